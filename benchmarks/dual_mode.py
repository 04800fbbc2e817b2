"""What the dual mode does for searches that do not settle by themselves.

    python benchmarks/dual_mode.py --seeds 5 --write docs/dual_mode.md

The corrected scenarios of the formation are flown without the dual mode and with two
terminal sets. A search that starts at random at every step comes near its slots and
stays restless there; once all UAVs are inside the set the linear law takes over.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarmstart.benchmarks.flights import Job, fly_all
from swarmstart.benchmarks.formation_flight import SCENARIOS, fly
from swarmstart.benchmarks.tables import row
from swarmstart.cases.campaign.statistics import spread

SEARCHES = {
    "GA, cold": "search={name: ga, warm_start: none}",
    "CPSO, cold": "search.warm_start=none",
    "CPSO, warm": "search.warm_start=all",
}
SETS = {
    "off": "dual_mode.enabled=false",
    "R = diag(1, 100)": "dual_mode.R=[1, 100]",
    "R = diag(1, 1000)": "dual_mode.R=[1, 1000]",
}
_HEAD = """# The dual mode, flown

Made by `python benchmarks/dual_mode.py --seeds {seeds}`: the corrected formation
scenarios, seeds 0 to {last}. Cold: the search starts at random at every step; warm:
from the last plan. Settled: every UAV within 1 m of its slot along x and y, and
that until the end of the flight. Numbers are lowest / median / highest. Both sets
are proven up to the bounds of the inputs ([terminal_sets.md](terminal_sets.md)).

"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all runs, print the table, and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path, help="a Markdown file to write")
    options = parser.parse_args(arguments)

    rows = [(s, a, d) for s in SCENARIOS for a in SEARCHES for d in SETS]
    jobs = [_job(*one, seed) for one in rows for seed in range(options.seeds)]
    measured = fly_all(fly, jobs, options.workers)

    lines = [
        row(
            "scenario", "search", "dual mode", "settled", "settle time [s]",
            "cost", "linear steps", "exits",
        ),
        row(*["---"] * 8),
    ]  # fmt: skip
    lines += [
        _line(*one, [measured[_job(*one, seed)] for seed in range(options.seeds)])
        for one in rows
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if options.write:
        head = _HEAD.format(seeds=options.seeds, last=options.seeds - 1)
        options.write.write_text(head + text, encoding="utf-8")
    return 0


def _job(scenario: str, search: str, dual: str, seed: int) -> Job:
    return Job(scenario, (SEARCHES[search], SETS[dual]), "corrected", seed=seed)


def _line(scenario: str, search: str, dual: str, runs: list[dict[str, Any]]) -> str:
    settled = [run["settle_time_s"] for run in runs if run["settle_time_s"] is not None]
    return row(
        scenario,
        search,
        dual,
        f"{len(settled)} of {len(runs)}",
        spread(settled, digits=6),
        spread([run["closed_loop_cost"] for run in runs], digits=6),
        spread([run["linear_steps"] for run in runs], digits=6),
        str(sum(run["terminal_exits"] for run in runs)),
    )


if __name__ == "__main__":
    sys.exit(main())
