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
from swarmstart.cases.kinds.problem.scenario import UserScenario
from swarmstart.cases.kinds.problem.values import Names
from swarmstart.cases.kinds.python.code import Code, read_code


def _code(value: object, info: ValidationInfo) -> Code:
    return read_code(value, (info.context or {}).get("folder", Path()))


class PlantPart(Part):
    """The simulated system: the problem's model in finer steps."""

    substeps: int = Field(default=20, ge=1, le=10_000)


class PythonScenario(UserScenario):
    """A problem from Python, and how it is solved and flown.

    Attributes:
        problem: "file.py:function"; the file is in the scenario's folder or below.
        sha256: The hash of the file; a file with another one is refused.
        arguments: Of the function, by name, as they are: expressions stay text.
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
        if code is None:  # It is refused already.
            return given
        if given not in ("", code.sha256):
            raise ValueError(
                f"expected {code.file.name} with the hash {given}, found one with "
                f"{code.sha256}: the file has changed"
            )
        return str(code.sha256)
