"""The statement of a lower bound: a control problem in numbers, and its derivation.

All proofs of a bound share one statement. `statement_of` makes it from a problem of
this library, if that is possible, and `affine_form` shows whether its controls enter
affinely.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.common.pickling import Expressed
from swarmstart.ocp.rollout.fitness import Known, core_known
from swarmstart.ocp.rollout.scaling import Sizes, Sizing
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.feature import effective
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import Lowered, lowered
from swarmstart.ocp.statement.rewrites.counted_from import from_zero
from swarmstart.ocp.system.constraints import Constraint
from swarmstart.terminal_set.interval_arithmetic import expanded_tape

MOST_STATES = 3
_SMOOTH = frozenset(
    "add sub mul div neg exp log pow constpow sqrt sq twice sin cos tan asin acos atan "
    "inv sinh cosh tanh asinh acosh atanh log1p expm1 erf hypot assign".split()
)
"""Operations that are determined by their derivatives: without kinks and jumps."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Statement(Expressed):
    """A control problem in numbers.

    Attributes:
        time: Symbol of the time t [s].
        states: Symbols of the states x, each divided by its size, shape (n, 1).
        controls: Symbols of the controls u, in their units, shape (m, 1).
        rate: f(t, x, u), shape (n, 1) [1/s].
        stage: L(t, x, u) [cost / s].
        end: phi(t, x) [cost], t the time of the end.
        x0: Initial state, shape (n,).
        sizes: Sizes of the states, in their units, shape (n,): a state is its x times
            its size.
        horizon: Earliest and latest end [s].
        control_box: Lower and upper bounds of the controls, each (m,), finite.
        state_box: Lower and upper bounds of the states, each (n,), infinite if missing;
            admissible trajectories keep them at all times.
        path: Expressions g(t, x) that are at most 0 at all times.
        ends: Expressions e(t, x) that are at most 0 at the end, t its time.
        offset: Cost that no decision changes.
        sense: 1 for a minimised cost, -1 for a maximised one.
    """

    time: ca.SX
    states: ca.SX
    controls: ca.SX
    rate: ca.SX
    stage: ca.SX
    end: ca.SX
    x0: Array
    sizes: Array
    horizon: tuple[float, float]
    control_box: tuple[Array, Array]
    state_box: tuple[Array, Array]
    path: tuple[ca.SX, ...] = ()
    ends: tuple[ca.SX, ...] = ()
    offset: float = 0.0
    sense: float = 1.0

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.states.numel())

    @property
    def m(self) -> int:
        """Number of controls."""
        return int(self.controls.numel())

    @property
    def point(self) -> ca.SX:
        """The symbols (t, x), shape (1 + n, 1)."""
        return ca.vertcat(self.time, self.states)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Affine:
    """A problem with dynamics affine in the controls and a separable cost.

        f = drift + sum of columns[k] u_k,    L = stage + sum of (c_k u_k + q_k u_k^2)

    with numbers c_k and q_k >= 0: the u that minimises L + V_x f is known in closed
    form, for any polynomial V.

    Attributes:
        drift: Rate without controls, shape (n, 1), of (t, x).
        columns: A column for each control, shape (n, 1), of (t, x).
        stage: Stage cost without controls, scalar, of (t, x).
        linear: Factors c of the controls in L, shape (m,).
        quadratic: Factors q of the squared controls in L, shape (m,).
    """

    drift: ca.SX
    columns: tuple[ca.SX, ...]
    stage: ca.SX
    linear: Array = field(default_factory=lambda: np.zeros(0))
    quadratic: Array = field(default_factory=lambda: np.zeros(0))


class NoBoundError(SwarmstartError):
    """A problem for which no bound can be proven here, with the reason."""


def statement_of(
    problem: OptimalControlProblem, x0: ArrayLike, known: Known
) -> Statement:
    """Return a problem in numbers.

    Args:
        problem: The problem.
        x0: Initial state, shape (nx,).
        known: Parameters, and the time at the start.

    Raises:
        NoBoundError: If no bound can be proven for it; the message has the reason.
        InvalidProblemError: If a shape does not fit the problem.
    """
    problem = from_zero(problem)  # Costs are the same, and a proof rounds by itself.
    reason = _reason_for_none(problem)
    if reason:
        raise NoBoundError(reason)
    problem_pair = lowered(problem)
    stated = problem_pair.stated
    start = problem_pair.start(x0)
    inner = core_known(problem_pair, known)
    signals = np.asarray(inner.signals, dtype=np.float64)
    core = problem_pair.core
    sizes = Sizing(core)(
        start, np.asarray(inner.parameters), signals.reshape(core.ns, core.nodes)
    )
    if not np.isfinite(start[: stated.model.nx]).all():
        raise NoBoundError("the initial state is not known")
    statement = _Maker(problem_pair, known, sizes, start).statement()
    if _starts_outside(statement):
        raise NoBoundError(
            "the start breaks a bound of the states or a path constraint: "
            "no bound is known of such a problem"
        )
    return statement


def _reason_for_none(problem: OptimalControlProblem) -> str:
    """Return why no bound can be proven for a problem; empty if one can."""
    model = problem.model
    if model.nx > MOST_STATES:
        return f"{model.nx} states, at most {MOST_STATES} are possible"
    lacks = {
        "the model jumps at the end of an interval": model.jumps,
        "the model or the problem has signals": bool(problem.ns),
        "a control is delayed, or the problem has another feature": bool(
            effective(problem)
        ),
        "the model has algebraic equations": model.algebraic is not None,
        "parameters are decided": bool(problem.decided),
        "the start is decided": bool(problem.start),
        "states are periodic": bool(problem.periodic),
        "costs are added at each interval": not problem.step_cost.is_zero(),
        "the stage cost is summed, not integrated": problem.quadrature != "integral",
        "the cost is that of an ensemble": problem.risk is not None,
    }
    found = [reason for reason, holds in lacks.items() if holds]
    if found:
        return f"{found[0]}: no bound is known of such a problem"
    low, high = problem.control_limits
    names = model.control_names
    unbounded = [
        name
        for name, ends in zip(names, zip(low, high, strict=True), strict=False)
        if not np.isfinite(ends).all()
    ]
    if unbounded:
        return f"the control {unbounded[0]} has no bounds on both sides"
    if isinstance(problem.horizon, Free) and not np.isfinite(problem.horizon.upper):
        return "the end time has no upper bound"
    return ""


class _Maker:
    """Substitution of numbers and sizes into the expressions of a problem."""

    def __init__(self, pair: Lowered, known: Known, sizes: Sizes, start: Array) -> None:
        self._problem, model = pair.stated, pair.stated.model
        self._sizes, n = sizes, model.nx
        scale = np.where(sizes.states[:n] > 0, sizes.states[:n], 1.0)
        # Powers of two: nothing is rounded.
        self._scale: Array = np.exp2(np.round(np.log2(scale)))
        self._time = ca.SX.sym("t")
        self._states = ca.SX.sym("x", n)
        self._start = start[:n]
        parameters = ca.DM(np.asarray(known.parameters, dtype=np.float64).ravel())
        self._given = [
            model.states, model.parameters, model.time
        ]  # fmt: skip
        # A statement begins at t = 0, the model at the time that is known.
        clock = self._time + float(known.time) if model.time.numel() else ca.SX(0, 1)
        self._taken = [self._states * self._scale, ca.SX(parameters), clock]

    def _numbers(self, expression: ca.SX) -> ca.SX:
        column = ca.densify(ca.SX(expression))
        return ca.substitute([column], self._given, self._taken)[0]

    def statement(self) -> Statement:
        """Return the problem in numbers."""
        problem, model = self._problem, self._problem.model
        horizon = problem.horizon
        span = (
            (max(horizon.lower, 0.0), horizon.upper)
            if isinstance(horizon, Free)
            else (problem.length, problem.length)
        )
        first = [ca.vertcat(self._time, self._states)]
        at_start = np.concatenate([[0.0], self._start / self._scale])
        # The stated costs are those of the user, so maximised ones change sign.
        stage, end, start = (
            problem.sense * self._numbers(cost)
            for cost in (
                problem.stage_cost,
                problem.terminal_cost,
                problem.initial_cost,
            )
        )
        initial = ca.Function("initial", first, [start])
        scales = self._row_scales()
        path = problem.stated
        ends = problem.terminal_constraints
        low, high = problem.state_limits
        room = self._room(scales)
        return Statement(
            time=self._time,
            states=self._states,
            controls=model.controls,
            rate=self._numbers(model.ode) / self._scale,
            stage=stage,
            end=end,
            x0=self._start / self._scale,
            sizes=self._scale,
            horizon=span,
            control_box=problem.control_limits,
            state_box=((low - room) / self._scale, (high + room) / self._scale),
            path=tuple(self._at_most_zero(path, scales)),
            ends=tuple(self._at_most_zero(ends, scales)),
            offset=float(initial(at_start)),
            sense=problem.sense,
        )

    def _row_scales(self) -> dict[int, Array]:
        """Return the sizes of the rows of each constraint, by its id.

        Answers are verified with the same sizes; the core has as many constraints.
        """
        problem = self._problem
        every = [*problem.path_constraints, *problem.terminal_constraints]
        return {id(c): rows for c, rows in zip(every, self._sizes.rows, strict=False)}

    def _room(self, scales: dict[int, Array]) -> Array:
        """Return the tolerances by which an answer may exceed the states' bounds."""
        problem = self._problem
        room = problem.path_tolerance * self._scale
        for one in problem.path_constraints[len(problem.stated) :]:
            room[problem.bounded_states] = problem.path_tolerance * scales[id(one)]
        return room

    def _at_most_zero(
        self, constraints: Iterable[Constraint], scales: dict[int, Array]
    ) -> Iterator[ca.SX]:
        """Yield the rows of constraints, widened by the tolerance of answers.

        Answers are verified by the rows themselves, not by the smooth ones, which may
        have a margin. Rows that depend on the controls are left out: this admits more
        trajectories, so that the bound stays valid.
        """
        free = ca.vertcat(self._problem.model.controls, self._problem.previous)
        for constraint in constraints:
            rows = constraint.rows(constraint.expression)
            widths = self._problem.path_tolerance * scales[id(constraint)]
            for i in range(rows.values.numel()):
                value = rows.values[i]
                if free.numel() and ca.depends_on(value, free):
                    continue
                lower, upper = rows.lower[i] - widths[i], rows.upper[i] + widths[i]
                yield from _between(self._numbers(value), lower, upper)


def _between(number: ca.SX, lower: float, upper: float) -> Iterator[ca.SX]:
    """Yield expressions that are at most 0 if a number is between its limits.

    A distance is compared by its square, which is smooth at 0 too.
    """
    if number.is_op(ca.OP_SQRT):
        lower = lower**2 if lower > 0 else -np.inf
        # No distance is below 0: a negative upper limit must stay infeasible.
        upper = upper**2 if upper >= 0 else upper
        number = number.dep(0)
    if np.isfinite(upper):
        yield number - float(upper)
    if np.isfinite(lower):
        yield float(lower) - number


def _starts_outside(statement: Statement) -> bool:
    """Return whether the start breaks a bound of the states or a path constraint.

    An answer may then violate it until it satisfies it for the first time.
    """
    low, high = statement.state_box
    x0 = statement.x0
    if not ((low <= x0) & (x0 <= high)).all():
        return True
    # vertcat of nothing would have no type and no shape.
    column = ca.densify(ca.vertcat(ca.SX(0, 1), *statement.path))
    path = ca.Function("path", [statement.point], [column])
    values = np.array(path(np.concatenate([[0.0], x0])))
    return not bool((values <= 0).all())


def affine_form(statement: Statement) -> Affine | None:
    """Return a problem in affine form; None if it has no such form.

    The dynamics must be affine in the controls. The stage cost must have, for each
    control, a number times u and a number of at least 0 times u^2.
    """
    u, f, L = statement.controls, statement.rate, statement.stage
    zero = ca.SX.zeros(u.shape)
    if _has_kinks(ca.vertcat(f, L), u):
        return None
    columns = ca.jacobian(f, u)
    slope = ca.gradient(L, u) if u.numel() else ca.SX(0, 1)
    bend = ca.jacobian(slope, u)
    if ca.depends_on(columns, u) or not _is_number(bend):
        return None
    numbers = np.array(ca.Function("bend", [], [ca.densify(bend)])()["o0"])
    linear = ca.simplify(ca.substitute(slope, u, zero))
    diagonal = np.diag(numbers)
    if (numbers != np.diag(diagonal)).any() or (diagonal < 0).any():
        return None
    if not _is_number(linear):
        return None
    c = np.array(ca.Function("linear", [], [ca.densify(linear)])()["o0"]).ravel()
    return Affine(
        drift=ca.densify(ca.substitute(f, u, zero)),
        columns=tuple(ca.densify(columns[:, k]) for k in range(u.numel())),
        stage=ca.substitute(L, u, zero),
        linear=c,
        quadratic=diagonal / 2,
    )


def _has_kinks(column: ca.SX, u: ca.SX) -> bool:
    """Return whether a kink or a jump depends on the controls.

    Derivatives do not show these: that of |u| does not depend on u.
    """
    function = ca.Function("column", [u, *_others(column, u)], [ca.densify(column)])
    tape = expanded_tape(function)
    moved: list[bool] = []
    for node in tape.nodes:
        if node.operation in ("input", "constant"):
            moved.append(node.operation == "input" and node.arguments[0] == 0)
            continue
        moved.append(any(moved[a] for a in node.arguments))
        if moved[-1] and node.operation not in _SMOOTH:
            return True
    return False


def _others(column: ca.SX, u: ca.SX) -> list[ca.SX]:
    """Return the symbols of an expression without those given."""
    given = {one.element_hash() for one in ca.symvar(u)}
    return [one for one in ca.symvar(column) if one.element_hash() not in given]


def _is_number(expression: ca.SX) -> bool:
    return not ca.symvar(expression)
