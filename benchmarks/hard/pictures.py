"""The best optima of each hard problem side by side: the page docs/hard_optima.md.

    python benchmarks/hard/pictures.py --write docs/hard_optima.md --folder docs/hard
        [--only walls_2 ...] [--without walls_8 ...] [--seed 0]

They are those of one default call: its answer, and other optima of its lanes, polished
and confirmed. `--only` draws some problems and keeps the page.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.peers import largest_excess
from swarmstart.benchmarks.tables import command_of, page_options, publish
from swarmstart.cases.drawing.palette import LIGHT
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.hard import SHIPPED
from swarmstart.cases.hard.best_known import BestKnown, best_known
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp import OptimalControlProblem, Solution

MOST, TRIED = 3, 12
"""Number of optima that are drawn, and of those that are polished for it."""
APART = 1e-6
"""Relative difference of costs below which two optima with near paths are the same."""
GRID = 300
"""Number of points along each side of the plane at which limits are evaluated."""
POSES = 6
"""Number of times at which an arm is drawn."""
Disc = tuple[float, float, float]
"""x, y and radius."""
TEXT = """# The optima of the hard problems

This page shows the best optima of each [hard problem](hard_problems.md) side by side,
at most three. They come from one call of `solve` without options: its answer, and the
best other optima that its [lanes](glossary.md#lane) found, each polished by IPOPT. An
optimum that breaks a limit when it is integrated ten times finer is left out.
"Here" lists the costs of the pictures. The word in brackets says [how a cost is
known](hard_problems.md#best-known-values).

"""


class Drawn(NamedTuple):
    """The optima of a problem.

    Attributes:
        name: Name of the problem, without `hard/`.
        answers: Confirmed optima, the cheapest first.
    """

    name: str
    answers: Sequence[Solution]


def optima_of(name: str, seed: int) -> Drawn:
    """Return the best optima that one default call finds.

    Args:
        name: Name of the problem, without `hard/`.
        seed: Seed of the call.
    """
    posed = first_problem(resolve(read_document(f"hard/{name}")).posed())
    solved = partial(ss.solve, posed.problem, posed.x0, known=posed.known, seed=seed)
    best = solved()
    found = [best] if best.status.is_confirmed else list[Solution]()
    for optimum in best.optima[:TRIED]:
        if len(found) == MOST:
            break
        # Solved again: that repairs what breaks a limit between the checks.
        one = solved(guess=optimum.solution().controls, search=None, lanes=0)
        if one.status.is_confirmed and not any(are_same(one, other) for other in found):
            found.append(one)
    sense = -1.0 if posed.problem.maximize else 1.0
    return Drawn(name, sorted(found, key=lambda answer: sense * answer.cost))


def are_same(one: Solution, other: Solution) -> bool:
    """Return whether two answers are the same optimum: near in cost and path."""
    near = abs(one.cost - other.cost) <= APART * max(1.0, abs(other.cost))
    size = np.maximum(np.ptp(other.states, axis=1), 1e-9)[:, None]
    return bool(near and np.abs((one.states - other.states) / size).max() < 1e-2)


def picture(drawn: Drawn, path: Path) -> None:
    """Draw optima side by side into a file."""
    figure = Figure(figsize=(4 * MOST, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, MOST, sharex=True, sharey=True)
    draw = panel_of(drawn.name)
    for number, (axes, answer) in enumerate(
        zip(panels, drawn.answers, strict=False), start=1
    ):
        draw(axes, answer)
        axes.set_title(f"{number}: cost {answer.cost:.6g}", fontsize="medium")
    if draw is draw_plane:  # When all paths are there, which share their limits.
        for axes in panels[: len(drawn.answers)]:
            draw_ground(axes, drawn.answers[0].problem)
    for axes in panels[len(drawn.answers) :]:
        axes.set_axis_off()
    figure.savefig(path, dpi=70, bbox_inches="tight")


def panel_of(name: str) -> Callable[[Any, Solution], None]:
    """Return what draws an optimum of a problem."""
    family = SHIPPED[name][0]
    if family == "arms":
        return partial(draw_arm, discs_of(name))
    panels: Mapping[str, Callable[[Any, Solution], None]] = {
        "swing_up": draw_swing, "gears": draw_gears, "reorientation": draw_attitude
    }  # fmt: skip
    return panels.get(family, draw_plane)


def draw_plane(axes: Any, answer: Solution) -> None:
    """Draw positions in the plane, with blocked places grey and currents as arrows."""
    names = answer.problem.model.state_names
    rows = np.array(
        [[k, names.index(n.replace("x", "y"))] for k, n in enumerate(names) if "x" in n]
    )
    positions = answer.states[rows]
    for number, (x, y) in enumerate(positions):
        axes.plot(x, y, color=LIGHT[number % len(LIGHT)], lw=1.6)
        axes.plot(x[0], y[0], "o", color="0.2", fillstyle="none")
        axes.plot(x[-1], y[-1], "s", color="0.2", ms=5)
    axes.margins(x=0.05, y=0.3)  # What lies beside a path tells why it goes there.
    axes.set(xlabel="x", ylabel="y", aspect="equal")


def draw_ground(axes: Any, problem: OptimalControlProblem) -> None:
    """Draw blocked places grey, and currents as arrows, within the limits of axes."""
    if problem.model.state_names != ("x", "y"):
        return
    limits = axes.get_xlim(), axes.get_ylim()
    sides = [np.linspace(low, high, GRID) for low, high in limits]
    points = np.stack(np.meshgrid(*sides))
    worst = largest_excess(problem)(points.reshape(2, -1), ())
    blocked = worst.reshape(points.shape[1:])
    if (blocked > 0).any():
        axes.contourf(*points, blocked, levels=[0, np.inf], colors=["0.75"], zorder=0)
    flow(axes, problem, sides)
    axes.set(xlim=limits[0], ylim=limits[1])


def flow(axes: Any, problem: OptimalControlProblem, sides: Sequence[Array]) -> None:
    """Draw the mean rate of two opposite headings, which is the current."""
    model = problem.model
    if model.control_names != ("heading",):
        return
    rate = ca.Function("rate", [model.states, model.controls], [model.ode])
    at = np.stack(np.meshgrid(*(side[:: GRID // 15] for side in sides))).reshape(2, -1)
    values = [rate(at, np.full((1, at.shape[1]), turn)).full() for turn in (0, np.pi)]
    axes.quiver(*at, *np.mean(values, axis=0), color="0.6", width=3e-3, zorder=0)


def draw_arm(discs: Iterable[Disc], axes: Any, answer: Solution) -> None:
    """Draw an arm of links of length 1 at some times, and the discs it avoids."""
    at = np.linspace(0, answer.states.shape[1] - 1, POSES).astype(int)
    turned = np.cumsum(answer.states, axis=0)
    joints = np.zeros((2, len(turned) + 1, turned.shape[1]))
    joints[:, 1:] = np.cumsum([np.cos(turned), np.sin(turned)], axis=1)
    axes.plot(*joints[:, -1], color=LIGHT[1], lw=1.2)
    for number, k in enumerate(at):
        shade = 0.8 * (1 - number / (POSES - 1))
        axes.plot(*joints[:, :, k], "o-", color=str(shade), ms=3, lw=1.6)
    for x, y, radius in discs:
        around = np.linspace(0, 2 * np.pi, 60)
        axes.fill(x + radius * np.cos(around), y + radius * np.sin(around), "0.75")
    axes.set(xlabel="x", ylabel="y", aspect="equal")


def discs_of(name: str) -> set[Disc]:
    """Return the discs (x, y, radius) that the points of an arm avoid, by its file."""
    found = set()
    for one in resolve(read_document(f"hard/{name}")).settings["path"]:
        # Such as x1_2 + 0.364: the way from a disc's middle.
        x, y = (-float(re.sub(r"^\w+ | ", "", part)) for part in one["distance"])
        found.add((x, y, float(one["at_least"])))
    return found


def draw_swing(axes: Any, answer: Solution) -> None:
    """Draw the speed of a pendulum over its angle."""
    axes.plot(*answer.states, color=LIGHT[0], lw=1.4)
    axes.plot(*answer.states[:, 0], "o", color=LIGHT[0], fillstyle="none")
    axes.plot(*answer.states[:, -1], "s", color=LIGHT[0], ms=5)
    axes.set(xlabel="angle [rad]", ylabel="speed [rad/s]")
    axes.grid(alpha=0.3)


def draw_gears(axes: Any, answer: Solution) -> None:
    """Draw speed and gear over time."""
    names = answer.problem.model.state_names
    axes.plot(answer.times, answer.states[names.index("v")], color=LIGHT[0], label="v")
    starts = np.linspace(0, answer.times[-1], answer.controls.shape[1] + 1)
    gear = answer.controls[0]
    axes.step(starts, [*gear, gear[-1]], where="post", color=LIGHT[1], label="gear")
    axes.legend(fontsize="small")
    axes.set(xlabel="time [s]")
    axes.grid(alpha=0.3)


def draw_attitude(axes: Any, answer: Solution) -> None:
    """Draw the quaternion over time."""
    for number in range(4):
        axes.plot(
            answer.times, answer.states[number], color=LIGHT[number], label=f"q{number}"
        )
    axes.legend(fontsize="small")
    axes.set(xlabel="time [s]", ylabel="quaternion")
    axes.grid(alpha=0.3)


def section(drawn: Drawn, known: BestKnown, folder: str) -> list[str]:
    """Return the lines of the page about a problem."""
    costs = ", ".join(f"{one.cost:.7g}" for one in drawn.answers) or "none"
    value = "unknown" if known.cost is None else f"{known.cost:.9g} ({known.known_by})"
    return [
        f"## {drawn.name}", "", f"Best known: {value}. Here: {costs}.", "",
        f"![Optima of {drawn.name}]({folder}/{drawn.name}.png)", "",
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw all problems, and write the page where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="of the pictures")
    parser.add_argument("--only", nargs="*", help="names such as walls_2")
    parser.add_argument("--without", nargs="*", default=[], help="names left out")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    known, lines = best_known(), list[str]()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.only or [one for one in SHIPPED if one not in options.without]:
        drawn = optima_of(name, options.seed)
        picture(drawn, options.folder / f"{name}.png")
        lines += section(drawn, known[f"hard/{name}"], options.folder.name)
        print(name, [one.cost for one in drawn.answers], flush=True)
    if options.only:
        return 0
    made_by = f"Made by `{command_of('benchmarks/hard/pictures.py', arguments)}`.\n"
    publish([made_by, *lines[:-1]], options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
