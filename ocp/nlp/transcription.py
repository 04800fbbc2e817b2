"""Direct multiple shooting: an optimal-control problem as a sparse NLP, without units.

    minimise  f(w, q)   subject to  lbg <= g(w, q) <= ubg,  lbw <= w <= ubw
    w = (u_0, x_1, u_1, x_2, ... u_N-1, x_N, decided states of x_0), divided by sizes;
        after each u_k the excesses e_k >= 0 of soft constraints (violation.py), and the
        collocation unknowns of the interval, if there are any (collocation.py)
    g = (defects and rows of interval 0, of interval 1, ..., terminal rows, rows of x_0,
         differences of controls that must be equal)
    q = (x0, shared, weights of an interval's, the end's and the start's rows, ca.vec of
    signals), with `shared` the parameters and sizes that all parts of the NLP use

x_k and u_k are state and controls of interval k. The states after each interval are
variables; they are tied by continuity (defects = 0), which means that each is the state
that the interval before leads to. Path constraints hold, in smooth form, at every
check; rows that depend on a control also hold at the start of each interval. Terminal
constraints hold at the end. A range or an equality is one row with two limits.

The sizes (scaling.py) are arguments; the size of the cost is in the cost's unit
(`Shooting.costs`). So a solver is built once and sees numbers near one for all units
and initial states. The derivatives are those of one interval, mapped and put in their
places (nlp_assembly.py), so the build time does not grow with N.

Source: Bock and Plitt (1984), A multiple shooting algorithm for direct solution of
optimal control problems.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.pickling import Rebuilt
from swarmstart.ocp.nlp.collocation import (
    Inner,
    inner_sizes,
    inner_unknowns,
    layout_of,
    lifts,
)
from swarmstart.ocp.nlp.inner_guess import InnerGuess
from swarmstart.ocp.nlp.nlp_assembly import (
    LimitedRows,
    Mapped,
    Part,
    Parts,
    decided_states,
    derivatives_of,
    inputs_of,
)
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.rollout.violation import SoftRows
from swarmstart.ocp.statement.control_shape import first_of, ties
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.algebraic import UNSOLVED
from swarmstart.ocp.system.constraints import Rows

_UNROLLED = 100_000
"""Largest number of operations, with derivatives, of an NLP that is written out. This
speeds up the iterations over short horizons; longer ones would take too long to
build."""
_MOST_SHARED = 50_000
"""Largest number of operations of second derivatives that are derived from values as
they are written. For longer ones, common subexpressions of the values are merged before
the values are differentiated."""
_AS_FAST = 30_000
"""The same if longer ones are evaluated by machine code."""


class Limits(NamedTuple):
    """Bounds of an NLP's variables and constraints."""

    lbx: Array
    ubx: Array
    lbg: Array
    ubg: Array


class _Functions(NamedTuple):
    """An NLP, its derivatives, and the kernels that they call, but do not own."""

    nlp: dict[str, Any]
    derivatives: dict[str, ca.Function]
    kernels: list[ca.Function]


@dataclass(frozen=True, eq=False)
class NonlinearProgram(Rebuilt):
    """An NLP in the form that CasADi's `nlpsol` takes, with sizes as arguments.

    Its functions are built at their first use and then kept, so that a pickled answer
    is loaded without building them.

    Attributes:
        shooting: The problem's functions.
        compiled: Whether the NLP's functions call machine code, unless it is so small
            that CasADi is as fast. They have no further derivatives then.
    """

    shooting: Shooting
    compiled: bool = False

    @property
    def problem(self) -> OptimalControlProblem:
        """The problem after all rewrites (core)."""
        return self.shooting.problem

    @property
    def nlp(self) -> dict[str, Any]:
        """The expressions "x", "p", "f", "g": MX, or SX if they are written out."""
        return self._functions.nlp

    @property
    def derivatives(self) -> dict[str, ca.Function]:
        """The functions "grad_f", "jac_g" and "hess_lag", in the form IPOPT takes."""
        return self._functions.derivatives

    @cached_property
    def lagrangian(self) -> ca.Function:
        """The function (w, q, lam_g) -> (f + lam_g' g, its gradient by w, g)."""
        slope, jacobian = (self.derivatives[name] for name in ("grad_f", "jac_g"))
        w, q = (ca.MX.sym(name, slope.size1_in(name)) for name in ("x", "p"))
        lam = ca.MX.sym("lam_g", jacobian.size1_out("g"))
        (f, gradient), (g, J) = slope(w, q), jacobian(w, q)
        values = [f + ca.dot(lam, g), ca.densify(gradient + ca.mtimes(J.T, lam)), g]
        return ca.Function("lagrangian", [w, q, lam], values)

    @property
    def kernels(self) -> list[ca.Function]:
        """Machine code of the intervals; the NLP's functions do not keep it alive."""
        return self._functions.kernels

    @property
    def unit(self) -> float:
        """Unit of the cost, as in `OptimalControlProblem.costs`."""
        return self.shooting.costs[0]

    @cached_property
    def parts(self) -> Parts:
        """One interval, the end and the start."""
        begins = bool(self.problem.nlp_starts)
        return Parts(
            _interval_part(self.shooting),
            _end_part(self.shooting),
            _begin_part(self.shooting) if begins else None,
        )

    @cached_property
    def slack_rows(self) -> tuple[list[int], ...]:
        """For each soft row, the rows of an interval that bound its excess.

        Rows are numbered among the rows with a limit.
        """
        places = self.parts.interval.rows.places
        soft = () if self.shooting.soft is None else self.shooting.soft.places
        return tuple(
            [row for row, place in enumerate(places) if place == own] for own in soft
        )

    @cached_property
    def inner_guess(self) -> InnerGuess | None:
        """Guess of the collocation unknowns; None in multiple shooting."""
        layout = layout_of(self.problem)
        return None if layout is None else InnerGuess(self.shooting, layout)

    @cached_property
    def _functions(self) -> "_Functions":
        problem, parts = self.problem, self.parts
        operations = sum(part.n_instructions() for part in parts.interval[:3])
        is_written_out = operations * problem.intervals <= (
            _AS_FAST if self.compiled else _UNROLLED
        )
        compiled = self.compiled and not is_written_out
        mapped = Mapped(problem, parts, compiled=compiled)
        costs, values = zip(
            *mapped.applied(lambda part: part.values, apart=((0,), (1,))), strict=True
        )
        nlp: dict[str, Any] = {
            "x": mapped.w,
            "p": mapped.q,
            "f": sum(costs[1:], ca.sum2(costs[0])),
            "g": mapped.rows_of(values),
        }
        derivatives = derivatives_of(mapped)
        if is_written_out:
            nlp = _without_calls(nlp)
            derivatives = {name: f.expand() for name, f in derivatives.items()}
        return _Functions(nlp, derivatives, mapped.kernels)

    def arguments(
        self, x0: Array, parameters: Array, signals: Array, sizes: Sizes
    ) -> Array:
        """Return the arguments q.

        Args:
            x0: Initial state, shape (nx,).
            parameters: Parameters, shape (np,).
            signals: ca.vec of the signals.
            sizes: Natural sizes of states, controls, cost and rows.
        """
        cost = [sizes.cost / self.unit]
        soft = _sizes_of_slacks(self.problem, sizes)
        inner = inner_sizes(self.problem, sizes.states)
        solved = np.empty(0)
        if self.inner_guess is not None:
            solved = self.inner_guess.residual_sizes(x0, parameters, signals)
        shared = [
            parameters, sizes.states, sizes.controls, soft, inner, solved, cost
        ]  # fmt: skip
        weights = [_part_weights(part, sizes) for part in self.parts.present]
        return np.concatenate([x0 / sizes.states, *shared, *weights, signals])

    def limits(self, sizes: Sizes) -> Limits:
        """Return the bounds of variables and constraints, divided by the sizes."""
        problem, none = self.problem, np.empty(0, dtype=np.intp)
        tied = ties(problem.control_labels)[0] if problem.ties_controls else none
        return Limits(
            *self._bounds_of_variables(sizes, tied),
            *self._bounds_of_rows(sizes, tied.size),
        )

    def _bounds_of_variables(
        self, sizes: Sizes, tied: NDArray[np.intp]
    ) -> tuple[Array, Array]:
        """Return the lower and upper bounds of w.

        Args:
            sizes: Natural sizes of states, controls, cost and rows.
            tied: Numbers of controls that must equal earlier ones. They have no bounds
                of their own, which would repeat those of the earlier ones.
        """
        problem, N = self.problem, self.problem.intervals
        free = decided_states(problem)
        starts = [one.value for one in problem.nlp_starts for _ in one.states]
        decided = [
            np.array([getattr(value, side) for value in starts]) / sizes.states[free]
            for side in ("lower", "upper")
        ]
        inner = np.full(inner_unknowns(problem), np.inf)
        # Excesses are at least 0; collocation unknowns have no bounds.
        slacks = (
            np.append(np.zeros(problem.slacks), -inner),
            np.append(np.full(problem.slacks, np.inf), inner),
        )
        lower, upper = (
            np.append(
                np.tile(np.concatenate([u / sizes.controls, e, x / sizes.states]), N),
                start,
            )
            for u, e, x, start in zip(
                problem.control_limits,
                slacks,
                problem.state_limits,
                decided,
                strict=True,
            )
        )
        size = (lower.size - len(free)) // N
        k, j = np.divmod(tied, problem.model.nu or 1)  # There may be no controls.
        lower[k * size + j], upper[k * size + j] = -np.inf, np.inf
        return lower, upper

    def _bounds_of_rows(self, sizes: Sizes, tied: int) -> tuple[Array, Array]:
        """Return the lower and upper limits of g, whose last rows tie controls."""
        N = self.problem.intervals
        g = []
        for side in (1, 2):
            inside, *ends = (
                np.concatenate(
                    [
                        np.zeros(part.height - len(part.rows.places)),
                        part.rows[side] * _part_weights(part, sizes),
                    ]
                )
                for part in self.parts.present
            )
            g.append(np.concatenate([np.tile(inside, N), *ends, np.zeros(tied)]))
        return g[0], g[1]

    def variables(self, controls: Array, states: Array, sizes: Sizes) -> Array:
        """Return w for controls (nu, N) and the states between intervals (nx, N + 1).

        Excesses of soft constraints and collocation unknowns are 0.
        """
        scaled = states / sizes.states[:, None]
        more = inputs_of(self.problem) - self.problem.model.nu
        slacks = np.zeros((more, self.problem.intervals))
        inner = np.vstack([controls / sizes.controls[:, None], slacks, scaled[:, 1:]])
        free = decided_states(self.problem)
        return np.concatenate([inner.ravel(order="F"), scaled[free, 0]])

    def hold(self, limits: Limits, w: Array, controls: Sequence[int]) -> None:
        """Fix some controls at their values in w, by their bounds."""
        if not controls:
            return
        problem = self.problem
        inner = w.size - len(decided_states(problem))
        columns = np.arange(inner).reshape((problem.intervals, -1))
        k, number = np.divmod(first_of(problem.control_labels), problem.model.nu)
        chosen = np.isin(number, controls)
        row = columns[k[chosen], number[chosen]]
        limits.lbx[row] = limits.ubx[row] = w[row]

    def with_slacks(self, w: Array, q: Array, limits: Limits) -> Array:
        """Return w with the excesses of soft constraints at this point.

        Args:
            w: Variables whose excesses are 0.
            q: Arguments of the NLP, shape (nq,).
            limits: Limits of the NLP's variables and rows.
        """
        problem = self.problem
        if not problem.slacks:
            return w
        g = np.array(self.derivatives["jac_g"](w, q)[0]).ravel()
        beyond = np.maximum(g - limits.ubg, limits.lbg - g).clip(min=0.0)
        N, nu, interval = problem.intervals, problem.model.nu, self.parts.interval
        height = interval.height
        rows = beyond[: height * N].reshape((height, N), order="F")
        rows = rows[-len(interval.rows.places) :]  # Rows with limits come last.
        found, step = w.copy(), inputs_of(problem) + problem.model.nx
        own_slacks = slice(nu, nu + problem.slacks)
        slacks = found[: step * N].reshape((N, step))[:, own_slacks]  # A view.
        for number, own in enumerate(self.slack_rows):
            slacks[:, number] = rows[own].max(axis=0)
        return found

    def with_points(self, w: Array, given: "Given", sizes: Sizes) -> Array:
        """Return w with a guess of the collocation unknowns.

        Args:
            w: Variables.
            given: Values that the variables are made from.
            sizes: Natural sizes of states, controls, cost and rows.
        """
        if self.inner_guess is None:
            return w
        guess = self.inner_guess(*given)
        problem, N, count = self.problem, self.problem.intervals, len(guess)
        found, step = w.copy(), inputs_of(problem) + problem.model.nx
        after = inputs_of(problem)
        columns = found[: step * N].reshape((N, step))  # A view.
        columns[:, after - count : after] = (
            guess / inner_sizes(problem, sizes.states)[:, None]
        ).T
        return found

    def split(self, w: Array, sizes: Sizes) -> tuple[Array, Array]:
        """Return controls (nu, N), and the decided states at the start, from w."""
        problem = self.problem
        nu, N, free = problem.model.nu, problem.intervals, decided_states(problem)
        inner = w[: w.size - len(free)].reshape((-1, N), order="F")
        return inner[:nu] * sizes.controls[:, None], w[w.size - len(free) :] * (
            sizes.states[free]
        )


def _sizes_of_slacks(problem: OptimalControlProblem, sizes: Sizes) -> Array:
    """Return the size of each soft row, which is that of its excess, too."""
    hard = len(sizes.rows) - len(problem.soft)
    return np.concatenate([np.empty(0), *sizes.rows[hard:]])


def _part_weights(part: Part, sizes: Sizes) -> Array:
    """Return 1 / size of each constraint row of a part."""
    rows = [1 / sizes.rows[constraint][row] for constraint, row in part.rows.places]
    return np.array(rows, dtype=np.float64)


def multiple_shooting(
    problem: OptimalControlProblem | Shooting, *, compiled: bool = False
) -> NonlinearProgram:
    """Return the multiple-shooting NLP of a problem, with its derivatives.

    Args:
        problem: The problem, or its compiled functions.
        compiled: Whether its functions call machine code, unless it is so small that
            CasADi is as fast. They have no further derivatives then.
    """
    program = NonlinearProgram(shooting_of(problem), compiled)
    # Now: a solver that is built does nothing of this when it plans.
    _ = program.nlp, program.inner_guess
    return program


def _without_calls(nlp: dict[str, Any]) -> dict[str, Any]:
    """Return an NLP as one expression, without calls of the stage."""
    both = ca.Function("nlp", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]]).expand()
    w, q = (ca.SX.sym(name, both.numel_in(i)) for i, name in enumerate("wq"))
    f, g = both(w, q)
    return {"x": w, "p": q, "f": f, "g": g}


class Given(NamedTuple):
    """Start of an NLP solver, in the units of the problem.

    Attributes:
        controls: Controls, shape (nu, N).
        pieces: States at the start of each interval and at each of its checks, shape
            (nx, checks + 1, N).
        parameters: Parameters, shape (np,).
        signals: Signals at the nodes, shape (ns, nodes).
    """

    controls: Array
    pieces: Array
    parameters: Array
    signals: Array


class _Shared(NamedTuple):
    """Arguments that all parts share, as one column: see `_shared_symbols`."""

    parameters: ca.SX
    states: ca.SX
    controls: ca.SX
    residuals: ca.SX
    cost: ca.SX

    def column(self) -> ca.SX:
        """Return all of them in one column."""
        return ca.vertcat(*self)


def _shared_symbols(problem: OptimalControlProblem) -> _Shared:
    """Return symbols of the parameters and of the sizes."""
    model, layout = problem.model, layout_of(problem)
    return _Shared(
        ca.SX.sym("p", model.np),
        ca.SX.sym("size_x", model.nx),
        ca.SX.sym("size_u", inputs_of(problem)),
        ca.SX.sym("size_r", 0 if layout is None else layout.lifted),
        ca.SX.sym("size_f"),
    )


def interval_around(shooting: Shooting) -> Part:
    """Return an interval that is not integrated: z = (x, u, e, x after).

    The state after the interval, x after, is one of the variables; e are the excesses
    of soft constraints. The cost is without the integral of the stage cost. Rows at
    checks inside the interval are not valid.

    Args:
        shooting: The functions of a problem without collocation.
    """
    return _interval_part(shooting, ca.SX.sym("after", shooting.problem.model.nx))


def _interval_part(shooting: Shooting, after: ca.SX | None = None) -> Part:
    """Return an interval: z = (x, u, e, c), g = (x after, rows of c, constraint rows).

    c are the collocation unknowns, see collocation.py.

    Args:
        shooting: The functions of the problem.
        after: Given state after the interval, at the end of z; None: it follows from z.
    """
    problem = shooting.problem
    model, shared = problem.model, _shared_symbols(problem)
    x_, u_ = ca.SX.sym("x", model.nx), ca.SX.sym("u", inputs_of(problem))
    s = ca.SX.sym("s", problem.ns, problem.checks + 1)
    state, inputs, p = x_ * shared.states, u_ * shared.controls, shared.parameters
    soft_end = model.nu + problem.slacks
    u, e, c = ca.vertsplit(inputs, [0, model.nu, soft_end, inputs.numel()])
    inner = Inner(shooting, (state, u, p, s[:, 0]), c)
    points = [(state, s[:, 0], False)]
    cost = shooting.cost_at_begin(state, u, p, s[:, 0])
    parts = _rows_at(shooting, (state, u, p, s[:, 0]), shooting.rows_with_controls, 0)
    for k in range(problem.checks):
        ends = s[:, k], s[:, k + 1]
        if after is None:
            state, spent = inner.check(state, ends, k)
            cost += spent
        else:
            state = after * shared.states
        points.append((state, s[:, k + 1], False))
        if not model.is_discrete:  # In discrete time only the jump moves the state.
            at = (state, u, p, s[:, k + 1])
            chosen = _rows_of_check(shooting, last=k == problem.checks - 1)
            parts += _rows_at(shooting, at, chosen, k + 1)
    if model.jumps:
        state = shooting.jump(state, u, p, s[: model.ns, -1])
        at, number = (state, u, p, s[:, -1]), problem.checks + 1
        rows = shooting.rows_that_jump
        parts += _rows_at(shooting, at, rows, number, without_bounds=True)
        points.append((state, s[:, -1], True))
    if problem.quadrature == "right":
        cost += problem.dt * shooting.stage_cost(state, u, p, s[:, -1])
    if shooting.soft is not None:
        parts += _soft_rows(shooting.soft, points, (u, e, p))
        spent = shooting.soft.price(points[0][0], p, s[:, 0], e)
        cost += problem.dt * spent / shooting.costs[0]  # The price has the user's unit.
    limited = _joined(parts)
    g = ca.vertcat(
        state / shared.states,
        inner.rows(shared.states, shared.residuals),
        limited.values,
    )
    cost, g = inner.lifted(cost, g)
    z = ca.vertcat(x_, u_, ca.SX(0, 1) if after is None else after)
    return _part(z, shared, s, cost, g, limited)


def _soft_rows(
    soft: SoftRows,
    points: Sequence[tuple[ca.SX, ca.SX, bool]],
    held: tuple[ca.SX, ca.SX, ca.SX],
) -> list[LimitedRows]:
    """Return the rows that bound the excesses of soft constraints from below.

    Args:
        soft: The soft constraints.
        points: States and signals, and whether they are after the interval's end.
        held: Controls, excesses and parameters.
    """
    u, e, p = held
    found = []
    for number, (x, s, jumped) in enumerate(points):
        values = soft.values(x, u, p, s)
        chosen = soft.that_jump if jumped else range(soft.size)
        for limits, sign in ((soft.lower, 1.0), (soft.upper, -1.0)):
            rows = [i for i in chosen if np.isfinite(limits[i])]
            none = np.full(len(rows), sign * np.inf)
            lower, upper = (limits[rows], none) if sign > 0 else (none, limits[rows])
            places = [soft.places[i] for i in rows]
            value = (values + sign * e)[rows] if rows else ca.SX(0, 1)
            at = [number] * len(rows)
            found.append(LimitedRows(value, lower, upper, places, at))
    return found


def _rows_of_check(shooting: Shooting, *, last: bool) -> list[list[int]]:
    """Return the rows of each constraint that hold at the end of a check.

    Only rows that can still change are included: repeated equalities would give the NLP
    more equations than variables. States after an interval are variables with bounds of
    their own; states before the jump at its end are not.
    """
    problem, chosen = shooting.problem, []
    for number, constraint in enumerate(problem.path_constraints):
        rows = range(constraint.rows(constraint.expression).values.numel())
        if last and number == len(problem.stated):
            chosen.append(shooting.rows_that_jump[number])
            continue
        settled = shooting.rows_settled[number]
        chosen.append([row for row in rows if row not in settled])
    return chosen


def _rows_at(
    shooting: Shooting,
    at: tuple[ca.SX, ca.SX, ca.SX, ca.SX],
    chosen: Sequence[list[int]],
    check: int,
    *,
    without_bounds: bool = False,
) -> list[LimitedRows]:
    """Return the smooth rows of the path constraints at one point.

    Args:
        shooting: The problem's functions.
        at: State, controls, parameters and signals.
        chosen: The rows of each constraint.
        check: Number of the check, as in LimitedRows.
        without_bounds: Whether the bounds of the states are left out.
    """
    problem, found = shooting.problem, []
    for number, constraint in enumerate(problem.path_constraints):
        if without_bounds and number == len(problem.stated):
            continue
        if lifts(problem) and constraint.name == UNSOLVED:
            continue  # These equations are separate rows.
        rows = constraint.smooth(shooting.path_values[number](*at))
        found.append(_limited(rows, number, chosen[number], check))
    return found


def _end_part(shooting: Shooting) -> Part:
    """Return the end of the horizon: z = x, g = equations of a risk, terminal rows."""
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
        [*_end_terms(shooting), rows.values],
    )
    s = ca.SX.sym("s", problem.ns)
    cost, equations, values = at_end(x_ * shared.states, shared.parameters, s)
    if problem.epigraph is not None:
        # They compare costs, and t has the size of a cost.
        equations = equations / shared.states[problem.epigraph.first]
    return _part(x_, shared, s, cost, ca.vertcat(equations, values), rows)


def _end_terms(shooting: Shooting) -> tuple[ca.SX, ca.SX]:
    """Return the smooth terminal cost / unit, and the equations that belong to it."""
    unit, costs = shooting.costs
    epigraph = shooting.problem.epigraph
    if epigraph is None:
        return costs.terminal, ca.SX(0, 1)
    return epigraph.cost / unit, epigraph.equations


def _begin_part(shooting: Shooting) -> Part:
    """Return the start of the horizon: z = x, g = ties and rows of a decided start."""
    problem = shooting.problem
    symbols, shared = problem.symbols(), _shared_symbols(problem)
    x_ = ca.SX.sym("x", problem.model.nx)
    tied = [x_[i] - x_[one.states[0]]
            for one in problem.free_starts for i in one.states[1:]]  # fmt: skip
    rows = _joined(
        [
            _limited(c.smooth(c.expression), number, shooting.rows_of_start[number])
            for number, c in enumerate(problem.path_constraints)
            if number < len(problem.stated)  # State bounds apply to the start anyway.
            and not (lifts(problem) and c.name == UNSOLVED)
        ]
    )
    at_start = ca.Function(
        "begin",
        [symbols["states"], symbols["parameters"], symbols["signals"]],
        [shooting.costs[1].initial, rows.values],
    )
    s = ca.SX.sym("s", problem.ns)
    cost, values = at_start(x_ * shared.states, shared.parameters, s)
    return _part(x_, shared, s, cost, ca.vertcat(*tied, values), rows)


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
    further = [*arguments, lam_f, lam_g]

    def derived(cost: ca.SX, g: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
        lagrangian = lam_f * cost + ca.dot(lam_g, g)
        slopes = [cost, ca.gradient(cost, z), g, ca.jacobian(g, z)]
        # IPOPT takes the upper triangle only.
        return slopes, [ca.triu(ca.hessian(lagrangian, z)[0])]

    values, (slopes, bent) = ca.cse([cost, g]), derived(cost, g)
    if ca.Function("curvature", further, bent).n_instructions() > _MOST_SHARED:
        slopes, bent = derived(*values)
    # Common parts of derivatives are not looked for: that takes longer than all else,
    # and machine code is as fast without.
    return Part(
        ca.Function("values", arguments, values),
        ca.Function("slopes", arguments, slopes),
        ca.Function("curvature", further, bent),
        rows,
    )


def _limited(
    rows: Rows, number: int, chosen: list[int] | None, check: int = 0
) -> LimitedRows:
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
        [check] * len(kept),
    )


def _joined(parts: list[LimitedRows]) -> LimitedRows:
    empty = np.empty(0)
    return LimitedRows(
        ca.vertcat(ca.SX(0, 1), *[part.values for part in parts]),
        np.concatenate([empty, *[part.lower for part in parts]]),
        np.concatenate([empty, *[part.upper for part in parts]]),
        [place for part in parts for place in part.places],
        [check for part in parts for check in part.at],
    )
