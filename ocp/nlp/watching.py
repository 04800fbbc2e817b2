"""Observation of the work of an NLP solver, a search and lanes, while they run.

A watch counts the work, keeps the best answer so far, and reports when a budget is
spent. An NLP solver then stops after the present iteration, and no further solve is
started. A watch that stops nothing changes no result.

The work of an NLP solver is counted in rollouts, by the instructions of the functions
of one interval, end and start (nlp_assembly.py):

    rollouts    points at which the solver evaluated cost or rows
    gradients   points at which it evaluated the cost's slope or the Jacobian
    hessians    points at which it evaluated second derivatives
    evaluations = rollouts + (gradients * instructions of slope and Jacobian
                  + hessians * instructions of the Hessian) / instructions of a rollout

Both ratios of instructions are fixed for a problem, so that equal work is the same
number on a fast and on a slow machine. CasADi reports the counts only at the end of a
solve. While it runs, an iteration counts as one of each; trial steps of a line search
are added at the end.
"""

import math
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from swarmstart.arguments import having
from swarmstart.arrays import Array
from swarmstart.heuristics import Budget, SearchResult, StopReason
from swarmstart.heuristics.running import Individual
from swarmstart.ocp.common.presentation import ProgressCallback
from swarmstart.ocp.nlp.transcription import NonlinearProgram
from swarmstart.ocp.rollout.shooting import Shooting

Answer = tuple[Array, Array]
"""Controls (nu, N), and the initial state with the decisions about it (nx,)."""
Value = tuple[float, float]
"""Cost and violation at the checks of the problem."""
_CALLS = "n_call_nlp_"
_REPORTED = 10
"""Number of iterations of an NLP solver from one report to the next."""
_SOON_S, _MANY = 0.5, 1000
"""Time and number of variables from which iterations are reported: a report takes up to
0.1 ms, a tenth of a short iteration."""


class Ratios(NamedTuple):
    """Cost of derivatives, in rollouts.

    Attributes:
        gradient: Cost of the cost's slope and the Jacobian at a point.
        hessian: Cost of the second derivatives at a point.
    """

    gradient: float
    hessian: float


@dataclass(frozen=True, slots=True)
class Work:
    """Work of an NLP solver.

    Attributes:
        rollouts: Points with cost or rows.
        gradients: Points with first derivatives.
        hessians: Points with second derivatives.
    """

    rollouts: int = 0
    gradients: int = 0
    hessians: int = 0

    def __add__(self, other: "Work") -> "Work":
        """Return the sum of both."""
        return Work(
            self.rollouts + other.rollouts,
            self.gradients + other.gradients,
            self.hessians + other.hessians,
        )

    def evaluations(self, ratios: Ratios) -> float:
        """Return the work in rollouts."""
        return (
            self.rollouts
            + self.gradients * ratios.gradient
            + self.hessians * ratios.hessian
        )


def work_of(stats: Mapping[str, Any]) -> Work:
    """Return the work of a solve.

    Separate evaluations of cost and rows, or of slope and Jacobian, are at the same
    points; the larger count is taken.

    Args:
        stats: Statistics as CasADi's solver reports them.
    """
    counts = {"hess": 0, "grad": 0, "value": 0}
    for name, count in stats.items():
        if not name.startswith(_CALLS) or name == "n_call_nlp_grad":
            continue  # The last: CasADi's own multipliers.
        what = name.removeprefix(_CALLS)
        kind = "grad" if "grad" in what or "jac" in what else "value"
        kind = "hess" if "hess" in what else kind
        counts[kind] = max(counts[kind], int(count))
    return Work(counts["value"], counts["grad"], counts["hess"])


def ratios_of(program: NonlinearProgram, shooting: Shooting) -> Ratios:
    """Return the cost of an NLP's derivatives, in rollouts.

    If rollouts use step size control, a rollout counts as much as one with the fixed
    steps of the NLP.
    """
    problem, parts = program.problem, program.parts.present
    times = [problem.intervals, *[1] * (len(parts) - 1)]

    def instructions(*names: str) -> int:
        return sum(
            count * getattr(part, name).n_instructions()
            for count, part in zip(times, parts, strict=True)
            for name in names
        )

    rollout = instructions("values")
    if not problem.is_adaptive:
        each = shooting.stage_without_path.n_instructions()
        rollout = each * problem.intervals + shooting.terminal.n_instructions()
    return Ratios(
        gradient=instructions("slopes") / rollout,
        hessian=instructions("curvature") / rollout,
    )


class Watch(Protocol):
    """Observer that counts the work and decides when to stop."""

    @property
    def is_over(self) -> bool:
        """True if a budget is spent, so that no further work is started."""

    def searching(self) -> AbstractContextManager[None]:
        """Observe a search until the context ends.

        The work of an NLP solver meanwhile is part of the search's own evaluations.
        """

    def advanced(
        self,
        evaluations: int,
        best: Callable[[], Individual],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Receive the progress of a search, at times that depend on the clock.

        Args:
            evaluations: Evaluations of the search so far.
            best: Function that returns the best point of the search.
            answer: Converts a point to an answer.
        """

    def searched(self, result: SearchResult) -> None:
        """Receive the result of a search, with its history."""

    def counted(self, evaluations: float) -> None:
        """Receive other work, in rollouts."""

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Receive an iterate of an NLP solver; return whether it may continue.

        Args:
            evaluations: Approximate work of this solve so far, in rollouts.
            answer: Function that returns the iterate; None if the iterate does not
                belong to the problem itself.
        """

    def solved(self, work: Work, ratios: Ratios) -> None:
        """Receive the work of a solve."""

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Receive an answer of a solver, with its cost and violation at the checks."""


class Unwatched:
    """No observation: nothing is counted, and nothing is stopped."""

    is_over = False

    def __reduce__(self) -> str:
        """Be pickled by name: `UNWATCHED` is known by its identity."""
        return "UNWATCHED"

    def searching(self) -> AbstractContextManager[None]:
        """Do nothing; the same holds for all methods below."""
        return nullcontext()

    def advanced(
        self,
        evaluations: int,
        best: Callable[[], Individual],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Do nothing."""

    def searched(self, result: SearchResult) -> None:
        """Do nothing."""

    def counted(self, evaluations: float) -> None:
        """Do nothing."""

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Return True."""
        del evaluations, answer
        return True

    def solved(self, work: Work, ratios: Ratios) -> None:
        """Do nothing."""

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Do nothing."""


UNWATCHED = Unwatched()
WATCH = having("is_over", "searching", words="an observer with the methods of Watch")


class Relay:
    """Relay to one watch after another, so that compiled parts serve all of them.

    Attributes:
        watch: The current watch.
    """

    def __init__(self, watch: Watch = UNWATCHED) -> None:
        """Start with a watch."""
        self.watch = watch

    @contextmanager
    def to(self, watch: Watch) -> Iterator[None]:
        """Relay to another watch until the context ends."""
        before, self.watch = self.watch, watch
        try:
            yield
        finally:
            self.watch = before

    @property
    def is_over(self) -> bool:
        """True if the current watch's budget is spent."""
        return self.watch.is_over

    def searching(self) -> AbstractContextManager[None]:
        """Pass the call on to the current watch."""
        return self.watch.searching()

    def advanced(
        self,
        evaluations: int,
        best: Callable[[], Individual],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Pass the call on to the current watch."""
        self.watch.advanced(evaluations, best, answer)

    def searched(self, result: SearchResult) -> None:
        """Pass the call on to the current watch."""
        self.watch.searched(result)

    def counted(self, evaluations: float) -> None:
        """Pass the call on to the current watch."""
        self.watch.counted(evaluations)

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Pass the call on to the current watch."""
        return self.watch.iterated(evaluations, answer)

    def solved(self, work: Work, ratios: Ratios) -> None:
        """Pass the call on to the current watch."""
        self.watch.solved(work, ratios)

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Pass the call on to the current watch."""
        self.watch.answered(answer, cost, violation)


class WorkAlone(Relay):
    """Report another problem's work to a watch, without its answers."""

    def counted(self, evaluations: float) -> None:
        """Do nothing."""

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Report an iterate, without its values."""
        del answer
        return self.watch.iterated(evaluations, None)

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Do nothing."""


class Deadline(Relay):
    """Watch that ends the work on a plan at a given time and keeps the best answer.

    Attributes:
        best: The best answer so far; None before the first.
        value: Cost and violation of the best answer.
        stopped: Whether the time has ended some work, or prevented it.
    """

    def __init__(
        self,
        within: float,
        clock: Callable[[], float],
        *,
        value_of: Callable[[Array, Array], Value],
        better: Callable[[Value, Value], bool],
        watch: Watch = UNWATCHED,
    ) -> None:
        """Set the time.

        Args:
            within: Time after the start at which the work ends [s].
            clock: Function that returns the time since the start [s].
            value_of: Controls and initial state -> cost and violation at the checks.
            better: Whether the first value is better than the second.
            watch: Another observer, which may stop the work earlier.
        """
        super().__init__(watch)
        self._within, self._clock = within, clock
        self._value_of, self._better = value_of, better
        self._limits_search = False
        self.best: Answer | None = None
        self.value: Value = (math.inf, math.inf)
        self.stopped = False

    @property
    def is_late(self) -> bool:
        """True if the time is over, so that no further work is started."""
        late = self._clock() >= self._within
        self.stopped = self.stopped or late
        return late

    @property
    def is_over(self) -> bool:
        """True if the time is over, or another budget is spent."""
        return self.is_late or self.watch.is_over

    def shortened(self, budget: Budget, share: float) -> Budget:
        """Return a search's budget with at most a share of the remaining time."""
        # A budget needs a time above zero: the first generation is made in any case.
        left = max(share * (self._within - self._clock()), 1e-9)
        self._limits_search = budget.seconds is None or left < budget.seconds
        return replace(budget, seconds=left) if self._limits_search else budget

    def searched(self, result: SearchResult) -> None:
        """Pass the result on; note if the deadline cut the search short."""
        if self._limits_search and result.stopped is StopReason.SECONDS:
            self.stopped = True
        self.watch.searched(result)

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Keep an iterate if it is the best so far; return whether to continue."""
        if answer is not None:
            found = answer()
            # Iterates of a solver that fails can be NaN.
            if all(np.isfinite(part).all() for part in found):
                self._keep(found, self._value_of(*found))
        goes_on = self.watch.iterated(evaluations, answer)
        return goes_on and not self.is_late

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Keep an answer if it is the best so far."""
        self._keep(answer, (cost, violation))
        self.watch.answered(answer, cost, violation)

    def _keep(self, answer: Answer, value: Value) -> None:
        if self._better(value, self.value):
            self.best, self.value = answer, value


class Reporting(Relay):
    """Reports of the polishes to a callback for progress.

    Attributes:
        starts: Number of starts to be polished, as far as it is known.
    """

    def __init__(self, progress: ProgressCallback, watch: Watch = UNWATCHED) -> None:
        """Keep the callback and another observer."""
        super().__init__(watch)
        self._progress, self.starts = progress, 0
        self._polished, self._iterations = 0, 0
        self._began = clock.perf_counter()

    def reports(self, variables: int) -> bool:
        """Return whether iterations of an NLP are reported now."""
        return variables >= _MANY or clock.perf_counter() - self._began >= _SOON_S

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Report every tenth iteration of a start."""
        # The first report is that of the start itself.
        if self._iterations and self._iterations % _REPORTED == 0:
            number = self._polished + 1
            of = f" of {self.starts}" if self.starts >= number else ""
            text = f"polishing start {number}{of}, iteration {self._iterations}"
            self._progress(0, 0, text)
        self._iterations += 1
        return self.watch.iterated(evaluations, answer)

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Count a polished start."""
        self._polished, self._iterations = self._polished + 1, 0
        self.watch.answered(answer, cost, violation)

    def expect(self, more: int) -> None:
        """Receive the number of starts that will be polished besides those so far."""
        self.starts = self._polished + more


def is_watched(watch: Watch, *, variables: int = _MANY) -> bool:
    """Return whether anything is to be reported to a watch now.

    Args:
        watch: The watch.
        variables: Number of variables of the NLP.
    """
    if isinstance(watch, Deadline):
        return True
    if isinstance(watch, Relay):
        reports = isinstance(watch, Reporting) and watch.reports(variables)
        return reports or is_watched(watch.watch, variables=variables)
    return watch is not UNWATCHED


def stops_nothing(watch: Watch) -> bool:
    """Return whether a watch ends no work, and keeps no answers, but only reports."""
    while type(watch) in (Relay, Reporting):
        watch = watch.watch  # type: ignore[attr-defined]
    return watch is UNWATCHED


def deadline_of(watch: Watch) -> Deadline | None:
    """Return the watch if it is a `Deadline`, or the one it relays to; else None."""
    if isinstance(watch, Deadline):
        return watch
    return deadline_of(watch.watch) if isinstance(watch, Relay) else None


def expect_starts(watch: Watch, more: int) -> None:
    """Tell a watch that reports progress how many starts will be polished."""
    while isinstance(watch, Relay):
        if isinstance(watch, Reporting):
            watch.expect(more)
        watch = watch.watch


def is_late(watch: Watch) -> bool:
    """Return whether the deadline of a watch, if it has one, has passed."""
    deadline = deadline_of(watch)
    return deadline is not None and deadline.is_late


class Iterates(ca.Callback):
    """Callback that CasADi calls after each iteration of an NLP solver.

    Attributes:
        told: Function (iterate in the NLP's units) -> whether to continue; set for each
            solve.
    """

    def __init__(self, nlp: Mapping[str, Any]) -> None:
        """Keep the NLP's sizes.

        Args:
            nlp: The NLP, as `nlpsol` takes it.
        """
        super().__init__()
        rows = nlp["g"].numel() if "g" in nlp else 0
        parameters = nlp["p"].numel() if "p" in nlp else 0
        w = nlp["x"].numel()
        self._sizes = {
            "x": w, "f": 1, "g": rows, "lam_x": w, "lam_g": rows, "lam_p": parameters
        }  # fmt: skip
        self.told: Callable[[Array], bool] = lambda _: True
        self.construct("iterates", {})  # Last, since CasADi asks for the sizes at once.

    def get_n_in(self) -> int:
        """Return the number of the solver's outputs."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: the flag to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of an output of the solver."""
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:
        """Return the name that CasADi expects."""
        del i
        return "ret"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of an output of the solver."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def has_eval_buffer(self) -> bool:
        """Return True: the iterate is read from CasADi's memory."""
        return True

    def eval_buffer(
        self, given: Sequence[memoryview], found: Sequence[memoryview]
    ) -> int:
        """Write 0 to continue, 1 to stop."""
        # The first of the solver's outputs is x.
        may_continue = self.told(np.array(np.frombuffer(given[0])))
        np.frombuffer(found[0])[...] = 0.0 if may_continue else 1.0
        return 0
