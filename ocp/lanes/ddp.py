"""Local solves of many starts at once: differential dynamic programming in lanes.

A step is a sweep back and a roll-out; one that does not help is tried shorter. Second
derivatives of the dynamics count only once a lane takes whole steps that gain less than
a tenth, and not after a failed or a very short one: with them from the start a quarter
of the lanes ends in worse optima, without them some never end.

Source: Tassa, Mansard and Todorov (2014), Control-limited differential dynamic
programming.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lanes.augmented import (
    AugmentedSolver,
    LaneAnswers,
    LaneOptions,
    Lanes,
    Mask,
    none_found,
    write_down,
)
from swarmstart.ocp.lanes.kernels import Sweeps, triangle
from swarmstart.ocp.lanes.posed import Posed

Array = NDArray[np.float64]

STEPS = np.array([0.5, 0.25, 0.1, 0.02, 0.003])
"""Shorter steps, tried side by side where the whole one does not help."""
_LEAST_MU, _MOST_MU = 1e-9, 1e7
_LEAST_VALUE, _NOTHING = 1e-3, 1e-3
_SLOW, _SHORT = 0.1, 0.2
"""Fall below which second derivatives help; length of a step too short for them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """Roll-outs: where lanes would be after a step."""

    y: Array
    x0: Array
    x: Array
    end: Array
    u: Array
    value: Array


def solve_by_sweeps(
    posed: Posed,
    sweeps: Sweeps,
    controls: Array,
    starts: Array,
    *,
    weights: tuple[Array, Array],
    options: LaneOptions | None = None,
) -> LaneAnswers:
    """Return the local optima that many starts lead to.

    Args:
        posed: The problem from one initial state.
        sweeps: The machine code of a step.
        controls: Shape (nu, N, n), within their bounds.
        starts: What is decided about the start, shape (ny, n), within its bounds.
        weights: First weights of the rows of intervals and of the end, each (n,): the
            lighter those of the end, the fewer and better the optima that are found.
        options: When lanes end; None means the defaults.
    """
    options = options or LaneOptions()
    solver, found = (
        _Sweeping(posed, sweeps, options),
        none_found(posed, controls, starts),
    )
    n = controls.shape[2]
    lanes = solver.begun(posed.scaled(controls), starts / posed.start_sizes, weights)
    left = n
    while lanes.count and left > (1 - options.enough) * n:
        converged = np.flatnonzero(solver.step(lanes))
        if not converged.size:
            continue
        ended, cost, worst = solver.renew(lanes, converged)
        write_down(found, posed, lanes.kept(ended), cost, worst)
        left -= ended.size
        lanes.done[ended] = True
        if lanes.done.sum() > lanes.count // 8 or lanes.done.all():
            lanes = lanes.kept(np.flatnonzero(~lanes.done))
    rest = lanes.kept(np.flatnonzero(~lanes.done))
    if rest.count:
        write_down(found, posed, rest, *solver.judged(rest))
    return found


class _Sweeping(AugmentedSolver):
    """The inner loop by sweeps."""

    def __init__(self, posed: Posed, sweeps: Sweeps, options: LaneOptions) -> None:
        super().__init__(posed, options)
        self._sweeps = sweeps
        # Takes the triangle of V to what it is of the decisions, T' V T.
        self._onto_start = np.array([
            np.outer(*posed.tied[[i, j]]) + (i != j) * np.outer(*posed.tied[[j, i]])
            for i, j in triangle(self.nx)
        ]).reshape(len(triangle(self.nx)), self.ny**2).T  # fmt: skip
        reach = posed.first_most - posed.first_least
        self._stride = np.where(np.isfinite(reach), 0.1 * reach, 1.0)[:, None]

    @np.errstate(invalid="ignore", over="ignore")
    def step(self, lanes: Lanes) -> Mask:
        """Take one step in every lane: back, forward, and shorter where that fails.

        Returns:
            Which lanes have converged inside, shape (n,).
        """
        posed, n = self.posed, lanes.count
        _, slope, bend, *_ = self.at_end(lanes.end, lanes)
        slope, bend, k, K = self._sweeps.backward.evaluate([
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
        lanes: Lanes,
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

    def _trial(self, lanes: Lanes, k: Array, K: Array, dy: Array, a: Array) -> _Trial:
        """Return lanes after a step of a given length."""
        posed = self.posed
        y = lanes.y + a * dy
        y = np.clip(y, posed.first_least[:, None], posed.first_most[:, None])
        x0 = self.start(y)
        end, cost, x, u = self._sweeps.forward.evaluate([
            x0, np.zeros_like(a), lanes.x, lanes.u, k, K, lanes.m, a, lanes.r,
            posed.least, posed.most, *posed.interval,
        ])  # fmt: skip
        return _Trial(y, x0, x, end, u, self.valued(lanes, x0, end, cost))

    def _start_step(self, lanes: Lanes, slope: Array, bend: Array) -> Array:
        """Return Newton's step of what is decided about the start, (ny, n)."""
        posed, n, ny = self.posed, lanes.count, self.ny
        if not ny:
            return np.zeros((0, n))
        if posed.begin is not None:
            _, more, curved, *_ = self.at_begin(lanes.x0, lanes)
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
        self, lanes: Lanes, better: Mask, length: Array, fall: Array
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
        ended = small | (lanes.mu > _MOST_MU) | (lanes.since >= self.options.inner)
        return np.asarray(ended[0])
