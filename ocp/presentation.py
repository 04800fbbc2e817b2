"""How a result is drawn, written and shown: by functions that `ocp` knows by name only.

`ocp` neither plots nor writes. A result looks its function up in the table below when
it is asked, and `cases` does the work.
"""

from pathlib import Path
from pkgutil import resolve_name
from typing import Any

_DRAWING, _RECORD = "swarmstart.cases.drawing", "swarmstart.cases.record"
PRESENTATIONS = {
    ("Solution", "plot"): f"{_DRAWING}.problem_figures:draw_solution",
    ("Trajectory", "plot"): f"{_DRAWING}.problem_figures:draw_trajectory",
    ("Solution", "html"): f"{_DRAWING}.summaries:html_of",
    ("Trajectory", "html"): f"{_DRAWING}.summaries:html_of",
    ("Solution", "save"): f"{_RECORD}.results:save_solution",
    ("Trajectory", "save"): f"{_RECORD}.results:save_trajectory",
    ("Solution", "to_dataframe"): f"{_RECORD}.tables:dataframe_of",
    ("Trajectory", "to_dataframe"): f"{_RECORD}.tables:dataframe_of",
}
"""(class, verb) -> "module:function" that takes the result first."""


class Presented:
    """A result that can be drawn, saved and made a table of."""

    __slots__ = ()

    def plot(self) -> Any:
        """Return a matplotlib Figure: states and controls over time, by their names.

        Raises:
            ImportError: If matplotlib is not installed.
        """
        return self._presented("plot")

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write the result into a folder, for `swarmstart.load`; return the folder.

        Args:
            folder: Made if it is missing; must be empty.
            force: Whether a result that was saved there before is replaced. Other
                files are never touched.

        Raises:
            OccupiedFolderError: If the folder holds other files.
            RecordError: If a file cannot be written.
        """
        written: Path = self._presented("save", Path(folder), force=force)
        return written

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame: a row a node, a column a state or a control.

        Algebraic variables of a Solution come last. The index is the time [s]. Controls
        are held from a row to the next, so that the last row has none (NaN).

        Raises:
            MissingPackageError: If pandas is not installed.
        """
        return self._presented("to_dataframe")

    def _repr_html_(self) -> str:
        """Return the summary and the figure, as a notebook shows them."""
        shown: str = self._presented("html")
        return shown

    def _presented(self, verb: str, *arguments: Any, **options: Any) -> Any:
        """Call the function that the table has for this class and a verb."""
        present = resolve_name(PRESENTATIONS[type(self).__name__, verb])
        return present(self, *arguments, **options)
