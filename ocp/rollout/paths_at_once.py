"""Finer paths of many instances at once, in machine code; only their values are kept.

The steps, points and constraints are those of path.py. A compiled loop over the fine
steps (a scan, compiled/scan.py) carries the state with the integrals of the cost, the
lowest and the highest value of each state, and the worst excess of each path row. So
nothing of a path is in memory but the fine steps' controls and signals. Another scan
rolls out the controls on the problem's own grid.

The following is left to path.py, one path after another: step size control, jumps of
the state, kinks, soft constraints, ensembles, whole numbers, sums instead of integrals
of the cost, and what cannot be compiled.
"""

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.scan import Role, compile_scan
from swarmstart.ocp.compiled.simd import SimdBatch
from swarmstart.ocp.rollout.checking import ConstraintRows
from swarmstart.ocp.rollout.path import Tracer
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.tape import UnknownOperationError

_LARGEST = 1e308
"""A number of a larger size counts as not finite."""


class Grid(NamedTuple):
    """Roll-outs on the problem's own grid.

    Attributes:
        states: States at the nodes, shape (nx, nodes, n).
        cost: Cost of each roll-out, shape (n,).
        violation: Violation of each roll-out, shape (n,); infinite if a number is not
            finite.
    """

    states: Array
    cost: Array
    violation: Array


class PathValues(NamedTuple):
    """Values of finer paths, as in `Path`.

    Attributes:
        ends: States at the end, shape (nx, n).
        reach: Natural size of each state along the path: its range, shape (nx, n).
        finite: Whether all states are finite, shape (n,).
        cost: Costs, shape (n,).
        magnitude: Integral of |stage cost| plus |terminal cost|, as in `Path`, shape
            (n,).
        along: Worst excess of each path row, relative to its scale, shape (rows, n).
        at_end: Excess of each terminal row, relative to its scale, shape (rows, n).
    """

    ends: Array
    reach: Array
    finite: NDArray[np.bool_]
    cost: Array
    magnitude: Array
    along: Array
    at_end: Array


class Data(NamedTuple):
    """Controls and data of n instances.

    Attributes:
        controls: Controls, shape (nu, N, n).
        x0: Initial states with the decisions about them, shape (nx, n).
        parameters: Parameters, shape (np, n).
        signals: Signals at the nodes, shape (ns, nodes, n).
        sizes: Natural sizes of each instance.
    """

    controls: Array
    x0: Array
    parameters: Array
    signals: Array
    sizes: list[Sizes]


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """Compiled loops (scans) over the problem's own grid and over the finer path.

    Attributes:
        tracer: Tracer that follows paths one by one; its functions are used.
        grid: Scan of the problem's own grid.
        fine: Scan of the finer path.
    """

    tracer: Tracer
    grid: SimdBatch
    fine: SimdBatch

    def with_threads(self, threads: int) -> "Paths":
        """Return the same scans, spread over threads."""
        scans = (one.with_threads(threads) for one in (self.grid, self.fine))
        return Paths(self.tracer, *scans)

    def own_grid(self, data: Data) -> Grid:
        """Return the roll-outs on the problem's own grid."""
        shooting, problem = self.tracer.shooting, self.tracer.problem
        n, checks, N = data.x0.shape[1], problem.checks, problem.intervals
        p = data.parameters
        if problem.automatic:
            weights = [shooting.automatic(sizes) for sizes in data.sizes]
            p = np.vstack([p, np.stack(weights, axis=-1)])
        # Each interval has its nodes, both ends among them, node after node.
        nodes = np.arange(N)[:, None] * checks + np.arange(checks + 1)
        given = data.signals[:, nodes].transpose(1, 2, 0, 3).reshape(-1, n)
        begun = np.array(shooting.begin(data.x0, p, data.signals[:, 0]))
        begun = begun.reshape(2, n)
        _, sums, kept = self.grid.evaluate(
            [data.x0, begun, _each(data.controls), p, given]
        )
        states = kept.reshape(N * checks, -1, n).transpose(1, 0, 2)
        states = np.concatenate([data.x0[:, None], states], axis=1)
        end = shooting.terminal(states[:, -1], p, data.signals[:, -1])
        cost, violation = sums + np.array([np.array(one).ravel() for one in end])
        finite = np.isfinite(cost) & np.isfinite(violation)
        return Grid(states, cost, np.where(finite, violation, np.inf))

    def along(self, data: Data) -> PathValues:
        """Return the values of the finer paths."""
        tracer, problem = self.tracer, self.tracer.problem
        nx, n, m = problem.model.nx, data.x0.shape[1], tracer.steps
        N, p, x0 = problem.intervals, data.parameters, data.x0
        s = self._signals(data.signals)
        first, last = s[0], s[-1]
        rows = len(tracer.checker.path.places)
        origin = np.array(tracer.stage_cost(x0, data.controls[:, 0], p, first))
        given = [
            np.vstack([x0, np.zeros((2, n))]),
            np.vstack([x0, x0]),
            np.zeros((3, n)),
            np.full((rows, n), -np.inf),
            np.repeat(_each(data.controls).reshape(N, -1, n), m, axis=0).reshape(-1, n),
            s[:-1].reshape(-1, n),
            s[1:].reshape(-1, n),
            p,
            origin.reshape(1, n),
            np.tile(tracer.lengths, N),
            np.tile(np.arange(m) == 0, N).astype(np.float64),
        ]
        y, range_, extra, worst = self.fine.evaluate(given)
        ends = y[:nx]
        begin = np.array(tracer.first_cost(x0, p, first)).ravel()
        end = np.array(tracer.end_cost(ends, p, last)).ravel()
        shift = np.zeros(n)
        if tracer.moved[1]:
            shift = np.array(tracer.end_cost(x0, p, last)).ravel()
        single, singles, stages = extra
        size = stages if tracer.moved[0] else y[nx + 1]
        reach = range_[nx:] - range_[:nx]
        u = np.zeros((problem.model.nu, 1))  # Terminal rows contain no control.
        u = np.repeat(u, n, axis=1)
        at_end, _ = tracer.checker.end.excess(ends, u, p, last)
        return PathValues(
            ends=ends,
            reach=reach,
            finite=np.asarray(np.isfinite(np.vstack([ends, reach])).all(axis=0)),
            cost=y[nx] + single + begin + end,
            magnitude=size + singles + np.abs(begin) + np.abs(end - shift),
            along=_relative(worst, scales_of(tracer.checker.path, data.sizes)),
            at_end=_relative(at_end, scales_of(tracer.checker.end, data.sizes)),
        )

    def _signals(self, signals: Array) -> Array:
        """Return the signals at the fine steps, shape (steps + 1, ns, n).

        Args:
            signals: Signals at the nodes, shape (ns, nodes, n).
        """
        problem, times = self.tracer.problem, self.tracer.times
        after = np.searchsorted(problem.times, times[:-1], side="right")
        after = np.append(after, problem.times.size - 1)
        left, right = problem.times[after - 1], problem.times[after]
        part = ((times - left) / (right - left))[None, :, None]
        found = signals[:, after - 1] + part * (
            signals[:, after] - signals[:, after - 1]
        )
        return np.ascontiguousarray(found.transpose(1, 0, 2))


def paths_of(tracer: Tracer) -> Paths | None:
    """Return the scans for a problem; None if its paths are traced one by one.

    Args:
        tracer: Tracer of its paths.
    """
    problem, shooting = tracer.problem, tracer.shooting
    if (
        problem.is_adaptive
        or problem.model.jumps
        or problem.integer
        or problem.risk is not None
        or problem.quadrature != "integral"
        or shooting.soft is not None
        or tracer.kinks.names
    ):
        return None
    try:
        return Paths(tracer, _grid(shooting), _fine(tracer))
    except (NoCompilerError, UnknownOperationError):
        return None


def _grid(shooting: Shooting) -> SimdBatch:
    """Return the scan (x, (cost, violation), u, p, S) -> (the same, states)."""
    stage = shooting.stage
    x, u, p, s = (ca.SX.sym(n, *stage.size_in(i)) for i, n in enumerate("xups"))
    sums = ca.SX.sym("sums", 2)
    states, cost, violation = stage(x, u, p, s)
    after = [states[:, -1], sums + ca.vertcat(cost, violation), ca.vec(states)]
    step = ca.Function("grid", [x, sums, u, p, ca.vec(s)], _dense(after))
    roles: list[Role] = ["carried", "carried", "both", "individual", "both"]
    turns = shooting.problem.intervals
    return compile_scan(step, roles, turns=turns)


def _fine(tracer: Tracer) -> SimdBatch:
    """Return the scan of the finer path; its arguments are those in `Paths.along`."""
    problem, checker = tracer.problem, tracer.checker
    model = problem.model
    nx, rows = model.nx, len(checker.path.places)
    y, u = ca.SX.sym("y", nx + 2), ca.SX.sym("u", model.nu)
    span, extra = ca.SX.sym("range", 2 * nx), ca.SX.sym("extra", 3)
    worst = ca.SX.sym("worst", rows)
    before, after = ca.SX.sym("s0", problem.ns), ca.SX.sym("s1", problem.ns)
    p, origin = ca.SX.sym("p", model.np), ca.SX.sym("origin")
    h, begins = ca.SX.sym("h"), ca.SX.sym("begins")
    end = tracer.step(y, u, p, before, after, h)
    x, x_end = y[:nx], end[:nx]
    single = begins * tracer.step_cost(x, u, p, before)
    stages = ca.SX(0)
    if tracer.moved[0]:
        sides = (x, before), (x_end, after)
        far = [ca.fabs(tracer.stage_cost(z, u, p, s) - origin) for z, s in sides]
        stages = h / 2 * (far[0] + far[1])
    outputs = [
        end,
        ca.vertcat(ca.fmin(span[:nx], x_end), ca.fmax(span[nx:], x_end)),
        extra + ca.vertcat(single, ca.fabs(single), stages),
        _worst(tracer, worst, [(x, u, p, before), (x_end, u, p, after)]),
    ]
    arguments = [y, span, extra, worst, u, before, after, p, origin, h, begins]
    of_each: list[tuple[Role, int]] = [
        ("carried", 4),
        ("both", 3),
        ("individual", 2),
        ("interval", 2),
    ]
    roles = [role for role, count in of_each for _ in range(count)]
    step = ca.Function("fine", arguments, _dense(outputs))
    turns = problem.intervals * tracer.steps
    return compile_scan(step, roles, turns=turns)


def _worst(
    tracer: Tracer, worst: ca.SX, ends: list[tuple[ca.SX, ca.SX, ca.SX, ca.SX]]
) -> ca.SX:
    """Return the worst excess of each path row so far, with both ends of a step.

    A row that no decision changes at the start is looked at from the first step's end
    on; the end of each other step is the begin of the next, with other controls.

    Args:
        tracer: The tracer.
        worst: The worst excess before.
        ends: States, controls, parameters and signals at the begin and at the end.
    """
    rows, free = tracer.checker.path, tracer.checker.free
    if not rows.places:
        return worst
    found = ca.vertsplit(worst)
    for number, point in enumerate(ends):
        values = rows.function(*point)
        for i in range(len(found)):
            if number or not free[i]:
                excess = _excess(
                    values[i], float(rows.lower[i, 0]), float(rows.upper[i, 0])
                )
                found[i] = ca.fmax(found[i], excess)
    return ca.vertcat(*found)


def _excess(value: ca.SX, lower: float, upper: float) -> ca.SX:
    """Return the excess of a row; infinity if its value is not finite."""
    parts = [ca.SX(-np.inf)]
    if np.isfinite(lower):
        parts.append(lower - value)
    if np.isfinite(upper):
        parts.append(value - upper)
    if len(parts) == 1:
        return parts[0]
    # NaN fails every comparison, and a maximum would leave it out.
    finite = ca.fabs(value) <= _LARGEST
    return ca.if_else(finite, ca.fmax(parts[1], parts[-1]), np.inf)


def _dense(outputs: list[ca.SX]) -> list[ca.SX]:
    found: list[ca.SX] = ca.cse([ca.densify(one) for one in outputs])
    return found


def _each(controls: Array) -> Array:
    """Return controls (nu, N, n) interval after interval, shape (N * nu, n)."""
    return np.ascontiguousarray(controls.transpose(1, 0, 2)).reshape(
        -1, controls.shape[2]
    )


def scales_of(rows: ConstraintRows, sizes: list[Sizes]) -> Array:
    """Return the scales of rows, shape (rows, n).

    Args:
        rows: The rows.
        sizes: Natural sizes of each instance.
    """
    scales = [[one.rows[c][row] for one in sizes] for c, row in rows.places]
    return np.array(scales).reshape(len(rows.places), len(sizes))


def _relative(excess: Array, scales: Array) -> Array:
    """Return excesses relative to the scales of their rows, at least 0."""
    return np.asarray(np.maximum(excess, 0.0) / scales)
