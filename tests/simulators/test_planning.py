"""Plans for a simulator come near the optimum of its formula, which is not known."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.ocp import Steps
from swarmstart.tests.simulators import foreign


def cart(
    rate: Callable[[ca.SX, ca.SX], ca.SX], **more: Any
) -> ss.OptimalControlProblem:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    fields: dict[str, Any] = {"bounds": ss.Bounds(controls=(-2, 2))}
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=rate(x, u)), horizon=2.0, intervals=10,
        stage_cost=(x[0] - 1) ** 2 + 0.1 * u**2, terminal_cost=x[1] ** 2, checks=2,
        substeps=5, **fields | more,
    )  # fmt: skip


def planned(x: ca.SX, u: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], u)


def true(x: ca.SX, u: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], u - 0.3 * x[1] * ca.fabs(x[1]))


def found_for(simulator: Steps, **more: Any) -> ss.SimulatedPlan:
    settings: dict[str, Any] = {"rollouts": 60, "workers": 0, "seed": 0}
    return ss.solve_simulated(
        cart(planned), simulator, [0.0, 0.0], progress=False, **settings | more
    )


def test_the_surrogate_comes_near_the_optimum_of_the_formula() -> None:
    """The simulator's own steps differ from it by less."""
    best = ss.solve(cart(true), [0.0, 0.0], seed=0, progress=False)
    assert best.status.is_confirmed
    found = found_for(foreign.Cart())
    assert found.status is ss.SolutionStatus.FEASIBLE
    assert found.cost == pytest.approx(best.cost, rel=3e-3)
    assert found.rollouts <= 40
    last = found.rounds[-1]
    assert last.predicted == pytest.approx(last.found, rel=1e-2)
    assert f"{len(found.rounds)} rounds with a surrogate" in found.reason
    assert found.controls.shape == (1, 10) and found.states.shape == (2, 21)
    # What it says of itself comes from the simulator, not from the surrogate.
    x = np.zeros(2)
    for step, u in enumerate(np.repeat(found.controls, 2, axis=1).T):
        x = foreign.Cart().step(x, u, 0.1)
        assert found.states[:, step + 1] == pytest.approx(x, abs=1e-14)


def test_the_number_of_processes_changes_no_bit() -> None:
    one, two = (found_for(foreign.Cart(), workers=n, rollouts=30) for n in (0, 2))
    assert np.array_equal(one.controls, two.controls) and one.cost == two.cost


@pytest.mark.parametrize("search", ["lshade", "cpso", "pso", "de", "jde", "cma", "ga",
                                    "random"])  # fmt: skip
def test_every_population_search_spends_the_rollouts(
    search: str, tmp_path: Path
) -> None:
    file = tmp_path / "count"
    found = found_for(
        foreign.Counted(file), surrogate=False, search=search, rollouts=80
    )
    assert len(file.read_text()) == found.rollouts <= 80
    assert found.rollouts > 40
    assert not found.rounds and "surrogate" not in found.reason
    rest = found_for(foreign.Cart(), surrogate=False, search=search, rollouts=80)
    assert rest.cost == found.cost  # The same seed.


def test_rollouts_that_end_their_process_are_counted_and_passed_by() -> None:
    """Two thirds of the range are lost; the best is among the others."""
    found = found_for(
        foreign.Brittle(), workers=1, surrogate=False, search="lshade", rollouts=60
    )
    assert found.failures["ended"] >= 3
    assert 30 <= found.rollouts <= 60  # Whole generations.
    assert np.abs(found.states[1]).max() < 1.5
    assert "ended" in repr(found)


def test_a_simulator_that_always_fails_is_said() -> None:
    class Broken:
        def step(self, x: object, u: object, dt: float) -> object:
            raise ValueError("no licence")

    with pytest.raises(ss.SimulatorError, match=r"'ValueError': \d+.*no licence"):
        found_for(Broken())  # type: ignore[arg-type]


def test_a_surrogate_that_does_not_agree_leaves_the_rest_to_the_search() -> None:
    """No formula fits a simulator with a memory of its own."""

    class Moody:
        def __init__(self) -> None:
            self.count = 0

        def step(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
            self.count += 1
            kick = np.sin(37.0 * self.count**2)
            return x + dt * np.array([x[1], u[0] + 8 * kick])

    found = found_for(Moody(), rollouts=120)
    assert len(found.rounds) >= 15 and found.rollouts > 12 + 4 * len(found.rounds)


def test_a_guess_is_tried_first(tmp_path: Path) -> None:
    guess = np.full((1, 10), 0.5)
    found = found_for(
        foreign.Cart(), surrogate=False, rollouts=1, search="random", guess=guess
    )
    assert found.rollouts == 1 and np.array_equal(found.controls, guess)


def test_constraints_and_their_tolerance_decide_the_status() -> None:
    """No control reaches the end that is asked for."""
    x = ca.SX.sym("x", 2)
    far = ss.OptimalControlProblem(
        ss.Model(states=x, controls=(u := ca.SX.sym("u")), ode=planned(x, u)),
        horizon=1.0, intervals=5, stage_cost=u**2, checks=2,
        terminal=[ss.TerminalConstraint(expression=x[0], lower=5.0, upper=6.0)],
        bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    found = ss.solve_simulated(
        far, foreign.Cart(), [0.0, 0.0], rollouts=30, workers=0, seed=0,
        surrogate=False, progress=False,
    )  # fmt: skip
    assert found.status is ss.SolutionStatus.INFEASIBLE
    assert found.reason.startswith("not feasible: its violation is ")
    found = ss.solve_simulated(
        far, foreign.Cart(), [0.0, 0.0], rollouts=30, workers=0, seed=0,
        surrogate=False, progress=False, tolerance=found.violation + 1,
    )  # fmt: skip
    assert found.status is ss.SolutionStatus.FEASIBLE


def test_ctrl_c_keeps_the_best_so_far() -> None:
    def stop(done: int, of: int, what: str) -> None:
        assert (of, what) == (60, "simulating")
        if done >= 12:
            raise KeyboardInterrupt

    with pytest.raises(ss.RollOutsInterrupted) as caught:
        ss.solve_simulated(
            cart(planned), foreign.Cart(), [0.0, 0.0], rollouts=60, workers=0, seed=0,
            progress=stop,
        )  # fmt: skip
    assert caught.value.partial is not None
    assert caught.value.partial.rollouts == 12


def test_what_cannot_be_planned_for_is_refused() -> None:
    x, u, t = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("t")
    timed = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u + t, time=t), horizon=1.0, intervals=2,
        stage_cost=x**2, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip

    class Rest:
        def step(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
            return x

    with pytest.raises(ss.InvalidProblemError, match="surrogate=False searches any"):
        ss.solve_simulated(timed, Rest(), [0.0], workers=0, seed=0, progress=False)
    found = ss.solve_simulated(
        timed, Rest(), [0.0], rollouts=20, workers=0, surrogate=False, seed=0,
        progress=False,
    )  # fmt: skip
    assert found.cost == 0.0
    with pytest.raises(ss.InvalidProblemError, match="finite bounds on every control"):
        ss.solve_simulated(
            cart(planned, bounds=ss.Bounds()), foreign.Cart(), [0.0, 0.0], seed=0
        )


def test_a_feasible_roll_out_is_better_than_a_cheaper_one_that_is_not() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    asked = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=planned(x, u)), horizon=1.0, intervals=5,
        stage_cost=u**2, checks=2, bounds=ss.Bounds(controls=(-1, 1)),
        terminal=[ss.TerminalConstraint(expression=x[0], lower=0.4, upper=1.0)],
    )  # fmt: skip
    guess = np.ones((1, 5))
    found = ss.solve_simulated(
        asked, foreign.Cart(), [0.0, 0.0], rollouts=30, workers=0, seed=0, guess=guess,
        surrogate=False, search="random", progress=False,
    )  # fmt: skip
    assert found.status is ss.SolutionStatus.FEASIBLE
    assert np.array_equal(found.controls, guess)


def test_shapes_are_checked_before_a_roll_out_and_a_guess_is_clipped() -> None:
    for wrong in ({"guess": np.ones((2, 10))}, {"guess": np.ones((1, 3))}):
        with pytest.raises(
            ss.InvalidProblemError, match=r"guess must have shape \(1, "
        ):
            found_for(foreign.Cart(), **wrong)
    with pytest.raises(ss.InvalidProblemError, match=r"x0 must have shape \(2,\)"):
        ss.solve_simulated(cart(planned), foreign.Cart(), [0.0], seed=0)
    found = found_for(
        foreign.Cart(), guess=np.full((1, 10), 9.0), rollouts=1, surrogate=False,
        search="random",
    )  # fmt: skip
    assert np.array_equal(found.controls, np.full((1, 10), 2.0))


def test_whole_numbers_stay_whole() -> None:
    """Also those that are tried near a plan."""
    whole = cart(planned, bounds=ss.Bounds(controls=(-2, 2), integer=[0]))
    seen: list[np.ndarray] = []

    class Seen(foreign.Cart):
        def step(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
            seen.append(u.copy())
            return super().step(x, u, dt)

    found = ss.solve_simulated(
        whole, Seen(), [0.0, 0.0], rollouts=30, workers=0, seed=0, progress=False
    )
    assert np.array_equal(np.round(seen), seen)
    assert np.array_equal(np.round(found.controls), found.controls)


@pytest.mark.parametrize("rollouts", [1, 2, 14])
def test_fewer_roll_outs_than_a_generation_are_made_too(rollouts: int) -> None:
    for search in ("lshade", "cma"):
        found = found_for(
            foreign.Cart(), rollouts=rollouts, surrogate=False, search=search
        )
        assert 1 <= found.rollouts <= rollouts
