"""Controllers: receding horizon (plan at each control instant) and open loop (once).

A controller's only memory is its last decision: `decide` takes it and returns the next
one. So a run can be stopped, stored and continued.

Receding horizon: at each control instant the planner starts from the last plan, shifted
by one interval with zero controls appended, and the first control of the new plan is
applied. (The chapter starts from the unshifted U(t - delta), as `shift=False` does. The
loop then does not settle: an erratum.) If no feasible plan is found, the better of the
plan found and the shifted last plan, by (violation, cost), is applied; `Plan.source`
says which. (Always applying the shifted plan can stall: an infeasible plan would be
repeated for ever.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from typing import Protocol, Required, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    RNG,
    a_number,
    checked,
    choice,
    either,
    function,
    mapping,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.answer.improving import improved
from swarmstart.ocp.answer.plan import Plan, Source
from swarmstart.ocp.answer.planner import Planner, planner_of
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.nlp.multipliers import duals_of
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.nlp.start import Carried, Start
from swarmstart.ocp.nlp.watching import Answer, Deadline
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.statement.control_shape import Profile
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.guesses import Appended, shifted_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.end_time import END_TIME
from swarmstart.ocp.statement.rewrites.shrinking import Shrinking

ReferenceSignals = Callable[[Array], Array]
"""Absolute times (n,) [s] -> known signals (nr, n)."""


_ROUNDING = 1e-9
"""Fraction of a period by which an end time may exceed it and still count as equal."""
_SHOWN = 6
"""Number of controls that a summary shows."""


SEEN = several(reals(axes=2), "a sequence of arrays with 2 axes")


class Mode(Enum):
    """Control law that made a decision."""

    PLANNED = "planned"
    LINEAR = "linear"


@checked(
    refused,
    control=reals(axes=1),
    plans=several(of_kind(Plan, "a Plan"), "a sequence of Plans"),
    mode=of_kind(Mode, "a Mode"),
    profile=optional(of_kind(Profile, "a Profile")),
    start=optional(reals()),
    dt=optional(a_number(above=0)),
    is_last=FLAG,
    decided=mapping(words="a mapping of names to numbers"),
    acting=optional(reals(axes=1)),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Decision:
    """Decision of a controller at one control instant; also its memory.

    Attributes:
        control: Control to hold over the coming interval, shape (nu,); with a
            `profile`, the control at its start.
        plans: The plan of each agent, in the order of the agents.
        mode: The law that made the decision.
        start: State at which the run begins, shape (nx,), if the first plan decides it;
            None: the measured state.
        dt: Length of the coming interval [s], if the plan decides it; None: the
            controller's.
        is_last: Whether the run ends with the coming interval.
        profile: Controls over the interval, if they are linear, or if the next plan
            follows after a `period` and not after one interval of this plan; None: the
            control is held.
        decided: Parameters that the plan decides, by name.
        acting: Control that reaches the equations of a `Plant` over the interval, shape
            (nu,), if it differs from `control` because of a delay; None: `control`
            itself. A plant of the user's own receives `control`, and delays it itself.
    """

    control: Array
    plans: tuple[Plan, ...]
    mode: Mode = Mode.PLANNED
    start: Array | None = None
    dt: float | None = None
    is_last: bool = False
    profile: Profile | None = None
    decided: Mapping[str, float] = field(default_factory=dict)
    acting: Array | None = None

    @property
    def received(self) -> Array:
        """Control that reaches the equations of a `Plant`, shape (nu,)."""
        return self.control if self.acting is None else self.acting

    @property
    def has_feasible_plans(self) -> bool:
        """True if planning found a feasible plan for every agent.

        A step that follows the shifted last plan has found none, even if that plan is
        feasible.
        """
        return all(
            plan.feasible and plan.source is not Source.SHIFTED for plan in self.plans
        )

    def __repr__(self) -> str:
        """Return mode, control and number of plans in one line."""
        control = ", ".join(f"{value:.4g}" for value in self.control[:_SHOWN])
        more = ", ..." if self.control.size > _SHOWN else ""
        plans = len(self.plans)
        return (
            f"Decision: {self.mode.value}, control ({control}{more}), {plans} plan(s)"
        )


OF_DECISION = {
    "time": a_number(),
    "previous": optional(of_kind(Decision, "the last Decision")),
    "rng": RNG,
}
"""Checks of the arguments of `decide`, besides that of the state."""


class Controller(Protocol):
    """Feedback law that acts at fixed control instants."""

    @property
    def dt(self) -> float:
        """Time from one control instant to the next [s]."""

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the decision at a control instant.

        Args:
            time: Time since the start [s].
            state: Measured state, shape (nx,).
            previous: The decision one interval ago; None at the start.
            rng: Source of all randomness.
        """


def known_at(
    problem: OptimalControlProblem,
    time: float,
    reference: ReferenceSignals | None,
    parameters: Callable[[float], ArrayLike] | None,
    seen: tuple[Array, ...] = (),
    length: float | None = None,
) -> Known:
    """Return parameters and signals of a plan; see RecedingHorizon.known."""
    times = problem.expected_times
    times = time + times * (1.0 if length is None else length / times[-1])
    rows = () if reference is None else (reference(times),)
    try:
        signals = np.vstack([np.empty((0, times.size)), *rows, *seen])
    except ValueError as error:
        found = ", ".join(str(np.shape(one)) for one in (*rows, *seen))
        raise InvalidProblemError(
            f"reference must return, for {times.size} times, an array of shape "
            f"(signals, {times.size}), got {found}"
        ) from error
    values: ArrayLike = () if parameters is None else parameters(time)
    return Known(
        parameters=np.atleast_1d(values) if np.ndim(values) == 0 else values,
        signals=signals,
        time=time,
    )


def of_given_length(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem that is given the length of each plan with the initial state.

    The length is the last state of the problem after all rewrites (core).

    Raises:
        InvalidProblemError: If a control has a delay, or a signal is held.
    """
    if problem.features:
        raise InvalidProblemError(
            "until changes the length of intervals, which delays and held signals "
            "count: expected a problem without features"
        )
    return replace(problem, features=(Shrinking(),))


@checked(
    refused,
    planner=of_kind(Planner, "a Planner"),
    reference=optional(function()),
    parameters=optional(function()),
    candidates=optional(function()),
    append=choice(get_args(Appended)),
    shift=FLAG,
    first=optional(either(reals(), of_kind(Start, "a Start"))),
    period=optional(a_number(above=0)),
    until=optional(a_number(above=0)),
    previous=optional(reals()),
    carries=FLAG,
    within=optional(a_number(above=0)),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RecedingHorizon:
    """Plan over the horizon, apply the first interval, plan again.

    Attributes:
        planner: Planner of the problem.
        reference: Times, shape (n,) [s] -> values of the problem's first signals at
            these times, shape (signals, n); None: the problem has no such signals.
        parameters: Time [s] -> parameters of the plan made at that time, one number for
            each, or a number alone; None: no parameters.
        candidates: Time [s] -> controls (nu, N, k) that a search evaluates in addition
            to the last plan; None: no candidates.
        append: What is appended to the shifted last plan: "zero" controls or its "last"
            ones.
        shift: Whether planning starts from the last plan shifted by one interval; else
            it starts from the last plan unchanged, which is one interval late.
        first: Controls (nu, N), or a Start with states, from which the first plan
            begins; None: no guess. If the planner has neither search nor polish, these
            controls are the first plan.
        period: Time from one plan to the next [s], for a free end time or `until`.
            The horizon shrinks with a constant number of intervals. The run ends when
            the end time is at most one period, or when the remainder after a period
            would be shorter than allowed. None: one control interval.
        until: Time at which the run ends [s], such as the end of a batch. No plan goes
            beyond it: the horizon, which must be a number, is cut there.
            `planner` is then replaced by one that takes the length of each plan as an
            input. None: the horizon recedes for ever.
        previous: Control of the interval before the run, shape (nu,); None: the allowed
            value nearest to zero.
        carries: Whether a polish also starts from the multipliers of the last plan.
            Such a polish is stopped after three times the median iterations of the
            earlier ones, but not before 20; it is then repeated from the usual start.
            Set `carries` to False if the meaning of the signals changes from plan to
            plan.
        within: Limit of the wall time for one plan [s], without loading and compiling.
            At the limit search and polish are stopped, and the best plan so far (by
            violation, then cost) is applied; its `Plan.stopped` is true. This plan is
            never worse than the shifted last plan or the start. A generation or an
            iteration that has begun is finished, and lanes are not used. None: no
            limit.

    Raises:
        InvalidProblemError: If the end time is free and may not shrink to one period;
            if there is a period, but neither a free end time nor `until`; if there is
            `until` and the end time is free, a control has a delay, or time is
            discrete; if the members of an ensemble share no control; or if there is a
            limit `within`, and the search uses lanes or the polish cannot be stopped.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=x + u), horizon=2.0, intervals=4,
        ...     stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> controller = ss.RecedingHorizon(planner=planner)
        >>> plant = ss.Plant(problem.model, dt=controller.dt, substeps=4)
        >>> loop = ss.simulate(plant, controller, [1.0], steps=8, seed=0)
        >>> bool(abs(loop.states[0, -1]) < 0.1)
        True
    """

    planner: Planner
    reference: ReferenceSignals | None = None
    parameters: Callable[[float], ArrayLike] | None = None
    candidates: Callable[[float], Array] | None = None
    append: Appended = "zero"
    shift: bool = True
    first: Array | Start | None = None
    period: float | None = None
    until: float | None = None
    previous: Array | None = None
    carries: bool = True
    within: float | None = None

    def __post_init__(self) -> None:
        """Check that the run can end if the end time is free, and plans be stopped."""
        if self.until is not None:
            self._shrink()
        if self.within is not None:
            self.planner.in_time()
        horizon = self.planner.stated.horizon
        risk = self.planner.stated.risk
        if risk is not None and risk.robust_horizon == 0:
            raise InvalidProblemError(
                "members of an ensemble that share no control cannot be run: "
                "robust_horizon must be at least 1"
            )
        if not isinstance(horizon, Free):
            if self.period is not None and self.until is None:
                raise InvalidProblemError(
                    "a period is for a problem whose end time is free: here plans are "
                    f"one control interval of {self.dt:g} s apart"
                )
        elif self.period is not None and not horizon.lower <= self.period:
            raise InvalidProblemError(
                "a free end time must be allowed to shrink to one period of "
                f"{self.period:g} s, got the lower bound {horizon.lower:g} s; for the "
                f"closed loop state Free({self.period:g}, {horizon.upper:g})"
            )

    def _shrink(self) -> None:
        """Take a planner whose plans have a length that is given, and a period."""
        stated = self.planner.stated
        if not any(isinstance(one, Shrinking) for one in stated.features):
            planner = planner_of(of_given_length(stated), self.planner)
            object.__setattr__(self, "planner", planner)
        if self.period is None:
            object.__setattr__(self, "period", stated.length / stated.intervals)

    @property
    def dt(self) -> float:
        """Time from one plan to the next [s].

        Raises:
            InvalidProblemError: If the end time is free and no period was given.
        """
        if isinstance(self.planner.stated.horizon, Free) and self.period is None:
            raise InvalidProblemError(
                "a free end time needs a period: the time between plans [s]"
            )
        return self.period or self.planner.problem.dt

    @checked(refused, state=reals(), **OF_DECISION)
    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the first control of a new plan; see Controller.

        Raises:
            InvalidProblemError: If the problem decides its start, which is measured
                here, or consists of several phases.
        """
        if self.planner.stated.clock:
            raise InvalidProblemError(
                "phases cannot be run in receding horizon by their joined problem: "
                "take phased_horizon(), or run one plan in an OpenLoop"
            )
        if self.planner.stated.start:
            raise InvalidProblemError(
                "a receding horizon starts where the state is measured: take "
                "dataclasses.replace(problem, start={})"
            )
        last = previous.plans[0] if previous else None
        plan = self.plan(time, state, last, rng=rng)
        first = self.flown(plan)[:, 0]
        decided = self.planner.lowered.decided_parameters(plan.x0)
        linear = self.planner.stated.has_knots
        if self.period is None:
            profile = self._profile(plan, self.dt * plan.controls.shape[1], pieces=1)
            return Decision(
                control=first,
                plans=(plan,),
                profile=profile if linear else None,
                decided=decided,
                acting=_acting(self.planner, plan, 0),
            )
        length = self._length(plan)
        # Else the rest after one more period would be shorter than allowed.
        ends = length < self.period * (1 + _ROUNDING) + self._shortest
        return Decision(
            control=first,
            plans=(plan,),
            dt=length if ends else None,
            is_last=ends,
            profile=self._profile(plan, length),
            decided=decided,
        )

    @checked(refused, plan=of_kind(Plan, "a Plan"))
    def flown(self, plan: Plan) -> Array:
        """Return the controls or knots of a plan that a plant receives.

        If each member of an ensemble has controls of its own, they are the first one's.
        """
        stated, lowered = self.planner.stated, self.planner.lowered
        return lowered.knots(plan.controls, plan.x0)[: stated.flown_controls]

    def _profile(self, plan: Plan, length: float, pieces: int | None = None) -> Profile:
        """Return the controls of a plan over its horizon.

        Args:
            plan: The plan.
            length: Length of its horizon [s].
            pieces: Number of intervals that count; None: all.
        """
        # Knots are one more than the intervals, so these are counted by the core's
        # controls.
        controls, piece = self.flown(plan), length / plan.controls.shape[1]
        if not self.planner.stated.has_knots:
            return Profile(controls=controls, piece=piece)
        end = None if pieces is None else pieces + 1
        return Profile(controls=controls[:, 1:end], piece=piece, start=controls[:, 0])

    @property
    def _shortest(self) -> float:
        """Shortest allowed end time [s]."""
        horizon = self.planner.stated.horizon
        return horizon.lower if isinstance(horizon, Free) else 0.0

    def _length(self, plan: Plan) -> float:
        """Return the length of a plan's horizon [s]."""
        return self.planner.lowered.end_time(plan.x0)

    @checked(refused, time=a_number(), seen=SEEN, length=optional(a_number(above=0)))
    def known(
        self,
        time: float,
        seen: tuple[Array, ...] = (),
        length: float | None = None,
    ) -> Known:
        """Return parameters and signals of a plan made at a time.

        Args:
            time: Time since the start [s].
            seen: Further signals, after those of the reference, each of shape (k,
                nodes): plans of other agents.
            length: Expected length of the plan [s]; None: the horizon, or the guess of
                a free end time.
        """
        stated = self.planner.stated
        known = known_at(stated, time, self.reference, self.parameters, seen, length)
        return known._replace(previous=self.previous)

    @checked(
        refused,
        seen=SEEN,
        last=optional(of_kind(Plan, "the last Plan")),
        time=a_number(),
        state=reals(),
        is_only=FLAG,
        rng=RNG,
    )
    def plan(
        self,
        time: float,
        state: Array,
        last: Plan | None,
        *,
        seen: tuple[Array, ...] = (),
        is_only: bool = False,
        rng: np.random.Generator,
    ) -> Plan:
        """Return the plan to apply from a state.

        Args:
            time: Time since the start [s].
            state: Shape (nx,).
            last: The plan one interval ago; None at the start.
            seen: Signal rows, as in `known`.
            is_only: Whether this is the only plan of the run.
            rng: Source of all randomness.
        """
        problem, left = self.planner.problem, self._left(time, last)
        state, known, first = self._posed(state, self.known(time, seen, left), last)
        guess = first if last is None else last.controls
        shifted: Array | None = None
        if last is not None and self.period is not None and left is not None:
            state, shifted = self._shrunk(state, last, self.period, left)
        elif left is not None:  # The first plan.
            state = self._with_length(state, left)
        elif last is not None:
            shifted = shifted_controls(problem, last.controls, self.append)
        begun = shifted if self.shift and shifted is not None else guess
        if last is not None and begun is not None and not isinstance(begun, Start):
            begun = Start(begun, carried=self._carried(last, left))
        return plan_of_step(
            self.planner,
            state,
            known,
            shifted,
            within=self.within,
            guess=begun,
            candidates=None if self.candidates is None else self.candidates(time),
            near=last is not None,
            last_cost=None if last is None else last.cost,
            in_loop=not is_only and self._leaves_some,
            is_new=not self._leaves_some,
            rng=rng,
        )

    def _posed(
        self, state: Array, known: Known, last: Plan | None
    ) -> tuple[Array, Known, Array | Start | None]:
        """Return initial state, known data and first guess of the core.

        The core's states that remember controls continue those of the last plan.
        """
        planner = self.planner
        if last is not None and self.period is not None:
            known = known._replace(previous=self._last_held(last, self.period))
        first = self.first if last is None else None
        start, known, first = planner.posed(state, known, first)
        found = np.asarray(start, dtype=np.float64)
        if last is not None and self.period is None:
            found = planner.lowered.after(found, last.x0, last.controls)
        return found, known, first

    def _carried(self, last: Plan, left: float | None) -> Carried | None:
        """Return the multipliers of the last plan over the time of the next one.

        Args:
            last: The last plan.
            left: Remaining time of the last plan, as from `_left`.
        """
        duals = last.duals if last.point is None else duals_of(last.point)
        if duals is None or not self.carries:
            return None
        if not self.shift:
            return Carried(duals=duals, spent=last.spent)
        begin, length = 1.0 / self.planner.problem.intervals, 1.0
        if self.period is not None and left is not None:
            whole = self._length(last)
            begin, length = self.period / whole, left / whole
        if not begin < 1.0:  # The last plan is used up.
            return None
        end = begin + length
        return Carried(duals=duals, begin=begin, end=end, spent=last.spent)

    @property
    def _leaves_some(self) -> bool:
        """True if a part of a plan remains when the next one is made."""
        one = self.period is None and self.planner.problem.intervals == 1
        return not (self.shift and one)

    def _left(self, time: float, last: Plan | None) -> float | None:
        """Return the length of the next plan [s]; None if it is fixed or unknown.

        Raises:
            InvalidProblemError: If the run has ended.
        """
        if self.until is not None:
            if not time < self.until:
                raise InvalidProblemError(
                    f"a run until {self.until:g} s has no plan at {time:g} s"
                )
            return min(self.planner.stated.length, self.until - time)
        if last is None or self.period is None:
            return None
        return max(self._length(last) - self.period, self._shortest)

    def _last_held(self, last: Plan, period: float) -> Array:
        """Return the control at the end of the applied part of the last plan."""
        if self.planner.stated.has_knots:
            lowered, length = self.planner.lowered, self._length(last)
            knots = lowered.knots(last.controls, last.x0)
            piece = length / last.controls.shape[1]
            flown = Profile(controls=knots[:, 1:], piece=piece, start=knots[:, 0])
            return flown.at(np.array([period]))[:, 0]
        N = last.controls.shape[1]
        intervals = period / (self._length(last) / N)
        # The interval that contains the end; an end on an edge belongs to the one
        # before.
        return last.controls[:, min(max(int(np.ceil(intervals - _ROUNDING)), 1), N) - 1]

    def _shrunk(
        self, state: Array, last: Plan, period: float, left: float
    ) -> tuple[Array, Array]:
        """Return the start of the next plan, and the rest of the last controls.

        The remaining time is the guess of the end time.
        """
        start = self._with_length(state, left)
        lowered, N = self.planner.lowered, last.controls.shape[1]
        knots, piece = lowered.knots(last.controls, last.x0), self._length(last) / N
        if not self.planner.stated.has_knots:
            return start, Profile(controls=knots, piece=piece).sampled(period, left, N)
        rest = Profile(controls=knots[:, 1:], piece=piece, start=knots[:, 0])
        found = rest.at(period + left * np.arange(N + 1) / N)
        return lowered.guess(start, found)

    def _with_length(self, state: Array, left: float) -> Array:
        """Return a state of the core whose plan has another length [s]."""
        (one,) = self.planner.lowered.places[END_TIME]
        start = state.copy()
        start[one] = left
        return start


def _acting(planner: Planner, plan: Plan, number: int) -> Array | None:
    """Return the control that a plant's equations receive; None: that of the plan.

    Args:
        planner: The planner that made the plan.
        plan: The plan.
        number: Number of the interval.
    """
    found = planner.lowered.acting(plan.controls, plan.x0)
    return None if found is None else found[: planner.stated.flown_controls, number]


class _Asked(TypedDict, total=False):
    """Further arguments of `Planner.plan`."""

    guess: Array | Start | None
    candidates: Array | None
    near: bool
    last_cost: float | None
    in_loop: bool
    is_new: bool
    rng: Required[np.random.Generator]


def plan_of_step(
    planner: Planner,
    state: Array,
    known: Known,
    shifted: Array | None,
    *,
    within: float | None,
    **asked: Unpack[_Asked],
) -> Plan:
    """Return the new plan of a step, or the shifted last one if that is better.

    The shifted plan is considered only if the new one is not feasible.

    Args:
        planner: The planner.
        state: State of the rewritten problem (core), shape (nx,).
        known: Parameters and signals of the plan.
        shifted: Controls of the shifted last plan, shape (nu, N); None at the start.
        within: As in `RecedingHorizon`.
        **asked: Further arguments of `Planner.plan`.
    """
    if within is None:
        plan = planner.plan(state, known=known, **asked)
    else:
        plan = _in_time(planner, state, known, shifted, within=within, **asked)
    if plan.feasible or shifted is None:  # A first plan has no fallback.
        return plan
    # Values of the search and the effort are those of planning.
    again = _another(planner, plan, shifted, state, known, source=Source.SHIFTED)
    values = [(one.cost, one.violation) for one in (plan, again)]
    return plan if is_better(*values, tolerance=planner.problem.tolerance) else again


def _in_time(
    planner: Planner,
    state: Array,
    known: Known,
    shifted: Array | None,
    *,
    within: float,
    **asked: Unpack[_Asked],
) -> Plan:
    """Return the plan of a step, or the best so far when its time is over."""
    with stopwatch() as watch:
        deadline = Deadline(
            within,
            lambda: watch.seconds,
            value_of=lambda controls, x0: planner.fitness.value(controls, x0, known),
            better=partial(is_better, tolerance=planner.problem.tolerance),
            watch=planner.watch.watch,
        )
        with planner.watch.to(deadline):
            best = planner.in_time().plan(state, known=known, **asked)
    if not deadline.stopped:
        return best
    found, guess = (best.cost, best.violation), asked.get("guess")
    chosen: tuple[Answer, Source] | None = None
    others: list[tuple[Answer, Source]] = []
    if deadline.best is not None:
        others.append((deadline.best, Source.POLISH))
    if shifted is not None:
        others.append(((shifted, state), Source.GUESS))
    # Else planning began from the shifted plan itself.
    if not isinstance(guess, Start) or guess.controls is not shifted:
        begun = planner.as_begun(state, known=known, guess=guess)
        others.append(((begun.controls, begun.x0), begun.source))
    for other in others:
        value = planner.fitness.value(*other[0], known)
        if is_better(value, found, tolerance=planner.problem.tolerance):
            found, chosen = value, other
    if chosen is not None:
        (controls, x0), source = chosen
        best = _another(planner, best, controls, x0, known, source=source)
    return replace(best, stopped=True)


def _another(
    planner: Planner,
    plan: Plan,
    controls: Array,
    state: Array,
    known: Known,
    *,
    source: Source,
) -> Plan:
    """Return other controls as a plan, with the effort of a plan that was made."""
    return planner.evaluated(
        controls,
        state,
        known=known,
        source=source,
        search=plan.search,
        evaluations=plan.evaluations,
        polish_status=plan.polish_status,
        stopped=plan.stopped,
    )


@checked(refused, loop=of_kind(RecedingHorizon, "a RecedingHorizon"), repair=FLAG)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class OpenLoop:
    """A controller that plans once, as `solve` does, and then follows that plan.

    Attributes:
        loop: Controller that makes the plan from the first state.
        repair: Whether a plan that breaks a constraint between its checks is solved
            again with a margin, as in `solve`.

    Raises:
        InvalidProblemError: If members of an ensemble have controls of their own, or
            the loop has a limit `within`.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-2, 2)), terminal=[(x, 1)],
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> controller = ss.OpenLoop(loop=ss.RecedingHorizon(planner=planner))
        >>> plant = ss.Plant(problem.model, dt=0.25, substeps=2)
        >>> run = ss.simulate(plant, controller, [0.0], steps=4, seed=0)
        >>> print(run.states.round(4))
        [[0.   0.25 0.5  0.75 1.  ]]
    """

    loop: RecedingHorizon
    repair: bool = True

    def __post_init__(self) -> None:
        """Raise if members have controls of their own, or a plan has a time."""
        if self.loop.within is not None:
            raise InvalidProblemError(
                "an open loop plans once, before it begins: expected within=None, got "
                f"{self.loop.within:g} s"
            )
        stated = self.loop.planner.stated
        risk = stated.risk
        shared = None if risk is None else risk.robust_horizon
        if shared is not None and shared < stated.intervals:
            raise InvalidProblemError(
                f"an open loop has one control sequence, but members have their own "
                f"after {shared} of {stated.intervals} intervals: leave out "
                "robust_horizon"
            )

    @property
    def dt(self) -> float:
        """Length of a control interval [s]; for a free end time, that of its guess."""
        stated = self.loop.planner.stated
        return float(stated.expected_times[-1]) / stated.intervals

    @checked(refused, state=reals(), **OF_DECISION)
    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the plan's control at a time; see Controller.

        Raises:
            InvalidProblemError: If the time is after the plan's last interval.
        """
        plans = previous.plans if previous else (self._planned(state, rng),)
        planner = self.loop.planner
        intervals, lowered = planner.problem.intervals, planner.lowered
        length = lowered.end_time(plans[0].x0) / intervals
        number = round(time / length)  # A whole number up to rounding.
        if number >= intervals:
            raise InvalidProblemError(
                f"an open loop must end with its plan of {intervals} intervals, "
                f"got interval {number}"
            )
        decided = isinstance(planner.stated.horizon, Free)
        controls, start = self.loop.flown(plans[0]), lowered.as_stated(plans[0].x0)
        profile = None
        if planner.stated.has_knots:
            profile = Profile(
                controls=controls[:, number + 1 : number + 2],
                piece=length,
                start=controls[:, number],
            )
        return Decision(
            control=controls[:, number],
            plans=plans,
            profile=profile,
            # Further states of the core are none of the plant's.
            start=start[: state.size] if planner.stated.start else None,
            dt=length if decided else None,
            is_last=decided and number == intervals - 1,
            decided=lowered.decided_parameters(plans[0].x0),
            acting=_acting(planner, plans[0], number),
        )

    def _planned(self, state: Array, rng: np.random.Generator) -> Plan:
        """Return the plan from the first state."""
        planner = self.loop.planner
        x0, known, _ = planner.posed(state, self.loop.known(0.0))
        plan = self.loop.plan(0.0, state, None, is_only=True, rng=rng)
        # The last one is the best.
        *_, best = improved(planner, plan, x0, known, repair=self.repair, rng=rng)
        return best.plan
