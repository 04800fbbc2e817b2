"""Margins for constraints that an answer breaks between the checks."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.ocp import (
    Bounds,
    Connection,
    Constraint,
    CountedFrom,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Separation,
    Solution,
    SolutionStatus,
    Source,
    TerminalConstraint,
    disc,
    solve,
    verified,
)
from swarmstart.ocp.answer import improving
from swarmstart.ocp.answer.repair import (
    added,
    at_points,
    finer_checks,
    has_segments,
    hurried,
    needed,
    place_of,
    slack_at_checks,
    tightened,
    with_more_checks,
)
from swarmstart.ocp.rollout.checking import Excess
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.rollout.path import Tracer
from swarmstart.ocp.system.separation import Along

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
DISCS = ((2.0, 0.3, 0.9), (4.2, -0.6, 1.0), (6.2, 0.5, 1.0), (8.2, -0.3, 0.9))


def moving(*constraints: Constraint, **stated: object) -> OptimalControlProblem:
    """A point that moves to the right at 1 m/s for 4 s, up with its control."""
    given = {"intervals": 4, "stage_cost": U**2, **stated}
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(1, U)),
        horizon=4.0,
        constraints=constraints,
        **given,  # type: ignore[arg-type]
    )


def excess(
    constraint: int, amount: float, *, row: int = 0, above: bool = False
) -> Excess:
    return Excess(
        name="row", amount=amount, scale=2.0, time=1.0, constraint=constraint, row=row,
        above=above,
    )  # fmt: skip


def margin(amount: float) -> float:
    """5 % more than measured, plus half of the path tolerance."""
    return 1.05 * amount + 1e-4 * 2.0 / 2


@given(amount=st.floats(1e-6, 10))
def test_separation_gets_a_margin_in_search_and_nlp(amount: float) -> None:
    stated = Separation(relative=X, distance=3.0, margin=0.5, smooth_margin=0.25)
    (tight,) = tightened(moving(stated), [excess(0, amount)]).constraints
    assert isinstance(tight, Separation)
    assert tight.distance == 3
    assert tight.margin == pytest.approx(0.5 + margin(amount))
    assert tight.smooth_margin == pytest.approx(0.25 + margin(amount))


@given(amount=st.floats(1e-6, 10))
def test_connection_keeps_half_of_its_distance(amount: float) -> None:
    stated = Connection(relative=X, distance=3.0, margin=1.0)
    (tight,) = tightened(moving(stated), [excess(0, amount)]).constraints
    assert isinstance(tight, Connection)
    assert tight.margin == pytest.approx(1 + min(margin(amount), 1.0))


@given(amount=st.floats(1e-6, 10), above=st.booleans(), row=st.integers(0, 2))
def test_path_constraint_gets_one_limit_moved_but_not_past_the_middle(
    amount: float, above: bool, row: int
) -> None:
    lower, upper = np.array([-np.inf, -1, 0]), np.array([5, 2, np.inf])
    stated = PathConstraint(expression=ca.vertcat(X, U), lower=lower, upper=upper)
    broken = excess(1, amount, row=row, above=above)
    if not np.isfinite((upper if above else lower)[row]):
        return  # What has no limit is not broken.
    problem = moving(disc(X, centre=[9, 9], radius=1), stated)
    other, tight = tightened(problem, [broken]).constraints
    assert other is problem.constraints[0]
    assert isinstance(tight, PathConstraint)
    moved = margin(amount) if row != 1 else min(margin(amount), 1.5)
    expected_lower, expected_upper = lower.copy(), upper.copy()
    if above:
        expected_upper[row] -= moved
    else:
        expected_lower[row] += moved
    np.testing.assert_allclose(np.asarray(tight.lower), expected_lower)
    np.testing.assert_allclose(np.asarray(tight.upper), expected_upper)
    assert np.asarray(stated.upper)[1] == 2


def test_equality_cannot_be_tightened() -> None:
    stated = PathConstraint(expression=X[0], lower=1, upper=1)
    (tight,) = tightened(moving(stated), [excess(0, 0.1, above=True)]).constraints
    assert isinstance(tight, PathConstraint)
    assert np.asarray(tight.lower) == np.asarray(tight.upper) == 1


@pytest.mark.parametrize(("row", "state"), [(0, 0), (1, 2)])
def test_bounds_of_states_move_for_the_state_of_the_row(row: int, state: int) -> None:
    """Bounds are the rows of the bounded states, after all other constraints."""
    x = ca.SX.sym("x", 3)
    problem = OptimalControlProblem(
        Model(states=x, controls=U, ode=ca.vertcat(U, U, U)),
        horizon=1.0,
        intervals=2,
        bounds=Bounds(
            controls=(-1, 1), states=([-5, -np.inf, -7], [np.inf, np.inf, 7]),
            state_scale=[1, 2, 3],
        ),
        constraints=[x[0] <= 9],
    )  # fmt: skip
    tight = tightened(problem, [excess(1, 0.1, row=row)])
    expected = problem.state_limits[0].copy()
    expected[state] += margin(0.1)
    np.testing.assert_allclose(tight.state_limits[0], expected)
    np.testing.assert_array_equal(tight.state_limits[1], problem.state_limits[1])
    np.testing.assert_array_equal(np.asarray(tight.bounds.state_scale), [1, 2, 3])
    np.testing.assert_array_equal(tight.control_limits[0], [-1])
    assert problem.state_limits[0][0] == -5


def test_margins_add_up_over_attempts() -> None:
    stated = Separation(relative=X, distance=3.0)
    once = tightened(moving(stated), [excess(0, 0.1)])
    (twice,) = tightened(once, [excess(0, 0.2)]).constraints
    assert isinstance(twice, Separation)
    assert twice.margin == pytest.approx(margin(0.1) + margin(0.2))


def evaluated(problem: OptimalControlProblem, controls: list[float]) -> Solution:
    planner = Planner(problem, search=None, backend="casadi")
    plan = planner.evaluated(np.array([controls]), [0, 0], source=Source.GUESS)
    return verified(problem, plan, [0, 0])


def test_needed_is_what_the_path_breaks_of_path_constraints() -> None:
    """Discs are passed at 1 m, with a small cut; the end needs no margin."""
    discs = [
        disc(X, centre=[1.5, 0.3], radius=0.4),  # Cut by 0.1.
        disc(X, centre=[2.5, 0.39999], radius=0.4),  # By 1e-5, below the tolerance.
        disc(X, centre=[3.5, -0.1], radius=0.4),  # By 0.3.
    ]
    problem = moving(
        *discs, terminal=[TerminalConstraint(expression=X[1], lower=5, upper=6)]
    )
    found = needed(problem, evaluated(problem, [0.0] * 4), [0, 0], NOTHING)
    assert [e.constraint for e in found] == [2, 0]
    np.testing.assert_allclose([e.amount for e in found], [0.3, 0.1], atol=1e-2)


def test_margin_begins_where_the_checks_are() -> None:
    """Between two checks, each 0.5 m away, the disc of 0.2 m is passed through.

    The checks have a distance of 0.3 m to the disc, so a smaller margin has no effect.
    With twice as many checks, the nearest one is at the centre, 0.2 m inside.
    """
    problem = moving(disc(X, centre=[2.5, 0.0], radius=0.2))
    answer = evaluated(problem, [0.0] * 4)
    for times, room in ((1, 0.3), (2, -0.2)):
        slack = slack_at_checks(Tracer(problem), answer, [0, 0], NOTHING, times)
        assert slack[0, 0] == pytest.approx(room)
    slack = slack_at_checks(Tracer(problem), answer, [0, 0], NOTHING, 1)
    (found,) = needed(problem, answer, [0, 0], NOTHING)
    (wanted,) = added({}, [found], slack, 1.0).values()
    assert wanted.amount == pytest.approx(0.3 + 0.2)


def test_slack_is_the_same_where_states_are_counted_from_far_away() -> None:
    """The point starts at 1e6 m, and its way is counted from there."""
    start = 1e6
    problem = moving(
        PathConstraint(expression=X[0] - start, upper=10.0),
        features=[CountedFrom({str(X[0]): start})],
    )
    answer = solve(problem, [start, 0.0], search=None, lanes=0, seed=0, repair=False)
    slack = slack_at_checks(Tracer(problem), answer, [start, 0.0], NOTHING, 1)
    # After 4 s it is 4 m away, 6 m below the limit.
    assert slack[0, 0] == pytest.approx(6.0)


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("nearest", [1.0, 2.0, 4.0])
def test_slack_is_that_at_the_checks_the_start_left_out(
    nearest: float, times: int
) -> None:
    """|x - nearest| is smallest, 0, at one check; at the start it would be less."""
    near = PathConstraint(
        expression=ca.if_else(X[0] < 0.25, -1, ca.fabs(X[0] - nearest)), lower=0
    )
    problem = moving(near)
    answer = evaluated(problem, [0.0] * 4)
    slack = slack_at_checks(Tracer(problem), answer, [0, 0], NOTHING, times)
    assert slack[0, 0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("times", [1, 2, 4])
def test_slack_counts_signals_and_parameters_at_its_own_checks(times: int) -> None:
    """x_0 = t below 2 p - s with s = |t - 3|, linear from node to node."""
    s, p = ca.SX.sym("s"), ca.SX.sym("p")
    problem = replace(
        moving(checks=2, signals=s),
        model=Model(states=X, controls=U, parameters=p, ode=ca.vertcat(1, U)),
        constraints=[PathConstraint(expression=2 * p - s - X[0], lower=0)],
    )
    known = Known(parameters=[2.75], signals=np.abs(problem.times - 3.0)[None])
    planner = Planner(problem, search=None, backend="casadi")
    controls = np.zeros((1, 4))
    plan = planner.evaluated(controls, [0, 0], known=known, source=Source.GUESS)
    answer = verified(problem, plan, [0, 0], known)
    slack = slack_at_checks(Tracer(problem), answer, [0, 0], known, times)
    assert slack[0, 0] == pytest.approx(5.5 - 1 - 4)  # Least at the end.


def test_margins_fall_with_the_square_of_the_distance_of_checks() -> None:
    first, other = excess(0, 0.1), excess(1, 0.4)
    before = added({}, [first], {}, 1.0)
    now = added(before, [other, excess(0, 0.3)], {}, 0.5)
    assert now[place_of(first)].amount == pytest.approx((0.1 + 0.3) / 4)
    assert now[place_of(other)].amount == pytest.approx(0.4 / 4)


def test_margin_with_little_effect_grows_by_the_secant() -> None:
    """From 0.4 to 0.1, so three quarters took effect; 0.1 / (3 / 4) is left."""
    row = excess(0, 0.1)
    for attempt, haste in ((0, 1.0), (1, 1.25), (2, 1.5)):
        (again,) = hurried([row], {place_of(row): 0.4}, attempt)
        assert again.amount == pytest.approx(haste * 0.1 / 0.75)
    (worse,) = hurried([row], {place_of(row): 0.05}, 0)
    assert worse.amount == pytest.approx(0.1 / 0.25)  # No effect: not believed.


def test_all_distances_share_the_least_margin() -> None:
    """5 % of its own distance for a pair that is not broken; a larger margin stays."""
    near, far = (Separation(relative=X, distance=d) for d in (1.0, 4.0))
    line = PathConstraint(expression=X[1], lower=-3.0)
    problem = moving(near, far, line)
    tight = tightened(problem, [excess(0, 0.3)], for_all=0.05).constraints
    margins = [c.margin for c in tight if isinstance(c, Separation)]
    assert margins == pytest.approx([1.05 * 0.3 + 0.5e-4, 1.05 * 0.05 * 4 + 2e-4])
    (same,) = [c for c in tight if isinstance(c, PathConstraint)]
    assert same.lower == pytest.approx([-3.0])


def test_margins_go_to_the_constraint_that_is_broken() -> None:
    """A bound of the states is the last constraint, also in the measurement."""
    box = Bounds(controls=(-9, 9), states=([-np.inf, -0.4], np.inf))
    problem = moving(disc(X, centre=[9, 9], radius=1), bounds=box, intervals=2)
    # Down for 2 s and up again, below the bound at 2 s, which is only a check.
    found = needed(problem, evaluated(problem, [-0.25, 0.25]), [0, 0], NOTHING)
    assert [(e.constraint, e.name) for e in found] == [(1, "the bound of state x_1")]
    assert found[0].amount == pytest.approx(0.1)
    tight = tightened(problem, found)
    assert tight.state_limits[0][1] > -0.4 + 0.1


def test_needed_leaves_out_what_is_not_a_number() -> None:
    problem = moving(PathConstraint(expression=ca.sqrt(2.5 - X[0]), upper=9))
    lost = evaluated(problem, [0.0] * 4)
    assert lost.path.broken[0].amount == np.inf
    assert needed(problem, lost, [0, 0], NOTHING) == []


def test_chords_of_segments_count_as_far_as_they_cut() -> None:
    """Up and down around the disc: the path has a corner at the node, but no chord."""
    stated = disc(X, centre=[1.5, -0.1], radius=0.4, along="segments", margin=0.05)
    problem = moving(stated, checks=1)
    found = needed(problem, evaluated(problem, [0.0] * 4), [0, 0], NOTHING)
    chord, path = sorted(found, key=lambda e: -e.amount)
    assert chord.name.startswith("the chord of")
    assert chord.amount == pytest.approx(0.35)  # The margin of the search included.
    assert path.amount == pytest.approx(0.3, abs=1e-3)
    assert (chord.constraint, chord.row, chord.time) == (0, 0, 2.0)
    assert len(needed(moving(replace(stated, along="points")),
                      evaluated(problem, [0.0] * 4), [0, 0], NOTHING)) == 1  # fmt: skip


def test_chord_is_that_of_the_control_of_its_own_interval() -> None:
    """Past the origin at 0.1 m in the third interval alone."""
    relative = ca.vertcat(X[0] - 2.5, U - 0.1)
    problem = moving(Separation(relative=relative, distance=0.4, along="segments"))
    found = needed(problem, evaluated(problem, [9, 9, 0, 9]), [0, 0], NOTHING)
    (chord,) = [e for e in found if e.name.startswith("the chord of")]
    assert chord.amount == pytest.approx(0.3)
    assert chord.time == 3


def test_points_take_the_place_of_segments_with_the_margin_of_the_nlp() -> None:
    problem = moving(
        disc(X, centre=[1, 1], radius=1, along="segments", margin=5, smooth_margin=0.5),
        PathConstraint(expression=X[0], upper=9),
    )
    assert has_segments(problem)
    points = at_points(problem)
    assert not has_segments(points)
    first = points.constraints[0]
    assert isinstance(first, Separation)
    assert (first.margin, first.smooth_margin) == (0.5, 0.5)
    assert points.constraints[1] is problem.constraints[1]


def four_discs(intervals: int, along: Along = "points") -> OptimalControlProblem:
    """Unit speed among four discs, from the origin to (10, 0), the time free."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
    w, T = u[0], u[1]
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=T * ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), w)),
        horizon=1.0,
        intervals=intervals,
        stage_cost=T + 0.1 * T * w**2,
        bounds=Bounds(controls=([-3, 10], [3, 20])),
        constraints=[
            disc(x[:2], centre=[a, b], radius=r, along=along) for a, b, r in DISCS
        ],
        terminal=[x[:2] - ca.vertcat(10, 0)],
        substeps=6,
    )


def clearance(solution: Solution) -> float:
    x, y = solution.path.states[:2]
    return min(float(np.hypot(x - a, y - b).min()) - r for a, b, r in DISCS)


@pytest.mark.parametrize(
    ("substeps", "times"),
    [(4, [1, 2, 4]), (6, [1, 2, 2]), (2, [1, 2, 2]), (3, [1, 2, 4]), (1, [1, 2, 4])],
)
def test_later_attempts_look_more_often_on_the_same_steps_if_these_can_be_shared(
    substeps: int, times: list[int]
) -> None:
    problem = moving(substeps=substeps)
    assert [finer_checks(problem, attempt) for attempt in range(3)] == times


@pytest.mark.parametrize(
    ("substeps", "times", "shared"), [(4, 2, 2), (5, 2, 3), (1, 4, 1), (6, 4, 2)]
)
def test_more_checks_have_steps_as_long_and_signals_in_between(
    substeps: int, times: int, shared: int
) -> None:
    s = ca.SX.sym("s", 2)
    problem = moving(signals=s, checks=3, substeps=substeps, intervals=2)
    known = Known(signals=np.array([np.arange(7.0) ** 2, 10.0 - np.arange(7.0)]))
    finer, there = with_more_checks(problem, known, times)
    assert (finer.checks, finer.substeps, finer.intervals) == (3 * times, shared, 2)
    at = np.linspace(0, 6, 6 * times + 1)
    expected = [np.interp(at, np.arange(7), row) for row in np.asarray(known.signals)]
    np.testing.assert_allclose(np.asarray(there.signals), expected, atol=1e-12)
    assert there.parameters is known.parameters


def test_excess_of_the_tolerance_itself_needs_no_margin() -> None:
    """Nor does one that is no number; what needs one comes in order."""
    edge = 2.0**-10
    line = PathConstraint(expression=X[0], upper=9.0)
    problem = moving(line, line, line, line, line, path_tolerance=edge)
    answer = evaluated(problem, [0.0] * 4)
    amounts = (2 * edge, 4 * edge * (1 + 1e-9), np.inf, 8 * edge, 2 * edge)
    broken = tuple(excess(k, amount) for k, amount in enumerate(amounts))
    solution = replace(answer, path=replace(answer.path, broken=broken))
    found = needed(problem, solution, [0, 0], NOTHING)
    assert [e.constraint for e in found] == [3, 1]


def test_margins_leave_soft_constraints_as_they_are() -> None:
    soft = PathConstraint(expression=X[1], upper=1.0, weight=2.0)
    apart = Separation(relative=X - 50, distance=2.0)
    problem = moving(apart, soft)
    tight = tightened(problem, [excess(0, 0.1)])
    assert [c.weight is not None for c in tight.soft] == [True]
    assert tight.soft[0].upper == pytest.approx([1.0])
    (same,) = at_points(problem).soft
    assert same is problem.soft[0]


def test_chord_that_only_touches_needs_no_margin() -> None:
    """Along y = 0 the disc of radius 1/2 about (2, 1/2) is touched, not cut."""
    for height, count in ((0.5, 0), (0.5 - 2.0**-30, 1)):
        stated = disc(X, centre=[1.5, height], radius=0.5, along="segments")
        problem = moving(stated, path_tolerance=0.5)
        found = needed(problem, evaluated(problem, [0.0] * 4), [0, 0], NOTHING)
        assert len(found) == count


def test_chord_of_points_that_move_by_signals_is_cut_where_it_is() -> None:
    """An object that approaches at 1 m/s and sinks is met in the third second."""
    at = ca.SX.sym("at", 2)
    apart = Separation(relative=X - at, distance=0.75, along="segments")
    problem = moving(
        PathConstraint(expression=X[1], upper=99),
        apart,
        signals=at,
        checks=2,
        bounds=Bounds(controls=(-1, 1)),
    )
    t = problem.times
    known = Known(signals=np.stack([5.5 - t, 0.5 + 0.2 * (2.75 - t)]))
    planner = Planner(problem, search=None, backend="casadi")
    plan = planner.evaluated(np.zeros((1, 4)), [0, 0], known=known, source=Source.GUESS)
    solution = verified(problem, plan, [0, 0], known)
    asked = needed(problem, solution, [0, 0], known)
    (found,) = (e for e in asked if e.name.startswith("the chord of"))
    # Relative: through (0, -0.5) at 2.75 s along (2, 0.2), within the last half second.
    assert found.amount == pytest.approx(0.75 - 0.5 / np.hypot(1, 0.1))
    assert (found.time, found.constraint, found.row, found.above) == (3.0, 1, 0, False)
    assert found.scale == 0.75


@pytest.mark.parametrize(
    ("intervals", "along", "seed"),
    [
        (8, "points", 1),
        (8, "segments", 0),
        (12, "points", 1),
        (20, "points", 1),
        (20, "segments", 0),
        (40, "points", 0),
    ],
)
def test_repaired_answers_keep_clear_of_four_discs_on_the_path(
    intervals: int, along: Along, seed: int
) -> None:
    found = solve(
        four_discs(intervals, along),
        [0, 0, 0],
        search="lshade",
        budget=3000,
        repair=True,
        backend="casadi",
        seed=seed,
    )
    assert found.status.is_confirmed
    assert clearance(found) >= -1e-4  # The path tolerance, of radii of one.
    assert found.path.broken == () or found.path.broken[0].relative <= 1e-4


def test_without_repair_the_same_answer_is_called_broken() -> None:
    """The advice says by how much."""
    asked = {"search": "lshade", "budget": 3000, "backend": "casadi", "seed": 1}
    cut = solve(four_discs(8), [0, 0, 0], repair=False, **asked)  # type: ignore[arg-type]
    assert cut.status is SolutionStatus.BROKEN
    assert clearance(cut) == pytest.approx(-max(e.amount for e in cut.path.broken))
    assert f"a margin of {cut.path.broken[0].amount:.2g}" in cut.advice
    clear = solve(four_discs(8), [0, 0, 0], **asked)  # type: ignore[arg-type]
    assert clear.status.is_confirmed
    assert clear.cost > cut.cost
    assert cut.repair is None
    account = clear.repair
    assert account is not None and account.succeeded
    assert account.attempts >= 1 and account.evaluations > 0 and account.seconds > 0
    assert clear.plan.evaluations - account.evaluations == cut.plan.evaluations
    assert f"  repair      {account.line}" in str(clear)


def test_repair_that_failed_says_what_it_tried_and_does_not_advise_it() -> None:
    """One interval, and a wall that a start towards it cannot help to cut."""
    wall = PathConstraint(expression=X[0], upper=0.2, name="wall")
    ode = ca.vertcat(X[1], U[0])
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=ode), horizon=1.0, intervals=1,
        stage_cost=ca.sumsqr(U), constraints=[wall], terminal=[X[0]],
        bounds=Bounds(controls=(-9, 9)),
    )  # fmt: skip
    found = solve(problem, [0.0, 1.0], search=None, seed=0)
    assert found.status is SolutionStatus.BROKEN
    assert found.repair is not None and not found.repair.succeeded
    assert found.repair.tried in found.reason and "in vain" in found.reason
    assert "repair" not in found.advice
    assert "more intervals (2)" in found.advice


def test_margins_that_cost_become_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixteen checks in each interval show the cost of a clear path."""
    asked = {"search": "lshade", "budget": 3000, "backend": "casadi", "seed": 1}
    stated = four_discs(20)
    dense = replace(stated, checks=16, substeps=1)
    plan = solve(stated, [0, 0, 0], repair=False, **asked)  # type: ignore[arg-type]
    least = solve(
        dense, [0, 0, 0], search=None, guess=plan.controls, repair=False, seed=0
    )
    assert least.path.broken[0].relative < 1e-4
    found = solve(stated, [0, 0, 0], repair=True, **asked)  # type: ignore[arg-type]
    assert found.status.is_confirmed
    assert found.cost == pytest.approx(least.cost, rel=1e-4)
    monkeypatch.setattr(improving, "_margin_costs", lambda *_: False)
    with_margins = solve(stated, [0, 0, 0], repair=True, **asked)  # type: ignore[arg-type]
    assert with_margins.status.is_confirmed
    assert with_margins.cost > least.cost * (1 + 1e-4)
    assert with_margins.plan.evaluations < found.plan.evaluations


def test_margins_that_cost_next_to_nothing_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A path along the bump whose height hardly matters."""
    bump = PathConstraint(
        expression=X[1] - 0.5 * ca.sin(np.pi * X[0]) ** 2, lower=-0.01
    )
    problem = moving(
        bump, bounds=Bounds(controls=(-1, 1)), stage_cost=1 + 1e-5 * (X[1] - 0.1) ** 2
    )
    monkeypatch.setattr(improving, "_with_checks_for_margins", None)
    clear = solve(problem, [0, 0.6], search=None, repair=True, seed=0)
    cut = solve(problem, [0, 0.6], search=None, repair=False, seed=0)
    assert cut.status is SolutionStatus.BROKEN
    assert clear.status.is_confirmed


@pytest.mark.parametrize("polish", [None, "ipopt"])
def test_answer_of_a_search_alone_is_repaired_too(polish: str | None) -> None:
    """Over a bump between two checks, which see only its feet."""
    bump = PathConstraint(
        expression=X[1] - 0.5 * ca.sin(np.pi * X[0]) ** 2, lower=-0.01
    )
    problem = moving(
        bump, bounds=Bounds(controls=(-1, 1)), stage_cost=(X[1] - 0.1) ** 2
    )
    asked = {"search": "lshade", "budget": 1000, "polish": polish, "seed": 0}
    asked |= {"backend": "casadi"}
    cut = solve(problem, [0, 0.6], repair=False, **asked)  # type: ignore[arg-type]
    assert cut.status is SolutionStatus.BROKEN
    clear = solve(problem, [0, 0.6], repair=True, **asked)  # type: ignore[arg-type]
    assert clear.status.is_confirmed
    x, y = clear.path.states
    assert (y - 0.5 * np.sin(np.pi * x) ** 2).min() >= -0.01 - 1e-3
    assert clear.plan.evaluations > cut.plan.evaluations
