"""Powers of two are factored out of expressions without a change of any bit."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.ocp import Model, OptimalControlProblem
from swarmstart.ocp.common.expressions import without_power_of_two

X = ca.SX.sym("x", 3)
POINTS = np.random.default_rng(0).normal(size=(3, 20))
numbers = st.floats(-1e6, 1e6, allow_subnormal=False).filter(lambda v: abs(v) > 1e-6)


def _combined(part: st.SearchStrategy[ca.SX]) -> st.SearchStrategy[ca.SX]:
    pairs = st.tuples(part, part)
    return st.one_of(
        st.tuples(numbers, part).map(lambda p: p[0] * p[1]),
        st.tuples(numbers, part).map(lambda p: p[1] * p[0]),
        part.map(lambda v: 2 * v),
        part.map(lambda v: -v),
        part.map(ca.sin),
        part.map(lambda v: v**2),
        pairs.map(lambda p: p[0] + p[1]),
        pairs.map(lambda p: p[0] - p[1]),
        pairs.map(lambda p: p[0] * p[1]),
        pairs.map(lambda p: p[0] / (1 + p[1] ** 2)),
    )


expressions = st.recursive(
    st.one_of(numbers.map(ca.SX), st.integers(0, 2).map(lambda i: X[i])),
    _combined,
    max_leaves=12,
)


def values(expression: ca.SX) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array(ca.Function("f", [X], [ca.densify(expression)])(POINTS))


@given(expression=expressions)
@settings(max_examples=150, deadline=None)
def test_value_is_power_times_rest(expression: ca.SX) -> None:
    k, rest = without_power_of_two(expression)
    with np.errstate(over="ignore", invalid="ignore"):
        expected = values(expression)
        np.testing.assert_array_equal(2.0**k * values(rest), expected)


@given(expression=expressions, j=st.integers(-40, 40))
@settings(max_examples=150, deadline=None)
def test_power_that_is_multiplied_comes_out_again(expression: ca.SX, j: int) -> None:
    """The rest has the same bits for any power."""
    if expression.is_constant():
        return
    k, rest = without_power_of_two(expression)
    for times in (2.0**j * expression, expression * 2.0**j):
        power, left = without_power_of_two(times)
        assert power == k + j
        np.testing.assert_array_equal(values(left), values(rest))


def test_terms_of_a_sum_give_out_what_they_share() -> None:
    assert without_power_of_two(8 * X[0] + 8 * X[1])[0] == 3
    assert without_power_of_two(8 * X[0] - 4 * (2 * X[1]))[0] == 3
    assert without_power_of_two(8 * X[0] + 4 * X[1])[0] == 0
    assert without_power_of_two(8 * X[0] + 1)[0] == 0


@pytest.mark.parametrize("factor", [0.0, np.nan, np.inf])
def test_factor_that_has_no_power_stays(factor: float) -> None:
    k, rest = without_power_of_two(X[0] * factor)
    assert k == 0
    np.testing.assert_array_equal(values(rest), values(X[0] * factor))
    assert without_power_of_two(ca.SX(0))[0] == 0


@pytest.mark.parametrize(
    ("stage", "end"),
    [(1e-310, 0.0), (1e-200, 1e200), (1e300, 0.0), (0.0, 1e-310), (3.0, 5.0)],
)
def test_costs_of_any_size_stay_what_they_are(stage: float, end: float) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=1,
        stage_cost=stage * ca.cos(u),
        terminal_cost=end * ca.cos(x),
    )
    unit, costs = problem.costs()
    both = ca.Function("both", [x, u], [costs.stage, costs.terminal])(0, 0)
    assert [unit * float(v) for v in both] == [stage, end]
