"""IPOPT from random starts: best answer within a budget, also after Ctrl-C."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import Budget
from swarmstart.ocp import (
    Bounds,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Polished,
    PolishStatus,
    Source,
    multistart,
)
from swarmstart.ocp.answer.plan import PlanningInterrupted


def two_valleys() -> Planner:
    """x' = u over 1 s from 0, in one interval: x(1) is the control."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=1,
        terminal_cost=4 * (x**2 - 1) ** 2 - x / 2,
        bounds=Bounds(controls=(-2, 2)),
    )
    return Planner(problem, search=None, polish=IpoptOptions())


def found(seed: int, budget: Budget) -> Plan:
    rng = np.random.default_rng(seed)
    return multistart(two_valleys(), [0.0], budget=budget, rng=rng)


def test_the_better_valley_is_found_from_whatever_seed() -> None:
    """The root of 16 x (x^2 - 1) = 1 / 2 that is above 1."""
    (best,) = (r.real for r in np.roots([16, 0, -16, -0.5]) if r.real > 0.5)
    for seed in range(5):
        plan = found(seed, Budget(evaluations=150))
        assert plan.controls[0, 0] == pytest.approx(best, abs=1e-6)
        assert plan.source is Source.POLISH
        assert plan.polish_status is PolishStatus.CONVERGED
        assert plan.evaluations >= 150


def test_the_same_seed_gives_the_same_bits() -> None:
    first, again = (found(3, Budget(evaluations=40)) for _ in range(2))
    np.testing.assert_array_equal(first.controls, again.controls)
    assert first.evaluations == again.evaluations


def test_a_target_ends_it_at_the_first_start_that_reaches_it() -> None:
    reached = found(0, Budget(evaluations=10_000, target=0.6))
    assert reached.cost <= 0.6 and reached.evaluations < 1000


def test_starts_without_a_better_one_end_it() -> None:
    assert found(0, Budget(evaluations=10**6, stagnation=5)).evaluations < 2000


def test_a_planner_without_a_polish_is_refused() -> None:
    planner = Planner(two_valleys().problem, search=None)
    with pytest.raises(InvalidProblemError, match="with a polish, got none"):
        multistart(
            planner, [0.0], budget=Budget(evaluations=1), rng=np.random.default_rng(0)
        )


@pytest.mark.parametrize("starts", [0, 2])
def test_an_interrupt_keeps_the_best_start(
    starts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = two_valleys()
    polish, seen = planner.polisher, list[Polished]()
    assert polish is not None

    def interrupted(*given: object, **options: object) -> Polished:
        if len(seen) == starts:
            raise KeyboardInterrupt
        seen.append(polish(*given, **options))  # type: ignore[arg-type]
        return seen[-1]

    monkeypatch.setattr(planner, "polisher", interrupted)
    rng, budget = np.random.default_rng(0), Budget(evaluations=10**6)
    if not starts:
        with pytest.raises(KeyboardInterrupt):
            multistart(planner, [0.0], budget=budget, rng=rng)
        return
    with pytest.raises(PlanningInterrupted) as told:
        multistart(planner, [0.0], budget=budget, rng=rng)
    assert told.value.partial.cost == min(one.cost for one in seen)


def test_what_is_decided_besides_controls_is_drawn_and_answered_with() -> None:
    """x' = gain u from a free start: both valleys of the end, both of the start."""
    x, u, gain = (ca.SX.sym(n) for n in ("x", "u", "gain"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=gain * u, parameters=gain),
        horizon=Free(0.5, 2.0),
        intervals=1,
        stage_cost=(u**2) / 10,
        initial_cost=4 * (x**2 - 1) ** 2 + x / 2,
        terminal_cost=4 * (x**2 - 1) ** 2 - x / 2,
        bounds=Bounds(controls=(-2, 2)),
        start={"x": Free(-2, 2)},
        decided={"gain": Free(0.5, 1.5)},
    )
    planner = Planner(problem, search=None, polish=IpoptOptions())
    rng = np.random.default_rng(0)
    plan = multistart(planner, [np.nan], budget=Budget(evaluations=500), rng=rng)
    start, end_time, factor = plan.x0
    assert start == pytest.approx(-1, abs=0.1)
    assert plan.states[0, -1] == pytest.approx(1, abs=0.1)
    assert end_time == pytest.approx(2.0, abs=1e-6)
    assert factor == pytest.approx(1.5, abs=1e-6)
    assert plan.polish_status is PolishStatus.CONVERGED
