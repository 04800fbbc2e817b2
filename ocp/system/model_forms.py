"""Forms in which users give right-hand sides, converted to one SX column.

    an SX expression, or a list of its rows       as it is
    MX expressions in MX symbols                  expanded, see expressions.py
    a casadi.Function of (x, u), (x, u, p), ...   called with the model's symbols
    a Python function of the same arguments       called once with the model's symbols

The arguments of a function are recognised by their names (ARGUMENT_NAMES), else by a
signature such as "txup" with a letter for each argument in order, else by their number:
x; x, u; x, u, p or t, x, u; t, x, u, p. The sizes of a casadi.Function's arguments must
allow one of these orders and no permutation of it.
"""

import inspect
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import cast

import casadi as ca
import numpy as np

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import (
    SymbolMap,
    as_column,
    require_scalar_operations,
)

LETTERS = {
    "t": "time",
    "x": "states",
    "u": "controls",
    "p": "parameters",
    "s": "signals",
    "z": "algebraic",
}
"""Meaning of each letter of a signature."""
ARGUMENT_NAMES = {
    "t": ("t", "time"),
    "x": ("x", "state", "states"),
    "u": ("u", "control", "controls"),
    "p": ("p", "parameter", "parameters", "params"),
    "s": ("s", "signal", "signals"),
    "z": ("z", "algebraic"),
}
"""Names of arguments by letter."""
_BY_NAME = {name: letter for letter, known in ARGUMENT_NAMES.items() for name in known}
RESULT_NAMES = {
    "ode": ("xdot", "x_dot", "dx", "ode", "rhs"),
    "next_state": ("x_next", "xnext", "next_state", "xf"),
}
"""Names of the output to take from a casadi.Function with several outputs."""
_ORDERS = {1: ("x",), 2: ("xu",), 3: ("xup", "txu"), 4: ("txup",)}
_LONGEST = 300  # characters of a user's error that a message shows
Symbols = Mapping[str, ca.SX]
Rows = Sequence[ca.SX | ca.MX | float]
Given = ca.SX | ca.MX | ca.Function | Rows | Callable[..., object]


def symbolic_rows(
    role: str,
    given: Given,
    symbols: Symbols,
    *,
    signature: str = "",
    symbol_map: SymbolMap | None = None,
) -> ca.SX:
    """Return a right-hand side as a column in the model's SX symbols.

    Args:
        role: Its role, "ode" or "next_state": for messages, and to choose an output.
        given: An expression, a list of rows, a `casadi.Function` or a Python function.
        symbols: Columns of SX symbols by role: "states", "controls", "parameters",
            "time", "signals", "algebraic"; roles that the model lacks are left out or
            empty.
        signature: A letter for each argument of a function, see LETTERS; if empty, the
            arguments are recognised by their names, else by their number.
        symbol_map: The MX symbols of the model, if it was given in MX.

    Returns:
        The rows, shape (m, 1).

    Raises:
        InvalidProblemError: If the arguments cannot be recognised or do not fit; if the
            function fails or does not return one row for each state; or if an
            expression has symbols that are not the model's or cannot be expanded.
    """
    known = symbol_map or SymbolMap()
    _require_letters(signature)
    if isinstance(given, ca.Function):
        return _rows_of_function(role, given, symbols, signature)
    if callable(given):
        return _rows_of_callable(role, given, symbols, signature, known)
    return _column(role, given, known)


def _column(role: str, given: object, symbol_map: SymbolMap) -> ca.SX:
    """Return an expression or a list of rows as an SX column."""
    # NumPy functions return arrays of symbols, which CasADi does not accept.
    if isinstance(given, np.ndarray) and given.dtype == object:
        given = given.ravel().tolist()
    if isinstance(given, list | tuple):
        given = [symbol_map.sx(role, row) for row in given]
    return as_column(role, symbol_map.sx(role, cast(ca.SX, given)))


def _rows_of_function(
    role: str, function: ca.Function, symbols: Symbols, signature: str
) -> ca.SX:
    """Return the rows of a `casadi.Function` for the model's symbols."""
    place = f"{role}, the casadi.Function {function.name()!r},"
    names = [function.name_in(k) for k in range(function.n_in())]
    sizes = [function.numel_in(k) for k in range(function.n_in())]
    letters = signature or _letters_by_name(names)
    if not letters:
        letters = _letters_by_size(place, names, sizes, symbols)
    arguments = _arguments(place, letters, names, symbols)
    for name, size, argument, letter in zip(
        names, sizes, arguments, letters, strict=True
    ):
        if size != argument.numel():
            raise InvalidProblemError(
                f"{place} has {size} rows in its input {name!r}, the model has "
                f"{argument.numel()} {LETTERS[letter]}"
            )
    outputs = [function.name_out(k) for k in range(function.n_out())]
    if not outputs:
        raise InvalidProblemError(f"{place} must have an output, it has none")
    named = [k for k, name in enumerate(outputs) if name in RESULT_NAMES.get(role, ())]
    shaped = [
        ca.reshape(argument, *function.size_in(k))
        for k, argument in enumerate(arguments)
    ]
    try:
        # The output with a known name, else the first one.
        result = function.call(shaped)[named[0] if len(named) == 1 else 0]
    except RuntimeError as error:
        raise InvalidProblemError(
            f"{place} must consist of scalar operations (CasADi's expand), found: "
            f"{' '.join(str(error).split())[-_LONGEST:]}"
        ) from error
    require_scalar_operations(place.rstrip(","), result)  # The comma is for sentences.
    return _of_states(place, as_column(place, result), symbols)


def _rows_of_callable(
    role: str,
    function: Callable[..., object],
    symbols: Symbols,
    signature: str,
    symbol_map: SymbolMap,
) -> ca.SX:
    """Return the rows of a Python function for the model's symbols."""
    name = getattr(function, "__name__", type(function).__name__)
    place = f"{role}, the function {name!r},"
    by_keyword: tuple[str, ...] = ()
    if signature:
        names: Sequence[str] = tuple(signature)
        letters = signature
    else:
        names, by_keyword = _parameters(place, function, symbols)
        letters = _letters_by_name(names)
        letters = letters or _letters_by_number(place, names, symbols)
    arguments = _arguments(place, letters, names, symbols)
    keywords = {n: a for n, a in zip(names, arguments, strict=True) if n in by_keyword}
    positional = [
        a for n, a in zip(names, arguments, strict=True) if n not in by_keyword
    ]
    try:
        returned = function(*positional, **keywords)
    except Exception as error:  # A user's function may raise anything.
        raise InvalidProblemError(
            f"{place} raised {type(error).__name__}: "
            f"{' '.join(str(error).split())[:_LONGEST]}; it is called once with CasADi "
            "symbols: write casadi.sin for math.sin and casadi.if_else for if"
        ) from error
    if returned is None:
        raise InvalidProblemError(f"{place} must return the rows, got None")
    rows = _of_states(place, _column(place, returned, symbol_map), symbols)
    if _has_nan(rows):
        raise InvalidProblemError(
            f"{place} must return rows without NaN: float(), and so math.sin, of a "
            "CasADi symbol is NaN; write casadi.sin"
        )
    return rows


def _has_nan(rows: ca.SX) -> bool:
    """Return whether a constant in an expression is NaN."""
    whole = ca.Function("whole", ca.symvar(rows), [rows])
    return any(
        np.isnan(whole.instruction_constant(k))
        for k in range(whole.n_instructions())
        if whole.instruction_id(k) == ca.OP_CONST
    )


def _of_states(place: str, rows: ca.SX, symbols: Symbols) -> ca.SX:
    expected = symbols["states"].numel()
    if rows.numel() != expected:
        raise InvalidProblemError(
            f"{place} must return one row for each of the {expected} states, "
            f"got {rows.numel()}"
        )
    return rows


def _require_letters(signature: str) -> None:
    """Raise if a signature has unknown or repeated letters."""
    if not isinstance(signature, str) or set(signature) - set(LETTERS):
        meaning = ", ".join(f"{letter} {role}" for letter, role in LETTERS.items())
        raise InvalidProblemError(
            "signature must be letters such as 'txup', one for each argument in order "
            f"({meaning}), got {signature!r}"
        )
    if len(set(signature)) != len(signature):
        raise InvalidProblemError(
            f"signature must have each letter once, got {signature!r}"
        )


def _letters_by_name(names: Sequence[str]) -> str:
    """Return the letters of arguments by their names; empty if a name is unknown."""
    letters = "".join(_BY_NAME.get(name, "") for name in names)
    # An unknown or a repeated name leaves fewer letters than names.
    return letters if len(set(letters)) == len(names) else ""


def _letters_by_number(place: str, names: Sequence[str], symbols: Symbols) -> str:
    """Return the letters of a Python function's arguments by their number."""
    fitting = [
        letters
        for letters in _ORDERS.get(len(names), ())
        if all(letter in "xu" or _size(letter, symbols) for letter in letters)
        and _agree(letters, names)
    ]
    if len(fitting) != 1:
        raise _unclear(place, names)
    return fitting[0]


def _letters_by_size(
    place: str, names: Sequence[str], sizes: Sequence[int], symbols: Symbols
) -> str:
    """Return the letters of a casadi.Function's inputs by their number and sizes."""
    fitting = {
        "".join(order)
        for letters in _ORDERS.get(len(names), ())
        for order in itertools.permutations(letters)
        if [_size(letter, symbols) for letter in order] == list(sizes)
        and _agree(order, names)
    }
    usual = {letters for letters in fitting if letters in _ORDERS[len(names)]}
    # Another order that fits as well is no reason to guess.
    if len(fitting) != 1 or not usual:
        raise _unclear(place, [f"{n} ({s})" for n, s in zip(names, sizes, strict=True)])
    return fitting.pop()


def _agree(letters: Iterable[str], names: Iterable[str]) -> bool:
    """Return whether each argument with a known name gets the letter of that name."""
    return all(
        _BY_NAME.get(name, letter) == letter
        for letter, name in zip(letters, names, strict=True)
    )


def _size(letter: str, symbols: Symbols) -> int:
    symbol = symbols.get(LETTERS[letter])
    return 0 if symbol is None else int(symbol.numel())


def _unclear(place: str, names: Sequence[str]) -> InvalidProblemError:
    return InvalidProblemError(
        f"{place} must have arguments that can be told apart: call them x, u, p, t, or "
        f"give signature='xup' or the like; it has {', '.join(names) or 'none'}"
    )


def _arguments(
    place: str, letters: str, names: Sequence[str], symbols: Symbols
) -> list[ca.SX]:
    """Return the symbols for the letters; a role that the model lacks is empty."""
    if len(letters) != len(names):
        raise InvalidProblemError(
            f"signature must have a letter for each of the {len(names)} arguments of "
            f"{place.rstrip(',')}, got {letters!r}"
        )
    if "t" in letters and not _size("t", symbols):
        raise InvalidProblemError(
            f"{place} depends on the time, the model has no symbol of the time"
        )
    return [symbols.get(LETTERS[letter], ca.SX(0, 1)) for letter in letters]


def _parameters(
    place: str, function: Callable[..., object], symbols: Symbols
) -> tuple[list[str], tuple[str, ...]]:
    """Return a Python function's arguments, and the keyword-only ones among them.

    An argument with a default value keeps it, unless its name is that of symbols of the
    model.
    """
    known = {name for name, letter in _BY_NAME.items() if _size(letter, symbols)}
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError) as error:
        raise _unclear(place, ["a signature that Python cannot tell"]) from error
    variable = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    taken = [
        p
        for p in parameters
        if p.kind not in variable and (p.default is p.empty or p.name in known)
    ]
    if not taken:
        raise _unclear(place, [str(p) for p in parameters])
    return [p.name for p in taken], tuple(
        # By keyword: an argument with a default before it may have been left out.
        p.name
        for p in taken
        if p.kind is p.KEYWORD_ONLY or (p.default is not p.empty)
    )
