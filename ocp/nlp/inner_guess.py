"""Initial guess of the collocation unknowns, and their distance from the evaluator.

The states at the collocation points come from the problem's integrator, started at the
beginning of a check. A correction that grows linearly in time is added, so that they
end at the given state at the check's end. If the integrator misses the given state, in
any component, by more than this component changes over the check, the states lie on a
straight line instead. Algebraic variables come from Newton's method; if the method
fails, they are its start values.
"""

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.integration.integrators import integrate
from swarmstart.ocp.integration.radau import radau_coefficients
from swarmstart.ocp.nlp.collocation import Layout
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting


class InnerGuess:
    """Guess of the inner unknowns of a problem's intervals; compiled once."""

    def __init__(self, shooting: Shooting, layout: Layout) -> None:
        """Compile the integration from point to point."""
        self._shooting, self._layout = shooting, layout
        self._problem = problem = shooting.problem
        times = radau_coefficients(layout.points).times
        parts = np.arange(layout.elements)[:, None] + times
        self._parts = parts.ravel() / layout.elements
        self._along = [_along(shooting, self._parts, first) for first in (True, False)]
        self._stage = shooting.stage.map(problem.intervals)
        names, found = [*problem.symbols().values()], problem.model.elimination
        self._z = ca.Function("z", names, [found.solution, found.start])
        self._size = ca.Function("size", [*names, found.symbols], [found.size])

    def __call__(
        self, controls: Array, pieces: Array, parameters: Array, signals: Array
    ) -> Array:
        """Return the inner unknowns, shape (size, N), not scaled.

        Args:
            controls: Controls, shape (nu, N).
            pieces: States at both ends of each check, shape (nx, checks + 1, N).
            parameters: Parameters, shape (np,).
            signals: Signals at the nodes, shape (ns, nodes).
        """
        layout, (_, _, N) = self._layout, pieces.shape
        known, p = self._by_interval(signals), np.tile(parameters[:, None], (1, N))
        states, varying = [pieces[:, 0]], [known[:, 0]]
        for k in range(layout.checks):
            ends = known[:, k], known[:, k + 1]
            # Only the first check begins with a jump of the controls.
            along = self._along[0 if k == 0 else 1]
            found = np.array(along(pieces[:, k], controls, p, *ends))
            found = found.reshape((len(found), N, self._parts.size)).transpose(2, 0, 1)
            bends = not (self._problem.model.jumps and k == layout.checks - 1)
            states += [*self._led(found, pieces[:, k], pieces[:, k + 1], bends=bends)]
            varying += [self._shooting.signals_at(ends, part) for part in self._parts]
        moving = list(layout.moving)
        inner = [state[moving] for state in states[1:]]
        if layout.lifted:
            inner += [
                self._algebraic(state, controls, p, s)
                for state, s in zip(states, varying, strict=True)
            ]
        return np.concatenate([np.empty((0, N)), *inner])

    def pieces_of(self, nodes: Array) -> Array:
        """Return states at the nodes by interval, shape (nx, checks + 1, N).

        A node between two intervals belongs to both.

        Args:
            nodes: States at the nodes, shape (nx, nodes).
        """
        return self._by_interval(nodes)

    def followed(
        self,
        controls: Array,
        begins: Array,
        known: tuple[Array, Array],
        sizes: Sizes,
    ) -> Array:
        """Return the states that the rollout's integrator reaches, (nx, checks + 1, N).

        They are the given start of each interval, and the states at its checks that the
        integrator reaches from there.

        Args:
            controls: Controls, shape (nu, N).
            begins: States at the start of the intervals, shape (nx, N).
            known: Parameters, shape (np,), and signals at the nodes, (ns, nodes).
            sizes: The natural sizes, by which steps are controlled.
        """
        (parameters, signals), (nx, N) = known, begins.shape
        p = np.append(parameters, self._shooting.automatic(sizes))
        s = self._by_interval(signals)
        s = s.reshape((len(s), s.shape[1] * N), order="F")
        states = self._stage(begins, controls, np.tile(p[:, None], (1, N)), s)[0]
        after = np.array(states).reshape((nx, self._layout.checks, N), order="F")
        return np.concatenate([begins[:, None], after], axis=1)

    def residual_sizes(self, x0: Array, parameters: Array, signals: Array) -> Array:
        """Return the size of each algebraic equation at the start, shape (nz,).

        Args:
            x0: Initial state, shape (nx,).
            parameters: Parameters, shape (np,).
            signals: ca.vec of the signals.
        """
        if not self._layout.lifted:
            return np.empty(0)
        lower, upper = self._problem.search_limits
        bounded = np.isfinite(lower) & np.isfinite(upper)
        middle = np.clip(0.0, lower, upper)
        middle[bounded] = (lower[bounded] + upper[bounded]) / 2
        at = [x0, middle, parameters, signals[: self._problem.ns]]
        z = self._algebraic(*[column[:, None] for column in at])
        sizes = np.array(self._size(*at, z[:, 0])).ravel()
        return np.where(np.isfinite(sizes) & (sizes > 0), sizes, 1.0)

    def _by_interval(self, nodes: Array) -> Array:
        """Return rows at the nodes as (rows, checks + 1, N)."""
        checks, N = self._layout.checks, self._problem.intervals
        columns = np.arange(N) * checks + np.arange(checks + 1)[:, None]
        return np.asarray(nodes[:, columns])

    def _led(self, states: Array, begin: Array, end: Array, *, bends: bool) -> Array:
        """Return states at the points of a check, corrected to reach a given end.

        Args:
            states: States from the integrator, shape (points, nx, N).
            begin: State at the start of the check, shape (nx, N).
            end: State at its end, shape (nx, N).
            bends: Whether the end is the integrator's end, without a jump.
        """
        parts = self._parts[:, None, None]
        line = begin + parts * (end - begin)
        lost = ~np.isfinite(states).all(axis=(0, 1))
        states = np.where(lost, line, states)
        if bends:
            missed = end - states[-1]
            # It misses the end by more than the whole way, so it leads elsewhere.
            lost = (np.abs(missed) > np.abs(end - begin)).any(axis=0)
            states = states + parts * missed
        return np.where(lost, line, states)

    def _algebraic(self, states: Array, u: Array, p: Array, s: Array) -> Array:
        """Return z at each column; Newton's start values if Newton's method fails."""
        solved, start = map(np.array, self._z(states, u, p, s))
        start = np.nan_to_num(start, nan=0.0, posinf=0.0, neginf=0.0)
        return np.where(np.isfinite(solved).all(axis=0), solved, start)


def _along(shooting: Shooting, parts: Array, first: bool) -> ca.Function:
    """Return (x, u, p, s0, s1) -> the states at a check's points, shape (nx, points).

    Args:
        shooting: The problem's functions.
        parts: Times of the points, as fractions of the check.
        first: Whether the check is the first of an interval.
    """
    problem, f = shooting.problem, shooting.dynamics
    model, ns = problem.model, problem.model.ns
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p, ends = ca.SX.sym("p", model.np), [ca.SX.sym("s", problem.ns) for _ in range(2)]
    duration = problem.dt / problem.checks

    def rate(t: float, y: ca.SX) -> ca.SX:
        return f(y, u, p, shooting.signals_at((ends[0], ends[1]), t / duration)[:ns, 0])

    state, found, begin = x, [], 0.0
    for end in parts * duration:
        state = integrate(
            problem.integrator,
            rate,
            state,
            start=begin,
            duration=float(end) - begin,
            steps=1,
            after_jump=first and begin == 0.0,
        )
        found.append(state)
        begin = float(end)
    return ca.Function("along", [x, u, p, *ends], [ca.cse(ca.horzcat(*found))])
