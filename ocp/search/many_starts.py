"""From many starts to one answer: lanes, distinct optima, NLP solver.

    cold       the NLP solver from the user's guess, from states that lead straight to
               a fixed end, from zero controls, and from the middle of the bounds
    lanes      local solves from these, from smooth random controls and from states
               that reach a fixed end; the distinct optima are counted. If cold
               starts and lanes disagree, also from variations of these optima
               (start_lanes.py)
    search     the population search
    polish     the NLP solver from the best three optima of the lanes and from the
               search's points; without optima of lanes, from more states that reach a
               fixed end
    again      the NLP solver once more from the best answer, if its settings had kept
               it near the start: now with default settings, so that it can leave a
               saddle point

Cold starts and lanes agree if all cold starts lead to the cheapest optimum of the
lanes, and hardly any optimum is unseen. Then a search with `when="undecided"` is left
out, and of the lanes' optima only the best is polished.

The answer is never worse than the result of any single start. Of answers that agree to
1e-6, the one from the first kind of start is taken. Features that lanes do not support
(blocks, stiff models) are left to the NLP solver, and the report on the starts says so.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.errors import Sendable
from swarmstart.ocp.common.processes import Ahead, processes_of, threads_of
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.threads import aside
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.nlp.polish import SAME_COST, Polished, Polisher, is_better
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.nlp.several import Timed, in_turn, polished_from
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.nlp.watching import expect_starts
from swarmstart.ocp.rollout.fitness import Fitness, Known, started
from swarmstart.ocp.search.account import Lanes, Origin, StartsAccount, Tried
from swarmstart.ocp.search.start_lanes import Solved, StartLanes
from swarmstart.ocp.search.state_guesses import state_guesses, straight_states
from swarmstart.ocp.statement.guesses import cold_controls, zero_controls

T = TypeVar("T")

LANES = 64
"""Number of random starts of `solve`."""
POLISHED = 3
"""Number of optima of the lanes that are polished."""
_GUESSES = 8
"""Largest number of guesses of states."""
_MOST_WORK = 5_000_000
"""Iterations times instructions of a rollout after which no further start of a kind is
polished: an iteration of a large problem may take a tenth of a second."""
_UNSEEN = 0.1
"""Largest share of random starts, at the end of the 95 % interval, that may end in
optima not seen if lanes and cold starts agree: 30 starts in one optimum show it."""
_AGREED = 1e-4
"""Relative difference of costs within which lanes and cold starts agree."""
_NEAR: tuple[Origin, ...] = ("the lanes", "the search")
"""Kinds of starts that are answers, which the NLP solver stays near."""


class Origined(NamedTuple):
    """A start with its origin."""

    origin: Origin
    start: Start


@dataclass(frozen=True, slots=True, eq=False)
class Answered:
    """The best answer from many starts, and the results of all.

    Attributes:
        polished: The answer.
        evaluations: Evaluations of the NLP solver.
        account: Results of all starts.
        is_searched: Whether a search ran, after which the best answer was judged by a
            roll-out over the whole horizon.
    """

    polished: Polished
    evaluations: int
    account: StartsAccount
    is_searched: bool


class ManyStartsInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C during the solves from many starts.

    Attributes:
        partial: The best answer so far.
    """

    def __init__(self, partial: Answered) -> None:
        """Keep the best answer so far."""
        super().__init__("interrupted among many starts; the best is in .partial")
        self.partial = partial


class ManyStarts:
    """Local solves from many starts of one problem; built once."""

    def __init__(
        self, fitness: Fitness, polisher: Polisher, random: int, threads: int | None = 1
    ) -> None:
        """Start to compile the lanes; the cold starts need not wait for them.

        Args:
            fitness: The problem's evaluator.
            polisher: Its NLP solver.
            random: Number of random starts.
            threads: Largest number of threads, and of processes, as in `solve`.
        """
        self._fitness, self._polisher, self._random = fitness, polisher, random
        self._threads = threads
        self._lanes, self._refused = None, ""
        # Built with the evaluator, which is needed at once and never compiled aside.
        program = polisher.program
        try:
            # Compiled in another thread while the cold starts are polished.
            with aside():
                solver = LaneSolver(
                    fitness.shooting,
                    program=program,
                    threads=threads_of(threads),
                )
            self._lanes = StartLanes(fitness, solver, polisher.watch)
        except NoLanesError as error:
            self._refused = str(error)

    def prepare(self) -> None:
        """Wait for machine code that is still being compiled."""
        if self._lanes is None:
            return
        try:
            self._lanes.prepare()
        except NoCompilerError as error:
            self._lanes, self._refused = None, str(error)

    def __call__(
        self,
        guess: Start | None,
        search: Callable[[], Sequence[Start]] | None,
        x0: ArrayLike,
        known: Known,
        rng: np.random.Generator,
        *,
        may_agree: bool = False,
    ) -> Answered:
        """Return the best answer.

        Args:
            guess: The user's guess, if there is one.
            search: Function that runs the search and returns its points, the best
                first; None without a search.
            x0: Initial state of the rewritten problem (core), shape (nx,).
            known: Values of the parameters and signals.
            rng: Source of all randomness.
            may_agree: Whether the search is left out if cold starts and lanes agree.

        Raises:
            ManyStartsInterrupted: On Ctrl-C after the first start.
        """
        fitness, watch = self._fitness, self._polisher.watch
        lanes, optima = None, list[Start]()
        # Asked for each time, since the program may have other threads by now.
        processes = processes_of(self._threads)
        tries = _Tries(self._polisher, x0, known, fitness.problem.tolerance, processes)
        cold = self._cold(guess, x0, known)
        starts = [
            one.start for one in cold if one.origin != "a straight way to the end"
        ]
        expect_starts(watch, len(cold))
        try:
            solved = self._beside(
                tries, cold, rng, lambda: self._in_lanes(starts, x0, known, rng)
            )
            if solved is not None and self._lanes is not None:
                lanes = self._lanes.account(solved)
                do_agree = agree(tries.tried, lanes)
                tries.agree = may_agree and do_agree
                if not do_agree:
                    solved = self._lanes.varied(solved, self._random, rng)
                    lanes = self._lanes.account(solved)
                optima = self._lanes.best(solved, POLISHED)
            self._further(tries, optima, search, x0, known, rng)
            if not (watch.is_over or tries.is_beyond_rollouts):
                tries.polish_again()
        except KeyboardInterrupt:
            if not tries.answers:
                raise
            raise ManyStartsInterrupted(self._answered(tries, lanes)) from None
        return self._answered(tries, lanes)

    def _further(
        self,
        tries: "_Tries",
        optima: Sequence[Start],
        search: Callable[[], Sequence[Start]] | None,
        x0: ArrayLike,
        known: Known,
        rng: np.random.Generator,
    ) -> None:
        """Search, and polish from all but the cold starts."""
        # In lanes there were many guesses already.
        count = 1 if optima else _GUESSES
        # Without the straight one, which was a cold start.
        guesses = state_guesses(self._fitness, x0, known, count, rng)[1:]
        if tries.agree:
            optima, search = optima[:1], None
        best = [Origined("the lanes", one) for one in optima]
        watch = self._polisher.watch
        expect_starts(watch, len(best) + len(guesses))
        found: Sequence[Start] = ()
        if search is None or watch.is_over or tries.is_beyond_rollouts:
            self._several(tries, best)
        else:
            found = self._beside(tries, best, rng, search) or ()
            # Where roll-outs say nothing, all that searches by them is left out.
            tries.is_searched = not tries.is_beyond_rollouts
            expect_starts(watch, len(found))
        further = [Origined("the search", one) for one in found]
        further += [Origined("guesses of states", one) for one in guesses]
        if not self._fitness.problem.model.nu:
            further += self._drawn(x0, known, rng)
        self._several(tries, further)

    def _beside(
        self,
        tries: "_Tries",
        starts: Sequence[Origined],
        rng: np.random.Generator,
        work: Callable[[], T],
    ) -> T | None:
        """Polish from starts, and do other work, if possible at the same time.

        Where roll-outs say nothing, the work is left out, and nothing is drawn.
        """
        state, done = rng.bit_generator.state, None
        with tries.polishes(starts) as results:
            if results.begin():
                done = work()
            self._take(tries, starts, results)
        if tries.is_beyond_rollouts:
            rng.bit_generator.state = state
            return None
        return work() if done is None else done

    def _several(self, tries: "_Tries", starts: Sequence[Origined]) -> None:
        """Polish from starts, of each kind the best first, within its work limit."""
        with tries.polishes(starts) as results:
            self._take(tries, starts, results)

    def _take(
        self, tries: "_Tries", starts: Sequence[Origined], results: Ahead[Timed]
    ) -> None:
        """Take the results of starts, of each kind the best first.

        When a budget is spent, only a first start that is an answer is taken: its
        polish ends after an iteration, and returns it if it is not improved.
        """
        shooting, work = self._fitness.shooting, Counter[Origin]()
        each = shooting.stage_without_path.n_instructions() * shooting.problem.intervals
        for number, one in enumerate(starts):
            is_answer = number == 0 and one.origin in _NEAR
            if self._polisher.watch.is_over and tries.answers and not is_answer:
                return
            if work[one.origin] <= _MOST_WORK:
                answer = tries.taken(one, results.result(number))
                work[one.origin] += answer.iterations * each

    def _answered(self, tries: "_Tries", lanes: Lanes | None) -> Answered:
        """Return the best answer, and the results of all starts."""
        best = tries.best
        account = StartsAccount(
            won=tries.tried[best].origin,
            tried=tuple(tries.tried),
            lanes=lanes,
            agree=tries.agree,
            without_lanes="" if lanes else self._refused or self._stopped(tries),
        )
        evaluations = sum(one.evaluations for one in tries.answers)
        return Answered(
            tries.answers[best], evaluations, account, is_searched=tries.is_searched
        )

    def _stopped(self, tries: "_Tries") -> str:
        """Return why there were no lanes although there could have been."""
        if tries.is_beyond_rollouts:
            return "the model is so unstable that roll-outs say nothing"
        spent = self._polisher.watch.is_over
        return "the budget was spent before" if spent else "interrupted"

    def _cold(self, guess: Start | None, x0: ArrayLike, known: Known) -> list[Origined]:
        """Return the starts before the lanes; those that soon lead to an answer first.

        The middle of the bounds is among them if it differs from zero controls.
        """
        fitness, straight = self._fitness, list[Start]()
        states = straight_states(fitness, x0, known)
        if states is not None:
            straight.append(Start(zero_controls(fitness.problem), states))
        origins: tuple[Origin, ...] = ("zero controls", "the middle of the bounds")
        if not fitness.problem.model.nu:
            origins = origins[1:]  # Of what is decided.
        cold = cold_controls(fitness.problem)
        return [
            *([] if guess is None else [Origined("the guess", guess)]),
            *(Origined("a straight way to the end", one) for one in straight),
            *(Origined(o, Start(c)) for o, c in zip(origins, cold, strict=False)),
        ]

    def _drawn(
        self, x0: ArrayLike, known: Known, rng: np.random.Generator
    ) -> list[Origined]:
        """Return the best of many draws of what is decided, for want of controls."""
        fitness, problem = self._fitness, self._fitness.problem
        if not problem.free_starts:
            return []
        none = np.empty((0, problem.intervals))
        _, decided = random_starts(problem, self._random, rng)
        drawn = [started(problem, x0, one) for one in decided.T]
        values = np.array([fitness.value(none, one, known) for one in drawn])
        order = np.lexsort(np.where(np.isfinite(values), values, np.inf).T)
        best = [Start(none, x0=drawn[number]) for number in order[:POLISHED]]
        return [Origined("random starts", one) for one in best]

    def _in_lanes(
        self,
        starts: Sequence[Start],
        x0: ArrayLike,
        known: Known,
        rng: np.random.Generator,
    ) -> Solved | None:
        """Return the answers of the lanes; None without lanes."""
        if self._lanes is None or self._polisher.watch.is_over:
            return None
        try:
            return self._lanes.random(starts, x0, known, self._random, rng)
        except NoCompilerError as error:  # Raised at the first use.
            self._lanes, self._refused = None, str(error)
            return None


class _Tries:
    """Results of the NLP solver so far.

    Attributes:
        answers: Its answers.
        tried: Account of each answer.
        is_searched: Whether a search ran, after which the best answer was judged by a
            roll-out over the whole horizon.
        agree: Whether cold starts and lanes agree, so that less is tried.
    """

    def __init__(
        self,
        polisher: Polisher,
        x0: ArrayLike,
        known: Known,
        tolerance: float,
        processes: int,
    ) -> None:
        self._polisher, self._x0, self._known = polisher, x0, known
        self._tolerance, self._processes = tolerance, processes
        self.answers: list[Polished] = []
        self.tried: list[Tried] = []
        self.is_searched = self.agree = False

    def polishes(
        self, starts: Sequence[Origined], *, near: bool | None = None
    ) -> Ahead[Timed]:
        """Return a context with the answers from starts, in their order.

        Args:
            starts: The starts.
            near: Whether the solver stays near them; None: near those that are answers.
        """

        def made(one: Origined) -> Polished:
            is_answer = one.origin in _NEAR and one.start.states is None
            return polished_from(
                self._polisher,
                one.start,
                self._x0,
                self._known,
                near=is_answer if near is None else near,
            )

        calls = [partial(made, one) for one in starts]
        origins = [one.origin for one in starts]
        # The work limit of a kind may leave out all but its first.
        first = [origins.index(one) for one in dict.fromkeys(origins)]
        return in_turn(self._polisher, calls, self._processes, first=first)

    def taken(self, one: Origined, timed: Timed) -> Polished:
        """Add an answer to those that count, and return it."""
        answer = timed.found
        self.answers.append(answer)
        self.tried.append(
            Tried(
                origin=one.origin,
                cost=answer.cost,
                violation=answer.violation,
                feasible=bool(
                    np.isfinite(answer.cost) and answer.violation <= self._tolerance
                ),
                iterations=answer.iterations,
                evaluations=answer.evaluations,
                seconds=timed.seconds,
            )
        )
        return answer

    def polish_again(self) -> None:
        """Polish the best answer again, not near its start, if it was kept near."""
        origin, answer = self.tried[self.best].origin, self.answers[self.best]
        if origin in _NEAR and np.isfinite(answer.cost + answer.violation):
            again = Origined(origin, Start(answer.controls, x0=answer.x0))
            with self.polishes([again], near=False) as results:
                self.taken(again, results.result(0))

    @property
    def is_beyond_rollouts(self) -> bool:
        """True if the best answer is judged from the states between its intervals.

        It is so judged if no roll-out over the whole horizon confirms it.
        """
        return self.answers[self.best].ends is not None

    @property
    def best(self) -> int:
        """Number of the best answer.

        Among equal answers one that converged comes first, then the earlier kind of
        start.
        """
        best = 0
        for number in range(1, len(self.answers)):
            if is_better(
                *(self._value(i) for i in (number, best)), tolerance=self._tolerance
            ):
                best = number
        order = get_args(Origin)
        equal = [i for i in range(len(self.answers)) if self._equals(i, best)]
        return min(
            equal,
            key=lambda i: (
                self.answers[i].status is not PolishStatus.CONVERGED,
                order.index(self.tried[i].origin),
            ),
        )

    def _value(self, number: int) -> tuple[float, float]:
        answer = self.answers[number]
        return answer.cost, answer.violation

    def _equals(self, number: int, best: int) -> bool:
        """Return whether an answer equals the best, except for rounding."""
        if number == best:
            return True
        (cost, violation), (least, broken) = self._value(number), self._value(best)
        if not max(violation, broken) <= self._tolerance:
            return False
        return abs(cost - least) <= SAME_COST * max(abs(cost), abs(least))


def agree(cold: Sequence[Tried], lanes: Lanes | None) -> bool:
    """Return whether cold starts lead to the cheapest optimum of the lanes.

    All feasible results of cold starts must do so, and there must be at least one. The
    lanes must also have seen nearly all optima in which random starts end.

    Args:
        cold: Results of the cold starts.
        lanes: Results of the lanes; None without lanes.
    """
    if lanes is None or lanes.unseen is None or not lanes.optima:
        return False
    costs = [one.cost for one in cold if one.feasible]
    least = lanes.optima[0].cost
    return (
        bool(costs)
        and lanes.unseen.most <= _UNSEEN
        and max(abs(cost - least) for cost in costs) <= _AGREED * abs(least)
    )
