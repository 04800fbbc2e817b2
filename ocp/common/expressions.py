"""Expressions given by a user: columns, symbols, and their text in messages."""

from collections.abc import Sequence
from typing import Any, cast

import casadi as ca

from swarmstart.ocp.common.errors import InvalidProblemError

LONGEST_SHOWN = 60
"""Largest number of characters of a value in a message."""


def shortened(value: object) -> str:
    """Return the text of a value for a message: shortened, with its type."""
    text = " ".join(str(value).split())
    if len(text) > LONGEST_SHOWN:
        text = f"{text[: LONGEST_SHOWN - 3]}..."
    return text if isinstance(value, ca.SX) else f"{text} ({type(value).__name__})"


def as_symbolic_column(role: str, expression: ca.SX) -> ca.SX:
    """Return an expression as one column; MX stays MX, a problem converts it to SX.

    Raises:
        InvalidProblemError: If it is neither a vector nor a number.
    """
    rows: Sequence[Any] = (expression,)
    if isinstance(expression, list | tuple):
        rows = expression
    if not any(isinstance(row, ca.MX) for row in rows):
        return as_column(role, expression)
    try:
        column = ca.vertcat(*rows)
    except (NotImplementedError, TypeError) as error:
        raise InvalidProblemError(
            f"{role} must be a CasADi expression, got {shortened(expression)}"
        ) from error
    if min(column.shape) > 1:
        raise InvalidProblemError(f"{role} must be a vector, got shape {column.shape}")
    return cast(ca.SX, ca.densify(ca.vec(column)))


def as_column(role: str, expression: ca.SX) -> ca.SX:
    """Return an expression, or a value convertible to SX, as one column.

    Raises:
        InvalidProblemError: If it is neither a vector nor a number.
    """
    try:
        if isinstance(expression, list | tuple):
            expression = ca.vertcat(ca.SX(0, 1), *expression)
        column = ca.SX(expression)
    except (NotImplementedError, TypeError) as error:
        raise InvalidProblemError(
            f"{role} must be a CasADi SX expression, got {shortened(expression)}"
        ) from error
    if min(column.shape) > 1:
        raise InvalidProblemError(f"{role} must be a vector, got shape {column.shape}")
    return ca.densify(ca.reshape(column, -1, 1))


def require_symbols(role: str, symbols: ca.SX) -> None:
    """Raise unless the argument is a column of SX symbols.

    Raises:
        InvalidProblemError: If symbols is not a column of SX symbols.
    """
    if not isinstance(symbols, ca.SX) or (
        symbols.numel() and not symbols.is_valid_input()
    ):
        raise InvalidProblemError(
            f"{role} must be CasADi SX symbols, got {shortened(symbols)}"
        )
    if symbols.shape[1] != 1:
        raise InvalidProblemError(f"{role} must be a column, got shape {symbols.shape}")


def require_known(role: str, expression: ca.SX, known: dict[str, ca.SX]) -> None:
    """Raise if an expression has symbols that are not among the known ones.

    Args:
        role: Description of the expression, for the message.
        expression: The expression.
        known: Columns of symbols, by their names in the message.

    Raises:
        InvalidProblemError: If there are foreign symbols, which the message names, or
            two of the known symbols are the same.
    """
    try:
        ca.Function("known", list(known.values()), [expression])
    except RuntimeError as error:
        columns = list(known.values())
        foreign = [
            str(symbol)
            for symbol in ca.symvar(expression)
            if not any(ca.depends_on(column, symbol) for column in columns)
        ]
        allowed = ", ".join(known)
        if not foreign:
            raise InvalidProblemError(
                f"{allowed} must be different symbols, found one twice"
            ) from error
        raise InvalidProblemError(
            f"{role} may depend on {allowed} only, found {', '.join(foreign)}"
        ) from error


def rows_that_depend(column: ca.SX, symbols: ca.SX) -> list[int]:
    """Return the rows of an expression that depend on any of some symbols."""
    if not (symbols.numel() and column.numel()):
        return []
    depend = ca.which_depends(column, symbols, 1, True)
    return [row for row, depends in enumerate(depend) if depends]


def symbol_names(symbols: ca.SX) -> tuple[str, ...]:
    """Return the names of a column of symbols."""
    return tuple(str(symbols[i]) for i in range(symbols.numel()))


def symbol_of(name: str) -> ca.SX:
    """Return a scalar symbol of any name; CasADi would split a name at brackets."""
    return ca.SX.sym(name.translate(str.maketrans("[],", "   ")))
