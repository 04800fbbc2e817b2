"""A pendulum's cost to go and first control from 10,000 initial states on a plane.

    python benchmarks/uses/feedback_map.py [--write docs/measured/feedback_map.md]
        [--plot docs/measured/feedback_map.png] [--points 100] [--solves 40]

The problem is benchmarks/uses/swing_up.yaml.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, illustrated, page_options, publish, row
from swarmstart.ocp import Solutions, SolutionStatus

SCENARIO = Path(__file__).parent / "swing_up.yaml"
ANGLE, SPEED = np.pi, 8.0
"""Ends of the plane."""
SAME = 1e-3
"""Relative difference up to which two costs are those of one optimum."""
BORDER = 1.0
"""Mean difference of two neighbours' controls at which they are of two basins."""
STEP = 3.0
"""Difference of two neighbours' costs at a border that is a step, not a kink."""
TEXT = """# A feedback map from many instances

Made by `python benchmarks/uses/feedback_map.py --write docs/measured/feedback_map.md
--plot docs/measured/feedback_map.png`. A weak motor swings up a pendulum: torque up to
5 where gravity pulls with 9.81, 3 s in 30 intervals; both upright positions (turned
left or right) are goals. One sweep solves this problem from each initial state of a
grid of angle and speed. The same from the command line, with a table, a figure and all
answers on disk:

    swarmstart sweep benchmarks/uses/swing_up.yaml

The problem is the same from the mirrored state (-angle, -speed). "Mirrored" is the
share of answers that cost at most 1e-3 more than the answer from the mirrored state;
the computation does not use this symmetry. "As cheap as `solve`" is the share of 40
answers, drawn from all, that cost at most 1e-3 more than the answer of `ss.solve` from
the same state with its default search. A "border" lies between two states that are
neighbours along the angle and whose controls differ by more than 1 in the mean: the two
answers then belong to different [basins](../glossary.md#basin). Jumps are medians of
the absolute differences between neighbours. Where two branches of the cost cross, it
has a kink and the first control jumps; a "step" is a border at which the cost jumps by
more than 3, too: on one side the motor can still catch the pendulum, on the other it
needs one more swing. To see whether the higher costs at steps are optimal, 40 answers
on the side of the higher cost are compared with `solve`.

"""


class Map(NamedTuple):
    """Answers from a grid of initial states; arrays end with (angles, speeds).

    Attributes:
        x0: Initial states, shape (2, n, n).
        cost: Costs to go, shape (n, n).
        controls: Shape (N, n, n).
        confirmed: Mask of confirmed answers, shape (n, n).
    """

    x0: Array
    cost: Array
    controls: Array
    confirmed: NDArray[np.bool_]


def solved(points: int) -> tuple[Solutions, Map]:
    """Return the answers of the sweep, as they are and on the grid."""
    ends = {"angle": ANGLE, "speed": SPEED}
    grid = {k: {"lower": -v, "upper": v, "points": points} for k, v in ends.items()}
    settings = {"instances": {"grid": grid}}
    many = ss.sweep(SCENARIO, seed=0, settings=settings, progress=False)
    shape = points, points
    return many, Map(
        x0=many.states[:, 0].reshape(2, *shape),
        cost=many.cost.reshape(shape),
        controls=many.controls[0].reshape(-1, *shape),
        confirmed=many.is_confirmed.reshape(shape),
    )


def mirrored(cost: Array) -> float:
    """Return the share of answers that cost no more than those from mirrored states."""
    return float(np.mean(cost <= cost[::-1, ::-1] * (1 + SAME)))


def as_cheap(many: Solutions, chosen: NDArray[np.int64], solves: int) -> float:
    """Return the share of answers that cost no more than those of `solve`.

    Args:
        many: All answers.
        chosen: Numbers of the answers from which some are drawn.
        solves: Number of those drawn.
    """
    rng = np.random.default_rng(0)
    drawn = rng.choice(chosen, min(solves, chosen.size), replace=False)
    costs = np.array(
        [ss.solve(many.problem, many.states[:, 0, one], seed=0, progress=False).cost
         for one in drawn]
    )  # fmt: skip
    return float(np.mean(many.cost[drawn] <= costs * (1 + SAME)))


def borders(one: Map) -> tuple[NDArray[np.bool_], Array, Array]:
    """Return where basins meet between two angles, and the jumps there.

    Returns:
        Mask of neighbours along the angle that are of two basins, shape (n - 1, n), and
        the absolute differences of their first controls and of their costs.
    """
    between = np.abs(np.diff(one.controls, axis=1))
    return (
        between.mean(axis=0) > BORDER,
        between[0],
        np.abs(np.diff(one.cost, axis=0)),
    )


def plot(one: Map, path: Path) -> None:
    """Draw cost to go and first control, and in the first one where basins meet."""
    angles, speeds = one.x0[0, :, 0], one.x0[1, 0]
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    drawn = left.pcolormesh(angles, speeds, one.cost.T, cmap="viridis")
    figure.colorbar(drawn, ax=left, label="cost to go")
    apart, _, _ = borders(one)
    i, j = np.nonzero(apart)
    left.plot((angles[i] + angles[i + 1]) / 2, speeds[j], ".", color="w", markersize=2)
    drawn = right.pcolormesh(angles, speeds, one.controls[0].T, cmap="coolwarm")
    figure.colorbar(drawn, ax=right, label="first control [1/s²]")
    left.set_ylabel("speed [rad/s]")
    for axes in (left, right):
        axes.set_xlabel("angle [rad], 0 below")
    figure.savefig(path)


def _numbers(points: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of the two neighbours along the angle, the second first."""
    numbers = np.arange(points**2).reshape(points, points)
    return numbers[1:], numbers[:-1]


def _median(values: Array) -> str:
    return f"{np.median(values):.2f}" if values.size else "-"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write the page and the figure where asked."""
    parser = page_options(__doc__, plots=True)
    parser.add_argument("--points", type=int, default=100, help="of a side of the grid")
    parser.add_argument("--solves", type=int, default=40, help="by solve")
    options = parser.parse_args(arguments)
    begin = time.process_time()
    many, found = solved(options.points)
    cpu = time.process_time() - begin
    apart, control, cost = borders(found)
    step = apart & (cost > STEP)
    higher = np.where(np.diff(found.cost, axis=0) > 0, *_numbers(options.points))[step]
    every = np.arange(len(many))
    lines = [
        *head("measured", "value"),
        row("initial states", str(len(many))),
        row("confirmed", str(int(many.is_confirmed.sum()))),
        row("local optima", str(many.counts.get(SolutionStatus.CONVERGED, 0))),
        row("solves in lanes", str(int(many.attempts.sum()))),
        row("wall time [s]", f"{many.seconds:.0f}"),
        row("CPU time [s]", f"{cpu:.0f}"),
        row("mirrored", f"{mirrored(found.cost):.4f}"),
        row("as cheap as `solve`", f"{as_cheap(many, every, options.solves):.2f}"),
        row("borders", str(int(apart.sum()))),
        row("jump of the first control, at borders", _median(control[apart])),
        row("jump of the first control, elsewhere", _median(control[~apart])),
        row("jump of the cost, at borders", _median(cost[apart])),
        row("jump of the cost, elsewhere", _median(cost[~apart])),
        row("steps of the cost", str(int(step.sum()))),
        row("as cheap as `solve`, above steps",
            f"{as_cheap(many, higher, options.solves):.2f}"),
    ]  # fmt: skip
    caption = "Cost to go and first control"
    lines = illustrated(lines, options, caption, lambda path: plot(found, path))
    publish(lines, options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
