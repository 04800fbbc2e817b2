"""A small network fitted to 100,000 states and optimal controls, in closed loop.

    python benchmarks/uses/training_set.py [--write docs/measured/training_set.md]
        [--plot docs/measured/training_set.png] [--points 100] [--pairs 100000]
        [--paths 500] [--iterations 600]

The problem is benchmarks/uses/swing_up.yaml.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, illustrated, page_options, publish, row
from swarmstart.benchmarks.uses.feedback_map import ANGLE, SPEED, solved

TORQUE, GRAVITY, HORIZON, INTERVALS = 5.0, 9.81, 3.0, 30
"""Numbers of the problem."""
SUBSTEPS = 20
"""Steps of the simulated path in an interval."""
HIDDEN = 48
"""Number of units in each of two hidden layers."""
ITERATIONS = 600
"""Largest number of steps of L-BFGS."""
TEXT = """# A network fitted to optimal controls

Made by `python benchmarks/uses/training_set.py --write docs/measured/training_set.md
--plot docs/measured/training_set.png`. The optimal paths of the [feedback
map](feedback_map.md) visit 300,000 states at the beginnings of their intervals; the
rest of an optimal path is optimal for the time that is left, so each state, with its
time, has an optimal control. A network (two hidden layers of 48, tanh) is fitted to
100,000 of these pairs by L-BFGS: cos and sin of the angle, speed and time to the
torque. Then the network controls the pendulum from 500 other states, drawn uniformly,
and is compared with the optimal plan from each of them; without disturbances, a
controller that solves the problem again at each step follows just that plan. Costs are
integrated apart from the library, by Runge-Kutta steps of a twentieth of an interval.
"Excess" is the network's cost relative to that of the plan, less 1.

A network is smooth, but the optimal control jumps where basins meet. There the network
returns a mean of the two controls, which is near neither of them; hence the tail of the
excess.

"""


class Pairs(NamedTuple):
    """States with their times and optimal controls.

    Attributes:
        states: Angle [rad] and speed [rad/s], shape (2, n).
        times: Since the start [s], shape (n,).
        controls: Torque, shape (n,).
    """

    states: Array
    times: Array
    controls: Array


def pairs_of(states: Array, controls: Array) -> Pairs:
    """Return the pairs along optimal paths.

    Args:
        states: Shape (2, N + 1, M).
        controls: Shape (N, M).
    """
    N, M = controls.shape
    times = np.repeat(np.arange(N) * HORIZON / N, M)
    return Pairs(states[:, :N].reshape(2, -1), times, controls.ravel())


class Network:
    """A function of state and time with two hidden layers of tanh.

    Attributes:
        weights: Weights and biases of all layers, one after the other, shape (n,).
    """

    _shapes = ((HIDDEN, 4), (HIDDEN, HIDDEN), (1, HIDDEN))

    def __init__(self, weights: Array) -> None:
        """Keep the weights."""
        self.weights = weights

    @classmethod
    def random(cls, rng: np.random.Generator) -> "Network":
        """Return a network with random weights, and biases 0."""
        parts = [
            np.append(
                rng.normal(size=rows * columns) / np.sqrt(columns), np.zeros(rows)
            )
            for rows, columns in cls._shapes
        ]
        return cls(np.concatenate(parts))

    def _layers(self) -> list[tuple[Array, Array]]:
        """Return weights and biases of each layer."""
        found, place = [], 0
        for rows, columns in self._shapes:
            W = self.weights[place : place + rows * columns].reshape(rows, columns)
            place += rows * columns
            found.append((W, self.weights[place : place + rows, None]))
            place += rows
        return found

    def __call__(self, states: Array, times: Array) -> Array:
        """Return torques, shape (n,).

        Args:
            states: Shape (2, n).
            times: Shape (n,) [s].
        """
        *_, last = self._values(_inputs(states, times))
        return np.asarray(TORQUE * last[0])

    def _values(self, inputs: Array) -> list[Array]:
        """Return the inputs and the values after each layer."""
        values = [inputs]
        for W, b in self._layers():
            values.append(np.tanh(W @ values[-1] + b))
        return values

    def loss(self, inputs: Array, goal: Array) -> tuple[float, Array]:
        """Return the mean square of the differences, and its gradient by the weights.

        Args:
            inputs: Shape (4, n).
            goal: Torques by their bound, shape (n,).
        """
        values, slopes = self._values(inputs), list[Array]()
        off = values[-1] - goal
        back = 2 * off / goal.size
        for (W, _), before, after in zip(
            self._layers()[::-1], values[-2::-1], values[:0:-1], strict=True
        ):
            back = back * (1 - after**2)
            slopes[:0] = [(back @ before.T).ravel(), back.sum(axis=1)]
            back = W.T @ back
        return float(np.mean(off**2)), np.concatenate(slopes)

    def fitted(self, pairs: Pairs, iterations: int) -> "Network":
        """Return the network that fits pairs best, by least squares.

        Args:
            pairs: The pairs.
            iterations: Largest number of steps.
        """
        inputs, goal = _inputs(pairs.states, pairs.times), pairs.controls / TORQUE
        options = {"maxiter": iterations, "maxfun": 2 * iterations}
        found = minimize(
            lambda weights: Network(weights).loss(inputs, goal),
            self.weights,
            jac=True,
            method="L-BFGS-B",
            options=options,
        )
        return Network(np.asarray(found.x))


def _inputs(states: Array, times: Array) -> Array:
    """Return what the network takes, each within about [-1, 1], shape (4, n)."""
    angle, speed = states
    return np.stack([np.cos(angle), np.sin(angle), speed / SPEED, times / HORIZON])


def simulated(x0: Array, torques: "Network | Array") -> Array:
    """Return the costs of paths, shape (n,).

    Args:
        x0: Initial states, shape (2, n).
        torques: A network, or the torques, shape (N, n).
    """
    n, h = x0.shape[1], HORIZON / INTERVALS / SUBSTEPS
    y = np.vstack([x0, np.zeros(n)])

    def rate(y: Array, u: Array) -> Array:
        angle, speed, _ = y
        cost = 10 * (1 + np.cos(angle)) + 0.1 * speed**2 + 0.05 * u**2
        return np.stack([speed, u - GRAVITY * np.sin(angle), cost])

    for k in range(INTERVALS):
        u = torques[k] if isinstance(torques, np.ndarray) else torques(
            y[:2], np.full(n, k * HORIZON / INTERVALS)
        )  # fmt: skip
        for _ in range(SUBSTEPS):
            a = rate(y, u)
            b = rate(y + h / 2 * a, u)
            c = rate(y + h / 2 * b, u)
            y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c, u))
    angle, speed, cost = y
    return np.asarray(cost + 100 * (1 + np.cos(angle)) + 10 * speed**2)


def plot(excess: Array, path: Path) -> None:
    """Draw the share of paths over the excess of their costs."""
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    axes = figure.subplots()
    order = np.sort(np.maximum(excess, 1e-6))
    axes.semilogx(order, np.arange(1, order.size + 1) / order.size)
    axes.set_xlabel("excess of the network's cost over that of the plan")
    axes.set_ylabel("share of paths")
    axes.grid(color="0.9")
    figure.savefig(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write the page and the figure where asked."""
    parser = page_options(__doc__, plots=True)
    parser.add_argument("--points", type=int, default=100, help="on each side")
    parser.add_argument("--pairs", type=int, default=100_000, help="to be fitted")
    parser.add_argument("--paths", type=int, default=500, help="of the network")
    parser.add_argument("--iterations", type=int, default=ITERATIONS, help="of the fit")
    options = parser.parse_args(arguments)
    begin = time.process_time()
    many, _ = solved(options.points)
    swept = time.process_time() - begin
    rng = np.random.default_rng(0)
    every = pairs_of(many.states, many.controls[0])
    chosen = rng.permutation(every.times.size)
    fit, test = (
        Pairs(every.states[:, part], every.times[part], every.controls[part])
        for part in np.split(chosen, [options.pairs])
    )
    begin = time.process_time()
    network = Network.random(rng).fitted(fit, options.iterations)
    trained = time.process_time() - begin
    x0 = rng.uniform([[-ANGLE], [-SPEED]], [[ANGLE], [SPEED]], (2, options.paths))
    begin = time.process_time()
    plans = ss.solve_many(many.problem, x0, seed=0, threads=1, progress=False)
    solve_ms = 1e3 * (time.process_time() - begin) / options.paths
    begin = time.process_time()
    network(test.states, test.times)
    network_us = 1e6 * (time.process_time() - begin) / max(1, test.times.size)
    planned = simulated(x0, plans.controls[0])
    excess = simulated(x0, network) / planned - 1
    errors = [
        float(np.sqrt(np.mean((network(one.states, one.times) - one.controls) ** 2)))
        for one in (fit, test)
    ]
    lines = [
        *head("measured", "value"),
        row("optimal paths", str(len(many))),
        row("of these confirmed", str(int(many.is_confirmed.sum()))),
        row("pairs fitted", str(fit.times.size)),
        row("CPU time of the sweep [s]", f"{swept:.0f}"),
        row("CPU time of the fit [s]", f"{trained:.0f}"),
        row("RMS error of the torque, fitted pairs", f"{errors[0]:.2f}"),
        row("RMS error of the torque, other pairs", f"{errors[1]:.2f}"),
        row("paths of the network", str(x0.shape[1])),
        row("largest difference of a plan's cost, relative",
            f"{np.max(np.abs(planned / plans.cost - 1)):.1e}"),
        row("median excess", f"{np.median(excess):.4f}"),
        row("excess of nine in ten is below", f"{np.quantile(excess, 0.9):.3f}"),
        row("share of paths within 1 %", f"{np.mean(excess <= 0.01):.2f}"),
        row("share of paths within 10 %", f"{np.mean(excess <= 0.1):.2f}"),
        row("CPU time of a control by the network [us]", f"{network_us:.1f}"),
        row("CPU time of a plan by `solve_many` [ms]", f"{solve_ms:.1f}"),
    ]  # fmt: skip
    caption = "Share of paths over excess"
    lines = illustrated(lines, options, caption, lambda path: plot(excess, path))
    publish(lines, options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
