"""An NLP solver from a guess; the better of the two is kept.

The NLP (transcription.py) need not measure constraints as the search does: it sees
smooth inequalities at points. So its answer is evaluated like any individual, and
returned only if it is better by (violation, cost) on that same evaluator.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.errors import InvalidProblemError, SolveError
from swarmstart.ocp.fitness import NOTHING, Fitness, Known, flatten, unflatten
from swarmstart.ocp.guess import bounded_controls
from swarmstart.ocp.integrators import require_count
from swarmstart.ocp.transcription import multiple_shooting

Array = NDArray[np.float64]
SAME_COST = 1e-6
"""Relative difference below which two costs are those of one local optimum."""


class PolishStatus(Enum):
    """How an NLP solver ended."""

    CONVERGED = "converged to a local optimum"
    ITERATION_LIMIT = "stopped at the limit of iterations or time"
    INFEASIBLE = "found no feasible point near the guess"
    NUMERICAL_FAILURE = "broke off for a numerical reason"
    WORSE = "converged to a point that is worse than the guess"


_IPOPT_STATUS = {
    "Solve_Succeeded": PolishStatus.CONVERGED,
    "Solved_To_Acceptable_Level": PolishStatus.CONVERGED,
    "Maximum_Iterations_Exceeded": PolishStatus.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": PolishStatus.ITERATION_LIMIT,
    "Maximum_WallTime_Exceeded": PolishStatus.ITERATION_LIMIT,
    "Infeasible_Problem_Detected": PolishStatus.INFEASIBLE,
}


@dataclass(frozen=True, kw_only=True, slots=True)
class IpoptOptions:
    """What IPOPT is told.

    Attributes:
        max_iterations: Largest number of iterations.
        tolerance: IPOPT's convergence tolerance `tol`.
        max_seconds: Wall time after which it stops [s]; None means no limit.
    """

    max_iterations: int = 300
    tolerance: float = 1e-8
    max_seconds: float | None = None

    def __post_init__(self) -> None:
        """Refuse values IPOPT would refuse later."""
        require_count("max_iterations", self.max_iterations)
        if not self.tolerance > 0:
            raise InvalidProblemError(
                f"tolerance must be positive, got {self.tolerance}"
            )
        if self.max_seconds is not None and not self.max_seconds > 0:
            raise InvalidProblemError(
                f"max_seconds must be positive, got {self.max_seconds}"
            )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Polished:
    """The better of a guess and what the NLP solver made of it.

    Attributes:
        controls: Shape (nu, N), within the bounds.
        cost: Its cost on the problem's evaluator.
        violation: Its violation there.
        improved: False where the guess was kept.
        status: How the solver ended.
        iterations: The solver's iterations.
        evaluations: Evaluations of the objective by the solver.
    """

    controls: Array
    cost: float
    violation: float
    improved: bool
    status: PolishStatus
    iterations: int
    evaluations: int


class Polisher:
    """IPOPT on the multiple-shooting NLP of one problem, built once."""

    def __init__(self, fitness: Fitness, options: IpoptOptions | None = None) -> None:
        """Build the solver.

        Args:
            fitness: The problem's evaluator, which also judges the answer.
            options: What IPOPT is told; None means the defaults.
        """
        options = options or IpoptOptions()
        self._fitness = fitness
        self._program = multiple_shooting(fitness.problem)
        self._solver = ca.nlpsol(
            "polish",
            "ipopt",
            self._program.nlp,
            {
                "print_time": False,
                "show_eval_warnings": False,
                "ipopt.print_level": 0,
                "ipopt.sb": "yes",
                "ipopt.max_iter": options.max_iterations,
                "ipopt.tol": options.tolerance,
                # By default IPOPT leaves bounds by 1e-8; brought back into them, its
                # controls would break path constraints that are active.
                "ipopt.bound_relax_factor": 0.0,
                **_time_limit(options.max_seconds),
            },
        )

    def __call__(
        self,
        controls: Array,
        x0: ArrayLike,
        known: Known = NOTHING,
        *,
        states: Array | None = None,
    ) -> Polished:
        """Return the better of a guess and the local optimum found from it.

        Args:
            controls: The guess, shape (nu, N), clipped to the bounds; not changed.
            x0: Initial state, shape (nx,).
            known: Parameters and signals.
            states: At the nodes, shape (nx, nodes): where the solver starts; they need
                not be those that the controls lead to. None means they are.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value not finite.
            SolveError: If IPOPT cannot be run at all.
        """
        problem, fitness = self._fitness.problem, self._fitness
        controls = bounded_controls(problem, controls)
        before = fitness.value(controls, x0, known)
        if states is None:
            states = fitness.states(controls, x0, known)
        elif np.shape(states) != (shape := (problem.model.nx, problem.nodes)):
            raise InvalidProblemError(
                f"states must have shape {shape}, got {np.shape(states)}"
            )
        found, stats = self._solve(controls, states, x0, known)
        lower, upper = (limit[:, None] for limit in problem.control_limits)
        better = np.clip(found, lower, upper)
        after = (
            fitness.value(better, x0, known)
            if np.isfinite(better).all()
            else (np.inf, np.inf)
        )
        improved = is_better(after, before, tolerance=problem.tolerance)
        cost, violation = after if improved else before
        status = _IPOPT_STATUS.get(
            str(stats["return_status"]), PolishStatus.NUMERICAL_FAILURE
        )
        if status is PolishStatus.CONVERGED and not improved:
            if not _agree(before, after, tolerance=problem.tolerance):
                status = PolishStatus.WORSE
        return Polished(
            controls=better if improved else controls,
            cost=cost,
            violation=violation,
            improved=improved,
            status=status,
            iterations=int(stats["iter_count"]),
            evaluations=int(stats["n_call_nlp_f"]),
        )

    def _solve(
        self, controls: Array, states: Array, x0: ArrayLike, known: Known
    ) -> tuple[Array, dict[str, Any]]:
        """Return the solver's controls and its statistics."""
        program, problem = self._program, self._fitness.problem
        ends = states[:, problem.checks :: problem.checks]
        fixed = [np.asarray(x0), np.asarray(known.parameters)]
        fixed.append(flatten(np.asarray(known.signals)))
        try:
            answer = self._solver(
                x0=np.concatenate([flatten(controls), flatten(ends)]),
                p=np.concatenate(fixed),
                lbx=program.lower,
                ubx=program.upper,
                lbg=program.lower_g,
                ubg=program.upper_g,
            )
        except RuntimeError as error:
            raise SolveError(f"IPOPT could not be run: {error}") from error
        size = problem.model.nu * problem.intervals
        w = np.array(answer["x"]).ravel()
        return unflatten(w[:size], problem.model.nu), self._solver.stats()


def _time_limit(seconds: float | None) -> dict[str, float]:
    return {} if seconds is None else {"ipopt.max_wall_time": seconds}


def is_better(
    one: tuple[float, float], other: tuple[float, float], *, tolerance: float
) -> bool:
    """Return whether (cost, violation) `one` is better, violation first.

    Violations up to the tolerance count as none; what is not finite is never better.
    """
    if not np.isfinite(one).all():
        return False
    if not np.isfinite(other).all():
        return True
    broken, broken_other = (v if v > tolerance else 0.0 for v in (one[1], other[1]))
    return (broken, one[0]) < (broken_other, other[0])


def _agree(
    one: tuple[float, float], other: tuple[float, float], *, tolerance: float
) -> bool:
    """Return whether two (cost, violation) are feasible and of the same cost."""
    feasible = max(one[1], other[1]) <= tolerance
    return feasible and bool(np.isclose(one[0], other[0], rtol=SAME_COST, atol=0.0))
