"""The formation flights over seeds: the project's bars and the chapter's claims 1-10.

    python benchmarks/formation_flight.py --seeds 5 --pairs 10 --write docs/claims.md

Every distinct run is flown once, in two worker processes. A claim is judged by runs
with the settings its `when` asks for; a claim with `against` by pairs of runs with the
same seed, whose ratio must be in the relation to the bound.
"""

import argparse
import itertools
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.benchmarks.bars import Found, claim_jobs, claims_of, judged
from swarmstart.benchmarks.flights import Job, Measured, flown, fly_all
from swarmstart.benchmarks.tables import row
from swarmstart.cases.claims import holds
from swarmstart.cases.statistics import spread
from swarmstart.ocp import Source
from swarmstart.ocp.polish import is_better

SCENARIOS = ("formation_v", "formation_obstacle")
VARIANTS = ("literal", "corrected")
FEASIBLE = 1e-6
"""Largest violation that counts as none: the problems' tolerance."""


class Bar(NamedTuple):
    """A number the project must reach, over all seeds."""

    scenario: str
    variant: str
    assignments: tuple[str, ...]
    measure: str
    relation: str
    bound: float

    def jobs(self, seeds: int) -> list[Job]:
        """Return the runs that must reach it."""
        return _jobs(self.scenario, self.variant, self.assignments, seeds)


POLISHED = ("polish=ipopt",)
DUAL = ("dual_mode.enabled=true",)
BARS = (
    Bar("formation_v", "literal", (), "settle_time_s", "<=", 12),
    Bar("formation_v", "literal", (), "tail_error_m", "<=", 0.05),
    Bar("formation_v", "literal", (), "closed_loop_cost", "<=", 4400),
    Bar("formation_v", "literal", (), "min_distance_m", ">=", 5),
    Bar("formation_v", "corrected", (), "settle_time_s", "<=", 10),
    Bar("formation_v", "corrected", (), "closed_loop_cost", "<=", 4350),
    Bar("formation_v", "corrected", (), "terminal_exits", "==", 0),
    Bar("formation_v", "corrected", (), "lyapunov_ratio_max", "<", 1),
    Bar("formation_obstacle", "literal", (), "settle_time_s", "<=", 18),
    Bar("formation_obstacle", "literal", (), "tail_error_m", "<=", 0.1),
    Bar("formation_obstacle", "literal", (), "closed_loop_cost", "<=", 95000),
    Bar("formation_obstacle", "literal", (), "min_distance_sampled_m", ">=", 3),
    Bar(
        "formation_obstacle", "literal", (), "obstacle_clearance_sampled_m", ">=", -1e-6
    ),
    Bar("formation_obstacle", "literal", (), "obstacle_clearance_m", "<", 0),
    Bar("formation_obstacle", "corrected", (), "settle_time_s", "<=", 18),
    Bar("formation_obstacle", "corrected", (), "closed_loop_cost", "<=", 112000),
    Bar("formation_obstacle", "corrected", (), "min_distance_m", ">=", 3),
    Bar("formation_obstacle", "corrected", (), "obstacle_clearance_m", ">=", 0),
    Bar("formation_obstacle", "corrected", (), "terminal_exits", "==", 0),
    Bar("formation_obstacle", "corrected", (), "lyapunov_ratio_max", "<", 1),
    Bar("formation_obstacle", "corrected", POLISHED, "closed_loop_cost", "<=", 101500),
    Bar("formation_obstacle", "corrected", POLISHED, "min_distance_m", ">=", 3),
    Bar("formation_obstacle", "corrected", POLISHED, "obstacle_clearance_m", ">=", 0),
    Bar(
        "formation_obstacle", "corrected", POLISHED, "steps_worse_than_search", "==", 0
    ),
    Bar("formation_v", "corrected", POLISHED, "steps_worse_than_search", "==", 0),
    Bar("formation_v", "literal", DUAL, "lyapunov_ratio_max", ">", 10),
    Bar("formation_v", "literal", DUAL, "held_spectral_radius", ">", 10.75),
)


def fly(job: Job) -> dict[str, Any]:
    """Fly one run and return its measures; called in a worker process."""
    finished = flown(job)
    worse = sum(
        is_better(
            (plan.search_cost, plan.search_violation),
            (plan.cost, plan.violation),
            tolerance=FEASIBLE,
        )
        for decision in finished.trajectory.decisions
        for plan in decision.plans
        if plan.source in (Source.SEARCH, Source.POLISH)
    )
    return {**finished.measures, "steps_worse_than_search": worse}


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all runs, print the tables, and write them where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--pairs", type=int, default=10, help="seeds of paired claims")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path, help="a Markdown file to write")
    options = parser.parse_args(arguments)

    claims = claims_of(itertools.product(SCENARIOS, VARIANTS))
    jobs = [job for bar in BARS for job in bar.jobs(options.seeds)]
    jobs += [job for runs in _rivals(options.seeds).values() for job in runs]
    jobs += [job for claim in claims for pair in _pairs(claim, options) for job in pair]
    measured = fly_all(fly, jobs, options.workers)

    lines, failed = _bar_table(measured, options.seeds)
    lines += _ranking_table(measured, options.seeds)
    lines += _claim_table(claims, measured, options)
    text = "\n".join(lines) + "\n"
    print(text)
    if options.write:
        options.write.write_text(_HEAD.format(**vars(options)) + text)
    return 3 if failed else 0


def _jobs(
    scenario: str, variant: str, assignments: tuple[str, ...], seeds: int
) -> list[Job]:
    return [Job(scenario, assignments, variant, seed=seed) for seed in range(seeds)]


def _rivals(seeds: int) -> dict[tuple[str, str, str], list[Job]]:
    """Return the runs of each scenario and variant with GA and with chaotic PSO."""
    return {
        (name, variant, search): _jobs(name, variant, assignments, seeds)
        for name in SCENARIOS
        for variant in VARIANTS
        for search, assignments in (("ga", ("search={name: ga}",)), ("cpso", ()))
    }


def _pairs(claim: Found, options: argparse.Namespace) -> list[tuple[Job, ...]]:
    """Return the runs of a claim, or the pairs."""
    paired = claim.claim.against is not None
    return claim_jobs(claim, options.pairs if paired else options.seeds)


def _bar_table(measured: Measured, seeds: int) -> tuple[list[str], int]:
    lines = [
        "## Bars",
        "",
        f"Every one of {seeds} seeds (0 to {seeds - 1}) must reach the bound.",
        "",
        row("scenario", "variant", "set", "measure", "bound", "measured", "reached"),
        row(*["---"] * 7),
    ]
    failed = 0
    for bar in BARS:
        values = [measured[job][bar.measure] for job in bar.jobs(seeds)]
        reached = sum(bool(holds(v, bar.relation, bar.bound)) for v in values)
        failed += reached < seeds
        lines.append(
            row(
                bar.scenario,
                bar.variant,
                " ".join(bar.assignments) or "-",
                bar.measure,
                f"{bar.relation} {bar.bound:g}",
                spread(values, digits=6),
                f"{reached} of {seeds}",
            )
        )
    return [*lines, ""], failed


def _ranking_table(measured: Measured, seeds: int) -> list[str]:
    lines = [
        "## The chapter's GA, started at random at every step, against chaotic PSO",
        "",
        row("scenario", "variant", "GA, cost", "CPSO, cost", "ratio", "GA settles"),
        row(*["---"] * 6),
    ]
    runs = {
        rival: [measured[job] for job in jobs] for rival, jobs in _rivals(seeds).items()
    }
    for name, variant in itertools.product(SCENARIOS, VARIANTS):
        ga, cpso = (
            statistics.median(
                run["closed_loop_cost"] for run in runs[name, variant, search]
            )
            for search in ("ga", "cpso")
        )
        settled = [
            run["settle_time_s"] is not None for run in runs[name, variant, "ga"]
        ]
        lines.append(
            row(
                name,
                variant,
                f"{ga:.0f}",
                f"{cpso:.0f}",
                f"{ga / cpso:.3f}",
                f"{sum(settled)} of {seeds}",
            )
        )
    return [*lines, ""]


def _claim_table(
    claims: Sequence[Found], measured: Measured, options: argparse.Namespace
) -> list[str]:
    lines = [
        "## The chapter's claims 1 to 10",
        "",
        row("claim", "scenario", "variant", "text", "asked", "measured", "verdict"),
        row(*["---"] * 7),
    ]
    for found in claims:
        claim = found.claim
        values, verdict = judged(claim, _pairs(found, options), measured)
        bound = "never" if claim.bound is None else f"{claim.bound:.4g}"
        ratio = " (ratio)" if claim.against is not None else ""
        lines.append(
            row(
                claim.id,
                found.scenario,
                found.variant,
                f"{claim.text} ({claim.source})",
                f"{claim.measure}{ratio} {claim.relation} {bound}",
                spread(values, digits=6),
                verdict,
            )
        )
    return [*lines, ""]


_HEAD = """# The formation flights over seeds

Made by `python benchmarks/formation_flight.py --seeds {seeds} --pairs {pairs}`.
Numbers are lowest / median / highest over the seeds, medians where there is one. Paired
runs are said to differ where a two-sided Wilcoxon signed-rank test gives p <= 0.05; the
median ratio then decides.

"""


if __name__ == "__main__":
    sys.exit(main())
