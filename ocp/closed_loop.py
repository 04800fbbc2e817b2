"""A plant under a controller: the closed loop, one control interval after another.

`fly` yields each finished step, so that nothing finished is lost when it is stopped;
`simulate` collects them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.compile_time import stopwatch
from swarmstart.heuristics import generator_of
from swarmstart.ocp.controller import Controller, Decision
from swarmstart.ocp.errors import DivergedError, InvalidProblemError
from swarmstart.ocp.expressions import shortened
from swarmstart.ocp.limits import numbers_of
from swarmstart.ocp.plant import AnyPlant, Plant, SteppedPlant, plant_of
from swarmstart.ocp.presentation import Presented
from swarmstart.ocp.progress import ProgressCallback, tell_nothing

Array = NDArray[np.float64]
_MIDDLES = 100
"""Points in time whose mean is that of linear controls, for an object that holds."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Step:
    """One control interval as it was flown.

    Attributes:
        number: Its number, from 0.
        state: At its beginning, shape (nx,).
        decision: What the controller decided there.
        dense_states: After each of the plant's steps within it, shape (nx, m).
        seconds: Wall time of the decision [s].
        dt: Its length [s], where it is not that of the plant; else None.
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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Trajectory(Presented):
    """A flight.

    Attributes:
        times: Control instants, shape (T + 1,) [s].
        states: At the control instants, shape (nx, T + 1).
        controls: Held from each to the next, or as each interval begins where they
            are linear, shape (nu, T).
        dense_times: The plant's steps, shape (T * m + 1,) [s].
        dense_states: At the plant's steps, shape (nx, T * m + 1).
        decisions: What the controller decided, T of them.
        step_seconds: Wall time of each decision, shape (T,) [s], without that of
            loading and compiling machine code.
        state_names: The model's names of the states; numbered where it has none.
        control_names: The same of the controls.
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

    def __post_init__(self) -> None:
        """Number states and controls that have no names."""
        for role, rows in (("state", self.states), ("control", self.controls)):
            numbered = tuple(f"{role}_{i}" for i in range(rows.shape[0]))
            names = tuple(getattr(self, f"{role}_names")) or numbered
            object.__setattr__(self, f"{role}_names", names)

    def __repr__(self) -> str:
        """Return length, sizes and how the plans went, in a few lines."""
        plans = [plan for decision in self.decisions for plan in decision.plans]
        feasible = sum(plan.feasible for plan in plans)
        return "\n".join(
            [
                f"Trajectory of {len(self.decisions)} steps over {self.times[-1]:g} s: "
                f"{self.states.shape[0]} states, {self.controls.shape[0]} controls",
                f"  plans: {feasible} of {len(plans)} feasible",
                f"  decisions: {float(np.median(self.step_seconds)):.3g} s (median)",
            ]
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
    """Yield the closed loop, one finished control interval at a time.

    Args:
        plant: A `Plant`, or any object with `step(x, u, dt)`.
        controller: The controller.
        x0: State at the first interval flown here, shape (nx,).
        steps: Number of the interval to stop before, if no decision ends the flight.
        rng: Source of all randomness.
        done: Number of the first interval; above 0 where a flight goes on.
        previous: The decision of the interval before it; None at the start.

    Raises:
        InvalidProblemError: If x0 does not fit the plant, or intervals differ.
        DivergedError: If the plant leaves the finite numbers, or does not solve its
            algebraic equations.

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
    for number in range(done, steps):
        time = number * (before or plant.dt)
        with stopwatch() as watch:
            decision = controller.decide(time, state, previous, rng=rng)
            seconds = watch.seconds
        if number == 0 and decision.start is not None:
            state = decision.start
        if decision.dt is not None and decision.dt != plant.dt:
            plant = plant.with_interval(decision.dt)
        if decision.decided and isinstance(plant, Plant):
            plant = plant.with_decided(decision.decided)
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


def _checked(
    plant: AnyPlant, controller: Controller, x0: ArrayLike
) -> tuple[Plant | SteppedPlant, Array]:
    """Return a plant and the state it starts at, which fit each other."""
    if not (hasattr(controller, "decide") and hasattr(controller, "dt")):
        raise InvalidProblemError(
            "controller must have decide() and dt, such as RecedingHorizon, "
            f"got {shortened(controller)}"
        )
    plant = plant_of(plant, controller.dt)
    state = numbers_of("x0", x0)
    nx = plant.model.nx if isinstance(plant, Plant) else state.size
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

    It holds one control, or several one after another, or they are linear over its
    steps. An object with step(x, u, dt) holds the mean.
    """
    profile = decision.profile
    if profile is None:
        return plant(state, decision.control, time)
    if isinstance(plant, Plant):
        if profile.is_held:
            return plant(state, profile.sampled(0.0, plant.dt, plant.substeps), time)
        return plant.along(state, profile.ends(plant.dt, plant.substeps), time)
    if profile.is_held:
        several = profile.sampled(0.0, plant.dt, plant.substeps)
    else:
        several = profile.sampled(0.0, plant.dt, _MIDDLES)
    return plant(state, several.mean(axis=1), time)


def simulate(  # noqa: PLR0913 - a closed loop in one call
    plant: AnyPlant,
    controller: Controller,
    x0: ArrayLike,
    *,
    steps: int,
    rng: np.random.Generator | None = None,
    seed: int | Sequence[int] | None = None,
    progress: ProgressCallback = tell_nothing,
) -> Trajectory:
    """Return the whole closed loop over `steps` control intervals.

    Args:
        plant: A `Plant`, or any object with `step(x, u, dt)`, which returns the state
            after dt seconds; the flight then has no path between the control instants.
        controller: The controller.
        x0: State at the start, shape (nx,).
        steps: Number of control intervals.
        rng: Source of all randomness; either this or a seed.
        seed: Seed of a new generator.
        progress: Told (finished steps, all steps, "flying") after each step.

    Raises:
        InvalidProblemError: As in `fly`.

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
    flown: list[Step] = []
    for step in fly(plant, controller, x0, steps=steps, rng=rng):
        flown.append(step)
        progress(len(flown), steps, "flying")
    return collected(plant_of(plant, controller.dt), flown)


def collected(plant: Plant | SteppedPlant, steps: Sequence[Step]) -> Trajectory:
    """Return finished steps, from number 0 on without a gap, as a trajectory.

    Raises:
        InvalidProblemError: If there is none, or one is missing.
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
        state_names=plant.state_names,
        control_names=plant.control_names,
    )


def _times(plant: Plant | SteppedPlant, steps: Sequence[Step]) -> tuple[Array, Array]:
    """Return the control instants and the times of the plant's steps [s]."""
    count, m = len(steps), plant.substeps
    if all(step.dt is None for step in steps):
        end = count * plant.dt
        return np.linspace(0.0, end, count + 1), np.linspace(0.0, end, count * m + 1)
    lengths = np.array([step.dt or plant.dt for step in steps])
    times = np.concatenate([[0.0], np.cumsum(lengths)])
    parts = np.arange(1, m + 1) / m
    dense = (times[:-1, None] + lengths[:, None] * parts).ravel()
    return times, np.concatenate([[0.0], dense])
