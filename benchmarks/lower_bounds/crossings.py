"""Bounds of all problems with a known optimum, which no bound may exceed.

    python benchmarks/lower_bounds/crossings.py [NAME ...] [--seconds 20]
        [--answers none known worse] [--drawn 0] [--write FILE]

The problems are those of tests/ocp/lower_bound/known_optima.py: closed forms, Riccati
equations, costs made for a value function; minimised and maximised, in other units,
with drawn data. Each is bounded without an answer, with the optimum as the answer's
cost, or with a cost 2 % worse. --drawn adds so many more problems with data that are
drawn. The gap is between optimum and bound. The exit code is 3 if a bound exceeds an
optimum by more than 1e-9 of it.
"""

import os
import sys
from collections import Counter
from collections.abc import Callable, Sequence

if __name__ == "__main__":
    for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[_threads] = "1"

import numpy as np

from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import LowerBound
from swarmstart.tests.ocp.lower_bound.inverse_optima import drawn
from swarmstart.tests.ocp.lower_bound.known_optima import known_optima
from swarmstart.tests.ocp.lower_bound.known_optimum import KnownOptimum

ROUNDING = 1e-9
WORSE = 0.02


def the_optimum(known: KnownOptimum) -> float:
    """Return the optimum as an answer's cost."""
    return known.optimum


def a_worse_one(known: KnownOptimum) -> float:
    """Return the cost of an answer that is not the best."""
    return known.optimum + known.problem.sense * WORSE * known.size


ANSWERS: dict[str, Callable[[KnownOptimum], float | None]] = {
    "none": lambda known: None,
    "known": the_optimum,
    "worse": a_worse_one,
}
COLUMNS = (
    "problem", "states", "answer", "optimum", "bound", "kind", "gap", "boxes", "CPU s",
)  # fmt: skip


def has_crossed(known: KnownOptimum, bound: LowerBound) -> bool:
    """Return whether a bound is better than the optimum; NaN counts as better."""
    return bound.kind.is_bound and not known.excess(bound.value) <= ROUNDING


def row_of(known: KnownOptimum, answer: str, bound: LowerBound) -> str:
    """Return the row of a bound."""
    has = bound.kind.is_bound
    crossed = " **crossed**" if has_crossed(known, bound) else ""
    return row(
        known.name,
        str(known.problem.model.nx),
        answer,
        f"{known.optimum:.7g}",
        f"{bound.value:.7g}" if has else "-",
        bound.kind.value + crossed,
        f"{-100 * known.excess(bound.value):.3g} %" if has else "-",
        f"{bound.boxes:,}",
        f"{bound.cpu_seconds:.1f}",
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Bound all, and print or write the table."""
    parser = page_options(__doc__)
    parser.add_argument("names", nargs="*", help="parts of names; all unless given")
    parser.add_argument("--seconds", type=float, default=20.0, help="for each bound")
    parser.add_argument("--drawn", type=int, default=0, help="more drawn problems")
    parser.add_argument("--answers", nargs="+", choices=[*ANSWERS], default=["worse"])
    options = parser.parse_args(arguments)
    lines, kinds, crossed = head(*COLUMNS), Counter[str](), 0
    rng = np.random.default_rng(22)
    more = [drawn(rng, 100 + number) for number in range(options.drawn)]
    for known in [*known_optima(), *more]:
        if options.names and not any(part in known.name for part in options.names):
            continue
        for answer in options.answers:
            bound = lower_bound(
                known.problem, known.x0, known=known.known,
                answer=ANSWERS[answer](known), work=options.seconds,
            )  # fmt: skip
            crossed += has_crossed(known, bound)
            kinds[bound.kind.value] += 1
            lines.append(row_of(known, answer, bound))
            print(f"{lines[-1]} {bound.reason}", file=sys.stderr, flush=True)
    said = ", ".join(f"{number} {kind}" for kind, number in kinds.most_common())
    publish([*lines, "", f"{crossed} crossings; {said}."], options)
    return 3 if crossed else 0


if __name__ == "__main__":
    sys.exit(main())
