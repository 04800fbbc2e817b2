"""Problems with bang-bang controls or singular arcs.

The cost is linear, so that the control jumps between its bounds, or quadratic in the
states without any control in it, so that it does so until a singular arc begins; in
Fuller's problem it chatters. Optima are those of linear and quadratic programs.

Source: Bryson and Ho (1975), Applied Optimal Control, chapters 3.9 and 8;
Fuller (1963), Study of an optimum non-linear control system.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.drawing import (
    chain,
    drawn_cases,
    last,
    random_system,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.held_linear import End, Linear
from swarmstart.tests.adversary.linear_case import linear_case

KIND = "bang_bang_or_singular"
GENERATED = 30


def _farthest(rng: np.random.Generator) -> Linear:
    """Draw a double integrator that goes as far as it can and stops."""
    return Linear(
        A=chain(2), B=last(2), p=np.array([-1.0, 0.0]), x0=rng.normal(size=2) * 0.5,
        horizon=float(rng.uniform(1.5, 4.0)), intervals=int(rng.integers(6, 16)),
        controls=symmetric_limits(rng.uniform(0.8, 2.0, 1)),
        end=End(np.eye(2)[1:], np.zeros(1), np.zeros(1)),
    )  # fmt: skip


def _linear_end(rng: np.random.Generator) -> Linear:
    """Draw a system whose final state is to be far in some direction."""
    nx, horizon = int(rng.integers(2, 4)), float(rng.uniform(1.0, 4.0))
    A, B = random_system(rng, nx=nx, nu=1, horizon=horizon)
    return Linear(
        A=A, B=B, p=rng.normal(size=nx), x0=rng.normal(size=nx), horizon=horizon,
        intervals=int(rng.integers(6, 16)), controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip


def _least_area(rng: np.random.Generator) -> Linear:
    """Draw a double integrator that comes to rest with the least integral of x."""
    return Linear(
        A=chain(2), B=last(2), q=np.array([1.0, 0.0]),
        x0=np.array([rng.uniform(0.5, 1.5), rng.uniform(-0.5, 0.5)]),
        horizon=float(rng.uniform(3.5, 5.0)), intervals=int(rng.integers(8, 16)),
        controls=symmetric_limits(np.ones(1)),
        end=End(np.eye(2), np.zeros(2), np.zeros(2)),
    )  # fmt: skip


def _singular(rng: np.random.Generator) -> Linear:
    """Draw a state that is brought to a level, and held there: a singular arc."""
    level = rng.uniform(-0.5, 0.5)
    return Linear(
        A=np.array([[rng.uniform(-1.0, 0.6)]]), B=np.eye(1), Q=np.eye(1),
        q=np.array([-2 * level]), x0=np.array([rng.uniform(0.6, 1.2)]),
        horizon=float(rng.uniform(2.0, 4.0)), intervals=int(rng.integers(8, 20)),
        controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip


def _fuller(rng: np.random.Generator) -> Linear:
    """Draw Fuller's problem: the integral of a position's square, nothing else."""
    return Linear(
        A=chain(2), B=last(2), Q=np.diag([1.0, 0.0]),
        x0=np.array([rng.uniform(0.5, 1.5), rng.uniform(-1.0, 1.0)]),
        horizon=float(rng.uniform(3.0, 6.0)), intervals=int(rng.integers(10, 20)),
        controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip


FAMILIES = {
    "farthest": _farthest,
    "linear end": _linear_end,
    "least area": _least_area,
    "singular": _singular,
    "Fuller": _fuller,
}


def _drawn(rng: np.random.Generator, number: int) -> Case:
    name, draw = list(FAMILIES.items())[number % len(FAMILIES)]
    return linear_case(KIND, f"{name} {number}", draw(rng), absolute=1e-4)


def _written() -> dict[str, Linear]:
    """Return problems written by hand."""
    one = symmetric_limits(np.ones(1))
    far = Linear(
        A=chain(2), B=last(2), p=np.array([-1.0, 0.0]), x0=np.zeros(2),
        horizon=2.0, intervals=10, controls=one,
        end=End(np.eye(2)[1:], np.zeros(1), np.zeros(1)),
    )  # fmt: skip
    level = Linear(
        A=np.zeros((1, 1)), B=np.eye(1), Q=np.eye(1), x0=np.ones(1),
        horizon=2.0, intervals=20, controls=one,
    )  # fmt: skip
    rest = End(np.eye(2), np.zeros(2), np.zeros(2))
    area = replace(
        far, p=np.zeros(2), q=np.array([1.0, 0.0]), x0=np.eye(2)[0], end=rest
    )
    oscillator = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return {
        "as far as possible in 2 s: 1": far,
        "an odd number of intervals": replace(far, intervals=9),
        "as far as possible, stronger brakes": replace(
            far, controls=(-np.full(1, 2.0), np.ones(1))
        ),
        "in exactly the least time": replace(area, horizon=2.0),
        "nearly the least time": replace(area, horizon=2.05),
        "an oscillator driven up": replace(
            far, A=oscillator, end=None, horizon=2 * np.pi, intervals=16
        ),
        "an oscillator brought to rest": replace(
            area, A=oscillator, horizon=4.0, intervals=16
        ),
        "to zero and stay: 1/3": level,
        "to zero and stay, the switch within an interval": replace(level, intervals=7),
        "an unstable state, to zero and stay": replace(
            level, A=np.eye(1), x0=np.array([0.5])
        ),
        "singular from the beginning": replace(level, x0=np.zeros(1)),
        "Fuller's problem": Linear(
            A=chain(2), B=last(2), Q=np.diag([1.0, 0.0]), x0=np.eye(2)[0],
            horizon=5.0, intervals=20, controls=one,
        ),
    }  # fmt: skip


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng = np.random.default_rng(3)
    made = list(drawn_cases(GENERATED, lambda number: _drawn(rng, number)))
    return made + [linear_case(KIND, name, p) for name, p in _written().items()]
