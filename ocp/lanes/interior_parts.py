"""The parts of a problem as an interior-point method in lanes takes them.

The problem is the NLP of transcription.py, in its scaled numbers: an interval leads
from x to F(x, u), costs l(x, u), and its rows c(x, u) have limits. The state xa after
it is a variable of its own, F(x, u) - xa = 0 with the multiplier lam. Each lane has its
own parameters and initial state, and perhaps its own signals. The cost is divided by a
unit that each lane has: the size of the cost of its start.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from swarmstart.ocp.lanes.barrier import Pairs, Walls, bounded, kinds_of
from swarmstart.ocp.lanes.kernels import symbols
from swarmstart.ocp.nlp.nlp_assembly import Part, inputs_of
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.statement.problem import OptimalControlProblem


@dataclass(frozen=True, eq=False)
class Place:
    """An interval, the end or the start as expressions.

    Attributes:
        name: "interval", "end" or "begin". Kernels put it before the names of given
            numbers, as in "interval.unit".
        x: State.
        u: Controls and excesses of soft constraints; empty at the ends.
        own: Symbols of the variables that can have bounds: the state xa after an
            interval and its u, the decisions about the start; none at the end.
        given: Symbols of given numbers by name: "parameters" and "unit" (divisor of the
            cost) of each lane; "signals", of each lane or of all; "shared", the same
            for all lanes; the limits "lower" and "upper" of rows; bounds of `own`.
        cost: Cost of the part.
        after: State after the interval; empty at the ends.
        walls: Bounds and rows of the part.
    """

    name: str
    x: ca.SX
    u: ca.SX
    own: ca.SX
    given: dict[str, ca.SX]
    cost: ca.SX
    after: ca.SX
    walls: Walls

    @cached_property
    def kept(self) -> dict[str, ca.SX]:
        """Symbols of slacks and elastic variables, multipliers and duals."""
        walls = self.walls
        return symbols(w=walls.inner, m=walls.height, z=walls.pairs.count)

    @cached_property
    def v(self) -> ca.SX:
        """The variables with bounds."""
        return ca.vertcat(self.own, self.kept["w"])

    @cached_property
    def z(self) -> ca.SX:
        """State and controls."""
        return ca.vertcat(self.x, self.u)

    @cached_property
    def known(self) -> dict[str, ca.SX]:
        """Given numbers of the part, with the names that kernels use."""
        return {f"{self.name}.{name}": one for name, one in self.given.items()}

    @cached_property
    def cost_slope(self) -> ca.SX:
        """Gradient of the part's cost by state and controls."""
        return ca.gradient(self.cost, self.z)

    def slopes(self, rows: ca.SX) -> ca.SX:
        """Return the Jacobian of expressions by state and controls."""
        return ca.jacobian(rows, self.z)

    def bend(self, one: ca.SX) -> ca.SX:
        """Return the second derivatives of an expression by state and controls."""
        return ca.hessian(one, self.z)[0]

    @cached_property
    def excess(self) -> ca.SX:
        """Residual of the part's rows: c - s + p - n (barrier.py)."""
        return self.walls.excess(self.v, self.walls.rows)


@dataclass(frozen=True, eq=False)
class SteppedPlace(Place):
    """An interval whose integrator is computed elsewhere, step by step.

    Its cost is the part that is not integrated. The state after the integrator's last
    step is a given number F. Rows, this cost and the jump to the state after the
    interval may depend on it.

    Attributes:
        stepped: Symbols of given numbers by name. At the point from which Newton's step
            is taken: "F"; "Gc" (gradient of the integral of the cost); "J" (Jacobian of
            F); "H" (lower triangle of the second derivatives of the integral + p'F,
            with p the costate of F, see `pull`). At a trial point: "F_new"; "L_new"
            (integral); "G_new" (gradient of the integral + p'F).
    """

    stepped: dict[str, ca.SX]

    @cached_property
    def jacobian(self) -> ca.SX:
        """Derivatives of F, the state after the last step, by state and controls."""
        shape = self.x.numel(), self.z.numel()
        return ca.reshape(self.stepped["J"], *shape)

    @cached_property
    def cost_slope(self) -> ca.SX:
        """Gradient of the part's cost by state and controls."""
        return self.slopes(self.cost).T + self.stepped["Gc"]

    def slopes(self, rows: ca.SX) -> ca.SX:
        """Return the Jacobian of expressions, including their dependence on F.

        F is the state after the integrator's last step.
        """
        direct = ca.jacobian(rows, self.z)
        return direct + ca.jacobian(rows, self.stepped["F"]) @ self.jacobian

    def bend(self, one: ca.SX) -> ca.SX:
        """Return the second derivatives of an expression, with its dependence on F.

        F is the state after the integrator's last step. The terms with second
        derivatives of F are left out; they are part of `stepped["H"]`.
        """
        both = ca.vertcat(self.z, self.stepped["F"])
        chain = ca.vertcat(ca.SX.eye(self.z.numel()), self.jacobian)
        return chain.T @ ca.hessian(one, both)[0] @ chain

    def pull(self) -> ca.Function | None:
        """Return the function for the costate of F; None if this costate is always lam.

        F is the state after the integrator's last step, lam the costate of the state
        after the interval, and m are the multipliers of the rows. The function is (x,
        u, m, lam, F, parameters, unit, shared, signals) -> shape (nx,).
        """
        lam, F = ca.SX.sym("lam", self.x.numel()), self.stepped["F"]
        rows = ca.dot(self.kept["m"], self.walls.rows)
        slope = ca.gradient(self.cost + rows + ca.dot(lam, self.after), F)
        if (slope - lam).is_zero():
            return None
        given = [self.given[n] for n in ("parameters", "unit", "shared", "signals")]
        arguments = [self.x, self.u, self.kept["m"], lam, F, *given]
        return ca.Function("pull", arguments, [ca.cse(ca.densify(slope))])


@dataclass(frozen=True, eq=False)
class Places:
    """The parts of a problem.

    Attributes:
        interval: One interval; its `own` variables are the state xa after it and its u.
        end: The end.
        begin: The start; its `own` variables are the decisions y about it.
        tied: Matrix, shape (nx, ny): entry (i, j) is 1 if decision j is the initial
            value of state i, else 0.
        N: Number of intervals.
    """

    interval: Place
    end: Place
    begin: Place
    tied: ca.DM
    N: int

    @property
    def nx(self) -> int:
        """Number of states."""
        return int(self.interval.x.numel())


def places_of(program: NonlinearProgram, around: Part | None = None) -> Places:
    """Return the parts of a problem.

    Args:
        program: NLP of the problem.
        around: The interval as `interval_around` in transcription.py returns it, if the
            state after its steps is computed elsewhere; the interval of the result is
            then a `SteppedPlace`. None: the interval contains its steps.
    """
    problem, parts = program.problem, program.parts
    nx = problem.model.nx
    tied = ca.DM.zeros(nx, len(problem.free_starts))
    for column, one in enumerate(problem.free_starts):
        tied[list(one.states), column] = 1
    return Places(
        _interval(problem, parts.interval, around),
        _at(problem, parts.end, "end", Pairs([], [], ca.SX(0, 1), 0), ca.SX(0, 1), {}),
        _begin(problem, parts.begin, tied.shape[1]),
        tied,
        problem.intervals,
    )


def _interval(problem: OptimalControlProblem, part: Part, around: Part | None) -> Place:
    nx, nu = problem.model.nx, inputs_of(problem)
    u, after = ca.SX.sym("u", nu), ca.SX.sym("xa", nx)
    bounds = symbols(x_least=nx, x_most=nx, least=nu, most=nu)
    limits = [
        np.concatenate([states, controls, np.full(nu - problem.model.nu, excess)])
        for states, controls, excess in zip(
            problem.state_limits, problem.control_limits, (0.0, np.inf), strict=True
        )
    ]
    low, high = (np.flatnonzero(np.isfinite(side)).tolist() for side in limits)
    pairs = bounded(
        nx + nu,
        [
            (1.0, low, ca.vertcat(bounds["x_least"], bounds["least"])),
            (-1.0, high, ca.vertcat(bounds["x_most"], bounds["most"])),
        ],
    )
    own = ca.vertcat(after, u)
    if around is None:
        return _at(problem, part, "interval", pairs, own, bounds, u=u)
    nz = nx + nu
    stepped = symbols(
        F=nx, Gc=nz, J=nx * nz, H=nz * (nz + 1) // 2, F_new=nx, L_new=1, G_new=nz
    )
    found = _at(
        problem, around, "interval", pairs, own, bounds, u=u, after=stepped["F"]
    )
    # Without a jump it is F, multiplied by its sizes and divided by them.
    reached = found.after if problem.model.jumps else stepped["F"]
    return SteppedPlace(
        found.name, found.x, u, own, found.given, found.cost, reached, found.walls,
        stepped,
    )  # fmt: skip


def _begin(problem: OptimalControlProblem, part: Part | None, count: int) -> Place:
    bounds = symbols(first_least=count, first_most=count)
    values = [one.value for one in problem.free_starts]
    pairs = bounded(
        count,
        [
            (
                sign,
                [i for i, v in enumerate(values) if np.isfinite(getattr(v, side))],
                bounds[name],
            )
            for sign, side, name in (
                (1.0, "lower", "first_least"), (-1.0, "upper", "first_most"),
            )
        ],
    )  # fmt: skip
    return _at(problem, part, "begin", pairs, ca.SX.sym("y", count), bounds)


def _at(  # noqa: PLR0913 - a part of a problem
    problem: OptimalControlProblem,
    part: Part | None,
    name: str,
    own: Pairs,
    variables: ca.SX,
    bounds: dict[str, ca.SX],
    *,
    u: ca.SX | None = None,
    after: ca.SX | None = None,
) -> Place:
    """Return a part as expressions."""
    nx, x = problem.model.nx, ca.SX.sym("x", problem.model.nx)
    u = ca.SX(0, 1) if u is None else u
    cost, reached, rows = ca.SX(0), ca.SX(0, 1), ca.SX(0, 1)
    given, limits = dict(bounds), (np.zeros(0), np.zeros(0))
    if part is not None:
        shared = ca.SX.sym("shared", part.values.numel_in(1))
        s = ca.SX.sym("s", *part.values.size_in(2))
        z = ca.vertcat(x, u, ca.SX(0, 1) if after is None else after)
        cost, rows = part.values(z, shared, s)
        if u.numel():
            reached, rows = ca.vertsplit(rows, [0, nx, rows.numel()])
        count = problem.model.np
        parameters = ca.SX.sym("parameters", count)
        others = ca.SX.sym("others", shared.numel() - count)
        cost, reached, rows = ca.substitute(
            [cost, reached, rows], [shared], [ca.vertcat(parameters, others)]
        )
        unit = ca.SX.sym("unit")
        cost /= unit
        given |= {
            "parameters": parameters, "unit": unit, "shared": others,
            "signals": ca.vec(s),
        }  # fmt: skip
        equations = np.zeros(rows.numel() - len(part.rows.places))
        limits = (
            np.concatenate([equations, part.rows.lower]),
            np.concatenate([equations, part.rows.upper]),
        )
    lower, upper = (ca.SX.sym(side, rows.numel()) for side in ("lower", "upper"))
    given |= {"lower": lower, "upper": upper}
    walls = Walls(rows, lower, upper, kinds_of(*limits), own)
    return Place(name, x, u, variables, given, cost, reached, walls)
