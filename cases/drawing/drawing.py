"""What the figures of all kinds share: colours, empty figures, how they are written."""

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.record.files import write_atomically
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
S = TypeVar("S")
F = TypeVar("F")
Figures = Iterable[tuple[str, "Figure"]]
"""Names without a suffix, and figures."""

# Colours that people with colour-blindness can tell apart (Okabe and Ito, 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def new_figure(size: tuple[float, float] = (7.0, 4.0)) -> "Figure":
    """Return an empty figure that no global state knows of; its size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=110, layout="constrained")


def into_folder(
    figures: Callable[[S, F, Trajectory], Figures],
) -> Callable[[S, F, Trajectory, Path], list[Path]]:
    """Return a function that writes figures into a folder and returns the files.

    Args:
        figures: Scenario, flight and trajectory -> figures by name, in order.
    """

    @functools.wraps(figures)
    def draw(
        scenario: S, flight: F, trajectory: Trajectory, folder: Path
    ) -> list[Path]:
        return write_figures(figures(scenario, flight, trajectory), folder)

    return draw


def write_figures(figures: Figures, folder: Path) -> list[Path]:
    """Write figures as PNG files by name; return the files, in order.

    Args:
        figures: Names without a suffix, and figures.
        folder: Where they go; made where it is missing.
    """
    files = []
    for name, figure in figures:
        file = folder / f"{name}.png"
        write_atomically(file, functools.partial(figure.savefig, format="png"))
        files.append(file)
    return files


def colour(number: int) -> str:
    """Return the colour of a UAV; seven, then round again."""
    return COLOURS[number % len(COLOURS)]


def arrowhead(heading: float) -> Array:
    """Return a triangle that points along a heading [rad], shape (4, 2)."""
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    tip, left = along, -0.7 * along + 0.55 * across
    right = -0.7 * along - 0.55 * across
    return np.array([tip, left, right, tip])
