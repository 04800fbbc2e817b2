"""Local solves of many starts at once: differential dynamic programming in lanes.

Each lane, an individual, is one local solve with its own step, multipliers, weights and
end; kernels.py has what is computed, this module the loop:

    inside   a sweep back and a roll-out, until the augmented Lagrangian falls by less
             than the lane's tolerance; a step that does not help is tried shorter
    outside  new multipliers; a weight grows thirtyfold where its rows did not come ten
             times nearer to their limits; the tolerance falls a hundredfold

Second derivatives of the dynamics count only once a lane takes whole steps that gain
less than a tenth, and not after a failed or a very short one: with them from the start
a quarter of the lanes ends in worse optima, without them some never end.

Source: Tassa, Mansard and Todorov (2014); Howell, Jackson and Manchester (2019), ALTRO;
Andreani et al. (2007), ALGENCAN, the schedule of weights.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lanes.kernels import triangle
from swarmstart.ocp.lanes.posed import Posed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEPS = np.array([0.5, 0.25, 0.1, 0.02, 0.003])
"""Shorter steps, tried side by side where the whole one does not help."""
FEASIBLE = 1e-7
"""Violation, in the NLP's numbers near one, at which a lane is done."""
_LEAST_MU, _MOST_MU = 1e-9, 1e7
_LEAST_VALUE, _NOTHING = 1e-3, 1e-3
_SLOW, _SHORT = 0.1, 0.2
"""Fall below which second derivatives help; length of a step too short for them."""
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
class _Lanes:
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

    def kept(self, places: NDArray[np.int64]) -> "_Lanes":
        """Return some of the lanes."""
        return _Lanes(**{
            one.name: np.ascontiguousarray(getattr(self, one.name)[..., places])
            for one in fields(self)
        })  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """Roll-outs: where lanes would be after a step."""

    y: Array
    x0: Array
    x: Array
    end: Array
    u: Array
    value: Array


def solve_lanes(
    posed: Posed,
    controls: Array,
    starts: Array,
    *,
    weights: tuple[Array, Array],
    options: LaneOptions | None = None,
) -> LaneAnswers:
    """Return the local optima that many starts lead to.

    Args:
        posed: The problem from one initial state.
        controls: Shape (nu, N, n), within their bounds.
        starts: What is decided about the start, shape (ny, n), within its bounds.
        weights: First weights of the rows of intervals and of the end, each (n,): the
            lighter those of the end, the fewer and better the optima that are found.
        options: When lanes end; None means the defaults.
    """
    options = options or LaneOptions()
    solver = _Solver(posed, options)
    n = controls.shape[2]
    found = LaneAnswers(
        controls=np.array(controls),
        starts=np.array(starts),
        states=np.full((posed.x0.size, posed.intervals + 1, n), np.nan),
        cost=np.full(n, np.inf),
        violation=np.full(n, np.inf),
        iterations=np.zeros(n, dtype=np.int64),
    )
    lanes = solver.begun(posed.scaled(controls), starts / posed.start_sizes, weights)
    left = n
    while lanes.count and left > (1 - options.enough) * n:
        converged = np.flatnonzero(solver.step(lanes))
        if not converged.size:
            continue
        ended, cost, worst = solver.renew(lanes, converged)
        _keep(found, posed, lanes.kept(ended), cost, worst)
        left -= ended.size
        lanes.done[ended] = True
        if lanes.done.sum() > lanes.count // 8 or lanes.done.all():
            lanes = lanes.kept(np.flatnonzero(~lanes.done))
    rest = lanes.kept(np.flatnonzero(~lanes.done))
    if rest.count:
        _keep(found, posed, rest, *solver.judged(rest))
    return found


def _keep(
    found: LaneAnswers, posed: Posed, lanes: _Lanes, cost: Array, worst: Array
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


class _Solver:
    """The loop's parts; changes lanes in place."""

    def __init__(self, posed: Posed, options: LaneOptions) -> None:
        self._posed, self._options = posed, options
        self._nx, self._ny = posed.tied.shape
        self._fixed = np.where(posed.tied.any(axis=1), 0.0, posed.x0)[:, None]
        self._N, self._nu = posed.intervals, posed.least.size
        # Takes the triangle of V to what it is of the decisions, T' V T.
        self._onto_start = np.array([
            np.outer(*posed.tied[[i, j]]) + (i != j) * np.outer(*posed.tied[[j, i]])
            for i, j in triangle(self._nx)
        ]).reshape(len(triangle(self._nx)), self._ny**2).T  # fmt: skip
        reach = posed.first_most - posed.first_least
        self._stride = np.where(np.isfinite(reach), 0.1 * reach, 1.0)[:, None]

    def begun(self, u: Array, y: Array, weights: tuple[Array, Array]) -> _Lanes:
        """Return lanes rolled out from their starts."""
        n, posed = u.shape[1], self._posed
        nc, n_end = posed.interval[2].size, posed.end[2].size
        n_begin = 0 if posed.begin is None else posed.begin[2].size
        none = np.zeros((1, n))
        lanes = _Lanes(
            number=np.arange(n), y=np.array(y), x0=self._start(y),
            x=np.zeros((self._N * self._nx, n)), end=np.zeros((self._nx, n)), u=u,
            m=np.zeros((self._N * nc, n)), m_end=np.zeros((n_end, n)),
            m_begin=np.zeros((n_begin, n)),
            r=np.array(weights[0])[None, :], r_end=np.array(weights[1])[None, :],
            value=np.full((1, n), np.inf), mu=np.full((1, n), 1e-6), theta=none.copy(),
            tolerance=np.full((1, n), self._options.first_tolerance),
            broken=np.full((1, n), np.inf), broken_end=np.full((1, n), np.inf),
            since=np.zeros((1, n), dtype=np.int64),
            renewed=np.zeros((1, n), dtype=np.int64),
            iterations=np.zeros(n, dtype=np.int64), done=np.zeros(n, dtype=bool),
        )  # fmt: skip
        self._rolled_out(lanes)
        return lanes

    def _start(self, y: Array) -> Array:
        return np.ascontiguousarray(self._fixed + self._posed.tied @ y)

    def _rolled_out(self, lanes: _Lanes) -> None:
        """Find states and values of the lanes' controls."""
        n = lanes.count
        k = np.zeros((self._N * self._nu, n))
        K = np.zeros((self._N * self._nu * self._nx, n))
        made = self._trial(lanes, k, K, np.zeros((self._ny, n)), np.zeros((1, n)))
        lanes.x, lanes.end, lanes.value = made.x, made.end, made.value

    def _trial(self, lanes: _Lanes, k: Array, K: Array, dy: Array, a: Array) -> _Trial:
        """Return lanes after a step of a given length."""
        posed = self._posed
        y = lanes.y + a * dy
        y = np.clip(y, posed.first_least[:, None], posed.first_most[:, None])
        x0 = self._start(y)
        end, cost, x, u = posed.kernels.forward.evaluate([
            x0, np.zeros_like(a), lanes.x, lanes.u, k, K, lanes.m, a, lanes.r,
            posed.least, posed.most, *posed.interval,
        ])  # fmt: skip
        value = cost + self._at_end(end, lanes)[0]
        if posed.begin is not None:
            value = value + self._at_begin(x0, lanes)[0]
        finite = np.isfinite(value) & np.isfinite(end).all(axis=0)
        return _Trial(y, x0, x, end, u, np.where(finite, value, np.inf))

    def _at_end(self, end: Array, lanes: _Lanes) -> tuple[Array, ...]:
        return self._posed.kernels.end.evaluate(
            [end, lanes.m_end, lanes.r_end, *self._posed.end]
        )

    def _at_begin(self, x0: Array, lanes: _Lanes) -> tuple[Array, ...]:
        begin, known = self._posed.kernels.begin, self._posed.begin
        if begin is None or known is None:
            raise TypeError("expected a start that is decided")
        return begin.evaluate([x0, lanes.m_begin, lanes.r, *known])

    @np.errstate(invalid="ignore", over="ignore")
    def step(self, lanes: _Lanes) -> Mask:
        """Take one step in every lane: back, forward, and shorter where that fails.

        Returns:
            Which lanes have converged inside, shape (n,).
        """
        posed, n = self._posed, lanes.count
        _, slope, bend, *_ = self._at_end(lanes.end, lanes)
        slope, bend, k, K = posed.kernels.backward.evaluate([
            slope, bend, lanes.x, lanes.u, lanes.m, lanes.mu, lanes.theta, lanes.r,
            posed.least, posed.most, *posed.interval,
        ])  # fmt: skip
        dy = self._start_step(lanes, slope, bend)
        made = self._trial(lanes, k, K, dy, np.ones((1, n)))
        size = np.maximum(np.abs(lanes.value), _LEAST_VALUE)
        # A whole step that neither gains nor loses: there is nothing left to gain.
        settled = np.abs(made.value - lanes.value) <= _NOTHING * lanes.tolerance * size
        low = lanes.value - 1e-13 * np.abs(lanes.value)
        length = np.ones((1, n))
        failed = np.flatnonzero(~(made.value < low)[0] & ~lanes.done)
        if failed.size:
            length[:, failed] = self._shorter(lanes, made, failed, (k, K, dy))
        better = made.value < low
        fall = np.where(better, (lanes.value - made.value) / size, 0.0)
        for name in ("y", "x0", "x", "end", "u", "value"):
            setattr(lanes, name, np.where(better, getattr(made, name),
                                          getattr(lanes, name)))  # fmt: skip
        converged = self._regulated(lanes, better, length, fall)
        return np.asarray((converged | settled[0]) & ~lanes.done)

    def _shorter(
        self,
        lanes: _Lanes,
        made: _Trial,
        failed: NDArray[np.int64],
        step: tuple[Array, Array, Array],
    ) -> Array:
        """Put the best of shorter steps in place of those that failed.

        Returns:
            Their lengths, shape (failed,).
        """
        several = np.tile(failed, STEPS.size)
        k, K, dy = (np.ascontiguousarray(part[:, several]) for part in step)
        a = np.repeat(STEPS, failed.size)[None, :]
        tried = self._trial(lanes.kept(several), k, K, dy, a)
        best = tried.value.reshape(STEPS.size, failed.size).argmin(axis=0)
        chosen = best * failed.size + np.arange(failed.size)
        for name in ("y", "x0", "x", "end", "u", "value"):
            getattr(made, name)[:, failed] = getattr(tried, name)[:, chosen]
        return np.asarray(STEPS[best])

    def _start_step(self, lanes: _Lanes, slope: Array, bend: Array) -> Array:
        """Return Newton's step of what is decided about the start, (ny, n)."""
        posed, n, ny = self._posed, lanes.count, self._ny
        if not ny:
            return np.zeros((0, n))
        if posed.begin is not None:
            _, more, curved, *_ = self._at_begin(lanes.x0, lanes)
            slope, bend = slope + more, bend + curved
        g = posed.tied.T @ slope
        H = (self._onto_start @ bend).T.reshape(n, ny, ny) + (
            lanes.mu[0][:, None, None] * np.eye(ny)
        )
        least, most = posed.first_least[:, None], posed.first_most[:, None]
        held = ((lanes.y <= least) & (g > 0)) | ((lanes.y >= most) & (g < 0))
        free = ~held.T
        H = np.where(free[:, :, None] & free[:, None, :], H, 0.0)
        H[:, np.arange(ny), np.arange(ny)] += held.T
        usable = np.isfinite(H).all(axis=(1, 2)) & np.isfinite(g).all(axis=0)
        H[~usable], g[:, ~usable] = np.eye(ny), 0.0
        values, vectors = np.linalg.eigh(H)
        along = np.einsum("nij,in->nj", vectors, np.where(held, 0.0, g))
        along /= np.maximum(np.abs(values), 1e-12)
        step = -np.einsum("nij,nj->in", vectors, along)
        return np.asarray(np.clip(step, -self._stride, self._stride))

    def _regulated(
        self, lanes: _Lanes, better: Mask, length: Array, fall: Array
    ) -> Mask:
        """Set mu and theta after a step, and count it; return where lanes converged."""
        whole, mu = better & (length == 1.0), lanes.mu
        grown = np.where(better, 2 * mu, np.maximum(20 * mu, 1e-4))
        lanes.mu = np.where(whole, np.maximum(mu / 10, _LEAST_MU), grown)
        theta = np.where(whole & (fall < _SLOW), 1.0, lanes.theta)
        lanes.theta = np.where(better & (length >= _SHORT), theta, 0.0)
        lanes.since, lanes.iterations = lanes.since + 1, lanes.iterations + 1
        small = better & (fall < lanes.tolerance)
        small &= whole | (fall < 0.01 * lanes.tolerance)
        ended = small | (lanes.mu > _MOST_MU) | (lanes.since >= self._options.inner)
        return np.asarray(ended[0])

    def renew(
        self, lanes: _Lanes, converged: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """Renew the multipliers of lanes, and their weights where that did not help.

        Args:
            lanes: The lanes; changed.
            converged: Which of them have converged inside.

        Returns:
            Which lanes have ended, and of these costs and worst excesses.
        """
        options, some = self._options, lanes.kept(converged)
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
        self._rolled_out(some)
        for one in fields(some):
            getattr(lanes, one.name)[..., converged] = getattr(some, one.name)
        ended = done[0]
        return converged[ended], seen.cost[0][ended], seen.worst[0][ended]

    def _heavier(self, weight: Array, broken: Array, before: Array) -> Array:
        slow = (broken > 0.1 * before) & (broken > FEASIBLE)
        grown = np.minimum(weight * self._options.factor, _HEAVIEST)
        return np.asarray(np.where(slow, grown, weight))

    def judged(self, lanes: _Lanes) -> tuple[Array, Array]:
        """Return costs and worst excesses, each (n,)."""
        seen = self._seen(lanes)
        return seen.cost[0], seen.worst[0]

    def _seen(self, lanes: _Lanes) -> "_Seen":
        """Return costs and rows of lanes as they are."""
        posed, none = self._posed, np.zeros((1, lanes.count))
        cost, worst, broken, m = posed.kernels.rows.evaluate([
            none, none, none, lanes.x, lanes.u, lanes.m, lanes.r, *posed.interval,
        ])  # fmt: skip
        _, _, _, more, worst_end, broken_end, m_end = self._at_end(lanes.end, lanes)
        cost, worst = cost + more, np.maximum(worst, worst_end)
        m_begin = lanes.m_begin
        if posed.begin is not None:
            _, _, _, more, at_begin, stuck, m_begin = self._at_begin(lanes.x0, lanes)
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
