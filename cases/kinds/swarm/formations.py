"""Formations: places of vehicles, by a few numbers, from a file, or as letters."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    model_validator,
)

from swarmstart.arrays import Array
from swarmstart.cases.format.document import shown
from swarmstart.cases.format.parts import Number, Part, Positive
from swarmstart.cases.kinds.problem.stated.values import (
    csv_names,
    csv_rows,
    number_of,
)

MOST_VEHICLES = 1000
APART = 1.15
"""Distance of random places, in least distances."""
MOST_TRIES = 20_000
"""Number of random places in a row that may have no room."""
AXES = ("x_m", "y_m", "z_m")

Place = Annotated[list[Number], Field(min_length=3, max_length=3)]
"""Position: x, y, z [m]."""
Count = Annotated[int, Field(ge=1, le=MOST_VEHICLES)]
ORIGIN: Place = [0.0, 0.0, 0.0]


class Points(Part):
    """Places one by one, or from a CSV file.

    Attributes:
        formation: Name of the formation.
        points_m: Place of each vehicle: x, y, z [m].
    """

    formation: Literal["points"]
    points_m: list[Place] = Field(min_length=1, max_length=MOST_VEHICLES)

    def places(self) -> Array:
        """Return the places, shape (n, 3) [m]."""
        return np.array(self.points_m)


class Line(Part):
    """A row across the heading.

    Attributes:
        formation: Name of the formation.
        count: Number of vehicles.
        spacing_m: Distance from one to the next [m].
        centre_m: Middle of the row: x, y, z [m].
        heading_rad: Heading, from the x axis to the left [rad].
    """

    formation: Literal["line"]
    count: Count
    spacing_m: Positive
    centre_m: Place = ORIGIN
    heading_rad: Number = 0.0

    def places(self) -> Array:
        """Return the places, shape (n, 3) [m], from the left to the right."""
        places = np.arange(self.count, dtype=np.float64)
        aside = self.spacing_m * ((self.count - 1) / 2 - places)
        return _turned(np.zeros(self.count), aside, self.heading_rad, self.centre_m)


class V(Part):
    """A V behind its leader, the first vehicle.

    Attributes:
        formation: Name of the formation.
        count: Number of vehicles.
        spacing_m: Distance from one to the next along each leg [m].
        opening_rad: Angle between the legs [rad].
        centre_m: Place of the leader: x, y, z [m].
        heading_rad: Heading, from the x axis to the left [rad].
    """

    formation: Literal["v"]
    count: Count
    spacing_m: Positive
    opening_rad: Annotated[Number, Field(gt=0, le=np.pi)] = np.pi / 2
    centre_m: Place = ORIGIN
    heading_rad: Number = 0.0

    def places(self) -> Array:
        """Return the places, shape (n, 3) [m]: the leader, then left and right."""
        number = np.arange(self.count)
        along = self.spacing_m * np.floor((number + 1) / 2)
        side = np.where(number % 2 == 1, 1.0, -1.0)
        return _turned(
            -along * np.cos(self.opening_rad / 2),
            side * along * np.sin(self.opening_rad / 2),
            self.heading_rad,
            self.centre_m,
        )


class Circle(Part):
    """A circle at one height.

    Attributes:
        formation: Name of the formation.
        count: Number of vehicles.
        radius_m: Radius of the circle [m].
        centre_m: Its centre: x, y, z [m].
        phase_rad: Angle of the first vehicle [rad].
    """

    formation: Literal["circle"]
    count: Count
    radius_m: Positive
    centre_m: Place = ORIGIN
    phase_rad: Number = 0.0

    def places(self) -> Array:
        """Return the places, shape (n, 3) [m]."""
        angle = self.phase_rad + 2 * np.pi * np.arange(self.count) / self.count
        return _turned(
            self.radius_m * np.cos(angle), self.radius_m * np.sin(angle), 0.0,
            self.centre_m,
        )  # fmt: skip


class Grid(Part):
    """Rows, columns and layers at equal distances.

    Attributes:
        formation: Name of the formation.
        counts: Number of vehicles along x, y and z.
        spacing_m: Distance from one to the next [m].
        centre_m: Middle of the grid: x, y, z [m].
    """

    formation: Literal["grid"]
    counts: Annotated[list[Count], Field(min_length=3, max_length=3)]
    spacing_m: Positive
    centre_m: Place = ORIGIN

    @model_validator(mode="after")
    def _not_too_many(self) -> "Grid":
        count = int(np.prod(self.counts))
        if count > MOST_VEHICLES:
            raise ValueError(f"expected at most {MOST_VEHICLES} places, found {count}")
        return self

    def places(self) -> Array:
        """Return the places, shape (n, 3) [m]; the last axis changes first."""
        axes = [self.spacing_m * (np.arange(n) - (n - 1) / 2) for n in self.counts]
        whole = np.meshgrid(*axes, indexing="ij")
        flat = np.stack([one.ravel() for one in whole], axis=1)
        return np.asarray(flat + np.array(self.centre_m))


class Letters(Part):
    """Points along the outlines of text.

    Attributes:
        formation: Name of the formation.
        text: Characters to be shown, without a space at the ends.
        count: Number of vehicles.
        height_m: Height of the letters [m].
        centre_m: Middle of the text: x, y, z [m].
        upright: Option to let the letters stand along x and z, in place of x and y.
    """

    formation: Literal["letters"]
    text: Annotated[str, Field(pattern=r"^[\x21-\x7e]([\x20-\x7e]{0,30}[\x21-\x7e])?$")]
    count: Count
    height_m: Positive
    centre_m: Place = ORIGIN
    upright: bool = False

    def places(self) -> Array:
        """Return the places, shape (n, 3) [m], evenly along the outlines."""
        from matplotlib.textpath import TextPath  # Slow to import.

        text = self.text.replace("$", r"\$")  # It would begin a formula.
        lines = [
            np.asarray(one) for one in TextPath((0, 0), text, size=1).to_polygons()
        ]
        begins = np.concatenate([one[:-1] for one in lines])
        ways = np.concatenate([np.diff(one, axis=0) for one in lines])
        lengths = np.hypot(*ways.T)
        ends = np.cumsum(lengths)
        along = (np.arange(self.count) + 0.5) * ends[-1] / self.count
        which = np.searchsorted(ends, along)
        share = 1.0 - (ends[which] - along) / lengths[which]
        flat = begins[which] + share[:, None] * ways[which]
        low, high = begins.min(axis=0), begins.max(axis=0)
        flat = self.height_m / (high[1] - low[1]) * (flat - (low + high) / 2)
        across = np.zeros(self.count)
        x, y = flat.T
        whole = np.stack([x, across, y] if self.upright else [x, y, across], axis=1)
        return np.asarray(whole + np.array(self.centre_m))


class Cube(Part):
    """Random places in a cube, apart from each other and from obstacles.

    Attributes:
        formation: Name of the formation.
        count: Number of vehicles.
        side_m: Length of the sides of the cube [m].
        centre_m: Its centre: x, y, z [m].
        seed: Seed of the places.
    """

    formation: Literal["cube"]
    count: Count
    side_m: Positive
    centre_m: Place = ORIGIN
    seed: int = Field(default=0, ge=0, lt=2**32)


class Opposite(Part):
    """Goals opposite to the starts, through the middle of all starts.

    Attributes:
        formation: Name of the formation.
    """

    formation: Literal["opposite"]


def _sort(given: object) -> str:
    """Return which of the forms of starts or goals is given."""
    if isinstance(given, list):
        return "several"
    name = given.get("formation") if isinstance(given, dict) else None
    is_opposite = isinstance(given, Opposite) or name == "opposite"
    return "opposite" if is_opposite else "one"


def _from_file(given: Any, info: ValidationInfo) -> Any:
    """Replace a CSV file of places by its points."""
    if not isinstance(given, dict) or given.get("formation") != "file":
        return given
    if set(given) != {"formation", "file"}:
        raise ValueError(f"expected the keys formation and file; found {sorted(given)}")
    folder = (info.context or {}).get("folder", Path())
    name, rows = csv_rows(given["file"], folder)
    names, body = csv_names(name, rows, ", ".join(AXES))
    if tuple(names) != AXES:
        raise ValueError(
            f"{name}: expected the columns {', '.join(AXES)}; found {', '.join(names)}"
        )
    if not 1 <= len(body) <= MOST_VEHICLES:
        raise ValueError(
            f"{name}: expected 1 to {MOST_VEHICLES} places, found {len(body)}"
        )
    points = [_numbers(name, line, row) for line, row in body]
    return {"formation": "points", "points_m": points}


def _numbers(name: str, line: int, row: list[str]) -> list[float]:
    """Return the numbers of a line of a CSV file of places.

    Raises:
        ValueError: If it has no three finite numbers.
    """
    values = [number_of(cell) for cell in row]
    if len(row) != len(AXES) or None in values:
        raise ValueError(
            f"{name}:{line}: expected a number for {', '.join(AXES)}, found "
            f"{shown(','.join(row))}"
        )
    return [value for value in values if value is not None]


Formation = Annotated[
    Annotated[
        Points | Line | V | Circle | Grid | Letters | Cube,
        Field(discriminator="formation"),
    ],
    BeforeValidator(_from_file),
]
"""One formation, perhaps from a file."""
Goals = Annotated[
    Annotated[Opposite, Tag("opposite")]
    | Annotated[Formation, Tag("one")]
    | Annotated[list[Formation], Field(min_length=1, max_length=100), Tag("several")],
    Discriminator(_sort),
]
"""Goals: opposite to the starts, one formation, or several."""
Starts = Annotated[
    Annotated[Formation, Tag("one")]
    | Annotated[list[Formation], Field(min_length=1, max_length=100), Tag("several")],
    Discriminator(_sort),
]
"""Starts: one formation, or several, one after another."""


def random_places(
    cube: Cube, scale: Array, distance: float, balls: list[tuple[Array, float]]
) -> Array:
    """Return random places of a cube, shape (n, 3) [m].

    Args:
        cube: The cube.
        scale: Factors of the axes in distances, shape (3,).
        distance: Least scaled distance of two places; the places keep a little more.
        balls: Centre, shape (3,) [m], and scaled clearance of each obstacle.

    Raises:
        ValueError: If there is no room for all places.
    """
    rng, found = np.random.default_rng(cube.seed), np.empty((0, 3))
    corner = np.array(cube.centre_m) - cube.side_m / 2
    failures = 0
    while failures < MOST_TRIES:
        if len(found) == cube.count:
            return found
        failures += 1
        place = corner + cube.side_m * rng.random(3)
        apart = np.linalg.norm((found - place) * scale, axis=1)
        free = all(
            np.linalg.norm((centre - place) * scale) > room for centre, room in balls
        )
        if free and (apart >= APART * distance).all():
            found, failures = np.vstack([found, place]), 0
    raise ValueError(
        f"expected room for {cube.count} vehicles in a cube of {cube.side_m:g} m; "
        f"found room for {len(found)}"
    )


def _turned(along: Array, left: Array, heading: float, centre: Place) -> Array:
    """Return places at one height, given along and left of a heading."""
    cos, sin = np.cos(heading), np.sin(heading)
    flat = [cos * along - sin * left, sin * along + cos * left, np.zeros(len(along))]
    return np.asarray(np.stack(flat, axis=1) + np.array(centre))
