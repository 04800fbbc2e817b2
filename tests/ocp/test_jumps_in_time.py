"""Functions of time that jump at an interval's end have their value of before there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array

X, U, T = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("t")


def pushed(at: float, after: ca.SX | float = -1.0) -> ss.OptimalControlProblem:
    """x' = u + 3 before a time, u - 1 after it."""
    rate = U + ca.if_else(T < at, 3, after)
    return ss.OptimalControlProblem(
        ss.Model(states=X, controls=U, time=T, ode=rate), horizon=1.0, intervals=10,
        stage_cost=U**2, bounds=ss.Bounds(controls=(-5, 5)), terminal=[(X, 1)],
    )  # fmt: skip


def exact(controls: Array, at: float) -> Array:
    """x at the nodes: a straight line in every interval."""
    wind = np.where(np.arange(10) < round(10 * at), 3.0, -1.0)
    return np.append(0.0, np.cumsum(0.1 * (controls[0] + wind)))


@pytest.mark.parametrize("at", [0.1, 0.3, 0.6, 0.7])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"checks": 2, "substeps": 3},
        {"transcription": "radau"},
        {"integrator": "euler"},
        {"integrator": "stiff"},
        {"integrator": "stiff", "integrator_tolerance": 1e-6},
    ],
    ids=str,
)
def test_a_plan_is_exact_where_the_wind_turns_at_a_node(
    at: float, options: dict[str, Any]
) -> None:
    """0.3 and 0.7 are no floats, nor are three times 0.1 and 0.3 the same one."""
    problem = replace(pushed(at), **options)
    answer = ss.solve(problem, [0.0], search=None, lanes=0, seed=0)
    assert answer.status.is_confirmed, answer.reason
    found = answer.states[0, :: problem.checks]
    np.testing.assert_allclose(found, exact(answer.controls, at), atol=1e-8)
    # A mean control of 1 less the mean wind: every other plan costs more.
    mean = 1 - (3 * at - (1 - at))
    assert answer.cost == pytest.approx(mean**2, rel=1e-6)


def test_lanes_and_searches_see_the_same() -> None:
    answer = ss.solve(pushed(0.3), [0.0], seed=0, budget=2000)
    np.testing.assert_allclose(answer.states[0], exact(answer.controls, 0.3), atol=1e-8)
    searched = ss.solve(pushed(0.3), [0.0], seed=0, budget=2000, polish=None, lanes=0)
    np.testing.assert_allclose(
        searched.states[0], exact(searched.controls, 0.3), atol=1e-8
    )


def test_a_plant_turns_where_its_plans_do() -> None:
    problem = pushed(0.3)
    loop = ss.RecedingHorizon(
        planner=ss.Planner(
            replace(problem, terminal=(), terminal_cost=10 * (X - 1) ** 2),
            search=None, polish=ss.IpoptOptions(),
        )
    )  # fmt: skip
    plant = ss.Plant(problem.model, dt=0.1, substeps=3)
    run = ss.simulate(plant, loop, [0.0], steps=10, seed=0)
    np.testing.assert_allclose(run.states[0], exact(run.controls, 0.3), atol=1e-8)


def test_a_smooth_function_of_time_is_integrated_as_before() -> None:
    """x' = u + cos t: the reading inside of the steps changes nothing that counts."""
    problem = replace(pushed(0.0, ca.cos(T)), horizon=2.0, intervals=5, substeps=4)
    answer = ss.solve(problem, [0.0], search=None, lanes=0, seed=0)
    exactly = np.cumsum(0.4 * answer.controls[0]) + np.sin(0.4 * np.arange(1, 6))
    np.testing.assert_allclose(answer.states[0, 1:], exactly, atol=1e-8)
