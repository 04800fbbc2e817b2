"""Plans that end at a fixed time: `until` of a receding horizon."""

import pickle
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss

X, U, T = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("t")


def tank(**changes: Any) -> ss.OptimalControlProblem:
    """Fill a tank to 3 after 3 s with least effort; the best inflow is constant."""
    given: dict[str, Any] = {
        "model": ss.Model(states=X, controls=U, ode=U), "horizon": 3.0, "intervals": 6,
        "stage_cost": U**2, "bounds": ss.Bounds(controls=(-5, 5)), "terminal": [(X, 3)],
    }  # fmt: skip
    return ss.OptimalControlProblem(**given | changes)


def loop_of(
    problem: ss.OptimalControlProblem, until: float | None = 3.0, **options: Any
) -> ss.RecedingHorizon:
    """Return a closed loop of IPOPT alone."""
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    return ss.RecedingHorizon(planner=planner, until=until, **options)


def simulated(loop: ss.RecedingHorizon, leak: float = 0.0) -> ss.Trajectory:
    """Return the path of a tank with a leak that the plans do not know."""
    model = ss.Model(states=X, controls=U, ode=U - leak)
    plant = ss.Plant(model, dt=loop.dt, substeps=12)
    return ss.simulate(plant, loop, [0.0], steps=100, seed=0)


@pytest.mark.parametrize("period", [None, 0.5, 0.7, 1.0, 4.0])
def test_each_plan_fills_what_is_missing_in_the_time_left(period: float | None) -> None:
    path = simulated(loop_of(tank(), period=period), leak=0.2)
    assert path.times[-1] == pytest.approx(3.0)
    begins = path.times[:-1]
    for at, level, plan in zip(begins, path.states[0], path.decisions, strict=False):
        wanted = (3 - level) / (3 - at)
        assert plan.control == pytest.approx([wanted], abs=1e-6)
        assert plan.plans[0].cost == pytest.approx(wanted**2 * (3 - at), abs=1e-5)
    assert path.states[0, -1] == pytest.approx(3 - 0.2 * np.diff(path.times)[-1])


def test_without_a_disturbance_the_first_plan_is_kept() -> None:
    """Principle of optimality: the rest of the best plan is the best of the rest."""
    cost = (X - ca.sin(2 * T)) ** 2 + 0.1 * U**2
    moving = tank(
        model=ss.Model(states=X, controls=U, ode=U, time=T), stage_cost=cost,
        intervals=30, substeps=2,
    )  # fmt: skip
    once = ss.solve(moving, [0.0], search=None, lanes=0, seed=0)
    path = simulated(loop_of(moving))
    assert path.states[0, ::10] == pytest.approx(once.states[0, ::10], abs=0.02)
    assert path.states[0, -1] == pytest.approx(3.0, abs=1e-6)


def test_plans_keep_their_length_until_the_end_is_near() -> None:
    path = simulated(loop_of(tank(horizon=1.5), until=3.0))
    lengths = [
        decision.plans[0].x0[1] for decision in path.decisions
    ]  # The state after x.
    left = 3.0 - path.times[:-1]
    assert lengths == pytest.approx(np.minimum(1.5, left))
    assert path.states[0, -1] == pytest.approx(3.0, abs=1e-6)


def test_a_loop_that_begins_later_has_less_time() -> None:
    loop, rng = loop_of(tank()), np.random.default_rng(0)
    decision = loop.decide(2.0, np.array([1.0]), None, rng=rng)
    assert decision.control == pytest.approx([2.0], abs=1e-6)
    again = pickle.loads(pickle.dumps(loop)).decide(2.0, np.array([1.0]), None, rng=rng)
    assert again.control == decision.control
    with pytest.raises(ss.InvalidProblemError, match="until 3 s has no plan at 3 s"):
        loop.decide(3.0, np.array([1.0]), None, rng=rng)


def test_linear_controls_and_members_of_an_ensemble_end_there_too() -> None:
    linear = simulated(loop_of(tank(control_shape="linear")), leak=0.2)
    assert linear.states[0, -1] == pytest.approx(2.9, abs=0.02)
    k = ca.SX.sym("k")
    uncertain = tank(
        model=ss.Model(states=X, controls=U, ode=k * U, parameters=k), terminal=[],
        terminal_cost=100 * (X - 3) ** 2,
    )  # fmt: skip
    both = ss.ensemble(uncertain, parameters={"k": [0.9, 1.1]})
    path = simulated(loop_of(both))
    assert path.times[-1] == pytest.approx(3.0)
    assert path.states[0, -1] == pytest.approx(3.0, abs=0.1)


def test_a_changed_loop_keeps_its_planner() -> None:
    loop = loop_of(tank())
    assert replace(loop, carries=False).planner is loop.planner


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"horizon": ss.Free(0.5, 3.0)}, "got a free end time"),
        (
            {"features": [ss.TransportDelay({"u": 0.5})]},
            "delays and held signals",
        ),
        ({"model": ss.Model(states=X, controls=U, next_state=X + U)}, "in discrete"),
    ],
)
def test_what_needs_equal_intervals_is_refused(
    changes: Mapping[str, Any], words: str
) -> None:
    with pytest.raises(ss.InvalidProblemError, match=words):
        loop_of(tank(**changes))


def test_a_team_and_a_c_file_refuse_it() -> None:
    loop = loop_of(tank())
    with pytest.raises(ss.InvalidProblemError, match="without until"):
        ss.Team([ss.Agent(controller=loop)])
    with pytest.raises(ss.ExportError, match="become shorter"):
        ss.export_c(loop, [0.0], name="tank", starts=0)
