"""An augmented Lagrangian in each lane: what all ways to solve lanes share.

Each lane, an individual, is one local solve with its own multipliers, weights and end;
kernels.py has what is computed. Inside, the augmented Lagrangian is made smaller (by
sweeps, ddp.py, or by slopes, slopes.py) until it falls by less than the lane's
tolerance. Outside, multipliers are renewed; a weight grows thirtyfold where its rows
did not come ten times nearer to their limits; the tolerance falls a hundredfold.

Source: Howell, Jackson and Manchester (2019), ALTRO; Andreani et al. (2007), ALGENCAN,
the schedule of weights.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lanes.posed import Posed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEASIBLE = 1e-7
"""Violation, in the NLP's numbers near one, at which a lane is done."""
_HEAVIEST, _MOST_MULTIPLIER = 1e9, 1e7
_HARDLY, _FAR = 0.9, 1e-3
_ROUNDING = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class LaneOptions:
    """When lanes end, and how their weights grow.

    Attributes:
        inner: Most steps between new multipliers.
        outer: Most new multipliers.
        factor: What a weight grows by.
        first_tolerance: Relative fall of the augmented Lagrangian that ends the inner
            steps, at first.
        tolerance: The same at last.
        heaviest: Weight at which a lane that comes no nearer to its limits is given up.
        enough: Part of the lanes to wait for.
    """

    inner: int = 60
    outer: int = 25
    factor: float = 30.0
    first_tolerance: float = 1e-2
    tolerance: float = 1e-6
    heaviest: float = 1e6
    enough: float = 0.99


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LaneAnswers:
    """What lanes ended with, in the order of their starts.

    Attributes:
        controls: Shape (nu, N, n), within their bounds.
        starts: What is decided about the start, shape (ny, n).
        states: As intervals begin and in the end, divided by their sizes, shape
            (nx, N + 1, n).
        cost: Of the problem's core, shape (n,); infinite where a lane broke down.
        violation: The worst excess in the NLP's numbers near one, shape (n,).
        iterations: Sweeps, shape (n,).
    """

    controls: Array
    starts: Array
    states: Array
    cost: Array
    violation: Array
    iterations: NDArray[np.int64]


@dataclass(kw_only=True, slots=True, eq=False)
class Lanes:
    """Where the lanes are that are still worked on; the last axis is the lane.

    Attributes:
        number: Which start it came from.
        y: Decisions about the start, (ny, n).
        x0: State at the start, (nx, n).
        x: States as intervals begin, (N nx, n).
        end: State at the end, (nx, n).
        u: Controls, (N nu, n).
        m: Multipliers of the intervals' rows; m_end, m_begin: of the ends'.
        r: Weights of the rows of intervals and start; r_end: of those of the end.
        value: The augmented Lagrangian.
        mu: Regularisation of the controls' Hessian.
        theta: Whether second derivatives of the dynamics count, 0 or 1.
        tolerance: See LaneOptions.
        broken: How far rows and multipliers were from fitting each other, when the
            multipliers were last renewed; broken_end: those of the end.
        since: Steps since then.
        renewed: How often that was.
        iterations: Steps in all.
        done: 1 for a lane that has ended and waits to be left out.
    """

    number: NDArray[np.int64]
    y: Array
    x0: Array
    x: Array
    end: Array
    u: Array
    m: Array
    m_end: Array
    m_begin: Array
    r: Array
    r_end: Array
    value: Array
    mu: Array
    theta: Array
    tolerance: Array
    broken: Array
    broken_end: Array
    since: NDArray[np.int64]
    renewed: NDArray[np.int64]
    iterations: NDArray[np.int64]
    done: Mask

    @property
    def count(self) -> int:
        """Number of lanes."""
        return self.number.size

    def kept(self, places: NDArray[np.int64]) -> "Lanes":
        """Return some of the lanes."""
        return Lanes(**{
            one.name: np.ascontiguousarray(getattr(self, one.name)[..., places])
            for one in fields(self)
        })  # fmt: skip


class AugmentedSolver:
    """The outer loop of lanes; changes them in place."""

    def __init__(self, posed: Posed, options: LaneOptions) -> None:
        """Take a problem from one initial state."""
        self.posed, self.options = posed, options
        self.nx, self.ny = posed.tied.shape
        self.N, self.nu = posed.intervals, posed.least.size
        self._fixed = np.where(posed.tied.any(axis=1), 0.0, posed.x0)[:, None]

    def begun(self, u: Array, y: Array, weights: tuple[Array, Array]) -> Lanes:
        """Return lanes rolled out from their starts."""
        n, posed = u.shape[1], self.posed
        nc, n_end = posed.interval[2].size, posed.end[2].size
        n_begin = 0 if posed.begin is None else posed.begin[2].size
        none = np.zeros((1, n))
        lanes = Lanes(
            number=np.arange(n), y=np.array(y), x0=self.start(y),
            x=np.zeros((self.N * self.nx, n)), end=np.zeros((self.nx, n)), u=u,
            m=np.zeros((self.N * nc, n)), m_end=np.zeros((n_end, n)),
            m_begin=np.zeros((n_begin, n)),
            r=np.array(weights[0])[None, :], r_end=np.array(weights[1])[None, :],
            value=np.full((1, n), np.inf), mu=np.full((1, n), 1e-6), theta=none.copy(),
            tolerance=np.full((1, n), self.options.first_tolerance),
            broken=np.full((1, n), np.inf), broken_end=np.full((1, n), np.inf),
            since=np.zeros((1, n), dtype=np.int64),
            renewed=np.zeros((1, n), dtype=np.int64),
            iterations=np.zeros(n, dtype=np.int64), done=np.zeros(n, dtype=bool),
        )  # fmt: skip
        self.roll_out(lanes)
        return lanes

    def start(self, y: Array) -> Array:
        """Return the state at the start, (nx, n), of what is decided about it."""
        return np.ascontiguousarray(self._fixed + self.posed.tied @ y)

    def roll_out(self, lanes: Lanes) -> None:
        """Find states and values of the lanes' controls."""
        posed = self.posed
        lanes.x0 = self.start(lanes.y)
        none = np.zeros((1, lanes.count))
        lanes.end, cost, lanes.x = posed.kernels.roll.evaluate(
            [lanes.x0, none, lanes.u, lanes.m, lanes.r, *posed.interval]
        )
        lanes.value = self.valued(lanes, lanes.x0, lanes.end, cost)

    def valued(self, lanes: Lanes, x0: Array, end: Array, cost: Array) -> Array:
        """Return augmented Lagrangians, (1, n): intervals' costs with both ends."""
        value = cost + self.at_end(end, lanes)[0]
        if self.posed.begin is not None:
            value = value + self.at_begin(x0, lanes)[0]
        finite = np.isfinite(value) & np.isfinite(end).all(axis=0)
        return np.where(finite, value, np.inf)

    def at_end(self, end: Array, lanes: Lanes) -> tuple[Array, ...]:
        """Return what the kernel of the end says; see `LaneKernels`."""
        given = [end, lanes.m_end, lanes.r_end, *self.posed.end]
        return self.posed.kernels.end.evaluate(given)

    def at_begin(self, x0: Array, lanes: Lanes) -> tuple[Array, ...]:
        """Return what the kernel of the start says."""
        begin, known = self.posed.kernels.begin, self.posed.begin
        if begin is None or known is None:
            raise TypeError("expected a start that is decided")
        return begin.evaluate([x0, lanes.m_begin, lanes.r, *known])

    def renew(
        self, lanes: Lanes, converged: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """Renew the multipliers of lanes, and their weights where that did not help.

        Args:
            lanes: The lanes; changed.
            converged: Which of them have converged inside.

        Returns:
            Which lanes have ended, and of these costs and worst excesses.
        """
        options, some = self.options, lanes.kept(converged)
        seen = self._seen(some)
        before = np.maximum(some.broken, some.broken_end)
        now = np.maximum(seen.broken, seen.broken_end)
        last: Mask = some.tolerance <= options.tolerance * (1 + _ROUNDING)
        heavy: Mask = np.maximum(some.r, some.r_end) >= options.heaviest
        given_up = heavy & (now > _HARDLY * before) & (now > _FAR)
        done = (last & (now <= FEASIBLE)) | given_up | (some.renewed >= options.outer)
        some.r = self._heavier(some.r, seen.broken, some.broken)
        some.r_end = self._heavier(some.r_end, seen.broken_end, some.broken_end)
        some.m, some.m_end, some.m_begin = (
            np.clip(m, -_MOST_MULTIPLIER, _MOST_MULTIPLIER) for m in seen.multipliers
        )
        some.broken, some.broken_end = seen.broken, seen.broken_end
        some.tolerance = np.maximum(0.01 * some.tolerance, options.tolerance)
        some.mu, some.since = np.minimum(some.mu, 1.0), np.zeros_like(some.since)
        some.renewed = some.renewed + 1
        self.roll_out(some)
        for one in fields(some):
            getattr(lanes, one.name)[..., converged] = getattr(some, one.name)
        ended = done[0]
        return converged[ended], seen.cost[0][ended], seen.worst[0][ended]

    def _heavier(self, weight: Array, broken: Array, before: Array) -> Array:
        slow = (broken > 0.1 * before) & (broken > FEASIBLE)
        grown = np.minimum(weight * self.options.factor, _HEAVIEST)
        return np.asarray(np.where(slow, grown, weight))

    def judged(self, lanes: Lanes) -> tuple[Array, Array]:
        """Return costs and worst excesses, each (n,)."""
        seen = self._seen(lanes)
        return seen.cost[0], seen.worst[0]

    def _seen(self, lanes: Lanes) -> "_Seen":
        """Return costs and rows of lanes as they are."""
        posed, none = self.posed, np.zeros((1, lanes.count))
        cost, worst, broken, m = posed.kernels.rows.evaluate([
            none, none, none, lanes.x, lanes.u, lanes.m, lanes.r, *posed.interval,
        ])  # fmt: skip
        _, _, _, more, worst_end, broken_end, m_end = self.at_end(lanes.end, lanes)
        cost, worst = cost + more, np.maximum(worst, worst_end)
        m_begin = lanes.m_begin
        if posed.begin is not None:
            _, _, _, more, at_begin, stuck, m_begin = self.at_begin(lanes.x0, lanes)
            cost, worst = cost + more, np.maximum(worst, at_begin)
            broken = np.maximum(broken, stuck)
        lost = ~(np.isfinite(cost + worst) & np.isfinite(lanes.end).all(axis=0))
        cost, worst = (np.where(lost, np.inf, part) for part in (cost, worst))
        return _Seen(cost, worst, broken, broken_end, (m, m_end, m_begin))


class _Seen(NamedTuple):
    """What lanes cost, and what they break: see `kernels._Augmented`."""

    cost: Array
    worst: Array
    broken: Array
    broken_end: Array
    multipliers: tuple[Array, Array, Array]


def none_found(posed: Posed, controls: Array, starts: Array) -> LaneAnswers:
    """Return answers of lanes that have not ended: their starts, at infinite cost."""
    n = controls.shape[2]
    return LaneAnswers(
        controls=np.array(controls),
        starts=np.array(starts),
        states=np.full((posed.x0.size, posed.intervals + 1, n), np.nan),
        cost=np.full(n, np.inf),
        violation=np.full(n, np.inf),
        iterations=np.zeros(n, dtype=np.int64),
    )


def write_down(
    found: LaneAnswers, posed: Posed, lanes: Lanes, cost: Array, worst: Array
) -> None:
    """Write down what lanes have ended with."""
    number = lanes.number
    found.controls[:, :, number] = posed.controls(lanes.u)
    found.starts[:, number] = lanes.y * posed.start_sizes
    inner = lanes.x.reshape(posed.intervals, posed.x0.size, lanes.count)
    found.states[:, :-1, number] = np.moveaxis(inner, 0, 1)
    found.states[:, -1, number] = lanes.end
    found.cost[number] = cost * posed.sizes.cost
    found.violation[number] = worst
    found.iterations[number] = lanes.iterations
