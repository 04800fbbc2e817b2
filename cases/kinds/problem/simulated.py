"""An external simulator as the plant of a problem: what it needs, how it is loaded.

A file with foreign code is loaded only when a simulation begins, and only if it still
has the hash that it had when the scenario was read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

from swarmstart.cases.format.foreign_files import ForeignFile, hash_of
from swarmstart.cases.format.kind import PosedSimulator
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.simulators import (
    CommandPart,
    FmuPart,
    JsbsimPart,
    OnnxPart,
    steps_within,
)
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Model, Steps


class ChangedFileError(SwarmstartError):
    """A file of a simulator is not the one that the scenario was read with."""


class _Wanted(NamedTuple):
    """States, controls and steps of a scenario, for its simulator.

    Attributes:
        states: Names of the states of all vehicles.
        controls: Names of their controls.
        units: Units of these states and controls; empty if they are not stated.
        vehicles: Number of vehicles.
        step: Length of the simulator's steps [s].
    """

    states: tuple[str, ...]
    controls: tuple[str, ...]
    units: tuple[str, ...]
    vehicles: int
    step: float


def posed_simulator(
    scenario: ProblemScenario, model: Model, interval: float
) -> PosedSimulator | None:
    """Return the simulator of a scenario, not loaded; None if it has none.

    Args:
        scenario: The scenario, checked.
        model: The model of all vehicles.
        interval: Length of a control interval [s].
    """
    part = scenario.simulator
    if part is None:
        return None
    wanted = _Wanted(
        states=model.state_names, controls=model.control_names,
        units=tuple(
            one.unit
            for part in (scenario.states, scenario.controls)
            for one in [*part.values()] * (model.nx // len(scenario.states))
        ),
        vehicles=model.nx // len(scenario.states),
        step=interval / steps_within(part, interval),
    )  # fmt: skip
    if isinstance(part, JsbsimPart):  # Its names are those of one aircraft.
        wanted = wanted._replace(
            states=(*scenario.states,), controls=(*scenario.controls,)
        )
    load = partial(_LOADING[type(part)], part, wanted)
    return PosedSimulator(load=load, code=part.code)


def _fmu(part: FmuPart, wanted: _Wanted) -> Steps:
    from swarmstart.simulators import FmuPlant, require_units

    _require_same(part.fmu)
    plant = FmuPlant(
        part.fmu.file,
        states=part.states or wanted.states,
        controls=part.controls or wanted.controls,
        parameters=part.values,
    )
    names = *plant.state_names, *plant.control_names
    units = dict(zip(names, wanted.units, strict=True))
    require_units(str(part.fmu), units, plant.units)
    return plant


def _network(part: OnnxPart, wanted: _Wanted) -> Steps:
    from swarmstart.simulators import OnnxPlant

    _require_same(part.onnx)
    return OnnxPlant(
        part.onnx.file, states=wanted.states, controls=wanted.controls,
        dt=wanted.step, gives_change=part.gives_change,
    )  # fmt: skip


def _program(part: CommandPart, wanted: _Wanted) -> Steps:
    from swarmstart.simulators import CommandPlant, SelectedPlant

    for one in part.command.files.values():
        _require_same(one)
    return SelectedPlant(
        CommandPlant(part.command.called, limit_s=part.limit_s),
        states=part.states or wanted.states,
        controls=part.controls or wanted.controls,
    )


def _aircraft(part: JsbsimPart, wanted: _Wanted) -> Steps:
    from swarmstart.simulators import AircraftPlant, SelectedPlant

    count = wanted.vehicles
    numbers = [f"_{i + 1}" for i in range(count)] if count > 1 else [""]
    given = {"speed_m_s": part.airspeed_m_s, "height_m": part.altitude_m}
    states, controls = part.states or wanted.states, part.controls or wanted.controls
    return SelectedPlant(
        AircraftPlant(part.jsbsim, count=count),
        states=[name + i for i in numbers for name in states],
        controls=[name + i for i in numbers for name in controls],
        start={name + i: value for i in numbers for name, value in given.items()},
        held={f"{n}_set{i}": value for i in numbers for n, value in given.items()},
    )


def _require_same(one: ForeignFile) -> None:
    """Raise if a file is not the one that was hashed.

    Raises:
        ChangedFileError: With its name.
    """
    try:
        found = hash_of(one.file)
    except ValueError as error:
        raise ChangedFileError(str(error)) from None
    if found != one.sha256:
        raise ChangedFileError(f"{one}: the file has changed since it was read")


_LOADING: Mapping[type, Callable[..., Steps]] = {
    FmuPart: _fmu,
    OnnxPart: _network,
    CommandPart: _program,
    JsbsimPart: _aircraft,
}
