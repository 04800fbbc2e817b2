"""Expressions of a problem as CasADi symbols, as numbers, and over time.

A scope has the names that an expression can use. The message of an error has the column
in the expression and, if a name is not allowed there, the role of this name.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import (
    CONSTANTS,
    FLOAT_OPERATIONS,
    FUNCTIONS,
    PREVIOUS,
    ExpressionError,
    interpret,
    parse,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.values import (
    Decided,
    OverTime,
    Table,
    Tables,
    Tied,
    inputs_of,
    operations_of,
)
from swarmstart.ocp import Free, InvalidProblemError

Signal = Callable[[Array], Array]
"""Times (n,) [s] -> values, shape (n,) or (rows, n)."""
TIME = "time"
"""Name of the time since the start [s], for values that change in time."""
TIMING_S = 1e-9
"""Difference below which instants are equal, since n dt is rounded [s]."""
RESERVED = frozenset({TIME, PREVIOUS, *CONSTANTS, *FUNCTIONS})


def _symbolic(name: str) -> Callable[..., Any]:
    """Return an operation on symbols, computed in floats if there are floats only."""
    of_floats = FLOAT_OPERATIONS[name]
    named: dict[str, Any] = {"abs": ca.fabs, "min": ca.fmin, "max": ca.fmax}
    named |= {"**": ca.power, "radians": _radians}
    # Operators of floats, such as +, work on symbols as they are.
    of_symbols: Any = named.get(name) or getattr(ca, name, of_floats)

    def operation(*arguments: Any) -> Any:
        # Floats raise if the operation is undefined; a symbol is NaN then.
        if all(isinstance(argument, float) for argument in arguments):
            return of_floats(*arguments)
        return of_symbols(*arguments)

    return operation


def _radians(degrees: Any) -> Any:
    # CasADi has no function for it.
    return degrees * (math.pi / 180)


SYMBOLIC: Mapping[str, Callable[..., Any]] = {
    name: _symbolic(name) for name in FLOAT_OPERATIONS
}
ARRAYS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in FUNCTIONS if hasattr(np, name)},
    **{"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2},
    **{"abs": np.abs, "min": np.minimum, "max": np.maximum, "neg": np.negative},
    **{"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide},
    **{"**": np.power, "radians": np.radians},
}
"""Operations on arrays, entry by entry; not finite if they are not defined."""


@dataclass(frozen=True, slots=True)
class Scope:
    """The names that an expression can use.

    Attributes:
        names: Name -> its value, a symbol or a number.
        elsewhere: Name -> its role, for names of this file that are not allowed here.
        place: Place of the expression, in words.
        tables: Name -> table, used as a function.
    """

    names: Mapping[str, Any]
    elsewhere: Mapping[str, str]
    place: str
    tables: Tables = field(default_factory=dict)

    def value(self, text: str, operations: Mapping[str, Callable[..., Any]]) -> Any:
        """Return the value of an expression.

        Args:
            text: The expression.
            operations: Name of an operation or a function -> Python function that
                computes it.

        Raises:
            ExpressionError: If a name is unknown or not allowed here.
        """
        expression = parse(text, functions=inputs_of(self.tables))
        for name in expression.name_places:
            what = self.elsewhere.get(name.name)
            if name.name in self.tables:
                what = "table without its argument"
            if name.name not in self.names and what is not None:
                raise ExpressionError(
                    f"expected no {what} in {self.place}, found {name.name!r}",
                    text,
                    name.column,
                )
        return interpret(
            expression,
            operations={**operations, **operations_of(self.tables)},
            names=self.names,
        )

    def symbol(self, text: str) -> ca.SX:
        """Return an expression as a symbol."""
        return ca.SX(self.value(text, SYMBOLIC))

    def number(self, text: str) -> float:
        """Return an expression as a finite number."""
        return float(self.value(text, FLOAT_OPERATIONS))


def constants_of(
    scenario: ProblemScenario, own: Mapping[str, str] | None = None
) -> dict[str, float]:
    """Return the constants as numbers; a constant can use those before it.

    Args:
        scenario: The scenario.
        own: Constants of a vehicle, which replace those of the file or are added to
            them.

    Raises:
        ExpressionError: If a constant is not a finite number.
    """
    found: dict[str, float] = {}
    for name, text in {**scenario.constants, **(own or {})}.items():
        found[name] = number(text, found)
    return found


def number(text: str, constants: Mapping[str, float]) -> float:
    """Return an expression in constants as a finite number."""
    value = interpret(parse(text), operations=FLOAT_OPERATIONS, names=constants)
    return float(value)


def positive(text: str, constants: Mapping[str, float]) -> float:
    """Return an expression in constants as a positive number.

    Raises:
        InvalidProblemError: If it is not positive.
    """
    value = number(text, constants)
    if not value > 0:
        raise InvalidProblemError(f"expected a positive number, found {value:g}")
    return value


def limits(
    pair: Sequence[str | None] | None, constants: Mapping[str, float]
) -> tuple[float, float]:
    """Return [lower, upper] as numbers, infinite if there is no limit."""
    lower, upper = (None, None) if pair is None else pair
    return (
        -math.inf if lower is None else number(lower, constants),
        math.inf if upper is None else number(upper, constants),
    )


def moving_limits(
    pair: Sequence[str | None] | None, scope: Scope
) -> tuple[float | ca.SX, float | ca.SX]:
    """Return [lower, upper], each a number or an expression that can change."""
    lower, upper = (None, None) if pair is None else pair
    return (
        -math.inf if lower is None else scope.value(lower, SYMBOLIC),
        math.inf if upper is None else scope.value(upper, SYMBOLIC),
    )


def fixed_limits(
    pair: Sequence[str | None] | None, scope: Scope
) -> tuple[float, float]:
    """Return [lower, upper] as numbers, infinite if a limit changes or is missing."""
    lower, upper = moving_limits(pair, scope)
    return (
        -math.inf if isinstance(lower, ca.SX) else float(lower),
        math.inf if isinstance(upper, ca.SX) else float(upper),
    )


def free(given: Decided, constants: Mapping[str, float]) -> Free:
    """Return a decided number, with its bounds and its guess.

    Raises:
        SwarmstartError: If lower > upper, or the guess is not within the bounds.
    """
    lower, upper = limits(given.free, constants)
    guess = None if given.guess is None else number(given.guess, constants)
    found = f"[{lower:g}, {upper:g}]"
    if lower > upper:
        raise InvalidProblemError(f"expected lower <= upper, found {found}")
    if guess is not None and not lower <= guess <= upper:
        raise InvalidProblemError(f"expected a guess within {found}, found {guess:g}")
    return Free(lower, upper, guess)


def is_decided(given: object) -> bool:
    """Return whether a number of a scenario is decided."""
    return isinstance(given, Decided | Tied)


def known_parameters(scenario: ProblemScenario) -> dict[str, OverTime]:
    """Return the parameters that are not decided, by name."""
    given = scenario.parameters.items()
    return {name: one for name, one in given if not isinstance(one, Decided)}


def decided_parameters(
    scenario: ProblemScenario, constants: Mapping[str, float]
) -> dict[str, Free]:
    """Return the parameters that are decided, by name."""
    given = scenario.parameters.items()
    return {n: free(one, constants) for n, one in given if isinstance(one, Decided)}


def over_time(given: OverTime, constants: Mapping[str, float]) -> Signal:
    """Return a function: times (n,) [s] -> values (n,) of a table or an expression.

    Raises:
        ExpressionError: If a name is unknown, or its value at time 0 is not finite.
    """
    if isinstance(given, Table):
        times, values = np.array(given.times), np.array(given.values)
        if given.between == "linear":
            return lambda at: np.interp(at, times, values)
        return lambda at: values[_last_before(times, at)]
    expression = parse(given)
    interpret(
        expression, operations=FLOAT_OPERATIONS, names={**constants, TIME: 0.0}
    )  # Raises here, with its column.

    def values_at(times: Array) -> Array:
        with np.errstate(all="ignore"):
            found = interpret(
                expression, operations=ARRAYS, names={**constants, TIME: times}
            )
        return np.broadcast_to(np.asarray(found, dtype=np.float64), times.shape)

    return values_at


def _last_before(times: Array, at: Array) -> NDArray[np.intp]:
    """Return the index of the last time that is not after each instant."""
    found = np.searchsorted(times, np.asarray(at) + TIMING_S, side="right") - 1
    return np.maximum(found, 0)


def rows_over_time(
    given: Mapping[str, OverTime], constants: Mapping[str, float]
) -> Signal | None:
    """Return a function: times (n,) [s] -> a row for each entry, (rows, n); or None.

    It is None if nothing is given.
    """
    return stacked([over_time(one, constants) for one in given.values()])


def rows_at(
    given: Mapping[str, OverTime],
    names: Mapping[str, object],
    times: Array,
    constants: Sequence[Mapping[str, float]],
) -> Array:
    """Return rows of values: each name's for the first member, then for the next ones.

    Names that are not given have zeros.

    Args:
        given: Name -> values over time.
        names: All names, in order.
        times: Times (n,) [s].
        constants: The constants of each member.
    """
    rows = [
        over_time(given[name], own)(times) if name in given else np.zeros_like(times)
        for own in constants
        for name in names
    ]
    return np.stack(rows)


def stacked(rows: Sequence[Signal]) -> Signal | None:
    """Return a function that stacks values: times (n,) [s] -> (rows, n).

    It is None if there are no rows.

    Args:
        rows: Functions: times (n,) [s] -> values (n,).
    """
    return (lambda times: np.stack([row(times) for row in rows])) if rows else None
