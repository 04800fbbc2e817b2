"""The machine code of local solves by gradients: values, gradients, new multipliers."""

from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.compiled.simd import SimdBatch
from swarmstart.ocp.lanes.schedule import LaneOptions, Schedule, renewed
from swarmstart.ocp.lanes.stages import (
    Reads,
    Stage,
    augmented,
    flat_kernel,
    known_of,
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
