"""What local solves compute in machine code: the stages of an augmented Lagrangian.

The problem is the NLP of transcription.py, in its numbers near one, by single shooting:
interval k leads from x to F(x, u), costs l(x, u), and its rows c(x, u), those of the
states' bounds among them, have limits. Every individual has its own multipliers m and
weight r (Powell, Hestenes, Rockafellar):

    v = c + m / r        what is beyond the limits: d = v - (v within its limits)
    L = l + r/2 |d|^2 - |m|^2 / (2 r),    new multipliers: r d

A lane is one individual. Backward: the step of differential dynamic programming within
box bounds of the controls, V'(x) and V''(x) carried; second derivatives of the rows are
left out (Gauss-Newton), those of F count theta, 0 or 1. Forward: the same interval with
the controls within their bounds,

    u = u_old + a k + K (x - x_old)

Source: Tassa, Mansard and Todorov (2014), Control-limited differential dynamic
programming; Howell, Jackson and Manchester (2019), ALTRO.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.compiled.scan import Role, compile_scan
from swarmstart.ocp.compiled.simd import SimdBatch, compile_flat
from swarmstart.ocp.nlp_assembly import Part, inputs_of
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.transcription import NonlinearProgram

_AT_BOUND = 1e-9
"""A control this near to its bound, in parts of its size, is at it."""
_SMALLEST_PIVOT = 1e-10


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LaneKernels:
    """The machine code that all ways to solve lanes need.

    Arguments come in the order given; "lane" is one number for each individual, "each"
    one for each interval and individual; what is shared comes last (`Stage.known`).

    Attributes:
        roll: (x, cost, u, m: each, r: lane) -> (x after, cost; x before: each).
        rows: (cost, worst, broken, x, u, m: each, r: lane) -> (cost without
            multipliers, the worst excess, the worst of |c - (v within limits)|; new
            multipliers: each).
        end: (x, m, r: lane) -> (L, its gradient and Hessian, cost, worst, broken, new
            multipliers) at the end.
        begin: The same at the start; None where nothing is decided about it.
    """

    roll: SimdBatch
    rows: SimdBatch
    end: SimdBatch
    begin: SimdBatch | None


class Sweeps(NamedTuple):
    """The machine code of steps by differential dynamic programming.

    The bounds of the controls come before what is shared.

    Attributes:
        backward: (V', V'', x, u, m: each, mu, theta, r: lane) -> (V', V'' at the start;
            k, K: each).
        forward: (x, cost, x_old, u_old, k, K, m: each, a, r: lane) -> (x after, cost;
            x before, u: each).
    """

    backward: SimdBatch
    forward: SimdBatch


class Stage(NamedTuple):
    """An interval, the end or the start as expressions.

    Attributes:
        x: State.
        u: Controls and excesses of soft constraints; empty at the ends.
        known: (shared numbers with weights, signals, lower and upper limits of rows).
        after: State after it; the same state at the ends.
        cost: Its cost.
        rows: Values of its rows.
    """

    x: ca.SX
    u: ca.SX
    known: tuple[ca.SX, ca.SX, ca.SX, ca.SX]
    after: ca.SX
    cost: ca.SX
    rows: ca.SX


def stages(program: NonlinearProgram) -> tuple[Stage, Stage, Stage | None]:
    """Return an interval, the end and the start of a problem."""
    problem, parts = program.problem, program.parts
    begin = None if parts.begin is None else _stage(problem, parts.begin)
    return _interval(problem, parts.interval), _stage(problem, parts.end), begin


def _interval(problem: OptimalControlProblem, part: Part) -> Stage:
    nx = problem.model.nx
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", inputs_of(problem))
    shared = ca.SX.sym("shared", part.value.numel_in(1))
    s = ca.SX.sym("s", *part.value.size_in(2))
    g = part.value(ca.vertcat(x, u), shared, s)
    after, rows = ca.vertsplit(g, [0, nx, g.numel()])
    rows = ca.vertcat(rows, after[[int(i) for i in problem.bounded_states], 0])
    cost = part.cost(ca.vertcat(x, u), shared, s)
    return Stage(x, u, _known(shared, s, rows), after, cost, rows)


def _stage(problem: OptimalControlProblem, part: Part) -> Stage:
    """Return the end or the start."""
    x = ca.SX.sym("x", problem.model.nx)
    shared = ca.SX.sym("shared", part.value.numel_in(1))
    s = ca.SX.sym("s", *part.value.size_in(2))
    rows, cost = part.value(x, shared, s), part.cost(x, shared, s)
    return Stage(x, ca.SX(0, 1), _known(shared, s, rows), x, cost, rows)


def _known(shared: ca.SX, s: ca.SX, rows: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    lower, upper = (ca.SX.sym(side, rows.numel()) for side in ("lower", "upper"))
    return shared, ca.vec(s), lower, upper


class _Augmented(NamedTuple):
    """The augmented Lagrangian of a stage.

    Attributes:
        value: L.
        multipliers: The new multipliers, r d.
        worst: The worst excess.
        broken: The worst of |c - (v within limits)|, 0 where c keeps its limits and
            those that press.
        pressed: 1 for rows that count in the Gauss-Newton Hessian, else 0.
    """

    value: ca.SX
    multipliers: ca.SX
    worst: ca.SX
    broken: ca.SX
    pressed: ca.SX


def _augmented(stage: Stage, m: ca.SX, r: ca.SX) -> _Augmented:
    *_, lower, upper = stage.known
    c = stage.rows
    v = c + m / r
    within = ca.fmin(ca.fmax(v, lower), upper)
    d = v - within
    kept = ca.fmin(ca.fmax(c, lower), upper)
    most = ca.SX(0)
    broken = ca.SX(0)
    for i in range(c.numel()):
        most = ca.fmax(most, ca.fabs(c[i] - kept[i]))
        broken = ca.fmax(broken, ca.fabs(c[i] - within[i]))
    # An equality always counts; a row within its limits does not.
    pressed = ca.logic_or(d != 0, lower == upper)
    value = stage.cost + r / 2 * ca.sumsqr(d) - ca.sumsqr(m) / (2 * r)
    return _Augmented(value, r * d, most, broken, pressed)


def compile_kernels(program: NonlinearProgram, *, threads: int = 1) -> LaneKernels:
    """Return the machine code that all ways to solve lanes need.

    Args:
        program: The problem's NLP.
        threads: Over how many threads individuals may be spread.

    Raises:
        UnknownOperationError: If a function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here, or would be too long.
    """
    N = program.problem.intervals
    interval, end, begin = stages(program)
    return LaneKernels(
        roll=_roll(interval, N, threads),
        rows=_looked_at(interval, N, threads),
        end=_at(end, threads),
        begin=None if begin is None else _at(begin, threads),
    )


def compile_sweeps(program: NonlinearProgram, *, threads: int = 1) -> Sweeps:
    """Return the machine code of steps by sweeps; see `compile_kernels`."""
    N = program.problem.intervals
    interval, _, _ = stages(program)
    return Sweeps(_backward(interval, N, threads), _forward(interval, N, threads))


def compile_adjoint(program: NonlinearProgram, *, threads: int = 1) -> SimdBatch:
    """Return (lambda, x, u, m: each, r: lane) -> (lambda at the start; L_u: each)."""
    N = program.problem.intervals
    stage, _, _ = stages(program)
    ahead, m, r = _symbols(ahead=stage.x.numel(), m=stage.rows.numel(), r=1)
    al, z = _augmented(stage, m, r), ca.vertcat(stage.x, stage.u)
    slope = ca.gradient(al.value + ca.dot(ahead, stage.after), z)
    before, of_controls = ca.vertsplit(slope, [0, stage.x.numel(), z.numel()])
    step = _Step([before, of_controls], [ahead], [stage.x, stage.u, m], [r])
    return _scan(stage, step, N, backward=True, threads=threads)


def triangle(n: int) -> list[tuple[int, int]]:
    """Return the places of the lower triangle of a matrix, row by row."""
    return [(i, j) for i in range(n) for j in range(i + 1)]


def _symmetric(entries: ca.SX, n: int) -> ca.SX:
    matrix = ca.SX(n, n)
    for number, (i, j) in enumerate(triangle(n)):
        matrix[i, j] = matrix[j, i] = entries[number]
    return matrix


def _lower(matrix: ca.SX) -> ca.SX:
    entries = [(matrix[i, j] + matrix[j, i]) / 2 for i, j in triangle(matrix.shape[0])]
    return ca.vertcat(ca.SX(0, 1), *entries)


class _Step(NamedTuple):
    """What a kernel of all intervals computes, and of what, in this order.

    Attributes:
        outputs: What is carried on, then what is kept of each interval.
        carried: From interval to interval.
        each: Of each interval and individual.
        lane: Of each individual.
        bounds: Of the controls; shared.
    """

    outputs: Sequence[ca.SX]
    carried: Sequence[ca.SX]
    each: Sequence[ca.SX]
    lane: Sequence[ca.SX]
    bounds: Sequence[ca.SX] = ()


def _scan(
    stage: Stage, step: _Step, N: int, *, backward: bool = False, threads: int
) -> SimdBatch:
    """Return the kernel of all intervals."""
    roles: list[Role] = ["carried"] * len(step.carried)
    roles += ["both"] * len(step.each)
    roles += ["individual"] * len(step.lane)
    roles += ["shared"] * len(step.bounds)
    roles += ["shared", "interval", "shared", "shared"]  # stage.known
    arguments = [*step.carried, *step.each, *step.lane, *step.bounds, *stage.known]
    outputs = [ca.cse(ca.densify(one)) for one in step.outputs]
    function = ca.Function("step", arguments, outputs)
    return compile_scan(function, roles, turns=N, backward=backward, threads=threads)


def _symbols(**sizes: int) -> list[ca.SX]:
    """Return symbols of given names and sizes."""
    return [ca.SX.sym(name, size) for name, size in sizes.items()]


def _backward(stage: Stage, N: int, threads: int) -> SimdBatch:
    x, u = stage.x, stage.u
    nx, nu, z = x.numel(), u.numel(), ca.vertcat(x, u)
    slope, bend = _symbols(slope=nx, bend=len(triangle(nx)))
    m, mu, theta, r = _symbols(m=stage.rows.numel(), mu=1, theta=1, r=1)
    bounds = _symbols(least=nu, most=nu)
    al, V = _augmented(stage, m, r), _symmetric(bend, nx)
    J, rows = ca.jacobian(stage.after, z), ca.jacobian(stage.rows, z)
    ahead = ca.dot(slope, stage.after)
    Qz = ca.gradient(stage.cost + ahead, z) + rows.T @ al.multipliers
    Q = ca.hessian(stage.cost, z)[0] + theta * ca.hessian(ahead, z)[0]
    Q += r * (rows.T @ (rows * ca.repmat(al.pressed, 1, nx + nu))) + J.T @ V @ J
    Qu, Quu, Qux = Qz[nx:], Q[nx:, nx:], Q[nx:, :nx]
    k, K = _box_step(u, Qu, Quu, Qux, bounds, mu)
    before = Qz[:nx] + K.T @ (Quu @ k + Qu) + Qux.T @ k
    bent = Q[:nx, :nx] + K.T @ Quu @ K + K.T @ Qux + Qux.T @ K
    step = _Step(
        [before, _lower(bent), k, ca.vec(K)], [slope, bend], [x, u, m],
        [mu, theta, r], bounds,
    )  # fmt: skip
    return _scan(stage, step, N, backward=True, threads=threads)


def _box_step(
    u: ca.SX,
    Qu: ca.SX,
    Quu: ca.SX,
    Qux: ca.SX,
    bounds: list[ca.SX],
    mu: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """Return k and K of the controls that are not held at their bounds."""
    nu, (least, most) = u.numel(), bounds
    held = ca.logic_or(
        ca.logic_and(u <= least + _AT_BOUND, Qu > 0),
        ca.logic_and(u >= most - _AT_BOUND, Qu < 0),
    )
    free = 1 - held
    H = (free @ free.T) * (Quu + mu * ca.SX.eye(nu)) + ca.diag(held)
    masked = ca.repmat(free, 1, 1 + Qux.shape[1]) * ca.horzcat(Qu, Qux)
    solved = _solved(H, masked)
    k = ca.fmin(ca.fmax(u - solved[:, 0], least), most) - u
    return k, -solved[:, 1:] * ca.repmat(free, 1, Qux.shape[1])


def _solved(A: ca.SX, B: ca.SX) -> ca.SX:
    """Return A^-1 B by Cholesky's method, written out.

    A pivot that is not positive counts as its size: a direction of descent all the
    same.
    """
    n, L = A.shape[0], ca.SX(*A.shape)
    for j in range(n):
        pivot = A[j, j] - ca.sumsqr(L[j, :j])
        L[j, j] = ca.sqrt(ca.fmax(ca.fabs(pivot), _SMALLEST_PIVOT))
        for i in range(j + 1, n):
            L[i, j] = (A[i, j] - ca.dot(L[i, :j], L[j, :j])) / L[j, j]
    Y = ca.SX(*B.shape)
    for i in range(n):
        Y[i, :] = (B[i, :] - L[i, :i] @ Y[:i, :]) / L[i, i] if i else B[i, :] / L[i, i]
    for i in reversed(range(n)):
        rest = L[i + 1 :, i].T @ Y[i + 1 :, :] if i + 1 < n else 0
        Y[i, :] = (Y[i, :] - rest) / L[i, i]
    return Y


def _forward(stage: Stage, N: int, threads: int) -> SimdBatch:
    x, u = stage.x, stage.u
    nx, nu = x.numel(), u.numel()
    total, a, r, m = _symbols(total=1, a=1, r=1, m=stage.rows.numel())
    x_old, u_old, k, K = _symbols(x_old=nx, u_old=nu, k=nu, K=nu * nx)
    bounds = _symbols(least=nu, most=nu)
    moved = u_old + a * k + ca.reshape(K, nu, nx) @ (x - x_old)
    moved = ca.fmin(ca.fmax(moved, bounds[0]), bounds[1])
    value = _augmented(stage, m, r).value
    after, spent = ca.substitute([stage.after, value], [u], [moved])
    step = _Step(
        [after, total + spent, x, moved], [x, total], [x_old, u_old, k, K, m], [a, r],
        bounds,
    )  # fmt: skip
    return _scan(stage, step, N, threads=threads)


def _roll(stage: Stage, N: int, threads: int) -> SimdBatch:
    total, r, m = _symbols(total=1, r=1, m=stage.rows.numel())
    after = [stage.after, total + _augmented(stage, m, r).value]
    step = _Step([*after, stage.x], [stage.x, total], [stage.u, m], [r])
    return _scan(stage, step, N, threads=threads)


def _looked_at(stage: Stage, N: int, threads: int) -> SimdBatch:
    total, worst, broken, r = _symbols(total=1, worst=1, broken=1, r=1)
    (m,) = _symbols(m=stage.rows.numel())
    al = _augmented(stage, m, r)
    after = [total + stage.cost, ca.fmax(worst, al.worst), ca.fmax(broken, al.broken)]
    carried = [total, worst, broken]
    step = _Step([*after, al.multipliers], carried, [stage.x, stage.u, m], [r])
    return _scan(stage, step, N, threads=threads)


def _at(stage: Stage, threads: int) -> SimdBatch:
    """Return the kernel of the end or the start."""
    m, r = _symbols(m=stage.rows.numel(), r=1)
    al, rows = _augmented(stage, m, r), ca.jacobian(stage.rows, stage.x)
    slope = ca.gradient(stage.cost, stage.x) + rows.T @ al.multipliers
    bend = ca.hessian(stage.cost, stage.x)[0]
    bend += r * (rows.T @ (rows * ca.repmat(al.pressed, 1, stage.x.numel())))
    outputs = [
        al.value, slope, _lower(bend), stage.cost, al.worst, al.broken, al.multipliers,
    ]  # fmt: skip
    function = ca.Function(
        "end", [stage.x, m, r, *stage.known],
        [ca.cse(ca.densify(one)) for one in outputs],
    )  # fmt: skip
    individual = (True, True, True, False, False, False, False)
    return compile_flat(function, individual, threads=threads)
