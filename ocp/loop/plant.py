"""Plants: a model integrated finely, a system, or any object that makes a step.

A `Plant` is integrated by the classical Runge-Kutta method, or, if it is stiff, by
RODAS4 with each step divided into eight parts, since its parameters may jump between
steps. An object with `step(x, u, dt)`, as a system of python-control (system_steps.py),
is known at the control instants only, so nothing is checked, interpolated or measured
between them.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    function,
    having,
    mapping,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import DivergedError, InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened, symbol_names
from swarmstart.ocp.common.limits import numbers_of
from swarmstart.ocp.common.pickling import Called, made
from swarmstart.ocp.integration.integrators import (
    INSIDE,
    MORE_PARTS,
    held_step,
    linear_step,
)
from swarmstart.ocp.loop.system_steps import SystemSteps, is_system
from swarmstart.ocp.system.algebraic import SOLVED_WITHIN
from swarmstart.ocp.system.model import (
    Model,
    jump_of,
    outputs_of,
    shown_units,
    unsolved_of,
)

NOTHING_DECIDED: Mapping[str, float] = MappingProxyType({})
_LAST_PART = 1e-3
"""Last part of a step within which a jump counts as one at its end."""
_SECONDS = a_number(above=0)
_ROWS, _TIMES = reals(array=True, axes=2), reals(array=True, axes=1)
_STEP = {
    "state": reals(array=True, axes=1),
    "control": reals(array=True),
    "time": a_number(),
}


def at_both_ends(
    rows: Callable[[Array], Array], begins: Array, ends: Array
) -> tuple[Array, Array]:
    """Return values of functions at the beginnings and at the ends of steps.

    Both have the shape (rows, n).

    If a function jumps at the end of a step, its value just before the jump is taken.

    Args:
        rows: The functions: times, shape (n,) [s] -> values, shape (rows, n).
        begins: Times at which the steps begin, shape (n,) [s].
        ends: Times at which they end, shape (n,) [s].
    """
    just_before = ends - _LAST_PART * (ends - begins)
    times = np.stack([begins, just_before, ends], axis=1)
    values = rows(times.ravel())  # One call, since it may be slow.
    first, before, at = np.moveaxis(values.reshape(len(values), -1, 3), 2, 0)
    jumps = np.abs(at - before) > np.abs(at - first) / 2
    return first, np.where(jumps, before, at)


def rows_before_jumps(rows: Callable[[Array], Array], times: Array) -> Array:
    """Return values of functions along control intervals, shape (rows, T * (m + 1)).

    A function that jumps at the end of an interval has, like a control, its value
    before the jump there; the next interval begins with the value after the jump.

    Args:
        rows: The functions: times, shape (n,) [s] -> values, shape (n,) or (rows, n).
        times: Times along T intervals, shape (T, m + 1) [s]; if the end of an interval
            changes the state, the last time of each row occurs twice.
    """

    def values(at: Array) -> Array:
        return np.atleast_2d(rows(at))

    found = values(times.reshape(-1)).reshape(-1, *times.shape).copy()
    last = int(np.searchsorted(times[0], times[0, -1]))  # Before the state's jump.
    found[:, :, last] = at_both_ends(values, times[:, last - 1], times[:, last])[1]
    return found.reshape(len(found), -1)


@checked(
    refused,
    model=of_kind(Model, "a Model"),
    dt=_SECONDS,
    substeps=a_count(least=1),
    parameters=optional(function()),
    signals=optional(function()),
    integrator=text(),
    decided=mapping(words="a mapping of names to numbers"),
    clock=text(),
)
class Plant(Called):
    """A model, integrated finely over control intervals with held controls.

    Attributes:
        model: The model.
        dt: Length of a control interval [s].
        substeps: Number of integrator steps in a control interval.
        clock: Name of the state that is the time of the run; empty: no such state.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u, k = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("k")
        >>> model = ss.Model(states=x, controls=u, ode=-k * x + u, parameters=k)
        >>> plant = ss.Plant(
        ...     model, dt=0.5, substeps=5, parameters=lambda t: np.full((1, t.size), 2)
        ... )
        >>> after = plant(np.array([1.0]), np.array([0.0]))
        >>> after.shape, round(float(after[0, -1]), 4)
        ((1, 5), 0.3679)
    """

    def __init__(  # noqa: PLR0913 - a model and what drives it
        self,
        model: Model,
        *,
        dt: float,
        substeps: int,
        parameters: Callable[[Array], Array] | None = None,
        signals: Callable[[Array], Array] | None = None,
        integrator: str = "rk4",
        decided: Mapping[str, float] = NOTHING_DECIDED,
        clock: str = "",
    ) -> None:
        """Compile the plant.

        Args:
            model: The model.
            dt: Length of a control interval [s].
            substeps: Number of integrator steps in a control interval, at least 1.
            parameters: Times (n,) [s] -> the model's parameters (np, n), except those
                that are decided; each value is held over one integrator step. None: no
                such parameters.
            signals: Times (n,) [s] -> the model's signals (ns, n), linear over one
                integrator step; one that jumps at a step's end has its earlier value
                until then. None: the model has no signals.
            integrator: A key of INTEGRATORS; "stiff" for a stiff model.
            decided: Name of a parameter that plans decide -> its value before the first
                plan.
            clock: Name of the state that is the time of the run [s], as for phases;
                empty: the time follows from the intervals of length dt.

        Raises:
            InvalidProblemError: If the model has parameters or signals that are not
                given, `decided` names unknown parameters, or a number is out of range.
        """
        if model.ns and signals is None:
            raise InvalidProblemError(
                f"the model of a plant has {model.ns} signals: expected a function of "
                "time for them, got none"
            )
        names = symbol_names(model.parameters)
        if unknown := [name for name in decided if name not in names]:
            raise InvalidProblemError(
                f"decided must name parameters of a plant, some of "
                f"{', '.join(names) or 'nothing'}, got {unknown}"
            )
        if model.np > len(decided) and parameters is None:
            raise InvalidProblemError(
                f"the model of a plant has {model.np - len(decided)} parameters: "
                "expected a function of time for them, got none; parameters that only "
                "plans use, such as a set point, need not be in the plant's model"
            )
        if clock and clock not in model.state_names:
            raise InvalidProblemError(
                f"clock must name a state, one of {', '.join(model.state_names)}, "
                f"got {clock!r}"
            )
        model.require_step(dt)
        self.model, self.dt, self.substeps = model, dt, substeps
        # Signals that only costs and constraints use are not the model's.
        self._parameters, self._signals = parameters, signals if model.ns else None
        self._decided, self._integrator = dict(decided), integrator
        self.clock = clock
        step = held_step(model, dt / substeps, method=integrator, parts=MORE_PARTS)
        self._interval = step.mapaccum("plant", substeps)
        self._linear: ca.Function | None = None
        self._jump = jump_of(model)
        self._unsolved = unsolved_of(model)

    def __call__(self, state: Array, control: Array, time: float = 0.0) -> Array:
        """Return the states after each step of the interval, shape (nx, substeps).

        Args:
            state: State at the start of the interval, shape (nx,).
            control: Control held over the interval, shape (nu,); or several, held one
                after another over equal parts of it, shape (nu, m), with m a divisor of
                the number of steps.
            time: Time at the start of the interval [s].

        Raises:
            DivergedError: If algebraic equations of the model are not solved.
        """
        states = self.until_end(state, control, time)
        return self._ended(
            states, control if control.ndim == 1 else control[:, -1], time
        )

    @checked(refused, state=reals(axes=1), controls=reals(axes=2), time=a_number())
    def along(self, state: Array, controls: Array, time: float = 0.0) -> Array:
        """Return the states after each step; controls are linear in time within a step.

        Args:
            state: State at the start of the interval, shape (nx,).
            controls: Controls at both ends of the steps, shape (nu, substeps + 1).
            time: Time at the start of the interval [s].
        """
        states = self.along_until_end(state, controls, time)
        return self._ended(states, controls[:, -1], time)

    @checked(refused, state=reals(axes=1), controls=reals(axes=2), time=a_number())
    def along_until_end(
        self, state: Array, controls: Array, time: float = 0.0
    ) -> Array:
        """Return the states of `along`, without the jump at the end of the interval.

        Args:
            state: State at the start of the interval, shape (nx,).
            controls: Controls at both ends of the steps, shape (nu, substeps + 1).
            time: Time at the start of the interval [s].
        """
        self._require_sizes(state, controls)
        if self._linear is None:
            step = linear_step(
                self.model, self.dt / self.substeps, method=self._integrator
            )
            self._linear = step.mapaccum("plant", self.substeps)
        both = np.vstack([controls[:, :-1], controls[:, 1:]])
        states = np.array(self._linear(state, both, *self._known(time)))
        return self._solved(state, states, (controls[:, :-1], controls[:, 1:]), time)

    def _ended(self, states: Array, last: Array, time: float) -> Array:
        """Return the states with the jump at the interval's end applied, in place."""
        if not self.model.jumps:
            return states
        end = np.array([time + self.dt])
        # Parameters are held over a step, so those of the last step count.
        begin = time + self.dt * ((self.substeps - 1) / self.substeps)
        jumped = self._jump(
            states[:, -1],
            last,
            self.parameters(np.array([begin]))[:, 0],
            self.varying(end)[:, 0],
        )
        states[:, -1] = np.array(jumped).ravel()
        return states

    @checked(refused, **_STEP)
    def until_end(self, state: Array, control: Array, time: float = 0.0) -> Array:
        """Return the states after each step, without the jump at the interval's end.

        Except for this jump, they are those that a call of the plant returns.

        Args:
            state: State at the start of the interval, shape (nx,).
            control: Control held over it, shape (nu,); or several, as in a call.
            time: Time at the start of the interval [s].

        Raises:
            DivergedError: If algebraic equations of the model are not solved.
        """
        self._require_sizes(state, control)
        held = control[:, None] if control.ndim == 1 else control
        held = np.repeat(held, self.substeps // held.shape[1], axis=1)
        states = np.array(self._interval(state, held, *self._known(time)))
        return self._solved(state, states, (held, held), time)

    def _require_sizes(self, state: Array, control: Array) -> None:
        """Refuse a state or a control of another model."""
        sizes = np.shape(state)[0], np.shape(control)[0]
        if sizes != (self.model.nx, self.model.nu):
            raise InvalidProblemError(
                f"state and control must have {self.model.nx} and {self.model.nu} "
                f"rows, got {sizes[0]} and {sizes[1]}"
            )

    def _known(self, time: float) -> list[Array]:
        """Return the parameters of each step, and the signals and time at its ends."""
        begins = time + self.dt * (np.arange(self.substeps) / self.substeps)
        arguments = [self.parameters(begins)]
        if self.model.varying.numel():
            ends = np.append(begins[1:], time + self.dt)
            both = at_both_ends(self.varying, begins, ends)
            # Both ends of each step, side by side.
            known = np.stack(both, axis=2).reshape(len(both[0]), -1)
            if self.model.time.numel():
                # A little inside, as in a plan: what jumps at an end has the value that
                # it has within the step.
                moved = INSIDE * self.dt / self.substeps
                known[-1] += np.tile([moved, -moved], self.substeps)
            arguments.append(known)
        return arguments

    def _solved(
        self, state: Array, states: Array, controls: tuple[Array, Array], time: float
    ) -> Array:
        """Return the states; raise if the algebraic equations are not solved.

        Args:
            state: State before the first step, shape (nx,).
            states: States after each step, shape (nx, substeps).
            controls: Controls at the start and the end of each step, each
                (nu, substeps).
            time: Time before the first step [s].

        Raises:
            DivergedError: With the time and the residual.
        """
        if not self.model.elimination.unsolved.numel():
            return states
        nodes = time + self.dt * (np.arange(self.substeps + 1) / self.substeps)
        every = np.column_stack([state, states])
        parameters = self.parameters(nodes[:-1])
        for side, u in zip((slice(0, -1), slice(1, None)), controls, strict=True):
            at, times = every[:, side], nodes[side]
            known = parameters, self.varying(times)
            rest = np.abs(np.array(self._unsolved(at, u, *known))).max(axis=0)
            # States that are not finite are reported elsewhere; a residual of NaN is
            # wrong.
            wrong = np.isfinite(at).all(axis=0) & ~(rest <= SOLVED_WITHIN)
            if wrong.any():
                first = int(np.argmax(wrong))
                names = ", ".join(self.model.elimination.names)
                raise DivergedError(
                    f"the plant's algebraic equations are not solved for {names} at "
                    f"{times[first]:.6g} s: their residual is {rest[first]:.3g} of its "
                    f"size, at most {SOLVED_WITHIN:g} is allowed; give Newton's method "
                    "a better start or more iterations"
                )
        return states

    def with_interval(self, dt: float) -> Plant:
        """Return the same plant with another length of the control intervals.

        Args:
            dt: Length of a control interval [s].
        """
        args, named = self._called_with
        again: Plant = made(type(self), args, named | {"dt": dt})
        return again

    @checked(refused, values=mapping(words="a mapping of names to numbers"))
    def with_decided(self, values: Mapping[str, float]) -> Plant:
        """Return the same plant with the parameters that a plan decided.

        Args:
            values: Values by name; names that the plant does not expect are ignored.
        """
        again = copy.copy(self)  # Parameters are arguments: nothing is compiled.
        again._decided = {n: values.get(n, old) for n, old in self._decided.items()}
        again._call_with(decided=again._decided)
        return again

    @checked(refused, times=_TIMES)
    def varying(self, times: Array) -> Array:
        """Return the model's signals and time at given times, shape (ns, n).

        Args:
            times: Shape (n,) [s].
        """
        rows = [] if self._signals is None else [self._signals(times)]
        rows += [times[None, :]] if self.model.time.numel() else []
        return np.vstack([np.empty((0, times.size)), *rows])

    @checked(refused, states=_ROWS, controls=_ROWS, times=_TIMES)
    def outputs(self, states: Array, controls: Array, times: Array) -> Array:
        """Return the outputs of the model, shape (ny, n).

        Args:
            states: Shape (nx, n).
            controls: Shape (nu, n).
            times: Shape (n,) [s].
        """
        known = self.parameters(times), self.varying(times)
        return np.array(outputs_of(self.model)(states, controls, *known))

    @property
    def output_names(self) -> tuple[str, ...]:
        """The model's names of the outputs."""
        return self.model.output_names

    @property
    def state_names(self) -> tuple[str, ...]:
        """The model's names of the states."""
        return self.model.state_names

    @property
    def control_names(self) -> tuple[str, ...]:
        """The model's names of the controls."""
        return self.model.control_names

    @property
    def units(self) -> dict[str, str]:
        """The model's units of states, controls and outputs, by name."""
        return shown_units(self.model)

    @checked(refused, times=_TIMES)
    def parameters(self, times: Array) -> Array:
        """Return the parameters held over steps of the integrator, shape (np, n).

        Args:
            times: Beginnings of the steps, shape (n,) [s].
        """
        given = np.empty((0, times.size))
        if self._parameters is not None:
            given = self._parameters(times)
        if not self._decided:
            return given
        rows = iter(given)
        return np.stack(
            [
                np.full(times.size, self._decided[name])
                if name in self._decided
                else next(rows)
                for name in symbol_names(self.model.parameters)
            ]
        )


@runtime_checkable
class Steps(Protocol):
    """Interface of any plant: its step over one control interval.

    It may also have `state_names` and `control_names`, which a run then takes over.
    """

    def step(self, x: Array, u: Array, dt: float, /) -> ArrayLike:
        """Return the state after an interval, shape (nx,).

        Args:
            x: State at the start of the interval, shape (nx,).
            u: Control held over it, shape (nu,).
            dt: Length of the interval [s].
        """


@runtime_checkable
class Simulator(Steps, Protocol):
    """Interface of a plant that keeps its state inside, such as an FMU.

    A run begins with `start_at`. After that `step` accepts no other state than the one
    that was returned last.
    """

    def start_at(self, x: Array, /) -> ArrayLike:
        """Begin a run, and return the state at which it begins, shape (nx,).

        Args:
            x: The state that is asked for, shape (nx,).
        """


@checked(
    refused, steps=having("step", words="an object with step(x, u, dt)"), dt=_SECONDS
)
class SteppedPlant(Called):
    """An object with `step(x, u, dt)` as a plant with one step per interval.

    Attributes:
        dt: Length of a control interval [s].
        substeps: Always 1.
        state_names: The object's names of the states, if it has any.
        control_names: The object's names of the controls, if it has any.
        output_names: Names of the outputs if the object is a system of python-control;
            else empty.
        units: The object's units of states and controls by name, if it has any.

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> class Tank:
        ...     def step(self, x, u, dt):
        ...         return x + dt * (u - 0.5 * x)
        >>> plant = ss.SteppedPlant(Tank(), dt=0.1)
        >>> plant(np.array([1.0]), np.array([0.0]))
        array([[0.95]])
    """

    substeps = 1

    def __init__(self, steps: Steps, *, dt: float) -> None:
        """Keep the object.

        Args:
            steps: Object with `step(x, u, dt)`.
            dt: Length of a control interval [s].
        """
        self.dt, self._steps = dt, steps
        self.state_names: tuple[str, ...] = tuple(getattr(steps, "state_names", ()))
        self.control_names: tuple[str, ...] = tuple(getattr(steps, "control_names", ()))
        self._system = steps if isinstance(steps, SystemSteps) else None
        self.output_names = () if self._system is None else self._system.output_names
        self.units: dict[str, str] = dict(getattr(steps, "units", {}))

    def with_interval(self, dt: float) -> SteppedPlant:
        """Return the same plant with control intervals of another length [s]."""
        return SteppedPlant(self._steps, dt=dt)

    @checked(refused, **{**_STEP, "control": reals(array=True, axes=1)})
    def __call__(self, state: Array, control: Array, time: float = 0.0) -> Array:
        """Return the state after the interval, shape (nx, 1); see Plant."""
        if self._system is None:
            return stepped(self._steps, state, control[:, None], self.dt)
        after = self._system.step(state, control, self.dt, time)
        return _returned("step", after, state).reshape(-1, 1)

    @checked(refused, state=reals(axes=1))
    def start_at(self, state: Array) -> Array:
        """Begin a run, and return the state at which it begins, shape (nx,).

        It is the state that is asked for, unless a simulator returns another one.

        Args:
            state: The state that is asked for, shape (nx,).
        """
        return begun(self._steps, state)

    @property
    def nx(self) -> int | None:
        """Number of states of a system of python-control; None for any other object."""
        return None if self._system is None else len(self.state_names)

    @checked(refused, states=_ROWS, controls=_ROWS, times=_TIMES)
    def outputs(self, states: Array, controls: Array, times: Array) -> Array:
        """Return the outputs of a system of python-control, shape (ny, n); see Plant.

        Any other object has no outputs.
        """
        if self._system is None:
            return np.empty((0, times.size))
        return self._system.outputs(states, controls, times)


def begun(steps: Steps, state: Array) -> Array:
    """Begin a run of a user's object, and return the state at which it begins, (nx,).

    Args:
        steps: The object; only a `Simulator` has to be begun.
        state: The state that is asked for, shape (nx,).
    """
    if not isinstance(steps, Simulator):
        return state
    return _returned("start_at", steps.start_at(state.copy()), state)


def stepped(steps: Steps, state: Array, controls: Array, dt: float) -> Array:
    """Return the states after each of several steps of a user's object, shape (nx, n).

    Args:
        steps: Object with `step(x, u, dt)`.
        state: State before the first step, shape (nx,).
        controls: Controls of each step, shape (nu, n).
        dt: Length of a step [s].
    """
    found = []
    for control in controls.T:
        # Copies: a user's object may change its arguments.
        after = steps.step(state.copy(), control.copy(), dt)
        state = _returned("step", after, state)
        found.append(state)
    return np.stack(found, axis=1)


def _returned(call: str, found: ArrayLike, state: Array) -> Array:
    """Return a state that a user's object has returned, shape (nx,), checked."""
    after = numbers_of(f"the state that {call}() returns", found)
    if after.size != state.size:
        raise InvalidProblemError(
            f"{call}() must return a state of shape ({state.size},), got {after.shape}"
        )
    return after.reshape(-1)


AnyPlant = Plant | SteppedPlant | Steps


def plant_of(plant: object, dt: float) -> Plant | SteppedPlant:
    """Return a plant in the form that a closed loop uses.

    Args:
        plant: A `Plant`, an object with `step(x, u, dt)`, or a system of
            python-control.
        dt: Length of a control interval [s].

    Raises:
        InvalidProblemError: If it is not a plant, or a system of python-control that
            has no states or another sampling time.
    """
    if isinstance(plant, Plant | SteppedPlant):
        return plant
    if is_system(plant):
        return SteppedPlant(SystemSteps(plant, dt=dt), dt=dt)
    if isinstance(plant, Steps):
        return SteppedPlant(plant, dt=dt)
    raise InvalidProblemError(
        "plant must be a swarmstart.Plant, a system of python-control, or have "
        f"step(x, u, dt), got {shortened(plant)}"
    )
