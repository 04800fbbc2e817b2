"""The quadrotor of jaxipm's benchmarks: among four cylinders, and behind a reference.

Stated anew from its equations: 13 states (position, quaternion, velocity and rates),
four motor speeds, steps of 0.1 s by Euler's method, 29 of them. The peer is the same
problem in CasADi's Opti, as that project states it, from the same starts.

Source: Viljoen (2026), jaxipm, quad_nav_circle and quad_track_avoid;
https://github.com/johnviljoen/jaxipm
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart.arrays import Array

Column = TypeVar("Column", ca.SX, ca.MX)
INTERVALS, STEP = 29, 0.1
HOVER = 522.9847140714692
"""Motor speed at which it hovers [rad/s]."""
SPEEDS = 75.0, 925.0
STATES = ("x", "y", "z", "q0", "q1", "q2", "q3", "vx", "vy", "vz", "p", "q", "r")
MASS, ARM, DRAG, GRAVITY = 1.2, 0.16, 0.1, 9.81
INERTIA = 0.0123, 0.0123, 0.0224
ROTOR, THRUST, TORQUE = 2.7e-5, 1.076e-5, 1.632e-7
WEIGHTS = (1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1)
FARTHEST = 10.0
"""Bound of positions [m], velocities [m/s] and rates [rad/s]."""
CYLINDERS = ((1.0, 1.0, 0.7), (1.0, 3.0, 0.7), (3.0, 1.0, 0.7), (3.0, 3.0, 0.95))
"""Centres and radii of the cylinders with the quadrotor's own [m]; they grow by a
tenth of their area in a second."""
MOVING = (
    (3.0, 3.0, 1.0, 0.5, 0.3, 0.5, 0.0, 0.0),
    (-3.0, 2.0, 0.5, 1.0, 0.4, 0.3, 1.0, 0.5),
    (0.0, -3.0, 0.8, 0.8, 0.5, 0.4, 0.5, 1.0),
)
"""Middle x and y, amplitudes, frequencies and phases of moving cylinders of 1 m."""
REFERENCE = 4.0, 4.0, 2.0
"""Amplitudes of the reference, a saddle [m]."""


class Task(NamedTuple):
    """A problem with instances.

    Attributes:
        problem: The problem.
        x0: Initial states, shape (13, M).
        known: Data of each instance by name.
        guess: Controls of the start, shape (4, N).
        states: States of the start, shape (13, N + 1, M).
        peer: CasADi's Opti, given whether it expands: (x0, states, reference) -> cost.
    """

    problem: ss.OptimalControlProblem
    x0: Array
    known: dict[str, Array]
    guess: Array
    states: Array
    peer: Callable[[bool], Callable[[int], float]]


def rates(x: Column, u: Column) -> Column:
    """Return the derivatives of the states."""
    thrust = THRUST * u**2
    lift, turn = thrust[0] + thrust[1] + thrust[2] + thrust[3], TORQUE * u**2
    spin = ROTOR * (u[0] - u[1] + u[2] - u[3])
    q0, q1, q2, q3, vx, vy, vz, p, q, r = (x[i] for i in range(3, 13))
    a, b, c = INERTIA
    return ca.vertcat(
        vx,
        vy,
        vz,
        (-p * q1 - q * q2 - q3 * r) / 2,
        (p * q0 - q * q3 + q2 * r) / 2,
        (p * q3 + q * q0 - q1 * r) / 2,
        (-p * q2 + q * q1 + q0 * r) / 2,
        (-DRAG * vx * ca.fabs(vx) - 2 * (q0 * q2 + q1 * q3) * lift) / MASS,
        (-DRAG * vy * ca.fabs(vy) + 2 * (q0 * q1 - q2 * q3) * lift) / MASS,
        (-DRAG * vz * ca.fabs(vz) - lift * (q0**2 - q1**2 - q2**2 + q3**2)) / MASS
        + GRAVITY,
        ((b - c) * q * r - spin * q + ARM * _pairs(thrust, (1, -1, -1, 1))) / a,
        ((c - a) * p * r + spin * p + ARM * _pairs(thrust, (1, 1, -1, -1))) / b,
        ((a - b) * p * q + _pairs(turn, (-1, 1, -1, 1))) / c,
    )


def _pairs(values: Column, signs: tuple[int, ...]) -> Column:
    return ca.dot(ca.DM(signs), values)


def _spent(x: Column, reference: Column) -> Column:
    away = x - reference
    return ca.dot(ca.DM(WEIGHTS), away * away)


def _clear(x: Column, t: Any) -> list[Column]:
    """Return what is at least 0 outside the growing cylinders."""
    return [
        (x[0] - a) ** 2 + (x[1] - b) ** 2 - radius**2 * (1 + 0.1 * t)
        for a, b, radius in CYLINDERS
    ]


def _clear_of_moving(x: Column, t: Any) -> list[Column]:
    return [
        (x[0] - a - da * ca.sin(f * t + i)) ** 2
        + (x[1] - b - db * ca.sin(g * t + j)) ** 2
        - 1.0
        for a, b, da, db, f, g, i, j in MOVING
    ]


def _even(x: Column) -> Column:
    """Return the squared norm of the quaternion."""
    return ca.sumsqr(x[3:7])


def _model() -> tuple[ca.SX, ca.SX, ss.Model]:
    x, u, t = ca.SX.sym("x", 13), ca.SX.sym("u", 4), ca.SX.sym("t")
    model = ss.Model(
        states=x, controls=u, next_state=x + STEP * rates(x, u), time=t,
        state_names=STATES, control_names=("w0", "w1", "w2", "w3"), dt=STEP,
    )  # fmt: skip
    return x, t, model


def _bounds() -> ss.Bounds:
    far = np.full(13, FARTHEST)
    far[3:7] = np.inf
    return ss.Bounds(controls=SPEEDS, states=(-far, far))


def _straight(x0: Array) -> Array:
    """Return positions on a straight line to 2 m above the origin, all else at rest."""
    goal, parts = np.array([0.0, 0.0, -2.0]), np.linspace(0, 1, INTERVALS + 1)
    states = np.zeros((13, INTERVALS + 1, x0.shape[1]))
    states[3] = 1.0
    states[:3] = x0[:3, None] + parts[:, None] * (goal[:, None, None] - x0[:3, None])
    states[:, 0] = x0
    return states


def cylinders(sector: float, count: int = 80) -> Task:
    """Return the flight to the origin among four cylinders, from starts on an arc.

    Args:
        sector: Angle of the arc [degrees].
        count: Number of starts.
    """
    x, t, model = _model()
    rows = [ss.PathConstraint(expression=row, lower=0.0) for row in _clear(x, t)]
    problem = ss.OptimalControlProblem(
        model, horizon=INTERVALS * STEP, intervals=INTERVALS, bounds=_bounds(),
        step_cost=_spent(x, 0 * x), terminal_cost=_spent(x, 0 * x), constraints=rows,
    )  # fmt: skip
    half, middle = np.deg2rad(sector) / 2, np.pi / 4
    angles = np.linspace(middle - half, middle + half, count)
    x0 = np.zeros((13, count))
    x0[:2] = np.sqrt(32.0) * np.array([np.cos(angles), np.sin(angles)])
    x0[3] = 1.0
    guess, states = np.full((4, INTERVALS), HOVER), _straight(x0)

    def rows_at(x: ca.MX, k: int) -> list[ca.MX]:
        # That project asks for them at the starts of intervals only.
        return [row >= 0 for row in _clear(x, k * STEP)] if k < INTERVALS else []

    def peer(expand: bool) -> Callable[[int], float]:
        return _opti(expand, x0, states, np.zeros((13, INTERVALS + 1, count)), rows_at)

    return Task(problem, x0, {}, guess, states, peer)


def tracking(speed: float, count: int = 250, seed: int = 0) -> Task:
    """Return the flight behind a reference among moving cylinders, from random starts.

    Args:
        speed: How fast the reference moves [rad/s].
        count: Number of starts.
        seed: Seed of the starts.
    """
    x, t, model = _model()
    r = ca.SX.sym("reference", 6)
    wanted = ca.vertcat(r[:3], ca.SX.zeros(4), r[3:], ca.SX.zeros(3))
    rows = [
        *(ss.PathConstraint(expression=c, lower=0.0) for c in _clear_of_moving(x, t)),
        ss.PathConstraint(expression=_even(x), lower=0.5, upper=1.5),
    ]
    problem = ss.OptimalControlProblem(
        model, horizon=INTERVALS * STEP, intervals=INTERVALS, signals=r,
        step_cost=_spent(x, wanted), terminal_cost=_spent(x, wanted), bounds=_bounds(),
        constraints=rows,
    )  # fmt: skip
    x0, phases = _random_starts(speed, count, np.random.default_rng(seed))
    along = phases[:, None] + speed * STEP * np.arange(INTERVALS + 1)
    references = np.zeros((13, INTERVALS + 1, count))
    states = _reference(along, speed)
    by_row = np.moveaxis(states, 0, 2)
    references[:3], references[7:10] = by_row[:3], by_row[3:]
    known = {f"reference_{i}": by_row[i] for i in range(6)}
    guess, start = np.full((4, INTERVALS), HOVER), _straight(x0)

    def rows_at(x: ca.MX, k: int) -> list[ca.MX]:
        clear = [row >= 0 for row in _clear_of_moving(x, k * STEP)]
        return [*clear, _even(x) >= 0.5, _even(x) <= 1.5]

    def peer(expand: bool) -> Callable[[int], float]:
        return _opti(expand, x0, start, references, rows_at)

    return Task(problem, x0, known, guess, start, peer)


def _reference(s: Array, speed: float) -> Array:
    """Return positions and velocities of the reference, shape (M, 6, nodes)."""
    a, b, c = REFERENCE
    rows = [
        a * np.cos(s), b * np.sin(s), c * np.cos(2 * s), -a * speed * np.sin(s),
        b * speed * np.cos(s), -2 * c * speed * np.sin(2 * s),
    ]  # fmt: skip
    return np.stack(rows, axis=1)


def _random_starts(
    speed: float, count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return starts near the reference, clear of the cylinders, and its phases."""
    x0, phases = np.zeros((13, count)), np.empty(count)
    x0[3] = 1.0
    centres = [
        (a + da * np.sin(i), b + db * np.sin(j)) for a, b, da, db, _, _, i, j in MOVING
    ]
    for number in range(count):
        near = True
        while near:
            phases[number] = rng.uniform(0, 2 * np.pi)
            at = _reference(phases[number : number + 1, None], speed)[0, :3, 0]
            x0[:3, number] = at + 0.5 * rng.standard_normal(3)
            away = [np.hypot(x0[0, number] - a, x0[1, number] - b) for a, b in centres]
            near = min(away) < 1.1
    return x0, phases


def _opti(
    expand: bool,
    x0: Array,
    states: Array,
    references: Array,
    rows_at: Callable[[ca.MX, int], list[ca.MX]],
) -> Callable[[int], float]:
    """Return the peer: the number of an instance -> its cost, NaN if it fails."""
    opti = ca.Opti()
    x, u = opti.variable(13, INTERVALS + 1), opti.variable(4, INTERVALS)
    start, wanted = opti.parameter(13), opti.parameter(13, INTERVALS + 1)
    spent = [_spent(x[:, k], wanted[:, k]) for k in range(INTERVALS + 1)]
    opti.minimize(ca.sum1(ca.vertcat(*spent)))
    opti.subject_to(x[:, 0] == start)
    for k in range(INTERVALS):
        opti.subject_to(x[:, k + 1] == x[:, k] + STEP * rates(x[:, k], u[:, k]))
    for k in range(INTERVALS + 1):
        for i in (*range(3), *range(7, 13)):
            opti.subject_to(opti.bounded(-FARTHEST, x[i, k], FARTHEST))
        for row in rows_at(x[:, k], k):
            opti.subject_to(row)
    opti.subject_to(opti.bounded(SPEEDS[0], u, SPEEDS[1]))
    quiet = {"print_time": False, "expand": expand}
    opti.solver("ipopt", quiet, {"print_level": 0, "sb": "yes", "tol": 1e-6})

    def solve(number: int) -> float:
        opti.set_value(start, x0[:, number])
        opti.set_value(wanted, references[:, :, number])
        opti.set_initial(x, states[:, :, number])
        opti.set_initial(u, HOVER)
        try:
            return float(opti.solve().value(opti.f))
        except RuntimeError:
            return float("nan")

    return solve
