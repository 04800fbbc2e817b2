"""Confirmed answers of `solve` are admissible for the statement of the bound."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    TerminalConstraint,
    solve,
)
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.statement import (
    NoBoundError,
    Statement,
    affine_form,
    statement_of,
)
from swarmstart.ocp.rollout.checking import ConstraintRows
from swarmstart.ocp.rollout.fitness import NOTHING, core_known
from swarmstart.ocp.rollout.scaling import Sizing
from swarmstart.ocp.statement.ensemble import ensemble
from swarmstart.ocp.statement.rewrites.chain import lowered
from swarmstart.ocp.system.algebraic import AlgebraicEquations
from swarmstart.ocp.system.separation import Connection, Separation, disc
from swarmstart.tests.ocp.lower_bound.evidence_by_hand import scalar
from swarmstart.tests.ocp.lower_bound.known_optimum import Symbols, stated

Posed = tuple[OptimalControlProblem, list[float]]


def kept(statement: Statement, times: Array, states: Array) -> NDArray[np.bool_]:
    """Return whether each point keeps path and state bounds; states in their units."""
    x = states / statement.sizes[:, None]
    low, high = (limit[:, None] for limit in statement.state_box)
    rounding = 1e-12 * (1 + np.abs(x))
    within = ((x >= low - rounding) & (x <= high + rounding)).all(axis=0)
    return np.asarray(within & _at_most_zero(statement, statement.path, times, x))


def ended(statement: Statement, times: Array, states: Array) -> NDArray[np.bool_]:
    """Return whether each point keeps the terminal constraints and the horizon."""
    x = states / statement.sizes[:, None]
    early, late = statement.horizon
    within = (times >= early - 1e-12) & (times <= late + 1e-12)
    return within & _at_most_zero(statement, statement.ends, times, x)


def _at_most_zero(
    statement: Statement, expressions: tuple[ca.SX, ...], times: Array, x: Array
) -> NDArray[np.bool_]:
    column = ca.densify(ca.vertcat(ca.SX(0, 1), *expressions))
    values = np.array(
        ca.Function("e", [statement.point], [column])(np.vstack([times, x]))
    )
    return np.asarray((values <= 1e-9).all(axis=0))


def plane(**parts: Any) -> OptimalControlProblem:
    """A point that moves in the plane with two controls."""
    s = Symbols(2, 2)
    made = {name: part(s) for name, part in parts.items() if callable(part)}
    given: dict[str, Any] = {
        "horizon": 1.0,
        "controls": (-9, 9),
        "stage": ca.sumsqr(s.u),
    }
    return stated(s, s.u, **(given | parts | made), intervals=20)


def round_a_disc() -> Posed:
    return plane(
        path=lambda s: [disc(s.x, centre=[0.0, 0.3], radius=0.7, smooth_margin=0.05)],
        terminal=lambda s: [s.x - ca.DM([2, 0])],
    ), [-2.0, 0.0]


def between_margins() -> Posed:
    return plane(
        path=lambda s: [
            Separation(relative=s.x, distance=0.7, smooth_margin=0.3),
            Connection(relative=s.x, distance=2.5, margin=0.4),
        ],
        terminal=lambda s: [
            TerminalConstraint(expression=s.x, lower=[1.5, -0.5], upper=[1.6, 0.9])
        ],
    ), [-2.0, 0.1]


def far_scales() -> Posed:
    """Scales that are given, and far from the limits."""
    return plane(
        path=lambda s: [
            Separation(relative=s.x, distance=0.7, scale=120.0),
            Connection(relative=s.x, distance=3.0, scale=900.0),
            PathConstraint(expression=s.x, lower=-2.5, upper=[2.2, 2.0], scale=20.0),
        ],
        terminal=lambda s: [TerminalConstraint(expression=s.x[0] - 1.5, scale=40.0)],
    ), [-2.0, 0.1]


def narrow_box() -> Posed:
    """Widths of which the nearest power of two is less."""
    return plane(
        states=([-2.7, -0.7], [2.7, 0.7]), terminal=lambda s: [s.x[0] >= 2.69],
    ), [-2.0, 0.0]  # fmt: skip


def sized_box() -> Posed:
    """A scale of the states' bounds that is given."""
    problem = plane(
        states=([-np.inf, -0.7], [2.7, 0.7]), terminal=lambda s: [s.x[0] >= 2.69]
    )
    bounds = Bounds(
        controls=(-9, 9), states=([-np.inf, -0.7], [2.7, 0.7]), state_scale=50.0
    )
    return replace(problem, bounds=bounds), [-2.0, 0.0]


def in_free_time() -> Posed:
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u], horizon=Free(0.5, 6.0), controls=(-1, 1), stage=1.0,
        states=(-700.3, 0.8), path=[s.x[0] <= s.t + 0.5, s.u[0] <= 2 + s.x[1]],
        terminal=[s.x[0], TerminalConstraint(expression=s.x[1], lower=-0.1)],
        intervals=20,
    )  # fmt: skip
    return problem, [-1.0, 0.0]


POSED = (
    round_a_disc, between_margins, far_scales, narrow_box, sized_box, in_free_time,
)  # fmt: skip


@pytest.mark.parametrize("posed", POSED)
def test_the_path_of_a_confirmed_answer_is_admissible(
    posed: Callable[[], Posed],
) -> None:
    problem, x0 = posed()
    answer = solve(problem, x0, search=None, lanes=8, backend="casadi", seed=0)
    assert answer.status.is_confirmed, answer.reason
    statement = statement_of(problem, x0, NOTHING)
    path = answer.path
    states = path.states[: statement.n]
    assert path.times[-1] == pytest.approx(answer.times[-1])
    assert kept(statement, path.times, states).all()
    assert ended(statement, path.times[-1:], states[:, -1:]).all()


@pytest.mark.parametrize("share", [0.999, 3.0])
@pytest.mark.parametrize("posed", POSED)
def test_limits_are_those_that_answers_are_verified_by(
    posed: Callable[[], Posed], share: float
) -> None:
    # Points at a share of the tolerance beyond a limit, by bisection along rays.
    problem, x0 = posed()
    pair = lowered(problem)
    assert pair.stated.path_constraints
    statement = statement_of(problem, x0, NOTHING)
    core, start = pair.core, pair.start(x0)
    parameters = np.asarray(core_known(pair, NOTHING).parameters)
    sizes = Sizing(core)(start, parameters, np.zeros((core.ns, core.nodes)))
    found = 0
    for constraints, first, keeps in (
        (core.path_constraints, 0, kept),
        (core.terminal_constraints, len(core.path_constraints), ended),
    ):
        rows = ConstraintRows(core, constraints, first=first)
        scale = np.array([sizes.rows[a][b] for a, b in rows.places])
        at = Beyond(rows, scale, start, parameters)
        for row, name in enumerate(rows.names):
            if name.startswith("'(u"):
                continue
            points = at.edge(row, share * problem.path_tolerance)
            if not points.size:
                continue
            found += 1
            inside = keeps(statement, np.full(points.shape[1], at.time), points)
            # Three times the tolerance is admissible nowhere, less is everywhere.
            assert inside.all() if share < 1 else not inside.any()
    assert found


class Beyond:
    """Finds states at which one row is broken by a share and no other is more."""

    def __init__(
        self, rows: ConstraintRows, scale: Array, start: Array, parameters: Array
    ) -> None:
        self.time = 1.0
        self._rows, self._scale, self._start = rows, scale[:, None], start
        self._parameters = parameters

    def relative(self, points: Array) -> Array:
        """Return the excess of each row in parts of its scale, (rows, N)."""
        count = points.shape[1]
        x = np.repeat(self._start[:, None], count, axis=1)
        x[:2] = points
        size = self._rows.function.size1_in
        u, s = (np.zeros((size(k), count)) for k in (1, 3))
        if s.size:
            s[0] = self.time
        return self._rows.excess(x, u, self._parameters, s)[0] / self._scale

    def edge(self, row: int, share: float) -> Array:
        """Return points where a row's excess is the share, others' at most it."""
        rng = np.random.default_rng(row)
        one, other = rng.uniform(-4, 4, (2, 2, 4000))
        near, far = self.relative(one)[row] < share, self.relative(other)[row] > share
        one, other = one[:, near & far], other[:, near & far]
        if not one.size:
            return np.asarray(one)
        for _ in range(80):
            middle = (one + other) / 2
            below = self.relative(middle)[row] <= share
            one = np.where(below, middle, one)
            other = np.where(below, other, middle)
        fine = (self.relative(one) <= share * (1 + 1e-6)).all(axis=0)
        return np.asarray(one[:, fine])


def test_a_start_that_breaks_a_constraint_has_no_statement() -> None:
    s = Symbols(1)
    for limits in ({"path": [s.x <= 1]}, {"states": (-1, 1)}):
        problem = stated(
            s, s.u, horizon=2.0, controls=(-2, 2), stage=s.x**2 + s.u**2, intervals=4,
            **limits,
        )  # fmt: skip
        with pytest.raises(NoBoundError, match="the start breaks"):
            statement_of(problem, [1.5], NOTHING)
        # As far outside as an answer may be.
        statement_of(problem, [1.00009], NOTHING)


def test_parameters_and_start_time_are_put_in_and_the_maximised_is_turned() -> None:
    s, p = Symbols(2), ca.SX.sym("p", 2)
    ode = ca.vertcat(p[0] * s.x[1] + ca.sin(s.t), s.u - s.x[0] ** 2)
    model = Model(states=s.x, controls=s.u, ode=ode, time=s.t, parameters=p)
    problem = OptimalControlProblem(
        model, horizon=3.0, intervals=10, stage_cost=p[1] * s.x[0] * s.u + s.t,
        terminal_cost=s.x[1] ** 3, bounds=Bounds(controls=(-1, 2)), maximize=True,
    )  # fmt: skip
    known = Known(parameters=[0.7, 30.0], time=5.0)
    x0 = np.array([300.0, -0.4])
    found = statement_of(problem, x0, known)
    assert (np.log2(found.sizes) % 1 == 0).all() and found.sizes[0] > 100
    assert (found.x0 * found.sizes == x0).all()
    assert found.sense == -1 and found.horizon == (3.0, 3.0)
    at = ca.Function(
        "at", [found.point, found.controls], [found.rate, found.stage, found.end]
    )
    t, x, u = 0.8, np.array([210.0, 0.3]), 1.3
    rate, stage, end = (
        np.array(v).ravel() for v in at(np.append(t, x / found.sizes), u)
    )
    expected = np.array([0.7 * x[1] + math.sin(5 + t), u - x[0] ** 2])
    assert rate * found.sizes == pytest.approx(expected, rel=1e-14)
    assert stage == pytest.approx(-(30 * x[0] * u + 5 + t), rel=1e-14)
    assert end == pytest.approx(-(x[1] ** 3), rel=1e-14)


def test_the_cost_of_the_start_is_an_offset() -> None:
    s = Symbols(1)
    problem = replace(
        stated(s, s.u, horizon=1.0, controls=(-1, 1), stage=s.u**2, maximize=True),
        initial_cost=s.x**2,
    )
    assert statement_of(problem, [3.0], NOTHING).offset == -9.0


def test_rows_that_hang_on_controls_are_left_out() -> None:
    s = Symbols(1)
    both = PathConstraint(expression=ca.vertcat(s.x + s.u, s.x), lower=-1, upper=2)
    problem = stated(s, s.u, horizon=1.0, controls=(-1, 1), path=[both, s.u <= s.x])
    assert len(statement_of(problem, [0.0], NOTHING).path) == 2


def simple(**changes: Any) -> OptimalControlProblem:
    s = Symbols(1)
    problem = stated(s, s.u, horizon=1.0, controls=(-1, 1), stage=s.x**2, intervals=4)
    return replace(problem, **changes)


def jumping() -> OptimalControlProblem:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=u, next_state=x / 2)
    return OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=x, bounds=Bounds(controls=(-1, 1))
    )


def algebraic() -> OptimalControlProblem:
    x, z, u = (ca.SX.sym(name) for name in "xzu")
    equations = AlgebraicEquations(symbols=z, residual=z - u)
    model = Model(states=x, controls=u, ode=z, algebraic=equations)
    return OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=x, bounds=Bounds(controls=(-1, 1))
    )


def of_four_states() -> OptimalControlProblem:
    s = Symbols(4)
    return stated(s, ca.vertcat(s.x[1:], s.u), horizon=1.0, controls=(-1, 1))


def of_a_parameter(**changes: Any) -> OptimalControlProblem:
    x, u, p = (ca.SX.sym(name) for name in "xup")
    model = Model(states=x, controls=u, ode=p * u, parameters=p)
    return OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=x**2,
        bounds=Bounds(controls=(-1, 1)), **changes,
    )  # fmt: skip


NONE: dict[str, Callable[[], OptimalControlProblem]] = {
    "4 states": of_four_states,
    "the control u has no bounds": lambda: simple(bounds=Bounds(controls=(-1, np.inf))),
    "jumps at the end of an interval": jumping,
    "algebraic equations": algebraic,
    "signals": lambda: simple(signals=ca.SX.sym("w")),
    "the start is decided": lambda: simple(start={"x": Free(0.0, 1.0)}),
    "states are periodic": lambda: simple(periodic=["x"]),
    "parameters are decided": lambda: of_a_parameter(decided={"p": Free(0.0, 1.0)}),
    "each interval": lambda: simple(step_cost=ca.SX(1.0)),
    "ensemble": lambda: ensemble(of_a_parameter(), {"p": [0.5, 1.0]}),
    "summed": lambda: simple(quadrature="left"),
    "no upper bound": lambda: simple(horizon=Free(0.5, np.inf)),
}


@pytest.mark.parametrize("reason", NONE)
def test_what_no_bound_is_known_of_is_said_at_once(reason: str) -> None:
    problem = NONE[reason]()
    x0 = np.full(problem.model.nx, 0.5)
    with pytest.raises(NoBoundError, match=reason):
        statement_of(problem, x0, NOTHING)
    bound = lower_bound(problem, x0, work=60.0)
    assert not bound.kind.is_bound and reason in bound.reason


def affine(rate: ca.SX, stage: ca.SX, u: ca.SX, x: ca.SX) -> Statement:
    m = u.numel()
    return scalar(
        states=x, controls=u, rate=rate, stage=stage,
        control_box=(-np.ones(m), np.ones(m)),
    )  # fmt: skip


def test_the_affine_form_is_the_problem() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    rate = ca.sin(x) + (1 + x) * u[0] - 2 * u[1] * x**2
    stage = (x - 1) ** 2 + 3 * u[0] + 0.25 * u[0] ** 2 - u[1] + 0 * u[1] ** 2
    statement = affine(rate, stage, u, x)
    form = affine_form(statement)
    assert form is not None
    assert form.linear == pytest.approx([3.0, -1.0])
    assert form.quadratic == pytest.approx([0.25, 0.0])
    summed = form.drift + form.columns[0] * u[0] + form.columns[1] * u[1]
    cost = form.stage + ca.dot(form.linear, u) + ca.dot(form.quadratic, u**2)
    apart = ca.Function("apart", [x, u], [summed - rate, cost - stage])
    for point in np.random.default_rng(0).uniform(-2, 2, (20, 3)):
        assert all(abs(float(a)) < 1e-12 for a in apart(point[0], point[1:]))


NOT_AFFINE: dict[str, Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]] = {
    "product of controls": lambda x, u: (u[0] * u[1], x),
    "square in the rate": lambda x, u: (u[0] ** 2, x),
    "sine": lambda x, u: (ca.sin(u[0]), x),
    "product in the cost": lambda x, u: (u[0], u[0] * u[1]),
    "cube in the cost": lambda x, u: (u[0], u[0] ** 3),
    "state times control": lambda x, u: (u[0], x * u[0]),
    "state times square": lambda x, u: (u[0], (1 + x**2) * u[0] ** 2),
    "negative square": lambda x, u: (u[0], -(u[0] ** 2)),
    "size of a control": lambda x, u: (u[0], -ca.fabs(u[0])),
    "floor of a control": lambda x, u: (ca.floor(u[0]), x),
    "switch by a control": lambda x, u: (ca.if_else(u[0] > 0, 1, x), x),
}


@pytest.mark.parametrize("name", NOT_AFFINE)
def test_what_is_not_affine_has_no_such_form(name: str) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    assert affine_form(affine(*NOT_AFFINE[name](x, u), u, x)) is None
