"""Functions as weighted sums of terms: same values, and equal terms cancel."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.lower_bound.tubes.motion import terms_of
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
)

x = ca.SX.sym("x", 3)


def made(*outputs: ca.SX | float) -> ca.Function:
    return ca.Function("f", [x], [ca.densify(ca.vertcat(*outputs))])


@pytest.mark.parametrize(
    "function",
    [
        made(2 * x[0] - x[1] / 3 + 1, -(x[2] - 4), 0),
        made(ca.exp(x[0]) - 2 * (ca.exp(x[0]) + x[1] * x[2]), ca.sin(x[1]) * 3),
        made((x[0] + 0.5) * (x[1] - 1), x[0] / (2 + x[1] ** 2), ca.fmin(x[0], x[2])),
        made(0.1 + (0.2 + x[0]) * (0.3 - 0.1), 7 * (x[0] - x[0])),
        made(1 / (3 + x[0] ** 2), ca.atan2(x[0], 9 + x[1]), x[0] ** 1.5 * 0 + 2),
    ],
)
def test_sums_of_terms_have_the_function_s_values(function: ca.Function) -> None:
    sums = terms_of(function)
    terms = ca.Function("w", [sums.symbols], [sums.terms])
    for point in np.random.default_rng(0).random((20, 3)) * 2:
        found = sums.weights @ np.asarray(terms(point)).ravel()
        assert found == pytest.approx(np.asarray(function(point)).ravel(), abs=1e-13)


def test_a_term_in_two_rows_cancels_in_their_sum() -> None:
    r = (x[1] + 0.5) * ca.exp(25 * x[0] / (x[0] + 2))
    again = (x[1] + 0.5) * ca.exp(25 * x[0] / (x[0] + 2))  # Not the same object.
    sums = terms_of(made(-x[0] + r, 0.5 - x[1] - again))
    both = sums.weights.sum(axis=0)
    assert sorted(both) == [-1.0, -1.0, 0.0, 0.5]


def test_errors_count_what_was_added_up_and_cancelled() -> None:
    sums = terms_of(made((1e8 * x[0] + x[1]) - (1e8 * x[0] + x[2])))
    (weight,) = sums.weights[np.abs(sums.errors) > 1e-6]
    assert weight == 0.0
    assert (sums.errors > 0.0).all()


def test_unknown_operations_are_refused() -> None:
    y = ca.MX.sym("y", 2)
    solved = ca.Function("f", [y], [ca.solve(ca.blockcat([[y[0], 1], [2, y[1]]]), y)])
    with pytest.raises(UnknownIntervalOperationError, match="f has the operation"):
        terms_of(solved)
