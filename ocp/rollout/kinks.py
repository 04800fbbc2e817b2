"""Kinks and jumps of a problem's expressions, and whether a path touches them.

The optimality conditions of an NLP solver hold for smooth functions. This module finds
the operations that are not smooth (fabs, fmin, fmax, floor, ceil, sign, comparisons,
if_else). Each gets a number, its side, which is zero at the switch. A comparison across
which the result stays smooth, as between the pieces of a cubic spline, does not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.interpolation.interpolants import without_interpolants
from swarmstart.ocp.interpolation.smooth_switches import smooth_comparisons
from swarmstart.ocp.statement.problem import OptimalControlProblem

_ONE = {ca.OP_FABS: "fabs", ca.OP_SIGN: "sign"}
_TWO = {
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
    ca.OP_LT: "if",
    ca.OP_LE: "if",
    ca.OP_EQ: "if",
    ca.OP_NE: "if",
}
_STEPS = {ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil"}
_WRAPS = {ca.OP_FMOD: ("fmod", 0.0), ca.OP_REMAINDER: ("remainder", 0.5)}
"""Operations that jump when a ratio passes whole numbers, or half way between them."""
_TOUCHES = 1e-6
"""A side smaller than this part of its size counts as at the switch."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Kinks:
    """Switches of a problem's expressions.

    Attributes:
        names: Name of each switch, for messages.
        sides: (x, u, p, s, sizes of x, sizes of u) -> side of each switch, and its
            change over these sizes, each (n, 1).
        steps: Whether a switch occurs at every whole number, as for floor; shape (n,).
    """

    names: tuple[str, ...]
    sides: ca.Function
    steps: NDArray[np.bool_]

    def touched(self, sides: Array, reach: Array, intervals: int) -> tuple[str, ...]:
        """Return the names of the switches that a path touches or crosses.

        A control that jumps over a switch from one interval to the next does not touch
        it: the expressions are smooth near both of its values.

        Args:
            sides: Sides along the path, in order of time, with the same number of
                points in each interval; shape (n, points).
            reach: Change of each side over the sizes, shape (n, points). A side that is
                small all along is thus near its switch, not small by its nature.
            intervals: Number of intervals.
        """
        if not self.names:
            return ()
        by_interval = sides.reshape(len(self.names), intervals, -1)
        low, high = by_interval.min(axis=2), by_interval.max(axis=2)
        moves = np.where(np.isfinite(reach), reach, 0.0)
        sizes = np.maximum(np.abs(sides), moves).max(axis=1, initial=0)
        near = _TOUCHES * sizes[:, None]
        crossed = ((low <= near) & (high >= -near)).any(axis=1)
        # A side that stays at a whole number is at its step; one that leaves it is not.
        room = np.where(high - low <= near, near, 0.0)
        stepped = (np.floor(low - room) != np.floor(high + room)).any(axis=1)
        active = np.where(self.steps, stepped, crossed)
        return tuple(n for n, a in zip(self.names, active, strict=True) if a)


def kinks_of(problem: OptimalControlProblem) -> Kinks:
    """Return the switches in the model, the costs and the constraints of a problem."""
    symbols = [*problem.symbols().values()]
    expressions = [
        problem.model.ode,
        problem.model.next_state,
        problem.stage_cost,
        problem.step_cost,
        problem.initial_cost,
        problem.smooth_terminal_cost,
    ]
    if problem.epigraph is not None:
        expressions.append(problem.epigraph.costs)
    expressions += [
        c.expression
        for c in (
            *problem.path_constraints,
            *problem.terminal_constraints,
            *problem.soft,
        )
    ]
    whole = ca.Function("whole", symbols, expressions)
    expressions = without_interpolants(whole).call(symbols)
    results = [e.nz[i] for e in expressions for i in range(e.nnz())]
    nodes = _in_order(results)
    smooth = smooth_comparisons(nodes, results)
    found: dict[str, tuple[str, ca.SX, bool]] = {}
    for node in nodes:
        if node.is_leaf() or node.element_hash() in smooth:
            continue
        switch = _switch(node, [node.dep(i) for i in range(node.n_dep())])
        if switch is not None:
            found[f"{switch[0]} {switch[1]}"] = switch
    switches = [s for s in found.values() if not s[1].is_constant()]
    sides = ca.vertcat(ca.SX(0, 1), *[s for _, s, _ in switches])
    moving = [ca.SX.sym("size", v.numel()) for v in symbols[:2]]
    slopes = ca.jacobian(sides, ca.vertcat(*symbols[:2]))
    reach = ca.fabs(slopes) @ ca.vertcat(*moving)
    return Kinks(
        names=tuple(f"{name}({shortened(side)})" for name, side, _ in switches),
        sides=ca.Function("sides", [*symbols, *moving], [sides, ca.densify(reach)]),
        steps=np.array([step for *_, step in switches], dtype=bool),
    )


def _in_order(results: Sequence[ca.SX]) -> list[ca.SX]:
    """Return all nodes that the results depend on, each after its own dependencies."""
    order: list[ca.SX] = []
    seen: set[int] = set()
    stack = [(result, False) for result in reversed(results)]
    while stack:
        node, complete = stack.pop()
        if complete:
            order.append(node)
        elif node.element_hash() not in seen:
            seen.add(node.element_hash())
            stack.append((node, True))
            if not node.is_leaf():
                stack += [(node.dep(i), False) for i in range(node.n_dep())]
    return order


def _switch(node: ca.SX, of: list[ca.SX]) -> tuple[str, ca.SX, bool] | None:
    """Return (name, side, whether at every whole number) of a node; None: smooth."""
    operation = node.op()
    if operation in _ONE:
        return _ONE[operation], of[0], False
    if operation in _TWO:
        return _TWO[operation], of[0] - of[1], False
    if operation in _STEPS:
        return _STEPS[operation], of[0], True
    if operation == ca.OP_COPYSIGN:
        return "copysign", of[1], False
    if operation in _WRAPS:
        name, shift = _WRAPS[operation]
        return name, of[0] / of[1] + shift, True
    return None
