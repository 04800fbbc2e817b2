"""Problems with a free end time: the time of each interval is a control.

    dx/ds = tau f(x, u),  0 <= s <= 1,   J = integral of tau (1 + cost) ds

tau, the stretch, is held on each interval, so that a control may switch at any time:
least times are those of continuous time, in closed form.

Source: Bryson and Ho (1975), Applied Optimal Control, chapter 3.9.
"""

from collections.abc import Callable

import casadi as ca
import numpy as np

from swarmstart.tests.adversary.case import Case, Formulas, equal, known, limits
from swarmstart.tests.adversary.judge import NO_ROWS, Rows, Truth

KIND = "free_end_time"
GENERATED = 30
Drawn = tuple[Callable[[ca.SX, ca.SX], Formulas], Truth, float]


def least_time(x: float, v: float, *, force: float) -> float:
    """Return the least time of x'' = u, |u| <= force, to rest at zero.

    First one bound, then the other: the parabola through the origin decides which.
    """
    if x < -v * abs(v) / (2 * force):
        x, v = -x, -v
    peak = np.sqrt(max(v * v / 2 + force * x, 0.0))
    return float((v + 2 * peak) / force)


def _double(rng: np.random.Generator) -> Drawn:
    """Draw a double integrator to be brought to rest."""
    x0, force = rng.uniform(-1.5, 1.5, 2), rng.uniform(0.5, 2.0)
    longest = 3 * least_time(*x0, force=force)
    truth = Truth(
        dynamics=lambda x, u: u[1] * np.array([x[1], u[0]]),
        stage_cost=lambda x, u: float(u[1]),
        terminal=equal(lambda x, _: x, [0.0, 0.0]),
        controls=limits([-force, 0.0], [force, longest]),
        x0=x0,
        horizon=1.0,
        intervals=6,
        sizes=np.ones(2),
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        return Formulas(u[1] * ca.vertcat(x[1], u[0]), u[1], terminal=x)

    return formulas, truth, least_time(*x0, force=force)


def _speed_limited(rng: np.random.Generator) -> Drawn:
    """Draw a double integrator with a speed limit: d / v + v / a."""
    force, speed = rng.uniform(0.5, 2.0, 2)
    distance = speed**2 / force * rng.uniform(1.2, 3.0)
    least = distance / speed + speed / force
    truth = Truth(
        dynamics=lambda x, u: u[1] * np.array([x[1], u[0]]),
        stage_cost=lambda x, u: float(u[1]),
        path=Rows(
            value=lambda x, u: x[1:], lower=np.full(1, -speed), upper=np.full(1, speed)
        ),
        terminal=equal(lambda x, _: x, [0.0, 0.0]),
        controls=limits([-force, 0.0], [force, 3 * least]),
        x0=np.array([-distance, 0.0]),
        horizon=1.0,
        intervals=6,
        sizes=np.ones(2),
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        return Formulas(u[1] * ca.vertcat(x[1], u[0]), u[1], path=x[1], terminal=x)

    return formulas, truth, least


def _time_and_energy(rng: np.random.Generator) -> Drawn:
    """Draw x' = u, T + w * energy, to zero: u = 1 / sqrt(w), J = 2 |x0| sqrt(w)."""
    x0, w = rng.uniform(0.5, 3.0), rng.uniform(0.1, 2.0)
    truth = Truth(
        dynamics=lambda x, u: u[1] * u[:1],
        stage_cost=lambda x, u: float(u[1] * (1 + w * u[0] * u[0])),
        terminal=equal(lambda x, _: x, 0.0),
        controls=limits([-3 / np.sqrt(w), 0.0], [3 / np.sqrt(w), 5 * x0 * np.sqrt(w)]),
        x0=np.array([x0]),
        horizon=1.0,
        intervals=5,
        sizes=np.ones(1),
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        return Formulas(u[1] * u[0], u[1] * (1 + w * u[0] ** 2), terminal=x)

    return formulas, truth, 2 * x0 * np.sqrt(w)


def _exponential(rng: np.random.Generator) -> Drawn:
    """Draw x' = a x + u, |u| <= m, least time to zero: log(1 + a x0 / m) / a.

    With a > 0 it is -log(1 - a x0 / m) / a.
    """
    a, m = rng.uniform(-1.0, 1.0), rng.uniform(0.5, 2.0)
    x0 = m / abs(a) * rng.uniform(0.2, 0.7)
    least = float(-np.log1p(-a * x0 / m) / a)
    truth = Truth(
        dynamics=lambda x, u: u[1] * (a * x + u[:1]),
        stage_cost=lambda x, u: float(u[1]),
        terminal=equal(lambda x, _: x, 0.0),
        controls=limits([-m, 0.0], [m, 3 * least]),
        x0=np.array([x0]),
        horizon=1.0,
        intervals=5,
        sizes=np.ones(1),
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        return Formulas(u[1] * (a * x + u[0]), u[1], terminal=x)

    return formulas, truth, least


def _boat(rng: np.random.Generator) -> Drawn:
    """Draw a boat in a steady current, least time to a point: a straight line."""
    goal, current = rng.uniform(-2.0, 2.0, 2), rng.uniform(-0.5, 0.5, 2)
    # |goal - T current| = T, the larger root is the positive one.
    a, b, c = 1 - current @ current, goal @ current, -goal @ goal
    least = float((-b + np.sqrt(b * b - a * c)) / a)
    drift = ca.DM(current)
    truth = Truth(
        dynamics=lambda x, u: u[1] * (np.array([np.cos(u[0]), np.sin(u[0])]) + current),
        stage_cost=lambda x, u: float(u[1]),
        path=NO_ROWS,
        terminal=equal(lambda x, _: x, goal),
        controls=limits([-4.0, 0.0], [4.0, 4 * least]),
        x0=np.zeros(2),
        horizon=1.0,
        intervals=5,
        sizes=np.ones(2),
    )

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        heading = ca.vertcat(ca.cos(u[0]), ca.sin(u[0]))
        return Formulas(u[1] * (heading + drift), u[1], terminal=x)

    return formulas, truth, least


FAMILIES = {
    "double integrator": _double,
    "double integrator with a speed limit": _speed_limited,
    "time and energy": _time_and_energy,
    "exponential": _exponential,
    "boat in a current": _boat,
}


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng, made = np.random.default_rng(9), []
    for number in range(GENERATED):
        name, draw = list(FAMILIES.items())[number % len(FAMILIES)]
        formulas, truth, least = draw(rng)
        case = Case(
            name=f"{KIND}/{name} {number}", kind=KIND, formulas=formulas, truth=truth,
            checks=2, is_counted=False,
        )  # fmt: skip
        made.append(known(case, least))
    return made
