"""The way from many starts to one answer: lanes, distinct optima, the NLP solver.

    starts   the user's guess; zero controls and the middle of the bounds, cold; what a
             search found; smooth random controls
    lanes    a local solve from each of them (lanes/solver.py)
    optima   distinct ones, counted; the best three go to the NLP solver
    polish   from these, and from each of the other starts but the random ones

So the answer is never worse than the guess, a cold start or the search's best polished.
What lanes do not know (whole numbers, blocks, stiff models) goes to the NLP solver
alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.account import Lanes, Origin, StartsAccount, Tried
from swarmstart.ocp.fitness import Fitness, Known, started
from swarmstart.ocp.guess import zero_controls
from swarmstart.ocp.lanes.optima import distinct_optima, unseen_share
from swarmstart.ocp.lanes.solver import LaneSolver, NoLanesError, random_starts
from swarmstart.ocp.polish import SAME_COST, Polished, Polisher, is_better
from swarmstart.ocp.search_space import Start

Array = NDArray[np.float64]

POLISHED = 3
"""Optima of the lanes that go to the NLP solver."""


class Origined(NamedTuple):
    """A start and where it comes from."""

    origin: Origin
    start: Start


@dataclass(frozen=True, slots=True, eq=False)
class Answered:
    """The best answer from many starts, and what all led to."""

    polished: Polished
    evaluations: int
    account: StartsAccount


class ManyStarts:
    """Local solves from many starts of one problem; built once."""

    def __init__(self, fitness: Fitness, polisher: Polisher, random: int) -> None:
        """Compile what lanes compute.

        Args:
            fitness: The problem's evaluator.
            polisher: Its NLP solver.
            random: Number of random starts.
        """
        self._fitness, self._polisher, self._random = fitness, polisher, random
        self._solver, self._refused = None, ""
        try:
            self._solver = LaneSolver(fitness.shooting)
        except NoLanesError as error:
            self._refused = str(error)

    def __call__(
        self,
        given: Sequence[Origined],
        x0: ArrayLike,
        known: Known,
        rng: np.random.Generator,
    ) -> Answered:
        """Return the best answer.

        Args:
            given: The guess and what a search found, if there are any.
            x0: Initial state of the core, shape (nx,).
            known: Parameters and signals.
            rng: Source of all randomness.
        """
        tolerance = self._fitness.problem.tolerance
        starts = [*self._cold(), *given]
        lanes, optima = self._in_lanes([one.start for one in starts], x0, known, rng)
        every = _ordered([*starts, *(Origined("the lanes", one) for one in optima)])
        answers = [
            self._polisher(
                start.controls,
                x0 if start.x0 is None else start.x0,
                known,
                states=start.states,
                is_guess=start.is_guess,
                near=origin in ("the lanes", "the search") and start.states is None,
            )
            for origin, start in every
        ]
        tried = [
            Tried(
                origin=origin,
                cost=answer.cost,
                violation=answer.violation,
                iterations=answer.iterations,
            )
            for (origin, _), answer in zip(every, answers, strict=True)
        ]
        best = 0
        for number in range(1, len(answers)):
            if _clearly_better(answers[number], answers[best], tolerance):
                best = number
        return Answered(
            answers[best],
            sum(one.evaluations for one in answers),
            StartsAccount(
                won=every[best].origin,
                tried=tuple(tried),
                lanes=lanes,
                without_lanes=self._refused,
            ),
        )

    def _cold(self) -> list[Origined]:
        """Return zero controls, and the middle of their bounds where it is another."""
        problem = self._fitness.problem
        zero = zero_controls(problem)
        lower, upper = problem.control_limits
        middle = np.where(np.isfinite(upper - lower), (lower + upper) / 2, zero[:, 0])
        cold = [Origined("zero controls", Start(zero))]
        if not np.array_equal(middle, zero[:, 0]):
            same = np.repeat(middle[:, None], problem.intervals, axis=1)
            cold.append(Origined("the middle of the bounds", Start(same)))
        return cold

    def _in_lanes(
        self,
        starts: Sequence[Start],
        x0: ArrayLike,
        known: Known,
        rng: np.random.Generator,
    ) -> tuple[Lanes | None, list[Start]]:
        """Return what lanes found, and the best optima among it."""
        solver, problem = self._solver, self._fitness.problem
        if solver is None:
            return None, []
        state = np.asarray(x0, dtype=np.float64).ravel()
        controls, decided = random_starts(problem, self._random, rng)
        firsts = [one.states[0] for one in problem.free_starts]
        own = [(state if one.x0 is None else one.x0)[firsts] for one in starts]
        controls = np.dstack([*(one.controls for one in starts), controls])
        decided = np.hstack([np.array(own).reshape(len(own), len(firsts)).T, decided])
        found = solver(x0, controls, decided, known=known, rng=rng)
        optima = distinct_optima(found)
        best = [
            Start(
                found.controls[:, :, one.lane],
                x0=started(problem, state, found.starts[:, one.lane]),
            )
            for one in optima[:POLISHED]
        ]
        lanes = Lanes(
            starts=controls.shape[2],
            method=solver.method,
            optima=tuple(optima),
            unseen=unseen_share([one.count for one in optima]),
        )
        return lanes, best


def _ordered(starts: Sequence[Origined]) -> list[Origined]:
    """Return starts with the cheapest kind first."""
    order = get_args(Origin)
    return sorted(starts, key=lambda one: order.index(one.origin))


def _clearly_better(one: Polished, other: Polished, tolerance: float) -> bool:
    """Return whether an answer is better by more than rounding."""
    values = [(answer.cost, answer.violation) for answer in (one, other)]
    if not is_better(*values, tolerance=tolerance):
        return False
    both = max(one.violation, other.violation) <= tolerance
    same = abs(one.cost - other.cost) <= SAME_COST * max(abs(one.cost), abs(other.cost))
    return not (both and same)
