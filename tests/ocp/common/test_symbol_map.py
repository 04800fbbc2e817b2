"""MX symbols and their SX symbols: expansion, and errors."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import InvalidProblemError, PathConstraint, disc
from swarmstart.ocp.common.expressions import (
    SymbolMap,
    in_sx,
    require_scalar_operations,
)

X: Any = ca.MX.sym("x", 2)
U: Any = ca.MX.sym("u")
MAP, COLUMNS = SymbolMap().extended({"states": X, "controls": U})


def value(expression: ca.SX, *numbers: object) -> Any:
    function = ca.Function("value", list(MAP.symbols), [expression])
    return np.array(function(*numbers)).ravel()


def test_symbols_keep_their_names_and_shapes() -> None:
    assert [str(s) for s in ca.vertsplit(COLUMNS["states"])] == ["x_0", "x_1"]
    assert str(COLUMNS["controls"]) == "u"


def test_an_expression_is_expanded_to_the_same_values() -> None:
    given = ca.vertcat(X[1] * U, ca.norm_2(X), (X.T @ X) / 3)
    expected = np.array(ca.Function("given", [X, U], [given])([0.3, 0.7], 2.0)).ravel()
    np.testing.assert_array_equal(
        value(MAP.sx("ode", given), [0.3, 0.7], 2.0), expected
    )


def test_a_map_is_extended_and_keeps_what_it_has() -> None:
    s = ca.MX.sym("s", 3)
    more, columns = MAP.extended({"signals": s, "controls": U})
    assert ca.is_equal(columns["controls"], COLUMNS["controls"])
    assert columns["signals"].shape == (3, 1)
    assert more.sx("cost", s[2] * U).shape == (1, 1)


def test_a_column_of_several_symbols_has_their_names() -> None:
    a, b = ca.MX.sym("a"), ca.MX.sym("b")
    _, columns = SymbolMap().extended({"states": ca.vertcat(a, b)})
    assert str(columns["states"]) == "[a, b]"


def test_what_is_stated_in_lists_and_constraints_is_brought_to_sx() -> None:
    rows: Any = [X[0], U]
    stated = [X[0] <= 1, (X[1], 2.0), PathConstraint(expression=rows, upper=1)]
    relation, pair, constraint = in_sx("constraints", stated, MAP.sx)
    assert str(relation) == "(x_0<=1)"
    assert str(pair[0]) == "x_1"
    assert pair[1] == 2.0
    assert str(constraint.expression) == "[x_0, u]"
    away = in_sx("constraints", disc(X, centre=[1.0, 0.0], radius=0.5), MAP.sx)
    np.testing.assert_array_equal(value(away.relative, [3.0, 4.0], 0.0), [2.0, 4.0])


def test_what_has_no_mx_is_returned_as_it_is() -> None:
    constraint = PathConstraint(expression=COLUMNS["states"], upper=1)
    assert in_sx("constraints", constraint, MAP.sx) is constraint


def test_a_table_remains_a_call() -> None:
    table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, 1.0, 4.0])
    found = value(MAP.sx("ode", table(X[0]) * U), [1.5, 0.0], 2.0)
    np.testing.assert_allclose(found, [5.0], rtol=1e-15)


def root_finder() -> ca.Function:
    z, p = ca.MX.sym("z"), ca.MX.sym("p")
    return ca.rootfinder("root", "newton", {"x": z, "p": p, "g": z**2 - p})


def test_refuses_calls_of_other_functions_also_below_a_table() -> None:
    table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, 1.0, 4.0])
    x = ca.SX.sym("x")
    for expression in (root_finder()(1, x), x + table(ca.sin(root_finder()(1, x)))):
        with pytest.raises(InvalidProblemError, match=r"it calls root \(Newton\)"):
            require_scalar_operations("ode", expression)


def test_refuses_foreign_symbols_and_expressions_for_symbols() -> None:
    with pytest.raises(InvalidProblemError, match=r"cost has MX symbols .*: wind"):
        MAP.sx("cost", X[0] * ca.MX.sym("wind"))
    with pytest.raises(InvalidProblemError, match="states must be CasADi symbols"):
        SymbolMap().extended({"states": 2 * X})
