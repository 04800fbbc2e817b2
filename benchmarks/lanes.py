"""Local solves in lanes against IPOPT from the same starts, in one run.

    python benchmarks/lanes.py [--write docs/measured/lanes.md]
        [--plot docs/measured/lanes.png]
        [--starts 256] [--solves 24] [--only NAME]

Seconds are CPU time of the process, so that other processes matter little. Only the
gain of a second thread is wall time, and needs two idle cores.
"""

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.benchmarks.kept_values import PROBLEMS
from swarmstart.benchmarks.problems import Instance, passing
from swarmstart.benchmarks.tables import head, illustrated, page_options, publish, row
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.ocp import (
    InvalidProblemError,
    IpoptOptions,
    Known,
    OptimalControlProblem,
    Planner,
)
from swarmstart.ocp.lanes.answers import (
    FEASIBLE,
    LaneAnswers,
    distinct_optima,
    unseen_share,
)
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.rollout.fitness import started

SAME = 1e-4
"""Relative distance of costs that count as one optimum for both."""
ITERATIONS = 500
TEXT = """# Local solves in lanes

Made by `python benchmarks/lanes.py --write docs/measured/lanes.md --plot
docs/measured/lanes.png`. Each problem is solved from the same smooth random starts
([Many starts](../answers.md#many-starts)), all at once in lanes on one core, and a few
of them one after another by IPOPT, at most 500 iterations each: on the faster of two
NLPs, one with machine code for the functions of an interval ("mapped"), one with all
functions expanded. Seconds are CPU seconds. A lane takes at most 300 steps. A solve
counts as feasible if its violation in the scaled numbers of the NLP is at most 1e-6;
"best" is the share of solves within 1e-4 of the cheapest optimum that lanes or IPOPT
found. "Warm" is the number of iterations of IPOPT from the best optimum of the lanes,
and the relative change of its cost. "Not seen" is Good's estimate of the share of
further random starts that would end in a new optimum, with the upper end of its
interval ([The share of optima not seen](unseen_share.md)). "Two threads" is the speed
of two threads relative to one, by the clock, with the same answers; it is lower if all
lanes together take few milliseconds.

Made on another machine, `ratio` may differ by 80 %. Other columns may differ by a
percentage of the value or by a fixed amount, whichever is larger: `feasible` by 0 % or
0.05, `best cost` by 0.01 % or 0, `best` by 0 % or 0.1 and `optima` by 20 % or 2.

In the rows without lanes, "its steps are too long" means that the machine code of a
solver's sweep over an interval would have more instructions than are compiled. A sweep
has at least 8 times as many instructions as the functions of an interval, so these are
counted first. If they have more than an eighth of the limit, the problem is refused
before the sweep is derived, and the row states this smaller limit.

"""


class Posed(NamedTuple):
    """A problem from one initial state."""

    name: str
    problem: OptimalControlProblem
    x0: ArrayLike
    known: Known


class Compared(NamedTuple):
    """Results of lanes and of IPOPT from the same starts.

    Attributes:
        lane_ms: Time of one lane [ms].
        ipopt_ms: Time of one solve by IPOPT, on the faster of its NLPs [ms].
        nlp: Name of that NLP.
        feasible: Share of feasible lanes.
        ipopt_feasible: Share of IPOPT's feasible answers.
        best: Cost of the cheapest optimum.
        lane_hits: Share of the lanes that found it.
        ipopt_hits: Share of IPOPT's answers.
        optima: Number of distinct optima of the lanes.
        unseen: Estimated share of unseen optima, and its upper limit.
        warm: Iterations of IPOPT from the best optimum of the lanes, and the relative
            change of its cost.
        threads: Speed of two threads relative to one.
    """

    lane_ms: float
    ipopt_ms: float
    nlp: str
    feasible: float
    ipopt_feasible: float
    best: float
    lane_hits: float
    ipopt_hits: float
    optima: int
    unseen: tuple[float, float]
    warm: tuple[int, float]
    threads: float


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
    """Return the results of both; or a text, the reason why there are no lanes.

    Args:
        posed: The problem.
        starts: Number of lanes.
        solves: Number of them that IPOPT solves too.
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
    solver(x0, *few, known=known)  # Not the first call.
    begin = time.process_time()
    answers = solver(x0, controls, decided, known=known)
    lane_s = (time.process_time() - begin) / starts
    nlps = {"mapped": planner, "expanded": _expanded(planner)}
    spent, costs = dict[str, float](), dict[str, list[float]]()
    for name, one in nlps.items():
        begin = time.process_time()
        costs[name] = [
            _polished(one, x0, known, controls, decided, i) for i in range(solves)
        ]
        spent[name] = (time.process_time() - begin) / solves
    nlp = min(spent, key=lambda name: spent[name])
    ipopt_s, costs_of = spent[nlp], costs[nlp]
    optima = distinct_optima(answers)
    ok = answers.violation <= FEASIBLE
    best = min([*costs_of, *(one.cost for one in optima), np.inf])
    reach = SAME * max(abs(best), 1e-12)
    unseen = unseen_share([one.count for one in optima])
    return Compared(
        lane_ms=1e3 * lane_s,
        ipopt_ms=1e3 * ipopt_s,
        nlp=nlp,
        feasible=float(ok.mean()),
        ipopt_feasible=float(np.mean(np.isfinite(costs_of))),
        best=best,
        lane_hits=float(np.mean(ok & (answers.cost <= best + reach))),
        ipopt_hits=float(np.mean(np.array(costs_of) <= best + reach)),
        optima=len(optima),
        unseen=(unseen.share, unseen.most),
        warm=_warm(planner, x0, known, answers, [one.lane for one in optima[:1]]),
        threads=_two_threads(planner, x0, known, controls, decided),
    )


def _expanded(planner: Planner) -> Planner:
    """Return a planner whose NLP is expanded to scalar operations."""
    polisher = planner.polisher
    if polisher is None:
        raise TypeError("expected a planner with a polish")
    options = IpoptOptions(max_iterations=ITERATIONS).settings(near=False)
    quiet = {"print_time": False, "error_on_fail": False, "calc_lam_p": False}
    # Machine code cannot be expanded.
    again = Planner(
        planner.stated,
        search=None,
        polish=IpoptOptions(max_iterations=ITERATIONS),
        backend="casadi",
    )
    polishing = again.polisher
    polishing.prepare()  # type: ignore[union-attr]
    built = polishing.solvers.built  # type: ignore[union-attr]
    for steps, one in built.items():
        far = ca.nlpsol(
            "far", "ipopt", one.program.nlp, {"expand": True, **quiet, **options}
        )
        built[steps] = one._replace(far=partial(_same, far))
    return again


def _same(solver: ca.Function, is_observed: bool) -> ca.Function:
    """Return a solver, whether its iterates are observed or not."""
    del is_observed
    return solver


def _warm(
    planner: Planner,
    x0: ArrayLike,
    known: Known,
    answers: LaneAnswers,
    lanes: Sequence[int],
) -> tuple[int, float]:
    """Return the most iterations of IPOPT from lanes, and the change by them."""
    if planner.polisher is None:
        raise TypeError("expected a planner with a polish")
    iterations, change = 0, 0.0
    state = np.asarray(x0, dtype=np.float64).ravel()
    for lane in lanes:
        start = started(planner.problem, state, answers.starts[:, lane])
        found = planner.polisher(answers.controls[:, :, lane], start, known, near=True)
        iterations = max(iterations, found.iterations)
        size = max(abs(found.cost), 1e-12)
        change = max(change, abs(found.cost - float(answers.cost[lane])) / size)
    return iterations, change


def _two_threads(
    planner: Planner, x0: ArrayLike, known: Known, controls: Array, decided: Array
) -> float:
    """Return how many times faster two threads solve lanes than one.

    Raises:
        RuntimeError: If their answers differ.
    """
    taken, found = list[float](), list[LaneAnswers]()
    for threads in (1, 2):
        solver = LaneSolver(planner.fitness.shooting, threads=threads)
        seconds = []
        for _ in range(3):
            begin = time.perf_counter()
            answers = solver(x0, controls, decided, known=known)
            seconds.append(time.perf_counter() - begin)
        taken.append(min(seconds))
        found.append(answers)
    if not np.array_equal(found[0].controls, found[1].controls, equal_nan=True):
        raise RuntimeError("expected the same answers on two threads")
    return taken[0] / taken[1]


def _polished(
    planner: Planner,
    x0: ArrayLike,
    known: Known,
    controls: Array,
    decided: Array,
    number: int,
) -> float:
    """Return IPOPT's cost from one of the starts; infinite if it is infeasible."""
    if planner.polisher is None:
        raise TypeError("expected a planner with a polish")
    start = started(planner.problem, x0, decided[:, number])
    try:
        found = planner.polisher(controls[:, :, number], start, known)
    except InvalidProblemError:
        return np.inf
    return found.cost if found.violation <= planner.problem.tolerance else np.inf


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare all problems, print the table, and write it where asked."""
    parser = page_options(__doc__, plots=True)
    parser.add_argument("--starts", type=int, default=256, help="lanes")
    parser.add_argument("--solves", type=int, default=24, help="by IPOPT")
    parser.add_argument("--only", action="append", help="one problem")
    options = parser.parse_args(arguments)
    lines = [
        *head("problem", "ms a lane", "ms by IPOPT", "NLP", "ratio",
              "feasible", "IPOPT's", "best cost", "best", "IPOPT's", "optima",
              "not seen", "warm", "two threads"),
    ]  # fmt: skip
    ratios = dict[str, float]()
    wanted = options.only or [*PROBLEMS, "passing"]
    for name in wanted:
        posed = of_instance(passing()) if name == "passing" else shipped(name)
        found = compared(posed, options.starts, options.solves)
        if isinstance(found, str):
            lines.append(row(name, f"none: {found}", *[""] * 12))
        else:
            ratios[name] = found.ipopt_ms / found.lane_ms
            lines.append(_row_of(name, found))
        print(lines[-1], flush=True)
    middle = float(np.median(list(ratios.values())))
    lines += ["", f"Median of the ratios: {middle:.0f}."]
    caption = "How many times faster lanes are"
    lines = illustrated(lines, options, caption, lambda path: plot(ratios, path))
    publish(lines, options, TEXT)
    return 0


def _row_of(name: str, found: Compared) -> str:
    share, most = found.unseen
    unseen = f"{share:.2f}, at most {most:.2f}"
    return row(
        name, f"{found.lane_ms:.2f}", f"{found.ipopt_ms:.1f}",
        found.nlp, f"{found.ipopt_ms / found.lane_ms:.0f}", f"{found.feasible:.2f}",
        f"{found.ipopt_feasible:.2f}", f"{found.best:.7g}", f"{found.lane_hits:.2f}",
        f"{found.ipopt_hits:.2f}", str(found.optima), unseen,
        f"{found.warm[0]}, {found.warm[1]:.0e}", f"{found.threads:.2f}",
    )  # fmt: skip


def plot(ratios: Mapping[str, float], path: Path) -> None:
    """Draw how many times faster a lane is than IPOPT, the largest above."""
    names = sorted(ratios, key=lambda name: ratios[name])
    figure = Figure(figsize=(8, 0.3 * len(names) + 1.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    values = [ratios[name] for name in names]
    bars = axes.barh([name.replace("_", " ") for name in names], values)
    axes.bar_label(bars, [f"{value:.0f}" for value in values], padding=3)
    middle = float(np.median(values))
    axes.axvline(
        middle, color="black", linestyle="--", linewidth=1, label=f"median {middle:.0f}"
    )
    axes.legend(loc="lower right")
    axes.set_xscale("log")
    axes.set(xlabel="time of one solve by IPOPT / time of one lane, one core")
    axes.set_xlim(1.0, 2.0 * max(values))
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    raise SystemExit(main())
