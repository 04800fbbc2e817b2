"""Statements on e'Pe: at a point against NumPy, and over the whole of the ellipsoid."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.findings import (
    NEVER,
    Deadline,
    TimeIsUpError,
)
from swarmstart.terminal_set.linear.matrix_equations import continuous_lqr
from swarmstart.tests.terminal_set.checker.certificates_by_hand import certificate_of

flint = pytest.importorskip("flint")

from swarmstart.terminal_set.checker.decrease import (  # noqa: E402
    Outcome,
    Search,
    Statement,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    PointwiseChange,
    _least,
    decrease_statement,
    growth_statement,
    prove_decrease,
    prove_growth,
)

P = np.array([[2.0, 0.6], [0.6, 1.0]])
Q_M = np.array([[0.1, 0.02], [0.02, 0.3]])
F = np.array([[-1.0, 0.7], [-0.4, -1.5]])
E = np.array([0.3, -0.5])
MOST_BOXES = 3000
IDENTITY = [[1.0, 0.0], [0.0, 1.0]]
TILTED = P.tolist()


def linear(dt: float | None = None, **changes: object) -> Certificate:
    """x' = F x, held: the Runge-Kutta map is the exponential's series to dt^4."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("linear", [x, u], [ca.DM(F) @ x + 0 * u])
    given = {"Q_m": tuple(map(tuple, Q_M.tolist())), **changes}
    return certificate_of(f, P.tolist(), 1.0, dt=dt, **given)  # type: ignore[arg-type]


def series(dt: float) -> np.ndarray:
    A = dt * F
    return np.eye(2) + A + A @ A / 2 + A @ A @ A / 6 + A @ A @ A @ A / 24


def test_the_change_at_a_point_is_the_form_written_out() -> None:
    V = E @ P @ E
    change = PointwiseChange(linear(drift=0.2)).change(tuple(E))
    expected = 2 * E @ P @ F @ E + E @ Q_M @ E + 2 * 0.2 * V
    assert float(change.mid()) == pytest.approx(expected, rel=1e-12)
    held = linear(0.5, integrator=0.03, drift=0.2, growth=1.4)
    after = series(0.5) @ E
    c = 0.03 + 0.2
    expected = after @ P @ after - V + E @ Q_M @ E + (2 * c + c**2) * V
    assert float(PointwiseChange(held).change(tuple(E)).mid()) == pytest.approx(
        expected
    )
    excess = PointwiseChange(held).excess(tuple(E), 0.3)
    after = series(0.3) @ E
    assert float(excess.mid()) == pytest.approx(after @ P @ after - 1.4 * V)


@pytest.mark.parametrize("dt", [None, 0.5])
def test_the_radius_of_the_search_holds_the_ellipsoid_and_hardly_more(
    dt: float | None,
) -> None:
    alpha = 0.7
    certificate = dataclasses.replace(linear(dt, growth=1.2), alpha=alpha)
    statements = [decrease_statement(certificate)]
    if dt is not None:
        statements.append(growth_statement(certificate, (0.1, 0.2)))
    for statement in statements:
        assert alpha <= statement.radius**2 <= alpha * (1 + 1e-12)
        T = np.array(statement.T)
        np.testing.assert_allclose(T.T @ P @ T, np.eye(2), atol=1e-14)


@pytest.mark.parametrize(("weight", "least"), [(2.0, 1.5), (-2.0, -2.5)])
def test_the_least_of_a_weighted_v_is_at_the_end_its_sign_says(
    weight: float, least: float
) -> None:
    """V / rho^2 from 3 / 4 to 5 / 4."""
    assert _least(flint.arb(weight), flint.arb(0.25)) == least


def largest_reserve(dt: float | None) -> float:
    """The q for which c(e) = 0 for some e, with Q_m = q P."""
    if dt is None:
        form = -(P @ F + F.T @ P)
    else:
        form = P - series(dt).T @ P @ series(dt)
    L = np.linalg.inv(np.linalg.cholesky(P))
    return float(np.linalg.eigvalsh(L @ form @ L.T)[0])


@pytest.mark.parametrize("dt", [None, 0.5])
def test_a_reserve_is_proven_up_to_what_the_linear_part_has(dt: float | None) -> None:
    """And with it the drift and the error of the map, which are of the same form."""
    most = largest_reserve(dt)
    for share, expected in ((0.99, True), (1.01, False)):
        Q_m = tuple(map(tuple, (share * most * P).tolist()))
        assert prove_decrease(linear(dt, Q_m=Q_m), NEVER).proven == expected
    zero = ((0.0, 0.0), (0.0, 0.0))
    c = math.sqrt(1 + most) - 1  # 2 c + c^2 = most
    for share, expected in ((0.99, True), (1.01, False)):
        named = "drift" if dt is None else "integrator"
        size = share * (most / 2 if dt is None else c)
        stated = linear(dt, Q_m=zero, **{named: size})
        assert prove_decrease(stated, NEVER).proven == expected


def test_what_counts_as_a_counterexample_is_in_the_set_and_certain() -> None:
    growing = PointwiseChange(linear(Q_m=((9.0, 0.0), (0.0, 9.0))))
    size = math.sqrt(float(E @ P @ E))
    assert growing.violates_decrease(tuple(0.999 * E / size), 0.0)
    assert not growing.violates_decrease(tuple(1.001 * E / size), 0.0)
    assert not growing.violates_decrease((0.0, 0.0), 0.0)
    falling = PointwiseChange(linear())
    assert not falling.violates_decrease(tuple(0.5 * E), 0.0)
    held = PointwiseChange(linear(0.5, growth=0.3))
    assert held.violates_growth(tuple(0.5 * E), 0.01)
    assert not held.violates_growth(tuple(0.5 * E), 1.5)


@pytest.mark.parametrize("dt", [None, 0.5])
def test_the_reserve_of_the_search_is_the_raised_one(dt: float | None) -> None:
    """Semidefinite to rounding is enough for Q_m: what is proven has no rising part."""
    Q_m = ((1.0, 0.0), (0.0, -1e-10))
    statement = decrease_statement(linear(dt, Q_m=Q_m))
    T = np.array(statement.T)
    raised = np.diag([1.0 + 1e-9, 9e-10])
    found = [[float(entry.mid()) for entry in row] for row in statement.M.tolist()]
    np.testing.assert_allclose(found, T.T @ raised @ T, rtol=0, atol=1e-13)


def test_a_proof_ends_at_the_deadline() -> None:
    for prove in (prove_decrease, prove_growth):
        with pytest.raises(TimeIsUpError):
            prove(linear(0.5, growth=1.05), Deadline(-math.inf))


def cubic() -> ca.Function:
    """x' = -x + x^3: at x = 1 it rests, and so does every Runge-Kutta map."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return ca.Function("cubic", [x, u], [-x + x**3 + 0 * u])


def two_cubics() -> ca.Function:
    """x0' = -x0 + x0^3, x1' = -2 x1 + x1^3: the nearest rest is at (1, 0)."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(-x[0] + x[0] ** 3, -2 * x[1] + x[1] ** 3)
    return ca.Function("cubics", [x, u], [xdot + 0 * u])


def turned_cubics() -> ca.Function:
    """The same in coordinates y = S x with S'S = TILTED: V = y'y."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    S = ca.DM(np.linalg.cholesky(np.array(TILTED)).T)
    y = S @ x
    ydot = ca.vertcat(-y[0] + y[0] ** 3, -2 * y[1] + y[1] ** 3)
    return ca.Function("turned", [x, u], [ca.solve(S, ydot) + 0 * u])


def van_der_pol() -> ca.Function:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(-x[1], x[0] - (1 - x[0] ** 2) * x[1])
    return ca.Function("van_der_pol", [x, u], [xdot + 0 * u])


def chen() -> Certificate:
    """Chen and Allgoewer (1998), their P, K and rate: to 0.73201, published as 0.7."""
    x, u, mu = ca.SX.sym("x", 2), ca.SX.sym("u"), 0.5
    xdot = ca.vertcat(
        x[1] + u * (mu + (1 - mu) * x[0]), x[0] + u * (mu - 4 * (1 - mu) * x[1])
    )
    K = np.array([[2.118, 2.118]])
    Q_m = 0.5 * np.eye(2) + K.T @ K
    return certificate_of(
        ca.Function("chen", [x, u], [xdot]),
        [[16.5926, 11.5926], [11.5926, 16.5926]],
        0.73201,
        K=((2.118, 2.118),),
        Q_m=tuple(map(tuple, Q_m.tolist())),
    )


def pendulum() -> Certificate:
    """Upright, g / l = 9.81, the LQR's own P: to 6.8899."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("p", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])
    A, B = np.array([[0.0, 1.0], [9.81, 0.0]]), np.array([[0.0], [1.0]])
    gain = continuous_lqr(A, B, np.eye(2), np.eye(1))
    return certificate_of(
        f, gain.P.tolist(), 6.88987, K=tuple(map(tuple, gain.K.tolist()))
    )


TRUE_LEVELS: dict[str, Callable[[], Certificate]] = {
    "cubic": lambda: certificate_of(cubic(), [[1.0]], 1.0),
    "cubic, P = 9": lambda: certificate_of(cubic(), [[9.0]], 9.0),
    "cubic, held": lambda: certificate_of(cubic(), [[1.0]], 1.0, dt=0.4),
    "two cubics": lambda: certificate_of(two_cubics(), IDENTITY, 1.0),
    "two cubics, held": lambda: certificate_of(two_cubics(), IDENTITY, 1.0, dt=0.2),
    "turned cubics": lambda: certificate_of(turned_cubics(), TILTED, 1.0),
    "turned cubics, held": lambda: certificate_of(
        turned_cubics(), TILTED, 1.0, dt=0.2, substeps=2
    ),
    "van der Pol": lambda: certificate_of(
        van_der_pol(), [[1.5, -0.5], [-0.5, 1.0]], 2.30448
    ),
    "Chen and Allgoewer": chen,
    "pendulum": pendulum,
}


def proved(statement: Statement) -> Outcome:
    """Run the search alone: no point is looked at, only bounds of boxes count."""
    blind = dataclasses.replace(statement, is_counterexample=lambda e, time: False)
    return Search(blind, NEVER, MOST_BOXES).run()


def with_level(certificate: Certificate, share: float) -> Statement:
    level = dataclasses.replace(certificate, alpha=share * certificate.alpha)
    return decrease_statement(level)


@pytest.mark.parametrize("name", TRUE_LEVELS)
def test_a_level_is_proven_below_the_true_one_and_not_above(name: str) -> None:
    certificate = TRUE_LEVELS[name]()
    below = proved(with_level(certificate, 0.95))
    assert below.proven, below.remark
    for share in (1.02, 1.1, 4.0):
        assert not proved(with_level(certificate, share)).proven


@pytest.mark.parametrize("name", ["two cubics", "van der Pol", "two cubics, held"])
def test_a_state_that_breaks_the_decrease_ends_the_search(name: str) -> None:
    certificate = TRUE_LEVELS[name]()
    certificate = dataclasses.replace(certificate, alpha=1.1 * certificate.alpha)
    outcome = Search(decrease_statement(certificate), NEVER, MOST_BOXES).run()
    assert not outcome.proven and outcome.counterexample is not None
    points = PointwiseChange(certificate)
    assert points.violates_decrease(outcome.counterexample, 0.0)


def rotation(P: list[list[float]], growth: float, dt: float) -> Certificate:
    """x0' = x1, x1' = -x0: with P = diag(1, 4) e'Pe grows up to fourfold."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("rotation", [x, u], [ca.vertcat(x[1], -x[0]) + 0 * u])
    return certificate_of(f, P, 1.0, dt=dt, growth=growth, substeps=4)


@pytest.mark.parametrize(("dt", "largest"), [(0.5, None), (2.0, 4.0)])
def test_growth_is_proven_above_the_true_one_and_not_below(
    dt: float, largest: float | None
) -> None:
    """The largest growth in a hold: 4 after a quarter turn, else by the exponential."""
    P = np.diag([1.0, 4.0])
    if largest is None:
        turned = scipy.linalg.expm(dt * np.array([[0.0, 1.0], [-1.0, 0.0]]))
        largest = float(scipy.linalg.eigh(turned.T @ P @ turned, P)[0][-1])
    above = rotation(P.tolist(), 1.02 * largest, dt)
    assert prove_growth(above, NEVER).proven
    for share in (0.98, 0.7):
        below = rotation(P.tolist(), share * largest, dt)
        outcome = prove_growth(below, NEVER)
        assert not outcome.proven and outcome.counterexample is not None
        statement = growth_statement(below, (0.9 * dt if dt < 1 else 1.5, min(dt, 1.6)))
        assert not proved(statement).proven
