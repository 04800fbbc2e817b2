"""Smooth problems with active constraints along the path.

Speed limits, tracking above a bound, back-EMF and mixed constraints are convex programs
with rows at many points of each interval; the same in other coordinates is nonlinear.
Limits of power, |u v|, are one state, and were solved by dynamic programming.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import (
    Case,
    Formulas,
    equal,
    known,
    limits,
)
from swarmstart.tests.adversary.charts import CHARTS, charted_case
from swarmstart.tests.adversary.drawing import (
    chain,
    drawn_cases,
    last,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.convex import UnsolvedError
from swarmstart.tests.adversary.exact.held_linear import End, Linear, Path
from swarmstart.tests.adversary.judge import Rows, Truth
from swarmstart.tests.adversary.linear_case import linear_case

KIND = "path_constrained"
GENERATED = 36
COARSE = 3
"""Cases whose least cost, seen at the ends of the intervals only, cuts a corner."""


def _rest(distance: float) -> End:
    goal = np.array([distance, 0.0])
    return End(np.eye(2), goal, goal)


def _speed_limit(rng: np.random.Generator) -> Linear:
    """Draw a transfer whose least energy would be faster than is allowed."""
    distance, horizon = rng.uniform(0.5, 2.0), float(rng.uniform(1.0, 3.0))
    speed = distance / horizon * rng.uniform(1.15, 1.4)
    return Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.zeros(2), horizon=horizon,
        intervals=int(rng.integers(10, 18)), end=_rest(distance),
        controls=symmetric_limits(np.full(1, 15 * distance / horizon**2)),
        states=(np.array([-np.inf, -speed]), np.array([np.inf, speed])),
    )  # fmt: skip


def _tracking(rng: np.random.Generator) -> Linear:
    """Draw a state that is to follow a level above its bound."""
    bound = rng.uniform(0.5, 1.0)
    return Linear(
        A=np.array([[-rng.uniform(0.2, 1.0)]]), B=np.eye(1), Q=np.eye(1),
        q=np.array([-4 * bound]), R=np.eye(1) * 0.05, x0=rng.uniform(-0.5, 0.2, 1),
        horizon=2.0, intervals=int(rng.integers(8, 16)),
        controls=symmetric_limits(np.full(1, 4.0)),
        states=(np.full(1, -2.0), np.array([bound])),
    )  # fmt: skip


def _motor(rng: np.random.Generator) -> Linear:
    """Draw a motor whose voltage, u + k v, is limited; v is the second state."""
    k, voltage = rng.uniform(0.5, 1.0), rng.uniform(0.8, 1.2)
    path = Path(
        np.array([[0.0, k]]), np.eye(1), np.array([-voltage]), np.array([voltage])
    )
    return Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.zeros(2), horizon=3.0,
        intervals=int(rng.integers(10, 16)), controls=symmetric_limits(np.full(1, 3.0)),
        end=_rest(rng.uniform(0.9, 1.1) * voltage), path=path,
    )  # fmt: skip


def _lower_speed(rng: np.random.Generator) -> Linear:
    """Draw a body with drag that slows down to a lowest speed and up again."""
    slow, drag = rng.uniform(0.4, 0.7), rng.uniform(0.1, 0.8)
    A = np.array([[0.0, 1.0], [0.0, -drag]])
    goal = np.array([2.0 * slow * 1.25, 1.0])
    return Linear(
        A=A, B=last(2), R=np.eye(1), x0=np.array([0.0, 1.0]), horizon=2.0,
        intervals=int(rng.integers(10, 16)), controls=symmetric_limits(np.full(1, 8.0)),
        end=End(np.eye(2), goal, goal),
        states=(np.array([-np.inf, slow]), np.full(2, np.inf)),
    )  # fmt: skip


def wall(rng: np.random.Generator) -> Linear:
    """Draw a body thrown at a wall, to be caught before it and brought back."""
    speed, wall = rng.uniform(0.8, 1.2), rng.uniform(0.12, 0.16)
    return Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.array([0.0, speed]), horizon=1.0,
        intervals=int(rng.integers(10, 16)),
        controls=symmetric_limits(np.full(1, 12.0)),
        end=End(np.eye(2), np.array([0.0, -speed]), np.array([0.0, -speed])),
        states=(np.full(2, -np.inf), np.array([wall, np.inf])),
    )  # fmt: skip


LINEAR: dict[str, Callable[[np.random.Generator], Linear]] = {
    "speed limit": _speed_limit,
    "tracking above a bound": _tracking,
    "motor": _motor,
    "lowest speed": _lower_speed,
    "wall": wall,
}


def _drawn(rng: np.random.Generator, number: int) -> Case:
    family = number % (len(LINEAR) + 1)
    if family < len(LINEAR):
        name, draw = list(LINEAR.items())[family]
        linear, checks = draw(rng), 4 if name == "wall" else 2
        return linear_case(KIND, f"{name} {number}", linear, checks=checks)
    name, chart = list(CHARTS.items())[(number // 6) % len(CHARTS)]
    low, high = max(chart.lower, -1.5), min(chart.upper, 1.5)
    bound, x0 = low + np.array([0.7, 0.2]) * (high - low)
    rate = rng.uniform(0.2, 0.6)
    linear = Linear(
        A=np.array([[-rate]]), B=np.eye(1), c=rate * bound[None], Q=np.eye(1),
        q=np.array([-2 * (bound + 0.3)]), R=np.eye(1) * 0.05, x0=x0[None], horizon=2.0,
        intervals=10, controls=symmetric_limits(np.full(1, 3.0)),
        states=(np.full(1, -np.inf), np.array([bound])),
    )  # fmt: skip
    return charted_case(KIND, f"{name}, bounded {number}", linear, chart)


POWERS = {1.15: 2.333171, 1.2: 2.219680, 1.35: 2.076564, 1.5: 2.027305, 1.8: 2.001710}
"""Least energy of braking from 2 to 0 in 2 s, by the limit of power; by SLSQP from many
starts, and by dynamic programming in the tests."""


def braking(power: float, *, optimum: float) -> Case:
    """Return v' = u, v(0) = 2, v(2) = 0, -u v <= power; least integral of u^2.

    Args:
        power: The limit; it binds at the beginning of an interval, where v is largest.
        optimum: The least cost.
    """
    case = Case(
        name=f"{KIND}/braking with power {power:g}",
        kind=KIND,
        formulas=lambda v, u: Formulas(u, u**2, path=-u * v, terminal=v),
        truth=Truth(
            dynamics=lambda v, u: u,
            stage_cost=lambda v, u: float(u[0] * u[0]),
            path=Rows(
                value=lambda v, u: -u * v,
                lower=np.full(1, -np.inf),
                upper=np.array([power]),
            ),
            terminal=equal(lambda v, _: v, 0.0),
            controls=limits(-6.0, 1.0),
            x0=np.full(1, 2.0),
            horizon=2.0,
            intervals=16,
            sizes=np.ones(1),
        ),
        checks=2,
        substeps=2,
    )
    return known(case, optimum)


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(8)

    def draw(number: int) -> Case:
        case = _drawn(rng, number)
        if case.best is None or case.truth.lowest > case.truth.highest:
            raise UnsolvedError(case.name)
        return case

    made = list(drawn_cases(GENERATED, draw))
    for number in range(COARSE):
        linear = replace(wall(rng), intervals=8)
        made.append(linear_case(KIND, f"wall, seen once an interval {number}", linear))
    return made + [braking(power, optimum=least) for power, least in POWERS.items()]
