"""Flights as arrays and back; each plan counts once."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.record.trajectory_arrays import (
    control_rows,
    effort,
    held_controls,
    new_plans,
    plan_costs,
    planned,
    step_table,
    trajectory_arrays,
    trajectory_of,
)
from swarmstart.ocp import (
    Decision,
    Mode,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Source,
    Trajectory,
)
from swarmstart.ocp.statement import Profile
from swarmstart.tests.cases.record.test_partial import SUBSTEPS, flight


@pytest.fixture(scope="module")
def planner() -> Planner:
    """x' = u, x(1) = 1."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=1, terminal=[x - 1]
    )
    return Planner(problem, search=None, backend="casadi")


def plan(planner: Planner, control: float, source: Source) -> Plan:
    return planner.evaluated(np.array([[control]]), [0.0], source=source)


def test_step_under_the_linear_law_is_not_planned(planner: Planner) -> None:
    plans = (plan(planner, 1.0, Source.LINEAR),)
    decisions = (
        Decision(control=np.ones(1), plans=plans, mode=mode)
        for mode in (Mode.PLANNED, Mode.LINEAR)
    )
    assert [planned(decision) for decision in decisions] == [True, False]


def test_a_plan_that_several_steps_fly_counts_once() -> None:
    """An open loop of 50 steps had 1,002,350 evaluations for 20,047."""
    made = flight(1).decisions[0]
    plans = tuple(replace(plan, evaluations=20_047) for plan in made.plans)
    flown = [Decision(control=made.control, plans=plans) for _ in range(50)]
    later = tuple(replace(plan, evaluations=3) for plan in plans)
    flown += [Decision(control=made.control, plans=(plans[0], later[1]))] * 2
    whole = replace(
        flight(len(flown)), decisions=tuple(flown), step_seconds=np.ones(len(flown))
    )
    assert effort(whole)["evaluations"] == 2 * 20_047 + 3
    assert np.argwhere(new_plans(whole.decisions)).tolist() == [[0, 0], [0, 1], [50, 1]]


def test_plans_that_are_equal_count_each() -> None:
    made = flight(1).decisions[0]
    again = replace(made, plans=tuple(replace(plan) for plan in made.plans))
    assert new_plans((made, again)).all()


def random_flight(kind: str, count: int, rng: np.random.Generator) -> Trajectory:
    """Return a flight of 1 s a step whose plans differ in shape; two agents, nu = 2.

    Args:
        kind: What the decisions have beside their plans: "nothing"; only "lengths"; an
            "end" alone; "held" controls of their own; the "plan" that is held on;
            "lines" to one knot or along the plan.
        count: Number of steps.
        rng: Source of all randomness.
    """
    whole, decisions = flight(count), list[Decision]()
    for made in whole.decisions:
        plans = tuple(
            replace(
                plan,
                controls=rng.normal(size=(2 + agent, int(rng.integers(1, 5)))),
                start=rng.normal(size=3 + agent) if rng.random() < 0.7 else None,
                start_excess=rng.random() - 0.5,
            )
            for agent, plan in enumerate(made.plans)
        )
        if decisions and rng.random() < 0.3:
            plans = (decisions[-1].plans[0], plans[1])
        control, piece = rng.normal(size=2), int(rng.integers(1, 4)) / SUBSTEPS
        own = rng.normal(size=(2, int(rng.integers(1, 5))))
        line = rng.random() < 0.5
        profile = {
            "held": Profile(controls=own, piece=piece),
            "plan": Profile(controls=plans[0].controls, piece=piece),
            "lines": Profile(
                controls=own[:, :1] if line else plans[0].controls,
                piece=1.0 if line else piece,
                start=control,
            ),
        }.get(kind)
        has_length = kind in ("lengths", "held", "lines") and rng.random() < 0.7
        decisions.append(
            replace(
                made, control=control, plans=plans,
                dt=float(rng.random()) if has_length else None,
                profile=profile if rng.random() < 0.7 else None,
            )
        )  # fmt: skip
    if kind in ("end", "lines"):
        decisions[-1] = replace(decisions[-1], is_last=True)
    controls = np.stack([d.control for d in decisions], axis=1)
    return replace(
        whole, decisions=tuple(decisions), controls=controls,
        control_names=("a", "b"),
    )  # fmt: skip


KINDS = ("nothing", "lengths", "end", "held", "plan", "lines")


@pytest.mark.parametrize("kind", KINDS)
def test_a_flight_that_is_read_back_is_the_same_flight(kind: str) -> None:
    rng = np.random.default_rng(0)
    for count in (1, 2, 3, 5, 5, 5, 5, 5):
        whole = random_flight(kind, count, rng)
        arrays = trajectory_arrays(whole)
        assert ("interval_s" in arrays) <= (kind != "nothing")
        if "profile_controls" in arrays:  # Needed only where plans have others.
            assert kind in ("held", "lines")
            for entry, decision in zip(
                arrays["profile_controls"], whole.decisions, strict=True
            ):
                assert np.isnan(entry).all() == (decision.profile is None)
        again = trajectory_of(arrays)
        for name in ("times", "states", "controls", "dense_times", "dense_states",
                     "step_seconds"):  # fmt: skip
            np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
        assert again.outputs.shape == (0, whole.dense_times.size)
        assert again.state_names == whole.state_names
        assert again.control_names == whole.control_names
        for one, other in zip(again.decisions, whole.decisions, strict=True):
            np.testing.assert_array_equal(one.control, other.control)
            assert (one.mode, one.dt, one.is_last) == (
                other.mode, other.dt, other.is_last,
            )  # fmt: skip
            assert_same_profile(one.profile, other.profile)
            for plan, old in zip(one.plans, other.plans, strict=True):
                assert_same_plan(plan, old)
        np.testing.assert_array_equal(
            new_plans(again.decisions), new_plans(whole.decisions)
        )
        np.testing.assert_array_equal(plan_costs(again), plan_costs(whole))
        np.testing.assert_allclose(
            plan_costs(whole), arrays["plan_cost"].sum(axis=1), rtol=1e-12
        )


def assert_same_profile(one: Profile | None, other: Profile | None) -> None:
    assert (one is None) == (other is None)
    if one is not None and other is not None:
        assert one.piece == other.piece
        assert one.is_held == other.is_held
        np.testing.assert_array_equal(one.controls, other.controls)
        np.testing.assert_array_equal(
            np.array(one.start, dtype=float), np.array(other.start, dtype=float)
        )


def assert_same_plan(one: Plan, other: Plan) -> None:
    for name in ("cost", "violation", "feasible", "source", "evaluations",
                 "polish_status", "start_excess"):  # fmt: skip
        assert getattr(one, name) == getattr(other, name)
    np.testing.assert_array_equal(one.controls, other.controls)
    np.testing.assert_equal(
        (one.search.cost, one.search.violation),
        (other.search.cost, other.search.violation),
    )
    np.testing.assert_array_equal(one.search.history, other.search.history)
    np.testing.assert_array_equal(one.search.evaluations, other.search.evaluations)
    np.testing.assert_array_equal(one.search.violations, other.search.violations)
    start = np.empty(0) if other.start is None else other.start
    assert one.start is not None
    np.testing.assert_array_equal(one.start, start)
    assert one.states.shape == (0, 0)  # They are not kept.


def test_a_plan_with_states_alone_keeps_the_first_of_them() -> None:
    made = flight(1)
    states = np.arange(6.0).reshape(2, 3)
    plans = tuple(replace(plan, states=states) for plan in made.decisions[0].plans)
    flown = replace(made, decisions=(replace(made.decisions[0], plans=plans),))
    np.testing.assert_array_equal(
        trajectory_arrays(flown)["plan_start"], [[[0.0, 3.0]] * 2]
    )


def control_at(decision: Decision, time: float) -> Array:
    """Return the control at a time after the beginning of a step, by the definition."""
    profile = decision.profile
    if profile is None:
        return decision.control
    if profile.start is None:
        piece = min(int(time / profile.piece + 1e-9), profile.controls.shape[1] - 1)
        return np.asarray(profile.controls[:, piece])
    knots = np.hstack([profile.start[:, None], profile.controls])
    at = profile.piece * np.arange(knots.shape[1])
    return np.array([np.interp(time, at, row) for row in knots])


@pytest.mark.parametrize("kind", KINDS)
def test_controls_between_the_steps_are_those_of_the_profiles(kind: str) -> None:
    """Pieces are whole steps of the plant here, so that no mean is taken."""
    rng = np.random.default_rng(1)
    for count in (1, 1, 2, 2, 3, 4, 4, 4):
        whole = random_flight(kind, count, rng)
        times, controls = held_controls(whole)
        rows = control_rows(whole)
        profiles = [d.profile for d in whole.decisions if d.profile is not None]
        if not profiles:
            assert times is whole.times and controls is whole.controls and rows is None
            continue
        assert times is whole.dense_times
        is_linear = kind == "lines"
        steps = np.arange(SUBSTEPS + is_linear) / SUBSTEPS
        expected = np.stack(
            [np.stack([control_at(d, t) for t in steps], axis=1)
             for d in whole.decisions], axis=1,
        )  # fmt: skip
        assert (rows is not None) == is_linear
        if rows is not None:
            np.testing.assert_allclose(rows, expected, rtol=1e-12)
            last = expected[:, -1, -1:]
            expected = expected[:, :, :-1]
        joined = np.hstack(list(expected.transpose(1, 0, 2)))
        joined = np.hstack([joined, last]) if is_linear else joined
        np.testing.assert_allclose(controls, joined, rtol=1e-12)


def test_effort_is_counted_over_all_steps() -> None:
    made = flight(3)
    outside = [(-1.0, 0.0), (0.5, -1.0), (0.0, 1e-9)]
    decisions = tuple(
        replace(d, plans=tuple(
            replace(plan, start_excess=excess)
            for plan, excess in zip(d.plans, pair, strict=True)
        ))
        for d, pair in zip(made.decisions, outside, strict=True)
    )  # fmt: skip
    found = effort(
        replace(made, decisions=decisions, step_seconds=np.array([1.0, 9.0, 2.0]))
    )
    assert found["steps_starting_outside"] == 2
    assert (found["step_seconds_median"], found["step_seconds_max"]) == (2.0, 9.0)


def test_the_table_of_one_step_has_a_column_for_each_agent() -> None:
    made = replace(flight(1), step_seconds=np.array([0.25]))
    sources = [plan.source.name for plan in made.decisions[0].plans]
    assert step_table(made).splitlines() == [
        "step,time_s,step_seconds,plan_1,plan_2", f"0,0,0.25,{','.join(sources)}",
    ]  # fmt: skip
