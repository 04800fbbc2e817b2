"""Projected L-BFGS from many starts, beside SciPy's from each of them."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize as scipy_minimize
from scipy.optimize import rosen, rosen_der

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.box import Box
from swarmstart.heuristics.laws.descent import DescentOptions, descend


def rosenbrock(x: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
    del numbers
    return rosen(x), rosen_der(x)


@pytest.mark.parametrize("upper", [2.0, 0.6])
def test_minima_are_those_of_scipy(upper: float) -> None:
    """In a box that holds the minimum, and in one that cuts it off."""
    box = Box(lower=np.full(4, -1.5), upper=np.full(4, upper))
    starts = np.random.default_rng(0).uniform(-1.5, upper, (4, 20))
    found = descend(rosenbrock, box, starts, DescentOptions(iterations=1000))
    for column, value in zip(starts.T, found.value, strict=True):
        peer = scipy_minimize(
            rosen, column, jac=rosen_der, method="L-BFGS-B",
            bounds=[(-1.5, upper)] * 4, options={"ftol": 1e-15, "gtol": 1e-10},
        )  # fmt: skip
        # Rosenbrock has two minima here; which one a start leads to may differ.
        assert min(abs(value - v) for v in (peer.fun, 0.0, 3.70142861)) < 1e-6
    np.testing.assert_allclose(found.value, rosen(found.x), rtol=1e-12, atol=1e-20)
    assert (found.x >= -1.5).all()
    assert (found.x <= upper).all()


def test_quadratic_is_solved_in_as_many_steps_as_it_has_dimensions() -> None:
    """Conjugate gradients would need six; bounds hold two of the coordinates."""
    A = np.diag([1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
    centre = np.array([0.2, -0.3, 2.0, 0.1, -4.0, 0.0])
    box = Box(lower=np.full(6, -1.0), upper=np.full(6, 1.0))

    def quadratic(x: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
        del numbers
        away = x - centre[:, None]
        return 1.0 + 0.5 * np.sum(away * (A @ away), axis=0), A @ away

    found = descend(quadratic, box, np.zeros((6, 3)))
    np.testing.assert_allclose(found.x, np.clip(centre, -1, 1)[:, None] + np.zeros(3),
                               atol=1e-4)  # fmt: skip
    assert found.iterations.max() <= 40


def test_each_start_has_data_of_its_own() -> None:
    targets = np.linspace(-0.9, 0.9, 7)

    def towards(x: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
        away = x[0] - targets[numbers]
        return 1 + away**4 + away**2, (4 * away**3 + 2 * away)[None]

    box = Box(lower=np.array([-1.0]), upper=np.array([1.0]))
    found = descend(towards, box, np.zeros((1, 7)))
    np.testing.assert_allclose(found.x[0], targets, atol=1e-4)


def test_what_is_not_finite_is_no_step() -> None:
    """1/x - log x beyond a pole; a start on the pole does not move."""

    def walled(x: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
        del numbers
        with np.errstate(all="ignore"):
            return 1 / x[0] - np.log(x[0]) + x[0], (-1 / x**2 - 1 / x + 1)

    box = Box(lower=np.array([-1.0]), upper=np.array([3.0]))
    found = descend(walled, box, np.array([[0.0, 1.0, 2.5]]))
    assert np.isinf(found.value[0])
    np.testing.assert_allclose(found.x[0, 1:], (1 + np.sqrt(5)) / 2, rtol=1e-4)


def test_fixed_variables_stay() -> None:
    box = Box(lower=np.array([0.5, -2.0]), upper=np.array([0.5, 2.0]))
    found = descend(rosenbrock, box, np.array([[0.5], [-1.0]]))
    np.testing.assert_allclose(found.x[:, 0], [0.5, 0.25], atol=1e-4)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_no_point_that_is_tried_lies_outside_the_box(side: float) -> None:
    """The slope leads far beyond either end, also where a step is tried shorter."""
    box, seen = Box(lower=np.full(2, -1.0), upper=np.full(2, 1.0)), []

    def steep(x: Array, numbers: NDArray[np.int64]) -> tuple[Array, Array]:
        del numbers
        seen.append(x.copy())
        wave = np.cos(9 * x).sum(axis=0)
        return 100 - 20 * side * x.sum(axis=0) + wave, -20 * side - 9 * np.sin(9 * x)

    found = descend(steep, box, np.random.default_rng(0).uniform(-1, 1, (2, 30)))
    assert max(abs(x).max() for x in seen) <= 1
    np.testing.assert_allclose(found.x, side, atol=1e-9)
