"""Planner of one problem: guess -> search -> polish -> plan.

A planner is built once for a problem; planning then rebuilds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    RNG,
    Check,
    a_count,
    checked,
    either,
    function,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Budget,
    SearchInterrupted,
    default_order,
)
from swarmstart.heuristics.laws import first_size_of
from swarmstart.heuristics.running import heeded
from swarmstart.machine_code import stopwatch
from swarmstart.ocp.answer.plan import (
    NO_SEARCH,
    Account,
    Plan,
    PlanningInterrupted,
    SearchReport,
    Source,
    begins_warm,
    better_plan,
    is_enough,
)
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.pickling import Called
from swarmstart.ocp.common.presentation import ProgressCallback, of_budget, tell_nothing
from swarmstart.ocp.common.processes import processes_of, threads_of
from swarmstart.ocp.lanes.interior import InteriorLanes
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.nlp.integer_polish import IntegerPolisher, WholePolished
from swarmstart.ocp.nlp.polish import (
    Polished,
    Polisher,
    better_of,
    is_better,
)
from swarmstart.ocp.nlp.polish_options import DEAF, PolishOptions, PolishStatus
from swarmstart.ocp.nlp.several import polish_basins
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.nlp.watching import (
    UNWATCHED,
    WATCH,
    Answer,
    Relay,
    Reporting,
    Watch,
    deadline_of,
    is_late,
    is_watched,
)
from swarmstart.ocp.rollout.checking import Checker, Excess
from swarmstart.ocp.rollout.fitness import (
    KNOWN,
    NOTHING,
    Fitness,
    Known,
    core_known,
    replay,
    shared_arguments,
)
from swarmstart.ocp.rollout.path import Tracer
from swarmstart.ocp.rollout.paths_at_once import Paths, paths_of
from swarmstart.ocp.search.account import Effort, Origin, StartsAccount, Tried
from swarmstart.ocp.search.lane_search import LaneSearch, searched
from swarmstart.ocp.search.lane_starts import Task, ToldBest
from swarmstart.ocp.search.many_starts import (
    Answered,
    ManyStarts,
    ManyStartsInterrupted,
)
from swarmstart.ocp.search.search_space import (
    SearchSpace,
    TrajectoryFamily,
    points,
    space_of,
)
from swarmstart.ocp.search.settings import (
    Memetic,
    Multistart,
    SearchGiven,
    SearchSettings,
    population_of,
    search_settings,
    traded_order,
)
from swarmstart.ocp.search.state_guesses import straight_states
from swarmstart.ocp.statement.guesses import (
    bounded_controls,
    cold_controls,
    zero_controls,
)
from swarmstart.ocp.statement.problem import OptimalControlProblem

_SOURCES = {
    "the search": Source.SEARCH,
    "the lanes": Source.LANES,
    "the guess": Source.GUESS,
}
"""Origins of starts that are no cold ones."""
_VALUE = Check(
    lambda value: (
        isinstance(value, tuple) and reals().accepts(value) and np.shape(value) == (2,)
    ),
    "a pair (cost, violation)",
)
_GUESS = optional(either(reals(), of_kind(Start, "a Start")))
_BASINS = 3
"""Number of basins to polish if there are decisions besides the controls."""
_SEARCHED = 0.5
"""Largest share of the time left that a search takes if a polish follows."""


class _Request(NamedTuple):
    """Request for one plan; as in `Planner.plan`.

    Attributes:
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        guess: Guess, within the bounds.
        first: Controls that a search evaluates first, each (nu, N).
        near: Whether the guess is an earlier answer.
        rng: Source of all randomness.
        progress: Callback for the progress.
    """

    x0: ArrayLike
    known: Known
    guess: Start | None
    first: Sequence[Array]
    near: bool
    rng: np.random.Generator
    progress: ProgressCallback


def _turned(search: SearchSettings) -> SearchSettings:
    """Return a search whose target is multiplied by -1."""
    if search.budget.target is None:
        return search
    return replace(search, budget=replace(search.budget, target=-search.budget.target))


@checked(
    refused,
    polish=optional(of_kind(PolishOptions, "IpoptOptions or NlpOptions")),
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    family=optional(of_kind(TrajectoryFamily, "a TrajectoryFamily")),
    backend=optional(text()),
    lanes=a_count(),
    watch=WATCH,
)
class Planner(Called):
    """Search and polish (local solve) of one problem, compiled once.

    Except for `posed`, all methods refer to the core: the problem after all rewrites,
    which append states for decided parameters, previous controls and the like. If no
    rewrite is needed, the core is the problem itself.

    Attributes:
        stated: The problem as it is stated.
        problem: The core of the stated problem.
        lowered: The stated problem with its core, and the rewrites between them.
        fitness: Evaluator of the core: controls -> cost and violation.
        search: The population search; None without one.
        polish: Options of the polish; None without one.
        polisher: NLP solver of the core (that of the relaxed problem if controls take
            whole numbers); None without a polish.
        watch: Relay to the observer of search and polish, which may stop them.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=5,
        ...     stage_cost=u**2, bounds=ss.Bounds(controls=(-2, 2)), terminal=[(x, 1)],
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> plan = planner.plan([0.0], rng=np.random.default_rng(0))
        >>> plan.feasible, round(plan.cost, 4)
        (True, 1.0)
    """

    def __init__(  # noqa: PLR0913 - all that planning needs
        self,
        problem: OptimalControlProblem,
        *,
        search: SearchGiven,
        polish: PolishOptions | None = None,
        family: TrajectoryFamily | None = None,
        backend: str | None = None,
        lanes: int = 0,
        threads: int | None = 1,
        watch: Watch = UNWATCHED,
    ) -> None:
        """Prepare planning; functions are compiled when they are needed.

        Args:
            problem: The problem.
            search: The population search, as in `solve`: settings with a budget, or an
                algorithm with the default budget of 20,000 evaluations; None means no
                search.
            polish: Options of the polish; None means no polish.
            family: Family of trajectories to search; None means control sequences. The
                controls of a member do not lead exactly along its states, so a family
                should be combined with a polish.
            backend: Backend that evaluates populations: "llvm" (machine code), "casadi"
                or "auto"; None asks SWARMSTART_BACKEND, then auto.
            lanes: Number of additional random starts that are solved at once if there
                is no earlier answer (docs/answers.md, "Many starts"). 0: no such
                starts.
            threads: Largest number of threads of populations and lanes, and of
                processes of polishes from several starts; None as in `solve`. Plans are
                the same for any number.
            watch: Observer of search and polish, which may stop them.

        Raises:
            InvalidProblemError: If there is a search and a control is unbounded, the
                family does not fit the problem, or there are lanes without a polish.
            InvalidSettingsError: If the search's population does not fit into memory.
        """
        self.fitness = Fitness(problem, backend=backend, threads=threads_of(threads))
        self.threads = threads
        self.lowered = self.fitness.shooting.lowered
        self.stated, self.problem = problem, self.lowered.core
        self._checker = Checker(self.fitness.shooting)
        search = search_settings(search)
        if search is not None and problem.maximize:
            # The user's target belongs to the maximised cost, the core's is minimised.
            search = _turned(search)
        self.search, self.polish = search, polish
        self.watch = watch = watch if isinstance(watch, Relay) else Relay(watch)
        self._space: SearchSpace | None = None
        if search is not None:
            self._space = space_of(self.fitness, family)
            # Raised here, not at the first plan.
            evaluations = search.budget.evaluations
            population = population_of(search.algorithm, evaluations)
            if population is not None:
                first_size_of(population, self._space.box, evaluations)
        self._rounding: IntegerPolisher | None = None
        self.polisher: Polisher | None = None
        if polish and self.problem.integer:
            self._rounding = IntegerPolisher(self.fitness, polish, watch=watch)
            self.polisher = self._rounding.relaxed
        elif polish:
            self.polisher = Polisher(self.fitness, polish, watch=watch)
        if lanes and self.polisher is None:
            raise InvalidProblemError("lanes need a polish, which ends what they begin")
        self._lanes = lanes
        self._lane_search: LaneSearch | None = None
        uses_lanes = search and isinstance(search.algorithm, Multistart | Memetic)
        if search and self._space and uses_lanes:
            self._lane_search = LaneSearch(
                self.fitness, self._space, search, self.polisher
            )

    @checked(refused, budget=of_kind(Budget, "a Budget"))
    def with_budget(self, budget: Budget) -> Planner:
        """Return the same planner with another search budget; nothing is rebuilt.

        Args:
            budget: The budget; without effect if there is no search.

        Returns:
            A new planner that shares all compiled functions.
        """
        if self.search is None:
            return self
        other = copy(self)
        other.search = replace(self.search, budget=budget)
        is_max = self.stated.maximize
        other._call_with(search=_turned(other.search) if is_max else other.search)
        if self._lane_search is not None:
            other._lane_search = self._lane_search.with_search(other.search)
        return other

    def in_time(self) -> Planner:
        """Return the same planner without starts in lanes, so that it can be stopped.

        It then stops at a deadline, `within` in `RecedingHorizon`.

        Raises:
            InvalidProblemError: If the search itself is a solve in lanes, or the solver
                of the polish cannot be stopped.
        """
        if self._lane_search is not None and self._lane_search.uses_lanes:
            raise InvalidProblemError(
                "within needs a search that can be stopped at any time, got one in "
                "lanes: take a population search such as lshade, or "
                "Multistart(lanes=False)"
            )
        if self.polish is not None and self.polish.plugin in DEAF:
            raise InvalidProblemError(
                "within needs a polish that can be stopped between iterations, such "
                f"as ipopt, got {self.polish.plugin}"
            )
        return self._without_lanes() if self._lanes else self

    def _without_lanes(self) -> Planner:
        other = copy(self)
        other._lanes = 0
        other._call_with(lanes=0)
        # A copy takes cached values along; this one is for a planner with lanes.
        other.__dict__.pop("many_starts", None)
        return other

    @checked(refused, x0=reals(), known=KNOWN, guess=_GUESS)
    def as_begun(
        self,
        x0: ArrayLike,
        *,
        known: Known = NOTHING,
        guess: Array | Start | None = None,
    ) -> Plan:
        """Return the plan from which planning begins, neither searched nor polished.

        Its controls are the guess; without a guess they are zero controls.

        Args:
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
            guess: As in `plan`.
        """
        still = copy(self._alone)
        still.polisher = None
        # Nothing is drawn.
        return still.plan(x0, known=known, guess=guess, rng=np.random.default_rng(0))

    def prepare(self) -> None:
        """Build and compile in advance what plans need.

        Left for the first use are the kernels of a search, if they were never compiled
        on this machine, and an NLP whose steps are chosen for each guess.
        """
        self.fitness.prepare()
        if self.polisher is not None:
            self.polisher.prepare()
        if self._lane_search is not None:
            self._lane_search.prepare()
        if self.many_starts is not None:
            self.many_starts.prepare()

    @cached_property
    def tracer(self) -> Tracer:
        """Tracer of the paths of plans; compiled at its first use."""
        return Tracer(self.fitness.shooting, self._checker)

    @cached_property
    def lanes_of_instances(self) -> InteriorLanes | None:
        """Solver of many instances in lanes; None if lanes cannot solve the problem."""
        program = None if self.polisher is None else self.polisher.program
        try:
            return InteriorLanes(self.fitness.shooting, program=program)
        except NoLanesError:
            return None

    @cached_property
    def paths_at_once(self) -> Paths | None:
        """Tracer of many finer paths at once; None: each path is traced alone."""
        return paths_of(self.tracer)

    @cached_property
    def many_starts(self) -> ManyStarts | None:
        """Solver of the problem from many starts, if there is one.

        None without lanes or a polish, or if controls take whole numbers. The problem
        is the core, the problem after all rewrites.
        """
        if not self._lanes or self.polisher is None or self._rounding is not None:
            return None
        return ManyStarts(self.fitness, self.polisher, self._lanes, self.threads)

    @property
    def is_core(self) -> bool:
        """True if the stated problem is its own core, with the same data."""
        # All members of an ensemble may be given one start, which must be repeated.
        is_core = self.lowered.core is self.stated and self.stated.risk is None
        return is_core and not self.problem.free_starts

    @checked(refused, x0=reals(), known=KNOWN, guess=_GUESS)
    def posed(
        self, x0: ArrayLike, known: Known = NOTHING, guess: Array | Start | None = None
    ) -> tuple[ArrayLike, Known, Array | Start | None]:
        """Convert initial state, known data and guess to those of the core.

        The core is the problem after all rewrites.

        Args:
            x0: Initial state of the stated problem, shape (nx,).
            known: Known data of the stated problem.
            guess: Controls, or a Start with states of the stated problem.

        Returns:
            Initial state, known data and guess (None without one) of the core.

        Raises:
            InvalidProblemError: If a shape is not the problem's.
        """
        if self.is_core:
            return x0, known, guess
        lowered = self.lowered
        start, core = lowered.start(x0, known.previous), core_known(lowered, known)
        if isinstance(guess, Start):
            start = lowered.with_decided(start, guess.decided)
            start, controls = lowered.guess(start, guess.controls)
            states = guess.states
            if states is not None:
                states = lowered.states(states, controls, start)
                at = np.arange(states.shape[1]) / self.problem.checks
                states = lowered.signalled(states, np.asarray(core.signals), at)
            own = None if guess.x0 is None else guess.x0 - lowered.origin
            guess = guess._replace(controls=controls, states=states, x0=own)
        elif guess is not None:
            start, guess = lowered.guess(start, guess)
        return start, core, guess

    @checked(
        refused,
        x0=reals(),
        known=KNOWN,
        guess=_GUESS,
        candidates=optional(reals(axes=3)),
        near=FLAG,
        last_cost=optional(reals(axes=0)),
        in_loop=FLAG,
        is_new=FLAG,
        rng=RNG,
        progress=function(),
    )
    def plan(  # noqa: PLR0913 - each may be left out
        self,
        x0: ArrayLike,
        *,
        known: Known = NOTHING,
        guess: Array | Start | None = None,
        candidates: Array | None = None,
        near: bool = False,
        last_cost: float | None = None,
        in_loop: bool = False,
        is_new: bool = False,
        rng: np.random.Generator,
        progress: ProgressCallback = tell_nothing,
    ) -> Plan:
        """Return the best plan found from an initial state.

        Args:
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
            guess: Controls to start from, shape (nu, N), clipped to the bounds; None:
                no guess. The search then starts at random, and a polish without a
                search at zero controls and at the middle of their bounds. A Start has
                states as well, for the polish.
            candidates: Further controls that the search evaluates, shape (nu, N, k),
                clipped to the bounds; None: no candidates. They come first in its first
                population.
            near: Whether the guess is an earlier answer. Then the plan is made by a
                polish that stays near the guess, without search and lanes, unless the
                polish fails, the cost has jumped since, or the search has
                `when="always"` (docs/answers.md, "Closed loop: one warm polish a
                step").
            last_cost: Cost of the earlier answer; None if not known.
            in_loop: Whether later plans will start from this one. Then this plan is
                also made without search and lanes, and the better plan is kept.
            is_new: Whether nothing of an earlier answer can be used, as for a horizon
                of one interval; then a search is made as for a first plan.
            rng: Source of all randomness.
            progress: Called with (evaluations so far, their limit, "searching") now and
                then, and with "polishing" when the polish begins. In a long polish the
                last argument is a text with the numbers of the start and of the
                iteration.

        Returns:
            The best plan; it need not be feasible.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value is not
                finite.
            PlanningInterrupted: On Ctrl-C, with the best plan so far, if there is one.
        """
        warm, follows = None, near
        # Many starts include a polish alone.
        follows_on = (near and not is_new) or (in_loop and not self._lanes)
        if follows_on and self._begins_warm:
            warm = self._alone.plan(x0, known=known, guess=guess, near=near, rng=rng)
            if near and is_enough(self.fitness, warm, x0, known, last_cost):
                return warm
            if is_late(self.watch):
                return warm
            follows = False  # From here on as for a first plan.
        plan = self._made(x0, known, guess, candidates, follows, rng, progress)
        return (
            plan if warm is None else better_plan(self.fitness, plan, warm, x0, known)
        )

    @property
    def _begins_warm(self) -> bool:
        if self.polisher is None or (self.search is None and not self._lanes):
            return False
        return begins_warm(self.search, lanes=bool(self._lanes))

    @cached_property
    def _alone(self) -> Planner:
        """The same planner without search and lanes."""
        alone = self._without_lanes()
        alone.search, alone._space = None, None
        return alone

    def _made(  # noqa: PLR0913, PLR0917 - what plan was given
        self,
        x0: ArrayLike,
        known: Known,
        guess: Array | Start | None,
        candidates: Array | None,
        near: bool,
        rng: np.random.Generator,
        progress: ProgressCallback,
    ) -> Plan:
        """Return the best plan, searched, polished or both; see `plan`."""
        given = guess if isinstance(guess, Start) or guess is None else Start(guess)
        if given is not None:
            x0 = x0 if given.x0 is None else given.x0
            controls = bounded_controls(self.problem, given.controls)
            given = given._replace(
                controls=controls,
                is_guess=given.states is not None,
                x0=None,  # It is the request's own now.
            )
        first = []
        if candidates is not None:
            columns = np.moveaxis(candidates, -1, 0)
            first = [bounded_controls(self.problem, one) for one in columns]
        request = _Request(x0, known, given, first, near, rng, progress)
        watch = self.watch.watch
        if progress is not tell_nothing:
            watch = Reporting(progress, watch)
        with self.watch.to(watch):
            if not near and self.many_starts is not None:
                return self._from_many(request, self.many_starts)
            return self._from_one(request)

    def _from_one(self, request: _Request) -> Plan:
        """Return the best plan from the search's points, or from the guess."""
        x0, known, guess, near = request.x0, request.known, request.guess, request.near
        plan, starts = self._searched(request)
        if self.polisher is None:
            return plan
        if is_late(self.watch):
            return replace(plan, polish_status=PolishStatus.ITERATION_LIMIT)
        if guess is not None:
            starts = self._with_guess(starts, guess)
        request.progress(0, 0, "polishing")
        relaxed_cost, account = np.nan, None
        try:
            with heeded():
                if self._rounding is None:
                    polished, evaluations = self._polished(
                        self.polisher, starts, x0, known, near=near
                    )
                else:
                    # A search's points are answers, too.
                    near_it = near or self.search is not None
                    with stopwatch() as watch:
                        rounded = self._rounding(starts, x0, known, near=near_it)
                    polished, evaluations = rounded.polished, rounded.evaluations
                    relaxed_cost = rounded.relaxed_cost
                    if not near:
                        account = self._whole_account(rounded, watch.seconds)
        except KeyboardInterrupt:
            raise PlanningInterrupted(plan) from None
        return self.evaluated(
            polished.controls,
            polished.x0,
            known=known,
            value=(polished.cost, polished.violation),
            source=Source.POLISH if polished.improved else plan.source,
            search=plan.search,
            evaluations=plan.evaluations + evaluations,
            polish_status=polished.status,
            point=polished.point,
            ends=polished.ends,
            relaxed_cost=relaxed_cost,
            starts=account,
            spent=polished.spent,
        )

    def _whole_account(
        self, rounded: WholePolished, seconds: float
    ) -> StartsAccount | None:
        """Return the account of starts for controls that take whole numbers."""
        if not self._lanes:
            return None
        origin: Origin = "zero controls" if self.search is None else "the search"
        polished, reason = rounded.polished, "controls take whole numbers"
        tried = Tried(
            origin=origin,
            cost=polished.cost,
            violation=polished.violation,
            feasible=bool(polished.violation <= self.problem.tolerance),
            iterations=polished.iterations,
            evaluations=rounded.evaluations,
            seconds=seconds,
        )
        return StartsAccount(
            won=origin, tried=(tried,), lanes=None, without_lanes=reason
        )

    def _from_many(self, request: _Request, many_starts: ManyStarts) -> Plan:
        """Return the best plan from many starts."""
        searched: list[tuple[Plan, float]] = []

        def search() -> list[Start]:
            with stopwatch() as watch:
                try:
                    plan, starts = self._searched(request)
                except PlanningInterrupted as stopped:
                    # Kept here, since `many_starts` knows the results of polishes only.
                    searched.append((stopped.partial, watch.seconds))
                    raise
                searched.append((plan, watch.seconds))
            request.progress(0, 0, "polishing")
            return starts

        request.progress(0, 0, "polishing")
        try:
            with heeded():
                answered = many_starts(
                    request.guess,
                    None if self.search is None else search,
                    request.x0,
                    request.known,
                    request.rng,
                    may_agree=self.search is not None
                    and self.search.when == "undecided",
                )
        except ManyStartsInterrupted as stopped:
            best = self._of_many(stopped.partial, searched, request.known)
            # The search's answer may be better than those of the few polishes so far.
            for plan, _ in searched:
                one, other = ((p.cost, p.violation) for p in (plan, best))
                if is_better(one, other, tolerance=self.problem.tolerance):
                    best = replace(plan, starts=best.starts)
            raise PlanningInterrupted(best) from None
        return self._of_many(answered, searched, request.known)

    def _of_many(
        self, answered: Answered, searched: Sequence[tuple[Plan, float]], known: Known
    ) -> Plan:
        """Return the answer from many starts as a plan.

        Args:
            answered: The answer.
            searched: Result of the search and its seconds; empty without a search.
            known: Values of the parameters and signals.
        """
        polished, account = answered.polished, answered.account
        source = _SOURCES.get(account.won, Source.COLD)
        report, evaluations = NO_SEARCH, 0
        for plan, seconds in searched if answered.is_searched else ():
            report, evaluations = plan.search, plan.evaluations
            effort = Effort(evaluations=evaluations, seconds=seconds)
            account = replace(account, search=effort)
        return self.evaluated(
            polished.controls,
            polished.x0,
            known=known,
            value=(polished.cost, polished.violation),
            source=Source.POLISH if polished.improved else source,
            search=report,
            evaluations=evaluations + answered.evaluations,
            polish_status=polished.status,
            point=polished.point,
            ends=polished.ends,
            starts=account,
            spent=polished.spent,
        )

    def _with_guess(self, starts: list[Start], guess: Start) -> list[Start]:
        """Return the starts of the polish, with a guess that has more than controls."""
        if guess.states is not None:
            return [*(starts if self.search is not None else ()), guess]
        alone = guess.carried is not None and self.search is None
        return [guess] if alone else starts

    def _polished(
        self,
        polisher: Polisher,
        starts: Sequence[Start],
        x0: ArrayLike,
        known: Known,
        *,
        near: bool,
    ) -> tuple[Polished, int]:
        """Return the best polished answer, and the evaluations of all polishes.

        Args:
            polisher: The NLP solver.
            starts: Starts of the polish, at least one.
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
            near: Whether they follow an earlier answer.
        """
        tolerance = self.problem.tolerance
        found, evaluations = polish_basins(
            polisher,
            starts,
            x0,
            known,
            tolerance=tolerance,
            near=near or self.search is not None,
            processes=processes_of(self.threads),
        )
        if found.violation <= tolerance or near or self.watch.is_over:
            return found, evaluations
        # A second attempt for a first plan that is infeasible.
        straight = self._straight(starts[0], x0, known)
        if straight:
            again, more = polish_basins(
                polisher,
                straight,
                x0,
                known,
                tolerance=tolerance,
                near=False,
                processes=processes_of(self.threads),
            )
            evaluations += more
            found = better_of(found, again, tolerance=tolerance)
        return found, evaluations

    def _straight(self, first: Start, x0: ArrayLike, known: Known) -> list[Start]:
        """Return starts whose states lead straight to the fixed states at the end.

        One has zero controls, another, if it differs, the controls of `first`; empty if
        the end fixes no state.
        """
        states = straight_states(self.fitness, x0, known)
        if states is None:
            return []
        zero = Start(zero_controls(self.problem), states)
        if np.array_equal(first.controls, zero.controls):
            return [zero]
        return [zero, Start(first.controls, states)]

    @checked(
        refused,
        controls=reals(),
        x0=reals(),
        known=KNOWN,
        source=of_kind(Source, "a Source"),
        value=optional(_VALUE),
    )
    def evaluated(
        self,
        controls: Array,
        x0: ArrayLike,
        *,
        known: Known = NOTHING,
        source: Source,
        value: tuple[float, float] | None = None,
        **account: Unpack[Account],
    ) -> Plan:
        """Return given controls as a plan: evaluated, neither searched nor polished.

        Args:
            controls: Shape (nu, N).
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
            source: Origin of the controls.
            value: Cost and violation of the controls; None: they are computed here.
            account: Fields of `Plan` on the effort to find the controls.

        Returns:
            The plan.
        """
        states, outside = self.fitness.followed(controls, x0, known)
        ends = account.get("ends")
        if ends is not None:
            states, *value_there = replay(
                self.fitness.shooting, controls, x0, known, ends=ends
            )
            value = value or (value_there[0], value_there[1])
        cost, violation = value or self.fitness.value(controls, x0, known)
        return Plan(
            controls=controls,
            states=states,
            cost=cost,
            violation=violation,
            feasible=bool(violation <= self.problem.tolerance and np.isfinite(cost)),
            source=source,
            start_excess=outside if outside > self.problem.tolerance else 0.0,
            **account,
        )

    def _searched(self, request: _Request) -> tuple[Plan, list[Start]]:
        """Return the search's answer and the starts of the polish, the best first.

        Without a search, these are the guess, or the cold starts.
        """
        x0, known, rng = request.x0, request.known, request.rng
        guess = None if request.guess is None else request.guess.controls
        search, space = self.search, self._space
        if search is None or space is None or is_late(self.watch):
            return self._unsearched(x0, known, guess)
        objective = space.objective(x0, known)
        order = search.order or default_order(self.problem.tolerance)
        basins = search.basins if self.polisher else 0  # They are for the polish.
        if self.polisher and self.problem.free_starts:
            basins = basins or _BASINS
            order = search.order or traded_order(objective, space.box, rng)
        if self._lane_search is not None and self.polisher:
            basins = basins or _BASINS
        search, lanes = self._shortened(search)
        task = Task(
            x0=x0,
            known=known,
            objective=objective,
            order=order,
            guess=guess,
            first=request.first,
            basins=basins,
            rng=rng,
            tell=of_budget(request.progress, search.budget, "searching"),
            told_best=self._told_best(space, x0, known),
        )
        try:
            with self.watch.searching():
                found = searched(search, space, task, lanes)
                self.watch.searched(found.result)
        except SearchInterrupted as stopped:
            start = space.decoded(stopped.partial.x, x0, known)
            plan = self.evaluated(
                start.controls,
                x0 if start.x0 is None else start.x0,
                known=known,
                source=Source.SEARCH,
                evaluations=stopped.partial.evaluations,
            )
            raise PlanningInterrupted(plan) from None
        result = found.result
        starts = [space.decoded(x, x0, known) for x in points(result)]
        plan = self.evaluated(
            starts[0].controls,
            x0 if starts[0].x0 is None else starts[0].x0,
            known=known,
            source=Source.SEARCH,
            search=SearchReport(
                result.cost,
                result.violation,
                result.history_cost,
                result.history_evaluations,
                found.lanes,
                found.without,
                result.history_violation,
            ),
            evaluations=result.evaluations,
        )
        return plan, starts

    def _unsearched(
        self, x0: ArrayLike, known: Known, guess: Array | None
    ) -> tuple[Plan, list[Start]]:
        """Return the guess, or the first cold start, and the starts of the polish."""
        cold = cold_controls(self.problem) if guess is None else [guess]
        source = Source.COLD if guess is None else Source.GUESS
        plan = self.evaluated(cold[0], x0, known=known, source=source)
        return plan, [Start(controls) for controls in cold]

    def _shortened(
        self, search: SearchSettings
    ) -> tuple[SearchSettings, LaneSearch | None]:
        """Return the search, and that of its local solves, within the time left."""
        lanes, deadline = self._lane_search, deadline_of(self.watch)
        if deadline is None:
            return search, lanes
        share = _SEARCHED if self.polisher else 1.0
        search = replace(search, budget=deadline.shortened(search.budget, share))
        return search, None if lanes is None else lanes.with_search(search)

    def _told_best(self, space: SearchSpace, x0: ArrayLike, known: Known) -> ToldBest:
        """Return the callback for a search's best point; None if it is not observed."""
        watch = self.watch
        if not is_watched(watch):
            return None

        def answer(x: Array) -> Answer:
            start = space.decoded(x, x0, known)
            state = x0 if start.x0 is None else start.x0
            return start.controls, np.asarray(state, dtype=np.float64)

        return lambda evaluations, best: watch.advanced(evaluations, best, answer)

    @checked(refused, x0=reals(), known=KNOWN)
    def outside(self, x0: ArrayLike, known: Known = NOTHING) -> list[Excess]:
        """Return the constraints that an initial state breaks for any control.

        The worst comes first.

        Args:
            x0: Initial state, shape (nx,).
            known: Values of the parameters and signals.
        """
        if not self._checker.looks_at_start:
            return []
        problem = self.problem
        state, p, flat = shared_arguments(problem, x0, known)
        return self._checker.at_start(
            state,
            p,
            flat[: problem.ns],
            lambda: self.fitness.arguments.sizes(x0, known),
        )


def planner_of(problem: OptimalControlProblem, planner: Planner) -> Planner:
    """Return a planner of a problem, built with the settings of another planner."""
    _, named = planner._called_with
    return Planner(problem, **{n: v for n, v in named.items() if n != "problem"})
