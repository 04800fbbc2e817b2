"""Closed loop: a plant under a controller, one control interval after another.

`fly` yields each step when it is finished, so that an interruption loses no finished
step; `simulate` collects the steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    NAMES,
    RNG,
    UNITS,
    a_count,
    a_number,
    checked,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.heuristics import generator_of
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.common.errors import DivergedError, InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import numbers_of
from swarmstart.ocp.common.messages import Paragraph
from swarmstart.ocp.common.presentation import (
    PROGRESS,
    Presented,
    ProgressGiven,
    shown,
)
from swarmstart.ocp.loop.controller import Controller, Decision, Mode
from swarmstart.ocp.loop.plant import AnyPlant, Plant, SteppedPlant, plant_of
from swarmstart.ocp.loop.simulated_plant import SimulatedPlant
from swarmstart.ocp.statement.control_shape import piece_at, rows_at
from swarmstart.ocp.system import warn_of_units

_MIDDLES = 100
"""Points in time whose mean represents linear controls, for an object that holds."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Step:
    """One finished control interval.

    Attributes:
        number: Number of the interval, from 0.
        state: State at its start, shape (nx,).
        decision: Decision of the controller at its start.
        dense_states: States after each step of the plant within it, shape (nx, m).
        seconds: Wall time of the decision [s].
        dt: Length of the interval [s], if it differs from the plant's; else None.
    """

    number: int
    state: Array
    decision: Decision
    dense_states: Array
    seconds: float
    dt: float | None = None

    def __repr__(self) -> str:
        """Return number, mode and time of the step in one line."""
        mode = self.decision.mode.value
        return f"Step {self.number}: {mode}, decided in {self.seconds:.3g} s"


@checked(
    refused,
    times=reals(array=True),
    states=reals(array=True, axes=2),
    controls=reals(array=True, axes=2),
    dense_times=reals(array=True),
    dense_states=reals(array=True, axes=2),
    step_seconds=reals(array=True),
    state_names=NAMES,
    control_names=NAMES,
    output_names=NAMES,
    decisions=several(of_kind(Decision, "a Decision"), "a sequence of Decisions"),
    outputs=reals(array=True),
    units=UNITS,
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Trajectory(Presented):
    """Result of a closed-loop run.

    Attributes:
        times: Control instants, shape (T + 1,) [s].
        states: States at the control instants, shape (nx, T + 1).
        controls: Controls, shape (nu, T): held from each instant to the next, or, if
            they are linear, their values at the start of each interval.
        dense_times: Times of the plant's steps, shape (T * m + 1,) [s].
        dense_states: States at the plant's steps, shape (nx, T * m + 1).
        decisions: Decisions of the controller, T of them.
        step_seconds: Wall time of each decision, shape (T,) [s], without loading and
            compiling machine code.
        state_names: The model's names of the states; numbers if it has none.
        control_names: The model's names of the controls; numbers if it has none.
        outputs: Outputs of the plant at its steps, with the control that follows (the
            last ones with the control before), shape (ny, T * m + 1).
        output_names: Names of the outputs.
        units: Units of states, controls and outputs by name, as far as they are stated.
    """

    times: Array
    states: Array
    controls: Array
    dense_times: Array
    dense_states: Array
    decisions: tuple[Decision, ...]
    step_seconds: Array
    state_names: tuple[str, ...] = ()
    control_names: tuple[str, ...] = ()
    outputs: Array = field(default_factory=lambda: np.empty((0, 0)))
    output_names: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    @checked(refused, time=a_number())
    def at(self, time: float) -> tuple[Array, Array]:
        """Return states (nx,) and controls (nu,) at a time, for `Model.linearised`.

        States are linear between the plant's steps. At a control instant the controls
        are the new ones. Delayed controls are those that the model receives at that
        time.

        Args:
            time: Time within the run [s].

        Raises:
            InvalidProblemError: If the time is outside of the run.
        """
        number = piece_at(time, self.times)
        control, profile = self.received[:, number], self.decisions[number].profile
        if profile is not None:
            control = profile.at(np.array([time - self.times[number]]))[:, 0]
        return rows_at(time, self.dense_times, self.dense_states), control

    @property
    def stopped_steps(self) -> int:
        """Number of steps at which a plan was stopped when its time was over."""
        return sum(any(plan.stopped for plan in d.plans) for d in self.decisions)

    @property
    def infeasible_steps(self) -> int:
        """Number of planned steps at which no feasible plan was found."""
        return len(self._infeasible)

    @property
    def _infeasible(self) -> list[int]:
        return [
            number
            for number, one in enumerate(self.decisions)
            if one.mode is Mode.PLANNED and not one.has_feasible_plans
        ]

    @property
    def received(self) -> Array:
        """Controls that reached the equations of a `Plant`, shape (nu, T)."""
        if all(decision.acting is None for decision in self.decisions):
            return self.controls
        return np.stack([decision.received for decision in self.decisions], axis=1)

    def __post_init__(self) -> None:
        """Number the states and controls that have no names."""
        for role, rows in (("state", self.states), ("control", self.controls)):
            numbered = tuple(f"{role}_{i}" for i in range(rows.shape[0]))
            names = tuple(getattr(self, f"{role}_names")) or numbered
            object.__setattr__(self, f"{role}_names", names)

    def __repr__(self) -> str:
        """Return length, sizes and number of feasible plans in a few lines."""
        plans = [plan for decision in self.decisions for plan in decision.plans]
        feasible = sum(plan.feasible for plan in plans)
        stopped = without = ""
        if none := self._infeasible:
            explained = Paragraph.SOME_STEPS if feasible else Paragraph.NO_STEP
            without = (
                f"; without one: {len(none)} of {len(self.decisions)} "
                f"steps, the first at {self.times[none[0]]:g} s "
                f"(more: {explained})"
            )
        if self.stopped_steps:
            stopped = f"; {self.stopped_steps} stopped when their time was over"
        return "\n".join(
            [
                f"Trajectory of {len(self.decisions)} steps over {self.times[-1]:g} s: "
                f"{self.states.shape[0]} states, {self.controls.shape[0]} controls",
                f"  plans: {feasible} of {len(plans)} feasible{without}",
                f"  decisions: {float(np.median(self.step_seconds)):.3g} s (median)"
                f"{stopped}",
            ]
        )


@checked(
    refused,
    x0=reals(),
    steps=a_count(),
    rng=RNG,
    done=a_count(),
    previous=optional(of_kind(Decision, "the last Decision")),
)
def fly(  # noqa: PLR0913 - a closed loop and where to begin in it
    plant: AnyPlant,
    controller: Controller,
    x0: ArrayLike,
    *,
    steps: int,
    rng: np.random.Generator,
    done: int = 0,
    previous: Decision | None = None,
) -> Iterator[Step]:
    """Run a controller on a plant in closed loop; yield each finished control interval.

    Args:
        plant: A `Plant`, a system of python-control with states, or any object with
            `step(x, u, dt)`.
        controller: The controller, with the same control interval as the plant.
        x0: State at the start of the first interval of this run, shape (nx,).
        steps: Total number of control intervals, including the `done` ones. The run
            ends earlier if a decision says that it is the last.
        rng: Source of all randomness.
        done: Number of intervals that are already done; above 0 to continue a run.
        previous: The decision of the last interval done; None at the start.

    Raises:
        InvalidProblemError: If x0 does not fit the plant, or the intervals differ.
        DivergedError: If a state of the plant is no longer finite, or its algebraic
            equations are not solved.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        ...     terminal_cost=x**2, bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> controller = ss.RecedingHorizon(planner=planner)
        >>> plant = ss.Plant(problem.model, dt=0.5, substeps=1)
        >>> rng = np.random.default_rng(0)
        >>> for step in ss.fly(plant, controller, [3.0], steps=3, rng=rng):
        ...     print(step.number, step.state.round(3), step.decision.control.round(3))
        0 [3.] [-1.]
        1 [2.5] [-1.]
        2 [2.] [-1.]
    """
    plant, state = _checked(plant, controller, x0)
    if previous is not None and previous.is_last:
        return
    before = previous.dt if previous else None
    if not done:
        state = _begun(plant, state)
    for number in range(done, steps):
        # Intervals that a plan decides have one length; phases keep the time as a
        # state.
        time = number * (before or plant.dt)
        with stopwatch() as watch:
            decision = controller.decide(time, state, previous, rng=rng)
            seconds = watch.seconds
        if number == 0 and decision.start is not None:
            state = _begun(plant, decision.start)
        plant = _as_decided(plant, decision)
        before = decision.dt
        dense = _driven(plant, state, decision, time)
        if not np.isfinite(dense).all():
            raise DivergedError(
                f"the plant left the finite numbers in step {number}, at "
                f"{time:g} s: its step of {plant.dt / plant.substeps:g} s "
                "may be too long for the model"
            )
        yield Step(
            number=number,
            state=state,
            decision=decision,
            dense_states=dense,
            seconds=seconds,
            dt=decision.dt,
        )
        if decision.is_last:
            return
        state, previous = dense[:, -1], decision


def _begun(plant: Plant | SteppedPlant, state: Array) -> Array:
    """Return the state at which a run begins; a simulator of others is put there."""
    if isinstance(plant, SteppedPlant | SimulatedPlant):
        return plant.start_at(state)
    return state


def flown_again(plant: SimulatedPlant, steps: Sequence[Step]) -> bool:
    """Return whether a simulator, started anew, repeats the steps of an earlier run.

    The simulator then has the state at which that run ended, so that the run can be
    continued.
    """
    if not np.array_equal(plant.start_at(steps[0].state), steps[0].state):
        return False
    for step in steps:
        dense = _driven(plant, step.state, step.decision, step.number * plant.dt)
        if not np.array_equal(dense, step.dense_states):
            return False
    return True


def _as_decided(
    plant: Plant | SteppedPlant, decision: Decision
) -> Plant | SteppedPlant:
    """Return the plant with the interval and the parameters that were decided."""
    if decision.dt is not None and decision.dt != plant.dt:
        plant = plant.with_interval(decision.dt)
    if decision.decided and isinstance(plant, Plant):
        plant = plant.with_decided(decision.decided)
    return plant


def _checked(
    plant: AnyPlant, controller: Controller, x0: ArrayLike
) -> tuple[Plant | SteppedPlant, Array]:
    """Return the plant and its initial state, checked against each other."""
    # By its methods: users write controllers of their own.
    if not (hasattr(controller, "decide") and hasattr(controller, "dt")):
        raise InvalidProblemError(
            "controller must have decide() and dt, such as RecedingHorizon, "
            f"got {shortened(controller)}"
        )
    plant = plant_of(plant, controller.dt)
    state = numbers_of("x0", x0)
    known = plant.model.nx if isinstance(plant, Plant) else plant.nx
    nx = state.size if known is None else known
    if state.shape == (nx, 1):
        state = state[:, 0]
    if state.shape != (nx,):
        raise InvalidProblemError(f"x0 must have shape ({nx},), got {state.shape}")
    if not np.isclose(plant.dt, controller.dt):
        raise InvalidProblemError(
            f"plant and controller must share one interval, got {plant.dt} s "
            f"and {controller.dt} s"
        )
    return plant, state


def _driven(
    plant: Plant | SteppedPlant, state: Array, decision: Decision, time: float
) -> Array:
    """Return the states after each step of a plant; see Plant.

    A plant holds one control, or several one after another, or the controls are linear
    over its steps. An object with step(x, u, dt) holds their mean.
    """
    profile = decision.profile
    if profile is None:
        is_own = isinstance(plant, Plant) and not isinstance(plant, SimulatedPlant)
        return plant(state, decision.received if is_own else decision.control, time)
    if isinstance(plant, Plant):
        if profile.is_held:
            return plant(state, profile.means(plant.dt, plant.substeps), time)
        return plant.along(state, profile.ends(plant.dt, plant.substeps), time)
    if profile.is_held:
        several = profile.means(plant.dt, 1)
    else:
        several = profile.sampled(0.0, plant.dt, _MIDDLES)
    return plant(state, several.mean(axis=1), time)


@checked(refused, x0=reals(), steps=a_count(), progress=PROGRESS)
def simulate(  # noqa: PLR0913 - a closed loop in one call
    plant: AnyPlant,
    controller: Controller,
    x0: ArrayLike,
    *,
    steps: int,
    rng: np.random.Generator | None = None,
    seed: int | Sequence[int] | None = None,
    progress: ProgressGiven = True,
) -> Trajectory:
    """Simulate the closed loop over `steps` control intervals.

    Args:
        plant: A `Plant`; a `control.InputOutputSystem` with states, continuous or
            sampled with the controller's dt; or any object with `step(x, u, dt)`, which
            returns the state after dt seconds. Only a `Plant` has a path between the
            control instants.
        controller: Controller that decides at each control instant.
        x0: State at the start, shape (nx,).
        steps: Number of control intervals.
        rng: Source of all randomness; either this or a seed.
        seed: Seed of a new generator.
        progress: True: shown on a terminal and in a notebook if it takes more than two
            seconds. False: not shown. A function is called with (finished steps, all
            steps, "simulating") after each step.

    Returns:
        The trajectory of the whole run.

    Raises:
        InvalidProblemError: If x0 does not fit the plant, or the intervals differ.
        DivergedError: If a state of the plant is no longer finite, or its algebraic
            equations are not solved.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=3.0,
        ...     intervals=6, stage_cost=x[0] ** 2 + x[1] ** 2 + u**2,
        ...     bounds=ss.Bounds(controls=(-1, 1)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> plant = ss.Plant(problem.model, dt=problem.dt, substeps=5)
        >>> loop = ss.simulate(
        ...     plant, ss.RecedingHorizon(planner=planner), [1.0, 0.0], steps=12, seed=0
        ... )
        >>> loop.states.shape, loop.controls.shape
        ((2, 13), (1, 12))
    """
    rng = generator_of(rng, seed)
    if isinstance(plant, Plant):
        warn_of_units(plant.model.unit_conflicts())
    flown: list[Step] = []
    with shown(progress, "simulate", "simulating", total=steps) as told:
        for step in fly(plant, controller, x0, steps=steps, rng=rng):
            flown.append(step)
            told(len(flown), steps, "simulating")
    return collected(plant_of(plant, controller.dt), flown)


@checked(
    refused,
    plant=of_kind(Plant | SteppedPlant, "a Plant or a SteppedPlant"),
    steps=several(of_kind(Step, "a Step"), "a sequence of Steps"),
)
def collected(plant: Plant | SteppedPlant, steps: Sequence[Step]) -> Trajectory:
    """Join finished steps, numbered from 0 without a gap, to a trajectory.

    Args:
        plant: The plant of the run.
        steps: The finished steps, at least one.

    Raises:
        InvalidProblemError: If there is no step, or one is missing.
    """
    if not steps:
        raise InvalidProblemError("a trajectory needs at least one finished step")
    numbers = [step.number for step in steps]
    if numbers != list(range(len(steps))):
        raise InvalidProblemError(
            f"steps must be numbered from 0 on without a gap, got {numbers}"
        )
    dense = np.hstack([steps[0].state[:, None], *[s.dense_states for s in steps]])
    times, dense_times = _times(plant, steps)
    if isinstance(plant, Plant) and plant.clock:
        # Steps of phases differ in length, so the plant's own clock counts.
        dense_times = dense[plant.state_names.index(plant.clock)]
        times = dense_times[:: plant.substeps]
    return Trajectory(
        times=times,
        states=dense[:, :: plant.substeps],
        controls=np.stack([s.decision.control for s in steps], axis=1),
        dense_times=dense_times,
        dense_states=dense,
        decisions=tuple(s.decision for s in steps),
        step_seconds=np.array([s.seconds for s in steps]),
        outputs=_outputs(plant, steps, dense_times, dense),
        output_names=plant.output_names,
        state_names=plant.state_names,
        control_names=plant.control_names,
        units=plant.units,
    )


def _outputs(
    plant: Plant | SteppedPlant, steps: Sequence[Step], times: Array, states: Array
) -> Array:
    """Return the outputs at the plant's steps, shape (ny, T * m + 1)."""
    if not plant.output_names:
        return np.empty((0, times.size))
    m, found = plant.substeps, []
    for step in steps:
        own = plant if step.dt is None else plant.with_interval(step.dt)
        if step.decision.decided and isinstance(own, Plant):
            own = own.with_decided(step.decision.decided)
        first = step.number * m
        last = first + m + (step is steps[-1])  # The last one includes the end.
        u = _begins(step.decision, own.dt, m)[:, : last - first]
        found.append(own.outputs(states[:, first:last], u, times[first:last]))
    return np.hstack(found)


def _begins(decision: Decision, dt: float, m: int) -> Array:
    """Return the acting controls from m steps on, and the last again, (nu, m + 1)."""
    profile = decision.profile
    if profile is None:
        return np.repeat(decision.received[:, None], m + 1, axis=1)
    if not profile.is_held:
        return profile.ends(dt, m)
    means = profile.means(dt, m)
    return np.hstack([means, means[:, -1:]])


def _times(plant: Plant | SteppedPlant, steps: Sequence[Step]) -> tuple[Array, Array]:
    """Return the control instants and the times of the plant's steps [s]."""
    count, m = len(steps), plant.substeps
    if all(step.dt is None for step in steps):
        # Not a running sum, which would add a rounding error at each step.
        end = count * plant.dt
        return np.linspace(0.0, end, count + 1), np.linspace(0.0, end, count * m + 1)
    lengths = np.array([step.dt or plant.dt for step in steps])
    times = np.concatenate([[0.0], np.cumsum(lengths)])
    parts = np.arange(1, m + 1) / m
    dense = (times[:-1, None] + lengths[:, None] * parts).ravel()
    return times, np.concatenate([[0.0], dense])
