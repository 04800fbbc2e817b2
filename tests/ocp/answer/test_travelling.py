"""Transferred warm starts: saved iterations, transferred values, and errors."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Phases,
    Solution,
    Start,
    phases,
    solve,
)
from swarmstart.ocp.nlp.polish import Polisher

X0 = np.array([1.0, 0.0])


def cart(intervals: int = 20, **more: object) -> OptimalControlProblem:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(
            states=x,
            controls=u,
            ode=ca.vertcat(x[1], u - ca.sin(x[0])),
            state_names=("angle", "rate"),
        ),
        **{
            "horizon": 3.0,
            "intervals": intervals,
            "stage_cost": ca.sumsqr(x) + 0.1 * u**2,
            "bounds": Bounds(controls=(-1, 1)),
            "constraints": [PathConstraint(expression=x[1], lower=-0.4, name="slow")],
            **more,
        },  # type: ignore[arg-type]
    )


def quickest(intervals: int = 20) -> OptimalControlProblem:
    given = cart(intervals, horizon=Free(0.5, 9.0, 2.0), stage_cost=ca.SX(1))
    return replace(given, terminal=[(given.model.states, [0.0, 0.0])])


@pytest.fixture
def iterations(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the number of IPOPT iterations of each solve."""
    found: list[int] = []
    solve_once = Polisher._solve

    def counted(self: Polisher, *given: object, **more: object) -> object:
        answer = solve_once(self, *given, **more)  # type: ignore[arg-type]
        found.append(answer.effort[0])
        return answer

    monkeypatch.setattr(Polisher, "_solve", counted)
    return found


ALONE = {"lanes": 0, "repair": False, "seed": 0}


def spent(
    iterations: list[int],
    problem: OptimalControlProblem,
    x0: object,
    guess: Start | None,
) -> tuple[Solution, int]:
    iterations.clear()
    found = solve(problem, x0, guess=guess, search=None, **ALONE)  # type: ignore[arg-type]
    return found, sum(iterations)


@pytest.mark.parametrize("pose", [cart, quickest], ids=["path", "free end"])
def test_an_answer_as_a_guess_saves_iterations_and_ends_where_a_cold_solve_does(
    pose: Callable[[int], OptimalControlProblem], iterations: list[int]
) -> None:
    """The same grid, one twice and one half as fine, and neighbouring starts."""
    first, _ = spent(iterations, pose(20), X0, None)
    moved = X0 * 1.02
    for problem, x0, most in (
        (pose(20), X0, 3),
        (pose(40), X0, 8),
        (pose(10), X0, 8),
        (pose(20), moved, 6),
    ):
        guess = first.as_guess(problem)
        warm, few = spent(iterations, problem, x0, guess)
        cold, many = spent(iterations, problem, x0, None)
        states, _ = spent(iterations, problem, x0, guess._replace(carried=None))
        assert few <= min(most, many - 2)
        assert warm.cost == pytest.approx(cold.cost, rel=1e-6)
        assert states.cost == pytest.approx(cold.cost, rel=1e-6)
        assert warm.status is cold.status


def test_a_longer_horizon_and_other_checks_take_the_multipliers_too(
    iterations: list[int],
) -> None:
    first, _ = spent(iterations, cart(), X0, None)
    for problem in (cart(horizon=3.1), cart(checks=3), cart(substeps=3)):
        _, few = spent(iterations, problem, X0, first.as_guess(problem))
        _, many = spent(iterations, problem, X0, None)
        assert few < many


def test_what_is_decided_travels_and_stays_within_its_bounds() -> None:
    first = solve(quickest(), X0, search=None, lanes=0, seed=0)
    assert first.as_guess().decided == pytest.approx(first.decided)
    shorter = replace(quickest(10), horizon=Free(0.5, 1.0, 0.7))
    guess = first.as_guess(shorter)
    found = solve(shorter, [0.1, 0.0], guess=guess, search=None, lanes=0, seed=0)
    assert 0.5 <= found.decided["end time"] <= 1.0


def test_a_searched_answer_travels_without_multipliers() -> None:
    found = solve(cart(), X0, budget=200, polish=None, seed=0)
    guess = found.as_guess(cart(10))
    assert guess.carried is None
    # Means over the new intervals: the integral is kept.
    assert guess.controls.sum() * 2 == pytest.approx(found.controls.sum())
    assert guess.states is not None
    np.testing.assert_allclose(guess.states, found.plan.states[:, ::2])


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (lambda p: replace(p, constraints=[]), "path constraints are slow, .* none"),
        (lambda p: replace(p, model=replace(p.model, state_names=("a", "rate"))),
         "states are angle, rate, .* a, rate"),
        (lambda p: replace(p, horizon=Free(1, 4, 3)), "its decisions are .* end time"),
        (lambda p: replace(p, terminal=[(p.model.states, [0, 0])]), "terminal"),
        (lambda p: replace(p, control_shape="linear"), "controls are constant.*linear"),
        (lambda p: "no problem", "problem must be None or an OptimalControlProblem"),
    ],
)  # fmt: skip
def test_another_problem_is_refused(other: object, said: str) -> None:
    found = solve(cart(4), X0, budget=100, polish=None, seed=0)
    with pytest.raises(InvalidProblemError, match=said):
        found.as_guess(other(cart(4)))  # type: ignore[operator]


def test_joined_phases_travel_to_another_grid_without_their_counted_intervals() -> None:
    def legs(intervals: int) -> Phases:
        x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0])))
        there, back = (
            OptimalControlProblem(
                model, horizon=Free(0.5, 5, 2.0), intervals=intervals,
                stage_cost=1 + 0.1 * u**2, bounds=Bounds(controls=(-2, 2)),
                terminal=[(x, end)],
            )
            for end in ([1, 0], [0, 0])
        )  # fmt: skip
        return phases([there, back])

    coarse, fine = legs(8), legs(12)
    first = solve(coarse.problem, coarse.start([0, 0]), search=None, seed=0)
    guess = first.as_guess(fine.problem)
    assert guess.states is None and guess.carried is not None
    again, cold = (
        solve(fine.problem, fine.start([0, 0]), guess=one, search=None, lanes=0, seed=0)
        for one in (guess, None)
    )
    assert again.cost == pytest.approx(cold.cost, rel=1e-6)
    assert again.plan.evaluations < cold.plan.evaluations
    assert first.as_guess().states is not None
