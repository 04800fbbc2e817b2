"""A simulator of others as the plant of a problem: what it needs, and how it is loaded.

Nothing of others is loaded before a simulation begins, and none but the file whose hash
the scenario states.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from swarmstart.cases.format.foreign_files import ForeignFile, hash_of
from swarmstart.cases.format.kind import PosedSimulator
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.simulators import (
    CommandPart,
    FmuPart,
    JsbsimPart,
    OnnxPart,
    SimulatorPart,
    steps_within,
)
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Model, Steps

Names = Sequence[str]


class ChangedFileError(SwarmstartError):
    """A file of a simulator is not the one that the scenario was read with."""


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
    names = model.state_names, model.control_names
    return PosedSimulator(
        load=partial(_loaded, part, *names, interval / steps_within(part, interval)),
        code=None if part.code is None else str(part.code),
    )


def _loaded(part: SimulatorPart, states: Names, controls: Names, step: float) -> Steps:
    """Return the simulator, loaded.

    Args:
        part: What is loaded.
        states: Names of the states of all vehicles.
        controls: Names of their controls.
        step: Length of its steps [s].

    Raises:
        ChangedFileError: If a file has changed.
        SimulatorError: If it cannot be loaded, or does not fit.
        MissingPackageError: If a package is missing.
    """
    return _LOADING[type(part)](part, states, controls, step)


def _fmu(part: FmuPart, states: Names, controls: Names, step: float) -> Steps:
    from swarmstart.simulators import FmuPlant

    del step
    _require_same(part.fmu)
    return FmuPlant(
        part.fmu.file,
        states=part.states or states,
        controls=part.controls or controls,
        parameters=part.values,
    )


def _network(part: OnnxPart, states: Names, controls: Names, step: float) -> Steps:
    from swarmstart.simulators import OnnxPlant

    _require_same(part.onnx)
    return OnnxPlant(
        part.onnx.file, states=states, controls=controls, dt=step,
        gives_change=part.gives_change,
    )  # fmt: skip


def _program(part: CommandPart, states: Names, controls: Names, step: float) -> Steps:
    from swarmstart.simulators import CommandPlant, SelectedPlant

    del step
    for one in part.command.files.values():
        _require_same(one)
    return SelectedPlant(
        CommandPlant(part.command.called, limit_s=part.limit_s),
        states=part.states or states,
        controls=part.controls or controls,
    )


def _aircraft(part: JsbsimPart, states: Names, controls: Names, step: float) -> Steps:
    from swarmstart.simulators import AircraftPlant, SelectedPlant

    del controls, step
    count = len(states) // len(part.states)
    numbers = [f"_{i + 1}" for i in range(count)] if count > 1 else [""]
    given = {"speed_m_s": part.airspeed_m_s, "height_m": part.altitude_m}
    return SelectedPlant(
        AircraftPlant(part.jsbsim, count=count),
        states=[name + i for i in numbers for name in part.states],
        controls=[name + i for i in numbers for name in part.commands],
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
