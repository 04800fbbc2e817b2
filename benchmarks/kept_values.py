"""Costs of the shipped problems with their constraints kept along the whole path.

    python benchmarks/kept_values.py [--write docs/measured/kept_values.json]
        [PROBLEM ...]

The cheapest answer of some seeds at the problem's own checks is solved again with 2, 4,
8, ... times as many checks, on the same control intervals, until no row is violated by
more than 1e-6 of its scale on the finely integrated path. A margin removes the rest:
the cost with it, with the constraints kept everywhere, is the value; the cost before is
a lower bound. The method does not use `repair`.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp import IpoptOptions, Known, OptimalControlProblem, Planner
from swarmstart.ocp.answer.plan import start_of
from swarmstart.ocp.answer.repair import place_of, tightened, with_more_checks
from swarmstart.ocp.answer.solution import Solution, verified
from swarmstart.ocp.rollout.checking import Excess

PROBLEMS = (
    "pendulum",
    "double_integrator",
    "two_reaction_reactor",
    "van_der_pol",
    "catalyst_mixing",
    "bryson_denham",
    "hypersensitive",
    "pendulum_on_cart",
    "brachistochrone",
    "race_car",
    "lotka_volterra_fishing",
    "goddard_rocket",
    "shuttle_reentry",
    "four_discs",
    "bifunctional_catalyst",
    "supersonic_climb",
    "batch_reactor",
    "lynx_and_hares",
    "two_stage_launch",
)
VALUES = Path(__file__).parent.parent / "docs" / "measured" / "kept_values.json"
BROKEN = 1e-6
"""Largest violation, relative to a row's scale, that a margin removes."""
MOST = 16
"""Largest multiple of the number of checks."""
LEFT = 1e-9
"""Excess, relative to a scale, that counts as the tolerance of an NLP solver."""


@dataclass(frozen=True, slots=True)
class Kept:
    """A cost at which a problem's constraints are kept, and how it was found.

    Attributes:
        at_checks: Cost with the constraints kept at the problem's own checks.
        broken: Largest excess of that answer between them, in parts of the scale.
        along_path: Cost with them kept along the whole path.
        without_margin: The same before the margin: a bound from below.
        checks: In each interval.
    """

    at_checks: float
    broken: float
    along_path: float
    without_margin: float
    checks: int


def kept_value(posed: PlanningProblem, *, seeds: Sequence[int] = (0, 1)) -> Kept:
    """Return what a problem costs with its constraints kept along the whole path.

    Args:
        posed: The problem, its initial state and what is known.
        seeds: Of the searches at its own checks.
    """
    first = Planner(posed.problem, search="lshade", polish=IpoptOptions())
    x0, known, _ = first.posed(posed.x0, posed.known)
    plans = [
        first.plan(x0, known=known, rng=np.random.default_rng(seed)) for seed in seeds
    ]
    core = first.problem
    plan = min((plan for plan in plans if plan.feasible), key=lambda plan: plan.cost)
    own = found = verified(first.tracer, plan, x0, known)
    times = 1
    while _worst(found) > BROKEN and times < MOST:
        times *= 2
        found = _again(core, found, x0, known, times)
    without, margins = found, list[Excess]()
    while broken := _broken(found):
        margins = _larger(margins, broken)
        found = _again(core, found, x0, known, times, margins)
    return Kept(
        at_checks=own.cost,
        broken=_worst(own),
        along_path=found.cost,
        without_margin=without.cost,
        checks=posed.problem.checks * times,
    )


def _again(
    core: OptimalControlProblem,
    near: Solution,
    x0: ArrayLike,
    known: Known,
    times: int,
    margins: Sequence[Excess] = (),
) -> Solution:
    """Return an answer with more checks and margins, judged without the margins."""
    dense, given = with_more_checks(core, known, times)
    tight = tightened(replace(dense, path_tolerance=BROKEN), margins)
    judge, solver = (
        Planner(problem, search=None, polish=IpoptOptions(), backend="casadi")
        for problem in (dense, tight)
    )
    start = start_of(core, near.plan, x0)
    rng = np.random.default_rng(0)
    plan = solver.plan(start, known=given, guess=near.controls, near=True, rng=rng)
    at = start_of(core, plan, x0)
    plan = judge.evaluated(plan.controls, at, known=given, source=plan.source)
    return verified(judge.tracer, plan, x0, given)


def _larger(margins: Sequence[Excess], broken: Sequence[Excess]) -> list[Excess]:
    """Return margins of the rows of both, the amounts of one row added."""
    found = {place_of(excess): excess for excess in margins}
    for excess in broken:
        before = found.get(place_of(excess))
        amount = excess.amount + (before.amount if before else 0.0)
        found[place_of(excess)] = replace(excess, amount=amount)
    return [*found.values()]


def _broken(found: Solution) -> list[Excess]:
    """Return what an answer breaks along its path, beyond what a solver leaves."""
    paths = len(found.problem.path_constraints)
    rows = [excess for excess in found.path.broken if excess.constraint < paths]
    return [excess for excess in rows if excess.relative > LEFT]


def _worst(found: Solution) -> float:
    """Return the largest excess along a path, in parts of the scale."""
    return max((excess.relative for excess in _broken(found)), default=0.0)


def written(kept: Mapping[str, Kept]) -> str:
    """Return values as JSON, a line for each problem."""
    lines = [
        f"  {json.dumps(name)}: {json.dumps(asdict(k))}" for name, k in kept.items()
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read(path: Path = VALUES) -> dict[str, Kept]:
    """Return the values of the shipped problems as they were written."""
    values = json.loads(path.read_text(encoding="utf-8"))
    return {name: Kept(**value) for name, value in values.items()}


def main() -> None:
    """Make the values of all, and print or write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", type=Path, help="a JSON file to write")
    parser.add_argument("problems", nargs="*", help="to make again; all unless given")
    options = parser.parse_args()
    kept = read() if options.problems else {}
    for name in options.problems or PROBLEMS:
        posed = first_problem(resolve(read_document(name)).posed())
        kept[name] = kept_value(posed)
        print(name, kept[name], flush=True)
    if options.write:
        options.write.write_text(written(kept), encoding="utf-8")


if __name__ == "__main__":
    main()
