"""Solution of a problem in one call: search, polish, verification, repair, and bound.

A lower bound is computed after an answer was found, so that Ctrl-C loses no answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    a_count,
    checked,
    choice,
    either,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.errors import Sendable, SwarmstartError
from swarmstart.heuristics import Budget, Order, generator_of
from swarmstart.heuristics.running import heeded
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.answer.improving import improved
from swarmstart.ocp.answer.kept import kept_planner
from swarmstart.ocp.answer.plan import Plan, PlanningInterrupted
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.solution import Solution, verified
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import require_seconds
from swarmstart.ocp.common.presentation import (
    PROGRESS,
    ProgressCallback,
    ProgressGiven,
    shown,
    tell_nothing,
)
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.ocp.nlp.polish_options import (
    IpoptOptions,
    NlpOptions,
    PolishOptions,
)
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import KNOWN, NOTHING, Known, from_near_start
from swarmstart.ocp.rollout.shooting import shooting_of
from swarmstart.ocp.search.many_starts import LANES
from swarmstart.ocp.search.settings import SearchGiven, search_settings
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.chain import has_decisions
from swarmstart.ocp.system import warn_of_units

StartRule = Literal["must hold", "may violate"]
PolishGiven = PolishOptions | str | bool | None


class SolveInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C during `solve`.

    Attributes:
        partial: The best answer so far, verified. If only the computation of its bound
            was interrupted, it has the best bound so far.
    """

    def __init__(self, partial: Solution) -> None:
        """Keep the best answer so far."""
        super().__init__("solve was interrupted; the best answer so far is in .partial")
        self.partial = partial


class BoundInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C while the lower bound of an answer was computed.

    Attributes:
        partial: The best bound so far; None without one.
    """

    def __init__(self, partial: LowerBound | None) -> None:
        """Keep the best bound so far."""
        super().__init__("the bound was interrupted")
        self.partial = partial


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    x0=reals(),
    guess=optional(either(reals(), of_kind(Start, "a Start"))),
    known=KNOWN,
    repair=FLAG,
    lanes=optional(a_count()),
    threads=optional(a_count(least=1)),
    start=choice(get_args(StartRule)),
    polish=of_kind(
        (bool, str, IpoptOptions, NlpOptions, type(None)),
        "'ipopt', the name of an NLP solver of CasADi, IpoptOptions, NlpOptions or "
        "None",
    ),
    backend=optional(text()),
    progress=PROGRESS,
)
def solve(  # noqa: PLR0913 - the whole way in one call
    problem: OptimalControlProblem,
    x0: ArrayLike,
    *,
    search: SearchGiven = "default",
    budget: Budget | int | None = None,
    order: Order | None = None,
    polish: PolishGiven = "ipopt",
    guess: ArrayLike | Start | None = None,
    known: Known = NOTHING,
    start: StartRule = "must hold",
    repair: bool = True,
    lanes: int | None = None,
    threads: int | None = None,
    backend: str | None = None,
    bound: float | None = None,
    rng: np.random.Generator | None = None,
    seed: int | Sequence[int] | None = None,
    progress: ProgressGiven = True,
) -> Solution:
    """Solve an optimal-control problem from an initial state.

    Args:
        problem: Problem to solve.
        x0: Initial state, shape (nx,); entries that are decided are a guess, or NaN.
        search: The population search: a name such as "lshade", an algorithm or its
            class, or `SearchSettings`, which have a budget and an order. "default" is
            the choice of `heuristics.default_algorithm` for the budget. None or "none":
            no search.
        budget: Budget of the search; an integer is a number of evaluations; None means
            20,000 evaluations.
        order: Order of individuals in the search; None means `heuristics.default_order`
            with the problem's tolerance.
        polish: Local solve from good starts at the end: "ipopt" or True, the name of
            another NLP solver of CasADi, or options of one; None, False or "none" means
            no polish.
        guess: Controls to start from, shape (nu, N), or (nu, N + 1) for linear ones; or
            a Start, which has states for the polish as well. None: no guess.
        known: Parameters and signals, if the problem has any.
        start: "must hold": x0 must satisfy the bounds of the states and the path
            constraints. "may violate": it need not, and the status reports it.
        repair: Whether an answer that breaks a constraint between checks is solved
            again with more checks and margins, at most three times. `Solution.repair`
            reports on it. False: the answer is not solved again.
        lanes: Number of random starts that are solved at once, in SIMD lanes. With them
            the polish also starts from zero controls, the middle of the bounds, the
            guess, states that lead straight to a fixed end and the search's best
            points, and the answer reports the result of each. None means 64 if there is
            a polish. 0: the polish starts from the search's best points; without a
            search, from the guess, or, if there is no guess either, from zero controls
            and from the middle of the bounds.
        threads: Largest number of threads of the search and the lanes, and of copies of
            this process that polish from several starts at a time (Linux). The answer
            has the same bits for any number. None: as many as there are processors, but
            no copies are made if the program has threads of its own, as a notebook has.
        backend: Backend that evaluates populations: "llvm" (machine code), "casadi" or
            "auto"; None asks SWARMSTART_BACKEND, then auto (docs/evaluator.md, "Choose
            the evaluator").
        bound: Budget to prove a lower bound of the optimal cost once the answer is
            found, the `work` of `lower_bound`, in units of about a second; None: no
            bound.
        rng: Source of all randomness; either this or a seed.
        seed: Seed of a new generator.
        progress: True: shown on a terminal and in a notebook if it takes more than two
            seconds. False: not shown. A function is called with (evaluations so far,
            their limit, "searching") now and then, and with (0, 0, text) at the start
            of "polishing", "verifying" and "improving", whose length is not known; in a
            long polish the last argument is a text with the numbers of the start and of
            the iteration.

    Returns:
        The best answer found, verified along its path.

    Raises:
        InvalidProblemError: If there is neither a search nor a polish, a shape is not
            the problem's, the start violates its constraints although `start` is "must
            hold", or `bound` is not a positive number.
        SolveInterrupted: On Ctrl-C, with the best answer so far; a plain
            KeyboardInterrupt if there is none yet.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        ...     horizon=1.0, intervals=10, stage_cost=u**2,
        ...     bounds=ss.Bounds(controls=(-10, 10)), terminal=[(x[0], 1), (x[1], 0)],
        ... )
        >>> solution = ss.solve(problem, [0.0, 0.0], budget=500, lanes=0, seed=0)
        >>> solution.status.name, round(solution.cost, 2)
        ('CONVERGED', 12.12)
    """
    if not isinstance(problem, OptimalControlProblem):
        raise InvalidProblemError(
            f"solve takes an OptimalControlProblem, got {shortened(problem)}"
        )
    require_seconds("bound", bound)
    warn_of_units(problem.model.unit_conflicts())
    # The bound is that of the stated problem, whereas `posed` returns the core's.
    given = x0, known
    rng = generator_of(rng, seed)
    settings = search_settings(search, budget, order)
    if search == "default" and not has_decisions(problem):
        settings = None  # A simulation.
    polishing = polish_options(polish)
    if lanes is None:
        lanes = LANES if polishing is not None else 0
    if settings is None and polishing is None:
        raise InvalidProblemError("solve needs a search, a polish or both, got neither")
    with shown(progress, "solve", "compiling") as told:
        with (
            stopwatch() as watch,
            kept_planner(
                from_near_start(shooting_of(problem), x0, known),
                search=settings,
                polish=polishing,
                backend=backend,
                lanes=lanes,
                threads=threads,
            ) as planner,
        ):
            start_at = None if guess is None else _start(guess)
            x0, known, start_at = planner.posed(x0, known, start_at)
            outside = planner.outside(x0, known)
            if outside and start == "must hold":
                raise InvalidProblemError(
                    "the start must keep the bounds of the states and the path "
                    f"constraints: {'; '.join(map(str, outside))} (start='may violate' "
                    "allows it)"
                )
            solution = _solved(
                planner,
                x0,
                known,
                guess=start_at,
                repair=repair,
                rng=rng,
                progress=told,
            )
        solution = replace(solution, compile_seconds=watch.compile_seconds)
        if bound is None:
            return solution
        return _with_bound(solution, *given, work=bound, progress=told)


def bounded(
    answer: Solution | float | None,
    problem: OptimalControlProblem,
    x0: ArrayLike,
    known: Known = NOTHING,
    *,
    work: float,
    progress: ProgressCallback = tell_nothing,
) -> LowerBound:
    """Return a lower bound of the optimal cost, of kind NONE if none was found.

    Args:
        answer: An answer, or its cost as the problem states it, which makes the bound
            tighter; None: no answer is known.
        problem: The problem as it was given.
        x0: Initial state, as it was given.
        known: Parameters and signals as they were given.
        work: Budget, in units of about a second.
        progress: Callback, as in `solve`.

    Raises:
        BoundInterrupted: On Ctrl-C, with the best bound so far.
    """
    # Many modules, which most calls do not need.
    from swarmstart.ocp.lower_bound import bounding

    progress(0, 0, "bounding")
    found = None
    try:
        with heeded():
            found = bounding.lower_bound(
                problem,
                x0,
                known=known,
                answer=answer,
                work=float(work),
                progress=progress,
            )
    except KeyboardInterrupt:
        # Not None if the signal came after the search had ended.
        raise BoundInterrupted(found) from None
    except SwarmstartError as error:
        return LowerBound(
            kind=BoundKind.NONE, value=math.nan, reason=str(error), sense=problem.sense
        )
    return found


def _with_bound(
    solution: Solution,
    x0: ArrayLike,
    known: Known,
    *,
    work: float,
    progress: ProgressCallback,
) -> Solution:
    """Return an answer with its bound; on Ctrl-C the answer is kept."""
    try:
        found = bounded(
            solution, solution.problem, x0, known, work=work, progress=progress
        )
    except BoundInterrupted as stopped:
        raise SolveInterrupted(replace(solution, bound=stopped.partial)) from None
    return replace(solution, bound=found)


def _solved(  # noqa: PLR0913 - what solve was given, checked
    planner: Planner,
    x0: ArrayLike,
    known: Known,
    *,
    guess: Array | Start | None,
    repair: bool,
    rng: np.random.Generator,
    progress: ProgressCallback,
) -> Solution:
    """Plan, verify, and improve the answer."""

    def stopped_at(plan: Plan) -> SolveInterrupted:
        return SolveInterrupted(verified(planner.tracer, plan, x0, known))

    try:
        with heeded():
            plan = planner.plan(
                x0, known=known, guess=guess, rng=rng, progress=progress
            )
    except PlanningInterrupted as stopped:
        raise stopped_at(stopped.partial) from None
    progress(0, 0, "verifying")
    answers = improved(planner, plan, x0, known, repair=repair, rng=rng)
    try:
        with heeded():
            # One step after the other, so that Ctrl-C loses the present step only.
            solution = next(answers)
    except KeyboardInterrupt:
        # The plan is there; to verify it again takes a moment.
        raise stopped_at(plan) from None
    progress(0, 0, "improving")
    try:
        while True:
            with heeded():
                better = next(answers, None)
            if better is None:
                return solution
            solution = better
    except KeyboardInterrupt:
        raise SolveInterrupted(solution) from None


def polish_options(polish: PolishGiven) -> PolishOptions | None:
    """Return the polish in the form that a planner uses; None means no polish.

    Raises:
        InvalidProblemError: If there is no such solver.
    """
    if polish is None or polish is False or polish == "none":
        return None
    if polish is True or polish == "ipopt":
        return IpoptOptions()
    return NlpOptions(plugin=polish) if isinstance(polish, str) else polish


def _start(guess: ArrayLike | Start) -> Array | Start:
    """Return a guess with its controls as an array; a vector is one row."""
    if isinstance(guess, Start):
        return guess
    return np.array(guess, dtype=np.float64, ndmin=2)
