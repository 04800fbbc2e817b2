"""One problem solved for many initial states, parameters and signals.

    read       shapes and names; an invalid instance is left out, with the reason
    lanes      all at once, if there are lanes for the problem; each answer verified
    retries    those that failed, in lanes, from the answers of neighbours, then from
               random controls
    polish     what is left by an NLP solver in processes: from the answer that was not
               confirmed, else the guess; from neighbours; from random controls

Each instance is solved by itself, in an order that depends on the data only, and all of
one wave before the next. So the answers have the same bits for any number of threads
and any order of the instances.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arguments import (
    FLAG,
    SEED,
    a_count,
    checked,
    either,
    mapping,
    of_kind,
    optional,
    reals,
)
from swarmstart.heuristics import generator_of
from swarmstart.heuristics.running import heeded
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.answer.kept import kept_planner
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.solving import PolishGiven, polish_options
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.presentation import (
    PROGRESS,
    ProgressCallback,
    ProgressGiven,
    shown,
)
from swarmstart.ocp.common.processes import threads_of
from swarmstart.ocp.instances.in_lanes import InLanes, lanes_of
from swarmstart.ocp.instances.instance_data import (
    KnownGiven,
    PosedInstances,
    posed_instances,
    read_data,
    told_invalid,
)
from swarmstart.ocp.instances.outcomes import Outcomes
from swarmstart.ocp.instances.polishing import Group, OneByOne
from swarmstart.ocp.instances.retries import (
    Neighbours,
    at_instances,
    random_start,
    side_by_side,
    starts_from,
)
from swarmstart.ocp.instances.solutions import (
    How,
    Solutions,
    SolveManyInterrupted,
    counted_near,
    solutions_of,
)
from swarmstart.ocp.instances.verification import fine_paths_of
from swarmstart.ocp.nlp.polish_options import (
    IpoptOptions,
    NlpOptions,
)
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import KNOWN
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.statement.guesses import cold_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem

_ROUNDS = 2
"""Largest number of times that instances are tried again from neighbours' answers; in
the second one those count that the first one has solved."""
_RANDOM = 1
"""Number that follows the seed in that of the random start."""


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    x0s=reals(),
    known=optional(either(KNOWN, mapping(words="a mapping of names to numbers"))),
    guesses=optional(reals()),
    lanes=FLAG,
    polish=of_kind(
        (bool, str, IpoptOptions, NlpOptions, type(None)),
        "'ipopt', the name of an NLP solver of CasADi, IpoptOptions, NlpOptions or "
        "None",
    ),
    repair=FLAG,
    threads=optional(a_count(least=1)),
    strict=FLAG,
    seed=optional(SEED),
    progress=PROGRESS,
)
def solve_many(  # noqa: PLR0913 - the whole way in one call
    problem: OptimalControlProblem,
    x0s: ArrayLike,
    *,
    known: KnownGiven = None,
    guesses: ArrayLike | None = None,
    lanes: bool = True,
    polish: PolishGiven = "ipopt",
    repair: bool = True,
    threads: int | None = None,
    strict: bool = False,
    seed: int | Sequence[int] | None = None,
    progress: ProgressGiven = True,
) -> Solutions:
    """Solve one problem for many initial states, parameters and signals.

    Args:
        problem: The problem.
        x0s: Initial states, shape (nx, M), a column for each instance; entries that are
            decided are a guess, or NaN.
        known: Parameters and signals, by name: of a parameter a number for all
            instances or shape (M,), of a signal its values at the nodes, shape (nodes,)
            for all or (nodes, M). Or a `Known` for all. None: the problem has none.
        guesses: Controls to start from, shape (nu, N) for all instances, or (nu, N, M);
            of linear controls with N + 1 knots. None: no guess.
        lanes: Whether instances are solved at once in lanes, if there are lanes for the
            problem. They do not look at second derivatives, so their answers are
            FEASIBLE, not CONVERGED; without lanes each instance is solved by `polish`.
        polish: NLP solver of the instances that the lanes leave, as in `solve`; None:
            they stay unsolved.
        repair: As in `solve`, for the answers of the NLP solver.
        threads: Largest number of threads of the lanes, and of processes of the NLP
            solver, as in `solve`. The answers have the same bits for any number.
        strict: Whether invalid instances are an error; else they are left out, with the
            status INVALID and the reason in `Solutions.invalid`. An instance is invalid
            if a number is not finite, or its initial state breaks the bounds of the
            states or the path constraints.
        seed: Seed; each instance has a generator from it, as `solve` has.
        progress: As in `solve`; a function is called with (instances done, all, what is
            being done).

    Returns:
        The answers, each verified along its finer path.

    Raises:
        InvalidProblemError: If a shape or a name is not the problem's, there are
            neither lanes nor a polish, or an instance is invalid and must not.
        SolveManyInterrupted: On Ctrl-C, with the answers so far.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u, goal = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("goal")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u, parameters=goal), horizon=1.0,
        ...     intervals=4, stage_cost=u**2, terminal=[x - goal],
        ...     bounds=ss.Bounds(controls=(-9, 9)),
        ... )
        >>> goals = {"goal": [1.0, 2.0, 10.0]}
        >>> found = ss.solve_many(problem, [[0.0, 0.0, 0.0]], known=goals, seed=0)
        >>> [status.name for status in found.status]
        ['CONVERGED', 'CONVERGED', 'INFEASIBLE']
        >>> found.cost[:2].round(6).tolist()
        [1.0, 4.0]
    """
    data = read_data(problem, x0s, known, guesses)
    generator_of(None, seed)  # For its errors.
    seeds = (int(seed),) if isinstance(seed, int | np.integer) else tuple(seed or ())
    polishing = polish_options(polish)
    how = How(polishing or IpoptOptions(), repair, seeds)
    title, M = "solve_many", data.size
    with shown(progress, title, "compiling", of="instance", total=M) as told:
        with (
            stopwatch() as watch,
            kept_planner(
                counted_near(problem, data),
                search=None,
                polish=how.polish,
                backend=None,
                lanes=0,
                threads=1,
            ) as planner,
        ):
            posed = posed_instances(planner, data)
            if strict and posed.invalid:
                raise InvalidProblemError(
                    f"{len(posed.invalid)} of {M} instances are invalid (strict=False "
                    f"leaves them out): {'; '.join(told_invalid(posed.invalid))}"
                )
            outcomes = Outcomes.none(planner.problem, posed.numbers.size)
            work = _Work(planner, posed, outcomes, seeds, told)
            each = OneByOne(planner, seed=seeds, repair=repair, threads=threads)
            in_lanes = _lanes(planner, each, threads_of(threads)) if lanes else None
            if in_lanes is None and polishing is None:
                raise InvalidProblemError(
                    "solve_many needs lanes or a polish: there are no lanes for this "
                    "problem, and polish is None"
                )
            is_whole = work.finished(in_lanes, each if polishing else None)
        solutions = solutions_of(
            problem, data, posed, outcomes, seconds=watch.seconds, how=how
        )
        if not is_whole:
            raise SolveManyInterrupted(solutions)
        return solutions


def _lanes(planner: Planner, each: OneByOne, threads: int) -> InLanes | None:
    """Return the solves in lanes; None if there are none for the problem."""
    lanes = lanes_of(planner, threads)
    if lanes is None:
        return None
    return InLanes(planner, lanes, fine_paths_of(planner.tracer, threads=threads), each)


Solve = Callable[[NDArray[np.int64], Sequence[Start | None]], Iterator[Group]]
"""(numbers of instances, their starts) -> groups of answers."""


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """Waves of solves of the instances, each of those that are still open.

    Attributes:
        planner: Planner of the problem.
        posed: The valid instances.
        outcomes: Their best answers so far.
        seeds: Seed.
        progress: Callback.
    """

    planner: Planner
    posed: PosedInstances
    outcomes: Outcomes
    seeds: tuple[int, ...]
    progress: ProgressCallback

    def finished(self, lanes: InLanes | None, each: OneByOne | None) -> bool:
        """Solve all instances; return whether that was not interrupted.

        Args:
            lanes: Solves in lanes; None: there are none.
            each: Solves by the NLP solver; None: without it.
        """
        try:
            if lanes is not None:
                self._in_lanes(lanes)
            if each is not None:
                self._polished(each)
        except KeyboardInterrupt:
            return False
        return True

    def _in_lanes(self, lanes: InLanes) -> None:
        """Solve all instances in lanes, and again those that fail."""
        core, instances = self.planner.problem, self.posed.core
        cold = Start(cold_controls(core)[0])

        def solved(
            chosen: NDArray[np.int64], starts: Sequence[Start | None]
        ) -> Iterator[Group]:
            given = [one or cold for one in starts]
            return lanes(*side_by_side(core, instances, chosen, given))

        self._waves(solved, "lanes")

    def _polished(self, each: OneByOne) -> None:
        """Solve the open instances by the NLP solver, and again those that fail."""
        instances, answers = self.posed.core, self.outcomes.answers

        def solved(
            chosen: NDArray[np.int64], starts: Sequence[Start | None]
        ) -> Iterator[Group]:
            return each.polished(instances.at(chosen), starts)

        # What the lanes found, but the finer path does not confirm.
        near = [
            number
            for number in self.outcomes.open
            if answers.status[number]
            in (SolutionStatus.BROKEN, SolutionStatus.MISMATCH)
        ]
        own = [Start(answers.controls[..., k], x0=answers.x0[:, k]) for k in near]
        solver = each.solver
        self._wave(solved, np.array(near, np.int64), own, (solver, "own answer"))
        self._waves(solved, solver)

    def _waves(self, solve: Solve, solver: str) -> None:
        """Solve from the guess, from neighbours' answers and from random controls."""
        core, instances = self.planner.problem, self.posed.core
        opened = self.outcomes.open
        given = self.posed.guesses
        first: list[Start | None] = [None] * opened.size
        if given is not None:
            first = [Start(given[:, :, number]) for number in opened]
        self._wave(solve, opened, first, (solver, "guess"))
        self._from_neighbours(solve, solver)
        drawn = random_start(core, (*self.seeds, _RANDOM))
        if drawn is not None:
            opened = self.outcomes.open
            starts = at_instances(core, instances, opened, drawn)
            self._wave(solve, opened, starts, (solver, "random"))

    def _from_neighbours(self, solve: Solve, solver: str) -> None:
        core, instances = self.planner.problem, self.posed.core
        outcomes, tried = self.outcomes, dict[int, int]()
        distances = None
        for _ in range(_ROUNDS):
            opened, confirmed = outcomes.open, outcomes.answers.confirmed
            if not opened.size or not confirmed.any():
                return
            distances = distances or Neighbours(core, instances)
            nearest = distances.nearest(opened, np.flatnonzero(confirmed))
            # The same start again would lead to the same end.
            new = np.array(
                [
                    tried.get(int(own)) != k
                    for own, k in zip(opened, nearest, strict=True)
                ]
            )
            opened, nearest = opened[new], nearest[new]
            tried |= dict(zip(opened.tolist(), nearest.tolist(), strict=True))
            starts = starts_from(core, instances, outcomes.answers, opened, nearest)
            self._wave(solve, opened, starts, (solver, "neighbour"))

    def _wave(
        self,
        solve: Solve,
        chosen: NDArray[np.int64],
        starts: Sequence[Start | None],
        words: tuple[str, str],
    ) -> None:
        """Solve some instances and keep the better answers, group by group.

        Args:
            solve: Solves them.
            chosen: Their numbers.
            starts: Start of each.
            words: The solver, and the kind of the starts.
        """
        solver, start = words
        what = "solving" if start == "guess" else f"again: {start}"
        done = 0
        groups = solve(chosen, starts) if chosen.size else iter(())
        while True:
            with heeded():
                group = next(groups, None)
            if group is None:
                return
            self.outcomes.take(
                chosen[group.chosen], group.answers, solver=solver, start=start
            )
            done += group.chosen.size
            self.progress(done, chosen.size, f"{what} ({solver})")
