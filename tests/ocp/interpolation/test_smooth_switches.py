"""Harmless comparisons: value, slope and curvature agree on both sides."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.ocp import Bounds, Model, OptimalControlProblem, table
from swarmstart.ocp.rollout.kinks import kinks_of

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
P = X[0] - 1


def kinks(expression: ca.SX) -> int:
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(X[1] + expression, U)),
        horizon=1.0,
        intervals=2,
        stage_cost=U**2,
        bounds=Bounds(controls=(-1, 1)),
    )
    return len(kinks_of(problem).names)


SMOOTH = {
    "cubed": ca.if_else(P < 0, 0, P**3),
    "the other way": ca.if_else(P >= 0, 4 + P**3, 4),
    "number first": ca.if_else(1 <= X[0], 4 + P**3, 4),
    "then mixed": (1 + ca.if_else(P < 0, 0, P**3)) * ca.sqrt(X[1]) + X[0],
    "inside": ca.sin(ca.if_else(X[0] < 1, X[0], X[0] + P**4)),
    "twice": ca.if_else(P < 0, 0, P**3) + ca.if_else(X[1] < 0, X[1], X[1] - X[1] ** 5),
    "small units": ca.if_else(X[0] < 1e-7, 0, 1e21 * (X[0] - 1e-7) ** 3),
    "large units": ca.if_else(X[0] < 1e7, 0, 1e-21 * (X[0] - 1e7) ** 3),
}
KINKED = {
    "curvature": ca.if_else(P < 0, 0, P**2),
    "slope": ca.if_else(P < 0, 0, P),
    "jump": ca.if_else(P < 0, 0, 1),
    "small jump": ca.if_else(P < 0, 1, 1 + 1e-6),
    "curvature of a mixture": ca.if_else(P < 0, X[1] ** 3, X[1] ** 3 + P**3 * X[1]),
    "flag": (P < 0) * X[1],
    "used twice": ca.if_else(P < 0, 0, P**3) + (X[0] < 1) * X[1],
    "equality": ca.if_else(X[0] == 1, 1 + P**3, 1),
    "variable": ca.if_else(X[0] < X[1], 0, (X[0] - X[1]) ** 3),
    "undefined": ca.if_else(X[0] < 1, ca.log(X[0] - 1), ca.log(X[0] - 1) + P**3),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_what_stays_smooth_is_no_kink(name: str) -> None:
    assert kinks(SMOOTH[name]) == 0


@pytest.mark.parametrize("name", KINKED)
def test_what_does_not_is_one(name: str) -> None:
    assert kinks(KINKED[name]) == 1


def test_one_kink_among_smooth_comparisons_is_seen() -> None:
    spline = table(np.arange(8.0), np.sin(np.arange(8.0)), "bspline")
    assert kinks(spline(X[0])) == 0
    bent = spline(X[0]) + ca.if_else(X[0] < 3, 0, 0.01 * (X[0] - 3))
    assert kinks(bent) == 1


@given(
    at=st.lists(st.integers(-300, 300), min_size=5, max_size=15, unique=True),
    unit=st.integers(-8, 8),
    size=st.integers(-8, 8),
    seed=st.integers(0, 999),
)
@settings(deadline=None, max_examples=30)
def test_splines_have_no_kinks_in_any_units(
    at: list[int], unit: int, size: int, seed: int
) -> None:
    known = np.sort(at) * 10.0**unit
    rng = np.random.default_rng(seed)
    spline = table(known, 10.0**size * rng.normal(size=known.size), "bspline")
    assert kinks(spline(X[0] - X[1])) == 0
    plane = rng.normal(size=(known.size, known.size))
    assert kinks(table((known, known), plane, "bspline")(X[0], X[1])) == 0


def test_spline_of_parallel_values_has_no_kinks() -> None:
    """A line, a parabola, and a value that is constant except for rounding."""
    at = np.array([-1.0, -0.5, 0.1, 0.4, 1.0, 1.5])
    for values in (3 * at + 1, (at - 0.1) ** 2, 5 + 1e-15 * at**3):
        assert kinks(table(at, values, "bspline")(X[0])) == 0
