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

from swarmstart.terminal_set.checker.ellipsoid_search import (  # noqa: E402
    DecreaseTask,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    decrease_task,
    growth_task,
    prove_on_set,
)
from swarmstart.terminal_set.checker.search import (  # noqa: E402
    Boxes,
    Flags,
    Outcome,
)
from swarmstart.tests.terminal_set.checker.changes import (  # noqa: E402
    after_looks,
    change_at,
    excess_at,
    violates,
)

P = np.array([[2.0, 0.6], [0.6, 1.0]])
Q_M = np.array([[0.1, 0.02], [0.02, 0.3]])
F = np.array([[-1.0, 0.7], [-0.4, -1.5]])
E = np.array([0.3, -0.5])
MOST_LOOKS = 30
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
    change = change_at(linear(drift=0.2), E)
    expected = 2 * E @ P @ F @ E + E @ Q_M @ E + 2 * 0.2 * V
    assert change == pytest.approx(expected, rel=1e-12)
    held = linear(0.5, integrator=0.03, drift=0.2, growth=1.4)
    after = series(0.5) @ E
    c = 0.03 + 0.2
    expected = after @ P @ after - V + E @ Q_M @ E + (2 * c + c**2) * V
    assert change_at(held, E) == pytest.approx(expected)
    excess = excess_at(held, E, 0.3)
    after = series(0.3) @ E
    assert excess == pytest.approx(after @ P @ after - 1.4 * V)


@pytest.mark.parametrize("dt", [None, 0.5])
def test_the_radius_of_the_search_holds_the_ellipsoid_and_hardly_more(
    dt: float | None,
) -> None:
    alpha = 0.7
    certificate = dataclasses.replace(linear(dt, growth=1.2), alpha=alpha)
    tasks = [decrease_task(certificate)]
    if dt is not None:
        tasks.append(growth_task(certificate))
    for task in tasks:
        radius = task.roots().upper[0]
        assert (alpha <= radius**2).all() and (radius**2 <= alpha * (1 + 1e-12)).all()
        for T in task.T:
            np.testing.assert_allclose(T.T @ P @ T, np.eye(2), atol=1e-14)


def prove_decrease(certificate: Certificate) -> Outcome:
    return prove_on_set(decrease_task(certificate), NEVER)


def prove_growth(certificate: Certificate) -> Outcome:
    return prove_on_set(growth_task(certificate), NEVER)


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
        assert prove_decrease(linear(dt, Q_m=Q_m)).proven == expected
    zero = ((0.0, 0.0), (0.0, 0.0))
    c = math.sqrt(1 + most) - 1  # 2 c + c^2 = most
    for share, expected in ((0.99, True), (1.01, False)):
        named = "drift" if dt is None else "integrator"
        size = share * (most / 2 if dt is None else c)
        stated = linear(dt, Q_m=zero, **{named: size})
        assert prove_decrease(stated).proven == expected


def test_what_counts_as_a_counterexample_is_in_the_set_and_certain() -> None:
    growing = linear(Q_m=((9.0, 0.0), (0.0, 9.0)))
    size = math.sqrt(float(E @ P @ E))
    assert violates(growing, 0.999 * E / size)
    assert not violates(growing, 1.001 * E / size)
    assert not violates(growing, (0.0, 0.0))
    assert not violates(linear(), 0.5 * E)


@pytest.mark.parametrize("dt", [None, 0.5])
def test_the_reserve_of_the_search_is_the_raised_one(dt: float | None) -> None:
    """Semidefinite to rounding is enough for Q_m: what is proven has no rising part."""
    Q_m = ((1.0, 0.0), (0.0, -1e-10))
    certificate = linear(dt, Q_m=Q_m)
    found = np.array(decrease_task(certificate).change.M, dtype=float)
    weight = 0.0 if dt is None else -1.0
    np.testing.assert_allclose(
        found - weight * P, np.diag([1.0 + 1e-9, 9e-10]), rtol=0, atol=1e-13
    )


def test_a_proof_ends_at_the_deadline() -> None:
    for task in (decrease_task, growth_task):
        with pytest.raises(TimeIsUpError):
            task(linear(0.5, growth=1.05), Deadline(-math.inf))


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


class Blind(DecreaseTask):
    """No point is looked at, only bounds of boxes count."""

    def refuted(self, points: Boxes) -> Flags:
        return np.zeros(points.count, dtype=np.bool_)


def proved(task: DecreaseTask) -> Outcome:
    """Run the search alone, for some batches of boxes."""
    fields = {
        field.name: getattr(task, field.name) for field in dataclasses.fields(task)
    }
    return prove_on_set(Blind(**fields), after_looks(MOST_LOOKS))


def with_level(certificate: Certificate, share: float) -> DecreaseTask:
    level = dataclasses.replace(certificate, alpha=share * certificate.alpha)
    return decrease_task(level)


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
    outcome = prove_decrease(certificate)
    assert not outcome.proven and outcome.counterexample is not None
    assert violates(certificate, outcome.counterexample)


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
    assert prove_growth(above).proven
    for share in (0.98, 0.7):
        below = rotation(P.tolist(), share * largest, dt)
        outcome = prove_growth(below)
        assert not outcome.proven and outcome.counterexample is not None
        assert not proved(growth_task(below)).proven
