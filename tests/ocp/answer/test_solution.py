"""Verification of a plan on the finer grid."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal, cast

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    Integrator,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Plan,
    Planner,
    PolishStatus,
    Solution,
    SolutionStatus,
    Source,
    TerminalConstraint,
    solve,
    verified,
)
from swarmstart.ocp.answer import solution
from swarmstart.ocp.answer.optimality_gap import OptimalityGap
from swarmstart.ocp.answer.solution import _ranges, _spread, _whole
from swarmstart.ocp.lower_bound.stated.answer import LowerBound
from swarmstart.ocp.rollout.fitness import NOTHING, Known
from swarmstart.ocp.rollout.status import Growth
from swarmstart.ocp.search.account import Repair, Restarts
from swarmstart.tests.ocp.two_valleys import two_valleys


def test_coarse_euler_is_unmasked_by_its_final_state_alone(pendulum: Model) -> None:
    """The cost u^2 is the same on every grid, and the end is free."""

    def status(integrator: str) -> SolutionStatus:
        problem = OptimalControlProblem(
            pendulum,
            horizon=2.0,
            intervals=4,
            stage_cost=pendulum.controls**2,
            integrator=integrator,
        )
        planner = Planner(problem, search=None)
        plan = planner.evaluated(np.ones((1, 4)), [1, 0], source=Source.GUESS)
        solution = verified(problem, plan, [1, 0])
        assert solution.verified_cost == pytest.approx(solution.cost)
        return solution.status

    assert status("euler") is SolutionStatus.MISMATCH
    assert status("rk4") is SolutionStatus.FEASIBLE


def test_fine_states_are_kept_beside_the_coarse_cost(pendulum: Model) -> None:
    problem = OptimalControlProblem(
        pendulum,
        horizon=1.0,
        intervals=2,
        stage_cost=pendulum.states[0] ** 2,
        integrator="euler",
        substeps=4,
    )
    planner = Planner(problem, search=None)
    plan = planner.evaluated(np.zeros((1, 2)), [1, 0], source=Source.GUESS)
    solution = verified(problem, plan, [1, 0])
    assert solution.plan is plan
    assert solution.cost == plan.cost != solution.verified_cost
    assert not np.array_equal(solution.states, plan.states)
    np.testing.assert_array_equal(solution.times, [0, 0.5, 1])


def test_violation_is_infeasible_even_if_confirmed(
    swing_up: Callable[..., OptimalControlProblem],
) -> None:
    problem = swing_up(5, 2)
    planner = Planner(problem, search=None)
    plan = planner.evaluated(np.zeros((1, 5)), [0, 0], source=Source.GUESS)
    solution = verified(problem, plan, [0, 0])
    assert solution.status is SolutionStatus.INFEASIBLE
    # At rest without torque the pendulum hangs, pi away from the target on every grid.
    assert solution.violation == pytest.approx(1)
    assert solution.verified_violation == pytest.approx(1)


def test_cost_that_is_not_finite_is_named(double_integrator: Model) -> None:
    problem = OptimalControlProblem(
        double_integrator,
        horizon=1.0,
        intervals=2,
        stage_cost=ca.log(double_integrator.states[0]),
    )
    planner = Planner(problem, search=None)
    plan = planner.evaluated(np.zeros((1, 2)), [-1, 0], source=Source.GUESS)
    solution = verified(problem, plan, [-1, 0])
    assert solution.status is SolutionStatus.NOT_FINITE
    assert solution.violation == np.inf
    assert "the cost is not a finite number" in solution.reason


def test_only_feasible_answers_that_agree_on_the_finer_grid_are_confirmed() -> None:
    confirmed = {status for status in SolutionStatus if status.is_confirmed}
    assert confirmed == {SolutionStatus.CONVERGED, SolutionStatus.FEASIBLE}


def _at_speed_one(substeps: int) -> tuple[OptimalControlProblem, Planner]:
    """A state that all integrators find exactly, and a cost that oscillates."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        stage_cost=1 + ca.cos(12 * x), substeps=substeps,
    )  # fmt: skip
    return problem, Planner(problem, search=None, backend="casadi")


def test_cost_alone_unmasks_a_coarse_grid() -> None:
    for substeps, status in (
        (1, SolutionStatus.MISMATCH), (8, SolutionStatus.FEASIBLE)
    ):  # fmt: skip
        problem, planner = _at_speed_one(substeps)
        plan = planner.evaluated(np.ones((1, 2)), [0], source=Source.GUESS)
        found = verified(problem, plan, [0])
        assert found.status is status
        # The integral of 1 + cos 12 t over 1 s.
        assert found.verified_cost == pytest.approx(1 + np.sin(12) / 12, abs=1e-3)
        if status is SolutionStatus.MISMATCH:
            assert found.reason.startswith("the cost is")
            assert "state" not in found.reason


def test_solver_that_only_says_it_converged_is_not_believed() -> None:
    problem, planner = _at_speed_one(8)
    plan = planner.evaluated(np.ones((1, 2)), [0], source=Source.GUESS)
    said = replace(plan, polish_status=PolishStatus.CONVERGED)
    found = verified(problem, said, [0])
    assert found.status is SolutionStatus.FEASIBLE
    assert found.reason == "the polish ended at a point that is not stationary"


def drift(
    stage_cost: ca.SX | float = 1.0, end_cost: ca.SX | float = 0.0, **stated: object
) -> tuple[OptimalControlProblem, Planner]:
    """x' = u from 0 over 1 s in two intervals: any integrator is exact."""
    given = {"bounds": Bounds(controls=(-2, 2)), "intervals": 2, **stated}
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=U), horizon=1.0,
        stage_cost=ca.SX(stage_cost), terminal_cost=ca.SX(end_cost),
        **given,  # type: ignore[arg-type]
    )  # fmt: skip
    return problem, Planner(problem, search=None, backend="casadi")


def planned(planner: Planner, controls: list[float], x0: float = 0.0) -> Plan:
    return planner.evaluated(np.array([controls]), [x0], source=Source.GUESS)


X, U = ca.SX.sym("x"), ca.SX.sym("u")


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("share", "agrees"), [(0.9e-3, True), (1.1e-3, False)])
def test_costs_agree_within_a_thousandth_of_the_magnitude(
    share: float, agrees: bool, sign: int
) -> None:
    """The cost itself is 0: 2 along the path less 2 at the end; the magnitude is 4."""
    problem, planner = drift(2.0, -2.0)
    plan = planned(planner, [0, 0])
    told = replace(plan, cost=plan.cost + sign * share * 4)
    found = verified(problem, told, [0])
    assert (found.status is SolutionStatus.FEASIBLE) is agrees
    assert found.reason.startswith("the cost is") is not agrees
    looser = verified(problem, told, [0], tolerance=2e-3)
    assert looser.status is SolutionStatus.FEASIBLE


@pytest.mark.parametrize(
    ("x0", "controls", "bounds", "scale"),
    [
        (0.0, [1, 1], np.inf, 1.0),  # The range along the path,
        (0.0, [2, -2], np.inf, 1.0),  # also if it comes back,
        (0.0, [1, 1], 4.0, 8.0),  # the width of its bounds,
        (3.0, [-2, -2], np.inf, 2.0),  # not its start,
        (-1.0, [-2, -2], np.inf, 2.0),  # nor its end.
    ],
)
def test_ends_agree_within_a_thousandth_of_the_state_s_size(
    x0: float, controls: list[float], bounds: float, scale: float
) -> None:
    states = Bounds(controls=(-2, 2), states=(-bounds, bounds))
    problem, planner = drift(bounds=states)
    plan = planned(planner, controls, x0)
    for part, sign in ((0.999, 1), (1.001, 1), (0.999, -1), (1.001, -1)):
        told, share = plan.states.copy(), part * 1e-3
        told[0, -1] += sign * share * scale
        found = verified(problem, replace(plan, states=told), [x0])
        assert (found.status is SolutionStatus.FEASIBLE) is (share < 1e-3)
        assert found.reason.startswith("state x ends at") is (share > 1e-3)


@pytest.mark.parametrize(
    ("misses", "told"),
    [([4e-3, 0.2], "x_0 ends at 1"), ([4e-3, 0], "x_0 ends at 1"),
     ([0, 0.2], "x_1 ends at 100"), ([1e-3, 0.2], "x_1 ends at 100")],
)  # fmt: skip
def test_state_that_ends_off_by_more_of_its_own_size_is_named(
    misses: list[float], told: str
) -> None:
    x = ca.SX.sym("x", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=U, ode=ca.vertcat(U, 100 * U)),
        horizon=1.0, intervals=2, bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    plan = planner.evaluated(np.ones((1, 2)), [0, 0], source=Source.GUESS)
    states = plan.states.copy()
    states[:, -1] += misses
    found = verified(problem, replace(plan, states=states), [0, 0])
    assert found.reason.startswith(f"state {told} on the finer path")


def test_nothing_moves_below_a_small_part_of_the_natural_size() -> None:
    """A cost of 0 along the path agrees with one that is nearly 0; a state as well."""
    problem, planner = drift(U**2)
    plan, size = planned(planner, [0, 0]), planner.fitness.arguments.sizes([0], NOTHING)
    moved = plan.states.copy()
    moved[0, -1] = size.states[0]
    for share in (0.9e-9, 1.1e-9):
        told = replace(plan, cost=10 * share * size.cost)
        status = verified(problem, told, [0]).status
        assert (status is SolutionStatus.FEASIBLE) is (share < 1e-9)
        told = replace(plan, states=share * moved)
        status = verified(problem, told, [0]).status
        assert (status is SolutionStatus.FEASIBLE) is (share < 1e-9)


def test_end_that_only_the_finer_path_misses_is_a_mismatch() -> None:
    problem, planner = drift(terminal=[TerminalConstraint(expression=X - 1, scale=1.0)])
    plan = planned(planner, [1, 1])
    for miss in (0.9e-4, 1.1e-4):
        controls = np.full((1, 2), 1 + miss)
        found = verified(problem, replace(plan, controls=controls), [0])
        assert (found.status is SolutionStatus.FEASIBLE) is (miss < 1e-4)
        assert found.reason.startswith("on the finer path") is (miss > 1e-4)


def test_path_may_be_broken_by_its_tolerance_itself() -> None:
    edge = 2.0**-10
    bound = PathConstraint(expression=U, upper=1.0, scale=1.0)
    problem, planner = drift(constraints=[bound], tolerance=1.0, path_tolerance=edge)
    for end, status in (
        (1 + edge, SolutionStatus.FEASIBLE), (1 + 2 * edge, SolutionStatus.BROKEN)
    ):  # fmt: skip
        found = verified(problem, planned(planner, [end, end]), [0])
        assert found.status is status
        assert found.verified_violation == end - 1


def test_end_may_be_broken_by_the_path_tolerance_itself() -> None:
    edge = 2.0**-10
    goal = TerminalConstraint(expression=X - 1, scale=1.0)
    problem, planner = drift(terminal=[goal], tolerance=1.0, path_tolerance=edge)
    for end, agrees in ((1 + edge, True), (1 + 2 * edge, False)):
        found = verified(problem, planned(planner, [end, end]), [0])
        assert found.reason.startswith("on the finer path") is not agrees
        assert found.status.is_confirmed is agrees


def test_what_intervals_miss_counts_together_for_each_state() -> None:
    """Three gaps of 4e-4 of the size of a state, and one of 9e-4 in each."""
    x = ca.SX.sym("x", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=U, ode=ca.vertcat(U, U)), horizon=4.0, intervals=4,
        bounds=Bounds(controls=(-2, 2), states=([-1, -10], [1, 10])),
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    plan = planner.evaluated(np.zeros((1, 4)), [0, 0], source=Source.GUESS)
    for gaps, told in (
        ([[0, 0, 0, 0], [0, 0, 0, 0]], ""),
        ([[3, -3, 0, 3], [30, -30, 0, 30]], ""),
        ([[9, 0, 0, 0], [0, 90, 0, 0]], ""),
        ([[4, -4, 0, 4], [0, 0, 0, 0]], "state x_0 ends at"),
        ([[4, 0, 0, 4], [40, 40, -40, 0]], "state x_1 ends at"),
    ):
        misses = np.array(gaps) * 1e-4 * 2
        ends = np.cumsum(np.hstack([np.zeros((2, 1)), misses]), axis=1)
        found = verified(problem, replace(plan, ends=ends, states=ends), [0, 0])
        assert found.status.is_confirmed is (told == "")
        assert found.reason.startswith(told)


def test_algebraic_variables_have_the_control_of_the_interval_after_a_node() -> None:
    """z + x - 2 u - p s = 0."""
    z, p, s = ca.SX.sym("z"), ca.SX.sym("p"), ca.SX.sym("s")
    problem = OptimalControlProblem(
        Model(
            states=X, controls=U, parameters=p, signals=s, ode=0 * z + U,
            algebraic=AlgebraicEquations(
                symbols=z, residual=z + X - 2 * U - p * s
            ),
        ),
        horizon=2.0, intervals=2, checks=2,
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    signals = np.array([[1.0, 2.0, 3.0, 4.0, 5.0]])
    known = Known(parameters=[3.0], signals=signals)
    plan = planner.evaluated(
        np.array([[1.0, -2.0]]), [0.5], known=known, source=Source.GUESS
    )
    found = verified(problem, plan, [0.5], known)
    controls = np.array([1.0, 1.0, -2.0, -2.0, -2.0])
    expected = 2 * controls - found.states[0] + 3 * signals[0]
    np.testing.assert_allclose(found.algebraic, [expected])
    assert verified(*_simple()).algebraic.shape == (0, 3)


def _simple() -> tuple[OptimalControlProblem, Plan, list[float]]:
    problem, planner = drift()
    return problem, planned(planner, [0, 0]), [0.0]


def test_broken_rows_are_counted_beside_the_worst() -> None:
    bounds = [PathConstraint(expression=k * X, upper=1.0, scale=1.0) for k in (2, 1, 3)]
    problem, planner = drift(constraints=bounds, tolerance=20.0)
    found = verified(problem, planned(planner, [2, 2]), [0])
    assert found.status is SolutionStatus.BROKEN
    assert "'(3*x)' is broken by 5" in found.reason
    assert "and 2 more row(s) are broken" in found.reason
    assert found.verified_violation == pytest.approx(5 + 3 + 1)
    one = verified(problem, planned(planner, [0.8, 0]), [0])
    assert "more row" not in one.reason and one.status is SolutionStatus.BROKEN


@pytest.mark.parametrize("intervals", [1, 2, 5])
@pytest.mark.parametrize("checks", [1, 3])
def test_states_are_those_of_the_nodes(intervals: int, checks: int) -> None:
    problem, planner = drift(intervals=intervals, checks=checks, substeps=2)
    found = verified(problem, planned(planner, [-2] * intervals, 0.25), [0.25])
    np.testing.assert_allclose(found.states[0], 0.25 - 2 * problem.times, atol=1e-14)


def test_slope_is_no_edge_however_steep() -> None:
    """Neighbours are only evaluated if an expression switches."""
    problem, planner = drift(1 + ca.tanh(1e9 * U))
    found = verified(problem, planned(planner, [0, 0]), [0])
    assert found.status is SolutionStatus.FEASIBLE


def test_start_outside_is_told_beside_the_status() -> None:
    problem, planner = drift(bounds=Bounds(controls=(-2, 2), states=(-1, 1)))
    found = verified(problem, planned(planner, [-2, 0], 1.5), [1.5])
    assert found.reason.startswith("the start is outside: the bound of state x")
    inside = verified(problem, planned(planner, [-2, 0], 0.5), [0.5])
    assert "outside" not in inside.reason


def _free(
    integrator: Integrator, intervals: int, ode: ca.SX, x0: float = 1.0
) -> Solution:
    """Return the verification of zero controls over 2 s."""
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=ode), horizon=2.0, intervals=intervals,
        stage_cost=U**2, integrator=integrator, substeps=1,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    plan = planner.evaluated(np.zeros((1, intervals)), [x0], source=Source.GUESS)
    return verified(problem, plan, [x0])


def test_pole_that_the_grid_jumps_over_is_a_mismatch() -> None:
    """x' = x^2 from 1 becomes infinite at 1 s."""
    found = _free("euler", 2, X**2)
    assert found.plan.feasible
    assert found.status is SolutionStatus.MISMATCH
    assert "on the finer path state x is not a finite number from 1" in found.reason


def test_numbers_lost_on_the_grid_alone_are_no_answer() -> None:
    """x' = -x^3 stays finite, but steps of 1/6 s do not."""
    found = _free("euler", 12, -(X**3), 6.0)
    assert found.path.not_finite is None and not found.plan.feasible
    assert found.status is SolutionStatus.NOT_FINITE
    assert "state x is not a finite number from" in found.reason


def test_stiff_model_is_told_from_a_wrong_one() -> None:
    """x' = -500 x in steps of 0.1 s; a confirmed answer needs no advice."""
    stiff = _free("rk4", 20, -500 * X)
    assert not stiff.status.is_confirmed
    assert "the model is stiff" in stiff.advice
    soft = _free("rk4", 20, -X / 5)
    assert soft.status is SolutionStatus.FEASIBLE
    assert soft.advice == "polish='ipopt' would make it a local optimum"


def edged(
    jump: float, *, moved: str = "all controls", way: int = 1, at: float = 1e-3
) -> Solution:
    """The answer 0 of a problem whose terminal cost has a step near it.

    The cost is 2 along the path. The step is reached if the named quantity is moved to
    the given side; 1e-8 of the size of b is 2e-8.

    Args:
        jump: Height of the step.
        moved: "all controls", "every other control" or "start".
        way: Side to which it is moved.
        at: Position of the step, in units of 1e-8 of the sizes.
    """
    a, b, clock = ca.vertsplit(ca.SX.sym("x", 3))
    # Equal controls, or alternating ones, move a, since the clock is 0.5 in between.
    rate = {"all controls": U, "every other control": 4 * U * (clock - 0.5)}
    side = a if moved == "start" else a - b  # A start moves a and b alike.
    problem = OptimalControlProblem(
        Model(
            states=ca.vertcat(a, b, clock), controls=U,
            ode=ca.vertcat(rate.get(moved, 0), 0, 1),
        ),
        horizon=1.0, intervals=2, stage_cost=ca.SX(2),
        terminal_cost=ca.if_else(way * side > at * 2e-8, jump, 0),
        bounds=Bounds(controls=(-1, 1), states=([-1, -1, 0], [1, 1, 2])),
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    plan = planner.evaluated(np.zeros((1, 2)), [0, 0, 0], source=Source.GUESS)
    return verified(problem, plan, [0, 0, 0])


MOVED = ["all controls", "every other control", "start"]


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("moved", MOVED)
def test_answer_on_an_edge_is_seen_from_every_neighbour(moved: str, way: int) -> None:
    for jump in (6e-3, -6e-3):
        found = edged(jump, moved=moved, way=way)
        assert found.status is SolutionStatus.MISMATCH
        assert "on the edge of if" in found.reason
        assert f"the cost is {2 + jump:.6g} instead of 2" in found.reason
    # A thousandth of the magnitude is allowed.
    assert edged(1.9e-3, moved=moved, way=way).status is SolutionStatus.FEASIBLE


@pytest.mark.parametrize("moved", MOVED)
def test_neighbours_are_a_part_in_1e8_away(moved: str) -> None:
    assert edged(1, moved=moved, at=0.9).status is SolutionStatus.MISMATCH
    assert edged(1, moved=moved, at=1.1).status is SolutionStatus.FEASIBLE


def test_edge_of_a_constraint_is_seen_beyond_twice_the_path_tolerance() -> None:
    for height, status in (
        (1.9e-4, SolutionStatus.FEASIBLE), (2.1e-4, SolutionStatus.MISMATCH)
    ):  # fmt: skip
        step = ca.if_else(X > 1e-10, height, 0)
        bound = PathConstraint(expression=step, upper=0.0, scale=1.0, name="step")
        problem, planner = drift(constraints=[bound])
        found = verified(problem, planned(planner, [0, 0]), [0])
        assert found.status is status
        if status is SolutionStatus.MISMATCH:
            assert "'step' is broken by 0.00021" in found.reason


@pytest.mark.parametrize(("steep", "status"), [
    (0.9, SolutionStatus.FEASIBLE), (1.1, SolutionStatus.MISMATCH)
])  # fmt: skip
def test_kink_is_no_jump_unless_it_is_a_hundred_times_steeper(
    steep: float, status: SolutionStatus
) -> None:
    """Moved by 1e-8 of 4, a cost of size 8 may change by 100 times 1e-8 of it."""
    problem, planner = drift(8 * ca.fmin(ca.fabs(steep * 100 / 4 * U), 1))
    plan = planned(planner, [0, 0])
    assert planner.fitness.arguments.sizes([0], NOTHING).cost == 8
    assert verified(problem, plan, [0]).status is status


def polished(problem: OptimalControlProblem) -> Plan:
    """Return the point at which IPOPT ends from zero controls."""
    planner = Planner(problem, search=None, polish=IpoptOptions(), backend="casadi")
    return planner.plan([0], rng=np.random.default_rng(0))


def ranked(
    problem: OptimalControlProblem, plan: Plan, *, settled: bool = False
) -> tuple[SolutionStatus, str]:
    found = verified(problem, replace(plan, settled=settled), [0])
    return found.status, found.reason


def test_strict_minimum_alone_is_a_local_optimum_by_itself() -> None:
    strict, _ = drift((U - 1) ** 2)
    assert ranked(strict, polished(strict)) == (
        SolutionStatus.CONVERGED, "stationary, with positive second derivatives"
    )  # fmt: skip
    for cost, what in (
        (ca.cos(X) + U**2 / 100, "saddle"), ((X - 0.5) ** 2 * 0, "flat"),
    ):  # fmt: skip
        other, _ = drift(cost)
        plan = polished(other)
        status, reason = ranked(other, plan)
        assert status is SolutionStatus.FEASIBLE
        assert reason.startswith("the polish ended at a point that is ")
        assert what in reason
        status, reason = ranked(other, plan, settled=True)
        assert status is SolutionStatus.CONVERGED
        assert "no perturbed start" in reason


def test_polish_that_did_not_converge_proves_nothing_whatever_its_point() -> None:
    strict, _ = drift((U - 1) ** 2)
    plan = polished(strict)
    for status in PolishStatus:
        found = ranked(strict, replace(plan, polish_status=status))
        if status is not PolishStatus.CONVERGED:
            assert found == (SolutionStatus.FEASIBLE, f"the polish {status.value}")
            left = verified(strict, replace(plan, polish_status=status), [0])
            assert left.advice.startswith("try another seed")
    assert plan.point is not None
    wrong = replace(plan.point, lam_x=plan.point.lam_x + 1)
    for point in (None, wrong):
        assert ranked(strict, replace(plan, point=point), settled=True) == (
            SolutionStatus.FEASIBLE,
            "the polish ended at a point that is not stationary",
        )
    alone = verified(strict, replace(plan, polish_status=None), [0])
    assert alone.reason == "it was searched, not polished"
    assert alone.advice == "polish='ipopt' would make it a local optimum"


def test_kinks_that_are_touched_are_told_of_a_polished_answer() -> None:
    problem, planner = drift((U - 1) ** 2 + 1e-3 * ca.fabs(U - 1))
    plan = replace(polished(problem), controls=np.ones((1, 2)))
    plan = replace(plan, states=planned(planner, [1, 1]).states, cost=0.0)
    status, reason = ranked(problem, plan)
    assert status is SolutionStatus.FEASIBLE
    assert reason.startswith("the path touches a kink or jump of fabs")
    advice = verified(problem, plan, [0]).advice
    assert advice.startswith(
        "write fabs(a) as a slack: a further control s with s >= a"
    )
    searched = ranked(problem, planned(planner, [1, 1]))
    assert searched == (SolutionStatus.FEASIBLE, "it was searched, not polished")


def test_infeasible_plan_tells_its_worst_row_and_one_without_numbers_which() -> None:
    goal = TerminalConstraint(expression=X - 1, scale=1.0, name="goal")
    problem, planner = drift(terminal=[goal])
    found = verified(problem, planned(planner, [0, 0]), [0])
    assert found.status is SolutionStatus.INFEASIBLE
    assert found.reason == (
        "the best point found breaks constraints by 1 in all; 'goal' is broken by 1 "
        "(1 of its scale 1) at 1 s"
    )
    root = PathConstraint(expression=ca.sqrt(0.5 - X), upper=9.0, name="root")
    problem, planner = drift(constraints=[root, X <= 0.25])
    lost = verified(problem, planned(planner, [1, 1]), [0])
    assert lost.status is SolutionStatus.NOT_FINITE
    assert lost.reason.startswith("'root' is not a finite number at 0.5")


def test_ends_may_differ_by_rounding_far_from_the_origin() -> None:
    problem, planner = drift()
    plan = planned(planner, [0, 0], 1e9)
    for miss, agrees in ((1e-6, True), (1e-3, False)):
        told = plan.states.copy()
        told[0, -1] += miss
        found = verified(problem, replace(plan, states=told), [1e9])
        assert (found.status is SolutionStatus.FEASIBLE) is agrees


@pytest.mark.parametrize("sense", [1, -1])
def test_optima_of_lanes_have_the_costs_of_their_controls(sense: int) -> None:
    """Also the sign of a gain; without lanes there are none."""
    problem = two_valleys()
    if sense < 0:
        problem = replace(problem, stage_cost=-problem.stage_cost, maximize=True)
    found = solve(problem, [0.0], search=None, seed=0)
    costs = []
    for one in found.optima:
        u = one.controls.ravel()
        costs.append(np.mean((u - 2) ** 2 * (u + 1) ** 2 - 0.1 * u))
        assert one.cost == pytest.approx(sense * costs[-1], abs=1e-6)
    # Each of two intervals in either valley; which of them comes first is the same.
    assert 2 <= len(costs) <= 4 and np.diff(costs).min() > -1e-9
    assert found.cost == pytest.approx(sense * costs[0], abs=1e-5)
    last = found.optima[-1]
    polished_last = last.solution()
    assert polished_last.status is SolutionStatus.CONVERGED
    assert polished_last.states[0, 0] == 0.0
    np.testing.assert_allclose(polished_last.states, last.states, atol=1e-4)
    assert solve(problem, [0.0], search=None, lanes=0, seed=0).optima == ()
    planner = Planner(problem, search=None)
    guess = planner.evaluated(np.zeros((1, 2)), [0.0], source=Source.GUESS)
    assert verified(problem, guess, [0.0]).optima == ()


def test_optima_of_linear_controls_have_their_knots() -> None:
    """The first knot is a state of the start, all others are those of the intervals."""
    problem = replace(two_valleys(), control_shape="linear")
    found = solve(problem, [0.0], search=None, seed=0)
    for one in found.optima:
        assert one.controls.shape == (1, 3)
        np.testing.assert_allclose(one.solution().controls, one.controls, atol=1e-3)
        steps = 0.25 * (one.controls[0, :-1] + one.controls[0, 1:])
        np.testing.assert_allclose(np.diff(one.states[0]), steps, atol=1e-9)
    first = {round(float(one.controls[0, 0])) for one in found.optima}
    assert len(first) > 1  # In either valley.


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(
    ("cost", "relaxed", "status", "told"),
    [
        (5.0, 4.0, PolishStatus.CONVERGED, "cost {5}, relaxed {4}: 25 % apart"),
        (4.0 + 1e-12, 4.0, PolishStatus.CONVERGED, "cost {4}, relaxed {4}: the same"),
        (0.25, 0.2, PolishStatus.CONVERGED, "cost {0.25}, relaxed {0.2}: 25 % apart"),
        (5.0, 0.0, PolishStatus.CONVERGED, "cost {5}, relaxed {0}"),
        (5.0, np.nan, PolishStatus.CONVERGED, "cost {5}; the relaxed problem was not"),
        (5.0, np.nan, None, "cost {5}; searched, not polished"),
    ],
)
def test_whole_numbers_are_told_beside_the_relaxed_problem(
    sense: int, cost: float, relaxed: float, status: PolishStatus | None, told: str
) -> None:
    """Costs are those of the core; a gain has its own sign."""
    planner = Planner(two_valleys(), search=None)
    plan = planner.evaluated(np.zeros((1, 2)), [0.0], source=Source.GUESS)
    plan = replace(plan, cost=cost, relaxed_cost=relaxed, polish_status=status)
    for number in ("5", "4", "0.25", "0.2", "0"):
        told = told.replace(f"{{{number}}}", f"{sense * float(number):.6g}")
    assert _whole(plan, sense).startswith(f"whole numbers {told}")


def test_outputs_of_one_interval_are_those_of_both_its_ends() -> None:
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=U, outputs={"double": 2 * X}),
        horizon=1.0,
        intervals=1,
    )
    planner = Planner(problem, search=None, backend="casadi")
    found = verified(problem, planned(planner, [3.0], 0.5), [0.5])
    np.testing.assert_allclose(found.outputs, [[1, 7]])


def test_outputs_at_the_nodes_have_the_control_of_the_interval_after_them() -> None:
    outputs = {"double": 2 * X, "push": U}
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=U, outputs=outputs),
        horizon=3.0,
        intervals=3,
        checks=2,
    )
    planner = Planner(problem, search=None, backend="casadi")
    found = verified(problem, planned(planner, [1, -2, 5], 0.5), [0.5])
    np.testing.assert_allclose(found.outputs[0], [1, 2, 3, 1, -1, 4, 9])
    np.testing.assert_array_equal(found.outputs[1], [1, 1, -2, -2, 5, 5, 5])
    assert found.output_names == ("double", "push")
    assert "outputs     double 1 to 9 in [-1, 9]; push 1 to 5 in [-2, 5]" in str(found)


@pytest.mark.parametrize("shape", ["constant", "linear"])
def test_linear_system_is_that_of_the_path_at_its_time(
    shape: Literal["constant", "linear"],
) -> None:
    """x' = t s u^2 / 2000 + p x^2 / 2 has the slopes p x and t s u / 1000."""
    p, s, t, wanted = (ca.SX.sym(name) for name in ("p", "s", "t", "wanted"))
    problem = OptimalControlProblem(
        Model(
            states=X, controls=U, parameters=p, signals=s, time=t,
            ode=t * s * U**2 / 2e3 + p * X**2 / 2,
        ),
        horizon=2.0, intervals=2, checks=2, signals=wanted,
        bounds=Bounds(controls=(-9, 9)), control_shape=shape,
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    signals = np.array([[1.0, 3.0, 5.0, 7.0, 9.0], 5 * [50.0]])
    known = Known(parameters=[0.5], signals=signals, time=10.0)
    x0, posed, _ = planner.posed([0.1], known)
    count = planner.problem.model.nu, planner.problem.intervals
    plan = planner.evaluated(
        np.ones(count) * [[2.0, 3.0]], x0, known=posed, source=Source.GUESS
    )
    found = verified(planner.tracer, plan, x0, posed)
    for time in (0.0, 0.25, 0.8, 1.0, 1.7, 2.0):
        system = found.linearised(time)
        x = np.interp(time, found.path.times, found.path.states[0])
        u = [2.0, 3.0][int(time >= 1.0)]
        if shape == "linear":
            u = float(np.interp(time, [0.0, 1.0, 2.0], found.controls[0]))
        assert system.A[0, 0] == pytest.approx(0.5 * x, rel=1e-6)
        assert system.B[0, 0] == pytest.approx((10 + time) * (1 + 4 * time) * u / 1e3)


def test_parts_of_a_summary_have_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, planner = drift()
    plain = verified(problem, planned(planner, [0, 0]), [0])
    labels = "Solution: reason advice more cost violation source horizon states"

    def first_words(solution: Solution) -> list[str]:
        return [line.split()[0] for line in str(solution).splitlines()]

    assert first_words(plain)[:9] == labels.split()
    repair = Repair(
        attempts=1, checks=2, margins=0, evaluations=3, seconds=0.0, succeeded=True
    )
    restarts = Restarts(starts=1, iterations=2, better=0, seconds=0.0)
    full = replace(
        plain,
        decided={"gain": 1.5},
        member_costs=np.array([3.0, 1.0, 2.0]),
        repair=repair,
        restarts=restarts,
    )
    monkeypatch.setattr(Solution, "gap", SimpleNamespace(words="so far"))
    labels = (
        "Solution: reason advice more cost bound members violation source horizon "
        "decided states controls"
    )
    words = first_words(full)
    assert words[:13] == labels.split()
    assert words[-2:] == ["repair", "restarts"]
    assert "  members     3, costs from 1 (number 1) to 3 (number 0)" in str(full)


def test_ranges_are_those_of_the_numbers_in_a_row() -> None:
    rows = np.array([[1.0, -2.0, 0.5], [3.0, np.nan, 4.0], 3 * [np.nan]])
    assert _ranges(("a", "b", "c"), rows, {"b": "m"}) == (
        "a 1 to 0.5 in [-2, 1]; b 3 to 4 in [3, 4] m; c nan to nan in none"
    )
    assert _ranges((), np.empty((0, 3)), {}) == "none"
    assert _spread(np.array([2.0, -1.0, 7.0, 7.0])) == (
        "4, costs from -1 (number 1) to 7 (number 2)"
    )


def test_cost_that_no_start_has_is_told_with_its_origin() -> None:
    problem, planner = drift(4.0)
    found = verified(problem, planned(planner, [0, 0]), [0])
    restarts = Restarts(starts=1, iterations=2, better=1, seconds=0.0)
    vain = replace(restarts, better=0)

    def afterwards(costs: list[float], **more: Any) -> list[str]:
        tried = [SimpleNamespace(cost=cost) for cost in costs]
        starts = cast(Any, SimpleNamespace(tried=tried))
        return replace(found, **more)._afterwards(starts)

    for costs in ([], [4.0], [7.0, 4.0 + 3.9e-6]):
        assert afterwards(costs) == []
    for more, by in (
        ({}, "rounding kinks"),
        ({"restarts": vain}, "rounding kinks"),
        ({"repair": object(), "restarts": vain}, "repair"),
        ({"repair": object(), "restarts": restarts}, "restarts"),
    ):
        assert afterwards([7.0, 4.0 + 4.1e-6], **more) == [f"  afterwards  4, by {by}"]


def test_cost_or_violation_that_is_no_number_is_no_answer() -> None:
    problem, planner = drift()
    plan = replace(planned(planner, [0, 0]), feasible=False)
    for cost, violation in ((np.nan, 1.0), (1.0, np.inf), (np.inf, np.nan)):
        told = replace(plan, cost=cost, violation=violation)
        found = verified(problem, told, [0])
        assert found.status is SolutionStatus.NOT_FINITE
        assert found.reason == "the cost is not a finite number"
    found = verified(problem, replace(plan, cost=1.0, violation=1.0), [0])
    assert found.status is SolutionStatus.INFEASIBLE
    assert found.reason == "the best point found breaks constraints by 1 in all"


def test_growth_is_that_from_the_states_at_which_the_intervals_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the finer path, or of a plan that is judged interval by interval."""
    seen: list[tuple[np.ndarray, np.ndarray]] = []

    def noted(_: object, states: np.ndarray, controls: np.ndarray, *__: object) -> Any:
        seen.append((states, controls))
        return Growth(1.0, 0.0, 1.0, 2.0, 0.5)

    monkeypatch.setattr(solution, "growth_along", noted)
    problem, planner = drift(intervals=4, checks=3, terminal=[X - 9])
    plan = planned(planner, [1, 2, -2, 1])
    verified(problem, plan, [0])
    ends = plan.states[:, ::3] + np.array([[0.0, 0.1, 0.2, 0.3, 0.4]])
    states = plan.states + np.linspace(0.0, 0.4, 13)
    found = verified(problem, replace(plan, ends=ends, states=states), [0])
    for (begins, controls), expected in zip(
        seen, ([0, 0.25, 0.75, 0.25], [0, 0.35, 0.95, 0.55]), strict=True
    ):
        np.testing.assert_allclose(begins, [expected], atol=1e-12)
        np.testing.assert_array_equal(controls, plan.controls)
    told = "judged interval by interval, since a deviation grows 2.7-fold from 0 s to 1"
    assert told in found.reason


def test_fast_mode_is_looked_for_if_the_solver_failed_or_nothing_is_confirmed() -> None:
    """u is 0: the stiff state rests, so that the answer is confirmed all the same."""
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=-500 * X + U), horizon=2.0, intervals=4,
        substeps=1, stage_cost=U**2, bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    planner = Planner(problem, search=None, backend="casadi")
    plan = planned(planner, [0, 0, 0, 0])
    failed = replace(plan, polish_status=PolishStatus.NUMERICAL_FAILURE)
    for one, advised, stiff in (
        (plan, True, False), (failed, True, True), (failed, False, False)
    ):  # fmt: skip
        found = verified(problem, one, [0], advised=advised)
        assert found.status is SolutionStatus.FEASIBLE
        assert ("the model is stiff" in found.advice) is stiff
    wrong = replace(plan, cost=9.0)
    for advised in (True, False):
        found = verified(problem, wrong, [0], advised=advised)
        assert found.status is SolutionStatus.MISMATCH
        assert ("the model is stiff" in found.advice) is advised


def test_gap_is_that_of_the_finer_cost_within_a_thousandth_of_its_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[Any, ...]] = []

    told = cast(OptimalityGap, object())

    def noted(
        bound: LowerBound, cost: float | None, *, tolerance: float
    ) -> OptimalityGap:
        asked.append((bound, cost, tolerance))
        return told

    monkeypatch.setattr(OptimalityGap, "of", noted)
    bound = LowerBound.__new__(LowerBound)
    problem, planner = drift(5.0, -1.0)
    found = verified(problem, planned(planner, [0, 0]), [0])
    assert found.gap is None and asked == []
    assert replace(found, bound=bound).gap is found.beside(bound) is told
    broken = replace(found, status=SolutionStatus.BROKEN)
    assert broken.beside(bound) is told
    assert [cost for _, cost, _ in asked] == [pytest.approx(4.0)] * 2 + [None]
    assert all(one is bound for one, _, _ in asked)
    assert [tolerance for _, _, tolerance in asked] == pytest.approx([6e-3] * 3)


def test_answer_has_multipliers_if_it_was_polished_and_is_a_guess_for_any_grid() -> (
    None
):
    problem, planner = drift((U - 1) ** 2)
    searched = verified(problem, planned(planner, [1, 1]), [0])
    assert searched.multipliers is None
    found = verified(problem, polished(problem), [0])
    assert found.multipliers is not None
    assert found.multipliers.costates.shape == (1, 2)
    assert found.as_guess().controls.shape == (1, 2)
    other, _ = drift((U - 1) ** 2, intervals=5)
    assert found.as_guess(other).controls.shape == (1, 5)
