"""Figures of the explanation pages: `python docs/explanation/figures.py` writes them.

Each is drawn from solutions of this package and written as SVG beside this file. The
text of a picture stays text, so that a reader's browser sets it.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

import swarmstart as ss

FOLDER = Path(__file__).parent
BLUE, RED, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#545c66"
"""Colours that the colour-blind tell apart, as in the figures of runs."""


def cart() -> ss.Solution:
    """Return the cart of optimal_control.md: 1 m in 2 s from rest to rest."""
    position, velocity, u = (ca.SX.sym(name) for name in ("position", "velocity", "u"))
    state = ca.vertcat(position, velocity)
    problem = ss.OptimalControlProblem(
        ss.Model(states=state, controls=u, ode=ca.vertcat(velocity, u)),
        horizon=2.0,
        intervals=8,
        stage_cost=u**2,
        bounds=ss.Bounds(controls=(-1.2, 1.2)),
        terminal=[(state, [1, 0])],
    )
    return ss.solve(problem, x0=[0, 0], seed=0)


def draw_cart() -> Figure:
    """Draw states, control and its bounds over time, with horizon and intervals."""
    found = cart()
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(6.4, 4.2), sharex=True, layout="constrained"
    )
    fine = np.linspace(0, 2, 201)
    dense = np.array([_cart_at(found, t) for t in fine])
    above.plot(fine, dense[:, 0], color=BLUE, label="position [m]")
    above.plot(fine, dense[:, 1], color=RED, ls="--", label="velocity [m/s]")
    above.plot(found.times, found.states[0], "o", color=BLUE, ms=4)
    above.plot(found.times, found.states[1], "s", color=RED, ms=4)
    above.plot(2, 1, "*", color=GREEN, ms=13, label="target: position 1")
    above.set_title("States: they follow from the control", loc="left", fontsize=10)
    above.legend(fontsize=8, loc="upper left")
    below.stairs(
        found.controls[0], found.times, baseline=None, color=GREEN, lw=2, label="force"
    )
    for bound in (-1.2, 1.2):
        below.axhline(bound, color=GREY, ls=":", lw=1.2)
    below.text(1.0, 1.23, "bounds", color=GREY, fontsize=8, ha="center", va="bottom")
    below.set_title("Control: one number for each interval", loc="left", fontsize=10)
    below.annotate(
        "", (1.25, -0.95), (1.0, -0.95), arrowprops={"arrowstyle": "<->", "color": GREY}
    )
    below.text(0.97, -0.95, "interval", fontsize=8, ha="right", va="center")
    below.set(ylim=(-1.6, 1.6), xlabel="time [s], the horizon is 2 s", ylabel="force")
    below.set_xticks(found.times)
    for axes in (above, below):
        axes.grid(axis="x", color="#d9dee3", lw=0.8)
    return figure


def _cart_at(found: ss.Solution, time: float) -> tuple[float, float]:
    """Return position and velocity at a time, exactly."""
    k = min(int(time / 0.25), 7)
    rest, (p, v) = time - 0.25 * k, found.states[:, k]
    u = found.controls[0, k]
    return p + v * rest + u * rest**2 / 2, v + u * rest


def passing() -> ss.OptimalControlProblem:
    """Return the problem of local_optima.md: pass a disc on either side."""
    x, y, w, u = (ca.SX.sym(name) for name in "xywu")
    return ss.OptimalControlProblem(
        ss.Model(states=ca.vertcat(x, y, w), controls=u, ode=ca.vertcat(1, w, u)),
        horizon=10.0,
        intervals=40,
        stage_cost=u**2,
        bounds=ss.Bounds(controls=(-1, 1)),
        constraints=[(x - 5) ** 2 + (y - 0.3) ** 2 >= 1.5**2],
        terminal=[y, w],
    )


def draw_passing() -> Figure:
    """Draw both ways past the disc, and the cost over the height of the way."""
    problem = passing()
    turns = 0.3 * np.sign(np.cos(np.linspace(0, 2 * np.pi, 40)))[None, :]
    above, below = (
        ss.solve(problem, [0, 0, 0], guess=sign * turns, search=None, lanes=0, seed=0)
        for sign in (1, -1)
    )
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(8.2, 3.3), layout="constrained", width_ratios=[1.25, 1]
    )
    left.add_patch(Circle((5, 0.3), 1.5, fc="#d9dee3", ec=GREY, hatch="///"))
    for found, colour, style in ((above, RED, "--"), (below, BLUE, "-")):
        label = f"cost {found.cost:.3f}"
        left.plot(found.states[0], found.states[1], style, color=colour, label=label)
    left.plot([0, 10], [0, 0], "o", color="#16191d", ms=5)
    left.text(0.2, 0.12, "start", fontsize=8, va="bottom")
    left.text(9.8, 0.12, "end", fontsize=8, va="bottom", ha="right")
    left.set(xlabel="x [m]", ylabel="y [m]", ylim=(-2, 2.7), aspect="equal")
    left.legend(fontsize=8, loc="upper left")
    left.set_title("Two ways, both locally optimal", loc="left", fontsize=10)
    _landscape(right)
    return figure


def _landscape(axes: Axes) -> None:
    """Draw the least cost 24 h^2 / 125 of a way through height h beside the disc."""
    for low, high, colour, style in ((-2.6, -1.2, BLUE, "-"), (1.8, 2.6, RED, "--")):
        h = np.linspace(low, high, 100)
        axes.plot(h, 24 * h**2 / 125, style, color=colour)
    axes.axvspan(-1.2, 1.8, fc="#d9dee3", ec=GREY, hatch="///", alpha=0.6, lw=0)
    axes.plot(-1.2, 24 * 1.2**2 / 125, "o", color=BLUE)
    axes.plot(1.8, 24 * 1.8**2 / 125, "o", color=RED)
    axes.text(
        0.3, 1.1, "inside the disc", ha="center", fontsize=8, backgroundcolor="#ffffff"
    )
    axes.annotate("the optimum", (-1.2, 0.28), (-2.6, 0.1), fontsize=8, color=BLUE)
    axes.annotate("local optimum", (1.8, 0.62), (1.9, 0.45), fontsize=8, color=RED)
    axes.set(
        xlabel="y of the way at x = 5 [m]",
        ylabel="cost",
        ylim=(0, 1.35),
        xlim=(-2.8, 3.6),
    )
    axes.set_title("The cost has two valleys", loc="left", fontsize=10)


def draw_terminal_set() -> Figure:
    """Draw a pendulum's terminal set and paths of the linear law around it."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    motion = ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=motion),
        horizon=2.0,
        intervals=40,
        stage_cost=u**2,
        bounds=ss.Bounds(controls=(-8, 8)),
    )
    found = ss.terminal_set_of(
        problem,
        at=[0, 0],
        weights=ss.Weights(Q=np.diag([1.0, 5.0]), R=np.eye(1)),
        rng=np.random.default_rng(0),
    )
    right_side = ca.Function("f", [x, u], [motion])
    figure, axes = plt.subplots(figsize=(5.6, 4.2), layout="constrained")
    angles = np.linspace(0, 2 * np.pi, 200)
    shape = np.linalg.cholesky(np.linalg.inv(found.P)) * np.sqrt(found.alpha)
    edge = shape @ np.array([np.cos(angles), np.sin(angles)])
    axes.fill(*edge, fc="#cfe6f3", ec=BLUE, lw=1.5, label="terminal set, certified")
    for k in range(8):
        path = _under_the_law(right_side, found.K, shape @ _direction(k), found.dt or 0)
        axes.plot(*path, color=BLUE, lw=0.9)
        axes.plot(*path[:, 0], "o", color=BLUE, ms=3)
    lost = _under_the_law(right_side, found.K, np.array([0.9, 0.7]), found.dt or 0, 0.9)
    axes.plot(*lost, "--", color=RED, label="from outside: 8 is too little, it falls")
    axes.plot(*lost[:, 0], "s", color=RED, ms=5)
    axes.plot(0, 0, "+", color="#16191d", ms=10)
    axes.set(xlabel="angle from upright [rad]", ylabel="speed [rad/s]")
    axes.set(xlim=(-1.7, 2.2), ylim=(-4.2, 4.8))
    axes.legend(fontsize=8, loc="upper right")
    return figure


def _direction(k: int) -> NDArray[np.float64]:
    return np.array([np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)])


def _under_the_law(
    f: ca.Function,
    K: NDArray[np.float64],
    e: NDArray[np.float64],
    dt: float,
    s: float = 3,
) -> NDArray[np.float64]:
    """Return the states under u = -K e, bounded by 8 and held for dt [s]."""
    states, step = [e], dt / 10
    for _ in range(round(s / dt)):
        u = np.clip(-K @ states[-1], -8, 8)
        for _ in range(10):
            half = states[-1] + step / 2 * f(states[-1], u).full().ravel()
            states.append(states[-1] + step * f(half, u).full().ravel())
    return np.array(states).T


def main() -> None:
    """Write all figures."""
    mpl.rcParams.update({"svg.hashsalt": "swarmstart", "svg.fonttype": "none"})
    mpl.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})
    for name, draw in (
        ("cart", draw_cart),
        ("passing", draw_passing),
        ("terminal_set", draw_terminal_set),
    ):
        figure = draw()
        figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
