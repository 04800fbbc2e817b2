"""Basis of all figures: colours and line styles, empty figures, files.

Each series has a colour and a line style of its own, so that twelve series can be told
apart with any colour vision and in grey print.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing import palette
from swarmstart.cases.record.files import write_atomically
from swarmstart.cases.record.record import PNG
from swarmstart.ocp import Trajectory
from swarmstart.ocp.common import ProgressCallback, tell_nothing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


S_contra = TypeVar("S_contra", contravariant=True)
F_contra = TypeVar("F_contra", contravariant=True)
S = TypeVar("S")
F = TypeVar("F")
Figures = Iterable[tuple[str, "Figure"]]
"""Names without a suffix, and figures."""
LineStyle = str | tuple[float, tuple[float, ...]]

COLOURS = palette.LIGHT
MOST_NAMED = 12
"""Series up to which each has its own line and name; more are drawn as bands."""
LAYOUT_DPI, PNG_DPI = 110, 200
"""Dots per inch at which a figure is laid out, and of PNG files."""
# Without a date, so that the same figure is the same file.
_METADATA: dict[str, dict[str, Any]] = {
    "png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None},
}  # fmt: skip


class Draw(Protocol[S_contra, F_contra]):
    """A function that draws a run into files and returns these, in order."""

    def __call__(
        self,
        scenario: S_contra,
        flight: F_contra,
        trajectory: Trajectory,
        folder: Path,
        *,
        formats: Sequence[str] = PNG,
        progress: ProgressCallback = tell_nothing,
    ) -> list[Path]:
        """Draw."""


def new_figure(size: tuple[float, float] = (7.0, 4.0)) -> "Figure":
    """Return an empty figure that no global state knows of; its size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=LAYOUT_DPI, layout="constrained")


def into_folder(figures: Callable[[S, F, Trajectory], Figures]) -> Draw[S, F]:
    """Return a function that writes figures into a folder and returns the files.

    Args:
        figures: Scenario, flight and trajectory -> figures by name, in order.
    """

    @functools.wraps(figures)
    def draw(
        scenario: S,
        flight: F,
        trajectory: Trajectory,
        folder: Path,
        *,
        formats: Sequence[str] = PNG,
        progress: ProgressCallback = tell_nothing,
    ) -> list[Path]:
        drawn = figures(scenario, flight, trajectory)
        return write_figures(drawn, folder, formats=formats, progress=progress)

    return draw


def write_figures(
    figures: Figures,
    folder: Path,
    *,
    formats: Sequence[str] = PNG,
    progress: ProgressCallback = tell_nothing,
) -> list[Path]:
    """Write figures as files by name; return the files, in order.

    Args:
        figures: Names without a suffix, and figures.
        folder: Folder of the files; made if it is missing.
        formats: Formats of each figure, of "png", "svg" and "pdf"; each is a file.
        progress: Told (files written, all files, "drawing").

    Raises:
        RecordError: If a file cannot be written.
    """
    planned = [
        (figure, form, folder / f"{name}.{form}")
        for name, figure in figures
        for form in formats
    ]
    for number, (figure, form, file) in enumerate(planned):
        progress(number, len(planned), "drawing")
        save = functools.partial(
            figure.savefig, format=form, dpi=PNG_DPI, metadata=_METADATA[form]
        )
        write_atomically(file, save)
    return [file for _, _, file in planned]


def colour(number: int) -> str:
    """Return the colour of a series; twelve, then round again."""
    return COLOURS[number % len(COLOURS)]


def line_style(number: int) -> LineStyle:
    """Return the line style of a series: twelve, each round with other colours.

    Example:
        >>> line_style(0), line_style(2)
        ('-', (0.0, (2.0, 2.0)))
    """
    count = len(palette.DASHES)
    dashes = palette.DASHES[(number + number // count) % count]
    return (0.0, tuple(map(float, dashes.split()))) if dashes else "-"


def arrowhead(heading: float) -> Array:
    """Return a triangle that points along a heading [rad], shape (4, 2)."""
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    tip, left = along, -0.7 * along + 0.55 * across
    right = -0.7 * along - 0.55 * across
    return np.array([tip, left, right, tip])
