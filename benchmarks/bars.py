"""What flights must reach, and the tables that say whether they do.

A bar is a command and a bound on a measure. The chapter's claims are judged by
`swarmstart replicate`.
"""

import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmstart.benchmarks.flights import Job, Measured
from swarmstart.benchmarks.tables import row
from swarmstart.cases.campaign.claims import holds
from swarmstart.cases.campaign.statistics import spread


@dataclass(frozen=True, kw_only=True, slots=True)
class Bar:
    """A bound on a measure.

    Attributes:
        name: Several bars may share it.
        job: What is flown, for every seed.
        measure: A measure of the run, an entry of a list, "name[k]", or one that the
            benchmark adds.
        relation: "<=", ">=", "<", ">", or "+-" with a bound and a width.
        bound: The number, or (centre, half-width).
        over: Whether "every" seed must reach it, their "median", or their "mean".
        seeds: How many; 1 where nothing is random.
        against: A second job: its median is divided by that of `job`.
    """

    name: str
    job: Job
    measure: str
    relation: str
    bound: float | tuple[float, float]
    over: str = "every"
    seeds: int = 10
    against: Job | None = None

    def reached(self, value: float | None) -> bool:
        """Return whether one number reaches the bound."""
        if isinstance(self.bound, tuple):
            centre, width = self.bound
            return value is not None and abs(value - centre) <= width
        return bool(holds(value, self.relation, self.bound))

    def asked(self) -> str:
        """Return the bound in words."""
        if isinstance(self.bound, tuple):
            return f"{self.bound[0]:g} ± {self.bound[1]:g}"
        return f"{self.relation} {self.bound:g}"


def jobs_of(bar: Bar, seeds: int) -> list[Job]:
    """Return every run a bar needs, at most that many seeds."""
    several = [j for j in (bar.job, bar.against) if j is not None]
    if bar.measure == "same_again":
        several.append(bar.job._replace(repeat=1))
    return [
        job._replace(seed=seed)
        for job in several
        for seed in range(min(bar.seeds, seeds))
    ]


_ENTRY = re.compile(r"(\w+)\[(-?\d+)\]")


def measure_of(measures: Mapping[str, Any], name: str) -> Any:
    """Return a measure, or with "name[k]" the k-th entry of a list."""
    entry = _ENTRY.fullmatch(name)
    return measures[name] if entry is None else measures[entry[1]][int(entry[2])]


def values_of(bar: Bar, measured: Measured, most: int) -> list[Any]:
    """Return what is compared with the bound: one number a seed, or a ratio."""
    jobs = [bar.job._replace(seed=seed) for seed in range(min(bar.seeds, most))]
    if bar.measure == "same_again":
        return [
            int(
                measured[job]["trajectory"]
                == measured[job._replace(repeat=1)]["trajectory"]
            )
            for job in jobs
        ]
    values = [measure_of(measured[job], bar.measure) for job in jobs]
    if bar.against is None:
        return values
    others = [
        measure_of(measured[bar.against._replace(seed=job.seed)], bar.measure)
        for job in jobs
    ]
    return [statistics.median(others) / statistics.median(values)]


def _reached(bar: Bar, values: list[Any]) -> tuple[bool, str]:
    """Return whether a bar is reached, and what the table says of it."""
    if bar.against is not None or bar.over in ("median", "mean"):
        known = [v for v in values if v is not None]
        middle = statistics.mean if bar.over == "mean" else statistics.median
        reached = len(known) == len(values) and bar.reached(middle(known))
        return reached, "yes" if reached else "NO"
    count = sum(bar.reached(value) for value in values)
    return count == len(values), f"{count} of {len(values)}"


def bar_table(
    bars: Sequence[Bar], measured: Measured, most: int
) -> tuple[list[str], int]:
    """Return the bars with what was measured, as Markdown, and how many are missed."""
    lines = [
        "## Bars",
        "",
        row("bar", "measure", "bound", "measured", "seeds", "reached", "command"),
        row(*["---"] * 7),
    ]
    failed = 0
    for bar in bars:
        values = values_of(bar, measured, most)
        reached, said = _reached(bar, values)
        failed += not reached
        over = "" if bar.over == "every" else f", {bar.over}"
        over += ", ratio of medians" if bar.against is not None else ""
        command = f"`{bar.job.command()}`"
        command += f"; against `{bar.against.command()}`" if bar.against else ""
        lines.append(
            row(
                bar.name,
                bar.measure + over,
                bar.asked(),
                f"{statistics.mean(values):.3g}"
                if bar.over == "mean"
                else spread(values, digits=6),
                str(min(bar.seeds, most)),
                said,
                command,
            )
        )
    return [*lines, ""], failed
