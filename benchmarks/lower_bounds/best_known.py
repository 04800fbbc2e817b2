"""The best known costs of the problems for which lower bounds are measured.

    python benchmarks/lower_bounds/best_known.py [NAME ...] [--lanes 64]

Each is solved with controls held on 50, 100, 200 and 400 intervals, and with controls
linear between as many knots, from many starts on the coarsest grid and from the
previous answer on the others. The integrator's steps are so short that its error does
not matter. The least cost belongs to admissible controls, up to the tolerance of
constraints. So it is at least the optimum of free controls, and at least any bound.
"""

import argparse
import sys
from dataclasses import replace

from swarmstart.benchmarks.lower_bounds.problems import NAMED, Named
from swarmstart.benchmarks.tables import head, row
from swarmstart.ocp import OptimalControlProblem, Solution, solve
from swarmstart.ocp.statement.control_shape import ControlShape

GRIDS = (50, 100, 200, 400)
STEPS = 4000
"""Steps of the integrator over the horizon."""
SHAPES: tuple[ControlShape, ...] = ("constant", "linear")


def on_grid(
    problem: OptimalControlProblem, intervals: int, shape: ControlShape
) -> OptimalControlProblem:
    """Return a problem on another grid of controls."""
    return replace(
        problem,
        intervals=intervals,
        control_shape=shape,
        checks=1,
        substeps=max(4, STEPS // intervals),
        integrator="rk4",
    )


def refined(
    named: Named, shape: ControlShape, *, lanes: int, grids: tuple[int, ...] = GRIDS
) -> list[Solution]:
    """Return the answers on the grids, each begun at the one before.

    Args:
        named: The problem.
        shape: Of the controls.
        lanes: Random starts on the first grid.
        grids: Numbers of intervals, growing.
    """
    found: list[Solution] = []
    for intervals in grids:
        problem = on_grid(named.problem, intervals, shape)
        guess = found[-1].as_guess(problem) if found else None
        found.append(
            solve(
                problem, named.x0, known=named.known, search=None, repair=True,
                guess=guess, lanes=0 if found else lanes, backend="casadi", seed=0,
            )
        )  # fmt: skip
    return found


def main() -> None:
    """Solve all, and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", help="of problems; all unless given")
    parser.add_argument("--lanes", type=int, default=64)
    options = parser.parse_args()
    lines = head("problem", "controls", *(f"{N} intervals" for N in GRIDS), "status")
    for name in options.names or NAMED:
        for shape in SHAPES:
            found = refined(NAMED[name](), shape, lanes=options.lanes)
            costs = [f"{answer.verified_cost:.7g}" for answer in found]
            lines.append(row(name, shape, *costs, found[-1].status.name.lower()))
            print(lines[-1], file=sys.stderr, flush=True)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
