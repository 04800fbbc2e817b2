"""An NLP solver from a guess; the better of the two is kept.

The NLP (transcription.py) need not measure constraints as the search does: it sees
smooth rows at points. So its answer is evaluated like any individual, and returned only
if it is better by (violation, cost) on that same evaluator. Whether it is a stationary
point is judged by our own numbers (optimality.py), whatever the solver says of itself,
before an answer is called a local optimum.

From a good start, one that is feasible to 1e-3 and comes from a search or an earlier
answer, IPOPT begins with a small barrier and small pushes: with its defaults it moves
away from what it is given before it comes back, if it does. What does not converge so
is tried once more with the defaults.

A search's best point need not lie in the basin of the best local optimum: the search's
archive (`heuristics/archive.py`) keeps the best points that are apart in the box, and
each is a guess for the NLP solver.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics.interrupts import heeded
from swarmstart.ocp.errors import InvalidProblemError, SolveError
from swarmstart.ocp.fitness import NOTHING, Fitness, Known, shared_arguments
from swarmstart.ocp.guess import bounded_controls
from swarmstart.ocp.optimality import NlpPoint, is_stationary
from swarmstart.ocp.polish_options import (
    IPOPT_STATUS,
    IpoptOptions,
    PolishOptions,
    PolishStatus,
)
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.scaling import Sizes
from swarmstart.ocp.search_space import Start
from swarmstart.ocp.transcription import multiple_shooting

Array = NDArray[np.float64]
SAME_COST = 1e-6
"""Relative difference below which two costs are those of one local optimum."""
GOOD_START = 1e-3
"""Largest violation of a start that is near enough to be kept near."""
_STEEP = 1e3
"""What the cost is at its own size, in the NLP's numbers."""


class _How(NamedTuple):
    """Whether the solver stays near the guess, and the controls that it leaves.

    Also whether states are a guess that says how large they get.
    """

    near: bool
    held: Sequence[int]
    is_guess: bool


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Polished:
    """The better of a guess and what the NLP solver made of it.

    Attributes:
        controls: Shape (nu, N), within the bounds.
        x0: Initial state, with what is decided about it, shape (nx,).
        cost: Its cost on the problem's evaluator.
        violation: Its violation there.
        improved: False if the guess was kept.
        status: How the solver ended.
        iterations: The solver's iterations.
        evaluations: Evaluations of the objective by the solver.
        point: The solver's answer in the NLP's numbers; None if it did not converge.
    """

    controls: Array
    x0: Array
    cost: float
    violation: float
    improved: bool
    status: PolishStatus
    iterations: int
    evaluations: int
    point: NlpPoint | None = None

    def __repr__(self) -> str:
        """Return status, cost and effort in one line."""
        return (
            f"Polished: {self.status.value}, cost {self.cost:.9g}, violation "
            f"{self.violation:.3g}, {self.iterations} iterations"
        )


class Polisher:
    """An NLP solver on the multiple-shooting NLP of one problem, built once."""

    def __init__(self, fitness: Fitness, options: PolishOptions | None = None) -> None:
        """Build the solver.

        Args:
            fitness: The problem's evaluator, which also judges the answer.
            options: What the solver is told; None means IPOPT's defaults.

        Raises:
            InvalidProblemError: If the solver refuses an option.
        """
        self._options = options or IpoptOptions()
        self._fitness = fitness
        self._program = multiple_shooting(fitness.shooting)
        self._far = self._near = self._built(near=False)
        if self._options.plugin == "ipopt":
            self._near = self._built(near=True)

    def _built(self, *, near: bool) -> ca.Function:
        options = self._options
        given = self._program.derivatives if options.plugin == "ipopt" else {}
        settings = {
            "print_time": False,
            "show_eval_warnings": False,
            "error_on_fail": False,
            "calc_lam_p": False,
            **given,
            **options.settings(near=near),
        }
        try:
            return ca.nlpsol("polish", options.plugin, self._program.nlp, settings)
        except RuntimeError as error:
            raise InvalidProblemError(
                f"{options.plugin} refuses its options: expected its own names and "
                f"types, found {dict(options.options)}: {_last_line(error)}"
            ) from error

    def __call__(  # noqa: PLR0913 - a guess, what is known of it and what is held
        self,
        controls: Array,
        x0: ArrayLike,
        known: Known = NOTHING,
        *,
        states: Array | None = None,
        is_guess: bool = False,
        near: bool = False,
        held: Sequence[int] = (),
    ) -> Polished:
        """Return the better of a guess and the local optimum found from it.

        Args:
            controls: The guess, shape (nu, N), clipped to the bounds; not changed.
            x0: Initial state, shape (nx,), with the guess of what is decided about it.
            known: Parameters and signals.
            states: At the nodes, shape (nx, nodes): where the solver starts; they need
                not be those that the controls lead to. None means they are.
            is_guess: Whether the states say how large they get where bounds do not.
            near: Whether the guess is an answer of a search or a solver, worth staying
                near if it is feasible to 1e-3.
            held: Numbers of the controls that stay as they are.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value not finite.
            SolveError: If the solver cannot be run at all.
            KeyboardInterrupt: On Ctrl-C, which CasADi would swallow.
        """
        problem, fitness = self._fitness.problem, self._fitness
        controls = bounded_controls(problem, controls)
        before = fitness.value(controls, x0, known)
        if states is None:
            states = fitness.states(controls, x0, known)
        elif np.shape(states) != (shape := (problem.model.nx, problem.nodes)):
            raise InvalidProblemError(
                f"states must have shape {shape}, got {np.shape(states)}"
            )
        x0, states = fitness.with_threshold(x0, states, known)
        near = near and before[1] <= GOOD_START
        how = _How(near, held, is_guess)
        found = self._tried(controls, states, x0, known, before, how)
        if near and found.status is not PolishStatus.CONVERGED:
            how = how._replace(near=False)
            again = self._tried(controls, states, x0, known, before, how)
            found = better_of(found, again, tolerance=problem.tolerance)
        return found

    def _tried(
        self,
        controls: Array,
        states: Array,
        x0: ArrayLike,
        known: Known,
        before: tuple[float, float],
        how: "_How",
    ) -> Polished:
        """Return the better of a guess of known value and the solver's answer."""
        problem, fitness = self._fitness.problem, self._fitness
        given = np.asarray(x0, dtype=np.float64).ravel()
        point, stats, found = self._solve(controls, states, given, known, how)
        better, start = _within(problem, given, *found)
        better[list(how.held)] = controls[list(how.held)]
        after = (
            fitness.value(better, start, known)
            if np.isfinite(better).all() and np.isfinite(start).all()
            else (np.inf, np.inf)
        )
        status = self._judged(stats, point)
        ended = status is PolishStatus.CONVERGED
        improved = is_better(after, before, tolerance=problem.tolerance) or (
            ended and _pays_for_violation(point, before, after, problem.tolerance)
        )
        cost, violation = after if improved else before
        if status is PolishStatus.CONVERGED and not improved:
            if not _agree(before, after, tolerance=problem.tolerance):
                status = PolishStatus.WORSE
        return Polished(
            controls=better if improved else controls,
            x0=start if improved else given,
            cost=cost,
            violation=violation,
            improved=improved,
            status=status,
            iterations=int(stats.get("iter_count", 0)),
            evaluations=int(stats.get("n_call_nlp_f", 0)),
            point=point if status is PolishStatus.CONVERGED else None,
        )

    def _judged(self, stats: Mapping[str, Any], point: NlpPoint) -> PolishStatus:
        """Return how the solver ended; of a solver other than IPOPT, by its answer."""
        if self._options.plugin == "ipopt":
            return IPOPT_STATUS.get(
                str(stats["return_status"]), PolishStatus.NUMERICAL_FAILURE
            )
        if is_stationary(point):
            return PolishStatus.CONVERGED
        return PolishStatus.NUMERICAL_FAILURE

    def _solve(
        self,
        controls: Array,
        states: Array,
        x0: Array,
        known: Known,
        how: "_How",
    ) -> tuple[NlpPoint, dict[str, Any], tuple[Array, Array]]:
        """Return the solver's answer, its statistics, and what it says in our units.

        That is the controls, and the states at the start that are decided.
        """
        program, problem = self._program, self._fitness.problem
        ends = np.hstack([x0[:, None], states[:, problem.checks :: problem.checks]])
        sizes = self._sizes(controls, states, x0, known, is_guess=how.is_guess)
        q = program.arguments(*shared_arguments(problem, x0, known), sizes)
        limits = program.limits(sizes)
        first = program.variables(controls, ends, sizes)
        first = program.with_slacks(first, q, limits)
        program.hold(limits, first, how.held)
        solver = self._near if how.near else self._far
        try:
            with heeded():
                answer = solver(x0=first, p=q, **limits._asdict())
        except RuntimeError as error:
            raise SolveError(
                f"{self._options.plugin} could not be run: {_last_line(error)}"
            ) from error
        w, lam_g, lam_x = (
            np.array(answer[name]).ravel() for name in ("x", "lam_g", "lam_x")
        )
        point = NlpPoint(
            program=program,
            cost_size=sizes.cost,
            w=w,
            q=q,
            lam_g=lam_g,
            lam_x=lam_x,
            limits=limits,
        )
        return point, solver.stats(), program.split(w, sizes)

    def _sizes(
        self,
        controls: Array,
        states: Array,
        x0: ArrayLike,
        known: Known,
        *,
        is_guess: bool,
    ) -> Sizes:
        """Return the sizes, the cost's so small that IPOPT scales it by itself.

        IPOPT scales an objective down until no slope is above 100, but never up.
        """
        sizes = self._fitness.arguments.sizes_along(
            controls, states, x0, known, is_guess=is_guess
        )
        return replace(sizes, cost=sizes.cost / _STEEP)


def polish_basins(
    polisher: Polisher,
    starts: Sequence[Start],
    x0: ArrayLike,
    known: Known,
    *,
    tolerance: float,
    near: bool,
) -> tuple[Polished, int]:
    """Polish from each start; return the best, and the evaluations of all.

    Args:
        polisher: The polisher.
        starts: At least one; of equals the first is kept.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
        tolerance: Largest violation that counts as none.
        near: Whether the starts are answers, worth staying near; see Polisher.
    """
    best, *others = (
        polisher(
            start.controls,
            x0 if start.x0 is None else start.x0,
            known,
            states=start.states,
            is_guess=start.is_guess,
            near=near and start.states is None,
        )
        for start in starts
    )
    evaluations = best.evaluations
    for one in others:
        evaluations += one.evaluations
        found, so_far = ((p.cost, p.violation) for p in (one, best))
        if is_better(found, so_far, tolerance=tolerance):
            best = one
    return best, evaluations


def better_of(one: Polished, other: Polished, *, tolerance: float) -> Polished:
    """Return the better of two, with the effort of both; of equals one converged."""
    costs = [(p.cost, p.violation) for p in (one, other)]
    takes_other = is_better(costs[1], costs[0], tolerance=tolerance) or (
        other.status is PolishStatus.CONVERGED
        and not is_better(costs[0], costs[1], tolerance=tolerance)
    )
    best = other if takes_other else one
    return replace(
        best,
        improved=one.improved or other.improved,
        iterations=one.iterations + other.iterations,
        evaluations=one.evaluations + other.evaluations,
    )


def _within(
    problem: OptimalControlProblem, x0: Array, controls: Array, decided: Array
) -> tuple[Array, Array]:
    """Return controls, the same in each block, and the initial state within bounds."""
    lower, upper = (limit[:, None] for limit in problem.control_limits)
    start, place = x0.copy(), 0
    for one in problem.nlp_starts:
        value = np.clip(decided[place], one.value.lower, one.value.upper)
        start[list(one.states)] = value
        place += len(one.states)
    return np.clip(problem.averaged(controls), lower, upper), start


def _last_line(error: Exception) -> str:
    """Return the last line of CasADi's message, which says what is wrong."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1].strip() if lines else type(error).__name__


def is_better(
    one: tuple[float, float], other: tuple[float, float], *, tolerance: float
) -> bool:
    """Return whether (cost, violation) `one` is better, violation first.

    Violations up to the tolerance count as none; what is not finite is never better.
    """
    if not np.isfinite(one).all():
        return False
    if not np.isfinite(other).all():
        return True
    broken, broken_other = (v if v > tolerance else 0.0 for v in (one[1], other[1]))
    return (broken, one[0]) < (broken_other, other[0])


def _pays_for_violation(
    point: NlpPoint,
    before: tuple[float, float],
    after: tuple[float, float],
    tolerance: float,
) -> bool:
    """Return whether a dearer answer differs by what the tolerance is worth only.

    A guess may be cheaper than the optimum by breaking constraints within the
    tolerance: a violation is worth its multiplier.
    """
    if not (
        after[1] <= before[1] <= tolerance and np.isfinite([*before, *after]).all()
    ):
        return False
    worth = np.abs(point.lam_g).max(initial=0) * point.cost_size * before[1]
    return bool(after[0] - before[0] <= 2 * worth)


def _agree(
    one: tuple[float, float], other: tuple[float, float], *, tolerance: float
) -> bool:
    """Return whether two (cost, violation) are feasible and of the same cost."""
    feasible = max(one[1], other[1]) <= tolerance
    return feasible and bool(np.isclose(one[0], other[0], rtol=SAME_COST, atol=0.0))
