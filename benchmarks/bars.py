"""What flights must reach, and the tables that say whether they do.

A bar is a command and a bound on a measure; a claim is one of a scenario's.
"""

import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from swarmstart.benchmarks.flights import Job, Measured
from swarmstart.benchmarks.tables import row
from swarmstart.cases.claims import assignments_of, claim_assignments, holds
from swarmstart.cases.scenario import read_document, resolve
from swarmstart.cases.statistics import spread
from swarmstart.cases.verdicts import Verdict, paired_verdict, verdict_of_seeds


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


class Found(NamedTuple):
    """A claim of a scenario.

    Attributes:
        scenario: Its name.
        variant: The variant; empty where there is none, or for the default.
        claim: The claim.
        settings: The resolved scenario.
    """

    scenario: str
    variant: str
    claim: Any
    settings: Mapping[str, Any]


def claims_of(scenarios: Iterable[tuple[str, str]]) -> list[Found]:
    """Return every claim of some scenarios, given by name and variant."""
    found: list[Found] = []
    for name, variant in scenarios:
        resolved = resolve(read_document(name), variant=variant or None)
        found += [
            Found(name, variant, claim, resolved.settings)
            for claim in resolved.scenario.claims
        ]
    return found


def claim_jobs(found: Found, seeds: int) -> list[tuple[Job, ...]]:
    """Return the runs of a claim, or the pairs; one where nothing is random."""
    claim, settings = found.claim, found.settings
    base = claim_assignments(claim, settings)
    both = [base]
    if claim.against is not None:
        both.append(base + assignments_of(claim.against))
    exact = claim.when.get("search.name") == "none"
    return [
        tuple(Job(found.scenario, sets, found.variant, seed=seed) for sets in both)
        for seed in range(1 if exact else seeds)
    ]


def claim_table(
    title: str, claims: Sequence[Found], measured: Measured, seeds: int
) -> list[str]:
    """Return the claims with what was measured, as lines of Markdown."""
    lines = [
        f"## {title}",
        "",
        "A ratio is to the second run that the claim names. Where nothing is random "
        "one run decides; else every seed, or for ratios the median and a Wilcoxon "
        "test.",
        "",
        row("claim", "scenario", "text", "asked", "measured", "verdict", "note"),
        row(*["---"] * 7),
    ]
    for found in claims:
        claim = found.claim
        values, verdict = judged(claim, claim_jobs(found, seeds), measured)
        bound = "never" if claim.bound is None else f"{claim.bound:.6g}"
        ratio = " (ratio)" if claim.against is not None else ""
        lines.append(
            row(
                claim.id,
                " ".join(filter(None, (found.scenario, found.variant))),
                f"{claim.text} ({claim.source})",
                f"{claim.measure}{ratio} {claim.relation} {bound}",
                spread(values, digits=6),
                verdict,
                claim.note or "-",
            )
        )
    return [*lines, ""]


def judged(
    claim: Any, jobs: list[tuple[Job, ...]], measured: Measured
) -> tuple[list[Any], str]:
    """Return the measures of a claim's runs, or the ratios of pairs, and the verdict.

    Args:
        claim: The claim.
        jobs: As of `claim_jobs`.
        measured: What was flown.
    """
    found = [[measured[job][claim.measure] for job in pair] for pair in jobs]
    if claim.against is None:
        values = [value for (value,) in found]
    else:
        values = [a / b for a, b in found]
        if len(values) > 1:
            verdict, test = paired_verdict(values, claim.relation, claim.bound)
            return values, f"{verdict} ({test})"
    verdict = verdict_of_seeds(values, claim.relation, claim.bound, share=claim.share)
    kept = sum(bool(holds(v, claim.relation, claim.bound)) for v in values)
    part = verdict is Verdict.IN_PART
    return values, f"{verdict}: {kept} of {len(values)} seeds" if part else str(verdict)
