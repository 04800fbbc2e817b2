"""Lower bounds of optimal-control problems, from the problem to the answer.

    statement -> tube -> (prunings, by what is known of the answer) -> polynomials of
    rising degree, each proven, until time is up or the gap is closed

Source: Lasserre, Henrion, Prieur and Trelat (2008), Nonlinear optimal control via
occupation measures and LMI relaxations: V is the dual of their linear program.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pkgutil import resolve_name
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.expressions import shortened
from swarmstart.ocp.fitness import NOTHING, Known
from swarmstart.ocp.limits import require_number
from swarmstart.ocp.lower_bound.answer import BoundKind, LowerBound
from swarmstart.ocp.lower_bound.basis import Box
from swarmstart.ocp.lower_bound.evidence import Evidence, Pruning, Step, Tube
from swarmstart.ocp.lower_bound.region import Region, basis_of
from swarmstart.ocp.lower_bound.stage import Stage
from swarmstart.ocp.lower_bound.statement import Statement
from swarmstart.ocp.lower_bound.stating import (
    NoBoundError,
    affine_form,
    statement_of,
)
from swarmstart.ocp.lower_bound.subsolution import (
    Aim,
    Cuts,
    Forms,
    Round,
    Search,
    Setting,
    loss_of,
    worth,
)
from swarmstart.ocp.lower_bound.tube import NoTubeError, tube_of
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.progress import ProgressCallback, tell_nothing
from swarmstart.ocp.status import SolutionStatus
from swarmstart.terminal_set.intervals import (
    UnknownIntervalOperationError,
    interval_function,
)

Array = NDArray[np.float64]
SLACK_SHARES = (3e-4, 1e-5)
"""Slack hoped for at first and at last, times the horizon, in parts of the size."""
SLACK_OF_GAP = 0.1
"""The same, in parts of the gap that is left."""
ROUGH_SHARE = 0.01
"""The same of the steps that prune."""
CLOSED = 1e-5
"""Gap at which the search ends, in parts of the known cost."""
PRUNING_TIME = 0.3
"""Of the time that is left, for one pruning."""
MOST_PRUNINGS = 3
"""Of each degree."""
FEWEST_ROUNDS = 3
WORTHWHILE = 0.8
"""A pruning that leaves more than this part of the volume is the degree's last one."""
USELESS = 0.97
"""One that leaves more than this part is not kept."""
DEGREES = {1: (2, 4, 6, 8, 10, 12), 2: (2, 3, 4, 5, 6, 7, 8), 3: (2, 3, 4, 5, 6)}
"""By the number of states."""
FIRST_DEGREE = 3
"""Below it polynomials only prune."""
SETTLED = 0.1
"""Slack of a step, in parts of its gap, from which on the next degree is tried."""
ABOVE = 1e-6
"""By which part the cost that prunings compare with is above the known one."""


@runtime_checkable
class Answered(Protocol):
    """An answer to a problem: a `Solution`, which may have a bound itself."""

    @property
    def status(self) -> SolutionStatus:
        """What can be said of it."""

    @property
    def verified_cost(self) -> float:
        """Its cost, accurately integrated, as the problem states it."""


def lower_bound(  # noqa: PLR0913 - everything but the problem has a default
    problem: OptimalControlProblem,
    x0: ArrayLike,
    *,
    known: Known = NOTHING,
    answer: Answered | float | None = None,
    seconds: float = 60.0,
    seed: int = 0,
    progress: ProgressCallback = tell_nothing,
) -> LowerBound:
    """Prove a lower bound of what any answer to a problem costs.

    Args:
        problem: The problem, of at most three states.
        x0: Initial state, shape (nx,).
        known: Parameters, and the time at the start.
        answer: An answer, or the cost of one as the problem states it: where a
            trajectory must cost more, it need not be looked at. It need not be right:
            a bound is never above it. None: the problem is solved for it.
        seconds: Wall time, about [s].
        seed: Of the samples. A bound does not hang on them, only its height does.
        progress: Told (whole seconds, all of them, "bounding") now and then.

    Returns:
        The best bound that was proven; of kind NONE with a reason if there is none.
        Ctrl-C ends the search as the time does.

    Raises:
        InvalidProblemError: If a shape is not the problem's, or seconds are not
            positive.
    """
    if not isinstance(problem, OptimalControlProblem):
        raise InvalidProblemError(
            f"lower_bound takes an OptimalControlProblem, got {shortened(problem)}"
        )
    if not (isinstance(seconds, int | float) and 0 < seconds < math.inf):
        raise InvalidProblemError(
            f"seconds must be a number above 0, got {shortened(seconds)}"
        )
    began, cpu = clock.perf_counter(), clock.process_time()

    def tell() -> None:
        progress(int(clock.perf_counter() - began), math.ceil(seconds), "bounding")

    try:
        statement = statement_of(problem, x0, known)
    except NoBoundError as error:
        return _none(str(error), problem.sense)
    cost = _cost_of(problem, x0, known, answer, seconds, seed)
    found = _bounded(
        statement, cost, began + seconds, np.random.default_rng(seed), tell
    )
    return replace(found, cpu_seconds=clock.process_time() - cpu)


def _none(reason: str, sense: float) -> LowerBound:
    return LowerBound(kind=BoundKind.NONE, value=math.nan, reason=reason, sense=sense)


def _cost_of(
    problem: OptimalControlProblem,
    x0: ArrayLike,
    known: Known,
    answer: Answered | float | None,
    seconds: float,
    seed: int,
) -> float:
    """Return the cost to compare with, as the problem states it; NaN if there is none.

    That of an answer which is not feasible would cut nothing sensible off.
    """
    if answer is None:
        try:  # Named, not imported: it has a bound of its own, and so imports this.
            solve = resolve_name("swarmstart.ocp.solving:solve")
            answer = solve(problem, x0, known=known, search=None, seed=seed)
        except InvalidProblemError:
            return math.nan
    if isinstance(answer, Answered):
        return answer.verified_cost if answer.status.is_confirmed else math.nan
    if isinstance(answer, bool) or not isinstance(answer, int | float | np.number):
        raise InvalidProblemError(
            f"answer must be a Solution or a cost, got {shortened(answer)}"
        )
    return require_number("answer, the cost of one,", answer)


@dataclass(eq=False)
class _Best:
    """The best bound so far, of a statement's cost without its offset."""

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
        """Return it as the problem states it."""
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


def _bounded(
    statement: Statement,
    cost: float,
    until: float,
    rng: np.random.Generator,
    tell: Callable[[], None],
) -> LowerBound:
    """Return the best bound that can be proven until a time."""
    best = _trivial(statement, None)
    try:
        tube = tube_of(statement)
        best = _better(best, _trivial(statement, tube))
        goal = statement.sense * cost - statement.offset
        if not Region(statement, tube).paving[0].size:
            raise NoTubeError("no trajectory keeps the bounds of the states")
        path = _Path(statement, tube, goal, until, rng)
        for found in path.bounds():
            best = _better(best, found)
            tell()
            if goal - best.value < CLOSED * abs(goal):
                break
    except (NoTubeError, UnknownIntervalOperationError) as error:
        best = replace(best, reason=f"{best.reason}; {error}")
    except KeyboardInterrupt:
        best = replace(best, reason=f"{best.reason}; interrupted")
    return best.answer()


def _better(one: _Best, other: _Best) -> _Best:
    if not other.kind.is_bound:
        return one
    return other if not one.kind.is_bound or other.value > one.value else one


def _trivial(statement: Statement, tube: Tube | None) -> _Best:
    """Return the bound that the least stage cost gives.

    Args:
        statement: The problem.
        tube: Where the states are; None: within their bounds alone.
    """
    n, latest = statement.n, statement.horizon[1]
    low, high = statement.state_box
    if tube is not None:
        low = np.maximum(low, -tube.levels[:, 1 : 2 * n : 2].max(axis=0))
        high = np.minimum(high, tube.levels[:, 0 : 2 * n : 2].max(axis=0))
    at = ca.vertcat(statement.point, statement.controls)
    costs = ca.Function(
        "costs", [at], [ca.densify(ca.vertcat(statement.stage, statement.end))]
    )
    none = _Best(statement, math.nan, BoundKind.NONE, "no bound was proven in the time")
    try:
        evaluate = interval_function(costs)
    except UnknownIntervalOperationError as error:
        return replace(none, reason=str(error))
    control_low, control_high = statement.control_box
    lower = np.concatenate([[0.0], low, control_low])[:, None]
    upper = np.concatenate([[latest], high, control_high])[:, None]
    least, _ = evaluate(lower, upper)
    stage, end = float(least[0, 0]), float(least[1, 0])
    # A rate that is negative counts for all of the longest horizon.
    duration = latest if stage < 0 else statement.horizon[0]
    value = stage * duration + end
    value -= 1e-14 * (abs(stage * duration) + abs(end))
    if not math.isfinite(value):
        return none
    reason = "the least stage cost over the horizon, and the least terminal cost"
    return _Best(statement, value, BoundKind.TRIVIAL, reason)


@dataclass(eq=False)
class _Path:
    """The way from a tube to bounds."""

    statement: Statement
    tube: Tube
    goal: float
    until: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        """Bring the problem into the form that the steps need."""
        affine = affine_form(self.statement)
        stage = Stage(self.statement, affine)
        self._region = Region(self.statement, self.tube)
        self._setting = Setting(self.statement, affine, stage, self._size(stage))
        self._began = clock.perf_counter()
        self._prunings: list[Pruning] = []
        self.shares: list[float] = []
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
        return max(size, 1e-3 * usual, 1e-12)

    def bounds(self) -> Iterator[_Best]:
        """Yield proven bounds, of rising degrees on a set that gets smaller."""
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
            if clock.perf_counter() > self.until:
                return

    def _kept(self, aim: Aim) -> Cuts | None:
        """Return the cuts of earlier searches that are still in the set."""
        cuts = self._cuts.get(aim)
        if cuts is None:
            return None
        points, ends = cuts.points, cuts.ends
        within = self._region.inside(points)
        if ends.size:
            ends = ends[:, self._region.inside_ends(ends)]
        return Cuts(points[:, within], ends)

    def _share(self, best: float) -> float:
        """Return the slack hoped for, in parts of the costs' size."""
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

    def _bound(self, step: Step, degree: int) -> _Best:
        """Return the bound that a step proves."""
        self._boxes += step.boxes
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
        return _Best(
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

    def _pruned(self, forms: Forms) -> Iterator[_Best]:
        """Make the set smaller by the known cost; yield the bounds met on the way."""
        if not math.isfinite(self._known):
            return
        for _ in range(MOST_PRUNINGS):
            left = self.until - clock.perf_counter()
            limit = clock.perf_counter() + PRUNING_TIME * left
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
            self.shares.append(share)
            if share > USELESS or not region.paving[0].size:
                return
            self._region = region
            self._prunings.append(pruning)
            self._boxes += come.boxes
            if share > WORTHWHILE:
                return

    def _needed(self, go: Step | None) -> Callable[[Array], Array]:
        """Return how much the way to a point must cost for it to be cut off.

        Args:
            go: What is known of the way on; None: nothing.
        """

        def needed(points: Array) -> Array:
            if go is None:
                return np.full(points.shape[1], self._known)
            V = go.polynomial
            basis = basis_of(V)
            values = basis.values(Box(V.middle, V.half), points) @ V.coefficients
            return np.asarray(self._known - values)

        return needed

    def _rough(
        self,
        forms: Forms,
        aim: Aim,
        needed: Callable[[Array], Array],
        limit: float,
    ) -> Step | None:
        """Return a step that prunes, proven to within little."""
        search = self._search(forms, aim, ROUGH_SHARE)
        now = clock.perf_counter()
        search = replace(search, until=now + 0.5 * max(0.0, limit - now), needed=needed)
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
