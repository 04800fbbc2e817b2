"""A design study: the cost of a swing-up over 500 lengths of the pole.

    python benchmarks/uses/design_study.py [--write docs/measured/design_study.md]
        [--plot docs/measured/design_study.png] [--points 500] [--solves 40]

The problem is benchmarks/uses/pole.yaml.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, illustrated, page_options, publish, row
from swarmstart.ocp import Solutions, SolutionStatus

SCENARIO = Path(__file__).parent / "pole.yaml"
SHORTEST, LONGEST = 0.25, 2.0
"""Lengths of the pole [m]."""
SAME = 1e-3
"""Relative difference up to which two costs are those of one optimum."""
KINK = 20.0
"""Change of the slope at a kink, relative to the median change between neighbours."""
TEXT = """# A design study over 500 variants

Made by `python benchmarks/uses/design_study.py --write docs/measured/design_study.md
--plot docs/measured/design_study.png`. What does a metre of pole cost if a cart has to
swing it up within a second? The problem is that of the shipped `pendulum_on_cart` (0.8
m) with the length as a parameter, at 500 lengths from 0.25 m to 2 m. The same from the
command line:

    swarmstart sweep benchmarks/uses/pole.yaml

Shorter poles move too fast for 20 intervals: below 0.23 m the finer grid gives another
answer. "As cheap as `solve`" is the share of 40 lengths at which the answer costs at
most 1e-3 more than `ss.solve` with its default search, and "cheaper than `solve`" the
share at which it costs over 1e-3 less. A "kink" is a length at which the slope of the
cost changes by more than 20 times the median change from one length to the next: two
branches of optima cross there, and the force jumps by 9 N in some interval.

"""


def solved(points: int) -> tuple[Solutions, Array]:
    """Return the answers of the sweep, and their lengths [m], shape (points,)."""
    lengths = {"lower": SHORTEST, "upper": LONGEST, "points": points}
    settings = {"instances": {"grid": {"l": lengths}}}
    many = ss.sweep(SCENARIO, seed=0, settings=settings, progress=False)
    return many, np.linspace(SHORTEST, LONGEST, points)


def kinks(cost: Array, lengths: Array) -> NDArray[np.int64]:
    """Return the numbers of the variants at which the cost has a kink.

    Args:
        cost: Shape (M,).
        lengths: Equally spaced, shape (M,) [m].
    """
    bends = np.abs(np.diff(np.diff(cost) / np.diff(lengths)))
    sharp = bends > KINK * np.median(bends)
    around = np.pad(bends, 1)
    largest = (bends >= around[:-2]) & (bends > around[2:])
    return np.flatnonzero(sharp & largest) + 1


def ratios(many: Solutions, lengths: Array, solves: int) -> Array:
    """Return costs relative to those of `solve`, of some variants evenly spread."""
    chosen = np.unique(np.linspace(0, len(many) - 1, solves).astype(int))
    costs = [
        ss.solve(
            many.problem, many.states[:, 0, one], seed=0, progress=False,
            known=ss.Known(parameters=lengths[[one]]),
        ).cost
        for one in chosen
    ]  # fmt: skip
    return np.asarray(many.cost[chosen] / np.array(costs))


def plot(many: Solutions, lengths: Array, path: Path) -> None:
    """Draw the cost over the length, and where the way of swinging changes."""
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(lengths, many.cost, ".", markersize=3)
    for number in kinks(many.cost, lengths):
        axes.axvline(lengths[number], color="0.7", linewidth=0.8)
    axes.set_xlabel("length of the pole [m]")
    axes.set_ylabel("cost")
    figure.savefig(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write the page and the figure where asked."""
    parser = page_options(__doc__, plots=True)
    parser.add_argument("--points", type=int, default=500, help="number of lengths")
    parser.add_argument("--solves", type=int, default=40, help="by solve")
    options = parser.parse_args(arguments)
    begin = time.process_time()
    many, lengths = solved(options.points)
    cpu = time.process_time() - begin
    compared = ratios(many, lengths, options.solves)
    best = int(np.argmin(np.where(many.is_confirmed, many.cost, np.inf)))
    slopes = np.gradient(many.cost, lengths)
    places = kinks(many.cost, lengths)
    lines = [
        *head("measured", "value"),
        row("lengths", str(len(many))),
        row("confirmed", str(int(many.is_confirmed.sum()))),
        row("local optima", str(many.counts.get(SolutionStatus.CONVERGED, 0))),
        row("wall time [s]", f"{many.seconds:.1f}"),
        row("CPU time [s]", f"{cpu:.1f}"),
        row("as cheap as `solve`", f"{np.mean(compared <= 1 + SAME):.2f}"),
        row("cheaper than `solve`", f"{np.mean(compared < 1 - SAME):.2f}"),
        row("best length [m]", f"{lengths[best]:.2f}"),
        row("its cost", f"{many.cost[best]:.0f}"),
        row("highest cost", f"{np.nanmax(many.cost):.0f}"),
        row("kinks", str(places.size)),
    ]
    for number in places:
        before, after = (slopes[number + away] for away in (-3, 3))
        name = f"slope before and after {lengths[number]:.2f} m [1/m]"
        lines.append(row(name, f"{before:.0f}, {after:.0f}"))
    caption = "Cost over the length of the pole"
    lines = illustrated(lines, options, caption, lambda path: plot(many, lengths, path))
    publish(lines, options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
