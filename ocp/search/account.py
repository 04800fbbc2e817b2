"""Origin of an answer, and the results of all other starts."""

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

from swarmstart.ocp.lanes.answers import Optimum, Unseen
from swarmstart.ocp.nlp.polish import SAME_COST

Origin = Literal[
    "zero controls",
    "the middle of the bounds",
    "the guess",
    "a straight way to the end",
    "the lanes",
    "the search",
    "guesses of states",
    "random starts",
]
"""Kinds of starts, in order: among equal answers, the one of the first kind counts."""

SHOWN = 3
"""Number of optima that a summary shows."""


def _s(count: int) -> str:
    """Return the end of a noun behind a number."""
    return "" if count == 1 else "s"


_FURTHER = 4
"""Advice if one start of all found the cheapest optimum: so many times as many."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Tried:
    """Result of one start.

    Attributes:
        origin: The kind of start.
        cost: Cost of the NLP solver's answer from this start; minimised.
        violation: Violation of that answer.
        feasible: Whether the violation is within the problem's tolerance.
        iterations: Iterations of the solver.
        evaluations: Evaluations of the objective by the solver.
        seconds: Wall time [s].
    """

    origin: Origin
    cost: float
    violation: float
    feasible: bool
    iterations: int
    evaluations: int
    seconds: float = field(compare=False)  # Differs from run to run.


@dataclass(frozen=True, kw_only=True, slots=True)
class Lanes:
    """Results of the local solves that ran in parallel lanes.

    Attributes:
        starts: Number of starts, including those that are not random.
        optima: Distinct local optima, the cheapest first, with their counts.
        unseen: Estimated share of further random starts that would end in an optimum
            not seen yet. It holds for such starts and this solution method only, not
            for all optima. None: the starts were not a random sample, so there is no
            estimate.
        iterations: Steps of all lanes together.
        seconds: Wall time [s].
        infeasible: Number of starts that ended at a point that breaks constraints.
        unfinished: Number of starts that ended at a feasible point which is not shown
            to be an optimum.
        lost: Number of starts whose states became infinite or NaN.
        varied: Number of starts that are variations of optima found from the other
            starts; they count in all fields but `unseen`.
    """

    starts: int
    optima: tuple[Optimum, ...]
    unseen: Unseen | None
    iterations: int
    seconds: float = field(compare=False)
    infeasible: int
    unfinished: int
    lost: int
    varied: int = 0

    def told(self, sense: float = 1.0) -> dict[str, Any]:
        """Return all fields as a dictionary for JSON.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        optima = [{"cost": sense * one.cost, "count": one.count} for one in self.optima]
        return asdict(replace(self, optima=())) | {"optima": optima}

    def line(self, sense: float = 1.0) -> str:
        """Return the result in one line.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        shown = [f"{sense * one.cost:.7g} ({one.count})" for one in self.optima[:SHOWN]]
        more = len(self.optima) - SHOWN
        listed = ", ".join(shown) + (f" and {more} more" if more > 0 else "")
        said = f"{self.starts} start{_s(self.starts)}"
        if self.varied:
            said += f", {self.varied} of them variations"
        said += f": {listed or 'no optimum'}"
        ended = (
            (self.unfinished, "unfinished"),
            (self.infeasible, "infeasible"),
            (self.lost, "not finite"),
        )
        said += "".join(f", {count} {how}" for count, how in ended if count)
        # Starts that reached nothing say nothing about how others would end.
        if self.unseen is None or not self.optima:
            return said
        most = f"{self.unseen.most:.0%}"
        return f"{said}; at most {most} of such starts end in others (95% interval)"

    @property
    def advice(self) -> str:
        """Advice to try more starts if one alone found the best of several optima."""
        if len(self.optima) < 2 or self.optima[0].count > 1:  # noqa: PLR2004
            return ""
        more = _FURTHER * (self.starts - self.varied)
        return f"; the best was found once: try more, such as lanes={more}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Effort:
    """Effort of one part of the solution.

    Attributes:
        evaluations: Evaluations of the problem.
        seconds: Wall time without compilation [s].
    """

    evaluations: int
    seconds: float = field(compare=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class Repair:
    """Report on the repair of an answer that broke constraints between its checks.

    Attributes:
        attempts: Number of problems that were solved again.
        checks: Largest factor by which the number of checks was multiplied.
        margins: Number of constraint rows that got a margin.
        evaluations: Evaluations of the problem.
        seconds: Wall time [s].
        succeeded: Whether the repaired answer is confirmed.
    """

    attempts: int
    checks: int
    margins: int
    evaluations: int
    seconds: float = field(compare=False)
    succeeded: bool

    @property
    def tried(self) -> str:
        """All attempts, as part of a sentence."""
        times = "once" if self.attempts == 1 else f"{self.attempts} times"
        how = f"up to {self.checks} times the checks" if self.checks > 1 else ""
        if self.margins:
            rows = f"{self.margins} row{_s(self.margins)}"
            how += f"{' and ' if how else ''}margins on {rows}"
        return f"solved again {times}{' with ' if how else ''}{how}"

    @property
    def line(self) -> str:
        """The report in one line."""
        ended = "confirmed" if self.succeeded else "not confirmed"
        return (
            f"{self.tried}: {ended}; {self.evaluations} "
            f"evaluation{_s(self.evaluations)}, "
            f"{self.seconds:.2g} s"
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Restarts:
    """Report on the restarts from points near an answer.

    Attributes:
        starts: Number of perturbed starts that were polished.
        iterations: Iterations of the solver.
        better: Number of better answers that were taken.
        seconds: Wall time [s].
    """

    starts: int
    iterations: int
    better: int
    seconds: float = field(compare=False)

    @property
    def line(self) -> str:
        """The report in one line."""
        found = f"{self.better} better" if self.better else "nothing better"
        return (
            f"{self.starts} perturbed starts: {found}; {self.iterations} iterations, "
            f"{self.seconds:.2g} s"
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class StartsAccount:
    """Report on all starts that led to an answer.

    Attributes:
        won: The kind of start that the answer comes from. Of answers that agree to
            1e-6, the earlier start wins.
        tried: Results of the NLP solver, in the order of its runs.
        lanes: Results of the local solves in lanes; None without such solves.
        without_lanes: Reason why there were no lanes; empty if there were.
        search: Effort of the search; None without a search.
        agree: Whether the search was left out, since all cold starts (the guess, zero
            controls and the like) lead to the best optimum of the lanes.
    """

    won: Origin
    tried: tuple[Tried, ...]
    lanes: Lanes | None
    without_lanes: str = ""
    search: Effort | None = None
    agree: bool = False

    @property
    def polish(self) -> Effort:
        """Effort of the NLP solver for all starts."""
        return Effort(
            evaluations=sum(one.evaluations for one in self.tried),
            seconds=sum(one.seconds for one in self.tried),
        )

    @property
    def found_after(self) -> float:
        """Seconds, without compilation, until an answer as good as the best was found.

        The order of work is: polish from the cold starts, lanes, polish from their
        optima, search.
        """
        feasible = [one.cost for one in self.tried if one.feasible]
        least = min(feasible, default=math.inf)
        enough = least + SAME_COST * abs(least)
        parts: list[tuple[tuple[Origin, ...], Lanes | Effort]] = []
        if self.lanes is not None:
            parts.append((_FIRST, self.lanes))
        if self.search is not None:
            parts.append(((*_FIRST, "the lanes"), self.search))
        seconds = 0.0
        for one in self.tried:
            while parts and one.origin not in parts[0][0]:
                seconds += parts.pop(0)[1].seconds
            seconds += one.seconds
            if one.feasible and one.cost <= enough:
                return seconds
        return seconds

    def best_of(self, origin: Origin) -> Tried | None:
        """Return the best result from starts of one kind; None without such a start."""
        found = [one for one in self.tried if one.origin == origin]
        return min(found, key=lambda one: (not one.feasible, one.cost), default=None)

    def told(self, sense: float = 1.0) -> dict[str, Any]:
        """Return the report as a dictionary for JSON.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        return {
            "won": self.won,
            "tried": [_told(one, sense) for one in self.tried],
            "lanes": None if self.lanes is None else self.lanes.told(sense),
            "without_lanes": self.without_lanes,
            "search": None if self.search is None else asdict(self.search),
            "agree": self.agree,
        }

    def lines(self, sense: float = 1.0) -> list[str]:
        """Return the report in three lines.

        Args:
            sense: 1 for a minimised cost, -1 for a maximised one.
        """
        gave = []
        for origin in dict.fromkeys(one.origin for one in self.tried):
            best = self.best_of(origin)
            if best is not None:
                cost = f"{sense * best.cost:.7g}" if best.feasible else "infeasible"
                gave.append(f"{origin} {cost}")
        lanes = f"none: {self.without_lanes}"
        if self.lanes is not None:
            # Of a search that uses lanes, the budget gives their number.
            lanes = self.lanes.line(sense) + self.lanes.advice
        return [
            f"  won         {self.origin}; {self._seconds()}",
            f"  polished    {'; '.join(gave) or 'nothing'}",
            f"  lanes       {lanes}",
        ]

    @property
    def origin(self) -> str:
        """The kind of start that the answer comes from, and a note on needless work.

        The note, in brackets, says that the search was left out, or which of lanes and
        search ran but found nothing better. There may be no note.
        """
        return f"{self.won}{self._not_needed()}"

    def _not_needed(self) -> str:
        """Return a note on work left out or without use; empty without one."""
        if self.agree:
            return " (the lanes agree, so that no search was made)"
        best = self.best_of(self.won)
        if best is None or not best.feasible:
            return ""
        dearer = {"the lanes": self.lanes, "the search": self.search}
        needless = [
            name
            for name, part in dearer.items()
            if part is not None and _ORDER.index(name) > _ORDER.index(self.won)
        ]
        if not needless:
            return ""
        verb = "were" if "the lanes" in needless else "was"
        return f" ({' and '.join(needless)} {verb} not needed)"

    def _seconds(self) -> str:
        parts = {
            "search": self.search,
            "lanes": self.lanes,
            "polish": self.polish,
        }
        return ", ".join(
            f"{name} {part.seconds:.2g} s" for name, part in parts.items() if part
        )


_ORDER = get_args(Origin)
_FIRST = _ORDER[: _ORDER.index("the lanes")]


def _told(one: Tried, sense: float) -> dict[str, Any]:
    """Return the result of a start for JSON, which has no infinite numbers."""
    values = {"cost": sense * one.cost, "violation": one.violation}
    finite = {k: v if math.isfinite(v) else None for k, v in values.items()}
    return asdict(one) | finite
