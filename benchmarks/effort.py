"""Effort of the default call, and what it finds, when cold starts and lanes agree.

    python benchmarks/effort.py [--write docs/measured/effort.md] [--seeds 30]
        [--only pendulum]

Seconds are CPU time of the process, with one thread. A call is warm if it is not the
first for its problem; that of plain CasADi states the NLP, builds IPOPT and solves.
"""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from swarmstart.benchmarks.answer_runs import Shipped, shipped
from swarmstart.benchmarks.initial_states import Peer
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.ocp import Planner, Solution, solve

SAME = 1e-4
"""Relative difference up to which an answer costs as much as the best."""
CALLS = 5
"""Number of calls of which the median counts."""
PLAIN = (
    "double_integrator", "bryson_denham", "pendulum", "brachistochrone",
    "van_der_pol", "catalyst_mixing", "hypersensitive", "pendulum_on_cart",
    "lotka_volterra_fishing", "batch_reactor", "goddard_rocket", "race_car",
    "two_stage_launch", "two_reaction_reactor", "four_discs",
)  # fmt: skip
"""Shipped problems that plain CasADi states as the benchmarks' peer does."""
SEVERAL = (
    "two_reaction_reactor", "pendulum_on_cart", "lynx_and_hares", "goddard_rocket",
    "two_stage_launch", "four_discs",
)  # fmt: skip
"""Shipped problems with several optima."""
HARD = (
    "arms_2", "arms_3", "arms_4", "crossing_2", "crossing_4", "currents_4",
    "currents_8", "currents_16", "discs_8", "discs_16", "gears_6", "gears_8",
    "gears_10", "reorientation_1", "reorientation_2", "reorientation_4", "swing_up_10",
    "swing_up_20", "swing_up_30", "walls_2",
)  # fmt: skip
"""Hard problems, with which nothing was chosen; a sixth of the seeds."""
TEXT = """# Effort in proportion

Made by `python benchmarks/effort.py --write docs/measured/effort.md`. The default call,
`solve` without options, leaves out its search if [cold starts and lanes
agree](../answers.md#many-starts).

The first table compares the CPU time of a default call, repeated so that its machine
code is loaded, and with all that it verifies and repairs, with that of plain CasADi:
stating the NLP of direct multiple shooting, building IPOPT, and solving once from
states held at the initial state and controls in the middle of their bounds. "One start
is enough" if the cost of this solve is within 1e-4 of the best cost known here.

"""
HITS = """
The second table compares the default call with one that always searches
(`search="lshade"`), on problems with several optima. The two differ only if cold starts
and lanes agree. A seed hits if its answer is feasible at the checks (`repair=False`)
and costs at most 1e-4 more, relative, than the best of all these answers. The rule was
chosen before the [hard problems](../hard_problems.md) were written; starts from states
that lead straight to the end were added to the cold ones after it.

"""


class Spent(NamedTuple):
    """CPU time on a problem.

    Attributes:
        name: The problem.
        ours_s: Median of a warm default call [s].
        plain_s: Median of plain CasADi with building [s].
        agrees: Whether cold starts and lanes agree, with the last seed.
        is_enough: Whether plain CasADi's answer is as good.
    """

    name: str
    ours_s: float
    plain_s: float
    agrees: bool
    is_enough: bool

    @property
    def ratio(self) -> float:
        """Time of the default call, relative to plain CasADi."""
        return self.ours_s / self.plain_s


class Hits(NamedTuple):
    """Hits of the default call, and of one that always searches.

    Attributes:
        name: The problem.
        seeds: Number of seeds.
        agreed: Number of those in which cold starts and lanes agree.
        found: Hits of the default call.
        found_searching: Hits of one that always searches.
        spent_s: Median CPU time of both [s].
    """

    name: str
    seeds: int
    agreed: int
    found: int
    found_searching: int
    spent_s: tuple[float, float]


def called(
    one: Shipped, seed: int, *, search: str = "default", repair: bool = True
) -> tuple[Solution, float]:
    """Return an answer, and its CPU time [s]."""
    begin = time.process_time()
    answer = solve(
        one.problem, one.x0, known=one.known, guess=one.guess, search=search,
        repair=repair, threads=1, seed=seed, progress=False,
    )  # fmt: skip
    return answer, time.process_time() - begin


def agrees(answer: Solution) -> bool:
    """Return whether cold starts and lanes agree on an answer."""
    return answer.plan.starts is not None and answer.plan.starts.agree


def spent_on(name: str) -> Spent:
    """Return the CPU time of the default call and of plain CasADi on a problem."""
    one = shipped(name, None)
    answer, _ = called(one, CALLS)  # Builds and compiles.
    planner = Planner(one.problem, search=None, polish=None)
    x0 = np.asarray(planner.posed(one.x0, one.known)[0], dtype=np.float64)
    ours, plain, cost = [], [], np.inf
    for seed in range(CALLS):
        answer, seconds = called(one, seed)
        ours.append(seconds)
        peer = Peer(one.problem)  # Builds nothing yet.
        start = peer.starts(x0, np.random.default_rng(0))[0]
        begin = time.process_time()
        cost, _ = peer(x0, start)
        plain.append(time.process_time() - begin)
    best = one.problem.sense * answer.cost
    return Spent(
        name=name,
        ours_s=float(np.median(ours)),
        plain_s=float(np.median(plain)),
        agrees=agrees(answer),
        is_enough=bool(cost <= best + SAME * abs(best)),
    )


def hits_on(one: Shipped, seeds: int) -> Hits:
    """Return the hits of the default call and of one that always searches."""
    sense = one.problem.sense
    costs, spent, agreed = np.full((2, seeds), np.inf), np.zeros((2, seeds)), 0
    called(one, seeds, repair=False)  # Builds and compiles.
    for seed in range(seeds):
        for way, search in enumerate(("default", "lshade")):
            answer, spent[way, seed] = called(one, seed, search=search, repair=False)
            if answer.plan.feasible:
                costs[way, seed] = sense * answer.cost
            agreed += agrees(answer)
            if not (way or agrees(answer)):  # Both calls are the same.
                costs[1, seed], spent[1, seed] = costs[0, seed], spent[0, seed]
                break
    least = costs.min()
    found = (costs <= least + SAME * abs(least)).sum(axis=1)
    return Hits(
        name=one.name,
        seeds=seeds,
        agreed=agreed,
        found=int(found[0]),
        found_searching=int(found[1]),
        spent_s=(float(np.median(spent[0])), float(np.median(spent[1]))),
    )


def spent_table(spent: Sequence[Spent]) -> list[str]:
    """Return the table of CPU times."""
    lines = head("problem", "ours [s]", "plain CasADi [s]", "ratio", "agree",
                 "one start is enough")  # fmt: skip
    return lines + [
        row(one.name, f"{one.ours_s:.2g}", f"{one.plain_s:.2g}", f"{one.ratio:.2f}",
            "yes" if one.agrees else "no", "yes" if one.is_enough else "no")
        for one in spent
    ]  # fmt: skip


def hits_table(hits: Sequence[Hits]) -> list[str]:
    """Return the table of hits."""
    lines = head("problem", "agree", "hits", "hits, always searching", "seconds",
                 "always searching")  # fmt: skip
    return lines + [
        row(one.name,
            *(f"{n} of {one.seeds}"
              for n in (one.agreed, one.found, one.found_searching)),
            *(f"{seconds:.2g}" for seconds in one.spent_s))
        for one in hits
    ]  # fmt: skip


def bars_of(spent: Sequence[Spent], hits: Sequence[Hits]) -> Iterator[Bar]:
    """Yield what was asked for."""
    ratios = [one.ratio for one in spent if one.is_enough]
    if ratios:
        middle = float(np.median(ratios))
        yield Bar("median ratio if one start is enough", "<=", 4.0, middle)
        yield Bar("largest ratio", "<=", 8.0, max(ratios))
    lost = sum(max(one.found_searching - one.found, 0) for one in hits)
    yield Bar("hits lost", "<=", 0, lost)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=30, help="for the hits")
    parser.add_argument("--only", nargs="*", default=None, help="some problems only")
    options = parser.parse_args(arguments)
    asked = options.only
    spent, hits = [], []
    for name in PLAIN:
        if asked is None or name in asked:
            spent.append(spent_on(name))
            print(spent[-1], flush=True)
    hard = {f"hard/{name}": max(options.seeds // 6, 1) for name in HARD}
    for name, seeds in {**dict.fromkeys(SEVERAL, options.seeds), **hard}.items():
        if asked is None or name in asked:
            hits.append(hits_on(shipped(name, None), seeds))
            print(hits[-1], flush=True)
    lines = [*spent_table(spent), HITS, *hits_table(hits), ""]
    publish([*lines, *bar_table(bars_of(spent, hits))], options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
