"""Derivatives of an NLP, assembled from those of one interval.

Interval k of a transcription (transcription.py) has the variables z = (x_k, u_k),
state and controls, and the rows g_k = (x after, collocation rows, constraint rows) -
(x_k+1, 0, 0). One function evaluates gradient, Jacobian and Hessian of all intervals
(interval_kernels.py), and the values are put in their places in the NLP. So the build
time does not grow with the number of intervals.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.nlp.collocation import inner_unknowns
from swarmstart.ocp.nlp.interval_kernels import over_intervals
from swarmstart.ocp.statement.control_shape import ties
from swarmstart.ocp.statement.problem import OptimalControlProblem

Index = NDArray[np.int64]
_JACOBIAN = 3
"""Number of an output of `Part.slopes`."""


class LimitedRows(NamedTuple):
    """Rows with limits, and their origin.

    Attributes:
        values: Expressions of the rows, shape (m, 1).
        lower: Lower limits, shape (m,).
        upper: Upper limits, shape (m,).
        places: For each row: number of its constraint among path and terminal
            constraints, and its row there.
        at: For each row: number, from 1, of the check at whose end it holds; 0: at the
            start of the interval; number of checks plus 1: after the jump at its end.
    """

    values: ca.SX
    lower: Array
    upper: Array
    places: list[tuple[int, int]]
    at: list[int]


class Part(NamedTuple):
    """A part of the NLP (an interval, the end or the start) with its derivatives.

    The derivatives are with respect to the variables z of the part. `shared` are
    arguments that all parts have in common, s are signals.

    Attributes:
        values: Function (z, shared, s) -> (cost, g).
        slopes: Function (z, shared, s) -> (cost, its gradient, g, its Jacobian).
        curvature: Function (z, shared, s, lam_f, lam_g) -> upper triangle of the
            Hessian of lam_f cost + lam_g' g.
        rows: The rows with limits, which come last in g.
    """

    values: ca.Function
    slopes: ca.Function
    curvature: ca.Function
    rows: LimitedRows

    @property
    def height(self) -> int:
        """Number of rows of g."""
        return int(self.values.numel_out(1))


class Parts(NamedTuple):
    """The parts of an NLP.

    Attributes:
        interval: One interval, z = (x, u).
        end: The end of the horizon, z = x.
        begin: The start, z = x, if the start of any state is decided; else None.
    """

    interval: Part
    end: Part
    begin: Part | None

    @property
    def present(self) -> tuple[Part, ...]:
        """All existing parts."""
        several = (self.interval, self.end)
        return several if self.begin is None else (*several, self.begin)

    def argument_sizes(self, problem: OptimalControlProblem) -> list[int]:
        """Return the lengths of the pieces of the NLP's arguments q.

        These are x0, the numbers shared by all parts, the weights of each part's rows,
        and the signals.
        """
        weights = [len(part.rows.places) for part in self.present]
        shared = self.interval.values.numel_in(1) - weights[0]
        return [problem.model.nx, shared, *weights, problem.ns * problem.nodes]


def inputs_of(problem: OptimalControlProblem) -> int:
    """Return the number of variables of an interval besides its state.

    These are the controls, the excess of each row of a soft constraint, and the
    collocation unknowns.
    """
    return int(problem.model.nu) + problem.slacks + inner_unknowns(problem)


class Mapped:
    """Symbols of the NLP, and the functions of its parts applied to them."""

    def __init__(
        self, problem: OptimalControlProblem, parts: Parts, *, compiled: bool = False
    ) -> None:
        """Create the symbols, and arrange them as arguments side by side.

        Args:
            problem: The problem.
            parts: Parts of its NLP.
            compiled: Whether the intervals are evaluated by machine code if possible.
        """
        self._compiled, self.kernels = compiled, list[ca.Function]()
        model, N, checks = problem.model, problem.intervals, problem.checks
        self.nx, self.nu, self.N, self.parts = model.nx, inputs_of(problem), N, parts
        empty = np.empty(0, dtype=np.intp)
        tied = ties(problem.control_labels) if problem.ties_controls else (empty, empty)
        self.same = (tied[0], tied[1])
        self.controls = model.nu
        self.rows = parts.interval.height
        self.free = decided_states(problem)
        inner = (self.nu + model.nx) * N
        self.w = ca.MX.sym("w", inner + len(self.free))
        sizes = parts.argument_sizes(problem)
        self.q = ca.MX.sym("q", sum(sizes))
        x0, known, *weights, flat = ca.vertsplit(
            self.q, [0, *np.cumsum(sizes).tolist()]
        )
        both = ca.reshape(self.w[:inner], self.nu + model.nx, N)
        self.x = both[self.nu :, :]
        place = {i: inner + j for j, i in enumerate(self.free)}
        start = ca.vertcat(
            *[self.w[place[i]] if i in place else x0[i] for i in range(model.nx)]
        )
        z = ca.vertcat(ca.horzcat(start, self.x[:, :-1]), both[: self.nu, :])
        signals = ca.reshape(flat, problem.ns, problem.nodes)
        # The node between two intervals belongs to both.
        columns = [k * checks + c for k in range(N) for c in range(checks + 1)]
        places = [
            (z, signals[:, columns]),
            (self.x[:, -1], signals[:, -1]),
            (start, signals[:, 0]),
        ]
        self._arguments = [
            [at, ca.vertcat(known, rows), s]
            # The start may have no part.
            for (at, s), rows in zip(places, weights, strict=False)
        ]

    def applied(
        self,
        chosen: Callable[[Part], ca.Function],
        more: Sequence[tuple[ca.MX, ...]] = ((), (), ()),
        *,
        same: tuple[int, ...] = (1,),
        apart: Sequence[Sequence[int]] = ((0,),),
    ) -> list[list[ca.MX]]:
        """Return the outputs of all intervals (side by side), of the end, of the start.

        Args:
            chosen: Function from a `Part` to the one of its functions that is applied.
            more: Further arguments of each part; those of the intervals side by side.
            same: Indices of the arguments that are the same for all intervals.
            apart: Numbers of the outputs, in groups that are not needed together.
        """
        interval, *ends = [[chosen(part)] for part in self.parts.present]
        interval = over_intervals(
            interval[0], self.N, same, apart=apart, compiled=self._compiled
        )
        self.kernels += interval
        return [
            [
                output
                for function in functions
                for output in _several(function(*arguments, *besides))
            ]
            for functions, arguments, besides in zip(
                [interval, *ends], self._arguments, more, strict=False
            )
        ]

    def rows_of(self, g: Sequence[ca.MX]) -> ca.MX:
        """Return the g of the NLP: defects and rows; a row that is always 0 is kept."""
        reached = ca.vertcat(self.x, ca.MX.zeros(self.rows - self.nx, self.N))
        first, second = self.ties()
        ties = [self.w[first.tolist()] - self.w[second.tolist()]] if first.size else []
        return ca.densify(ca.vertcat(ca.vec(g[0] - reached), *g[1:], *ties))

    def ties(self) -> tuple[Index, Index]:
        """Return the indices in w of tied controls, and of those that they must equal.

        w are the variables of the NLP.
        """
        step = self.nu + self.nx
        now, before = (
            # From ca.vec of u to w.
            (places // self.controls) * step + places % self.controls
            if places.size
            else places
            for places in self.same
        )
        return now, before

    def place(self, k: int) -> list[int]:
        """Return the indices in w, the NLP's variables, of an interval's z = (x, u).

        A state whose start is given is no variable; its index is -1.
        """
        step = self.nu + self.nx
        if k == 0:
            place = {i: self.N * step + j for j, i in enumerate(self.free)}
            x = [place.get(i, -1) for i in range(self.nx)]
        else:
            x = list(range((k - 1) * step + self.nu, k * step))
        return x + list(range(k * step, k * step + self.nu))

    def places(self) -> list[Index]:
        """Return the indices in w of each interval's z."""
        return [np.array(self.place(k)) for k in range(self.N)]

    def ends(self) -> list[tuple[Part, Index]]:
        """Return the parts except the interval, with the indices in w of their z."""
        places = [np.array(self.place(k)[: self.nx]) for k in (self.N, 0)]
        return list(zip(self.parts.present[1:], places, strict=False))


def _several(found: ca.MX | tuple[ca.MX, ...] | list[ca.MX]) -> list[ca.MX]:
    return [found] if isinstance(found, ca.MX) else list(found)


def decided_states(problem: OptimalControlProblem) -> list[int]:
    """Return the numbers of the states whose start is decided, one variable each."""
    return [i for one in problem.nlp_starts for i in one.states]


def derivatives_of(mapped: Mapped) -> dict[str, ca.Function]:
    """Return gradient, Jacobian and Hessian of the NLP, as IPOPT takes them."""
    costs, slopes, values, jacobians = zip(
        *mapped.applied(lambda part: part.slopes, apart=((0, 1), (2, 3))), strict=True
    )
    w, q = mapped.w, mapped.q
    f = sum(costs[1:], ca.sum2(costs[0]))
    rows = mapped.rows_of(values)
    gradient = _gradient(mapped, slopes)
    jacobian = _jacobian(mapped, jacobians, rows.numel())
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows.numel())
    hessian = _hessian(mapped, (lam_f, lam_g))
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


def _gradient(mapped: Mapped, slopes: Sequence[ca.MX]) -> ca.MX:
    """Return the gradient of the cost from those of the parts."""
    places = [*mapped.places(), *[place for _, place in mapped.ends()]]
    entries = [(place, np.zeros_like(place)) for place in places]
    values = ca.vertcat(*[ca.vec(ca.densify(slope)) for slope in slopes])
    return _assembled((mapped.w.numel(), 1), entries, values)


def _jacobian(mapped: Mapped, blocks: Sequence[ca.MX], size: int) -> ca.MX:
    """Return the Jacobian of all rows, including the -1 of each next state."""
    N, nx, places, parts = mapped.N, mapped.nx, mapped.places(), mapped.parts.present
    rows, columns = _triplet(parts[0].slopes, _JACOBIAN)
    following = [np.array(mapped.place(k + 1)[:nx]) for k in range(N)]
    entries = [(rows + k * mapped.rows, places[k][columns]) for k in range(N)]
    above = N * mapped.rows
    for part, place in mapped.ends():
        end_rows, end_columns = _triplet(part.slopes, _JACOBIAN)
        entries.append((end_rows + above, place[end_columns]))
        above += part.height
    entries += [(np.arange(nx) + k * mapped.rows, following[k]) for k in range(N)]
    ties = mapped.ties()
    count = ties[0].size
    entries += [(above + np.arange(count), tie) for tie in ties]
    values = ca.vertcat(
        *[
            _nonzeros(part.slopes.sparsity_out(_JACOBIAN), block, count)
            for part, block, count in zip(parts, blocks, (N, 1, 1), strict=False)
        ],
        -ca.MX.ones(nx * N),
        ca.MX.ones(count),
        -ca.MX.ones(count),
    )
    return _assembled((size, mapped.w.numel()), entries, values)


def _hessian(mapped: Mapped, multipliers: tuple[ca.MX, ca.MX]) -> ca.MX:
    """Return the upper triangle of the Hessian of lam_f f + lam_g' g."""
    N, places, parts = mapped.N, mapped.places(), mapped.parts.present
    lam_f, lam_g = multipliers
    inside = N * mapped.rows
    last = inside + parts[1].height
    begin = sum(part.height for part in parts[2:])
    curved = mapped.applied(
        lambda part: part.curvature,
        (
            (lam_f, ca.reshape(lam_g[:inside], mapped.rows, N)),
            (lam_f, lam_g[inside:last]),
            (lam_f, lam_g[last : last + begin]),
        ),
        same=(1, 3),
    )
    rows, columns = _triplet(parts[0].curvature, 0)
    entries = [_upper(place[rows], place[columns]) for place in places]
    for part, place in mapped.ends():
        end_rows, end_columns = _triplet(part.curvature, 0)
        entries.append(_upper(place[end_rows], place[end_columns]))
    values = ca.vertcat(*[
        _nonzeros(part.curvature.sparsity_out(0), block[0], count)
        for part, block, count in zip(parts, curved, (N, 1, 1), strict=False)
    ])  # fmt: skip
    size = mapped.w.numel()
    return _assembled((size, size), entries, values)


def _upper(rows: Index, columns: Index) -> tuple[Index, Index]:
    """Return places mirrored to the upper triangle; -1 is kept."""
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
    if blocks.sparsity() != expected:  # The places were computed for this pattern.
        blocks = ca.project(blocks, expected)
    return ca.vec(blocks.nz[:]) if blocks.nnz() else ca.MX(0, 1)


def _assembled(
    shape: tuple[int, int], entries: list[tuple[Index, Index]], values: ca.MX
) -> ca.MX:
    """Return a sparse matrix of the sums of values at (row, column).

    Values at -1 are left out.
    """
    rows, columns = (np.concatenate(v) for v in zip(*entries, strict=True))
    kept = np.flatnonzero((rows >= 0) & (columns >= 0))
    # Column by column, as CasADi stores a matrix.
    order = kept[np.lexsort((rows[kept], columns[kept]))]
    if not order.size:
        return ca.MX(ca.Sparsity.triplet(*shape, [], []))
    rows, columns = rows[order], columns[order]
    # After the sort, the entries of one place follow one another.
    new = np.r_[True, (np.diff(rows) != 0) | (np.diff(columns) != 0)]
    sparsity = ca.Sparsity.triplet(*shape, rows[new].tolist(), columns[new].tolist())
    found = ca.vec(values[order.tolist()])
    if not new.all():
        into = (np.cumsum(new) - 1).tolist()
        ones = ca.Sparsity.triplet(
            int(new.sum()), order.size, into, [*range(order.size)]
        )
        # A sparse matrix of ones adds up the entries of each place.
        found = ca.mtimes(ca.DM(ones, 1.0), found)
    return ca.MX(sparsity, found)
