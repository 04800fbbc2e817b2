"""Instances of a scenario's plan: other starts of states, other values of parameters.

They are given in a CSV file or as lists, as a grid, or drawn. A file is replaced by its
numbers when the scenario is read, so that they are part of a sweep's record.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, Tag, ValidationInfo, model_validator

from swarmstart.arrays import Array
from swarmstart.cases.format.document import counted, shown
from swarmstart.cases.format.parts import Number, Part
from swarmstart.cases.kinds.problem.stated.values import (
    Law,
    Names,
    Normal,
    Quantity,
    chosen,
    csv_columns,
    csv_names,
    csv_rows,
    number_of,
)

MOST_INSTANCES, MOST_STARTS = 100_000, 1000
"""Largest number of instances of a sweep, and of starts of each."""
FIRST_LINE = 2
"""Line of a CSV file that has the first instance; the names are in the line before."""
_NAMED = 10
"""Largest number of lines that a message names."""
_MOST_BYTES = 20_000_000
"""Largest size of a CSV file of instances."""


class Axis(Part):
    """Values at equal distances.

    Attributes:
        lower: First value.
        upper: Last value.
        points: Number of values, with both ends.
    """

    lower: Quantity
    upper: Quantity
    points: int = Field(ge=2, le=MOST_INSTANCES)


AxisPart = Annotated[
    Annotated[Axis, Tag("of points")]
    | Annotated[Annotated[list[Quantity], Field(min_length=1)], Tag("of text")],
    chosen("points", otherwise="points"),
]
"""Values of one axis of a grid: at equal distances, or a list of them."""


class Instances(Part):
    """Starts and parameters of many instances of a plan, for `swarmstart sweep`.

    States and parameters that are not named are those of the file.

    Attributes:
        file: CSV file in the scenario's folder or below, in place of `values`: the
            first line has names of states and parameters, each other line an instance.
        values: Starts of states and values of parameters by name, one for each
            instance.
        grid: Values by name, in place of `values`: every combination is an instance,
            the last name changes first.
        drawn: Distributions by name, in place of `values`.
        samples: Number of instances that are drawn; null without `drawn`.
        seed: Seed of the drawn numbers, which do not depend on --seed.
        starts: Number of starts of the local solver for each instance. The first two
            have as controls the guess or, without a guess, the middle of the bounds:
            the first with the states to which these controls lead, the second with
            states that stay at the start. All others have random controls. If it is
            null, all instances are solved from the first start; three more starts are
            then tried for instances that fail and for some chosen at random, and for
            further ones as long as cheaper answers are found.
    """

    file: str = Field(default="", exclude=True)
    values: Mapping[Names, list[Number]] = Field(default_factory=dict)
    grid: Mapping[Names, AxisPart] = Field(default_factory=dict)
    drawn: Mapping[Names, Law] = Field(default_factory=dict)
    samples: int | None = Field(default=None, ge=1, le=MOST_INSTANCES)
    seed: int = Field(default=0, ge=0, lt=2**32)
    starts: int | None = Field(default=None, ge=1, le=MOST_STARTS)

    @model_validator(mode="before")
    @classmethod
    def _read(cls, given: Any, info: ValidationInfo) -> Any:
        """Replace a file by its numbers."""
        if not isinstance(given, dict) or not given.get("file"):
            return given
        if "values" in given:
            raise ValueError("expected file or values; found both")
        folder = (info.context or {}).get("folder", Path())
        return {
            **given,
            "values": _columns(*csv_rows(given["file"], folder, most=_MOST_BYTES)),
        }

    @model_validator(mode="after")
    def _one_source(self) -> "Instances":
        found = [
            "file" if key == "values" and self.file else key
            for key in ("values", "grid", "drawn")
            if getattr(self, key)
        ]
        if len(found) != 1:
            raise ValueError(
                "expected one of file, values, grid and drawn; found "
                f"{' and '.join(found) or 'none'}"
            )
        if bool(self.drawn) != (self.samples is not None):
            raise ValueError("expected samples, their number, with drawn and only then")
        lengths = {name: len(one) for name, one in self.values.items()}
        if len({*lengths.values()}) > 1:
            listed = ", ".join(f"{n} of {name}" for name, n in lengths.items())
            raise ValueError(f"expected as many values of each name; found {listed}")
        if not 1 <= self.count <= MOST_INSTANCES:
            raise ValueError(
                f"expected 1 to {MOST_INSTANCES} instances, found {self.count}"
            )
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states and parameters that differ."""
        return (*self.values, *self.grid, *self.drawn)

    @property
    def count(self) -> int:
        """Number of instances."""
        if self.values:
            return max(map(len, self.values.values()))
        if self.drawn:
            return self.samples or 0
        # Python's integers have no largest one, unlike NumPy's.
        count = 1
        for axis in self.grid.values():
            count *= axis.points if isinstance(axis, Axis) else len(axis)
        return count

    def place(self, number: int) -> str:
        """Return the line of an instance in a file, in words; empty without a file.

        Args:
            number: Number of the instance, from 0.
        """
        return f"line {number + FIRST_LINE} of {self.file}" if self.file else ""

    def quantities(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the place of each expression, and its text."""
        for name, axis in self.grid.items():
            if isinstance(axis, Axis):
                yield ("grid", name, "lower"), axis.lower
                yield ("grid", name, "upper"), axis.upper
            else:
                yield from ((("grid", name, n), one) for n, one in enumerate(axis))
        for name, law in self.drawn.items():
            kind, pair = law.pair
            yield from ((("drawn", name, kind, n), one) for n, one in enumerate(pair))


def instance_columns(
    part: Instances, number: Callable[[str], float]
) -> dict[str, Array]:
    """Return the values of all instances by name, each of shape (M,).

    Args:
        part: The instances.
        number: Function from an expression to its value.
    """
    if part.values:
        return {name: np.array(one, dtype=float) for name, one in part.values.items()}
    if part.drawn:
        return {
            name: _drawn(part, index, *map(number, law.pair[1]))
            for index, (name, law) in enumerate(part.drawn.items())
        }
    axes = [
        np.linspace(number(axis.lower), number(axis.upper), axis.points)
        if isinstance(axis, Axis)
        else np.array([number(text) for text in axis])
        for axis in part.grid.values()
    ]
    whole = np.meshgrid(*axes, indexing="ij")
    return {name: one.ravel() for name, one in zip(part.grid, whole, strict=True)}


def _drawn(part: Instances, index: int, first: float, second: float) -> Array:
    """Return the values of a name; more samples leave the first ones as they are."""
    law = [*part.drawn.values()][index]
    rng = np.random.default_rng([part.seed, index])
    draw = rng.normal if isinstance(law, Normal) else rng.uniform
    return np.asarray(draw(first, second, part.samples))


def _columns(name: str, rows: Sequence[tuple[int, list[str]]]) -> dict[str, Any]:
    """Return the columns of a CSV file by their names.

    Raises:
        ValueError: If a name or a line is invalid; all such lines are named.
    """
    names, body = csv_names(name, rows, "the names of states and parameters")
    wrong = [*_wrong_lines(names, body)]
    if wrong:
        more = len(wrong) - _NAMED
        listed = [f"line {line}: {what}" for line, what in wrong[:_NAMED]]
        listed += [f"and {counted(more, 'more line')}"] if more > 0 else []
        raise ValueError(
            f"{name}: expected a finite number for {', '.join(names)} in each line; "
            f"{'; '.join(listed)}"
        )
    return {key: one.tolist() for key, one in csv_columns(names, body).items()}


def _wrong_lines(
    names: Collection[str], body: Sequence[tuple[int, list[str]]]
) -> Iterator[tuple[int, str]]:
    """Yield the lines that have no instance, and what was found there."""
    for place, (line, row) in enumerate(body):
        before = body[place - 1][0] if place else FIRST_LINE - 1
        if before != line - 1:
            yield line - 1, "found an empty line"
        if len(row) != len(names):
            yield line, f"found {counted(len(row), 'column')}"
            continue
        found = [
            f"{shown(cell)} as {name}"
            for name, cell in zip(names, row, strict=True)
            if number_of(cell) is None
        ]
        if found:
            yield line, f"found {', '.join(found)}"
