"""`solve` with one and with two threads, on the shipped problems that take longest.

    python benchmarks/threads.py [--write docs/measured/threads.md] [--rounds 5]

Seconds are wall time, of warm calls in turns: use it on a machine with two free cores.
"""

import statistics
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarmstart.benchmarks.kept_values import PROBLEMS
from swarmstart.benchmarks.lanes import Posed, shipped
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.ocp import Solution, solve

SLOWEST, ASKED = 5, 1.5
TEXT = """# Two threads

Made by `python benchmarks/threads.py --write docs/measured/threads.md`: `solve` with
`threads=1` and `threads=2` in turns, on the five shipped scenarios of `kind: problem`
whose warm call takes longest. Seconds are wall time on two cores. "Times as fast" is
the median, over pairs of calls, of the time with one thread divided by that with two.
Of the time with one thread, "polishes" is the part of the NLP solver, for all starts
together, and "search" the part of the population search. The answers with one and with
two threads have the same bits.

"""


class Timed(NamedTuple):
    """Wall times of the calls of one problem, and its last answer with one thread."""

    name: str
    seconds: dict[int, list[float]]
    answer: Solution

    @property
    def ratios(self) -> list[float]:
        """Time with one thread over that with two, of each pair."""
        one, two = self.seconds[1], self.seconds[2]
        return [a / b for a, b in zip(one, two, strict=True)]


def called(posed: Posed, threads: int) -> tuple[float, Solution]:
    """Return the wall time of a call, and its answer."""
    begin = time.perf_counter()
    found = solve(
        posed.problem, posed.x0, known=posed.known, seed=0, threads=threads,
        progress=False,
    )  # fmt: skip
    return time.perf_counter() - begin, found


def compared(posed: Posed, rounds: int) -> Timed:
    """Return the times of a problem's calls, after one of each that is not counted.

    Raises:
        ArithmeticError: If the answers differ.
    """
    seconds: dict[int, list[float]] = {1: [], 2: []}
    found: dict[int, Solution] = {}
    for number in range(rounds + 1):
        for threads, each in seconds.items():
            took, found[threads] = called(posed, threads)
            if number:
                each.append(took)
    if not np.array_equal(found[1].controls, found[2].controls):
        raise ArithmeticError(f"answers differ: {posed.name}")
    return Timed(posed.name, seconds, found[1])


def slowest(names: Sequence[str]) -> list[Posed]:
    """Return the problems whose second call takes longest, the longest first."""
    took = {}
    for name in names:
        posed = shipped(name)
        called(posed, 1)
        took[name] = called(posed, 1)[0]
        print(f"{name}: {took[name]:.2f} s", flush=True)
    return [shipped(name) for name in sorted(names, key=lambda n: -took[n])[:SLOWEST]]


def line(one: Timed) -> str:
    """Return the row of a problem."""
    account = one.answer.plan.starts
    polishes = sum(tried.seconds for tried in account.tried) if account else 0.0
    search = account.search.seconds if account and account.search else 0.0
    first, second = (statistics.median(one.seconds[n]) for n in (1, 2))
    low, middle, high = np.percentile(one.ratios, [25, 50, 75])
    return row(
        one.name, f"{first:.2f}", f"{polishes:.2f}", f"{search:.2f}", f"{second:.2f}",
        f"{middle:.2f}", f"{low:.2f} to {high:.2f}",
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="pairs of calls")
    options = parser.parse_args(arguments)
    found = [
        compared(posed, options.rounds)
        for posed in slowest([*PROBLEMS, "double_pendulum", "stirred_tank"])
    ]
    lines = head("problem", "one thread [s]", "polishes [s]", "search [s]",
                 "two threads [s]", "times as fast", "quartiles")  # fmt: skip
    lines += map(line, found)
    each = [float(np.median(one.ratios)) for one in found]
    told = f"the five slowest problems, median of {min(each):.2f} to {max(each):.2f}"
    bars = [Bar(told, ">=", ASKED, statistics.median(each))]
    publish([*lines, "", *bar_table(bars)], options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
