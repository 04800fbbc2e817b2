"""The curve of the Runge-Kutta map: its residual is enclosed, and f_x around it."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import Polynomial

from swarmstart.arrays import Array
from swarmstart.terminal_set import TerminalSet
from swarmstart.terminal_set.proving import residual as residual_module
from swarmstart.terminal_set.proving.residual import Residual

Number = TypeVar("Number", float, Polynomial)
GAIN, P, DT = 0.5, 4.0, 0.4


def law(K: Array, P: Array, x_ref: Array) -> TerminalSet:
    return TerminalSet(
        K=K, P=P, alpha=1.0, x_ref=x_ref, u_ref=np.zeros(len(K)), dt=None, design="own"
    )


def squared(substeps: int = 1) -> Residual:
    """x' = x^2 + u: every stage, the map and its residual are polynomials in s."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [x**2 + u])
    own = law(np.array([[GAIN]]), np.array([[P]]), np.array([0.3]))
    return Residual(f, own, dt=DT, substeps=substeps)


def step(x: Number, u: float, s: Number) -> Number:
    k1 = x**2 + u
    k2 = (x + s / 2 * k1) ** 2 + u
    k3 = (x + s / 2 * k2) ** 2 + u
    k4 = (x + s * k3) ** 2 + u
    return x + s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def fourth(z: float, time: float, steps_before: int = 0) -> float:
    """Return r4 of the curve by polynomials, in the coordinate z = 2 e."""
    x, u = 0.3 + z / 2, -GAIN * z / 2
    for _ in range(steps_before):
        x = step(x, u, DT / 2)
    curve = step(Polynomial([x]), u, Polynomial([0.0, 1.0]))
    residual = curve.deriv() - curve**2 - u
    assert np.abs(residual.coef[:4]).max() < 1e-15  # of order four
    return 2 * float(residual.deriv(4)(time))


@pytest.mark.parametrize("number", [0, 1])
def test_the_fourth_derivative_is_that_of_the_polynomial(number: int) -> None:
    residual = squared(substeps=2)
    for z, time in ((0.7, 0.0), (-1.0, 0.05), (0.2, 0.2)):
        start = residual.start(number, np.array([[z]]), np.zeros((1, 1)))
        (middle, radius), (slope, blur) = residual.fourth(start, (time, time))
        exact = fourth(z, time, number)
        assert abs(middle[0, 0] - exact) <= radius[0, 0] + 1e-13 < 1e-8
        near = fourth(z + 1e-5, time, number) - fourth(z - 1e-5, time, number)
        assert slope[0, 0, 0] == pytest.approx(near / 2e-5, rel=1e-6)
        assert blur[0, 0, 0] < 1e-8


@pytest.mark.parametrize("number", [0, 1])
def test_over_a_box_and_times_every_value_and_slope_is_enclosed(number: int) -> None:
    residual = squared(substeps=2)
    start = residual.start(number, np.array([[0.4]]), np.array([[0.1]]))
    (middle, radius), (slope, blur) = residual.fourth(start, (0.05, 0.1))
    for z in np.linspace(0.3, 0.5, 9):
        for time in np.linspace(0.05, 0.1, 5):
            exact = fourth(z, time, number)
            assert abs(exact - middle[0, 0]) <= radius[0, 0]
            near = fourth(z + 1e-5, time, number) - fourth(z - 1e-5, time, number)
            assert abs(near / 2e-5 - slope[0, 0, 0]) <= blur[0, 0, 0] + 1e-6


def test_the_field_is_enclosed_in_the_whole_tube_and_no_wider() -> None:
    """f_x = 2 x; of v with |v|_P <= 1, up to 1/2, f_x v turns by 2 v dx/dz."""
    residual, tube = squared(), 0.2
    start = residual.start(0, np.array([[0.4]]), np.zeros((1, 1)))
    times = (0.1, 0.1)
    (middle, radius), (turn, blur) = residual.field(start, times, tube)
    at = step(0.3 + 0.2, -GAIN * 0.2, 0.1)
    assert middle[0, 0, 0] == pytest.approx(2 * at, rel=1e-12)
    assert radius[0, 0, 0] == pytest.approx(2 * tube / 2, rel=1e-6)
    moved = (step(0.3 + 0.2 + 1e-6, -GAIN * (0.2 + 1e-6), 0.1)) - at
    size = abs(turn[0, 0, 0]) + blur[0, 0, 0]
    assert size == pytest.approx(2 * 0.5 * moved / 1e-6, rel=1e-5)


def test_the_field_turns_with_the_held_control_as_well() -> None:
    """Of x' = x u it is u: by e = z / 2 it turns by -GAIN, for |v| up to 1 / 2."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [x * u])
    own = law(np.array([[GAIN]]), np.array([[P]]), np.array([0.3]))
    residual = Residual(f, own, dt=DT, substeps=1)
    start = residual.start(0, np.array([[0.4]]), np.zeros((1, 1)))
    (middle, _), (turn, blur) = residual.field(start, (0.1, 0.1), 0.2)
    assert middle[0, 0, 0] == pytest.approx(-GAIN * 0.2, rel=1e-12)
    size = abs(turn[0, 0, 0]) + blur[0, 0, 0]
    assert size == pytest.approx(0.5 * GAIN, rel=1e-9)


def test_coordinates_are_those_of_the_ellipsoid(formation: ca.Function) -> None:
    """e = T z with e'Pe = |z|^2, and a start of boxes is around e and u."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    own = law(rng.normal(size=(2, 4)), root @ root.T, np.array([15.0, 0.2, 1, 2]))
    residual = Residual(formation, own, dt=0.5, substeps=1)
    z = rng.normal(size=(4, 3))
    e = residual.T @ z
    np.testing.assert_allclose(own.value(e), (z**2).sum(axis=0), rtol=1e-12)
    start = residual.start(0, z, np.full((4, 3), 0.1))
    for moved in (z, z + 0.1, z - 0.1, z + 0.1 * np.array([[1.0], [-1], [1], [-1]])):
        e = residual.T @ moved
        xu = np.vstack([own.x_ref[:, None] + e, own.feedback(e)])
        assert np.all((start.lower <= xu) & (xu <= start.upper))


@pytest.mark.parametrize("reach", [0.0, 2.0])
def test_rounding_of_the_start_is_that_of_all_that_is_added(
    reach: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made visible: a quarter of |x_ref|, of |e| and of the width of its box."""
    monkeypatch.setattr(residual_module, "ULPS", 0.25)
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [-x + u])
    own = law(np.array([[GAIN]]), np.eye(1), np.array([3.0]))
    z = np.array([[5.0]])
    start = Residual(f, own, dt=0.1, substeps=1).start(0, z, np.full((1, 1), reach))
    half = (start.upper - start.lower)[:, 0] / 2
    assert half[0] == pytest.approx(reach + 0.25 * (3 + 5 + reach), rel=1e-9)
    assert half[1] == pytest.approx(GAIN * (reach + 0.25 * (5 + reach)), rel=1e-9)


def test_rounding_of_spread_tube_and_slopes_is_that_of_their_sizes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Made visible: a quarter, of x' = 3 x^2 / 2 with e = z / 2 and f_x = 3 x."""
    monkeypatch.setattr(residual_module, "PADDING", 0.25)
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [1.5 * x**2 + 0 * u])
    own = law(np.array([[GAIN]]), np.array([[P]]), np.zeros(1))
    residual = Residual(f, own, dt=0.1, substeps=1)
    residual.off = 0.125
    start = residual.start(0, np.array([[5.0]]), np.full((1, 1), 2.0))
    half = (start.upper - start.lower)[:, 0] / 2
    assert half[0] == pytest.approx((2 + 0.25 * (2 + 5)) / 2, rel=1e-9)
    assert half[1] == pytest.approx(GAIN * half[0], rel=1e-9)
    exact = residual.start(0, np.array([[5.0]]), np.zeros((1, 1)))
    narrow = replace(exact, lower=np.full((2, 1), 2.5), upper=np.full((2, 1), 2.5))
    (middle, radius), _ = residual.field(narrow, (0.0, 0.0), 0.2)
    assert middle[0, 0, 0] == pytest.approx(7.5, rel=1e-9)
    length = 0.5 * (1 + residual.off + 0.25)
    reserve = (0.25 + residual.off) * 7.5
    assert radius[0, 0, 0] == pytest.approx(3 * 0.2 * length + reserve, rel=1e-9)


def test_products_of_matrices_enclose_all_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """[1, 3] times [4, 6] is [4, 18], which is 10 and 8 beyond it."""
    ends = np.array([[1.0]]), np.array([[3.0]])
    factor = np.array([[[5.0]]]), np.array([[[1.0]]])
    middle, radius = residual_module._product(*ends, factor)
    assert middle[0, 0, 0] + radius[0, 0, 0] == pytest.approx(18, rel=1e-9)
    monkeypatch.setattr(residual_module, "PADDING", 0.25)
    _, wide = residual_module._product(*ends, factor)
    assert wide[0, 0, 0] == pytest.approx(8 + 0.25 * 2 * 5, rel=1e-9)
    monkeypatch.undo()
    rng = np.random.default_rng(0)
    low, width = rng.normal(size=(6, 5)), rng.random((6, 5))
    slopes, blur = rng.normal(size=(5, 3, 2)), rng.random((5, 3, 2))
    middle, radius = residual_module._product(low, low + width, (slopes, blur))
    assert middle.shape == radius.shape == (5, 2, 2)
    reached = np.zeros_like(radius)
    for _ in range(300):
        left = (low + width * rng.integers(0, 2, low.shape)).T.reshape(5, 2, 3)
        right = slopes + blur * rng.choice([-1.0, 1.0], blur.shape)
        reached = np.maximum(reached, np.abs(left @ right - middle))
    assert np.all(reached <= radius)
    assert np.all(reached >= 0.5 * radius)


@pytest.mark.parametrize("number", [1, 2])
def test_a_later_step_begins_in_a_box_of_all_its_states_and_slopes(
    number: int,
) -> None:
    residual = squared(substeps=3)

    def after(z: float) -> float:
        x, u = 0.3 + z / 2, -GAIN * z / 2
        for _ in range(number):
            x = step(x, u, DT / 3)
        return x

    start = residual.start(number, np.array([[0.4]]), np.array([[0.3]]))
    middle, radius = start.slopes[0][0, 0, 0], start.slopes[1][0, 0, 0]
    slopes = []
    for z in np.linspace(0.1, 0.7, 13):
        assert start.lower[0, 0] <= after(z) <= start.upper[0, 0]
        # By e, which is z / 2.
        slopes.append((after(z + 1e-6) - after(z - 1e-6)) / 1e-6)
    assert middle - radius <= min(slopes) + 1e-7
    assert middle + radius >= max(slopes) - 1e-7
    assert radius <= 2 * (max(slopes) - min(slopes))
    assert start.upper[0, 0] - start.lower[0, 0] <= 2 * (after(0.7) - after(0.1))


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_a_later_step_begins_where_the_map_is_and_with_its_slopes(
    formation: ca.Function, number: int
) -> None:
    """Of x and u along e, by differences of the classical Runge-Kutta map."""
    rng, h = np.random.default_rng(1), 0.05
    own = law(rng.normal(size=(2, 4)), np.eye(4), np.array([15.0, 0.2, 1, 2]))
    residual = Residual(formation, own, dt=4 * h, substeps=4)
    map_of = ca.simpleRK(formation, 1, 4)

    def after(e: Array) -> Array:
        x, u = own.x_ref + e, own.u_ref - own.K @ e
        for _ in range(number):
            x = np.array(map_of(x, u, h)).ravel()
        return np.concatenate([x, u])

    z = 0.1 * rng.normal(size=(4, 1))
    e, d = (residual.T @ z).ravel(), 1e-5
    start = residual.start(number, z, 0 * z)
    np.testing.assert_allclose(start.lower[:, 0], after(e), atol=1e-12)
    np.testing.assert_allclose(start.upper[:, 0], after(e), atol=1e-12)
    near = [(after(e + w) - after(e - w)) / (2 * d) for w in d * np.eye(4)]
    np.testing.assert_allclose(start.slopes[0][0], np.transpose(near), atol=1e-7)
    assert start.slopes[1].shape == (1, 6, 4) and start.slopes[1].max() < 1e-10


@pytest.mark.parametrize("name", ["fabs", "fmax"])
def test_nothing_is_said_of_a_box_with_a_kink(name: str) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    bent = ca.fabs(x - 1) if name == "fabs" else ca.fmax(x, 1)
    f = ca.Function("f", [x, u], [-x + 0.1 * bent * x + u])
    own = law(np.zeros((1, 1)), np.eye(1), np.zeros(1))
    residual = Residual(f, own, dt=0.1, substeps=1)
    for z, is_known in ((0.5, True), (1.02, False), (2.0, True)):
        start = residual.start(0, np.array([[z]]), np.zeros((1, 1)))
        with np.errstate(invalid="ignore"):
            _, (_, blur) = residual.fourth(start, (0.0, 0.1))
            (_, radius), _ = residual.field(start, (0.0, 0.1), 1e-3)
        assert np.isfinite(blur).all() == np.isfinite(radius).all() == is_known


class Quadratic:
    """x_i' = c_i + (L w)_i + w'D_i w with w = (x, u), by series in time.

    A series is an array (ORDERS, n, m): of m points, coefficients of powers of the time
    from its centre.
    """

    def __init__(self, rng: np.random.Generator, nx: int, nu: int) -> None:
        n = nx + nu
        self.nx, self.c, self.L = nx, rng.normal(size=nx), rng.normal(size=(nx, n))
        D = rng.normal(size=(nx, n, n))
        self.D = (D + D.transpose(0, 2, 1)) / 2
        root = rng.normal(size=(nx, nx))
        self.law = law(
            rng.normal(size=(nu, nx)), root @ root.T + np.eye(nx), rng.normal(size=nx)
        )
        x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
        w = ca.vertcat(x, u)
        rate = ca.vertcat(*[ca.bilin(ca.DM(part), w, w) for part in self.D])
        rate += ca.DM(self.c) + ca.DM(self.L) @ w
        self.f = ca.Function("f", [x, u], [rate])

    def rate(self, x: Array, u: Array) -> Array:
        w = np.concatenate([x, u], axis=1)
        found = np.einsum("ai,kim->kam", self.L, w)
        found[0] += self.c[:, None]
        for i in range(ORDERS):
            for j in range(ORDERS - i):
                found[i + j] += np.einsum("aij,im,jm->am", self.D, w[i], w[j])
        return np.asarray(found)

    def slopes(self, x: Array, u: Array) -> Array:
        """Return f_x, (m, nx, nx)."""
        turned = 2 * np.einsum("aij,jm->mai", self.D, np.concatenate([x, u]))
        return np.asarray((self.L + turned)[:, :, : self.nx])

    def step(self, x: Array, u: Array, s: Array) -> Array:
        def later(k: Array, share: float) -> Array:
            """Return x + share s k; s has two coefficients."""
            found = x + share * s[0] * k
            found[1:] += share * s[1] * k[:-1]
            return np.asarray(found)

        k1 = self.rate(x, u)
        k2 = self.rate(later(k1, 1 / 2), u)
        k3 = self.rate(later(k2, 1 / 2), u)
        k4 = self.rate(later(k3, 1), u)
        return later((k1 + 2 * k2 + 2 * k3 + k4) / 6, 1)

    def at(self, z: Array, number: int, h: float, time: float) -> tuple[Array, ...]:
        """Return the curve, the input and r4, of columns z that may be complex."""
        e = np.linalg.solve(np.linalg.cholesky(self.law.P).T, z)
        x, u = (
            np.concatenate([part[None], np.zeros((ORDERS - 1, *part.shape))])
            for part in (self.law.x_ref[:, None] + e, -self.law.K @ e)
        )
        for _ in range(number):
            x = self.step(x, u, np.array([h, 0.0]))
        curve = self.step(x, u, np.array([time, 1.0]))
        residual = (ORDERS - 1) * curve[-1] - self.rate(curve, u)[-2]
        return curve[0], u[0], 24 * residual


ORDERS, TINY = 6, 1e-30
"""Number of coefficients of series; length of an imaginary step, whose square is lost
beside any number."""


@pytest.fixture(scope="module")
def quadratic() -> tuple[Quadratic, Residual]:
    case = Quadratic(np.random.default_rng(3), 2, 1)
    return case, Residual(case.f, case.law, dt=0.3, substeps=2)


@pytest.mark.parametrize("reach", [0.0, 1e-3])
@pytest.mark.parametrize("number", [0, 1])
def test_all_that_is_enclosed_is_that_of_series_and_is_no_wider(
    quadratic: tuple[Quadratic, Residual], number: int, reach: float
) -> None:
    """Two states, slopes by imaginary steps: r4, f_x in the tube, and its bends."""
    (case, residual), rng = quadratic, np.random.default_rng(4)
    h, tube, count = residual.h, 2 * reach, 400
    S = np.linalg.cholesky(case.law.P).T
    T = np.linalg.inv(S)
    z_0, times = rng.normal(size=(2, 1)) / 2, (0.07, 0.07 + reach)
    start = residual.start(number, z_0, np.full((2, 1), reach))
    z = z_0 + reach * rng.uniform(-1, 1, (2, count))
    z[:, ::2] = z_0 + reach * rng.choice([-1.0, 1.0], (2, count // 2))
    d, v = rng.normal(size=(2, 2, count))
    d, v = (T @ (w / np.linalg.norm(w, axis=0)) for w in (d, v))
    (value, wide), slope = residual.fourth(start, times)
    columns = value.T[:, None], wide.T[:, None]
    balls = columns, slope, *residual.field(start, times, tube)
    reached = [0 * middle for middle, _ in balls]
    for time in times:
        point, u, r4 = case.at(z, number, h, time)
        moved = [
            case.at(z + 1j * TINY * axis, number, h, time)
            for axis in np.eye(2)[:, :, None]
        ]
        slopes = np.stack([r.imag.T / TINY for *_, r in moved], axis=2)
        turns = [
            np.einsum("ij,mjk,km->mi", S, case.slopes(p, w).imag / TINY, v)
            for p, w, _ in moved
        ]
        found = (
            (S @ r4).T[:, None],
            S @ slopes,
            S @ case.slopes(point + tube * d, u) @ T,
            np.stack(turns, axis=2),
        )
        for k, ((middle, radius), exact) in enumerate(zip(balls, found, strict=True)):
            apart, size = np.abs(exact - middle), np.abs(exact).max()
            assert np.all(apart <= radius + 1e-12 * size), k
            reached[k] = np.maximum(reached[k], apart.max(axis=0))
    # By this factor interval arithmetic is wider: r4 is a long sum of products.
    for (middle, radius), most, factor in zip(
        balls, reached, (3000, 3000, 10, 10), strict=True
    ):
        size = np.abs(middle).max()
        assert np.all(radius <= factor * most + 1e-8 * size)


def test_coordinates_that_are_rounded_are_said_to_be_off(
    formation: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made visible: an inverse that is wrong by a part in a thousand."""
    rng = np.random.default_rng(4)
    root, own_inverse = rng.normal(size=(4, 4)), np.linalg.inv
    P = root @ root.T + np.eye(4)
    own = law(rng.normal(size=(2, 4)), P, np.array([15.0, 0.2, 1, 2]))
    noise = 1 + 1e-3 * rng.uniform(-1, 1, (4, 4))
    monkeypatch.setattr(np.linalg, "inv", lambda matrix: noise * own_inverse(matrix))
    residual = Residual(formation, own, dt=0.5, substeps=1)
    T, S = residual.T, np.linalg.cholesky(P).T
    off = [np.abs(T.T @ P @ T - np.eye(4)), np.abs(S @ T - np.eye(4))]
    assert min(part.max() for part in off) > 1e-4
    expected = sum(part.sum(axis=1).max() for part in off)
    assert residual.off == pytest.approx(expected, rel=1e-9)


def test_tube_reaches_as_far_in_each_state_as_the_ellipsoid_does() -> None:
    """T is [[1, 10], [0, 1]]: of |z| = 1, e_0 is up to the root of 101, e_1 to 1."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.vertcat(x[0] ** 2, 0 * u)])
    S = np.array([[1.0, -10.0], [0.0, 1.0]])
    own = law(np.zeros((1, 2)), S.T @ S, np.zeros(2))
    residual = Residual(f, own, dt=0.1, substeps=1)
    start = residual.start(0, np.zeros((2, 1)), np.zeros((2, 1)))
    (_, radius), _ = residual.field(start, (0.0, 0.0), 0.2)
    # f_x is 2 e_0 in its first entry alone, as is S f_x T.
    assert radius[0, 0, 0] == pytest.approx(2 * 0.2 * 101**0.5, rel=1e-9)
