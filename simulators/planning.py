"""Plans for a simulator without a formula, from its roll-outs alone.

The surrogate loop: a correction of the problem's model is fitted to roll-outs, a plan
is made with the corrected model, by a local solver from several starts and by IPOPT,
and this plan is simulated. The fit is made again with the roll-out of the plan, until
predicted and simulated costs agree and plans get no better. If the costs never agree,
or no surrogate is wanted, a population search makes the roll-outs that are left. Each
roll-out begins the simulator at the initial state, in a process; a crash, a hang or a
NaN costs that roll-out alone.

An answer is feasible at best: without derivatives of the simulator no optimum is shown.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    RNG,
    a_count,
    a_number,
    checked,
    having,
    of_kind,
    optional,
    reals,
)
from swarmstart.arrays import Array
from swarmstart.errors import Sendable
from swarmstart.heuristics import (
    Algorithm,
    Budget,
    Initial,
    InvalidBudgetError,
    feasibility_first,
    generator_of,
    minimize,
)
from swarmstart.heuristics.laws import smooth_in
from swarmstart.ocp import (
    Fitness,
    IpoptOptions,
    Known,
    OptimalControlProblem,
    Planner,
    SolutionStatus,
    Steps,
)
from swarmstart.ocp.common import (
    PROGRESS,
    ProgressCallback,
    ProgressGiven,
    shaped,
    shown,
)
from swarmstart.ocp.common.errors import refused
from swarmstart.ocp.rollout import NOTHING, SampledValue
from swarmstart.ocp.search import LANES, space_of
from swarmstart.simulators.common import SimulatorError
from swarmstart.simulators.surrogate import Correction, RollOut
from swarmstart.simulators.workers import Failure, Here, Order, Workers

_FIRST = 12
"""Number of random roll-outs from which the first surrogate is fitted."""
_NEAR = 3
"""Number of roll-outs near each plan, for the next fit."""
_SPREAD = 0.05
"""Distance of these from the plan, a fraction of the ranges of the controls."""
_REACH = 0.1
"""Distance from the path that a fit repeats, in the ranges of its states, at which a
roll-out counts half in it."""
_NARROWER = 0.7
_NARROWEST = 1 / 16
"""Spread and reach become narrower by this factor in a round without a gain; the least
that they become."""
_AGREES = 3e-3
"""Largest difference of predicted and simulated cost at which a surrogate is trusted,
relative to the simulated cost."""
_SAME = 1e-4
"""Relative gain below which a round has found nothing better."""
_PATIENCE = 15
"""Number of rounds without a gain after which the loop ends."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SurrogateRound:
    """One round of the surrogate loop.

    Attributes:
        rollouts: Number of roll-outs that the surrogate was fitted to.
        degree: Degree of its polynomials.
        error: Error of the surrogate in steps that it was not fitted to, relative to
            the change of the state in a step.
        predicted: Cost of the plan as the surrogate predicts it.
        found: Cost of the plan as it was simulated.
        violation: Violation of the plan as it was simulated.

    Example:
        >>> import swarmstart as ss
        >>> one = ss.SurrogateRound(
        ...     rollouts=12, degree=2, error=0.01, predicted=2.0, found=2.5,
        ...     violation=0.0,
        ... )
        >>> round(one.found / one.predicted - 1, 2)
        0.25
    """

    rollouts: int
    degree: int
    error: float
    predicted: float
    found: float
    violation: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SimulatedPlan:
    """The best roll-out of a simulator that was found.

    Attributes:
        times: Times of the nodes, shape (nodes,) [s].
        states: States at the nodes, shape (nx, nodes).
        controls: Controls held over the intervals, shape (nu, N).
        cost: Cost of the roll-out; the larger the better if the problem maximises.
        violation: Sum of the scaled excesses over constraints.
        status: FEASIBLE or INFEASIBLE, judged by the simulator's own steps: no
            simulation in finer steps confirms the plan.
        reason: Reason why the search ended, and what the rounds gained, in words.
        rollouts: Number of roll-outs, failed ones included.
        failures: Kind of failure -> number of roll-outs that failed so.
        rounds: Rounds of the surrogate loop.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> class Tank:
        ...     def step(self, x, u, dt):
        ...         return x + dt * (u - 0.5 * np.sqrt(x))
        >>> level, inflow = ca.SX.sym("level"), ca.SX.sym("inflow")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=level, controls=inflow, ode=inflow), horizon=2.0,
        ...     intervals=4, stage_cost=(level - 1) ** 2,
        ...     bounds=ss.Bounds(controls=(0, 2)),
        ... )
        >>> plan = ss.solve_simulated(
        ...     problem, Tank(), [0.5], rollouts=30, workers=0, seed=0
        ... )
        >>> plan.states.shape, plan.controls.shape, plan.violation, plan.failures
        ((1, 5), (1, 4), 0.0, {})
    """

    times: Array
    states: Array
    controls: Array
    cost: float
    violation: float
    status: SolutionStatus
    reason: str
    rollouts: int
    failures: Mapping[str, int]
    rounds: tuple[SurrogateRound, ...]

    def __repr__(self) -> str:
        """Return cost, status and reason in a few lines."""
        failed = ", ".join(f"{n} {kind}" for kind, n in self.failures.items())
        return "\n".join(
            [
                f"Cost {self.cost:.6g} in {self.rollouts} roll-outs: {self.reason}",
                *([f"  failed: {failed}"] if failed else []),
            ]
        )


class RollOutsInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C while roll-outs were made.

    Attributes:
        partial: The best answer so far; None if no roll-out has ended.
    """

    def __init__(self, partial: SimulatedPlan | None) -> None:
        """Keep the best answer so far."""
        super().__init__("planning was interrupted")
        self.partial = partial


class _Tried(NamedTuple):
    """A roll-out with its value.

    Attributes:
        controls: Controls held over the intervals, shape (nu, N).
        states: States at the nodes, shape (nx, nodes).
        cost: The minimised cost.
        violation: The violation.
    """

    controls: Array
    states: Array
    cost: float
    violation: float


class _RollOuts:
    """All roll-outs of a problem, and the best of them."""

    def __init__(  # noqa: PLR0913 - a problem and all that its roll-outs need
        self,
        problem: OptimalControlProblem,
        makes: Workers | Here,
        x0: Array,
        known: Known,
        *,
        tolerance: float,
        most: int,
        told: ProgressCallback,
    ) -> None:
        """Make no roll-out yet."""
        self.problem, self.x0, self.known = problem, x0, known
        self.value, self.tolerance = SampledValue(problem), tolerance
        core = self.value.problem
        self.step = core.dt / core.checks
        self.space = space_of(Fitness(problem), None)
        self.tried: list[_Tried] = []
        self.failures: Counter[str] = Counter()
        self.last_words = ""
        self._makes, self.most, self._told = makes, most, told

    @property
    def count(self) -> int:
        """Number of roll-outs so far."""
        return len(self.tried) + sum(self.failures.values())

    @property
    def left(self) -> int:
        """Number of roll-outs that are left."""
        return self.most - self.count

    @property
    def best(self) -> _Tried | None:
        """The best roll-out so far."""

        def rank(one: _Tried) -> tuple[float, float]:
            return max(one.violation - self.tolerance, 0.0), one.cost

        return min(self.tried, key=rank, default=None)

    def made(self, many: Sequence[Array]) -> list[_Tried | None]:
        """Make roll-outs of controls (nu, N); None for each that fails."""
        m = self.value.problem.checks
        orders = [Order(self.x0, np.repeat(u, m, axis=1), self.step) for u in many]
        found: list[_Tried | None] = []
        for u, states in zip(many, self._makes.results(orders), strict=True):
            one = None
            if isinstance(states, Failure):
                self.failures[states.kind] += 1
                self.last_words = states.words
            else:
                value = self.value(states, u, self.x0, self.known)
                one = _Tried(u, states, value.cost, value.violation)
                self.tried.append(one)
            found.append(one)
        self._told(self.count, self.most, "simulating")
        return found


@checked(
    refused,
    problem=of_kind(OptimalControlProblem, "an OptimalControlProblem"),
    simulator=having("step", words="an object with step(x, u, dt)"),
    x0=reals(axes=1),
    known=of_kind(Known, "Known data"),
    guess=optional(reals(axes=2)),
    rollouts=a_count(least=1),
    surrogate=FLAG,
    workers=a_count(least=0, most=1000),
    limit_s=a_number(above=0, most=1e6),
    tolerance=a_number(least=0),
    rng=optional(RNG),
    progress=PROGRESS,
)
def solve_simulated(  # noqa: PLR0913 - one call for all of it
    problem: OptimalControlProblem,
    simulator: Steps,
    x0: ArrayLike,
    *,
    known: Known = NOTHING,
    guess: Array | None = None,
    rollouts: int = 500,
    surrogate: bool = True,
    search: Algorithm | type[Algorithm] | str = "cma",
    workers: int = 1,
    limit_s: float = 60.0,
    tolerance: float = 1e-3,
    rng: np.random.Generator | None = None,
    seed: int | Sequence[int] | None = None,
    progress: ProgressGiven = True,
) -> SimulatedPlan:
    """Plan for a simulator that has no formula, by roll-outs from its start.

    Args:
        problem: Costs, constraints and bounds, with a model of the same states and
            controls, from which the surrogate begins; only the surrogate uses its
            rates. Other outputs of the simulator on which costs depend must be among
            its states.
        simulator: Object with `step(x, u, dt)`, such as an `FmuPlant`; it makes
            `problem.checks` steps in an interval.
        x0: Initial state, shape (nx,).
        known: Parameters and signals of costs and model.
        guess: Controls that are tried first, shape (nu, N); None: none.
        rollouts: Largest number of roll-outs.
        surrogate: Whether a formula is fitted to the roll-outs, and plans are made with
            it. False: the population search makes all roll-outs.
        search: Algorithm of the population search, as in `minimize`.
        workers: Number of processes; 0: roll-outs are made in this process, and a crash
            of the simulator ends it.
        limit_s: Longest wall time of a roll-out in a process [s].
        tolerance: Violation up to which a roll-out is feasible: the sum of the excesses
            over constraints, relative to their scales.
        rng: Source of all randomness; give either `rng` or `seed`.
        seed: Seed of a new generator.
        progress: As in `solve`; a function is called with (roll-outs so far,
            `rollouts`, "simulating").

    Returns:
        The best roll-out, FEASIBLE at best.

    Raises:
        InvalidProblemError: If the problem has other unknowns than held controls, a
            control is unbounded, an array has a shape that does not fit the problem, or
            the surrogate cannot correct the rates of the model.
        SimulatorError: If the simulator cannot be sent to a process, or no roll-out
            succeeds.
        RollOutsInterrupted: After Ctrl-C, with the best so far.

    Example:
        >>> import casadi as ca, numpy as np
        >>> import swarmstart as ss
        >>> class Cart:
        ...     def step(self, x, u, dt):
        ...         return x + dt * np.array([x[1], u[0] - 0.3 * x[1]])
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)), horizon=2.0,
        ...     intervals=10, stage_cost=(x[0] - 1) ** 2 + 0.1 * u**2, checks=2,
        ...     bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> found = ss.solve_simulated(
        ...     problem, Cart(), [0.0, 0.0], rollouts=40, workers=0, seed=0
        ... )
        >>> found.status.name, round(found.cost, 3), found.rollouts <= 40
        ('FEASIBLE', 0.834, True)
    """
    rng = generator_of(rng, seed)
    start, model = shaped("x0", x0, (problem.model.nx,)), problem.model
    if guess is not None:
        guess = shaped("guess", guess, (model.nu, problem.intervals))
    with ExitStack() as stack:
        told = stack.enter_context(
            shown(progress, "solve_simulated", "simulating", total=rollouts)
        )
        makes: Workers | Here = Here(simulator)
        if workers:
            several = Workers(simulator, count=workers, limit_s=limit_s)
            makes = stack.enter_context(several)
        made = _RollOuts(
            problem, makes, start, known, tolerance=tolerance, most=rollouts, told=told
        )
        rounds: list[SurrogateRound] = []
        try:
            if guess is not None:
                point = made.space.encoded(guess, start)
                made.made([made.space.decoded(point, start, known).controls])
            agrees = surrogate and _with_surrogate(made, rounds, rng)
            if made.left > 0 and not agrees:
                _with_search(made, search, rng)
        except KeyboardInterrupt:
            partial = _answer(made, rounds) if made.tried else None
            raise RollOutsInterrupted(partial) from None
    if not made.tried:
        raise SimulatorError(
            type(simulator).__name__,
            f"expected a roll-out that succeeds, found {dict(made.failures)}: "
            f"{made.last_words}",
        )
    return _answer(made, rounds)


def _with_surrogate(
    made: _RollOuts, rounds: list[SurrogateRound], rng: np.random.Generator
) -> bool:
    """Make the rounds of the surrogate loop; return whether it agrees at the end."""
    correction = Correction(made.problem, made.step)
    planner = Planner(
        correction.problem, search=None, polish=IpoptOptions(), lanes=LANES
    )
    parameters = np.asarray(made.known.parameters, dtype=np.float64).ravel()
    made.made(_drawn(made, min(_FIRST, made.left), rng))
    last, gained, narrow, near = np.inf, 0, 1.0, made.best
    while made.left > 0 and len(made.tried) > 1 and len(rounds) - gained < _PATIENCE:
        best = made.best
        if near is None or gained == len(rounds):
            near = best
        fit = correction.fitted(_weighted(made, near, narrow * _REACH), parameters)
        plan = planner.plan(
            made.x0,
            known=correction.known(made.known, fit),
            guess=best.controls if best is not None and rounds else None,
            near=bool(rounds),
            rng=rng,
        )
        count = len(made.tried)
        (tried,) = made.made([plan.controls])
        rounds.append(
            SurrogateRound(
                rollouts=count, degree=fit.degree, error=fit.error,
                predicted=float(made.problem.sense * plan.cost),
                found=np.nan if tried is None else made.problem.sense * tried.cost,
                violation=np.nan if tried is None else tried.violation,
            )
        )  # fmt: skip
        if tried is not None and _is_settled(tried, plan.cost, last, made.tolerance):
            return True
        if best is None or _is_gain(best, made.best):
            gained = len(rounds)
        else:
            narrow = max(_NARROWER * narrow, _NARROWEST)
        if tried is not None:  # The next fit repeats it: plans come nearer to another.
            last, near = tried.cost, tried
        made.made(_beside(made, best, plan.controls, narrow * _SPREAD, rng))
    return False


def _beside(
    made: _RollOuts,
    best: _Tried | None,
    controls: Array,
    spread: float,
    rng: np.random.Generator,
) -> list[Array]:
    """Return controls near the best plan; also its mean with a plan that is worse."""
    count = min(_NEAR, made.left)
    if not count:
        return []
    if best is None or made.best is not best:
        return _near(made, controls, count, spread, rng)
    between = (best.controls + controls) / 2
    return [between, *_near(made, best.controls, count - 1, spread, rng)]


def _weighted(made: _RollOuts, near: _Tried | None, reach: float) -> list[RollOut]:
    """Return all roll-outs, with the more weight the nearer they are to a given one."""
    if near is None:
        return []
    ranges = np.ptp(near.states, axis=1, keepdims=True)
    ranges = np.where(ranges > 0, ranges, 1.0)
    found = []
    for one in made.tried:
        apart = float((((one.states - near.states) / ranges) ** 2).mean())
        controls = np.repeat(one.controls, made.value.problem.checks, axis=1)
        found.append(RollOut(one.states, controls, 1 / (1 + apart / reach**2)))
    return found


def _is_settled(tried: _Tried, predicted: float, last: float, tolerance: float) -> bool:
    """Return whether a plan is as predicted, and no better than the one before."""
    size = max(abs(tried.cost), 1e-12)
    return (
        tried.violation <= tolerance
        and abs(tried.cost - predicted) <= _AGREES * size
        and abs(last - tried.cost) <= _SAME * size
    )


def _is_gain(before: _Tried, now: _Tried | None) -> bool:
    """Return whether the best has become better."""
    if now is None or now is before:
        return False
    size = max(abs(before.cost), 1e-12)
    return now.violation < before.violation or now.cost < before.cost - _SAME * size


def _drawn(made: _RollOuts, count: int, rng: np.random.Generator) -> list[Array]:
    """Return random controls that are smooth in time, each (nu, N)."""
    box = made.space.box
    points = box.lower[:, None] + box.width[:, None] * smooth_in(box, count, rng=rng)
    return [made.space.decoded(x, made.x0, made.known).controls for x in points.T]


def _near(
    made: _RollOuts,
    controls: Array,
    count: int,
    spread: float,
    rng: np.random.Generator,
) -> list[Array]:
    """Return controls near given ones, within their bounds."""
    box = made.space.box
    point = made.space.encoded(controls, made.x0)
    changes = spread * box.width * rng.standard_normal((count, box.dim))
    points = np.clip(point + changes, box.lower, box.upper)
    return [made.space.decoded(x, made.x0, made.known).controls for x in points]


def _with_search(
    made: _RollOuts,
    search: Algorithm | type[Algorithm] | str,
    rng: np.random.Generator,
) -> None:
    """Spend the roll-outs that are left on a population search, from the best."""

    def objective(points: Array) -> tuple[Array, Array]:
        many = [made.space.decoded(x, made.x0, made.known).controls for x in points.T]
        found = made.made(many)
        values = [
            (np.inf, np.inf) if r is None else (r.cost, r.violation) for r in found
        ]
        cost, violation = np.array(values).T
        return cost, violation

    best = made.best
    initial = None
    if best is not None:
        point = made.space.encoded(best.controls, made.x0)
        initial = Initial(points=point[:, None])
    try:
        minimize(
            objective, made.space.box, algorithm=search, rng=rng, initial=initial,
            budget=Budget(evaluations=made.left),
            order=feasibility_first(made.tolerance),
        )  # fmt: skip
    except InvalidBudgetError:  # Fewer are left than a generation has.
        made.made(
            _drawn(made, made.left, rng)
            if best is None
            else _near(made, best.controls, made.left, _SPREAD, rng)
        )


def _answer(made: _RollOuts, rounds: Sequence[SurrogateRound]) -> SimulatedPlan:
    """Return the best roll-out as an answer."""
    best = made.best
    if best is None:
        raise SimulatorError("the simulator", "expected a roll-out, found none")
    is_feasible = best.violation <= made.tolerance
    words = (
        "feasible; no derivatives of the simulator show an optimum"
        if is_feasible
        else f"not feasible: its violation is {best.violation:.3g}, above "
        f"{made.tolerance:g}"
    )
    if rounds:
        first, last = rounds[0], rounds[-1]
        words += (
            f"; {len(rounds)} rounds with a surrogate, from {first.found:.6g} to "
            f"{last.found:.6g} ({last.predicted:.6g} predicted)"
        )
    core = made.value.problem
    return SimulatedPlan(
        times=np.asarray(core.times),
        states=best.states,
        controls=best.controls,
        cost=float(made.problem.sense * best.cost),
        violation=best.violation,
        status=SolutionStatus.FEASIBLE if is_feasible else SolutionStatus.INFEASIBLE,
        reason=words,
        rollouts=made.count,
        failures=dict(made.failures),
        rounds=tuple(rounds),
    )
