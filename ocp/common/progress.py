"""Progress reports from long work to the program that called it."""

import time as clock
from collections.abc import Callable

from swarmstart.heuristics import Budget

ProgressCallback = Callable[[int, int, str], None]
"""(done, of, description of the work) -> None; `of` is 0 if it is not known.

The library itself prints nothing.
"""


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
    if progress is tell_nothing:
        return None
    began = clock.perf_counter()

    def tell(evaluations: int) -> None:
        if budget.evaluations is None and budget.seconds is not None:
            seconds = int(clock.perf_counter() - began)
            progress(seconds, int(budget.seconds), what)
        else:
            progress(evaluations, budget.evaluations or 0, what)

    return tell
