"""Map from a model's CasADi MX symbols to the SX symbols that replace them.

The right-hand side is compiled from SX expressions, whose operations are scalar. A
model in MX symbols gets an SX symbol of the same name and shape for each of them, and
every expression in them is expanded:

    e(x, u, p) in MX  ->  Function([x, u, p], [e]).expand()  called with the SX symbols

If CasADi cannot write a function's body in scalar operations (an integrator, a root
finder, a callback), the function stays in the expanded expression as a call, without an
error (CasADi 3.8.2). Such a call is refused here. Tables (`casadi.interpolant`) stay as
calls, too, but are allowed: the compiler reads them (interpolants.py).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TypeVar, cast

import casadi as ca

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened

T = TypeVar("T")
_WEIGHTS = ("weight", "quadratic_weight")
_TABLES = ("LinearInterpolant", "BSplineInterpolant")


@dataclass(frozen=True, slots=True, eq=False)
class SymbolMap:
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
    calls = (
        k
        for k in range(whole.n_instructions())
        if whole.instruction_id(k) == ca.OP_CALL
    )
    if next(calls, None) is None:  # the usual case, and a quick one
        return
    waiting = list(ca.vertsplit(ca.vec(ca.densify(expression))))
    seen = set()
    while waiting:
        node = waiting.pop()
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
        sx: Converts an expression, given its role, to SX.
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
        if any(value is not getattr(stated, name) for name, value in changed.items()):
            stated = replace(stated, **changed)
    return cast(T, stated)
