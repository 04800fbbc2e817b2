"""Expressions given by a user: columns, symbols, MX converted to SX, common factors.

The right-hand side is compiled from SX expressions, whose operations are scalar. A
model in MX symbols gets an SX symbol of the same name and shape for each of them, and
every expression in them is expanded:

    e(x, u, p) in MX  ->  Function([x, u, p], [e]).expand()  called with the SX symbols

If CasADi cannot write a function's body in scalar operations (an integrator, a root
finder, a callback), the function stays in the expanded expression as a call, without an
error (CasADi 3.8.2). Such a call is refused here. Tables (`casadi.interpolant`) stay as
calls, too, but are allowed: the compiler reads them (interpolants.py).

Powers of two are factored out of an expression, so that they cause no rounding. A cost
times a power of two has the same digits with other exponents. But 2^k (a b) + c is not
rounded like a b + c: sums are fused with products, and derivatives add up in another
order. If the power is factored out and applied at the very end, every answer has the
same bits.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar, cast

import casadi as ca
import numpy as np

from swarmstart.arguments import Check, either, of_kind, reals
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.pickling import Expressed

LONGEST_SHOWN = 60
"""Largest number of characters of a value in a message."""
_APART = re.compile(r"(?P<name>@\d+)=(?P<part>.*?), (?P<rest>.*)")
"""A part that CasADi writes apart, and what follows it; no part has ", " in it."""
_LONGEST_FOLDED = 20 * LONGEST_SHOWN
T = TypeVar("T")
_WEIGHTS = ("weight", "quadratic_weight")
_TABLES = ("LinearInterpolant", "BSplineInterpolant")


EXPRESSION = of_kind((ca.SX, ca.MX, ca.DM), "a CasADi expression")
ROWS = Check(
    either(EXPRESSION, either(reals(), of_kind((list, tuple), ""))).accepts,
    "a CasADi expression, numbers, or a list of rows",
)


def shortened(value: object) -> str:
    """Return the text of a value for a message: shortened, with its type.

    CasADi writes repeated parts of an expression separately, as in "@1=x+y, @1*@1".
    Such parts are inserted again.

    Example:
        >>> half = ca.SX.sym("x") / 2
        >>> print(half * ca.sin(half))
        @1=(x/2), (@1*sin(@1))
        >>> print(shortened(half * ca.sin(half)))
        ((x/2)*sin((x/2)))
    """
    text = " ".join(str(value).split())
    if isinstance(value, ca.SX | ca.MX):
        text = _folded(text)
    if len(text) > LONGEST_SHOWN:
        text = f"{text[: LONGEST_SHOWN - 3]}..."
    return text if isinstance(value, ca.SX) else f"{text} ({type(value).__name__})"


def _folded(text: str) -> str:
    """Return CasADi's "@1=part, expression of @1" as one expression."""
    parts: dict[str, str] = {}
    while found := _APART.fullmatch(text):
        parts[found["name"]], text = found["part"], found["rest"]
    # A part may hold those before it, so the last one is replaced first.
    for name, part in reversed(parts.items()):
        text = re.sub(rf"{name}(?!\d)", part.replace("\\", r"\\"), text)
        # Parts of parts can double the length again and again.
        text = text[:_LONGEST_FOLDED]
    return text


def as_symbolic_column(role: str, expression: ca.SX) -> ca.SX:
    """Return an expression as one column; MX stays MX, for a problem to convert to SX.

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
            # The empty SX makes the result SX, also of numbers alone or of no rows.
            expression = ca.vertcat(ca.SX(0, 1), *expression)
        column = ca.SX(expression)
    except (NotImplementedError, TypeError) as error:
        raise InvalidProblemError(
            f"{role} must be a CasADi SX expression, got {shortened(expression)}"
        ) from error
    if min(column.shape) > 1:
        raise InvalidProblemError(f"{role} must be a vector, got shape {column.shape}")
    if column.is_constant() and bool(np.isnan(np.array(ca.evalf(column))).any()):
        raise InvalidProblemError(f"{role} must not be NaN, got {column}")
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
        # CasADi refuses free symbols at once; they are searched for only if it does.
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
        others = "; a symbol of your own is declared as Model(parameters=...)"
        raise InvalidProblemError(
            f"{role} may depend on {allowed} only, found {', '.join(foreign)}"
            f"{others if 'parameters' in known else ''}"
        ) from error


def rows_that_depend(column: ca.SX, symbols: ca.SX) -> list[int]:
    """Return the rows of an expression that depend on any of some symbols."""
    if not (symbols.numel() and column.numel()):
        return []
    # Order 1: in any way; for each row.
    depend = ca.which_depends(column, symbols, 1, True)
    return [row for row, depends in enumerate(depend) if depends]


def symbol_names(symbols: ca.SX) -> tuple[str, ...]:
    """Return the names of a column of symbols."""
    return tuple(str(symbols[i]) for i in range(symbols.numel()))


def symbol_of(name: str) -> ca.SX:
    """Return a scalar symbol of any name; CasADi would split a name at brackets."""
    return ca.SX.sym(name.translate(str.maketrans("[],", "   ")))


@dataclass(frozen=True, slots=True, eq=False)
class SymbolMap(Expressed):
    """MX symbols, each with the SX symbol that replaces it.

    Attributes:
        given: The MX symbols of the user.
        symbols: An SX column or matrix for each, of the same name and shape.
    """

    given: tuple[ca.MX, ...] = ()
    symbols: tuple[ca.SX, ...] = ()

    def sx(self, role: str, expression: ca.SX | ca.MX) -> ca.SX:
        """Return an expression in MX symbols as one in SX symbols.

        Args:
            role: Description of the expression, for the message.
            expression: MX in the given symbols; anything else is returned unchanged.

        Raises:
            InvalidProblemError: If it has other MX symbols, or a call that cannot be
                written in scalar operations.
        """
        if not isinstance(expression, ca.MX):
            return expression
        foreign = [
            symbol.name()
            for symbol in ca.symvar(expression)
            if not any(ca.is_equal(symbol, known) for known in self.given)
        ]
        if foreign:
            raise InvalidProblemError(
                f"{role} has MX symbols that are not symbols of the model: "
                f"{', '.join(foreign)}"
            )
        # A call with SX symbols expands the function.
        function = ca.Function("expression", list(self.given), [expression])
        expanded = function.call(list(self.symbols))[0]
        require_scalar_operations(role, expanded)
        return expanded

    def extended(
        self, columns: Mapping[str, ca.SX | ca.MX]
    ) -> tuple["SymbolMap", dict[str, ca.SX]]:
        """Return the map with further symbols, and the columns as SX.

        Args:
            columns: Columns of symbols by role; those that are not MX are returned
                unchanged.

        Raises:
            InvalidProblemError: If an MX column is neither a symbol nor a column of
                symbols.
        """
        given, symbols = list(self.given), list(self.symbols)
        for role, column in columns.items():
            for primitive in _primitives(role, column):
                if not any(ca.is_equal(primitive, known) for known in given):
                    given.append(primitive)
                    name, sparsity = primitive.name(), primitive.sparsity()
                    symbols.append(ca.SX.sym(name, sparsity))
        extended = SymbolMap(tuple(given), tuple(symbols))
        return extended, {
            role: extended.sx(role, column) for role, column in columns.items()
        }


def _primitives(role: str, column: ca.SX | ca.MX) -> list[ca.MX]:
    """Return the MX symbols that a column consists of."""
    if not isinstance(column, ca.MX):
        return []
    if not column.is_valid_input():
        raise InvalidProblemError(
            f"{role} must be CasADi symbols, got {shortened(column)}"
        )
    return [p for p in column.primitives() if p.numel()]


def require_scalar_operations(role: str, expression: ca.SX) -> None:
    """Raise if an expression calls a function other than a table.

    Raises:
        InvalidProblemError: With the names of the called functions.
    """
    called = sorted({
        f"{function.name()} ({function.class_name()})"
        for function in _called(expression)
        if function.class_name() not in _TABLES
    })  # fmt: skip
    if called:
        raise InvalidProblemError(
            f"{role} must consist of scalar operations (CasADi's expand), it calls "
            f"{', '.join(called)}; write the formula itself, for example an explicit "
            "right-hand side in place of an integrator"
        )


def _called(expression: ca.SX) -> Iterator[ca.Function]:
    """Yield the functions that an SX expression calls, outermost calls first."""
    whole = ca.Function("whole", ca.symvar(expression), [expression])
    if not whole.find_functions(0):  # The usual case, and a quick one.
        return
    waiting = list(ca.vertsplit(ca.vec(ca.densify(expression))))
    seen = set()
    while waiting:
        node = waiting.pop()
        # Shared subexpressions are visited once; else the walk may grow exponentially.
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.is_call():
            yield node.which_function()
        waiting.extend(node.dep(k) for k in range(node.n_dep()))


def in_sx(role: str, entry: T, sx: Callable[[str, ca.SX | ca.MX], ca.SX]) -> T:
    """Return a user's entry with every expression in it converted to SX.

    Args:
        role: Description of the entry, for messages.
        entry: An expression, a constraint of this package, or a list or tuple of these;
            anything else is returned unchanged.
        sx: Function (role, expression) -> the expression in SX.
    """
    stated: object = entry
    if isinstance(stated, ca.SX | ca.MX):
        stated = sx(role, stated)
    elif isinstance(stated, list | tuple):
        stated = type(stated)(in_sx(role, part, sx) for part in stated)
    elif is_dataclass(stated) and not isinstance(stated, type):
        changed = {
            attribute: sx(role, value)
            for attribute in ("expression", "relative", *_WEIGHTS)
            if attribute in {f.name for f in fields(stated)}
            and isinstance(value := getattr(stated, attribute), ca.SX | ca.MX)
        }
        # An entry without MX is returned itself: `replace` would validate it again.
        if any(value is not getattr(stated, name) for name, value in changed.items()):
            stated = replace(stated, **changed)
    return cast(T, stated)


def without_power_of_two(expression: ca.SX) -> tuple[int, ca.SX]:
    """Return (k, rest) with expression = 2^k rest, k taken from constant factors."""
    if expression.is_constant() or not expression.nnz():
        return 0, expression
    operation = expression.op()
    if operation == ca.OP_MUL:
        return _of_product(expression)
    if operation == ca.OP_TWICE:
        power, rest = without_power_of_two(expression.dep(0))
        return power + 1, rest
    if operation == ca.OP_NEG:
        power, rest = without_power_of_two(expression.dep(0))
        return power, -rest
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return _of_sum(expression)
    return 0, expression


def _of_product(product: ca.SX) -> tuple[int, ca.SX]:
    first, second = product.dep(0), product.dep(1)
    for factor, other in ((first, second), (second, first)):  # Either may be constant.
        # 0, inf and NaN have no power of two.
        if factor.is_constant() and float(factor) and math.isfinite(float(factor)):
            mantissa, exponent = math.frexp(float(factor))
            power, rest = without_power_of_two(other)
            left = 2 * mantissa  # In [1, 2), with its sign.
            return power + exponent - 1, rest if left == 1.0 else left * rest
    return 0, product


def _of_sum(total: ca.SX) -> tuple[int, ca.SX]:
    """Return the power that both terms share, taken out of a sum or difference."""
    (k, a), (m, b) = (without_power_of_two(total.dep(i)) for i in (0, 1))
    if k != m or not k:
        return 0, total
    return k, a + b if total.op() == ca.OP_ADD else a - b
