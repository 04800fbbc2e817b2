"""Receding horizon, planning at each control instant; open loop, planning once.

A controller's memory is its last decision: `decide` takes it and returns the next one,
so that a flight can be stopped, stored and gone on with.

Receding horizon: at each control instant the planner starts at the last plan, shifted
by one interval with zero controls appended, and the first control of the new plan is
flown. (The chapter starts at U(t - delta) as it is, which does not settle: erratum;
`shift=False` does that.)
Where no feasible plan is found, the better of what was found and the shifted last
plan, by (violation, cost), is flown, and the plan says so. (Always flying the shifted
plan can stall: one that never was feasible is then repeated for ever.)
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.fitness import Known
from swarmstart.ocp.guess import Appended, shifted_controls
from swarmstart.ocp.improving import improved
from swarmstart.ocp.planner import Plan, Planner, Source
from swarmstart.ocp.polish import is_better
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.search_space import Start

Array = NDArray[np.float64]
ReferenceSignals = Callable[[Array], Array]
"""Absolute times (n,) [s] -> known signals (nr, n)."""


_SHOWN = 6
"""Controls that a summary shows."""


class Mode(Enum):
    """Which law made a decision."""

    PLANNED = "planned"
    LINEAR = "linear"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Decision:
    """What a controller does at one control instant; also its memory.

    Attributes:
        control: Control to hold over the coming interval, shape (nu,).
        plans: The plan of each agent, in the order of the agents.
        mode: Which law made it.
    """

    control: Array
    plans: tuple[Plan, ...]
    mode: Mode = Mode.PLANNED

    def __repr__(self) -> str:
        """Return mode, control and number of plans in one line."""
        control = ", ".join(f"{value:.4g}" for value in self.control[:_SHOWN])
        more = ", ..." if self.control.size > _SHOWN else ""
        plans = len(self.plans)
        return (
            f"Decision: {self.mode.value}, control ({control}{more}), {plans} plan(s)"
        )


class Controller(Protocol):
    """Feedback at fixed control instants."""

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
    parameters: Callable[[float], Array] | None,
    seen: tuple[Array, ...] = (),
) -> Known:
    """Return parameters and signals of a plan made at a time; see RecedingHorizon."""
    times = time + problem.times
    rows = () if reference is None else (reference(times),)
    return Known(
        parameters=() if parameters is None else parameters(time),
        signals=np.vstack([np.empty((0, problem.nodes)), *rows, *seen]),
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RecedingHorizon:
    """Plan over the horizon, fly the first interval, plan again.

    Attributes:
        planner: Plans from one state.
        reference: The problem's first signals; None where it has none.
        parameters: Time [s] -> parameters (np,) of the plan made then; None: none.
        candidates: Time [s] -> controls (nu, N, k) that a search looks at besides the
            last plan; None: none.
        append: What the last plan, shifted, ends with.
        shift: Whether planning starts at the last plan shifted by one interval; else at
            the last plan as it is, one interval late.
        first: Controls (nu, N), or a Start with states, that the first plan begins
            from; None: none are known. Without search and polish they are that plan.
    """

    planner: Planner
    reference: ReferenceSignals | None = None
    parameters: Callable[[float], Array] | None = None
    candidates: Callable[[float], Array] | None = None
    append: Appended = "zero"
    shift: bool = True
    first: Array | Start | None = None

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.planner.problem.dt

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the first control of a new plan; see Controller."""
        last = previous.plans[0] if previous else None
        plan = self.plan(time, state, last, rng=rng)
        return Decision(control=plan.controls[:, 0], plans=(plan,))

    def known(self, time: float, seen: tuple[Array, ...] = ()) -> Known:
        """Return parameters and signals of a plan made at a time.

        Args:
            time: Time since the start [s].
            seen: Rows that follow the reference's, each (k, nodes): plans of others.
        """
        problem = self.planner.problem
        return known_at(problem, time, self.reference, self.parameters, seen)

    def plan(
        self,
        time: float,
        state: Array,
        last: Plan | None,
        *,
        seen: tuple[Array, ...] = (),
        rng: np.random.Generator,
    ) -> Plan:
        """Return the plan to fly from a state.

        Args:
            time: Time since the start [s].
            state: Shape (nx,).
            last: The plan one interval ago; None at the start.
            seen: As in `known`.
            rng: Source of all randomness.
        """
        known = self.known(time, seen)
        problem = self.planner.problem
        guess = self.first if last is None else last.controls
        shifted: Array | None = None
        if last is not None:
            shifted = shifted_controls(problem, last.controls, self.append)
        plan = self.planner.plan(
            state,
            known=known,
            guess=shifted if self.shift and shifted is not None else guess,
            candidates=None if self.candidates is None else self.candidates(time),
            near=last is not None,
            rng=rng,
        )
        if plan.feasible or shifted is None:
            return plan
        return self._fallback(plan, shifted, state, known)

    def _fallback(self, plan: Plan, again: Array, state: Array, known: Known) -> Plan:
        """Return the shifted last plan in place of an infeasible one, unless worse.

        Args:
            plan: What planning found; its search values and effort are kept.
            again: The shifted last plan's controls, shape (nu, N).
            state: Shape (nx,).
            known: Parameters and signals of the plan.
        """
        shifted = self.planner.evaluated(
            again,
            state,
            known=known,
            source=Source.SHIFTED,
            search=plan.search,
            evaluations=plan.evaluations,
            polish_status=plan.polish_status,
        )
        found, last = (plan.cost, plan.violation), (shifted.cost, shifted.violation)
        if is_better(found, last, tolerance=self.planner.problem.tolerance):
            return plan
        return shifted


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class OpenLoop:
    """A controller that plans once, as `solve` does, and then flies what it planned.

    Attributes:
        loop: Plans from the first state.
        repair: Whether a plan that breaks a constraint between its checks is made
            again with a margin, as in `solve`.
    """

    loop: RecedingHorizon
    repair: bool = False

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.loop.dt

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
        intervals = self.loop.planner.problem.intervals
        number = round(time / self.dt)
        if number >= intervals:
            raise InvalidProblemError(
                f"an open loop must end with its plan of {intervals} intervals, "
                f"got interval {number}"
            )
        return Decision(control=plans[0].controls[:, number], plans=plans)

    def _planned(self, state: Array, rng: np.random.Generator) -> Plan:
        """Return the plan from the first state."""
        planner, known = self.loop.planner, self.loop.known(0.0)
        plan = self.loop.plan(0.0, state, None, rng=rng)
        *_, best = improved(planner, plan, state, known, repair=self.repair, rng=rng)
        return best.plan
