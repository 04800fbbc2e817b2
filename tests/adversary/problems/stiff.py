"""Stiff problems: linear ones with a fast mode that no explicit step follows.

The optimum is exact, by matrix exponentials; RK4 with the given number of steps is not
stable. They are stated with the stiff integrator, and do not count in the shares.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.drawing import symmetric_limits
from swarmstart.tests.adversary.exact.held_linear import End, Linear
from swarmstart.tests.adversary.linear_case import linear_case

KIND = "stiff"
GENERATED = 30
SUBSTEPS = 4


def _lag(rng: np.random.Generator, rate: float) -> Linear:
    """Draw a fast actuator before a slow state."""
    return Linear(
        A=np.array([[-rng.uniform(0.2, 1.0), 1.0], [0.0, -rate]]),
        B=np.array([[0.0], [rate]]), Q=np.diag([1.0, 0.0]), R=np.eye(1) * 0.1,
        x0=np.array([rng.uniform(0.5, 2.0), 0.0]), horizon=2.0, intervals=10,
        controls=symmetric_limits(np.full(1, 3.0)),
    )  # fmt: skip


def _reaction(rng: np.random.Generator, rate: float) -> Linear:
    """Draw a fast equilibrium between two states, fed slowly."""
    back = rate * rng.uniform(0.3, 1.0)
    return Linear(
        A=np.array([[-rate, back], [rate, -back - 1.0]]), B=np.array([[1.0], [0.0]]),
        Q=np.eye(2), q=np.array([-1.0, -1.0]), R=np.eye(1) * 0.2,
        x0=np.array([1.0, 0.0]),
        horizon=2.0, intervals=8, controls=(np.zeros(1), np.full(1, 2.0)),
    )  # fmt: skip


def _target(rng: np.random.Generator, rate: float) -> Linear:
    """Draw a slow state to be brought to a target through a fast one."""
    goal = rng.uniform(0.3, 0.8, 1)
    lag = _lag(rng, rate)
    return replace(
        lag,
        Q=np.zeros((2, 2)),
        x0=np.zeros(2),
        end=End(np.array([[1.0, 0.0]]), goal, goal),
    )


FAMILIES = {"actuator": _lag, "equilibrium": _reaction, "target": _target}


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng, made = np.random.default_rng(10), []
    for number in range(GENERATED):
        name, draw = list(FAMILIES.items())[number % len(FAMILIES)]
        rate = float(10 ** rng.uniform(2.0, 4.0))
        case = linear_case(
            KIND, f"{name} {number}, rate {rate:.0f}", draw(rng, rate), is_counted=False
        )
        made.append(replace(case, substeps=SUBSTEPS, integrator="stiff"))
    return made
