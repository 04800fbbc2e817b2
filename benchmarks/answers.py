"""Answers of `solve` on every shipped problem, and how long they take, measured.

    python benchmarks/answers.py [--write docs/measured/answers_measured.md]
        [--only NAME]
        [--seeds 20] [--lanes N] [--short] [--out results/answers]

Every run is a line of OUT/runs.jsonl. Finished runs are not repeated, so a measurement
that was stopped can be continued; the page is made of all finished runs. It takes about
twenty minutes on an idle machine. A new state of the code needs a new folder.
"""

import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from swarmstart.benchmarks.answer_races import (
    SOONER,
    SURE,
    Raced,
    raced,
)
from swarmstart.benchmarks.answer_runs import (
    Amount,
    Log,
    Run,
    What,
    missing,
    shipped,
    wanted,
)
from swarmstart.benchmarks.kept_values import PROBLEMS, Kept
from swarmstart.benchmarks.kept_values import read as kept_values
from swarmstart.benchmarks.shipped_problems import WITHIN
from swarmstart.benchmarks.tables import head, page_options, publish, row

SHORT = Amount(
    seeds=2, most_seeds=2, solve_s=0, starts=3, most_starts=10, ipopt_s=1,
    repaired_s=0, longest_s=0,
)  # fmt: skip
SAME = 1e-6
"""Relative difference of costs that counts as rounding."""
LONGEST, TIMES_COLD = 5.0, 3.0
"""A solve must end within this many seconds, or this many times a cold solve's time."""
TEXT = """# How often the best answer is found

Made by `python benchmarks/answers.py --write docs/measured/answers_measured.md`:
`solve` with its defaults{lanes}, from several seeds, on every shipped problem. Seconds
are CPU seconds of the process on all cores, in brackets wall seconds. They are those of
whole calls, with posing and verifying. The first call of a process makes machine code,
or loads it from disk, and is not among them; "code s" has the most seconds that this
took. "Cold" is a whole call of IPOPT alone from zero controls.

- A seed hits if its answer is feasible and costs at most 1e-4 more, relative, than the
  best known at the problem's checks (`docs/measured/kept_values.json`). "Along the
  path" counts confirmed answers that also keep the constraints between the checks and
  cost at most 1e-4 more than the best such answer known; with `repair=True` if a seed's
  answer breaks a constraint there.
- "Worse" is the number of seeds whose answer costs more, by over 1e-6 relative, than
  the best of these: IPOPT from zero controls, from the middle of the bounds (if that is
  not zero), from the guess in the problem's file, and the best feasible start among
  those that this call of `solve` tried.
- "5 s or 3 cold" says whether the slowest call ("s, most") takes at most 5 s or three
  times "cold s".
- If the column "lanes" begins with "none", it gives the reason why the problem cannot
  be solved in [lanes](../glossary.md#lane). "Too long" means that the machine code of
  an interval would have too many instructions.

"""
RACE_TEXT = """
## Seconds until the best optimum is found with 95 % probability

With p the share of starts that hit and t their mean seconds: t max(1, log(0.05) /
log(1 - p)). IPOPT solves from the smooth random controls from which the
[lanes](../glossary.md#lane) start, one after another with the same solver. Only the
wall seconds of solving count. For `solve` these are the seconds of the cold starts, the
search, the lanes and the polish until the best answer was found
(`solution.plan.starts.found_after`). Posing, verifying and machine code are in the
table above only. If no start hits, p is the largest value with which that happens in 5
% of all cases, and the seconds are a lower bound: those of all starts. The brackets are
90 % bootstrap intervals, from 2,000 samples of the runs with replacement.

The [bars](../glossary.md#bar): {sooner} times less time if IPOPT hits in less than 30 %
of its starts; not slower on the other problems with several optima (feasible answers of
IPOPT's starts differ by more than 1e-4); with a single optimum, at most 0.2 s plus
1.3 times the time of IPOPT's solver from zero controls.

"""


def is_hit(run: Run, value: float, sense: float) -> bool:
    """Return whether a run found the best known cost, or a better one.

    Args:
        run: The run.
        value: The best known cost, as the problem states it.
        sense: -1 if costs are gains.
    """
    return run.feasible and sense * (run.cost - value) <= WITHIN * abs(value)


def worse(answers: Iterable[Run], others: Sequence[Run], sense: float) -> int:
    """Return the number of answers that are worse than a simpler solve.

    Args:
        answers: Answers of `solve`.
        others: Solves from other starts.
        sense: -1 if costs are gains.
    """
    number = 0
    feasible = [run.cost for run in others if run.feasible]
    for run in answers:
        known = [sense * cost for cost in (*feasible, *run.tried.values())]
        least = min(known, default=np.inf)
        within = least + SAME * abs(least) if known else np.inf
        number += bool(known) and not (run.feasible and sense * run.cost <= within)
    return number


def answers_row(name: str, log: Log, lanes: int | None, value: Kept) -> str:
    """Return what is measured of the answers of a problem."""
    answers = log.of(name, "answer", lanes)
    repaired = log.of(name, "repaired", lanes) or answers
    sense = shipped(name, lanes).problem.sense
    cold = np.median([run.process_s for run in log.of(name, "cold", lanes)])
    seconds = np.array([run.process_s for run in answers])
    wall = np.array([run.wall_s for run in answers])
    at_checks = sum(is_hit(run, value.at_checks, sense) for run in answers)
    along = [run.confirmed and is_hit(run, value.along_path, sense) for run in repaired]
    simpler: tuple[What, ...] = ("zero", "middle", "guess")
    others = [run for what in simpler for run in log.of(name, what, lanes)]
    costs = [sense * run.cost for run in answers if run.feasible]
    most = max(LONGEST, TIMES_COLD * float(cold))
    return row(
        f"`{name}`",
        _lanes(answers),
        f"{value.at_checks:.7g}",
        f"{sense * min(costs):.7g}" if costs else "-",
        f"{at_checks} of {len(answers)}",
        f"{sum(along)} of {len(repaired)}",
        f"{worse(answers, others, sense)}",
        f"{np.median(seconds):.2f} ({np.median(wall):.2f})",
        f"{seconds.max():.2f} ({wall.max():.2f})",
        f"{cold:.2f}",
        "yes" if seconds.max() <= most else "**no**",
        f"{max(run.code_s for run in log.of(name, 'first', lanes)):.2f}",
    )


def _lanes(answers: Sequence[Run]) -> str:
    """Return what is said of lanes."""
    if answers[0].without_lanes:
        return f"none: {answers[0].without_lanes}"
    return "yes" if answers[0].won else "not asked for"


def race_row(name: str, found: Raced) -> str:
    """Return the race of a problem."""
    return row(
        f"`{name}`",
        f"{found.ipopt.runs}",
        f"{found.ipopt.share:.2f}",
        f"{found.ipopt.mean_s:.3f}",
        found.ipopt.told,
        f"{found.solve.share:.2f}",
        f"{found.solve.mean_s:.3f}",
        found.solve.told,
        found.told,
        found.asked,
        "yes" if found.reached else "**no**",
    )


def page(names: Iterable[str], log: Log, lanes: int | None) -> list[str]:
    """Return both tables, of the problems whose runs are there."""
    values = kept_values()
    rows, races = list[str](), list[str]()
    for name in names:
        answers, starts = log.of(name, "answer", lanes), log.of(name, "ipopt", lanes)
        cold = log.of(name, "cold", lanes)
        if not (answers and starts and cold and log.of(name, "first", lanes)):
            continue
        rows.append(answers_row(name, log, lanes, values[name]))
        sense, value = shipped(name, lanes).problem.sense, values[name].at_checks
        hits = [[is_hit(run, value, sense) for run in runs] for runs in
                (starts, answers)]  # fmt: skip
        races.append(race_row(name, raced(starts, hits[0], answers, hits[1])))
    return [
        *head("problem", "lanes", "best known", "best found", "hits",
              "along the path", "worse", "s, median", "s, most", "cold s",
              f"{LONGEST:g} s or {TIMES_COLD:g} cold", "code s"),
        *rows,
        *RACE_TEXT.format(sooner=SOONER).splitlines(),
        *head("problem", "starts of IPOPT", "hits", "s each",
              f"s until {SURE:.0%}", "`solve` hits", "s each", f"s until {SURE:.0%}",
              "times less", "asked for", "reached"),
        *races,
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, print the tables, and write them where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--only", action="append", help="one problem")
    parser.add_argument("--seeds", type=int, default=20, help="of solve, at least")
    parser.add_argument("--lanes", type=int, help="of solve; its default unless given")
    parser.add_argument("--short", action="store_true", help="a few runs of each")
    parser.add_argument("--out", type=Path, default=Path("results/answers"))
    options = parser.parse_args(arguments)
    log, values = Log(options.out / "runs.jsonl"), kept_values()
    amount = Amount(seeds=options.seeds, most_seeds=max(30, options.seeds))
    names = options.only or PROBLEMS
    for name in names:
        one = shipped(name, options.lanes)
        found = partial(is_hit, value=values[name].at_checks, sense=one.problem.sense)
        runs = wanted(one, log, SHORT if options.short else amount, found)
        for run in missing(one, log, runs):
            log.add(run)
            print(
                f"{run.problem} {run.what} {run.number}: {run.cost:.7g}, "
                f"{run.process_s:.2f} s",
                file=sys.stderr,
                flush=True,
            )
    said = "" if options.lanes is None else f" but `lanes={options.lanes}`"
    lines = page(names, log, options.lanes)
    publish(lines, options, TEXT.format(lanes=said))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
