"""Answer to one optimal-control problem, verified along its path.

A coarse integrator lets solvers find optima that do not exist, and constraints that
hold at the checks may be broken between them. So every answer is integrated again with
a step ten times finer, and

    cost        may differ by `tolerance` of the integral of |stage cost| plus
                |terminal cost|
    end state   each state may differ by `tolerance` of its scale (the larger one of its
                range along the path and the width of its bounds), and by rounding; if
                an answer is judged interval by interval, the differences of all
                intervals are added
    constraints may be broken by `path_tolerance` of their scale, anywhere on the path

or the answer is not confirmed. A confirmed answer is called a local optimum if an NLP
solver ended at a stationary point, the second derivatives show a minimum, and the path
touches no kink or jump of the problem's expressions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    a_number,
    checked,
    choice,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.answer.explained import (
    AT_KINK,
    NOT_POLISHED,
    NOT_STATIONARY,
    ON_EDGE,
    WHOLE_NUMBERS,
    paragraph_of,
)
from swarmstart.ocp.answer.optimality_gap import OptimalityGap
from swarmstart.ocp.answer.plan import Plan, guess_of, start_of
from swarmstart.ocp.answer.sensitivity import (
    DATA,
    Data,
    Sensitivity,
    sensitivity_of,
)
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.common.presentation import Presented
from swarmstart.ocp.lanes.answers import Optimum
from swarmstart.ocp.lower_bound.stated.answer import LowerBound
from swarmstart.ocp.nlp.multipliers import Multipliers, multipliers_of
from swarmstart.ocp.nlp.optimality import Curvature, curvature, is_stationary
from swarmstart.ocp.nlp.polish import SAME_COST
from swarmstart.ocp.nlp.polish_options import IpoptOptions, PolishStatus
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import (
    KNOWN,
    NOTHING,
    Known,
    at_nodes,
    shared_arguments,
    stated_known,
)
from swarmstart.ocp.rollout.kinks import without_kink
from swarmstart.ocp.rollout.member_costs import member_costs
from swarmstart.ocp.rollout.path import Path, Tracer, first_not_finite
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.rollout.status import (
    Found,
    Growth,
    SolutionStatus,
    advice_for,
    fastest_mode,
    growth_along,
)
from swarmstart.ocp.search.account import Repair, Restarts, StartsAccount
from swarmstart.ocp.statement.control_shape import piece_at, rows_at
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import Lowered, lowered

if TYPE_CHECKING:
    import control

TOLERANCE = 1e-3
Numbers = TypeVar("Numbers", float, Array)
_BESIDE = 1e-8
"""Distance to neighbours, relative to the sizes."""
_STEADY = 100
"""Largest change of a cost without a jump, relative to size and distance."""
_AGAIN = "try another seed, a guess, or more iterations (max_iterations) of the polish"
_ROUNDINGS = 1e3 * float(np.finfo(np.float64).eps)
"""Rounding of a path, relative to its values."""
_NOTHING_COSTS = 1e-8
"""Difference of costs, relative to the natural size, that a solver may leave."""
_NOTHING_MOVES = 1e-9
"""Part of the natural size below which a difference counts as zero."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LocalOptimum:
    """A local optimum that a solve in lanes found; it is not polished yet.

    The solve has tested the conditions of a local optimum, of second order too.

    Attributes:
        cost: Its cost, with the sign as the problem states it.
        count: Number of starts that ended in it.
        controls: As `Solution.controls`.
        states: States between the intervals, shape (nx, N + 1).
    """

    cost: float
    count: int
    controls: Array = field(repr=False)
    states: Array = field(repr=False)
    _core: Optimum = field(repr=False)
    _answer: Solution = field(repr=False)

    @staticmethod
    def of(one: Optimum, answer: Solution, core: Lowered) -> LocalOptimum:
        """Return an optimum of the rewritten problem in terms of the stated problem."""
        problem = answer.problem
        controls = core.knots(one.controls, one.states[:, 0])
        return LocalOptimum(
            cost=problem.sense * one.cost,
            count=one.count,
            controls=controls,
            states=core.as_stated(one.states)[: problem.model.nx],
            _core=one,
            _answer=answer,
        )

    def solution(self) -> Solution:
        """Return the optimum polished by IPOPT and verified.

        Example:
            >>> import casadi as ca, swarmstart as ss
            >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
            >>> problem = ss.OptimalControlProblem(
            ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
            ...     stage_cost=u**2 / 50, terminal_cost=(x**2 - 1) ** 2 + x / 10,
            ...     bounds=ss.Bounds(controls=(-2, 2)),
            ... )
            >>> found = ss.solve(problem, [0.0], search=None, seed=0)
            >>> second = found.optima[1].solution()
            >>> [round(float(one.states[0, -1]), 2) for one in (found, second)]
            [-1.01, 0.98]
        """
        from swarmstart.ocp.answer.planner import Planner

        problem, known = self._answer.problem, self._answer.known
        planner = Planner(problem, search=None, polish=IpoptOptions(), backend="casadi")
        given = planner.lowered.known_parameters
        known = known._replace(parameters=np.asarray(known.parameters)[given])
        start, states = self._core.states[:, 0], self.states[:, 0]
        _, known, _ = planner.posed(states, known, None)
        plan = planner.plan(
            start, known=known, guess=self._core.controls, near=True,
            rng=np.random.default_rng(0),
        )  # fmt: skip
        return verified(planner.tracer, plan, start, known)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solution(Presented):
    """The best answer found, with its verification by a finer integration.

    Attributes:
        status: Status of the answer.
        reason: Reason for the status, in sentences with numbers.
        advice: Advice on what to change; empty without one.
        problem: The problem.
        times: Times of the nodes, shape (nodes,) [s].
        states: States at the nodes, finely integrated, shape (nx, nodes).
        controls: Controls, shape (nu, N); linear controls by their knots, (nu, N + 1).
        known: Parameters of the model (those that were decided too), signals at the
            nodes, and time at the start.
        decided: Decisions besides controls and start: parameters by their names, a free
            end time as "end time" [s].
        cost: Cost on the problem's own grid, with the sign as the problem states it.
        violation: Summed violation on the problem's own grid, relative to the scales.
        verified_cost: Cost by the finer integration.
        verified_violation: Sum of the worst excess of each constraint row by the finer
            integration, relative to the scales.
        path: The finely integrated path, called the finer path, with the constraints
            that it breaks.
        plan: The plan, with its source and its effort.
        compile_seconds: Wall time of `solve` for loading and compiling machine code
            [s].
        algebraic: Algebraic variables of the model at the nodes, with the control of
            the following interval, shape (nz, nodes); empty if the model has none.
        member_costs: Costs of the members of an ensemble on the problem's own grid,
            shape (M,); empty for any other problem.
        bound: Bound of the optimal cost, if `solve` was asked for one.
        repair: Report on the repair; None: there was nothing to repair, or `solve` was
            asked not to repair.
        restarts: Report on the restarts that decided whether a point with flat
            curvature is an optimum; None: there were no restarts.
    """

    status: SolutionStatus
    reason: str
    advice: str
    problem: OptimalControlProblem
    times: Array
    states: Array
    controls: Array
    known: Known
    decided: Mapping[str, float]
    cost: float
    violation: float
    verified_cost: float
    verified_violation: float
    path: Path
    plan: Plan
    compile_seconds: float = 0.0
    algebraic: Array
    member_costs: Array
    bound: LowerBound | None = None
    repair: Repair | None = None
    restarts: Restarts | None = None

    @property
    def optima(self) -> tuple[LocalOptimum, ...]:
        """Distinct local optima that the lanes found, the cheapest first.

        Their costs are those before the polish, with the sign as the problem states it.
        Empty if no starts were solved in lanes.
        """
        starts = self.plan.starts
        if starts is None or starts.lanes is None:
            return ()
        core = lowered(self.problem)
        return tuple(LocalOptimum.of(one, self, core) for one in starts.lanes.optima)

    @property
    def gap(self) -> OptimalityGap | None:
        """Gap between the answer and its bound; None if no bound was asked for.

        The cost is that of the finer path, and is used only if the answer is confirmed.
        """
        return None if self.bound is None else self.beside(self.bound)

    @checked(refused, bound=of_kind(LowerBound, "a LowerBound"))
    def beside(self, bound: LowerBound) -> OptimalityGap:
        """Return the gap between the answer and a bound.

        Args:
            bound: A bound of the optimal cost, as of `lower_bound`.
        """
        return OptimalityGap.of(
            bound,
            self.verified_cost if self.status.is_confirmed else None,
            tolerance=TOLERANCE * self.path.magnitude,
        )

    @property
    def multipliers(self) -> Multipliers | None:
        """Costates and shadow prices of the polished answer.

        They are in the units of the problem (docs/any_problem.md, "What limits are
        worth"). None if no NLP solver has converged to it.
        """
        point = self.plan.point
        return None if point is None else multipliers_of(point, self.problem)

    @checked(refused, by=several(choice(DATA), "names of data"))
    def sensitivity(self, by: Sequence[Data] = DATA) -> Sensitivity:
        """Return the derivatives of the answer by its data, to first order.

        Args:
            by: "x0", the states at the start that are not decided; "parameters", those
                of the model that are not decided.

        Raises:
            NoSensitivityError: If no NLP solver has converged to the answer, or it is
                no strict minimum whose active limits are independent.

        Example:
            >>> import casadi as ca, swarmstart as ss
            >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
            >>> problem = ss.OptimalControlProblem(
            ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
            ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-9, 9)),
            ...     terminal=[(x, 0)],
            ... )
            >>> found = ss.solve(problem, [2.0], seed=0).sensitivity()
            >>> found.data, found.cost.round(6)  # Of x0^2.
            (('x',), array([4.]))
            >>> found.controls[:, :, 0].round(6)
            array([[-1., -1., -1., -1.]])
        """
        core = lowered(self.problem)
        return sensitivity_of(self.plan.point, core, self.plan.controls, by)

    @checked(
        refused,
        problem=optional(of_kind(OptimalControlProblem, "an OptimalControlProblem")),
    )
    def as_guess(self, problem: OptimalControlProblem | None = None) -> Start:
        """Return the answer as a start for another grid, horizon or initial state.

        States, controls, decisions and, for a polished answer, its multipliers are
        transferred to the grid of the problem; a polish starts from all of them.

        Args:
            problem: The problem to solve, with the same names of states, controls and
                constraints; None: the same problem.

        Returns:
            A start, for `solve(..., guess=...)`.

        Raises:
            InvalidProblemError: If the names of the problem differ.

        Example:
            >>> import casadi as ca, swarmstart as ss
            >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
            >>> model = ss.Model(states=x, controls=u, ode=u - x**3)
            >>> coarse, fine = (
            ...     ss.OptimalControlProblem(
            ...         model, horizon=2.0, intervals=N, stage_cost=x**2 + u**2,
            ...         bounds=ss.Bounds(controls=(-1, 1)),
            ...     )
            ...     for N in (10, 20)
            ... )
            >>> found = ss.solve(coarse, [2.0], search=None, seed=0)
            >>> start = found.as_guess(fine)
            >>> start.controls.shape, start.states.shape
            ((1, 20), (1, 21))
            >>> ss.solve(fine, [2.1], guess=start, search=None, seed=0).status.name
            'CONVERGED'
        """
        return guess_of(self.plan, self.problem, problem or self.problem)

    @property
    def state_names(self) -> tuple[str, ...]:
        """The model's names of the states."""
        return self.problem.model.state_names

    @property
    def control_names(self) -> tuple[str, ...]:
        """The model's names of the controls."""
        return self.problem.model.control_names

    @property
    def outputs(self) -> Array:
        """Outputs of the model at the nodes, shape (ny, nodes).

        At each node they use the control of the interval after it, at the last node
        that of the interval before it.
        """
        every = (self.path.times.size - 1) // (self.times.size - 1)
        return self.path.outputs[:, ::every]

    @property
    def output_names(self) -> tuple[str, ...]:
        """The model's names of the outputs."""
        return self.problem.model.output_names

    @checked(refused, time=a_number())
    def linearised(self, time: float) -> control.StateSpace:
        """Return the linear system near the answer at a time, for python-control.

        Args:
            time: Time after the start [s]; states and controls are those of the finer
                path at that time. Delayed controls are those that the model receives at
                that time.

        Raises:
            InvalidProblemError: If the time is outside of the horizon.
            InvalidSystemError: As `Model.linearised`.

        Example:
            >>> import casadi as ca, swarmstart as ss
            >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
            >>> problem = ss.OptimalControlProblem(
            ...     ss.Model(states=x, controls=u, ode=u - x**3), horizon=2.0,
            ...     intervals=4, terminal=[(x, 1)], stage_cost=u**2,
            ...     bounds=ss.Bounds(controls=(-2, 2)),
            ... )
            >>> found = ss.solve(problem, [0.0], search=None, lanes=0, seed=0)
            >>> found.linearised(2.0).A.round(3).tolist()  # -3 x^2 at x = 1
            [[-3.0]]
        """
        problem, model = self.problem, self.problem.model
        instants = self.times[:: problem.checks]
        interval = piece_at(time, instants)
        late = lowered(problem).acting(self.plan.controls, self.plan.x0)
        u = (self.controls if late is None else late)[:, interval]
        if problem.has_knots:
            u = rows_at(time, instants, self.controls)
        signals = np.asarray(self.known.signals)
        return model.linearised(
            rows_at(time, self.path.times, self.path.states[: model.nx]),
            u,
            parameters=self.known.parameters,
            signals=rows_at(time, self.times, signals[: model.ns]),
            time=self.known.time + time,
        )

    @property
    def algebraic_names(self) -> tuple[str, ...]:
        """Names of the model's algebraic variables."""
        return self.problem.model.elimination.names

    def __repr__(self) -> str:
        """Return a summary in about ten lines."""
        plan = self.plan
        lines = [
            f"Solution: {self.status.value}",
            f"  reason      {self.reason}",
            f"  advice      {self.advice or 'none'}",
            f"  cost        {self.cost:.9g}  (finer path: {self.verified_cost:.9g})",
            f"  violation   {self.violation:.3g}  "
            f"(finer path: {self.verified_violation:.3g})",
            f"  source      {plan.source.value}; {plan.evaluations} evaluations"
            + (f"; polish {plan.polish_status.value}" if plan.polish_status else ""),
            f"  horizon     {self.times[-1]:g} s, {self.problem.intervals} "
            f"intervals of {self.times[-1] / self.problem.intervals:g} s",
            f"  states      {self._ranges(self.state_names, self.states)}",
            f"  controls    {self._ranges(self.control_names, self.controls)}",
        ]
        if self.algebraic.size:
            shown = self._ranges(self.algebraic_names, self.algebraic)
            lines.append(f"  algebraic   {shown}")
        if self.output_names:
            lines.append(
                f"  outputs     {self._ranges(self.output_names, self.outputs)}"
            )
        if self.decided:
            values = [f"{name} {value:.9g}" for name, value in self.decided.items()]
            # The later line first, so that the places of the others stay valid.
            lines.insert(7, f"  decided     {', '.join(values)}")
        if self.member_costs.size:
            lines.insert(4, f"  members     {_spread(self.member_costs)}")
        if self.gap is not None:
            lines.insert(4, f"  bound       {self.gap.words}")
        paragraph = paragraph_of(self.status, self.reason)
        if paragraph is not None:
            lines.insert(3, f"  more        {paragraph}")
        return "\n".join([*lines, *self._account()])

    def _ranges(self, names: tuple[str, ...], rows: Array) -> str:
        """Return values and ranges of the first rows, with their units."""
        return _ranges(names, rows, self.problem.model.units)

    def _afterwards(self, starts: StartsAccount) -> list[str]:
        """Return the line of a cost that is not that of any start."""
        costs = [one.cost for one in starts.tried]
        cost = self.plan.cost
        if not costs or np.isclose(cost, costs, rtol=SAME_COST, atol=0.0).any():
            return []
        by = "repair" if self.repair is not None else "rounding kinks"
        if self.restarts is not None and self.restarts.better:
            by = "restarts"
        return [f"  afterwards  {self.cost:.7g}, by {by}"]

    def _account(self) -> list[str]:
        """Return what search, starts, repair and restarts did, in lines."""
        plan = self.plan
        lines = plan.search.lines(self.problem.sense)
        if plan.starts is not None:
            lines += plan.starts.lines(self.problem.sense)
            lines += self._afterwards(plan.starts)
        if self.repair is not None:
            lines.append(f"  repair      {self.repair.line}")
        if self.restarts is not None:
            lines.append(f"  restarts    {self.restarts.line}")
        return lines


SHOWN = 6
"""Rows of states or controls that a summary shows."""


def _spread(costs: Array) -> str:
    """Return the spread of the costs of an ensemble's members."""
    return (
        f"{costs.size}, costs from {costs.min():.6g} (number {costs.argmin()}) to "
        f"{costs.max():.6g} (number {costs.argmax()})"
    )


def _ranges(names: tuple[str, ...], rows: Array, units: Mapping[str, str]) -> str:
    """Return name, first and last value and range of the first rows."""
    if not names:
        return "none"
    parts = []
    for name, row in zip(names[:SHOWN], rows, strict=False):
        finite = row[np.isfinite(row)]
        unit = f" {units[name]}" if name in units else ""
        reach = f"[{finite.min():.4g}, {finite.max():.4g}]" if finite.size else "none"
        parts.append(f"{name} {row[0]:.4g} to {row[-1]:.4g} in {reach}{unit}")
    more = len(names) - SHOWN
    return "; ".join(parts) + (f"; and {more} more" if more > 0 else "")


@checked(
    refused,
    problem=of_kind(OptimalControlProblem | Tracer, "an OptimalControlProblem"),
    plan=of_kind(Plan, "a Plan"),
    x0=reals(),
    known=KNOWN,
    tolerance=a_number(least=0),
    advised=FLAG,
)
def verified(
    problem: OptimalControlProblem | Tracer,
    plan: Plan,
    x0: ArrayLike,
    known: Known = NOTHING,
    *,
    tolerance: float = TOLERANCE,
    advised: bool = True,
) -> Solution:
    """Verify a plan by an integration ten times finer, and return it as a solution.

    Args:
        problem: The problem of the plan, or the tracer of its paths.
        plan: The plan.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        tolerance: Allowed difference of the cost, relative to the integral of |stage
            cost| plus |terminal cost|, and of each end state, relative to its scale.
        advised: Whether to look for the fastest mode along a path that is not
            confirmed, for advice; this takes most of the time for a small problem.

    Returns:
        The solution with its status.
    """
    trace = problem if isinstance(problem, Tracer) else Tracer(problem)
    problem = trace.problem
    state, parameters, flat = shared_arguments(
        problem, start_of(problem, plan, x0), known
    )
    signals = at_nodes(problem, flat)
    sizes = trace.shooting.sizing(state, parameters, signals, plan.controls)
    path = trace(plan.controls, state, parameters, signals, sizes, ends=plan.ends)
    found = _judged(trace.shooting, plan, path, sizes, tolerance=tolerance)
    # Away from kinks and jumps, neighbours have nearly the same value.
    if found.status is SolutionStatus.FEASIBLE and path.kinks:
        here = state, parameters, signals
        found = _same_beside(trace, plan, path, here, sizes, tolerance)
    if found.status is SolutionStatus.FEASIBLE:
        found = _ranked(trace.shooting, plan, path)
    status, reason = found.status, found.reason
    fast, grown, data = None, None, Known(parameters, signals)
    asked = advised and not status.is_confirmed
    if asked or plan.ends is not None:
        grown = _growth(trace.shooting, plan, path, data, sizes)
    if plan.ends is not None:
        reason = f"{reason}; judged interval by interval, since {grown}"
    if path.outside:
        reason = f"the start is outside: {path.outside[0]}; {reason}"
    failed = plan.polish_status is PolishStatus.NUMERICAL_FAILURE
    if asked or (advised and failed):
        fast = fastest_mode(trace.shooting, path, state, data)
    every = (path.times.size - 1) // (problem.nodes - 1)  # Fine steps between nodes.
    stated, lowered = trace.shooting.stated, trace.shooting.lowered
    sense, states = stated.sense, lowered.as_stated(path.states)
    return Solution(
        status=status,
        reason=reason,
        advice=advice_for(problem, found, fast, grown),
        problem=stated,
        times=path.times[::every],
        # Further states of the core are none of the user's.
        states=states[: stated.model.nx, ::every],
        controls=lowered.knots(plan.controls, state),
        known=stated_known(lowered, state, parameters, signals),
        decided=lowered.decided(state),
        cost=sense * plan.cost,
        violation=plan.violation,
        verified_cost=sense * path.cost,
        verified_violation=sum(e.relative for e in path.broken),
        path=replace(path, states=states),
        plan=plan,
        algebraic=_algebraic(
            problem, path.states[:, ::every], plan, parameters, signals
        ),
        member_costs=sense
        * member_costs(trace.shooting, plan.controls, state, parameters, signals),
    )


def _growth(
    shooting: Shooting,
    plan: Plan,
    path: Path,
    known: Known,
    sizes: Sizes,
) -> Growth:
    """Return the growth of deviations along the path, or along a plan's intervals."""
    begins = (path.states if plan.ends is None else plan.states)[:, :-1]
    every = begins.shape[1] // shooting.problem.intervals
    return growth_along(
        shooting, begins[:, ::every], plan.controls, known, sizes.states
    )


def _algebraic(
    core: OptimalControlProblem,
    states: Array,
    plan: Plan,
    parameters: Array,
    signals: Array,
) -> Array:
    """Return the algebraic variables at the nodes, shape (nz, nodes)."""
    found = core.model.elimination
    if not found.symbols.numel():
        return np.empty((0, states.shape[1]))
    at = ca.Function("algebraic", [*core.symbols().values()], [found.solution])
    u = np.repeat(plan.controls, core.checks, axis=1)
    p = np.repeat(parameters[:, None], states.shape[1], axis=1)
    # No control begins at the last node.
    return np.array(at(states, np.hstack([u, u[:, -1:]]), p, signals))


def _judged(
    shooting: Shooting,
    plan: Plan,
    path: Path,
    sizes: Sizes,
    *,
    tolerance: float,
) -> Found:
    """Return the status of a plan by its path: FEASIBLE if everything agrees."""
    problem = shooting.problem
    lost = path.not_finite or first_not_finite(problem, problem.times, plan.states)
    if lost is not None and not plan.feasible:
        time, name = lost
        return Found(
            SolutionStatus.NOT_FINITE,
            f"state {name} is not a finite number from {time:.4g} s on",
        )
    if not plan.feasible:
        return _infeasible(plan, path)
    if path.not_finite is not None:
        time, name = path.not_finite
        return Found(
            SolutionStatus.MISMATCH,
            f"on the finer path state {name} is not a finite number from {time:.4g} s "
            "on",
        )
    differs = _differences(shooting, plan, path, sizes, tolerance)
    if differs:
        return Found(SolutionStatus.MISMATCH, differs)
    broken = [e for e in path.broken if e.relative > problem.path_tolerance]
    if broken:
        more = len(broken) - 1
        also = f", and {more} more row(s) are broken" if more else ""
        return Found(
            SolutionStatus.BROKEN,
            f"between the checks {broken[0]}{also}; the path tolerance is "
            f"{problem.path_tolerance:g} of the scale",
            broken[0],
        )
    return Found(SolutionStatus.FEASIBLE, "")


def _beside(
    problem: OptimalControlProblem, controls: Array, x0: Array, sizes: Sizes
) -> Iterator[tuple[Array, Array]]:
    """Yield controls and starts that differ slightly from those given.

    If a cost or a constraint jumps, such neighbours show whether the answer is at the
    edge of the jump, so that rounding decides its value.
    """
    lower, upper = (limit[:, None] for limit in problem.control_limits)
    pattern = np.where(np.arange(controls.shape[1]) % 2, 1.0, -1.0)
    for signs in (np.ones(controls.shape[1]), pattern):
        for part in (_BESIDE, -_BESIDE):
            moved = controls + part * sizes.controls[:, None] * signs
            yield np.clip(moved, lower, upper), x0
    for part in (_BESIDE, -_BESIDE):
        yield controls, x0 + part * sizes.states


def _same_beside(
    trace: Tracer,
    plan: Plan,
    path: Path,
    here: tuple[Array, Array, Array],
    sizes: Sizes,
    tolerance: float,
) -> Found:
    """Return MISMATCH if a neighbour's path has another value, else FEASIBLE.

    Args:
        trace: The tracer of the paths.
        plan: The plan.
        path: Its path.
        here: Initial state, parameters and signals.
        sizes: Natural sizes of states, controls, cost and rows.
        tolerance: Tolerance of the comparison.
    """
    start, parameters, signals = here
    for controls, begin in _beside(trace.problem, plan.controls, start, sizes):
        moved = trace(controls, begin, parameters, signals, sizes, ends=plan.ends)
        found = _same_value(trace.shooting, path, moved, sizes, tolerance)
        if found.status is not SolutionStatus.FEASIBLE:
            return found
    return Found(SolutionStatus.FEASIBLE, "")


def _same_value(
    shooting: Shooting,
    path: Path,
    moved: Path,
    sizes: Sizes,
    tolerance: float,
) -> Found:
    """Return MISMATCH if a neighbour's path has another value."""
    problem, sense = shooting.problem, shooting.stated.sense
    allowed = tolerance * path.magnitude + _STEADY * _BESIDE * sizes.cost
    # True for NaN, too.
    changes = not abs(moved.cost - path.cost) <= allowed
    # The answer itself may break them by the tolerance.
    broken = [e for e in moved.broken if e.relative > 2 * problem.path_tolerance]
    if not (changes or broken):
        return Found(SolutionStatus.FEASIBLE, "")
    moved_cost, cost = sense * moved.cost, sense * path.cost
    what = f"the cost is {moved_cost:.6g} instead of {cost:.6g}"
    if broken:
        what = str(broken[0])
    return Found(
        SolutionStatus.MISMATCH,
        f"{ON_EDGE} {path.kinks[0]}: moved by {_BESIDE:g} of its size, {what}",
    )


def _infeasible(plan: Plan, path: Path) -> Found:
    """Return the reason why a plan is infeasible."""
    if not np.isfinite(plan.cost) or not np.isfinite(plan.violation):
        bad = next((e for e in path.broken if not np.isfinite(e.amount)), None)
        what = (
            f"{bad.name} is not a finite number at {bad.time:.4g} s"
            if bad
            else "the cost is not a finite number"
        )
        return Found(SolutionStatus.NOT_FINITE, what)
    worst = f"the best point found breaks constraints by {plan.violation:.3g} in all"
    if path.broken:
        worst += f"; {path.broken[0]}"
    return Found(
        SolutionStatus.INFEASIBLE, worst, path.broken[0] if path.broken else None
    )


def _differences(
    shooting: Shooting,
    plan: Plan,
    path: Path,
    sizes: Sizes,
    tolerance: float,
) -> str:
    """Return the differences of the finer path; empty if it agrees."""
    problem, sense = shooting.problem, shooting.stated.sense
    if not np.isfinite(path.cost):
        return "the cost of the finer path is not a finite number"
    told = []
    allowed = allowed_cost(path.magnitude, sizes.cost, tolerance)
    if abs(path.cost - plan.cost) > allowed:
        # No 0 / 0.
        share = abs(path.cost - plan.cost) / max(path.magnitude, 1e-300)
        told.append(
            f"the cost is {sense * path.cost:.6g} on the finer path, "
            f"{sense * plan.cost:.6g} on the problem's grid ({share:.2g} of its "
            f"size; {tolerance:g} is allowed)"
        )
    off, scale = end_differences(problem, plan, path)
    beyond = off - allowed_ends(scale, sizes.states, path.states[:, -1], tolerance)
    if (beyond > 0).any():
        i = int(np.argmax(beyond / np.maximum(scale, 1e-300)))
        finer, grid = (
            shooting.lowered.as_stated(states[:, -1])[i]
            for states in (path.states, plan.states)
        )
        told.append(
            f"state {problem.model.state_names[i]} ends at {finer:.6g} on "
            f"the finer path, at {grid:.6g} on the problem's grid "
            f"({off[i] / max(scale[i], 1e-300):.2g} of its size {scale[i]:.3g})"
        )
    at_end = [
        e
        for e in path.broken
        if e.constraint >= len(problem.path_constraints)
        and e.relative > problem.path_tolerance
    ]
    if at_end:
        told.append(f"on the finer path {at_end[0]}")
    return "; ".join(told)


def allowed_cost(
    magnitude: Numbers, natural: Numbers, tolerance: float = TOLERANCE
) -> Numbers:
    """Return by how much the cost of the finer path may differ from the plan's.

    Args:
        magnitude: Integral of |stage cost| plus |terminal cost|; see `Path`.
        natural: Natural size of the cost.
        tolerance: Tolerance of the comparison.
    """
    return tolerance * magnitude + _NOTHING_COSTS * natural


def allowed_ends(
    scale: Array, natural: Array, ends: Array, tolerance: float = TOLERANCE
) -> Array:
    """Return by how much the end of each state may differ on the finer path.

    Args:
        scale: Scales of the states; see `end_differences`.
        natural: Their natural sizes.
        ends: States at the end of the finer path, of the same shape as `scale`.
        tolerance: Tolerance of the comparison.
    """
    rounding = _ROUNDINGS * np.abs(ends)
    return np.asarray(tolerance * scale + _NOTHING_MOVES * natural + rounding)


def end_differences(
    problem: OptimalControlProblem, plan: Plan, path: Path
) -> tuple[Array, Array]:
    """Return how far each end state of the finer path is from the plan's.

    The states' scales are returned, too.

    For a plan that is judged interval by interval, the differences of all intervals are
    added.

    Args:
        problem: The rewritten problem (core).
        plan: The plan.
        path: Its finer path.

    Returns:
        Differences and scales, each of shape (nx,).
    """
    off = np.abs(path.states[:, -1] - plan.states[:, -1])
    if path.missed is not None:
        off = np.abs(path.missed).sum(axis=1)
    return off, end_scales(problem, path.reach)


def end_scales(problem: OptimalControlProblem, reach: Array) -> Array:
    """Return the scales of differences between states at the end.

    Args:
        problem: The rewritten problem (core).
        reach: Natural size of each state along the path, shape (nx,) or (nx, n).
    """
    lower, upper = problem.state_limits
    width = np.where(np.isfinite(upper - lower), upper - lower, 0.0)
    return np.asarray(np.maximum(reach.T, width).T)


def _whole(plan: Plan, sense: float) -> str:
    """Return the gap between whole numbers and the relaxed problem."""
    cost, relaxed = sense * plan.cost, sense * plan.relaxed_cost
    if not np.isfinite(relaxed):
        why = "the relaxed problem was not solved"
        if plan.polish_status is None:
            why = "searched, not polished, so that no relaxed cost is known"
        return f"{WHOLE_NUMBERS} {cost:.6g}; {why}"
    told = f"{WHOLE_NUMBERS} {cost:.6g}, relaxed {relaxed:.6g}"
    apart, size = sense * (cost - relaxed), abs(relaxed)
    if apart <= SAME_COST * size:
        return f"{told}: the same"
    return f"{told}: {100 * apart / size:.2g} % apart" if size else told


def _ranked(shooting: Shooting, plan: Plan, path: Path) -> Found:
    """Return whether a confirmed answer is a local optimum, with the reason."""
    if shooting.problem.integer:
        return Found(SolutionStatus.FEASIBLE, _whole(plan, shooting.stated.sense))
    touched = path.kinks
    if touched and plan.polish_status is not None:
        return Found(
            SolutionStatus.FEASIBLE,
            f"{AT_KINK} {touched[0]}, where the conditions of "
            "a smooth optimum say nothing",
            advice=without_kink(touched[0]),
        )
    point = plan.point
    # By the project's own test, whatever the solver reports.
    if point is not None and not is_stationary(point):
        point = None
    if point is None or plan.polish_status is not PolishStatus.CONVERGED:
        if plan.polish_status is None:
            advice = "polish='ipopt' would make it a local optimum"
            return Found(SolutionStatus.FEASIBLE, NOT_POLISHED, advice=advice)
        return Found(
            SolutionStatus.FEASIBLE, f"the polish {plan.polish_status.value}"
            if plan.polish_status is not PolishStatus.CONVERGED
            else NOT_STATIONARY, advice=_AGAIN,
        )  # fmt: skip
    bent = curvature(point)
    if bent is Curvature.POSITIVE or plan.settled:
        shown = "and no perturbed start led to anything better"
        if bent is Curvature.POSITIVE:
            shown = "with positive second derivatives"
        return Found(SolutionStatus.CONVERGED, f"stationary, {shown}")
    return Found(
        SolutionStatus.FEASIBLE,
        f"the polish ended at a point that is {bent.value}",
        advice=_AGAIN if bent is Curvature.NEGATIVE else "",
    )
