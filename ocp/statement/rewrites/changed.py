"""Problem with other expressions and further states, for the rewrites."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import brief
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.common.limits import numbers_of, shaped
from swarmstart.ocp.statement.guesses import zero_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import Bounds, Constraint
from swarmstart.ocp.system.model import Model

Change = Callable[[ca.SX], ca.SX]
"""An expression -> the expression that replaces it."""
NOTHING_CHANGED: Mapping[str, Any] = MappingProxyType({})
_KEPT = (
    "states", "controls", "ode", "next_state", "parameters", "signals", "time",
    "state_names", "control_names", "outputs", "units", "elimination",
)  # fmt: skip
"""Fields of a model; the others concern how it is stated."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Appended:
    """States that a rewrite appends, unbounded.

    Attributes:
        states: Their symbols, shape (k, 1).
        rates: Their rates; None: constant within an interval.
        after: Their values after the end of an interval; None: no jump.
        names: Their names; empty: those of the symbols.
    """

    states: ca.SX
    rates: ca.SX | None = None
    after: ca.SX | None = None
    names: tuple[str, ...] = ()


def replaced(old: ca.SX, new: ca.SX) -> Change:
    """Return a function that substitutes symbols in an expression."""
    if not old.numel():
        return lambda expression: expression
    return lambda expression: ca.substitute(expression, old, new)


def with_states(
    problem: OptimalControlProblem,
    appended: Appended,
    equations: Mapping[str, Any] = NOTHING_CHANGED,
    **changes: Any,
) -> OptimalControlProblem:
    """Return a copy of a problem with further states and some fields changed.

    Args:
        problem: The problem before.
        appended: The states.
        equations: Further fields of the model to change; an "ode" or "next_state"
            has the rows of the old states only.
        changes: Further fields of the problem to change.
    """
    given = {**{role: getattr(problem.model, role) for role in _KEPT}, **equations}
    model = problem.model
    count = int(appended.states.numel())
    rates = ca.SX.zeros(count) if appended.rates is None else appended.rates
    jumps = model.jumps or appended.after is not None
    after = appended.states if appended.after is None else appended.after
    before = given["next_state"] if model.jumps else model.states
    given |= {
        "states": ca.vertcat(model.states, appended.states),
        "ode": ca.vertcat(given["ode"], rates),
        "next_state": ca.vertcat(before, after) if jumps else ca.SX(0, 1),
        "state_names": (
            *model.state_names,
            *(appended.names or symbol_names(appended.states)),
        ),
    }
    return replace(
        problem,
        model=Model(**given),
        bounds=_bounds(problem, count),
        **changes,
    )


def with_equations(model: Model, **changes: Any) -> Model:
    """Return a model with some fields changed, such as its equations.

    The model returned is in SX symbols, and its algebraic equations are solved already.
    """
    return Model(**({role: getattr(model, role) for role in _KEPT} | changes))


def changed_model(model: Model, change: Change) -> dict[str, Any]:
    """Return the fields of a model with all expressions changed."""
    return {
        "ode": change(model.ode),
        "next_state": change(model.next_state) if model.jumps else model.next_state,
        "outputs": {name: change(output) for name, output in model.outputs.items()},
        "elimination": model.elimination.rewritten(change),
    }


def changed_fields(
    problem: OptimalControlProblem, timed: Change, begun: Change
) -> dict[str, Any]:
    """Return the fields of a problem with all expressions changed.

    Args:
        problem: The problem.
        timed: Function that changes an expression that is evaluated at any time.
        begun: Function that changes an expression that is evaluated at the start of an
            interval.
    """
    risk = problem.risk
    return {
        "stage_cost": timed(problem.stage_cost),
        "step_cost": begun(problem.step_cost),
        "initial_cost": timed(problem.initial_cost),
        "terminal_cost": timed(problem.terminal_cost),
        "constraints": [
            *[_with_expression(c, timed(c.expression)) for c in problem.stated],
            *[
                replace(
                    c,
                    expression=timed(c.expression),
                    weight=timed(c.weights[0]),
                    quadratic_weight=timed(c.weights[1]),
                )
                for c in problem.soft
            ],
        ],
        "terminal": [
            replace(c, expression=timed(c.expression))
            for c in problem.terminal_constraints
        ],
        "risk": None
        if risk is None
        else replace(
            risk,
            stage=timed(risk.stage),
            step=begun(risk.step),
            initial=timed(risk.initial),
            terminal=timed(risk.terminal),
        ),
    }


def signal_rows(problem: OptimalControlProblem, signals: ArrayLike) -> Array:
    """Return the signals at the nodes, shape (ns, nodes).

    Raises:
        InvalidProblemError: If the shape is not the problem's; the message has the
            signals' names.
    """
    given, shape = numbers_of("signals", signals), (problem.ns, problem.nodes)
    # A user without signals gives ().
    rows = given if given.size or problem.ns else np.empty((0, problem.nodes))
    return shaped("signals", rows, shape, lambda: meaning_of_known(problem, "signals"))


def with_parameters(
    problem: OptimalControlProblem, parameters: ArrayLike, more: ArrayLike
) -> Array:
    """Return the known parameters of a problem with those that a rewrite appends.

    Parameters of the core are returned unchanged; their larger number tells them apart.

    Args:
        problem: Problem before the rewrite.
        parameters: Values of its parameters that are not decided, or of the core's.
        more: Values of the appended parameters.
    """
    values = np.asarray(parameters)
    own = problem.model.np - len(problem.decided)
    return np.append(values, more) if values.size == own else values


def meaning_of_known(problem: OptimalControlProblem, role: str) -> str:
    """Return a text for messages: how values are given as an argument of `Known`.

    Args:
        problem: The problem.
        role: Name of the argument: "parameters" or "signals".

    Returns:
        The text, with the names of the problem's parameters or signals; empty if the
        problem has none of them.
    """
    names = ", ".join(symbol_names(problem.symbols()[role]))
    if not names:
        return ""
    if role == "parameters":
        return f": Known(parameters=...), the values of {names}"
    return (
        f": Known(signals=...), a row for each of {names}, with its values at the "
        f"{problem.nodes} nodes"
    )


def controls_before(
    problem: OptimalControlProblem, previous: ArrayLike | None, count: int = 1
) -> Array:
    """Return the controls of the last intervals before the horizon, (nu, count).

    Args:
        problem: The problem.
        previous: Controls of the last interval, shape (nu,), or of several, the last
            one last, shape (nu, k): if these are fewer than `count`, the first one is
            repeated; if more, the earlier ones are ignored. None: the allowed value
            nearest to zero.
        count: Number of intervals, at least 1.

    Raises:
        InvalidProblemError: If the shape is wrong, or a number is not finite.
    """
    if previous is None:
        return np.repeat(zero_controls(problem)[:, :1], count, axis=1)
    given, nu = numbers_of("previous", previous), problem.model.nu
    columns = given.reshape(-1, 1) if given.ndim < 2 else given  # noqa: PLR2004
    if columns.shape[1] and 0 < columns.shape[0] == problem.flown_controls:
        # A plant has the controls of one member, and all members begin with them.
        columns = np.tile(columns, (nu // columns.shape[0], 1))
    fits = columns.ndim == 2 and columns.shape[0] == nu and columns.shape[1]  # noqa: PLR2004
    if not (fits and np.isfinite(columns).all()):
        one = problem.flown_controls or nu
        raise InvalidProblemError(
            f"previous must be finite numbers of shape ({one},), one for each control, "
            f"or ({one}, k), those of the last k intervals, the last one last; got "
            f"{brief(previous)}, shape {given.shape}"
        )
    missing = max(count - columns.shape[1], 0)
    first = np.repeat(columns[:, :1], missing, axis=1)
    return np.hstack([first, columns])[:, -count:]


def _with_expression(constraint: Constraint, expression: ca.SX) -> Constraint:
    """Return a copy of a path constraint with another expression."""
    field = "relative" if hasattr(constraint, "relative") else "expression"
    found: Constraint = replace(constraint, **{field: expression})  # type: ignore[type-var]
    return found


def _bounds(problem: OptimalControlProblem, more: int) -> Bounds:
    """Return the bounds of a problem with so many further states."""
    lower, upper = problem.state_limits
    scale = problem.bounds.state_scale
    return replace(
        problem.bounds,
        states=(
            np.append(lower, np.full(more, -np.inf)),
            np.append(upper, np.full(more, np.inf)),
        ),
        # Unbounded states have no excess, so any number will do.
        state_scale=None if scale is None else np.append(scale, np.ones(more)),
    )
