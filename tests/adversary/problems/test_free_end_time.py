import numpy as np
import pytest
from scipy.integrate import quad

from swarmstart.tests.adversary.exact.convex import UnsolvedError, solve_convex
from swarmstart.tests.adversary.exact.held_linear import End, Linear, program_of
from swarmstart.tests.adversary.problems.free_end_time import least_time


def held_least_time(x0: np.ndarray, force: float) -> float:
    """Return the least time with 60 held controls, by bisection of linear programs."""
    low, high = 0.0, 20.0
    while high - low > 1e-4:
        middle = (low + high) / 2
        linear = Linear(
            A=np.eye(2, k=1), B=np.array([[0.0], [1.0]]), x0=x0, horizon=middle,
            intervals=60, controls=(np.full(1, -force), np.full(1, force)),
            end=End(np.eye(2), np.zeros(2), np.zeros(2)),
        )  # fmt: skip
        try:
            solve_convex(program_of(linear))
            high = middle
        except UnsolvedError:
            low = middle
    return high


@pytest.mark.parametrize(
    ("x", "v", "force"), [(1.0, 0.0, 1.0), (-0.5, 1.2, 0.7), (0.2, 1.0, 2.0)]
)
def test_least_time_agrees_with_linear_programs(
    x: float, v: float, force: float
) -> None:
    held = held_least_time(np.array([x, v]), force)
    exact = least_time(x, v, force=force)
    assert exact <= held + 1e-4
    assert held == pytest.approx(exact, rel=5e-3)


def test_least_time_from_rest_is_that_of_two_parabolas() -> None:
    assert least_time(1.0, 0.0, force=1.0) == pytest.approx(2.0)


def test_least_time_of_an_exponential_is_an_integral() -> None:
    a, m, x0 = 0.5, 1.0, 0.8
    exact, _ = quad(lambda x: 1 / (m - a * x), 0.0, x0)
    assert -np.log1p(-a * x0 / m) / a == pytest.approx(exact)
