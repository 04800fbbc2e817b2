"""Tables: values and derivatives against CasADi and SciPy, and errors."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, RectBivariateSpline

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    SolutionStatus,
    Table,
    compile_batch,
    solve,
    table,
)
from swarmstart.ocp.interpolation.tables import Method
from swarmstart.ocp.rollout.kinks import kinks_of

METHODS: tuple[Method, ...] = ("linear", "bspline")
RNG = np.random.default_rng(0)
AT = np.array([-2.0, -1.5, -1.4, 0.0, 0.3, 1.0, 4.0, 4.5])
OVER = np.array([0.0, 1.0, 3.0, 3.5, 4.0, 7.0])
VALUES = RNG.normal(size=AT.size)
PLANE = RNG.normal(size=(AT.size, OVER.size))


def assert_close(found: object, wanted: object) -> None:
    """Values are about one; both sides round some ten times."""
    np.testing.assert_allclose(
        np.asarray(found, dtype=np.float64),
        np.asarray(wanted, dtype=np.float64),
        rtol=0,
        atol=1e-11,
    )


def inside(count: int) -> Array:
    """Return points within both inputs' breakpoints, including the end points."""
    random = np.random.default_rng(1)
    first, second = (random.uniform(a[0], a[-1], count) for a in (AT, OVER))
    corners = np.array([[AT[0], AT[-1], AT[0], AT[3]], [*OVER[[0, -1, -1, 2]]]])
    return np.hstack([corners, [first, second]])


def one_and_two(method: Method, **options: Any) -> tuple[Table, Table]:
    one = table(AT, VALUES, method, **options)
    return one, table((AT, OVER), PLANE, method, **options)


def functions(method: Method, **options: Any) -> tuple[ca.Function, ca.Function]:
    """Return both tables as functions of one column."""
    x = ca.SX.sym("x", 2)
    one, two = one_and_two(method, **options)
    return (
        ca.Function("one", [x[0]], [one(x[0])]),
        ca.Function("two", [x], [two(x[0], x[1])]),
    )


@pytest.mark.parametrize("method", METHODS)
def test_values_are_those_of_casadis_interpolant(method: Method) -> None:
    one, two = one_and_two(method)
    points = inside(200)
    n = points.shape[1]
    theirs = ca.interpolant("one", method, [AT], VALUES).map(n)(points[:1])
    assert_close(one.at(points[0]), np.array(theirs)[0])
    flat = PLANE.ravel(order="F")
    theirs = ca.interpolant("two", method, [AT, OVER], flat).map(n)(points)
    assert_close(two.at(*points), np.array(theirs)[0])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
def test_machine_code_gives_the_values_of_casadi(method: Method, outside: str) -> None:
    points = 1.5 * inside(100)
    for function in functions(method, outside=outside):
        given_to = points[: function.numel_in(0)]
        theirs = np.array(function.map(points.shape[1])(given_to))
        np.testing.assert_allclose(
            compile_batch(function, backend="llvm")(given_to), theirs, rtol=1e-12,
            atol=1e-12,
        )  # fmt: skip


def test_spline_and_its_derivatives_are_scipys_also_at_knots_and_outside() -> None:
    x = ca.SX.sym("x")
    value = table(AT, VALUES, "bspline")(x)
    slope = ca.jacobian(value, x)
    f = ca.Function("f", [x], [value, slope, ca.jacobian(slope, x)])
    points = np.concatenate([AT, np.linspace(-3, 6, 50)])
    ours = [np.array(part)[0] for part in f.map(points.size)(points[None])]
    theirs = CubicSpline(AT, VALUES, bc_type="not-a-knot")
    for order, part in enumerate(ours):
        wanted = theirs(points, order)
        size = np.abs(wanted).max()
        np.testing.assert_allclose(part, wanted, rtol=0, atol=1e-11 * size)


def test_spline_of_two_inputs_and_its_gradient_are_scipys() -> None:
    x = ca.SX.sym("x", 2)
    value = table((AT, OVER), PLANE, "bspline")(x[0], x[1])
    hessian, gradient = ca.hessian(value, x)
    f = ca.Function("f", [x], [ca.vertcat(value, gradient, ca.vec(hessian))])
    points = inside(50)
    ours = np.array(f.map(points.shape[1])(points))
    theirs = RectBivariateSpline(AT, OVER, PLANE, s=0)
    orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (1, 1), (0, 2)]
    for row, (dx, dy) in zip(ours, orders, strict=True):
        wanted = theirs.ev(*points, dx=dx, dy=dy)
        size = np.abs(wanted).max()
        np.testing.assert_allclose(row, wanted, rtol=0, atol=1e-11 * size)


def test_slope_of_a_linear_table_is_that_of_its_piece() -> None:
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.jacobian(table(AT, VALUES)(x), x)])
    middles = (AT[1:] + AT[:-1]) / 2
    slopes = np.array(f.map(middles.size)(middles[None]))[0]
    np.testing.assert_allclose(slopes, np.diff(VALUES) / np.diff(AT), rtol=1e-12)
    outside = np.array(f.map(2)(np.array([[AT[0] - 5, AT[-1] + 5]])))[0]
    np.testing.assert_array_equal(outside, slopes[[0, -1]])


breakpoints = st.lists(
    st.integers(-1000, 1000), min_size=4, max_size=12, unique=True
).map(lambda found: np.sort(found) / 100)


@given(
    at=breakpoints,
    cubic=st.lists(st.floats(-3, 3), min_size=4, max_size=4),
    x=st.floats(-12, 12),
)
@settings(deadline=None, max_examples=30)
def test_spline_reproduces_every_cubic_and_linear_every_line(
    at: Array, cubic: list[float], x: float
) -> None:
    size = 1e4 * max(1.0, *map(abs, cubic))
    condition = (np.ptp(at) / np.diff(at).min()) ** 2
    allowed = 1e-13 * size * condition + 1e-9
    spline = table(at, np.polyval(cubic, at), "bspline")
    assert float(spline.at(x)) == pytest.approx(np.polyval(cubic, x), abs=allowed)
    line = table(at, np.polyval(cubic[:2], at))
    assert float(line.at(x)) == pytest.approx(np.polyval(cubic[:2], x), abs=1e-9)


@given(at=breakpoints, x=st.floats(-20, 20), y=st.floats(-20, 20))
@settings(deadline=None, max_examples=10)
@pytest.mark.parametrize("method", METHODS)
def test_table_of_ones_is_one_everywhere(
    method: Method, at: Array, x: float, y: float
) -> None:
    assert float(table(at, np.ones(at.size), method).at(x)) == pytest.approx(1)
    ones = table((at, at), np.ones((at.size, at.size)), method)
    beyond = np.abs([x, y]).max() / np.diff(at).min()  # Bases as large as its cube.
    assert float(ones.at(x, y)) == pytest.approx(1, abs=1e-12 * (1 + beyond**6))


@given(at=breakpoints, x=st.floats(-20, 20), seed=st.integers(0, 99))
@settings(deadline=None, max_examples=30)
def test_held_linear_table_stays_within_its_values(
    at: Array, x: float, seed: int
) -> None:
    values = np.random.default_rng(seed).normal(size=at.size)
    found = float(table(at, values, outside="hold").at(x))
    assert values.min() - 1e-12 <= found <= values.max() + 1e-12
    assert found == pytest.approx(np.interp(x, at, values), abs=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_values_are_met_and_held(method: Method) -> None:
    one, two = one_and_two(method, outside="hold")
    assert_close(one.at(AT), VALUES)
    assert_close(two.at(AT[:, None], OVER), PLANE)
    assert_close(one.at([-1e300, -1e9, 1e300]), VALUES[[0, 0, -1]])
    assert_close(two.at(99, -99), PLANE[-1, 0])
    assert_close(two.at(-99, 3), PLANE[0, 2])


FLAT = np.where((AT > -1.45) & (AT < 3), VALUES, 2.0)
"""Values with constant first and last pieces."""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("outside", ["extrapolate", "hold"])
@pytest.mark.parametrize("values", [VALUES, FLAT])
def test_nan_gives_nan(method: Method, outside: Any, values: Array) -> None:
    x = ca.SX.sym("x", 2)
    one = table(AT, values, method, outside=outside)
    two = table((AT, OVER), values[:, None] + 0 * OVER, method, outside=outside)
    entries = ca.vertcat(one(x[0]), two(x[0], x[1]))
    f = ca.Function("f", [x], [entries])
    points = np.array([[np.nan, np.nan], [1.0, 9.0]])
    assert np.isnan(np.array(f.map(2)(points))).all()
    assert np.isnan(compile_batch(f, backend="llvm")(points)).all()
    other = table((AT, OVER), PLANE, method, outside=outside)
    assert np.isnan(other.at([1.0, np.nan], np.nan)).all()


def test_a_step_does_not_spoil_values_far_from_it() -> None:
    steep = table([0, 1, 1 + 1e-9, 2], [0, 1, 5, 4])
    points = [0.25, 1.0, 1.75]
    wanted = np.interp(points, steep.breakpoints[0], steep.values)
    np.testing.assert_allclose(steep.at(points), wanted, rtol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_vectors_are_taken_entry_by_entry(method: Method) -> None:
    one, two = one_and_two(method)
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    f = ca.Function("f", [x, y], [one(x), two(x, y), two(x, x)])
    points = np.array([-1.0, 0.2, 3.0])
    found = [np.array(part).ravel() for part in f(points, 2.5)]
    for ours, wanted in zip(
        found, (one.at(points), two.at(points, 2.5), two.at(points, points)),
        strict=True,
    ):  # fmt: skip
        assert_close(ours, wanted)
    assert one(ca.SX(2, 1)).shape == (2, 1)  # Zeros that are not stored.
    at_zero = ca.evalf(one(ca.SX(2, 1)))
    assert_close(np.array(at_zero).ravel(), one.at([0, 0]))


def test_matrix_expressions_are_taken() -> None:
    x = ca.MX.sym("x", 2)
    one, two = one_and_two("bspline")
    expressions: list[Any] = [one(x), two(x[0], 1.5)]
    f = ca.Function("f", [x], expressions)
    values, single = f([0.1, 3.3])
    assert_close(np.array(values).ravel(), one.at([0.1, 3.3]))
    assert_close(float(single), two.at(0.1, 1.5))


def test_numbers_are_copied_and_locked() -> None:
    values = VALUES.copy()
    found = table(AT, values)
    values[:] = 9.0
    np.testing.assert_array_equal(found.values, VALUES)
    with pytest.raises(ValueError, match="read-only"):
        found.values[0] = 1.0


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "falling": (lambda: table([0, 2, 1], [1, 2, 3]), "must increase, got 1 after 2"),
    "twice": (lambda: table([0, 1, 1], [1, 2, 3]), "must increase, got 1 after 1"),
    "lengths": (lambda: table([0, 1], [1, 2, 3]), r"shape \(2,\).*got \(3,\)"),
    "few": (lambda: table([0], [1]), "linear needs at least 2 breakpoints, got 1"),
    "three": (
        lambda: table([0, 1, 2], [1, 2, 3], "bspline"),
        "bspline needs at least 4 breakpoints, got 3",
    ),
    "nan": (lambda: table([0, 1], [1, np.nan]), "values must be finite"),
    "infinite": (lambda: table([0, np.inf], [1, 2]), "breakpoints must be finite"),
    "text": (lambda: table([0, 1], ["a", "b"]), "values must be numbers"),
    "method": (lambda: table([0, 1], [1, 2], "cubic"), "linear, bspline, got 'cubic'"),  # type: ignore[arg-type]
    "outside": (
        lambda: table([0, 1], [1, 2], outside="zero"),  # type: ignore[arg-type]
        "extrapolate, hold, got 'zero'",
    ),
    "inputs": (
        lambda: table(([0, 1], [0, 1], [0, 1]), np.zeros((2, 2, 2))),
        "one or two inputs, got 3",
    ),
    "turned": (
        lambda: table(([0, 1], [0, 1, 2]), np.zeros((3, 2))),
        r"shape \(2, 3\).*got \(3, 2\)",
    ),
    "matrix": (lambda: table(np.eye(2), [1, 2]), "list of numbers, got shape"),
    "near": (lambda: table([0, 5e-324, 1], [0, 1e308, 0]), "is not finite"),
    "arguments": (lambda: table([0, 1], [1, 2])(1, 2), "takes 1 argument.s., got 2"),
    "at": (lambda: table([0, 1], [1, 2]).at(1, 2), "takes 1 argument.s., got 2"),
    "a text": (lambda: table([0, 1], [1, 2])("x"), "expressions or numbers, got x"),
    "shapes": (
        lambda: one_and_two("linear")[1](ca.SX(2, 1), ca.SX(3, 1)),
        r"one shape, or scalar, got \(2, 1\) and \(3, 1\)",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_table_is_refused(name: str) -> None:
    make, message = REFUSED[name]
    with pytest.raises(InvalidProblemError, match=message):
        make()


def of(cost: Callable[[ca.SX], ca.SX]) -> OptimalControlProblem:
    """Return min of the integral of cost(u) over 1 s, x' = u, |u| <= 1."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        stage_cost=cost(u),
        bounds=Bounds(controls=(-1, 1)),
    )


def status(cost: Callable[[ca.SX], ca.SX]) -> SolutionStatus:
    return solve(
        of(cost), [0], search=None, guess=[0.3, 0.3], backend="casadi", seed=0
    ).status


def test_optimum_of_a_spline_is_a_local_optimum_also_on_its_knot() -> None:
    """The parabola's least value is at 0.1, where two pieces meet."""
    at = np.array([-1, -0.5, 0.1, 0.4, 1])
    parabola = table(at, (at - 0.1) ** 2, "bspline")
    assert kinks_of(of(parabola)).names == ()
    assert status(parabola) is SolutionStatus.CONVERGED


def test_optimum_on_the_knot_of_a_linear_table_is_not_called_one() -> None:
    def cost(u: ca.SX) -> ca.SX:
        return 0.1 * (u - 0.3) ** 2 + table([-1, 0.1, 1], [1, 0, 1])(u)

    assert status(cost) is SolutionStatus.FEASIBLE
    assert status(lambda u: cost(u) - 2 * u) is SolutionStatus.CONVERGED


def test_kinks_of_a_linear_table_are_its_knots_where_the_slope_changes() -> None:
    at = np.arange(0, 1.05, 0.1)
    bent = table(at, np.where(at < 0.65, 0.3 * at, 0.18 + 7 * (at - 0.6)))
    (name,) = kinks_of(of(bent)).names
    assert name == "fmin(u,0.6)"
    assert_close(bent.at(at), bent.values)
    line = table((at, at), 0.3 * at[:, None] + 0.7 * at)
    assert kinks_of(of(lambda u: line(u, u))).names == ()
    ends = kinks_of(of(table([2, 3], [0, 1], outside="hold"))).names
    assert len(ends) == 2
    assert "3" in ends[0] + ends[1] and "2" in ends[0] + ends[1]


def test_planning_with_tables_runs_in_machine_code(
    recwarn: pytest.WarningsRecorder,
) -> None:
    one, two = one_and_two("bspline")
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u + 0.1 * one(x)),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2 + two(x, u),
        bounds=Bounds(controls=(-1, 1)),
    )
    solution = solve(problem, [0], budget=500, seed=0)
    assert solution.status is SolutionStatus.CONVERGED
    assert not recwarn.list
