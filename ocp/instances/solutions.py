"""Answers to many instances of one problem, in arrays; each a Solution on demand."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import (
    FLAG,
    PATH,
    a_count,
    checked,
    choice,
    of_kind,
    optional,
    several,
)
from swarmstart.arrays import Array
from swarmstart.errors import Sendable
from swarmstart.ocp.answer.explained import status_line
from swarmstart.ocp.answer.kept import kept_planner
from swarmstart.ocp.answer.sensitivity import (
    DATA,
    Data,
    Sensitivities,
    Sensitivity,
    require_data,
)
from swarmstart.ocp.answer.solution import Solution
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.presentation import Presenting, presentation
from swarmstart.ocp.instances.instance_data import InstanceData, told_invalid
from swarmstart.ocp.instances.outcomes import Answers, Statuses
from swarmstart.ocp.instances.polishing import Answered, OneByOne
from swarmstart.ocp.instances.work import Work
from swarmstart.ocp.nlp.polish_options import IpoptOptions, PolishOptions
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import from_near_start
from swarmstart.ocp.rollout.shooting import shooting_of
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import Lowered
from swarmstart.ocp.statement.rewrites.end_time import END_TIME

if TYPE_CHECKING:
    import pandas as pd
    import xarray


class How(NamedTuple):
    """Settings of the solves, also used for each Solution that is made on demand.

    Attributes:
        polish: Options of the NLP solver.
        repair: As in `solve`.
        seed: Seed of the generator of each instance.
    """

    polish: PolishOptions = IpoptOptions()
    repair: bool = True
    seed: tuple[int, ...] = (0,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Solutions(Presenting):
    """Answers to M instances of one problem, in the order of their initial states.

    Index it to get the `Solution` of one instance, which is polished by the NLP solver
    from the answer here, and verified; iterate over it to get all of them. The finer
    path of an answer is that of the same controls with ten times as many integration
    steps.

    Attributes:
        problem: The problem as it was given.
        data: Initial states, parameters and signals of all instances.
        solver: Solver of each answer, shape (M,): "lanes", or the name of the NLP
            solver; empty without an answer.
        start: Start that led to each answer, shape (M,). "guess": in the lanes, any
            start listed under `starts` in `solve_many`; for the NLP solver, the guess,
            or without one the starts that `solve` takes. "own answer": an earlier
            answer of the instance that was not confirmed on the finer path.
            "neighbour": the answer of another instance. "random": random controls for
            the NLP solver. Empty without an answer.
        attempts: Number of solves of each instance, shape (M,).
        sampled: Number of instances, drawn at random, at which the starts in lanes
            after the first one found nothing cheaper. So these starts were left out at
            the instances that had an answer and were not drawn. 0: no start was left
            out for this reason.
        invalid: Reason why an instance is invalid, by its number.
        seconds: Wall time of the solves [s].
        core_answers: The answers in the terms of the rewritten problem (core).
        how: Settings of the solves.

    Example:
        >>> import casadi as ca, swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        ...     stage_cost=u**2, terminal=[(x, 0)],
        ...     bounds=ss.Bounds(controls=(-9, 9)),
        ... )
        >>> found = ss.solve_many(problem, [[1.0, 2.0, 3.0]], seed=0)
        >>> [status.name for status in found.status], found.cost.round(6)
        (['CONVERGED', 'CONVERGED', 'CONVERGED'], array([1., 4., 9.]))
        >>> found[1].controls.round(6)
        array([[-2., -2., -2., -2.]])
    """

    problem: OptimalControlProblem
    data: InstanceData
    solver: NDArray[np.str_]
    start: NDArray[np.str_]
    attempts: NDArray[np.int64]
    sampled: int
    invalid: Mapping[int, str]
    seconds: float
    core_answers: Answers
    how: How

    @property
    def status(self) -> Statuses:
        """Status of each answer, shape (M,): members of `SolutionStatus`.

        CONVERGED: a local optimum, as shown by the NLP solver, or by the lanes in their
        own test of first and second derivatives. FEASIBLE: confirmed as well, but not
        shown to be a local optimum.
        """
        return self.core_answers.status

    @property
    def is_confirmed(self) -> NDArray[np.bool_]:
        """Mask of the answers that are confirmed on the finer path, shape (M,)."""
        return self.core_answers.confirmed

    @property
    def cost(self) -> Array:
        """Cost on the problem's grid, as stated, shape (M,); NaN without an answer."""
        return self.problem.sense * self.core_answers.cost

    @property
    def verified_cost(self) -> Array:
        """Cost on the finer path, shape (M,)."""
        return self.problem.sense * self.core_answers.verified_cost

    @property
    def violation(self) -> Array:
        """Summed violation on the problem's grid, relative to the scales, (M,)."""
        return self.core_answers.violation

    @property
    def excess(self) -> Array:
        """Worst excess of a constraint on the finer path, shape (M,).

        It is relative to the constraint's scale.
        """
        return self.core_answers.excess

    @property
    def end_difference(self) -> Array:
        """Largest difference of an end state on the finer path, shape (M,).

        It is relative to the state's scale.
        """
        return self.core_answers.end_difference

    @property
    def iterations(self) -> NDArray[np.int64]:
        """Iterations of the lanes, in all attempts, shape (M,)."""
        return self.core_answers.iterations

    @cached_property
    def controls(self) -> Array:
        """Controls, shape (nu, N, M); of linear controls the knots, (nu, N + 1, M)."""
        found, lowered = self.core_answers.controls, self._lowered
        if not lowered.links:
            return found
        knots = [
            lowered.knots(controls, x0)
            for controls, x0 in zip(
                found.T.swapaxes(1, 2), self.core_answers.x0.T, strict=True
            )
        ]
        return np.stack(knots, axis=-1)

    @cached_property
    def states(self) -> Array:
        """States at the nodes, on the problem's own grid, shape (nx, nodes, M)."""
        lowered, found = self._lowered, self.core_answers.states
        flat = lowered.as_stated(found.reshape(len(found), -1))
        return flat.reshape(found.shape)[: self.problem.model.nx]

    @property
    def times(self) -> Array:
        """Times of the nodes, shape (nodes,) [s].

        If the end time is decided, they are fractions of the end time.
        """
        core = self._lowered.core
        return core.times

    @cached_property
    def decided(self) -> Mapping[str, Array]:
        """Decided parameters by name, a free end time as "end time", each (M,)."""
        places, x0 = self._lowered.places, self.core_answers.x0
        names = [END_TIME] * len(places[END_TIME]) + [*self.problem.decided]
        rows = [*places[END_TIME], *places["decided"]]
        return {name: x0[row] for name, row in zip(names, rows, strict=True)}

    @property
    def counts(self) -> dict[SolutionStatus, int]:
        """Number of instances of each status that occurs."""
        found = Counter(self.status.tolist())
        return {status: found[status] for status in SolutionStatus if found[status]}

    @property
    def sampled_line(self) -> str:
        """Sentence about starts that were tried at some instances only, else empty.

        If these starts find nothing cheaper at n instances drawn at random, the share
        of all instances at which they would is below 3 / n, at 95 % confidence (Hanley
        and Lippman-Hand 1983).
        """
        if not self.sampled:
            return ""
        return (
            f"other starts found nothing cheaper at {self.sampled} instances drawn of "
            f"{len(self)}: at most {3 / self.sampled:.1%} have cheaper answers among "
            "them (95% interval)"
        )

    def __len__(self) -> int:
        """Return the number of instances."""
        return self.data.size

    def __iter__(self) -> Iterator[Solution]:
        """Yield the `Solution` of each instance; see `__getitem__`."""
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, number: SupportsIndex) -> Solution:
        """Return the answer to one instance, polished from the answer here.

        Args:
            number: Number of the instance; negative ones count from the end.

        Raises:
            IndexError: If there is no such instance.
            InvalidProblemError: If the number is no integer, or the instance was not
                solved.
        """
        if isinstance(number, bool | np.bool_) or not hasattr(number, "__index__"):
            raise refused("number", number, "the number of an instance")
        place = operator.index(number)
        if not -len(self) <= place < len(self):
            raise IndexError(f"there are {len(self)} instances, asked for {number}")
        place %= len(self)
        status, kept = self.status[place], self.core_answers
        if status in (SolutionStatus.INVALID, SolutionStatus.NOT_REACHED):
            reason = self.invalid.get(place, status.value)
            raise InvalidProblemError(f"instance {place} has no answer: {reason}")
        start, near = None, False
        if np.isfinite(kept.controls[:, :, place]).all():
            start = Start(kept.controls[:, :, place], x0=kept.x0[:, place])
            near = not kept.by_interval[place]
            if not near:  # A roll-out of its controls would explode.
                start = start._replace(states=kept.states[:, :, place])
        with kept_planner(self._near, polish=self.how.polish) as planner:
            x0, known, _ = planner.posed(self.data.x0[:, place], self.data.known(place))
            each = OneByOne(
                planner, seed=self.how.seed, repair=self.how.repair, threads=1
            )
            return each.solution(np.asarray(x0, dtype=float), known, start, near=near)

    @checked(
        refused,
        by=several(choice(DATA), "names of data"),
        threads=optional(a_count(least=1)),
    )
    def sensitivity(
        self, by: Sequence[Data] = DATA, *, threads: int | None = None
    ) -> Sensitivities:
        """Return the derivatives of all answers by their data, to first order.

        An answer has no multipliers of its own. They are computed by least squares from
        the first-order conditions with its active limits. If they satisfy the
        conditions, nothing is solved again. Otherwise the answer is first polished by
        the NLP solver, from itself and without margins. This is needed for an answer
        with margins at its limits, or from a polish by collocation.

        Args:
            by: As in `Solution.sensitivity`.
            threads: Largest number of processes, as in `solve`.

        Raises:
            NoSensitivityError: If the problem has no derivatives by its data. An answer
                without derivatives is no error: see `Sensitivities.reasons`.

        Example:
            >>> import casadi as ca, swarmstart as ss
            >>> x, u, goal = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("goal")
            >>> problem = ss.OptimalControlProblem(
            ...     ss.Model(states=x, controls=u, ode=u, parameters=goal), horizon=1.0,
            ...     intervals=4, stage_cost=u**2, terminal=[x - goal],
            ...     bounds=ss.Bounds(controls=(-9, 9)),
            ... )
            >>> goals = {"goal": [1.0, 2.0, 10.0]}
            >>> many = ss.solve_many(problem, [[0.0, 0.0, 0.0]], known=goals, seed=0)
            >>> found = many.sensitivity(by=["parameters"])
            >>> found.data, found.cost.round(6)  # Of goal^2.
            (('goal',), array([[ 2.,  4., nan]]))
            >>> found.reasons
            {2: 'the answer is not confirmed: INFEASIBLE'}
        """
        core = self._lowered
        require_data(core)
        confirmed = self.is_confirmed
        reasons = {
            int(i): f"the answer is not confirmed: {self.status[i].name}"
            for i in np.flatnonzero(~confirmed)
        }
        numbers = np.flatnonzero(confirmed).tolist()
        kept = self.core_answers
        with kept_planner(self._near, polish=self.how.polish) as planner:
            answers = [
                Answered(
                    kept.controls[..., i],
                    kept.states[..., i],
                    planner.posed(self.data.x0[:, i], self.data.known(i))[1],
                )
                for i in numbers
            ]
            each = OneByOne(planner, seed=(), repair=False, threads=threads)
            derived = each.sensitivities(answers, by)
        found = dict[int, Sensitivity]()
        for number, one in zip(numbers, derived, strict=True):
            if isinstance(one, Sensitivity):
                found[number] = one
            else:
                reasons[number] = str(one)
        return Sensitivities.of(found, reasons, core, by)

    def plot(self) -> Any:
        """Return a matplotlib Figure: cost over the data that differ, failures marked.

        The axes are the first two data that differ between the instances, initial
        states before parameters.

        Raises:
            ImportError: If matplotlib is not installed.
        """
        return self._presented("plot")

    def to_dataframe(self) -> pd.DataFrame:
        """Return a pandas DataFrame: one row per instance.

        Its columns are initial states, parameters, status, solver, start, costs,
        violation, excess, end difference, attempts, iterations and decisions.

        Raises:
            MissingPackageError: If pandas is not installed.
        """
        return self._presented("to_dataframe")

    def to_xarray(self) -> xarray.Dataset:
        """Return an xarray Dataset: states, controls and the table's columns.

        Its dimensions are instance, time [s] and state, for controls instance, interval
        and control.

        Raises:
            MissingPackageError: If xarray is not installed.
        """
        return self._presented("to_xarray")

    @checked(refused, path=PATH, force=FLAG)
    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the answers into one .npz file; return its path.

        Args:
            path: The file.
            force: Whether to replace a file that is there.

        Raises:
            RecordError: If the file exists, or cannot be written.
        """
        written: Path = self._presented("save", Path(path), force=force)
        return written

    @staticmethod
    @checked(
        refused,
        path=PATH,
        problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    )
    def load(path: str | Path, problem: OptimalControlProblem) -> Solutions:
        """Return the answers that `save` has written.

        Args:
            path: The file; no code in it is run.
            problem: The problem that they answer.

        Raises:
            RecordError: If the file cannot be read, was not written by `save`, or
                belongs to another problem.
        """
        read: Solutions = presentation("Solutions", "load")(Path(path), problem)
        return read

    def __repr__(self) -> str:
        """Return the counts, the range of the costs and the invalid instances."""
        lines = [f"Solutions of {len(self)} instances in {self.seconds:.3g} s"]
        for status, count in self.counts.items():
            lines.append(f"  {count:>7} {status_line(status)}")
        confirmed = self.is_confirmed
        if confirmed.any():
            costs = self.cost[confirmed]
            low, high = int(costs.argmin()), int(costs.argmax())
            places = np.flatnonzero(confirmed)
            lines.append(
                f"  costs       {costs[low]:.6g} (instance {places[low]}) to "
                f"{costs[high]:.6g} (instance {places[high]})"
            )
            solvers = Counter(self.solver[confirmed].tolist()).most_common()
            lines.append(
                f"  solvers     {', '.join(f'{name} {n}' for name, n in solvers)}"
            )
            starts = Counter(self.start[confirmed].tolist()).most_common()
            lines.append(
                f"  starts      {', '.join(f'{name} {n}' for name, n in starts)}"
            )
        if self.sampled:
            lines.append(f"  {self.sampled_line}")
        return "\n".join(lines + [f"  {line}" for line in told_invalid(self.invalid)])

    @cached_property
    def _near(self) -> OptimalControlProblem:
        """The problem, counted from near the initial states, as it is solved."""
        return counted_near(self.problem, self.data)

    @property
    def _lowered(self) -> Lowered:
        return shooting_of(self._near).lowered


class SolveManyInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C during `solve_many`.

    Attributes:
        partial: The answers so far; the status of all others is NOT_REACHED.
    """

    def __init__(self, partial: Solutions) -> None:
        """Keep the answers so far."""
        super().__init__("solve_many was interrupted; the answers so far: .partial")
        self.partial = partial


def counted_near(
    problem: OptimalControlProblem, data: InstanceData
) -> OptimalControlProblem:
    """Return the problem with large states measured from values near a typical start.

    A state is large if it starts far from zero, compared with its natural size.

    Args:
        problem: The problem.
        data: Data of its instances.
    """
    number = data.typical
    if number is None:
        return problem
    x0, known = data.x0[:, number], data.known(number)
    return from_near_start(shooting_of(problem), x0, known)


def solutions_of(
    problem: OptimalControlProblem,
    data: InstanceData,
    work: Work,
    *,
    sampled: int,
    seconds: float,
    how: How,
) -> Solutions:
    """Return the answers to all instances, in the order of the data.

    The status of an invalid instance is INVALID.

    Args:
        problem: The problem as it was given.
        data: Data of all M instances.
        work: The valid instances and their answers.
        sampled: As in `Solutions`.
        seconds: Wall time [s].
        how: Settings of the solves.
    """
    posed, outcomes = work.posed, work.outcomes
    M, numbers = data.size, posed.numbers
    every = _spread(outcomes.answers, numbers, M)
    every.status[list(posed.invalid)] = SolutionStatus.INVALID
    solver, start = (np.full(M, "", dtype="<U16") for _ in range(2))
    attempts = np.zeros(M, dtype=np.int64)
    solver[numbers], start[numbers] = outcomes.solver, outcomes.start
    attempts[numbers] = outcomes.attempts
    return Solutions(
        problem=problem,
        data=data,
        solver=solver,
        start=start,
        attempts=attempts,
        sampled=sampled,
        invalid=dict(posed.invalid),
        seconds=seconds,
        core_answers=every,
        how=how,
    )


def _spread(answers: Answers, numbers: NDArray[np.int64], M: int) -> Answers:
    """Return answers at their numbers among M instances."""
    found = []
    for values in answers:
        fill: Any = np.nan if values.dtype == np.float64 else 0
        if values.dtype == object:
            fill = SolutionStatus.NOT_REACHED
        whole = np.full((*values.shape[:-1], M), fill, dtype=values.dtype)
        whole[..., numbers] = values
        found.append(whole)
    return Answers(*found)
