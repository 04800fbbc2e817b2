"""A problem of this library as a control problem in numbers, if it is one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.ocp.constraint_forms import known_scales
from swarmstart.ocp.constraints import Constraint
from swarmstart.ocp.fitness import Known, core_known
from swarmstart.ocp.free import Free
from swarmstart.ocp.lower_bound.statement import Affine, Statement
from swarmstart.ocp.lowering import Lowered, lowered
from swarmstart.ocp.problem import STATE_BOUNDS, OptimalControlProblem
from swarmstart.ocp.scaling import Sizes, Sizing

Array = NDArray[np.float64]
MOST_STATES = 3


class NoBoundError(SwarmstartError):
    """A problem that no bound can be proven of here, with the reason."""


def statement_of(
    problem: OptimalControlProblem, x0: ArrayLike, known: Known
) -> Statement:
    """Return a problem in numbers.

    Args:
        problem: The problem.
        x0: Initial state, shape (nx,).
        known: Parameters, and the time at the start.

    Raises:
        NoBoundError: If it is none that a bound can be proven of: with the reason.
        InvalidProblemError: If a shape is not the problem's.
    """
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
    return _Maker(problem_pair, known, sizes, start).statement()


def _reason_for_none(problem: OptimalControlProblem) -> str:
    """Return why nothing can be proven of a problem; empty if there is a way."""
    model = problem.model
    if model.nx > MOST_STATES:
        return f"{model.nx} states, at most {MOST_STATES} are possible"
    lacks = {
        "the model jumps at the end of an interval": model.jumps,
        "the model has algebraic equations": model.algebraic is not None,
        "the model or the problem has signals": bool(problem.ns),
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
    """Puts numbers and sizes into the expressions of a problem."""

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
        # The stated costs are as the user has them: maximised ones are turned round.
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
        path = [c for c in problem.path_constraints if c.name != STATE_BOUNDS]
        ends = problem.terminal_constraints
        low, high = problem.state_limits
        room = problem.path_tolerance * self._scale
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
        """Return the sizes of the rows of each constraint, by its id."""
        problem = self._problem
        every = [*problem.path_constraints, *problem.terminal_constraints]
        if len(every) != len(self._sizes.rows[: len(every)]):
            return {}
        return {id(c): rows for c, rows in zip(every, self._sizes.rows, strict=False)}

    def _at_most_zero(
        self, constraints: Iterable[Constraint], scales: dict[int, Array]
    ) -> Iterator[ca.SX]:
        """Yield the rows of constraints, widened by the tolerance of answers.

        Rows that depend on the controls are left out: more is admissible then, and the
        bound no higher.
        """
        free = ca.vertcat(self._problem.model.controls, self._problem.previous)
        for constraint in constraints:
            # As stated: the smooth form of an NLP may have a margin.
            rows = constraint.rows(constraint.expression)
            sizes = scales.get(id(constraint), known_scales(constraint))
            for i in range(rows.values.numel()):
                value = rows.values[i]
                if free.numel() and ca.depends_on(value, free):
                    continue
                limits = np.abs([rows.lower[i], rows.upper[i]])
                largest = float(limits[np.isfinite(limits)].max(initial=1.0))
                size = float(sizes[i]) if np.isfinite(sizes[i]) else largest
                width = self._problem.path_tolerance * size
                number = self._numbers(value)
                if np.isfinite(rows.upper[i]):
                    yield number - float(rows.upper[i] + width)
                if np.isfinite(rows.lower[i]):
                    yield float(rows.lower[i] - width) - number


def affine_form(statement: Statement) -> Affine | None:
    """Return a problem in affine form; None if it has none.

    The dynamics must be affine in the controls, the stage cost a sum of a number times
    u and a number, at least 0, times u^2, for each control.
    """
    u, f, L = statement.controls, statement.rate, statement.stage
    zero = ca.SX.zeros(u.shape)
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


def _is_number(expression: ca.SX) -> bool:
    return not ca.symvar(expression)
