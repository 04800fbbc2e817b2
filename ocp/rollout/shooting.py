"""Single shooting: controls -> trajectory, cost and violation.

One stage function covers one control interval; the rollout applies it N times from the
initial state. All functions here take these arguments, in this order:

    decisions   ca.vec of the controls (nu, N), interval after interval, followed by the
                decisions about the start, one for each of problem.free_starts
    x0          initial state, shape (nx,); its decided entries are ignored
    parameters  (p, w): the model's parameters (np,), and 1 / scale of each row whose
                scale depends on the initial state; with step size control (rodas.py) w
                also has the sizes of the states and of the integrated cost / unit; the
                length of w is problem.automatic
    signals     ca.vec of (ns, nodes): node after node, shape (ns * nodes,)

In "cost / unit" the unit is a power of two by which all costs are divided, see
`Shooting.costs`.

If a rollout is not finite, its violation is infinity: such values stay in the sums
(violation.py). A state that is not finite never becomes finite again, so the states are
checked only at the end.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.pickling import Rebuilt
from swarmstart.ocp.integration.integrators import INSIDE, PARTS, integrate
from swarmstart.ocp.integration.rodas import Rate
from swarmstart.ocp.rollout.adaptive_stage import adaptive_stage, tick_of
from swarmstart.ocp.rollout.scaling import Sizes, Sizing
from swarmstart.ocp.rollout.violation import (
    SoftRows,
    infinite_unless_finite,
    path_violation,
    row_weights,
    rows_depending,
    unless_finite,
)
from swarmstart.ocp.statement.decisions import whole_symbols
from swarmstart.ocp.statement.problem import Costs, OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import Lowered, lowered
from swarmstart.ocp.system.constraints import row_excess
from swarmstart.ocp.system.model import jump_of, rate_of

_UNROLLED = 20_000
"""Largest number of operations for which a trajectory is one function without calls."""
_MOST_WRITTEN_OUT = 200_000
"""The same for a roll-out: with 400,000 it takes 7 s to look for common
subexpressions."""
Symbolic = TypeVar("Symbolic", ca.SX, ca.MX)
Values = TypeVar("Values", ca.SX, Array)
ARGUMENTS = ("decisions", "x0", "parameters", "signals")


@dataclass(frozen=True, eq=False)
class Shooting(Rebuilt):
    """Functions of one problem; each is built at its first use and then kept.

    All evaluators of a problem share one `Shooting`.

    Attributes:
        stated: The problem as it is stated; all functions are of its core.
        parts: With the stiff integrator in equal steps, the number of parts into which
            the first step after a jump of the controls is divided.
    """

    stated: OptimalControlProblem
    parts: int = PARTS

    @cached_property
    def lowered(self) -> Lowered:
        """The problem with its core; see rewrites/chain.py."""
        return lowered(self.stated)

    @property
    def problem(self) -> OptimalControlProblem:
        """The problem after all rewrites (core)."""
        return self.lowered.core

    @cached_property
    def sizing(self) -> Sizing:
        """Natural sizes for any initial state; see scaling.py."""
        return Sizing(self.problem)

    @cached_property
    def dynamics(self) -> ca.Function:
        """Function (x, u, p, s) -> x', s the model's signals."""
        return rate_of(self.problem.model)

    @cached_property
    def jump(self) -> ca.Function:
        """Function (x, u, p, s) -> the state after the end of an interval."""
        return jump_of(self.problem.model)

    @cached_property
    def jump_slopes(self) -> ca.Function:
        """(x, u, p, s) -> derivative of the state after a jump by that before it."""
        return self.jump.factory("slopes", self.jump.name_in(), ["jac:o0:i0"])

    @cached_property
    def rate_slopes(self) -> ca.Function:
        """Function (x, u, p, s) -> the derivative of the rates by the state."""
        f = self.dynamics
        return f.factory("slopes", f.name_in(), ["jac:o0:i0"])

    @cached_property
    def costs(self) -> tuple[float, Costs]:
        """Unit of the cost, and the costs divided by it."""
        return self.problem.costs()

    def automatic(self, sizes: Sizes) -> Array:
        """Return the numbers of a rollout that depend on the initial state.

        These are 1 / size of the rows whose scale the problem leaves open. With step
        size control, the sizes of the states follow, and those of the integrated cost,
        divided by the unit of the cost.
        """
        if not self.problem.is_adaptive:
            return sizes.weights
        costs = [sizes.cost / self.costs[0]] * self.problem.integrals
        return np.concatenate([sizes.weights, sizes.states, costs])

    @cached_property
    def stage_cost(self) -> ca.Function:
        """Function (x, u, p, s) -> stage cost, divided by the unit of the cost."""
        names = self.problem.symbols().values()
        return ca.Function("stage_cost", [*names], [self.costs[1].stage])

    @cached_property
    def step_cost(self) -> ca.Function:
        """Function (x, u, p, s) -> step cost, divided by the unit of the cost."""
        names = self.problem.symbols().values()
        return ca.Function("step_cost", [*names], [self.costs[1].step])

    @cached_property
    def path_values(self) -> tuple[ca.Function, ...]:
        """For each path constraint, the function (x, u, p, s) -> its expression."""
        names = [*self.problem.symbols().values()]
        return tuple(
            ca.Function("watched", names, [c.expression])
            for c in self.problem.path_constraints
        )

    @cached_property
    def rows_with_controls(self) -> tuple[list[int], ...]:
        """Rows of each path constraint that depend on the controls."""
        controls = self.problem.model.controls
        return tuple(rows_depending(c, controls) for c in self.problem.path_constraints)

    @cached_property
    def rows_of_start(self) -> tuple[list[int], ...]:
        """Rows of each path constraint that are checked at a decided start.

        They depend on a state whose start is decided, and on no control.
        """
        problem = self.problem
        decided = ca.vertcat(ca.SX(0, 1), *[
            problem.model.states[i] for one in problem.free_starts for i in one.states
        ])  # fmt: skip
        return self._without_controls(decided)

    @cached_property
    def rows_that_jump(self) -> tuple[list[int], ...]:
        """Rows of each path constraint that the end of an interval may change.

        They depend on a state that jumps, and on no control.
        """
        jumping = self.problem.model.jumping
        return self._without_controls(jumping)

    def _without_controls(self, symbols: ca.SX) -> tuple[list[int], ...]:
        """Rows of each path constraint that depend on symbols, and on no control."""
        return tuple(
            [row for row in rows_depending(c, symbols) if row not in controlled]
            for c, controlled in zip(
                self.problem.path_constraints, self.rows_with_controls, strict=True
            )
        )

    @cached_property
    def rows_settled(self) -> tuple[list[int], ...]:
        """Rows of each path constraint that are constant within an interval.

        They depend on no signal, and only on states without a rate. If they depend on
        controls, they are checked at the start of the interval; if they depend on
        decisions about the start and do not jump, at the start of the horizon.
        """
        problem, model = self.problem, self.problem.model
        if model.is_discrete:
            return tuple([] for _ in problem.path_constraints)
        moving = ca.vertcat(
            problem.signals,
            *[model.states[i] for i in range(model.nx) if not model.ode[i].is_zero()],
        )
        return tuple(
            [row for row in (*controlled, *[r for r in started if r not in jumping])
             if row not in rows_depending(c, moving)]
            for c, controlled, started, jumping in zip(
                problem.path_constraints, self.rows_with_controls, self.rows_of_start,
                self.rows_that_jump, strict=True,
            )
        )  # fmt: skip

    @cached_property
    def soft(self) -> SoftRows | None:
        """Rows of the soft constraints; None without them."""
        return SoftRows(self.problem) if self.problem.soft else None

    @cached_property
    def stage(self) -> ca.Function:
        """Function of one control interval; whole numbers are rounded in it.

        (x, u, p, S) -> (states, cost, violation). p has the model's parameters, then
        the numbers that `automatic` returns. S are the signals at the nodes of the
        interval, shape (ns, checks + 1); the states are those after each check, shape
        (nx, checks). With step size control, it is a function of calls, not an SX
        function.
        """
        if self.problem.is_adaptive:
            return adaptive_stage(self.problem, self.tick, _closing(self))
        return _stage(self)

    @cached_property
    def stage_without_path(self) -> ca.Function:
        """Stage for a rollout: (x, u, p, S) -> (x after, cost, violation).

        It returns only the last of the states. With step size control, the states that
        its steps reach at the checks, and the integrals, are further arguments.
        """
        whole = _closing(self) if self.problem.is_adaptive else self.stage
        arguments = [
            ca.SX.sym(whole.name_in(i), *whole.size_in(i)) for i in range(whole.n_in())
        ]
        states, cost, violation = whole(*arguments)
        return ca.Function(
            "stage_without_path", arguments, ca.cse([states[:, -1], cost, violation])
        )

    @property
    def tick(self) -> ca.Function:
        """Function (z, u, p, s) -> z after one trial step of the step size control.

        The step may be accepted or not. z has the states and integrals, their largest
        absolute values so far, the time left until the next check, and the step size; s
        are the signals at the two checks between which the step lies.
        """
        return self.tick_to(self.problem.integrator_tolerance or 0.0)

    def tick_to(self, tolerance: float) -> ca.Function:
        """Return the function `tick` for another tolerance."""
        if tolerance not in self._ticks:
            self._ticks[tolerance] = tick_of(
                self.problem, self.rate, tolerance=tolerance
            )
        return self._ticks[tolerance]

    @cached_property
    def _ticks(self) -> dict[float, ca.Function]:
        """Functions `tick` by their tolerances."""
        return {}

    @cached_property
    def begin(self) -> ca.Function:
        """Function (x, p, s) -> (cost, violation) at the start of the horizon.

        p is as in `stage`. The violation is that of the rows that are checked at a
        decided start.
        """
        return _begin(self)

    @cached_property
    def has_begin(self) -> bool:
        """True if the start adds a cost or a violation to a rollout."""
        return any(self.rows_of_start) or not self.problem.initial_cost.is_zero()

    @cached_property
    def terminal(self) -> ca.Function:
        """Function (x, p, s) -> (cost, violation) at the end of the horizon.

        p is as in `stage`. The violation is infinite if a state is not finite.
        """
        return _terminal(self.problem)

    @cached_property
    def rollout(self) -> ca.Function:
        """Function (decisions, x0, parameters, signals) -> (cost, violation)."""
        # The stage with step size control is made of calls, which SX cannot hold.
        is_called = self.problem.is_adaptive
        stage = self.stage if is_called else self.stage_without_path
        operations = stage.n_instructions() * self.problem.intervals
        if is_called or operations > _MOST_WRITTEN_OUT:
            arguments, outputs = _rolled(self, stage, ca.MX)
            return _named_rollout(arguments, outputs)
        given, found = _rolled(self, stage, ca.SX)
        return _named_rollout(given, ca.cse(found))

    @cached_property
    def trajectory(self) -> ca.Function:
        """Function (decisions, x0, parameters, signals) -> (states, outside).

        The states are at the nodes, shape (nx, nodes). `outside` is the largest scaled
        excess of the rows without controls, at the start of the horizon.
        """
        return _trajectory(self)

    def cost_at_begin(self, x: ca.SX, u: ca.SX, p: ca.SX, s: ca.SX) -> ca.SX:
        """Return what an interval costs at its start, divided by the unit of the cost.

        This is the step cost and, with the quadrature "left", the stage cost times dt.
        """
        problem, cost = self.problem, ca.SX(0)
        if problem.quadrature == "left":
            cost = problem.dt * self.stage_cost(x, u, p, s)
        if not problem.step_cost.is_zero():
            cost += self.step_cost(x, u, p, s)
        return cost

    def check_step(
        self,
        x: ca.SX,
        u: ca.SX,
        p: ca.SX,
        ends: tuple[ca.SX, ca.SX],
        *,
        after_jump: bool = True,
    ) -> tuple[ca.SX, ca.SX]:
        """Return the state at the next check, and the integral of the cost until then.

        The integral is divided by the unit of the cost.

        Args:
            x: State at the present check.
            u: Controls, which are held.
            p: Parameters.
            ends: Signals at the present and at the next check.
            after_jump: Whether the step begins an interval, so that controls jump.

        The steps are `substeps` equal ones, regardless of the problem's tolerance.
        """
        problem, duration = self.problem, self.problem.dt / self.problem.checks
        # Nothing moves within the interval, and nothing is integrated.
        if problem.model.is_discrete and problem.quadrature != "integral":
            return x, ca.SX(0)
        # The integral is one more state.
        begun = x if problem.quadrature != "integral" else ca.vertcat(x, 0)
        both = integrate(
            problem.integrator,
            self.rate(u, p, ends),
            begun,
            start=0.0,
            duration=duration,
            steps=problem.substeps,
            after_jump=after_jump,
            parts=self.parts,
        )
        if problem.quadrature != "integral":
            return both, ca.SX(0)
        return both[:-1], both[-1]

    def signals_at(self, ends: tuple[Values, Values], part: float) -> Values:
        """Return the signals at a fraction of a step, linear between the step's ends.

        The time is read a little inside of both ends, so that a function of time that
        jumps there has the value that it has in between. On average over a step the
        time is not moved, so the error of a smooth function is far below the error of
        the step.

        Args:
            ends: Signals at both ends, shape (ns, 1), or (ns, n) of arrays.
            part: Fraction from 0 at the first end to 1 at the second.
        """
        start, end = ends
        s: Values = start + part * (end - start)
        row = self.lowered.time_row
        if row is not None:
            s[row] += INSIDE * (1 - 2 * part) * (end[row] - start[row])
        return s

    def rate(self, u: ca.SX, p: ca.SX, ends: tuple[ca.SX, ca.SX]) -> Rate:
        """Return the rate r(t, y) of the integrated quantities y over a check.

        y is the state, followed by the integral of cost / unit if the stage cost is
        integrated.

        Args:
            u: Controls, which are held.
            p: Parameters, shape (np, 1).
            ends: Signals at both ends of the check.
        """
        problem, f = self.problem, self.dynamics
        duration, ns = problem.dt / problem.checks, problem.model.ns

        def rate(t: float, y: ca.SX) -> ca.SX:
            s = self.signals_at(ends, t / duration)
            if problem.quadrature != "integral":
                return f(y, u, p, s[:ns])
            return ca.vertcat(f(y[:-1], u, p, s[:ns]), self.stage_cost(y[:-1], u, p, s))

        return rate


def shooting_of(problem: OptimalControlProblem | Shooting) -> Shooting:
    """Return the functions of a problem's core, which the problem keeps.

    Args:
        problem: The problem; or its functions, which are then returned.
    """
    if isinstance(problem, Shooting):
        return problem
    if "functions" not in problem.kept:
        problem.kept["functions"] = Shooting(problem)
    kept: Shooting = problem.kept["functions"]
    return kept


def _stage(shooting: Shooting) -> ca.Function:
    def steps(
        k: int, x: ca.SX, u: ca.SX, p: ca.SX, ends: tuple[ca.SX, ca.SX]
    ) -> tuple[ca.SX, ca.SX]:
        return shooting.check_step(x, u, p, ends, after_jump=k == 0)

    return _closed(shooting, steps, [])


def _closing(shooting: Shooting) -> ca.Function:
    """Return the stage for states that other steps reach at the checks.

    These states, shape (nx, checks), and the integrals over the interval are its last
    arguments.
    """
    problem = shooting.problem
    reached = ca.SX.sym("reached", problem.model.nx, problem.checks)
    integrals = ca.SX.sym("integrals", problem.integrals)

    def steps(
        k: int, x: ca.SX, u: ca.SX, p: ca.SX, ends: tuple[ca.SX, ca.SX]
    ) -> tuple[ca.SX, ca.SX]:
        del x, u, p, ends
        # They are those of the whole interval, so they are counted once.
        spent = integrals if k == 0 and problem.integrals else ca.SX(0)
        return reached[:, k], spent

    return _closed(shooting, steps, [reached, integrals])


Steps = Callable[[int, ca.SX, ca.SX, ca.SX, tuple[ca.SX, ca.SX]], tuple[ca.SX, ca.SX]]
"""(check, x, u, p, signals at both ends of the check) -> (x after it, integrals)."""


def _closed(shooting: Shooting, steps: Steps, more: list[ca.SX]) -> ca.Function:
    """Return the stage for given steps."""
    problem = shooting.problem
    model = problem.model
    x, given = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    u = whole_symbols(given, problem.integer, problem.control_limits)
    p, signals = (
        ca.SX.sym("p", model.np + problem.automatic),
        ca.SX.sym("s", problem.ns, problem.checks + 1),
    )
    parameters, automatic = ca.vertsplit(p, [0, model.np, p.numel()])
    weights = row_weights(problem, automatic)
    cost = shooting.cost_at_begin(x, u, parameters, signals[:, 0])
    violation, state, states = ca.SX(0), x, []
    soft, e = shooting.soft, ca.SX(0, 1)
    if soft is not None:
        e = soft.excess(soft.values(x, u, parameters, signals[:, 0]))
    for k in range(problem.checks):
        ends = signals[:, k], signals[:, k + 1]
        reached, spent = steps(k, state, u, parameters, ends)
        after = reached
        if model.jumps and k == problem.checks - 1:
            after = shooting.jump(reached, u, parameters, ends[1][: model.ns])
        violation += _check_violation(
            shooting, (state, reached, after), (u, parameters, *ends), weights, k
        )
        if soft is not None:
            e = soft.grown(e, (reached, after), (u, parameters, ends[1]))
        cost, state = cost + spent, after
        states.append(after)
    if problem.quadrature == "right":
        cost += problem.dt * shooting.stage_cost(state, u, parameters, signals[:, -1])
    # The power of two comes last, so that it rounds nothing (expressions.py).
    cost = shooting.costs[0] * cost
    if soft is not None:
        cost += problem.dt * soft.price(x, parameters, signals[:, 0], e)
    return ca.Function(
        "stage",
        [x, given, p, signals, *more],
        ca.cse([ca.horzcat(*states), cost, violation]),
        ["x", "u", "p", "signals", *("reached", "integrals")[: len(more)]],
        ["states", "cost", "violation"],
    )


def _check_violation(
    shooting: Shooting,
    states: tuple[ca.SX, ca.SX, ca.SX],
    known: tuple[ca.SX, ca.SX, ca.SX, ca.SX],
    weights: list[ca.SX],
    k: int,
) -> ca.SX:
    """Return the violation of the path constraints over one check of an interval.

    Args:
        shooting: The problem's functions.
        states: States at the start and end of the check, and after the interval's end.
        known: Controls, parameters, signals at the start and at the end.
        weights: 1 / scale of each constraint's rows.
        k: Number of the check in the interval.
    """
    problem, (before, reached, after), (u, p, s0, s1) = shooting.problem, states, known
    violation = ca.SX(0)
    last, discrete = k == problem.checks - 1, problem.model.is_discrete
    for number, constraint in enumerate(problem.path_constraints):
        value, weight = shooting.path_values[number], weights[number]
        start = value(before, u, p, s0)
        broken = ca.SX(0)
        if not discrete:  # In discrete time only the interval's end moves the state.
            excess = constraint.excess(start, value(reached, u, p, s1))
            broken = path_violation(constraint, excess, weight)
        # The control jumps at the interval's start, where its rows are checked, too.
        rows = shooting.rows_with_controls[number] if k == 0 else []
        if rows:
            excess = constraint.excess(start, start)[rows]
            broken += path_violation(constraint, excess, weight[rows])
        rows = shooting.rows_that_jump[number] if last else []
        if rows:
            end = value(after, u, p, s1)
            # In discrete time the jump is the motion, which a segment has to cover.
            excess = constraint.excess(start if discrete else end, end)[rows]
            broken += path_violation(constraint, excess, weight[rows])
        violation += broken
    return violation


def _begin(shooting: Shooting) -> ca.Function:
    problem = shooting.problem
    symbols, automatic = problem.symbols(), ca.SX.sym("w", problem.automatic)
    violation = ca.SX(0)
    for constraint, weight, rows in zip(
        problem.path_constraints,
        row_weights(problem, automatic)[: len(problem.path_constraints)],
        shooting.rows_of_start,
        strict=True,
    ):
        if rows:
            excess = constraint.excess(constraint.expression, constraint.expression)
            violation += path_violation(constraint, excess[rows], weight[rows])
    return ca.Function(
        "begin",
        [
            symbols["states"],
            ca.vertcat(symbols["parameters"], automatic),
            symbols["signals"],
        ],
        [problem.initial_cost, violation],
    )


def _terminal(problem: OptimalControlProblem) -> ca.Function:
    symbols, count = problem.symbols(), problem.automatic
    automatic = ca.SX.sym("w", count)
    weights = row_weights(problem, automatic)[len(problem.path_constraints) :]
    # If one state is NaN or infinite, so is the sum.
    violation = infinite_unless_finite(ca.sum1(symbols["states"]))
    for constraint, weight in zip(problem.terminal_constraints, weights, strict=True):
        excess = constraint.excess(constraint.expression, constraint.expression)
        violation += path_violation(constraint, excess, weight)
    return ca.Function(
        "terminal",
        [
            symbols["states"],
            ca.vertcat(symbols["parameters"], automatic),
            symbols["signals"],
        ],
        [problem.terminal_cost, violation],
        ["x", "p", "s"],
        ["cost", "violation"],
    )


def _trajectory(shooting: Shooting) -> ca.Function:
    problem, interval = shooting.problem, shooting.stage
    model, checks, N = problem.model, problem.checks, problem.intervals
    step = (
        _followed(interval, ca.MX)
        if problem.is_adaptive
        else _followed(interval, ca.SX)
    )
    arguments = [
        ca.MX.sym(name, rows)
        for name, rows in zip(ARGUMENTS, _sizes(problem), strict=True)
    ]
    decisions, given, parameters, flat = arguments
    signals = ca.reshape(flat, problem.ns, problem.nodes)
    # The node between two intervals belongs to both.
    columns = [k * checks + c for k in range(N) for c in range(checks + 1)]
    controls, x0 = decisions[: model.nu * N], _started(shooting, given, decisions)
    _, states = step.mapaccum("steps", N)(
        x0,
        ca.reshape(controls, model.nu, N),
        ca.repmat(parameters, 1, N),
        signals[:, columns],
    )
    outputs = [
        ca.horzcat(x0, states),
        _outside(shooting)(x0, parameters, signals[:, 0]),
    ]
    names = ["states", "outside"]
    whole = ca.Function("trajectory", arguments, outputs, list(ARGUMENTS), names)
    if problem.is_adaptive or step.n_instructions() * N > _UNROLLED:
        return whole
    return whole.expand()  # Faster calls, but a size that grows with N.


def _followed(interval: ca.Function, kind: type[Symbolic]) -> ca.Function:
    """Return the function (x, u, p, S) -> (last of the states, states) of a stage."""
    x, u, p, s = (kind.sym(n, *interval.size_in(i)) for i, n in enumerate("xups"))
    after = interval(x, u, p, s)[0]
    return ca.Function("step", [x, u, p, s], [after[:, -1], after])


def _started(shooting: Shooting, x0: Symbolic, decisions: Symbolic) -> Symbolic:
    """Return the state at the start, including the decisions about it."""
    problem, decided = shooting.problem, shooting.problem.start_decisions
    if not decided:
        return x0
    first = problem.model.nu * problem.intervals
    return ca.vertcat(*[
        decisions[first + decided[i]] if i in decided else x0[i]
        for i in range(problem.model.nx)
    ])  # fmt: skip


def _outside(shooting: Shooting) -> ca.Function:
    """Return (x, p, s) -> largest scaled excess of rows without any decision."""
    problem = shooting.problem
    symbols, automatic = problem.symbols(), ca.SX.sym("w", problem.automatic)
    worst = ca.SX(0)
    weights = row_weights(problem, automatic)
    for constraint, weight, with_controls, decided in zip(
        problem.path_constraints,
        weights,
        shooting.rows_with_controls,
        shooting.rows_of_start,
        strict=False,  # Weights of terminal constraints follow.
    ):
        excess = row_excess(constraint.rows(constraint.expression))
        for row in range(excess.numel()):
            if row not in with_controls and row not in decided:
                worst = ca.fmax(worst, excess[row] * weight[row])
    return ca.Function(
        "outside",
        [
            symbols["states"],
            ca.vertcat(symbols["parameters"], automatic),
            symbols["signals"],
        ],
        [worst],
    )


def _sizes(problem: OptimalControlProblem) -> tuple[int, int, int, int]:
    """Return the number of entries of each of ARGUMENTS."""
    model = problem.model
    return (
        problem.decisions,
        model.nx,
        model.np + problem.automatic,
        problem.ns * problem.nodes,
    )


def _named_rollout(arguments: list[Symbolic], outputs: list[Symbolic]) -> ca.Function:
    names = ["cost", "violation"]
    return ca.Function("rollout", arguments, outputs, list(ARGUMENTS), names)


def _rolled(
    shooting: Shooting, interval: ca.Function, kind: type[Symbolic]
) -> tuple[list[Symbolic], list[Symbolic]]:
    """Return the arguments, and cost and violation as expressions of them."""
    problem = shooting.problem
    model, checks = problem.model, problem.checks
    arguments = [
        kind.sym(name, rows)
        for name, rows in zip(ARGUMENTS, _sizes(problem), strict=True)
    ]
    decisions, x0, p, flat_signals = arguments
    u = ca.reshape(
        decisions[: model.nu * problem.intervals], model.nu, problem.intervals
    )
    signals = ca.reshape(flat_signals, problem.ns, problem.nodes)

    x, cost, violation = _started(shooting, x0, decisions), kind(0), kind(0)
    if shooting.has_begin:
        cost, violation = shooting.begin(x, p, signals[:, 0])
    for k in range(problem.intervals):
        known = signals[:, k * checks : (k + 1) * checks + 1]
        after, spent, broken = interval(x, u[:, k], p, known)
        x = after[:, -1]
        cost, violation = cost + spent, violation + broken
    end_cost, end_violation = shooting.terminal(x, p, signals[:, -1])
    cost, violation = cost + end_cost, violation + end_violation
    return arguments, [cost, unless_finite(cost, violation)]
