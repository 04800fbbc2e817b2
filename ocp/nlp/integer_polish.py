"""Polish of a problem with whole-number controls: relax, round, descend, polish.

    relaxed   the NLP solver, from the starts, on the problem in which the controls need
              not be whole numbers
    rounded   the relaxed answer by sum-up rounding, and the starts themselves; each is
              improved by changing one whole number at a time
    held      the NLP solver on the other decisions, with the whole numbers fixed

The best answer by (violation, cost) is kept. The relaxed cost is a lower bound if the
solver's local optimum is the global one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.polish import Polished, Polisher, is_better
from swarmstart.ocp.nlp.polish_options import PolishOptions, PolishStatus
from swarmstart.ocp.nlp.several import polish_basins
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.nlp.watching import UNWATCHED, Watch, WorkAlone
from swarmstart.ocp.rollout.fitness import Fitness, Known
from swarmstart.ocp.statement.control_shape import block_numbers, first_intervals
from swarmstart.ocp.statement.decisions import neighbours, sum_up_rounded, whole
from swarmstart.ocp.statement.problem import OptimalControlProblem

_ROUNDS = 500
"""Largest number of steps of a descent."""
_POLISHES = 10
"""Largest number of descents, each after a polish of the other decisions."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class WholePolished:
    """Result of an integer polish.

    Attributes:
        polished: The best answer with whole numbers.
        relaxed_cost: Cost of the relaxed problem's best answer; NaN: not solved.
        evaluations: Evaluations of all steps.
    """

    polished: Polished
    relaxed_cost: float
    evaluations: int


def relaxation(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem without the requirement of whole numbers."""
    return replace(problem, bounds=replace(problem.bounds, integer=()))


class IntegerPolisher:
    """Rounding and polish for one problem with whole-number controls."""

    def __init__(
        self,
        fitness: Fitness,
        options: PolishOptions,
        *,
        watch: Watch = UNWATCHED,
    ) -> None:
        """Build the solver of the relaxed problem.

        Args:
            fitness: The problem's evaluator.
            options: Options of the NLP solver.
            watch: Observer of the work, which may stop it.
        """
        self._fitness, problem = fitness, fitness.problem
        self._watch = watch
        relaxed = Fitness(relaxation(problem), backend="casadi")
        unwatched = watch is UNWATCHED
        self.relaxed = Polisher(
            relaxed,
            options,
            # An answer with fractions is no answer of the problem itself.
            watch=watch if unwatched else WorkAlone(watch),
        )
        self._integer, self._limits = problem.integer, problem.control_limits
        self._block = block_numbers(problem.blocks, problem.intervals)
        self._first = first_intervals(problem.blocks, problem.intervals)
        self._decides_more = (
            len(self._integer) < problem.model.nu or bool(problem.free_starts)
        )  # fmt: skip

    def __call__(
        self, starts: Sequence[Start], x0: ArrayLike, known: Known, *, near: bool
    ) -> WholePolished:
        """Return the best answer with whole numbers from some starts.

        Args:
            starts: Starts, at least one, the best first.
            x0: Initial state, shape (nx,); its decided entries are guesses.
            known: Values of the parameters and signals.
            near: Whether the starts are answers that the solver should stay near; see
                Polisher.
        """
        tolerance = self._fitness.problem.tolerance
        relaxed, evaluations = polish_basins(
            self.relaxed, starts, x0, known, tolerance=tolerance, near=near
        )
        rounded = sum_up_rounded(
            relaxed.controls[:, self._first],
            self._integer,
            self._limits,
            np.bincount(self._block).tolist(),
        )[:, self._block]
        firsts: list[tuple[Array, ArrayLike]] = [(rounded, relaxed.x0)]
        firsts += [(s.controls, x0 if s.x0 is None else s.x0) for s in starts]
        best = self._descended(*firsts[0], known)
        evaluations += best.evaluations
        for first in firsts[1:]:
            if self._watch.is_over:
                break
            one = self._descended(*first, known)
            evaluations += one.evaluations
            best = one if _beats(one, best, tolerance) else best
        self._watch.answered((best.controls, best.x0), best.cost, best.violation)
        # No bound lies above an answer, so the relaxed problem can only improve it.
        if not self._watch.is_over:
            again = self.relaxed(best.controls, best.x0, known, near=True)
            evaluations += again.evaluations
            if _beats(again, relaxed, tolerance):
                relaxed = again
        solved = relaxed.violation <= tolerance
        return WholePolished(
            polished=replace(best, status=relaxed.status, point=None),
            relaxed_cost=relaxed.cost if solved else np.nan,
            evaluations=evaluations,
        )

    def _descended(self, controls: Array, x0: ArrayLike, known: Known) -> Polished:
        """Descend by steps of whole numbers, and polish the other decisions."""
        best = self._held(whole(controls, self._integer, self._limits), x0, known)
        evaluations = best.evaluations
        for _ in range(_POLISHES):
            stepped, spent = self._stepped(best, known)
            evaluations += spent
            if stepped is None:
                break
            best = self._held(stepped, best.x0, known)
            evaluations += best.evaluations
            # Without other decisions a second descent finds nothing new.
            if not self._decides_more or self._watch.is_over:
                break
        return replace(best, evaluations=evaluations)

    def _stepped(self, found: Polished, known: Known) -> tuple[Array | None, int]:
        """Descend by single steps; return controls, if they change, and evaluations."""
        fitness, x0 = self._fitness, found.x0
        objective = fitness.objective(x0, known)
        controls, value, moved = found.controls, (found.cost, found.violation), False
        spent, tolerance = 0, fitness.problem.tolerance
        for _ in range(_ROUNDS):
            if spent and self._watch.is_over:
                break
            blocks = neighbours(controls[:, self._first], self._integer, self._limits)
            others = blocks[:, :, self._block]
            population = np.stack([fitness.decision(c, x0) for c in others], axis=1)
            cost, violation = objective(population)
            spent += cost.size
            self._watch.counted(cost.size)
            # The order of is_better: violation beyond the tolerance, then the cost.
            broken = np.where(violation > tolerance, violation, 0.0)
            i = int(np.lexsort((cost, broken))[0])
            reached = float(cost[i]), float(violation[i])
            if not is_better(reached, value, tolerance=tolerance):
                break
            controls, value, moved = others[i], reached, True
        return (controls if moved else None), spent

    def _held(self, controls: Array, x0: ArrayLike, known: Known) -> Polished:
        """Return the best answer with the whole numbers held."""
        if self._decides_more:
            return self.relaxed(controls, x0, known, held=self._integer, near=True)
        cost, violation = self._fitness.value(controls, x0, known)
        return Polished(
            controls=controls,
            x0=np.asarray(x0, dtype=np.float64).ravel(),
            cost=cost,
            violation=violation,
            improved=True,
            status=PolishStatus.CONVERGED,
            iterations=0,
            evaluations=1,
        )


def _beats(one: Polished, other: Polished, tolerance: float) -> bool:
    values = [(p.cost, p.violation) for p in (one, other)]
    return is_better(*values, tolerance=tolerance)
