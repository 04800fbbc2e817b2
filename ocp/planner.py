"""One planning problem: guess -> search -> polish -> plan.

A planner is built once for a problem; planning rebuilds nothing.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics import (
    SearchInterrupted,
    default_order,
)
from swarmstart.heuristics.algorithm import first_size_of
from swarmstart.heuristics.interrupts import heeded
from swarmstart.ocp.checking import Checker, Excess
from swarmstart.ocp.control_shape import split_knots
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.fitness import (
    NOTHING,
    Fitness,
    Known,
    at_nodes,
    core_known,
    shared_arguments,
)
from swarmstart.ocp.guess import bounded_controls, zero_controls
from swarmstart.ocp.integer_polish import IntegerPolisher
from swarmstart.ocp.lane_search import LaneSearch, searched
from swarmstart.ocp.lane_settings import Memetic, Multistart, population_of
from swarmstart.ocp.lane_starts import Task
from swarmstart.ocp.many_starts import ManyStarts, Origined
from swarmstart.ocp.path import Tracer
from swarmstart.ocp.plan import (
    Account,
    Plan,
    PlanningInterrupted,
    SearchReport,
    Source,
)
from swarmstart.ocp.polish import Polished, Polisher, better_of, polish_basins
from swarmstart.ocp.polish_options import PolishOptions
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.progress import ProgressCallback, of_budget, tell_nothing
from swarmstart.ocp.search_settings import (
    SearchGiven,
    SearchSettings,
    search_settings,
    traded_order,
)
from swarmstart.ocp.search_space import (
    SearchSpace,
    Start,
    TrajectoryFamily,
    points,
    space_of,
)
from swarmstart.ocp.shooting import Shooting

Array = NDArray[np.float64]


_BASINS = 3
"""Basins that are polished where more than the controls is decided."""


def _turned(search: SearchSettings) -> SearchSettings:
    """Return a search whose target is of the costs times -1."""
    if search.budget.target is None:
        return search
    return replace(search, budget=replace(search.budget, target=-search.budget.target))


class Planner:
    """Search and polish of one problem, compiled once.

    All its methods but `posed` speak of the core of the problem (lowering.py), which is
    the problem itself unless it decides or remembers more than controls.

    Attributes:
        stated: The problem as it is stated.
        problem: Its core.
        lowered: Both, and what is which.
        fitness: Its evaluator.
        search: The population search; None: none.
        polish: Options of the polish; None: none.
        polisher: Its NLP solver, of the relaxed problem where controls take whole
            numbers; None without a polish.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        *,
        search: SearchGiven,
        polish: PolishOptions | None = None,
        family: TrajectoryFamily | None = None,
        backend: str | None = None,
        lanes: int = 0,
    ) -> None:
        """Compile what planning needs.

        Args:
            problem: The problem.
            search: The population search, as in `solve`: settings with a budget, or an
                algorithm, which then has 20,000 evaluations; None means none.
            polish: Options of the polish; None means none.
            family: What the search looks for; None means control sequences. A member
                becomes a plan by its controls, which do not lead exactly where its
                states are: it wants a polish.
            backend: What evaluates populations, as in compiled/backend.py.
            lanes: Number of random starts that are solved at once, beside the others,
                where there is no earlier answer; see many_starts.py. 0 means none.

        Raises:
            InvalidProblemError: If a search is asked for and a control is unbounded,
                the family does not fit the problem, or there are lanes without a
                polish.
            InvalidSettingsError: If the search's population does not fit into memory.
        """
        self.fitness = Fitness(Shooting(problem), backend=backend)
        self.lowered = self.fitness.shooting.lowered
        self.stated, self.problem = problem, self.lowered.core
        self._checker = Checker(self.fitness.shooting)
        search = search_settings(search)
        if search is not None and problem.maximize:
            search = _turned(search)
        self.search, self.polish = search, polish
        self._space: SearchSpace | None = None
        if search is not None:
            self._space = space_of(self.fitness, family)
            # Refused here, not at the first plan.
            evaluations = search.budget.evaluations
            population = population_of(search.algorithm, evaluations)
            if population is not None:
                first_size_of(population, self._space.box, evaluations)
        self._rounding: IntegerPolisher | None = None
        self.polisher: Polisher | None = None
        if polish and self.problem.integer:
            self._rounding = IntegerPolisher(self.fitness, polish)
            self.polisher = self._rounding.relaxed
        elif polish:
            self.polisher = Polisher(self.fitness, polish)
        if lanes and self.polisher is None:
            raise InvalidProblemError("lanes need a polish, which ends what they begin")
        self._lanes = 0 if self._rounding else lanes
        self._lane_search: LaneSearch | None = None
        uses_lanes = search and isinstance(search.algorithm, Multistart | Memetic)
        if search and self._space and uses_lanes:
            self._lane_search = LaneSearch(
                self.fitness, self._space, search, self.polisher
            )

    @cached_property
    def tracer(self) -> Tracer:
        """Traces the paths of plans; compiled when first asked for."""
        return Tracer(self.fitness.shooting, self._checker)

    @cached_property
    def many_starts(self) -> ManyStarts | None:
        """Local solves from many starts; None: there are none."""
        if not self._lanes or self.polisher is None:
            return None
        return ManyStarts(self.fitness, self.polisher, self._lanes)

    def posed(
        self, x0: ArrayLike, known: Known = NOTHING, guess: Array | Start | None = None
    ) -> tuple[ArrayLike, Known, Array | Start | None]:
        """Return initial state, what is known and a guess as the core has them.

        Args:
            x0: Initial state of the stated problem, shape (nx,).
            known: What the stated problem knows.
            guess: Controls, or a Start with states of the stated problem.

        Raises:
            InvalidProblemError: If a shape is not the problem's.
        """
        lowered = self.lowered
        is_core = lowered.core is self.stated and self.stated.risk is None
        if is_core and not self.problem.free_starts:
            return x0, known, guess
        start, core = lowered.start(x0, known.previous), core_known(lowered, known)
        if self.stated.has_knots and guess is not None:
            start, guess = self._from_knots(start, guess)
        if isinstance(guess, Start) and guess.states is not None:
            guess = guess._replace(states=lowered.states(guess.states, start))
        return start, core, guess

    def _from_knots(
        self, start: Array, guess: Array | Start
    ) -> tuple[Array, Array | Start]:
        """Return the core's initial state, and a guess with the core's controls.

        Raises:
            InvalidProblemError: If the guess is of no knots, nor of held controls.
        """
        knots = np.array(guess.controls if isinstance(guess, Start) else guess)
        nu, N = self.problem.model.nu, self.problem.intervals
        if knots.shape not in ((nu, N + 1), (nu, N)):
            raise InvalidProblemError(
                f"a guess of linear controls must have shape {(nu, N + 1)}, or "
                f"{(nu, N)} of held ones, got {knots.shape}"
            )
        if not np.isfinite(knots).all():
            raise InvalidProblemError(f"a guess must be finite, got {knots}")
        controls = split_knots(knots, N)[1]
        start = self.lowered.with_first_knot(start, knots)
        if not isinstance(guess, Start):
            return start, controls
        guess = guess._replace(controls=controls)
        if guess.states is not None:
            states = self.lowered.states(guess.states, start)
            guess = guess._replace(
                states=self.lowered.with_knots(states, controls, start)
            )
        return start, guess

    def plan(  # noqa: PLR0913 - each may be left out
        self,
        x0: ArrayLike,
        *,
        known: Known = NOTHING,
        guess: Array | Start | None = None,
        candidates: Array | None = None,
        near: bool = False,
        rng: np.random.Generator,
        progress: ProgressCallback = tell_nothing,
    ) -> Plan:
        """Return the best plan found from an initial state.

        Args:
            x0: Initial state, shape (nx,).
            known: Parameters and signals.
            guess: Controls to start from, shape (nu, N), clipped to the bounds; None
                means none is known: the search starts at random, the polish alone at
                zero controls. A Start has states as well: the polish begins there, too.
            candidates: Controls that the search looks at besides, shape (nu, N, k),
                clipped to the bounds; None means none. First in its first population.
            near: Whether the guess is an earlier answer, which a polish without a
                search stays near to.
            rng: Source of all randomness.
            progress: Told (evaluations, all, "searching") now and then, and
                "polishing" when that begins.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a value not finite.
            PlanningInterrupted: On Ctrl-C, with the best plan so far, if there is one.
        """
        given = guess if isinstance(guess, Start) or guess is None else Start(guess)
        controls, states, start = given[:3] if given else (None, None, None)
        x0 = x0 if start is None else start
        if controls is not None:
            controls = bounded_controls(self.problem, controls)
        first = []
        if candidates is not None:
            columns = np.moveaxis(candidates, -1, 0)
            first = [bounded_controls(self.problem, one) for one in columns]
        plan, starts = self._searched(x0, controls, first, known, rng, progress)
        if self.polisher is None:
            return plan
        if controls is not None and states is not None:
            found = starts if self.search is not None else []
            starts = [*found, Start(controls, states, is_guess=True)]
        progress(0, 0, "polishing")
        relaxed_cost, account = np.nan, None
        try:
            with heeded():
                if not near and self.many_starts is not None:
                    several = self._given(starts, controls, states)
                    answered = self.many_starts(several, x0, known, rng)
                    polished, evaluations = answered.polished, answered.evaluations
                    account = answered.account
                elif self._rounding is None:
                    polished, evaluations = self._polished(
                        self.polisher, starts, x0, known, near=near
                    )
                else:
                    near = near or self.search is not None
                    rounded = self._rounding(starts, x0, known, near=near)
                    polished, evaluations = rounded.polished, rounded.evaluations
                    relaxed_cost = rounded.relaxed_cost
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
            relaxed_cost=relaxed_cost,
            starts=account,
        )

    def _given(
        self, starts: Sequence[Start], controls: Array | None, states: Array | None
    ) -> list[Origined]:
        """Return what a search found and the guess, if there are any."""
        found = starts if self.search is not None else ()
        given = [Origined("the search", one) for one in found if one.states is None]
        if controls is not None:
            start = Start(controls, states, is_guess=states is not None)
            given.append(Origined("the guess", start))
        return given

    def _polished(
        self,
        polisher: Polisher,
        starts: Sequence[Start],
        x0: ArrayLike,
        known: Known,
        *,
        near: bool,
    ) -> tuple[Polished, int]:
        """Return the best that polishing finds, and the evaluations of all.

        Args:
            polisher: The NLP solver.
            starts: Where to polish from, at least one.
            x0: Initial state, shape (nx,).
            known: Parameters and signals.
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
        )
        if found.violation <= tolerance or near:
            return found, evaluations
        straight = self._straight(starts[0], x0, known)
        if straight:
            again, more = polish_basins(
                polisher, straight, x0, known, tolerance=tolerance, near=False
            )
            evaluations += more
            found = better_of(found, again, tolerance=tolerance)
        return found, evaluations

    def _straight(self, first: Start, x0: ArrayLike, known: Known) -> list[Start]:
        """Return starts whose states lead straight to where the end fixes them.

        Where the controls of a start lead far from the end, the solver may not find
        back; from states that reach it, it often does. With zero controls, and with
        those of the start, where these are others; none if the end fixes nothing.
        """
        state, p, flat = shared_arguments(self.problem, x0, known)
        sizing, signals = self.fitness.shooting.sizing, at_nodes(self.problem, flat)
        target = sizing.target(p, signals[:, -1])
        if np.isnan(target).all():
            return []
        reached = np.where(np.isnan(target), state, target)
        part = np.linspace(0.0, 1.0, self.problem.nodes)
        states = state[:, None] + np.outer(reached - state, part)
        zero = Start(zero_controls(self.problem), states)
        if np.array_equal(first.controls, zero.controls):
            return [zero]
        return [zero, Start(first.controls, states)]

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
        """Return given controls as a plan, evaluated but neither searched nor polished.

        Args:
            controls: Shape (nu, N).
            x0: Initial state, shape (nx,).
            known: Parameters and signals.
            source: Where the controls come from.
            value: Their cost and violation; None means that they are to be found.
            account: What it took to find the controls, as in Plan.
        """
        cost, violation = value or self.fitness.value(controls, x0, known)
        states, outside = self.fitness.followed(controls, x0, known)
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

    def _searched(
        self,
        x0: ArrayLike,
        guess: Array | None,
        first: Sequence[Array],
        known: Known,
        rng: np.random.Generator,
        progress: ProgressCallback,
    ) -> tuple[Plan, list[Start]]:
        """Return the search's answer, and where to polish from, the best first.

        Without a search that is the guess, or zero controls.
        """
        search, space = self.search, self._space
        if search is None or space is None:
            controls = zero_controls(self.problem) if guess is None else guess
            plan = self.evaluated(controls, x0, known=known, source=Source.GUESS)
            return plan, [Start(controls)]
        objective = space.objective(x0, known)
        order = search.order or default_order(self.problem.tolerance)
        basins = search.basins if self.polisher else 0
        if self.polisher and self.problem.free_starts:
            basins = basins or _BASINS
            order = search.order or traded_order(objective, space.box, rng)
        if self._lane_search is not None and self.polisher:
            basins = basins or _BASINS
        task = Task(
            x0=x0,
            known=known,
            objective=objective,
            order=order,
            guess=guess,
            first=first,
            basins=basins,
            rng=rng,
            tell=of_budget(progress, search.budget, "searching"),
        )
        try:
            found = searched(search, space, task, self._lane_search)
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
            ),
            evaluations=result.evaluations,
        )
        return plan, starts

    def outside(self, x0: ArrayLike, known: Known = NOTHING) -> list[Excess]:
        """Return what an initial state breaks that no control can keep, worst first.

        Args:
            x0: Initial state, shape (nx,).
            known: Parameters and signals.
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
