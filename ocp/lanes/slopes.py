"""Local solves of many starts at once by gradients: for stages too long for sweeps.

A lane computes the gradient of a rollout by its controls, from the last interval back
(the adjoint equation), and descends by projected L-BFGS within the bounds
(heuristics/laws/descent.py). All lanes renew their multipliers after each descent
(`Schedule`). Values, gradients and new multipliers are machine code (`Slopes`).
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.heuristics.laws import Box, DescentOptions, descend
from swarmstart.ocp.compiled.simd import SimdBatch
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.posed import Posed
from swarmstart.ocp.lanes.stages import (
    LaneOptions,
    Reads,
    Schedule,
    Stage,
    augmented,
    flat_kernel,
    known_of,
    renewed,
    scan_kernel,
    slope_of,
    stages,
    symbols,
)
from swarmstart.ocp.nlp.transcription import NonlinearProgram


class Slopes(NamedTuple):
    """The machine code of gradients; arguments in the order given.

    "lane" stands for one number for each individual, "each" for one for each interval
    and individual; shared arguments (`Stage.known`) come last.

    Attributes:
        roll: (x, L, u, m: each, r: lane) -> (x after, L; x before: each).
        adjoint: (lambda, x, u, m: each, r: lane) -> (lambda at the start; L_u: each).
        rows: (cost, worst, broken, x, u, m: each, r: lane) -> (cost without
            multipliers, the worst excess, the worst of |c - (v within limits)|; new
            multipliers: each).
        end: (x, m, r: lane) -> (L, its gradient, cost, worst, broken, new multipliers)
            at the end.
        begin: The same at the start; None if it has no decisions.
        renewal: (schedule, broken, broken_end) -> (schedule, whether a lane has ended).
    """

    roll: SimdBatch
    adjoint: SimdBatch
    rows: SimdBatch
    end: SimdBatch
    begin: SimdBatch | None
    renewal: SimdBatch


def compile_slopes(
    program: NonlinearProgram, options: LaneOptions, *, threads: int = 1
) -> Slopes:
    """Return the machine code of gradients.

    Args:
        program: The problem's NLP.
        options: Conditions at which lanes end.
        threads: Largest number of threads for the individuals.

    Raises:
        UnknownOperationError: If a function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here, or would be too long.
    """
    N = program.problem.intervals
    interval, end, begin = stages(program)
    return Slopes(
        roll=_roll(interval, N, threads),
        adjoint=_adjoint(interval, N, threads),
        rows=_rows(interval, N, threads),
        end=_at(end, threads),
        begin=None if begin is None else _at(begin, threads),
        renewal=_renewal(options),
    )


def _roll(stage: Stage, N: int, threads: int) -> SimdBatch:
    total, r, m = symbols(total=1, r=1, m=stage.rows.numel()).values()
    value = total + augmented(stage, m, r).value
    reads = Reads({"x": stage.x, "total": total}, {"u": stage.u, "m": m}, {"r": r}, {})
    writes = {"after": stage.after, "value": value, "before": stage.x}
    return scan_kernel(stage, reads, writes, N, threads=threads).code


def _adjoint(stage: Stage, N: int, threads: int) -> SimdBatch:
    nx = stage.x.numel()
    ahead, m, r = symbols(ahead=nx, m=stage.rows.numel(), r=1).values()
    al, z = augmented(stage, m, r), ca.vertcat(stage.x, stage.u)
    slope = ca.gradient(al.value + ca.dot(ahead, stage.after), z)
    before, of_controls = ca.vertsplit(slope, [0, nx, z.numel()])
    each = {"x": stage.x, "u": stage.u, "m": m}
    writes = {"before": before, "of_controls": of_controls}
    reads = Reads({"ahead": ahead}, each, {"r": r}, {})
    return scan_kernel(stage, reads, writes, N, backward=True, threads=threads).code


def _rows(stage: Stage, N: int, threads: int) -> SimdBatch:
    carried = symbols(total=1, worst=1, broken=1)
    r, m = symbols(r=1, m=stage.rows.numel()).values()
    al = augmented(stage, m, r)
    writes = {
        "total": carried["total"] + stage.cost,
        "worst": ca.fmax(carried["worst"], al.worst),
        "broken": ca.fmax(carried["broken"], al.broken),
        "m": al.multipliers,
    }
    each = {"x": stage.x, "u": stage.u, "m": m}
    reads = Reads(carried, each, {"r": r}, {})
    return scan_kernel(stage, reads, writes, N, threads=threads).code


def _at(stage: Stage, threads: int) -> SimdBatch:
    """Return the kernel of the end or the start."""
    m, r = symbols(m=stage.rows.numel(), r=1).values()
    al = augmented(stage, m, r)
    writes = {
        "value": al.value, "slope": slope_of(stage, al), "cost": stage.cost,
        "worst": al.worst, "broken": al.broken, "m": al.multipliers,
    }  # fmt: skip
    lane = {"x": stage.x, "m": m, "r": r}
    known = known_of(stage, "end")
    return flat_kernel(lane, known, writes, threads=threads).code


def _renewal(options: LaneOptions) -> SimdBatch:
    now = symbols(**dict.fromkeys(Schedule._fields, 1))
    seen, at_end = symbols(seen=1, at_end=1).values()
    following, done = renewed(Schedule(**now), seen, at_end, options)
    writes = {**following._asdict(), "done": done}
    return flat_kernel({**now, "seen": seen, "at_end": at_end}, {}, writes).code


@dataclass(kw_only=True, slots=True, eq=False)
class _Lanes:
    """The lanes that have not ended; the last axis is the lane.

    Attributes:
        number: Number of its start.
        y: Decisions about the start, (ny, n).
        u: Controls, (N nu, n).
        x: States at the beginning of intervals, (N nx, n).
        end: State at the end, (nx, n).
        value: The augmented Lagrangian.
        m: Multipliers of the intervals' rows; m_end and m_begin: those of the ends.
        schedule: Numbers of `Schedule`, a row each.
        iterations: Total number of steps.
    """

    number: NDArray[np.int64]
    y: Array
    u: Array
    x: Array
    end: Array
    value: Array
    m: Array
    m_end: Array
    m_begin: Array
    schedule: Array
    iterations: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of lanes."""
        return self.number.size

    def of(self, name: str) -> Array:
        """Return a number of the schedule, (1, n)."""
        row = Schedule._fields.index(name)
        return np.ascontiguousarray(self.schedule[row : row + 1])

    def kept(self, places: NDArray[np.int64]) -> "_Lanes":
        """Return some of the lanes."""
        return _Lanes(**{
            one.name: np.ascontiguousarray(getattr(self, one.name)[..., places])
            for one in fields(self)
        })  # fmt: skip


def solve_by_slopes(
    posed: Posed,
    slopes: Slopes,
    controls: Array,
    starts: Array,
    *,
    weights: tuple[Array, Array],
    options: LaneOptions,
) -> LaneAnswers:
    """Return the local optima that many starts lead to.

    Args:
        posed: The problem from one initial state; all decisions have bounds.
        slopes: The machine code of gradients.
        controls: Shape (nu, N, n), within their bounds.
        starts: Decisions about the start, shape (ny, n), within their bounds.
        weights: First weights of the rows of intervals and of the end, each (n,).
        options: Conditions at which lanes end.
    """
    solver = _Descending(posed, slopes)
    found = _none_found(posed, controls, starts)
    lanes = solver.begun(
        posed.scaled(controls), starts / posed.start_sizes, weights, options
    )
    while lanes.count:
        solver.descend(lanes)
        ended, cost, worst = solver.renew(lanes)
        _write_down(found, posed, lanes.kept(ended), cost[ended], worst[ended])
        lanes = lanes.kept(np.setdiff1d(np.arange(lanes.count), ended))
    return found


class _Descending:
    """The steps of lanes; changes them in place."""

    def __init__(self, posed: Posed, slopes: Slopes) -> None:
        """Prepare steps for a problem from one initial state."""
        self._posed, self._slopes = posed, slopes
        self._split = posed.intervals * posed.least.size
        tile = posed.intervals
        self._box = Box(
            lower=np.concatenate([np.tile(posed.least, tile), posed.first_least]),
            upper=np.concatenate([np.tile(posed.most, tile), posed.first_most]),
        )

    def begun(
        self, u: Array, y: Array, weights: tuple[Array, Array], options: LaneOptions
    ) -> _Lanes:
        """Return lanes at their starts."""
        posed, n = self._posed, u.shape[1]
        begin = np.zeros(0) if posed.begin is None else posed.begin[2]
        first: dict[str, Array | float] = {
            "tolerance": options.first_tolerance, "r": weights[0], "r_end": weights[1],
            "broken": np.inf, "broken_end": np.inf, "renewed": 0.0,
        }  # fmt: skip
        schedule = [np.broadcast_to(first[name], n) for name in Schedule._fields]
        return _Lanes(
            number=np.arange(n), y=np.array(y), u=u,
            x=np.zeros((posed.intervals * posed.x0.size, n)),
            end=np.zeros((posed.x0.size, n)), value=np.zeros((1, n)),
            m=np.zeros((posed.intervals * posed.interval[2].size, n)),
            m_end=np.zeros((posed.end[2].size, n)), m_begin=np.zeros((begin.size, n)),
            schedule=np.array(schedule),
            iterations=np.zeros(n, dtype=np.int64),
        )  # fmt: skip

    def descend(self, lanes: _Lanes) -> None:
        """Minimise the augmented Lagrangians to their tolerances."""

        def sloped(w: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
            some = lanes.kept(numbers)
            some.u, some.y = self._parts(w)
            return self._sloped(some)

        # A tenth of the lane's tolerance, since a single step may gain too little.
        tolerance = 0.1 * float(lanes.of("tolerance").min())
        found = descend(
            sloped,
            self._box,
            np.vstack([lanes.u, lanes.y]),
            DescentOptions(tolerance=tolerance, slope=tolerance),
        )
        # `sloped` works on copies, so that these lanes still have their old numbers.
        lanes.u, lanes.y = self._parts(found.x)
        lanes.iterations = lanes.iterations + found.iterations
        self._roll_out(lanes)

    def _parts(self, w: Array) -> tuple[Array, Array]:
        u, y = (np.ascontiguousarray(part) for part in np.split(w, [self._split]))
        return u, y

    def _roll_out(self, lanes: _Lanes) -> None:
        """Compute the states and values of the lanes' controls."""
        x0, none = self._posed.start(lanes.y), np.zeros((1, lanes.count))
        lanes.end, value, lanes.x = self._slopes.roll.evaluate(
            [x0, none, lanes.u, lanes.m, lanes.of("r"), *self._posed.interval]
        )
        for at in self._at_ends(lanes):
            value = value + at[0]
        finite = np.isfinite(value) & np.isfinite(lanes.end).all(axis=0)
        lanes.value = np.where(finite, value, np.inf)

    def _at_ends(self, lanes: _Lanes) -> list[tuple[Array, ...]]:
        """Return the outputs of the kernels of the end and the start; see `Slopes`."""
        posed, slopes = self._posed, self._slopes
        given = [lanes.end, lanes.m_end, lanes.of("r_end"), *posed.end]
        found = [slopes.end.evaluate(given)]
        if slopes.begin is not None and posed.begin is not None:
            given = [posed.start(lanes.y), lanes.m_begin, lanes.of("r"), *posed.begin]
            found.append(slopes.begin.evaluate(given))
        return found

    def _sloped(self, lanes: _Lanes) -> tuple[Array, Array]:
        """Return values (n,) and gradients by controls and decisions of the start."""
        self._roll_out(lanes)
        at_end, *at_begin = self._at_ends(lanes)
        ahead, of_controls = self._slopes.adjoint.evaluate(
            [at_end[1], lanes.x, lanes.u, lanes.m, lanes.of("r"), *self._posed.interval]
        )
        for at in at_begin:
            ahead = ahead + at[1]
        return lanes.value[0], np.vstack([of_controls, self._posed.tied.T @ ahead])

    def renew(self, lanes: _Lanes) -> tuple[NDArray[np.int64], Array, Array]:
        """Renew the multipliers of lanes, and their weights if that did not help.

        Returns:
            Indices of lanes that have ended; costs and worst excesses of all, each
            (n,).
        """
        none = np.zeros((1, lanes.count))
        cost, worst, broken, lanes.m = self._slopes.rows.evaluate([
            none, none, none, lanes.x, lanes.u, lanes.m, lanes.of("r"),
            *self._posed.interval,
        ])  # fmt: skip
        at_end, *at_begin = self._at_ends(lanes)
        lanes.m_end = at_end[-1]
        cost, worst = cost + at_end[2], np.maximum(worst, at_end[3])
        for at in at_begin:
            cost, worst = cost + at[2], np.maximum(worst, at[3])
            broken, lanes.m_begin = np.maximum(broken, at[4]), at[-1]
        now = [lanes.of(name) for name in Schedule._fields]
        *following, done = self._slopes.renewal.evaluate([*now, broken, at_end[4]])
        lanes.schedule = np.vstack(following)
        lost = ~(np.isfinite(cost + worst) & np.isfinite(lanes.end).all(axis=0))
        cost, worst = (np.where(lost, np.inf, part)[0] for part in (cost, worst))
        return np.flatnonzero(done[0]), cost, worst


def _none_found(posed: Posed, controls: Array, starts: Array) -> LaneAnswers:
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


def _write_down(
    found: LaneAnswers, posed: Posed, lanes: _Lanes, cost: Array, worst: Array
) -> None:
    """Record the results of lanes that have ended."""
    number = lanes.number
    found.controls[:, :, number] = posed.controls(lanes.u)
    found.starts[:, number] = lanes.y * posed.start_sizes
    found.states[:, :, number] = posed.states(lanes.x, lanes.end)
    found.cost[number] = cost * posed.sizes.cost
    found.violation[number] = worst
    found.iterations[number] = lanes.iterations
