"""A function as weighted sums of terms, so that equal terms of a sum cancel.

    f_i(y) = sum over j of A_ij w_j(y)

w_j are the inputs, the number 1 and the values that are not sums, each once; A are
numbers. With x1' = -x1 + r and x2' = -x2 - r, for example, r cancels in x1' + x2';
intervals of x1' and x2' would count the width of r twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.tubes.support import PAD
from swarmstart.tape import OPERATIONS, Node, Tape
from swarmstart.terminal_set.interval_arithmetic import expanded_tape

_CODES = {name: code for code, name in OPERATIONS.items()}
_ONE = -1
"""Number of the term 1."""
_UNDERFLOW = 1e-280
"""Added to sizes of numbers, for products too small for a float."""

_Form = dict[int, tuple[float, float]]
"""Term -> its weight in a value, and the sum of the sizes of the weight's summands."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Terms:
    """A function as weighted sums.

    Attributes:
        symbols: y, shape (inputs, 1).
        terms: w, shape (number, 1), of y.
        weights: A in floats, shape (outputs, number).
        errors: Error bounds of these floats, shape (outputs, number).
    """

    symbols: ca.SX
    terms: ca.SX
    weights: Array
    errors: Array


def terms_of(function: ca.Function) -> Terms:
    """Return a function as weighted sums of terms.

    Args:
        function: y (n, 1) -> a column.

    Raises:
        UnknownIntervalOperationError: If it has an operation that is unknown.
    """
    tape = expanded_tape(function)
    forms: list[_Form] = []
    for number, node in enumerate(tape.nodes):
        forms.append(_form(number, node, forms))
    outputs = [forms[number] for number in tape.outputs[0]]
    used = sorted({term for form in outputs for term in form})
    column = {term: j for j, term in enumerate(used)}
    weights, sizes = np.zeros((2, len(outputs), len(used)))
    for i, form in enumerate(outputs):
        for term, (weight, size) in form.items():
            weights[i, column[term]], sizes[i, column[term]] = weight, size + _UNDERFLOW
    symbols = ca.SX.sym("y", function.numel_in(0))
    values = _replayed(tape, symbols)
    terms = [ca.SX(1) if term == _ONE else values[term] for term in used]
    # Each of the tape's operations rounds a number once at most.
    roundings = max(PAD, len(tape.nodes) * 2.0**-51)
    return Terms(
        symbols=symbols,
        terms=ca.densify(ca.vertcat(*terms)),
        weights=weights,
        errors=roundings * sizes,
    )


def _form(number: int, node: Node, forms: list[_Form]) -> _Form:
    """Return a value as a sum of terms; as a term itself if it is not a sum."""
    if node.operation == "constant" and np.isfinite(node.value):
        return {_ONE: (node.value, abs(node.value))}
    itself = {number: (1.0, 1.0)}
    if node.operation in ("constant", "input"):
        return itself
    one, other = (forms[node.arguments[k]] for k in (0, -1))
    if node.operation in ("add", "sub"):
        return _sum(one, _scaled(other, 1.0 if node.operation == "add" else -1.0))
    if node.operation in ("neg", "twice"):
        return _scaled(one, -1.0 if node.operation == "neg" else 2.0)
    if node.operation in ("mul", "div"):
        return _product(one, other, is_quotient=node.operation == "div") or itself
    return itself


def _product(one: _Form, other: _Form, *, is_quotient: bool) -> _Form | None:
    """Return a product with, or quotient by, a number; None if neither is a number."""
    factor, divisor = _number(one), _number(other)
    if is_quotient:
        return _scaled(one, 1.0 / divisor) if divisor else None
    if factor is not None:
        return _scaled(other, factor)
    return _scaled(one, divisor) if divisor is not None else None


def _number(form: _Form) -> float | None:
    """Return the exact number that a value is; None if it is not an exact number."""
    weight, size = form.get(_ONE, (0.0, 0.0))
    # A number that is a rounded sum is not exact: it stays a term.
    return weight if set(form) == {_ONE} and abs(weight) == size else None


def _sum(one: _Form, other: _Form) -> _Form:
    total = dict(one)
    for term, (weight, size) in other.items():
        before = total.get(term, (0.0, 0.0))
        total[term] = before[0] + weight, before[1] + size
    return total


def _scaled(form: _Form, factor: float) -> _Form:
    return {
        term: (weight * factor, size * abs(factor))
        for term, (weight, size) in form.items()
    }


def _replayed(tape: Tape, symbols: ca.SX) -> list[ca.SX]:
    """Return all values of a tape of one argument as expressions."""
    values: list[ca.SX] = []
    for node in tape.nodes:
        if node.operation == "constant":
            values.append(ca.SX(node.value))
        elif node.operation == "input":
            values.append(symbols[node.arguments[1]])
        else:
            arguments = [values[a] for a in node.arguments]
            code = _CODES[node.operation]
            if len(arguments) == 1:
                values.append(ca.SX.unary(code, *arguments))
            else:
                values.append(ca.SX.binary(code, *arguments))
    return values
