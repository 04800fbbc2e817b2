"""Values in the scenario of a problem: expressions, numbers, tables, decided numbers.

Expressions use the file's own names; numbers can be expressions in its constants.
Tables are in the file or in a CSV file beside it, and are used as functions. A CSV file
is replaced by its numbers when the scenario is read, so that the numbers are part of a
run's key and of its record.
"""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError, PydanticKnownError

from swarmstart.arrays import Array
from swarmstart.cases.format.document import (
    UnreadableFileError,
    YamlError,
    printable,
    shown,
)
from swarmstart.cases.format.expressions import parse
from swarmstart.cases.format.parts import LARGEST, Number, Part, Positive
from swarmstart.cases.format.yaml_reader import MAX_BYTES, read_bytes
from swarmstart.ocp.interpolation import Beyond, Method, table
from swarmstart.ocp.interpolation import Table as LookupTable

Names = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$")]

MOST_VALUES = 10_000
"""Largest number of values of a table; problems get too many operations before."""
_LONGEST_PATH = 300
_Numbers = list[Number]


def _text(value: object) -> object:
    """Return an expression in constants as text; numbers are converted, too."""
    value = _written(value, "float_type")
    parse(value)
    return value


def _text_with_tables(value: object) -> object:
    """Return an expression as text; the tables are not known yet."""
    value = _written(value, "expression_type")
    parse(value, functions=None)
    return value


def _text_of_paths(value: object) -> object:
    """Return the expression of a measure, checked."""
    if not isinstance(value, str):
        raise _unexpected("measure_type")
    parse(value, of_paths=True, functions=None)
    return value


def _written(value: object, expected: str) -> str:
    """Return an expression, or a number as text; for others raise what was expected."""
    if isinstance(value, str):
        return value
    # true and false are integers of Python, but no numbers of a scenario.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _unexpected(expected)
    if value > LARGEST:
        raise PydanticKnownError("less_than_equal", {"le": LARGEST})
    if value < -LARGEST:
        raise PydanticKnownError("greater_than_equal", {"ge": -LARGEST})
    if math.isnan(value):
        raise PydanticKnownError("finite_number")
    return repr(value)


def _unexpected(expected: str) -> PydanticCustomError:
    # A type of error whose words are in format/flaws.py.
    return PydanticCustomError(expected, "Input should be other")


def _schema(what: str) -> WithJsonSchema:
    return WithJsonSchema({"type": ["number", "string"], "description": what})


Expression = Annotated[
    str,
    BeforeValidator(_text_with_tables),
    _schema("An expression in the names of this file."),
]
Quantity = Annotated[
    str, BeforeValidator(_text), _schema("A number, or an expression in constants.")
]
Measured = Annotated[str, BeforeValidator(_text_of_paths)]


class Table(Part):
    """Values at times, held before the first and after the last.

    Attributes:
        times: Increasing times [s].
        values: Values, one at each time.
        between: Values between two times: with linear they change evenly, with hold the
            earlier value stays. With hold, a signal jumps in plans, too, if it jumps
            only where control intervals of a fixed length begin; otherwise, and in
            committed plans, it is linear from one check to the next.
    """

    times: list[Number] = Field(min_length=1, max_length=10_000)
    values: list[Number] = Field(min_length=1, max_length=10_000)
    between: Literal["linear", "hold"] = "linear"

    @model_validator(mode="after")
    def _fits(self) -> "Table":
        if len(self.times) != len(self.values):
            raise ValueError(
                f"expected as many values as times; found {len(self.values)} values "
                f"and {len(self.times)} times"
            )
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("expected times that increase")
        return self


def chosen(key: str, *, otherwise: str) -> Discriminator:
    """Return a rule for Pydantic that says by a key which form of a part is meant.

    Pydantic then reports errors of this form only, not of all forms. If the value is a
    text, the form for texts is meant.

    Args:
        key: Key that only one of the forms has.
        otherwise: Name of the form of a mapping without this key.
    """

    def tag(value: Any) -> str:
        has = key in value if isinstance(value, dict) else hasattr(value, key)
        is_part = isinstance(value, dict | Part)
        found = key if has else otherwise if is_part else "text"
        return f"of {found}"  # Not equal to a key: keys are places of errors.

    return Discriminator(tag)


OverTime = Annotated[
    Annotated[Table, Tag("of table")] | Annotated[Expression, Tag("of text")],
    chosen("table", otherwise="table"),
]
"""A table, or an expression in constants and time."""
Limits = Annotated[list[Quantity | None], Field(min_length=2, max_length=2)]
"""[lower, upper]; null means no limit."""
MovingLimits = Annotated[list[Expression | None], Field(min_length=2, max_length=2)]
"""Limits that can be expressions of parameters, signals and time."""


class Decided(Part):
    """A number that the plan decides, within bounds.

    Attributes:
        free: Bounds [lower, upper] of the number; null, without a search only, means no
            limit.
        guess: Value between the bounds at which a polish without a search starts; null
            means the middle of the bounds.
    """

    free: Limits
    guess: Quantity | None = None


class Tied(Part):
    """A start that is decided together with that of another state, whose value it has.

    Attributes:
        same_as: Name of the state whose decided start this state shares.
    """

    same_as: Names


def _decided_or(otherwise: str, *, or_tied: bool = False) -> Discriminator:
    """Return the choice between a decided number and another form."""

    def tag(value: Any) -> str:
        is_mapping = isinstance(value, dict) and "same_as" in value
        if or_tied and (isinstance(value, Tied) or is_mapping):
            return "is tied"
        if isinstance(value, Decided) or (isinstance(value, dict) and "free" in value):
            return "is decided"
        if otherwise == "over time" and isinstance(value, dict | Table):
            return "table"
        return otherwise

    return Discriminator(tag)


Start = Annotated[
    Annotated[Decided, Tag("is decided")]
    | Annotated[Tied, Tag("is tied")]
    | Annotated[Quantity, Tag("number")],
    _decided_or("number", or_tied=True),
]
"""Start of a state: a number, decided, or decided with another one."""
Parameter = Annotated[
    Annotated[Decided, Tag("is decided")]
    | Annotated[Table, Tag("table")]
    | Annotated[Expression, Tag("over time")],
    _decided_or("over time"),
]
"""A table or an expression as OverTime, or a decided number."""
Horizon = Annotated[
    Annotated[Decided, Tag("is decided")] | Annotated[Positive, Tag("number")],
    _decided_or("number"),
]
"""A length [s], or decided."""


class TablePart(Part):
    """A table of one input, y at each x, or of two, z at each x and y.

    Attributes:
        file: CSV file in the scenario's folder or below, in place of x, y and z.
        x: Increasing breakpoints of the first input.
        y: Values at the breakpoints; with z, increasing breakpoints of the second
            input.
        z: Values of a table of two inputs: a row for each x with a value for each y;
            null means one input.
        method: Interpolation: linear, or the cubic spline through the values.
        outside: Values beyond the breakpoints: the end pieces continue, or the end
            values hold.
    """

    file: str = Field(default="", exclude=True)
    x: _Numbers = Field(default_factory=list, max_length=MOST_VALUES)
    y: _Numbers = Field(default_factory=list, max_length=MOST_VALUES)
    z: list[_Numbers] | None = Field(default=None, max_length=MOST_VALUES)
    method: Method = "linear"
    outside: Beyond = "extrapolate"

    @model_validator(mode="before")
    @classmethod
    def _read(cls, given: Any, info: ValidationInfo) -> Any:
        """Replace a file by its numbers."""
        if not isinstance(given, dict) or "file" not in given:
            return given
        if inline := [key for key in ("x", "y", "z") if key in given]:
            raise ValueError(f"expected file, or x and y; found file and {inline[0]}")
        folder = (info.context or {}).get("folder", Path())
        return {**given, **numbers_of(given["file"], folder)}

    @model_validator(mode="after")
    def _fits(self) -> "TablePart":
        for key in ("x", "y"):
            if key not in self.model_fields_set:
                raise ValueError(f"expected x and y, or a file; missing {key}")
        if self.z is not None and sum(map(len, self.z)) > MOST_VALUES:
            raise ValueError(f"expected at most {MOST_VALUES} values")
        _ = self.table  # Raises here, at its place.
        return self

    @cached_property
    def table(self) -> LookupTable:
        """The table."""
        if self.z is None:
            return table(self.x, self.y, self.method, outside=self.outside)
        return table((self.x, self.y), self.z, self.method, outside=self.outside)


Pair = Annotated[list[Quantity], Field(min_length=2, max_length=2)]


class Normal(Part):
    """Normally distributed numbers: [mean, deviation].

    Attributes:
        normal: Mean and standard deviation of a normal distribution.
    """

    normal: Pair

    @property
    def pair(self) -> tuple[str, list[str]]:
        """Name of the distribution, and its two numbers."""
        return "normal", self.normal


class Uniform(Part):
    """Uniformly distributed numbers in [lower, upper].

    Attributes:
        uniform: Lower and upper end of a uniform distribution.
    """

    uniform: Pair

    @property
    def pair(self) -> tuple[str, list[str]]:
        """Name of the distribution, and its two numbers."""
        return "uniform", self.uniform


Law = Annotated[
    Annotated[Normal, Tag("of normal")] | Annotated[Uniform, Tag("of uniform")],
    chosen("normal", otherwise="uniform"),
]
"""Distribution of a drawn number."""


Tables = Mapping[str, LookupTable]
NO_TABLES: Tables = MappingProxyType({})


def inputs_of(tables: Tables) -> dict[str, int]:
    """Return the number of arguments of each table."""
    return {name: len(one.breakpoints) for name, one in tables.items()}


def operations_of(tables: Tables) -> dict[str, Callable[..., Any]]:
    """Return each table as an operation on floats, arrays or symbols."""
    return {name: _operation(one) for name, one in tables.items()}


def _operation(given: LookupTable) -> Callable[..., Any]:
    def operation(*arguments: Any) -> Any:
        if any(isinstance(argument, ca.SX) for argument in arguments):
            return given(*arguments)
        values = given.at(*arguments)
        return values if values.ndim else float(values)

    return operation


def numbers_of(given: object, folder: Path) -> dict[str, Any]:
    """Return the numbers of a CSV file: x and y, and z of a table of two inputs.

    Two columns are x and y; a first line without numbers names them. More columns are a
    table of two inputs: the first line has the values of y, after a cell that is not
    read; each other line has a value of x and the values of z.

    Args:
        given: The file's path in the scenario.
        folder: The scenario's folder; the file is in it or below.

    Raises:
        ValueError: If the file does not exist, or does not contain such a table.
    """
    name, rows = csv_rows(given, folder)
    return _tabulated(rows, name)


def csv_rows(
    given: object, folder: Path, *, most: int = MAX_BYTES
) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return the name of a CSV file for messages, and its lines that are not empty.

    Args:
        given: The file's path in the scenario.
        folder: The scenario's folder; the file is in it or below.
        most: Largest size of the file [bytes].

    Returns:
        The name; the number of each line, from 1, and its cells.

    Raises:
        ValueError: If there is no such file, or it is no CSV in UTF-8.
    """
    path = PurePosixPath(given) if isinstance(given, str) else PurePosixPath("..")
    is_below = not path.is_absolute() and ".." not in path.parts
    if not is_below or path.suffix != ".csv" or len(str(path)) > _LONGEST_PATH:
        raise ValueError(
            "expected file to be a CSV file in the scenario's folder or below, such as "
            f"thrust.csv; found {shown(str(given))}"
        )
    try:
        return csv_lines(folder / path, most=most)
    except (UnreadableFileError, YamlError) as error:
        raise ValueError(str(error)) from None


def csv_lines(file: Path, *, most: int) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return the name of a CSV file for messages, and its lines, as `csv_rows`.

    Args:
        file: The file.
        most: Largest size of the file [bytes].

    Raises:
        UnreadableFileError: If it cannot be read.
        YamlError: If it is larger than `most`.
        ValueError: If it is no CSV in UTF-8.
    """
    name = printable(str(file))
    try:
        # Spreadsheets begin a CSV file with a byte order mark.
        lines = read_bytes(file, most=most).decode("utf-8-sig").splitlines()
        return name, [
            (line, row) for line, row in enumerate(csv.reader(lines), 1) if row
        ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{name}: expected CSV in UTF-8: {error}") from None


def csv_names(
    name: str, rows: Sequence[tuple[int, list[str]]], of: str
) -> tuple[list[str], Sequence[tuple[int, list[str]]]]:
    """Return the names of the columns of a CSV file, and the lines below.

    Args:
        name: Name of the file.
        rows: Its lines.
        of: Things that the names belong to, in words for messages.

    Raises:
        ValueError: If a name is missing or appears twice.
    """
    (_, head), *body = rows or [(1, [])]
    names = [cell.strip() for cell in head]
    if not names or not all(names) or len({*names}) < len(names):
        raise ValueError(
            f"{name}:1: expected {of}, each once; found "
            f"{', '.join(map(shown, names)) or 'nothing'}"
        )
    return names, body


def csv_columns(
    names: Sequence[str], body: Sequence[tuple[int, list[str]]]
) -> dict[str, Array]:
    """Return the columns of a CSV file by name.

    Args:
        names: Names of the columns.
        body: Number of each line in the file, and its cells: a number for each name.
    """
    numbers = np.array([[number_of(cell) for cell in row] for _, row in body], float)
    return dict(zip(names, numbers.reshape(-1, len(names)).T, strict=True))


def _tabulated(rows: Sequence[tuple[int, list[str]]], name: str) -> dict[str, Any]:
    """Return the numbers of the lines of a table."""
    columns = len(rows[0][1]) if rows else 0
    if columns < 2:  # noqa: PLR2004
        raise ValueError(f"{name}: expected at least two columns, found {columns}")
    for line, row in rows:
        if len(row) != columns:
            raise ValueError(
                f"{name}:{line}: expected {columns} columns as in the first line, "
                f"found {len(row)}"
            )
    (first, head), *body = rows
    if columns > 2:  # noqa: PLR2004
        numbers = [_row(name, line, row) for line, row in body]
        return {
            "x": [row[0] for row in numbers],
            # A number in place of the first cell keeps the columns of messages right.
            "y": _row(name, first, ["0", *head[1:]])[1:],
            "z": [row[1:] for row in numbers],
        }
    has_names = all(number_of(cell) is None for cell in head)
    numbers = [_row(name, line, row) for line, row in (body if has_names else rows)]
    return {"x": [row[0] for row in numbers], "y": [row[1] for row in numbers]}


def _row(name: str, line: int, cells: Sequence[str]) -> list[float]:
    values = [number_of(cell) for cell in cells]
    for column, (value, cell) in enumerate(zip(values, cells, strict=True), 1):
        if value is None:
            raise ValueError(
                f"{name}:{line}: expected a number in column {column}, "
                f"found {shown(cell)}"
            )
    return [value for value in values if value is not None]


def number_of(cell: str) -> float | None:
    """Return a cell as a finite number; None if it is not one."""
    try:
        # Python reads 1_000 as a number; no table means that.
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None
