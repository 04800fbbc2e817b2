"""Problems without any feasible trajectory, by a clear margin.

Least times, reachable sets and contradictions prove it; what is asked is that no answer
is called feasible.
"""

from dataclasses import replace

import numpy as np

from swarmstart.tests.adversary.case import Case, unsolvable
from swarmstart.tests.adversary.drawing import (
    chain,
    last,
    random_system,
    symmetric_limits,
)
from swarmstart.tests.adversary.exact.convex import solve_convex
from swarmstart.tests.adversary.exact.held_linear import (
    End,
    Linear,
    Path,
    program_of,
)
from swarmstart.tests.adversary.linear_case import unsolvable_case
from swarmstart.tests.adversary.problems.impossible import impossible

KIND = "no_solution"
GENERATED = 35


def _too_short(rng: np.random.Generator) -> Linear:
    """From rest to rest takes 2 sqrt(d / a), and there is less."""
    distance, force = rng.uniform(0.5, 3.0, 2)
    least = 2 * np.sqrt(distance / force)
    return Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.zeros(2),
        horizon=float(least * rng.uniform(0.6, 0.95)), intervals=10,
        controls=symmetric_limits(np.array([force])),
        end=End(np.eye(2), np.array([distance, 0.0]), np.array([distance, 0.0])),
    )  # fmt: skip


def _out_of_reach(rng: np.random.Generator) -> Linear:
    """Ask for a tenth more of p'x(T) than there can be."""
    nx, nu, horizon = int(rng.integers(1, 4)), int(rng.integers(1, 3)), 2.0
    A, B = random_system(rng, nx=nx, nu=nu, horizon=horizon)
    p = rng.normal(size=nx)
    system = Linear(
        A=A, B=B, x0=rng.normal(size=nx), horizon=horizon, intervals=8, p=-p,
        controls=symmetric_limits(rng.uniform(0.5, 2.0, nu)),
    )  # fmt: skip
    program = program_of(system)
    most, none = -solve_convex(program).cost, -program.constant
    asked = np.array([most + 0.1 * max(most - none, abs(most))])
    return Linear(
        A=A, B=B, x0=system.x0, horizon=horizon, intervals=8, R=np.eye(nu),
        controls=system.controls, end=End(p[None, :], asked, np.full(1, np.inf)),
    )  # fmt: skip


def _speed_limit(rng: np.random.Generator) -> Linear:
    """Ask for a distance a tenth longer than the highest speed allows."""
    speed, horizon = rng.uniform(0.5, 2.0), float(rng.uniform(1.0, 3.0))
    goal = np.array([1.1 * speed * horizon, 0.0])
    return Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.zeros(2), horizon=horizon,
        intervals=10, controls=symmetric_limits(np.full(1, 20 * speed)),
        end=End(np.eye(2), goal, goal),
        states=(np.array([-np.inf, -speed]), np.array([np.inf, speed])),
    )  # fmt: skip


def _uncontrolled(rng: np.random.Generator) -> Linear:
    """Ask a state to be zero that no control moves."""
    nx = int(rng.integers(2, 4))
    A = np.triu(rng.normal(size=(nx, nx)) * 0.5)
    B = rng.normal(size=(nx, 1))
    B[-1] = 0.0
    return Linear(
        A=A, B=B, R=np.eye(1), x0=np.ones(nx), horizon=1.5, intervals=8,
        controls=symmetric_limits(np.full(1, 5.0)),
        end=End(np.eye(nx)[-1:], np.zeros(1), np.zeros(1)),
    )  # fmt: skip


def _too_weak(rng: np.random.Generator) -> Linear:
    """Ask an unstable state back to zero from where the control is too weak."""
    rate, force = rng.uniform(0.5, 2.0), rng.uniform(0.5, 2.0)
    return Linear(
        A=np.eye(1) * rate, B=np.eye(1), R=np.eye(1), horizon=3.0, intervals=10,
        x0=np.array([force / rate * rng.uniform(1.05, 1.5)]),
        controls=symmetric_limits(np.array([force])),
        end=End(np.eye(1), np.zeros(1), np.zeros(1)),
    )  # fmt: skip


def _drift(rng: np.random.Generator) -> Linear:
    """A state drifts over its bound, and the control cannot hold it."""
    drift = rng.uniform(0.5, 2.0)
    return Linear(
        A=np.zeros((1, 1)), B=np.eye(1), c=np.array([drift]), R=np.eye(1),
        x0=np.zeros(1), horizon=3.0, intervals=9,
        controls=symmetric_limits(np.array([drift * rng.uniform(0.3, 0.8)])),
        states=(np.full(1, -1.0), np.array([drift * 0.5])),
    )  # fmt: skip


def _contradiction(rng: np.random.Generator) -> Linear:
    """Two conditions at the end, or one and a bound, exclude each other."""
    E, target = rng.normal(size=(1, 2)), rng.normal()
    ends = np.array([target, target + rng.uniform(0.1, 1.0)])
    return Linear(
        A=chain(2), B=last(2), R=np.eye(1), x0=np.zeros(2), horizon=2.0, intervals=8,
        controls=symmetric_limits(np.full(1, 10.0)),
        end=End(np.vstack([E, E]), ends, ends),
    )  # fmt: skip


FAMILIES = {
    "less than the least time": _too_short,
    "out of reach": _out_of_reach,
    "too far at the highest speed": _speed_limit,
    "a mode without control": _uncontrolled,
    "too weak a control": _too_weak,
    "a drift over a bound": _drift,
    "a contradiction": _contradiction,
}


def _scalar_system() -> Linear:
    """Return x' = u, |u| <= 1, x(0) = 0, for 1 s."""
    return Linear(
        A=np.zeros((1, 1)), B=np.eye(1), R=np.eye(1), x0=np.zeros(1), horizon=1.0,
        intervals=6, controls=symmetric_limits(np.ones(1)),
    )  # fmt: skip


def _written_linear() -> dict[str, Linear]:
    """Return linear problems written by hand; of x' = u, all but the last."""
    base, one, none = _scalar_system(), np.eye(1), np.zeros((1, 1))
    at = np.full(1, 0.5)
    two = np.vstack([one, one])
    apart = Path(two, np.zeros((2, 1)), np.array([-1.0, 0.2]), np.array([0.1, 1.0]))
    drag = Linear(
        A=np.array([[0.0, 1.0], [0.0, -1.0]]), B=last(2), R=np.eye(1), x0=np.zeros(2),
        horizon=2.0, intervals=8, controls=symmetric_limits(np.ones(1)),
        end=End(np.eye(2)[:1], np.full(1, 1.3), np.full(1, np.inf)),
    )  # fmt: skip
    return {
        "starts below the bounds of its state": replace(base, states=(at, at + 1)),
        "starts above the bounds of its state": replace(base, states=(-at - 1, -at)),
        "starts outside a path constraint": replace(
            base, path=Path(one, none, at, np.full(1, np.inf))
        ),
        "two path constraints that exclude each other": replace(base, path=apart),
        "a path constraint that no control meets": replace(
            base, path=Path(none, one, np.full(1, 1.5), np.full(1, np.inf))
        ),
        "a mixed constraint broken at the start": replace(
            base, path=Path(one, -one, np.full(1, 1.2), np.full(1, np.inf))
        ),
        "a target behind a bound": replace(
            base, states=(-at, at), end=End(one, at + 0.3, at + 0.3)
        ),
        "a target behind a path constraint": replace(
            base,
            path=Path(one, none, np.full(1, -np.inf), at),
            end=End(one, at + 0.3, at + 0.4),
        ),
        "farther than drag allows": drag,
    }


def cases() -> list[Case]:
    """Return all cases of the class, the same on every call."""
    rng, made = np.random.default_rng(6), []
    for number in range(GENERATED):
        name, draw = list(FAMILIES.items())[number % len(FAMILIES)]
        made.append(unsolvable_case(KIND, f"{name} {number}", draw(rng)))
    for name, linear in _written_linear().items():
        made.append(unsolvable_case(KIND, name, linear))
    for name, (formulas, truth) in impossible().items():
        full = f"{KIND}/{name}"
        case = Case(name=full, kind=KIND, formulas=formulas, truth=truth, checks=2)
        made.append(unsolvable(case))
    return made
