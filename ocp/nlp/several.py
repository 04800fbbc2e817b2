"""Polishes from several starts, some of them ahead of their turn in other processes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from numpy.typing import ArrayLike

from swarmstart.machine_code import stopwatch
from swarmstart.ocp.common.processes import Ahead
from swarmstart.ocp.nlp.nlp_solvers import FixedSteps, NlpSolvers
from swarmstart.ocp.nlp.optimality import NlpPoint
from swarmstart.ocp.nlp.polish import Polished, Polisher, is_better
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.nlp.watching import UNWATCHED, expect_starts, is_late, stops_nothing
from swarmstart.ocp.rollout.fitness import Known

_WORTH = 3e7
"""Operations of a polish, about 30 ms, from which a copy of the process pays: it takes
some milliseconds to make, and to fetch the memory that it writes to."""


class Packed(NamedTuple):
    """An answer as it can be sent to another process.

    Attributes:
        found: The answer, without its point.
        point: Point of the answer, without the NLP; None if the answer has no point.
        steps: Steps of the NLP.
    """

    found: Polished
    point: NlpPoint | None
    steps: FixedSteps | None


class Timed(NamedTuple):
    """An answer of a polish, and its wall time [s]."""

    found: Polished
    seconds: float


def in_turn(
    polisher: Polisher,
    polishes: Sequence[Callable[[], Polished]],
    processes: int,
    *,
    first: Sequence[int] = (),
) -> Ahead[Timed]:
    """Return a context with the answers of polishes, in their order.

    If the polisher's watch counts work or may stop it, the polishes run one after the
    other.

    Args:
        polisher: The polisher that all of them call.
        polishes: Functions, each of which makes one polish.
        processes: Largest number of processes.
        first: Numbers of the polishes that are most likely needed.
    """
    pays = processes > 1 and bool(polishes) and stops_nothing(polisher.watch)
    if pays and polisher.operations >= _WORTH:
        polisher.prepare()  # Before the process is copied.
    else:
        processes = 1

    def timed(polish: Callable[[], Polished]) -> Timed:
        with stopwatch() as watch:
            return Timed(polish(), watch.seconds)

    def begins() -> None:
        polisher.watch = UNWATCHED  # A copy reports nothing.

    def sent(one: Timed) -> tuple[Packed, float]:
        return _packed(one.found, polisher.solvers), one.seconds

    def received(sent: tuple[Packed, float]) -> Timed:
        found = _unpacked(sent[0], polisher.solvers)
        polisher.watch.answered((found.controls, found.x0), found.cost, found.violation)
        return Timed(found, sent[1])

    return Ahead(
        [partial(timed, one) for one in polishes],
        processes=processes,
        begins=begins,
        sent=sent,
        received=received,
        first=first,
    )


def _packed(found: Polished, solvers: NlpSolvers) -> Packed:
    """Return an answer without its NLP, which the other process has already."""
    if found.point is None:
        return Packed(found, None, None)
    steps = solvers.steps_of(found.point.program)
    apart = replace(found.point, program=None)  # type: ignore[arg-type]
    return Packed(replace(found, point=None), apart, steps)


def _unpacked(packed: Packed, solvers: NlpSolvers) -> Polished:
    """Return an answer of another process with the NLP of this one."""
    found, point, steps = packed
    if point is None:
        return found
    program = solvers(steps).program
    return replace(found, point=replace(point, program=program))


def polished_from(
    polisher: Polisher, start: Start, x0: ArrayLike, known: Known, *, near: bool
) -> Polished:
    """Polish from a start, and return the answer.

    Args:
        polisher: The polisher.
        start: The start.
        x0: Initial state, shape (nx,), unless the start has its own.
        known: Values of the parameters and signals.
        near: Whether the solver should stay near the start; see Polisher.
    """
    return polisher(
        start.controls,
        x0 if start.x0 is None else start.x0,
        known,
        states=start.states,
        is_guess=start.is_guess,
        near=near,
        carried=start.carried,
    )


def polish_basins(  # noqa: PLR0913 - starts and how they are polished
    polisher: Polisher,
    starts: Sequence[Start],
    x0: ArrayLike,
    known: Known,
    *,
    tolerance: float,
    near: bool,
    processes: int = 1,
) -> tuple[Polished, int]:
    """Polish from each start; return the best answer, and the evaluations of all.

    Args:
        polisher: The polisher.
        starts: Starts, at least one; among equal answers the first is kept.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        tolerance: Largest violation that counts as feasible.
        near: Whether the starts are answers that the solver should stay near; see
            Polisher.
        processes: Largest number of processes.
    """

    def polished(start: Start) -> Polished:
        # A start with states of its own is a guess, not an answer.
        is_near = near and start.states is None
        return polished_from(polisher, start, x0, known, near=is_near)

    expect_starts(polisher.watch, len(starts))
    calls = [partial(polished, one) for one in starts]
    with in_turn(polisher, calls, processes) as results:
        best = results.result(0).found
        evaluations = best.evaluations
        for number in range(1, len(starts)):
            if is_late(polisher.watch):
                break
            one = results.result(number).found
            evaluations += one.evaluations
            found, so_far = ((p.cost, p.violation) for p in (one, best))
            if is_better(found, so_far, tolerance=tolerance):
                best = one
    return best, evaluations
