"""Choice of the search: all of them on planning problems, before and after the polish.

    python benchmarks/planning.py --seeds 15 --write docs/measured/planning.md

Every search has its default settings and the same seeds; only the best point of each is
polished, by IPOPT on multiple shooting. Points are compared as a static penalty does,
cost + 1e4 violation. Wilcoxon's signed-rank test on paired seeds compares each search
with L-SHADE, corrected by Holm over all searches of a problem and budget.
"""

import multiprocessing
import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np

from swarmstart.benchmarks.problems import (
    Instance,
    formation,
    four_discs,
    passing,
    reactor,
)
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.campaign.judging.statistics import LEVEL, holm, signed_rank_p
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.heuristics import ALGORITHMS, Algorithm, Budget
from swarmstart.ocp import IpoptOptions, Planner, SearchSettings

BUDGETS = (100, 200, 400, 1000, 4000, 20000)
WEIGHT = 1e4
REFERENCE = "lshade"
VARIANTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "cpso, c1 = c2 = 1.496": ("cpso", {"cognitive": 1.496, "social": 1.496}),
    "pso, ring": ("pso", {"neighbours": 4}),
}
PROBLEMS: Mapping[str, Callable[[], Instance]] = {
    "UAV 3 and the obstacle": lambda: formation("formation_obstacle")[2],
    "passing side": passing,
    "four discs": four_discs,
    "two-reaction reactor": reactor,
}


class Job(NamedTuple):
    """One planning problem, searched and polished once."""

    problem: str
    search: str
    evaluations: int
    seed: int


class Found(NamedTuple):
    """Cost + WEIGHT violation, before and after the polish."""

    searched: float
    polished: float


class Group(NamedTuple):
    """Answers of one search on one problem with one budget, seed by seed."""

    searched: Sequence[float]
    polished: Sequence[float]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=15, help="15 by default")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    options = parser.parse_args(arguments)

    jobs = [
        Job(problem, search, evaluations, seed)
        for problem in PROBLEMS
        for search in searches()
        for evaluations in BUDGETS
        for seed in range(options.seeds)
    ]
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        found = dict(pool.imap_unordered(_run, jobs, chunksize=options.seeds))
    publish(report(groups(found), options.seeds), options)
    return 0


def searches() -> list[str]:
    """Return the names of all searches, and of other settings of one."""
    return [*(name for name in SEARCHES if name in ALGORITHMS), *VARIANTS]


def algorithm(name: str) -> Algorithm:
    """Return a search's settings: its defaults, or a variant of them."""
    known, settings = VARIANTS.get(name, (name, {}))
    made: Algorithm = resolve_name(SEARCHES[known].settings)(**settings)
    return made


_PLANNERS: dict[tuple[str, str, int], tuple[Instance, Planner]] = {}
"""In a worker: what is compiled for a problem serves all its seeds."""


def _run(job: Job) -> tuple[Job, Found]:
    key = (job.problem, job.search, job.evaluations)
    if key not in _PLANNERS:
        instance = PROBLEMS[job.problem]()
        settings = SearchSettings(
            algorithm=algorithm(job.search),
            budget=Budget(evaluations=job.evaluations),
        )
        planner = Planner(instance.problem, search=settings, polish=IpoptOptions())
        _PLANNERS.clear()
        _PLANNERS[key] = (instance, planner)
    instance, planner = _PLANNERS[key]
    rng = np.random.default_rng(job.seed)
    plan = planner.plan(instance.x0, known=instance.known, rng=rng)
    return job, Found(
        plan.search.cost + WEIGHT * plan.search.violation,
        plan.cost + WEIGHT * plan.violation,
    )


Groups = Mapping[tuple[str, int, str], Group]
"""(problem, evaluations, search) -> what was found."""


def groups(found: Mapping[Job, Found]) -> Groups:
    """Return what was found, the seeds of each search side by side, in order."""
    lists: dict[tuple[str, int, str], list[Found]] = {}
    for job in sorted(found, key=lambda job: job.seed):
        key = (job.problem, job.evaluations, job.search)
        lists.setdefault(key, []).append(found[job])
    return {
        key: Group([f.searched for f in values], [f.polished for f in values])
        for key, values in lists.items()
    }


def report(found: Groups, seeds: int) -> list[str]:
    """Return the page."""
    lines = [_HEAD.format(seeds=seeds)]
    for problem in PROBLEMS:
        lines += [f"## {problem}", ""]
        lines += _problem_table(found, problem)
    return [*lines, *_summary(found)]


def _problem_table(found: Groups, problem: str) -> list[str]:
    lines = head("search", *(f"{budget:,} evaluations" for budget in BUDGETS))
    tests = {budget: _tests(found, problem, budget) for budget in BUDGETS}
    for name in searches():
        cells = []
        for budget in BUDGETS:
            group = found[problem, budget, name]
            cells.append(
                f"{_median(group.searched)} → {_median(group.polished)}"
                f"{tests[budget].get(name, '')}"
            )
        lines.append(row(name, *cells))
    return [*lines, ""]


def _tests(found: Groups, problem: str, budget: int) -> dict[str, str]:
    """Return a mark for each search that differs from the reference before polish."""
    reference = np.array(found[problem, budget, REFERENCE].searched)
    p_values, better = {}, {}
    for name in searches():
        other = np.array(found[problem, budget, name].searched)
        if name != REFERENCE and np.any(other != reference):
            p_values[name] = signed_rank_p((other - reference).tolist())
            better[name] = float(np.median(other)) < float(np.median(reference))
    return marks(p_values, better)


def marks(p_values: Mapping[str, float], better: Mapping[str, bool]) -> dict[str, str]:
    """Return a mark for each name whose difference shows, by Holm's procedure."""
    adjusted = dict(zip(p_values, holm([*p_values.values()]), strict=True))
    shown = (name for name, p in adjusted.items() if p <= LEVEL)
    return {name: " (+)" if better[name] else " (-)" for name in shown}


def _summary(found: Groups) -> list[str]:
    """Return mean ranks over the problems, before and after the polish."""
    lines = ["## Mean ranks over the problems", ""]
    lines += head("search", *(f"{budget:,}" for budget in BUDGETS))
    for name in searches():
        cells = [
            f"{_mean_rank(found, budget, name, 0):.1f} → "
            f"{_mean_rank(found, budget, name, 1):.1f}"
            for budget in BUDGETS
        ]
        lines.append(row(name, *cells))
    return [*lines, ""]


def _mean_rank(found: Groups, budget: int, name: str, part: int) -> float:
    """Return the mean rank of a search's median, over the problems."""
    ranks = []
    for problem in PROBLEMS:
        medians = {
            other: statistics.median(found[problem, budget, other][part])
            for other in searches()
        }
        own = medians[name]
        below = sum(_is_less(value, own) for value in medians.values())
        ties = sum(
            not _is_less(value, own) and not _is_less(own, value)
            for value in medians.values()
        )
        ranks.append(below + (ties + 1) / 2)
    return statistics.fmean(ranks)


def _is_less(a: float, b: float) -> bool:
    """Return whether a is below b by more than 1e-6 of it."""
    return a < b - 1e-6 * abs(b)


def _median(values: Iterable[float]) -> str:
    return f"{statistics.median(values):.4g}"


_HEAD = """# Which search to take

Made by `python benchmarks/planning.py`. Every search has its default settings and
the same {seeds} seeds. A cell shows two medians of cost + 1e4 violation: that of the
search's own answer → that after IPOPT has polished it. (+) and (-) mark searches that
are better or worse than L-SHADE before the polish, by Wilcoxon's signed-rank test on
the paired seeds, corrected by Holm over the searches, at 5 %. Without a mark no
difference is shown.
"""


if __name__ == "__main__":
    sys.exit(main())
