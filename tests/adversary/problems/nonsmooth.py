"""Discontinuous and non-smooth problems with a known optimum.

Kinks in the controls (prices of |u|, dead zones, gains, gears), in the states (dry
friction) and in the cost of the final state (stairs, windows, cusps).
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case, Formulas
from swarmstart.tests.adversary.drawing import (
    chain,
    drawn_cases,
    last,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.convex import UnsolvedError
from swarmstart.tests.adversary.exact.held_linear import End, Linear
from swarmstart.tests.adversary.judge import replay
from swarmstart.tests.adversary.linear_case import (
    formulas_of,
    linear_case,
)
from swarmstart.tests.adversary.problems.kinked_controls import (
    KIND,
    gear,
    passed_on,
    priced,
    two_gains,
)
from swarmstart.tests.adversary.problems.kinked_ends import END_COSTS
from swarmstart.tests.adversary.reach_case import reach_case

GENERATED = 40
SEARCHED = 1e-2
"""Relative: how near an optimum is that only a search can find."""


def _transfer(rng: np.random.Generator) -> Linear:
    """Draw a double integrator from rest to rest, with more time than it needs."""
    distance, force = rng.uniform(0.5, 2.0, 2)
    least = 2 * np.sqrt(distance / force)
    return Linear(
        A=chain(2), B=last(2), x0=np.array([distance, 0.0]),
        horizon=float(least * rng.uniform(1.2, 2.0)),
        intervals=int(rng.integers(8, 16)),
        controls=symmetric_limits(np.array([force])),
        end=End(np.eye(2), np.zeros(2), np.zeros(2)),
    )  # fmt: skip


def _lag(rng: np.random.Generator) -> Linear:
    """Draw x' = -a x + u that is to follow a level."""
    level = rng.uniform(0.5, 1.5)
    return Linear(
        A=np.array([[-rng.uniform(0.2, 1.0)]]), B=np.eye(1), Q=np.eye(1),
        q=np.array([-2 * level]), x0=rng.uniform(-1.0, 0.3, 1),
        horizon=float(rng.uniform(1.5, 3.0)), intervals=int(rng.integers(6, 14)),
        controls=symmetric_limits(rng.uniform(1.0, 2.0, 1)),
    )  # fmt: skip


def _friction(rng: np.random.Generator, name: str) -> Case:
    """Draw a body with dry friction that slows down, and never stops."""
    friction, drag = rng.uniform(0.2, 1.0, 2)
    v0, v1 = rng.uniform(1.0, 2.5, 2)
    moving = Linear(
        A=np.array([[0.0, 1.0], [0.0, -drag]]), B=last(2), c=np.array([0.0, -friction]),
        R=np.eye(1), x0=np.array([0.0, v0]), horizon=2.0, intervals=10,
        controls=symmetric_limits(np.full(1, 6.0)),
        end=End(np.eye(2), np.array([v0 + v1, v1]), np.array([v0 + v1, v1])),
    )  # fmt: skip
    done = linear_case(KIND, f"dry friction {name}", moving)
    flown = None if done.best is None else replay(done.truth, done.best)
    if flown is None or flown.states[:, 1].min() < 0.2:
        raise UnsolvedError("it stops")
    still = replace(moving, c=np.empty(0))

    def formulas(x: ca.SX, u: ca.SX) -> Formulas:
        flat = formulas_of(still, x, u)
        return flat._replace(ode=flat.ode - ca.vertcat(0, friction * ca.sign(x[1])))

    def dynamics(x: Array, u: Array) -> Array:
        slowed = u[0] - drag * x[1] - friction * np.sign(x[1])
        return np.array([x[1], slowed])

    truth = replace(done.truth, dynamics=dynamics, kinks=lambda x, u: x[1:])
    return replace(done, formulas=formulas, truth=truth)


def _end(rng: np.random.Generator, name: str, number: int) -> Case:
    """Return an energy and a cost of the final state with kinks or jumps."""
    label, draw = list(END_COSTS.items())[number % len(END_COSTS)]
    nx = int(rng.integers(1, 3))
    linear = Linear(
        A=chain(nx), B=last(nx), x0=rng.uniform(-0.3, 0.3, nx), horizon=1.5,
        intervals=int(rng.integers(4, 9)), controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip
    return reach_case(
        KIND, f"{label} {name}", linear, draw(rng), C=np.eye(nx)[:1],
        weight=float(rng.uniform(0.2, 0.6)), relative=SEARCHED,
    )  # fmt: skip


def _fuel(rng: np.random.Generator, name: str) -> Case:
    return priced(f"least fuel {name}", _transfer(rng), 1.0, 1.0)


def _fuel_and_energy(rng: np.random.Generator, name: str) -> Case:
    plain = replace(_transfer(rng), R=_weight(rng))
    return priced(f"fuel and energy {name}", plain, 1.0, 1.0)


def _two_prices(rng: np.random.Generator, name: str) -> Case:
    up, down = rng.uniform(0.2, 0.5), -rng.uniform(0.0, 0.2)
    return priced(f"two prices {name}", _lag(rng), up, down)


def _dead_zone(rng: np.random.Generator, name: str) -> Case:
    plain = replace(_lag(rng), R=_weight(rng))
    return passed_on(f"dead zone {name}", plain, dead=0.4, full=1.5)


def _saturation(rng: np.random.Generator, name: str) -> Case:
    plain = replace(_transfer(rng), R=_weight(rng))
    full = float(plain.controls[1][0])
    return passed_on(f"saturation {name}", plain, dead=0.0, full=full)


def _gains(rng: np.random.Generator, name: str) -> Case:
    up, down = rng.uniform(0.5, 2.0, 2)
    return two_gains(f"two gains {name}", _lag(rng), up, down)


def _weight(rng: np.random.Generator) -> Array:
    return np.eye(1) * rng.uniform(0.05, 0.3)


FAMILIES = (
    _fuel,
    _fuel_and_energy,
    _two_prices,
    _dead_zone,
    _saturation,
    _friction,
    _gains,
    lambda rng, name: gear(rng, f"gear {name}"),
)


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(7)

    def draw(number: int) -> Case:
        return FAMILIES[number % len(FAMILIES)](rng, f"{number}")

    made = list(drawn_cases(GENERATED, draw))
    return made + [_end(rng, f"{k}", k) for k in range(2 * len(END_COSTS))]
