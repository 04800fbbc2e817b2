"""CasADi's interpolants: read and compiled, or left to CasADi if that fails."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    BackendWarning,
    Bounds,
    Model,
    OptimalControlProblem,
    SolutionStatus,
    compile_batch,
    solve,
)
from swarmstart.ocp.interpolation import interpolants as module
from swarmstart.ocp.interpolation.interpolants import (
    read_interpolant,
    without_interpolants,
)

AT = np.array([0.0, 1.0, 2.5, 4.0, 5.0, 7.0])
RNG = np.random.default_rng(0)
VALUES, PLANE, SPACE = (RNG.normal(size=6**n) for n in (1, 2, 3))
X = ca.SX.sym("x", 2)
METHODS = ("linear", "bspline")
POINTS = np.random.default_rng(1).uniform(-3, 10, (2, 300))


def of_one(method: str, **options: Any) -> ca.Function:
    return ca.interpolant("one", method, [AT], VALUES, options)


def of_two(method: str, **options: Any) -> ca.Function:
    return ca.interpolant("two", method, [AT, AT], PLANE, options)


def of_two_outputs(method: str) -> ca.Function:
    return ca.interpolant("both", method, [AT], np.concatenate([VALUES, VALUES**2]))


def same_in_machine_code(expression: ca.SX) -> None:
    """Evaluate on all points, within and outside, without a warning."""
    f = ca.Function("f", [X], [expression])
    ours = compile_batch(f, backend="llvm")
    assert ours.backend == "llvm"
    theirs = np.array(f.map(POINTS.shape[1])(POINTS))
    np.testing.assert_allclose(ours(POINTS), theirs, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_interpolants_run_in_machine_code(
    method: str, recwarn: pytest.WarningsRecorder
) -> None:
    one, two, both = of_one(method), of_two(method), of_two_outputs(method)
    same_in_machine_code(one(X[0]))
    same_in_machine_code(two(X))
    same_in_machine_code(both(X[1]))
    nested = one(ca.sin(two(X)) * 4) + X[1] * both(one(X[1]))
    same_in_machine_code(ca.vertcat(nested, X, one(X[0]) ** 2))
    assert not recwarn.list


@pytest.mark.parametrize(
    ("function", "inputs"),
    [
        (of_one("bspline", degree=[2]), 1),
        (of_one("bspline", algorithm="smooth_linear"), 1),
        (of_two("bspline", degree=[2, 3]), 2),
        (of_one("linear", lookup_mode=["binary"]), 1),
    ],
)
def test_options_of_an_interpolant_are_read(function: ca.Function, inputs: int) -> None:
    (found,) = read_interpolant(function) or ()
    assert len(found.knots) == inputs
    same_in_machine_code(function(X[:inputs]))


@pytest.mark.parametrize("method", METHODS)
def test_matrix_functions_that_expand_run_in_machine_code(method: str) -> None:
    x = ca.MX.sym("x", 2)
    f = ca.Function("f", [x], [of_two(method)(x) * x[0]])
    np.testing.assert_allclose(
        compile_batch(f, backend="llvm")(POINTS),
        np.array(f.map(POINTS.shape[1])(POINTS)),
        rtol=1e-10,
        atol=1e-10,
    )


@pytest.mark.parametrize("method", METHODS)
def test_an_interpolant_is_read_after_its_derivatives_were_made(method: str) -> None:
    """The serialisation then contains the derivatives."""
    for made, inputs in ((of_one, 1), (of_two, 2)):
        function, x = made(method), ca.MX.sym("x", inputs)
        before = read_interpolant(function) or ()
        hessian, gradient = ca.hessian(function(x), x)
        ca.Function("f", [x], [hessian, gradient])(np.ones(inputs))
        after = read_interpolant(function) or ()
        assert before and after
        np.testing.assert_array_equal(before[0].coefficients, after[0].coefficients)
        same_in_machine_code(function(X[:inputs]))


@pytest.mark.parametrize("method", METHODS)
def test_an_interpolant_of_three_inputs_is_left_to_casadi(method: str) -> None:
    three = ca.interpolant("three", method, [AT] * 3, SPACE)
    assert read_interpolant(three) is None
    f = ca.Function("f", [X], [three(ca.vertcat(X, X[0]))])
    with pytest.warns(BackendWarning, match="evaluated by CasADi"):
        assert compile_batch(f).backend == "casadi"


def test_other_functions_and_grids_that_are_arguments_are_none() -> None:
    x = ca.SX.sym("x")
    assert read_interpolant(ca.Function("f", [x], [x**2])) is None
    assert read_interpolant(ca.interpolant("one", "linear", [AT])) is None
    without = ca.Function("f", [x], [ca.sin(x)])
    assert without_interpolants(without) is without


@pytest.mark.parametrize("method", METHODS)
def test_what_is_written_in_another_way_is_not_read(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another version of CasADi, or values that do not agree."""
    real = module._bytes
    for old, new in ((b"gridVJ", b"gridWJ"), (b"knotsVJ", b"knotsXJ")):
        monkeypatch.setattr(module, "_bytes", lambda t, o=old, n=new: swapped(t, o, n))
        if old in real(of_one(method).serialize({"debug": True})):
            assert (read_interpolant(of_one(method)) is None) == (
                (method == "linear") == (old == b"gridVJ")
            )
    number = np.float64(AT[2]).tobytes()
    monkeypatch.setattr(
        module, "_bytes", lambda text: real(text).replace(number, bytes(8))
    )
    assert read_interpolant(of_one(method)) is None


def swapped(text: str, old: bytes, new: bytes) -> bytes:
    halves = np.frombuffer(text.encode(), dtype=np.uint8) - ord("a")
    return bytes(halves[0::2] | (halves[1::2] << 4)).replace(old, new)


@pytest.mark.parametrize("method", METHODS)
def test_the_values_of_two_interpolants_of_one_name_are_told_apart(method: str) -> None:
    """The key of the machine-code cache contains all that determines the code."""
    for values in (VALUES, -VALUES):
        f = ca.interpolant("one", method, [AT], values)
        same_in_machine_code(f(X[0]))


def test_a_problem_with_an_interpolant_is_solved_in_machine_code(
    recwarn: pytest.WarningsRecorder,
) -> None:
    """The polish differentiates CasADi's interpolant, the search runs ours."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    wavy = ca.interpolant("wavy", "bspline", [np.linspace(-3, 3, 9)],
                          np.cos(np.linspace(-3, 3, 9)))  # fmt: skip
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - wavy(x)),
        horizon=1.0,
        intervals=5,
        stage_cost=u**2 + x**2,
        bounds=Bounds(controls=(-1, 1)),
    )
    assert solve(problem, [1], budget=500, seed=0).status is SolutionStatus.CONVERGED
    assert not recwarn.list
