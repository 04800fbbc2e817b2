"""Proven lower bounds of the named problems: gap, degree, set, slack, boxes, seconds.

    python benchmarks/lower_bounds/measure.py [NAME ...] [--seconds S]
        [--answer solve|best|none] [--write FILE] [--into PAGE]

Each problem has the seconds of its goals, one run for each, unless --seconds says
otherwise. The answer that the bound may prune by is that of `solve` on the problem's
own grid; its CPU seconds count. All threads are limited to one, and seconds are CPU
time of the process. --into writes the table between the marks of a page. The exit code
is 3 if a bound is above the best cost known.
"""

import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

if __name__ == "__main__":
    for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[_threads] = "1"


from swarmstart.benchmarks.lower_bounds.problems import NAMED, Named
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.ocp import Solution, solve
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import LowerBound

SECONDS = 60.0
"""Default number of seconds, without goal and option."""
ROUNDING = 1e-9
"""Relative excess over the best known cost at which a bound has crossed it."""
BEGIN, END = "<!-- lower bounds: measured -->", "<!-- lower bounds: end -->"
COLUMNS = (
    "problem", "best known", "answer", "bound", "kind", "gap", "degree", "set",
    "slack", "boxes", "CPU s", "asked",
)  # fmt: skip


class Measured(NamedTuple):
    """A bound of a named problem.

    Attributes:
        name: Name of the problem.
        named: The problem.
        answer: Cost that the bound could prune by; None if there was none.
        bound: The bound.
        seconds: CPU time of answer and bound [s].
        asked: The goal (CPU seconds, bound); None if there is none.
    """

    name: str
    named: Named
    answer: float | None
    bound: LowerBound
    seconds: float
    asked: tuple[float, float] | None

    @property
    def gap(self) -> float:
        """Gap between the best known cost and the bound, relative to the cost."""
        return self.bound.gap(self.named.best)

    @property
    def has_crossed(self) -> bool:
        """True if the bound is above the best known cost."""
        room = ROUNDING * abs(self.named.best)
        return self.bound.kind.is_bound and self.bound.value > self.named.best + room

    @property
    def is_reached(self) -> bool:
        """True if the goal is reached."""
        if self.asked is None or not self.bound.kind.is_bound:
            return False
        return self.bound.value >= self.asked[1] and self.seconds <= self.asked[0]


def solved(named: Named) -> Solution:
    """Return the answer of a problem on its own grid."""
    return solve(
        named.problem, named.x0, known=named.known, search=None, repair=True, seed=0
    )


def best_of(named: Named) -> float:
    """Return the best cost known as an answer."""
    return named.best


ANSWERS: dict[str, Callable[[Named], Solution | float | None]] = {
    "solve": solved,
    "best": best_of,
    "none": lambda named: None,
}


def measured(
    name: str,
    *,
    seconds: float,
    answer: str = "solve",
    asked: tuple[float, float] | None = None,
) -> Measured:
    """Return a bound of a named problem.

    Args:
        name: Of the problem.
        seconds: CPU time for answer and bound together [s].
        answer: A key of ANSWERS.
        asked: CPU seconds and the bound that are asked for.
    """
    named = NAMED[name]()
    begin = time.process_time()
    found = ANSWERS[answer](named)
    left = max(seconds - (time.process_time() - begin), 1.0)
    bound = lower_bound(
        named.problem, named.x0, known=named.known, answer=found, seconds=left
    )
    return Measured(
        name=name,
        named=named,
        answer=found.cost if isinstance(found, Solution) else found,
        bound=bound,
        seconds=time.process_time() - begin,
        asked=asked,
    )


def row_of(one: Measured) -> str:
    """Return the row of a bound."""
    bound, asked = one.bound, "-"
    if one.asked is not None:
        said = "reached" if one.is_reached else "**missed**"
        asked = f">= {one.asked[1]:.5g} in {one.asked[0]:g} s: {said}"
    has = bound.kind.is_bound
    return row(
        one.name,
        f"{one.named.best:.7g}",
        "-" if one.answer is None else f"{one.answer:.7g}",
        f"{bound.value:.7g}" if has else "-",
        bound.kind.value + (" **above the best known**" if one.has_crossed else ""),
        f"{100 * one.gap:.3g} %" if has else "-",
        str(bound.degree or "-"),
        bound.set_name or "-",
        f"{bound.slack:.2g}",
        f"{bound.boxes:,}",
        f"{one.seconds:.1f}",
        asked,
    )


def with_table(page: str, lines: Sequence[str]) -> str:
    """Return a page with its table replaced.

    Raises:
        ValueError: If the marks are not there, once and in order.
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1:
        raise ValueError(f"expected {BEGIN!r} and {END!r} once each in the page")
    before, rest = page.split(BEGIN)
    if END not in rest:
        raise ValueError(f"expected {BEGIN!r} before {END!r} in the page")
    after = rest.split(END)[1]
    return before + "\n".join([BEGIN, "", *lines, "", END]) + after


def runs(
    names: Sequence[str], seconds: float | None
) -> list[tuple[str, float, tuple[float, float] | None]]:
    """Return what is to be run: name, seconds, what is asked for.

    Args:
        names: Of problems; empty: all.
        seconds: CPU time of each [s]; None: that of its goals.
    """
    found: list[tuple[str, float, tuple[float, float] | None]] = []
    for name in names or NAMED:
        goals = NAMED[name]().goals
        if seconds is not None:
            asked = [goal for goal in goals if goal[0] >= seconds][:1]
            found.append((name, seconds, asked[0] if asked else None))
        else:
            found += [(name, goal[0], goal) for goal in goals] or [
                (name, SECONDS, None)
            ]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("names", nargs="*", help="of problems; all unless given")
    parser.add_argument("--seconds", type=float, help="CPU time of each [s]")
    parser.add_argument("--answer", choices=[*ANSWERS], default="solve")
    parser.add_argument("--into", type=Path, help="a page with marks for the table")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in NAMED]
    if unknown:
        parser.error(f"expected names of {', '.join(NAMED)}, got {', '.join(unknown)}")
    lines, crossed = head(*COLUMNS), 0
    for name, seconds, asked in runs(options.names, options.seconds):
        one = measured(name, seconds=seconds, answer=options.answer, asked=asked)
        crossed += one.has_crossed
        lines.append(row_of(one))
        print(f"{lines[-1]} {one.bound.reason}", file=sys.stderr, flush=True)
    publish(lines, options)
    if options.into:
        page = with_table(options.into.read_text(encoding="utf-8"), lines)
        options.into.write_text(page, encoding="utf-8")
    return 3 if crossed else 0


if __name__ == "__main__":
    sys.exit(main())
