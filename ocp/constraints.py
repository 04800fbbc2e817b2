"""Constraints on a trajectory: how far they are broken, and their rows for an NLP.

Every constraint names one `expression` in the problem's symbols. From its value v

    rows(v)      measured quantity with its limits, lower <= q(v) <= upper, in the units
                 of the user: what an answer is verified by
    smooth(v)    the same demand in rows that are smooth everywhere, for an NLP
    excess(a, b) column of numbers, positive if a row is broken between the values a and
                 b at the two ends of a check (a part of a control interval): what the
                 population search sees

The search adds up the positive excesses, each divided by its row's `scale`, over all
checks: the "violation" of an individual, a number without unit. An expression with
controls jumps at a control instant, so it is evaluated at both ends of every interval,
with that interval's control.

A scale that is not given is found from the problem (scaling.py), so that the units of a
constraint change nothing.

Distances are in separation.py.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, cast, get_args

import casadi as ca
import numpy as np

from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.expressions import as_column, as_symbolic_column
from swarmstart.ocp.limits import Array, Limit, limits_of, require_choice, scales_given

Measure = Literal["excess", "indicator"]
MovingLimit = Limit | ca.SX | Sequence[float | ca.SX]
"""Numbers, or expressions of parameters, signals and time."""


class Rows(NamedTuple):
    """Values with their limits, lower <= values <= upper.

    Attributes:
        values: Shape (m, 1).
        lower: Shape (m,).
        upper: Shape (m,).
    """

    values: ca.SX
    lower: Array
    upper: Array


class Constraint(Protocol):
    """Limits on an expression of states, controls, parameters and signals."""

    @property
    def name(self) -> str:
        """Name in messages; empty: its expression."""

    @property
    def expression(self) -> ca.SX:
        """Column in the problem's symbols that is evaluated at each check."""

    @property
    def scale(self) -> Limit | None:
        """Size of each row of `rows`, shape (m,); None: found automatically."""

    @property
    def measure(self) -> Measure:
        """How the search measures it: "excess" or "indicator"."""

    def rows(self, value: ca.SX) -> Rows:
        """Return the measured quantity and its limits, in the units of the user."""

    def smooth(self, value: ca.SX) -> Rows:
        """Return the same demand as as many smooth rows, in the same units."""

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return by how much each row is broken at most, <= 0 if respected, (m, 1)."""

    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 for each row that an indicator counts as broken, (m, 1)."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Bounds:
    """Box bounds on controls and states.

    Where a bound is an expression of parameters, signals and time, it moves: a problem
    makes a path constraint of it, and has numbers only.

    Attributes:
        controls: (lower, upper), each a number or shape (nu,); None = unbounded. A
            control with equal bounds is fixed.
        states: (lower, upper), each a number or shape (nx,), -inf and inf where a
            state is free; None = all free. They hold at the start and at every check.
        search: Bounds of the controls that a population search looks within, where they
            are narrower or the controls have none; None: those of the controls.
        state_scale: The excess of a state is divided by it, a number or shape (nx,);
            None: found automatically.
        integer: Numbers or names of the controls that take whole numbers only; their
            bounds are whole, too.

    Example:
        >>> import swarmstart as ss
        >>> inf = float("inf")
        >>> bounds = ss.Bounds(controls=(-1, 1), states=([0, -inf], [5, inf]))
        >>> bounds.states
        ([0, -inf], [5, inf])
    """

    controls: tuple[MovingLimit, MovingLimit] | None = None
    states: tuple[MovingLimit, MovingLimit] | None = None
    search: tuple[Limit, Limit] | None = None
    state_scale: Limit | None = None
    integer: Sequence[int | str] = ()


class _Limited:
    """How the value of an expression is measured against its limits."""

    __slots__ = ()
    lower: Limit
    upper: Limit

    def rows(self, value: ca.SX) -> Rows:
        """Return the value and its limits."""
        return Rows(value, np.asarray(self.lower), np.asarray(self.upper))

    def smooth(self, value: ca.SX) -> Rows:
        """Return the value and its limits."""
        return self.rows(value)

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return the excess of each row at the check's end."""
        return row_excess(self.rows(end))

    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 for each row beyond its limits."""
        return excess > 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PathConstraint(_Limited):
    """lower <= expression <= upper at the start and at the end of every check.

    With a weight it is soft, see soft.py: it may be broken at a cost, in each control
    interval of dt (weight e + quadratic_weight e^2) for the largest excess e of a row.

    Attributes:
        expression: Column in the problem's symbols, shape (m, 1), or a list of
            scalars.
        lower: Lower limits, a number or shape (m,).
        upper: Upper limits, a number or shape (m,).
        scale: The excess is divided by it, a number or shape (m,); None: found
            automatically.
        measure: "excess" (how far) or "indicator" (1 for each row broken).
        name: Name in messages; empty: the expression.
        weight: Of the excess, at least 0: a number, shape (m,), or expressions of
            parameters and signals as an interval begins [cost / (s unit of the row)].
        quadratic_weight: Of its square, likewise. None of both: not soft.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> power = ss.PathConstraint(expression=x[1] * u, lower=-1.2, upper=1.2)
        >>> power.is_soft
        False
        >>> ss.PathConstraint(expression=x[0], upper=3.0, weight=10.0).is_soft
        True
    """

    expression: ca.SX
    lower: Limit = -np.inf
    upper: Limit = np.inf
    scale: Limit | None = None
    measure: Measure = "excess"
    name: str = ""
    weight: Limit | ca.SX | None = None
    quadratic_weight: Limit | ca.SX | None = None

    def __post_init__(self) -> None:
        """Bring limits and weights into the shape of the expression."""
        _set_limits(self, "path constraint")
        require_choice("measure", self.measure, get_args(Measure))
        if self.is_soft:
            _set_weights(self)

    @property
    def is_soft(self) -> bool:
        """Whether it may be broken at a cost."""
        return self.weight is not None or self.quadratic_weight is not None

    @property
    def weights(self) -> tuple[ca.SX, ca.SX]:
        """Weights of the excess and of its square, if it is soft; each (m, 1)."""
        return cast(ca.SX, self.weight), cast(ca.SX, self.quadratic_weight)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TerminalConstraint(_Limited):
    """lower <= expression <= upper at the end of the horizon; equality by default.

    Attributes:
        expression: Column in states, parameters and signals, shape (m, 1).
        lower: Lower limits, a number or shape (m,).
        upper: Upper limits, a number or shape (m,).
        scale: The excess is divided by it, a number or shape (m,); None: found
            automatically.
        name: Name in messages; empty: the expression.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x = ca.SX.sym("x", 2)
        >>> at_rest = ss.TerminalConstraint(expression=x[1], name="rest")
        >>> near = ss.TerminalConstraint(expression=x[0], lower=0.9, upper=1.1)
        >>> print(at_rest.lower, near.upper)
        [0.] [1.1]
    """

    expression: ca.SX
    lower: Limit = 0.0
    upper: Limit = 0.0
    scale: Limit | None = None
    name: str = ""
    measure: Measure = field(default="excess", init=False)

    def __post_init__(self) -> None:
        """Bring the limits into the shape of the expression."""
        _set_limits(self, "terminal constraint")


def row_excess(rows: Rows) -> ca.SX:
    """Return by how much each value is outside its limits, (m, 1).

    Negative inside; 0 without limits.
    """
    over = []
    for i, (lower, upper) in enumerate(zip(rows.lower, rows.upper, strict=True)):
        value = rows.values[i]
        sides = [value - upper] if np.isfinite(upper) else []
        sides += [lower - value] if np.isfinite(lower) else []
        over.append(functools.reduce(ca.fmax, sides) if sides else ca.SX(0))
    return ca.vertcat(ca.SX(0, 1), *over)


_RELATIONS = (ca.OP_LE, ca.OP_LT, ca.OP_EQ)


def limited(role: str, constraint: object) -> tuple[ca.SX, Array, Array] | None:
    """Return (expression, lower, upper) of a relation or a bare expression.

    `x <= 1`, `x >= 1` and `x == 1` mean what they say; a bare expression means
    expression = 0. A strict relation counts as the one with equality.

    Args:
        role: What the constraint is, for the message.
        constraint: What the user gave.

    Returns:
        The expression with its limits; None if the constraint is no expression.

    Raises:
        InvalidProblemError: If relations and expressions are mixed in one column.
    """
    if not isinstance(constraint, ca.SX):
        return None
    column = as_column(role, constraint)
    rows = [column[i] for i in range(column.numel())]
    relations = [row.is_op(op) for row in rows for op in _RELATIONS if row.is_op(op)]
    if not relations:
        return column, np.zeros(len(rows)), np.zeros(len(rows))
    if len(relations) != len(rows):
        raise InvalidProblemError(
            f"{role} must be relations or expressions, found both in {column}"
        )
    expressions, lower, upper = zip(*map(_sides, rows), strict=True)
    return ca.vertcat(*expressions), np.array(lower), np.array(upper)


def _sides(relation: ca.SX) -> tuple[ca.SX, float, float]:
    """Return (expression, lower, upper) of a scalar relation a <= b or a = b."""
    left, right = relation.dep(0), relation.dep(1)
    equal = relation.is_op(ca.OP_EQ)
    if right.is_constant():
        limit = float(right)
        return left, limit if equal else -np.inf, limit
    if left.is_constant():
        limit = float(left)
        return right, limit, limit if equal else np.inf
    return left - right, 0.0 if equal else -np.inf, 0.0


def _set_limits(constraint: PathConstraint | TerminalConstraint, role: str) -> None:
    """Bring expression, limits and scale of a constraint into one shape."""
    expression = as_symbolic_column("expression", constraint.expression)
    size = expression.numel()
    lower, upper = limits_of(role, (constraint.lower, constraint.upper), size)
    object.__setattr__(constraint, "expression", expression)
    object.__setattr__(constraint, "lower", lower)
    object.__setattr__(constraint, "upper", upper)
    object.__setattr__(constraint, "scale", scales_given(role, constraint.scale, size))


def _set_weights(constraint: PathConstraint) -> None:
    """Bring the weights of a soft constraint to columns."""
    size = constraint.expression.numel()
    unlimited = ~np.isfinite(constraint.lower) & ~np.isfinite(constraint.upper)
    if constraint.measure == "indicator" or np.any(unlimited):
        raise InvalidProblemError(
            "a soft constraint must have a limit in every row and the measure "
            f"'excess', got {constraint.lower}, {constraint.upper} and "
            f"{constraint.measure!r}"
        )
    for role in ("weight", "quadratic_weight"):
        given = getattr(constraint, role)
        column = as_symbolic_column(role, ca.SX(0) if given is None else given)
        if column.numel() not in (1, size):
            raise InvalidProblemError(
                f"{role} must be one or {size} of them, got {column.numel()}"
            )
        for i in range(column.numel()):
            if column[i].is_constant() and not 0 <= float(column[i]) < np.inf:
                raise InvalidProblemError(
                    f"{role} must be at least 0 and finite, got {column[i]}"
                )
        column = ca.repmat(column, size // column.numel() if size else 1, 1)
        object.__setattr__(constraint, role, column)
