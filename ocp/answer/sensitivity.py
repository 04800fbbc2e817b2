"""Derivatives of an answer by the initial state and the parameters, to first order.

At a strict minimum of the NLP whose active limits do not change, the first-order
conditions are equations in the variables w and the multipliers, and the data q of the
NLP (transcription.py) are their parameters:

    [W  A'] [dw  ]     [d(grad f + A' lam)/dq]
    [A  0 ] [dlam]  = -[d(active rows)/dq    ] dq

W is the Hessian of the Lagrangian, A the Jacobian of the active rows. Variables at a
bound stay there. The derivative of the cost is that of the Lagrangian. Derivatives by q
are central differences of exact derivatives, so their relative error is some 1e-9, to
which the error of the answer is added.

Source: Fiacco (1976), Sensitivity analysis for nonlinear programming using penalty
methods, Mathematical Programming 10; Nocedal and Wright (2006), section 16.2.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Literal, NamedTuple, Self, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.nlp.nlp_assembly import decided_states, inputs_of
from swarmstart.ocp.nlp.optimality import (
    Curvature,
    NlpPoint,
    curvature,
    is_stationary,
    rooms,
)
from swarmstart.ocp.statement.rewrites.chain import Lowered

if TYPE_CHECKING:
    from scipy import sparse

Data = Literal["x0", "parameters"]
DATA: tuple[Data, ...] = get_args(Data)
NOT_CONVERGED = "expected an answer to which an NLP solver has converged, found none"
_STEP = np.finfo(np.float64).eps ** (1 / 3)
"""Relative step of central differences."""
_CLEAR = 1e3
"""Ratio of multiplier and distance, or of distance and multiplier, from which a limit
is clearly active or free. Multipliers are relative to the slope of the cost."""
_NEAR = 1e-2
"""Distance, or multiplier, from which it is clear, too."""
_RESIDUAL = 1e-6
"""Largest residual of the linear equations, relative to their right side."""


class NoSensitivityError(SwarmstartError):
    """An answer without derivatives; the message says why."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sensitivity:
    """Derivatives of an answer by n data, each in the units of the problem.

    Attributes:
        data: Names of the data: states at the start, then parameters, as asked.
        cost: Derivatives of the cost, shape (n,).
        controls: Derivatives of the controls (or their knots), shape (nu, N, n).
        states: Derivatives of the states at the ends of the intervals, shape (nx, N +
            1, n).
        decided: Derivatives of the decided parameters and a free end time ("end time"),
            by name, each of shape (n,).
        unclear: Number of limits that are neither clearly active nor clearly free. If
            there are any, the derivatives hold on one side only.
    """

    data: tuple[str, ...]
    cost: Array
    controls: Array
    states: Array
    decided: Mapping[str, Array]
    unclear: int

    def __repr__(self) -> str:
        """Return the derivatives of the cost, and the number of unclear limits."""
        slopes = ", ".join(
            f"{name} {value:.4g}"
            for name, value in zip(self.data, self.cost, strict=True)
        )
        doubt = f"; {self.unclear} limit(s) may change at once" if self.unclear else ""
        return f"Sensitivity: derivatives of the cost: {slopes}{doubt}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sensitivities:
    """Derivatives of M answers by n data, each in the units of the problem.

    They are NaN for an instance without an answer, or whose answer has no derivatives.

    Attributes:
        data: As in `Sensitivity`.
        cost: Derivatives of the costs, shape (n, M).
        controls: Derivatives of the controls (or their knots), shape (nu, N, n, M).
        states: Derivatives of the states at the ends of the intervals, shape (nx, N +
            1, n, M).
        decided: Derivatives of the decided parameters and a free end time, by name,
            each of shape (n, M).
        unclear: Number of limits of each instance that are neither clearly active nor
            clearly free, shape (M,). If there are any, its derivatives hold on one side
            only.
        reasons: Reason why an instance has no derivatives, by its number.
    """

    data: tuple[str, ...]
    cost: Array
    controls: Array
    states: Array
    decided: Mapping[str, Array]
    unclear: NDArray[np.int64]
    reasons: Mapping[int, str]

    @classmethod
    def of(
        cls,
        found: Mapping[int, Sensitivity],
        reasons: Mapping[int, str],
        core: Lowered,
        by: Sequence[Data],
    ) -> Self:
        """Return the derivatives of M answers.

        Args:
            found: Number of an instance -> the derivatives of its answer.
            reasons: Number of each other instance -> why it has no derivatives.
            core: The problem as stated and as rewritten (core).
            by: "x0" or "parameters", as in `Solution.sensitivity`.
        """
        stated, names, M = core.stated, data_names(core, by), len({*found, *reasons})
        nx, nu, N, n = stated.model.nx, stated.model.nu, stated.intervals, len(names)
        inputs = N + int(stated.has_knots)
        every = cls(
            data=names,
            cost=np.full((n, M), np.nan),
            controls=np.full((nu, inputs, n, M), np.nan),
            states=np.full((nx, N + 1, n, M), np.nan),
            decided={
                name: np.full((n, M), np.nan)
                for name in core.decided(np.zeros(core.core.model.nx))
            },
            unclear=np.zeros(M, dtype=np.int64),
            reasons=dict(reasons),
        )
        for i, one in found.items():
            every.cost[:, i], every.controls[..., i] = one.cost, one.controls
            every.states[..., i], every.unclear[i] = one.states, one.unclear
            for name, values in one.decided.items():
                every.decided[name][:, i] = values
        return every

    def __repr__(self) -> str:
        """Return the data, and how many instances have unclear or no derivatives."""
        return (
            f"Sensitivities of {self.unclear.size} instances by "
            f"{', '.join(self.data) or 'no data'}: {len(self.reasons)} without "
            f"derivatives, {np.count_nonzero(self.unclear)} with limits that may "
            "change at once"
        )


def require_data(core: Lowered) -> None:
    """Raise unless an answer to the problem can be differentiated by its data.

    Args:
        core: The problem as stated and as rewritten (core).

    Raises:
        NoSensitivityError: If the problem is an ensemble.
    """
    if core.stated.risk is not None:
        raise NoSensitivityError("expected a problem without members, found a risk")


def sensitivity_of(
    point: NlpPoint | None, core: Lowered, controls: Array, by: Sequence[Data]
) -> Sensitivity:
    """Return the derivatives of an answer.

    Args:
        point: The answer as a point of the NLP; None if no NLP solver converged to it.
        core: The problem as stated and as rewritten (core).
        controls: Controls of the rewritten problem (core), shape (nu, N).
        by: "x0" or "parameters", as in `Solution.sensitivity`.

    Raises:
        NoSensitivityError: If there is no point, or it is no strict minimum whose
            active limits are independent.
    """
    if point is None or not is_stationary(point):
        raise NoSensitivityError(NOT_CONVERGED)
    (found,) = sensitivities_of([point], core, [controls], by)
    if isinstance(found, NoSensitivityError):
        raise found
    return found


def sensitivities_of(
    points: Sequence[NlpPoint],
    core: Lowered,
    controls: Sequence[Array],
    by: Sequence[Data],
) -> list[Sensitivity | NoSensitivityError]:
    """Return the derivatives of answers, or the errors that say why there are none.

    Args:
        points: The answers as stationary points of one or several NLPs.
        core: The problem as stated and as rewritten (core).
        controls: Controls of each answer, in the rewritten problem (core), each of
            shape (nu, N).
        by: "x0" or "parameters", as in `Solution.sensitivity`.

    Raises:
        NoSensitivityError: As `require_data`.
    """
    require_data(core)
    found = list[Sensitivity | NoSensitivityError]()
    along = [_along(point, core, by) for point in points]
    for system, u, dq in zip(_systems(points, along), controls, along, strict=True):
        try:
            found.append(_derived(system, core, u, dq, by))
        except NoSensitivityError as error:
            found.append(error)
    return found


def _derived(
    system: "_System", core: Lowered, controls: Array, dq: Array, by: Sequence[Data]
) -> Sensitivity:
    """Return the derivatives of one answer in the units of the problem."""
    point = system.point
    bent = curvature(point)
    if bent is not Curvature.POSITIVE:
        raise NoSensitivityError(f"expected a strict minimum, found {bent.value}")
    dw, unclear = _solved(system)
    u, x = _in_units(point, dw, dq)
    start, nx = point.ends[:, 0] * point.state_sizes, core.stated.model.nx
    here = core.knots(controls, start)
    moved = np.empty((*here.shape, dq.shape[1]))
    for n in range(dq.shape[1]):
        moved[..., n] = core.knots(controls + u[..., n], start + x[:, 0, n]) - here
    # Decisions are linear in the start.
    ends = [core.decided(one) for one in x[:, 0].T]
    return Sensitivity(
        data=data_names(core, by),
        cost=core.stated.sense * point.cost_size * system.rates[0][0],
        controls=moved,
        states=x[:nx],
        decided={
            name: np.array([one[name] for one in ends]) for name in core.decided(start)
        },
        unclear=unclear,
    )


def _in_units(point: NlpPoint, dw: Array, dq: Array) -> tuple[Array, Array]:
    """Return changes of the core's controls (nu, N, n) and states (nx, N + 1, n)."""
    problem = point.program.problem
    nu, N, n = problem.model.nu, problem.intervals, dq.shape[1]
    inputs, decided = inputs_of(problem), decided_states(problem)
    rows = inputs + problem.model.nx
    inside = dw[: rows * N].reshape((rows, N, n), order="F")
    start = dq[: problem.model.nx].copy()
    start[decided] = dw[rows * N :]
    states = np.concatenate([start[:, None], inside[inputs:]], axis=1)
    return (
        inside[:nu] * point.control_sizes[:, None, None],
        states * point.state_sizes[:, None, None],
    )


def data_names(core: Lowered, by: Sequence[Data]) -> tuple[str, ...]:
    """Return the names of the data of a problem.

    Args:
        core: The problem as stated and as rewritten (core).
        by: "x0" or "parameters", as in `Solution.sensitivity`.
    """
    return tuple(name for name, _ in _places(core, by))


def _places(core: Lowered, by: Sequence[Data]) -> list[tuple[str, int]]:
    """Return each datum's name and place: a state's, or nx + a known parameter's."""
    found, nx = list[tuple[str, int]](), core.core.model.nx
    if "x0" in by:
        decided = {i for one in core.core.free_starts for i in one.states}
        names = core.stated.model.state_names
        found += [(name, i) for i, name in enumerate(names) if i not in decided]
    if "parameters" in by:
        every = symbol_names(core.stated.model.parameters)
        # They come first in the core; the time at the start follows.
        found += [(every[j], nx + i) for i, j in enumerate(core.known_parameters)]
    return found


def _along(point: NlpPoint, core: Lowered, by: Sequence[Data]) -> Array:
    """Return the change of q with each datum, shape (nq, n)."""
    problem, places = point.program.problem, _places(core, by)
    nx, zero = problem.model.nx, np.zeros(core.stated.model.nx)
    decided = [i for one in problem.free_starts for i in one.states]
    before, found = core.start(zero), np.zeros((point.q.size, len(places)))
    for dq, (_, place) in zip(found.T, places, strict=True):
        if place >= nx:
            dq[place] = 1.0
            continue
        zero[place] = 1.0
        dq[:nx] = (core.start(zero) - before) / point.state_sizes
        dq[decided] = 0.0
        zero[place] = 0.0
    return found


class _System(NamedTuple):
    """The linear equations at a point; see the head of the module.

    Attributes:
        point: The point.
        W: Upper triangle of the Lagrangian's Hessian, shape (nw, nw).
        A: Jacobian of all rows, shape (ng, nw).
        rates: Derivatives by n data of the Lagrangian, shape (1, n), its gradient by w,
            (nw, n), and the rows, (ng, n), with w and the multipliers fixed.
    """

    point: NlpPoint
    W: "sparse.coo_matrix"
    A: "sparse.coo_matrix"
    rates: list[Array]


def _systems(points: Sequence[NlpPoint], along: Sequence[Array]) -> Iterator[_System]:
    """Yield the equations at points; functions are called once for those of one NLP."""
    pairs = zip(points, along, strict=True)
    for _, some in groupby(pairs, key=lambda pair: id(pair[0].program)):
        own, changes = zip(*some, strict=True)
        derivatives = own[0].program.derivatives
        w, q, lam = _columns(own, 1)
        yield from map(
            _System,
            own,
            _matrices(derivatives["hess_lag"], 0, (w, q, 1.0, lam)),
            _matrices(derivatives["jac_g"], 1, (w, q)),
            _rates(own, changes),
        )


def _columns(points: Sequence[NlpPoint], n: int) -> tuple[Array, Array, Array]:
    """Return w, q and multipliers of points, each in n columns."""
    w, q, lam = (
        np.repeat(np.column_stack([getattr(one, name) for one in points]), n, axis=1)
        for name in ("w", "q", "lam_g")
    )
    return w, q, lam


def _matrices(
    function: ca.Function, output: int, arguments: tuple[Array | float, ...]
) -> Iterator["sparse.coo_matrix"]:
    """Yield a sparse output of a function for each column of its arguments."""
    from scipy import sparse  # Takes as long to import as CasADi and NumPy.

    pattern, found = function.sparsity_out(output), function.call(arguments)[output]
    places = tuple(np.array(one, dtype=np.int32) for one in pattern.get_triplet())
    count = found.shape[1] // pattern.shape[1]
    for values in np.array(found.nz[:]).reshape((count, pattern.nnz())):
        yield sparse.coo_matrix((values, places), shape=pattern.shape)


def _rates(points: Sequence[NlpPoint], along: Sequence[Array]) -> Iterator[list[Array]]:
    """Yield the derivatives at each point, as central differences of exact ones."""
    n = along[0].shape[1]
    steps = [_steps(point, dq) for point, dq in zip(points, along, strict=True)]
    change = np.hstack([step * dq for step, dq in zip(steps, along, strict=True)])
    w, q, lam = _columns(points, n)
    ahead, behind = (
        # CasADi would take no columns for zeros.
        [np.array(value)[:, : w.shape[1]] for value in points[0].program.lagrangian(
            w, q + sign * change, lam
        )]
        for sign in (1, -1)
    )  # fmt: skip
    for i, step in enumerate(steps):
        own = slice(i * n, (i + 1) * n)
        # If nothing depends on a datum, both are the same.
        double = 2 * np.where(step > 0, step, 1.0)
        yield [
            (a[:, own] - b[:, own]) / double for a, b in zip(ahead, behind, strict=True)
        ]


def _steps(point: NlpPoint, along: Array) -> Array:
    """Return the steps of central differences, shape (n,); 0: nothing changes."""
    nx = point.program.problem.model.nx
    sizes, change = np.abs(point.q), np.abs(along)
    # States are divided by their sizes; a parameter's size is only known from itself.
    is_small = sizes < 1.0
    is_small[nx:] = sizes[nx:] == 0.0
    sizes[is_small] = 1.0
    with np.errstate(divide="ignore"):
        found = _STEP * (sizes[:, None] / change).min(axis=0, initial=np.inf)
    return np.where(np.isfinite(found), found, 0.0)


def _solved(system: _System) -> tuple[Array, int]:
    """Return the changes of w, shape (nw, n), and the number of unclear limits.

    Variables that are held and rows that are not active have equations of their own,
    dw = 0 and dlam = 0.

    Raises:
        NoSensitivityError: If the linear equations have no unique solution.
    """
    from scipy import sparse  # Takes as long to import as CasADi and NumPy.
    from scipy.sparse.linalg import splu

    point, W, A, (_, slope, rows) = system
    # A solver leaves small multipliers at limits that are near, but not active: a steep
    # cost has larger ones.
    gradient = np.array(point.program.derivatives["grad_f"](point.w, point.q)[1])
    steepest = np.abs(gradient).max(initial=1.0)
    pulls = np.abs(point.lam_g) / steepest, np.abs(point.lam_x) / steepest
    of_rows, of_bounds = rooms(point)
    active, free = pulls[0] > of_rows, pulls[1] <= of_bounds
    nw, alone = point.w.size, np.flatnonzero(~np.concatenate([free, active]))
    upper = W.row < W.col
    kept_W, kept_A = free[W.row] & free[W.col], active[A.row] & free[A.col]
    entries = [
        (W, kept_W, W.row, W.col),
        (W, kept_W & upper, W.col, W.row),
        (A, kept_A, A.row + nw, A.col),
        (A, kept_A, A.col, A.row + nw),
    ]
    values, *places = (
        np.concatenate([own, *parts])
        for own, parts in (
            (np.ones(alone.size), [one.data[kept] for one, kept, *_ in entries]),
            (alone, [row[kept] for _, kept, row, _ in entries]),
            (alone, [column[kept] for _, kept, _, column in entries]),
        )
    )
    matrix = sparse.csc_matrix((values, places), shape=(nw + active.size,) * 2)
    right = -np.vstack([slope, rows])
    right[alone] = 0.0
    try:
        found = splu(matrix).solve(right)
    except RuntimeError:  # Exactly singular.
        found = np.full_like(right, np.nan)
    off = np.abs(matrix @ found - right).max(initial=0.0)
    if not off <= _RESIDUAL * max(1.0, np.abs(right).max(initial=0.0)):
        raise NoSensitivityError(
            "expected active limits that are independent of each other; they are not, "
            "so that the multipliers are not unique"
        )
    return found[:nw], _unclear(point, pulls, (of_rows, of_bounds))


def _unclear(
    point: NlpPoint, pulls: tuple[Array, Array], room: tuple[Array, Array]
) -> int:
    """Return the number of limits that are neither clearly active nor clearly free."""
    limits, count = point.limits, 0
    sides = (limits.lbg, limits.ubg), (limits.lbx, limits.ubx)
    for (lower, upper), pull, far in zip(sides, pulls, room, strict=True):
        less, more = np.minimum(pull, far), np.maximum(pull, far)
        unclear = (more < _NEAR) & (more <= _CLEAR * less) & (lower < upper)
        count += int(unclear.sum())
    return count
