"""Iterations of IPOPT from an answer, with its multipliers and with its states alone.

    python benchmarks/warm_starts.py [--write docs/measured/warm_starts.md]
        [--only NAME]

Twelve problems, each with a feature that the transfer of multipliers must handle, are
solved cold, and again from that answer: unchanged, on another grid, over another
horizon, from another start. Times are not measured.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.ocp.nlp.polish import Polisher

Grid = dict[str, Any]
Problem = ss.OptimalControlProblem
Pose = Callable[[int, float], tuple[Problem, list[float]]]
CHANGES = (
    "the same",
    "twice as many intervals",
    "half as many",
    "a horizon 5 % longer",
    "x0 moved by 1 %",
    "x0 moved by 5 %",
)
SETTINGS: dict[str, dict[str, Any]] = {
    "One polish": {"search": None, "lanes": 0, "repair": False},
    "With lanes and repair": {"search": None},
}
"""Arguments of `solve` by the name of their table on the page."""
TEXT = """# Iterations saved by warm starts

Made by `python benchmarks/warm_starts.py --write docs/measured/warm_starts.md`: all
iterations of IPOPT in a call of `solve`, summed over twelve problems (active
constraints, free end time, soft constraints, rate limits, blocks, linear controls,
collocation, ensembles, maximised), and in brackets the number of problems in which a
call with a guess takes fewer iterations than a cold call. [Warm starts that
travel](../answers.md#warm-starts-that-travel) shows how to use it. With
[lanes](../glossary.md#lane), IPOPT polishes the best answers of the lanes as well as
the guess, so a guess saves nothing on nearly all problems.

Made on another machine, the rows of a problem may differ: every number by 20 % or 3,
whichever is more.

"""


def cart(intervals: int, stretch: float, **more: Any) -> tuple[Problem, list[float]]:
    """Return a pendulum that comes to rest, with bounded torque, and its start."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    given: Grid = {
        "horizon": 3.0 * stretch,
        "intervals": intervals,
        "stage_cost": ca.sumsqr(x) + 0.1 * u**2,
        "bounds": ss.Bounds(controls=(-1, 1)),
        **more,
    }
    model = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0])))
    return Problem(model, **given), [1.0, 0.0]


def van_der_pol(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return the oscillator with a bound of a state that is active."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rates = ca.vertcat((1 - x[1] ** 2) * x[0] - x[1] + u, x[0])
    bounds = ss.Bounds(controls=(-1, 1), states=([-0.25, -np.inf], [np.inf, np.inf]))
    return Problem(
        ss.Model(states=x, controls=u, ode=rates), horizon=10 * stretch,
        intervals=intervals, stage_cost=ca.sumsqr(x) + u**2, bounds=bounds, checks=2,
        substeps=2,
    ), [0.0, 1.0]  # fmt: skip


def wall(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return Bryson and Denham's problem: a path constraint that is touched."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    limit = ss.PathConstraint(expression=x[0], upper=1 / 9, name="wall")
    return Problem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=stretch,
        intervals=intervals, stage_cost=u**2 / 2, constraints=[limit],
        terminal=[(x, [0, -1])],
    ), [0.0, 1.0]  # fmt: skip


def quickest(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return a free end time; it has no horizon to stretch."""
    del stretch
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return Problem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 0.2 * x[1])),
        horizon=ss.Free(0.5, 10, 2.0), intervals=intervals,
        stage_cost=1 + 0.01 * u**2, bounds=ss.Bounds(controls=(-1, 1)),
        terminal=[(x, [2, 0])],
    ), [0.0, 0.0]  # fmt: skip


def discs(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return a vehicle past two discs, in a free time."""
    del stretch
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    apart = [
        ss.Separation(relative=x[:2] - ca.DM([a, b]), distance=r, name=f"disc {a}")
        for a, b, r in ((3, 0.3, 0.9), (6, -0.6, 1.0))
    ]
    return Problem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u)),
        horizon=ss.Free(8, 20, 12), intervals=intervals, stage_cost=1 + 0.1 * u**2,
        bounds=ss.Bounds(controls=(-3, 3)), constraints=apart,
        terminal=[(x[:2], [10, 0])],
    ), [0.0, 0.0, 0.3]  # fmt: skip


def harvest(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return a problem whose cost is maximised."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return Problem(
        ss.Model(states=x, controls=u, ode=x - 0.1 * x**2 - u), horizon=3 * stretch,
        intervals=intervals, stage_cost=ca.sqrt(u + 0.01), terminal=[(x, 2.0)],
        maximize=True, bounds=ss.Bounds(controls=(0, 2)),
    ), [1.0]  # fmt: skip


def soft(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return a soft constraint that is broken."""
    problem, x0 = cart(intervals, stretch, bounds=ss.Bounds(controls=(-2, 2)))
    slow = ss.PathConstraint(expression=problem.model.states[1], lower=-0.3,
                             name="slow", weight=1.0, quadratic_weight=2.0)  # fmt: skip
    return replace(problem, constraints=[slow]), x0


def rates(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return a limit of how fast the control moves."""
    problem, x0 = cart(intervals, stretch)
    before, most = ca.SX.sym("v"), 4 * 3.0 * stretch / intervals
    limit = ss.PathConstraint(expression=problem.model.controls - before, lower=-most,
                              upper=most, name="rate")  # fmt: skip
    return replace(problem, previous=before, constraints=[limit]), x0


def blocks(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
    """Return controls that stay over several intervals."""
    return cart(intervals, stretch, blocks=(1, 1) + (2,) * (intervals // 2 - 1))


def members(risk: Literal["mean", "worst"]) -> Pose:
    """Return a function that poses an ensemble of three."""

    def pose(intervals: int, stretch: float) -> tuple[Problem, list[float]]:
        problem, x0 = cart(intervals, stretch)
        p, model = ca.SX.sym("p"), problem.model
        x, u = model.states, model.controls
        own = ss.Model(states=x, controls=u, parameters=p,
                       ode=ca.vertcat(x[1], u - p * ca.sin(x[0])))  # fmt: skip
        one = replace(problem, model=own)
        return ss.ensemble(one, {"p": [0.5, 1.0, 1.5]}, risk=risk), x0

    return pose


PROBLEMS: dict[str, Pose] = {
    "bound of a state": van_der_pol,
    "path constraint": wall,
    "free end time": quickest,
    "discs": discs,
    "maximised": harvest,
    "soft constraint": soft,
    "rate limit": rates,
    "blocks": blocks,
    "linear controls": lambda n, t: cart(n, t, control_shape="linear"),
    "collocation": lambda n, t: cart(n, t, transcription="radau"),
    "ensemble, mean": members("mean"),
    "ensemble, worst": members("worst"),
}


def tasks(pose: Pose) -> Iterator[tuple[Problem, Array]]:
    """Yield the problems that are solved again, in the order of WAYS."""
    problem, given = pose(20, 1.0)
    x0 = np.array(given)
    yield problem, x0
    for intervals, stretch in ((40, 1.0), (10, 1.0), (20, 1.05)):
        yield pose(intervals, stretch)[0], x0
    for part in (0.01, 0.05):
        yield problem, x0 + part * np.maximum(np.abs(x0), 0.1)


def iterations(name: str, settings: dict[str, Any]) -> Array:
    """Return the iterations of a problem, shape (changes, 3).

    The columns are: with multipliers, with states and controls alone, cold.

    Args:
        name: A key of PROBLEMS.
        settings: Arguments of `solve`.
    """
    spent: list[int] = []
    once = Polisher._solve

    def counted(self: Polisher, *given: Any, **more: Any) -> Any:
        answer = once(self, *given, **more)
        spent.append(answer.effort[0])
        return answer

    problem, x0 = PROBLEMS[name](20, 1.0)
    answer, rows = ss.solve(problem, x0, seed=0, **settings), []
    Polisher._solve = counted  # type: ignore[method-assign]
    try:
        for other, start in tasks(PROBLEMS[name]):
            guess = answer.as_guess(other)
            rows.append(list[int]())
            for one in (guess, guess._replace(carried=None), None):
                spent.clear()
                ss.solve(other, start, guess=one, seed=0, **settings)
                rows[-1].append(sum(spent))
    finally:
        Polisher._solve = once  # type: ignore[method-assign]
    return np.array(rows, dtype=float)


def tables(names: Sequence[str]) -> list[str]:
    """Return the sums over problems and those of each, with each of SETTINGS."""
    lines: list[str] = []
    for title, settings in SETTINGS.items():
        found = {name: iterations(name, settings) for name in names}
        every = np.array([*found.values()])
        given = ", ".join(f"{key}={value}" for key, value in settings.items())
        ways = ("with multipliers", "states and controls alone", "cold")
        lines += [f"## {title}: `{given}`", "", *head("solved again", *ways)]
        for k, change in enumerate(CHANGES):
            of_all = every[:, k]
            saved = (of_all[:, :2] < of_all[:, 2:]).sum(axis=0)
            sums = of_all.sum(axis=0)
            warm = [f"{n:.0f} ({m})" for n, m in zip(sums[:2], saved, strict=True)]
            lines.append(row(change, *warm, f"{sums[2]:.0f}"))
        lines += ["", "With multipliers / alone / cold:", ""]
        lines += head("problem", *CHANGES)
        for name, counts in found.items():
            cells = ["/".join(f"{n:.0f}" for n in change) for change in counts]
            lines.append(row(name, *cells))
        lines.append("")
    return lines[:-1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print the tables, and write the page if that is asked for."""
    parser = page_options(__doc__)
    parser.add_argument("--only", action="append", choices=PROBLEMS, help="a problem")
    options = parser.parse_args(arguments)
    publish(tables(options.only or list(PROBLEMS)), options, TEXT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
