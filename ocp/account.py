"""Where an answer comes from, and what the other starts led to."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

from swarmstart.ocp.lanes.optima import Optimum, Unseen

Origin = Literal[
    "zero controls", "the middle of the bounds", "the guess", "the lanes", "the search"
]
"""Kinds of starts, the cheapest first: of equal answers the cheapest start's counts."""

SHOWN = 5
"""Optima that a summary shows."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Tried:
    """What a start led to.

    Attributes:
        origin: Which start.
        cost: Of the NLP solver's answer from it, which is minimised.
        violation: Of that answer.
        iterations: The solver's iterations.
    """

    origin: Origin
    cost: float
    violation: float
    iterations: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Lanes:
    """What many local solves at once found.

    Attributes:
        starts: Number of starts, those of other origins among them.
        method: "sweeps" or "slopes".
        optima: Distinct local optima, the cheapest first, with their counts.
        unseen: Share of such starts that would end in an optimum not seen yet; of these
            starts and this way of solving only, never of all optima. None: the starts
            were chosen one after the other, and say nothing of others.
    """

    starts: int
    method: str
    optima: tuple[Optimum, ...]
    unseen: Unseen | None

    def told(self, sense: float = 1.0) -> dict[str, Any]:
        """Return all of it as JSON has it.

        Args:
            sense: -1 where costs are gains.
        """
        optima = [{"cost": sense * one.cost, "count": one.count} for one in self.optima]
        return {"starts": self.starts, "method": self.method, "optima": optima,
                "unseen": asdict(self.unseen) if self.unseen else None}  # fmt: skip

    def line(self, sense: float = 1.0) -> str:
        """Return it in a line.

        Args:
            sense: -1 where costs are gains.
        """
        shown = [f"{sense * one.cost:.7g} ({one.count})" for one in self.optima[:SHOWN]]
        more = len(self.optima) - SHOWN
        listed = ", ".join(shown) + (f" and {more} more" if more > 0 else "")
        said = f"{self.starts} starts: {listed or 'no optimum'}"
        if self.unseen is None:
            return said
        most = f"{self.unseen.most:.0%}"
        return f"{said}; at most {most} of such starts would end elsewhere"


@dataclass(frozen=True, kw_only=True, slots=True)
class StartsAccount:
    """All starts of an answer.

    Attributes:
        won: Where the answer comes from; of answers that are equal to 1e-6 the start
            that costs least.
        tried: What the NLP solver made of the starts, in the order in which it did.
        lanes: What the local solves found; None: there were none.
        without_lanes: Why there were none; empty: there were.
    """

    won: Origin
    tried: tuple[Tried, ...]
    lanes: Lanes | None
    without_lanes: str = ""

    def best_of(self, origin: Origin) -> Tried | None:
        """Return the best answer from starts of one kind; None: there was none."""
        found = [one for one in self.tried if one.origin == origin]
        return min(found, key=lambda one: (one.violation > 0, one.cost), default=None)

    def told(self, sense: float = 1.0) -> dict[str, Any]:
        """Return the account as JSON has it.

        Args:
            sense: -1 where costs are gains.
        """
        tried = [asdict(one) | {"cost": sense * one.cost} for one in self.tried]
        if self.lanes is None:
            return {"won": self.won, "tried": tried, "lanes": None,
                    "without_lanes": self.without_lanes}  # fmt: skip
        return {"won": self.won, "tried": tried, "lanes": self.lanes.told(sense),
                "without_lanes": ""}  # fmt: skip

    def lines(self, sense: float = 1.0) -> list[str]:
        """Return the account in three lines.

        Args:
            sense: -1 where costs are gains.
        """
        origins = dict.fromkeys(one.origin for one in self.tried)
        gave = []
        for origin in origins:
            best = self.best_of(origin)
            if best is not None:
                gave.append(f"{origin} {sense * best.cost:.7g}")
        lines = [f"  won         {self.won}", f"  polished    {'; '.join(gave)}"]
        if self.lanes is None:
            return [*lines, f"  lanes       none: {self.without_lanes}"]
        return [*lines, f"  lanes       {self.lanes.line(sense)}"]
