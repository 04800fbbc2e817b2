"""A correction that is fitted to roll-outs is the formula that they come from."""

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.simulators.surrogate import Correction, Fit, RollOut

STEP = 0.05


def problem(missing: bool) -> ss.OptimalControlProblem:
    """A cart; the second state's rate lacks a cubic drag, and a part of the force."""
    x, u, k = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("k")
    rate = k * u if missing else k * u - 0.4 * x[1] ** 3 + 0.2 * u * x[1] + 0.1
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], rate), parameters=k),
        horizon=1.0, intervals=5, stage_cost=u**2, bounds=ss.Bounds(controls=(-2, 2)),
    )  # fmt: skip


def rollouts(count: int = 12, weight: float = 1.0) -> list[RollOut]:
    """Return roll-outs of the true cart, by one Runge-Kutta step each."""
    plant = ss.Plant(
        problem(missing=False).model, dt=STEP, substeps=1,
        parameters=lambda times: np.full((1, times.size), 1.5),
    )  # fmt: skip
    rng, found = np.random.default_rng(0), []
    for _ in range(count):
        controls = rng.uniform(-2, 2, (1, 30))
        states = [rng.uniform(-1, 1, 2)]
        for u in controls.T:
            states.append(plant(states[-1], u)[:, -1])
        found.append(RollOut(np.stack(states, axis=1), controls, weight))
    return found


def test_a_polynomial_is_found_with_its_degree() -> None:
    correction = Correction(problem(missing=True), STEP)
    fit = correction.fitted(rollouts(), np.array([1.5]))
    assert fit.degree >= 3 and fit.error < 1e-8
    rate = ca.Function("rate", [
        correction.problem.model.states, correction.problem.model.controls,
        correction.problem.model.parameters, correction.problem.model.signals,
    ], [correction.problem.model.ode])  # fmt: skip
    known = correction.known(ss.Known(parameters=[1.5]), fit)
    assert np.abs(known.signals).max() < 1e-6
    for x, u in (((0.3, -0.8), 1.1), ((-0.5, 0.6), -1.7)):
        own = np.asarray(known.parameters)
        found = np.array(rate(x, u, own, 0)).ravel()
        drag = -0.4 * x[1] ** 3 + 0.2 * u * x[1] + 0.1
        assert found == pytest.approx([x[1], 1.5 * u + drag], abs=1e-6)


def test_roll_outs_of_little_weight_change_little() -> None:
    """Steps of another cart are nearly left out."""
    correction, p = Correction(problem(missing=True), STEP), np.array([1.5])
    wrong = [
        RollOut(one.states[:, ::-1].copy(), one.controls, 1e-9) for one in rollouts(6)
    ]
    found: Fit = correction.fitted([*rollouts(), *wrong], p)
    predicted = np.array([0.2, 0.5]), np.array([1.0])

    def after(fit: Fit) -> Array:
        x, u = (one[:, None] for one in predicted)
        return correction._predict(x, u, p, fit.parameters).ravel()

    states = ss.Plant(
        problem(missing=False).model, dt=STEP, substeps=1,
        parameters=lambda times: np.full((1, times.size), 1.5),
    )(*predicted)  # fmt: skip
    assert after(found) == pytest.approx(states[:, -1], abs=1e-6)


def test_a_state_that_never_changes_is_no_division_by_zero() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    still = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(0, u)), horizon=1.0, intervals=2,
        stage_cost=u**2, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    one = RollOut(np.zeros((2, 6)), np.zeros((1, 5)), 1.0)
    fit = Correction(still, STEP).fitted([one, one], np.empty(0))
    assert np.isfinite(fit.parameters).all() and fit.error == 0


def test_what_no_polynomial_fits_is_repeated_along_the_heaviest_roll_out() -> None:
    """A ripple in the rate, along a path that passes twenty of its waves."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")

    def stated(ripple: float) -> ss.OptimalControlProblem:
        return ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=u + ripple * ca.sin(20 * x)),
            horizon=6.0, intervals=60, checks=2, stage_cost=u**2,
            bounds=ss.Bounds(controls=(-2, 2)),
        )  # fmt: skip

    plant, rng = (
        ss.Plant(stated(0.5).model, dt=STEP, substeps=10),
        np.random.default_rng(0),
    )
    made = []
    for weight in (0.1, 0.1, 1.0, 0.1):
        controls = 1 + rng.uniform(-0.3, 0.3, (1, 120))
        states = [np.array([rng.uniform(0, 1)])]
        for control in controls.T:
            states.append(plant(states[-1], control)[:, -1])
        made.append(RollOut(np.stack(states, axis=1), controls, weight))
    correction = Correction(stated(0.0), STEP)
    fit = correction.fitted(made, np.empty(0))
    heaviest = made[2]

    def missed(rest: Array) -> float:
        states, most = heaviest.states[:, 0], 0.0
        for k, control in enumerate(heaviest.controls.T):
            both = rest[:, k : k + 2].ravel(order="F")
            states = np.array(correction._after(states, control, fit.parameters, both))
            states = states.ravel()
            most = max(most, float(np.abs(states - heaviest.states[:, k + 1]).max()))
        return most

    assert fit.rest.shape == (1, 121)
    assert 5 * missed(fit.rest) < missed(0 * fit.rest)


def test_many_states_are_fitted_with_few_monomials() -> None:
    """Seven quantities have all monomials to degree 2 and powers to 5; fifty none."""
    assert _count(6, 1) == 1 + 7 + 28 + 3 * 7
    assert _count(48, 2) == 1 + 50 + 0
    assert Correction(problem(missing=True), STEP).degrees == [1, 2, 3, 4, 5]


def _count(nx: int, nu: int) -> int:
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
    large = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.SX(nx, 1)), horizon=1.0, intervals=2,
        stage_cost=ca.sumsqr(u), bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    return len(Correction(large, STEP)._powers)
