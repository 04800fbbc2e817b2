from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import casadi as ca
import control
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.loop.plant import plant_of

INSTANTS = 20


def cart(dt: float = 0.0) -> control.StateSpace:
    system = control.ss(
        [[0, 1], [0, -0.5]], [[0], [2]], [[1, 0]], 0, states=["place", "speed"],
        inputs=["force"], outputs=["seen"],
    )  # fmt: skip
    return control.sample_system(system, dt, copy_names=True) if dt else system


def loop_of(model: ss.Model, dt: float) -> ss.RecedingHorizon:
    x, u = model.states, model.controls
    problem = ss.OptimalControlProblem(
        model, horizon=10 * dt, intervals=10, stage_cost=x[0] ** 2 + 0.1 * u**2,
        quadrature="left", bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    return ss.RecedingHorizon(planner=planner)


def flown(plant: Any, loop: ss.RecedingHorizon) -> ss.Trajectory:
    return ss.simulate(plant, loop, [1.0, 0.0], steps=INSTANTS, seed=0)


def test_a_sampled_plant_moves_as_its_model() -> None:
    system = cart(0.2)
    model = ss.Model.from_system(system)
    loop = loop_of(model, 0.2)
    theirs, ours = flown(system, loop), flown(ss.Plant(model, dt=0.2, substeps=1), loop)
    np.testing.assert_allclose(theirs.states, ours.states, atol=1e-10)
    np.testing.assert_allclose(theirs.outputs, ours.outputs, atol=1e-10)


def test_a_continuous_plant_moves_as_its_model_with_held_inputs() -> None:
    system = cart()
    model = ss.Model.from_system(system)
    loop = loop_of(model, 0.2)
    theirs = flown(system, loop)
    ours = flown(ss.Plant(model, dt=0.2, substeps=50), loop)
    np.testing.assert_allclose(theirs.states, ours.states, atol=1e-7)
    assert theirs.state_names == ("place", "speed") == ours.state_names
    assert theirs.output_names == ("seen",) == ours.output_names
    np.testing.assert_array_equal(theirs.outputs, theirs.states[:1])


def test_python_control_simulates_the_same_sampled_loop() -> None:
    """A linear law in our closed loop, and the loop closed by python-control."""
    system = cart(0.2)
    K, _, _ = control.dlqr(system, np.eye(2), np.eye(1), method="scipy")

    class Law:
        dt = 0.2

        def decide(self, time: float, state: Array, previous: Any, *, rng: Any) -> Any:
            return ss.Decision(control=-K @ state, plans=())

    ours = ss.simulate(system, Law(), [1.0, 0.0], steps=INSTANTS, seed=0)
    closed = control.ss(system.A - system.B @ K, system.B, np.eye(2), 0, 0.2)
    times = 0.2 * np.arange(INSTANTS + 1)
    theirs = control.initial_response(closed, times, [1.0, 0.0])
    np.testing.assert_allclose(ours.states, theirs.states, atol=1e-10)


def by_math(t: float, x: Any, u: Any, params: Any) -> Any:
    """A pendulum whose functions take numbers only, on a shaken pivot."""
    return [x[1], -math.sin(x[0]) + u[0] + 0.3 * math.cos(2.0 * t)]


def test_a_plant_needs_no_symbols_and_knows_the_time() -> None:
    system = control.NonlinearIOSystem(by_math, None, states=2, inputs=1, name="arm")
    x, u, t = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("t")
    shaken = -ca.sin(x[0]) + u + 0.3 * ca.cos(2.0 * t)
    real = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], shaken), time=t)
    still = ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - ca.sin(x[0])))
    loop = loop_of(still, 0.1)
    theirs, ours = flown(system, loop), flown(ss.Plant(real, dt=0.1, substeps=50), loop)
    np.testing.assert_allclose(theirs.states, ours.states, atol=1e-7)


def test_a_stiff_plant_is_integrated_implicitly() -> None:
    """x' = -1e6 (x - cos t): beyond the first moment x follows the cosine."""
    calls = []

    def rate(t: float, x: Any, u: Any, params: Any) -> Any:
        calls.append(t)
        return -1e6 * (x - math.cos(t))

    plant = plant_of(control.NonlinearIOSystem(rate, None, states=1, inputs=1), 1.0)
    after = plant(np.array([1.0]), np.array([0.0]), 0.0)
    assert after[0, -1] == pytest.approx(math.cos(1.0), abs=2e-6)
    assert len(calls) < 30_000  # The explicit method alone takes 2 million.


def test_a_plant_that_does_not_fit_is_refused() -> None:
    loop = loop_of(ss.Model.from_system(cart(0.2)), 0.2)
    with pytest.raises(
        ss.InvalidSystemError, match=r"sampled with dt = 0\.1 s, the con"
    ):
        flown(cart(0.1), loop)
    with pytest.raises(ss.InvalidProblemError, match=r"x0 must have shape \(2,\)"):
        ss.simulate(cart(0.2), loop, [1.0], steps=1, seed=0)
    data = control.frd(control.tf([1], [1, 1]), np.array([1.0, 2.0]), name="data")
    with pytest.raises(ss.InvalidSystemError, match=r"'data' .* has no states"):
        flown(data, loop)


def test_a_plant_with_other_inputs_or_rates_that_are_no_numbers_is_refused() -> None:
    loop = loop_of(ss.Model.from_system(cart()), 0.2)
    two = control.ss(-np.eye(2), np.eye(2), np.eye(2), 0, name="two")
    with pytest.raises(ss.InvalidSystemError, match="'two' has 2 inputs, the"):
        flown(two, loop)
    broken = control.nlsys(
        lambda t, x, u, p: np.full(2, np.nan), None, states=2, inputs=1, name="broken"
    )
    with pytest.raises(ss.DivergedError, match=r"'broken' .* rates are not finite"):
        flown(broken, loop)


def test_a_plant_that_escapes_is_told_by_its_time() -> None:
    system = control.NonlinearIOSystem(
        lambda t, x, u, params: x**2, None, states=1, inputs=1, name="blowup"
    )
    plant = plant_of(system, 2.0)
    with pytest.raises(ss.DivergedError, match="'blowup' could not be integrated from"):
        plant(np.array([1.0]), np.array([0.0]), 0.0)


def test_a_loop_with_our_own_plant_imports_no_python_control() -> None:
    code = """
import sys, casadi as ca, swarmstart as ss
x, u = ca.SX.sym("x"), ca.SX.sym("u")
model = ss.Model(states=x, controls=u, ode=u, outputs={"double": 2 * x})
problem = ss.OptimalControlProblem(model, horizon=1.0, intervals=2, terminal_cost=x**2,
                                   bounds=ss.Bounds(controls=(-1, 1)))
planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
loop = ss.RecedingHorizon(planner=planner)
ss.simulate(ss.Plant(model, dt=0.5, substeps=1), loop, [3.0], steps=2, seed=0)
sys.exit("control" in sys.modules)
"""
    path = {"PYTHONPATH": ":".join(part for part in sys.path if part)}
    done = subprocess.run([sys.executable, "-c", code], env=path, check=False)
    assert done.returncode == 0
