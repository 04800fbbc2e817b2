"""Draw V along the best known trajectory of van der Pol's oscillator.

    python benchmarks/lower_bounds/picture.py [--seconds 60] [--out FILE.png]

Along the trajectory of an answer, cost so far plus V is a curve that rises from the
bound to the cost: V may not fall faster than the cost grows. Its slope is the slack of
inequality (1) of docs/lower_bounds.md at this point.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.lower_bounds.problems import NAMED
from swarmstart.ocp import solve
from swarmstart.ocp.lower_bound.basis import values_of
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import Evidence

PAGE = Path(__file__).parents[2] / "docs" / "lower_bounds.png"


def values(evidence: Evidence, times: Array, states: Array) -> Array:
    """Return V of the final step along a trajectory, shape (nodes,).

    Args:
        evidence: Of the bound.
        times: Shape (nodes,) [s].
        states: In their units, shape (n, nodes).
    """
    V = evidence.final.polynomial
    points = np.vstack([times, states / evidence.statement.sizes[:, None]])
    return values_of(V, points)


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=PAGE)
    options = parser.parse_args()
    named = NAMED["van_der_pol"]()
    solution = solve(named.problem, named.x0, known=named.known, seed=0)
    bound = lower_bound(named.problem, named.x0, answer=solution, work=options.seconds)
    if bound.evidence is None:
        raise SystemExit(f"expected a proven bound, found none: {bound.reason}")
    path = solution.path
    held = (path.times.size - 1) // solution.controls.shape[1]
    u = np.repeat(solution.controls, held, axis=1)
    x, t = path.states[:2], path.times
    # The stage cost of this problem, by the trapezoidal rule on the fine path.
    left = (x[:, :-1] ** 2).sum(axis=0) + u[0] ** 2
    right = (x[:, 1:] ** 2).sum(axis=0) + u[0] ** 2
    paid = np.concatenate([[0.0], np.cumsum((left + right) / 2 * np.diff(t))])
    V = values(bound.evidence, t, x)
    draw(options.out, t, paid, V, bound.value)
    print(f"{options.out}: bound {bound.value:.6g}, cost {paid[-1]:.6g}")


def draw(file: Path, t: Array, paid: Array, V: Array, bound: float) -> None:
    """Write the picture.

    Args:
        file: Where to.
        t: Times [s].
        paid: Cost so far.
        V: The polynomial.
        bound: The proven bound.
    """
    figure, (upper, lower) = plt.subplots(
        2, 1, figsize=(7, 5), sharex=True, height_ratios=(2, 1), layout="constrained"
    )
    upper.plot(t, paid[-1] - paid, color="#1f5f8b", label="cost to go of the answer")
    upper.plot(t, V, color="#c8553d", linestyle="--", label="V(t, x(t))")
    upper.set_ylabel("cost")
    upper.legend(frameon=False)
    upper.set_title("V along the best known trajectory of van der Pol's oscillator")
    lower.plot(t, paid + V, color="#c8553d", label="cost so far + V")
    lower.axhline(paid[-1], color="#1f5f8b", linewidth=0.8)
    lower.axhline(bound, color="black", linewidth=0.8)
    lower.text(t[-1], paid[-1], "cost", ha="right", va="bottom")
    lower.text(t[-1], bound, "proven bound", ha="right", va="bottom")
    lower.margins(y=0.25)
    lower.set_xlabel("time [s]")
    lower.set_ylabel("cost so far + V")
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
