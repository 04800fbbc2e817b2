"""Constraints on a trajectory: their excess for a search, their rows for an NLP.

Every constraint names one `expression` in the problem's symbols. From its value v

    rows(v)      measured quantity with its limits, lower <= q(v) <= upper, in the units
                 of the user: used to verify an answer
    smooth(v)    the same constraint in rows that are smooth everywhere, for an NLP
    excess(a, b) column of numbers, positive if a row is broken between the values a and
                 b at the two ends of a check (a part of a control interval): for the
                 population search

The search adds up the positive excesses over all checks, each divided by its row's
`scale`. This sum is the "violation" of an individual, a number without unit. An
expression that contains controls jumps at a control instant, so it is evaluated at both
ends of every interval with the control of that interval.

A scale that is not given is found from the problem (scaling.py), so that the result
does not depend on the units of a constraint.

A bound that depends on parameters, signals or time becomes a path constraint,

    lower(p, s, t) <= x   ->   x - lower >= 0,        x <= upper   ->   x - upper <= 0,

while a bound that is a number stays a bound. Distances, and the forms in which users
write constraints, are in separation.py.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, cast, get_args

import casadi as ca
import numpy as np

from swarmstart.arguments import (
    Check,
    checked,
    either,
    of_kind,
    optional,
    reals,
    several,
    text,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import (
    EXPRESSION,
    ROWS,
    as_column,
    as_symbolic_column,
    require_known,
)
from swarmstart.ocp.common.limits import Limit, limits_of, require_choice, scales_given
from swarmstart.ocp.common.pickling import Expressed

Measure = Literal["excess", "indicator"]
MovingLimit = Limit | ca.SX | Sequence[float | ca.SX]
"""Numbers, or expressions of parameters, signals and time."""
MOVING = "moving bounds of the "
"""Name of the path constraint of moving bounds, followed by "controls" or "states"."""
Limits = tuple[Limit, Limit]
_SIDES = ("lower", "upper")


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
        """Measure of a violation in the search: "excess" or "indicator"."""

    def rows(self, value: ca.SX) -> Rows:
        """Return the measured quantity and its limits, in the units of the user."""

    def smooth(self, value: ca.SX) -> Rows:
        """Return the same limits as equally many smooth rows, in the same units."""

    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return a number for each row, above 0 if it is broken in a check, (m, 1).

        Args:
            start: Value of the expression at the start of the check.
            end: Value of the expression at the end of the check.
        """

    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 for each row that an indicator counts as broken, (m, 1)."""


def _pair(check: Check) -> Check:
    """A pair (lower, upper) of what another check accepts."""
    accepts = several(check, "").accepts
    return optional(
        Check(
            lambda value: accepts(value) and len(value) == len(_SIDES),
            f"a pair (lower, upper), each {check.allowed}",
        )
    )


_CONTROL = of_kind((int, float, str, np.integer), "a number or a name")


@checked(
    refused,
    controls=_pair(ROWS),
    states=_pair(ROWS),
    search=_pair(reals()),
    state_scale=optional(reals()),
    # Which controls there are is known to the problem only.
    integer=either(several(_CONTROL, "a sequence of numbers or names"), _CONTROL),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Bounds(Expressed):
    """Box bounds on controls and states.

    A bound may be an expression of parameters, signals and time. The problem turns such
    a moving bound into a path constraint and keeps numbers only as bounds.

    Attributes:
        controls: (lower, upper), each a number or shape (nu,); None: unbounded. Equal
            bounds fix a control.
        states: (lower, upper), each a number or shape (nx,); -inf and inf leave a state
            free; None: all free. They hold at the start and at every check.
        search: Bounds of the controls for a population search, if they are narrower
            than those of the controls or the controls have none; None: those of the
            controls.
        state_scale: Divisor of a state's excess, a number or shape (nx,); None: found
            automatically.
        integer: Numbers or names of the controls that take whole numbers only. Their
            bounds must be whole numbers, too.

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


class _Limited(Expressed):
    """Measurement of an expression against its limits."""

    __slots__ = ()
    lower: Limit
    upper: Limit

    @checked(refused, value=EXPRESSION)
    def rows(self, value: ca.SX) -> Rows:
        """Return the value and its limits."""
        return Rows(value, np.asarray(self.lower), np.asarray(self.upper))

    @checked(refused, value=EXPRESSION)
    def smooth(self, value: ca.SX) -> Rows:
        """Return the value and its limits."""
        return self.rows(value)

    @checked(refused, start=EXPRESSION, end=EXPRESSION)
    def excess(self, start: ca.SX, end: ca.SX) -> ca.SX:
        """Return the excess of each row at the check's end."""
        return row_excess(self.rows(end))  # Its start is the end of the check before.

    @checked(refused, excess=EXPRESSION)
    def indicated(self, excess: ca.SX) -> ca.SX:
        """Return 1 for each row beyond its limits."""
        return excess > 0


@checked(refused, measure=text(), name=text())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PathConstraint(_Limited):
    """Path constraint lower <= expression <= upper, at both ends of every check.

    With a weight it is soft: it may be broken at a cost. Each row then costs
    dt (weight e + quadratic_weight e^2) in each control interval of length dt, with e
    the row's largest excess over its limits in that interval, 0 if it keeps them.

    Attributes:
        expression: Column in the problem's symbols, shape (m, 1), or a list of
            scalars.
        lower: Lower limits, a number or shape (m,).
        upper: Upper limits, a number or shape (m,).
        scale: Divisor of the excess, a number or shape (m,); None: found automatically.
        measure: "excess" (amount of the violation) or "indicator" (1 for each broken
            row).
        name: Name in messages; empty: the expression.
        weight: Cost of the excess, at least 0: a number, shape (m,), or expressions of
            parameters and signals at the start of an interval [cost / (s unit of the
            row)].
        quadratic_weight: Cost of the squared excess, likewise. None for both: not soft.

    Raises:
        InvalidProblemError: If limits, scale or weights do not fit the expression or
            are out of range, or the measure is unknown.

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
        """Broadcast limits and weights to the shape of the expression."""
        _set_limits(self, "path constraint")
        require_choice("measure", self.measure, get_args(Measure))
        if self.is_soft:
            _set_weights(self)

    @property
    def is_soft(self) -> bool:
        """True if the constraint may be broken at a cost."""
        return self.weight is not None or self.quadratic_weight is not None

    @property
    def weights(self) -> tuple[ca.SX, ca.SX]:
        """Weights of the excess and of its square, if it is soft; each (m, 1)."""
        return cast(ca.SX, self.weight), cast(ca.SX, self.quadratic_weight)


@checked(refused, name=text())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TerminalConstraint(_Limited):
    """Constraint lower <= expression <= upper at the end of the horizon.

    By default both limits are 0: an equality.

    Attributes:
        expression: Column in states, parameters and signals, shape (m, 1).
        lower: Lower limits, a number or shape (m,).
        upper: Upper limits, a number or shape (m,).
        scale: Divisor of the excess, a number or shape (m,); None: found automatically.
        name: Name in messages; empty: the expression.

    Raises:
        InvalidProblemError: If limits or scale do not fit the expression, or cross.

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
        """Broadcast the limits to the shape of the expression."""
        _set_limits(self, "terminal constraint")


def row_excess(rows: Rows) -> ca.SX:
    """Return the distance of each value outside its limits, (m, 1).

    It is negative inside the limits, and 0 without limits.
    """
    over = []
    for i, (lower, upper) in enumerate(zip(rows.lower, rows.upper, strict=True)):
        value = rows.values[i]
        sides = [value - upper] if np.isfinite(upper) else []
        sides += [lower - value] if np.isfinite(lower) else []
        over.append(functools.reduce(ca.fmax, sides) if sides else ca.SX(0))
    return ca.vertcat(ca.SX(0, 1), *over)


def limited(role: str, constraint: object) -> tuple[ca.SX, Array, Array] | None:
    """Return (expression, lower, upper) of a relation or an expression alone.

    `x <= 1`, `x >= 1` and `x == 1` have their usual meaning. An expression alone means
    expression = 0. A strict relation is treated as the one with equality.

    Args:
        role: Description of the constraint, for messages.
        constraint: The user's entry.

    Returns:
        The expression with its limits; None if the entry is no expression.

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


def fixed_and_moving(
    role: str,
    limits: tuple[MovingLimit, MovingLimit] | None,
    symbols: ca.SX,
    known: dict[str, ca.SX],
) -> tuple[Limits, list[PathConstraint]]:
    """Split bounds into numbers and a path constraint for the others, if any.

    Args:
        role: "controls" or "states".
        limits: (lower, upper), each a number, an expression, or one of these for each
            symbol; None: no bounds.
        symbols: The bounded symbols, shape (n, 1).
        known: Columns of symbols that bounds may depend on, by their names in messages.

    Raises:
        InvalidProblemError: If a bound depends on symbols that are not `known`, or the
            number of bounds is neither one nor the number of bounded symbols.
    """
    if limits is None:
        return (-np.inf, np.inf), []
    if not isinstance(limits, tuple | list) or not any(map(_is_moving, limits)):
        return limits, []  # type: ignore[return-value] # Checked as numbers.
    # The limit is 0 and so constant, as a path constraint requires.
    numbers, rows, ranges = [], [], []
    for given, none, side in zip(
        limits, (-np.inf, np.inf), ((0.0, np.inf), (-np.inf, 0.0)), strict=True
    ):
        column = _column(role, given, int(symbols.numel()))
        require_known(f"bounds of the {role}", column, known)
        fixed = np.full(column.numel(), none)
        for i in range(column.numel()):
            if column[i].is_constant():
                fixed[i] = float(column[i])
            else:
                rows.append(symbols[i] - column[i])
                ranges.append(side)
        numbers.append(fixed)
    lower, upper = np.reshape(ranges, (-1, 2)).T
    constraint = PathConstraint(
        expression=ca.vertcat(*rows), lower=lower, upper=upper, name=f"{MOVING}{role}"
    )
    return (numbers[0], numbers[1]), [constraint]


_RELATIONS = (ca.OP_LE, ca.OP_LT, ca.OP_EQ)  # CasADi writes a >= b as b <= a.


def _sides(relation: ca.SX) -> tuple[ca.SX, float, float]:
    """Return (expression, lower, upper) of a scalar relation a <= b or a = b."""
    left, right = relation.dep(0), relation.dep(1)
    equal = relation.is_op(ca.OP_EQ)
    if right.is_constant():
        limit = float(right)
        return left, limit if equal else -np.inf, limit
    if left.is_constant():  # x >= 1 is stored as 1 <= x.
        limit = float(left)
        return right, limit, limit if equal else np.inf
    return left - right, 0.0 if equal else -np.inf, 0.0


def _set_limits(constraint: PathConstraint | TerminalConstraint, role: str) -> None:
    """Broadcast expression, limits and scale of a constraint to one shape."""
    expression = as_symbolic_column("expression", constraint.expression)
    size = expression.numel()
    lower, upper = limits_of(role, (constraint.lower, constraint.upper), size)
    object.__setattr__(constraint, "expression", expression)
    object.__setattr__(constraint, "lower", lower)
    object.__setattr__(constraint, "upper", upper)
    object.__setattr__(constraint, "scale", scales_given(role, constraint.scale, size))


def _set_weights(constraint: PathConstraint) -> None:
    """Turn the weights of a soft constraint into columns."""
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
        # Without rows the column may be empty, too: no division by 0.
        column = ca.repmat(column, size // max(column.numel(), 1), 1)
        object.__setattr__(constraint, role, column)


def _is_moving(limit: object) -> bool:
    """Return whether a limit is or contains an expression."""
    if isinstance(limit, ca.SX):
        return True
    several = limit if isinstance(limit, tuple | list) else ()
    return any(isinstance(one, ca.SX) for one in several)


def _column(role: str, given: object, size: int) -> ca.SX:
    """Return limits as a column of a given size."""
    column = as_column(f"bounds of the {role}", given)  # type: ignore[arg-type]
    if column.numel() not in (1, size):
        raise InvalidProblemError(
            f"bounds of the {role} must be one or {size} of them, got {column.numel()}"
        )
    return ca.vertcat(*[column] * (size // column.numel()))
