"""A part of a simulator's states and controls, by name and in any order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    NAMES,
    a_number,
    checked,
    having,
    mapping,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.simulators.common import STEP, require_known, require_last, vector

_NOTHING: Mapping[str, float] = MappingProxyType({})
_VALUES = mapping(text(), a_number(), words="a mapping of names to numbers")


class Named(Protocol):
    """Interface of a simulator with names, such as `AircraftPlant`."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls."""

    def start_at(self, x: Array, /) -> ArrayLike:
        """Begin a run; see `swarmstart.Simulator`."""

    def step(self, x: Array, u: Array, dt: float, /) -> ArrayLike:
        """Return the state after a step; see `swarmstart.Steps`."""


@checked(
    refused,
    simulator=having("state_names", "start_at", words="a simulator with state_names"),
    states=NAMES,
    controls=NAMES,
    start=_VALUES,
    held=_VALUES,
)
class SelectedPlant(Called):
    """A simulator with chosen states and controls.

    Attributes:
        state_names: Names of the chosen states.
        control_names: Names of the chosen controls.

    Example:
        >>> import swarmstart as ss
        >>> class Tank:
        ...     state_names, control_names = ("level", "heat"), ("inflow", "power")
        ...     def start_at(self, x):
        ...         return x
        ...     def step(self, x, u, dt):
        ...         return x + dt * u
        >>> level = ss.SelectedPlant(
        ...     Tank(), states=["level"], controls=["inflow"], held={"power": 5.0}
        ... )
        >>> level.step(level.start_at([1.0]), [0.5], 2.0)
        array([2.])
    """

    def __init__(
        self,
        simulator: Named,
        *,
        states: Sequence[str],
        controls: Sequence[str],
        start: Mapping[str, float] = _NOTHING,
        held: Mapping[str, float] = _NOTHING,
    ) -> None:
        """Keep the simulator and the choice.

        Args:
            simulator: The simulator, with names of its states and controls.
            states: Names of the simulator's states that are chosen, in the new order.
            controls: Names of the simulator's controls that are chosen, in the new
                order.
            start: Name of a state that is not chosen -> its value at the start of a
                run; 0 if it is not given.
            held: Name of a control that is not chosen -> its value; 0 if it is not
                given.

        Raises:
            SimulatorError: If the simulator has no state or control of a given name.
        """
        self._name, self._simulator = type(simulator).__name__, simulator
        known = tuple(simulator.state_names), tuple(simulator.control_names)
        for role, names, all_ in (
            ("states", [*states, *start], known[0]),
            ("controls", [*controls, *held], known[1]),
        ):
            require_known(self._name, role, names, all_)
        self.state_names, self.control_names = tuple(states), tuple(controls)
        self._states = [known[0].index(name) for name in states]
        self._controls = [known[1].index(name) for name in controls]
        self._start = np.array([start.get(name, 0.0) for name in known[0]])
        self._held = np.array([held.get(name, 0.0) for name in known[1]])
        self._last: Array | None = None

    @checked(refused, x=reals(axes=1))
    def start_at(self, x: ArrayLike) -> Array:
        """Begin a run, and return the start values of the selected states, shape (nx,).

        Args:
            x: Values of the selected states, shape (nx,).

        Raises:
            SimulatorError: As the simulator raises it.
        """
        whole = self._start.copy()
        whole[self._states] = vector(self._name, "the state", x, self.state_names)
        return self._found(self._simulator.start_at(whole))

    @checked(refused, x=reals(axes=1), u=reals(axes=1), dt=STEP)
    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the chosen states after a step, shape (nx,).

        Args:
            x: The chosen states that were returned last, shape (nx,).
            u: Chosen controls held over the step, shape (nu,).
            dt: Length of the step [s].

        Raises:
            SimulatorError: If `x` is not the array that was returned last, or as the
                simulator raises it.
        """
        last = self._last
        chosen = None if last is None else last[self._states]
        require_last(self._name, np.asarray(x, dtype=np.float64), chosen)
        whole, self._last = self._held.copy(), None
        whole[self._controls] = vector(
            self._name, "the controls", u, self.control_names
        )
        return self._found(self._simulator.step(np.array(last), whole, dt))

    def _found(self, after: ArrayLike) -> Array:
        """Keep the whole state, and return the chosen states."""
        self._last = np.asarray(after, dtype=np.float64)
        return self._last[self._states]
