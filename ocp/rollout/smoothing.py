"""Smooth versions of problems with kinks, which bring an NLP solver near the optimum.

    |a|  ->  sqrt(a^2 + (delta s)^2),   fmin, fmax(a, b)  ->  (a + b -+ |a - b|) / 2

with s the size of a around the start, and a falling delta. At an active kink, such as
|u| at a zero control, an NLP solver stops at a random place. If delta is reduced step
by step, it ends within about delta of the optimum. Jumps (floor, sign, if_else) are not
changed.

Source: Charbonnier, Blanc-Feraud, Aubert and Barlaud (1997), Deterministic edge-
preserving regularization in computed imaging, IEEE Transactions on Image Processing 6,
for the smooth modulus.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.ocp.interpolation.interpolants import without_interpolants
from swarmstart.ocp.rollout.fitness import Known, at_nodes, shared_arguments
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import PathConstraint

PARTS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""Decreasing values of delta."""
_SMOOTHED = (ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX)


def smoothed(
    problem: OptimalControlProblem, sizes: Sequence[float], part: float
) -> OptimalControlProblem:
    """Return a problem without kinks, each rounded over a part of its size.

    Args:
        problem: The problem.
        sizes: Size of each kink, as `kink_sizes` returns them.
        part: delta.
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
        terminal_cost=end if problem.epigraph is None else problem.terminal_cost,
        constraints=[
            replace(c, expression=by_old[id(c)]) if isinstance(c, PathConstraint) else c
            for c in (*problem.stated, *problem.soft)
        ],
        terminal=[replace(c, expression=by_old[id(c)]) for c in ends],
    )


def kink_sizes(
    problem: OptimalControlProblem | Shooting, x0: ArrayLike, known: Known
) -> list[float]:
    """Return the size of each kink around a start, one if it is zero there.

    Args:
        problem: The problem, or its compiled functions. The list is empty without
            kinks.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
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
        for part in (0.0, 0.618, -0.382)
        for u in controls
    ]
    largest = np.nan_to_num(np.max(found, axis=0), nan=0.0, posinf=0.0).ravel()
    return [float(size) if size > 0 else 1.0 for size in largest]


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
        self._expressions = [
            problem.model.ode,
            problem.model.next_state,
            problem.stage_cost,
            problem.step_cost,
            problem.initial_cost,
            problem.smooth_terminal_cost,
        ]
        self._expressions += [c.expression for c in self.path]
        self._expressions += [c.expression for c in problem.terminal_constraints]
        self._sides: list[ca.SX] = []
        self.rewritten(None)
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
