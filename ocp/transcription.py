"""Direct multiple shooting: an optimal-control problem as a sparse NLP, without units.

    minimise  f(w, q)   subject to  lbg <= g(w, q) <= ubg,  lbw <= w <= ubw
    w = (u_0, x_1, u_1, x_2, ... u_N-1, x_N), each divided by its size
    g = (defects and constraint rows of interval 0, of interval 1, ..., terminal rows)
    q = (x0, shared, weights of an interval's and of the end's rows, ca.vec of signals)

The states after each interval are variables, tied by continuity (defects = 0). Path
constraints hold, in smooth form, at every check; rows that a control enters hold as an
interval begins, too. Terminal constraints hold at the end. A range or an equality is
one row with two limits.

The sizes (scaling.py) are arguments, the cost's in its unit (`Shooting.costs`): so a
solver built once sees numbers near one, whatever the units and the initial state.
Derivatives are those of one interval, mapped and put in their places (nlp_assembly.py):
the time to build them does not grow with N.

Source: Bock and Plitt (1984), A multiple shooting algorithm for direct solution of
optimal control problems.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.constraints import Rows
from swarmstart.ocp.nlp_assembly import LimitedRows, Mapped, Part, derivatives_of
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.scaling import Sizes
from swarmstart.ocp.shooting import Shooting, shooting_of

Array = NDArray[np.float64]


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
        weights = [_part_weights(part, sizes) for part in (self.interval, self.end)]
        return np.concatenate([x0 / sizes.states, *shared, *weights, signals])

    def limits(self, sizes: Sizes) -> Limits:
        """Return the bounds of variables and constraints, divided by the sizes."""
        problem, N = self.problem, self.problem.intervals
        inside, at_end = (
            _part_weights(part, sizes) for part in (self.interval, self.end)
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


def _part_weights(part: Part, sizes: Sizes) -> Array:
    """Return 1 / size of each constraint row of a part."""
    rows = [1 / sizes.rows[constraint][row] for constraint, row in part.rows.places]
    return np.array(rows, dtype=np.float64)


def multiple_shooting(problem: OptimalControlProblem | Shooting) -> NonlinearProgram:
    """Return the multiple-shooting NLP of a problem, with its derivatives.

    Args:
        problem: The problem, or its functions.
    """
    shooting = shooting_of(problem)
    problem, interval, end = (
        shooting.problem,
        _interval_part(shooting),
        _end_part(shooting),
    )
    mapped = Mapped(problem, interval, end)
    cost, end_cost = mapped.applied(interval.cost, end.cost)
    g, end_g = mapped.applied(interval.value, end.value)
    nlp: dict[str, Any] = {
        "x": mapped.w,
        "p": mapped.q,
        "f": ca.sum2(cost) + end_cost,
        "g": mapped.rows_of(g, end_g),
    }
    derivatives = derivatives_of(mapped, interval, end)
    operations = sum(part.n_instructions() for part in interval[:5])
    if operations * problem.intervals <= _UNROLLED:
        nlp = _without_calls(nlp)
        derivatives = {name: f.expand() for name, f in derivatives.items()}
    return NonlinearProgram(
        problem=problem,
        nlp=nlp,
        derivatives=derivatives,
        interval=interval,
        end=end,
        unit=shooting.costs[0],
    )


def _without_calls(nlp: dict[str, Any]) -> dict[str, Any]:
    """Return an NLP as one expression, without calls of the stage."""
    both = ca.Function("nlp", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]]).expand()
    w, q = (ca.SX.sym(name, both.numel_in(i)) for i, name in enumerate("wq"))
    f, g = both(w, q)
    return {"x": w, "p": q, "f": f, "g": g}


class _Shared(NamedTuple):
    """Arguments that all parts share, one column: see `_shared_symbols`."""

    parameters: ca.SX
    states: ca.SX
    controls: ca.SX
    cost: ca.SX

    def column(self) -> ca.SX:
        """Return all in one column."""
        return ca.vertcat(*self)


def _shared_symbols(problem: OptimalControlProblem) -> _Shared:
    """Return symbols of the parameters and of the sizes."""
    model = problem.model
    return _Shared(
        ca.SX.sym("p", model.np),
        ca.SX.sym("size_x", model.nx),
        ca.SX.sym("size_u", model.nu),
        ca.SX.sym("size_f"),
    )


def _interval_part(shooting: Shooting) -> Part:
    """Return an interval: z = (x, u), g = (x after, constraint rows).

    Args:
        shooting: The problem's functions.
    """
    problem = shooting.problem
    model, shared = problem.model, _shared_symbols(problem)
    x_, u_ = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    s = ca.SX.sym("s", problem.ns, problem.checks + 1)
    state, u, p = x_ * shared.states, u_ * shared.controls, shared.parameters
    constraints = [
        *enumerate(zip(problem.path_constraints, shooting.path_values, strict=True))
    ]
    on_states = len(problem.constraints)  # Bounds, the last one if there are any.
    cost, parts = ca.SX(0), []
    if problem.quadrature == "left":
        cost = problem.dt * shooting.stage_cost(state, u, p, s[:, 0])
    for number, (constraint, value) in constraints:
        rows = constraint.smooth(value(state, u, p, s[:, 0]))
        parts.append(_limited(rows, number, shooting.rows_with_controls[number]))
    for k in range(problem.checks):
        state, spent = shooting.check_step(state, u, p, (s[:, k], s[:, k + 1]))
        cost += spent
        for number, (constraint, value) in constraints:
            if number == on_states and k == problem.checks - 1:
                continue  # The states after an interval are variables, with bounds.
            rows = constraint.smooth(value(state, u, p, s[:, k + 1]))
            parts.append(_limited(rows, number, None))
    if problem.quadrature == "right":
        cost = problem.dt * shooting.stage_cost(state, u, p, s[:, -1])
    limited = _joined(parts)
    g = ca.vertcat(state / shared.states, limited.values)
    return _part(ca.vertcat(x_, u_), shared, s, cost, g, limited)


def _end_part(shooting: Shooting) -> Part:
    """Return the end of the horizon: z = x, g = terminal rows.

    Args:
        shooting: The problem's functions.
    """
    problem = shooting.problem
    symbols, shared = problem.symbols(), _shared_symbols(problem)
    first = len(problem.path_constraints)
    x_ = ca.SX.sym("x", problem.model.nx)
    rows = _joined(
        [
            _limited(constraint.smooth(constraint.expression), first + number, None)
            for number, constraint in enumerate(problem.terminal_constraints)
        ]
    )
    at_end = ca.Function(
        "end",
        [symbols["states"], symbols["parameters"], symbols["signals"]],
        [shooting.costs[2], rows.values],
    )
    s = ca.SX.sym("s", problem.ns)
    cost, values = at_end(x_ * shared.states, shared.parameters, s)
    return _part(x_, shared, s, cost, values, rows)


def _part(
    z: ca.SX, shared: _Shared, s: ca.SX, cost: ca.SX, g: ca.SX, rows: LimitedRows
) -> Part:
    """Return a part with its derivatives; the last rows of g get a weight each."""
    weights = ca.SX.sym("weights", len(rows.places))
    free = g.numel() - weights.numel()
    first, limited = ca.vertsplit(g, [0, free, g.numel()])
    g = ca.vertcat(first, limited * weights)
    cost = cost / shared.cost
    arguments = [z, ca.vertcat(shared.column(), weights), s]
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.numel())
    lagrangian = lam_f * cost + ca.dot(lam_g, g)
    return Part(
        ca.Function("cost", arguments, ca.cse([cost])),
        ca.Function("value", arguments, ca.cse([g])),
        ca.Function("cost_slope", arguments, ca.cse([cost, ca.gradient(cost, z)])),
        ca.Function("slopes", arguments, ca.cse([g, ca.jacobian(g, z)])),
        ca.Function(
            "curvature",
            [*arguments, lam_f, lam_g],
            ca.cse([ca.triu(ca.hessian(lagrangian, z)[0])]),
        ),
        rows,
    )


def _limited(rows: Rows, number: int, chosen: list[int] | None) -> LimitedRows:
    """Return the chosen rows that have a limit."""
    limited = np.isfinite(rows.lower) | np.isfinite(rows.upper)
    kept = [
        int(i) for i in np.flatnonzero(limited) if chosen is None or int(i) in chosen
    ]
    return LimitedRows(
        rows.values[kept] if kept else ca.SX(0, 1),
        rows.lower[kept],
        rows.upper[kept],
        [(number, row) for row in kept],
    )


def _joined(parts: list[LimitedRows]) -> LimitedRows:
    empty = np.empty(0)
    return LimitedRows(
        ca.vertcat(ca.SX(0, 1), *[part.values for part in parts]),
        np.concatenate([empty, *[part.lower for part in parts]]),
        np.concatenate([empty, *[part.upper for part in parts]]),
        [place for part in parts for place in part.places],
    )
