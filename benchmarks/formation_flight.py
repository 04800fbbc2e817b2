"""The formation flights over seeds: the project's bars.

    python benchmarks/formation_flight.py --write docs/formation_bars.md

Every distinct run is flown once, in two worker processes.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.benchmarks.flights import Job, Measured, flown, fly_all
from swarmstart.benchmarks.tables import row
from swarmstart.cases.campaign.claims import holds
from swarmstart.cases.campaign.statistics import spread
from swarmstart.ocp import Source
from swarmstart.ocp.polish import is_better

SCENARIOS = ("formation_v", "formation_obstacle")
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
SHIFTED = ("last_plan=shifted",)
DUAL = ("last_plan=shifted", "dual_mode.enabled=true")
BARS = (
    Bar("formation_v", "literal", SHIFTED, "settle_time_s", "<=", 12),
    Bar("formation_v", "literal", SHIFTED, "tail_error_m", "<=", 0.05),
    Bar("formation_v", "literal", SHIFTED, "closed_loop_cost", "<=", 4400),
    Bar("formation_v", "literal", SHIFTED, "min_distance_m", ">=", 5),
    Bar("formation_v", "corrected", (), "settle_time_s", "<=", 10),
    Bar("formation_v", "corrected", (), "closed_loop_cost", "<=", 4350),
    Bar("formation_v", "corrected", (), "terminal_exits", "==", 0),
    Bar("formation_v", "corrected", (), "lyapunov_ratio_max", "<", 1),
    Bar("formation_obstacle", "literal", SHIFTED, "settle_time_s", "<=", 18),
    Bar("formation_obstacle", "literal", SHIFTED, "tail_error_m", "<=", 0.1),
    Bar("formation_obstacle", "literal", SHIFTED, "closed_loop_cost", "<=", 95000),
    Bar("formation_obstacle", "literal", SHIFTED, "min_distance_sampled_m", ">=", 3),
    Bar(
        "formation_obstacle",
        "literal",
        SHIFTED,
        "obstacle_clearance_sampled_m",
        ">=",
        -1e-6,
    ),
    Bar("formation_obstacle", "literal", SHIFTED, "obstacle_clearance_m", "<", 0),
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
            (plan.search.cost, plan.search.violation),
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
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path, help="a Markdown file to write")
    options = parser.parse_args(arguments)

    jobs = [job for bar in BARS for job in bar.jobs(options.seeds)]
    measured = fly_all(fly, jobs, options.workers)

    lines, failed = _bar_table(measured, options.seeds)
    text = "\n".join(lines) + "\n"
    print(text)
    if options.write:
        options.write.write_text(_HEAD.format(**vars(options)) + text)
    return 3 if failed else 0


def _jobs(
    scenario: str, variant: str, assignments: tuple[str, ...], seeds: int
) -> list[Job]:
    return [Job(scenario, assignments, variant, seed=seed) for seed in range(seeds)]


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


_HEAD = """# The formation flights over seeds

Made by `python benchmarks/formation_flight.py --seeds {seeds}`, with
`--write docs/formation_bars.md`. Numbers are lowest / median / highest over the seeds.
As printed, with searches that start at the last plan as it is, the flights do not
settle ([claims.md](claims.md)); the bars of `literal` are those with the last plan
shifted, `--set last_plan=shifted`.

"""


if __name__ == "__main__":
    sys.exit(main())
