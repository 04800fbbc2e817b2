"""Planning with this checkout against another one, such as that of an earlier release.

    git worktree add ../earlier COMMIT
    python benchmarks/releases.py ../earlier [--write docs/measured/releases.md]
        [--rounds 5] [--only NAME]

Each problem is planned by processes of both checkouts in turns, which have caches of
their own, filled before. Seconds are CPU time, that of child processes included.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from swarmstart.benchmarks.kept_values import PROBLEMS
from swarmstart.benchmarks.tables import head, page_options, publish, row

ROOT = Path(__file__).resolve().parents[1]
TOGETHER = "build and first plan"
WHAT = ("build", "first plan", TOGETHER, "warm plan", "step", "call")
MOST = 1.05
"""Ratio up to which a part is not slower than before."""
TITLE = "# Against an earlier version\n\n"
TEXT = """
Made by `python benchmarks/releases.py ../earlier --write docs/measured/releases.md`,
where `../earlier` is a checkout of 53ac769, the version before derivatives were machine
code. Compared is CPU time, with the machine code of both versions on disk: a planner
without a search is built, and makes a plan without a guess, a plan from that plan, and
a step of `RecedingHorizon`. The first plan starts IPOPT from zero controls, in the new
version also from the middle of the bounds if that is not zero. "Call" is the second
of two equal calls of `solve` (same problem, same seed) in one process; the first is not
timed. In the new version the build prepares machine code that the first plan prepared
in the earlier version, so the two are also counted together. The two versions run in
pairs; each number is the median ratio of the new to the earlier time over some pairs,
in brackets the upper quartile.

"""
PROGRAM = """
import json, resource, sys
import numpy as np
import swarmstart as ss
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
posed = first_problem(resolve(read_document(sys.argv[1])).posed())
problem, x0, known = posed.problem, posed.x0, posed.known
spent, rng = {}, np.random.default_rng(0)

def now():
    of = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    each = [resource.getrusage(who) for who in of]
    return sum(one.ru_utime + one.ru_stime for one in each)

def timed(name, call):
    begin, found = now(), call()
    spent.setdefault(name, []).append(now() - begin)
    return found

def built():
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    planner.polisher.prepare()
    planner.prepare()
    return planner

planner = timed("build", built)
inner = planner.posed(x0, known)
plan = timed("first plan", lambda: planner.plan(inner[0], known=inner[1], rng=rng))
for _ in range(5):
    timed("warm plan", lambda: planner.plan(
        inner[0], known=inner[1], guess=plan.controls, near=True, rng=rng))
loop = ss.RecedingHorizon(planner=planner)
try:
    last = loop.decide(0.0, np.asarray(x0, dtype=float), None, rng=rng)
    for step in range(1, 6):
        # The state that the plan expects after its first interval.
        state = last.plans[0].states[: len(x0), problem.checks].copy()
        last = timed("step", lambda: loop.decide(step * loop.dt, state, last, rng=rng))
except Exception:
    pass  # Problems whose loop needs signals.
ss.solve(problem, x0, known=known, seed=0)
timed("call", lambda: ss.solve(problem, x0, known=known, seed=0))
print(json.dumps({name: float(np.median(each)) for name, each in spent.items()}))
"""


def spent(checkout: Path, cache: str, name: str) -> Mapping[str, float]:
    """Return the seconds of each part of a problem's planning by a checkout."""
    environment = {
        **os.environ, "PYTHONPATH": str(checkout / ".dev"), "XDG_CACHE_HOME": cache
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM, name],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return {**found, TOGETHER: found["build"] + found["first plan"]}


def finding(every: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """Return the finding of the page.

    Args:
        every: Of each part, median and upper quartile of the ratios of each problem.

    Example:
        >>> finding({part: [(0.5, 1.0), (0.7, 1.2)] for part in WHAT})[:61]
        'In the median of 2 problems a repeated `solve` takes 0.60 of '
    """
    measured = {part: every.get(part, []) for part in WHAT}
    slower = {part: sum(q > MOST for _, q in each) for part, each in measured.items()}
    middle = {
        part: f"{np.median([m for m, _ in each]):.2f}" if each else "-"
        for part, each in measured.items()
    }
    return (
        f"In the median of {len(every[TOGETHER])} problems a repeated `solve` takes "
        f"{middle['call']} of the time that it took in an earlier version, a plan from "
        f'the last plan ("warm plan") {middle["warm plan"]}, a step in closed loop '
        f"{middle['step']}, building and the first plan {middle[TOGETHER]}. A [bar]"
        f"(../glossary.md#bar) of {MOST} for the upper quartile is missed by `solve` "
        f"on {slower['call']} of the problems, by warm plans on {slower['warm plan']}, "
        f"by steps on {slower['step']}, and by building and the first plan on "
        f"{slower[TOGETHER]}."
    )


def ratios(
    other: Path, caches: tuple[str, str], name: str, rounds: int
) -> Mapping[str, list[float]]:
    """Return this checkout's seconds over those of another, in each round.

    Args:
        other: The other checkout.
        caches: Folders for the machine code of both.
        name: Name of a shipped problem.
        rounds: Number of rounds, after one that fills the caches.
    """
    found: dict[str, list[float]] = {}
    here, there = caches
    for number in range(rounds + 1):
        own, others = spent(ROOT, here, name), spent(other, there, name)
        if number:  # The first one fills the caches.
            for part in own.keys() & others.keys():
                found.setdefault(part, []).append(own[part] / others[part])
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all problems, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("other", type=Path, help="another checkout")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", action="append", help="one problem")
    options = parser.parse_args(arguments)
    lines = head("problem", *WHAT)
    every = dict[str, list[tuple[float, float]]]()
    folders = [tempfile.TemporaryDirectory() for _ in range(2)]
    caches = folders[0].name, folders[1].name
    for name in options.only or [*PROBLEMS, "stirred_tank"]:
        found = ratios(options.other.resolve(), caches, name, options.rounds)
        cells = []
        for part in WHAT:
            each = found.get(part)
            if each is None:
                cells.append("-")
                continue
            middle, upper = (float(np.quantile(each, q)) for q in (0.5, 0.75))
            every.setdefault(part, []).append((middle, upper))
            cells.append(f"{middle:.2f} ({upper:.2f})")
        lines.append(row(name, *cells))
        print(lines[-1], flush=True)
    medians = [f"{np.median([m for m, _ in every[part]]):.2f}" if part in every else "-"
               for part in WHAT]  # fmt: skip
    lines.append(row("median", *medians))
    publish([finding(every), "", TEXT.strip(), "", *lines], options, TITLE)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
