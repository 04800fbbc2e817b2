"""The scenario of a problem that a function in the user's own file returns.

The file is read as bytes, identified by its hash, and run on demand. Reading does not
run it. It is read once, so that the same bytes are hashed, recorded and run.
"""

import contextlib
import copy
import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    JsonValue,
    PlainSerializer,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
)

from swarmstart.cases.format.document import (
    UnreadableFileError,
    YamlError,
    printable,
    shown,
)
from swarmstart.cases.format.foreign_files import file_below
from swarmstart.cases.format.parts import Part
from swarmstart.cases.format.yaml_reader import read_bytes
from swarmstart.cases.kinds.problem.stated.scenario import UserScenario
from swarmstart.cases.kinds.problem.stated.values import Names
from swarmstart.errors import SwarmstartError

_LONGEST = 300
"""Largest number of characters of the user's error in a message."""


class UserCodeError(SwarmstartError):
    """The user's file does not return a problem."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Code:
    """A function in a file that was read, but not run.

    Attributes:
        file: The file.
        function: The function's name.
        text: The file's content, UTF-8.
    """

    file: Path
    function: str
    text: str = field(repr=False)

    @property
    def sha256(self) -> str:
        """The hash of the file's content, in hexadecimal."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def __str__(self) -> str:
        """Return file and function as in a scenario of the same folder."""
        return f"{self.file.name}:{self.function}"


def read_code(value: object, folder: Path) -> Code:
    """Return the function that a scenario names; its file is read, but not run.

    Args:
        value: Text such as "my_model.py:build".
        folder: The scenario's folder; the file is in it or below.

    Raises:
        ValueError: If the file does not exist, is too large or is not UTF-8.
    """
    given, _, function = value.partition(":") if isinstance(value, str) else ("",) * 3
    file = file_below(given, folder)
    if file is None or file.suffix != ".py" or not function.isidentifier():
        raise ValueError(
            "expected problem to be a file in the scenario's folder or below and a "
            f"function in it, such as my_model.py:build; found {shown(str(value))}"
        )
    try:
        text = read_bytes(file).decode()
    except (UnreadableFileError, YamlError) as error:
        raise ValueError(str(error)) from None
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{printable(str(file))}: expected text in UTF-8: {error}"
        ) from None
    return Code(file=file, function=function, text=text)


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
        PlainSerializer(Code.__str__),
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
        # By default the hash is filled in, and a record then holds the run to it.
        if given not in ("", code.sha256):
            raise ValueError(
                f"expected {code.file.name} with the hash {given}, found one with "
                f"{code.sha256}: the file has changed"
            )
        return str(code.sha256)


def returned(code: Code, arguments: Mapping[str, Any]) -> object:
    """Run the file, call the function, and return its result.

    Output of the code goes to standard error, and the working directory is restored
    afterwards.

    Args:
        code: The function.
        arguments: Its arguments by name.

    Raises:
        UserCodeError: If the file or the function raises, or there is no function.
    """
    name = f"swarmstart_user_{code.sha256}"
    module = ModuleType(name)
    module.__file__ = str(code.file)
    place = printable(str(code.file))
    sys.modules[name] = module  # Dataclasses look up their module there.
    try:
        with contextlib.redirect_stdout(sys.stderr), contextlib.chdir(Path.cwd()):
            exec(compile(code.text.encode(), code.file, "exec"), vars(module))
            function = vars(module).get(code.function)
            if callable(function):
                # A copy: the code may change its arguments, but not the scenario.
                return function(**copy.deepcopy(dict(arguments)))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit must not end this program.
        raise UserCodeError(
            f"{place}: expected a problem from {code.function}, found "
            f"{_described(error)} (--debug shows where)"
        ) from error
    finally:
        sys.modules.pop(name, None)
    raise UserCodeError(
        f"{place}: expected a function {code.function!r}, found "
        f"{'no such name' if function is None else type(function).__name__}"
    )


def _described(error: BaseException) -> str:
    """Return an error in one line; its text comes from the user's code, too."""
    try:
        text = printable(" ".join(str(error).split()))[:_LONGEST]
    except Exception as another:  # noqa: BLE001 - whatever its __str__ does
        text = f"its text raises {type(another).__name__}"
    return f"{type(error).__name__}{': ' if text else ''}{text}"
