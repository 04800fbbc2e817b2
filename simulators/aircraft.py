"""Aircraft of JSBSim behind an autopilot for speed, heading and height, as a plant.

Each aircraft is trimmed in straight flight at its start. North and east are distances
on a sphere along the meridian and the parallel of the origin [m]: up to 10 km and at
heights up to 5 km they differ by at most 3e-3 from the distance over ground. The gains
are those of the F-16 of JSBSim, whose own controls command rates.

Source: JSBSim reference manual, https://jsbsim-team.github.io/jsbsim-reference-manual.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.errors import load_optional
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.silence import silenced
from swarmstart.simulators.common import (
    STEP,
    SimulatorError,
    require_last,
    require_start,
    vector,
)

STATES = ("speed_m_s", "heading_rad", "height_m", "north_m", "east_m")
"""States of each aircraft: true airspeed, heading clockwise from north, place."""
CONTROLS = ("speed_m_s_set", "heading_rad_set", "height_m_set")
"""Set points of each aircraft."""
_FEET, _EARTH, _GRAVITY = 0.3048, 6378137.0, 9.81
_LATITUDE, _LONGITUDE = 47.0, 8.0
_BANK_RATE = 0.7
"""Largest rate at which the commanded bank angle changes [rad/s]."""
_BANK_LIFT = 0.05
"""Pitch that makes up for the lift lost in a turn, by 1 / cos(bank) - 1 [rad]."""
_STEPS_PER_COMMAND = 4
"""Steps of JSBSim from one command of the autopilot to the next."""
_NEAR = 1e-6
_GAIN = a_number(least=0, most=1e6)


@checked(
    refused, throttle=_GAIN, throttle_integral=_GAIN, heading=_GAIN, bank_max=_GAIN,
    roll=_GAIN, roll_rate=_GAIN, climb=_GAIN, climb_max=_GAIN, path_integral=_GAIN,
    pitch=_GAIN, pitch_rate=_GAIN,
)  # fmt: skip
@dataclass(frozen=True, kw_only=True, slots=True)
class Autopilot:
    """Gains of the autopilot; the defaults are those of the F-16.

    Attributes:
        throttle: Gain from the error of speed to the throttle [1/(m/s)].
        throttle_integral: Gain from the integral of the error of speed to the throttle
            [1/m].
        heading: Gain from the error of heading to the turn rate [1/s].
        bank_max: Largest bank angle [rad].
        roll: Gain from the error of bank to the aileron [1/rad].
        roll_rate: Gain from the roll rate to the aileron [s/rad].
        climb: Gain from the error of height to the vertical speed [1/s].
        climb_max: Largest vertical speed [m/s].
        path_integral: Gain from the integral of the error of the path angle to the
            pitch [1/s].
        pitch: Gain from the error of pitch to the elevator [1/rad].
        pitch_rate: Gain from the pitch rate to the elevator [s/rad].

    Example:
        >>> import swarmstart as ss
        >>> ss.Autopilot(bank_max=0.5).bank_max
        0.5
    """

    throttle: float = 0.03
    throttle_integral: float = 0.004
    heading: float = 0.25
    bank_max: float = 1.0
    roll: float = 1.0
    roll_rate: float = 0.1
    climb: float = 0.2
    climb_max: float = 20.0
    path_integral: float = 1.0
    pitch: float = 3.0
    pitch_rate: float = 0.6


@checked(
    refused,
    aircraft=text(longest=100),
    count=a_count(least=1, most=1000),
    autopilot=optional(of_kind(Autopilot, "an Autopilot")),
    rate_hz=a_number(least=30, most=1000),
)
class AircraftPlant(Called):
    """Several aircraft of JSBSim as one plant.

    The state holds one aircraft after another, each in the order of STATES. The
    controls do so too, in the order of CONTROLS.

    Attributes:
        state_names: Names of the states, with the aircraft's number if there are
            several.
        control_names: Names of the set points, likewise.
        bounds: Least and largest values of the set points, each (nu,); all infinite.

    Example:
        >>> import swarmstart as ss
        >>> try:
        ...     ss.AircraftPlant("../f16")
        ... except ss.SimulatorError as error:
        ...     print(error)
        ../f16: expected the name of an aircraft that JSBSim has, such as f16
    """

    def __init__(
        self,
        aircraft: str = "f16",
        *,
        count: int = 1,
        autopilot: Autopilot | None = None,
        rate_hz: float = 120.0,
    ) -> None:
        """Keep the choice; aircraft are loaded by `start_at`.

        Args:
            aircraft: Name of one of JSBSim's own aircraft.
            count: Number of aircraft.
            autopilot: Gains of the autopilot; None: those of the F-16.
            rate_hz: Number of steps of JSBSim in a second.

        Raises:
            SimulatorError: If JSBSim has no such aircraft.
            MissingPackageError: If JSBSim is not installed (`swarmstart[jsbsim]`).
        """
        if not re.fullmatch(r"[A-Za-z0-9_-]+", aircraft):
            raise SimulatorError(
                aircraft,
                "expected the name of an aircraft that JSBSim has, such as f16",
            )
        self._jsbsim = load_optional("jsbsim", extra="jsbsim", need="an aircraft")
        folder = os.path.join(self._jsbsim.get_default_root_dir(), "aircraft")
        if not os.path.isfile(os.path.join(folder, aircraft, f"{aircraft}.xml")):
            raise SimulatorError(
                aircraft,
                "JSBSim has no such aircraft; for example it has f16, f15, T38",
            )
        self._name, self._rate, self._count = aircraft, float(rate_hz), count
        self._gains = Autopilot() if autopilot is None else autopilot
        numbers = [f"_{i + 1}" for i in range(count)] if count > 1 else [""]
        self.state_names = tuple(n + i for i in numbers for n in STATES)
        self.control_names = tuple(n + i for i in numbers for n in CONTROLS)
        unbounded = np.full(len(self.control_names), np.inf)
        self.bounds = -unbounded, unbounded
        self._flown: list[_Aircraft] = []
        self._last: Array | None = None

    @checked(refused, x=reals(axes=1))
    def start_at(self, x: ArrayLike) -> Array:
        """Trim the aircraft in straight flight, and return their state, shape (nx,).

        Args:
            x: State, shape (nx,).

        Raises:
            SimulatorError: If an aircraft cannot be trimmed there.
        """
        asked = vector(self._name, "the state", x, self.state_names)
        rows = asked.reshape(self._count, -1)
        self._flown = [_Aircraft(self._jsbsim, self._name, row, self._gains, self._rate)
                       for row in rows]  # fmt: skip
        found = self._read(asked)
        require_start(self._name, asked, found, self.state_names, near=_NEAR)
        self._last = found
        return found.copy()

    @checked(refused, x=reals(axes=1), u=reals(axes=1), dt=STEP)
    def step(self, x: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the state after a step, shape (nx,).

        Args:
            x: The state that was returned last, shape (nx,).
            u: Set points, shape (nu,).
            dt: Length of the step [s], a whole number of steps of JSBSim.

        Raises:
            SimulatorError: If `x` is not the state that was returned last, or `dt` is
                no whole number of steps of JSBSim.
        """
        last = self._last
        require_last(self._name, np.asarray(x, dtype=np.float64), last)
        control = vector(self._name, "the set points", u, self.control_names)
        steps = round(dt * self._rate)
        if not math.isclose(steps, dt * self._rate, rel_tol=1e-9) or not steps:
            raise SimulatorError(
                self._name,
                f"expected a step of whole periods of 1/{self._rate:g} s, found "
                f"{dt:g} s",
            )
        self._last = None  # Until the step has succeeded.
        for one, wanted in zip(self._flown, control.reshape(self._count, -1),
                               strict=True):  # fmt: skip
            one.fly(*wanted.tolist(), steps=steps)
        self._last = self._read(last)
        return self._last.copy()

    def _read(self, last: Array | None) -> Array:
        """Return the state, with headings that are near the last ones."""
        found = np.concatenate([one.state() for one in self._flown])
        if last is not None:
            headings = slice(1, None, len(STATES))
            turns = np.round((last[headings] - found[headings]) / (2 * np.pi))
            found[headings] += 2 * np.pi * turns
        return found


class _Aircraft:
    """One aircraft and the memory of its autopilot."""

    def __init__(
        self, jsbsim: Any, name: str, start: Array, gains: Autopilot, rate: float
    ) -> None:
        """Load and trim it.

        Raises:
            SimulatorError: If that fails.
        """
        with silenced():  # JSBSim greets, and tells of its trim.
            self._model = model = _trimmed(jsbsim, name, start, rate)
        self._gains, self._period = gains, 1.0 / rate
        self._throttle = model["fcs/throttle-cmd-norm"]
        self._elevator = model["fcs/elevator-cmd-norm"]
        self._pitch = model["attitude/theta-rad"]
        self._lag = self._lift = self._bank = 0.0

    def state(self) -> Array:
        """Return its state, shape (5,)."""
        model = self._model
        north = model["position/lat-geod-rad"] - math.radians(_LATITUDE)
        east = model["position/long-gc-rad"] - math.radians(_LONGITUDE)
        return np.array([
            model["velocities/vt-fps"] * _FEET, model["attitude/psi-rad"],
            model["position/h-sl-ft"] * _FEET, north * _EARTH, east * _parallel(),
        ])  # fmt: skip

    def fly(self, speed: float, heading: float, height: float, *, steps: int) -> None:
        """Simulate a number of steps of JSBSim in which the set points are held."""
        model = self._model
        for step in range(steps):
            if step % _STEPS_PER_COMMAND == 0:
                self._command(speed, heading, height)
            model.run()

    def _command(self, speed: float, heading: float, height: float) -> None:
        """Set throttle, aileron and elevator."""
        model, gains = self._model, self._gains
        seconds = _STEPS_PER_COMMAND * self._period
        now = model["velocities/vt-fps"] * _FEET
        missing = speed - now
        throttle = self._throttle + gains.throttle * missing
        throttle += gains.throttle_integral * (self._lag + missing * seconds)
        if 0 < throttle < 1:  # Else the integral would wind up.
            self._lag += missing * seconds
        model["fcs/throttle-cmd-norm"] = min(1.0, max(0.0, throttle))

        off = math.remainder(heading - model["attitude/psi-rad"], 2 * math.pi)
        wanted = math.atan(now * gains.heading * off / _GRAVITY)
        wanted = min(gains.bank_max, max(-gains.bank_max, wanted))
        most = _BANK_RATE * seconds
        self._bank += min(most, max(-most, wanted - self._bank))
        bank = model["attitude/phi-rad"]
        aileron = gains.roll * (self._bank - bank)
        aileron -= gains.roll_rate * model["velocities/p-rad_sec"]
        model["fcs/aileron-cmd-norm"] = min(1.0, max(-1.0, aileron))

        climb = gains.climb * (height - model["position/h-sl-ft"] * _FEET)
        climb = min(gains.climb_max, max(-gains.climb_max, climb)) / now
        self._lift += (climb - model["velocities/h-dot-fps"] * _FEET / now) * seconds
        pitch = self._pitch + climb + gains.path_integral * self._lift
        pitch += _BANK_LIFT * (1 / math.cos(bank) - 1) - model["attitude/theta-rad"]
        nose = gains.pitch * pitch - gains.pitch_rate * model["velocities/q-rad_sec"]
        elevator = self._elevator - min(1.0, max(-1.0, nose))  # Negative: nose up.
        model["fcs/elevator-cmd-norm"] = min(1.0, max(-1.0, elevator))


def _trimmed(jsbsim: Any, name: str, start: Array, rate: float) -> Any:
    """Return a model of JSBSim in trimmed straight flight.

    Raises:
        SimulatorError: If it cannot be trimmed.
    """
    speed, heading, height, north, east = start.tolist()
    model = jsbsim.FGFDMExec(None)
    model.set_debug_level(0)
    model.load_model(name)
    model.set_dt(1.0 / rate)
    number = 0
    while model.get_output_filename(number):  # An aircraft may name files to write.
        model.set_output_filename(number, os.devnull)
        number += 1
    latitude = _LATITUDE + math.degrees(north / _EARTH)
    model["ic/lat-geod-deg"] = latitude
    model["ic/long-gc-deg"] = _LONGITUDE + math.degrees(east / _parallel())
    model["ic/h-sl-ft"] = height / _FEET
    model["ic/psi-true-rad"] = heading % (2 * math.pi)
    model["ic/gamma-deg"] = 0.0
    model["ic/vt-fps"] = speed / _FEET
    model["propulsion/set-running"] = -1
    at = f"at {speed:g} m/s and {height:g} m"
    try:
        started = model.run_ic()
        model["propulsion/set-running"] = -1
        model["simulation/do_simple_trim"] = 1
    except jsbsim.TrimFailureError as error:
        raise SimulatorError(
            name, f"cannot be trimmed in straight flight {at}: try another speed"
        ) from error
    if not started:
        raise SimulatorError(name, f"cannot be started {at}")
    return model


def _parallel() -> float:
    """Return the radius of the origin's parallel [m]."""
    return _EARTH * math.cos(math.radians(_LATITUDE))
