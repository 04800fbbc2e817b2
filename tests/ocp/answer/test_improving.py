"""Improvement of an answer: when, how often, and which answer is kept."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.heuristics import LSHADE, Budget
from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Plan,
    Planner,
    PolishStatus,
    SearchReport,
    SearchSettings,
    Separation,
    Solution,
    SolutionStatus,
    Source,
    verified,
)
from swarmstart.ocp.answer import improving
from swarmstart.ocp.answer.improving import (
    Answer,
    Settled,
    followed_down,
    repaired,
    settled_answer,
)
from swarmstart.ocp.rollout.checking import Excess
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.search.account import Repair, Restarts

X, U = ca.SX.sym("x"), ca.SX.sym("u")


def stated(cost: ca.SX, end: ca.SX, *constraints: Any) -> OptimalControlProblem:
    """x' = u over 1 s in two intervals, |u| <= 2."""
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=U),
        horizon=1.0,
        intervals=2,
        stage_cost=cost,
        terminal_cost=end,
        bounds=Bounds(controls=(-2, 2)),
        constraints=constraints,
    )


def planner_of(problem: OptimalControlProblem, **how: Any) -> Planner:
    given = {"search": None, "polish": IpoptOptions(), "backend": "casadi", **how}
    return Planner(problem, **given)


def answered(planner: Planner, guess: float = 0.0) -> Solution:
    """Return the answer of the polish alone from equal controls."""
    plan = planner.plan(
        [0.0], guess=np.full((1, 2), guess), rng=np.random.default_rng(0)
    )
    return verified(planner.problem, plan, [0.0])


def looked_at(planner: Planner, solution: Solution) -> Solution:
    answer = Answer(solution, planner, NOTHING)
    return settled_answer(planner, answer, [0.0], NOTHING, np.random.default_rng(0))


SADDLE = stated(U**2 / 9, 4 * ca.cos(X))


def test_saddle_is_left_and_the_way_down_is_verified_and_counted() -> None:
    planner = planner_of(SADDLE)
    before = answered(planner)
    assert "saddle" in before.reason
    after = looked_at(planner, before)
    assert after.status is SolutionStatus.CONVERGED
    # With equal parts u: the minimum of u^2 / 9 + 4 cos u within |u| <= 2.
    assert after.cost == pytest.approx(4 / 9 + 4 * np.cos(2))
    assert after.plan.evaluations > before.plan.evaluations
    assert after.plan.source is before.plan.source


def test_evaluations_of_restarts_are_counted_once() -> None:
    planner = planner_of(SADDLE)
    before = answered(planner)
    rng = np.random.default_rng(0)
    plan = improving.settled(planner, before.plan, np.zeros(1), NOTHING, rng=rng).plan
    assert looked_at(planner, before).plan.evaluations == plan.evaluations


def test_descent_that_the_finer_path_does_not_confirm_is_not_taken() -> None:
    """At x = 0 the cost is 1 on any grid; two steps miss the waves elsewhere."""
    planner = planner_of(stated(ca.cos(60 * X) + U**2 / 100, ca.SX(0)))
    before = answered(planner)
    assert before.status is SolutionStatus.FEASIBLE
    after = looked_at(planner, before)
    assert after.plan is before.plan
    assert after.restarts is not None and after.restarts.better == 1


def test_only_a_stationary_answer_of_unknown_curvature_is_looked_at() -> None:
    planner = planner_of(SADDLE)
    before = answered(planner)
    sure = replace(before, status=SolutionStatus.CONVERGED)
    broken = replace(before, status=SolutionStatus.BROKEN)
    kinked = replace(before, path=replace(before.path, kinks=("fabs(x)",)))
    moving = replace(before, plan=replace(before.plan, point=None))
    for other in (sure, broken, kinked, moving):
        assert looked_at(planner, other) is other
    assert looked_at(planner_of(SADDLE, polish=None), before) is before


def test_states_of_restarts_are_those_at_the_checks_of_the_planner_that_is_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A repair may have had more checks than the user's problem."""
    planner, used = planner_of(SADDLE), planner_of(replace(SADDLE, checks=4))
    plans: list[Plan] = []

    def noted(_: Planner, plan: Plan, *__: Any, **___: Any) -> Settled:
        plans.append(plan)
        return Settled(plan, False, None)

    monkeypatch.setattr(improving, "settled", noted)
    before = answered(planner)
    rng = np.random.default_rng(0)
    settled_answer(planner, Answer(before, used, NOTHING), [0.0], NOTHING, rng)
    assert [plan.states.shape for plan in plans] == [(1, 9)]
    np.testing.assert_array_equal(plans[0].states[:, ::4], before.plan.states)


def followed(planner: Planner, solution: Solution) -> Solution:
    return followed_down(planner, solution, [0.0], NOTHING, np.random.default_rng(0))


KINKED = stated(ca.fabs(U - 1), (X - 2) ** 2 / 4)
"""Along u = 1 the modulus costs nothing; beyond, it costs more than the end gains."""


def test_kinks_are_followed_down_to_the_optimum_between_them() -> None:
    planner = planner_of(KINKED)
    plan = planner.evaluated(np.zeros((1, 2)), [0.0], source=Source.GUESS)
    stuck = verified(KINKED, replace(plan, evaluations=5), [0.0])
    found = followed(planner, stuck)
    # u = 1 all along: |u - 1| is 0 and (1 - 2)^2 / 4 is left.
    assert found.cost == pytest.approx(0.25, abs=1e-4)
    assert found.status is SolutionStatus.FEASIBLE  # Stationary when rounded only.
    assert found.plan.evaluations > 5


def test_only_kinked_and_polished_answers_are_followed_down() -> None:
    smooth = planner_of(SADDLE)
    at_saddle = answered(smooth)
    assert followed(smooth, at_saddle) is at_saddle  # It has no kinks,
    planner = planner_of(KINKED)
    plan = planner.evaluated(np.zeros((1, 2)), [0.0], source=Source.GUESS)
    stuck = verified(KINKED, plan, [0.0])
    sure = replace(stuck, status=SolutionStatus.CONVERGED)
    assert followed(planner, sure) is sure  # is sure already,
    assert followed(planner_of(KINKED, polish=None), stuck) is stuck  # or unpolished.


def test_better_answer_is_never_given_up_for_a_rounded_one() -> None:
    planner = planner_of(KINKED)
    best = planner.evaluated(np.ones((1, 2)), [0.0], source=Source.GUESS)
    solution = verified(KINKED, best, [0.0])
    assert followed(planner, solution) is solution


def test_rounding_begins_far_from_the_answer_and_goes_on_near_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[bool] = []

    class Recording(Planner):
        def plan(self, *given: Any, near: bool = False, **how: Any) -> Any:
            told.append(near)
            return super().plan(*given, near=near, **how)

    planner = planner_of(KINKED)
    plan = planner.evaluated(np.zeros((1, 2)), [0.0], source=Source.GUESS)
    stuck = verified(KINKED, plan, [0.0])
    monkeypatch.setattr(improving, "Planner", Recording)
    followed(planner, stuck)
    assert told == [False] + [True] * 4


class Rounds:
    """Records the calls of `repaired`, with prescribed answers.

    Attributes:
        planners: Planners made for the attempts.
        asked: Arguments (attempt, excesses before) of `hurried`.
        checks: Arguments of `slack_at_checks`.
        coarser: Arguments of `added`.
        shared: Arguments `for_all` of `tightened`.
        answers: Results of `verified`, one after the other.
    """

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, answers: list[Solution]
    ) -> None:
        self.planners: list[Planner] = []
        self.asked: list[tuple[int, dict[Any, float]]] = []
        self.checks: list[int] = []
        self.coarser: list[float] = []
        self.shared: list[float] = []
        self.answers = answers
        for name in ("hurried", "slack_at_checks", "added", "tightened", "Planner"):
            monkeypatch.setattr(improving, name, self._noting(name))
        monkeypatch.setattr(improving, "verified", lambda *_: self.answers.pop(0))

    def _noting(self, name: str) -> Callable[..., Any]:
        original = getattr(improving, name)

        def noted(*given: Any, **how: Any) -> Any:
            if name == "hurried":
                self.asked.append((given[2], given[1]))
            elif name == "slack_at_checks":
                self.checks.append(given[4])
            elif name == "added":
                self.coarser.append(given[3])
            elif name == "tightened":
                self.shared.append(how.get("for_all", 0.0))
            found = original(*given, **how)
            if name == "Planner":
                self.planners.append(found)
            return found

        return noted


ABOVE = stated(U**2, (X - 1) ** 2, PathConstraint(expression=X, upper=0.5, scale=2.0))


def broken(
    solution: Solution, amount: float, cost: float = 1.0, *, confirmed: bool = False
) -> Solution:
    """Return an answer that breaks the upper limit of the only row."""
    excess = Excess(
        name="row", amount=amount, scale=2.0, time=1.0, constraint=0, row=0, above=True
    )
    status = SolutionStatus.FEASIBLE if confirmed else SolutionStatus.BROKEN
    return replace(
        solution,
        status=status,
        cost=cost,
        verified_violation=excess.relative,
        path=replace(solution.path, broken=() if confirmed else (excess,)),
    )


@pytest.fixture(scope="module")
def above() -> tuple[Planner, Solution]:
    planner = planner_of(ABOVE)
    return planner, answered(planner)


def test_each_attempt_has_more_checks_and_margins_that_fall_with_their_distance(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, solution = above
    amounts = (0.4, 0.1, 0.05, 0.025)
    before, *answers = (broken(solution, amount) for amount in amounts)
    rounds = Rounds(monkeypatch, answers)
    found = repaired(
        planner, before, [0.0], NOTHING, rng=np.random.default_rng(0)
    ).solution
    assert rounds.asked == [
        (0, {}), (1, {(0, 0, True): 0.4}), (2, {(0, 0, True): 0.1})
    ]  # fmt: skip
    assert [p.problem.checks for p in rounds.planners] == [1, 2, 4]
    assert (rounds.checks, rounds.coarser) == ([1, 1, 2], [1, 1 / 2, 2 / 4])
    # What is wanted besides: 1.25 and 1.5 times, over the effect (at least 1/4) so far.
    wanted = [1.25 * 0.1 / (1 - 0.1 / 0.4), 1.5 * 0.05 / (1 - 0.05 / 0.1)]
    assert rounds.shared == pytest.approx([0, *(w / 2 / 4 for w in wanted)])
    assert found.verified_violation == pytest.approx(0.025 / 2)  # The best of them.
    assert rounds.answers == []
    tried = "solved again 3 times with up to 4 times the checks and margins on 1 row"
    assert found.repair is not None and found.repair.tried == tried
    assert not found.repair.succeeded
    assert (
        found.repair.evaluations == found.plan.evaluations - solution.plan.evaluations
    )
    assert found.reason == f"{solution.reason}; {tried}, in vain"
    assert found.advice == (
        "use more intervals (4), or leave more room than 0.025 at row"
    )


def test_margin_for_all_rows_is_that_of_the_row_that_breaks_most(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, solution = above

    def twice(amount: float) -> Solution:
        one = broken(solution, amount)
        (excess,) = one.path.broken
        other = replace(excess, amount=amount / 10, scale=0.1, above=False)
        return replace(one, path=replace(one.path, broken=(excess, other)))

    rounds = Rounds(monkeypatch, [twice(0.2), twice(0.1), twice(0.05)])
    rng = np.random.default_rng(0)
    repaired(planner, twice(0.4), [0.0], NOTHING, rng=rng)
    # Relative to their scales they are broken by 0.1 and 0.2 in the second attempt.
    first, second = 1.25 * 0.02 / (1 - 0.5), 1.5 * 0.01 / (1 - 0.5)
    assert rounds.shared == pytest.approx([0, first / 0.1 / 4, second / 0.1 / 4])


def test_attempts_are_counted_with_their_largest_margins_and_checks(
    monkeypatch: pytest.MonkeyPatch, above: tuple[Planner, Solution]
) -> None:
    """The first one of segments is solved as points, without margins."""
    planner = planner_of(stated(U**2, (X - 1) ** 2, APART))
    solution = answered(planner)
    last = broken(solution, 0, confirmed=True)
    evaluations = solution.plan.evaluations + 7
    last = replace(last, plan=replace(last.plan, evaluations=evaluations))
    Rounds(monkeypatch, [broken(solution, 0.4), broken(solution, 0.2), last])
    before = broken(solution, 0.4)
    found = repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert found.solution.repair == Repair(
        attempts=3, checks=2, margins=1, evaluations=7, seconds=0.0, succeeded=True
    )
    assert found.solution.reason == last.reason


def costly(
    monkeypatch: pytest.MonkeyPatch,
    answers: list[Solution],
    solution: Solution,
    **how: Any,
) -> tuple[Rounds, Answer]:
    """Return the repair of an answer of cost 1 that breaks its row, with answers."""
    planner = planner_of(ABOVE, **how)
    rounds = Rounds(monkeypatch, answers)
    before = broken(solution, 0.4, cost=1.0)
    before = replace(before, plan=replace(before.plan, cost=1.0))
    rng = np.random.default_rng(0)
    return rounds, repaired(planner, before, [0.0], NOTHING, rng=rng)


def confirmed(solution: Solution, cost: float, size: float = 1.0) -> Solution:
    """Return a confirmed answer of some cost, whose parts have the size `size`."""
    good = broken(solution, 0.0, cost=cost, confirmed=True)
    path = replace(good.path, magnitude=size)
    return replace(good, path=path, plan=replace(good.plan, cost=cost))


@pytest.mark.parametrize(
    ("higher", "size", "is_replaced"),
    [(0.9e-4, 1.0, False), (1.1e-4, 1.0, True), (1.1e-4, 2.0, False)],
)
def test_margins_that_cost_a_ten_thousandth_are_replaced_by_checks(
    above: tuple[Planner, Solution],
    monkeypatch: pytest.MonkeyPatch,
    higher: float,
    size: float,
    is_replaced: bool,
) -> None:
    _, solution = above
    answers = [confirmed(solution, 1.0 + higher, size), confirmed(solution, 1.0, size)]
    rounds, found = costly(monkeypatch, answers, solution)
    assert [p.problem.checks for p in rounds.planners] == [1, 4][: 1 + is_replaced]
    assert found.solution.plan.cost == (1.0 if is_replaced else 1.0 + higher)
    assert found.planner is rounds.planners[-1]


def test_without_a_polish_margins_are_not_replaced_by_checks(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, solution = above
    answers = [confirmed(solution, 1.5), confirmed(solution, 1.0)]
    rounds, found = costly(monkeypatch, answers, solution, polish=None)
    assert len(rounds.planners) == 1
    assert found.solution.plan.cost == 1.5


@pytest.mark.parametrize(("saved", "goes_on"), [(14.5e-4, False), (15.5e-4, True)])
def test_checks_replace_margins_while_a_fifteenth_of_what_they_save_is_noticed(
    above: tuple[Planner, Solution],
    monkeypatch: pytest.MonkeyPatch,
    saved: float,
    goes_on: bool,
) -> None:
    """Margins fall to a sixteenth, so a fifteenth of what was saved is still left."""
    _, solution = above
    costs = [1.1, 1.1 - saved, 1.1 - saved - 1e-5]
    answers = [confirmed(solution, cost) for cost in costs]
    rounds, found = costly(monkeypatch, answers, solution)
    assert [p.problem.checks for p in rounds.planners] == [1, 4, 16][: 2 + goes_on]
    assert found.solution.plan.cost == costs[1 + goes_on]
    assert found.solution.repair == Repair(
        attempts=2 + goes_on,
        checks=16 if goes_on else 4,
        margins=1,
        evaluations=0,
        seconds=0.0,
        succeeded=True,
    )
    # Each time with four times the checks, margins need a sixteenth of the room.
    assert rounds.coarser == [1.0, 1 / 4, 1 / 4][: 2 + goes_on]


def test_checks_stay_as_they_are_until_an_answer_with_them_is_confirmed(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, solution = above
    answers = [confirmed(solution, 2.0), *[broken(solution, 0.1) for _ in range(3)]]
    rounds, found = costly(monkeypatch, answers, solution)
    assert [p.problem.checks for p in rounds.planners] == [1, 4, 4, 4]
    assert rounds.coarser == [1.0, 1 / 4, 1.0, 1.0]
    assert found.solution.plan.cost == 2.0


def test_checks_are_added_while_the_states_at_all_of_them_are_not_too_many(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two intervals with 4 checks have 8 states, with 16 checks 32."""
    _, solution = above
    for most, checks in ((7, [1]), (8, [1, 4]), (32, [1, 4, 16])):
        monkeypatch.setattr(improving, "_MOST_STATES", most)
        answers = [confirmed(solution, cost) for cost in (4.0, 3.0, 3.0)]
        rounds, _ = costly(monkeypatch, answers, solution)
        assert [p.problem.checks for p in rounds.planners] == checks
    monkeypatch.undo()
    x = ca.SX.sym("x", 2)
    problem = replace(
        ABOVE,
        model=Model(states=x, controls=U, ode=ca.vertcat(x[1], U)),
        terminal_cost=ca.SX(0),
        stage_cost=ca.SX(0),
        constraints=[],
        intervals=5,
        checks=2,
    )
    small = [improving._is_small(problem, factor) for factor in (249, 250, 251)]
    assert small == [True, True, False]  # 20 states each, at most 5000.


@pytest.mark.parametrize("last", [0.1, 0.9])
def test_repair_ends_with_the_first_answer_that_breaks_nothing(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch, last: float
) -> None:
    """A confirmed answer is better, even if it is costlier."""
    planner, solution = above
    answers = [broken(solution, 0, cost=last, confirmed=True), solution]
    rounds = Rounds(monkeypatch, answers)
    before = broken(solution, 0.4, cost=0.5)
    found = repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert (found.solution.cost, len(rounds.planners)) == (last, 1)
    assert found.planner is rounds.planners[0]


def test_answer_that_breaks_more_than_before_is_not_kept(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, solution = above
    Rounds(monkeypatch, [broken(solution, 0.5 + k, cost=0.0) for k in range(3)])
    before = broken(solution, 0.4)
    found = repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert found.solution.plan is before.plan
    assert found.planner is planner
    assert found.solution.repair is not None and not found.solution.repair.succeeded


@pytest.mark.parametrize(
    "status",
    [SolutionStatus.FEASIBLE, SolutionStatus.INFEASIBLE, SolutionStatus.MISMATCH],
)
def test_margins_are_tried_only_where_they_could_help(
    above: tuple[Planner, Solution], status: SolutionStatus
) -> None:
    planner, solution = above
    before = replace(broken(solution, 0.4), status=status)
    found = repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert found == Answer(before, planner, NOTHING)


APART = Separation(relative=ca.vertcat(X - 0.5, 1), distance=0.5, along="segments")


@pytest.mark.parametrize(
    ("status", "rounds"),
    [
        (SolutionStatus.BROKEN, 1),
        (SolutionStatus.INFEASIBLE, 1),
        (SolutionStatus.MISMATCH, 0),
        (SolutionStatus.NOT_FINITE, 0),
    ],
)
def test_what_points_leave_infeasible_along_segments_is_given_margins(
    monkeypatch: pytest.MonkeyPatch, status: SolutionStatus, rounds: int
) -> None:
    planner = planner_of(stated(U**2, (X - 1) ** 2, APART))
    solution = answered(planner)
    worse = replace(broken(solution, 0.4), status=status)
    made = Rounds(monkeypatch, [worse, broken(solution, 0, confirmed=True)])
    before = broken(solution, 0.4, cost=1.0)
    repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert len(made.planners) == 1 + rounds


@pytest.mark.parametrize(
    ("costs", "kept"), [([3.0, 2.0], 2.0), ([0.9, 2.0], 0.9), ([3.0, 4.0], 1.0)]
)
def test_segments_are_first_polished_as_points_and_the_cheapest_confirmed_is_kept(
    monkeypatch: pytest.MonkeyPatch, costs: list[float], kept: float
) -> None:
    """The NLP sees points only, so it knows nothing of segments."""
    planner = planner_of(stated(U**2, (X - 1) ** 2, APART))
    solution = answered(planner)
    one, other = (broken(solution, 0, cost=c, confirmed=True) for c in costs)
    rounds = Rounds(monkeypatch, [one, other])
    before = broken(solution, 0.4, cost=1.0, confirmed=kept == 1.0)
    found = repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert [c.along for c in rounds.planners[0].problem.stated] == ["points"]  # type: ignore[attr-defined]
    assert rounds.planners[0].problem.checks == 1
    assert len(rounds.planners) == 1  # What is confirmed needs no margin.
    assert found.solution.cost == (1.0 if kept == 1.0 else costs[0])


@pytest.mark.parametrize(
    ("given", "left"),
    [
        (Budget(evaluations=20_000), Budget(evaluations=2000)),
        (Budget(evaluations=500), Budget(evaluations=400)),
        (Budget(seconds=5.0), Budget(seconds=0.5)),
        (Budget(evaluations=8000, seconds=2.0), Budget(evaluations=800, seconds=0.2)),
    ],
)
def test_search_of_an_attempt_has_a_tenth_of_the_budget(
    above: tuple[Planner, Solution],
    monkeypatch: pytest.MonkeyPatch,
    given: Budget,
    left: Budget,
) -> None:
    _, solution = above
    search = SearchSettings(algorithm=LSHADE(size=20), budget=given)
    planner = planner_of(ABOVE, search=search, polish=None)
    rounds = Rounds(monkeypatch, [broken(solution, 0, confirmed=True)])
    made: list[SearchSettings] = []

    def planned(self: Planner, *given: Any, **how: Any) -> Any:
        assert self.search is not None
        made.append(self.search)
        return solution.plan

    monkeypatch.setattr(Planner, "plan", planned)
    before = broken(solution, 0.4)
    repaired(planner, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert [s.budget for s in made] == [left]
    assert len(rounds.planners) == 1


def test_polished_attempt_is_not_searched_again_and_adds_its_effort(
    above: tuple[Planner, Solution], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, solution = above
    search = SearchSettings(algorithm=LSHADE(size=20), budget=Budget(evaluations=100))
    both = planner_of(ABOVE, search=search)
    plans: list[Plan] = []

    def noted(_: OptimalControlProblem, plan: Plan, *__: Any) -> Solution:
        plans.append(plan)
        return solution

    monkeypatch.setattr(improving, "verified", noted)
    report = SearchReport(3.0, 0.25, np.array([5.0, 3.0]))
    plan = replace(solution.plan, evaluations=7, search=report)
    before = replace(broken(solution, 0.4), plan=plan)
    found = repaired(both, before, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert found.planner.search is None
    (made,) = plans
    assert made.evaluations > 7
    assert (made.search.cost, made.search.violation) == (3.0, 0.25)
    assert made.search.history.tolist() == [5.0, 3.0]
    assert made.polish_status is PolishStatus.CONVERGED


F = ss.table([0, 0.5, 1, 2], [1, 2, 1.5, 3], "linear", name="f")


@pytest.mark.parametrize(
    ("rate", "intervals", "end", "constraints"),
    [(U * F(X), 10, 1.8, []), (U, 4, 1.0, [ca.fabs(X - 0.5037) >= 0.004])],
    ids=["table", "gap"],
)
def test_an_answer_that_is_feasible_at_the_checks_stays_feasible(
    rate: ca.SX, intervals: int, end: float, constraints: list[ca.SX]
) -> None:
    """With its kinks rounded it broke less along the path, but more at the checks."""
    problem = ss.OptimalControlProblem(
        Model(states=X, controls=U, ode=rate), horizon=1.0, intervals=intervals,
        stage_cost=U**2, bounds=Bounds(controls=(-5, 5)), terminal=[(X, end)],
        constraints=constraints,
    )  # fmt: skip
    answer = ss.solve(problem, [0.0], seed=0)
    assert answer.violation <= problem.tolerance
    assert answer.status is not SolutionStatus.INFEASIBLE


def test_an_answer_is_better_by_what_the_checks_say_first() -> None:
    """Neither a smaller excess nor a lower cost on the finer path outweighs them."""
    real = answered(planner_of(stated(U**2, (X - 1) ** 2)))

    def judged(violation: float, beyond: float, cost: float = 1.0) -> Solution:
        plan = replace(
            real.plan, violation=violation, cost=cost, feasible=violation < 1e-6
        )
        return replace(
            real, plan=plan, cost=cost, verified_violation=beyond,
            status=SolutionStatus.MISMATCH,
        )  # fmt: skip

    better = improving._is_better_answer
    feasible, infeasible = judged(0.0, 0.5), judged(1e-3, 0.1)
    assert better(feasible, infeasible) and not better(infeasible, feasible)
    worse = judged(2e-3, 0.01)
    assert not better(worse, infeasible) and not better(infeasible, worse)
    assert better(judged(5e-4, 0.05), infeasible)
    assert better(judged(0.0, 0.4), feasible)
    assert better(judged(0.0, 0.5, cost=0.5), feasible)


def test_account_of_starts_begins_with_nothing_and_adds_up() -> None:
    found = improving._Descended(
        better=None, evaluations=9, iterations=50, starts=3, decides=False
    )
    first = improving._counted(None, found, 2.0)
    assert first == Restarts(starts=3, iterations=50, better=0, seconds=2.0)
    assert first.seconds == 2.0
    both = improving._counted(first, found, 0.5)
    assert both == Restarts(starts=6, iterations=100, better=0, seconds=2.5)
    assert both.seconds == 2.5


def test_account_of_a_repair_is_added_once(above: tuple[Planner, Solution]) -> None:
    _, solution = above
    first, second = (
        Repair(
            attempts=n, checks=1, margins=1, evaluations=0, seconds=0.0, succeeded=True
        )
        for n in (1, 2)
    )
    assert improving._with_account(solution, None) is solution
    once = improving._with_account(solution, first)
    assert once.repair is first
    assert improving._with_account(once, second) is once
    failed = broken(solution, 0.4)
    assert improving._with_account(failed, None) is failed
    told = improving._with_account(failed, first)
    assert told.repair is first and told.reason.endswith(f"{first.tried}, in vain")
    assert "use more intervals (4)" in told.advice
