"""The scenario of a problem that a function in the user's own file returns."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    Field,
    JsonValue,
    PlainSerializer,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
)

from swarmstart.cases.format.settings import Part
from swarmstart.cases.kinds.problem.stated.scenario import UserScenario
from swarmstart.cases.kinds.problem.stated.values import Names
from swarmstart.cases.kinds.python.code import Code, read_code


def _code(value: object, info: ValidationInfo) -> Code:
    return read_code(value, (info.context or {}).get("folder", Path()))


class PlantPart(Part):
    """The simulated system: the problem's model in finer steps.

    Attributes:
        substeps: Number of integrator steps of the simulation in a control interval.
    """

    substeps: int = Field(default=20, ge=1, le=10_000)


class PythonScenario(UserScenario):
    """A problem from Python, and how it is solved and simulated.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        problem: File and function that returns the problem, such as my_model.py:build;
            the file is in the scenario's folder or below.
        sha256: SHA-256 hash that the file must have; by default the hash of the file as
            it is.
        arguments: Arguments of the function, by name, passed as they are: an expression
            stays text.
        plant: Simulated system.
    """

    kind: Literal["python"]
    problem: Annotated[
        Code,
        PlainValidator(_code),
        PlainSerializer(str),
        WithJsonSchema({"type": "string", "description": "my_model.py:build"}),
    ]
    sha256: str = Field(default="", validate_default=True)
    arguments: Mapping[Names, JsonValue] = Field(default_factory=dict)
    plant: PlantPart = PlantPart()

    @field_validator("sha256")
    @classmethod
    def _same_file(cls, given: str, info: ValidationInfo) -> str:
        code = info.data.get("problem")
        if code is None:  # It has an error already.
            return given
        if given not in ("", code.sha256):
            raise ValueError(
                f"expected {code.file.name} with the hash {given}, found one with "
                f"{code.sha256}: the file has changed"
            )
        return str(code.sha256)
