"""Plants that are external simulators: an FMU, a program, a network, aircraft.

Each part names what is loaded, and which of its variables are the states and controls
of the scenario, vehicle after vehicle. Reading a scenario hashes files and loads none.
"""

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    PlainSerializer,
    PlainValidator,
    Tag,
    ValidationInfo,
    WithJsonSchema,
)

from swarmstart.cases.format.document import shown
from swarmstart.cases.format.foreign_files import (
    ForeignFile,
    file_below,
    foreign_file,
    hash_of,
)
from swarmstart.cases.format.parts import Number, Part, Positive
from swarmstart.cases.kinds.problem.stated.parts import PlantPart

MOST_STEPS = 10_000
"""Largest number of a simulator's steps in a control interval."""
_MOST_WORDS = 1000
_NAMES = Field(min_length=1, max_length=1000)


def _folder(info: ValidationInfo) -> Path:
    return Path((info.context or {}).get("folder", Path()))


def _validator(key: str, suffix: str) -> PlainValidator:
    def read(value: object, info: ValidationInfo) -> ForeignFile:
        return foreign_file(value, _folder(info), key=key, suffix=suffix)

    return PlainValidator(read)


def _schema(example: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "description": example})


@dataclass(frozen=True, kw_only=True, slots=True)
class Command:
    """A program and its arguments, with the scenario's own files among them.

    Attributes:
        words: The words of the scenario.
        files: Word -> the file of that name in the scenario's folder.
    """

    words: tuple[str, ...]
    files: Mapping[str, ForeignFile]

    @property
    def called(self) -> list[str]:
        """The words, with the paths of the files."""
        files = self.files
        return [str(files[w].file.resolve()) if w in files else w for w in self.words]


def _verified(
    given: Mapping[str, str], files: Mapping[str, ForeignFile]
) -> dict[str, str]:
    """Return the hashes of files by name, which must be the given ones.

    Raises:
        ValueError: If a file is missing, or has another hash.
    """
    for name in given:
        if name not in files:
            listed = ", ".join(files) or "none"
            raise ValueError(f"expected names of {listed}; found {shown(name)}")
    for name, one in files.items():
        if given.get(name, one.sha256) != one.sha256:
            raise ValueError(
                f"expected {name} with the hash {given[name]}, found one with "
                f"{one.sha256}: the file has changed"
            )
    return {name: one.sha256 for name, one in files.items()}


def _unchanged(given: Mapping[str, str], info: ValidationInfo) -> Mapping[str, str]:
    """Return the hashes of the files of a part, which must be the given ones."""
    file, command = (
        info.data.get("fmu", info.data.get("onnx")),
        info.data.get("command"),
    )
    if file is not None:
        return _verified(given, {str(file): file})
    # Without any the key of the files has an error already.
    return given if command is None else _verified(given, command.files)


Hashes = Annotated[Mapping[str, str], AfterValidator(_unchanged)]
"""Hashes of all files of a part by name; it comes after the key of the files."""


class SimulatorPart(Part):
    """An external simulator as the simulated system.

    Attributes:
        step_s: Length of a step of the simulator [s]; a control interval has a whole
            number of steps, and null means that it is one step.
    """

    step_s: Positive | None = None

    @property
    def key(self) -> str:
        """Key that names the kind of simulator in a scenario, such as fmu."""
        return next(key for key in _KEYS if hasattr(self, key))

    @property
    def foreign(self) -> Mapping[str, ForeignFile]:
        """Files of the scenario that the simulator runs, by name."""
        return {}

    @property
    def files(self) -> Mapping[str, Path]:
        """Files that a record keeps, by name."""
        return {name: one.file for name, one in self.foreign.items()}

    @property
    def code(self) -> str | None:
        """The user's file or command that a simulation runs; None without one."""
        return next((str(one) for one in self.files.values()), None)


class FmuPart(SimulatorPart):
    """An FMU as the simulated system.

    Attributes:
        fmu: FMU for co-simulation, in the scenario's folder or below.
        states: Variables of the FMU that are the states, in the order of the states;
            null means variables with the same names.
        controls: Inputs of the FMU that are the controls, in the order of the controls;
            null means inputs with the same names.
        values: Values of parameters of the FMU, by name.
        sha256: File name -> SHA-256 hash that the file must have; by default the hash
            of the file as it is.
    """

    fmu: Annotated[
        ForeignFile,
        _validator("fmu", ".fmu"),
        PlainSerializer(ForeignFile.__str__),
        _schema("pendulum.fmu"),
    ]
    states: Annotated[list[str], _NAMES] | None = None
    controls: Annotated[list[str], _NAMES] | None = None
    values: Mapping[str, Number] = Field(default_factory=dict)
    sha256: Hashes = Field(default_factory=dict, validate_default=True)

    @property
    def foreign(self) -> Mapping[str, ForeignFile]:
        """Files of the scenario that the simulator runs, by name."""
        return {str(self.fmu): self.fmu}


class OnnxPart(SimulatorPart):
    """A network in ONNX as the simulated system.

    Attributes:
        onnx: Network, in the scenario's folder or below; its input is the states
            followed by the controls.
        gives_change: Whether the network gives the change of the states over a step,
            and not the states after the step.
        sha256: File name -> SHA-256 hash that the file must have; by default the hash
            of the file as it is.
    """

    onnx: Annotated[
        ForeignFile,
        _validator("onnx", ".onnx"),
        PlainSerializer(ForeignFile.__str__),
        _schema("network.onnx"),
    ]
    gives_change: bool = False
    sha256: Hashes = Field(default_factory=dict, validate_default=True)

    @property
    def foreign(self) -> Mapping[str, ForeignFile]:
        """Files of the scenario that the simulator runs, by name."""
        return {str(self.onnx): self.onnx}


def _command(value: object, info: ValidationInfo) -> Command:
    words = value if isinstance(value, list) else []
    if not (0 < len(words) <= _MOST_WORDS and all(isinstance(w, str) for w in words)):
        raise ValueError(
            "expected command to be a list of words, such as [python3, tank.py]; found "
            f"{shown(str(value))}"
        )
    files = {}
    for word in dict.fromkeys(words):
        file = None if "/" in word else file_below(word, _folder(info))
        if file is not None and file.is_file():
            files[word] = ForeignFile(file=file, sha256=hash_of(file))
    return Command(words=tuple(words), files=files)


class CommandPart(SimulatorPart):
    """A program as the simulated system: JSON lines, in any language.

    Attributes:
        command: Program and its arguments, run without a shell; words that are names of
            files in the scenario's folder mean these files.
        states: Names by which the program knows the states, in their order; null means
            the same names.
        controls: Names by which the program knows the controls, in their order; null
            means the same names.
        limit_s: Longest time to an answer, wall time [s].
        sha256: Name of a file in `command` -> SHA-256 hash that it must have; by
            default the hash of the file as it is.
    """

    command: Annotated[
        Command,
        PlainValidator(_command),
        PlainSerializer(lambda command: list(command.words)),
        WithJsonSchema({"type": "array", "items": {"type": "string"}}),
    ]
    states: Annotated[list[str], _NAMES] | None = None
    controls: Annotated[list[str], _NAMES] | None = None
    limit_s: Positive = 10.0
    sha256: Hashes = Field(default_factory=dict, validate_default=True)

    @property
    def foreign(self) -> Mapping[str, ForeignFile]:
        """Files of the scenario that the simulator runs, by name."""
        return self.command.files

    @property
    def code(self) -> str | None:
        """The whole command, so that a user sees what would be allowed."""
        return shlex.join(self.command.words)


class JsbsimPart(SimulatorPart):
    """Aircraft of JSBSim behind an autopilot, one for each vehicle.

    Attributes:
        jsbsim: Name of one of the aircraft that JSBSim has, such as f16.
        states: Name of the aircraft's quantity for each state of the scenario, in their
            order: speed_m_s, heading_rad, height_m, north_m or east_m; null means that
            the states have these names.
        controls: Name of the set point for each control of the scenario:
            speed_m_s_set, heading_rad_set or height_m_set; null means that the controls
            have these names. Other set points are held.
        altitude_m: Height at the start and set point of the height [m], if no state or
            control is the height.
        airspeed_m_s: True airspeed at the start and its set point [m/s], if no state or
            control is the airspeed.
    """

    jsbsim: str = Field(pattern=r"^[A-Za-z0-9_-]{1,100}$")
    states: Annotated[list[str], _NAMES] | None = None
    controls: Annotated[list[str], _NAMES] | None = None
    altitude_m: Number
    airspeed_m_s: Positive


_KEYS = ("fmu", "onnx", "command", "jsbsim")


def _form(value: Any) -> str:
    """Return the form of a plant by its key; see `values.chosen`."""
    for key in _KEYS:
        if key in value if isinstance(value, dict) else hasattr(value, key):
            return f"of {key}"
    return "of substeps"


AnyPlantPart = Annotated[
    Annotated[PlantPart, Tag("of substeps")]
    | Annotated[FmuPart, Tag("of fmu")]
    | Annotated[OnnxPart, Tag("of onnx")]
    | Annotated[CommandPart, Tag("of command")]
    | Annotated[JsbsimPart, Tag("of jsbsim")],
    Discriminator(_form),
]
"""The model in finer steps, or an external simulator."""


def steps_within(part: SimulatorPart, interval: float) -> int:
    """Return the number of a simulator's steps in a control interval.

    It is 0 if no whole number of steps fits, or if there are too many.

    Args:
        part: The simulator.
        interval: Length of a control interval [s].
    """
    if part.step_s is None:
        return 1
    count = round(interval / part.step_s)
    is_whole = math.isclose(count * part.step_s, interval, rel_tol=1e-9)
    return count if is_whole and count <= MOST_STEPS else 0
