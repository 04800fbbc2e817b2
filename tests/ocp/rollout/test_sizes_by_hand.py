"""Natural sizes against their rules, computed number by number without arrays."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.ocp import (
    Bounds,
    Free,
    Model,
    OptimalControlProblem,
    PathConstraint,
    SolutionStatus,
    TerminalConstraint,
    ensemble,
    right_hand_side,
    solve,
)
from swarmstart.ocp.rollout.scaling import Sizes, Sizing
from swarmstart.ocp.statement.rewrites.chain import lowered

INF, NONE = np.inf, np.empty(0)
START = (1.5, 4.9, 0.0)
STATES, CONTROLS = (2.0, 3.0, 0.5), (7.0, 4.0)
SCALES = {"x_0": 2.0, "x_1": 3.0, "x_2": 0.5, "u_0": 7.0}
GUESS = np.array([[9.0, 9.5], [-0.75, 4.0]])
LEAST_X, MOST_X = (1.0, -INF, 5.0), (INF, 5.5, 6.0)


def sizes_of(problem: OptimalControlProblem, x0: Sequence[float]) -> Sizes:
    empty = np.empty((0, problem.nodes))
    return Sizing(problem)(np.array(x0, dtype=np.float64), NONE, empty)


def points() -> Iterator[tuple[list[float], list[float]]]:
    """Yield states and controls at and around the start, at the start first.

    The first control is between its bounds -1 and 3, the second as far about the begin
    of its guess as this gets.
    The third state starts outside its bounds, so these do not cut its points.
    """
    low, middle, high = (-1.0, -0.75 - 4.0), (1.0, -0.75), (3.0, -0.75 + 4.0)
    moves: list[tuple[list[float], tuple[float, float]]]
    moves = [([0.0, 0.0, 0.0], u) for u in (middle, low, high)]
    for i, part in itertools.product(range(3), (0.618, -0.382)):
        alone = [0.0, 0.0, 0.0]
        alone[i] = part * STATES[i]
        moves.append((alone, middle))
    for part in (0.618, -0.382):
        together = [part * size for size in STATES]
        moves += [(together, u) for u in (middle, low, high)]
    for move, u in moves:
        x = [a + b for a, b in zip(START, move, strict=True)]
        yield [max(x[0], 1.0), min(x[1], 5.5), x[2]], [*u]


def size_by_hand(values: list[float], moved: bool, lower: float, upper: float) -> float:
    """Return the size of a row from its values, those at the start first."""
    if 0 < upper - lower < INF:
        return upper - lower
    origin = values[0] if moved and np.isfinite(values[0]) else 0.0
    seen = [v - origin if np.isfinite(v) else 0.0 for v in values]
    at_start, around = max(map(abs, seen[:3])), max(map(abs, seen))
    natural = at_start if at_start > 1e-6 * around else around
    lower, upper = lower - origin, upper - origin
    limit = max((abs(b) for b in (lower, upper) if np.isfinite(b)), default=0.0)
    reach = max(seen) - min(seen)
    way = min(limit, reach) if reach > 0 else limit
    kept = lower <= 0 <= upper or lower == upper
    if moved:
        found = way if kept and way > 0.01 * reach else reach
    else:
        found = max(limit, 1e-3 * natural) if limit > 0 else natural
    return found if found > 0 else 1.0


def test_rows_and_cost_follow_their_rules_at_every_edge() -> None:
    """Limits before, at and beyond the start; values that are no numbers."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
    alone = [
        x[0],
        -3 * x[1] + u[1] ** 2,
        x[2],
        x[0] + ca.sqrt(x[1] - 5),  # NaN at the start.
        x[0] + 1 / x[2],  # Infinite there.
        x[1] - 1 / x[2],
        x[0] + ca.log(x[2] + 0.1),  # NaN beside it.
    ]
    others = [x[0] * x[1], u[0] * u[1], x[2] ** 2, ca.log(x[2]), 1e9 * u[0] * x[2] ** 2]
    others += [1e-8 * x[0] ** 2 + 7 * x[2] ** 2, 1 / x[2] ** 2, 0 * x[0] ** 2]
    of_points = list(points())

    def values_of(expression: ca.SX) -> list[float]:
        value = ca.Function("value", [x, u], [expression])
        return [float(value(*point)) for point in of_points]

    stated, expected = [], []
    for expression in (*alone, *others):
        values = values_of(expression)
        finite = [v for v in values if np.isfinite(v)] or [0.0]
        begin = values[0] if np.isfinite(values[0]) else 0.0
        reach = max(finite) - min(finite) or 1.0
        steps = [0.0, 1e-9, 0.009, 0.011, 0.3, 1.0, 2.0]
        edges = {begin + sign * part * reach for part in steps for sign in (-1, 1)}
        edges |= {0.0, 1e-12, 30.0}
        moved = any(expression is one for one in alone)
        sides = [side for e in sorted(edges) for side in ((-INF, e), (e, INF), (e, e))]
        for lower, upper in ((-INF, INF), (-2.0, 3.0), *sides):
            stated.append((expression, lower, upper))
            expected.append(size_by_hand(values, moved, lower, upper))
    ends = [k for k, (e, _, _) in enumerate(stated) if not ca.depends_on(e, u)][:50]

    def rows_of(chosen: Sequence[int]) -> dict[str, Any]:
        rows, lower, upper = zip(*[stated[k] for k in chosen], strict=True)
        return {"expression": ca.vertcat(*rows), "lower": lower, "upper": upper}

    stage, terminal = 5 + u[0] * x[1] - x[0] ** 2, x[1] * x[0] - 8 * x[0]
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(u, x[0] * u[0])),
        horizon=3.0,
        intervals=2,
        stage_cost=stage,
        terminal_cost=terminal,
        bounds=Bounds(
            controls=([-1, -INF], [3, INF]),
            states=([*LEAST_X], [*MOST_X]),
            state_scale=1.0,
        ),
        constraints=[PathConstraint(**rows_of(range(len(stated))))],
        terminal=[TerminalConstraint(**rows_of(ends))],
        scales=SCALES,
    )
    found = Sizing(problem)(np.array(START), NONE, np.empty((0, 3)), GUESS)
    np.testing.assert_array_equal(found.states, STATES)
    np.testing.assert_array_equal(found.controls, CONTROLS)
    by_size = {row.size: row for row in found.rows}
    np.testing.assert_allclose(by_size[len(expected)], expected, rtol=1e-12)
    np.testing.assert_allclose(by_size[len(ends)], [expected[k] for k in ends])
    open_rows = [row for row in found.rows if row.size in (len(expected), len(ends))]
    weights = np.concatenate([
        [1 / size for (_, low, high), size in zip(stated, row, strict=False)
         if not 0 < high - low < INF]
        for row in open_rows
    ])  # fmt: skip
    np.testing.assert_array_equal(found.weights, weights)
    # Neither cost moves with the origin of a state.
    of_cost = [max(map(abs, values_of(cost))) for cost in (stage, terminal)]
    assert found.cost == pytest.approx(3.0 * of_cost[0] + of_cost[1], rel=1e-12)


def test_cost_that_moves_with_an_origin_counts_from_the_start() -> None:
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
    for cost, begin in ((x[0] - u[0] ** 2, 1.5 - 1.0), (x[0] ** 2, 0.0), (x[1], 4.9)):
        problem = OptimalControlProblem(
            Model(states=x, controls=u, ode=ca.vertcat(u, u[0])),
            horizon=3.0,
            intervals=2,
            stage_cost=cost,
            bounds=Bounds(
                controls=([-1, -INF], [3, INF]), states=([*LEAST_X], [*MOST_X])
            ),
            scales=SCALES,
        )
        found = Sizing(problem)(np.array(START), NONE, np.empty((0, 3)), GUESS)
        value = ca.Function("value", [x, u], [cost])
        values = [abs(float(value(*point)) - begin) for point in points()]
        assert found.cost == pytest.approx(3.0 * max(values), rel=1e-12)


def test_cost_of_nothing_or_beyond_all_numbers_has_the_size_one() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    for factor, expected in ((0.0, 1.0), (1.0, 8.0), (1e300, 8e300), (1e308, 1.0)):
        problem = OptimalControlProblem(
            Model(states=x, controls=u, ode=u), horizon=2.0, intervals=2,
            stage_cost=factor * u**2, bounds=Bounds(controls=(-2, 1)),
        )  # fmt: skip
        assert sizes_of(problem, [0.0]).cost == pytest.approx(expected)


def test_price_of_a_soft_limit_is_part_of_the_size_of_the_cost() -> None:
    """u^2 + 6 max(u, 0) is 7 at 1 and 4 at -2, for 2 s; the row has no weight."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=2.0, intervals=2,
        stage_cost=u**2, bounds=Bounds(controls=(-2, 1)),
        constraints=[PathConstraint(expression=u, upper=0.0, weight=6.0), u <= 9],
    )  # fmt: skip
    found = sizes_of(problem, [0.0])
    assert found.cost == pytest.approx(14.0)
    assert [row.tolist() for row in found.rows] == [[9.0], [2.0]]
    np.testing.assert_allclose(found.weights, [1 / 9])


@pytest.mark.parametrize(
    ("lower", "upper", "middle"),
    [
        (4.0, 8.0, 6.0),
        (-3.0, -1.0, -2.0),
        (-INF, 3.0, 0.0),
        (-INF, -3.0, -3.0),
        (2.0, INF, 2.0),
        (-INF, INF, 0.0),
    ],
)
def test_controls_are_tried_in_the_middle_of_their_bounds_or_next_to_zero(
    lower: float, upper: float, middle: float
) -> None:
    """x' = 1 / (u - middle - 1/8)^2 is by far the largest there: 64, for 2 s."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=1 / (u - middle - 1 / 8) ** 2),
        horizon=2.0,
        intervals=2,
        bounds=Bounds(controls=(lower, upper), search=(-9, 9)),
        scales={"u": 0.5},
    )
    assert sizes_of(problem, [0.0]).states[0] == pytest.approx(128.0)


def test_control_has_the_width_of_its_bounds_or_its_only_bound_as_size() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 4)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.sum1(u)), horizon=2.0, intervals=2,
        bounds=Bounds(controls=([-1, -INF, -6, 3], [4, -7, INF, 3]), search=(-9, 9)),
    )  # fmt: skip
    np.testing.assert_array_equal(sizes_of(problem, [0.0]).controls, [5, 7, 6, 3])


@pytest.mark.parametrize(
    ("A", "expected"),
    [
        # Rate T; by the spring's speed T^2 / 2; a third order would add w^2 T^3 / 6.
        ([[0, 1], [-100, 0]], [1 / 2, 1]),
        ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [1 / 6, 1 / 2, 1]),
        # Friction that ends in 1 / 20 s.
        ([[0, 1], [0, -20]], [1 / 40, 1 / 20]),
        ([[0, 3, 0], [0, 0, 0.5], [0, 0, 0]], [1.5 / 6, 0.5 / 2, 1]),
        # The longer way of two, and a drag that lasts longer than the horizon.
        ([[0, 4, 4], [0, -0.5, 1], [0, 0, 0]], [2, 1 / 2, 1]),
    ],
)
def test_states_are_as_large_as_a_push_by_one_moves_them(
    A: list[list[float]], expected: list[float]
) -> None:
    """x' = A x + (0, ..., 0, u) from rest for 1 s, by orders 1 to n of the motion."""
    n = len(A)
    x, u = ca.SX.sym("x", n), ca.SX.sym("u")
    push = ca.vertcat(ca.SX.zeros(n - 1, 1), u)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.DM(A) @ x + push), horizon=1.0,
        intervals=2, bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    np.testing.assert_allclose(sizes_of(problem, [0.0] * n).states, expected)


def test_state_that_rests_at_first_moves_as_the_known_ones_let_it() -> None:
    """x' = y^2 with y of the size 4: 2 s times (0.618 4)^2."""
    x, y, u = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=ca.vertcat(x, y), controls=u, ode=ca.vertcat(y**2, u)),
        horizon=2.0,
        intervals=2,
        bounds=Bounds(controls=(-1, 1)),
        scales={"y": 4.0},
    )
    found = sizes_of(problem, [0.0, 0.0]).states
    np.testing.assert_allclose(found, [2 * (0.618 * 4) ** 2, 4], rtol=1e-12)


def test_jump_at_the_end_of_an_interval_counts_as_a_rate() -> None:
    """v' = u and v+ = v - 3 u every 0.5 s: as a rate u - 6 u, for 2 s."""
    v, u = ca.SX.sym("v"), ca.SX.sym("u")
    for more, rate in (({}, 1.0), ({"next_state": v - 3 * u}, 5.0)):
        model = Model(states=v, controls=u, ode=u, **more)  # type: ignore[arg-type]
        problem = OptimalControlProblem(
            model, horizon=2.0, intervals=4, bounds=Bounds(controls=(-1, 1))
        )
        assert sizes_of(problem, [10.0]).states[0] == pytest.approx(2 * rate)


def test_free_start_has_the_width_of_its_range_unless_bounds_give_one() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(u, u)),
        horizon=1.0,
        intervals=2,
        bounds=Bounds(controls=(-1, 1)),
        start={"x_0": Free(-3.0, 5.0), "x_1": Free(-2.0, 2.0)},
    )
    for states, expected in (((-INF, INF), [8, 4]), (([-9, -INF], 9), [18, 4])):
        bounds = Bounds(controls=(-1, 1), states=states)
        found = sizes_of(replace(problem, bounds=bounds), [0.0, 0.0])
        np.testing.assert_array_equal(found.states[:2], expected)


def test_costs_of_members_have_one_size_as_states() -> None:
    """x' = k u with |u| <= 1 and the costs u^2 and 10 x: 2 and 60 for k = 3."""
    x, u, k = (ca.SX.sym(name) for name in "xuk")
    one = OptimalControlProblem(
        Model(states=x, controls=u, ode=k * u, parameters=k),
        horizon=2.0,
        intervals=2,
        stage_cost=u**2,
        terminal_cost=10 * x,
        bounds=Bounds(controls=(-1, 1)),
    )
    problem = lowered(ensemble(one, {"k": [1.0, 3.0]}, risk="worst")).core
    assert problem.epigraph is not None
    ours = [*problem.epigraph.accrued, *problem.epigraph.states]
    found = sizes_of(problem, [0.0] * problem.model.nx)
    others = [i for i in range(problem.model.nx) if i not in ours]
    assert sorted(found.states[others]) == [2.0, 6.0]
    assert found.states[ours] == pytest.approx(np.full(len(ours), 0.618 * (60 + 2)))


@pytest.mark.parametrize(("p", "size"), [(0.0, 2.0), (-1.0, 2.0), (0.01, 10.0)])
def test_way_that_is_no_number_does_not_count(p: float, size: float) -> None:
    """x' = u, |u| <= 1 for 2 s moves x by 2; (x - 1 / sqrt(p))^2 asks for 10."""
    x, u, at = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, parameters=at),
        horizon=2.0,
        intervals=2,
        bounds=Bounds(controls=(-1, 1)),
        terminal_cost=(x - 1 / ca.sqrt(at)) ** 2,
    )
    empty = np.empty((0, problem.nodes))
    found = Sizing(problem)(np.zeros(1), np.array([p]), empty)
    assert found.states[0] == pytest.approx(size)


def chain(**changes: Any) -> OptimalControlProblem:
    """Return four masses on springs that harden; no state has bounds."""
    x, v, u = ca.SX.sym("x", 4), ca.SX.sym("v", 4), ca.SX.sym("u", 2)
    ends = ca.vertcat(0, x, 0)
    stretch = ends[1:] - ends[:-1]
    force = stretch + stretch**3
    rate = force[1:] - force[:-1] - 0.1 * v + ca.vertcat(u[0], 0, 0, u[1])
    return OptimalControlProblem(
        Model(states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, rate)),
        horizon=6.0,
        intervals=40,
        stage_cost=ca.sumsqr(x) + 0.1 * ca.sumsqr(v) + 0.1 * ca.sumsqr(u),
        bounds=Bounds(controls=(-1, 1)),
        **changes,
    )


SWINGING = (1.0, -1.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0)


def test_sizes_of_what_swings_are_those_of_its_linear_motion() -> None:
    """By an independent integrator. Slopes without signs say 1e7 times as much."""
    problem = replace(chain(), stage_cost=ca.SX(0))
    f = right_hand_side(problem.model)
    x, u = ca.SX.sym("x", 8), ca.SX.sym("u", 2)
    A = np.array(ca.Function("A", [x, u], [ca.jacobian(f(x, u, []), x)])(SWINGING, 0))
    most = np.zeros(8)
    for push in (-1.0, 0.0, 1.0):
        rate = np.array(f(SWINGING, [push, push], [])).ravel()
        found = solve_ivp(
            lambda _, z, rate=rate: A @ z + rate, (0, 6), np.zeros(8),
            t_eval=np.linspace(0, 6, 601), rtol=1e-10, atol=1e-10,
        )  # fmt: skip
        most = np.maximum(most, np.abs(found.y).max(axis=1))
    np.testing.assert_allclose(sizes_of(problem, SWINGING).states, most, rtol=0.02)


def test_no_optimum_is_seen_where_sizes_would_hide_the_slope() -> None:
    """Zero controls, at a cost of 14.26, were called a local optimum of this chain."""
    found = solve(chain(), SWINGING, search=None, lanes=0, seed=0)
    assert found.status is SolutionStatus.CONVERGED
    assert found.cost == pytest.approx(10.555275, rel=1e-6)


def test_what_flies_away_keeps_its_large_size() -> None:
    """A chain of integrators: T^5 / 5! times all rates."""
    x, u = ca.SX.sym("x", 5), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(u, 30 * x[:-1])),
        horizon=4.0,
        intervals=5,
        stage_cost=u**2,
        bounds=Bounds(controls=(-1, 1)),
    )
    last = sizes_of(problem, [0.0] * 5).states[-1]
    assert last == pytest.approx(4.0**5 / 120 * 30**4)
