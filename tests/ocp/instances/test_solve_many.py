"""Many instances in one call, by lanes and by the NLP solver."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import InvalidSettingsError
from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Solutions,
    SolutionStatus,
    SolveManyInterrupted,
    Source,
    solve,
    solve_many,
    verified,
)
from swarmstart.ocp.instances import in_lanes, polishing
from swarmstart.ocp.instances import solve_many as module
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.tests.ocp.instances.fakes import (
    Answer,
    FakeLanes,
    N,
    U,
    X,
    by_gains,
    double_integrator,
    parametric,
    riccati,
)
from swarmstart.tests.processes import python

UseLanes = Callable[[Answer], FakeLanes]
CONVERGED, FEASIBLE = SolutionStatus.CONVERGED, SolutionStatus.FEASIBLE
INVALID, INFEASIBLE = SolutionStatus.INVALID, SolutionStatus.INFEASIBLE
ALONE = {"search": None, "lanes": 0, "seed": 0}
ARRAYS = ("cost", "verified_cost", "violation", "excess", "controls", "states")


@pytest.fixture
def use_lanes(monkeypatch: pytest.MonkeyPatch) -> UseLanes:
    """Return a function that puts fake lanes into the place of the compiled ones."""

    def use(answer: Answer) -> FakeLanes:
        lanes = FakeLanes(answer)
        for room in (module, in_lanes):  # In the latter for limits with margins.
            monkeypatch.setattr(room, "lanes_of", lambda *given: lanes)
        return lanes

    return use


def starts(count: int, seed: int = 0) -> Array:
    """Return random initial states of two numbers."""
    return np.random.default_rng(seed).normal(size=(2, count))


def assert_same(one: Solutions, other: Solutions) -> None:
    """Compare answers bit by bit."""
    for name in (*ARRAYS, "status", "solver", "start", "attempts"):
        mine, yours = getattr(one, name), getattr(other, name)
        np.testing.assert_array_equal(mine, yours, err_msg=name)


def test_two_hundred_answers_of_lanes_are_those_of_the_riccati_equation(
    use_lanes: UseLanes,
) -> None:
    use_lanes(by_gains)
    x0s = starts(200)
    found = solve_many(double_integrator(), x0s, polish=None, seed=0, starts=1)
    assert found.counts == {FEASIBLE: 200} and set(found.solver) == {"lanes"}
    expected = np.einsum("ik,ij,jk->k", x0s, riccati()[1], x0s)
    np.testing.assert_allclose(found.cost, expected, rtol=1e-12)
    np.testing.assert_allclose(found.verified_cost, expected, rtol=1e-12)
    assert (found.iterations >= 7).all()
    K = riccati()[0][0]
    np.testing.assert_allclose(found.controls[:, 0], -K @ x0s, rtol=1e-12)


def test_two_hundred_answers_of_ipopt_are_those_of_the_riccati_equation() -> None:
    x0s = starts(200)
    found = solve_many(double_integrator(), x0s, lanes=False, seed=0)
    assert found.counts == {CONVERGED: 200} and set(found.solver) == {"ipopt"}
    expected = np.einsum("ik,ij,jk->k", x0s, riccati()[1], x0s)
    np.testing.assert_allclose(found.cost, expected, rtol=1e-7)


def test_without_lanes_each_answer_has_the_bits_of_solve() -> None:
    problem, x0s = parametric(), starts(3) / 3
    masses, winds = np.array([1.0, 2.0, 0.5]), starts(3 * (N + 1)).reshape(N + 1, -1)
    winds = winds[:, :3] / 4
    known = {"m": masses, "w": winds}
    guess = np.full((1, N), 0.3)
    found = solve_many(
        problem, x0s, known=known, guesses=guess, lanes=False, seed=0, threads=1
    )
    for k in range(3):
        own = Known([masses[k]], winds[None, :, k])
        one = solve(problem, x0s[:, k], known=own, guess=guess, **ALONE)  # type: ignore[arg-type]
        assert found.status[k] is one.status
        assert found.cost[k] == one.cost
        np.testing.assert_array_equal(found.controls[:, :, k], one.controls)
        assert found.verified_cost[k] == one.verified_cost


@pytest.mark.parametrize("known", [{"m": 2.0, "w": np.zeros(N + 1)}, None])
def test_values_for_all_are_those_of_a_known(known: dict[str, Array] | None) -> None:
    """A number, or a vector for a signal, is for all; None is refused elsewhere."""
    problem, x0s = parametric(), starts(2) / 3
    whole = Known([2.0], np.zeros((1, N + 1)))
    found = solve_many(problem, x0s, known=whole, seed=0)
    assert_same(found, solve_many(problem, x0s, known=known or whole, seed=0))


@pytest.mark.parametrize("lanes", [True, False])
def test_order_threads_and_chunks_change_no_bit(
    lanes: bool, use_lanes: UseLanes, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Some lanes break down from any start, and the NLP solver solves these.
    fake = use_lanes(lambda x, u: None if x[0] < -0.5 else by_gains(x, u))
    problem, x0s = double_integrator(), starts(12)
    first = solve_many(problem, x0s, lanes=lanes, seed=0, threads=1)
    order = np.random.default_rng(1).permutation(12)
    moved = solve_many(problem, x0s[:, order], lanes=lanes, seed=0, threads=1)
    for name in ARRAYS:
        values = getattr(first, name)[..., order]
        np.testing.assert_array_equal(getattr(moved, name), values)
    assert_same(first, solve_many(problem, x0s, lanes=lanes, seed=0, threads=2))
    monkeypatch.setattr(in_lanes, "CHUNK", 5)
    monkeypatch.setattr(polishing, "_TOGETHER", 3)
    assert_same(first, solve_many(problem, x0s, lanes=lanes, seed=0, threads=1))
    assert bool(fake.calls) == lanes
    assert set(first.solver) == ({"lanes", "ipopt"} if lanes else {"ipopt"})


def test_a_lane_that_fails_is_tried_again_from_its_neighbour(
    use_lanes: UseLanes,
) -> None:
    def answer(x0: Array, guess: Array) -> Array | None:
        return by_gains(x0, guess) if x0[0] < 1 or guess.any() else None

    seen: list[Array] = []

    def watched(x0: Array, guess: Array) -> Array | None:
        if x0[0] == 1.5:
            seen.append(guess.copy())
        return answer(x0, guess)

    fake = use_lanes(watched)
    x0s = np.array([[0.0, 0.9, 1.5, 0.5], [1.0, 0.0, 0.0, -1.0]])
    found = solve_many(double_integrator(), x0s, polish=None, seed=0, starts=1)
    assert found.start.tolist() == ["guess", "guess", "neighbour", "guess"]
    # From the nearest one, then from one that is cheaper, which changes nothing.
    assert fake.calls[0] == 4 and found.attempts[2] == 3
    np.testing.assert_array_equal(seen[0], np.zeros((1, N)))
    np.testing.assert_array_equal(seen[1], found.controls[:, :, 1])  # The nearest one.
    np.testing.assert_array_equal(found.iterations, 7 * found.attempts)


def test_after_the_nearest_neighbour_the_next_one_is_tried(
    use_lanes: UseLanes,
) -> None:
    seen: list[Array] = []

    def answer(x0: Array, guess: Array) -> Array | None:
        if x0[0] < 1:
            return by_gains(x0, guess)
        seen.append(guess.copy())
        return by_gains(x0, guess) if len(seen) == 3 else None

    use_lanes(answer)
    x0s = np.array([[0.0, 0.9, 1.5, 0.5], [1.0, 0.0, 0.0, -1.0]])
    found = solve_many(double_integrator(), x0s, polish=None, seed=0, starts=1)
    assert found.start[2] == "neighbour" and len(seen) in {3, 4}
    for guess, place in zip(seen[1:], [1, 3, 0], strict=False):
        np.testing.assert_array_equal(guess, found.controls[:, :, place])


def test_each_start_of_an_instance_is_a_lane(use_lanes: UseLanes) -> None:
    """Only the third random start of the second instance leads anywhere."""
    tried: list[Array] = []

    def answer(x0: Array, guess: Array) -> Array | None:
        if x0[0] < 1:
            return by_gains(x0, guess)
        tried.append(guess.copy())
        return by_gains(x0, guess) if len(tried) == 5 else None

    use_lanes(answer)
    x0s = np.array([[0.0, 2.0], [1.0, 0.0]])
    found = solve_many(double_integrator(), x0s, polish=None, seed=0, starts=5)
    assert found.start[1] == "guess" and found.is_confirmed.all()
    drawn = tried[2:5]
    assert all(np.ptp(one) > 0 for one in drawn)
    assert not np.array_equal(drawn[0], drawn[1])
    for one in tried[:2]:
        np.testing.assert_array_equal(one, np.zeros((1, N)))


def test_a_better_optimum_is_carried_to_neighbours() -> None:
    """Two valleys: all start in the worse one but the last, whose guess is given."""
    problem, M = valleys(), 40
    x0s = np.linspace(-0.1, 0.1, M)[None, :]
    guesses = np.full((1, 4, M), 1.0)
    guesses[:, :, -1] = -1.0
    alone = solve_many(problem, x0s, guesses=guesses, lanes=False, seed=0)
    assert (alone.states[0, -1, :-1] > 0).all() and alone.states[0, -1, -1] < 0
    found = solve_many(problem, x0s, guesses=guesses, seed=0, starts=1, polish=None)
    assert (found.states[0, -1] < 0).all() and (found.cost <= alone.cost + 1e-9).all()
    assert "neighbour" in found.start


def test_other_starts_are_tried_at_some_instances_if_they_find_nothing() -> None:
    problem = double_integrator()
    found = solve_many(problem, starts(300), polish=None, seed=0)
    assert found.sampled == 75
    assert np.sort(found.attempts).tolist() == [1] * 225 + [2] * 75
    assert "at 75 instances drawn of 300: at most 4.0%" in repr(found)
    every = solve_many(problem, starts(300), polish=None, seed=0, starts=4)
    assert every.sampled == 0 and (every.attempts == 1).all()
    np.testing.assert_allclose(every.cost, found.cost, rtol=1e-9)


def test_all_instances_that_fail_are_tried_from_other_starts(
    use_lanes: UseLanes,
) -> None:
    """No matter whether they are among those drawn."""
    use_lanes(lambda x0, guess: by_gains(x0, guess) if x0[0] < 1 else None)
    found = solve_many(double_integrator(), starts(300), polish=None, seed=0)
    failed = ~found.is_confirmed
    # Those that failed say nothing of what other starts find.
    assert 75 - failed.sum() < found.sampled < 75 and 20 < failed.sum() < 75
    # From the first start, from each neighbour and from the others.
    assert set(found.attempts[failed].tolist()) == {1 + 8 + 1}


def test_several_signals_of_each_instance_reach_the_lanes_in_their_order() -> None:
    x, u, w = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("w", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u + w[0] - 2 * w[1], signals=w), horizon=1.0,
        intervals=4, stage_cost=u**2 + x**2, bounds=Bounds(controls=(-9, 9)),
    )  # fmt: skip
    x0s, winds = starts(4)[:1], np.random.default_rng(2).normal(size=(2, 5, 4))
    known = Known(np.zeros((0, 4)), winds)
    found = solve_many(problem, x0s, known=known, seed=0)
    assert set(found.solver) == {"lanes"}
    for k in range(4):
        own = Known(signals=winds[..., k])
        one = solve(problem, x0s[:, k], known=own, **ALONE)  # type: ignore[arg-type]
        assert found.cost[k] == pytest.approx(one.cost, rel=1e-7)


def test_a_start_is_judged_by_the_signals_at_the_start() -> None:
    x, u, roof = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("roof")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4, stage_cost=u**2,
        constraints=[PathConstraint(expression=roof - x, lower=0.0)], signals=roof,
        bounds=Bounds(controls=(-9, 9)),
    )  # fmt: skip
    roofs = np.linspace([0.4, 1.0], [1.0, 0.4], 5)
    found = solve_many(problem, [[0.5, 0.5]], known={"roof": roofs}, seed=0)
    assert found.status[0] is INVALID and found.is_confirmed[1]


def test_a_valley_that_other_starts_find_at_some_instances_is_found_at_all() -> None:
    """Guesses lead all into the worse valley; neighbours are far apart."""
    problem, M = valleys(), 300
    x0s = np.linspace(-0.1, 0.1, M)[None, :]
    guesses = np.full((1, 4, M), 1.0)
    one = solve_many(problem, x0s, guesses=guesses, seed=0, starts=1, polish=None)
    assert (one.states[0, -1] > 0).all()
    found = solve_many(problem, x0s, guesses=guesses, seed=0, polish=None)
    assert (found.states[0, -1] < 0).all() and 0 < found.sampled < M
    assert (found.cost < one.cost).all()


def test_what_lanes_leave_is_solved_by_ipopt(use_lanes: UseLanes) -> None:
    use_lanes(lambda x0, u: by_gains(x0, u) if x0[0] < 1 else None)
    x0s = np.array([[0.0, 2.0], [1.0, 0.0]])
    found = solve_many(double_integrator(), x0s, seed=0)
    assert found.solver.tolist() == ["lanes", "ipopt"]
    assert found.status.tolist() == [FEASIBLE, CONVERGED]
    alone = solve(double_integrator(), x0s[:, 1], **ALONE)  # type: ignore[arg-type]
    assert found.cost[1] == alone.cost


def test_each_answer_of_lanes_is_judged_by_its_own_sizes(use_lanes: UseLanes) -> None:
    """Swings of 1 mm to 10 m, checked once a period, go 2e-4 beyond k in between."""
    k = ca.SX.sym("k")
    problem = OptimalControlProblem(
        Model(
            states=X, controls=U, ode=ca.vertcat(X[1], U - 70.2 * X[0]), parameters=k
        ),
        horizon=1.5,
        intervals=2,
        substeps=20,
        stage_cost=U**2,
        bounds=Bounds(controls=(-5, 5)),
        constraints=[PathConstraint(expression=k - X[0] ** 2, lower=0.0)],
    )
    use_lanes(lambda x0, guess: np.zeros((1, 2)))
    size = np.logspace(-3, 1, 7)
    x0s, known = np.stack([size, 0.19 * size]), {"k": 1.0001 * size**2}
    found = solve_many(problem, x0s, known=known, polish=None, seed=0, starts=1)
    for number in range(7):
        own, x0 = Known([1.0001 * size[number] ** 2]), x0s[:, number]
        planner = Planner(problem, search=None)
        plan = planner.evaluated(np.zeros((1, 2)), x0, known=own, source=Source.LANES)
        assert found.status[number] is verified(problem, plan, x0, own).status
    assert found.excess.max() > 0


def below(roof: float) -> OptimalControlProblem:
    """Return a problem that ends best at 0 with speed -1, below a roof."""
    return double_integrator(
        intervals=2,
        terminal_cost=10 * (X[0] ** 2 + (X[1] + 1) ** 2),
        constraints=[PathConstraint(expression=X[0], upper=roof, scale=1.0)],
    )


def test_an_answer_that_cuts_a_limit_between_checks_is_repaired(
    use_lanes: UseLanes,
) -> None:
    """Up at 0.6 m/s, and back at 0 after half a second: 0.075 m in between."""
    use_lanes(lambda x0, guess: np.array([[-2.4, -0.8]]))
    alone = solve_many(below(0.05), [[0.0], [0.6]], seed=0, polish=None)
    assert alone.status[0] is SolutionStatus.BROKEN
    assert alone.excess[0] == pytest.approx(0.025, rel=0.01)
    found = solve_many(below(0.05), [[0.0], [0.6]], seed=0)
    assert found.is_confirmed[0] and found.start[0] == "own answer"
    assert found.solver[0] == "ipopt" and found.excess[0] < 1e-3


def test_answers_that_cut_a_limit_are_solved_in_lanes_with_one_margin_for_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """IPOPT's local optima without any repair stand in for those of the lanes."""
    seen: list[tuple[float, int]] = []

    def lanes_of(planner: Planner, instances: Instances, threads: int) -> FakeLanes:
        del instances, threads
        (roof,) = (c.upper[0] for c in planner.problem.stated)  # type: ignore[attr-defined]
        polisher = planner.polisher
        assert polisher is not None

        def answer(x0: Array, guess: Array) -> Array:
            seen.append((float(roof), planner.problem.checks))
            return polisher(guess, x0).controls

        return FakeLanes(answer)

    for room in (module, in_lanes):
        monkeypatch.setattr(room, "lanes_of", lanes_of)
    x0s = np.array([[0.0, 0.0, 0.0, -0.5], [0.62, 0.6, 0.1, 0.0]])
    found = solve_many(below(0.08), x0s, polish=None, seed=0, starts=1)
    assert found.is_confirmed.all() and set(found.solver) == {"lanes"}
    assert found.start.tolist() == ["own answer", "own answer", "guess", "guess"]
    assert (found.attempts[:2] >= 2).all()
    assert seen[:4] == [(0.08, 1)] * 4
    roof, checks = seen[5]
    assert seen[4] == (roof, checks) and checks == 4 and 0.07 < roof < 0.08
    assert {*seen[6:]} <= {(0.08, 1), (roof, 4)}  # From neighbours.
    assert (found.excess <= 1e-4).all()
    exact = solve_many(below(0.08), x0s, lanes=False, seed=0)
    assert (found.cost >= exact.cost - 1e-6).all()
    np.testing.assert_allclose(found.cost, exact.cost, rtol=0.05)


def test_a_cheaper_answer_that_cuts_a_limit_is_not_given_up_for_a_confirmed_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first start leads below the roof, at a price; others to the optimum."""
    dear: list[float] = []

    def lanes_of(planner: Planner, instances: Instances, threads: int) -> FakeLanes:
        del instances, threads
        (roof,) = (c.upper[0] for c in planner.problem.stated)  # type: ignore[attr-defined]
        polisher = planner.polisher
        assert polisher is not None

        def answer(x0: Array, guess: Array) -> Array:
            best = polisher(guess, x0).controls
            if roof < 0.08 or dear:
                return best
            dear.append(planner.evaluated(best - 1.0, x0, source=Source.LANES).cost)
            return best - 1.0

        return FakeLanes(answer)

    for room in (module, in_lanes):
        monkeypatch.setattr(room, "lanes_of", lanes_of)
    x0s = [[0.0], [0.62]]
    first = solve_many(below(0.08), x0s, polish=None, seed=0, starts=1)
    assert first.is_confirmed.all() and first.cost.tolist() == dear
    dear.clear()
    found = solve_many(below(0.08), x0s, polish=None, seed=0)
    assert found.is_confirmed.all() and found.start[0] == "own answer"
    assert found.cost[0] < dear[0] - 0.01


def valleys() -> OptimalControlProblem:
    """Return a problem whose ends near -1 and 1 are optima; that near -1 is better."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2 / 50,
        terminal_cost=(x**2 - 1) ** 2 + x / 10,
        bounds=Bounds(controls=(-2, 2)),
    )


def test_guesses_choose_the_valley() -> None:
    guesses = np.stack([np.full((1, 4), one) for one in (1.0, -1.0)], axis=-1)
    problem = valleys()
    found = solve_many(problem, [[0.0, 0.0]], guesses=guesses, lanes=False, seed=0)
    ends = found.states[0, -1].round(2).tolist()
    assert ends == [0.98, -1.01]
    assert [float(one.states[0, -1].round(2)) for one in found] == ends


def test_each_instance_has_the_generator_of_solve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[float] = []
    improve = getattr(polishing, "improved")  # noqa: B009 - not exported

    def watched(*given: Any, rng: np.random.Generator, **named: Any) -> Any:
        drawn.append(copy.deepcopy(rng).random())
        return improve(*given, rng=rng, **named)

    monkeypatch.setattr(polishing, "improved", watched)
    solve_many(double_integrator(), starts(3), lanes=False, seed=4, threads=1)
    assert drawn == [np.random.default_rng(4).random()] * 3


def test_no_lane_shows_an_optimum_at_a_kink() -> None:
    """It is best to stay at |x - 0.3| = 0, where derivatives say nothing."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=8,
        stage_cost=u**2 / 4 + ca.fabs(x - 0.3),
        bounds=Bounds(controls=(-2, 2)),
    )
    found = solve_many(problem, [[0.3, 1.0]], seed=0, polish=None)
    assert found.solver.tolist() == ["lanes", "lanes"] and found.cost[0] < 1e-9
    assert found.status.tolist() == [FEASIBLE, FEASIBLE]


def test_maximised_cost_has_the_sign_of_the_problem(use_lanes: UseLanes) -> None:
    use_lanes(by_gains)
    x0s = starts(3)
    problem = double_integrator(
        stage_cost=-(U**2), terminal_cost=-10 * ca.sumsqr(X), maximize=True
    )
    found = solve_many(problem, x0s, seed=0, polish=None)
    expected = -np.einsum("ik,ij,jk->k", x0s, riccati()[1], x0s)
    np.testing.assert_allclose(found.cost, expected, rtol=1e-12)
    np.testing.assert_allclose(found.verified_cost, expected, rtol=1e-12)


def test_decisions_of_each_instance_are_reported() -> None:
    """Time-optimal: a quarter of a metre at most 1 m/s^2 takes 1 s, one metre 2 s."""
    problem = double_integrator(
        horizon=Free(0.3, 5, guess=1.5),
        intervals=8,
        stage_cost=1.0,
        terminal_cost=0.0,
        bounds=Bounds(controls=(-1, 1)),
        terminal=[X],
    )
    found = solve_many(problem, [[-0.25, -1.0], [0.0, 0.0]], seed=0)
    assert found.is_confirmed.all()
    np.testing.assert_allclose(found.decided["end time"], [1.0, 2.0], rtol=1e-5)
    np.testing.assert_allclose(found.cost, [1.0, 2.0], rtol=1e-5)


@pytest.mark.parametrize("lanes", [True, False])
def test_invalid_instances_are_named_and_left_out(
    lanes: bool, use_lanes: UseLanes
) -> None:
    use_lanes(by_gains)
    problem = double_integrator(bounds=Bounds(controls=(-1e3, 1e3), states=(-5, 5)))
    x0s = np.array([[0.0, np.nan, 9.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    found = solve_many(problem, x0s, lanes=lanes, seed=0)
    good = CONVERGED if not lanes else FEASIBLE
    assert found.status.tolist() == [good, INVALID, INVALID, good]
    assert "x0 must be finite" in found.invalid[1]
    assert "bound of state place is broken by 4" in found.invalid[2]
    assert np.isnan(found.cost[1:3]).all()
    assert (found.attempts > 0).tolist() == [True, False, False, True]
    assert "instance 2: its start must keep" in repr(found)
    with pytest.raises(
        InvalidProblemError, match="instance 1 has no answer: x0 must be"
    ):
        _ = found[1]


def test_strict_names_at_most_ten_invalid_instances() -> None:
    x0s = np.zeros((2, 20))
    x0s[0, 5:18] = np.nan
    with pytest.raises(InvalidProblemError) as raised:
        solve_many(double_integrator(), x0s, strict=True, seed=0)
    told = str(raised.value)
    assert told.startswith("13 of 20 instances are invalid (strict=False")
    assert "instance 5: " in told and "instance 14: " in told
    assert "instance 15" not in told and told.endswith("and 3 more")


def test_instances_that_are_all_the_same_have_the_same_answer(
    use_lanes: UseLanes,
) -> None:
    use_lanes(by_gains)
    found = solve_many(double_integrator(), [[1.0] * 3, [0.5] * 3], polish=None, seed=0)
    assert found.is_confirmed.all() and (found.cost == found.cost[0]).all()


def test_without_a_valid_instance_nothing_is_solved() -> None:
    found = solve_many(double_integrator(), [[np.nan], [0.0]], seed=0)
    assert found.counts == {INVALID: 1} and len(found) == 1


WIND = np.zeros(N + 1)
REFUSED: list[tuple[dict[str, object], str]] = [
    ({"x0s": [0.0, 0.0]}, r"x0s must have shape \(2, M\).*x_0, x_1.*got shape \(2,\)"),
    ({"x0s": np.zeros((3, 4))}, r"x0s must have shape \(2, M\).*got shape \(3, 4\)"),
    ({"x0s": np.zeros((2, 0))}, r"got shape \(2, 0\)"),
    (
        {"known": None},
        r"of a Known must have shape \(1,\) for all .* or \(1, 3\).*got \(0,\)",
    ),
    ({"known": {"m": 1}}, r"parameters \(m\) and the signals \(w\).*missing w"),
    ({"known": {"m": 1, "w": WIND, "g": 2}}, "unknown g"),
    ({"known": {"m": [1, 2], "w": WIND}}, r"parameter m must be.*\(3,\).*\(2,\)"),
    ({"known": {"m": 1, "w": WIND[1:]}}, r"signal w must have shape \(6,\).*\(5,\)"),
    ({"known": {"m": 1, "w": np.zeros((3, 6))}}, r"or \(6, 3\), got shape \(3, 6\)"),
    ({"guesses": np.zeros((1, 4))}, r"shape \(1, 5\) for all.*or \(1, 5, 3\)"),
    ({"guesses": np.zeros((1, 5, 2))}, r"got shape \(1, 5, 2\)"),
    ({"polish": None, "lanes": False}, "needs lanes or a polish"),
]


@pytest.mark.parametrize(("wrong", "told"), REFUSED)
def test_wrong_shapes_and_names_are_refused(
    wrong: dict[str, object], told: str
) -> None:
    given: dict[str, object] = {
        "x0s": np.zeros((2, 3)),
        "known": {"m": 1.0, "w": WIND},
        "seed": 0,
    }
    with pytest.raises(InvalidProblemError, match=told):
        solve_many(parametric(), **given | wrong)  # type: ignore[arg-type]


def test_a_seed_is_asked_for() -> None:
    with pytest.raises(InvalidSettingsError, match="seed"):
        solve_many(double_integrator(), [[0.0], [0.0]])


def test_a_stop_keeps_what_was_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polishing, "_TOGETHER", 2)
    told: list[tuple[int, int, str]] = []

    def stop(done: int, of: int, what: str) -> None:
        told.append((done, of, what))
        if done == 5:
            raise KeyboardInterrupt

    x0s = starts(9)
    with pytest.raises(SolveManyInterrupted) as raised:
        solve_many(
            double_integrator(),
            x0s,
            lanes=False,
            seed=0,
            threads=1,
            progress=stop,
        )
    partial = raised.value.partial
    assert partial.counts == {CONVERGED: 5, SolutionStatus.NOT_REACHED: 4}
    assert told == [(n, 9, "solving (ipopt)") for n in (1, 3, 5)]
    whole = solve_many(double_integrator(), x0s, lanes=False, seed=0)
    done = partial.is_confirmed
    np.testing.assert_array_equal(partial.cost[done], whole.cost[done])


def test_an_impossible_instance_is_tried_from_several_starts() -> None:
    problem = double_integrator(
        bounds=Bounds(controls=(-1, 1)), terminal=[X], terminal_cost=0.0
    )
    found = solve_many(problem, [[0.0, 9.0], [0.1, 0.0]], lanes=False, seed=0)
    assert found.status.tolist() == [CONVERGED, INFEASIBLE]
    assert found.attempts.tolist() == [1, 3]  # The guess, the neighbour, random.
    assert found.violation[1] > 0.1 and found.excess[1] > 0.1


def test_a_known_can_have_parameters_of_each_instance() -> None:
    problem, masses = parametric(), np.array([0.5, 1.0, 1.5])
    x0s = np.ones((2, 3))
    named = solve_many(problem, x0s, known={"m": masses, "w": WIND}, seed=0)
    known = Known(parameters=masses[None, :], signals=WIND[None, :])
    found = solve_many(problem, x0s, known=known, seed=0)
    np.testing.assert_array_equal(found.controls, named.controls)
    assert np.ptp(found.cost) > 0


def test_an_answer_that_the_finer_grid_refutes_is_polished_once_only() -> None:
    """No other start makes three steps of 1 s follow a pendulum."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0]))),
        horizon=3.0,
        intervals=3,
        substeps=1,
        stage_cost=u**2 + ca.sumsqr(x),
        bounds=Bounds(controls=(-8, 8)),
    )
    found = solve_many(problem, [[1.0, 1.2], [0.0, 0.0]], seed=0)
    assert found.status.tolist() == [SolutionStatus.MISMATCH] * 2
    # In lanes from the first start and from others, then from its own answer.
    assert found.attempts.tolist() == [3, 3]


MANY = r"""
import pathlib, re, casadi as ca, numpy as np, swarmstart as ss
x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
problem = ss.OptimalControlProblem(
    ss.Model(states=x, controls=u, ode=ca.vertcat(
        x[2], x[3], u[0] - 0.1 * x[2] ** 3, u[1] - ca.sin(x[1])
    )),
    horizon=3.0, intervals=30, stage_cost=ca.sumsqr(u) + ca.sumsqr(x),
    bounds=ss.Bounds(controls=(-2, 2)),
)
x0s = np.random.default_rng(0).uniform(-1, 1, (4, 100_000))
found = ss.solve_many(problem, x0s, seed=0, threads=1, progress=False)
# The peak of this program: ru_maxrss would count that of the process that starts it.
status = pathlib.Path("/proc/self/status").read_text()
print(found.is_confirmed.sum(), re.search(r"VmHWM:\s+(\d+) kB", status)[1])
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux")
def test_a_hundred_thousand_instances_of_four_states_fit_into_a_gigabyte() -> None:
    confirmed, kilobytes = map(int, python("-c", MANY).stdout.split())
    assert confirmed == 100_000 and kilobytes < 1e6
