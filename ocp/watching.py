"""What an NLP solver, a search and lanes spend, told while they work.

A watch counts, keeps the best answer so far, and says when a budget is spent: then an
NLP solver stops after the iteration at hand, and no further solve is begun. Nothing is
changed by being watched, as long as nothing is stopped.

What an NLP solver does is counted in rollouts, by the instructions of the functions of
one interval, end and start (nlp_assembly.py):

    rollouts    points at which it has asked for cost or rows
    gradients   points at which it has asked for the cost's slope or the Jacobian
    hessians    points at which it has asked for second derivatives
    evaluations = rollouts + (gradients * instructions of slope and Jacobian
                  + hessians * instructions of the Hessian) / instructions of a rollout

Both ratios are fixed for a problem, so that equal work is the same number on a quick
and on a slow machine. CasADi tells the counts only at a solve's end: while it runs an
iteration counts as one of each, trial steps of a line search come at the end.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.heuristics import SearchResult
from swarmstart.heuristics.search import Individual
from swarmstart.ocp.shooting import Shooting
from swarmstart.ocp.transcription import NonlinearProgram

Array = NDArray[np.float64]
Answer = tuple[Array, Array]
"""Controls (nu, N), and the initial state with what is decided about it (nx,)."""
_CALLS = "n_call_nlp_"


class Ratios(NamedTuple):
    """What derivatives cost, in rollouts.

    Attributes:
        gradient: The cost's slope and the Jacobian at a point.
        hessian: The second derivatives at a point.
    """

    gradient: float
    hessian: float


@dataclass(frozen=True, slots=True)
class Work:
    """What an NLP solver has asked for.

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
        """Return the same in rollouts."""
        return (
            self.rollouts
            + self.gradients * ratios.gradient
            + self.hessians * ratios.hessian
        )


def work_of(stats: Mapping[str, Any]) -> Work:
    """Return what a solve took.

    Cost and rows, or slope and Jacobian, asked for one by one are of the same points:
    of these the larger count is taken.

    Args:
        stats: As CasADi's solver tells them.
    """
    counts = {"hess": 0, "grad": 0, "value": 0}
    for name, count in stats.items():
        if not name.startswith(_CALLS) or name == "n_call_nlp_grad":
            continue  # The last is CasADi's own look at the multipliers.
        what = name.removeprefix(_CALLS)
        kind = "grad" if "grad" in what or "jac" in what else "value"
        kind = "hess" if "hess" in what else kind
        counts[kind] = max(counts[kind], int(count))
    return Work(counts["value"], counts["grad"], counts["hess"])


def ratios_of(program: NonlinearProgram, shooting: Shooting) -> Ratios:
    """Return what derivatives of an NLP cost, in rollouts.

    Where steps have no fixed length, a rollout counts as the NLP's own fixed steps.

    Args:
        program: The NLP.
        shooting: Of its problem.
    """
    problem, parts = program.problem, program.parts.present
    times = [problem.intervals, *[1] * (len(parts) - 1)]

    def instructions(*names: str) -> int:
        return sum(
            count * getattr(part, name).n_instructions()
            for count, part in zip(times, parts, strict=True)
            for name in names
        )

    rollout = instructions("cost", "value")
    if not problem.is_adaptive:
        each = shooting.stage_without_path.n_instructions()
        rollout = each * problem.intervals + shooting.terminal.n_instructions()
    return Ratios(
        gradient=instructions("cost_slope", "slopes") / rollout,
        hessian=instructions("curvature") / rollout,
    )


class Watch(Protocol):
    """What looks on, counts, and says when to stop."""

    @property
    def is_over(self) -> bool:
        """Whether a budget is spent: nothing more is begun."""

    def searching(self) -> AbstractContextManager[None]:
        """Be told of a search until the context ends.

        What an NLP solver does meanwhile is in the search's own evaluations.
        """

    def advanced(
        self,
        evaluations: int,
        best: Callable[[], Individual],
        answer: Callable[[Array], Answer],
    ) -> None:
        """Take in where a search is; at moments that the clock decides.

        Args:
            evaluations: Of the search so far.
            best: Returns its best point.
            answer: What a point means.
        """

    def searched(self, result: SearchResult) -> None:
        """Take in what a search has found, and how it came there."""

    def counted(self, evaluations: float) -> None:
        """Take in other work, in rollouts."""

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Take in an iterate of an NLP solver; return whether it may go on.

        Args:
            evaluations: What this solve has taken so far, in rollouts, about.
            answer: Returns the iterate; None: it is none of the problem's own.
        """

    def solved(self, work: Work, ratios: Ratios) -> None:
        """Take in what a solve has taken."""

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        """Take in an answer of a solver, with its value at the checks."""


class Unwatched:
    """Nobody looks on: nothing is counted, and nothing stopped."""

    is_over = False

    def searching(self) -> AbstractContextManager[None]:
        """Do nothing; as all that follows."""
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


class WorkAlone(Unwatched):
    """Tells a watch what another problem's solver spends, and none of its answers."""

    def __init__(self, watch: Watch) -> None:
        """Take the watch that is told."""
        self._watch = watch

    @property
    def is_over(self) -> bool:  # type: ignore[override]
        """Whether a budget is spent."""
        return self._watch.is_over

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        """Tell of an iterate, not which."""
        del answer
        return self._watch.iterated(evaluations, None)

    def solved(self, work: Work, ratios: Ratios) -> None:
        """Tell of a solve."""
        self._watch.solved(work, ratios)


class Iterates(ca.Callback):
    """What CasADi calls after each iteration of an NLP solver.

    Attributes:
        told: Iterate, in the NLP's numbers -> whether to go on; set for each solve.
    """

    def __init__(self, nlp: Mapping[str, Any]) -> None:
        """Take the NLP's sizes.

        Args:
            nlp: As `nlpsol` takes it.
        """
        super().__init__()
        rows = nlp["g"].numel() if "g" in nlp else 0
        parameters = nlp["p"].numel() if "p" in nlp else 0
        w = nlp["x"].numel()
        self._sizes = {
            "x": w, "f": 1, "g": rows, "lam_x": w, "lam_g": rows, "lam_p": parameters
        }  # fmt: skip
        self.told: Callable[[Array], bool] = lambda _: True
        self.construct("iterates", {})

    def get_n_in(self) -> int:
        """Return the number of the solver's outputs."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of an output of the solver."""
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:
        """Return what CasADi looks for."""
        del i
        return "ret"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return the shape of an output of the solver."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[int]:
        """Return 0 to go on, 1 to stop."""
        return [0 if self.told(np.array(arguments[0]).ravel()) else 1]
