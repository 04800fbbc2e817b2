"""Waves of solves of many instances: in lanes, from neighbours, one by one.

    lanes        several starts of every instance at once, the best answer verified
    margins      in lanes, with finer checks and margins, those that break a limit
                 between the checks
    neighbours   in lanes, from the answers of similar instances that are cheaper, and
                 of those that failed; again while that finds better answers
    one by one   by an NLP solver, instances that are still open: from their own answer
                 that was not confirmed, else the guess; from neighbours; from random
                 controls. If the finer grid gives another value for the polished own
                 answer, too, the grid is too coarse, and no start changes that

A neighbour that is cheaper need not have found a better optimum, since its data differ;
but if it has, this wave carries the better optimum from instance to instance.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.heuristics.running import heeded
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.common.presentation import ProgressCallback
from swarmstart.ocp.instances.in_lanes import InLanes, LaneStart
from swarmstart.ocp.instances.instance_data import PosedInstances
from swarmstart.ocp.instances.margins import Amounts, with_margins
from swarmstart.ocp.instances.outcomes import Outcomes
from swarmstart.ocp.instances.polishing import Group, OneByOne
from swarmstart.ocp.instances.retries import (
    Neighbours,
    at_instances,
    random_start,
    starts_from,
    with_decisions_of,
)
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.guesses import cold_controls

STARTS = 4
"""Number of starts of each instance in lanes."""
_ROUNDS = 3
"""Largest number of times that the NLP solver tries instances from neighbours' answers;
from the second one on those count that an earlier one has found."""
_ROUNDS_IN_LANES = 100
"""The same in lanes. An optimum gets one or two neighbours further each time, and few
instances are tried after the first times: each answer of a neighbour is tried once."""
_AROUND = 4
"""Number of nearest neighbours that are tried if they are cheaper, cheapest first."""
_CHEAPER = 1e-3
"""Least relative difference of a neighbour's cost at which its answer is tried."""
_MARGINS = 2
"""Largest number of times that limits get finer checks and margins."""
_RANDOM = 1
"""Number that follows the seed in those of the random starts."""

Solve = Callable[[NDArray[np.int64]], Iterator[Group]]
"""numbers of instances -> groups of their answers."""


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """Waves of solves of the instances of a problem.

    Attributes:
        planner: Planner of the problem.
        posed: The valid instances.
        outcomes: Their best answers so far.
        seeds: Seed.
        progress: Callback.
    """

    planner: Planner
    posed: PosedInstances
    outcomes: Outcomes
    seeds: tuple[int, ...]
    progress: ProgressCallback

    def finished(
        self, lanes: InLanes | None, each: OneByOne | None, starts: int
    ) -> bool:
        """Solve all instances; return whether that was not interrupted.

        Args:
            lanes: Solves in lanes; None: there are none.
            each: Solves by the NLP solver; None: without it.
            starts: Number of starts of each instance in lanes.
        """
        try:
            if lanes is not None:
                self._in_lanes(lanes, starts)
                # Before neighbours, whose answers would break the same limits.
                self._with_margins(lanes)
                self._from_cheaper(lanes)
                self._with_margins(lanes)
            if each is not None:
                self._polished(each)
        except KeyboardInterrupt:
            return False
        return True

    def _in_lanes(self, lanes: InLanes, count: int) -> None:
        """Solve all instances in lanes, from several starts each."""
        instances = self.posed.core
        starts = self._starts()[:count]
        for number in range(len(starts), count):
            drawn = random_start(self.planner.problem, (*self.seeds, _RANDOM, number))
            if drawn is not None:
                starts.append(LaneStart(self._of_all(drawn.controls)))
        self._wave(
            lambda chosen: lanes(instances, starts),
            np.arange(instances.x0.shape[1]),
            ("lanes", "guess"),
        )

    def _starts(self) -> list[LaneStart]:
        """Return starts with states that controls lead to, or that stay at x0."""
        core, x0 = self.planner.problem, self.posed.core.x0
        cold = cold_controls(core)
        given = self.posed.guesses
        held = np.broadcast_to(
            x0[:, None], (core.model.nx, core.intervals + 1, x0.shape[1])
        )
        middle = self._of_all(cold[-1])
        starts = [
            LaneStart(self._of_all(cold[0]) if given is None else given),
            LaneStart(middle if given is None else given, held),
        ]
        if given is None and len(cold) == 1:  # The first one is the middle.
            return starts
        return [*starts, LaneStart(middle)]

    def _of_all(self, controls: Array) -> Array:
        """Return controls (nu, N) as those of all instances, without copies."""
        shape = *controls.shape, self.posed.core.x0.shape[1]
        return np.broadcast_to(controls[..., None], shape)

    def _with_margins(self, lanes: InLanes) -> None:
        """Solve again in lanes, with margins, what breaks limits between the checks."""
        instances = self.posed.core
        answers, amounts = self.outcomes.answers, Amounts()
        for _ in range(_MARGINS):
            chosen = self._of(SolutionStatus.BROKEN)
            if lanes.paths is None or not chosen.size:
                return
            here = instances.at(chosen)._replace(x0=answers.x0[:, chosen])
            controls = answers.controls[..., chosen]
            tight, amounts = with_margins(lanes.paths, here, controls, amounts)
            tighter = lanes.with_margins(tight, here)
            if tighter is None:
                return
            start = LaneStart(controls, is_near=True)
            self._wave(
                lambda chosen: tighter(here, [start]),  # noqa: B023 - called at once
                chosen,
                ("lanes", "own answer"),
            )

    def _of(self, *statuses: SolutionStatus) -> NDArray[np.int64]:
        """Return the numbers of the instances with one of some statuses."""
        found = [one in statuses for one in self.outcomes.answers.status]
        return np.flatnonzero(found)

    def _from_cheaper(self, lanes: InLanes) -> None:
        """Solve instances in lanes from answers of neighbours that are cheaper."""
        core, instances = self.planner.problem, self.posed.core
        answers, distances = self.outcomes.answers, None
        tried = np.full((instances.x0.shape[1], _AROUND), np.nan)
        for _ in range(_ROUNDS_IN_LANES):
            confirmed = answers.confirmed
            solved = np.flatnonzero(confirmed)
            if not solved.size:
                return
            distances = distances or Neighbours(core, instances)
            every = np.arange(confirmed.size)
            around = distances.nearest(every, solved, _AROUND)
            costs = np.where(around >= 0, answers.cost[around], np.inf)
            # The same answer again would lead to the same end.
            new = np.where(costs != tried[:, : costs.shape[1]], costs, np.inf)
            best = new.argmin(axis=1)
            nearest, least = around[every, best], new[every, best]
            own = np.where(confirmed, answers.cost, np.inf)
            sizes = np.maximum(np.abs(least), np.where(confirmed, own, 0.0))
            less = _CHEAPER * np.where(np.isfinite(least), sizes, 0.0)
            chosen = np.flatnonzero(least < own - less)
            if not chosen.size:
                return
            tried[chosen, best[chosen]] = least[chosen]
            others = nearest[chosen]
            here = with_decisions_of(core, instances.at(chosen), answers.x0[:, others])
            states = answers.states[:, :: core.checks, others].copy()
            states[:, 0] = here.x0
            start = LaneStart(answers.controls[..., others], states, is_near=True)
            self._wave(
                lambda chosen: lanes(here, [start]),  # noqa: B023 - called at once
                chosen,
                ("lanes", "neighbour"),
            )

    def _polished(self, each: OneByOne) -> None:
        """Solve the open instances by the NLP solver, and again those that fail."""
        answers, given = self.outcomes.answers, self.posed.guesses
        # What the lanes found, but the finer path does not confirm.
        near = self._of(SolutionStatus.BROKEN, SolutionStatus.MISMATCH)
        own = [Start(answers.controls[..., k], x0=answers.x0[:, k]) for k in near]
        self._polish_wave(each, near, own, "own answer")
        settled = np.intersect1d(near, self._of(SolutionStatus.MISMATCH))
        opened = self._open(settled)
        first: list[Start | None] = [None] * opened.size
        if given is not None:
            first = [Start(given[:, :, number]) for number in opened]
        self._polish_wave(each, opened, first, "guess")
        self._polish_from_neighbours(each, settled)
        drawn = random_start(self.planner.problem, (*self.seeds, _RANDOM))
        if drawn is not None:
            opened = self._open(settled)
            starts = at_instances(self.planner.problem, self.posed.core, opened, drawn)
            self._polish_wave(each, opened, starts, "random")

    def _open(self, settled: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers of the open instances without some that are settled."""
        return np.setdiff1d(self.outcomes.open, settled)

    def _polish_from_neighbours(
        self, each: OneByOne, settled: NDArray[np.int64]
    ) -> None:
        core, instances = self.planner.problem, self.posed.core
        outcomes, tried = self.outcomes, dict[int, int]()
        distances = None
        for _ in range(_ROUNDS):
            opened, confirmed = self._open(settled), outcomes.answers.confirmed
            if not opened.size or not confirmed.any():
                return
            distances = distances or Neighbours(core, instances)
            nearest = distances.nearest(opened, np.flatnonzero(confirmed), 1)[:, 0]
            # The same start again would lead to the same end.
            new = np.array(
                [
                    tried.get(int(own)) != k
                    for own, k in zip(opened, nearest, strict=True)
                ]
            )
            opened, nearest = opened[new], nearest[new]
            tried |= dict(zip(opened.tolist(), nearest.tolist(), strict=True))
            starts = starts_from(core, instances, outcomes.answers, opened, nearest)
            self._polish_wave(each, opened, starts, "neighbour")

    def _polish_wave(
        self,
        each: OneByOne,
        chosen: NDArray[np.int64],
        starts: Sequence[Start | None],
        start: str,
    ) -> None:
        instances = self.posed.core
        self._wave(
            lambda chosen: each.polished(instances.at(chosen), starts),
            chosen,
            (each.solver, start),
        )

    def _wave(
        self, solve: Solve, chosen: NDArray[np.int64], words: tuple[str, str]
    ) -> None:
        """Solve some instances and keep the better answers, group by group.

        Args:
            solve: Solves them.
            chosen: Their numbers.
            words: The solver, and the kind of the starts.
        """
        solver, start = words
        what = "solving" if start == "guess" else f"again: {start}"
        done = 0
        groups = solve(chosen) if chosen.size else iter(())
        while True:
            with heeded():
                group = next(groups, None)
            if group is None:
                return
            self.outcomes.take(
                chosen[group.chosen], group.answers, solver=solver, start=start
            )
            done += group.chosen.size
            self.progress(done, chosen.size, f"{what} ({solver})")
