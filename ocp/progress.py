"""How long work tells the program that asked for it how far it is."""

import time as clock
from collections.abc import Callable

from swarmstart.heuristics import Budget

ProgressCallback = Callable[[int, int, str], None]
"""(done, of, what is being done) -> None; `of` is 0 where that cannot be told.

The library itself prints nothing.
"""


def tell_nothing(done: int, of: int, what: str, /) -> None:
    """Tell nothing: the default."""


def of_budget(
    progress: ProgressCallback, budget: Budget, what: str
) -> Callable[[int], None] | None:
    """Return a function of the evaluations so far that tells the progress.

    Args:
        progress: Told evaluations, or whole seconds where the budget has only these.
        budget: Of the work, which begins now.
        what: What is being done.

    Returns:
        None where nothing is to be told.
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
