import numpy as np
import pytest

from swarmstart.tests.adversary.exact.held_linear import Linear
from swarmstart.tests.adversary.exact.reach import Reach


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
