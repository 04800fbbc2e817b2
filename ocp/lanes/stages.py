"""An interval, the end and the start of a problem with an augmented Lagrangian.

The problem is the NLP of transcription.py, in its scaled numbers, by single shooting:
interval k leads from x to F(x, u), costs l(x, u), and its rows c(x, u), those of the
states' bounds among them, have limits. Every individual has its own multipliers m and
weight r (Powell, Hestenes, Rockafellar):

    v = c + m / r        excess beyond the limits: d = v - (v clipped to its limits)
    L = l + r/2 |d|^2 - |m|^2 / (2 r),    new multipliers: r d

A lane is one individual. It renews its multipliers when its inner steps have converged
(`renewed`). A weight grows thirtyfold unless its rows came ten times nearer to their
limits; the tolerance of the next inner steps is a hundredth of the last.

Source: Howell, Jackson and Manchester (2019), ALTRO; Andreani et al. (2007), ALGENCAN,
the schedule of weights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.compiled.scan import Role, compile_scan
from swarmstart.ocp.compiled.simd import SimdBatch, compile_flat
from swarmstart.ocp.nlp.nlp_assembly import Part, inputs_of
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.statement.problem import OptimalControlProblem

_MOST_MULTIPLIER = 1e7
KNOWN = ("shared", "signals", "lower", "upper")

FEASIBLE = 1e-7
"""Violation, in the NLP's scaled numbers, at which a lane is done."""
_HEAVIEST = 1e9
_HARDLY, _FAR = 0.9, 1e-3
_ROUNDING = 1e-3


class Stage(NamedTuple):
    """An interval, the end or the start as expressions.

    Attributes:
        x: State.
        u: Controls and excesses of soft constraints; empty at the ends.
        known: Shared numbers with weights, signals, lower and upper limits of rows, in
            the order of KNOWN.
        after: State after the interval; the same state at the ends.
        cost: Its cost.
        rows: Values of its rows.
    """

    x: ca.SX
    u: ca.SX
    known: tuple[ca.SX, ca.SX, ca.SX, ca.SX]
    after: ca.SX
    cost: ca.SX
    rows: ca.SX

    def at(self, x: ca.SX) -> "Stage":
        """Return the same with another expression as its state."""
        parts = [self.after, self.cost, self.rows]
        after, cost, rows = ca.substitute(parts, [self.x], [x])
        return self._replace(x=x, after=after, cost=cost, rows=rows)


def stages(program: NonlinearProgram) -> tuple[Stage, Stage, Stage | None]:
    """Return an interval, the end and the start of a problem."""
    problem, parts = program.problem, program.parts
    begin = None if parts.begin is None else _stage(problem, parts.begin)
    return _interval(problem, parts.interval), _stage(problem, parts.end), begin


def _interval(problem: OptimalControlProblem, part: Part) -> Stage:
    nx = problem.model.nx
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", inputs_of(problem))
    shared, s = _known_symbols(part)
    cost, g = part.values(ca.vertcat(x, u), shared, s)
    after, rows = ca.vertsplit(g, [0, nx, g.numel()])
    # Single shooting has no variables for the states, so their bounds are rows.
    rows = ca.vertcat(rows, after[[int(i) for i in problem.bounded_states], 0])
    return Stage(x, u, _known(shared, s, rows), after, cost, rows)


def _stage(problem: OptimalControlProblem, part: Part) -> Stage:
    """Return the end or the start."""
    x = ca.SX.sym("x", problem.model.nx)
    shared, s = _known_symbols(part)
    cost, rows = part.values(x, shared, s)
    return Stage(x, ca.SX(0, 1), _known(shared, s, rows), x, cost, rows)


def _known_symbols(part: Part) -> tuple[ca.SX, ca.SX]:
    """Return symbols of what a part's functions share, and of its signals."""
    shared = ca.SX.sym("shared", part.values.numel_in(1))
    return shared, ca.SX.sym("s", *part.values.size_in(2))


def _known(shared: ca.SX, s: ca.SX, rows: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    lower, upper = (ca.SX.sym(side, rows.numel()) for side in ("lower", "upper"))
    return shared, ca.vec(s), lower, upper


class Augmented(NamedTuple):
    """The augmented Lagrangian of a stage.

    Attributes:
        value: L.
        force: r d, the multipliers in its gradient.
        multipliers: The new multipliers, r d clipped to a range without overflow.
        worst: The worst excess.
        broken: The worst of |c - (v clipped to its limits)|, which is 0 if c is within
            its limits, and at a limit if its multiplier is not 0.
        pressed: 1 for rows that count in the Gauss-Newton Hessian, else 0.
    """

    value: ca.SX
    force: ca.SX
    multipliers: ca.SX
    worst: ca.SX
    broken: ca.SX
    pressed: ca.SX


def augmented(stage: Stage, m: ca.SX, r: ca.SX) -> Augmented:
    """Return the augmented Lagrangian of a stage for multipliers and a weight."""
    *_, lower, upper = stage.known
    c, inverse = stage.rows, 1 / r
    v = c + m * inverse
    within = ca.fmin(ca.fmax(v, lower), upper)
    d = v - within
    kept = ca.fmin(ca.fmax(c, lower), upper)
    worst, broken = ca.SX(0), ca.SX(0)
    for i in range(c.numel()):
        worst = ca.fmax(worst, ca.fabs(c[i] - kept[i]))
        broken = ca.fmax(broken, ca.fabs(c[i] - within[i]))
    # An equality always counts; a row within its limits does not.
    pressed = ca.logic_or(d != 0, lower == upper)
    value = stage.cost + r / 2 * ca.sumsqr(d) - ca.sumsqr(m) * inverse / 2
    force = r * d
    multipliers = ca.fmin(ca.fmax(force, -_MOST_MULTIPLIER), _MOST_MULTIPLIER)
    return Augmented(value, force, multipliers, worst, broken, pressed)


def slope_of(stage: Stage, al: Augmented) -> ca.SX:
    """Return the gradient of L at an end, by its state."""
    rows = ca.jacobian(stage.rows, stage.x)
    return ca.gradient(stage.cost, stage.x) + rows.T @ al.force


def bend_of(stage: Stage, al: Augmented, r: ca.SX) -> ca.SX:
    """Return the Gauss-Newton Hessian of L at an end, by its state."""
    rows = ca.jacobian(stage.rows, stage.x)
    bend = ca.hessian(stage.cost, stage.x)[0]
    bend += r * (rows.T @ (rows * ca.repmat(al.pressed, 1, stage.x.numel())))
    return bend


def triangle(n: int) -> list[tuple[int, int]]:
    """Return the indices of the lower triangle of a matrix, row by row."""
    return [(i, j) for i in range(n) for j in range(i + 1)]


def symmetric(entries: ca.SX, n: int) -> ca.SX:
    """Return the symmetric matrix of the entries of its lower triangle."""
    matrix = ca.SX(n, n)
    for number, (i, j) in enumerate(triangle(n)):
        matrix[i, j] = matrix[j, i] = entries[number]
    return matrix


def lower(matrix: ca.SX) -> ca.SX:
    """Return the entries of the lower triangle of a matrix that is symmetric."""
    entries = [(matrix[i, j] + matrix[j, i]) / 2 for i, j in triangle(matrix.shape[0])]
    return ca.vertcat(ca.SX(0, 1), *entries)


def solved(A: ca.SX, B: ca.SX) -> ca.SX:
    """Return A^-1 B by Cholesky's method, written out.

    A pivot that is not positive is replaced by its absolute value, which still gives a
    direction of descent.
    """
    return cholesky_solved(A, B)[0]


def cholesky_solved(A: ca.SX, B: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return A^-1 B, as `solved`, and the least pivot."""
    n, L, inverse, least = A.shape[0], ca.SX(*A.shape), [], ca.SX(1)
    for j in range(n):
        pivot = A[j, j] - ca.sumsqr(L[j, :j])
        least = ca.fmin(least, pivot)
        inverse.append(1 / ca.sqrt(ca.fmax(ca.fabs(pivot), _SMALLEST_PIVOT)))
        for i in range(j + 1, n):
            L[i, j] = (A[i, j] - ca.dot(L[i, :j], L[j, :j])) * inverse[j]
    Y = ca.SX(*B.shape)
    for i in range(n):
        Y[i, :] = (B[i, :] - L[i, :i] @ Y[:i, :] if i else B[i, :]) * inverse[i]
    for i in reversed(range(n)):
        rest = L[i + 1 :, i].T @ Y[i + 1 :, :] if i + 1 < n else 0
        Y[i, :] = (Y[i, :] - rest) * inverse[i]
    return Y, least


_SMALLEST_PIVOT = 1e-10


def symbols(**sizes: int) -> dict[str, ca.SX]:
    """Return symbols of given names and sizes."""
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


Named = Mapping[str, ca.SX]
"""Arguments or outputs of a kernel by their names."""


class Kernel(NamedTuple):
    """Machine code whose arguments and outputs have names.

    Attributes:
        code: The machine code.
        reads: Names of its arguments.
        writes: Names of its outputs.
    """

    code: SimdBatch
    reads: tuple[str, ...]
    writes: tuple[str, ...]


class Reads(NamedTuple):
    """The arguments of a kernel.

    Attributes:
        carried: Arguments carried from interval to interval.
        each: Arguments of each interval and individual.
        lane: Arguments of each individual.
        shared: Arguments shared by all individuals.
    """

    carried: Named
    each: Named
    lane: Named
    shared: Named


def known_of(stage: Stage, place: str) -> dict[str, ca.SX]:
    """Return the known arguments of a stage; names begin with its place."""
    names = (f"{place}.{name}" for name in KNOWN)
    return dict(zip(names, stage.known, strict=True))


def scan_kernel(
    stage: Stage,
    reads: Reads,
    writes: Named,
    N: int,
    *,
    backward: bool = False,
    threads: int = 1,
) -> Kernel:
    """Return the kernel of all intervals.

    Args:
        stage: An interval.
        reads: Its arguments, without the known arguments of the stage.
        writes: Carried values, in order, then the values kept of each interval.
        N: Number of intervals.
        backward: Whether the last interval comes first.
        threads: Over how many threads individuals may be spread.
    """
    known = known_of(stage, "interval")
    roles: list[Role] = ["carried"] * len(reads.carried)
    roles += ["both"] * len(reads.each)
    roles += ["individual"] * len(reads.lane)
    roles += ["shared"] * len(reads.shared)
    roles += ["shared", "interval", "shared", "shared"]  # KNOWN
    named = {**reads.carried, **reads.each, **reads.lane, **reads.shared, **known}
    function = simplified_function(named, writes)
    code = compile_scan(function, roles, turns=N, backward=backward, threads=threads)
    return Kernel(code, tuple(named), tuple(writes))


def flat_kernel(
    lane: Named, shared: Named, writes: Named, *, threads: int = 1
) -> Kernel:
    """Return a kernel without intervals, with individual and shared arguments."""
    own = (True,) * len(lane) + (False,) * len(shared)
    named = {**lane, **shared}
    code = compile_flat(simplified_function(named, writes), own, threads=threads)
    return Kernel(code, tuple(named), tuple(writes))


def simplified_function(reads: Named, writes: Named) -> ca.Function:
    """Return a function of named symbols, common parts computed once."""
    outputs = ca.cse([ca.densify(one) for one in writes.values()])
    return ca.Function("step", list(reads.values()), outputs)


@dataclass(frozen=True, kw_only=True, slots=True)
class LaneOptions:
    """Options of the outer loop: limits, tolerances and growth of weights.

    Attributes:
        inner: Largest number of steps between new multipliers.
        outer: Largest number of new multipliers.
        most: Largest total number of steps of a lane.
        factor: Factor by which a weight grows.
        first_tolerance: Relative decrease of the augmented Lagrangian at which the
            first inner steps end.
        tolerance: The same for the last inner steps.
        heaviest: Weight at which a lane that comes no nearer to its limits is given up.
    """

    inner: int = 60
    outer: int = 25
    most: int = 500
    factor: float = 30.0
    first_tolerance: float = 1e-2
    tolerance: float = 1e-6
    heaviest: float = 1e6


class Schedule(NamedTuple):
    """The state of a lane in its outer loop.

    Attributes:
        tolerance: See LaneOptions.
        r: Weight of the rows of intervals and start.
        r_end: Weight of the rows of the end.
        broken: Violation of the rows' complementarity when the multipliers were last
            renewed.
        broken_end: The same of the end.
        renewed: Number of times that multipliers were renewed.
    """

    tolerance: ca.SX
    r: ca.SX
    r_end: ca.SX
    broken: ca.SX
    broken_end: ca.SX
    renewed: ca.SX


def renewed(
    now: Schedule, broken: ca.SX, broken_end: ca.SX, options: LaneOptions
) -> tuple[Schedule, ca.SX]:
    """Return the state of a lane after new multipliers, and whether it has ended.

    Args:
        now: Its state before.
        broken: Violation of its rows' complementarity with the multipliers so far.
        broken_end: The same of the end.
        options: Conditions at which lanes end.
    """
    before, after = ca.fmax(now.broken, now.broken_end), ca.fmax(broken, broken_end)
    # fmax below gives the last tolerance up to rounding only.
    last = now.tolerance <= options.tolerance * (1 + _ROUNDING)
    heavy = ca.fmax(now.r, now.r_end) >= options.heaviest
    stuck = ca.logic_and(after > _HARDLY * before, after > _FAR)
    given_up = ca.logic_or(ca.logic_and(heavy, stuck), now.renewed >= options.outer)
    done = ca.logic_or(ca.logic_and(last, after <= FEASIBLE), given_up)
    return Schedule(
        tolerance=ca.fmax(0.01 * now.tolerance, options.tolerance),
        r=_heavier(now.r, broken, now.broken, options),
        r_end=_heavier(now.r_end, broken_end, now.broken_end, options),
        broken=broken,
        broken_end=broken_end,
        renewed=now.renewed + 1,
    ), done


def _heavier(
    weight: ca.SX, broken: ca.SX, before: ca.SX, options: LaneOptions
) -> ca.SX:
    slow = ca.logic_and(broken > 0.1 * before, broken > FEASIBLE)
    return ca.if_else(slow, ca.fmin(weight * options.factor, _HEAVIEST), weight)
