"""Kinks and jumps of a problem's expressions: found, touched by a path, and smoothed.

The optimality conditions of an NLP solver hold for smooth functions. This module finds
the operations that are not smooth (fabs, fmin, fmax, floor, ceil, sign, comparisons,
if_else). For each operation it forms an expression, the side, which is zero where the
operation switches. A comparison across which the result stays smooth, as between the
pieces of a cubic spline, does not count.

Smooth versions of such problems bring an NLP solver near the optimum:

    |a|  ->  sqrt(a^2 + (delta s)^2),   fmin, fmax(a, b)  ->  (a + b -+ |a - b|) / 2

with s the size of a around the start. At an active kink, such as |u| at a zero control,
an NLP solver may stop anywhere. If it solves with smaller and smaller delta, it ends
within about delta of the optimum. Jumps (floor, sign, if_else) are not changed.

Source: Charbonnier, Blanc-Feraud, Aubert and Barlaud (1997), Deterministic edge-
preserving regularization in computed imaging, IEEE Transactions on Image Processing 6,
for the smooth modulus.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.interpolation.interpolants import without_interpolants
from swarmstart.ocp.interpolation.smooth_switches import smooth_comparisons
from swarmstart.ocp.rollout.fitness import Known, at_nodes, shared_arguments
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import PathConstraint

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
PARTS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Decreasing values of delta."""
_SMOOTHED = (ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX)
_OF_TABLE = "; of a linear table: use method='bspline'"
_WITHOUT_KINK = {
    "fmax(": "write fmax(a, b) as a slack: a further control s with s >= a and s >= b, "
    "if larger values cost more; and fmax(a, b) <= c as a <= c and b <= c" + _OF_TABLE,
    "fmin(": "write fmin(a, b) as a slack: a further control s with s <= a and s <= b, "
    "if smaller values cost more; and fmin(a, b) >= c as a >= c and b >= c" + _OF_TABLE,
    "fabs(": "write fabs(a) as a slack: a further control s with s >= a and s >= -a, "
    "if larger values cost more; and fabs(a) <= c as a <= c and a >= -c",
}
"""Beginning of a switch's name -> how to state the problem without this kink."""
_ROUND_IT = (
    "round the jump, such as by tanh(a/width) in place of sign(a); if its time is "
    "known, let an interval begin there"
)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Kinks:
    """Switches of a problem's expressions.

    Attributes:
        names: Name of each switch, for messages.
        sides: Function (x, u, p, s, sizes of x, sizes of u) -> two columns (n, 1). The
            first has the side of each switch, an expression that is zero where the
            operation switches; the second, by how much the side changes, to first
            order, if x and u change by these sizes.
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
            reach: Change of each side, to first order, if states and controls change by
                their sizes, shape (n, points). A side that is small all along the path,
                compared with this change, is near its switch.
            intervals: Number of intervals.
        """
        if not self.names:
            return ()
        by_interval = sides.reshape(len(self.names), intervals, -1)
        low, high = by_interval.min(axis=2), by_interval.max(axis=2)
        moves = np.where(np.isfinite(reach), reach, 0.0)
        sizes = np.maximum(np.abs(sides), moves).max(axis=1)
        near = _TOUCHES * sizes[:, None]
        crossed = ((low <= near) & (high >= -near)).any(axis=1)
        # A side that stays at a whole number is at its step; one that leaves it is not.
        room = np.where(high - low <= near, near, 0.0)
        stepped = (np.floor(low - room) != np.floor(high + room)).any(axis=1)
        active = np.where(self.steps, stepped, crossed)
        return tuple(n for n, a in zip(self.names, active, strict=True) if a)


def _motion_and_costs(problem: OptimalControlProblem) -> list[ca.SX]:
    """Return the expressions of a problem's model and costs, for both uses here."""
    return [
        problem.model.ode,
        problem.model.next_state,
        problem.stage_cost,
        problem.step_cost,
        problem.initial_cost,
        problem.smooth_terminal_cost,
    ]


def kinks_of(problem: OptimalControlProblem) -> Kinks:
    """Return the switches in the model, the costs and the constraints of a problem."""
    symbols = [*problem.symbols().values()]
    expressions = _motion_and_costs(problem)
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
    names: dict[str, str] = {}
    for node in nodes:
        if node.is_leaf() or node.element_hash() in smooth:
            continue
        switch = _switch(node, [node.dep(i) for i in range(node.n_dep())])
        if switch is not None:
            # By its text, since one switch may occur in several expressions.
            text = f"{switch[0]} {switch[1]}"
            found[text] = switch
            # Of a maximum both values say more than their difference.
            is_extreme = node.op() in (ca.OP_FMIN, ca.OP_FMAX)
            names[text] = (
                shortened(node)
                if is_extreme
                else f"{switch[0]}({shortened(switch[1])})"
            )
    # A constant side never reaches its switch.
    found = {text: s for text, s in found.items() if not s[1].is_constant()}
    switches = [*found.values()]
    sides = ca.vertcat(ca.SX(0, 1), *[s for _, s, _ in switches])
    moving = [ca.SX.sym("size", v.numel()) for v in symbols[:2]]
    slopes = ca.jacobian(sides, ca.vertcat(*symbols[:2]))
    reach = ca.fabs(slopes) @ ca.vertcat(*moving)
    return Kinks(
        names=tuple(names[text] for text in found),
        sides=ca.Function("sides", [*symbols, *moving], [sides, ca.densify(reach)]),
        steps=np.array([step for *_, step in switches], dtype=bool),
    )


def without_kink(name: str) -> str:
    """Return advice on how to state a problem without one of its switches.

    Args:
        name: Name of the switch, as in `Kinks.names`.
    """
    return next((w for begin, w in _WITHOUT_KINK.items() if name.startswith(begin)),
                _ROUND_IT)  # fmt: skip


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


def smoothed(
    problem: OptimalControlProblem, sizes: Sequence[float], part: float
) -> OptimalControlProblem:
    """Return a problem whose kinks are rounded; jumps are not changed.

    Args:
        problem: The problem.
        sizes: Size of each kink, as `kink_sizes` returns them.
        part: Factor delta: a kink is rounded over delta times its size.
    """
    kinked = _Kinked(problem)
    found = kinked.rewritten([part * size for size in sizes])
    ode, next_state, stage, step, begin, end, *rest = found
    ends = problem.terminal_constraints
    by_old = dict(zip(map(id, (*kinked.path, *ends)), rest, strict=True))
    return replace(
        problem,
        model=replace(problem.model, ode=ode, next_state=next_state),
        stage_cost=stage,
        step_cost=step,
        initial_cost=begin,
        # With an epigraph the NLP does not use this cost, and rollouts need it as it
        # is.
        terminal_cost=end if problem.epigraph is None else problem.terminal_cost,
        constraints=[
            # Distances are smooth in an NLP already (separation.py).
            replace(c, expression=by_old[id(c)]) if isinstance(c, PathConstraint) else c
            for c in (*problem.stated, *problem.soft)
        ],
        terminal=[replace(c, expression=by_old[id(c)]) for c in ends],
    )


def kink_sizes(
    problem: OptimalControlProblem | Shooting, x0: ArrayLike, known: Known
) -> list[float]:
    """Return the size, around a start, of the quantity that is zero at each kink.

    A size that is 0 or not finite is replaced by 1. The list is empty if the problem
    has no kinks.

    Args:
        problem: The problem, or its compiled functions.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
    """
    shooting = shooting_of(problem)
    problem = shooting.problem
    kinked = _Kinked(problem)
    if not kinked.sides.numel_out(0):
        return []
    x, p, flat = shared_arguments(problem, x0, known)
    sizes = shooting.sizing(x, p, at_nodes(problem, flat))
    lower, upper = problem.control_limits
    controls = [
        np.where(np.isfinite(bound), bound, sign * sizes.controls)
        for bound, sign in ((lower, -1.0), (upper, 1.0))
    ]
    found = [
        np.abs(
            np.array(kinked.sides(x + part * sizes.states, u, p, flat[: problem.ns]))
        )
        for part in (0.0, 0.618, -0.382)  # The moves of scaling.py.
        for u in controls
    ]
    largest = np.max(found, axis=0).ravel()
    return [float(size) if 0 < size < np.inf else 1.0 for size in largest]


class _Kinked:
    """Expressions of a problem, with the places of their kinks.

    Attributes:
        path: The path constraints whose expressions are included.
        sides: (x, u, p, s) -> the argument of each kink, shape (n, 1).
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        self._symbols = [*problem.symbols().values()]
        every = (*problem.stated, *problem.soft)
        self.path = [c for c in every if isinstance(c, PathConstraint)]
        self._expressions = _motion_and_costs(problem)
        self._expressions += [c.expression for c in self.path]
        self._expressions += [c.expression for c in problem.terminal_constraints]
        self._sides: list[ca.SX] = []
        self.rewritten(None)  # Records the arguments of the kinks.
        self.sides = ca.Function(
            "sides", self._symbols, [ca.vertcat(ca.SX(0, 1), *self._sides)]
        )

    def rewritten(self, widths: Sequence[float] | None) -> list[ca.SX]:
        """Return the expressions, operation by operation, with their kinks rounded.

        Args:
            widths: Width of each kink; None: kinks stay, and their arguments are
                recorded.
        """
        f = without_interpolants(
            ca.Function("kinked", self._symbols, self._expressions)
        )
        work: dict[int, ca.SX] = {}
        left = None if widths is None else iter(widths)
        found = [ca.SX.zeros(e.numel()) for e in self._expressions]
        for k in range(f.n_instructions()):
            operation = f.instruction_id(k)
            given, put = f.instruction_input(k), f.instruction_output(k)
            if operation == ca.OP_INPUT:
                work[put[0]] = self._symbols[given[0]][given[1]]
            elif operation == ca.OP_OUTPUT:
                found[put[0]][put[1]] = work[given[0]]
            elif operation == ca.OP_CONST:
                work[put[0]] = ca.SX(f.instruction_constant(k))
            else:
                arguments = [work[i] for i in given]
                work[put[0]] = self._applied(operation, arguments, left)
        return found

    def _applied(
        self, operation: int, arguments: list[ca.SX], widths: Iterator[float] | None
    ) -> ca.SX:
        """Return the value of an operation, rounded if it has a kink."""
        if operation in _SMOOTHED:
            side = arguments[0]
            if operation != ca.OP_FABS:
                side = arguments[0] - arguments[1]
            if widths is not None:
                return _rounded(operation, arguments, side, next(widths))
            self._sides.append(side)
        if len(arguments) == 1:
            return ca.SX.unary(operation, arguments[0])
        return ca.SX.binary(operation, *arguments)


def _rounded(
    operation: int, arguments: list[ca.SX], side: ca.SX, width: float
) -> ca.SX:
    modulus = ca.sqrt(side**2 + width**2)
    if operation == ca.OP_FABS:
        return modulus
    sign = 1 if operation == ca.OP_FMAX else -1
    return (arguments[0] + arguments[1] + sign * modulus) / 2
