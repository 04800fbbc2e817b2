"""Problems with many local optima, of which the global one is known.

The cost of the final state has many wells; how much energy each costs is known in
closed form, so that the best is found on a grid of one or two numbers.

Source: Rastrigin (1974); Himmelblau (1972), Applied Nonlinear Programming; the camel:
Dixon and Szegoe (1978), Towards Global Optimization 2.
"""

from collections.abc import Callable

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.drawing import (
    chain,
    last,
    random_system,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.held_linear import Linear
from swarmstart.tests.adversary.reach_case import EndCost, reach_case

KIND = "multimodal"
GENERATED = 30


def _rastrigin(rng: np.random.Generator) -> EndCost:
    t, a, b = rng.uniform(-2, 2), rng.uniform(0.2, 1.0), rng.uniform(1.0, 3.0)
    w = rng.uniform(3.0, 6.0)
    return EndCost(
        symbolic=lambda y: a * (y - t) ** 2 + b * (1 - ca.cos(w * (y - t))),
        numeric=lambda y: (a * (y - t) ** 2 + b * (1 - np.cos(w * (y - t))))[0],
    )


def _two_wells(rng: np.random.Generator) -> EndCost:
    c, a, tilt = rng.uniform(-1, 1), rng.uniform(1.0, 4.0), rng.uniform(-1.0, 1.0)
    return EndCost(
        symbolic=lambda y: a * ((y - c) ** 2 - 1) ** 2 + tilt * y + 5,
        numeric=lambda y: a * ((y[0] - c) ** 2 - 1) ** 2 + tilt * y[0] + 5,
    )


def _hidden_well(rng: np.random.Generator) -> EndCost:
    near, far = rng.uniform(0.3, 0.8), rng.uniform(-3.0, -2.0)
    width, depth = rng.uniform(0.15, 0.4), rng.uniform(4.0, 8.0)
    return EndCost(
        symbolic=lambda y: (
            10 + (y - near) ** 2 - depth * ca.exp(-(((y - far) / width) ** 2))
        ),
        numeric=lambda y: (
            10 + (y[0] - near) ** 2 - depth * np.exp(-(((y[0] - far) / width) ** 2))
        ),
    )


def _waves(rng: np.random.Generator) -> EndCost:
    w1, w2, shift = rng.uniform(2, 4), rng.uniform(5, 8), rng.uniform(0, 6)
    return EndCost(
        symbolic=lambda y: 4 + 2 * ca.sin(w1 * y + shift) + ca.sin(w2 * y),
        numeric=lambda y: 4 + 2 * np.sin(w1 * y[0] + shift) + np.sin(w2 * y[0]),
    )


def _himmelblau(rng: np.random.Generator) -> EndCost:
    a, b = rng.uniform(10, 12), rng.uniform(6, 8)
    return EndCost(
        symbolic=lambda y: (
            1 + (y[0] ** 2 + y[1] - a) ** 2 / 10 + (y[0] + y[1] ** 2 - b) ** 2 / 10
        ),
        numeric=lambda y: (
            1 + (y[0] * y[0] + y[1] - a) ** 2 / 10 + (y[0] + y[1] * y[1] - b) ** 2 / 10
        ),
    )


def _camel(rng: np.random.Generator) -> EndCost:
    c, d = rng.uniform(-0.5, 0.5, 2)

    def polynomial(p: Array, q: Array) -> Array:
        value: Array = (4 - 2.1 * p * p + p**4 / 3) * p * p + p * q + 3
        value += 4 * (q * q - 1) * q * q
        return value

    def hump(p: ca.SX, q: ca.SX) -> ca.SX:
        return 4 * p**2 - 2.1 * p**4 + p**6 / 3 + p * q - 4 * q**2 + 4 * q**4 + 3

    return EndCost(
        symbolic=lambda y: hump(y[0] - c, y[1] - d),
        numeric=lambda y: polynomial(y[0] - c, y[1] - d),
    )


FAMILIES: dict[str, tuple[int, Callable[[np.random.Generator], EndCost]]] = {
    "Rastrigin": (1, _rastrigin),
    "two wells": (1, _two_wells),
    "a hidden well": (1, _hidden_well),
    "waves": (1, _waves),
    "Himmelblau": (2, _himmelblau),
    "camel": (2, _camel),
}


def _system(rng: np.random.Generator, outputs: int) -> tuple[Linear, Array]:
    """Return a system that starts near zero and its outputs."""
    horizon, nx = float(rng.uniform(1.0, 3.0)), int(rng.integers(outputs, outputs + 2))
    A, B = random_system(rng, nx=nx, nu=outputs, horizon=horizon)
    if rng.random() < 0.4 and outputs == 1:
        A, B = chain(nx), last(nx)
    linear = Linear(
        A=A, B=B, x0=rng.uniform(-0.3, 0.3, nx), horizon=horizon,
        intervals=int(rng.integers(5, 12)),
        controls=symmetric_limits(np.full(outputs, 1e3)),
    )  # fmt: skip
    return linear, np.eye(nx)[:outputs]


def _drawn(rng: np.random.Generator, number: int) -> Case:
    name, (outputs, draw) = list(FAMILIES.items())[number % len(FAMILIES)]
    linear, C = _system(rng, outputs)
    weight = float(rng.uniform(0.02, 0.1))
    return reach_case(KIND, f"{name} {number}", linear, draw(rng), C=C, weight=weight)


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(5)
    return [_drawn(rng, number) for number in range(GENERATED)]
