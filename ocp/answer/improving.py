"""Improvement of an answer that is not yet confirmed or not yet shown to be optimal.

    repaired        solved again with margins, if constraints are broken between checks
    settled_answer  restarted from perturbed points, if it may be a saddle point
    followed_down   solved again with rounded kinks, and ever less rounding

Each step judges answers by the user's own problem, and keeps the better answer.

If the curvature at a stationary point is flat, perturbed starts decide whether it is a
local optimum: the controls are moved a little, at random, and polished again. If a
start leads to a lower cost, the point was no optimum, and the better one is taken. If
none of up to twenty starts does, the point is called a local optimum. The starts share
a limit of iterations: a fifth of those that the solver had taken before, but at least
100. Once it is reached, no further start begins. After fewer than five starts nothing
is decided.
"""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.answer.plan import Plan, Source, start_of
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.repair import (
    ATTEMPTS,
    Place,
    added,
    at_points,
    finer_checks,
    has_segments,
    hurried,
    needed,
    place_of,
    slack_at_checks,
    tightened,
    with_more_checks,
)
from swarmstart.ocp.answer.solution import Solution, verified
from swarmstart.ocp.common.processes import processes_of
from swarmstart.ocp.nlp.optimality import Curvature, NlpPoint, curvature
from swarmstart.ocp.nlp.polish import SAME_COST, Polished, Polisher, is_better
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.nlp.several import in_turn
from swarmstart.ocp.rollout.checking import Excess
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.ocp.rollout.kinks import PARTS, kink_sizes, smoothed
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.search.account import Repair, Restarts
from swarmstart.ocp.search.settings import SearchSettings
from swarmstart.ocp.statement.problem import OptimalControlProblem

_REPAIR_SHARE, _FEWEST = 0.1, 400
"""Share of a search's budget for an attempt to repair, and its fewest evaluations."""
DENSER = 4
"""Factor for the number of checks that replace costly margins."""
_NOTICED = 1e-4
"""Relative cost of margins above which they are replaced."""
_MOST_STATES = 5000
"""Largest number of states at all checks together; more would take too long."""
STARTS, ENOUGH = 20, 5
"""Largest number of perturbed starts, and the least that decides."""
_SHARE, _LEAST_ITERATIONS = 0.2, 100
"""Share of the iterations so far that perturbed starts may take, and what they may take
in any case."""
ROUNDS = 3
"""Largest number of better points taken before the question is left undecided."""
_MOST_WORK = 2_000_000
"""Iterations times rows of the NLP after which no other start is tried: a start of an
NLP with many checks in each interval may take seconds."""
_SMALLEST, _LARGEST = 1e-3, 1e-1
"""Sizes of the perturbations relative to the controls' sizes; drawn log-uniformly."""


class Answer(NamedTuple):
    """An answer with the planner that made it.

    Attributes:
        solution: The answer, judged by the user's own problem.
        planner: The planner that made the answer; its problem may have margins and more
            checks than the user's own.
        known: Values of parameters and signals, in the form that this planner takes.
    """

    solution: Solution
    planner: Planner
    known: Known


def improved(
    planner: Planner,
    plan: Plan,
    x0: ArrayLike,
    known: Known,
    *,
    repair: bool,
    rng: np.random.Generator,
) -> Iterator[Solution]:
    """Yield the verified answer of a plan, then the answer after each improvement.

    The last one is the best.

    Args:
        planner: The problem's planner.
        plan: The plan to verify and improve.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        repair: Whether to solve again, with more checks and margins, if the answer
            breaks a constraint between the checks.
        rng: Source of all randomness.
    """
    solution = verified(planner.tracer, plan, x0, known)
    yield solution
    answer = Answer(solution, planner, known)
    if repair:
        answer = repaired(planner, solution, x0, known, rng=rng)
    account = answer.solution.repair
    settled = settled_answer(planner, answer, x0, known, rng)
    yield _with_account(settled, account)
    found = followed_down(planner, settled, x0, known, rng)
    yield _with_account(replace(found, restarts=settled.restarts), account)


def settled_answer(
    planner: Planner,
    answer: Answer,
    x0: ArrayLike,
    known: Known,
    rng: np.random.Generator,
) -> Solution:
    """Test from perturbed starts whether an answer is a local optimum.

    An answer is tested if it is feasible but not shown to be a local optimum, comes
    from an NLP solver, and its path touches no kink of the problem's expressions. The
    tested answer or a better one is returned. Any other answer is returned unchanged.

    Args:
        planner: The problem's planner.
        answer: The answer, judged by the user's own problem.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        rng: Source of all randomness.
    """
    solution, used, given = answer
    # At a kink second derivatives and small moves decide nothing.
    undecided = solution.status is SolutionStatus.FEASIBLE and not solution.path.kinks
    if used.polisher is None or not undecided or solution.plan.point is None:
        return solution
    x0 = start_of(planner.problem, solution.plan, x0)
    plan = solution.plan
    if plan.ends is None:
        states = used.fitness.states(plan.controls, x0, given)
        plan = replace(plan, states=states)
    plan, is_settled, restarts = settled(used, plan, x0, given, rng=rng)
    judged = _judged_by(planner, plan, x0, known, point=plan.point)
    found = verified(planner.tracer, replace(judged, settled=is_settled), x0, known)
    # A lower cost that the finer path does not confirm does not count.
    best = found if found.status.is_confirmed else solution
    return replace(best, restarts=restarts)


class Settled(NamedTuple):
    """Result of restarts from points near a plan.

    Attributes:
        plan: The plan, or a better one that a restart found.
        is_settled: Whether the plan counts as a local optimum: its curvature is
            positive, or it is flat and enough perturbed starts found nothing better.
        restarts: Report on the restarts; None: no restart was needed or possible.
    """

    plan: Plan
    is_settled: bool
    restarts: Restarts | None


def settled(
    planner: Planner,
    plan: Plan,
    x0: ArrayLike,
    known: Known,
    *,
    rng: np.random.Generator,
) -> Settled:
    """Replace a plan by better ones from perturbed starts, as long as there are any.

    The result also says whether the last plan counts as a local optimum.

    Args:
        planner: The planner whose polish ended at the plan.
        plan: A stationary point.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        rng: Source of all randomness.
    """
    polisher = planner.polisher
    before = 0 if plan.starts is None else sum(t.iterations for t in plan.starts.tried)
    left = max(round(_SHARE * before), _LEAST_ITERATIONS)
    told: Restarts | None = None
    for _ in range(ROUNDS):
        # A perturbed start would explode.
        if plan.point is None or polisher is None or plan.ends is not None:
            return Settled(plan, False, told)
        bent = curvature(plan.point)
        if bent is Curvature.POSITIVE:
            return Settled(plan, True, told)
        with stopwatch() as watch:
            found = _descended(planner, polisher, plan, x0, known, rng=rng, left=left)
        told = _counted(told, found, watch.seconds)
        left -= found.iterations
        better, evaluations = found.better, found.evaluations + plan.evaluations
        if better is None:
            plan = replace(plan, evaluations=evaluations)
            return Settled(plan, found.decides and bent is not Curvature.NEGATIVE, told)
        plan = planner.evaluated(
            better.controls,
            better.x0,
            known=known,
            value=(better.cost, better.violation),
            source=Source.POLISH,
            search=plan.search,
            evaluations=evaluations,
            polish_status=better.status,
            point=better.point,
            ends=better.ends,
            starts=plan.starts,
        )
    return Settled(plan, False, told)


def _counted(told: Restarts | None, found: "_Descended", seconds: float) -> Restarts:
    """Return the account with further starts."""
    last = told or Restarts(starts=0, iterations=0, better=0, seconds=0.0)
    return Restarts(
        starts=last.starts + found.starts,
        iterations=last.iterations + found.iterations,
        better=last.better + (found.better is not None),
        seconds=last.seconds + seconds,
    )


def _descended(  # noqa: PLR0913 - a plan, its start, and what is left
    planner: Planner,
    polisher: Polisher,
    plan: Plan,
    x0: ArrayLike,
    known: Known,
    *,
    rng: np.random.Generator,
    left: int,
) -> "_Descended":
    """Return the first better answer from a perturbed start, and the effort.

    No start begins after `left` iterations.
    """
    fitness = planner.fitness
    x0 = start_of(fitness.problem, plan, x0)
    sizes = fitness.arguments.sizes_along(plan.controls, plan.states, x0, known)
    evaluations, iterations, starts, decides = 0, 0, 0, True
    rows = 0 if plan.point is None else plan.point.lam_g.size

    def moved(source: np.random.Generator) -> Array:
        part = np.exp(source.uniform(np.log(_SMALLEST), np.log(_LARGEST)))
        move = source.standard_normal(plan.controls.shape)
        return np.asarray(plan.controls + part * sizes.controls[:, None] * move)

    # Starts may be polished ahead of their turn, from the numbers that they will draw.
    ahead = deepcopy(rng)
    calls = [
        partial(polisher, moved(ahead), x0, known, near=True) for _ in range(STARTS)
    ]
    with in_turn(polisher, calls, processes_of(planner.threads)) as results:
        while starts < STARTS and iterations < left:
            if iterations * rows > _MOST_WORK:
                decides = False
                break
            moved(rng)
            found = results.result(starts).found
            evaluations += found.evaluations
            iterations += found.iterations
            starts += 1
            # Relative to the natural size as well: near a cost of 0 any change would
            # count.
            falls = plan.cost - found.cost > SAME_COST * max(abs(plan.cost), sizes.cost)
            feasible = found.violation <= fitness.problem.tolerance
            if feasible and falls and found.status is PolishStatus.CONVERGED:
                return _Descended(found, evaluations, iterations, starts, False)
    decides = decides and starts >= ENOUGH
    return _Descended(None, evaluations, iterations, starts, decides)


class _Descended(NamedTuple):
    """Result of the perturbed starts.

    Attributes:
        better: The first answer that is better; None without one.
        evaluations: Evaluations of the solver.
        iterations: Its iterations.
        starts: Number of starts.
        decides: Whether they show that nothing near is better.
    """

    better: Polished | None
    evaluations: int
    iterations: int
    starts: int
    decides: bool


def followed_down(
    planner: Planner,
    solution: Solution,
    x0: ArrayLike,
    known: Known,
    rng: np.random.Generator,
) -> Solution:
    """Return a better answer found by rounding the problem's kinks, if there is one.

    Args:
        planner: The problem's planner.
        solution: The planner's answer; returned unchanged if nothing better is found.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        rng: Source of all randomness.
    """
    problem, best = planner.problem, solution
    if planner.polish is None or solution.status is SolutionStatus.CONVERGED:
        return solution
    sizes, at = kink_sizes(planner.fitness.shooting, x0, known), solution
    for part in PARTS if sizes else ():
        other = Planner(
            smoothed(problem, sizes, part),
            search=None,
            polish=planner.polish,
            # Machine code is not worth its compilation for a few evaluations.
            backend="casadi",
        )
        near = part < PARTS[0]  # From then on the guess is nearly an answer.
        start = start_of(problem, at.plan, x0)
        plan = other.plan(
            start, known=known, guess=at.plan.controls, near=near, rng=rng
        )
        # Stationary for the rounded problem only.
        plan = _judged_by(planner, plan, x0, known, before=at, point=None)
        at = verified(planner.tracer, plan, x0, known)
        best = at if _is_better_answer(at, best) else best
    return best


def repaired(
    planner: Planner,
    solution: Solution,
    x0: ArrayLike,
    known: Known,
    *,
    rng: np.random.Generator,
) -> Answer:
    """Return an answer that keeps its constraints along the path, if one is found.

    Args:
        planner: The problem's planner.
        solution: The planner's answer.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        rng: Source of all randomness.

    Returns:
        The answer, with the planner that made it and the report on what was tried.
    """
    tried: list[tuple[int, int]] = []
    with stopwatch() as watch:
        best = _repaired(planner, solution, x0, known, tried, rng=rng)
    if not tried:
        return best
    found, evaluations = best.solution, solution.plan.evaluations
    account = Repair(
        attempts=len(tried),
        checks=max(checks for checks, _ in tried),
        margins=max(margins for _, margins in tried),
        evaluations=max(found.plan.evaluations - evaluations, 0),
        seconds=watch.seconds,
        succeeded=found.status.is_confirmed,
    )
    return best._replace(solution=_with_account(found, account))


def _with_account(solution: Solution, account: Repair | None) -> Solution:
    """Return an answer with the account of its repair, and with what has failed."""
    if account is None or solution.repair is not None:
        return solution
    if solution.status is not SolutionStatus.BROKEN:
        return replace(solution, repair=account)
    problem, excess = solution.problem, solution.path.broken[0]
    return replace(
        solution,
        repair=account,
        reason=f"{solution.reason}; {account.tried}, in vain",
        advice=f"use more intervals ({2 * problem.intervals}), or leave more room than "
        f"{excess.amount:.2g} at {excess.name}",
    )


def _repaired(
    planner: Planner,
    solution: Solution,
    x0: ArrayLike,
    known: Known,
    tried: list[tuple[int, int]],
    *,
    rng: np.random.Generator,
) -> Answer:
    """Return the best answer; append (factor of checks, margins) of each attempt."""
    problem = planner.problem
    best, at = Answer(solution, planner, known), solution
    by_points = planner.polish is not None and has_segments(problem)

    def again(stated: OptimalControlProblem, at: Solution, checks: int = 1) -> Answer:
        tried.append((checks, len(margins)))
        return _solved_again(planner, stated, at, x0, known, checks=checks, rng=rng)

    margins: dict[Place, Excess] = {}
    last: dict[Place, float] = {}
    if by_points:
        found = again(at_points(problem), at)
        at = found.solution
        best = found if _is_better_answer(at, best.solution) else best
    checks = 1
    for attempt in range(ATTEMPTS):
        excesses = needed(problem, at, x0, known)
        if not excesses or not _worth_repairing(at, by_points):
            break
        more = finer_checks(problem, attempt)
        slack = slack_at_checks(planner.tracer, at, x0, known, checks)
        wanted = hurried(excesses, last, attempt)
        margins = added(margins, wanted, slack, checks / more)
        # An excess between checks falls with the square of their distance.
        least = max(e.relative for e in wanted) * (checks / more) ** 2
        tight = tightened(
            problem, [*margins.values()], for_all=least if attempt > 0 else 0.0
        )
        checks = more
        found = again(at_points(tight) if by_points else tight, at, checks)
        at = found.solution
        best = found if _is_better_answer(at, best.solution) else best
        last = {place_of(excess): excess.amount for excess in excesses}
    is_open = planner.polish is not None and not by_points
    if not (is_open and _margin_costs(solution, best)):
        return best
    if not _is_small(problem, checks * DENSER):
        return best
    return _with_checks_for_margins(
        planner, best, margins, x0, known, tried, checks=checks * DENSER, rng=rng
    )


def _margin_costs(before: Solution, repaired: Answer) -> bool:
    """Return whether an answer with margins may cost more than necessary.

    The cost of the answer without margins is a lower bound.
    """
    found = repaired.solution
    higher = found.plan.cost - before.plan.cost
    return found.status.is_confirmed and higher > _NOTICED * found.path.magnitude


def _with_checks_for_margins(  # noqa: PLR0913 - an answer, and how it was found
    planner: Planner,
    repaired: Answer,
    margins: Mapping[Place, Excess],
    x0: ArrayLike,
    known: Known,
    tried: list[tuple[int, int]],
    *,
    checks: int,
    rng: np.random.Generator,
) -> Answer:
    """Return an answer with checks in place of its margins, if it costs less.

    A margin is kept at every check, even if the path breaks nothing between them. With
    more checks a smaller margin is enough: it falls with the square of their distance.

    Args:
        planner: The problem's planner.
        repaired: A confirmed answer with margins.
        margins: The margins.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        tried: As of `_repaired`.
        checks: Factor for the problem's number of checks.
        rng: Source of all randomness.
    """
    problem, best, at = planner.problem, repaired, repaired.solution
    smaller, coarser = dict(margins), 1 / DENSER
    for _ in range(ATTEMPTS):
        smaller = added(smaller, needed(problem, at, x0, known), {}, coarser)
        tight = tightened(problem, [*smaller.values()])
        tried.append((checks, len(smaller)))
        found = _solved_again(
            planner, tight, at, x0, known, checks=checks, rng=rng, backend="casadi"
        )
        at, coarser = found.solution, 1.0
        if at.status.is_confirmed:
            saved = best.solution.plan.cost - at.plan.cost
            best = found if _is_better_answer(at, best.solution) else best
            # Margins fell to 1 / DENSER^2, and their cost with them, so this part is
            # left.
            if saved / (DENSER**2 - 1) <= _NOTICED * at.path.magnitude:
                break  # The remaining margins cost hardly anything.
            checks, coarser = checks * DENSER, 1 / DENSER
        if not _is_small(problem, checks):
            break
    return best


def _is_small(problem: OptimalControlProblem, checks: int) -> bool:
    """Return whether the problem with this factor for its checks can be solved soon."""
    return (
        problem.model.nx * problem.intervals * problem.checks * checks <= _MOST_STATES
    )


def _solved_again(  # noqa: PLR0913 - of a problem and of the answer to start from
    planner: Planner,
    stated: OptimalControlProblem,
    at: Solution,
    x0: ArrayLike,
    known: Known,
    *,
    checks: int,
    rng: np.random.Generator,
    backend: str | None = None,
) -> Answer:
    """Solve a changed problem from another answer; judge it by the user's problem.

    Args:
        planner: The planner of the user's problem.
        stated: The changed problem.
        at: The answer to start from.
        x0: Initial state, shape (nx,).
        known: Parameters and signals of the user's problem.
        checks: Factor for the number of checks.
        rng: Source of all randomness.
        backend: Backend that evaluates populations; None: as for the user's problem.
    """
    stated, given = with_more_checks(stated, known, checks)
    other = Planner(
        stated,
        search=_shorter(planner.search) if planner.polish is None else None,
        polish=planner.polish,
        backend=backend or planner.fitness.backend,
        threads=planner.threads,
    )
    start = start_of(planner.problem, at.plan, x0)
    plan = other.plan(start, known=given, guess=at.plan.controls, rng=rng)
    judged = _judged_by(planner, plan, x0, known, before=at, point=plan.point)
    return Answer(verified(planner.tracer, judged, x0, known), other, given)


def _shorter(search: SearchSettings | None) -> SearchSettings | None:
    """Return a search with a tenth of its budget, since it starts from an answer."""
    if search is None:
        return None
    budget = search.budget
    evaluations, seconds = budget.evaluations, budget.seconds
    if evaluations is not None:
        evaluations = max(int(_REPAIR_SHARE * evaluations), _FEWEST)
    if seconds is not None:
        seconds = _REPAIR_SHARE * seconds
    return replace(
        search, budget=replace(budget, evaluations=evaluations, seconds=seconds)
    )


def _worth_repairing(solution: Solution, by_points: bool) -> bool:
    """Return whether a margin could repair all that an answer breaks."""
    broken = solution.status is SolutionStatus.BROKEN
    return broken or (by_points and solution.status is SolutionStatus.INFEASIBLE)


def _judged_by(
    planner: Planner,
    plan: Plan,
    x0: ArrayLike,
    known: Known,
    *,
    before: Solution | None = None,
    point: NlpPoint | None,
) -> Plan:
    """Return a plan made for a changed problem as one of the planner's problem.

    The plan continues from an earlier answer, so the evaluations of both are added.
    None means that the plan already counts them.
    """
    return planner.evaluated(
        plan.controls,
        start_of(planner.problem, plan, x0),
        known=known,
        source=plan.source,
        search=before.plan.search if before else plan.search,
        evaluations=plan.evaluations + (before.plan.evaluations if before else 0),
        polish_status=plan.polish_status,
        point=point,
        ends=plan.ends,
        relaxed_cost=before.plan.relaxed_cost if before else plan.relaxed_cost,
        starts=before.plan.starts if before else plan.starts,
    )


def _is_better_answer(one: Solution, other: Solution) -> bool:
    """Return whether an answer is better: feasible ones first, then confirmed ones.

    Among confirmed answers the cost decides, else excess and cost on the finer path;
    but what the checks say does not get worse.
    """
    if one.plan.feasible != other.plan.feasible:
        return one.plan.feasible
    if one.status.is_confirmed != other.status.is_confirmed:
        return one.status.is_confirmed
    if one.status.is_confirmed:
        return one.plan.cost < other.plan.cost
    at_checks = [(s.plan.cost, s.plan.violation) for s in (other, one)]
    if not one.plan.feasible and is_better(*at_checks, tolerance=one.problem.tolerance):
        return False
    values = [(s.cost, s.verified_violation) for s in (one, other)]
    return is_better(*values, tolerance=one.problem.path_tolerance)
