"""Phases one after another, against one phase, closed forms and CasADi's Opti."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    SolutionStatus,
    phases,
    solve,
)

X, U = ca.vertcat(ca.SX.sym("x"), ca.SX.sym("v")), ca.SX.sym("u")


def cart(mass: float = 1.0) -> Model:
    return Model(states=X, controls=U, ode=ca.vertcat(X[1], U / mass))


def leg(horizon: float | Free, intervals: int, **more: object) -> OptimalControlProblem:
    stated: dict[str, object] = {
        "horizon": horizon,
        "intervals": intervals,
        "stage_cost": U**2,
        "bounds": Bounds(controls=(-4, 4)),
    }
    model = more.pop("model", None) or cart()
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def test_a_horizon_cut_in_two_has_the_optimum_of_the_whole() -> None:
    target = [(X, [1.0, 0.0])]
    whole = solve(leg(2.0, 10, terminal=target), [0.0, 0.0], search=None, seed=0)
    # Intervals of the same length as in the single phase.
    cut = phases([leg(0.8, 4), leg(1.2, 6, terminal=target)])
    for search, budget in ((None, None), ("default", 3000)):
        answer = solve(
            cut.problem, cut.start([0.0, 0.0]), search=search, budget=budget, seed=0
        )
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.cost == pytest.approx(whole.cost, rel=1e-8)
        np.testing.assert_allclose(answer.controls, whole.controls, atol=1e-5)
        np.testing.assert_allclose(answer.times, whole.times, atol=1e-9)
        np.testing.assert_allclose(answer.states[:2], whole.states, atol=1e-5)


def test_intervals_of_phases_have_their_own_lengths() -> None:
    cut = phases([leg(0.8, 2), leg(1.2, 4)])
    controls = np.array([[1.0, -2.0, 0.5, 0.0, 1.0, -1.0]])
    answer = Fitness(cut.problem)
    states = answer.states(controls, cut.start([0.3, 0.1]))
    lengths = np.array([0.4] * 2 + [0.3] * 4)
    x, v = 0.3, 0.1
    for h, u in zip(lengths, controls[0], strict=True):
        x, v = x + v * h + u * h**2 / 2, v + u * h
    np.testing.assert_allclose(states[:2, -1], [x, v], atol=1e-12)
    np.testing.assert_allclose(states[2], np.cumsum([0, *lengths]), atol=1e-12)


def test_free_phases_are_those_of_the_fastest_way() -> None:
    """Full speed up, full speed down: from rest at 0 to rest at 1 in 2 s."""
    up = leg(Free(0.1, 5.0), 3, bounds=Bounds(controls=(0, 1)), stage_cost=ca.SX(1))
    down = leg(
        Free(0.1, 5.0),
        5,
        bounds=Bounds(controls=(-1, 0)),
        stage_cost=ca.SX(1),
        terminal=[(X, [1.0, 0.0])],
    )
    both = phases([up, down])
    for search, budget in ((None, None), ("default", 6000)):
        answer = solve(
            both.problem, both.start([0, 0]), search=search, budget=budget, seed=0
        )
        assert answer.cost == pytest.approx(2.0, abs=1e-6)
        assert answer.times[-1] == pytest.approx(2.0, abs=1e-6)
        assert answer.decided == {
            "duration of phase 1": pytest.approx(1.0, abs=1e-4),
            "duration of phase 2": pytest.approx(1.0, abs=1e-4),
        }
        assert answer.status.is_confirmed


def test_linkage_and_model_change_from_phase_to_phase() -> None:
    """A stage is dropped: mass 2, then 0.5, and half of the speed is lost."""
    first = leg(1.0, 2, model=cart(2.0))
    second = leg(1.0, 2, model=cart(0.5))
    both = phases([first, second], [{"v": X[1] / 2}])
    states = Fitness(both.problem).states(np.ones((1, 4)), both.start([0.0, 1.0]))
    # v: 1 -> 1.5, halved; 0.75 -> 2.75. x: 1.25, then + 0.75 + 1.
    np.testing.assert_allclose(states[:2, 2], [1.25, 0.75], atol=1e-12)
    np.testing.assert_allclose(states[:2, -1], [3.0, 2.75], atol=1e-12)
    answer = solve(both.problem, both.start([0.0, 1.0]), search=None, seed=0)
    assert answer.cost == pytest.approx(0.0, abs=1e-12)


def test_ends_of_earlier_phases_are_kept_and_paid() -> None:
    first = leg(
        1.0, 3, terminal=[(X[0], 0.5)], terminal_cost=3 * X[1] ** 2, stage_cost=U**2
    )
    second = leg(1.0, 3, terminal=[(X, [0.0, 0.0])])
    both = phases([first, second])
    opti = ca.Opti()
    u, x = opti.variable(6), ca.MX([0.0, 0.0])
    cost = ca.MX(0)
    for k in range(6):
        h = 1 / 3
        x = ca.vertcat(x[0] + h * x[1] + h**2 / 2 * u[k], x[1] + h * u[k])
        cost += h * u[k] ** 2
        if k == 2:
            cost += 3 * x[1] ** 2
            opti.subject_to(x[0] == 0.5)
    opti.subject_to(x == 0)
    opti.subject_to(opti.bounded(-4, u, 4))
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0})
    expected = opti.solve()
    answer = solve(both.problem, both.start([0, 0]), search=None, seed=0)
    assert answer.cost == pytest.approx(float(expected.value(cost)), rel=1e-7)
    np.testing.assert_allclose(answer.controls[0], expected.value(u), atol=1e-5)
    assert answer.status is SolutionStatus.CONVERGED


def test_constraints_and_bounds_hold_in_their_phase_only() -> None:
    first = leg(1.0, 2, constraints=[PathConstraint(expression=X[0], upper=0.3)],
                bounds=Bounds(controls=(-1, 4)))  # fmt: skip
    second = leg(1.0, 2, bounds=Bounds(controls=(-4, 4), states=(-9, [9, 1.0])))
    both = phases([first, second])
    fitness, start = Fitness(both.problem), both.start([0.0, 0.0])

    def violation(*controls: float) -> float:
        return fitness.value(np.array([controls]), start)[1]

    assert violation(0, 0, 1, 1) == 0
    assert violation(0.5, 0.5, 0, 0) == 0
    assert violation(2, 2, -2, -2) > 0  # Beyond 0.3 in the first.
    assert violation(-2, 0, 0, 0) > 0  # Below -1 in the first.
    assert violation(0, 0, -2, 0) == 0
    assert violation(0, 0, 2, 1) > 0  # Faster than 1 in the second.


@pytest.mark.parametrize(
    ("stated", "linkages", "message"),
    [
        ([], [], "at least one"),
        ([leg(1.0, 1), leg(1.0, 1)], [{}, {}], "one for each of the 1 ends"),
        ([leg(1.0, 1), leg(1.0, 1)], [{"w": X[0]}], "linkages must name states"),
        ([leg(1.0, 1, signals=ca.SX.sym("s"))], [], "no signals, phase 1 has"),
        (
            [leg(1.0, 1, bounds=Bounds(controls=(0, 1), integer=[0]))],
            [],
            "no controls of whole numbers, phase 1 has",
        ),
        (
            [
                leg(1.0, 1),
                OptimalControlProblem(
                    Model(states=ca.SX.sym("w"), controls=U, ode=U),
                    horizon=1.0,
                    intervals=1,
                ),
            ],
            [],
            "state w of phase 2 must come from phase 1",
        ),
    ],
)
def test_phases_that_do_not_follow_each_other_are_refused(
    stated: list[OptimalControlProblem], linkages: list[dict[str, ca.SX]], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        phases(stated, linkages)


def test_bounds_of_states_in_one_phase_are_named_with_it() -> None:
    """Broken at the end of the first phase: reported once, for the second."""
    low = Bounds(controls=(-4, 4), states=([-9.0, -9.0], [0.3, 9.0]))
    wide = Bounds(controls=(-4, 4), states=([-9.0, -9.0], [9.0, 9.0]))
    both = phases(
        [leg(1.0, 3, bounds=wide, terminal=[(X[0], 1.0)]), leg(1.0, 3, bounds=low)]
    )
    answer = solve(both.problem, both.start([0.0, 0.0]), search=None, seed=0)
    assert answer.status is SolutionStatus.INFEASIBLE
    assert "'bounds of the states in phase 2'" in answer.reason


def test_initial_cost_of_a_later_phase_is_refused_and_not_dropped() -> None:
    with pytest.raises(InvalidProblemError, match="no initial cost, phase 2 has"):
        phases([leg(1.0, 2), leg(1.0, 2, initial_cost=X[0])])
    phases([leg(1.0, 2, initial_cost=X[0]), leg(1.0, 2)])


def test_a_phase_that_ends_at_the_value_0_is_judged_by_how_far_it_could_vary() -> None:
    """Thrown upwards, to the apex and down again: v = 0 there, up to rounding."""
    drag = Model(states=X, controls=U, ode=ca.vertcat(X[1], -1 - X[1] ** 3 + U))

    def part(end: ca.SX) -> OptimalControlProblem:
        return leg(
            Free(0.1, 5), 5, model=drag, terminal=[(end, 0)], stage_cost=1 + U**2,
            bounds=Bounds(controls=(-0.5, 0.5)),
        )  # fmt: skip

    both = phases([part(X[1]), part(X[0])])
    answer = solve(both.problem, both.start([0.0, 1.0]), seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    ends, sizes = np.abs(answer.path.states[:, -1]), answer.path.reach
    kept = int(np.argmin(np.where(sizes > 0.1, ends, np.inf)[2:])) + 2
    # The speed falls from 1 to 0 and on to its end at the ground.
    fallen = np.ptp(answer.path.states[1])
    assert ends[kept] < 1e-5 and sizes[kept] == pytest.approx(fallen, rel=1e-9)


def test_what_a_phase_keeps_is_compared_with_the_finer_path_all_the_same() -> None:
    """A fast oscillation in one step of Runge and Kutta: its end is another one."""
    swing = Model(states=X, controls=U, ode=ca.vertcat(20 * X[1], -20 * X[0] + 0 * U))
    first = leg(1.0, 2, model=swing, substeps=1, terminal_cost=X[0])
    cut = phases([first, leg(1.0, 4)])
    answer = solve(cut.problem, cut.start([1.0, 0.0]), search=None, lanes=0, seed=0)
    assert answer.status is SolutionStatus.MISMATCH
