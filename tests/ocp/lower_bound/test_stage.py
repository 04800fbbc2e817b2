"""The control that makes h least, against all controls of a fine grid."""

import itertools

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.lower_bound.hamiltonian import Stage
from swarmstart.ocp.lower_bound.stated.statement import Statement, affine_form
from swarmstart.tests.ocp.lower_bound.evidence_by_hand import scalar

FINE = 41


def planar(*, is_affine: bool) -> Statement:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    t = ca.SX.sym("t")
    rate = ca.vertcat(x[1] + 0.5 * u[1], ca.cos(t) * u[0] + x[0] * u[1])
    stage = x[0] ** 2 + 0.4 * u[0] ** 2 + 0.2 * u[0] - 0.3 * u[1]
    if not is_affine:
        rate += ca.vertcat(ca.sin(2 * u[0]), u[0] * u[1] ** 2)
        stage += u[1] ** 4
    return scalar(
        time=t, states=x, controls=u, rate=rate, stage=stage, end=x[0] - t,
        x0=np.zeros(2), control_box=(np.array([-1.0, -0.5]), np.array([2.0, 1.5])),
    )  # fmt: skip


@pytest.mark.parametrize("is_affine", [True, False])
def test_the_best_control_is_no_worse_than_any_of_a_grid(*, is_affine: bool) -> None:
    statement, rng = planar(is_affine=is_affine), np.random.default_rng(3)
    form = affine_form(statement)
    assert (form is not None) is is_affine
    stage = Stage(statement, form)
    points, slopes = rng.normal(size=(2, 3, 200))
    h, u = stage.hamiltonian(slopes, points)
    low, high = statement.control_box
    assert (u >= low[:, None]).all() and (u <= high[:, None]).all()
    assert stage.hamiltonian(slopes, points, u)[0] == pytest.approx(h, abs=1e-12)
    f, L = stage.rates(points, u)
    assert slopes[0] + L + (slopes[1:] * f).sum(axis=0) == pytest.approx(h)
    best = np.full(200, np.inf)
    axes = np.linspace(low, high, FINE).T
    for one in itertools.product(*axes):
        tried = np.repeat(np.array(one)[:, None], 200, axis=1)
        best = np.minimum(best, stage.hamiltonian(slopes, points, tried)[0])
    # In closed form, or nearly.
    assert (h <= best + (1e-12 if is_affine else 0.03)).all()
    assert (h >= best - 0.1).all()


def test_rates_and_costs_are_the_expressions() -> None:
    stage = Stage(planar(is_affine=False), None)
    y, u = np.array([[0.3], [0.7], [-0.2]]), np.array([[1.1], [0.4]])
    f, L = stage.rates(y, u)
    first = -0.2 + 0.2 + np.sin(2.2)
    second = np.cos(0.3) * 1.1 + 0.7 * 0.4 + 1.1 * 0.16
    assert f.ravel() == pytest.approx([first, second])
    cost = 0.49 + 0.4 * 1.21 + 0.22 - 0.12 + 0.4**4
    assert pytest.approx([cost]) == L
    assert stage.end(y) == pytest.approx([0.4])
