"""Distances over whole flights by an independent integration; limits and models."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import casadi as ca
import numpy as np
import pydantic
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.parts import Part, Range
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import (
    METRE,
    SAME_PLACE_M,
    PlanarState,
    PlantPart,
    Point,
    Thrust,
    bank_flaws,
    bank_to_turn,
    by_uav,
    distance,
    flown_positions,
    largest_pair_distance,
    near_place_flaws,
    pair_distances,
    shortest_assignment,
    smallest,
    smallest_pair_distance,
    smallest_range,
    speed_bounds,
    speed_limit_flaws,
    start_speed_flaws,
    unicycle,
)
from swarmstart.ocp import DenseOutput, InvalidProblemError, Model

UAVS = 5


def rate(_: float, states: Array, controls: Array) -> Array:
    """The unicycles of (5.1), one after the other."""
    (v, psi, _x, _y), (u, omega) = states.reshape(-1, 4).T, controls.reshape(-1, 2).T
    return np.stack([u, omega, v * np.cos(psi), v * np.sin(psi)], axis=1).ravel()


def dop853(x0: Array, controls: Array) -> Array:
    """Return the states of a flight every 0.1 ms; controls are held for 1 s."""
    exact, parts = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10}, [x0[:, None]]
    for held in controls.T:
        start = parts[-1][:, -1]
        found = solve_ivp(rate, (0, 1), start, dense_output=True, args=(held,), **exact)
        parts.append(found.sol(np.linspace(0.0, 1.0, 10_001)))
    return np.hstack(parts)


def test_reported_distances_are_those_of_dop853() -> None:
    """At 0.1 ms a grid is off by 1e-6 m, as UAVs pass at 30 m/s; at 50 ms by 0.1 m."""
    short = ["steps=6", "budget.evaluations=1000"]
    resolved = resolve(
        read_document("formation_obstacle"), variant="corrected", assignments=short
    )
    scenario, flown = resolved.scenario, run(resolved, seed=0)
    assert isinstance(scenario, FormationScenario)
    exact = dop853(flown.flight.x0, flown.trajectory.controls)
    smallest = pair_distances(exact, UAVS).min()
    assert flown.measures["min_distance_m"] == pytest.approx(smallest, abs=1e-5)
    (disc,) = scenario.obstacles
    x, y = exact[2::4] - disc.x_m, exact[3::4] - disc.y_m
    nearest = np.hypot(x, y).min() - disc.radius_m
    assert flown.measures["obstacle_clearance_m"] == pytest.approx(nearest, abs=1e-5)
    # The steps of the plant alone do not see it.
    assert pair_distances(flown.trajectory.dense_states, UAVS).min() > smallest + 1e-4


def standing(*places: tuple[float, float]) -> Array:
    return np.tile(np.array(places)[:, :, None, None], (1, 1, 3, 6))


def test_distances_of_pairs_and_of_those_asked_for() -> None:
    positions = standing((0, 0), (3, 4), (3, 0))
    assert smallest_pair_distance(positions) == 3.0
    assert largest_pair_distance(positions) == 5.0
    assert largest_pair_distance(positions, pairs=[(0, 2), (2, 1)]) == 4.0
    assert smallest_range(positions, Point(x_m=3, y_m=-2)) == 2.0
    for order in itertools.permutations(((0, 0), (3, 4), (3, 0))):
        assert smallest_pair_distance(standing(*order)) == 3.0
        assert largest_pair_distance(standing(*order)) == 5.0


def test_without_a_pair_there_is_no_distance() -> None:
    assert smallest_pair_distance(standing((1, 2))) is None
    assert largest_pair_distance(standing((1, 2))) is None
    assert largest_pair_distance(standing((0, 0), (3, 4)), pairs=[]) is None


def between(lower: float, upper: float) -> Range:
    return Range.model_validate([lower, upper])


HALF_TURN, WIDER = math.pi / 2, math.nextafter(math.pi / 2, 4.0)


@pytest.mark.parametrize(
    ("turn", "lower", "upper", "is_flaw"),
    [
        ("sin", -HALF_TURN, HALF_TURN, False),
        ("sin", -WIDER, 1.0, True),
        ("sin", -1.0, WIDER, True),
        ("tan", -1.0, HALF_TURN, True),
        ("tan", -HALF_TURN, 1.0, True),
        ("tan", -1.5, 1.5, False),
    ],
)
def test_bank_is_less_than_a_quarter_of_a_turn(
    turn: str, lower: float, upper: float, is_flaw: bool
) -> None:
    found = [*bank_flaws(turn, between(lower, upper))]
    told = f"expected limits between -pi/2 and pi/2, found [{lower:g}, {upper:g}]"
    assert found == ([(("bank_rad",), told)] if is_flaw else [])


def test_speed_that_a_heading_rate_is_divided_by_is_above_zero() -> None:
    assert [*speed_limit_flaws(between(1e-9, 5))] == []
    for lower in (0.0, -2.0):
        ((place, told),) = speed_limit_flaws(between(lower, 5))
        assert place == ("speed_m_s",)
        assert told == (
            "expected a lower limit above 0, since the heading rate divides by the "
            f"speed; found {lower:g}"
        )


@pytest.mark.parametrize(("speed", "is_flaw"), [(2, 0), (5, 0), (1.9, 1), (5.1, 1)])
def test_speed_at_the_start_is_within_its_limits(speed: float, is_flaw: int) -> None:
    place = ("uavs", 3, "speed_m_s")
    found = [*start_speed_flaws(place, speed, between(2, 5))]
    told = f"expected a speed within vehicle.speed_m_s [2, 5], found {speed:g}"
    assert found == [(place, told)] * is_flaw


class Placed(Part):
    """A UAV with two places."""

    start: Point
    target: Point


def test_places_are_nearer_than_allowed_only_below_the_distance() -> None:
    """The starts of the first two and the targets of the others; 5 m are enough."""
    starts, targets = [(0, 0), (3, 3.9), (9, 9)], [(50, 0), (3, 0), (0, 4)]
    uavs = [
        Placed(start=Point(x_m=a, y_m=b), target=Point(x_m=c, y_m=d))
        for (a, b), (c, d) in zip(starts, targets, strict=True)
    ]
    assert distance(uavs[0].start, uavs[1].start) == math.hypot(3, 3.9)
    found = [*near_place_flaws(uavs, ("start", "target"), 5.0, [7, 8, 9])]
    assert found == [
        (
            ("uavs", 1, "start"),
            "expected a start at least 5 m (safe_distance_m) from that of UAV 7, found "
            "4.92037 m",
        )
    ]
    # Both are 5 m apart now.
    assert [*near_place_flaws(uavs[1:], ("target",), 5.0, [8, 9])] == []
    ((place, told),) = near_place_flaws(uavs[1:], ("target",), 5.001, [8, 9])
    assert place == ("uavs", 1, "target") and "UAV 8, found 5 m" in str(told)


def test_bounds_of_stacked_states_are_those_of_the_speeds() -> None:
    assert speed_bounds(None, uavs=3) is None
    inf = np.inf
    bounds = speed_bounds(between(2, 9))
    assert bounds is not None
    np.testing.assert_array_equal(bounds, [[2, -inf, -inf, -inf], [9, inf, inf, inf]])
    several = speed_bounds(between(2, 9), uavs=3)
    assert several is not None
    for one, three in zip(bounds, several, strict=True):
        np.testing.assert_array_equal(three, [*one] * 3)


def test_distances_along_stacked_states_are_those_of_their_positions() -> None:
    rng = np.random.default_rng(0)
    stacked = rng.normal(size=(12, 7))
    apart = pair_distances(stacked, 3)
    assert by_uav(stacked, 3).shape == (3, 4, 7)
    for row, (i, j) in zip(apart, ((0, 1), (0, 2), (1, 2)), strict=True):
        x, y = (stacked[4 * i + k] - stacked[4 * j + k] for k in (2, 3))
        np.testing.assert_allclose(row, np.hypot(x, y))
    assert smallest(apart) == apart.min()
    assert smallest(pair_distances(stacked[:4], 1)) is None


def test_positions_of_a_path_are_its_third_and_fourth_rows() -> None:
    curves = np.random.default_rng(0).normal(size=(8, 5, 6))
    path = cast(DenseOutput, SimpleNamespace(curves=curves))
    positions = flown_positions(path, 2)
    np.testing.assert_array_equal(positions, [curves[2:4], curves[6:8]])


def test_state_of_a_uav_is_its_vector_and_its_velocity() -> None:
    state = PlanarState(speed_m_s=2, heading_rad=math.pi / 6, x_m=3, y_m=-4)
    assert state.vector() == [2, math.pi / 6, 3, -4]
    np.testing.assert_allclose(state.velocity(), [3**0.5, 1.0])
    assert distance(state, Point(x_m=0, y_m=0)) == 5.0
    assert PlantPart().substeps == 20
    for count in (1, 1000):
        assert PlantPart(substeps=count).substeps == count
    for count in (0, 1001):
        with pytest.raises(pydantic.ValidationError):
            PlantPart(substeps=count)


@pytest.mark.parametrize(
    ("model", "push", "turn"),
    [
        (unicycle(), 0.3, 0.7),
        (bank_to_turn(turn="sin"), 0.3, 9.8 * math.sin(0.7) / 5),
        (bank_to_turn(turn="tan"), 0.3, 9.8 * math.tan(0.7) / 5),
        (
            bank_to_turn(
                turn="tan", thrust=Thrust(drag=2, weight=4, equation="printed")
            ),
            (0.3 - 2) / 4,
            9.8 * math.tan(0.7) / 5,
        ),
        (
            bank_to_turn(
                turn="sin", thrust=Thrust(drag=2, weight=4, equation="newton")
            ),
            9.8 * (0.3 - 2) / 4,
            9.8 * math.sin(0.7) / 5,
        ),
    ],
)
def test_rates_of_the_models_are_those_of_the_equations(
    model: Model, push: float, turn: float
) -> None:
    rates = ca.Function("rates", [model.states, model.controls], [model.ode])
    found = np.array(rates([5, 0.4, 70, 80], [0.3, 0.7])).ravel()
    expected = [push, turn, 5 * math.cos(0.4), 5 * math.sin(0.4)]
    np.testing.assert_allclose(found, expected)
    assert model.state_names == ("speed_m_s", "heading_rad", "x_m", "y_m")


def test_units_of_the_chapter_are_metres_and_its_places_exact() -> None:
    """A billionth of a metre is rounding only; so a penalty of 1 is one of 1 m."""
    assert METRE == 1.0
    assert SAME_PLACE_M == 1e-9


def test_turn_that_is_unknown_is_refused() -> None:
    with pytest.raises(InvalidProblemError, match="turn must be sin or tan, got 'cos'"):
        bank_to_turn(turn="cos")  # type: ignore[arg-type]


def test_assignment_has_the_least_sum_of_squares_of_all() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        starts, targets = rng.normal(size=(2, 5, 2))
        found = shortest_assignment(starts, targets)

        def total(order: Sequence[int], s: Array = starts, t: Array = targets) -> float:
            return float(((s - t[list(order)]) ** 2).sum())

        best = min(itertools.permutations(range(5)), key=total)
        assert tuple(found) == best
