"""Runs of `solve` and of IPOPT from random starts, kept line by line in a file.

Each run is a line of JSON, written when it ends. A run whose line exists is not
repeated, so a measurement that was stopped can be continued; a new state of the code
needs a new file. Costs are those of the stated problem.
"""

import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp import (
    InvalidProblemError,
    IpoptOptions,
    Known,
    OptimalControlProblem,
    Planner,
    Solution,
    Start,
    solve,
)
from swarmstart.ocp.lanes.solver import random_starts
from swarmstart.ocp.rollout.fitness import started
from swarmstart.ocp.statement.guesses import middle_controls

T = TypeVar("T")
What = Literal[
    "first", "answer", "repaired", "zero", "middle", "guess", "cold", "ipopt"
]
"""first      a solve before all others, which makes or loads machine code
answer     a solve with the defaults, the number its seed
repaired   the same with repair=True
zero       IPOPT alone, from zero controls
middle     the same from the middle of the bounds
guess      the same from the guess that the problem's file states
cold       the first of these again and again, for its seconds
ipopt      IPOPT's solver alone, from a random start"""

COLD = 5
"""Repetitions of the cold solve."""
_REPAIRED = 3
"""Seeds with repair=True, at least."""
_SELDOM, _AS_LONG, _MANY = 0.3, 12, 100_000


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """A run and its result.

    Attributes:
        problem: Name of the problem.
        what: See `What`.
        number: The seed, or which start.
        lanes: Random starts of `solve` in lanes; None: its default.
        cost: As the problem states it.
        feasible: Whether the answer is, at the problem's own checks.
        confirmed: Whether it is, along its path on a finer grid.
        process_s: Time of this process on all cores [s].
        wall_s: Time by the clock [s].
        code_s: Of it, on machine code: made, or loaded if it was there [s].
        found_s: Time by the clock until an answer as good was there: of the search, the
            lanes and the NLP solver alone; None: not told [s].
        zero_s: The NLP solver's from zero controls; None: not told [s].
        won: Start that the answer comes from; empty: nothing is said of it.
        without_lanes: Why there were no lanes; empty: there were, or nothing is said.
        tried: Best feasible cost of each kind of start.
    """

    problem: str
    what: What
    number: int
    lanes: int | None
    cost: float
    feasible: bool
    confirmed: bool
    process_s: float
    wall_s: float
    code_s: float = 0.0
    found_s: float | None = None
    zero_s: float | None = None
    won: str = ""
    without_lanes: str = ""
    tried: Mapping[str, float] = field(default_factory=dict)


class Seconds(NamedTuple):
    """Times of a call [s]."""

    process: float
    wall: float


def timed(call: Callable[[], T]) -> tuple[T, Seconds]:
    """Return what a call returns, and how long it took."""
    process, wall = time.process_time(), time.perf_counter()
    found = call()
    spent = time.process_time() - process, time.perf_counter() - wall
    return found, Seconds(*spent)


@dataclass(frozen=True)
class Shipped:
    """A shipped problem as `solve` takes it.

    Attributes:
        name: Its name.
        problem: The problem.
        x0: Initial state, shape (nx,).
        known: Its parameters and signals.
        guess: Controls, or a Start, that its file states; None: it states none.
        lanes: Random starts of `solve` in lanes; None: its default.
    """

    name: str
    problem: OptimalControlProblem
    x0: Array
    known: Known
    guess: Array | Start | None
    lanes: int | None

    def answer(self, number: int, what: What = "answer") -> Run:
        """Return a solve with the defaults."""
        more: dict[str, Any] = {} if self.lanes is None else {"lanes": self.lanes}
        found, seconds = timed(
            lambda: solve(
                self.problem,
                self.x0,
                known=self.known,
                guess=self.guess,
                repair=what == "repaired",
                seed=number,
                **more,
            )
        )
        return self._run(what, number, found, seconds)

    def polished(self, what: What, number: int) -> Run:
        """Return a solve by IPOPT alone."""
        guess = {"middle": self.middle, "guess": self.guess}.get(what)
        found, seconds = timed(
            lambda: solve(
                self.problem,
                self.x0,
                known=self.known,
                search=None,
                guess=guess,
                seed=number,
                lanes=0,
            )
        )
        return self._run(what, number, found, seconds)

    def from_start(self, number: int) -> Run:
        """Return IPOPT's result from a random start, with IPOPT's own seconds."""
        planner = self.planner
        if planner.polisher is None:
            raise TypeError("expected a planner with a polish")
        x0, known, _ = planner.posed(self.x0, self.known)
        core, rng = planner.problem, np.random.default_rng(number)
        controls, decided = random_starts(core, 1, rng)
        start = started(core, x0, decided[:, 0])
        polish = planner.polisher

        def call() -> tuple[float, float]:
            try:
                found = polish(controls[:, :, 0], start, known)
            except InvalidProblemError:  # It leaves the numbers at once.
                return math.inf, math.inf
            return found.cost, found.violation

        (cost, violation), seconds = timed(call)
        feasible = math.isfinite(cost) and violation <= core.tolerance
        return Run(
            problem=self.name, what="ipopt", number=number, lanes=None,
            cost=self.problem.sense * cost, feasible=feasible, confirmed=False,
            process_s=seconds.process, wall_s=seconds.wall,
        )  # fmt: skip

    @cached_property
    def planner(self) -> Planner:
        """IPOPT's solver, which has been called once."""
        planner = Planner(self.problem, search=None, polish=IpoptOptions())
        x0, known, _ = planner.posed(self.x0, self.known)
        planner.plan(x0, known=known, rng=np.random.default_rng(0))
        return planner

    @cached_property
    def middle(self) -> Array | None:
        """Middle of the bounds of the controls, (nu, N); None: it is zero."""
        middle = middle_controls(self.problem)
        return middle if middle.any() else None

    def _run(self, what: What, number: int, found: Solution, seconds: Seconds) -> Run:
        run = Run(
            problem=self.name, what=what, number=number, lanes=self.lanes,
            cost=float(found.cost),
            feasible=bool(
                np.isfinite(found.cost)
                and found.violation <= found.problem.tolerance
            ),
            confirmed=found.status.is_confirmed,
            process_s=seconds.process, wall_s=seconds.wall,
            code_s=found.compile_seconds,
        )  # fmt: skip
        account = found.plan.starts
        if account is None:
            return run
        sense, tolerance = self.problem.sense, found.problem.tolerance
        tried = dict[str, float]()
        for one in account.tried:
            if one.violation <= tolerance and np.isfinite(one.cost):
                before = tried.get(one.origin, math.inf)
                tried[one.origin] = min(before, one.cost)
        return replace(
            run,
            found_s=account.found_after,
            zero_s=account.tried[0].seconds if account.tried else None,
            won=account.won,
            without_lanes=account.without_lanes,
            tried={origin: sense * cost for origin, cost in tried.items()},
        )


def shipped(name: str, lanes: int | None) -> Shipped:
    """Return a shipped problem."""
    posed = resolve(read_document(name)).posed()
    first = first_problem(posed)
    if first.family is not None:
        raise TypeError(f"expected a search for controls, found a family in {name}")
    agent = next(agent for agent in posed.agents if agent.given is None)
    return Shipped(name, first.problem, first.x0, first.known, agent.first, lanes)


class Log:
    """Lines of a file, one for each run.

    Attributes:
        runs: Those that are there.
    """

    def __init__(self, file: Path) -> None:
        """Read what is there; a line that was not ended is left out."""
        self._file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        if text and not text.endswith("\n"):
            text = text[: text.rfind("\n") + 1]
            file.write_text(text, encoding="utf-8")
        self.runs = [Run(**json.loads(line)) for line in text.splitlines()]

    def of(self, problem: str, what: What, lanes: int | None) -> list[Run]:
        """Return the runs of one kind, by number."""
        found = [r for r in self.runs if (r.problem, r.what) == (problem, what)]
        if what != "ipopt":
            found = [run for run in found if run.lanes == lanes]
        return sorted(found, key=lambda run: run.number)

    def add(self, run: Run) -> None:
        """Write a run."""
        with self._file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(run)) + "\n")
        self.runs.append(run)


@dataclass(frozen=True, kw_only=True, slots=True)
class Amount:
    """Numbers of runs of a problem.

    Attributes:
        seeds: Of `solve`, at least.
        most_seeds: As many if they take less than `solve_s`.
        solve_s: See there [s].
        starts: Of IPOPT, at least.
        most_starts: As many if they take less than `ipopt_s`.
        ipopt_s: See there [s].
        repaired_s: As many seeds with repair=True as take less, three at least [s].
        longest_s: Largest time of IPOPT's starts if they seldom hit [s].
    """

    seeds: int = 20
    most_seeds: int = 30
    solve_s: float = 20.0
    starts: int = 10
    most_starts: int = 400
    ipopt_s: float = 10.0
    repaired_s: float = 60.0
    longest_s: float = 100.0


class Wanted(NamedTuple):
    """Runs of one kind.

    Attributes:
        what: The kind.
        make: Number of a run -> the run.
        least: How many.
        most: How many if `least` take less than `seconds`.
        seconds: See there [s].
    """

    what: What
    make: Callable[[int], Run]
    least: int
    most: int
    seconds: float


def wanted(
    one: Shipped, log: Log, amount: Amount, is_hit: Callable[[Run], bool]
) -> Iterator[Wanted]:
    """Yield the runs that a problem wants.

    If IPOPT's starts seldom hit, there are more of them, until they have taken twelve
    times as long as a solve: with fewer, ten times as long could not be shown if none
    hits.

    Args:
        one: The problem.
        log: Finished runs; if one of their answers violates a constraint along its
            path, runs with repair=True are added.
        amount: Numbers of runs.
        is_hit: Whether a run found the best known optimum.
    """
    alone: list[tuple[What, int]] = [("zero", 1), ("cold", COLD)]
    if one.middle is not None:
        alone.append(("middle", 1))
    if one.guess is not None:
        alone.append(("guess", 1))
    for what, many in alone:
        yield Wanted(what, partial(one.polished, what), many, many, 0.0)
    more = amount.seeds, amount.most_seeds, amount.solve_s
    yield Wanted("answer", one.answer, *more)
    answers = log.of(one.name, "answer", one.lanes)
    if any(run.feasible and not run.confirmed for run in answers):
        again = partial(one.answer, what="repaired")
        less = min(amount.seeds, _REPAIRED)
        yield Wanted("repaired", again, less, amount.seeds, amount.repaired_s)
    starts = amount.starts, amount.most_starts, amount.ipopt_s
    yield Wanted("ipopt", one.from_start, *starts)
    done = log.of(one.name, "ipopt", one.lanes)
    answers = log.of(one.name, "answer", one.lanes)
    if done and answers and sum(map(is_hit, done)) < _SELDOM * len(done):
        seconds = _AS_LONG * sum(run.wall_s for run in answers) / len(answers)
        seconds = min(seconds, amount.longest_s)
        yield Wanted("ipopt", one.from_start, 0, _MANY, seconds)


def missing(one: Shipped, log: Log, runs: Iterable[Wanted]) -> Iterator[Run]:
    """Yield the runs of a problem that are not in a log yet, as they end.

    Before them is one that makes or loads machine code, in each process anew.

    Args:
        one: The problem.
        log: Finished runs; the caller adds the yielded ones.
        runs: The runs to be made.
    """
    is_first = True
    for kind in runs:
        done = log.of(one.name, kind.what, one.lanes)
        spent = sum(run.wall_s for run in done)
        for number in range(len(done), kind.most):
            if number >= kind.least and spent >= kind.seconds:
                break
            if is_first:
                yield one.answer(len(log.of(one.name, "first", one.lanes)), "first")
                is_first = False
            run = kind.make(number)
            spent += run.wall_s
            yield run
