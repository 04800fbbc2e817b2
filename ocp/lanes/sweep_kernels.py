"""The machine code of steps by differential dynamic programming.

The backward sweep finds the step within the box bounds of the controls, carrying V'(x)
and V''(x). Second derivatives of the rows are left out (Gauss-Newton); those of F have
the weight theta, 0 or 1. If a lane is `fresh`, the sweep also renews its multipliers.
At the start follows the step of the decisions about it. The forward sweep rolls out,
with the controls clipped to their bounds,

    u = u_old + a k + K (x - x_old)

Source: Tassa, Mansard and Todorov (2014), Control-limited differential dynamic
programming.
"""

from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.lanes.stages import (
    Kernel,
    LaneOptions,
    Reads,
    Stage,
    augmented,
    bend_of,
    flat_kernel,
    known_of,
    lower,
    scan_kernel,
    slope_of,
    solved,
    stages,
    symbols,
    symmetric,
    triangle,
)
from swarmstart.ocp.lanes.verdict import verdict_kernel
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.statement.problem import OptimalControlProblem

_AT_BOUND = 1e-9
"""Distance from its bound, relative to its size, at which a control is at the bound."""


class Sweeps(NamedTuple):
    """The kernels of a step, in the order in which they are called.

    ddp.py explains what they read and write.

    Attributes:
        backward: The sweep from the end to the start.
        start: The step of the decisions about the start.
        forward: The roll-out from the start to the end.
        verdict: Judges the step and decides what comes next.
        keep: Copies the intervals of lanes whose step is accepted.
    """

    backward: Kernel
    start: Kernel
    forward: Kernel
    verdict: Kernel
    keep: Kernel


def compile_sweeps(program: NonlinearProgram, options: LaneOptions) -> Sweeps:
    """Return the machine code of steps by sweeps.

    Raises:
        UnknownOperationError: If a function has an operation that is not compiled.
        NoCompilerError: If machine code cannot be made here, or would be too long.
    """
    N = program.problem.intervals
    interval, end, begin = stages(program)
    return Sweeps(
        _backward(interval, N),
        _start(program.problem, begin),
        _forward(interval, N),
        verdict_kernel(end, begin, options, starts=len(program.problem.free_starts)),
        _keep(interval, N),
    )


def _backward(stage: Stage, N: int) -> Kernel:
    x, u = stage.x, stage.u
    nx, nu, z = x.numel(), u.numel(), ca.vertcat(x, u)
    carried = symbols(slope=nx, bend=len(triangle(nx)), spent=1, stuck=1)
    lane = symbols(mu=1, theta=1, r=1, r_was=1, fresh=1)
    shared = symbols(least=nu, most=nu)
    slope, bend, spent, stuck = carried.values()
    mu, theta, r, r_was, fresh = lane.values()
    given = ca.SX.sym("m", stage.rows.numel())
    # The old weight: the steps so far were made with it.
    m = ca.if_else(fresh, augmented(stage, given, r_was).multipliers, given)
    al, V = augmented(stage, m, r), symmetric(bend, nx)
    J, rows = ca.jacobian(stage.after, z), ca.jacobian(stage.rows, z)
    ahead = ca.dot(slope, stage.after)
    Qz = ca.gradient(stage.cost + ahead, z) + rows.T @ al.force
    Q = ca.hessian(stage.cost, z)[0] + theta * ca.hessian(ahead, z)[0]
    Q += r * (rows.T @ (rows * ca.repmat(al.pressed, 1, nx + nu))) + J.T @ V @ J
    Qu, Quu, Qux = Qz[nx:], Q[nx:, nx:], Q[nx:, :nx]
    k, K = _box_step(u, Qu, Quu, Qux, list(shared.values()), mu)
    # In full, since a step that is regularised or held at bounds does not minimise Q.
    before = Qz[:nx] + K.T @ (Quu @ k + Qu) + Qux.T @ k
    bent = Q[:nx, :nx] + K.T @ Quu @ K + K.T @ Qux + Qux.T @ K
    writes = {
        "slope_start": before, "bend_start": lower(bent),
        "spent_start": spent + al.value, "stuck_start": ca.fmax(stuck, al.broken),
        "k": k, "K": ca.vec(K), "m_new": m,
    }  # fmt: skip
    # The carried values begin with those of the end.
    named = {"slope": slope, "bend": bend, "at_end": spent, "nothing": stuck}
    each = {"x": x, "u": u, "m": given}
    return scan_kernel(
        stage, Reads(named, each, lane, shared), writes, N, backward=True
    )


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
    free = 1 - held_at(u, Qu, least + _AT_BOUND, most - _AT_BOUND)
    masked = ca.repmat(free, 1, 1 + Qux.shape[1]) * ca.horzcat(Qu, Qux)
    step = solved(_without_held(Quu + mu * ca.SX.eye(nu), free), masked)
    k = ca.fmin(ca.fmax(u - step[:, 0], least), most) - u
    return k, -step[:, 1:] * ca.repmat(free, 1, Qux.shape[1])


def held_at(u: ca.SX, slope: ca.SX, least: ca.SX, most: ca.SX) -> ca.SX:
    """Return 1 for controls that are at a bound and would cross it, else 0."""
    return ca.logic_or(
        ca.logic_and(u <= least, slope > 0), ca.logic_and(u >= most, slope < 0)
    )


def _without_held(H: ca.SX, free: ca.SX) -> ca.SX:
    """Return a Hessian with rows and columns of the identity for held controls."""
    return (free @ free.T) * H + ca.diag(1 - free)


def _start(problem: OptimalControlProblem, begin: Stage | None) -> Kernel:
    """Return the kernel of Newton's step of the decisions about the start."""
    nx, decided = problem.model.nx, problem.free_starts
    ny, tied = len(decided), ca.SX(problem.model.nx, len(decided))
    for column, one in enumerate(decided):
        tied[list(one.states), column] = 1
    lane = symbols(
        slope_start=nx, bend_start=len(triangle(nx)), spent_start=1, y=ny, mu=1,
        length=1, value=1, fresh=1, renewed=1, again=1,
    )  # fmt: skip
    slope, bend, value, y, mu, length, *_ = lane.values()
    shared = symbols(first_least=ny, first_most=ny, stride=ny, fixed=nx)
    least, most, stride, fixed = shared.values()
    bend = symmetric(bend, nx)
    if begin is not None:
        own = {"x0": begin.x, **symbols(m_begin=begin.rows.numel(), r=1)}
        al = augmented(begin, own["m_begin"], own["r"])
        slope, bend = slope + slope_of(begin, al), bend + bend_of(begin, al, own["r"])
        value += al.value
        lane, shared = lane | own, shared | known_of(begin, "begin")
    g = tied.T @ slope
    free = 1 - held_at(y, g, least, most)
    H = _without_held(tied.T @ bend @ tied + mu * ca.SX.eye(ny), free)
    step = ca.fmin(ca.fmax(-solved(H, free * g), -stride), stride)
    # A lane that must be rolled out has no step yet; a lane that begins again keeps its
    # start until multipliers are renewed.
    kept = ca.logic_and(lane["again"], lane["renewed"] < 1)
    moves = ca.logic_and(length > 0, ca.logic_not(kept))
    moved = y + ca.if_else(moves, length * step, 0 * y)
    moved = ca.fmin(ca.fmax(moved, least), most)
    writes = {
        "y_new": moved,
        "x0_new": fixed + tied @ moved,
        "value_now": ca.if_else(lane["fresh"], value, lane["value"]),
    }
    return flat_kernel(lane, shared, writes)


def _forward(stage: Stage, N: int) -> Kernel:
    x, u = stage.x, stage.u
    nx, nu, nc = x.numel(), u.numel(), stage.rows.numel()
    (sums,) = symbols(nothing4=4).values()
    each = symbols(x_old=nx, u_old=nu, k=nu, K=nu * nx, m=nc)
    lane, shared = symbols(length=1, r=1), symbols(least=nu, most=nu)
    length, r = lane.values()
    back = ca.reshape(each["K"], nu, nx) @ (x - each["x_old"])
    # A lane that must be rolled out has no k and K yet, but old numbers in their place.
    step = ca.if_else(length > 0, length * each["k"] + back, 0 * u)
    moved = ca.fmin(ca.fmax(each["u_old"] + step, shared["least"]), shared["most"])
    al = augmented(stage, each["m"], r)
    total = ca.vertcat(
        sums[:2] + ca.vertcat(al.value, stage.cost),
        ca.fmax(sums[2:], ca.vertcat(al.worst, al.broken)),
    )
    after, total = ca.substitute([stage.after, total], [u], [moved])
    writes = {"end_new": after, "sums_new": total, "x_new": x, "u_new": moved}
    named = dict(zip(("x", "u", "k", "K", "m_new"), each.values(), strict=True))
    reads = Reads({"x0_new": x, "nothing4": sums}, named, lane, shared)
    return scan_kernel(stage, reads, writes, N)


def _keep(stage: Stage, N: int) -> Kernel:
    """Return the kernel that copies accepted steps; it may write in place."""
    nx, nu, nc = stage.x.numel(), stage.u.numel(), stage.rows.numel()
    each = symbols(x=nx, u=nu, x_new=nx, u_new=nu, m_new=nc)
    (taken,) = symbols(taken=1).values()
    writes = {
        "x": ca.if_else(taken, each["x_new"], each["x"]),
        "u": ca.if_else(taken, each["u_new"], each["u"]),
        "m": each["m_new"],
    }
    return scan_kernel(stage, Reads({}, each, {"taken": taken}, {}), writes, N)
