"""Searches with and without local solves in lanes, after the polish.

    python benchmarks/lane_searches.py [--write docs/measured/lane_searches.md]
        [--seeds 10]

Seconds are CPU time of the process, so that other processes matter little; machine code
is loaded before.
"""

import statistics
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.heuristics import Budget, Initial, default_order, minimize
from swarmstart.ocp import IpoptOptions, Planner
from swarmstart.ocp.nlp.several import polish_basins
from swarmstart.ocp.search.search_space import space_of
from swarmstart.ocp.search.settings import search_settings, traded_order

SCENARIOS = (
    "four_discs", "pendulum_on_cart", "passing_side", "two_reaction_reactor",
    "lynx_and_hares", "swap_5",
)  # fmt: skip
SEARCHES = (
    *(
        (name, budget)
        for budget in (2_000, 20_000)
        for name in ("default", "cma", "lshade, then cma", "memetic", "multistart")
    ),
    ("memetic", 200_000),
    ("multistart", 200_000),
    ("none", 0),
)
SLOW, MOST = "swap_5", 2_000
"""A problem without lanes whose polish takes long, and its largest budget."""
HALVES = "lshade, then cma"
SAME = 1e-4
"""Relative distance from the least cost that any run has found, of a hit."""


class Answer(NamedTuple):
    """One answer: its cost, infinite if it is not feasible, and what it took."""

    cost: float
    evaluations: int
    seconds: float


class Measured(NamedTuple):
    """A search on a problem, seed by seed."""

    scenario: str
    search: str
    budget: int
    answers: Sequence[Answer]


def posed(scenario: str) -> PlanningProblem:
    """Return the first planning problem of a scenario."""
    return first_problem(resolve(read_document(scenario)).posed())


def measured(scenario: str, search: str, budget: int, seeds: int) -> Measured:
    """Solve a problem from several seeds."""
    problem = posed(scenario)
    named = "none" if search == HALVES else search
    settings = search_settings(named, Budget(evaluations=max(budget, 1)))
    planner = Planner(
        problem.problem, search=settings, polish=IpoptOptions(), family=problem.family
    )
    _answer(planner, problem, search, budget, seed=seeds)  # Loads machine code.
    answers = [_answer(planner, problem, search, budget, seed=s) for s in range(seeds)]
    return Measured(scenario, search, budget, answers)


def _answer(
    planner: Planner, problem: PlanningProblem, search: str, budget: int, seed: int
) -> Answer:
    rng, begin = np.random.default_rng(seed), time.process_time()
    x0, known, _ = planner.posed(problem.x0, problem.known)
    if search == HALVES:
        cost, violation, spent = _halves(planner, problem, budget, rng)
    else:
        plan = planner.plan(x0, known=known, rng=rng)
        cost, violation, spent = plan.cost, plan.violation, plan.evaluations
    seconds = time.process_time() - begin
    feasible = violation <= planner.problem.tolerance
    return Answer(cost if feasible else np.inf, spent, seconds)


def _halves(
    planner: Planner, problem: PlanningProblem, budget: int, rng: np.random.Generator
) -> tuple[float, float, int]:
    """Return cost, violation and evaluations of L-SHADE, CMA-ES and the polish."""
    space = space_of(planner.fitness, problem.family)
    x0, known, _ = planner.posed(problem.x0, problem.known)
    objective, polisher = space.objective(x0, known), planner.polisher
    if polisher is None:
        raise TypeError("expected a planner with a polish")
    tolerance = planner.problem.tolerance
    order, basins = default_order(tolerance), 0
    if planner.problem.free_starts:
        order, basins = traded_order(objective, space.box, rng), 3
    first = minimize(
        objective, space.box, algorithm="lshade", budget=budget // 2, rng=rng,
        order=order, basins=basins,
    )  # fmt: skip
    then = minimize(
        objective, space.box, algorithm="cma", budget=budget // 2, rng=rng,
        order=order, basins=basins, initial=Initial(points=first.x[:, None]),
    )  # fmt: skip
    points = [then.x, *(one.x for one in then.basins if (one.x != then.x).any())]
    starts = [space.decoded(x, x0, known) for x in points]
    found, evaluations = polish_basins(
        polisher, starts, x0, known, tolerance=tolerance, near=True
    )
    spent = first.evaluations + then.evaluations + evaluations
    return found.cost, found.violation, spent


def table(found: Sequence[Measured]) -> list[str]:
    """Return the table: a problem's searches below each other."""
    lines = head(
        "problem", "search", "budget", "hits", "median cost", "evaluations",
        "seconds of the process", "seconds a hit",
    )  # fmt: skip
    for one in found:
        same = [other for other in found if other.scenario == one.scenario]
        best = min(answer.cost for other in same for answer in other.answers)
        reach = best + SAME * abs(best)
        hits = sum(answer.cost <= reach for answer in one.answers)
        seconds = sum(answer.seconds for answer in one.answers)
        spent = statistics.median(answer.evaluations for answer in one.answers)
        lines.append(
            row(
                f"`{one.scenario}`",
                one.search,
                f"{one.budget:,}" if one.budget else "-",
                f"{hits} of {len(one.answers)}",
                f"{statistics.median(answer.cost for answer in one.answers):.7g}",
                f"{spent:,.0f}",
                f"{seconds / len(one.answers):.2f}",
                f"{seconds / hits:.2f}" if hits else "-",
            )
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="10 by default")
    parser.add_argument("--only", action="append", help="one scenario")
    options = parser.parse_args(arguments)
    found = []
    for scenario in options.only or SCENARIOS:
        for search, budget in SEARCHES:
            if scenario == SLOW and budget > MOST:
                continue
            found.append(measured(scenario, search, budget, options.seeds))
            print(table([one for one in found if one.scenario == scenario])[-1],
                  flush=True)  # fmt: skip
    publish(table(found), options, TEXT)
    return 0


TEXT = """# Searches that use local solves in lanes

Made by `python benchmarks/lane_searches.py --write docs/measured/lane_searches.md`.
Each search is followed by IPOPT from its best point, and from its best points in three
more [basins](../glossary.md#basin) if the end time, parameters or initial states are
optimised too, or if lanes are used. A hit is feasible, and within 1e-4 of the least
cost that any run found. Evaluations (median) include those of IPOPT and of local
solves, which count as [Local solves](../heuristics.md#local-solves) says; a batch of
lanes that has begun is finished, so a multistart with 2,000 evaluations solves one or
two starts. Seconds are CPU seconds of the process, in the mean over the runs, with
machine code loaded. Other work ran at the same time, so compare the seconds within a
problem only. "lshade, then cma" spends half of the budget on L-SHADE, and half on
CMA-ES from L-SHADE's best point; "none" is IPOPT from zero controls. `swap_5` searches
paths, for which there are no lanes: there the memetic search is L-SHADE, and the
multistart is IPOPT from random paths.

"""


if __name__ == "__main__":
    raise SystemExit(main())
