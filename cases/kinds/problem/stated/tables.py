"""Tables of a problem: in the file or in a CSV file beside it, used as functions.

A CSV file is replaced by its numbers when the scenario is read, so that the numbers are
part of a run's key and of its record.
"""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any

import casadi as ca
from pydantic import Field, ValidationInfo, model_validator

from swarmstart.cases.format.document import (
    UnreadableFileError,
    YamlError,
    printable,
    shown,
)
from swarmstart.cases.format.settings import Number, Part
from swarmstart.cases.format.yaml_reader import read_bytes
from swarmstart.ocp.interpolation import Beyond, Method, Table, table

MOST_VALUES = 10_000
"""Largest number of values of a table; problems get too many operations before."""
_LONGEST_PATH = 300
_Numbers = list[Number]


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
    def table(self) -> Table:
        """The table."""
        if self.z is None:
            return table(self.x, self.y, self.method, outside=self.outside)
        return table((self.x, self.y), self.z, self.method, outside=self.outside)


Tables = Mapping[str, Table]
NO_TABLES: Tables = MappingProxyType({})


def inputs_of(tables: Tables) -> dict[str, int]:
    """Return the number of arguments of each table."""
    return {name: len(one.breakpoints) for name, one in tables.items()}


def operations_of(tables: Tables) -> dict[str, Callable[..., Any]]:
    """Return each table as an operation on floats, arrays or symbols."""
    return {name: _operation(one) for name, one in tables.items()}


def _operation(given: Table) -> Callable[..., Any]:
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
    path = PurePosixPath(given) if isinstance(given, str) else PurePosixPath("..")
    is_below = not path.is_absolute() and ".." not in path.parts
    if not is_below or path.suffix != ".csv" or len(str(path)) > _LONGEST_PATH:
        raise ValueError(
            "expected file to be a CSV file in the scenario's folder or below, such as "
            f"thrust.csv; found {shown(str(given))}"
        )
    name = printable(str(folder / path))
    try:
        text = read_bytes(folder / path).decode("utf-8-sig")
        lines = text.splitlines()
        rows = [(line, row) for line, row in enumerate(csv.reader(lines), 1) if row]
    except (UnreadableFileError, YamlError) as error:
        raise ValueError(str(error)) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{name}: expected CSV in UTF-8: {error}") from None
    return _tabulated(rows, name)


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
            "y": _row(name, first, ["0", *head[1:]])[1:],
            "z": [row[1:] for row in numbers],
        }
    has_names = all(_value(cell) is None for cell in head)
    numbers = [_row(name, line, row) for line, row in (body if has_names else rows)]
    return {"x": [row[0] for row in numbers], "y": [row[1] for row in numbers]}


def _row(name: str, line: int, cells: Sequence[str]) -> list[float]:
    values = [_value(cell) for cell in cells]
    for column, (value, cell) in enumerate(zip(values, cells, strict=True), 1):
        if value is None:
            raise ValueError(
                f"{name}:{line}: expected a number in column {column}, "
                f"found {shown(cell)}"
            )
    return [value for value in values if value is not None]


def _value(cell: str) -> float | None:
    """Return a cell as a finite number; None if it is not one."""
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None
