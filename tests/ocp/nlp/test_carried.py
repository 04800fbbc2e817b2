"""Multipliers on another grid: identity, stationarity, totals, costates of Riccati."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Polisher,
    PolishStatus,
    ensemble,
)
from swarmstart.ocp.nlp.multipliers import (
    Duals,
    columns_of,
    duals_of,
    shifted_duals,
    units_of,
)
from swarmstart.ocp.nlp.nlp_assembly import inputs_of
from swarmstart.ocp.nlp.optimality import NlpPoint, stationarity
from swarmstart.ocp.nlp.start import Carried
from swarmstart.ocp.nlp.transcription import Limits
from swarmstart.ocp.statement.rewrites.chain import lowered

Make = Callable[[int], OptimalControlProblem]


def cart(intervals: int, **more: object) -> OptimalControlProblem:
    """A pendulum-like cart with active bounds and an active path constraint."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0]))),
        **{
            "horizon": 3.0,
            "intervals": intervals,
            "stage_cost": ca.sumsqr(x) + 0.1 * u**2,
            "bounds": Bounds(controls=(-1, 1)),
            "constraints": [
                PathConstraint(expression=x[1], lower=-0.4, name="slow"),
            ],
            "checks": 2,
            **more,
        },  # type: ignore[arg-type]
    )


def soft(intervals: int) -> OptimalControlProblem:
    given = cart(intervals)
    slow = PathConstraint(
        expression=given.model.states[1], lower=-0.4, name="slow", weight=0.3
    )
    return replace(given, constraints=[slow])


def blocks(intervals: int) -> OptimalControlProblem:
    """Bounds of the controls are active throughout a block."""
    given = replace(
        cart(intervals), constraints=[], bounds=Bounds(controls=(-0.2, 0.2))
    )
    return replace(given, blocks=(1, 1, 3, intervals - 5))


def free_end(intervals: int) -> OptimalControlProblem:
    given = cart(intervals, horizon=Free(0.5, 9.0, 3.0), stage_cost=ca.SX(1))
    return replace(given, terminal=[(given.model.states, [0.0, 0.0])])


def rates(intervals: int) -> OptimalControlProblem:
    given, before = cart(intervals), ca.SX.sym("v")
    limit = PathConstraint(
        expression=given.model.controls - before, lower=-0.3, upper=0.3, name="rate"
    )
    return replace(given, previous=before, constraints=[limit])


def members(intervals: int) -> OptimalControlProblem:
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
    model = Model(
        states=x, controls=u, parameters=p, ode=ca.vertcat(x[1], u - p * ca.sin(x[0]))
    )
    given = replace(cart(intervals), model=model, constraints=[],
                    stage_cost=ca.sumsqr(x) + 0.1 * u**2)  # fmt: skip
    return ensemble(given, {"p": [0.5, 1.5]}, risk="worst")


PROBLEMS: dict[str, Make] = {
    "hard": cart,
    "soft": soft,
    "blocks": blocks,
    "free end": free_end,
    "rates": rates,
    "members": members,
    "linear": lambda n: cart(n, control_shape="linear"),
    "collocated": lambda n: cart(n, transcription="radau", checks=1),
}


@cache
def solved(name: str) -> NlpPoint:
    return polished(PROBLEMS[name](8))


def polished(problem: OptimalControlProblem) -> NlpPoint:
    polisher = Polisher(Fitness(problem), IpoptOptions(tolerance=1e-10))
    core = polisher._fitness.problem
    x0 = lowered(problem).start([1.0, 0.0])
    found = polisher(np.zeros((core.model.nu, core.intervals)), x0)
    assert found.status is PolishStatus.CONVERGED and found.point is not None
    return found.point


@pytest.mark.parametrize("name", PROBLEMS)
def test_on_the_same_grid_the_general_way_gives_the_same_multipliers(
    name: str,
) -> None:
    """The fast way copies, so interpolation over cells must be the identity."""
    point = solved(name)
    carried = Carried(duals=duals_of(point), program=point.program)
    given = carried.placed(point.program, point.w, point.q, point.cost_size)
    assert given is not None
    np.testing.assert_allclose(given[0], point.lam_g, rtol=1e-12)
    # Collocation rows and ties follow by stationarity, in `placed`.
    rewritten = _via_another_length(carried, point)
    size = np.abs(point.lam_g).max()
    np.testing.assert_allclose(rewritten[0], point.lam_g, atol=1e-6 * size)
    np.testing.assert_allclose(rewritten[1], point.lam_x, atol=1e-9 * size)


def _via_another_length(carried: Carried, point: NlpPoint) -> tuple[Array, Array]:
    """Return the result of the general way, forced by a slightly different length."""
    stretched = replace(carried, stretch=1.0 + 1e-15)
    found = stretched.placed(point.program, point.w, point.q, point.cost_size)
    assert found is not None
    return found


@pytest.mark.parametrize("name", PROBLEMS)
def test_multipliers_are_stationary_whatever_the_sizes_of_the_nlp(name: str) -> None:
    """With other sizes of rows, variables and cost, the point stays stationary."""
    point = solved(name)
    program, core = point.program, point.program.problem
    q, limits, lengths = (
        point.q.copy(),
        point.limits,
        program.parts.argument_sizes(core),
    )
    nx, first = core.model.nx, lengths[0] + core.model.np
    inputs = first + nx + inputs_of(core)
    q[:nx] /= 3.0  # x0, divided by the sizes of the states.
    q[first : first + nx] *= 3.0
    q[first + nx : inputs] *= np.linspace(0.5, 0.7, inputs - first - nx)
    q[lengths[0] + lengths[1] - 1] *= 2.0  # Size of the cost.
    q[lengths[0] + lengths[1] : q.size - lengths[-1]] *= 7.0  # 1 / size of the rows.
    (rows, bounds), (rows_before, bounds_before) = (
        units_of(program, one, 1.0) for one in (q, point.q)
    )
    by_row, by_bound = rows / rows_before, bounds / bounds_before
    w = point.w * by_bound
    placed = Carried(duals=duals_of(point)).placed(program, w, q, 2 * point.cost_size)
    assert placed is not None
    again = replace(
        point, q=q, w=w, cost_size=2.0 * point.cost_size,
        lam_g=placed[0], lam_x=placed[1],
        limits=Limits(limits.lbx * by_bound, limits.ubx * by_bound,
                      limits.lbg * by_row, limits.ubg * by_row),
    )  # fmt: skip
    assert stationarity(point) < 1e-6
    assert stationarity(again) < 1e-5


def test_costates_do_not_depend_on_the_grid_and_limits_are_densities() -> None:
    """The costate is the gradient of the cost to go; a limit has one worth in all."""
    coarse, fine = (polished(cart(n)) for n in (20, 80))
    carried = Carried(duals=duals_of(coarse), program=coarse.program)
    moved = columns_of(fine.program, carried._on(coarse.program, fine.program))
    exact = columns_of(fine.program, duals_of(fine))
    costates = np.abs(exact[0][:2]).max()
    assert np.abs(moved[0][:2] - exact[0][:2]).max() < 0.05 * costates
    worth = [rows[2:].sum() for rows in (moved[0], exact[0])]
    given = columns_of(coarse.program, carried.duals)[0][2:].sum()
    assert worth[0] == pytest.approx(given, rel=1e-12)  # Kept by the transfer.
    assert worth[0] == pytest.approx(worth[1], rel=0.05)  # As found on the other grid.
    # An interval's share is a quarter, also for the controls' bounds.
    longer = replace(carried, stretch=1.5)._on(coarse.program, fine.program)
    stretched = columns_of(fine.program, longer)[0]
    assert stretched[2:].sum() == pytest.approx(1.5 * given, rel=1e-12)
    np.testing.assert_array_equal(stretched[:2], moved[0][:2])
    bounds = [columns.sum() for columns in (moved[1][0], exact[1][0])]
    assert bounds[0] == pytest.approx(bounds[1], rel=0.1)


def test_one_interval_later_is_the_same_by_the_fast_and_the_general_way() -> None:
    point = solved("hard")
    duals = duals_of(point)
    fast = shifted_duals(point.program, duals)
    part = 1.0 / 8
    later = Carried(duals=duals, begin=part, end=1.0 + part)
    general = later._on(point.program, point.program)
    columns = [columns_of(point.program, d) for d in (fast, general)]
    for one, other in zip(*columns, strict=True):
        size = np.abs(one).max()
        np.testing.assert_allclose(one[:, :-1], other[:, :-1], atol=1e-9 * size)
    np.testing.assert_array_equal(columns[0][0][:, -1], columns[0][0][:, -2])


def test_multipliers_of_another_nlp_are_left_out() -> None:
    point = solved("hard")
    strange = Carried(duals=Duals(np.zeros(3), np.zeros(4)))
    assert strange.placed(point.program, point.w, point.q, 1.0) is None
    lost = Duals(np.full(point.lam_g.size, np.nan), point.lam_x)
    assert Carried(duals=lost).placed(point.program, point.w, point.q, 1.0) is None


def test_patience_is_three_times_the_median_of_earlier_solves() -> None:
    duals = Duals(rows=np.zeros(0), bounds=np.zeros(0))
    told = {(): np.inf, (3, 4, 300): 20, (10, 20, 30): 60, (8, 9): 25.5}
    for spent, most in told.items():
        assert Carried(duals=duals, spent=spent).most == most


@pytest.mark.parametrize("scale", [1.0, 1e8])
def test_multipliers_that_lead_nowhere_are_given_up_for_the_usual_start(
    scale: float,
) -> None:
    problem = cart(20)
    polisher, zero = Polisher(Fitness(problem)), np.zeros((1, 20))
    usual = polisher(zero, [2.0, 0.0], near=True)
    assert usual.point is not None and usual.spent == ()
    duals, rng = duals_of(usual.point), np.random.default_rng(0)
    wrong = Duals(
        *(scale * rng.normal(size=v.size) for v in (duals.rows, duals.bounds))
    )
    for spent in ((3,), (2, 3, 4)):
        carried = Carried(duals=wrong, spent=spent)
        found = polisher(zero, [2.0, 0.0], near=True, carried=carried)
        assert found.status is PolishStatus.CONVERGED
        assert found.cost == pytest.approx(usual.cost, rel=1e-6)
        # It stops after the iteration that is one too many.
        assert 20 <= found.iterations - usual.iterations <= 21
        assert found.spent == spent
    right = polisher(
        usual.controls, [2.0, 0.0], near=True, carried=Carried(duals=duals, spent=(9,))
    )
    assert right.status is PolishStatus.CONVERGED and right.iterations < 20
    assert right.spent == (9, right.iterations)
