"""Phases in closed loop: closed forms, the plain receding horizon, another plant."""

from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.record.results import load
from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    PhasedHorizon,
    Planner,
    Plant,
    RecedingHorizon,
    Trajectory,
    phased_horizon,
    phases,
    simulate,
    solve,
)
from swarmstart.ocp.statement.phases import Linkage

X, V, U, K, T = (ca.SX.sym(n) for n in ("x", "v", "u", "k", "t"))
LINKS = [{"v": 0.9 * V}]


def leg(push: ca.SX = U, **more: object) -> OptimalControlProblem:
    stated: dict[str, object] = {
        "intervals": 6,
        "stage_cost": 1 + U**2,
        "bounds": Bounds(controls=(-4, 4)),
    }
    model = more.pop("model", None) or Model(
        states=ca.vertcat(X, V), controls=U, ode=ca.vertcat(V, push)
    )
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


TWO = [
    leg(horizon=Free(0.2, 3), terminal=[(X, 0.5)]),
    leg(2 * U, horizon=Free(0.2, 3), terminal=[(X, 2.0), (V, 0.0)]),
]


def looped(
    stated: list[OptimalControlProblem],
    links: Sequence[Linkage] = LINKS,
    period: float = 0.25,
) -> PhasedHorizon:
    return phased_horizon(stated, links, period=period, polish=IpoptOptions())


def flown(loop: PhasedHorizon, **parameters: float) -> Trajectory:
    plant = loop.plant(substeps=24, parameters=parameters)
    return simulate(plant, loop, loop.start([0.0, 0.0]), steps=60, seed=0)


def test_without_disturbance_the_flight_is_nearly_the_plan() -> None:
    both = phases(TWO, LINKS)
    plan = solve(both.problem, both.start([0.0, 0.0]), search=None, seed=0)
    flight = flown(looped(TWO))
    assert all(decision.plans[0].feasible for decision in flight.decisions)
    # More intervals than in the plan, so slightly less is lost.
    first = flight.decisions[0].plans[0]
    assert first.cost == pytest.approx(plan.cost, rel=1e-7)
    assert flight.times[-1] == pytest.approx(sum(plan.decided.values()), rel=5e-3)
    cost = 0.0
    for decision, dt in zip(flight.decisions, np.diff(flight.times), strict=True):
        assert decision.profile is not None
        held = decision.profile.sampled(0.0, float(dt), 24)
        cost += dt * (1 + np.mean(held**2))
    assert plan.cost * 0.99 < cost < plan.cost * 1.001
    assert flight.states[:2, -1] == pytest.approx([2.0, 0.0], abs=1e-6)
    # Each phase's last step is its remaining time.
    phase = flight.states[flight.state_names.index("phase")]
    (change,) = np.flatnonzero(np.diff(phase))
    assert flight.states[0, change + 1] == pytest.approx(0.5, abs=1e-6)
    dense = flight.dense_states[1, (change + 1) * 24 - 1 : (change + 1) * 24 + 1]
    assert dense[1] == pytest.approx(0.9 * dense[0], abs=2e-2)


def test_phases_of_given_lengths_end_when_they_must() -> None:
    fixed = [
        leg(horizon=1.0, terminal=[(X, 0.5)]),
        leg(2 * U, horizon=0.9, terminal=[(X, 1.2), (V, 0.0)]),
    ]
    flight = flown(looped(fixed))
    ends = [*np.arange(0.25, 1.8, 0.25), 1.9]
    np.testing.assert_allclose(flight.times[1:], ends, atol=1e-9)
    assert flight.states[0, 4] == pytest.approx(0.5, abs=1e-7)
    assert flight.states[:2, -1] == pytest.approx([1.2, 0.0], abs=1e-7)


def test_length_may_not_leave_its_bounds_by_being_planned_anew() -> None:
    long = [leg(horizon=Free(1.3, 1.6), terminal=[(X, 0.5)]), TWO[1]]
    # The best first phase lasts 1.15 s.
    flight = flown(looped(long))
    phase = flight.states[flight.state_names.index("phase")]
    (change,) = np.flatnonzero(np.diff(phase))
    assert flight.times[change + 1] == pytest.approx(1.3, abs=1e-6)


def test_one_phase_is_a_receding_horizon_of_a_free_end_time() -> None:
    alone = leg(horizon=Free(0.01, 5), terminal=[(X, 1.0), (V, 0.0)])
    loop = RecedingHorizon(
        planner=Planner(alone, search=None, polish=IpoptOptions()), period=0.25
    )
    plant = Plant(alone.model, dt=0.25, substeps=24)
    expected = simulate(plant, loop, [0.0, 0.0], steps=60, seed=0)
    found = flown(looped([alone], ()))
    np.testing.assert_allclose(found.times, expected.times, atol=1e-3)
    np.testing.assert_allclose(found.states[:2], expected.states, atol=1e-3)


def test_a_weaker_plant_is_brought_to_the_end_by_planning_anew() -> None:
    model = Model(
        states=ca.vertcat(X, V), controls=U, ode=ca.vertcat(V, K * U), parameters=K
    )
    stated = [
        leg(horizon=Free(0.2, 3), terminal=[(X, 0.5)], model=model),
        leg(horizon=Free(0.2, 4), terminal=[(X, 2.0), (V, 0.0)], model=model),
    ]
    loop = phased_horizon(
        stated, LINKS, period=0.1, polish=IpoptOptions(), parameters={"k": 1.0}
    )
    flight = flown(loop, k=0.8)
    assert flight.states[0, -1] == pytest.approx(2.0, abs=2e-2)
    assert flight.times[-1] > 3.0


def test_decided_parameters_and_time_are_those_of_the_flight() -> None:
    """v' = k u + sin(t): t is the time of the whole run, also in the second phase."""
    model = Model(
        states=ca.vertcat(X, V),
        controls=U,
        ode=ca.vertcat(V, K * U + ca.sin(T)),
        parameters=K,
        time=T,
    )
    stated = [
        leg(horizon=1.0, model=model, decided={"k": Free(0.5, 1.0)}),
        leg(horizon=1.0, model=model, terminal=[(X, 1.0), (V, 0.0)],
            decided={"k": Free(0.5, 1.0)}),
    ]  # fmt: skip
    flight = flown(looped(stated, ()))
    # A stronger engine needs less: the lower bound, in every plan.
    assert all(d.decided["k"] == pytest.approx(1.0) for d in flight.decisions)
    assert flight.states[:2, -1] == pytest.approx([1.0, 0.0], abs=1e-4)
    assert flight.times[-1] == pytest.approx(2.0)


def test_phases_may_have_states_and_controls_of_their_own(tmp_path: Path) -> None:
    w, r = ca.SX.sym("w"), ca.SX.sym("r")
    second = OptimalControlProblem(
        Model(
            states=ca.vertcat(X, w), controls=ca.vertcat(r, U), ode=ca.vertcat(w + r, U)
        ),
        horizon=0.8,
        intervals=4,
        stage_cost=r**2 + U**2,
        bounds=Bounds(controls=(-4, 4)),
        terminal=[(X, 2.0), (w, 0.0)],
    )
    stated = [leg(horizon=1.1, terminal=[(X, 0.5)]), second]
    loop = looped(stated, [{"w": V / 2}], period=0.4)
    flight = flown(loop)
    assert flight.state_names[:3] == ("x", "v", "w")
    assert flight.control_names == ("u", "r")
    assert (flight.controls[1, :3] == 0).all() and flight.controls[1, 3:].all()
    assert flight.states[[0, 2], -1] == pytest.approx([2.0, 0.0], abs=1e-6)
    kept = load(flight.save(tmp_path / "flight")).trajectory
    assert kept is not None
    np.testing.assert_array_equal(kept.times, flight.times)
    for one, other in zip(kept.decisions, flight.decisions, strict=True):
        np.testing.assert_array_equal(one.plans[0].controls, other.plans[0].controls)
        assert one.profile is not None and other.profile is not None
        np.testing.assert_array_equal(one.profile.controls, other.profile.controls)


@pytest.mark.parametrize(
    ("stated", "more", "words"),
    [
        (TWO, {"period": 0.0}, "period must be a finite number above 0"),
        (TWO, {"period": np.nan}, "period must be a finite number"),
        (TWO, {"parameters": {"k": 1.0}}, "values of nothing, got k"),
        ([leg(horizon=1.0, start={"x": Free(0, 1)})], {}, "no decided start, phase 1"),
        ([leg(horizon=1.0, initial_cost=X)], {}, "no initial cost, phase 1 has"),
        ([leg(horizon=1.0, periodic=["x"])], {}, "no periodic states"),
    ],
)
def test_what_cannot_be_flown_is_refused(
    stated: list[OptimalControlProblem], more: dict[str, object], words: str
) -> None:
    given = {"period": 0.25, "polish": IpoptOptions(), **more}
    with pytest.raises(InvalidProblemError, match=words):
        phased_horizon(stated, **given)  # type: ignore[arg-type]
    for wrong in ([1.0], [1.0, np.nan]):
        with pytest.raises(InvalidProblemError, match="a finite number for each of x"):
            looped(TWO).start(wrong)
