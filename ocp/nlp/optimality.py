"""Test for a local minimum at a point of the NLP: first and second order.

First order, with the cost f, the Jacobian J of the rows, and the multipliers of a
solver, lam_g of rows and lam_x of bounds (in CasADi's sign convention: positive at an
upper limit):

    |grad f + J' lam_g + lam_x| small,  |lam| times the distance to the limit small

Second order: the Hessian of the Lagrangian must be positive on the directions that keep
the dynamics and the active constraints. The dynamics are eliminated by the Riccati
recursion of the linearised problem, backward from the end, interval by interval. Let
z = (x, u) be state and controls of interval k, H_k the Hessian of the Lagrangian by z,
and [A B] the derivatives of the state after the interval by z. The excesses of soft
constraints count as controls; collocation unknowns follow from z.

    M_k = H_k + [A B]' P_k+1 [A B] + rho C'C,    M_uu > 0 in every interval
    P_k = M_xx - M_xu M_uu^-1 M_ux

over the controls that are not held at a bound. P_k is the matrix of the second-order
cost to go from x_k. C has the gradients of the active constraints as rows, each scaled
to length one, and rho is large. All M_uu positive is sufficient for a minimum: with
finite rho the least value of the quadratic form can only be smaller than on the
constraints' tangent space. A constraint does not count as active if its multiplier is
smaller than the distance to its limit.

Source: Nocedal and Wright (2006), Numerical Optimization, theorem 12.6; Debreu (1952),
Definite and semidefinite quadratic forms; Dunn and Bertsekas (1989), Efficient dynamic
programming implementations of Newton's method for unconstrained optimal control
problems.
"""

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.collocation import inner_unknowns
from swarmstart.ocp.nlp.nlp_assembly import Part, decided_states, inputs_of
from swarmstart.ocp.nlp.transcription import Limits, NonlinearProgram
from swarmstart.ocp.rollout.fitness import at_nodes
from swarmstart.ocp.statement.control_shape import ties
from swarmstart.ocp.statement.problem import OptimalControlProblem

if TYPE_CHECKING:
    from scipy import sparse

STATIONARY_WITHIN = 1e-5
"""Largest residual of the first-order conditions, relative to their terms."""
_FLAT = 1e-7
"""Curvature whose sign is uncertain, relative to the Hessian's largest entry."""
_ACTIVE = 1e-5
"""Distance from a limit, in the NLP's numbers, up to which an answer is at it."""
_RELEASES = 10
"""Number of times that limits whose multipliers have the wrong sign are let go."""
_DEPENDENT = 1e-11
"""Diagonal for multipliers, so that active rows may depend on each other."""
_HELD = 1e7
"""Weight of the active rows, relative to the Hessian's largest entry."""


class Curvature(Enum):
    """Result of the second-order test at a stationary point."""

    POSITIVE = "a strict local minimum"
    FLAT = "flat in some direction, to second order"
    NEGATIVE = "a saddle point: the cost falls in some direction"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NlpPoint:
    """A point of the NLP with multipliers, as a solver returns it.

    Attributes:
        program: The NLP.
        cost_size: Divisor of the cost in the NLP.
        w: Variables, shape (nw,).
        q: Arguments, shape (nq,).
        lam_g: Multipliers of the rows, shape (ng,).
        lam_x: Multipliers of the bounds, shape (nw,).
        limits: Bounds of variables and rows.
    """

    program: NonlinearProgram
    cost_size: float
    w: Array
    q: Array
    lam_g: Array
    lam_x: Array
    limits: Limits

    @property
    def ends(self) -> Array:
        """States between the intervals, divided by their sizes, shape (nx, N + 1)."""
        problem, inside = self.program.problem, self.intervals
        start = self.q[: problem.model.nx].copy()
        start[decided_states(problem)] = self.w[inside.size :]
        return np.hstack([start[:, None], inside[inputs_of(problem) :]])

    @property
    def intervals(self) -> Array:
        """Variables of each interval, its controls first, shape (inputs + nx, N)."""
        problem = self.program.problem
        count = (inputs_of(problem) + problem.model.nx) * problem.intervals
        return self.w[:count].reshape((-1, problem.intervals), order="F")

    @property
    def state_sizes(self) -> Array:
        """Divisors of the states, shape (nx,)."""
        model = self.program.problem.model
        return self.q[model.nx + model.np :][: model.nx]

    @property
    def control_sizes(self) -> Array:
        """Divisors of the controls, shape (nu,)."""
        model = self.program.problem.model
        return self.q[2 * model.nx + model.np :][: model.nu]


def is_stationary(point: NlpPoint) -> bool:
    """Return whether the first-order conditions hold."""
    return stationarity(point) <= STATIONARY_WITHIN


def stationarity(point: NlpPoint) -> float:
    """Return the residual of the first-order conditions; infinity if not finite.

    The residual is divided by the largest sum of the absolute values of its terms, if
    this sum exceeds one.
    """
    program = point.program
    slope = program.derivatives["grad_f"](point.w, point.q)[1]
    g, jacobian = program.derivatives["jac_g"](point.w, point.q)
    slopes = jacobian.T
    gradient = np.array(slope).ravel()
    pull = np.array(slopes @ point.lam_g).ravel()
    if not np.isfinite([*gradient, *pull, *point.lam_x]).all():
        return np.inf
    rest = gradient + pull + point.lam_x
    terms = np.abs(gradient) + np.abs(pull) + np.abs(point.lam_x)
    lost = max(
        _slack(point.lam_g, np.array(g).ravel(), point.limits.lbg, point.limits.ubg),
        _slack(point.lam_x, point.w, point.limits.lbx, point.limits.ubx),
    )
    residual = max(float(np.abs(rest).max(initial=0)), lost)
    size = max(1.0, float(terms.max(initial=0)))
    return residual / size


def least_multipliers(
    program: NonlinearProgram, w: Array, q: Array, limits: Limits
) -> tuple[Array, Array, Array]:
    """Return the multipliers with the least residual, at a feasible point.

    They minimise |grad f + J' lam_g + lam_x|, with the cost f and the Jacobian J of the
    rows. They are zero at limits that are not active, and have the right sign at the
    others. At an optimum whose active limits are independent they are its multipliers.

    Args:
        program: The NLP.
        w: Variables, shape (nw,).
        q: Arguments of the NLP, shape (nq,).
        limits: Bounds of variables and rows.

    Returns:
        lam_g of shape (ng,), lam_x of shape (nw,), and the residual, shape (nw,), which
        is infinite if something is not finite.
    """
    from scipy import sparse  # Slow to import, and only a polish is judged so.

    g = np.array(program.derivatives["grad_f"](w, q)[1]).ravel()
    c, slopes = program.derivatives["jac_g"](w, q)
    J = slopes.sparse().tocsr()
    rows = sparse.vstack([J, sparse.identity(w.size, format="csr")]).tocsr()
    values = np.concatenate([np.array(c).ravel(), w])
    lower = np.concatenate([limits.lbg, limits.lbx])
    upper = np.concatenate([limits.ubg, limits.ubx])
    found = np.zeros(values.size)
    if not (np.isfinite(g).all() and np.isfinite(J.data).all()):
        return found[: -w.size], found[-w.size :], np.full(w.size, np.inf)
    at_lower, at_upper = values <= lower + _ACTIVE, values >= upper - _ACTIVE
    active, lam, rest = np.flatnonzero(at_lower | at_upper), np.empty(0), g
    for _ in range(_RELEASES):
        lam, rest = _least_rest(g, rows[active])
        wrong = ((lam > 0) & ~at_upper[active]) | ((lam < 0) & ~at_lower[active])
        if not wrong.any():
            break
        active, lam = active[~wrong], lam[~wrong]
    found[active] = lam
    return found[: -w.size], found[-w.size :], rest


def _least_rest(g: Array, rows: "sparse.csr_matrix") -> tuple[Array, Array]:
    """Return lam and g + rows' lam with the least squares of the latter."""
    from scipy import sparse  # As above.
    from scipy.sparse.linalg import splu

    n, m = g.size, rows.shape[0]
    place = rows.tocoo()
    own, below, column = np.arange(n + m), n + place.row, place.col
    entries = (
        np.concatenate([np.repeat([1.0, -_DEPENDENT], [n, m]), *[place.data] * 2]),
        (np.concatenate([own, below, column]), np.concatenate([own, column, below])),
    )
    system = sparse.csc_matrix(entries, shape=(n + m, n + m))
    found = splu(system).solve(np.concatenate([-g, np.zeros(m)]))
    return found[n:], -found[:n]


def _slack(lam: Array, value: Array, lower: Array, upper: Array) -> float:
    """Return the largest |multiplier| times distance to the limit, capped at one."""
    # A multiplier of a limit that does not exist counts in full.
    lost = np.abs(lam) * np.minimum(_room(lam, value, lower, upper), 1.0)
    return float(np.max(np.where(lam == 0, 0.0, lost), initial=0))


def curvature(point: NlpPoint) -> Curvature:
    """Return the result of the second-order test at a stationary point."""
    problem = point.program.problem
    stages, N = _Stages(point), problem.intervals
    if problem.ties_controls:
        stages.remember_controls(problem)
    nx = stages.ends[0][0].shape[0]
    # A linear problem has no curvature, but needs thresholds above 0.
    size = max(stages.largest, np.finfo(np.float64).tiny)
    flat, held = _FLAT * size, _HELD * size
    found = Curvature.POSITIVE
    P = stages.ends[0][0] + held * _outer(stages.ends[0][1])
    for k in reversed(range(N)):
        P = P + held * np.diag(stages.held_states[k])
        H, AB, C = stages.hessian[k], stages.dynamics[k], stages.active[k]
        M = H + AB.T @ P @ AB + held * _outer(C)
        free = np.flatnonzero(~stages.held_controls[k]) + nx
        if free.size:
            values, vectors = np.linalg.eigh(M[np.ix_(free, free)])
            # Clearly negative. Down to this value rounding may decide the sign.
            if values[0] < -flat * 10:
                return Curvature.NEGATIVE
            if values[0] < flat:
                found = Curvature.FLAT
            # Flat directions count as barely positive, so that the recursion goes on.
            root = vectors / np.sqrt(np.maximum(values, flat))
            gain = M[:nx, free] @ root
            P = M[:nx, :nx] - gain @ gain.T
        else:
            P = M[:nx, :nx]
        if not np.isfinite(P).all():  # An overflow decides nothing.
            return Curvature.FLAT
    nx = problem.model.nx
    return _with_start(stages, P[:nx, :nx], found, (flat, held))


def _with_start(
    stages: "_Stages", P: Array, found: Curvature, sizes: tuple[float, float]
) -> Curvature:
    """Return the result of the second-order test with a decided start included.

    Args:
        stages: The linearised problem.
        P: Matrix of the cost to go from the start, shape (nx, nx).
        found: Result for the intervals.
        sizes: Threshold of flat curvature, and weight of the active rows.
    """
    flat, held = sizes
    free = np.array(stages.decided, dtype=int)[~stages.held_start]
    if not free.size:
        return found
    H, active = stages.ends[1]
    M = P + H + held * _outer(active)
    least = np.linalg.eigvalsh(M[np.ix_(free, free)])[0]
    if least < -flat * 10:
        return Curvature.NEGATIVE
    return Curvature.FLAT if least < flat else found


class _Stages:
    """Parts of the linearised problem, interval by interval."""

    def __init__(self, point: NlpPoint) -> None:
        program = point.program
        problem = program.problem
        nx, nu, N = problem.model.nx, inputs_of(problem), problem.intervals
        interval = program.parts.interval
        rows = interval.height
        inner, self.decided = (nu + nx) * N, decided_states(problem)
        ends = point.ends
        z = np.vstack([ends[:, :-1], point.intervals[:nu]])
        sizes = program.parts.argument_sizes(problem)
        _, shared, inside, *weights, signals = np.split(point.q, np.cumsum(sizes)[:-1])
        checks = problem.checks
        s = at_nodes(problem, signals)
        known = np.concatenate([shared, inside])
        lam = point.lam_g[: rows * N].reshape((rows, N), order="F")
        self.hessian, self.dynamics, self.active = [], [], []
        of_rows, of_bounds = rooms(point)
        active = np.abs(point.lam_g) > of_rows
        every = [s[:, k * checks : (k + 1) * checks + 1] for k in range(N)]
        inner_rows = inner_unknowns(problem)
        several = _derivatives(interval, (z, known, np.hstack(every)), lam)
        for k, derivatives in enumerate(zip(*several, strict=True)):
            H, J = _without_inner(*derivatives, nx, inner_rows)
            self.hessian.append(H)
            self.dynamics.append(J[:nx])
            kept = active[(k + 1) * rows - (len(J) - nx) : (k + 1) * rows]
            self.active.append(J[nx:][kept])
        self.ends, first = [], rows * N
        nodes = ((ends[:, -1], s[:, -1]), (ends[:, 0], s[:, 0]))
        for part, (at_node, known_there), own in zip(
            program.parts.present[1:], nodes, weights, strict=False
        ):
            after = first + part.height
            at = at_node, np.concatenate([shared, own]), known_there
            (H,), (J,) = _derivatives(part, at, point.lam_g[first:after, None])
            self.ends.append((H, J[active[first:after]]))
            first = after
        self._hold(problem, np.abs(point.lam_x) > of_bounds, inner)
        entries = [
            np.abs(H).max(initial=0)
            for H in (*self.hessian, *[H for H, _ in self.ends])
        ]
        self.largest = float(max(entries))

    def _hold(
        self, problem: OptimalControlProblem, at_bound: NDArray[np.bool_], inner: int
    ) -> None:
        """Mark the variables that are held at a bound; the inner ones come first."""
        nx, nu = problem.model.nx, inputs_of(problem)
        inside_bounds = at_bound[:inner].reshape((nu + nx, -1), order="F")
        self.held_controls = inside_bounds[: nu - inner_unknowns(problem)].T
        self.held_states = inside_bounds[nu:].T.astype(np.float64)
        self.held_start = at_bound[inner:]

    def remember_controls(self, problem: OptimalControlProblem) -> None:
        """Add the previous controls to the states of each interval, for tied controls.

        z = (x, v, u), with v the controls of the interval before. In a block of
        intervals v replaces u; if members of an ensemble share controls, those of the
        first member replace the others'.
        """
        nx, nu = problem.model.nx, problem.model.nu
        x, v, u = np.split(np.eye(nu + self.dynamics[0].shape[1]), [nx, nx + nu])
        of = dict(zip(*(found.tolist() for found in ties(problem.control_labels)),
                      strict=True))  # fmt: skip
        for k in range(problem.intervals):
            used = u.copy()
            for j in [j for j in range(nu) if k * nu + j in of]:
                at, i = divmod(of[k * nu + j], nu)
                used[j] = used[i] if at == k else v[i]
                self.held_controls[k, j] = True
            T = np.vstack([x, used])
            self.hessian[k] = T.T @ self.hessian[k] @ T
            self.dynamics[k] = np.vstack([self.dynamics[k] @ T, used[:nu]])
            self.active[k] = self.active[k] @ T
        self.held_states = np.pad(self.held_states, ((0, 0), (0, nu)))
        H, active = self.ends[0]
        self.ends[0] = (
            np.pad(H, (0, nu)), np.pad(active, ((0, 0), (0, nu)))
        )  # fmt: skip


def _without_inner(H: Array, J: Array, nx: int, count: int) -> tuple[Array, Array]:
    """Return Hessian and Jacobian without the collocation unknowns and rows.

    The collocation rows, which follow those of the states, determine these unknowns,
    which come last.
    """
    if not count:
        return H, J
    rows = J[nx : nx + count]
    # Least squares, since the rows may be singular at this point.
    follow = -np.linalg.lstsq(rows[:, -count:], rows[:, :-count], rcond=None)[0]
    T = np.vstack([np.eye(H.shape[0] - count), follow])
    return T.T @ H @ T, np.delete(J, slice(nx, nx + count), axis=0) @ T


def _derivatives(
    part: Part, at: tuple[Array, Array, Array], lam: Array
) -> tuple[Array, Array]:
    """Return Hessians of the Lagrangian and Jacobians of g of a part at n places.

    Args:
        part: The part.
        at: Variables z, a column for each place, shared numbers, and signals.
        lam: Multipliers of its rows, shape (rows, n).

    Returns:
        Shapes (n, nz, nz) and (n, rows, nz).
    """
    n = lam.shape[1]
    upper, J = (
        np.array(found).reshape((found.shape[0], n, found.shape[1] // n)).swapaxes(0, 1)
        for found in (part.curvature(*at, 1.0, lam), part.slopes(*at)[3])
    )
    return upper + np.triu(upper, 1).swapaxes(1, 2), J


def rooms(point: NlpPoint) -> tuple[Array, Array]:
    """Return the distances of rows and variables to their limits.

    A limit counts as active if its multiplier is larger than this distance. For
    equalities, which are always active, a negative number is returned.

    Returns:
        Distance of each row, shape (ng,), and of each variable, shape (nw,).
    """
    limits = point.limits
    g = np.array(point.program.derivatives["jac_g"](point.w, point.q)[0]).ravel()
    rows, bounds = (
        # Less than any multiplier: equalities are always active.
        np.where(lower == upper, -1.0, _room(lam, value, lower, upper))
        for lam, value, lower, upper in (
            (point.lam_g, g, limits.lbg, limits.ubg),
            (point.lam_x, point.w, limits.lbx, limits.ubx),
        )
    )
    return rows, bounds


def _room(lam: Array, value: Array, lower: Array, upper: Array) -> Array:
    """Return the distances of values from the limits on their multipliers' sides."""
    with np.errstate(invalid="ignore"):
        return np.abs(np.where(lam > 0, upper - value, value - lower))


def _outer(rows: Array) -> Array:
    """Return the sum of r'r over the rows, each scaled to length one."""
    if not rows.size:
        return np.zeros((rows.shape[1], rows.shape[1]))
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = rows / np.where(length > 0, length, 1.0)
    return np.asarray(unit.T @ unit)
