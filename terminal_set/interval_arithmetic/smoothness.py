"""Kinks and jumps of a function, and their consequences for a proof.

CasADi's derivatives are valid between the kinks of a function, but do not show a kink:
a second derivative has no term for it.

    |a|             kink at a = 0
    fmin, fmax      kink at a = b
    atan2(y, x)     branch cut at y = 0, x <= 0: the function jumps, its derivatives
                    do not

So a Taylor form of a function c is valid only on a box without kinks and branch cuts.
On a box with kinks but no branch cut the first derivative may still be used. Along a
line from m to x,

    c(x) - c(m) = int_0^1 g(m + t (x - m))'(x - m) dt

with g the formula of the gradient, since c is Lipschitz and g is right for almost all t
(if a = 0 on more than isolated points, the slope of a is 0 at almost all of them). So
an interval of g over the box bounds c(x) - c(m). Second derivatives bound nothing
there.

All other operations have unbounded derivatives or values at the edge of their domain,
which the intervals show by themselves.

Source: Lebourg (1975), Comptes Rendus A 281, 795-797; Clarke (1983), Optimization and
Nonsmooth Analysis, section 2.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.tape import Node, Tape
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    IntervalEvaluation,
    expanded_tape,
    interval_function,
    interval_program,
    require_no_jumps,
)
from swarmstart.terminal_set.linear.arrays import Mask

KINKS = ("fabs", "fmin", "fmax")
NEIGHBOURHOOD = 1e-150
"""Half width of the box that stands for a point's neighbourhood; arbitrary."""
_EDGES = {
    "sqrt": (0.0,),
    "pow": (0.0,),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
    "acosh": (1.0,),
    "hypot": (0.0,),
}
"""Arguments (of hypot: values) beyond or at which derivatives are unbounded."""


@dataclass(eq=False)
class NotSmoothError(SwarmstartError, ValueError):
    """A function jumps at the reference, or its derivatives are unbounded there.

    Attributes:
        function: The function's name.
        operation: Name of the operation.
        reason: The reason, as a phrase that follows the operation's name.
    """

    function: str
    operation: str
    reason: str

    def __str__(self) -> str:
        """Return a message with the operation and the reason."""
        return (
            f"nothing can be proven: the operation {self.operation} of "
            f"{self.function} {self.reason} at the reference"
        )


class Kinks:
    """A test of boxes for the kinks and branch cuts of a function."""

    def __init__(self, function: ca.Function) -> None:
        """Collect the operations that have kinks or branch cuts.

        Args:
            function: x (n, 1) -> a column.

        Raises:
            UnknownIntervalOperationError: If it jumps, or has an operation without
                interval form.
        """
        tape, name = expanded_tape(function), function.name()
        require_no_jumps(tape, name)
        kinks = [node for node in tape.nodes if node.operation in KINKS]
        cuts = [node for node in tape.nodes if node.operation == "atan2"]
        self._kinks, self._has_any = len(kinks), bool(kinks or cuts)
        self._arguments = _arguments(tape, kinks, cuts, name)

    def __call__(self, lower: Array, upper: Array) -> tuple[Mask, Mask]:
        """Return two masks (m,): boxes that may have kinks; boxes that may have cuts.

        Cuts are the branch cuts of atan2.

        Args:
            lower: Lower corners of m boxes, shape (n, m).
            upper: Upper corners.
        """
        if not self._has_any:
            nothing = np.zeros(lower.shape[1], dtype=bool)
            return nothing, nothing
        low, high = self._arguments(lower, upper)
        has_zero: Mask = (low <= 0) & (high >= 0)
        number = self._kinks  # After these come y and x of each atan2, in turn.
        is_left: Mask = low[number + 1 :: 2] <= 0
        kinks, cuts = has_zero[:number], has_zero[number::2] & is_left
        return np.asarray(kinks.any(axis=0)), np.asarray(cuts.any(axis=0))

    def require_no_cut(self, lower: Array, upper: Array, name: str) -> None:
        """Validate that a box has no branch cut.

        Args:
            lower: Lower corner, shape (n, 1).
            upper: Upper corner.
            name: Name of the function.

        Raises:
            NotSmoothError: If there may be a cut in the box.
        """
        if self(lower, upper)[1].any():
            raise NotSmoothError(name, "atan2", "has its cut (y = 0, x <= 0)")


def _arguments(
    tape: Tape, kinks: list[Node], cuts: list[Node], name: str
) -> IntervalEvaluation:
    """Return expressions that are 0 at kinks, then y and x of each atan2."""
    nodes, outputs = list(tape.nodes), []
    for node in kinks:
        if node.operation == "fabs":
            outputs.append(node.arguments[0])
        else:
            outputs.append(len(nodes))
            nodes.append(Node("sub", node.arguments))
    outputs += [argument for node in cuts for argument in node.arguments]
    arguments = replace(tape, nodes=tuple(nodes), outputs=(tuple(outputs),))
    return interval_program(arguments, name)


def require_smooth(function: ca.Function, at: Array) -> None:
    """Validate that a function does not jump at a point and has bounded derivatives.

    Args:
        function: x (n, 1) -> a column.
        at: The point, shape (n,).

    Raises:
        NotSmoothError: If the branch cut of an atan2 is at the point, or if an
            operation has unbounded derivatives there. A kink, as that of fabs, is
            allowed.
        UnknownIntervalOperationError: If the function contains sign, or any other
            operation that jumps except atan2, even if it does not jump at the point; or
            if an operation has no interval form.
    """
    point = at[:, None]
    Kinks(function).require_no_cut(point, point, function.name())
    x = ca.SX.sym("x", at.size)
    second = ca.jacobian(ca.vec(ca.jacobian(function(x), x)), x)
    bends = interval_function(
        ca.Function(function.name(), [x], [ca.vec(second)]), takes_jumps=True
    )
    if not np.all(np.isfinite(bends(point - NEIGHBOURHOOD, point + NEIGHBOURHOOD))):
        require_bounded(function, at)


def require_bounded(function: ca.Function, at: Array) -> None:
    """Raise an error for the operation whose derivatives are unbounded at a point.

    Args:
        function: x (n, 1) -> a column, whose second derivatives are unbounded there.
        at: The point, shape (n,).

    Raises:
        NotSmoothError: If an operation is at the edge of its domain.
        UnknownIntervalOperationError: If it has an operation without interval form.
    """
    tape, name = expanded_tape(function), function.name()
    around = at[:, None] - NEIGHBOURHOOD, at[:, None] + NEIGHBOURHOOD
    everything = replace(tape, outputs=(tuple(range(len(tape.nodes))),))
    low, high = (ends[:, 0] for ends in interval_program(everything, name)(*around))
    bounded = np.isfinite(low) & np.isfinite(high)
    for number, node in enumerate(tape.nodes):
        operation = node.operation.removeprefix("const")  # Of pow.
        for edge in _EDGES.get(operation, ()):
            of = number if operation == "hypot" else node.arguments[0]
            if low[of] <= edge <= high[of]:
                reason = "is at the edge of its smooth domain"
                raise NotSmoothError(name, operation, reason)
        if not bounded[number]:
            raise NotSmoothError(name, operation, "leaves its domain")
