"""Whole searches against those of SciPy, pygmo and IPOPT, as ratios from one run.

python benchmarks/search.py [--short] [--write docs/measured/search_speed.md]
"""

import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence

from swarmstart.benchmarks.problems import one_uav, reactor
from swarmstart.benchmarks.searches import (
    FULL,
    IPOPT,
    OURS,
    PYGMO,
    SCENARIO,
    SHORT,
    Case,
    Effort,
    Parts,
    Row,
    Step,
    box_of,
    evolution_case,
    measure_case,
    measure_step,
    scenario_search,
    shorter_uav,
    swarm_case,
    task_of,
)
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.benchmarks.timing import Timing
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.search.settings import population_of

FASTER = "How many times faster ours is; skipped: pygmo is not installed here."
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


def measure(effort: Effort) -> tuple[list[str], list[Bar]]:
    """Run everything; return the tables and the bars. Called in a worker process."""
    settings = scenario_search()
    swarm, evaluations = one_uav(), settings.budget.evaluations or 0
    algorithm = population_of(settings.algorithm)
    if algorithm is None:
        raise TypeError("expected a population search")
    size = algorithm.first_size(box_of(swarm), evaluations)
    swarm_task = task_of(swarm, size, evaluations // size)
    cases = [
        evolution_case("A1.", task_of(one_uav(), 20, 200)),
        evolution_case("A2.", task_of(shorter_uav(5), 100, 100)),
        # Nearly all of its time is rollouts, which SciPy's search makes with ours too.
        evolution_case("A3.", task_of(reactor(intervals=10), 100, 100))._replace(
            bars={PYGMO: 5}
        ),
        swarm_case("B.", swarm_task, algorithm),
    ]
    lines, bars, parts = list[str](), list[Bar](), dict[str, Parts]()
    for case in cases:
        rows, parts[case.title] = measure_case(case, effort)
        lines += _case_table(case, rows)
        bars += [_bar(case, rows, rival) for rival in case.bars]
    step = measure_step(settings, effort)
    ratio = step[IPOPT].timing.median / step[OURS].timing.median
    dearer = 100 * (step[OURS].cost / step[IPOPT].cost - 1)
    text = f"D. A step of {SCENARIO}, against IPOPT, at {dearer:.1f} % more cost"
    bars.append(Bar(text, ">", 1, ratio))
    lines += [*_parts_table(parts), *_step_table(step), *bar_table(bars), FASTER]
    return lines, bars


def _bar(case: Case, rows: Mapping[str, Row], rival: str) -> Bar:
    one = rows.get(rival)
    measured = one and one.timing.median / rows[OURS].timing.median
    how = " with CasADi" if rival == PYGMO else ""
    return Bar(f"{case.title}, against {rival}{how}", ">", case.bars[rival], measured)


def _case_table(case: Case, rows: Mapping[str, Row]) -> list[str]:
    first = rows[OURS].timing.median
    lines = [
        f"## {case.title}",
        "",
        *head("contestant", "ms", "times ours", "evaluations", "best cost"),
    ]
    lines += [
        row(
            name,
            _ms(one.timing),
            f"{one.timing.median / first:.1f}",
            str(one.evaluations),
            f"{one.cost:.6g}",
        )
        for name, one in rows.items()
    ]
    return [*lines, ""]


def _parts_table(parts: Mapping[str, Parts]) -> list[str]:
    lines = [
        "## C. Where the time of our search goes",
        "",
        "Each part is measured alone: as many calls of the machine code on as many",
        "individuals, and as many random numbers. The rest is what is left of the",
        "search: the algorithm's own work, and Python before and after the loop. SciPy",
        "in A evaluates with the same machine code: where rollouts take most of our",
        "time, no loop can be many times faster than SciPy's.",
        "",
        *head("search", "ms", "rollouts", "random numbers", "the rest"),
    ]
    for title, part in parts.items():
        shares = [p.median / part.total.median for p in (part.rollouts, part.draws)]
        shares.append(1 - sum(shares))
        lines.append(
            row(title, _ms(part.total), *(f"{100 * share:.0f} %" for share in shares))
        )
    return [*lines, ""]


def _step_table(step: Mapping[str, Step]) -> list[str]:
    first = step[OURS].timing.median
    lines = [
        f"## D. The five plans of the first step of {SCENARIO}",
        "",
        "Variant corrected. Ours: chaotic particle swarm, 4,000 evaluations a plan,",
        "from random controls, since there is no last plan yet. IPOPT: to 1e-8, from",
        "zero controls. Planners are built before the clock runs. Both plan the same",
        "five problems: who plans later avoids the same plans of the others.",
        "",
        *head("planner", "ms", "times ours", "sum of costs", "violation", "feasible"),
    ]
    for name, plans in step.items():
        converged = sum(s is PolishStatus.CONVERGED for s in plans.statuses)
        solved = f" ({converged} converged)" if plans.statuses else ""
        lines.append(
            row(
                name + solved,
                _ms(plans.timing),
                f"{plans.timing.median / first:.1f}",
                f"{plans.cost:.6g}",
                f"{plans.violation:.2g}",
                f"{plans.feasible:.3g} of 5",
            )
        )
    return [*lines, ""]


def _ms(timing: Timing) -> str:
    """Return median and quartiles in ms."""
    median, lower, upper = (f"{1e3 * seconds:.3g}" for seconds in timing)
    return f"{median} ({lower} to {upper})"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--short", action="store_true", help="fewer rounds")
    options = parser.parse_args(arguments)
    for variable in THREADS:
        os.environ.setdefault(variable, "1")

    effort = SHORT if options.short else FULL
    # Libraries read the number of threads when they are loaded: in a new process.
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        lines, bars = pool.apply(measure, (effort,))
    publish(lines, options, _HEAD.format(**effort._asdict()))
    return 3 if any(bar.is_missed for bar in bars) else 0


_HEAD = """# How long whole searches take

Made by `python benchmarks/search.py`. One core. All contestants of a table take turns,
{rounds} rounds in all; the numbers are medians (and quartiles) of the wall time of one
search, each with another seed. Parts that are built once for a problem are built before
the clock runs. All minimise cost + 1e4 violation with the same number of evaluations;
the best cost is the median over {seeds} seeds. In the tables A1 to A3 all run
DE/rand/1/bin with F = 0.7 and CR = 0.7, with different rules at the bounds. SciPy
evaluates whole generations with our evaluator. pygmo's DE evaluates one individual at a
time with CasADi, since it never asks for a whole generation; so its row measures search
and evaluator together. In table B the swarm has the settings of the formation flight;
pygmo's PSO is another algorithm with its own settings, with either evaluator, shown for
information.

"""


if __name__ == "__main__":
    sys.exit(main())
