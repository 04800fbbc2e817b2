"""Algebraic variables as unknowns of an NLP, in place of Newton's method.

A model's expressions contain Newton's method in place of the algebraic variables z
(algebraic.py). An NLP may use z as unknowns instead. The expression is then read value
by value, and each value that is z at a known point,

    z(x, u, p, s) = result of Newton's method there    ->    a symbol,

is replaced by a symbol; Newton's iterations then drop out of the expression. A value
that is not recognised is kept, so the expression has the same meaning in any case.
"""

from collections.abc import Mapping

import casadi as ca

from swarmstart.tape import OPERATIONS, Node, Tape, UnknownOperationError, read_tape

_CODES = {name: code for code, name in OPERATIONS.items()}


def lifted(expressions: ca.SX, values: ca.SX, symbols: ca.SX) -> ca.SX:
    """Return expressions with symbols in place of given values.

    Args:
        expressions: Shape (m, 1).
        values: Values to replace, shape (n, 1).
        symbols: The symbols that replace them, shape (n, 1).
    """
    given = ca.symvar(ca.vertcat(expressions, values))
    known = ca.vertcat(ca.SX(0, 1), *given)
    function = ca.Function("whole", [known], [ca.densify(expressions), values])
    try:
        tape = read_tape(function)
    except UnknownOperationError:
        return expressions
    places: dict[int, ca.SX] = {}
    for number, symbol in zip(tape.outputs[1], ca.vertsplit(symbols), strict=True):
        node = tape.nodes[number]
        if node.operation == "neg":  # x - (-a) becomes x + a.
            places.setdefault(node.arguments[0], -symbol)
        if node.operation != "constant":
            places.setdefault(number, symbol)
    return _rebuilt(tape, known, places)


def _rebuilt(tape: Tape, known: ca.SX, places: Mapping[int, ca.SX]) -> ca.SX:
    """Return the first output of a tape, with some of its values given."""
    turned = {
        node.arguments[::-1]: places[number]
        for number, node in enumerate(tape.nodes)
        if number in places and node.operation == "sub"
    }
    values: list[ca.SX] = []
    for number, node in enumerate(tape.nodes):
        if number in places:
            values.append(places[number])
        elif node.operation == "sub" and node.arguments in turned:
            values.append(-turned[node.arguments])  # CasADi has -(a - b) as b - a.
        elif node.operation == "input":
            values.append(known[node.arguments[1]])
        elif node.operation == "constant":
            values.append(ca.SX(node.value))
        else:
            values.append(_applied(node, values))
    return ca.vertcat(ca.SX(0, 1), *[values[number] for number in tape.outputs[0]])


def _applied(node: Node, values: list[ca.SX]) -> ca.SX:
    """Return the result of one operation."""
    arguments = [values[number] for number in node.arguments]
    if len(arguments) == 1:
        return ca.SX.unary(_CODES[node.operation], *arguments)
    return ca.SX.binary(_CODES[node.operation], *arguments)
