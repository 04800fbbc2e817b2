"""Polish: an NLP solver started from a guess; the better of guess and answer is kept.

The NLP (transcription.py) need not measure constraints as the search does: it uses
smooth rows at points. So its answer is evaluated like any individual, and returned only
if it is better by (violation, cost) on the same evaluator. An answer is called a local
optimum only if the project's own test (optimality.py) finds it stationary, independent
of the solver's report.

A good start is feasible to 1e-3 and comes from a search or an earlier answer. From a
good start IPOPT begins with a small barrier and small pushes away from the bounds; with
its defaults it would first move away from the start, and might not return. If IPOPT
does not converge from there, its defaults are tried once.

Collocation (collocation.py) does not integrate the dynamics as the evaluator does. If
the evaluator finds another cost or a broken limit, the NLP is solved again with its
equations of motion shifted to the evaluator's states (nlp_solvers.py), until NLP and
evaluator agree.

A search's best point need not lie in the basin of the best local optimum. The search's
archive (`heuristics/running/archive.py`) keeps the best points that are far from each
other, and each of them is a guess for the NLP solver.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import FLAG, INDICES, checked, of_kind, optional, reals
from swarmstart.arrays import Array
from swarmstart.heuristics.running import heeded
from swarmstart.ocp.common.errors import InvalidProblemError, SolveError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.nlp.nlp_solvers import (
    MOST_CORRECTIONS,
    FixedSteps,
    NlpSolvers,
    Solvers,
    StepChoice,
    corrected,
)
from swarmstart.ocp.nlp.nlp_sources import last_line
from swarmstart.ocp.nlp.optimality import (
    NlpPoint,
    is_stationary,
    least_multipliers,
)
from swarmstart.ocp.nlp.polish_options import (
    IPOPT_STATUS,
    IpoptOptions,
    PolishOptions,
    PolishStatus,
)
from swarmstart.ocp.nlp.start import Carried
from swarmstart.ocp.nlp.transcription import Given, Limits, NonlinearProgram
from swarmstart.ocp.nlp.watching import (
    UNWATCHED,
    WATCH,
    Answer,
    Ratios,
    Watch,
    Work,
    is_late,
    is_watched,
    work_of,
)
from swarmstart.ocp.rollout.fitness import (
    KNOWN,
    NOTHING,
    Fitness,
    Known,
    at_nodes,
    replay,
    shared_arguments,
)
from swarmstart.ocp.rollout.scaling import Sizes
from swarmstart.ocp.rollout.status import growth_along
from swarmstart.ocp.statement.guesses import bounded_controls
from swarmstart.ocp.statement.problem import OptimalControlProblem

SAME_COST = 1e-6
"""Relative difference below which two costs count as one local optimum."""
GOOD_START = 1e-3
"""Largest violation of a start that the solver stays near."""
_STEPS_OF_ERROR = 10
"""Number of allowed step errors by which costs may differ."""
_NO_COST = 1e-9
"""Difference of costs, relative to the cost's size, that no solver resolves."""
_WILD = 1e4
"""Way of a state, relative to its size, above which a roll-out is no NLP's start."""
_REMEMBERED = 15
"""Number of polishes in a closed loop whose iterations are remembered."""
_ITERATIONS, _FACTORS = 20, 4000
"""Usual number of iterations, and operations of the linear solver in one, for each
variable; measured in docs/measured/polish.md."""
_KEPT = 1e-6
"""Excess of a row, in the NLP's numbers, at which an answer still keeps it."""
_STEEP = 1e3
"""Value of the NLP's cost when the cost has its natural size."""


class _How(NamedTuple):
    """Settings of one solve.

    Attributes:
        solvers: The NLP with its solvers.
        near: Whether the solver stays near the guess.
        held: Indices of the controls that are held fixed.
        is_guess: Whether the states are a guess that gives the sizes of unbounded
            states.
        carried: Multipliers to start from; None without them.
    """

    solvers: Solvers
    near: bool
    held: Sequence[int]
    is_guess: bool
    carried: Carried | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """Input of a solver: start, arguments and limits, with the data they are made from.

    The multipliers, of rows and of bounds, are in the NLP's units; None without them.
    With them the solve is given up after `most` iterations.
    """

    first: Array
    q: Array
    limits: Limits
    sizes: Sizes
    parameters: Array
    signals: Array
    multipliers: tuple[Array, Array] | None = None
    most: float = math.inf
    x0: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """A solver's answer in the NLP's units, with its cost in the problem's."""

    point: NlpPoint
    cost: float
    stats: Mapping[str, Any]
    sizes: Sizes
    rollouts: float

    @property
    def effort(self) -> tuple[int, int]:
        """Iterations of the solver, and its evaluations of the objective."""
        counts = (self.stats.get(name, 0) for name in ("iter_count", "n_call_nlp_f"))
        iterations, evaluations = map(int, counts)
        return iterations, evaluations

    def agrees(
        self, value: tuple[float, float], problem: OptimalControlProblem
    ) -> bool:
        """Return whether the evaluator finds the same cost and no broken limit."""
        differs = abs(self.cost - value[0])
        same = differs <= SAME_COST * self.natural_cost
        return same and value[1] <= problem.tolerance

    @property
    def natural_cost(self) -> float:
        """Natural size of the cost."""
        return self.sizes.cost * _STEEP


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Polished:
    """The better of a guess and the NLP solver's answer from it.

    Attributes:
        controls: Controls, shape (nu, N), within the bounds.
        x0: Initial state, including the decisions about it, shape (nx,).
        cost: Cost by the problem's evaluator.
        violation: Violation by the problem's evaluator.
        improved: False if the guess was kept.
        status: Status of the solver at its end.
        iterations: The solver's iterations.
        evaluations: Evaluations of the objective by the solver.
        point: The solver's answer in the NLP's units; None if it did not converge.
        ends: States between the intervals, shape (nx, N + 1), of an answer that is
            judged interval by interval, since deviations grow so much over the horizon
            that no roll-out confirms it; None: it is judged by its roll-out.
        rollouts: Cost of the polish in rollouts, derivatives included; see watching.py.
        spent: Iterations as in `Carried.spent`, with those of this polish if it began
            with multipliers and converged.
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
    ends: Array | None = None
    rollouts: float = 0.0
    spent: tuple[int, ...] = ()

    def __repr__(self) -> str:
        """Return status, cost and effort in one line."""
        return (
            f"Polished: {self.status.value}, cost {self.cost:.9g}, violation "
            f"{self.violation:.3g}, {self.iterations} iterations"
        )


def _require_controls(held: Sequence[int], nu: int) -> None:
    """Raise unless the numbers are those of controls."""
    if any(number >= nu for number in held):
        raise refused("held", held, f"numbers of the {nu} controls")


@checked(
    refused,
    fitness=of_kind(Fitness, "a Fitness"),
    options=optional(of_kind(PolishOptions, "IpoptOptions or NlpOptions")),
    watch=WATCH,
)
class Polisher(Called):
    """An NLP solver on the multiple-shooting NLP of one problem.

    The NLP is built when it is first needed, and then kept. With step size control, its
    steps are chosen for each guess (nlp_solvers.py), and there is one NLP for each
    number of steps.

    Attributes:
        solvers: The NLPs with their solvers.
        watch: Observer of the work.
    """

    def __init__(
        self,
        fitness: Fitness,
        options: PolishOptions | None = None,
        *,
        watch: Watch = UNWATCHED,
    ) -> None:
        """Try the options; the NLP is built at its first use, or by `prepare`.

        Args:
            fitness: Evaluator of the problem, which also judges the answer.
            options: Options of the solver; None means IPOPT with this package's
                defaults.
            watch: Observer of the work, which may stop it.

        Raises:
            InvalidProblemError: If the solver refuses an option.
        """
        self._options = options or IpoptOptions()
        self._fitness, self.watch = fitness, watch
        near, far = (self._options.settings(near=either) for either in (True, False))
        # Other solvers than IPOPT have one way to start: it would be the same again.
        self._can_start_afresh = near != far
        self.solvers = NlpSolvers(fitness, self._options)
        self._choice: StepChoice | None = None
        if not self.solvers.has_fixed_steps:
            self._choice = StepChoice(fitness.shooting)

    @property
    def program(self) -> NonlinearProgram | None:
        """The NLP; None if its steps are chosen for each guess."""
        return self.solvers.program

    @property
    def ratios(self) -> Ratios | None:
        """Cost of the NLP's derivatives; None if steps are chosen for each guess."""
        return None if self._choice is not None else self.solvers(None).ratios

    @property
    def operations(self) -> float:
        """Operation count of a typical solve; infinity if steps depend on the guess."""
        program = self.program
        if program is None:
            return math.inf
        part, intervals = program.parts.interval, program.problem.intervals
        derivatives = part.slopes.n_instructions() + part.curvature.n_instructions()
        variables: int = program.nlp["x"].numel()
        return _ITERATIONS * (derivatives * intervals + _FACTORS * variables)

    def prepare(self) -> None:
        """Build the solvers now, not at their first use."""
        if self._choice is None:
            solvers, is_observed = self.solvers(None), is_watched(self.watch)
            solvers.far(is_observed)
            solvers.near(is_observed)

    @checked(
        refused,
        controls=reals(),
        x0=reals(),
        known=KNOWN,
        states=optional(reals()),
        is_guess=FLAG,
        near=FLAG,
        held=INDICES,
        carried=optional(of_kind(Carried, "multipliers of an earlier answer")),
    )
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
        carried: Carried | None = None,
    ) -> Polished:
        """Return the better of a guess and the local optimum found from it.

        Args:
            controls: The guess, shape (nu, N), clipped to the bounds; not changed.
            x0: Initial state, shape (nx,); its decided entries are guesses.
            known: Values of the parameters and signals.
            states: Start of the solver for the states at the nodes, shape (nx, nodes);
                they need not be consistent with the controls. None: the states that the
                controls lead to.
            is_guess: Whether the natural size of a state without bounds is its range in
                these states.
            near: Whether the guess is an answer, of a search or a solver, near which
                this solver should stay if the guess is feasible to 1e-3.
            held: Indices of the controls that are held fixed.
            carried: Multipliers of an earlier answer to start from. If the solve does
                not converge, it is repeated without them. None: no multipliers.

        Returns:
            The better of the guess and the solver's answer.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value is not
                finite.
            SolveError: If the solver cannot be run at all.
            KeyboardInterrupt: On Ctrl-C, which CasADi would otherwise discard.
        """
        problem, fitness = self._fitness.problem, self._fitness
        controls = bounded_controls(problem, controls)
        _require_controls(held, problem.model.nu)
        before = fitness.value(controls, x0, known)
        if states is None:
            states = fitness.states(controls, x0, known)
        elif np.shape(states) != (shape := (problem.model.nx, problem.nodes)):
            raise InvalidProblemError(
                f"states must have shape {shape}, got {np.shape(states)}"
            )
        x0, states = fitness.with_threshold(x0, states, known)
        near = near and before[1] <= GOOD_START
        steps = self._steps(controls, states, x0, known)
        how = _How(self.solvers(steps), near, held, is_guess)
        found = None
        if carried is not None and self._options.plugin == "ipopt":
            warm = how._replace(near=True, carried=carried)
            found = self._tried(controls, states, x0, known, before, warm)
            found = _with_spent(found, carried)
        fails = found is None or found.status is not PolishStatus.CONVERGED
        if found is None or (fails and not is_late(self.watch)):
            begun = self._tried(controls, states, x0, known, before, how)
            found = (
                begun
                if found is None
                else better_of(
                    found, begun, tolerance=problem.tolerance, alike=SAME_COST
                )
            )
        ended = found.status is PolishStatus.CONVERGED or self.watch.is_over
        if not ended and self._explodes(states, x0, known):
            # A roll-out that explodes is no start for the states.
            still = np.repeat(states[:, :1], states.shape[1], axis=1)
            again = self._tried(controls, still, x0, known, before, how)
            found = better_of(found, again, tolerance=problem.tolerance)
            ended = found.status is PolishStatus.CONVERGED or self.watch.is_over
        if near and not ended and self._can_start_afresh:
            how = how._replace(near=False)
            again = self._tried(controls, states, x0, known, before, how)
            found = better_of(found, again, tolerance=problem.tolerance)
        if self._choice is not None and not self.watch.is_over:
            found = self._with_finer_steps(found, steps, known, held)
        self.watch.answered((found.controls, found.x0), found.cost, found.violation)
        return found

    def _explodes(self, states: Array, x0: ArrayLike, known: Known) -> bool:
        """Return whether states at the nodes leave all natural sizes far behind."""
        if not np.isfinite(states).all():
            return bool(np.isfinite(states[:, 0]).all())
        sizes = self._fitness.arguments.sizes(x0, known).states
        way = np.abs(states - states[:, :1]).max(axis=1)
        return bool((way > _WILD * sizes).any())

    def point(
        self,
        controls: Array,
        states: Array,
        x0: Array,
        known: Known,
        *,
        held: Sequence[int] = (),
    ) -> NlpPoint | None:
        """Return an answer as a point of the NLP, with multipliers; nothing is solved.

        The multipliers are those of `least_multipliers`.

        Args:
            controls: Controls, shape (nu, N).
            states: States at the nodes, shape (nx, nodes).
            x0: Initial state, with the decisions about it, shape (nx,).
            known: Values of the parameters and signals.
            held: Indices of the controls that are held fixed.

        Returns:
            The point; None if it breaks limits of the NLP or is not stationary.
        """
        solvers = self.solvers(self._steps(controls, states, x0, known))
        how = _How(solvers, near=True, held=held, is_guess=False)
        asked = self._asked(controls, states, x0, known, how)
        w, q, limits, program = asked.first, asked.q, asked.limits, solvers.program
        g = np.array(program.derivatives["jac_g"](w, q)[0]).ravel()
        if not (np.clip(g, limits.lbg - _KEPT, limits.ubg + _KEPT) == g).all():
            return None
        lam_g, lam_x, _ = least_multipliers(program, w, q, limits)
        found = NlpPoint(
            program=program,
            cost_size=asked.sizes.cost,
            w=w,
            q=q,
            lam_g=lam_g,
            lam_x=lam_x,
            limits=limits,
        )
        return found if is_stationary(found) else None

    def _steps(
        self, controls: Array, states: Array, x0: ArrayLike, known: Known
    ) -> FixedSteps | None:
        """Return the steps that an NLP needs at a guess; None: the problem's own."""
        if self._choice is None:
            return None
        arguments = self._fitness.arguments(x0, known)
        begun = np.hstack([arguments[0][:, None], states[:, 1:]])
        return self._choice(controls, begun, arguments)

    def _with_finer_steps(
        self,
        found: Polished,
        steps: FixedSteps | None,
        known: Known,
        held: Sequence[int],
    ) -> Polished:
        """Return an answer, polished again if it needs more steps than its guess."""
        if steps is None:
            return found
        states = self._fitness.states(found.controls, found.x0, known)
        needed = self._steps(found.controls, states, found.x0, known)
        # The sum counts steps and parts.
        if needed is None or not np.isfinite(states).all() or sum(needed) <= sum(steps):
            return found
        x0, states = self._fitness.with_threshold(found.x0, states, known)
        before = found.cost, found.violation
        near = before[1] <= GOOD_START
        how = _How(self.solvers(needed), near, held, False)
        again = self._tried(found.controls, states, x0, known, before, how)
        best = again if again.status is PolishStatus.CONVERGED else found
        return replace(
            best,
            improved=found.improved or again.improved,
            iterations=found.iterations + again.iterations,
            evaluations=found.evaluations + again.evaluations,
            rollouts=found.rollouts + again.rollouts,
        )

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
        problem = self._fitness.problem
        given = np.asarray(x0, dtype=np.float64).ravel()
        asked = self._asked(controls, states, given, known, how)
        answer = self._solve(asked, how.solvers, near=how.near)
        better, start, after = self._evaluated(answer, controls, given, known, how)
        status = self._judged(answer)
        iterations, evaluations = answer.effort
        rollouts = answer.rollouts
        # Only collocation is corrected; see nlp_solvers.py.
        for _ in range(MOST_CORRECTIONS if how.solvers.program.inner_guess else 0):
            if status is not PolishStatus.CONVERGED or answer.agrees(after, problem):
                break
            if self.watch.is_over:
                break
            known_here = asked.sizes, asked.parameters, asked.signals
            shifted = corrected(answer.point, *known_here)
            if shifted is None:
                break
            again = replace(
                asked,
                first=shifted[0],
                limits=shifted[1],
                multipliers=None,
                most=math.inf,
            )
            answer = self._solve(again, how.solvers, near=True)
            better, start, after = self._evaluated(answer, controls, given, known, how)
            status = self._judged(answer)
            iterations += answer.effort[0]
            evaluations += answer.effort[1]
            rollouts += answer.rollouts
        point, ends = answer.point, None
        ended = status is PolishStatus.CONVERGED
        if ended and not answer.agrees(after, problem):
            ends, after = self._by_intervals(answer, better, start, known, after)
        improved = is_better(after, before, tolerance=problem.tolerance) or (
            ended and _pays_for_violation(point, before, after, problem.tolerance)
        )
        cost, violation = after if improved else before
        if status is PolishStatus.CONVERGED and not improved:
            if not _agree(before, after, problem, answer.natural_cost):
                status = PolishStatus.WORSE
        return Polished(
            controls=better if improved else controls,
            x0=start if improved else given,
            cost=cost,
            violation=violation,
            improved=improved,
            status=status,
            iterations=iterations,
            evaluations=evaluations,
            point=point if status is PolishStatus.CONVERGED else None,
            ends=ends if improved else None,
            rollouts=rollouts,
        )

    def _evaluated(
        self,
        answer: "_Answer",
        controls: Array,
        x0: Array,
        known: Known,
        how: "_How",
    ) -> tuple[Array, Array, tuple[float, float]]:
        """Return controls and start of an answer within bounds, with their value."""
        found = how.solvers.program.split(answer.point.w, answer.sizes)
        better, start = _within(self._fitness.problem, x0, *found)
        # Exactly: a solver keeps a fixed variable up to rounding only.
        better[list(how.held)] = controls[list(how.held)]
        if not (np.isfinite(better).all() and np.isfinite(start).all()):
            return better, start, (np.inf, np.inf)
        return better, start, self._fitness.value(better, start, known)

    def _by_intervals(
        self,
        answer: "_Answer",
        controls: Array,
        start: Array,
        known: Known,
        value: tuple[float, float],
    ) -> tuple[Array | None, tuple[float, float]]:
        """Return an answer's states between intervals, and its value by intervals.

        If a roll-out can confirm the answer: None, and its value by the roll-out.
        """
        shooting, sizes = self._fitness.shooting, answer.sizes.states
        if shooting.problem.model.jumps:
            return None, value
        ends = answer.point.ends * sizes[:, None]
        ends[:, 0] = start
        if not growth_along(shooting, ends[:, :-1], controls, known, sizes).is_large:
            return None, value
        _, cost, violation = replay(shooting, controls, start, known, ends=ends)
        return ends, (cost, violation)

    def _judged(self, answer: "_Answer") -> PolishStatus:
        """Return the status of an answer; from its point if the solver is not IPOPT."""
        if self._options.plugin == "ipopt":
            return IPOPT_STATUS.get(
                str(answer.stats["return_status"]), PolishStatus.NUMERICAL_FAILURE
            )
        if is_stationary(answer.point):
            return PolishStatus.CONVERGED
        return PolishStatus.NUMERICAL_FAILURE

    def _asked(
        self,
        controls: Array,
        states: Array,
        x0: Array,
        known: Known,
        how: "_How",
    ) -> "_Asked":
        """Return the input of the solver for a guess."""
        program, problem = how.solvers.program, self._fitness.problem
        nodes = np.hstack([x0[:, None], states[:, 1:]])
        sizes = self._sizes(controls, states, x0, known, is_guess=how.is_guess)
        start, parameters, flat = shared_arguments(problem, x0, known)
        signals = at_nodes(problem, flat)
        q = program.arguments(start, parameters, flat, sizes)
        limits = program.limits(sizes)
        if program.inner_guess is not None:  # It needs no rollout.
            nodes = np.where(np.isfinite(nodes).all(axis=0), nodes, x0[:, None])
        first = program.variables(controls, nodes[:, :: problem.checks], sizes)
        if program.inner_guess is not None:
            pieces = program.inner_guess.pieces_of(nodes)
            given = Given(controls, pieces, parameters, signals)
            first = program.with_points(first, given, sizes)
        # After the other variables, from whose values the excesses follow.
        first = program.with_slacks(first, q, limits)
        program.hold(limits, first, how.held)
        multipliers, most = None, math.inf
        if how.carried is not None:
            multipliers = how.carried.placed(program, first, q, sizes.cost)
            most = how.carried.most
        return _Asked(
            first, q, limits, sizes, parameters, signals, multipliers, most, x0
        )

    def _solve(self, asked: "_Asked", solvers: Solvers, *, near: bool) -> "_Answer":
        """Return the solver's answer.

        Args:
            asked: Input of the solver.
            solvers: The NLP with its solvers.
            near: Whether the solver stays near its start.
        """
        begun = {}
        if asked.multipliers is None:
            is_observed = is_watched(self.watch, variables=asked.first.size)
            solver = (solvers.near if near else solvers.far)(is_observed)
        else:
            solver = solvers.warm()
            begun = dict(zip(("lam_g0", "lam_x0"), asked.multipliers, strict=True))
        given = {"x0": asked.first, "p": asked.q, **begun, **asked.limits._asdict()}
        # The callback is built into the solver, so its receiver is set for each solve.
        solvers.iterates.told = self._told(asked, solvers)
        try:
            with heeded():  # CasADi would discard Ctrl-C.
                answer = solver(**given)
        except RuntimeError as error:
            raise SolveError(
                f"{self._options.plugin} could not be run: {last_line(error)}"
            ) from error
        w, lam_g, lam_x = (
            np.array(answer[name]).ravel() for name in ("x", "lam_g", "lam_x")
        )
        point = NlpPoint(
            program=solvers.program,
            cost_size=asked.sizes.cost,
            w=w,
            q=asked.q,
            lam_g=lam_g,
            lam_x=lam_x,
            limits=asked.limits,
        )
        stats = solver.stats()
        work = work_of(stats)
        self.watch.solved(work, solvers.ratios)
        cost = float(answer["f"]) * asked.sizes.cost
        effort = work.evaluations(solvers.ratios)
        return _Answer(point, cost, stats, asked.sizes, effort)

    def _told(self, asked: "_Asked", solvers: Solvers) -> Callable[[Array], bool]:
        """Return the callback for the iterates of a solve, which informs the watch."""
        problem, ratios = self._fitness.problem, solvers.ratios
        each, iterations = Work(1, 1, 1).evaluations(ratios), count()
        # Before the first iteration the start itself is evaluated.
        first = Work(1, 1).evaluations(ratios)

        def told(w: Array) -> bool:
            number = next(iterations)
            if number > asked.most:
                return False

            def answer() -> Answer:
                x0 = np.empty(0) if asked.x0 is None else asked.x0
                return _within(problem, x0, *solvers.program.split(w, asked.sizes))

            return self.watch.iterated(number * each + first, answer)

        return told

    def _sizes(
        self,
        controls: Array,
        states: Array,
        x0: ArrayLike,
        known: Known,
        *,
        is_guess: bool,
    ) -> Sizes:
        """Return the sizes, with the cost's so small that IPOPT scales the cost.

        IPOPT scales an objective down until no slope is above 100, but never up.
        """
        sizes = self._fitness.arguments.sizes_along(
            controls, states, x0, known, is_guess=is_guess
        )
        return replace(sizes, cost=sizes.cost / _STEEP)


def better_of(
    one: Polished, other: Polished, *, tolerance: float, alike: float = 0.0
) -> Polished:
    """Return the better of two answers, with the effort of both.

    Args:
        one: An answer.
        other: Another answer; among equal ones, it is preferred if it converged.
        tolerance: Largest violation that counts as feasible.
        alike: Difference of costs, relative to the cost, up to which they count as
            equal.
    """
    costs = [(p.cost, p.violation) for p in (one, other)]
    less = other.cost - alike * abs(other.cost), other.violation
    takes_other = is_better(costs[1], costs[0], tolerance=tolerance) or (
        other.status is PolishStatus.CONVERGED
        and not is_better(costs[0], less, tolerance=tolerance)
    )
    best = other if takes_other else one
    return replace(
        best,
        improved=one.improved or other.improved,
        iterations=one.iterations + other.iterations,
        evaluations=one.evaluations + other.evaluations,
        rollouts=one.rollouts + other.rollouts,
        spent=one.spent or other.spent,
    )


def _with_spent(found: Polished, carried: Carried) -> Polished:
    """Return a polish from multipliers with the iterations of earlier ones."""
    if found.status is not PolishStatus.CONVERGED:
        return replace(found, spent=carried.spent)
    return replace(found, spent=(*carried.spent, found.iterations)[-_REMEMBERED:])


def _within(
    problem: OptimalControlProblem, x0: Array, controls: Array, decided: Array
) -> tuple[Array, Array]:
    """Return controls, equal in each block, and the initial state within bounds."""
    lower, upper = (limit[:, None] for limit in problem.control_limits)
    start, place = x0.copy(), 0
    for one in problem.nlp_starts:
        # States that start together have one variable each, which rows tie: take the
        # first.
        value = np.clip(decided[place], one.value.lower, one.value.upper)
        start[list(one.states)] = value
        place += len(one.states)
    # The mean first: its rounding may pass a bound.
    return np.clip(problem.averaged(controls), lower, upper), start


def is_better(
    one: tuple[float, float], other: tuple[float, float], *, tolerance: float
) -> bool:
    """Return whether `one` is better than `other`, each (cost, violation).

    The smaller violation is better; if both are equal, the smaller cost. Violations up
    to the tolerance count as zero; a value that is not finite is never better.
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
    """Return whether a costlier answer is explained by the tolerance of constraints.

    A guess may be cheaper than the optimum because it breaks constraints within the
    tolerance: a violation is worth its multiplier.
    """
    if not (
        after[1] <= before[1] <= tolerance and np.isfinite([*before, *after]).all()
    ):
        return False
    worth = np.abs(point.lam_g).max(initial=0) * point.cost_size * before[1]
    return bool(after[0] - before[0] <= 2 * worth)


def _agree(
    one: tuple[float, float],
    other: tuple[float, float],
    problem: OptimalControlProblem,
    size: float,
) -> bool:
    """Return whether two (cost, violation) are feasible and of the same cost.

    Costs that are negligible compared with the natural size of the cost count as equal.
    With step size control, costs count as equal if they differ by less than the
    tolerance can resolve, since an NLP takes fixed steps.
    """
    feasible, same = max(one[1], other[1]) <= problem.tolerance, SAME_COST
    if problem.is_adaptive:
        same = max(same, _STEPS_OF_ERROR * (problem.integrator_tolerance or 0.0))
    nothing = _NO_COST * size
    return feasible and bool(np.isclose(one[0], other[0], rtol=same, atol=nothing))
