"""Bounds of the Hamilton-Jacobi-Bellman inequality: no point and no control is below.

The controls are found by trying: none of the closed forms is used.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.basis import Basis, Box, packed
from swarmstart.ocp.lower_bound.hamiltonian import (
    Inequality,
    Margin,
    Quadratic,
    settled,
)
from swarmstart.ocp.lower_bound.stated.statement import Statement, affine_form
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
)
from swarmstart.tests.ocp.lower_bound.statements import Rate, stated

Cost = Callable[[ca.SX, ca.SX, ca.SX], ca.SX | float]

DEGREE = 4
COUNT = 40


def costing(
    rate: Rate, cost: Cost, controls: Sequence[tuple[float, float]], n: int = 2
) -> Statement:
    """A statement with a stage cost of (t, x, u)."""
    bare = stated(rate, [0.0] * n, controls, 1.0)
    return replace(bare, stage=ca.SX(cost(bare.time, bare.states, bare.controls)))


def pendulum(_: ca.SX, x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [x[1], u[0] * ca.cos(x[0]) - ca.sin(x[0])]


def twice(t: ca.SX, x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [u[0] * ca.exp(x[1] / 2) + u[1], x[0] / (3 + t + x[1]) - u[1] * x[0]]


def bent(t: ca.SX, x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [ca.sin(2 * u[0]) * ca.exp(x[1]), x[0] / (4 + x[1] + t) + u[0] ** 2]


ONE, BOTH = [(-0.5, 1.5)], [(-1.0, 1.0), (0.5, 2.0)]
STATEMENTS = {
    "curved": costing(pendulum, lambda t, x, u: x[0] ** 2 + 0.3 * u[0] ** 2, ONE),
    "curved and linear": costing(
        pendulum, lambda t, x, u: ca.sin(t) + u[0] ** 2 - 0.4 * u[0], ONE
    ),
    "hardly curved": costing(
        pendulum, lambda t, x, u: x[1] ** 2 + 0.004 * u[0] ** 2, ONE
    ),
    "strongly curved": costing(
        pendulum, lambda t, x, u: x[1] ** 2 + 40 * u[0] ** 2, ONE
    ),
    "bang-bang": costing(pendulum, lambda t, x, u: 1 + x[0] ** 2, ONE),
    "bang-bang and linear": costing(
        pendulum, lambda t, x, u: x[0] ** 2 + 0.7 * u[0], [(1, 3)]
    ),
    "both": costing(
        twice, lambda t, x, u: x[0] * x[1] + 0.2 * u[1] ** 2 + 0.1 * u[0], BOTH
    ),
    "fixed": costing(pendulum, lambda t, x, u: 1 + u[0], [(0.3, 0.3)]),
    "fixed, curved": costing(pendulum, lambda t, x, u: 1 + u[0] ** 2, [(0.3, 0.3)]),
    "not affine": costing(bent, lambda t, x, u: ca.exp(-x[0]) + u[0] ** 2, ONE),
    "product": costing(
        pendulum, lambda t, x, u: x[0] ** 2 * u[0] + u[0] ** 2 * (2 + x[1]), ONE
    ),
    "concave": costing(pendulum, lambda t, x, u: x[0] ** 2 - u[0] ** 2, ONE),
}
AFFINE = [
    name for name, statement in STATEMENTS.items() if affine_form(statement) is not None
]


@dataclass(frozen=True)
class Case:
    """The inequality of a polynomial with coefficients at random."""

    inequality: Inequality
    statement: Statement
    rates: ca.Function
    basis: Basis
    box: Box
    w: Array

    @property
    def parameters(self) -> Array:
        return packed(self.basis.polynomial(self.box, self.w))

    def h(self, points: Array, u: Array) -> Array:
        """V_t + L + V_x f at points (1 + n, N), controls (m, N)."""
        return self._h(self._slopes(points), points, u)

    def _slopes(self, points: Array) -> Array:
        return np.asarray(self.basis.slopes(self.box, points) @ self.w)

    def _h(self, slopes: Array, points: Array, u: Array) -> Array:
        f, L = (np.array(part) for part in self.rates(points, u))
        return np.asarray(slopes[0] + L[0] + (slopes[1:] * f).sum(axis=0))

    def least(self, points: Array) -> Array:
        """The least h over controls, by trying and bending through the best three."""
        low, high = self.statement.control_box
        tried = 9 if len(low) == 1 else 3
        slopes, count = self._slopes(points), points.shape[1]
        found, best = np.full(count, np.inf), np.zeros((len(low), count))
        axes = [np.linspace(a, b, tried) for a, b in zip(low, high, strict=True)]
        for u in itertools.product(*axes):
            each = np.repeat(np.array(u)[:, None], count, axis=1)
            h = self._h(slopes, points, each)
            best = np.where(h < found, each, best)
            found = np.minimum(h, found)
        for k in range(len(low)):
            step = (high[k] - low[k]) / (tried - 1)
            if step > 0:
                best = self._bent(slopes, points, best, (k, step))
        return np.asarray(np.minimum(found, self._h(slopes, points, best)))

    def _bent(
        self, slopes: Array, points: Array, u: Array, along: tuple[int, float]
    ) -> Array:
        """Controls at the bottom of the parabola through three of control k."""
        k, step = along
        low, high = (float(end[k]) for end in self.statement.control_box)
        inner = u.copy()
        inner[k] = np.clip(u[k], low + step, high - step)
        axis = step * np.eye(len(u))[k][:, None]
        sides = [inner + s * axis for s in (-1, 0, 1)]
        below, at, above = (self._h(slopes, points, side) for side in sides)
        curve = below - 2 * at + above
        bottom = inner.copy()
        safe = np.where(curve > 0, curve, 1.0)
        bottom[k] = np.clip(inner[k] + step * (below - above) / 2 / safe, low, high)
        better = self._h(slopes, points, bottom) < self._h(slopes, points, u)
        return np.where(better, bottom, u)


@cache
def form(name: str) -> tuple[Inequality, ca.Function]:
    """The inequality of a statement, and its f and L."""
    one = STATEMENTS[name]
    basis = Basis(1 + one.n, DEGREE)
    rates = ca.Function("f", [one.point, one.controls], [one.rate, one.stage])
    return Inequality(one, affine_form(one), basis), rates


def case(name: str, seed: int, size: float = 1.0) -> Case:
    statement = STATEMENTS[name]
    basis = Basis(1 + statement.n, DEGREE)
    rng = np.random.default_rng(seed)
    inequality, rates = form(name)
    box = Box(np.array([0.5, 0.1, -0.1]), np.array([0.6, 1.5, 1.2]))
    w = size * rng.normal(size=basis.size)
    return Case(inequality, statement, rates, basis, box, w)


def boxes(size: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Boxes of (t, x) of very unequal sides, some of them flat."""
    middle = rng.uniform(-1, 1, (3, COUNT))
    reach = size * 10.0 ** rng.uniform(-2, 0, (3, COUNT))
    reach[rng.random((3, COUNT)) < 0.1] = 0.0
    return middle - reach, middle + reach


def inner(lower: Array, upper: Array, rng: np.random.Generator) -> list[Array]:
    """Corners, middles and points at random of boxes, (d, m) each."""
    corners = itertools.product([0.0, 1.0], repeat=len(lower))
    shares = [np.full(lower.shape, np.array(c)[:, None]) for c in corners]
    shares += [rng.random(lower.shape) for _ in range(12)]
    # About the middles, too: bounds of small boxes are close there.
    shares += [0.5 + 0.2 * (rng.random(lower.shape) - 0.5), np.full(lower.shape, 0.5)]
    return [np.clip(lower + (upper - lower) * s, lower, upper) for s in shares]


@pytest.mark.parametrize("name", AFFINE)
@pytest.mark.parametrize("size", [1.0, 0.2, 0.01, 1e-4])
def test_no_control_is_below_the_bound_of_a_box(name: str, size: float) -> None:
    for seed, weight in enumerate([0.1, 1.0, 10.0]):
        one = case(name, seed, weight)
        assert not one.inequality.with_controls
        rng = np.random.default_rng(seed)
        lower, upper = boxes(size, rng)
        found = one.inequality.bounds(one.parameters, lower, upper)
        assert np.isfinite(found.low).all()
        assert (found.spread >= 0).all()
        points = np.array(inner(lower, upper, rng))
        flat = points.transpose(1, 0, 2).reshape(3, -1)
        least = one.least(flat).reshape(-1, COUNT).min(axis=0)
        # As exact as h is found here.
        assert (least >= found.low - 1e-13 * (1 + np.abs(least))).all()


@pytest.mark.parametrize("name", sorted(set(STATEMENTS) - set(AFFINE)))
@pytest.mark.parametrize("size", [1.0, 0.2, 0.01, 1e-4])
def test_no_point_is_below_the_bound_of_a_box_with_controls(
    name: str, size: float
) -> None:
    one = case(name, 4)
    assert one.inequality.with_controls
    rng = np.random.default_rng(5)
    lower, upper = boxes(size, rng)
    ends = np.sort(rng.uniform(-0.5, 1.5, (2, 1, COUNT)), axis=0)
    ends[1] = np.minimum(ends[1], ends[0] + size)
    lower, upper = np.vstack([lower, ends[0]]), np.vstack([upper, ends[1]])
    found = one.inequality.bounds(one.parameters, lower, upper)
    assert found.spread.shape == (4, COUNT)
    assert np.isfinite(found.low).all()
    for point in inner(lower, upper, rng):
        h = one.h(point[:3], point[3:])
        assert (h >= found.low - 1e-13 * (1 + np.abs(h))).all()


@pytest.mark.parametrize("name", STATEMENTS)
def test_the_bound_of_a_point_is_its_value(name: str) -> None:
    one = case(name, 6)
    rng = np.random.default_rng(7)
    at = rng.uniform(-1, 1, (3, COUNT))
    if one.inequality.with_controls:
        u = rng.uniform(-0.5, 1.5, (1, COUNT))
        exact = one.h(at, u)
        at = np.vstack([at, u])
    else:
        exact = one.least(at)
    found = one.inequality.bounds(one.parameters, at, at)
    assert found.low == pytest.approx(exact, abs=1e-8)


def scalar(
    cost: Callable[[ca.SX, ca.SX], ca.SX | float], controls: tuple[float, float]
) -> Inequality:
    """x' = u with V = x^2 / 2, by `half_square`."""
    one = costing(lambda _, x, u: [u[0]], lambda _, x, u: cost(x, u), [controls], n=1)
    return Inequality(one, affine_form(one), Basis(2, 2))


def half_square() -> Array:
    basis, box = Basis(2, 2), Box(np.zeros(2), np.ones(2))
    w = np.zeros(basis.size)
    rows = basis.exponents.tolist()
    w[rows.index([0, 2])], w[0] = 0.25, 0.25
    return packed(basis.polynomial(box, w))


def interval(low: float, high: float) -> tuple[Array, Array]:
    return np.array([[0.0], [low]]), np.array([[0.0], [high]])


@pytest.mark.parametrize(
    ("cost", "controls", "x", "exact"),
    [
        # h = x u + u^2: least -x^2 / 4 inside, and at an end beyond x = -2 or 2.
        (lambda x, u: u[0] ** 2, (-1, 1), (-1.0, 1.0), -0.25),
        (lambda x, u: u[0] ** 2, (-1, 1), (0.5, 1.5), -0.5625),
        (lambda x, u: u[0] ** 2, (-1, 1), (3.0, 7.0), -6.0),
        (lambda x, u: u[0] ** 2, (-1, 1), (-7.0, -3.0), -6.0),
        # h = x u: least -|x|; crossing boxes have their chord.
        (lambda x, u: 0, (-1, 1), (0.5, 2.0), -2.0),
        (lambda x, u: 0, (-1, 1), (-2.0, -0.5), -2.0),
        (lambda x, u: 0, (-1, 1), (-1.0, 1.0), -1.0),
        (lambda x, u: 0, (-1, 3), (-2.0, 1.0), -6.0),
        (lambda x, u: x[0] * x[0], (0, 0), (0.5, 2.0), 0.25),
        (lambda x, u: 2 * u[0], (-1, 1), (0.5, 2.0), -4.0),
        (lambda x, u: u[0] ** 2 - 4 * u[0], (-1, 1), (-1.0, 0.5), -4.0),
    ],
)
def test_bounds_of_x_u_are_those_by_hand(
    cost: Callable[[ca.SX, ca.SX], ca.SX],
    controls: tuple[float, float],
    x: tuple[float, float],
    exact: float,
) -> None:
    found = scalar(cost, controls).bounds(half_square(), *interval(*x))
    assert found.low[0] <= exact
    assert found.low[0] == pytest.approx(exact, abs=1e-9)


def test_a_box_whose_control_leaves_its_bound_is_not_called_clipped() -> None:
    # The control is at its end in the middle of the box, free at its side: the tangent
    # there is above h, with or without sign.
    bound = scalar(lambda x, u: u[0] ** 2, (-1, 1))
    for low, high in [(1.0, 4.0), (-4.0, -1.0), (1.9, 2.2), (-2.2, -1.9)]:
        found = bound.bounds(half_square(), *interval(low, high))
        x = np.linspace(low, high, 101)
        u = np.clip(-x / 2, -1, 1)
        assert found.low[0] <= (x * u + u * u).min()
        y = np.linspace(low, high, 11)
        parts = bound.bounds(
            half_square(),
            np.vstack([0 * y[:-1], y[:-1]]),
            np.vstack([0 * y[1:], y[1:]]),
        )
        assert (parts.low <= (x * u + u * u)[:-1].reshape(10, 10).min(axis=1)).all()


@pytest.mark.parametrize("name", ["curved", "hardly curved", "fixed", "not affine"])
def test_the_error_falls_as_the_cube_of_an_interval(name: str) -> None:
    # Along one axis: what axes share costs a square. So does a control that comes to
    # its end within the box: a few boxes may have one.
    one = case(name, 8, 0.2)
    rng = np.random.default_rng(9)
    middle = rng.uniform(-0.8, 0.8, (3, COUNT))
    if one.inequality.with_controls:
        middle = np.vstack([middle, np.full(COUNT, 0.4)])
    z = np.linspace(-1, 1, 33)
    for axis in range(3):
        errors = []
        for size in (0.1, 0.025):
            reach = size * np.eye(len(middle))[axis][:, None]
            found = one.inequality.bounds(
                one.parameters, middle - reach, middle + reach
            )
            at = (middle[..., None] + reach[..., None] * z).reshape(len(middle), -1)
            if one.inequality.with_controls:
                exact = one.h(at[:3], at[3:])
            else:
                exact = one.least(at)
            errors.append(exact.reshape(COUNT, -1).min(axis=1) - found.low)
        sharp = errors[1] <= errors[0] / 4**2.7 + 1e-5
        assert sharp.mean() >= 0.85


def cancelling(x: ca.SX) -> ca.SX:
    """0 as a number, but not as it is rounded."""
    return (x[0] + 1e8) ** 2 - x[0] ** 2 - 2e8 * x[0] - 1e16


@pytest.mark.parametrize(
    ("cost", "least"),
    [
        ((0, 1), 1.0),
        ((1, 0), 1.0),
        ((0, 0), 0.0),
        ((0, 0.01), 0.01),
        # Far from a switch: no chord and no curvature has room for the rounding.
        ((1000, 0), 1000.0),
        ((1000, 1), 1001.0),
        ((-1000, 1), -1996.0),
    ],
)
@pytest.mark.parametrize("where", ["drift", "column", "stage"])
def test_rounding_of_values_does_not_lift_the_bound(
    cost: tuple[float, float], least: float, where: str
) -> None:
    def stage(_: ca.SX, x: ca.SX, u: ca.SX) -> ca.SX:
        own = cost[0] * u[0] + cost[1] * u[0] ** 2
        return own + cancelling(x) if where == "stage" else own

    def rate(_: ca.SX, x: ca.SX, u: ca.SX) -> list[ca.SX]:
        factor = {"drift": ca.SX(1), "column": u[0], "stage": ca.SX(0)}[where]
        return [cancelling(x) * factor]

    # The larger end alone, of (0, 2), has to make room, too.
    one = costing(rate, stage, [(0 if cost[0] < 0 else 1, 2)], n=1)
    basis, box = Basis(2, 1), Box(np.zeros(2), np.ones(2))
    w = np.zeros(basis.size)
    w[basis.exponents.tolist().index([0, 1])] = 1.0  # V = x
    bound = Inequality(one, affine_form(one), basis)
    x = np.random.default_rng(0).random(300)
    at = np.vstack([0 * x, x])
    found = bound.bounds(packed(basis.polynomial(box, w)), at, at)
    assert (found.low <= least).all()
    with_width = bound.bounds(packed(basis.polynomial(box, w)), at - 1e-3, at + 1e-3)
    assert (with_width.low <= least).all()


def test_nothing_is_known_where_the_problem_has_no_number() -> None:
    one = costing(
        lambda _, x, u: [1 / x[0] * u[0]],
        lambda _, x, u: ca.sqrt(x[0]) + u[0] ** 2,
        [(-1, 1)],
        n=1,
    )
    bound = Inequality(one, affine_form(one), Basis(2, 2))
    lower = np.array([[0.0, 0.0, 0.0, 0.0], [-1.0, 0.0, -3.0, 1.0]])
    upper = np.array([[0.5, 0.5, 0.5, 0.5], [1.5, 0.7, -2.0, 2.0]])
    found = bound.bounds(half_square(), lower, upper)
    assert (found.low[:3] == -np.inf).all()
    # All boxes can be cut further, the longest side first.
    assert np.isfinite(found.spread).all()
    assert (found.spread.argmax(axis=0)[:3] == 1).all()
    assert np.isfinite(found.low[3])


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e300])
def test_coefficients_that_are_not_numbers_bound_nothing(number: float) -> None:
    for name in ("curved", "bang-bang", "both", "not affine"):
        one = case(name, 1)
        parameters = one.parameters
        parameters[6 + 5] = number
        lower, upper = boxes(0.5, np.random.default_rng(0))
        if one.inequality.with_controls:
            lower, upper = (np.vstack([end, end[:1]]) for end in (lower, upper))
        found = one.inequality.bounds(parameters, lower, upper)
        assert not np.isnan(found.low).any()
        assert np.isfinite(found.spread).all() or np.isinf(number) or number < np.inf
        if not np.isfinite(number):
            assert (found.low == -np.inf).all()


def test_problems_whose_derivatives_jump_are_refused() -> None:
    one = costing(
        lambda _, x, u: [ca.fabs(x[0]) + u[0]], lambda _, x, u: 0, [(-1, 1)], n=1
    )
    with pytest.raises(UnknownIntervalOperationError):
        Inequality(one, affine_form(one), Basis(2, 2))


def test_a_margin_is_nowhere_below_its_bound() -> None:
    point, given = ca.SX.sym("y", 3), ca.SX.sym("p", 2)
    margin = given[0] * ca.sin(point[0] * point[1]) + ca.exp(point[2]) / (3 + given[1])
    bound = Margin(margin - point[1] ** 3, point, given)
    value = ca.Function("g", [point, given], [margin - point[1] ** 3])
    parameters, rng = np.array([0.8, -0.5]), np.random.default_rng(3)
    for size in (1.0, 0.1, 1e-3):
        lower, upper = boxes(size, rng)
        found = bound.bounds(parameters, lower, upper)
        for at in inner(lower, upper, rng):
            g = np.array(value(at, parameters)).ravel()
            assert (g >= found.low - 1e-14).all()
        again = bound.bounds(parameters, lower, lower)
        exact = np.array(value(lower, parameters)).ravel()
        assert again.low == pytest.approx(exact, abs=1e-9)


def test_what_is_left_over_and_rounding_lower_a_quadratic_s_bound() -> None:
    one = np.ones((1, 2))
    at = Quadratic(
        reach=one,
        constant=np.array([5.0, 5.0]),
        slope=one,
        bend=0 * one,
        rest=np.array([0.0, 0.25]),
        pull=0.5 * one,
    )
    found = settled(at, [(0, 0)])
    assert found.low == pytest.approx([4.0, 3.75])
    assert (found.low < [4.0, 3.75]).all()
    assert found.spread == pytest.approx(1.5 * one)


def test_rounding_does_not_lift_the_bound_of_a_margin() -> None:
    x = ca.SX.sym("x")
    at = np.random.default_rng(0).random((1, 300))
    found = Margin(cancelling(x), x, ca.SX(0, 1)).bounds(np.zeros(0), at, at)
    assert (found.low <= 0).all()
