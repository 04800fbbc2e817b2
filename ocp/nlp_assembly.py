"""The derivatives of an NLP put together from those of one interval.

Interval k of a transcription (transcription.py) has the variables z = (x_k, u_k) and
the rows g_k = (x after, constraint rows) - (x_k+1, 0): its gradient, Jacobian and
Hessian are evaluated by one mapped function and their numbers put in their places, so
that the time to build them does not grow with the number of intervals.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.problem import OptimalControlProblem

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class LimitedRows(NamedTuple):
    """Rows with limits and where they come from.

    Attributes:
        values: Shape (m, 1).
        lower: Shape (m,).
        upper: Shape (m,).
        places: Of each row: number of its constraint among path and terminal
            constraints, and its row there.
    """

    values: ca.SX
    lower: Array
    upper: Array
    places: list[tuple[int, int]]


class Part(NamedTuple):
    """A part of the NLP with its derivatives by its own variables z.

    Attributes:
        cost: (z, shared, s) -> cost.
        value: (z, shared, s) -> g.
        cost_slope: (z, shared, s) -> (cost, its gradient).
        slopes: (z, shared, s) -> (g, its Jacobian).
        curvature: (z, shared, s, lam_f, lam_g) -> upper triangle of the Hessian of
            lam_f cost + lam_g' g.
        rows: The rows with limits among g, the last ones.
    """

    cost: ca.Function
    value: ca.Function
    cost_slope: ca.Function
    slopes: ca.Function
    curvature: ca.Function
    rows: LimitedRows


def argument_sizes(
    problem: OptimalControlProblem, interval: Part, end: Part
) -> list[int]:
    """Return the lengths of x0, shared, both parts' weights and signals in q."""
    weights = [len(part.rows.places) for part in (interval, end)]
    shared = interval.value.numel_in(1) - weights[0]
    return [problem.model.nx, shared, *weights, problem.ns * problem.nodes]


class Mapped:
    """Symbols of the NLP, and the functions of its parts applied to them."""

    def __init__(
        self, problem: OptimalControlProblem, interval: Part, end: Part
    ) -> None:
        """Make the symbols, and shape them into arguments side by side.

        Args:
            problem: The problem.
            interval: One interval.
            end: The end of the horizon.
        """
        model, N, checks = problem.model, problem.intervals, problem.checks
        self.nx, self.nu, self.N = model.nx, model.nu, N
        self.rows = interval.value.numel_out(0)
        self.w = ca.MX.sym("w", (model.nu + model.nx) * N)
        sizes = argument_sizes(problem, interval, end)
        self.q = ca.MX.sym("q", sum(sizes))
        x0, known, inside, at_end, flat = ca.vertsplit(
            self.q, [0, *np.cumsum(sizes).tolist()]
        )
        both = ca.reshape(self.w, model.nu + model.nx, N)
        self.x = both[model.nu :, :]
        z = ca.vertcat(ca.horzcat(x0, self.x[:, :-1]), both[: model.nu, :])
        signals = ca.reshape(flat, problem.ns, problem.nodes)
        columns = [k * checks + c for k in range(N) for c in range(checks + 1)]
        self._stage = [z, ca.vertcat(known, inside), signals[:, columns]]
        self._end = [self.x[:, -1], ca.vertcat(known, at_end), signals[:, -1]]

    def applied(
        self,
        stage: ca.Function,
        end: ca.Function,
        stage_more: tuple[ca.MX, ...] = (),
        end_more: tuple[ca.MX, ...] = (),
        *,
        same: tuple[int, ...] = (1,),
    ) -> list[ca.MX]:
        """Return the outputs of all intervals, side by side, and of the end.

        Args:
            stage: A function of an interval.
            end: The same of the end.
            stage_more: Arguments besides, side by side.
            end_more: Arguments besides.
            same: Numbers of the arguments that are the same for all intervals.
        """
        mapped = stage.map(stage.name(), "serial", self.N, list(same), [])
        found = [mapped(*self._stage, *stage_more), end(*self._end, *end_more)]
        return [out for part in found for out in _several(part)]

    def rows_of(self, g: ca.MX, end_g: ca.MX) -> ca.MX:
        """Return the g of the NLP: defects and rows; one that is always 0 counts."""
        reached = ca.vertcat(self.x, ca.MX.zeros(self.rows - self.nx, self.N))
        return ca.densify(ca.vertcat(ca.vec(g - reached), end_g))

    def place(self, k: int) -> list[int]:
        """Return the numbers in w of an interval's z; -1 for the initial state."""
        step = self.nu + self.nx
        before = range((k - 1) * step + self.nu, k * step)
        x = [-1] * self.nx if k == 0 else list(before)
        return x + list(range(k * step, k * step + self.nu))

    def places(self) -> list[Index]:
        """Return the numbers in w of each interval's z."""
        return [np.array(self.place(k)) for k in range(self.N)]

    def last(self) -> Index:
        """Return the numbers in w of the state after the last interval."""
        return np.array(self.place(self.N)[: self.nx])


def _several(found: ca.MX | tuple[ca.MX, ...] | list[ca.MX]) -> list[ca.MX]:
    return [found] if isinstance(found, ca.MX) else list(found)


def derivatives_of(mapped: Mapped, interval: Part, end: Part) -> dict[str, ca.Function]:
    """Return gradient, Jacobian and Hessian of the NLP, as nlpsol's IPOPT takes them.

    Args:
        mapped: The NLP's symbols.
        interval: One interval.
        end: The end of the horizon.
    """
    cost, slope, end_cost, end_slope = mapped.applied(
        interval.cost_slope, end.cost_slope
    )
    g, jac, end_g, end_jac = mapped.applied(interval.slopes, end.slopes)
    w, q = mapped.w, mapped.q
    f, rows = ca.sum2(cost) + end_cost, mapped.rows_of(g, end_g)
    gradient = _gradient(mapped, slope, end_slope)
    jacobian = _jacobian(mapped, interval, end, (jac, end_jac), rows.numel())
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows.numel())
    hessian = _hessian(mapped, interval, end, (lam_f, lam_g))
    return {
        "grad_f": ca.Function(
            "nlp_grad_f", [w, q], [f, gradient], ["x", "p"], ["f", "grad_f_x"]
        ),
        "jac_g": ca.Function(
            "nlp_jac_g", [w, q], [rows, jacobian], ["x", "p"], ["g", "jac_g_x"]
        ),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [w, q, lam_f, lam_g],
            [hessian],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }


def _gradient(mapped: Mapped, slope: ca.MX, end_slope: ca.MX) -> ca.MX:
    """Return the gradient of the cost, from those of the intervals and the end."""
    places = [*mapped.places(), mapped.last()]
    entries = [(place, np.zeros_like(place)) for place in places]
    values = ca.vertcat(ca.vec(ca.densify(slope)), ca.densify(end_slope))
    return _assembled((mapped.w.numel(), 1), entries, values)


def _jacobian(
    mapped: Mapped, interval: Part, end: Part, blocks: tuple[ca.MX, ca.MX], size: int
) -> ca.MX:
    """Return the Jacobian of all rows; states are taken off the next ones' rows."""
    N, nx, places, last = mapped.N, mapped.nx, mapped.places(), mapped.last()
    rows, columns = _triplet(interval.slopes, 1)
    end_rows, end_columns = _triplet(end.slopes, 1)
    following = [np.array(mapped.place(k + 1)[:nx]) for k in range(N)]
    entries = [(rows + k * mapped.rows, places[k][columns]) for k in range(N)]
    entries.append((end_rows + N * mapped.rows, last[end_columns]))
    entries += [(np.arange(nx) + k * mapped.rows, following[k]) for k in range(N)]
    values = ca.vertcat(
        _nonzeros(interval.slopes.sparsity_out(1), blocks[0], N),
        _nonzeros(end.slopes.sparsity_out(1), blocks[1], 1),
        -ca.MX.ones(nx * N),
    )
    return _assembled((size, mapped.w.numel()), entries, values)


def _hessian(
    mapped: Mapped, interval: Part, end: Part, multipliers: tuple[ca.MX, ca.MX]
) -> ca.MX:
    """Return the upper triangle of the Hessian of lam_f f + lam_g' g."""
    N, places, last = mapped.N, mapped.places(), mapped.last()
    lam_f, lam_g = multipliers
    inside = N * mapped.rows
    curved, end_curved = mapped.applied(
        interval.curvature,
        end.curvature,
        (lam_f, ca.reshape(lam_g[:inside], mapped.rows, N)),
        (lam_f, lam_g[inside:]),
        same=(1, 3),
    )
    rows, columns = _triplet(interval.curvature, 0)
    end_rows, end_columns = _triplet(end.curvature, 0)
    entries = [_upper(place[rows], place[columns]) for place in places]
    entries.append(_upper(last[end_rows], last[end_columns]))
    values = ca.vertcat(
        _nonzeros(interval.curvature.sparsity_out(0), curved, N),
        _nonzeros(end.curvature.sparsity_out(0), end_curved, 1),
    )
    size = mapped.w.numel()
    return _assembled((size, size), entries, values)


def _upper(rows: Index, columns: Index) -> tuple[Index, Index]:
    """Return places in the upper triangle; -1 stays where it is."""
    outside = (rows < 0) | (columns < 0)
    first, second = np.minimum(rows, columns), np.maximum(rows, columns)
    return np.where(outside, -1, first), np.where(outside, -1, second)


def _triplet(function: ca.Function, output: int) -> tuple[Index, Index]:
    """Return rows and columns of an output's nonzeros, in CasADi's order."""
    rows, columns = function.sparsity_out(output).get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _nonzeros(sparsity: ca.Sparsity, blocks: ca.MX, count: int) -> ca.MX:
    """Return the nonzeros of blocks side by side as one column, block after block."""
    expected = ca.repmat(sparsity, 1, count)
    if blocks.sparsity() != expected:
        blocks = ca.project(blocks, expected)
    return ca.vec(blocks.nz[:]) if blocks.nnz() else ca.MX(0, 1)


def _assembled(
    shape: tuple[int, int], entries: list[tuple[Index, Index]], values: ca.MX
) -> ca.MX:
    """Return a sparse matrix of values at (row, column); those at -1 are left out.

    No place may be named twice.
    """
    rows, columns = (np.concatenate(v) for v in zip(*entries, strict=True))
    kept = np.flatnonzero((rows >= 0) & (columns >= 0))
    order = kept[np.lexsort((rows[kept], columns[kept]))]
    sparsity = ca.Sparsity.triplet(
        *shape, rows[order].tolist(), columns[order].tolist()
    )
    if not order.size:
        return ca.MX(sparsity)
    return ca.MX(sparsity, ca.vec(values[order.tolist()]))
