"""One problem solved for many initial states, parameters and signals.

Shapes and names are read first; an invalid instance is left out, with the reason. Then
the instances are solved in several rounds (waves, see waves.py).

Each instance is solved by itself, in an order that depends on the data only, and all
instances of one wave before the next wave begins. So the answers have the same bits for
any number of threads and any order of the instances.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

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
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.answer.kept import kept_planner
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.solving import PolishGiven, polish_options
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.presentation import (
    PROGRESS,
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
from swarmstart.ocp.instances.polishing import OneByOne
from swarmstart.ocp.instances.solutions import (
    How,
    Solutions,
    SolveManyInterrupted,
    counted_near,
    solutions_of,
)
from swarmstart.ocp.instances.verification import fine_paths_of
from swarmstart.ocp.instances.waves import solved
from swarmstart.ocp.instances.work import Work
from swarmstart.ocp.nlp.polish_options import (
    IpoptOptions,
    NlpOptions,
)
from swarmstart.ocp.rollout.fitness import KNOWN
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system import warn_of_units


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    x0s=reals(),
    known=optional(either(KNOWN, mapping(words="a mapping of names to numbers"))),
    guesses=optional(reals()),
    lanes=FLAG,
    starts=optional(a_count(least=1)),
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
    starts: int | None = None,
    polish: PolishGiven = "ipopt",
    repair: bool = True,
    threads: int | None = None,
    strict: bool = False,
    seed: int | Sequence[int] | None = None,
    progress: ProgressGiven = True,
) -> Solutions:
    """Solve one problem for many initial states, parameters and signals.

    Args:
        problem: Problem to solve for all instances.
        x0s: Initial states, shape (nx, M), a column for each instance; entries that are
            decided are a guess, or NaN.
        known: Parameters and signals by name. For a parameter: a number for all
            instances, or shape (M,). For a signal: its values at the nodes, shape
            (nodes,) for all instances, or (nodes, M). Or a `Known`, whose parameters or
            signals may have a last axis of length M. None: the problem has neither.
        guesses: Controls to start from, shape (nu, N) for all instances, or (nu, N, M);
            of linear controls with N + 1 knots. None: no guess.
        lanes: Whether instances are solved at once in lanes, if lanes support the
            problem. Without lanes each instance is solved by `polish`.
        starts: Number of starts of each instance in the lanes, in this order: the guess
            or zero controls, with the states that they lead to; the guess or the middle
            of the bounds, with states that stay at x0; the middle of the bounds, with
            the states that it leads to, if this is not the first start; then random
            controls. None: the first start for all instances, and three others for
            instances that fail and for some drawn at random; more are drawn as long as
            the other starts find cheaper answers.
        polish: NLP solver of the instances that lanes do not solve, as in `solve`;
            None: these stay unsolved.
        repair: As in `solve`, for the answers of the NLP solver.
        threads: Largest number of threads of the lanes, and of processes of the NLP
            solver, as in `solve`. The answers have the same bits for any number.
        strict: Whether invalid instances are an error; else they are left out, with the
            status INVALID and the reason in `Solutions.invalid`. An instance is invalid
            if a number is not finite, or its initial state breaks the bounds of the
            states or the path constraints.
        seed: Seed; each instance has a generator with this seed, as in `solve`.
        progress: As in `solve`; a function is called with (instances done, number of
            all, text on what is being done).

    Returns:
        The answers, each verified along its finer path.

    Raises:
        InvalidProblemError: If a shape or a name is not the problem's, there are
            neither lanes nor a polish, or an instance is invalid and `strict` is true.
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
    warn_of_units(problem.model.unit_conflicts())
    generator_of(None, seed)  # For its errors.
    seeds = (int(seed),) if isinstance(seed, int | np.integer) else tuple(seed or ())
    polishing = polish_options(polish)
    how = How(polishing or IpoptOptions(), repair, seeds)
    title, M = "solve_many", data.size
    with shown(progress, title, "compiling", of="instance", total=M) as told:
        with (
            stopwatch() as watch,
            kept_planner(counted_near(problem, data), polish=how.polish) as planner,
        ):
            posed = posed_instances(planner, data)
            if strict and posed.invalid:
                raise InvalidProblemError(
                    f"{len(posed.invalid)} of {M} instances are invalid (strict=False "
                    f"leaves them out): {'; '.join(told_invalid(posed.invalid))}"
                )
            outcomes = Outcomes.none(planner.problem, posed.numbers.size)
            work = Work(planner, posed, outcomes, seeds, told)
            each = OneByOne(planner, seed=seeds, repair=repair, threads=threads)
            in_lanes = None
            if lanes:
                in_lanes = _lanes(planner, posed, each, threads_of(threads))
            if in_lanes is None and polishing is None:
                raise InvalidProblemError(
                    "solve_many needs lanes or a polish: there are no lanes for this "
                    "problem, and polish is None"
                )
            ended = solved(work, in_lanes, each if polishing else None, starts)
        solutions = solutions_of(
            problem,
            data,
            work,
            sampled=ended.sampled,
            seconds=watch.seconds,
            how=how,
        )
        if not ended.is_whole:
            raise SolveManyInterrupted(solutions)
        return solutions


def _lanes(
    planner: Planner, posed: PosedInstances, each: OneByOne, threads: int
) -> InLanes | None:
    """Return the solves in lanes; None if there are none for the problem."""
    lanes = lanes_of(planner, posed.core, threads)
    if lanes is None:
        return None
    paths = fine_paths_of(planner, threads=threads)
    return InLanes(planner, planner.problem, lanes, paths, each, threads)
