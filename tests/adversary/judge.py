"""The judge: is what a solver claims true, by DOP853 at 1e-10?

    x' = f(x, u),  u held on each of N intervals,  J = integral of L(x, u) + E(x(T))

It has each model, cost and constraint in NumPy and imports nothing but NumPy and SciPy:
whatever is wrong in the package is not wrong here for the same reason. States are
looked at densely, the beginning of an interval with that interval's control included.

A claim to be confirmed is false if the trajectory does not exist, if the cost is off by
more than 2e-3 of the integral of |L| plus |E|, if a constraint is broken by more than
2.5e-4 of its scale (the program's own tolerance is 1e-4), or if the problem has no
solution; a claim to be a local optimum also if a kink or a jump is met on the way.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Rate = Callable[[Array, Array], Array]
"""(x, u) -> a vector, shapes (nx,), (nu,) -> (m,)."""

COST_TOLERANCE = 2e-3
CONSTRAINT_TOLERANCE = 2.5e-4
BOUND_TOLERANCE = 1e-9
KINK_TOLERANCE = 1e-7
PRECISION = 1e-10
POINTS = 41
"""In each interval, both ends included."""
MOST_EVALUATIONS = 400_000
"""Of the right-hand side: a trajectory that takes more is one that does not exist."""


def nothing(x: Array, u: Array) -> Array:
    """Return no rows."""
    del x, u
    return np.empty(0)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Rows:
    """lower <= value(x, u) <= upper, row by row.

    Attributes:
        value: (x, u) -> shape (m,).
        lower: Shape (m,).
        upper: Shape (m,).
    """

    value: Rate
    lower: Array
    upper: Array


NO_ROWS = Rows(value=nothing, lower=np.empty(0), upper=np.empty(0))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Truth:
    """A problem in NumPy, and what is known of its answer.

    Attributes:
        dynamics: f(x, u), shape (nx,).
        stage_cost: L(x, u).
        terminal_cost: E(x).
        path: What holds all along; the bounds of the states are here too.
        terminal: What holds at the end; `u` is given, and not to be used.
        kinks: (x, u) -> rows that are zero on the kinks and jumps of f and L.
        end_kinks: The same for E.
        controls: Lower and upper bounds, each (nu,).
        x0: Initial state, shape (nx,).
        horizon: [s].
        intervals: Number N of control intervals.
        sizes: What is an ordinary size of each state, shape (nx,).
        cost_size: What is an ordinary size of the cost.
        is_solvable: Whether a feasible trajectory exists.
        lowest: No honest answer costs less.
        highest: A right answer costs no more.
    """

    dynamics: Rate
    stage_cost: Callable[[Array, Array], float] = lambda x, u: 0.0
    terminal_cost: Callable[[Array], float] = lambda x: 0.0
    path: Rows = NO_ROWS
    terminal: Rows = NO_ROWS
    kinks: Rate = nothing
    end_kinks: Rate = nothing
    controls: tuple[Array, Array]
    x0: Array
    horizon: float
    intervals: int
    sizes: Array
    cost_size: float = 1.0
    is_solvable: bool = True
    lowest: float = -np.inf
    highest: float = np.inf


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Claim:
    """The claim of a solver.

    Attributes:
        controls: Shape (nu, N); None if the problem was refused as impossible.
        cost: Of these controls.
        is_confirmed: Whether it says that the answer is feasible and verified.
        is_local_optimum: Whether it says that it is a local optimum besides.
    """

    controls: Array | None
    cost: float = np.nan
    is_confirmed: bool = False
    is_local_optimum: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict:
    """The judge's verdict on a claim.

    Attributes:
        faults: What is false in it; empty if nothing is.
        is_right: Whether it is true and the right answer.
        note: Why it is not right although nothing is false.
    """

    faults: tuple[str, ...] = ()
    is_right: bool = False
    note: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Replay:
    """A trajectory, finely integrated.

    Attributes:
        states: In each interval at POINTS points, shape (N, nx, POINTS).
        controls: Shape (nu, N).
        cost: J.
        size: The integral of |L| plus |E|.
    """

    states: Array
    controls: Array
    cost: float
    size: float

    def along(self, rate: Rate) -> Array:
        """Return a function's values at all points, shape (N, m, POINTS)."""
        with np.errstate(all="ignore"):
            values = [
                [np.atleast_1d(rate(x, u)) for x in points.T]
                for points, u in zip(self.states, self.controls.T, strict=True)
            ]
        return np.swapaxes(np.array(values, dtype=np.float64), 1, 2)


class EndlessError(Exception):
    """An integration that takes more evaluations than it may."""


def replay(truth: Truth, controls: Array) -> Replay | None:
    """Return the trajectory of controls (nu, N); None if it does not exist."""
    nx, spent = truth.x0.size, 0

    def rate(_: float, y: Array, u: Array) -> Array:
        nonlocal spent
        spent += 1
        if spent > MOST_EVALUATIONS:
            raise EndlessError
        stage = truth.stage_cost(y[:nx], u)
        return np.array([*truth.dynamics(y[:nx], u), stage, abs(stage)], dtype=float)

    dt = truth.horizon / truth.intervals
    times = np.linspace(0.0, dt, POINTS)
    atol = PRECISION * np.array([*truth.sizes, truth.cost_size, truth.cost_size])
    y, states = np.array([*truth.x0, 0.0, 0.0]), []
    for u in controls.T:
        with np.errstate(all="ignore"):
            try:
                found = solve_ivp(
                    rate, (0.0, dt), y, "DOP853", t_eval=times, rtol=PRECISION,
                    atol=atol, max_step=dt / 4, args=(u,),
                )  # fmt: skip
            except (EndlessError, ValueError, ZeroDivisionError):
                return None
        if not found.success or not np.isfinite(found.y).all():
            return None
        states.append(found.y[:nx])
        y = found.y[:, -1]
    with np.errstate(all="ignore"):
        end = float(truth.terminal_cost(y[:nx]))
    if not np.isfinite(end):
        return None
    return Replay(
        states=np.array(states),
        controls=controls,
        cost=y[nx] + end,
        size=y[nx + 1] + abs(end),
    )


def scales(rows: Rows, size: Array) -> Array:
    """Return each row's scale: its width, else its limit, else its size, (m,)."""
    finite = np.isfinite(rows.lower), np.isfinite(rows.upper)
    limit = np.where(finite[1], np.abs(rows.upper), np.abs(rows.lower))
    is_range = finite[0] & finite[1] & (rows.lower < rows.upper)
    width = np.subtract(rows.upper, rows.lower, where=is_range, out=limit.copy())
    sized = np.where(size > 0, size, 1.0)
    return np.where(is_range, width, np.where(limit > 0, limit, sized))


def excess(rows: Rows, flown: Replay, *, at_end: bool) -> float:
    """Return by how much rows are broken at worst, in their scales; inf for NaN."""
    values = flown.along(rows.value)
    if values.shape[1] == 0:
        return 0.0
    scale = scales(rows, np.abs(values).max(axis=(0, 2)))
    seen = values[-1:, :, -1:] if at_end else values
    over = np.maximum(rows.lower[:, None] - seen, seen - rows.upper[:, None])
    worst = (over / scale[:, None]).max()
    return float(max(worst, 0.0)) if np.isfinite(seen).all() else np.inf


def meets_kink(truth: Truth, flown: Replay) -> bool:
    """Return whether a kink or a jump is met within an interval or at the end."""
    values = flown.along(truth.kinks)
    if values.shape[1]:
        near = KINK_TOLERANCE * np.abs(values).max(axis=(0, 2))
        low, high = values.min(axis=2), values.max(axis=2)
        if ((low <= near) & (high >= -near)).any():
            return True
    ends = flown.along(truth.end_kinks)
    if not ends.shape[1]:
        return False
    near = KINK_TOLERANCE * np.abs(ends).max(axis=(0, 2))
    return bool((np.abs(ends[-1, :, -1]) <= near).any())


def leaves_bounds(truth: Truth, controls: Array) -> bool:
    """Return whether a control is out of its bounds, by more than rounding."""
    lower, upper = (limit[:, None] for limit in truth.controls)
    room = BOUND_TOLERANCE * (upper - lower)
    return bool(((controls < lower - room) | (controls > upper + room)).any())


def faults_of(truth: Truth, claim: Claim, flown: Replay | None) -> tuple[str, ...]:
    """Return what is false in a claim to be confirmed."""
    if not truth.is_solvable:
        return ("confirmed, but the problem has no solution",)
    if flown is None:
        return ("confirmed, but the trajectory does not exist",)
    faults = []
    if not abs(claim.cost - flown.cost) <= COST_TOLERANCE * flown.size:
        faults.append(f"cost {claim.cost:.9g}, but it is {flown.cost:.9g}")
    for role, rows in (("path", truth.path), ("terminal", truth.terminal)):
        broken = excess(rows, flown, at_end=role == "terminal")
        if broken > CONSTRAINT_TOLERANCE:
            faults.append(f"{role} constraint broken by {broken:.3g} of its scale")
    if leaves_bounds(truth, flown.controls):
        faults.append("a control is out of its bounds")
    if claim.is_local_optimum and meets_kink(truth, flown):
        faults.append("a local optimum claimed on a kink")
    return tuple(faults)


def judge(truth: Truth, claim: Claim) -> Verdict:
    """Return what is false in a claim, and whether it is the right answer.

    Args:
        truth: The problem in NumPy, and what is known of it.
        claim: What the solver says of it.
    """
    if not claim.is_confirmed or claim.controls is None:
        return Verdict(is_right=not truth.is_solvable, note="not confirmed")
    finite = bool(np.isfinite(claim.controls).all())
    flown = replay(truth, claim.controls) if finite else None
    faults = faults_of(truth, claim, flown)
    if faults or flown is None:
        return Verdict(faults=faults)
    if flown.cost > truth.highest:
        return Verdict(note=f"cost {flown.cost:.9g} above {truth.highest:.9g}")
    if flown.cost < truth.lowest:
        return Verdict(note=f"cost {flown.cost:.9g} below {truth.lowest:.9g}")
    return Verdict(is_right=True)
