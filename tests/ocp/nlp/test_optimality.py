"""First and second order conditions against a dense reference of the whole NLP."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import null_space

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Polisher,
    Radau,
    TerminalConstraint,
)
from swarmstart.ocp.nlp import optimality
from swarmstart.ocp.nlp.optimality import (
    Curvature,
    NlpPoint,
    curvature,
    is_stationary,
    least_multipliers,
    stationarity,
)
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.rollout.fitness import NOTHING, shared_arguments

SURE = 1e-5
"""Curvature, relative to the Hessian's largest entry, that both ways must agree on."""


def point_at(
    problem: OptimalControlProblem,
    controls: Array,
    x0: list[float],
    known: Known = NOTHING,
) -> NlpPoint:
    """Return the rolled-out point of controls, without multipliers."""
    fitness, program = Fitness(problem, backend="casadi"), multiple_shooting(problem)
    states = fitness.states(controls, x0, known)
    sizes = fitness.arguments.sizes_along(controls, states, x0, known)
    w = program.variables(controls, states[:, :: problem.checks], sizes)
    limits = program.limits(sizes)
    return NlpPoint(
        program=program,
        cost_size=sizes.cost,
        w=w,
        q=program.arguments(*shared_arguments(problem, x0, known), sizes),
        lam_g=np.zeros(limits.lbg.size),
        lam_x=np.zeros(w.size),
        limits=limits,
    )


def with_multipliers(point: NlpPoint) -> NlpPoint:
    """Return a point with the best-fitting multipliers of its active limits."""
    g, J = (np.array(v) for v in point.program.derivatives["jac_g"](point.w, point.q))
    gradient = np.array(point.program.derivatives["grad_f"](point.w, point.q)[1])
    rows = _at_limit(g.ravel(), point.limits.lbg, point.limits.ubg)
    bounds = _at_limit(point.w, point.limits.lbx, point.limits.ubx)
    A = np.vstack([J[rows], np.eye(point.w.size)[bounds]])
    lam = np.linalg.lstsq(A.T, -gradient.ravel(), rcond=None)[0]
    lam_g, lam_x = np.zeros(g.size), np.zeros(point.w.size)
    lam_g[rows], lam_x[bounds] = np.split(lam, [int(rows.sum())])
    return replace(point, lam_g=lam_g, lam_x=lam_x)


def _at_limit(value: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    return np.asarray((value <= lower + 1e-9) | (value >= upper - 1e-9))


def least_curvature(point: NlpPoint) -> float:
    """Return the smallest eigenvalue on the tangent space, relative to the Hessian.

    The dense Hessian is reduced to the null space of the rows and bounds that
    multipliers hold; infinity if there are no free directions.
    """
    derivatives = point.program.derivatives
    upper = np.array(derivatives["hess_lag"](point.w, point.q, 1.0, point.lam_g))
    H = upper + np.triu(upper, 1).T
    g, J = (np.array(v) for v in derivatives["jac_g"](point.w, point.q))
    rows = _holds(point.lam_g, g.ravel(), point.limits.lbg, point.limits.ubg)
    bounds = _holds(point.lam_x, point.w, point.limits.lbx, point.limits.ubx)
    Z = null_space(np.vstack([J[rows], np.eye(point.w.size)[bounds]]), rcond=1e-10)
    if not Z.size:
        return np.inf
    return float(np.linalg.eigvalsh(Z.T @ H @ Z)[0] / np.abs(H).max())


def _holds(lam: Array, value: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    room = np.where(lam > 0, upper - value, value - lower)
    return np.asarray((lower == upper) | (np.abs(lam) > np.abs(room)))


@pytest.fixture(scope="module")
def lq_point(lq: OptimalControlProblem, riccati: tuple[Array, Array]) -> NlpPoint:
    """The optimum of `lq` by the Riccati recursion, with its exact multipliers."""
    dt, N = 0.2, 10
    A, B = np.array([[1, dt], [0, 1]]), np.array([[dt**2 / 2], [dt]])
    Q, R, P = dt * np.eye(2), dt / 2 * np.eye(1), 3 * np.eye(2)
    to_go = [P]
    for _ in range(N):
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ K)
        to_go.append(P)
    x, controls, states = np.array([1.0, -0.5]), np.empty((1, N)), []
    np.testing.assert_allclose(to_go[-1], riccati[1])
    for k in range(N):
        P = to_go[N - 1 - k]
        controls[:, k] = -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A) @ x
        x = A @ x + B @ controls[:, k]
        states.append(x)
    point = point_at(lq, controls, [1.0, -0.5])
    sizes = Fitness(lq, backend="casadi").arguments.sizes([1.0, -0.5], NOTHING)
    # The defect is F(x, u) - x+, and the cost-to-go has the slope 2 P x+ there.
    lam = [2 * to_go[N - 1 - k] @ states[k] * sizes.states for k in range(N)]
    return replace(point, lam_g=np.concatenate(lam) / point.cost_size)


def test_linear_quadratic_optimum_is_stationary(lq_point: NlpPoint) -> None:
    assert stationarity(lq_point) <= 1e-13
    assert is_stationary(lq_point)
    assert curvature(lq_point) is Curvature.POSITIVE


@pytest.mark.parametrize("wrong", [1.0, 1e3, -1e6])
def test_residual_is_counted_in_parts_of_all_terms_of_one_derivative(
    lq_point: NlpPoint, wrong: float
) -> None:
    """Nothing is bounded and all rows are 0: only the sum of terms remains."""
    point = replace(
        lq_point, lam_g=wrong * lq_point.lam_g + 1, lam_x=0.5 + 0 * lq_point.lam_x
    )
    free = np.isinf(point.limits.lbx) & np.isinf(point.limits.ubx)
    point = replace(point, lam_x=np.where(free, 0.0, point.lam_x))
    assert free.all()
    derivatives = point.program.derivatives
    gradient = np.array(derivatives["grad_f"](point.w, point.q)[1]).ravel()
    pull = np.array(derivatives["jac_g"](point.w, point.q)[1]).T @ point.lam_g
    size = max(1.0, float((np.abs(gradient) + np.abs(pull)).max()))
    expected = np.abs(gradient + pull).max() / size
    assert expected > 1e-3
    assert stationarity(point) == pytest.approx(expected, rel=1e-6)
    assert not is_stationary(point)


def test_whatever_is_changed_at_the_optimum_makes_it_not_stationary(
    lq_point: NlpPoint,
) -> None:
    rng = np.random.default_rng(0)
    for name in ("w", "lam_g", "lam_x"):
        right = getattr(lq_point, name)
        for _ in range(5):
            wrong = right.copy()
            wrong[rng.integers(right.size)] += 0.1
            assert stationarity(replace(lq_point, **{name: wrong})) > 1e-4
    assert stationarity(replace(lq_point, lam_g=-lq_point.lam_g)) > 1e-2
    broken = replace(lq_point, w=np.full_like(lq_point.w, np.nan))
    assert stationarity(broken) == np.inf


def scalar(
    cost: ca.SX | float,
    end: ca.SX | float,
    *,
    limits: tuple[float, float] = (-np.inf, np.inf),
    intervals: int = 3,
    **stated: object,
) -> OptimalControlProblem:
    """x' = u over 1 s."""
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=U),
        horizon=1.0,
        intervals=intervals,
        stage_cost=ca.SX(cost),
        terminal_cost=ca.SX(end),
        bounds=Bounds(controls=limits),
        **stated,  # type: ignore[arg-type]
    )


X, U = ca.SX.sym("x"), ca.SX.sym("u")


def test_multiplier_needs_its_limit_and_its_sign() -> None:
    """min u with u >= -1: at -1 only the lower bound has a multiplier."""
    problem = scalar(U, 0, limits=(-1, 2))
    held = with_multipliers(point_at(problem, np.full((1, 3), -1.0), [0.5]))
    assert stationarity(held) <= 1e-13
    assert (held.lam_x[::2] < 0).all()
    assert curvature(held) is Curvature.POSITIVE
    for level in (0.0, 2.0):
        other = point_at(problem, np.full((1, 3), level), [0.5])
        assert stationarity(replace(other, lam_x=held.lam_x)) > 1e-2
        assert stationarity(other) > 1e-2
    with_wrong_sign = replace(problem, stage_cost=-problem.stage_cost)
    wrong = with_multipliers(point_at(with_wrong_sign, np.full((1, 3), -1.0), [0.5]))
    assert stationarity(wrong) > 1e-2


def test_multiplier_of_a_limit_that_does_not_exist_counts_in_full() -> None:
    free = with_multipliers(point_at(scalar(U, 0), np.zeros((1, 3)), [1.0]))
    slope = np.array(free.program.derivatives["grad_f"](free.w, free.q)[1]).ravel()
    assert stationarity(free) > 1e-2
    nothing = np.zeros_like(free.lam_g)
    found = stationarity(replace(free, lam_g=nothing, lam_x=-slope))
    # The sum vanishes except for the multiplier itself, relative to at least one.
    most = np.abs(slope).max()
    assert found == pytest.approx(most / max(1, 2 * most), rel=1e-12)


def test_multiplier_of_one_is_a_multiplier() -> None:
    """min u over 0 <= u <= 1: in these units the slope is 1, and at 1 it is in vain."""
    point = point_at(scalar(U, 0, limits=(0, 1), intervals=1), np.ones((1, 1)), [0.5])
    held = replace(point, lam_x=np.array([-1.0, 0.0]))
    assert stationarity(held) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("room", [0.25, 0.75, 1.5, 4.0])
def test_multiplier_of_a_far_limit_counts_by_its_distance_but_once_at_most(
    room: float,
) -> None:
    """In the NLP's units, the size of a control is the width of its bounds."""
    problem = scalar(U, 0, limits=(-2 * room, 2 - 2 * room))
    point = with_multipliers(point_at(problem, np.full((1, 3), -2 * room), [0.5]))
    assert stationarity(point) <= 1e-13
    away = replace(point, limits=point.limits._replace(lbx=point.limits.lbx - room))
    most = np.abs(point.lam_x).max()
    size = max(1, 2 * most)
    assert stationarity(away) == pytest.approx(min(room, 1) * most / size, rel=1e-6)


@pytest.mark.parametrize(
    ("cost", "end", "expected"),
    [
        (U**2, 0, Curvature.POSITIVE),
        (U**2, -(X**2) / 2, Curvature.POSITIVE),  # u^2 of 1 s bends more than x^2 / 2.
        (U**2, -2 * X**2, Curvature.NEGATIVE),
        (-(U**2), 3 * X**2, Curvature.NEGATIVE),  # Up and down leaves the end in place.
        (0, ca.cos(X), Curvature.NEGATIVE),
        (U**2 / 9, ca.cos(X), Curvature.NEGATIVE),
        (U**2, ca.cos(X), Curvature.POSITIVE),
        (0, X**2, Curvature.FLAT),  # Only the sum of the controls counts.
        (U**4, 0, Curvature.FLAT),
        (U**4, X**4, Curvature.FLAT),
        (0, 0, Curvature.FLAT),
    ],
)
def test_curvature_of_scalar_problems_at_rest(
    cost: ca.SX | float, end: ca.SX | float, expected: Curvature
) -> None:
    """x' = u from 0: u = 0 is stationary, x(1) is the mean of the controls."""
    point = with_multipliers(point_at(scalar(cost, end), np.zeros((1, 3)), [0.0]))
    assert stationarity(point) <= 1e-12
    assert curvature(point) is expected


@pytest.mark.parametrize(
    ("bend", "expected"),
    [
        (1.1e-7, Curvature.POSITIVE),
        (0.9e-7, Curvature.FLAT),
        (-0.9e-6, Curvature.FLAT),
        (-1.1e-6, Curvature.NEGATIVE),
    ],
)
def test_bend_has_a_sign_from_a_part_in_1e7_of_the_largest_on(
    bend: float, expected: Curvature
) -> None:
    """Test of the flattest control; from ten times this, a fall is certain."""
    u = ca.SX.sym("u", 2)
    problem = OptimalControlProblem(
        Model(states=X, controls=u, ode=0 * u[0]),
        horizon=1.0,
        intervals=2,
        stage_cost=u[0] ** 2 + bend * u[1] ** 2,
        bounds=Bounds(controls=(-1, 1)),
    )
    assert curvature(point_at(problem, np.zeros((2, 2)), [0.0])) is expected
    # Of two decided starts, the one that bends less.
    x = ca.SX.sym("x", 2)
    begun = OptimalControlProblem(
        Model(states=x, controls=U, ode=ca.SX.zeros(2)),
        horizon=1.0,
        intervals=2,
        stage_cost=U**2,
        initial_cost=0.5 * (x[0] ** 2 + bend * x[1] ** 2),
        bounds=Bounds(controls=(-1, 1)),
        start={"x_0": Free(-1, 1), "x_1": Free(-1, 1)},
    )
    assert curvature(point_at(begun, np.zeros((1, 2)), [0.0, 0.0])) is expected


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_sign_of_a_bend_has_no_unit(size: float) -> None:
    """The cost, and with it the NLP's Hessian, divided by any number."""
    for bend, expected in (
        (0.5, Curvature.POSITIVE), (1.0, Curvature.FLAT), (2.0, Curvature.NEGATIVE),
    ):  # fmt: skip
        problem = scalar(U**2, -bend * X**2)
        fitness = Fitness(problem, backend="casadi")
        sizes = fitness.arguments.sizes([0.0], NOTHING)
        point = point_at(problem, np.zeros((1, 3)), [0.0])
        other = replace(sizes, cost=sizes.cost * size)
        q = point.program.arguments(*shared_arguments(problem, [0.0], NOTHING), other)
        assert curvature(replace(point, q=q)) is expected


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("falls", [None, 0, 1, 2])
def test_signals_of_each_interval_bend_the_cost_there(
    falls: int | None, side: str
) -> None:
    """s u^2, with the signal s at -1 at one interval's end and at 1 at the others."""
    s = ca.SX.sym("s")
    problem = scalar(s * U**2, 0, signals=s, checks=2, quadrature=side)
    signal = np.ones((1, 7))
    if falls is not None:
        signal[0, 2 * (falls + (side == "right"))] = -1
    point = point_at(problem, np.zeros((1, 3)), [0.0], Known(signals=signal))
    expected = Curvature.POSITIVE if falls is None else Curvature.NEGATIVE
    assert curvature(point) is expected


def test_curvature_that_overflows_says_nothing() -> None:
    """The end weighs a state that grows by 1e50^4 / 24 in a step, and a calm one."""
    x = ca.SX.sym("x", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=U, ode=ca.vertcat(1e50 * x[0], U)),
        horizon=1.0,
        intervals=1,
        terminal_cost=ca.sumsqr(x),
        bounds=Bounds(controls=(-1, 1), states=(-1, 1)),
        substeps=1,
    )
    point = point_at(problem, np.zeros((1, 1)), [0.0, 0.0])
    with np.errstate(over="ignore", invalid="ignore"):
        assert curvature(point) is Curvature.FLAT


def test_two_controls_for_one_thing_are_flat() -> None:
    u = ca.SX.sym("u", 2)
    for weight, expected in ((0, Curvature.FLAT), (1e-3, Curvature.POSITIVE)):
        problem = OptimalControlProblem(
            Model(states=X, controls=u, ode=u[0] + u[1]),
            horizon=1.0,
            intervals=3,
            stage_cost=(u[0] + u[1]) ** 2 + weight * (u[0] - u[1]) ** 2,
        )
        point = with_multipliers(point_at(problem, np.zeros((2, 3)), [0.0]))
        assert curvature(point) is expected


@pytest.mark.parametrize(
    ("stated", "controls", "expected"),
    [
        # -u^2 falls everywhere, but every control is at its bound.
        ({"limits": (-1, 1)}, [1, 1, 1], Curvature.POSITIVE),
        # Only one free direction remains, along which the cost falls.
        ({"limits": (-1, 1)}, [1, 0, 1], Curvature.NEGATIVE),
        # The sum is fixed: two free directions remain.
        ({"terminal": [X - 1]}, [1, 1, 1], Curvature.NEGATIVE),
        # ... and with one interval no direction.
        ({"terminal": [X - 1], "intervals": 1}, [1], Curvature.POSITIVE),
        # A row that is active at every check leaves no direction, in any unit.
        (
            {"constraints": [PathConstraint(expression=X + U, upper=9, scale=1e8)]},
            [6.75, 5.0625, 3.796875],
            Curvature.POSITIVE,
        ),
        ({"constraints": [X + U <= 9]}, [6.75, 5.0625, 3.796875], Curvature.POSITIVE),
    ],
)
def test_what_is_active_holds_a_cost_that_falls_everywhere(
    stated: dict[str, object], controls: list[float], expected: Curvature
) -> None:
    problem = scalar(-(U**2), 0, **stated)  # type: ignore[arg-type]
    point = with_multipliers(point_at(problem, np.array([controls]), [0.0]))
    reduced = least_curvature(point)
    assert curvature(point) is expected
    assert reduced > 0 if expected is Curvature.POSITIVE else reduced < 0


def test_an_equality_holds_whatever_its_multiplier() -> None:
    """-u^2 falls, but one interval must end at 0, without a multiplier."""
    problem = scalar(-(U**2), 0, terminal=[X], intervals=1)
    point = point_at(problem, np.zeros((1, 1)), [0.0])
    assert not point.lam_g.any()
    assert curvature(point) is Curvature.POSITIVE


def test_state_at_its_bound_is_held() -> None:
    """min -x^2 - u^2 / 9 over 0 <= x <= 1: full speed into the bound, then on it."""
    problem = scalar(
        -(U**2) / 9 - 4 * X**2, 0, intervals=3,
        constraints=[PathConstraint(expression=U, upper=3)],
    )  # fmt: skip
    bounded = replace(problem, bounds=Bounds(states=(0, 1)))
    controls = np.array([[3.0, 0.0, 0.0]])
    assert curvature(_held(bounded, controls)) is Curvature.POSITIVE
    assert curvature(_held(problem, controls)) is Curvature.NEGATIVE


def _held(problem: OptimalControlProblem, controls: Array) -> NlpPoint:
    return with_multipliers(point_at(problem, controls, [0.0]))


def random_problem(rng: np.random.Generator) -> OptimalControlProblem:
    """A small nonlinear problem whose costs have random curvature."""
    nx, nu = (int(n) for n in rng.integers(1, 3, size=2))
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
    A, B = rng.normal(size=(nx, nx)), rng.normal(size=(nx, nu))
    Q, R = rng.normal(size=(nx, nx)), rng.normal(size=(nu, nu))
    shift = rng.uniform(-0.5, 1.0)
    constraints, terminal = [], []
    if rng.random() < 0.6:
        row = ca.dot(rng.normal(size=nx), x) + ca.dot(rng.normal(size=nu), u)
        constraints.append(PathConstraint(expression=row + 0.2 * x[0] ** 2, upper=0.3))
    if rng.random() < 0.6:
        row = ca.dot(rng.normal(size=nx), x) - 0.2
        terminal.append(
            TerminalConstraint(expression=row, lower=0, upper=rng.choice([0, 1]))
        )
    ode = ca.mtimes(A, x) + ca.mtimes(B, u) + 0.2 * ca.sin(x) * u[0]
    bends = ca.bilin(ca.DM(Q), x, x) / 2 + ca.bilin(ca.DM(R), u, u) / 2
    intervals = int(rng.integers(1, 5))
    more: dict[str, object] = {}
    if rng.random() < 0.3:
        first = int(rng.integers(1, intervals + 1))
        more["blocks"] = [length for length in (first, intervals - first) if length]
    if rng.random() < 0.3:
        more["transcription"] = Radau(points=2, elements=1)
    if rng.random() < 0.4:
        states = ["x_0", "x_1"] if nx == 2 else ["x"]
        more["start"] = {name: Free(-1, 1) for name in states[: rng.integers(1, 3)]}
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ode),
        horizon=1.0,
        intervals=intervals,
        stage_cost=bends + shift * ca.sumsqr(u) + ca.dot(rng.normal(size=nu), u),
        terminal_cost=rng.normal() * ca.sumsqr(x),
        bounds=Bounds(controls=(-1, 1), states=(-2, 2) if rng.random() < 0.5 else None),
        constraints=constraints,
        terminal=terminal,
        checks=int(rng.integers(1, 3)),
        substeps=1,
        **more,  # type: ignore[arg-type]
    )


@given(seed=st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_riccati_says_what_the_dense_reduced_hessian_says(seed: int) -> None:
    """At optima that IPOPT finds, and at points with arbitrary multipliers."""
    rng = np.random.default_rng(seed)
    problem = random_problem(rng)
    model = problem.model
    fitness = Fitness(problem, backend="casadi")
    x0 = rng.uniform(-0.3, 0.3, size=model.nx)
    guess = rng.uniform(-1, 1, size=(model.nu, problem.intervals))
    found = Polisher(fitness)(guess, x0)
    points = [point_at(problem, guess, x0.tolist())]
    lam = rng.normal(size=points[0].lam_g.size)
    # Some of the rows and bounds are held by a large multiplier, others free.
    chosen = rng.random(lam.size) < 0.5
    large = np.where(rng.random(points[0].w.size) < 0.3, 1e3, 0.0)
    points = [replace(points[0], lam_g=np.where(chosen, 1e3 * lam, 0.0), lam_x=large)]
    if found.point is not None:
        assert stationarity(found.point) <= 1e-5
        points.append(found.point)
    for point in points:
        reduced = least_curvature(point)
        told = curvature(point)
        if reduced > SURE:
            assert told is Curvature.POSITIVE
        elif reduced < -SURE:
            assert told is Curvature.NEGATIVE


@given(bend=st.floats(0.1, 3))
@settings(max_examples=15, deadline=None)
def test_sign_changes_where_the_closed_form_says(bend: float) -> None:
    """min u^2 integrated - bend x(1)^2: with N equal parts, 1 - bend is the sign."""
    if abs(bend - 1) < 1e-3:
        return
    problem = scalar(U**2, -bend * X**2)
    point = with_multipliers(point_at(problem, np.zeros((1, 3)), [0.0]))
    expected = Curvature.POSITIVE if bend < 1 else Curvature.NEGATIVE
    assert curvature(point) is expected


def unmet(point: NlpPoint) -> float:
    """Return what is left of the slope at a point, summed up."""
    *_, rest = least_multipliers(point.program, point.w, point.q, point.limits)
    return float(np.abs(rest).sum())


def separate(
    slopes: Array, place: Array, *, lower: Array, upper: Array, caps: Array
) -> float:
    """Return what is unmet of a cost that is linear in controls that move nothing.

    Args:
        slopes: Of the cost, shape (nu, N); natural units are those of the NLP.
        place: The controls, shape (nu, N).
        lower: Of each control, shape (nu,).
        upper: Of each control, shape (nu,).
        caps: Upper limits of path constraints on the controls, stated twice.
    """
    nu, intervals = place.shape
    u, s = ca.SX.sym("u", nu), ca.SX.sym("s", nu)
    rows = PathConstraint(expression=ca.vertcat(u, u), upper=[*caps, *caps], scale=1)
    problem = OptimalControlProblem(
        Model(states=X, controls=u, ode=0 * u[0]),
        horizon=float(intervals),
        intervals=intervals,
        stage_cost=ca.dot(s, u),
        signals=s,
        quadrature="left",
        bounds=Bounds(controls=(lower, upper)),
        constraints=[rows],
        scales={f"u_{k}": 1.0 for k in range(nu)},
    )
    known = Known(signals=np.hstack([slopes, slopes[:, -1:]]))
    point = point_at(problem, place, [0.0], known)
    left = unmet(point)
    return left * point.cost_size


def test_unmet_is_the_slope_that_no_active_limit_explains() -> None:
    """Control by control: a slope downhill into a limit within 1e-5 is explained.

    Bounds and rows that coincide share their multiplier; there is one control with
    equal bounds, which explain every slope.
    """
    rng = np.random.default_rng(0)
    lower, upper = np.array([-1.0, -1.0, 0.25]), np.array([2.0, 2.0, 0.25])
    caps = np.array([0.5, 2.0, 9.0])
    most = np.minimum(upper, caps)[:, None]
    for _ in range(30):
        slopes = rng.uniform(-0.9, 0.9, (3, 4))
        inwards = rng.choice([0.0, 0.9e-5, 1.1e-5, 0.2], (3, 4))
        is_low = rng.random((3, 4)) < 0.5
        inwards[2] = 0.0
        place = np.where(is_low, lower[:, None] + inwards, most - inwards)
        explained = (inwards < 1e-5) & np.where(is_low, slopes > 0, slopes < 0)
        explained[2] = True
        found = separate(slopes, place, lower=lower, upper=upper, caps=caps)
        expected = np.abs(slopes[~explained]).sum()
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_unmet_is_infinite_where_a_slope_is() -> None:
    """The root of u has no slope at 0, and that of the cost neither."""
    root = scalar(U, 0, constraints=[ca.sqrt(U) <= 4], limits=(0, 1))
    for problem in (root, scalar(ca.sqrt(U), 0, limits=(0, 1))):
        for level, is_finite in ((0.5, True), (0.0, False)):
            controls = np.array([[0.5, level, 0.5]])
            point = point_at(problem, controls, [0.0])
            left = unmet(point)
            assert np.isfinite(left) == is_finite
            assert is_finite or left == np.inf


def test_tied_controls_are_the_first_member_s_or_those_of_the_interval_before() -> None:
    """Of four controls 2 is the same as 0 in the first interval, and in the next one.

    There 0 is as well the same as before, and 3 as the one before that is 1.
    """
    rng = np.random.default_rng(0)
    labels = np.array([[0, 0], [1, 4], [0, 0], [3, 1]])
    problem = SimpleNamespace(
        model=SimpleNamespace(nx=2, nu=4), intervals=2, control_labels=labels
    )
    stages = optimality._Stages.__new__(optimality._Stages)
    H = [one + one.T for one in rng.normal(size=(2, 6, 6))]
    dynamics, active = rng.normal(size=(2, 2, 6)), rng.normal(size=(2, 1, 6))
    stages.hessian, stages.dynamics, stages.active = [*H], [*dynamics], [*active]
    stages.held_controls = np.zeros((2, 4), dtype=bool)
    stages.held_states = np.zeros((2, 2))
    stages.ends = [(np.eye(2), np.ones((1, 2)))]
    stages.remember_controls(problem)  # type: ignore[arg-type]
    z = rng.normal(size=10)
    x, v, u = np.split(z, [2, 6])
    for k, used in enumerate(([u[0], u[1], u[0], u[3]], [v[2], u[1], v[2], v[1]])):
        w = np.concatenate([x, used])
        assert z @ stages.hessian[k] @ z == pytest.approx(w @ H[k] @ w)
        np.testing.assert_allclose(stages.dynamics[k] @ z, [*dynamics[k] @ w, *used])
        np.testing.assert_allclose(stages.active[k] @ z, active[k] @ w)
    np.testing.assert_array_equal(
        stages.held_controls, [[False, False, True, False], [True, False, True, True]]
    )
    assert stages.held_states.shape == (2, 6)
