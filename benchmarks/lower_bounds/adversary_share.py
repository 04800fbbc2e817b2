"""The share of seeded adversary problems with a proven bound within 10 %.

    python benchmarks/lower_bounds/adversary_share.py [--seconds 60] [--seed 0]
        [--count 10] [--write FILE.md] [--json FILE.json]

The problems are those of the adversary set (tests/adversary) that count, have a
solution, at most three states and smooth expressions; only the nonsmooth classes and
those without a solution are left out. `chosen`, which the adversary itself uses,
shuffles them by the seed and takes from each class in turn; no problem is replaced.
Each is solved with default settings, then bounded with the answer. The gap between the
answer, whose controls are held, and the bound is relative to the answer's cost. The
exit code is 3 if a bound is above the cost of a right answer.
"""

import json
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

if __name__ == "__main__":
    for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[_threads] = "1"

import numpy as np

from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.ocp import solve
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.tests.adversary.case import Case, problem_of
from swarmstart.tests.adversary.catalogue import CLASSES, all_cases, chosen

NOT_SMOOTH = ("nonsmooth", "no_solution")
"""Classes that are left out."""
MOST_STATES = 3
WITHIN = 0.1
"""Largest gap that counts as near, relative to the answer's cost."""
COLUMNS = (
    "problem", "states", "answer", "bound", "kind", "gap", "degree", "boxes", "CPU s",
)  # fmt: skip


class Bounded(NamedTuple):
    """A case, its answer and its bound.

    Attributes:
        case: The case.
        cost: Cost of the answer.
        bound: The bound.
        seconds: CPU time of both [s].
    """

    case: Case
    cost: float
    bound: LowerBound
    seconds: float

    @property
    def gap(self) -> float:
        """Gap between answer and bound, relative to the answer's cost."""
        return self.bound.gap(self.cost)

    @property
    def is_within(self) -> bool:
        """True if the bound is proven and near enough."""
        return self.bound.kind is BoundKind.PROVEN and self.gap <= WITHIN

    @property
    def has_crossed(self) -> bool:
        """True if the bound is above the cost of a right answer."""
        return self.bound.kind.is_bound and self.bound.value > self.case.truth.highest


def candidates(kinds: Sequence[str] = tuple(CLASSES)) -> list[Case]:
    """Return the cases to choose from, the same on every call.

    Args:
        kinds: Classes of the adversary.
    """
    return [
        case
        for case in all_cases(kinds)
        if case.is_counted
        and case.truth.is_solvable
        and case.truth.x0.size <= MOST_STATES
        and case.kind not in NOT_SMOOTH
        and case.origin is None  # A problem of another class once more.
    ]


def bounded(case: Case, *, seconds: float, seed: int = 0) -> Bounded:
    """Return a case's answer with its bound.

    Args:
        case: The case.
        seconds: Time for the bound [s].
        seed: Seed of the answer.
    """
    problem, x0 = problem_of(case), case.start
    begin = time.process_time()
    answer = solve(problem, x0, seed=seed)
    bound = lower_bound(problem, x0, answer=answer, work=seconds)
    return Bounded(case, answer.cost, bound, time.process_time() - begin)


def row_of(one: Bounded) -> str:
    """Return the row of a case."""
    bound, has = one.bound, one.bound.kind.is_bound
    crossed = " **above a right answer**" if one.has_crossed else ""
    return row(
        one.case.name,
        str(one.case.truth.x0.size),
        f"{one.cost:.6g}",
        f"{bound.value:.6g}" if has else "-",
        bound.kind.value + crossed,
        f"{100 * one.gap:.3g} %" if has else "-",
        str(bound.degree or "-"),
        f"{bound.boxes:,}",
        f"{one.seconds:.1f}",
    )


def share_of(found: Sequence[Bounded]) -> str:
    """Return the share in words."""
    within = sum(one.is_within for one in found)
    return (
        f"{within} of {len(found)} have a proven bound within {100 * WITHIN:g} % of "
        "their answer."
    )


def record_of(found: Sequence[Bounded], *, seconds: float, seed: int) -> str:
    """Return all in JSON, with null for numbers that are not finite."""

    def number(value: float) -> float | None:
        return value if math.isfinite(value) else None

    cases = [
        {
            "name": one.case.name,
            "states": one.case.truth.x0.size,
            "cost": number(one.cost),
            "bound": number(one.bound.value),
            "kind": one.bound.kind.value,
            "reason": one.bound.reason,
            "gap": number(one.gap),
            "seconds": one.seconds,
            "crossed": one.has_crossed,
        }
        for one in found
    ]
    within = sum(one.is_within for one in found)
    record = {"seed": seed, "seconds": seconds, "within": within, "cases": cases}
    return json.dumps(record, indent=2) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Choose, solve and bound; print the table and the share."""
    parser = page_options(__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each bound")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--json", type=Path, help="a JSON file to write")
    options = parser.parse_args(arguments)
    rng = np.random.default_rng(options.seed)
    lines, found = head(*COLUMNS), list[Bounded]()
    for case in chosen(candidates(), options.count, rng=rng):
        found.append(bounded(case, seconds=options.seconds))
        lines.append(row_of(found[-1]))
        said = found[-1].bound.reason
        print(f"{lines[-1]} {said}", file=sys.stderr, flush=True)
    publish([*lines, "", share_of(found)], options)
    if options.json:
        record = record_of(found, seconds=options.seconds, seed=options.seed)
        options.json.write_text(record, encoding="utf-8")
    return 3 if any(one.has_crossed for one in found) else 0


if __name__ == "__main__":
    sys.exit(main())
