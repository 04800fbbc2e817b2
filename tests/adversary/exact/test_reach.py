import numpy as np
import pytest
from scipy.optimize import differential_evolution

from swarmstart.arrays import Array
from swarmstart.tests.adversary.exact.held_linear import Linear, program_of
from swarmstart.tests.adversary.exact.reach import Reach, outputs_of


def reach(*, w: float, t: float) -> Reach:
    """Return x' = u for 2 s from 0, w |y - t| besides the energy."""
    linear = Linear(
        A=np.zeros((1, 1)), B=np.eye(1), x0=np.zeros(1), horizon=2.0, intervals=5,
        controls=(-np.ones(1), np.ones(1)),
    )  # fmt: skip
    return Reach(
        linear=linear, C=np.eye(1), weight=1.0,
        end_cost=lambda y: w * np.abs(y[0] - t), breaks=(t,),
    )  # fmt: skip


@pytest.mark.parametrize(("w", "t"), [(0.5, 1.0), (3.0, 1.0), (1.0, -0.3)])
def test_distance_is_the_soft_threshold(w: float, t: float) -> None:
    """The least of y^2 / 2 + w |y - t| is at y = w, or at t if that is nearer."""
    y = np.sign(t) * min(w, abs(t))
    best = reach(w=w, t=t).best()
    assert best.output[0] == pytest.approx(y, abs=1e-5)
    assert best.cost == pytest.approx(y * y / 2 + w * abs(y - t), abs=1e-8)
    np.testing.assert_allclose(best.controls, np.full((1, 5), y / 2), atol=1e-5)


def test_many_wells_agree_with_a_search_over_all_controls() -> None:
    """An oscillator, three controls, by differential evolution of the trajectory."""
    linear = Linear(
        A=np.array([[0.0, 1.0], [-1.0, 0.0]]), B=np.array([[0.0], [1.0]]),
        x0=np.array([0.2, -0.1]), horizon=1.5, intervals=3,
        controls=(np.full(1, -9.0), np.full(1, 9.0)), R=0.05 * np.eye(1),
    )  # fmt: skip

    def wells(y: Array) -> Array:
        away = y[0] - 1.3
        value: Array = 0.4 * away**2 + 2 * (1 - np.cos(4 * away))
        return value

    first = np.eye(2)[:1]
    best = Reach(linear=linear, C=first, weight=0.05, end_cost=wells).best()
    program, (gamma, y0) = program_of(linear), outputs_of(linear, first)
    found = differential_evolution(
        lambda U: program.cost(U) + float(wells((gamma @ U + y0)[:, None])[0]),
        [(-9.0, 9.0)] * 3,
        rng=np.random.default_rng(0),
        tol=1e-10,
    )
    assert best.cost == pytest.approx(found.fun, rel=1e-6)
