"""Models: values, stacking, and errors."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import InvalidProblemError, Model, right_hand_side, stack_models

X, U, P = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")


def test_right_hand_side_is_the_formula() -> None:
    model = Model(
        states=X, controls=U, parameters=P, ode=ca.vertcat(P * X[1], U - ca.sin(X[0]))
    )
    value = right_hand_side(model)([0.3, 2.0], 5.0, 7.0)
    np.testing.assert_allclose(np.array(value).ravel(), [14.0, 5.0 - np.sin(0.3)])
    assert (model.nx, model.nu, model.np) == (2, 1, 1)


def test_names_are_those_of_the_symbols_unless_given() -> None:
    model = Model(states=X, controls=U, ode=X, control_names=("torque",))
    assert model.state_names == ("x_0", "x_1")
    assert model.control_names == ("torque",)


def test_stacked_models_do_not_know_of_each_other() -> None:
    one = Model(states=X, controls=U, parameters=P, ode=ca.vertcat(X[1] * P, U))
    other = Model(states=U, controls=P, ode=-U * P)
    stacked = stack_models([one, other, one])
    value = right_hand_side(stacked)([1, 2, 3, 4, 5], [6, 7, 8], [9, 10])
    np.testing.assert_array_equal(np.array(value).ravel(), [18, 6, -21, 50, 8])
    assert stacked.state_names == ("x_0_0", "x_1_0", "u_1", "x_0_2", "x_1_2")
    assert stacked.control_names == ("u_0", "p_1", "u_2")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"ode": U}, "one row for each of the 2 states, got 1"),
        ({"ode": X + ca.SX.sym("stranger")}, "found stranger"),
        (
            {"ode": ca.MX.sym("a", 2)},
            "ode has MX symbols that are not symbols of the model: a",
        ),
        ({"ode": ca.SX.zeros(2, 2)}, "ode must be a vector"),
        ({"states": 2 * X}, "states must be CasADi SX symbols"),
        ({"states": X.T}, "states must be a column"),
        ({"controls": 1.0}, "controls must be CasADi SX symbols"),
        ({"controls": X}, "must be different symbols, found one twice"),
        ({"state_names": ("a",)}, "state_names must name 2 states"),
    ],
)
def test_refuses_what_is_no_model(arguments: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"states": X, "controls": U, "ode": X, **arguments}
    with pytest.raises(InvalidProblemError, match=message):
        Model(**given)  # type: ignore[arg-type]


def test_refuses_to_stack_nothing() -> None:
    with pytest.raises(InvalidProblemError, match="at least one model"):
        stack_models([])
