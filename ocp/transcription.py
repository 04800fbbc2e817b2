"""Direct multiple shooting: an optimal-control problem as a sparse NLP, without units.

    minimise  f(w, q)   subject to  lbg <= g(w, q) <= ubg,  lbw <= w <= ubw
    w = (u_0, x_1, u_1, x_2, ... u_N-1, x_N), each divided by its size
    g = (defects and constraint rows of interval 0, of interval 1, ..., terminal rows)
    q = (x0, shared, weights of an interval's and of the end's rows, ca.vec of signals)

The states after each interval are variables, tied by continuity (defects = 0). Path
constraints hold, in smooth form, at every check; rows that a control enters hold as an
interval begins, too. Terminal constraints hold at the end. A range or an equality is
one row with two limits.

The sizes (scaling.py) are arguments: a solver built once sees numbers near one,
whatever the units and the initial state. Derivatives are those of one interval
(nlp_parts.py), mapped and put in their places: the time to build them does not grow
with N.

Source: Bock and Plitt (1984), A multiple shooting algorithm for direct solution of
optimal control problems.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.nlp_parts import Part, end_part, interval_part
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.scaling import Sizes

Array = NDArray[np.float64]
Index = NDArray[np.int64]


_UNROLLED = 100_000
"""Operations of an NLP with its derivatives up to which it is written out, which makes
short horizons quicker to iterate; longer ones would take too long to build."""


class Limits(NamedTuple):
    """Bounds of an NLP's variables and constraints."""

    lbx: Array
    ubx: Array
    lbg: Array
    ubg: Array


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NonlinearProgram:
    """An NLP in the form CasADi's `nlpsol` takes; its numbers follow from sizes.

    Attributes:
        problem: The problem.
        nlp: The expressions "x", "p", "f", "g".
        derivatives: "grad_f", "jac_g" and "hess_lag", as nlpsol's IPOPT takes them.
        interval: One interval.
        end: The end of the horizon.
        unit: Of the cost, as `OptimalControlProblem.costs` gives it.
    """

    problem: OptimalControlProblem
    nlp: dict[str, Any]  # Of CasADi's MX or, written out, SX.
    derivatives: dict[str, ca.Function]
    interval: Part
    end: Part
    unit: float

    def arguments(
        self, x0: Array, parameters: Array, signals: Array, sizes: Sizes
    ) -> Array:
        """Return q.

        Args:
            x0: Initial state, shape (nx,).
            parameters: Shape (np,).
            signals: ca.vec of the signals.
            sizes: The sizes.
        """
        cost = [sizes.cost / self.unit]
        shared = [parameters, sizes.states, sizes.controls, cost]
        weights = [row_weights(part, sizes) for part in (self.interval, self.end)]
        return np.concatenate([x0 / sizes.states, *shared, *weights, signals])

    def limits(self, sizes: Sizes) -> Limits:
        """Return the bounds of variables and constraints, divided by the sizes."""
        problem, N = self.problem, self.problem.intervals
        inside, at_end = (
            row_weights(part, sizes) for part in (self.interval, self.end)
        )
        bounds = [
            np.tile(np.concatenate([u / sizes.controls, x / sizes.states]), N)
            for u, x in zip(problem.control_limits, problem.state_limits, strict=True)
        ]
        g = [
            np.concatenate(
                [
                    np.tile(
                        np.concatenate([np.zeros(problem.model.nx), stage * inside]), N
                    ),
                    end * at_end,
                ]
            )
            for stage, end in zip(
                self.interval.rows[1:3], self.end.rows[1:3], strict=True
            )
        ]
        return Limits(bounds[0], bounds[1], g[0], g[1])

    def variables(self, controls: Array, states: Array, sizes: Sizes) -> Array:
        """Return w of controls (nu, N) and the states after each interval (nx, N)."""
        scaled = [controls / sizes.controls[:, None], states / sizes.states[:, None]]
        return np.vstack(scaled).ravel(order="F")

    def split(self, w: Array, sizes: Sizes) -> tuple[Array, Array]:
        """Return controls (nu, N) and the states after each interval (nx, N) of w."""
        nu, N = self.problem.model.nu, self.problem.intervals
        both = w.reshape((-1, N), order="F")
        return both[:nu] * sizes.controls[:, None], both[nu:] * sizes.states[:, None]


def row_weights(part: Part, sizes: Sizes) -> Array:
    """Return 1 / size of each constraint row of a part."""
    rows = [1 / sizes.rows[constraint][row] for constraint, row in part.rows.places]
    return np.array(rows, dtype=np.float64)


def multiple_shooting(problem: OptimalControlProblem) -> NonlinearProgram:
    """Return the multiple-shooting NLP of a problem, with its derivatives.

    Args:
        problem: The problem.
    """
    interval, end = interval_part(problem), end_part(problem)
    mapped = _Mapped(problem, interval, end)
    cost, g, end_cost, end_g = mapped.applied(interval.value, end.value)
    nlp: dict[str, Any] = {
        "x": mapped.w,
        "p": mapped.q,
        "f": ca.sum2(cost) + end_cost,
        "g": mapped.rows_of(g, end_g),
    }
    derivatives = _derivatives(mapped, interval, end)
    operations = sum(part.n_instructions() for part in interval[:3])
    if operations * problem.intervals <= _UNROLLED:
        nlp = _without_calls(nlp)
        derivatives = {name: f.expand() for name, f in derivatives.items()}
    return NonlinearProgram(
        problem=problem,
        nlp=nlp,
        derivatives=derivatives,
        interval=interval,
        end=end,
        unit=problem.costs()[0],
    )


def _without_calls(nlp: dict[str, Any]) -> dict[str, Any]:
    """Return an NLP as one expression, without calls of the stage."""
    both = ca.Function("nlp", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]]).expand()
    w, q = (ca.SX.sym(name, both.numel_in(i)) for i, name in enumerate("wq"))
    f, g = both(w, q)
    return {"x": w, "p": q, "f": f, "g": g}


class _Mapped:
    """Symbols of the NLP, and the functions of its parts applied to them."""

    def __init__(
        self, problem: OptimalControlProblem, interval: Part, end: Part
    ) -> None:
        model, N, checks = problem.model, problem.intervals, problem.checks
        self.nx, self.nu, self.N = model.nx, model.nu, N
        self.rows = interval.value.numel_out(1)
        self.w = ca.MX.sym("w", (model.nu + model.nx) * N)
        weights = [len(part.rows.places) for part in (interval, end)]
        shared = interval.value.numel_in(1) - weights[0]
        sizes = [model.nx, shared, *weights, problem.ns * problem.nodes]
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


def _several(found: ca.MX | tuple[ca.MX, ...] | list[ca.MX]) -> list[ca.MX]:
    return [found] if isinstance(found, ca.MX) else list(found)


def _derivatives(mapped: _Mapped, interval: Part, end: Part) -> dict[str, ca.Function]:
    """Return gradient, Jacobian and Hessian of the NLP, as nlpsol takes them."""
    N, nx, w, q = mapped.N, mapped.nx, mapped.w, mapped.q
    cost, slope, g, jac, end_cost, end_slope, end_g, end_jac = mapped.applied(
        interval.slopes, end.slopes
    )
    places = [np.array(mapped.place(k)) for k in range(N)]
    last = np.array(mapped.place(N)[:nx])  # The state after the last interval.
    f = ca.sum2(cost) + end_cost
    g_all = mapped.rows_of(g, end_g)

    def gradient_entries(k: int) -> tuple[Index, Index]:
        return places[k], np.zeros_like(places[k])

    slope, end_slope = ca.densify(slope), ca.densify(end_slope)
    grad = _assembled(
        (w.numel(), 1),
        [gradient_entries(k) for k in range(N)] + [(last, np.zeros_like(last))],
        ca.vertcat(ca.vec(slope), end_slope),
    )
    rows, columns = (np.array(v, dtype=np.int64) for v in _triplet(interval.slopes, 3))
    end_rows, end_columns = (
        np.array(v, dtype=np.int64) for v in _triplet(end.slopes, 3)
    )
    states = [np.array(mapped.place(k + 1)[:nx]) for k in range(N)]
    jacobian = _assembled(
        (g_all.numel(), w.numel()),
        [(rows + k * mapped.rows, places[k][columns]) for k in range(N)]
        + [(end_rows + N * mapped.rows, last[end_columns])]
        + [(np.arange(nx) + k * mapped.rows, states[k]) for k in range(N)],
        ca.vertcat(
            _nonzeros(interval.slopes.sparsity_out(3), jac, N),
            _nonzeros(end.slopes.sparsity_out(3), end_jac, 1),
            -ca.MX.ones(nx * N),
        ),
    )
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g_all.numel())
    by_stage = ca.reshape(lam_g[: N * mapped.rows], mapped.rows, N)
    curved, end_curved = mapped.applied(
        interval.curvature,
        end.curvature,
        (lam_f, by_stage),
        (lam_f, lam_g[N * mapped.rows :]),
        same=(1, 3),
    )
    rows, columns = (
        np.array(v, dtype=np.int64) for v in _triplet(interval.curvature, 0)
    )
    end_rows, end_columns = (
        np.array(v, dtype=np.int64) for v in _triplet(end.curvature, 0)
    )
    hessian = _assembled(
        (w.numel(), w.numel()),
        [_upper(places[k][rows], places[k][columns]) for k in range(N)]
        + [_upper(last[end_rows], last[end_columns])],
        ca.vertcat(
            _nonzeros(interval.curvature.sparsity_out(0), curved, N),
            _nonzeros(end.curvature.sparsity_out(0), end_curved, 1),
        ),
    )
    return {
        "grad_f": ca.Function(
            "nlp_grad_f", [w, q], [f, grad], ["x", "p"], ["f", "grad_f_x"]
        ),
        "jac_g": ca.Function(
            "nlp_jac_g", [w, q], [g_all, jacobian], ["x", "p"], ["g", "jac_g_x"]
        ),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [w, q, lam_f, lam_g],
            [hessian],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }


def _upper(rows: Index, columns: Index) -> tuple[Index, Index]:
    """Return places in the upper triangle; -1 stays where it is."""
    outside = (rows < 0) | (columns < 0)
    first, second = np.minimum(rows, columns), np.maximum(rows, columns)
    return np.where(outside, -1, first), np.where(outside, -1, second)


def _triplet(function: ca.Function, output: int) -> tuple[list[int], list[int]]:
    """Return rows and columns of an output's nonzeros, in CasADi's order."""
    rows, columns = function.sparsity_out(output).get_triplet()
    return list(rows), list(columns)


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
