"""The sequence of proven bounds, from a set that holds all trajectories.

Polynomials of several degrees are used, the lowest first. Those of a degree first show
through which points of the set no trajectory costs less than a known answer. These
points are removed, and this is repeated as long as a noticeable part of the set is
removed. Then a polynomial is computed whose value at the start is high, since this
value gives the bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import now
from swarmstart.ocp.lower_bound.basis import values_of
from swarmstart.ocp.lower_bound.hamiltonian import Forms, Setting, Stage
from swarmstart.ocp.lower_bound.region import Region
from swarmstart.ocp.lower_bound.stated.answer import (
    BoundKind,
    Evidence,
    LowerBound,
    Pruning,
    Step,
    Tube,
)
from swarmstart.ocp.lower_bound.stated.statement import Statement, affine_form
from swarmstart.ocp.lower_bound.subsolution import (
    Aim,
    Cuts,
    Round,
    Search,
    loss_of,
    worth,
)

SLACK_SHARES = (3e-4, 1e-5)
"""First and last target of the slack, times the horizon, relative to the size."""
SLACK_OF_GAP = 0.1
"""Target of the slack, times the horizon, relative to the gap that is left."""
ROUGH_SHARE = 0.01
"""Target of the slack of steps that prune, times the horizon, relative to the size."""
PRUNING_TIME = 0.3
"""Fraction of the remaining time for one pruning."""
MOST_PRUNINGS = 3
"""Largest number of prunings for each degree."""
FEWEST_ROUNDS = 3
WORTHWHILE = 0.8
"""A pruning that leaves more than this fraction of the volume is the degree's last."""
USELESS = 0.97
"""A pruning that leaves more than this fraction of the volume is not kept."""
DEGREES = {1: (2, 4, 6, 8, 10, 12), 2: (2, 3, 4, 5, 6, 7, 8), 3: (2, 3, 4, 5, 6)}
"""Degrees of the polynomials, by the number of states."""
FIRST_DEGREE = 3
"""Degree below which polynomials only prune."""
SETTLED = 0.1
"""Slack of a step, relative to its gap, below which the next degree is tried."""
ABOVE = 1e-6
"""Relative margin of the cost that prunings compare with, above the known one."""


@dataclass(eq=False)
class Best:
    """The best bound so far of a `Statement`'s cost, without the constant offset."""

    statement: Statement
    value: float
    kind: BoundKind
    reason: str
    degree: int = 0
    slack: float = 0.0
    boxes: int = 0
    set_name: str = ""
    evidence: Evidence | None = None

    def answer(self) -> LowerBound:
        """Return the bound in terms of the stated problem."""
        sense = self.statement.sense
        value = sense * (self.value + self.statement.offset)
        return LowerBound(
            kind=self.kind,
            value=value if self.kind.is_bound else math.nan,
            reason=self.reason,
            degree=self.degree,
            slack=self.slack,
            boxes=self.boxes,
            set_name=self.set_name,
            evidence=self.evidence,
            sense=sense,
        )


@dataclass(eq=False)
class Ascent:
    """Search for better and better bounds, each over a set of trajectories.

    The first set is a tube around an answer.
    """

    statement: Statement
    tube: Tube
    goal: float
    until: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        """Prepare the problem for the steps."""
        affine = affine_form(self.statement)
        stage = Stage(self.statement, affine)
        self._region = Region(self.statement, self.tube)
        self._setting = Setting(self.statement, affine, stage, self._size(stage))
        self._prunings: list[Pruning] = []
        self._cuts: dict[str, Cuts] = {}
        self._boxes = 0
        known = self.goal + ABOVE * abs(self.goal)
        self._known = known if math.isfinite(known) else math.inf

    def _size(self, stage: Stage) -> float:
        """Return the size of the costs."""
        points = self._region.sampled(self.rng, 2000)
        middle = sum(self.statement.control_box) / 2
        u = np.repeat(np.atleast_1d(middle)[:, None], points.shape[1], axis=1)
        _, L = stage.rates(points, u)
        latest = self.statement.horizon[1]
        usual = latest * float(np.median(np.abs(L))) if L.size else 0.0
        usual += float(np.median(np.abs(stage.end(points)))) if L.size else 0.0
        size = abs(self.goal) if math.isfinite(self.goal) else usual
        # A goal near 0 says little about the size of the costs.
        return max(size, 1e-3 * usual, 1e-12)

    def bounds(self) -> Iterator[Best]:
        """Yield proven bounds, of rising degrees on a shrinking set."""
        best = -math.inf
        for degree in DEGREES[self.statement.n]:
            forms = Forms(self._setting, degree)
            for bound in self._pruned(forms):
                yield bound
                best = max(best, bound.value)
            if degree < FIRST_DEGREE:
                continue
            search = self._search(forms, "start", self._share(best))
            for number, found in enumerate(search.rounds(self._kept("start"), best)):
                self._cuts["start"] = found.cuts
                if found.step is not None:
                    bound = self._bound(found.step, degree)
                    yield bound
                    best = max(best, bound.value)
                if found.converged or self._settled(found, best, number):
                    break
            if not now() < self.until:
                return

    def _kept(self, aim: Aim) -> Cuts | None:
        """Return the points of earlier linear programs that are still in the set."""
        cuts = self._cuts.get(aim)
        if cuts is None:
            return None
        points, ends = cuts.points, cuts.ends
        within = self._region.inside(points)
        if ends.size:
            ends = ends[:, self._region.inside_ends(ends)]
        return Cuts(points[:, within], ends)

    def _share(self, best: float) -> float:
        """Return the target of the slack, relative to the costs' size."""
        first, last = SLACK_SHARES
        if not math.isfinite(self._known - best):
            return first
        gap = SLACK_OF_GAP * (self._known - best) / self._setting.size
        return float(np.clip(gap, last, first))

    def _settled(self, found: Round, best: float, number: int) -> bool:
        """Return whether a higher degree promises more than another round."""
        if not math.isfinite(best):
            return False
        apart = self._known - best
        if not math.isfinite(apart):
            apart = abs(best)
        return number > 3 and found.value - best < SETTLED * apart  # noqa: PLR2004

    def _search(self, forms: Forms, aim: Aim, share: float) -> Search:
        hoped = share * self._setting.size / self.statement.horizon[1]
        return Search(
            self._setting, self._region, forms, aim, hoped, self.rng, self.until
        )

    def _bound(self, step: Step, degree: int) -> Best:
        """Return the bound that a step proves."""
        self._boxes += step.boxes
        # Trajectories that were pruned cost at least `known`, but perhaps no more.
        value = min(self._known, worth(step, self.statement))
        evidence = Evidence(
            statement=self.statement,
            tube=self.tube,
            prunings=tuple(self._prunings),
            final=step,
            known=self._known,
            bound=value + self.statement.offset,
        )
        latest = self.statement.horizon[1]
        pruned = f", pruned {len(self._prunings)} times" if self._prunings else ""
        return Best(
            self.statement,
            value,
            BoundKind.PROVEN,
            "no admissible trajectory of the set that holds them all costs less",
            degree=degree,
            slack=loss_of(step, latest),
            boxes=self._boxes,
            set_name=f"tube of {len(self.tube.directions)} faces{pruned}",
            evidence=evidence,
        )

    def _pruned(self, forms: Forms) -> Iterator[Best]:
        """Shrink the set by means of the known cost; yield the bounds found so far."""
        if not math.isfinite(self._known):
            return
        for _ in range(MOST_PRUNINGS):
            left = self.until - now()
            limit = now() + PRUNING_TIME * left
            go = self._rough(forms, "go", self._needed(None), limit)
            if go is None:
                return
            yield self._bound(go, forms.basis.degree)
            come = self._rough(forms, "come", self._needed(go), limit)
            if come is None:
                return
            pruning = Pruning(come=come, go=go)
            sample = self._region.sampled(self.rng, 8000)
            region = self._region.pruned(pruning, self._known)
            share = float(region.inside(sample).mean()) if sample.size else 1.0
            # A set without boxes has nothing that a polynomial could be scaled to.
            if share > USELESS or not region.paving[0].size:
                return
            self._region = region
            self._prunings.append(pruning)
            self._boxes += come.boxes
            if share > WORTHWHILE:
                return

    def _needed(self, go: Step | None) -> Callable[[Array], Array]:
        """Return the function `needed` of a search that prunes; see `Search`.

        Args:
            go: Step that bounds the cost from the point on; None without one.
        """

        def needed(points: Array) -> Array:
            if go is None:
                return np.full(points.shape[1], self._known)
            return np.asarray(self._known - values_of(go.polynomial, points))

        return needed

    def _rough(
        self,
        forms: Forms,
        aim: Aim,
        needed: Callable[[Array], Array],
        limit: float,
    ) -> Step | None:
        """Return a step that prunes, proven with a small slack."""
        search = self._search(forms, aim, ROUGH_SHARE)
        at = now()
        # Half of the work: `come`, which follows `go`, has the same limit.
        search = replace(search, until=at + 0.5 * max(0.0, limit - at), needed=needed)
        best, quality = None, (-1.0, -math.inf)
        latest = self.statement.horizon[1]
        enough = 3 * ROUGH_SHARE * self._setting.size
        for number, found in enumerate(search.rounds(self._kept(aim))):
            self._cuts[aim] = found.cuts
            if found.step is None:
                continue
            loss = loss_of(found.step, latest)
            if (found.share, -loss) > quality:
                best, quality = found.step, (found.share, -loss)
            if loss < enough and number >= FEWEST_ROUNDS:
                break
        return best
