"""What the figures of all kinds share: empty figures, and how they are written."""

import functools
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from swarmstart.cases.record import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(size: tuple[float, float] = (7.0, 4.0)) -> "Figure":
    """Return an empty figure that no global state knows of; its size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=110, layout="constrained")


def write_figures(figures: Iterable[tuple[str, "Figure"]], folder: Path) -> list[Path]:
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
