from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from swarmstart.cases.kinds.formation_flight.measures import measure
from swarmstart.cases.kinds.formation_flight.names import MEASURES
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.ocp import Decision, Plan, Source, Trajectory
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.arrays import Array
    from swarmstart.tests.cases.kinds.formation_flight.conftest import Fly

UAVS, SUBSTEPS, STEPS = 5, 4, 20
DENSE = STEPS * SUBSTEPS + 1
X, Y = 2, 3


def still(steps: int = STEPS) -> Array:
    return np.zeros((UAVS, 4, steps * SUBSTEPS + 1))


@pytest.fixture
def measured(scenario: FormationScenario, flight: FormationFlight, by_hand: Fly) -> Any:
    def from_offsets(offsets: Array, **how: Any) -> Any:
        return measure(scenario, flight, by_hand(offsets, **how))

    return from_offsets


def test_everybody_in_the_slot_from_the_start(measured: Any) -> None:
    found = measured(still())
    assert found.keys() == MEASURES.keys()
    assert found["settle_time_s"] == 0.0
    assert found["tail_error_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["closed_loop_cost"] == pytest.approx(0.0, abs=1e-20)
    assert found["lone_failure"] == 0
    assert found["evaluations"] == UAVS * STEPS * 10
    assert found["step_seconds_median"] == 10.5 and found["step_seconds_max"] == 20.0


def test_settling_is_the_first_instant_after_the_last_excursion(measured: Any) -> None:
    offsets = still()
    offsets[1, X, : 3 * SUBSTEPS + 1] = 2.0  # until 3 s
    offsets[4, Y, 7 * SUBSTEPS] = -1.01  # again at 7 s
    offsets[2, X, 9 * SUBSTEPS :] = 1.0  # exactly the limit does not count
    offsets[3, Y, 10 * SUBSTEPS + 1] = 50.0  # between the control instants: neither
    assert measured(offsets)["settle_time_s"] == 8.0


def test_a_shape_is_there_at_a_tenth_of_the_smallest_distance_of_two_slots(
    measured: Any,
) -> None:
    """Slots of the V are 15 m apart in x and in y."""
    limit = 15 * math.sqrt(2) / 10
    offsets = still()
    offsets[1, X, : 3 * SUBSTEPS + 1] = limit + 0.01  # until 3 s
    offsets[4, Y, 7 * SUBSTEPS] = 0.01 - limit
    found = measured(offsets)
    assert (found["shape_time_s"], found["settle_time_s"]) == (4.0, 8.0)
    offsets[0, Y, -1] = -limit - 0.01
    assert measured(offsets)["shape_time_s"] is None


def test_never_settled_is_null(measured: Any) -> None:
    offsets = still()
    offsets[0, Y, -1] = -1.5
    assert measured(offsets)["settle_time_s"] is None


def test_the_tail_is_the_last_ten_seconds(measured: Any) -> None:
    offsets = still()
    offsets[1, X, 10 * SUBSTEPS] = -3.0  # at 10 s of 20: the first of the tail
    offsets[0, X, 9 * SUBSTEPS] = 30.0  # before
    offsets[2, Y, -1] = 0.25
    found = measured(offsets)
    assert found["tail_error_m"] == pytest.approx(3.0)
    assert found["tail_error_by_uav_m"] == pytest.approx([0.0, 3.0, 0.25, 0.0, 0.0])


@pytest.mark.parametrize(
    ("off", "lone"), [([], 0), ([4], 5), ([0], 1), ([1, 4], 0), ([0, 1, 2, 3, 4], 0)]
)
def test_a_lone_failure_is_named_and_several_are_none(
    off: list[int], lone: int, measured: Any
) -> None:
    offsets = still()
    offsets[off, X, -1] = 5.0
    assert measured(offsets)["lone_failure"] == lone
    assert measured(offsets)["plan_cost"] is None  # There are hundreds of plans.


def test_the_cost_is_the_sum_over_steps_and_uavs(measured: Any) -> None:
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(UAVS, 4, DENSE))
    controls = rng.normal(size=(2 * UAVS, STEPS))
    naive = 0.0
    for k in range(STEPS):
        for uav in range(UAVS):
            error = offsets[uav, :, k * SUBSTEPS]
            for entry in (*error, controls[2 * uav, k], controls[2 * uav + 1, k]):
                naive += float(entry) ** 2
    found = measured(offsets, controls=controls)["closed_loop_cost"]
    assert found == pytest.approx(naive, rel=1e-10)  # the slots are added and taken off


def test_distances_are_measured_between_the_samples_too(
    measured: Any, flight: FormationFlight
) -> None:
    offsets, between = still(), 5 * SUBSTEPS + 2
    times = np.linspace(0.0, STEPS, DENSE)
    slots = flight.posed.slots(times)
    # UAV 2 is 1 m beside UAV 1 between two samples only.
    beside = slots[0, :, between] - slots[1, :, between] + np.array([0, 0, 0.6, 0.8])
    offsets[1, :, between] = beside
    found = measured(offsets)
    apart = math.inf
    for one in range(UAVS):
        for other in range(one):
            difference = slots[one, X:, 0] - slots[other, X:, 0]
            apart = min(apart, float(np.hypot(*difference)))
    assert found["min_distance_m"] == pytest.approx(1.0)
    assert found["min_distance_sampled_m"] == pytest.approx(apart)


def test_clearance_is_to_the_edge_and_negative_inside(
    measured: Any, flight: FormationFlight, scenario: FormationScenario
) -> None:
    (disc,) = scenario.obstacles
    offsets = np.zeros((UAVS, 4, DENSE))
    slots = flight.posed.slots(np.linspace(0.0, STEPS, DENSE))
    offsets[:, Y] += 1000.0  # all UAVs far away
    offsets[3, 0] = -slots[3, 0]  # it stands at each step: so none passes nearer
    inside, outside = 3 * SUBSTEPS + 1, 6 * SUBSTEPS
    for number, y in ((inside, disc.y_m + 2.0), (outside, disc.y_m + 17.0)):
        offsets[3, X, number] = disc.x_m - slots[3, X, number]
        offsets[3, Y, number] = y - slots[3, Y, number]
    found = measured(offsets)
    assert found["obstacle_clearance_m"] == pytest.approx(2.0 - disc.radius_m)
    assert found["obstacle_clearance_sampled_m"] == pytest.approx(17.0 - disc.radius_m)


def test_speeds_are_the_extremes_of_any_uav(measured: Any) -> None:
    offsets = still()
    offsets[2, 0, 3], offsets[4, 0, 9] = -17.0, 12.5
    found = measured(offsets)
    assert found["speed_min_m_s"] == pytest.approx(-2.0)  # the leader flies 15 m/s
    assert found["speed_max_m_s"] == pytest.approx(27.5)


def test_a_step_without_a_plan_of_its_own_counts_once(measured: Any) -> None:
    def plan(step: int, uav: int) -> dict[str, Any]:
        if step in (0, 1) and uav in (1, 3):  # two UAVs in one step: one step
            return {"feasible": False}
        if step == 4 and uav == 2:  # the shifted plan is feasible, but nothing new is
            return {"source": Source.SHIFTED}
        return {"feasible": step != 7}  # a linear step plans nothing

    assert measured(still(), plan=plan, linear={7})["infeasible_steps"] == 3


def test_exits_and_the_fall_of_the_level_are_of_linear_steps(
    measured: Any, flight: FormationFlight
) -> None:
    offsets = still()
    edge = math.sqrt(
        flight.posed.terminal_set.alpha / flight.posed.terminal_set.P[X, X]
    )
    offsets[0, X, 3 * SUBSTEPS] = 0.5 * edge
    offsets[0, X, 4 * SUBSTEPS] = 0.25 * edge  # a quarter of the level
    offsets[0, X, 8 * SUBSTEPS] = 0.5 * edge
    offsets[0, X, 9 * SUBSTEPS] = 1.01 * edge  # out
    offsets[0, X, 13 * SUBSTEPS] = 9.0 * edge  # out, but planned
    found = measured(offsets, linear={3, 8})
    assert found["linear_steps"] == 2
    assert found["terminal_exits"] == 1
    assert found["lyapunov_ratio_max"] == pytest.approx(2.02**2)
    assert measured(offsets, linear={3})["lyapunov_ratio_max"] == pytest.approx(0.25)
    assert measured(offsets)["lyapunov_ratio_max"] is None
    assert measured(offsets)["terminal_exits"] is None  # none was flown: none is kept


def test_what_belongs_to_the_set_does_not_depend_on_the_flight(
    measured: Any, flight: FormationFlight
) -> None:
    found = measured(still())
    assert found["terminal_level"] == flight.posed.terminal_set.alpha
    assert found["held_spectral_radius"] < 1.0
    assert found["input_excess_ratio"] <= 1.0 + 1e-9


def test_one_uav_without_obstacles_has_no_distances(
    make: Callable[..., FormationScenario],
) -> None:
    start, slot = "{speed_m_s: 15, heading_rad: 0, x_m: 0, y_m: 0}", "{x_m: 0, y_m: 0}"
    scenario = make("formation_v", f"uavs=[{{start: {start}, slot: {slot}}}]")
    flight = build(scenario)
    plan = Plan(
        controls=np.zeros((2, 8)),
        states=np.empty((0, 0)),
        cost=0.0,
        violation=0.0,
        feasible=True,
        source=Source.SEARCH,
    )
    states = np.outer(flight.x0, np.ones(2))
    alone = Trajectory(
        times=np.array([0.0, 1.0]),
        states=states,
        controls=np.zeros((2, 1)),
        dense_times=np.array([0.0, 1.0]),
        dense_states=states,
        decisions=(Decision(control=np.zeros(2), plans=(plan,)),),
        step_seconds=np.ones(1),
    )
    found = measure(scenario, flight, alone)
    for name in ("min_distance", "obstacle_clearance"):
        assert found[f"{name}_m"] is None and found[f"{name}_sampled_m"] is None
