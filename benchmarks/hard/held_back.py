"""The default call on draws that nothing was tuned on: docs/measured/held_back.md.

    python benchmarks/hard/held_back.py --write docs/measured/held_back.md
        [--draws 2] [--seeds 3] [--families walls ...] [--workers 1]
        [--out results/hard/held_back]

For each family and size, draws from seeds that are used nowhere else. The default call
is run first; IPOPT from random starts then gets the CPU time that it took on average.
The best known cost of a draw is the least confirmed one of all these runs and of longer
runs of other methods. Runs are kept, as by `comparison.py`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.comparison import (
    DEFAULT,
    MANY,
    NEAR,
    outcomes_of,
    written_draw,
)
from swarmstart.benchmarks.hard.cpu_trials import entries_of
from swarmstart.benchmarks.tables import (
    command_of,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.cases.campaign.judging.runs import Asked, Runs, runs_of
from swarmstart.cases.campaign.judging.statistics import wilson_interval

FIRST_SEED = 101
"""First seed that is held back; what is shipped is drawn from seed 1."""
LONGEST_S = 60.0
"""Largest budget of the default call; sizes whose median call takes longer are no part
of the claim [s]."""
REFERENCES = {"memetic+ipopt": 30.0, "roadmap": 20.0}
"""Methods whose runs may only lower the best known cost, with their budgets [s]."""
LEAST_S = 0.1
"""Least budget of IPOPT from random starts [s]."""
SIZES: Mapping[str, Sequence[Mapping[str, int]]] = {
    "walls": [{"walls": n, "gaps": 2} for n in (2, 4)],
    "discs": [{"discs": n} for n in (8, 16)],
    "swing_up": [{"percent": n} for n in (30, 20, 10)],
    "currents": [{"vortices": n} for n in (4, 8, 16)],
    "crossing": [{"vehicles": n} for n in (2, 4)],
    "arms": [{"links": n, "discs": 3} for n in (2, 3, 4)],
    "reorientation": [{"cones": n} for n in (1, 2, 4)],
    "gears": [{"intervals": n} for n in (6, 8)],
}
"""Family -> the sizes that are drawn."""
TEXT = "# Hard problems that nothing was tuned on\n\n"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Held:
    """Runs on a draw.

    Attributes:
        family: Name of the family.
        name: Name of the draw.
        costs: Method -> confirmed minimised costs of its seeds, infinite without one.
        seconds: Method -> CPU time of its seeds, with the repair [s].
        budget: Budget of IPOPT from random starts [s].
    """

    family: str
    name: str
    costs: Mapping[str, Array]
    seconds: Mapping[str, Array]
    budget: float

    @property
    def best(self) -> float:
        """The least confirmed cost; infinite if there is none."""
        return float(min(costs.min(initial=np.inf) for costs in self.costs.values()))

    @property
    def counts(self) -> bool:
        """True if the claim is about a draw of this size: the call is short enough."""
        return float(np.median(self.seconds[DEFAULT])) <= LONGEST_S

    def hits(self, method: str) -> NDArray[np.bool_]:
        """Return whether each run of a method came near the best known cost."""
        target = self.best + NEAR * abs(self.best)
        return np.isfinite(self.costs[method]) & (self.costs[method] <= target)

    @property
    def finders(self) -> list[str]:
        """The methods with a run that came near the best known cost."""
        return [method for method in self.costs if self.hits(method).any()]


def drawn(folder: Path, draws: int, families: Iterable[str]) -> dict[str, Path]:
    """Write the draws as files, and return them by name.

    Args:
        folder: Where the files are written.
        draws: Number of draws of each size.
        families: Names of families.
    """
    paths = [
        written_draw(folder, family, sizes, FIRST_SEED + seed)
        for family in families
        for sizes in SIZES[family]
        for seed in range(draws)
    ]
    return {path.stem: path for path in paths}


def measured(name: str, path: Path, options: argparse.Namespace) -> Held:
    """Run what is not kept yet on a draw, and return its results."""
    default = _runs(path, DEFAULT, LONGEST_S, options.seeds, options)
    ends = np.asarray(default.seconds.ends)
    budget = max(LEAST_S, float(np.mean(ends)))
    every = {
        DEFAULT: default,
        MANY: _runs(path, MANY, round(budget, 3), options.seeds, options),
        **{
            method: _runs(path, method, seconds, 1, options)
            for method, seconds in REFERENCES.items()
        },
    }
    return Held(
        family=name.partition("_seed")[0].rpartition("_")[0],
        name=name,
        costs={method: np.asarray(runs.costs) for method, runs in every.items()},
        seconds={m: np.asarray(runs.seconds.ends) for m, runs in every.items()},
        budget=budget,
    )


def _runs(
    path: Path, method: str, seconds: float, seeds: int, options: argparse.Namespace
) -> Runs:
    budget = {"seconds": seconds}
    (entry,) = entries_of(str(path), [method], seeds=seeds, budget=budget)
    outcomes = outcomes_of([entry], options.out / "runs", workers=options.workers)
    return runs_of(entry, outcomes, Asked(seeds=tuple(range(seeds)), budget=budget))


def finding(results: Sequence[Held]) -> str:
    """Return the finding, in words."""
    counted = [one for one in results if one.counts]
    said = []
    for method in (DEFAULT, MANY):
        hits = np.concatenate([one.hits(method) for one in counted])
        low, high = wilson_interval(int(hits.sum()), len(hits))
        said.append(
            f"{int(hits.sum())} of {len(hits)} runs ({hits.mean():.0%}; 95 % interval "
            f"{low:.0%} to {high:.0%})"
        )
    return (
        f"On {len(counted)} random problems from "
        f"{len({one.family for one in counted})} families, drawn for this test only, "
        "`solve` without options comes within 0.1 % of the best known cost in "
        f"{said[0]}. IPOPT from random starts with the same CPU time does so in "
        f"{said[1]}."
    )


def page(results: Sequence[Held], command: str, seeds: int) -> list[str]:
    """Return the lines of the page below its title.

    Args:
        results: Results of the draws.
        command: Command that makes the page.
        seeds: Number of runs on each draw.
    """
    lines = [
        finding(results),
        "",
        f"Made by `{command}`: {seeds} seeds, CPU time of one thread on one of "
        f"{os.cpu_count()} cores. Building and compiling do not count. The problems "
        f"are drawn with seeds from {FIRST_SEED} on, the [shipped "
        "problems](../hard_problems.md) with seed 1. An answer counts if it still "
        "keeps all limits when it is integrated ten times finer. The budget of IPOPT "
        "from random starts (`repeated-ipopt`) is the mean CPU time of `solve` on the "
        "same problem. The best known cost is the least confirmed one of all runs, "
        "with those of "
        + " and ".join(f"`{m}` ({s:g} s)" for m, s in REFERENCES.items())
        + ", which is IPOPT from paths of probabilistic roadmaps; an optimum that none "
        "of them finds is missing here. The intervals are computed as if all runs were "
        "independent, which runs on the same problem are not.",
        "",
        *_families(results),
        "",
        "## Each draw",
        "",
        *_draws(results),
    ]
    left = [one.name for one in results if not one.counts]
    if left:
        lines += ["", f"Not counted above, since `solve` takes more than "
                  f"{LONGEST_S:g} s: {', '.join(left)}."]  # fmt: skip
    return lines


def _families(results: Sequence[Held]) -> list[str]:
    lines = head("family", "draws", "`solve`", f"`{MANY}`")
    for family in dict.fromkeys(one.family for one in results):
        own = [one for one in results if one.family == family and one.counts]
        if own:
            shares = [_share(own, method) for method in (DEFAULT, MANY)]
            lines.append(row(f"`{family}`", str(len(own)), *shares))
    return lines


def _share(results: Sequence[Held], method: str) -> str:
    hits = np.concatenate([one.hits(method) for one in results])
    return f"{int(hits.sum())} of {len(hits)}"


def _draws(results: Sequence[Held]) -> list[str]:
    lines = head("draw", "best cost", "`solve`", "median [s]", f"`{MANY}`",
                 "budget [s]", "others that find it")  # fmt: skip
    for one in results:
        others = [f"`{m}`" for m in one.finders if m in REFERENCES]
        lines.append(
            row(
                one.name,
                f"{one.best:.7g}" if np.isfinite(one.best) else "none",
                _share([one], DEFAULT),
                f"{np.median(one.seconds[DEFAULT]):.3g}",
                _share([one], MANY),
                f"{one.budget:.3g}",
                ", ".join(others) or "-",
            )
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is missing, print the page, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--draws", type=int, default=2, help="of each size")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--families", nargs="*", choices=[*SIZES], default=[*SIZES])
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("results/hard/held_back"))
    options = parser.parse_args(arguments)
    files = drawn(options.out / "problems", options.draws, options.families)
    results = [measured(name, path, options) for name, path in files.items()]
    command = command_of("benchmarks/hard/held_back.py", arguments)
    publish(page(results, command, options.seeds), options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
