"""One kernel for every function: against CasADi's own evaluation."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.compiled.backend import CasadiMap
from swarmstart.ocp.compiled.engine import NoCompilerError, machine
from swarmstart.ocp.compiled.interpreter import (
    BoundInterpreted,
    Interpreted,
    interpreted,
    program_of,
)
from swarmstart.tape import UnknownOperationError

try:
    machine()
except NoCompilerError as reason:  # pragma: no cover - a machine without LLVM
    pytest.skip(str(reason), allow_module_level=True)


def operations() -> ca.Function:
    """Return (x, p) -> most operations that an NLP can have."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    values = [
        *(f(x) for f in (ca.sin, ca.cos, ca.tan, ca.asin, ca.exp, ca.log, ca.tanh)),
        *(f(x) for f in (ca.sqrt, ca.erf, ca.sinh, ca.acosh, ca.log1p, ca.expm1)),
        *(x**k for k in (2, 3, 7, 2.5, -2)),
        *(1 / x, 2 * x, -x, x / p[0], x[0] ** x, x - p[1]),
        *(ca.floor(7 * x), ca.ceil(7 * x), ca.sign(x - 0.5), ca.fabs(x - 0.5)),
        *(ca.fmin(x, 0.3), ca.fmax(x, p[0]), ca.atan2(x, p[0]), ca.hypot(x, p[1])),
        ca.fmod(9 * x, 2),
        ca.if_else(x > 0.5, x, p[1]),
        ca.logic_and(x > 0.3, x < 0.6),
        ca.logic_or(x > 0.6, x < 0.3),
        ca.logic_not(x > 0.6),
        ca.copysign(p[0], x - 0.5),
    ]
    return ca.Function("operations", [x, p], [ca.vertcat(*values), ca.sum1(x)])


@pytest.mark.parametrize("size", [1, 31, 32, 101])
def test_every_operation_gives_what_casadi_gives(size: int) -> None:
    function, p = operations(), np.array([0.3, 0.4])
    x = np.random.default_rng(0).uniform(0.01, 0.99, (3, size))
    x[:, 0] = 1e9, -0.7, np.nan  # An angle for the C library; out of domains.
    found = Interpreted(function).bind((p,))(x)
    expected = CasadiMap(function).bind((p,))(x)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)


def test_an_individual_does_not_depend_on_its_neighbours() -> None:
    bound = Interpreted(operations()).bind((np.array([0.3, 0.4]),))
    x = np.random.default_rng(1).uniform(0.01, 0.99, (3, 70))
    alone = bound(x[:, 45:46])
    assert np.array_equal(bound(x)[:, 45:46], alone, equal_nan=True)


def test_a_constant_is_known_as_long_as_its_place_holds_it() -> None:
    """CasADi gives a place to another value once the first is no longer needed."""
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [(x + 3.0) ** (x + 2.0) + x**3.0 + 3.0**x])
    points = np.linspace(0.5, 2.0, 5)[None, :]
    found = Interpreted(function).bind(())(points)
    expected = (points + 3) ** (points + 2) + points**3 + 3**points
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_what_is_not_interpreted_goes_through_casadi() -> None:
    x = ca.MX.sym("x")
    table = ca.interpolant("table", "linear", [[0, 1, 2]], [0, 1, 4])
    function = ca.Function("f", [x], [table(x)]).expand()
    with pytest.raises(UnknownOperationError, match="is not interpreted"):
        program_of(function)
    assert isinstance(interpreted(function), CasadiMap)


def test_another_number_of_rows_is_refused() -> None:
    bound = Interpreted(operations()).bind((np.zeros(2),))
    assert isinstance(bound, BoundInterpreted)
    with pytest.raises(ValueError, match="must have 3 rows, got 2"):
        bound(np.zeros((2, 4)))
