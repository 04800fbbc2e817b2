"""Local solves in lanes against IPOPT from the same starts, in one run.

    python benchmarks/lanes.py [--write docs/lanes.md] [--starts 256] [--only NAME]

Seconds are those of the process, so that what else the machine does counts for little.
"""

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.benchmarks.kept_values import PROBLEMS
from swarmstart.benchmarks.problems import Instance, passing
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.scenario import ProblemScenario
from swarmstart.ocp import (
    InvalidProblemError,
    IpoptOptions,
    Known,
    OptimalControlProblem,
    Planner,
)
from swarmstart.ocp.lanes.optima import FEASIBLE, distinct_optima, unseen_share
from swarmstart.ocp.lanes.solver import LaneSolver, NoLanesError, random_starts

Array = NDArray[np.float64]
SAME = 1e-4
"""Relative distance of costs that count as one optimum for both."""
ITERATIONS = 500
TEXT = """# Local solves in lanes

Made by `python benchmarks/lanes.py --write docs/lanes.md`. Each problem is solved from
the same smooth random starts ([answers](answers.md#many-starts)), all at once in lanes
on one core, and a few of them one after the other by IPOPT on the problem's own NLP, at
most 500 iterations each. Seconds are those of the process. "Sweeps" are second-order,
"slopes" gradients, for stages that are too long for sweeps. A lane of sweeps takes at
most 500 steps; one that ends without having met its limits begins once more, which is
in its time. A solve counts as feasible
to 1e-6 in the NLP's numbers near one; "best" is the share of solves within 1e-4 of the
cheapest optimum that either found. The last column is Good's estimate of the share of
such starts that would end in an optimum not seen yet, with the end of its interval.

"""


class Posed(NamedTuple):
    """A problem from one initial state."""

    name: str
    problem: OptimalControlProblem
    x0: ArrayLike
    known: Known


class Compared(NamedTuple):
    """What lanes and IPOPT made of the same starts.

    Attributes:
        method: How the lanes are solved.
        lane_ms: Of one lane [ms].
        ipopt_ms: Of one solve by IPOPT [ms].
        feasible: Share of the lanes that are.
        ipopt_feasible: Share of IPOPT's answers that are.
        best: Cost of the cheapest optimum.
        lane_hits: Share of the lanes that found it.
        ipopt_hits: Share of IPOPT's answers.
        optima: Number of distinct optima of the lanes.
        unseen: Share that was not seen, and the most that it may be.
    """

    method: str
    lane_ms: float
    ipopt_ms: float
    feasible: float
    ipopt_feasible: float
    best: float
    lane_hits: float
    ipopt_hits: float
    optima: int
    unseen: tuple[float, float]


def shipped(name: str) -> Posed:
    """Return a shipped problem."""
    scenario = resolve(read_document(name)).scenario
    if not isinstance(scenario, ProblemScenario):
        raise TypeError(f"expected a scenario of kind: problem, found {name}")
    first = first_problem(pose(scenario))
    return Posed(name, first.problem, first.x0, first.known)


def of_instance(instance: Instance) -> Posed:
    """Return one of the benchmarks' own problems."""
    return Posed(instance.name, instance.problem, instance.x0, instance.known)


def compared(posed: Posed, starts: int, solves: int) -> Compared | str:
    """Return what both made of the same starts; a text: why there are no lanes.

    Args:
        posed: The problem.
        starts: Number of lanes.
        solves: Number of them that IPOPT solves, too.
    """
    planner = Planner(
        posed.problem, search=None, polish=IpoptOptions(max_iterations=ITERATIONS)
    )
    try:
        solver = LaneSolver(planner.fitness.shooting)
    except NoLanesError as error:
        return str(error)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    controls, decided = random_starts(solver.problem, starts, np.random.default_rng(0))
    few = controls[:, :, :8], decided[:, :8]
    solver(x0, *few, known=known, rng=np.random.default_rng(1))  # Not the first call.
    begin = time.process_time()
    answers = solver(x0, controls, decided, known=known, rng=np.random.default_rng(1))
    lane_s = (time.process_time() - begin) / starts
    begin = time.process_time()
    costs = [_polished(planner, x0, known, controls, decided, i) for i in range(solves)]
    ipopt_s = (time.process_time() - begin) / solves
    optima = distinct_optima(answers)
    ok = answers.violation <= FEASIBLE
    best = min([*costs, *(one.cost for one in optima), np.inf])
    reach = SAME * max(abs(best), 1e-12)
    unseen = unseen_share([one.count for one in optima])
    return Compared(
        method=solver.method,
        lane_ms=1e3 * lane_s,
        ipopt_ms=1e3 * ipopt_s,
        feasible=float(ok.mean()),
        ipopt_feasible=float(np.mean(np.isfinite(costs))),
        best=best,
        lane_hits=float(np.mean(ok & (answers.cost <= best + reach))),
        ipopt_hits=float(np.mean(np.array(costs) <= best + reach)),
        optima=len(optima),
        unseen=(unseen.share, unseen.most),
    )


def _polished(
    planner: Planner,
    x0: ArrayLike,
    known: Known,
    controls: Array,
    decided: Array,
    number: int,
) -> float:
    """Return IPOPT's cost from one of the starts; infinite where it is infeasible."""
    if planner.polisher is None:
        raise TypeError("expected a planner with a polish")
    start = np.array(x0, dtype=np.float64).ravel()
    for value, one in zip(decided[:, number], planner.problem.free_starts, strict=True):
        start[list(one.states)] = value
    try:
        found = planner.polisher(controls[:, :, number], start, known)
    except InvalidProblemError:
        return np.inf
    return found.cost if found.violation <= planner.problem.tolerance else np.inf


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare all problems, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--starts", type=int, default=256, help="lanes")
    parser.add_argument("--solves", type=int, default=24, help="by IPOPT")
    parser.add_argument("--only", action="append", help="one problem")
    options = parser.parse_args(arguments)
    lines = [
        *head("problem", "method", "ms a lane", "ms by IPOPT", "ratio", "feasible",
              "IPOPT's", "best cost", "best", "IPOPT's", "optima", "not seen"),
    ]  # fmt: skip
    ratios = []
    wanted = options.only or [*PROBLEMS, "passing"]
    for name in wanted:
        posed = of_instance(passing()) if name == "passing" else shipped(name)
        found = compared(posed, options.starts, options.solves)
        if isinstance(found, str):
            lines.append(row(name, f"none: {found}", *[""] * 10))
        else:
            ratios.append(found.ipopt_ms / found.lane_ms)
            lines.append(_row_of(name, found))
        print(lines[-1], flush=True)
    lines += ["", f"Median of the ratios: {np.median(ratios):.0f}."]
    publish(lines, options, TEXT)
    return 0


def _row_of(name: str, found: Compared) -> str:
    share, most = found.unseen
    unseen = f"{share:.2f}, at most {most:.2f}"
    return row(
        name, found.method, f"{found.lane_ms:.2f}", f"{found.ipopt_ms:.1f}",
        f"{found.ipopt_ms / found.lane_ms:.0f}", f"{found.feasible:.2f}",
        f"{found.ipopt_feasible:.2f}", f"{found.best:.7g}", f"{found.lane_hits:.2f}",
        f"{found.ipopt_hits:.2f}", str(found.optima), unseen,
    )  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
