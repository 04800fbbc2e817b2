"""Forms of a model: each gives the same right-hand side; and errors."""

import functools
import math
import subprocess
import sys
import textwrap
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import swarmstart as ss
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    right_hand_side,
)
from swarmstart.ocp.system.model_forms import Given, symbolic_rows

X, U, P = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p", 3)
# MX is accepted in addition to the declared type SX.
XM: Any = ca.MX.sym("x", 2)
UM: Any = ca.MX.sym("u")
PM: Any = ca.MX.sym("p", 3)
T = ca.SX.sym("t")
SYMBOLS = {"states": X, "controls": U, "parameters": P, "time": T}


def modelled(**given: Any) -> Model:
    """Return a model from forms beyond its declared types."""
    return Model(**given)


def pendulum(x: Any, u: Any, p: Any) -> list[Any]:
    """The right-hand side that each form expresses in its own way."""
    return [x[1], p[0] * u - p[1] * ca.sin(x[0]) - p[2] * x[1]]


def function(
    *order: str, names: tuple[str, ...] = (), outputs: tuple[str, ...] = ()
) -> ca.Function:
    """The pendulum as a casadi.Function in MX with its inputs in a given order."""
    inputs = {"x": XM, "u": UM, "p": PM, "t": ca.MX.sym("t")}
    rows = ca.vertcat(*pendulum(XM, UM, PM))
    results = [rows] if not outputs else [rows if o == "xdot" else UM for o in outputs]
    given = [inputs[letter] for letter in order]
    named: Any = [list(names), list(outputs or ["o0"])] if names or outputs else []
    swing: ca.Function = ca.Function("swing", given, results, *named)
    return swing


class Swing:
    """An object that can be called like a function."""

    def __call__(self, x: ca.SX, u: ca.SX, p: ca.SX) -> list[Any]:
        """Return the rows."""
        return pendulum(x, u, p)


def with_options(x: ca.SX, u: ca.SX, *, p: ca.SX, length: float = 1.0) -> Any:
    return ca.vertcat(*pendulum(x, u, p)) * length


def in_numpy(x: ca.SX, u: ca.SX, p: ca.SX) -> NDArray[np.object_]:
    return np.array(pendulum(x, u, p), dtype=object)


def of_anything(*arguments: ca.SX) -> list[Any]:
    return pendulum(*arguments)


FORMS: dict[str, tuple[Given, str]] = {
    "expression": (ca.vertcat(*pendulum(X, U, P)), ""),
    "list": (pendulum(X, U, P), ""),
    "tuple": (tuple(pendulum(X, U, P)), ""),
    "function by sizes": (function("x", "u", "p"), ""),
    "function by names": (function("p", "u", "x", names=("params", "u", "x")), ""),
    "function by signature": (function("u", "x", "p"), "uxp"),
    "function of the time": (
        function("t", "x", "u", "p", names=("time", "x", "u", "p")), ""),
    "function, named output": (
        function("x", "u", "p", names=("x", "u", "p"), outputs=("cost", "xdot")), ""),
    "python function": (pendulum, ""),
    "python function by names": (lambda u, p, x: pendulum(x, u, p), ""),
    "python function by number": (lambda t, y, v, c: pendulum(y, v, c), ""),
    "python function by signature": (lambda a, b, c: pendulum(b, a, c), "uxp"),
    "python function of anything": (of_anything, "xup"),
    "object": (Swing(), ""),
    "keyword and default": (with_options, ""),
    "partial": (functools.partial(with_options, length=1.0), ""),
    "numpy array": (in_numpy, ""),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_right_hand_side(form: str) -> None:
    given, signature = FORMS[form]
    rows = symbolic_rows("ode", given, SYMBOLS, signature=signature)
    assert rows.shape == (2, 1)
    place = [[0.3, 0.7], 2.0, [3.0, 9.81, 0.1]]
    values = [
        np.array(ca.Function("rows", [X, U, P], [r])(*place))
        for r in (rows, ca.vertcat(*pendulum(X, U, P)))
    ]
    np.testing.assert_array_equal(values[0], values[1])


def test_mx_symbols_and_expressions_are_brought_to_sx() -> None:
    model = modelled(
        states=XM, controls=UM, parameters=PM, ode=ca.vertcat(*pendulum(XM, UM, PM))
    )
    assert model.state_names == ("x_0", "x_1")
    assert isinstance(model.states, ca.SX)
    plain = modelled(states=X, controls=U, parameters=P, ode=pendulum(X, U, P))
    place = [[0.3, 0.7], 2.0, [3.0, 9.81, 0.1]]
    values = [np.array(right_hand_side(m)(*place)) for m in (model, plain)]
    np.testing.assert_array_equal(values[0], values[1])
    assert model.sx("cost", UM**2).shape == (1, 1)


def swing_up(model: Model, x: Any, u: Any, s: Any) -> OptimalControlProblem:
    rows: Any = [x[0], x[1]]
    return OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=8,
        stage_cost=u**2 + 0.1 * (x[0] - s) ** 2,
        terminal_cost=x[0] ** 2,
        bounds=Bounds(controls=(-8.0, 8.0)),
        constraints=[x[1] <= 4, PathConstraint(expression=rows, lower=-6)],
        terminal=[x[0] == 0.5, (x[1], 0.0)],
        signals=s,
        substeps=2,
    )


def test_every_form_has_the_same_answer() -> None:
    numbers = [1.0, 9.81, 0.1]
    s: Any = ca.SX.sym("s")
    sm: Any = ca.MX.sym("s")
    as_list = pendulum(X, U, numbers)
    in_mx = ca.vertcat(*pendulum(XM, UM, numbers))
    posed = [
        swing_up(modelled(states=X, controls=U, ode=ca.vertcat(*as_list)), X, U, s),
        swing_up(modelled(states=X, controls=U, ode=as_list), X, U, s),
        swing_up(modelled(states=XM, controls=UM, ode=in_mx), XM, UM, sm),
        swing_up(
            modelled(states=X, controls=U, ode=lambda x, u: pendulum(x, u, numbers)),
            X, U, s,
        ),
        swing_up(
            modelled(states=X, controls=U, ode=ca.Function("swing", [XM, UM], [in_mx])),
            X, U, s,
        ),
    ]  # fmt: skip
    known = ss.Known(signals=np.linspace(0.0, 0.5, 9)[None, :])
    first, *others = [
        ss.solve(problem, [0.0, 0.0], budget=400, seed=0, known=known)
        for problem in posed
    ]
    assert first.status is ss.SolutionStatus.CONVERGED
    for answer in others:
        assert answer.cost == first.cost
        np.testing.assert_array_equal(answer.controls, first.controls)
        np.testing.assert_array_equal(answer.states, first.states)


def test_a_function_is_called_in_the_models_roles_only() -> None:
    """An argument with a default keeps it if the model has no such symbols."""
    model = modelled(
        states=X, controls=U, ode=lambda x, u, t=2.0, p=3.0: [t * u, p * u]
    )
    values = np.array(right_hand_side(model)([0, 0], 5.0, [])).ravel()
    np.testing.assert_array_equal(values, [10.0, 15.0])


def in_math(x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [x[1], u - math.sin(x[0])]


def branching(x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [x[1], u] if x[0] > 0 else [x[1], -u]


A: Any = ca.MX.sym("a")
SCALAR = {"states": ca.SX.sym("x"), "controls": U, "parameters": ca.SX(0, 1)}
TURNED = ca.Function("f", [UM, XM], [XM])
HALF_NAMED = ca.Function("f", [XM, UM], [XM], ["u", "wind"], ["xdot"])
BY_NAME = ca.Function("f", [XM, UM], [XM], ["x", "wind"], ["xdot"])


@pytest.mark.parametrize(
    ("given", "symbols", "signature", "message"),
    [
        (
            in_math, SYMBOLS, "",
            "ode, the function 'in_math', must return rows without NaN: .*casadi.sin",
        ),
        (branching, SYMBOLS, "", "'branching', raised RuntimeError: .*if_else"),
        (lambda x, u: [u], SYMBOLS, "", "one row for each of the 2 states, got 1"),
        (lambda x, u: None, SYMBOLS, "", "must return the rows, got None"),
        (lambda x, u: "xu", SYMBOLS, "", "must be a CasADi SX expression, got xu"),
        (lambda x, u: [x, A], SYMBOLS, "", "MX symbols .* of the model: a"),
        (lambda: [U], SYMBOLS, "", "can be told apart: .* it has none"),
        (lambda *args: [U], SYMBOLS, "", r"told apart: .* it has \*args"),
        (lambda a, b, c: [U], SYMBOLS, "", "give signature='xup' .* a, b, c"),
        (lambda u, x, d: [U], SCALAR, "", "told apart: .* it has u, x, d"),
        (lambda u, v: [U], SCALAR, "", "told apart: .* it has u, v"),
        (lambda t, x: x, SCALAR, "", "depends on the time, the model has no symbol"),
        (lambda a, b: [U], SYMBOLS, "x", "raised TypeError: .*missing 1"),
        (pendulum, SYMBOLS, "xuq", "signature must be letters such as 'txup'.*'xuq'"),
        (pendulum, SYMBOLS, "xux", "signature must have each letter once"),
        (pendulum, SYMBOLS, 3, "signature must be letters"),
        (BY_NAME, SYMBOLS, "x", "signature must have a letter for each"),
        (TURNED, SYMBOLS, "", r"told apart: .*i0 \(1\), i1 \(2\)"),
        (HALF_NAMED, SYMBOLS, "", r"told apart: .*u \(2\), wind \(1\)"),
        (BY_NAME, SCALAR, "", r"told apart: .*x \(2\), wind \(1\)"),
        (
            ca.Function("f", [A, UM], [A * UM]), SCALAR, "",
            "can be told apart: .* signature=",
        ),
        (BY_NAME, SCALAR, "xu", "has 2 rows in its input 'x', .* 1 states"),
        (ca.Function("f", [XM, UM], [UM]), SYMBOLS, "", "for each of the 2 .*, got 1"),
        (ca.Function("f", [XM, UM], []), SYMBOLS, "", "must have an output, it has no"),
        (A, SYMBOLS, "", "ode has MX symbols .*: a"),
        ("x", SYMBOLS, "", "ode must be a CasADi SX expression, got x"),
        ([A, X[0]], SYMBOLS, "", "ode has MX symbols"),
    ],
)  # fmt: skip
def test_refuses_what_has_no_rows(
    given: Given, symbols: dict[str, ca.SX], signature: str, message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        symbolic_rows("ode", given, symbols, signature=signature)


def test_the_error_of_a_function_is_chained() -> None:
    with pytest.raises(InvalidProblemError) as caught:
        symbolic_rows("ode", branching, SYMBOLS)
    assert caught.value.__cause__ is not None


def test_the_next_state_has_outputs_of_other_names() -> None:
    f = ca.Function("f", [XM, UM], [XM, 2 * XM], ["x", "u"], ["xdot", "x_next"])
    for role, factor in (("ode", 1), ("next_state", 2)):
        rows = symbolic_rows(role, f, SYMBOLS)
        np.testing.assert_array_equal(
            np.array(ca.Function("rows", [X], [rows])([1.0, 2.0])).ravel(),
            factor * np.array([1.0, 2.0]),
        )


INTEGRATOR = """
    import casadi as ca
    import swarmstart as ss

    x, u = ca.MX.sym("x"), ca.MX.sym("u")
    flow = ca.integrator("flow", "cvodes", {"x": x, "p": u, "ode": -x * u}, 0, 1)
    end = flow(x0=x, p=u)["xf"]
    X, U = ca.SX.sym("x"), ca.SX.sym("u")
    z = ca.SX.sym("z")
    made = (
        lambda: ss.Model(states=X, controls=U, ode=ca.Function("f", [x, u], [end]),
                         signature="xu"),
        lambda: ss.Model(states=x, controls=u, ode=end),
        lambda: ss.OptimalControlProblem(
            ss.Model(states=x, controls=u, ode=x), horizon=1, intervals=1,
            stage_cost=end),
    )
    for make in made:
        try:
            make()
        except ss.InvalidProblemError as error:
            print(error)
"""


def test_an_integrator_inside_is_refused_without_a_crash() -> None:
    """CasADi 3.8.2 ends the process if such calls are substituted."""
    ran = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(INTEGRATOR)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    said = ran.stdout.splitlines()
    assert len(said) == 3
    assert all("it calls flow (CvodesInterface)" in line for line in said)


def test_a_callable_is_called_once() -> None:
    calls: list[int] = []

    def counted(x: Any, u: Any) -> Any:
        calls.append(1)
        return x * u

    modelled(states=X, controls=U, ode=counted)
    assert len(calls) == 1
