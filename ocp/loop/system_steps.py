"""Steps of a system of python-control, simulated without conversion.

    continuous   solve_ivp over the interval with the input held (DOP853 at rtol 1e-10;
                 Radau if that takes too many steps, as it does for stiff systems)
    sampled      its dynamics, once an interval

So a system whose functions do not work on CasADi symbols can still be a plant.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import DivergedError
from swarmstart.ocp.system.control_systems import InvalidSystemError, in_state_space

RTOL = 1e-10
_SMALLEST = 1e-3
"""Size below which errors of a state are absolute, relative to its present size."""
_MOST_CALLS = 20_000
"""Calls of the dynamics in an interval, after which the implicit method takes over."""


def is_system(plant: object) -> bool:
    """Return whether an object is a system of python-control.

    If python-control has not been imported yet, no object is one.
    """
    control = sys.modules.get("control")
    return control is not None and isinstance(plant, control.InputOutputSystem)


class SystemSteps:
    """A system of python-control with `step(x, u, dt)`.

    Attributes:
        state_names: The system's names of the states.
        control_names: The system's names of the inputs.
        output_names: The system's names of the outputs.
    """

    def __init__(self, system: Any, *, dt: float) -> None:
        """Keep the system.

        Args:
            system: A system of python-control with states.
            dt: Length of a control interval [s].

        Raises:
            InvalidSystemError: If it has no states, no known dt, or is sampled with
                another dt.
        """
        self._system = found = in_state_space(system)
        if found.dt and not np.isclose(found.dt, dt, rtol=1e-9, atol=0.0):
            raise InvalidSystemError(
                f"system {found.name!r} is sampled with dt = {found.dt:g} s, the "
                f"control intervals are {dt:g} s long: make them equal, or give the "
                "continuous system"
            )
        self.state_names = tuple(found.state_labels)
        self.control_names = tuple(found.input_labels)
        self.output_names = tuple(found.output_labels)

    def step(self, x: Array, u: Array, dt: float, time: float = 0.0) -> Array:
        """Return the state after an interval, shape (nx,); see `Steps.step`.

        Args:
            x: State at the start of the interval, shape (nx,).
            u: Input held over it, shape (nu,).
            dt: Length of the interval [s].
            time: Time at its start [s].

        Raises:
            InvalidSystemError: If the system has another number of inputs.
            DivergedError: If the integration does not reach the end of the interval.
        """
        system = self._system
        if u.size != system.ninputs:
            raise InvalidSystemError(
                f"system {system.name!r} has {system.ninputs} inputs, the controller "
                f"gives {u.size} controls"
            )
        if system.dt:
            return np.asarray(system.dynamics(time, x, u), dtype=np.float64)
        return _integrated(system, x, u, (time, time + dt))

    def outputs(self, states: Array, controls: Array, times: Array) -> Array:
        """Return the outputs, shape (ny, n).

        Args:
            states: Shape (nx, n).
            controls: Shape (nu, n).
            times: Shape (n,) [s].
        """
        columns = zip(times, states.T, controls.T, strict=True)
        rows = [np.ravel(self._system.output(t, x, u)) for t, x, u in columns]
        return np.array(rows, dtype=np.float64).T


class _TooManyCalls(Exception):  # noqa: N818 - no error
    """The explicit method takes too many steps."""


def _integrated(system: Any, x: Array, u: Array, span: tuple[float, float]) -> Array:
    """Return the state at the end of an interval with the input held."""
    from scipy.integrate import solve_ivp  # 0.2 s, for these plants only

    calls = 0

    def rate(t: float, state: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls == _MOST_CALLS:
            raise _TooManyCalls
        return np.asarray(system.dynamics(t, state, u), dtype=np.float64)

    def finite_rate(t: float, state: Array) -> Array:
        found = rate(t, state)
        if not np.isfinite(found).all():
            raise _diverged(system, span, f"its rates are not finite at {t:g} s")
        return found

    # A state at zero has no size of its own: it gets that of its motion.
    moved = (span[1] - span[0]) * np.abs(finite_rate(span[0], x))
    atol = _SMALLEST * RTOL * np.maximum(np.abs(x), moved)
    atol = np.maximum(atol, np.finfo(np.float64).tiny)
    try:  # DOP853 tries shorter steps where a rate is not finite; Radau cannot.
        found = solve_ivp(rate, span, x, method="DOP853", rtol=RTOL, atol=atol)
    except _TooManyCalls:
        found = solve_ivp(finite_rate, span, x, method="Radau", rtol=RTOL, atol=atol)
    if not found.success:
        raise _diverged(system, span, found.message)
    return np.asarray(found.y[:, -1], dtype=np.float64)


def _diverged(system: Any, span: tuple[float, float], why: str) -> DivergedError:
    return DivergedError(
        f"system {system.name!r} could not be integrated from {span[0]:g} s to "
        f"{span[1]:g} s: {why}"
    )
