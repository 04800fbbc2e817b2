"""The formation flights over seeds: the project's bars and the chapter's claims 1-10.

    python benchmarks/formation_flight.py --seeds 5 --pairs 10 --write docs/claims.md

Every distinct run is flown once, in two worker processes. A claim is judged by runs
with the settings its `when` asks for; a claim with `against` by pairs of runs with the
same seed, whose ratio must be in the relation to the bound.
"""

import argparse
import multiprocessing
import os
import statistics
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.claims import assignments_of, claim_assignments, holds
from swarmstart.cases.run import run
from swarmstart.cases.scenario import read_document, resolve
from swarmstart.cases.verdicts import paired_verdict
from swarmstart.ocp import Source
from swarmstart.ocp.polish import is_better

SCENARIOS = ("formation_v", "formation_obstacle")
VARIANTS = ("literal", "corrected")
FEASIBLE = 1e-6
"""Largest violation that counts as none: the problems' tolerance."""


class Job(NamedTuple):
    """One run: hashable, so that it is flown once."""

    scenario: str
    variant: str
    assignments: tuple[str, ...]
    seed: int


class Bar(NamedTuple):
    """A number the project must reach, over all seeds."""

    scenario: str
    variant: str
    assignments: tuple[str, ...]
    measure: str
    relation: str
    bound: float


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
    resolved = resolve(
        read_document(job.scenario), variant=job.variant, assignments=job.assignments
    )
    finished = run(resolved, seed=job.seed)
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
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    claims = _claims()
    jobs = sorted(set(_bar_jobs(options.seeds)) | set(_claim_jobs(claims, options)))
    print(f"{len(jobs)} runs", file=sys.stderr)
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        measured = dict(zip(jobs, pool.map(fly, jobs, chunksize=1), strict=True))

    lines, failed = _bar_table(measured, options.seeds)
    lines += _ranking_table(measured, options.seeds)
    lines += _claim_table(claims, measured, options)
    text = "\n".join(lines) + "\n"
    print(text)
    if options.write:
        options.write.write_text(_HEAD.format(**vars(options)) + text)
    return 3 if failed else 0


def _claims() -> list[tuple[str, str, Any, dict[str, Any]]]:
    """Return (scenario, variant, claim, settings) for every claim and variant."""
    found = []
    for name in SCENARIOS:
        for variant in VARIANTS:
            resolved = resolve(read_document(name), variant=variant)
            found += [
                (name, variant, claim, dict(resolved.settings))
                for claim in resolved.scenario.claims
            ]
    return found


def _bar_jobs(seeds: int) -> list[Job]:
    jobs = [
        Job(bar.scenario, bar.variant, bar.assignments, seed)
        for bar in BARS
        for seed in range(seeds)
    ]
    return jobs + [
        Job(name, variant, assignments, seed)
        for name in SCENARIOS
        for variant in VARIANTS
        for assignments in (("search={name: ga}",), ())
        for seed in range(seeds)
    ]


def _claim_jobs(
    claims: list[tuple[str, str, Any, dict[str, Any]]], options: argparse.Namespace
) -> list[Job]:
    jobs = []
    for name, variant, claim, settings in claims:
        base = claim_assignments(claim, settings)
        if claim.against is None:
            jobs += [Job(name, variant, base, seed) for seed in range(options.seeds)]
            continue
        other = base + assignments_of(claim.against)
        for seed in range(options.pairs):
            jobs += [Job(name, variant, base, seed), Job(name, variant, other, seed)]
    return jobs


def _bar_table(
    measured: dict[Job, dict[str, Any]], seeds: int
) -> tuple[list[str], int]:

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
        values = [
            measured[Job(bar.scenario, bar.variant, bar.assignments, seed)][bar.measure]
            for seed in range(seeds)
        ]
        reached = sum(bool(holds(v, bar.relation, bar.bound)) for v in values)
        failed += reached < seeds
        lines.append(
            row(
                bar.scenario,
                bar.variant,
                " ".join(bar.assignments) or "-",
                bar.measure,
                f"{bar.relation} {bar.bound:g}",
                spread(values),
                f"{reached} of {seeds}",
            )
        )
    return [*lines, ""], failed


def _ranking_table(measured: dict[Job, dict[str, Any]], seeds: int) -> list[str]:
    lines = [
        "## The chapter's GA, started at random at every step, against chaotic PSO",
        "",
        row("scenario", "variant", "GA, cost", "CPSO, cost", "ratio", "GA settles"),
        row(*["---"] * 6),
    ]
    for name in SCENARIOS:
        for variant in VARIANTS:
            runs = {
                search: [measured[Job(name, variant, a, s)] for s in range(seeds)]
                for search, a in (("ga", ("search={name: ga}",)), ("cpso", ()))
            }
            cost = {
                search: statistics.median(m["closed_loop_cost"] for m in rows)
                for search, rows in runs.items()
            }
            settled = sum(m["settle_time_s"] is not None for m in runs["ga"])
            lines.append(
                row(
                    name,
                    variant,
                    f"{cost['ga']:.0f}",
                    f"{cost['cpso']:.0f}",
                    f"{cost['ga'] / cost['cpso']:.3f}",
                    f"{settled} of {seeds}",
                )
            )
    return [*lines, ""]


def _claim_table(
    claims: list[tuple[str, str, Any, dict[str, Any]]],
    measured: dict[Job, dict[str, Any]],
    options: argparse.Namespace,
) -> list[str]:
    lines = [
        "## The chapter's claims 1 to 10",
        "",
        row("claim", "scenario", "variant", "text", "asked", "measured", "verdict"),
        row(*["---"] * 7),
    ]
    for name, variant, claim, settings in claims:
        values, verdict = _judged(name, variant, claim, settings, measured, options)
        bound = "never" if claim.bound is None else f"{claim.bound:.4g}"
        ratio = " (ratio)" if claim.against is not None else ""
        lines.append(
            row(
                claim.id,
                name,
                variant,
                f"{claim.text} ({claim.source})",
                f"{claim.measure}{ratio} {claim.relation} {bound}",
                spread(values),
                verdict,
            )
        )
    return [*lines, ""]


def _judged(
    name: str,
    variant: str,
    claim: Any,
    settings: Mapping[str, Any],
    measured: dict[Job, dict[str, Any]],
    options: argparse.Namespace,
) -> tuple[list[Any], str]:
    """Return the measured values or ratios of a claim, and the verdict."""
    base = claim_assignments(claim, settings)
    if claim.against is None:
        values = [
            measured[Job(name, variant, base, seed)][claim.measure]
            for seed in range(options.seeds)
        ]
        kept = sum(bool(holds(v, claim.relation, claim.bound)) for v in values)
        if kept >= claim.share * len(values):
            return values, "holds"
        part = f"in part: {kept} of {len(values)} seeds"
        return values, part if kept else "does not hold"
    other = base + assignments_of(claim.against)
    pairs = [
        (
            measured[Job(name, variant, base, seed)][claim.measure],
            measured[Job(name, variant, other, seed)][claim.measure],
        )
        for seed in range(options.pairs)
    ]
    ratios = [a / b for a, b in pairs]
    verdict, test = paired_verdict(ratios, claim.relation, claim.bound)
    return ratios, f"{verdict} ({test})"


def row(*cells: str) -> str:
    """Return a row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def spread(values: list[Any]) -> str:
    """Return lowest, median and highest; how many are not defined."""
    known = [v for v in values if v is not None]
    missing = f", {len(values) - len(known)} never" if len(known) < len(values) else ""
    if not known:
        return "never"
    low, middle, high = min(known), statistics.median(known), max(known)
    if low == high:
        return f"{low:.6g}{missing}"
    return f"{low:.6g} / {middle:.6g} / {high:.6g}{missing}"


_HEAD = """# The formation flights over seeds

Made by `python benchmarks/formation_flight.py --seeds {seeds} --pairs {pairs}`.
Numbers are lowest / median / highest over the seeds, medians where there is one. Paired
runs are said to differ where a two-sided Wilcoxon signed-rank test gives p <= 0.05; the
median ratio then decides.

"""


if __name__ == "__main__":
    sys.exit(main())
