"""Path of an answer, integrated ten times finer, with its constraints evaluated.

A problem's constraints are required at its nodes only; the path is the actual motion of
the model. It is integrated by the classical Runge-Kutta method (by RODAS4 if the
problem's integrator is "stiff") with ten steps for each step of the problem. The
lengths of these fine steps differ: equal fine steps may miss a ripple or a pulse whose
period divides the problem's steps, as the problem's steps do. All constraints are
evaluated at the start of each fine step, with the control of that step, and at the end
of every interval. If the problem uses step size control, the steps between these points
have their own lengths, at a tolerance ten times smaller.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.integration.integrators import integrate, verifying_integrator
from swarmstart.ocp.integration.rodas import (
    FIRST,
    Rate,
    column_at_check,
    finer,
    follower,
)
from swarmstart.ocp.rollout.checking import Checker, Excess, Points
from swarmstart.ocp.rollout.kinks import kinks_of
from swarmstart.ocp.rollout.scaling import Sizes, with_a_state_alone
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.rollout.violation import SoftRows
from swarmstart.ocp.statement.problem import OptimalControlProblem

FINER = 10
UNEVEN = 0.5
"""Range of the fine steps' lengths, relative to their mean."""
GOLDEN = (5**0.5 - 1) / 2
"""The golden section, which no fraction with a small denominator comes near."""
_SHOWN = 5
"""Number of broken rows that a summary shows."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Path:
    """A finely integrated path with the constraints that it breaks.

    Attributes:
        times: Times of the fine steps, shape (n,) [s].
        states: States at these times, shape (nx, n): the problem's own, then those that
            rewrites add, such as a free end time.
        controls: Controls held from each time to the next, shape (nu, n - 1).
        outputs: Outputs of the model at these times, with the control held from each
            time on, shape (ny, n).
        cost: Cost along the path; multiplied by -1 if it is maximised.
        magnitude: Integral of |stage cost| plus |terminal cost|. If a state stands
            alone in a cost, as x in x + y^2, the cost's value at the start is
            subtracted first.
        outside: Constraints that the start breaks.
        broken: The worst excess of each constraint row, the worst first.
        kinks: Names of the kinks and jumps that the path touches.
        reach: Natural size of each state along the path, shape (nx,): its range; for a
            state that the ends of intervals set, the range of the values that are set.
        not_finite: (time, name of the state) of the first state that is not finite;
            None: all are finite.
        missed: By how much each interval misses the state from which the next one
            begins, shape (nx, N), if each interval begins at a given state; None: the
            intervals are one path.
    """

    times: Array
    states: Array
    controls: Array
    outputs: Array
    cost: float
    magnitude: float
    outside: tuple[Excess, ...]
    broken: tuple[Excess, ...]
    kinks: tuple[str, ...]
    reach: Array
    not_finite: tuple[float, str] | None
    missed: Array | None = None

    def __repr__(self) -> str:
        """Return the cost and the broken constraints in a few lines."""
        broken = [f"  {excess}" for excess in self.broken[:_SHOWN]]
        head = f"Path of {self.times.size} points over {self.times[-1]:g} s"
        return "\n".join([f"{head}: cost {self.cost:.9g}", *broken])


class Tracer:
    """Integrates the path of control sequences of one problem; compiled once.

    Attributes:
        problem: The problem.
        shooting: Functions of the problem.
        checker: Measures the problem's constraints.
        steps: Number of fine steps in an interval.
        lengths: Lengths of these steps, shape (steps,) [s].
        step: ((x, cost, |cost|), u, p, s before, s after, length) -> (x, cost, |cost|)
            after a fine step, with s the signals; with step size control x has further
            entries.
        kinks: Switches of the problem's expressions.
        stage_cost: Function (x, u, p, s) -> stage cost.
        step_cost: Function (x, u, p, s) -> step cost.
        end_cost: Function (x, p, s) -> terminal cost.
        first_cost: Function (x, p, s) -> initial cost.
        moved: Whether a state stands alone, as x in x + y^2, in the stage cost, and in
            the terminal cost, shape (2,).
    """

    def __init__(
        self, problem: OptimalControlProblem | Shooting, checker: Checker | None = None
    ) -> None:
        """Compile the fine integration.

        Args:
            problem: The problem, or its compiled functions.
            checker: Checker of the problem's constraints; None: a new one.
        """
        self.shooting = shooting = shooting_of(problem)
        self.checker = checker or Checker(shooting)
        self.problem = problem = shooting.problem
        self.steps = problem.checks * problem.substeps * FINER
        self._at_once = self.steps
        if not problem.model.jumps:
            self._at_once *= problem.intervals  # The whole path is one call.
        fine = _adaptive_step if problem.is_adaptive else _fine_step
        self.step = fine(shooting)
        self._fine = self.step.mapaccum("path", self._at_once)
        self.lengths = problem.dt * uneven_lengths(problem.checks, self.steps)
        names = [*problem.symbols().values()]
        outputs = ca.vertcat(ca.SX(0, 1), *problem.model.outputs.values())
        self._outputs = ca.Function("outputs", names, [outputs])
        self.stage_cost = ca.Function("stage_cost", names, [problem.stage_cost])
        self.step_cost = ca.Function("step_cost", names, [problem.step_cost])
        ends = [names[0], names[2], names[3]]
        self.kinks = kinks_of(problem)
        self.end_cost = ca.Function("end_cost", ends, [problem.terminal_cost])
        self.first_cost = ca.Function("first_cost", ends, [problem.initial_cost])
        costs = ca.vertcat(problem.stage_cost, problem.terminal_cost)
        self.moved = with_a_state_alone(costs, problem)

    def __call__(
        self,
        controls: Array,
        x0: Array,
        p: Array,
        signals: Array,
        sizes: Sizes,
        *,
        ends: Array | None = None,
    ) -> Path:
        """Return the path of controls.

        Args:
            controls: Controls, shape (nu, N).
            x0: Initial state, shape (nx,).
            p: Parameters, shape (np,).
            signals: At the nodes, shape (ns, nodes).
            sizes: Natural sizes of states, controls, cost and rows.
            ends: States between the intervals, shape (nx, N + 1), from which each
                interval begins anew; None: each begins where the last one ends.
        """
        problem, m = self.problem, self.steps
        u = np.repeat(controls, m, axis=1)
        times = self.times
        s = signals_between(problem, signals, times)
        # With a free end time the core's horizon is 1, and its rates are per horizon.
        times = times * (self.shooting.lowered.end_time(x0) / problem.length)
        states, before, sums = self._followed(x0, u, self._shared(p, sizes), s, ends)
        if problem.clock:
            times = states[problem.model.state_names.index(problem.clock)]
        at = [states[:, ::m], s[:, ::m]]
        if problem.quadrature != "integral":
            side = slice(0, -1) if problem.quadrature == "left" else slice(1, None)
            rates = self._values(self.stage_cost, at, side, controls, p)
            origin = rates[0] if self.moved[0] else 0.0
            sums = problem.dt * np.array([rates.sum(), np.abs(rates - origin).sum()])
        elif self.moved[0]:
            sums[1] = self._size_of_stages(states, u, p, s)
        if self.shooting.soft is not None:
            sums = sums + self._softened(
                self.shooting.soft, states, before, (u, s, controls), p
            )
        single = self._values(self.step_cost, at, slice(0, -1), controls, p)
        first = float(self.first_cost(x0, p, s[:, 0]))
        end = float(self.end_cost(states[:, -1], p, s[:, -1]))
        outside = self.checker.at_start(x0, p, s[:, 0], lambda: sizes)
        points = Points(
            np.concatenate([times[:-1], times[m::m]]),
            np.hstack([states[:, :-1], before]),
            np.hstack([u, controls]),
            np.hstack([s[:, :-1], s[:, m::m]]),
        )
        last = Points(times[-1:], states[:, -1:], controls[:, -1:], s[:, -1:])
        broken = self.checker.along(
            _in_time(points),
            p,
            sizes,
            outside=outside,
            left=last if problem.model.jumps else None,
        )
        broken += self.checker.at_end(states[:, -1], p, s[:, -1], sizes, times[-1])
        return Path(
            times=times,
            states=states,
            controls=u,
            outputs=self._output_values(states, u, p, s),
            cost=float(sums[0] + single.sum() + first + end),
            magnitude=float(
                sums[1]
                + np.abs(single).sum()
                + abs(first)
                + abs(end - float(self.moved[1] and self.end_cost(x0, p, s[:, -1])))
            ),
            outside=tuple(outside),
            kinks=self._touched(Points(times, states, controls, s), before, p, sizes),
            reach=self._reach(states, before, controls, p, s[:, m::m]),
            broken=tuple(sorted(broken, key=lambda e: -e.relative)),
            not_finite=first_not_finite(problem, times, states),
            missed=None if ends is None else before - ends[:, 1:],
        )

    @cached_property
    def _fine_interval(self) -> ca.Function:
        """The fine integration of one interval."""
        return self.step.mapaccum("interval", self.steps)

    @property
    def times(self) -> Array:
        """Times of the fine steps, the problem's nodes among them; shape (n,) [s]."""
        problem, count = self.problem, self.steps // self.problem.checks
        parts = np.tile(self.lengths, problem.intervals).reshape(-1, count)
        since = np.cumsum(parts, axis=1) - parts  # Since the node before.
        times = (problem.times[:-1, None] + since).ravel()
        return np.append(times, problem.times[-1])

    def _shared(self, p: Array, sizes: Sizes) -> Array:
        """Return the arguments common to all fine steps: p, or as `_adaptive_step`."""
        if not self.problem.is_adaptive:
            return p
        return np.concatenate([p, sizes.states, [sizes.cost, sizes.cost, 1.0]])

    def _followed(
        self, x0: Array, u: Array, p: Array, s: Array, ends: Array | None
    ) -> tuple[Array, Array, Array]:
        """Return the states, those before each interval's end changes them, and sums.

        The sums are the integrals of the cost and of its absolute value.

        Args:
            x0: Initial state, shape (nx,).
            u: Controls of each fine step.
            p: As `_shared` returns it.
            s: Signals along the path.
            ends: States between the intervals; see `__call__`.
        """
        m, nx = self.steps, x0.size
        y, found, before = np.append(x0, [0.0, 0.0]), [x0[:, None]], []
        if self.problem.is_adaptive:
            y = np.concatenate([y, np.abs(y), [0.0, 1.0]])
        at_once, fine = self._at_once, self._fine
        if ends is not None and at_once != m:
            at_once, fine = m, self._fine_interval
        lengths = np.tile(self.lengths, at_once // m)[None, :]
        for first in range(0, u.shape[1], at_once):
            part = slice(first, first + at_once)
            many = np.tile(p[:, None], (1, at_once))
            if self.problem.is_adaptive:
                many[-1, ::m] = FIRST  # The controls jump.
            after = slice(first + 1, first + at_once + 1)
            known = (u[:, part], many, s[:, part], s[:, after], lengths)
            both = np.array(fine(y, *known))
            y = both[:, -1]
            # A copy, since the state after the jump is written into the same array
            # below.
            before.append(both[:nx, m - 1 :: m].copy())
            if self.problem.model.jumps:
                there = s[: self.problem.model.ns, first + at_once]
                own = p[: self.problem.model.np]
                jumped = self.shooting.jump(y[:nx], u[:, first], own, there)
                y[:nx] = both[:nx, -1] = np.array(jumped).ravel()
            if ends is not None:
                y[:nx] = both[:nx, -1] = ends[:, first // m + 1]
            found.append(both[:nx])
        return np.hstack(found), np.hstack(before), y[nx : nx + 2]

    def _size_of_stages(self, states: Array, u: Array, p: Array, s: Array) -> float:
        """Return the integral of |stage cost - its value at the start|.

        Args:
            states: Along the path, shape (nx, n).
            u: Controls of each fine step.
            p: Parameters, shape (np,).
            s: Signals along the path.
        """
        many = np.tile(p[:, None], (1, u.shape[1]))
        begins, ends = (
            np.array(self.stage_cost(states[:, side], u, many, s[:, side])).ravel()
            for side in (slice(0, -1), slice(1, None))
        )
        lengths = np.tile(self.lengths, self.problem.intervals)
        both = np.abs(begins - begins[0]) + np.abs(ends - begins[0])
        return float(both @ lengths / 2)

    def _reach(
        self, states: Array, before: Array, controls: Array, p: Array, s: Array
    ) -> Array:
        """Return the natural sizes of the states; see `Path`.

        A state that keeps the value of an expression at the end of a phase may keep a
        zero, up to rounding. It is judged by how far the expression can vary.
        """
        model = self.problem.model
        reach: Array = np.ptp(states, axis=1)
        if not model.jumps:
            return reach
        many = np.tile(p[: model.np, None], (1, before.shape[1]))
        known = before, controls, many, s[: model.ns]
        slopes = np.abs(np.array(self.shooting.jump_slopes(*known)))
        slopes = slopes.reshape(model.nx, -1, model.nx)
        # A state's own slope is 1 where the end of an interval leaves it as it is.
        own = np.arange(model.nx)
        slopes[own, :, own] = 0.0
        with np.errstate(invalid="ignore"):
            written = np.nan_to_num(slopes @ reach, nan=0.0, posinf=0.0)
        return np.asarray(np.maximum(reach, written.max(axis=1, initial=0.0)))

    def _output_values(self, states: Array, u: Array, p: Array, s: Array) -> Array:
        """Return the outputs along the path, shape (ny, n)."""
        n = states.shape[1]
        if not self.problem.model.outputs:
            return np.empty((0, n))
        held = np.hstack([u, u[:, -1:]])  # No control begins at the last time.
        many = np.tile(p[:, None], (1, n))
        return np.array(self._outputs(states, held, many, s))

    def _softened(
        self,
        soft: SoftRows,
        states: Array,
        before: Array,
        known: tuple[Array, Array, Array],
        p: Array,
    ) -> Array:
        """Return the cost of broken soft constraints, and its absolute value.

        Args:
            soft: The soft constraints.
            states: Along the path, shape (nx, n).
            before: States before each interval's end changes them, shape (nx, N).
            known: Controls of each fine step, signals along the path, and controls of
                each interval.
            p: Parameters, shape (np,).
        """
        (u, s, controls), m = known, self.steps
        many, each = (
            np.tile(p[:, None], (1, n)) for n in (u.shape[1], before.shape[1])
        )
        e = soft.excesses_along(
            (states[:, :-1], u, many, s[:, :-1]),
            (before, controls, each, s[:, m::m]),
            states[:, m::m],
        )
        rate = np.array(soft.price(states[:, :-1:m], each, s[:, :-1:m], e))
        # Such costs are never negative, so their absolute values are the same.
        return np.full(2, self.problem.dt * rate.sum())

    def _touched(
        self, path: Points, before: Array, p: Array, sizes: Sizes
    ) -> tuple[str, ...]:
        """Return the kinks that the path touches, with both ends of each interval.

        Args:
            path: All points of the path, with one column of controls for each interval.
            before: States before each interval's end changes them, shape (nx, N).
            p: Parameters, shape (np,).
            sizes: The sizes.
        """
        states, controls = path.states, path.controls
        if not self.kinks.names or not np.isfinite(states).all():
            return ()
        m, N = self.steps, self.problem.intervals
        columns = (np.arange(N)[:, None] * m + np.arange(m + 1)).ravel()
        seen = states[:, columns]
        seen[:, m :: m + 1] = before  # An interval ends before its jump.
        u = np.repeat(controls, m + 1, axis=1)
        many = np.tile(p[:, None], (1, columns.size))
        sides, reach = self.kinks.sides(
            seen, u, many, path.signals[:, columns],
            *(np.tile(v[:, None], (1, columns.size))
              for v in (sizes.states, sizes.controls)),
        )  # fmt: skip
        return self.kinks.touched(np.array(sides), np.array(reach), N)

    def _values(
        self,
        cost: ca.Function,
        at: list[Array],
        side: slice,
        controls: Array,
        p: Array,
    ) -> Array:
        """Return a cost at one end of each interval, shape (N,)."""
        many = np.tile(p[:, None], (1, controls.shape[1]))
        states, signals = (values[:, side] for values in at)
        return np.array(cost(states, controls, many, signals)).ravel()


def first_not_finite(
    problem: OptimalControlProblem, times: Array, states: Array
) -> tuple[float, str] | None:
    """Return (time, name of the state) of the first number that is not finite."""
    bad = ~np.isfinite(states)
    if not bad.any():
        return None
    column = int(np.argmax(bad.any(axis=0)))
    row = int(np.argmax(bad[:, column]))
    return float(times[column]), problem.model.state_names[row]


def uneven_lengths(checks: int, steps: int) -> Array:
    """Return the lengths of the fine steps of an interval, which sum up to 1.

    They are the same on all machines, and between two checks their mean is 1 / steps.

    Args:
        checks: Number of parts of an interval that end at a check.
        steps: Number of fine steps.
    """
    # Multiples of the golden section are spread more evenly than those of any other
    # number, and no run of them repeats.
    spread = np.arange(1, steps // 2 + 1) * GOLDEN % 1
    parts = (1 + UNEVEN * (spread - 0.5)).reshape(checks, -1)
    # Backwards again, so that the middle between two checks is looked at: a limit is
    # cut there most often.
    parts = np.hstack([parts, parts[:, ::-1]])
    return np.ravel(parts / parts.sum(axis=1, keepdims=True) / checks)


def _fine_step(shooting: Shooting) -> ca.Function:
    """Return ((x, cost, |cost|), u, p, s before, s after, h) -> the same after h."""
    model = shooting.problem.model
    y, p = ca.SX.sym("y", model.nx + 2), ca.SX.sym("p", model.np)
    rate, *known = _fine_rate(shooting, p)
    method = verifying_integrator(shooting.problem.integrator)
    stepped = integrate(method, rate, y, start=0.0, duration=1.0, steps=1)
    u, *rest = known
    return ca.Function("fine", [y, u, p, *rest], ca.cse([stepped]))


def _fine_rate(shooting: Shooting, p: ca.SX) -> tuple[Rate, ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the rate of (x, cost, |cost|) over a step, and its arguments.

    Time is counted in steps, so that the length of a step can be an argument.

    Args:
        shooting: Functions of the problem.
        p: Parameters.

    Returns:
        The rate; u, s before, s after, length of the step [s].
    """
    problem, f = shooting.problem, shooting.dynamics
    model = problem.model
    cost = ca.Function("cost", [*problem.symbols().values()], [problem.stage_cost])
    u = ca.SX.sym("u", model.nu)
    before, after = ca.SX.sym("s0", problem.ns), ca.SX.sym("s1", problem.ns)
    counts, h = float(problem.quadrature == "integral"), ca.SX.sym("h")

    def rate(t: float, z: ca.SX) -> ca.SX:
        x, s = z[: model.nx], shooting.signals_at((before, after), t)
        spent = counts * cost(x, u, p, s)
        return h * ca.vertcat(f(x, u, p, s[: model.ns]), spent, ca.fabs(spent))

    return rate, u, before, after, h


def _adaptive_step(shooting: Shooting) -> ca.Function:
    """Return (z, u, shared, s before, s after, h) -> z after h; see rodas.py.

    The y of z is (x, cost, |cost|); shared is (p, sizes of y, longest first step as a
    fraction of h).
    """
    model = shooting.problem.model
    shared = ca.SX.sym("shared", model.np + model.nx + 3)
    rate, u, *rest = _fine_rate(shooting, shared[: model.np, 0])
    follow = follower(
        rate,
        [u, shared, *rest],
        shared[model.np : model.np + model.nx + 2],
        duration=1.0,
        tolerance=finer(shooting.problem.integrator_tolerance or 0.0),
    )
    z, *known = (ca.MX.sym(f"a{i}", *follow.size_in(i)) for i in range(follow.n_in()))
    begun = column_at_check(z)
    # The last entry is the next step; after a jump of the controls it begins short.
    begun = ca.vertcat(begun[:-1], ca.fmin(begun[-1], known[1][-1]))
    return ca.Function("fine", [z, *known], [follow(begun, *known)])


def signals_between(
    problem: OptimalControlProblem, signals: Array, times: Array
) -> Array:
    """Return the signals at given times, shape (ns, n), linear between the nodes.

    Args:
        problem: The problem.
        signals: Signals at the problem's nodes, shape (ns, nodes).
        times: Times, shape (n,) [s].
    """
    rows = [np.interp(times, problem.times, row) for row in signals]
    return np.array(rows).reshape(problem.ns, times.size)


def _in_time(points: Points) -> Points:
    """Return points in the order of their times."""
    ends = np.argsort(points.times, kind="stable")
    return Points(
        points.times[ends],
        points.states[:, ends],
        points.controls[:, ends],
        points.signals[:, ends],
    )
