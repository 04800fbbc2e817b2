"""Local solves in lanes: from random starts, then from variations of their optima.

A variation begins at states between intervals, with gaps that the solver closes:

    crossing   of two optima, the first before a random time and the second after it;
               over up to a fifth of the horizon both are mixed
    kick       an optimum with one or two bumps, cos^2 over a tenth to six tenths of the
               horizon, of normal size in each state, relative to how far the cheapest
               optimum moves it

The k-th cheapest optimum is varied with weight 1 / k. A round of variations follows as
long as the one before found a cheaper optimum. On six vehicles that change places (ten
seeds) variations end within 1e-3 of the best optimum known 7 times, the same number of
iterations from fresh random starts 2 times, and three times that number also 2 times.

Source: Lourenco, Martin and Stuetzle (2003), Iterated local search; Eiben and Smith
(2015), Introduction to evolutionary computing, one-point crossover.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.lanes.answers import (
    LaneAnswers,
    distinct_optima,
    joined,
    reached,
    some_of,
    unreached,
    unseen_share,
)
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.nlp.watching import Watch, stops_nothing
from swarmstart.ocp.rollout.fitness import Fitness, Known, started
from swarmstart.ocp.search.account import Lanes
from swarmstart.ocp.search.search_space import side_by_side
from swarmstart.ocp.search.state_guesses import state_guesses

ROUNDS = 8
"""Largest number of rounds of variations."""
CHEAPER = 1e-4
"""Relative difference of costs by which a round must be cheaper for another one."""
BATCH = 16
"""Number of starts between two looks at a budget that may end the lanes."""
KEPT = 16
"""Number of optima that are varied, the cheapest ones."""
_MIXED = 0.2
"""Longest time over which two optima are mixed, as a share of the horizon."""
_WIDTHS = (0.1, 0.6)
"""Shortest and longest bump, as shares of the horizon."""
_HEIGHTS = (0.1, 0.8)
"""Smallest and largest standard deviation of a bump, as shares of a state's way."""
_STILL = 1e-6
"""A state that moves by less, relative to its size, is kicked by shares of its size."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solved:
    """Answers that lanes found from the starts of one problem.

    Attributes:
        x0: Initial state of the rewritten problem (core), shape (nx,).
        known: Values of the parameters and signals.
        answers: Those from random starts, then those from variations.
        random: Number of the answers from random starts.
        seconds: Wall time [s].
    """

    x0: Array
    known: Known
    answers: LaneAnswers
    random: int
    seconds: float

    @property
    def least(self) -> float:
        """The least cost of feasible answers; infinite if no answer is feasible."""
        return float(self.answers.cost[reached(self.answers)].min(initial=np.inf))


class _Starts(NamedTuple):
    """Starts of one kind, n of them.

    Attributes:
        controls: Controls, shape (nu, N, n).
        decided: Decisions about the start, shape (ny, n).
        states: States between intervals, shape (nx, N + 1, n); None: those that the
            controls lead to.
    """

    controls: Array
    decided: Array
    states: Array | None = None

    def part(self, some: slice) -> "_Starts":
        """Return some of these starts."""
        states = None if self.states is None else self.states[..., some]
        return _Starts(self.controls[..., some], self.decided[..., some], states)


class StartLanes:
    """Local solves in lanes of one problem."""

    def __init__(self, fitness: Fitness, solver: LaneSolver, watch: Watch) -> None:
        """Keep the evaluator, the solver and the observer.

        Args:
            fitness: The problem's evaluator.
            solver: The solver.
            watch: Observer that counts the work, and says whether it may go on.
        """
        self._fitness, self._solver, self._watch = fitness, solver, watch

    def prepare(self) -> None:
        """Wait for machine code that is still being compiled.

        Raises:
            NoCompilerError: If it cannot be made.
        """
        self._solver.prepare()

    def random(
        self,
        starts: Sequence[Start],
        x0: ArrayLike,
        known: Known,
        n: int,
        rng: np.random.Generator,
    ) -> Solved:
        """Return the answers from given starts and from random starts.

        If the end fixes states, half of the random starts are states that reach it.

        Args:
            starts: Further starts, at least one.
            x0: Initial state of the rewritten problem (core), shape (nx,).
            known: Values of the parameters and signals.
            n: Number of random starts.
            rng: Source of all randomness.

        Raises:
            NoCompilerError: If machine code cannot be made.
        """
        problem, state = self._fitness.problem, np.asarray(x0, np.float64).ravel()
        with stopwatch() as watch:
            bent = state_guesses(self._fitness, x0, known, n // 2, rng)
            controls, decided = random_starts(problem, n, rng)
            given = side_by_side(problem, starts, state)
            rest = slice(len(bent), None)
            kinds = [
                _Starts(
                    np.dstack([given[0], controls[..., rest]]),
                    np.hstack([given[1], decided[:, rest]]),
                )
            ]
            if bent:
                nodes = np.dstack([g.states for g in bent if g.states is not None])
                kinds.append(
                    _Starts(
                        np.dstack([one.controls for one in bent]),
                        decided[:, : len(bent)],
                        nodes[:, :: problem.checks],
                    )
                )
            found = self._answers(kinds, state, known)
        return Solved(
            x0=state, known=known, answers=found, random=found.cost.size,
            seconds=watch.seconds,
        )  # fmt: skip

    def varied(self, solved: Solved, n: int, rng: np.random.Generator) -> Solved:
        """Return given answers, and the answers from variations of the cheapest.

        A further round of variations follows as long as the least cost falls, at most
        `ROUNDS` in all.

        Args:
            solved: Answers from random starts.
            n: Number of variations of a round.
            rng: Source of all randomness.
        """
        x0, known = solved.x0, solved.known
        sizes = self._fitness.arguments.sizes(x0, known).states
        for _ in range(ROUNDS):
            before = solved.least
            if not np.isfinite(before) or self._watch.is_over:
                break
            with stopwatch() as watch:
                controls, decided, states = variations(solved.answers, n, rng)
                states *= sizes[:, None, None]
                kind = _Starts(controls, decided, states)
                further = self._answers([kind], x0, known)
            solved = replace(
                solved,
                answers=joined([solved.answers, further]),
                seconds=solved.seconds + watch.seconds,
            )
            if not solved.least < before - CHEAPER * abs(before):
                break
        return solved

    def _answers(
        self, kinds: Sequence[_Starts], x0: Array, known: Known
    ) -> LaneAnswers:
        """Return the answers from starts, those of each kind in their order.

        If the watch may end the work, a batch of each kind is solved in turn until it
        does, at least one batch.
        """
        n = max(one.controls.shape[2] for one in kinds)
        size = n if stops_nothing(self._watch) else BATCH
        found: list[list[LaneAnswers]] = [[] for _ in kinds]
        for first in range(0, n, size):
            for kind, answers in zip(kinds, found, strict=True):
                some = kind.part(slice(first, first + size))
                is_empty = some.controls.shape[2] == 0
                if is_empty or (found[0] and self._watch.is_over):
                    continue
                answers.append(self._solver(x0, *some, known=known))
                self._report(answers[-1], x0, known)
        return joined([*chain(*found)])

    def _report(self, found: LaneAnswers, x0: Array, known: Known) -> None:
        """Report the work of lanes, and their best answer if answers are kept."""
        taken = int(found.iterations.sum())
        self._watch.counted(taken * self._solver.rollouts_per_iteration)
        best = distinct_optima(found)[:1]
        if stops_nothing(self._watch) or not best:
            return
        controls, decided = best[0].controls, best[0].decided
        start = started(self._fitness.problem, x0, decided)
        value = self._fitness.value(controls, start, known)
        self._watch.answered((controls, start), *value)

    def best(self, solved: Solved, n: int) -> list[Start]:
        """Return the cheapest distinct answers that are feasible, at most n."""
        problem = self._fitness.problem
        return [
            Start(one.controls, x0=started(problem, solved.x0, one.decided))
            for one in distinct_optima(solved.answers)[:n]
        ]

    def account(self, solved: Solved) -> Lanes:
        """Return the results of the lanes."""
        answers = solved.answers
        at = solved.x0, solved.known
        optima = self._solver.optima(answers, *at)
        varied, sampled = answers.cost.size - solved.random, optima
        if varied:  # Which are no random sample of starts.
            sample = some_of(answers, np.arange(solved.random))
            sampled = self._solver.optima(sample, *at)
        infeasible, lost = unreached(answers)
        feasible = sum(one.count for one in distinct_optima(answers))
        return Lanes(
            starts=answers.cost.size,
            optima=optima,
            unseen=unseen_share([one.count for one in sampled]),
            iterations=int(answers.iterations.sum()),
            seconds=solved.seconds,
            infeasible=infeasible,
            unfinished=feasible - sum(one.count for one in optima),
            lost=lost,
            varied=varied,
        )


def variations(
    answers: LaneAnswers, n: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return variations of the cheapest optima: half crossings, half kicks.

    A crossing follows one optimum up to a random time, and another one after it. A kick
    adds random bumps to the states of an optimum. If there is only one optimum, all
    variations are kicks.

    Args:
        answers: Answers of lanes, at least one of them feasible.
        n: Number of variations.
        rng: Source of all randomness.

    Returns:
        Controls (nu, N, n), decisions about the start (ny, n), and states between
        intervals, divided by their sizes as in the answers, (nx, N + 1, n).
    """
    best = np.array([one.lane for one in distinct_optima(answers)[:KEPT]])
    weights = 1.0 / np.arange(1, best.size + 1)
    parents = rng.choice(best, n, p=weights / weights.sum())
    controls = answers.controls[:, :, parents]
    states = answers.states[:, :, parents]
    crossed = n // 2 if best.size > 1 else 0
    others = rng.choice(best, crossed)
    share = _shares(states.shape[1], crossed, rng)
    for values, source in ((controls, answers.controls), (states, answers.states)):
        part = share[: values.shape[1]]
        values[:, :, :crossed] *= 1.0 - part
        values[:, :, :crossed] += part * source[:, :, others]
    moved = np.ptp(answers.states[:, :, best[0]], axis=1)
    moved = np.where(moved > _STILL, moved, 1.0)
    kicked = states[:, :, crossed:]
    for count in (kicked.shape[2], kicked.shape[2] // 2):
        bumps = _bumps(kicked.shape[1], count, rng)
        heights = rng.standard_normal((moved.size, 1, count)) * moved[:, None, None]
        kicked[:, :, :count] += heights * rng.uniform(*_HEIGHTS, count) * bumps
    return controls, answers.starts[:, parents], states


def _shares(nodes: int, n: int, rng: np.random.Generator) -> Array:
    """Return the share of the second optimum at each node, (nodes, n)."""
    time = np.linspace(0.0, 1.0, nodes)[:, None]
    cut, width = rng.uniform(0.0, 1.0, n), rng.uniform(0.0, _MIXED, n)
    return np.clip((time - cut) / np.maximum(width, 1e-9) + 0.5, 0.0, 1.0)


def _bumps(nodes: int, n: int, rng: np.random.Generator) -> Array:
    """Return bumps of height 1, zero at the first node, (nodes, n)."""
    time = np.linspace(0.0, 1.0, nodes)[:, None]
    middle, width = rng.uniform(0.0, 1.0, n), rng.uniform(*_WIDTHS, n)
    away = np.minimum(np.abs(time - middle) / width, 0.5)
    bumps = np.cos(np.pi * away) ** 2
    bumps[0] = 0.0  # The start is given.
    return bumps
