from __future__ import annotations

import math
import warnings
from typing import Any

import casadi as ca
import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.terminal_set import sampled_lqr

EXACT = 1e-12


def matrices(seed: int, nx: int, nu: int, ny: int) -> tuple[Array, ...]:
    rng = np.random.default_rng(seed)
    shapes = ((nx, nx), (nx, nu), (ny, nx), (ny, nu))
    return tuple(
        rng.normal(size=shape) * 10.0 ** rng.integers(-3, 4) for shape in shapes
    )


def car(t: float, x: Any, u: Any, params: dict[str, float]) -> Any:
    """A bicycle model as python-control's documentation writes it, with numpy."""
    wheelbase = params.get("wheelbase", 3.0)
    steer = np.clip(u[1], -0.5, 0.5)
    return np.array(
        [np.cos(x[2]) * u[0], np.sin(x[2]) * u[0], u[0] / wheelbase * np.tan(steer)]
    )


def nonlinear(update: Any, **options: Any) -> control.NonlinearIOSystem:
    named = {"states": 1, "inputs": 1, "name": "mine", **options}
    return control.NonlinearIOSystem(update, options.pop("outfcn", None), **named)


@given(
    st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 3), st.integers(1, 3),
    st.sampled_from([0, 0.1, 7.0]),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_a_linear_system_comes_back_equal(
    seed: int, nx: int, nu: int, ny: int, dt: float
) -> None:
    A, B, C, D = matrices(seed, nx, nu, ny)
    system = control.StateSpace(
        A, B, C, D, dt, remove_useless_states=False,
        states=[f"s{i}" for i in range(nx)], inputs=[f"in{i}" for i in range(nu)],
        outputs=[f"out {i}" for i in range(ny)],
    )  # fmt: skip
    model = ss.Model.from_system(system)
    rng = np.random.default_rng(seed)
    back = model.linearised(rng.normal(size=nx), rng.normal(size=nu))
    for old, new in zip(control.ssdata(system), control.ssdata(back), strict=True):
        np.testing.assert_allclose(new, old, rtol=EXACT, atol=EXACT)
    assert back.dt == system.dt == (model.dt or 0)
    for labels in ("state_labels", "input_labels", "output_labels"):
        assert getattr(back, labels) == getattr(system, labels)


@pytest.mark.parametrize("dt", [0, 0.5])
def test_a_transfer_function_keeps_its_frequency_response(dt: float) -> None:
    system = control.tf([2.0, 1.0], [1.0, 0.3, 0.05], dt, inputs="u", outputs="y")
    model = ss.Model.from_system(system)
    assert model.control_names == ("u",) and model.output_names == ("y",)
    back = model.linearised([0, 0], [0])
    s = np.exp(0.7j) if dt else 0.7j
    assert back(s) == pytest.approx(system(s), rel=1e-12)


def test_a_transfer_matrix_is_joined_channel_by_channel_and_says_so() -> None:
    num = [[[1.0], [2.0, 1.0]], [[0.0], [3.0]]]
    den = [[[1.0, 1.0], [1.0, 2.0, 3.0]], [[1.0], [1.0, 5.0]]]
    system = control.tf(num, den, name="plant")
    with pytest.warns(ss.NonMinimalWarning, match="'plant' became 4 states"):
        model = ss.Model.from_system(system)
    assert model.state_names[0] == "y[0] of u[0][0]"
    back = model.linearised(np.zeros(4), np.zeros(2))
    np.testing.assert_allclose(back(0.3j), system(0.3j), rtol=1e-12, atol=1e-14)


def test_a_nonlinear_system_has_the_equations_of_its_functions() -> None:
    system = control.NonlinearIOSystem(
        car, None, states=3, inputs=("v", "phi"), params={"wheelbase": 2.0}
    )
    model = ss.Model.from_system(system)
    assert model.control_names == ("v", "phi")
    f = ss.ocp.right_hand_side(model)
    for x, u in [([1.0, 2.0, 0.4], [3.0, 0.2]), ([0.0, 0.0, -2.0], [5.0, 0.9])]:
        mine = np.array(f(x, u, [])).ravel()
        np.testing.assert_allclose(mine, system.dynamics(0.0, x, u), rtol=EXACT)
    own = control.linearize(system, [0, 0, 0.4], [10, 0.1])
    np.testing.assert_allclose(
        model.linearised([0, 0, 0.4], [10, 0.1]).A, own.A, atol=1e-5
    )


def test_a_system_that_depends_on_time_has_a_time() -> None:
    system = nonlinear(lambda t, x, u, p: -x * np.cos(t) + u)
    model = ss.Model.from_system(system)
    assert model.time.numel() == 1
    assert model.linearised([1.0], [0.0], time=0.5).A == pytest.approx(-math.cos(0.5))
    still = ss.Model.from_system(nonlinear(lambda t, x, u, p: -x + u))
    assert still.time.numel() == 0


def branch(t: Any, x: Any, u: Any, p: Any) -> Any:
    return u if x[0] > 0 else -u


def by_math(t: Any, x: Any, u: Any, p: Any) -> Any:
    return [math.sin(x[0]) + u[0]]


def by_floats(t: Any, x: Any, u: Any, p: Any) -> Any:
    rate = np.zeros(1)
    rate[0] = -x[0]
    return rate


def hidden(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Python's max turns the NaN of a symbol into its other argument."""
    return [max(-0.5, float(x[0])) + u[0]]


@pytest.mark.parametrize(
    ("update", "what"),
    [
        (branch, r"line \d+, `return u if x\[0\] > 0 else -u`, raised RuntimeError"),
        (by_math, r"the change of x\[0\] is nan by symbols"),
        (by_floats, r"the change of x\[0\] is nan by symbols"),
        (hidden, r"the change of x\[0\] is .* by symbols and .* by numbers"),
        (lambda t, x, u, p: [x[0], x[0]], "2 values came back for its 1 states"),
    ],
)
def test_functions_that_need_numbers_are_refused_as_a_model(
    update: Any, what: str
) -> None:
    system = nonlinear(update)
    message = rf"system 'mine' do not work on CasADi symbols: {what}.*plant of `simula"
    with pytest.raises(ss.InvalidSystemError, match=message):
        ss.Model.from_system(system)


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (control.frd(control.tf([1], [1, 1]), np.array([1.0, 2.0]), name="data"),
         r"'data' \(FrequencyResponseData\) has no states: give a StateSpace"),
        (control.StateSpace([], [], [], [[2.0]], 0, name="gain"),
         r"'gain' \(StateSpace\) has no states, so its outputs follow"),
        (control.tf([3.0], [1.0], name="gain"), "'gain' .* has no states"),
        (control.tf([1, 0, 0], [1, 1], name="rate"),
         "'rate' is improper from u.0. to y.0.: its numerator has degree 2, its"),
        (control.tf([1], [1, 0.5], True, name="z"), "dt=True .*lacks a sampling time"),
        (control.ss(1, 1, 1, 0, None, name="s"), "dt=None .*lacks a time base"),
        (control.ss([[np.nan]], 1, 1, 0, name="n"), "matrices of system 'n' must be f"),
        (np.eye(2), "a system must be a control.StateSpace"),
    ],
    ids=lambda value: value if isinstance(value, str) else getattr(value, "name", ""),
)  # fmt: skip
def test_a_system_that_is_no_model_is_refused_with_its_name(
    system: Any, message: str
) -> None:
    with pytest.raises(ss.InvalidSystemError, match=message):
        ss.Model.from_system(system)


def test_intervals_of_another_length_than_the_sampling_time_are_refused() -> None:
    model = ss.Model.from_system(control.ss(0.9, 1, 1, 0, 0.1))
    with pytest.raises(
        ss.InvalidProblemError, match=r"sampled with dt = 0\.1 s, the int"
    ):
        ss.OptimalControlProblem(model, horizon=1.0, intervals=5)
    with pytest.raises(ss.InvalidProblemError, match="horizon must be a number"):
        ss.OptimalControlProblem(model, horizon=ss.Free(1, 2), intervals=5)
    with pytest.raises(ss.InvalidProblemError, match=r"sampled with dt = 0\.1 s"):
        ss.Plant(model, dt=0.2, substeps=1)
    assert ss.OptimalControlProblem(model, horizon=0.7, intervals=7).dt < 0.11


def test_a_sampled_linear_problem_costs_what_dlqr_says() -> None:
    """With P of the Riccati equation at the end, no horizon costs more than x0'P x0."""
    A, B = np.array([[1.0, 0.2], [-0.1, 0.95]]), np.array([[0.02], [0.2]])
    K, P, _ = control.dlqr(A, B, np.eye(2), np.eye(1), method="scipy")
    model = ss.Model.from_system(control.ss(A, B, np.eye(2), 0, 0.2))
    x, u = model.states, model.controls
    problem = ss.OptimalControlProblem(
        model, horizon=2.0, intervals=10, stage_cost=(ca.dot(x, x) + u**2) / 0.2,
        quadrature="left", terminal_cost=x.T @ P @ x,
        bounds=ss.Bounds(controls=(-50, 50)),
    )  # fmt: skip
    x0 = np.array([1.0, -2.0])
    found = ss.solve(problem, x0, search=None, lanes=0, seed=0)
    assert found.cost == pytest.approx(x0 @ P @ x0, rel=1e-8)
    np.testing.assert_allclose(found.controls[:, 0], -K @ x0, rtol=1e-6)


def test_an_interconnection_of_nonlinear_systems_can_be_a_plant_only() -> None:
    arm = nonlinear(lambda t, x, u, p: -np.sin(x) + u, states=["a"], outputs=["a"])
    gain = control.StateSpace([], [], [], [[-1.0]], 0, inputs="a", outputs="u[0]")
    both = control.interconnect([arm, gain], inplist=["u[0]"], outlist=["a"], name="b")
    with pytest.raises(ss.InvalidSystemError, match="'b' is an interconnection of non"):
        ss.Model.from_system(both)


def test_a_model_without_controls_has_no_state_space() -> None:
    x = ca.SX.sym("x")
    alone = ss.Model(states=x, controls=ca.SX(0, 1), ode=-x)
    with pytest.raises(ss.InvalidSystemError, match="without controls has no StateSp"):
        alone.linearised([0], [])


def test_a_model_with_an_ode_and_jumps_is_no_linear_system() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = ss.Model(states=x, controls=u, ode=u, next_state=x / 2)
    with pytest.raises(ss.InvalidSystemError, match="an ode and jumps"):
        model.linearised([0], [0])
    root = ss.Model(states=x, controls=u, ode=ca.sqrt(x) + u)
    with pytest.raises(ss.InvalidSystemError, match=r"derivatives .* must be finite"):
        root.linearised([0], [0])
    with pytest.raises(ss.InvalidProblemError, match="x must be 1 numbers, got 2"):
        root.linearised([1, 2], [0])


def test_a_discrete_model_without_dt_is_sampled_with_an_unknown_time() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    assert (
        ss.Model(states=x, controls=u, next_state=x + u).linearised([0], [0]).dt is True
    )
    with pytest.raises(ss.InvalidProblemError, match="leave it out of a model with"):
        ss.Model(states=x, controls=u, ode=u, dt=0.1)
    for dt in (-1.0, np.nan, np.inf, "0.1"):
        with pytest.raises(
            ss.InvalidProblemError, match="dt must be None or a finite number above 0"
        ):
            ss.Model(states=x, controls=u, next_state=u, dt=dt)  # type: ignore[arg-type]


def test_the_law_of_a_terminal_set_closes_the_loop_of_its_design() -> None:
    A, B = np.array([[0.0, 1.0], [2.0, 0.0]]), np.array([[0.0], [1.0]])
    sampled = control.sample_system(control.ss(A, B, np.eye(2), 0), 0.1)
    gain = sampled_lqr(sampled.A, sampled.B, np.eye(2), np.eye(1))
    near = ss.TerminalSet(
        K=gain.K,
        P=gain.P,
        alpha=1.0,
        x_ref=np.zeros(2),
        u_ref=np.zeros(1),
        dt=0.1,
        design="sampled",
    )
    law = near.linear_law(states=["angle", "rate"], controls=["torque"])
    assert law.dt == 0.1 and law.input_labels == ["angle", "rate"]
    loop = control.feedback(sampled, law, sign=1)
    np.testing.assert_allclose(
        np.sort_complex(loop.poles()), np.sort_complex(gain.eigenvalues), rtol=1e-9
    )


def test_a_nonlinear_system_gives_no_warning_of_casadi() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.Model.from_system(nonlinear(lambda t, x, u, p: [np.log1p(x[0] ** 2) + u[0]]))
