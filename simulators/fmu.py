"""An FMU for co-simulation as a plant; FMPy calls it.

The FMU keeps its state: a step accepts the state that was returned last, and no other.
A run can begin at a given state if the FMU lets its states be set before a run (initial
"exact" or "approx"), or if the FMU begins at this state by itself.
"""

from __future__ import annotations

import contextlib
import math
import tempfile
import weakref
from collections import deque
from collections.abc import Mapping, Sequence
from ctypes import c_double, c_uint
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    NAMES,
    PATH,
    a_number,
    checked,
    mapping,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.errors import brief, load_optional
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.common.limits import numbers_of, require_number
from swarmstart.ocp.common.pickling import Called
from swarmstart.simulators.archive import Described, described, require_variables
from swarmstart.simulators.common import (
    LONGEST_STEP,
    STEP,
    SimulatorError,
    require_last,
    require_start,
    vector,
)

_NOTHING: Mapping[str, float] = MappingProxyType({})
_KEPT_WORDS = 5
"""Number of the FMU's last messages that are kept."""


@checked(
    refused,
    file=PATH,
    states=NAMES,
    controls=NAMES,
    parameters=mapping(text(), a_number(), words="a mapping of names to numbers"),
)
class FmuPlant(Called):
    """An FMU as a plant.

    Attributes:
        state_names: Names of the variables that are the state.
        control_names: Names of the inputs that are the controls.
        units: Name of a variable -> its unit, for the variables that state one.
        bounds: Least and largest values of the controls, each (nu,).
        start: State at which the FMU begins by itself, shape (nx,).
        can_restore: True if the FMU's state can be saved and restored.

    Example:
        >>> import swarmstart as ss
        >>> try:
        ...     ss.FmuPlant("missing.fmu", states=["angle"], controls=["torque"])
        ... except ss.SimulatorError as error:
        ...     print(error)
        missing.fmu: expected an FMU, found no file
    """

    def __init__(
        self,
        file: str | Path,
        *,
        states: Sequence[str],
        controls: Sequence[str],
        parameters: Mapping[str, float] = _NOTHING,
    ) -> None:
        """Unpack and load an FMU: its code runs with all rights of this process.

        Args:
            file: Path of the FMU.
            states: Names of variables that are the state, each a number; outputs are
                allowed.
            controls: Names of inputs that are the controls; they are held over a step.
            parameters: Name of a parameter -> its value.

        Raises:
            SimulatorError: If the file is no FMU that this machine can run, or the FMU
                lacks a variable or fails.
            MissingPackageError: If FMPy is not installed (`swarmstart[fmi]`).
        """
        self._name = str(file)
        self._described = found = described(Path(file))
        require_variables(found, "states", states)
        require_variables(found, "controls", controls, "input")
        require_variables(found, "parameters", list(parameters), "parameter")
        self.state_names, self.control_names = tuple(states), tuple(controls)
        self.units = found.units([*states, *controls])
        self.bounds = found.bounds(controls)
        self.can_restore = found.can_restore
        self._states, self._inputs = found.references(states), len(controls)
        self._controls = found.references(controls)
        given = zip(found.references([*parameters]), parameters.values(), strict=True)
        self._given = {reference: float(value) for reference, value in given}
        settable = [name for name in states if found.can_be_set(name)]
        self._settable = [self.state_names.index(name) for name in settable]
        self._last: list[float] | None = None
        self._is_broken = False
        self._library = self._loaded()
        self.start = np.array(self._begun({}))

    @checked(refused, x=reals(axes=1))
    def start_at(self, x: ArrayLike) -> Array:
        """Begin a run, and return the state at which it begins, shape (nx,).

        Args:
            x: State, shape (nx,).

        Raises:
            SimulatorError: If the FMU fails, or cannot begin there.
        """
        asked = vector(self._name, "the state", x, self.state_names)
        first = {self._states[row]: float(asked[row]) for row in self._settable}
        found = self._begun(first)
        require_start(self._name, asked, np.array(found), self.state_names)
        self._last = found
        return np.array(found)

    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the state after a step, shape (nx,).

        Args:
            x: The state that was returned last, shape (nx,).
            u: Controls held over the step, shape (nu,).
            dt: Length of the step [s].

        Raises:
            SimulatorError: If `x` is not the state that was returned last, or the FMU
                fails.
        """
        # As lists: an FMU may take no longer for a step than one call of NumPy.
        state, control = _numbers("x", x), _numbers("u", u)
        dt = dt if type(dt) is float else require_number("dt", dt)
        if state != self._last:
            require_last(self._name, np.array(state), self._last)
        if len(control) != self._inputs or not all(map(math.isfinite, control)):
            vector(self._name, "the controls", control, self.control_names)  # Raises.
        if not 0.0 < dt <= LONGEST_STEP:
            raise refused("dt", dt, STEP.allowed)
        self._last, self._is_broken = None, True  # Until the step has succeeded.
        after = self._library.stepped(control, self._time, dt)
        self._time += dt
        self._last, self._is_broken = after, False
        return np.array(after)

    def close(self) -> None:
        """Unload the FMU and remove its unpacked folder.

        Both also happen when the plant is no longer referenced.
        """
        self._last, self._is_broken = None, False
        self._library.close()

    def _loaded(self) -> _Library:
        return _Library(self._described, read=self._states, set_=self._controls)

    def _begun(self, first: Mapping[int, float]) -> list[float]:
        """Return the state at the begin of a new run."""
        if self._is_broken:  # Its own memory may be damaged.
            self._library.close()
            self._library = self._loaded()
        self._last, self._time, self._is_broken = None, 0.0, True
        found = self._library.begun({**self._given, **first})
        self._is_broken = False
        return found


class _Library:
    """The loaded library of an FMU: both versions by the same calls."""

    def __init__(self, found: Described, *, read: list[int], set_: list[int]) -> None:
        """Unpack, load and instantiate it.

        Args:
            found: What the FMU says of itself.
            read: References of what is read after each step.
            set_: References of what is set before each step.

        Raises:
            SimulatorError: If that fails.
        """
        self._name, self._is_new = str(found.file), True
        self._words: deque[str] = deque(maxlen=_KEPT_WORDS)
        folder = tempfile.TemporaryDirectory(prefix="swarmstart-fmu-")
        self._is_3 = found.version.startswith("3")
        try:
            # FMPy leaves the working folder changed if a library cannot be loaded.
            with contextlib.chdir("."):
                self._slave = _instance(found, folder.name, self._words)
        except Exception as error:
            folder.cleanup()
            raise self._failed("load", error) from error
        self._close = weakref.finalize(self, _ended, self._slave, folder)
        # Arrays of C are made once: FMPy's own calls make them at each step.
        self._read, self._values = _references(read), (c_double * len(read))()
        self._set, self._given = _references(set_), (c_double * len(set_))()

    def close(self) -> None:
        """Free the instance, unload the library, remove the folder."""
        self._close()

    def begun(self, values: Mapping[int, float]) -> list[float]:
        """Begin a run with given values of variables, and return the state."""
        slave = self._slave
        if not self._close.alive:
            raise SimulatorError(self._name, "expected an FMU in use, found it closed")
        try:
            if not self._is_new:
                slave.reset()
            self._is_new = False
            if values:
                put = slave.setFloat64 if self._is_3 else slave.setReal
                put(list(values), list(values.values()))
            if not self._is_3:
                slave.setupExperiment(startTime=0.0)
                slave.enterInitializationMode()
            else:
                slave.enterInitializationMode(startTime=0.0)
            slave.exitInitializationMode()
            return self._found()
        except Exception as error:
            raise self._failed("begin a run", error) from error

    def stepped(self, values: list[float], time: float, dt: float) -> list[float]:
        """Set inputs, make a step, and return the state."""
        slave, one = self._slave, self._slave.component
        count = len(values)
        self._given[:] = values  # type: ignore[assignment]  # Floats are taken.
        try:
            if self._is_3:
                slave.fmi3SetFloat64(one, self._set, count, self._given, count)
                _, is_over, is_early, until = slave.doStep(time, dt)
            else:
                slave.fmi2SetReal(one, self._set, count, self._given)
                slave.fmi2DoStep(one, time, dt, 1)
                is_over = is_early = False
            found = self._found()
        except Exception as error:
            raise self._failed(f"step at {time:g} s", error) from error
        if is_over or is_early:
            what = "ended the simulation" if is_over else "returned early"
            raise SimulatorError(self._name, f"it {what} at {until:g} s")
        return found

    def _found(self) -> list[float]:
        """Return the values that are read after a step."""
        slave, one, count = self._slave, self._slave.component, len(self._values)
        if self._is_3:
            slave.fmi3GetFloat64(one, self._read, count, self._values, count)
        else:
            slave.fmi2GetReal(one, self._read, count, self._values)
        return self._values[:]

    def _failed(self, what: str, error: Exception) -> SimulatorError:
        said = f"; it said: {brief(' / '.join(self._words))}" if self._words else ""
        return SimulatorError(
            self._name, f"the FMU failed to {what}: {brief(str(error))}{said}"
        )


def _references(which: list[int]) -> Any:
    """Return value references as C has them."""
    return (c_uint * len(which))(*which)


def _numbers(role: str, values: ArrayLike) -> list[float]:
    """Return a vector as a list of floats."""
    if not (isinstance(values, np.ndarray) and values.dtype == np.float64):
        values = numbers_of(role, values)
    if values.ndim != 1:
        raise refused(role, values, "a vector")
    found: list[float] = values.tolist()
    return found


def _instance(found: Described, folder: str, words: deque[str]) -> Any:
    """Unpack an FMU, and return its instance, whose messages are kept."""
    fmpy = load_optional("fmpy", extra="fmi", need="an FMU")
    fmpy.extract(str(found.file), folder)

    def keep(*message: Any) -> None:
        words.append(message[-1].decode("utf-8", "replace"))

    parts = {
        "guid": found.token, "unzipDirectory": folder,
        "modelIdentifier": found.identifier, "instanceName": "plant",
    }  # fmt: skip
    if found.version.startswith("3"):
        fmi3 = load_optional("fmpy.fmi3", extra="fmi", need="an FMU").fmi3
        slave = fmi3.FMU3Slave(**parts)
        slave.instantiate(logMessage=keep)
        return slave
    fmi2 = load_optional("fmpy.fmi2", extra="fmi", need="an FMU").fmi2
    slave = fmi2.FMU2Slave(**parts)
    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(keep)
    callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
    slave.instantiate(callbacks=callbacks)
    return slave


def _ended(slave: Any, folder: tempfile.TemporaryDirectory[str]) -> None:
    """Free an instance; an FMU that fails now has done its work."""
    try:
        slave.freeInstance()
    except Exception:  # noqa: BLE001 - nothing depends on it
        pass
    folder.cleanup()
