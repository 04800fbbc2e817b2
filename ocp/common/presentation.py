"""Presentation of results and of progress, by functions that `ocp` does not contain.

`ocp` neither prints, nor plots, nor writes. A result looks up the function for its
figures, files and tables in the table below when it is needed, and `cases` does the
work. Long work reports its progress to a callback of the program that called it. By
default a display of `cases` is that callback, on a terminal and in a notebook.
"""

import os
import sys
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.arguments import FLAG, PATH, checked, either, function
from swarmstart.heuristics import Budget
from swarmstart.ocp.common.errors import refused

_DRAWING, _RECORD = "swarmstart.cases.drawing", "swarmstart.cases.record"
PRESENTATIONS = {
    ("Solution", "plot"): f"{_DRAWING}.problem_figures:draw_solution",
    ("Trajectory", "plot"): f"{_DRAWING}.problem_figures:draw_trajectory",
    ("Solution", "html"): f"{_DRAWING}.problem_figures:html_of",
    ("Trajectory", "html"): f"{_DRAWING}.problem_figures:html_of",
    ("Solution", "save"): f"{_RECORD}.results:save_solution",
    ("Trajectory", "save"): f"{_RECORD}.results:save_trajectory",
    ("Solution", "to_dataframe"): f"{_RECORD}.results:dataframe_of",
    ("Trajectory", "to_dataframe"): f"{_RECORD}.results:dataframe_of",
    ("Solution", "to_time_response"): f"{_RECORD}.results:time_response_of",
    ("Trajectory", "to_time_response"): f"{_RECORD}.results:time_response_of",
    ("SwarmFlight", "plot"): f"{_DRAWING}.swarm_figures:draw_swarm",
    ("Solutions", "plot"): f"{_DRAWING}.instance_figures:draw_solutions",
    ("Solutions", "save"): f"{_RECORD}.instances:save_solutions",
    ("Solutions", "load"): f"{_RECORD}.instances:load_solutions",
    ("Solutions", "to_dataframe"): f"{_RECORD}.instances:dataframe_of",
    ("Solutions", "to_xarray"): f"{_RECORD}.instances:dataset_of",
}
"""(class, verb) -> "module:function"; the function takes the result first."""
ProgressCallback = Callable[[int, int, str], None]
"""(done, of, description of the work) -> None; `of` is 0 if it is not known.

The library itself prints nothing.
"""
ProgressGiven = ProgressCallback | bool
"""A callback; True: a display on a terminal and in a notebook; False: none."""
PROGRESS = either(FLAG, function())
_DISPLAY = "swarmstart.cases.commands.terminal:Progress"
_FREE = threading.Lock()
"""Held while the progress of a call is shown, or hidden: a second display would be
drawn over the first."""


class Presenting:
    """Base of results whose figures, files and tables `cases` makes."""

    __slots__ = ()

    def _presented(self, verb: str, *arguments: Any, **options: Any) -> Any:
        """Call the function that the table lists for this class and a verb."""
        return presentation(type(self).__name__, verb)(self, *arguments, **options)


def presentation(result: str, verb: str) -> Callable[..., Any]:
    """Return the function of `PRESENTATIONS` for a class of results and a verb.

    Args:
        result: Name of the class.
        verb: What to do, such as "plot".
    """
    # At the call, not at the import: `cases` stands above `ocp` and loads matplotlib.
    found: Callable[..., Any] = resolve_name(PRESENTATIONS[result, verb])
    return found


class Presented(Presenting):
    """Base of results over time that can be drawn, saved and converted to a table."""

    __slots__ = ()

    def plot(self) -> Any:
        """Return a matplotlib Figure: states and controls over time, with their names.

        Raises:
            ImportError: If matplotlib is not installed.
        """
        return self._presented("plot")

    @checked(refused, folder=PATH, force=FLAG)
    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write the result into a folder, for `swarmstart.load`; return the folder.

        Args:
            folder: Created if it is missing; must be empty otherwise.
            force: Whether to replace a result that was saved there before. Other files
                are never changed.

        Raises:
            OccupiedFolderError: If the folder holds other files.
            RecordError: If a file cannot be written.
        """
        written: Path = self._presented("save", Path(folder), force=force)
        return written

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame: one row per node, one column per state or control.

        Algebraic variables of a Solution and outputs of the model come last. The index
        is the time [s]. Controls are held from one row to the next, so the last row has
        none (NaN).

        Raises:
            MissingPackageError: If pandas is not installed.
        """
        return self._presented("to_dataframe")

    def to_time_response(self) -> Any:
        """Return a `control.TimeResponseData`, with python-control's plots and tables.

        Its times are those of the finer path of a Solution, or of the plant's steps of
        a Trajectory. Its outputs are those of the model, or the states if it has none.
        Controls are held from each time to the next.
        """
        return self._presented("to_time_response")

    def _repr_html_(self) -> str:
        """Return the summary and the figure, for a notebook."""
        shown: str = self._presented("html")
        return shown


def tell_nothing(done: int, of: int, what: str, /) -> None:
    """Do nothing: the default callback."""


def of_budget(
    progress: ProgressCallback, budget: Budget, what: str
) -> Callable[[int], None] | None:
    """Return a function of the evaluations so far that reports the progress.

    Args:
        progress: Callback; receives evaluations, or whole seconds if the budget has
            only these.
        budget: Budget of the work, which starts now.
        what: Description of the work.

    Returns:
        The function; None if no progress is to be reported.
    """
    if progress is tell_nothing:  # A search without this function makes no reports.
        return None
    began = clock.perf_counter()

    def tell(evaluations: int) -> None:
        if budget.evaluations is None and budget.seconds is not None:
            seconds = int(clock.perf_counter() - began)
            progress(seconds, int(budget.seconds), what)
        else:
            progress(evaluations, budget.evaluations or 0, what)

    return tell


@contextmanager
def shown(
    progress: ProgressGiven, title: str, what: str, *, of: str = "step", total: int = 0
) -> Iterator[ProgressCallback]:
    """Lend a callback for the progress of a call.

    Args:
        progress: A callback, which is lent as it is; True: a display on standard error
            that appears after two seconds and is erased at the end, if standard error
            is a terminal or a notebook's, and no progress is shown yet; False: nothing.
        title: Name of the call.
        what: Description of the work that is done first.
        of: Name of what is counted.
        total: Total of what is counted; 0 if it is not known.
    """
    if not isinstance(progress, bool):
        yield progress
        return
    if not (progress and _is_seen() and _FREE.acquire(blocking=False)):
        yield tell_nothing
        return
    try:
        with resolve_name(_DISPLAY)(title, of=of, waits=True) as display:
            display.update(0, total, what)
            yield display.update
    finally:
        _FREE.release()


@contextmanager
def hidden() -> Iterator[None]:
    """Show no progress by default until the context ends."""
    is_first = _FREE.acquire(blocking=False)
    try:
        yield
    finally:
        if is_first:
            _FREE.release()


def _is_seen() -> bool:
    """Return whether standard error is a terminal, or that of a notebook."""
    try:
        is_terminal = sys.stderr is not None and sys.stderr.isatty()
    except ValueError:  # It is closed.
        return False
    return (is_terminal or is_notebook()) and "CI" not in os.environ


def is_notebook() -> bool:
    """Return whether standard error is shown in the cells of a notebook."""
    return type(sys.stderr).__module__.partition(".")[0] == "ipykernel"
