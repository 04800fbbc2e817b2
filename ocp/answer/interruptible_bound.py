"""Search of a lower bound after an answer was found, without losing the answer."""

import math

from numpy.typing import ArrayLike

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.running import heeded
from swarmstart.ocp.answer.solution import Solution
from swarmstart.ocp.common.progress import ProgressCallback, tell_nothing
from swarmstart.ocp.lower_bound import bounding
from swarmstart.ocp.lower_bound.answer import BoundKind, LowerBound
from swarmstart.ocp.rollout.fitness import NOTHING, Known
from swarmstart.ocp.statement.problem import OptimalControlProblem


class BoundInterrupted(KeyboardInterrupt):
    """Ctrl-C while the lower bound of an answer was computed.

    Attributes:
        partial: The best bound so far; None if there is none.
    """

    def __init__(self, partial: LowerBound | None) -> None:
        """Keep the best bound so far."""
        super().__init__("the bound was interrupted")
        self.partial = partial


def bounded(
    answer: Solution | float | None,
    problem: OptimalControlProblem,
    x0: ArrayLike,
    known: Known = NOTHING,
    *,
    seconds: float,
    progress: ProgressCallback = tell_nothing,
) -> LowerBound:
    """Return a lower bound of the optimal cost; of kind NONE if there is none.

    Args:
        answer: An answer, or its cost as the problem states it, which makes the bound
            tighter; None: no answer is known.
        problem: The problem as it was given.
        x0: Initial state, as it was given.
        known: Parameters and signals as they were given.
        seconds: Time limit [s].
        progress: Callback, as in `solve`.

    Raises:
        BoundInterrupted: On Ctrl-C, with the best bound so far.
    """
    progress(0, 0, "bounding")
    found = None
    try:
        with heeded():
            found = bounding.lower_bound(
                problem,
                x0,
                known=known,
                answer=answer,
                seconds=float(seconds),
                progress=progress,
            )
    except KeyboardInterrupt:
        raise BoundInterrupted(found) from None
    except SwarmstartError as error:
        return LowerBound(
            kind=BoundKind.NONE, value=math.nan, reason=str(error), sense=problem.sense
        )
    return found
