"""An expression has one meaning: as symbols, as numbers, along arrays, over time."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarmstart.cases.format.expressions import (
    FLOAT_OPERATIONS,
    FUNCTIONS,
    ExpressionError,
)
from swarmstart.cases.kinds.problem.stated.symbols import (
    ARRAYS,
    RESERVED,
    SYMBOLIC,
    Scope,
    constants_of,
    limits,
    number,
    over_time,
    rows_over_time,
)
from swarmstart.cases.kinds.problem.stated.values import Table
from swarmstart.tests.cases.kinds.problem.conftest import PENDULUM, scenario_of

NUMBERS = st.one_of(st.floats(-3, 3), st.sampled_from([0.0, 0.5, -0.5, 1.0, -1.0, 2.0]))
STEPS = Table(times=[1.0, 2.0, 4.0], values=[10.0, 20.0, 40.0], between="hold")


def arity(name: str) -> int:
    return FUNCTIONS.get(name, 1 if name == "neg" else 2)


@pytest.mark.parametrize("name", FLOAT_OPERATIONS)
@given(numbers=st.tuples(NUMBERS, NUMBERS))
def test_an_operation_is_the_same_on_symbols_arrays_and_numbers(
    name: str, numbers: tuple[float, float]
) -> None:
    given = numbers[: arity(name)]
    try:
        expected = FLOAT_OPERATIONS[name](*given)
    except (ValueError, ZeroDivisionError, OverflowError):
        assume(False)
    assume(math.isfinite(expected))
    symbols = [ca.SX.sym(f"x{k}") for k, _ in enumerate(given)]
    symbolic = ca.Function("f", symbols, [SYMBOLIC[name](*symbols)])
    rows = [np.array([value, value]) for value in given]
    close = pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert float(symbolic(*given)) == close
    assert ARRAYS[name](*rows).tolist() == [close, close]
    assert SYMBOLIC[name](*given) == expected  # Of numbers alone: the same bits.


def test_every_operation_is_known_on_symbols_and_on_arrays() -> None:
    assert SYMBOLIC.keys() == ARRAYS.keys() == FLOAT_OPERATIONS.keys()


def test_numbers_alone_that_have_no_value_are_refused_beside_symbols() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(ExpressionError, match="column 5"):
        Scope({"x": x}, {}, "rate").symbol("x + 1/0")


def test_a_name_in_the_wrong_place_is_told_with_its_column() -> None:
    scope = Scope({"x": 1.0}, {"u": "control", "x": "state"}, "terminal")
    with pytest.raises(ExpressionError) as caught:
        scope.value("2*x + u", FLOAT_OPERATIONS)
    assert caught.value.column == 7
    assert "expected no control in terminal, found 'u'" in str(caught.value)
    assert scope.value("2*x", FLOAT_OPERATIONS) == 2.0


def test_what_has_a_meaning_of_its_own_is_reserved() -> None:
    assert {"time", "pi", "sin", "atan2"} <= RESERVED


def test_a_held_table_switches_at_its_instants() -> None:
    at = np.array([0.0, 1.0, 2.0 - 1e-6, 2.0, 2.5, 4.0, 9.0])
    assert over_time(STEPS, {})(at).tolist() == [10, 10, 10, 20, 20, 40, 40]


def test_an_instant_reached_by_adding_steps_is_that_instant() -> None:
    table = Table(times=[0.0, 0.3], values=[1.0, 2.0], between="hold")
    below = np.array([math.nextafter(0.3, 0.0), 0.3 - 1e-8])
    assert over_time(table, {})(below).tolist() == [2.0, 1.0]


def test_a_linear_table_is_held_before_its_first_and_after_its_last_time() -> None:
    table = Table(times=[1.0, 3.0], values=[10.0, 30.0])
    at = np.array([0.0, 1.0, 1.5, 3.0, 7.0])
    assert over_time(table, {})(at).tolist() == [10, 10, 15, 30, 30]


def test_an_expression_over_time_is_that_at_each_time() -> None:
    at = np.array([0.0, 1.0, 2.0])
    assert over_time("a*time**2 + 1", {"a": 3.0})(at).tolist() == [1, 4, 13]
    assert over_time("a", {"a": 3.0})(at).tolist() == [3, 3, 3]


def test_an_expression_over_time_without_a_value_at_the_start_is_refused() -> None:
    with pytest.raises(ExpressionError, match="finite real value"):
        over_time("1/time", {})


def test_rows_over_time_are_in_the_order_of_the_file() -> None:
    rows = rows_over_time({"b": "2*time", "a": "1"}, {})
    assert rows is not None
    assert rows(np.array([0.0, 3.0])).tolist() == [[0, 6], [1, 1]]
    assert rows_over_time({}, {}) is None


def test_a_constant_may_use_those_before_it_and_a_vehicle_may_replace_one() -> None:
    scenario = scenario_of(PENDULUM.replace("g: 9.81", "g: 9.81, twice: 2*g"))
    assert constants_of(scenario) == {"g": 9.81, "twice": 19.62}
    own = constants_of(scenario, {"g": "1", "new": "twice + 1"})
    assert own == {"g": 1.0, "twice": 2.0, "new": 3.0}


def test_no_limit_is_infinite() -> None:
    assert limits(None, {}) == (-math.inf, math.inf)
    assert limits([None, "a/2"], {"a": 3.0}) == (-math.inf, 1.5)
    assert limits(["-a", None], {"a": 3.0}) == (-3.0, math.inf)
    assert number("radians(180)", {}) == math.pi
