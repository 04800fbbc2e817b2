"""Answers from many starts, and their account of the other starts."""

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import LSHADE
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Plan,
    Planner,
    SolveInterrupted,
    Source,
    solve,
)
from swarmstart.ocp.lanes.answers import Optimum, reached, unseen_share
from swarmstart.ocp.lanes.posed import NoLanesError
from swarmstart.ocp.lanes.solver import LaneSolver, random_starts
from swarmstart.ocp.nlp.watching import UNWATCHED, Unwatched, Watch
from swarmstart.ocp.rollout.fitness import Fitness
from swarmstart.ocp.search import many_starts
from swarmstart.ocp.search.account import Lanes, Origin, StartsAccount, Tried
from swarmstart.ocp.search.many_starts import agree
from swarmstart.ocp.search.start_lanes import ROUNDS
from swarmstart.ocp.search.state_guesses import state_guesses
from swarmstart.tests.ocp.lanes.problems import (
    cart,
    crossing,
    four_discs,
    pendulum,
)

pytestmark = pytest.mark.usefixtures("compiler")


def test_answer_is_no_worse_than_any_of_its_starts() -> None:
    """The lanes find what the cold start misses: 10.8186 instead of 11.4386."""
    x0 = [0.0, 0.0, 0.0]
    answer = solve(four_discs(), x0, search=None, lanes=64, repair=False, seed=0)
    account = answer.plan.starts
    assert account is not None
    assert account.lanes is not None
    feasible = [one.cost for one in account.tried if one.violation <= 1e-6]
    assert answer.cost == pytest.approx(min(feasible), rel=1e-9)
    assert answer.cost == pytest.approx(10.8186, abs=1e-4)
    cold = solve(four_discs(), x0, search=None, lanes=0, repair=False, seed=0)
    assert cold.cost > answer.cost + 0.1
    assert account.won in ("a straight way to the end", "the lanes")
    found = account.best_of("the lanes")
    assert found is not None
    assert found.cost == pytest.approx(answer.cost, rel=1e-6)
    assert sum(one.count for one in account.lanes.optima) <= account.lanes.starts
    assert account.lanes.starts - account.lanes.varied == 65
    assert account.lanes.varied in range(64, 64 * ROUNDS + 1, 64)


def test_of_equal_answers_the_cheapest_start_wins() -> None:
    """A convex problem, for which neither a search nor lanes are needed."""
    answer = solve(cart(), [0.0, 1.0], lanes=16, budget=1000, seed=0)
    account = answer.plan.starts
    assert account is not None
    assert account.won == "zero controls"
    costs = [one.cost for one in account.tried]
    assert max(costs) - min(costs) <= 1e-5 * abs(min(costs))
    assert account.lanes is not None
    assert len(account.lanes.optima) == 1


def test_seconds_until_found_are_those_of_the_parts_before() -> None:
    """The cold start solves a convex problem, but not the four discs."""
    account = solve(cart(), [0.0, 1.0], lanes=16, budget=1000, seed=0).plan.starts
    assert account is not None
    assert account.won == "zero controls"
    assert account.found_after == account.tried[0].seconds
    answer = solve(four_discs(), [0.0, 0.0, 0.0], budget=1000, lanes=64, seed=0)
    account = answer.plan.starts
    assert account is not None and account.search is not None
    assert account.lanes is not None
    before = [one for one in account.tried if one.cost > answer.cost * (1 + 1e-5)]
    assert account.tried[0] in before
    assert account.won == "the lanes"  # Which are before the search.
    cold = sum(one.seconds for one in account.tried[:2])
    assert account.tried[0].origin == "a straight way to the end"
    assert account.tried[1] in before
    least = account.lanes.seconds + cold
    assert least < account.found_after <= least + account.polish.seconds
    found = next(one for one in account.tried if one.origin == "the search")
    late = replace(account, tried=(*account.tried[:2], replace(found, cost=0.0)))
    least += account.search.seconds + found.seconds
    assert late.found_after == pytest.approx(least)


def test_guess_that_is_best_wins() -> None:
    """A valley that only a random start reaches: lanes have one."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=4, stage_cost=1e-3 * u**2,
        terminal_cost=1 - 0.1 * x**2 - 5 * ca.exp(-200 * (x - 0.95) ** 2),
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    guess = np.full((1, 4), 0.94)
    answer = solve(problem, [0.0], search=None, lanes=1, guess=guess, seed=0)
    assert answer.plan.starts is not None
    assert answer.plan.starts.won in ("the guess", "the lanes")
    assert answer.cost < -4
    found = answer.plan.starts.best_of("the guess")
    assert found is not None
    assert found.cost == pytest.approx(answer.cost, rel=1e-6)


def test_cold_starts_begin_with_what_is_known_and_most_likely_feasible() -> None:
    guess = np.full((1, 50), 0.1)
    answer = solve(pendulum(), [0.0, 0.0], search=None, lanes=4, guess=guess, seed=0)
    assert answer.plan.starts is not None
    origins = [one.origin for one in answer.plan.starts.tried]
    assert origins[:3] == ["the guess", "a straight way to the end", "zero controls"]


def test_summary_says_what_starts_led_to() -> None:
    answer = solve(pendulum(), [0.0, 0.0], search=None, lanes=16, seed=0)
    said = str(answer)
    assert 31 <= sum(one.count for one in answer.optima) <= 33
    assert answer.optima[0].count >= 17
    assert answer.optima[0].cost == pytest.approx(36.7126, abs=1e-3)
    assert "  won         zero controls" in said
    cold = "a straight way to the end 36.71264; zero controls 36.71264"
    assert f"  polished    {cold}; the lanes 36.71264" in said
    assert "  lanes       33 starts, 16 of them variations: 36.712" in said
    last = said.splitlines()[-1]
    assert last.endswith("at most 18% of such starts end in others (95% interval)")
    assert len(last) <= 150


def test_reason_is_said_where_lanes_do_not_serve() -> None:
    answer = solve(cart(blocks=[25, 25]), [0.0, 1.0], search=None, lanes=16, seed=0)
    assert answer.plan.starts is not None
    assert answer.plan.starts.lanes is None
    assert "lanes       none: it has blocks of intervals" in str(answer)
    assert answer.status.is_confirmed


def test_gains_are_told_as_gains() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=5, stage_cost=2.5 - u**2, maximize=True,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    answer = solve(problem, [0.0], search=None, lanes=4, seed=0)
    assert answer.cost == pytest.approx(2.5)
    assert answer.optima[0].cost == pytest.approx(2.5)
    assert "polished    zero controls 2.5" in str(answer)


def test_same_seed_gives_the_same_answer() -> None:
    one, two = (
        solve(four_discs(), [0.0, 0.0, 0.0], budget=500, lanes=32, seed=3)
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.controls, two.controls)
    assert one.plan.starts == two.plan.starts


def test_without_lanes_nothing_is_told_of_starts() -> None:
    answer = solve(cart(), [0.0, 1.0], search=None, lanes=0, seed=0)
    assert answer.plan.starts is None and answer.optima == ()
    assert "lanes" not in str(answer)


@pytest.mark.parametrize("lanes", [-1, 1.5])
def test_lanes_must_be_a_positive_whole_number(lanes: float) -> None:
    with pytest.raises(InvalidProblemError, match="lanes must be None or an integer"):
        solve(cart(), [0.0, 1.0], lanes=lanes, seed=0)  # type: ignore[arg-type]


def test_lanes_want_a_polish() -> None:
    with pytest.raises(InvalidProblemError, match="lanes need a polish"):
        solve(cart(), [0.0, 1.0], lanes=4, polish=None, seed=0)


def test_start_that_breaks_down_leaves_the_others() -> None:
    """From most starts the state explodes; zero controls keep it finite."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=x**3 + 4 * u),
        horizon=2.0, intervals=20, stage_cost=x**2 + u**2,
        constraints=[PathConstraint(expression=x, upper=3.0)],
        bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    answer = solve(problem, [0.1], search=None, lanes=32, seed=0)
    assert answer.status.is_confirmed
    assert answer.plan.starts is not None


def test_search_that_is_stopped_leaves_its_plan_if_the_cold_starts_are_worse(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One iteration from zero controls ends inside a disc; some individuals do not."""
    told: list[int] = []

    def refused(*_: object, **__: object) -> None:
        raise NoLanesError("refused")

    monkeypatch.setattr(many_starts, "LaneSolver", refused)

    def stop(done: int, of: int, what: str) -> None:
        if what == "searching":
            told.append(done)
            if len(told) == 4:
                raise KeyboardInterrupt

    with pytest.raises(SolveInterrupted) as stopped:
        solve(
            four_discs(), [0.0, 0.0, 0.0], polish=IpoptOptions(max_iterations=1),
            search=LSHADE(size=40), seed=0, progress=stop,
        )  # fmt: skip
    plan = stopped.value.partial.plan
    assert plan.source is Source.SEARCH
    account = plan.starts
    assert account is not None
    assert plan.violation < min(one.violation for one in account.tried)
    assert account.lines()[2] == "  lanes       none: refused"


def test_nothing_is_called_needless_where_there_is_no_answer() -> None:
    """From 0 to 5 in one second, at a speed of at most 1."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=5, stage_cost=u**2, terminal=[(x, 5.0)],
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    said = str(solve(problem, [0.0], budget=400, lanes=8, seed=0))
    assert "zero controls infeasible" in said
    assert "needed" not in said


def _cold(cost: float, *, feasible: bool = True) -> Tried:
    return Tried(
        origin="zero controls", cost=cost, violation=0.0, feasible=feasible,
        iterations=9, evaluations=9, seconds=0.0,
    )  # fmt: skip


def _lanes(**counts: int) -> Lanes:
    """Return an account: names of optima are their costs, behind a letter."""
    optima = [
        Optimum(
            lane=0, cost=float(name[1:]), count=count, controls=np.zeros((1, 1)),
            states=np.zeros((1, 2)), decided=np.zeros(0),
        )
        for name, count in counts.items()
    ]  # fmt: skip
    return Lanes(
        starts=64, optima=tuple(optima), unseen=unseen_share([*counts.values()]),
        iterations=1, seconds=0.0, infeasible=0, unfinished=0, lost=0,
    )  # fmt: skip


def test_cold_starts_and_lanes_agree_on_the_cheapest_optimum() -> None:
    many = _lanes(c2=60, c3=4)
    assert agree([_cold(2.0), _cold(2.0001)], many)
    assert agree([_cold(2.0), _cold(7.0, feasible=False)], many)
    assert not agree([_cold(2.0), _cold(3.0)], many)  # The other cold start.
    assert not agree([_cold(3.0)], many)
    assert not agree([_cold(1.9)], many)  # What no lane has found.
    assert not agree([_cold(2.0, feasible=False)], many)
    assert not agree([], many) and not agree([_cold(2.0)], None)


def test_few_lanes_or_optima_found_once_do_not_agree_with_anything() -> None:
    assert agree([_cold(2.0)], _lanes(c2=30))
    assert not agree([_cold(2.0)], _lanes(c2=29))
    assert not agree([_cold(2.0)], _lanes(c2=57, c3=1, c4=1, c5=1))
    assert not agree([_cold(2.0)], _lanes())


def test_default_search_is_left_out_only_where_starts_agree() -> None:
    settled = solve(cart(), [0.0, 1.0], seed=0)
    account = settled.plan.starts
    assert account is not None and account.agree and account.search is None
    assert account.told()["agree"] is True
    said = "zero controls (the lanes agree, so that no search was made)"
    assert account.origin == said
    assert not settled.plan.search.evaluations.size
    named = solve(cart(), [0.0, 1.0], search="lshade", budget=1000, seed=0)
    account = named.plan.starts
    assert account is not None and not account.agree and account.search is not None
    open_ = solve(four_discs(), [0.0, 0.0, 0.0], budget=1000, seed=0, repair=False)
    account = open_.plan.starts
    assert account is not None and not account.agree and account.search is not None
    np.testing.assert_allclose(settled.cost, named.cost, rtol=1e-6)


def counts_of(account: StartsAccount, kinds: Sequence[Origin]) -> list[int]:
    """Return the number of polishes from each kind of start."""
    return [sum(one.origin == kind for one in account.tried) for kind in kinds]


def test_states_that_reach_the_end_are_guessed_in_lanes() -> None:
    """Half of the random starts begin there; without lanes IPOPT tries seven."""
    answer = solve(pendulum(), [0.0, 0.0], search=None, lanes=16, seed=0)
    account = answer.plan.starts
    assert account is not None and account.lanes is not None
    assert account.lanes.starts - account.lanes.varied == 1 + 16
    kinds: tuple[Origin, ...] = ("a straight way to the end", "guesses of states")
    assert counts_of(account, kinds) == [1, 0]
    left = solve(cart(blocks=[25, 25]), [0.0, 1.0], search=None, lanes=16, seed=0)
    assert left.plan.starts is not None
    assert counts_of(left.plan.starts, kinds) == [1, 7]


def test_lanes_from_states_pass_where_those_from_controls_fail() -> None:
    """Vehicles change places: half of the random controls do not let them pass."""
    problem = crossing()
    solver = LaneSolver(problem)
    rng = np.random.default_rng(0)
    x0 = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 1.0])
    controls, _ = random_starts(problem, 32, rng)
    direct = solver(x0, controls)
    bent = state_guesses(Fitness(problem), x0, Known(), 32, rng)
    nodes = np.array([one.states for one in bent])
    states = np.moveaxis(nodes, 0, -1)[:, :: problem.checks]
    through = solver(x0, np.zeros_like(controls), states=states)
    assert reached(through).sum() >= reached(direct).sum() + 8


def test_one_start_is_polished_although_the_budget_is_spent() -> None:
    """A plan without any answer could not be judged."""

    class Spent(Unwatched):
        is_over = True

    planner = Planner(
        cart(), search=None, polish=IpoptOptions(), lanes=4, watch=Spent()
    )
    plan = planner.plan([0.0, 1.0], rng=np.random.default_rng(0))
    assert plan.feasible
    assert plan.starts is not None
    assert [one.origin for one in plan.starts.tried] == ["a straight way to the end"]
    assert plan.starts.without_lanes == "the budget was spent before"


class Ended(Unwatched):
    """Observer whose budget is spent after a number of batches of lanes.

    Attributes:
        batches: Batches so far.
        answers: Number of batches before each answer so far, and its cost.
    """

    def __init__(self, most: int) -> None:
        """Keep the number."""
        self._most, self.batches = most, 0
        self.answers: list[tuple[int, float]] = []

    def counted(self, evaluations: float) -> None:
        """Count a batch."""
        assert evaluations > 0
        self.batches += 1
        self.is_over = self.batches >= self._most

    def iterated(self, evaluations: float, answer: object) -> bool:
        """Stop a solve after the last batch."""
        del evaluations, answer
        return not self.is_over

    def answered(self, answer: object, cost: float, violation: float) -> None:
        """Keep the value."""
        del answer, violation
        self.answers.append((self.batches, cost))


def past_discs(watch: Watch = UNWATCHED) -> Plan:
    """Return a plan past four discs, for which the cold starts cost too much."""
    planner = Planner(
        four_discs(), search=None, polish=IpoptOptions(), lanes=64, watch=watch
    )
    x0 = planner.posed([0.0, 0.0, 0.0])[0]
    return planner.plan(x0, rng=np.random.default_rng(0))


def test_lanes_end_with_the_budget_and_their_best_is_the_answer() -> None:
    """Lanes are 16 random controls, then 16 states that lead to the end, and so on."""
    watch = Ended(2)
    plan = past_discs(watch)
    assert plan.starts is not None and plan.starts.lanes is not None
    assert watch.batches == 2 and plan.starts.lanes.starts == 32
    assert plan.starts.won == "the lanes" and plan.starts.tried[-1].iterations == 0
    cold = [one.cost for one in plan.starts.tried if one.origin != "the lanes"]
    assert plan.feasible and plan.cost < min(cold) - 0.1
    # Lanes report after each batch, before anything of them is polished.
    found = [cost for batches, cost in watch.answers if batches]
    assert {batches for batches, _ in watch.answers} == {0, 1, 2}
    assert plan.cost == pytest.approx(min(found[:-1]), rel=1e-6)


def test_budget_that_is_not_spent_changes_no_answer() -> None:
    """Batches are solved apart, and their answers are in the order of their starts."""
    watch = Ended(1000)
    plan = past_discs(watch)
    whole = past_discs()
    assert watch.batches > 5
    assert plan.starts == whole.starts
    np.testing.assert_array_equal(plan.controls, whole.controls)
