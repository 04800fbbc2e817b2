"""The set S: nothing that is in it is dropped, nor any trajectory that is cheap."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.basis import Basis
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.region import EndSet, Region, value_interval
from swarmstart.ocp.lower_bound.stated.answer import Polynomial, Pruning, Step
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes.tube import tube_of
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand
from swarmstart.tests.ocp.lower_bound.known_optimum import Symbols, stated
from swarmstart.tests.ocp.lower_bound.statements import (
    double_integrator,
    trajectories,
)
from swarmstart.tests.ocp.lower_bound.test_known_optima import stop_after


def plane() -> Statement:
    """The double integrator with a disc, a moving wall, bounds and an end set."""
    statement = double_integrator()
    t, x = statement.time, statement.states
    return replace(
        statement,
        path=(0.09 - ca.sumsqr(x - ca.DM([0.9, 0.5])), x[1] - 1.2 + 0.3 * t),
        state_box=(np.array([-0.4, -1.1]), np.array([np.inf, np.inf])),
        ends=(3 * x[0] - 2.4, 0.1 - x[1] / 3, x[0] ** 2 + x[1] - 1.5 + 0.1 * t),
        horizon=(1.2, 2.1),
    )


def full(step: Step) -> Step:
    """Return a step with all the products up to its degree, as computed ones have."""
    given = step.polynomial
    basis = Basis(given.exponents.shape[1], int(given.exponents.sum(axis=1).max()))
    number = {tuple(e): j for j, e in enumerate(basis.exponents.tolist())}
    coefficients = np.zeros(basis.size)
    for exponents, value in zip(
        given.exponents.tolist(), given.coefficients, strict=True
    ):
        coefficients[number[tuple(exponents)]] = value
    polynomial = replace(given, exponents=basis.exponents, coefficients=coefficients)
    return replace(step, polynomial=polynomial)


def by_both(pruning: Pruning) -> Pruning:
    """Return a pruning with its polynomials in full."""
    return Pruning(come=full(pruning.come), go=full(pruning.go))


def region_of(statement: Statement) -> Region:
    return Region(statement, tube_of(statement))


def shrunk() -> Region:
    """With a pruning by hand, too."""
    evidence = by_hand.pruned()
    (pruning,) = evidence.prunings
    return Region(evidence.statement, evidence.tube).pruned(
        by_both(pruning), evidence.known
    )


def boxes(
    region: Region, rng: np.random.Generator, count: int
) -> tuple[Array, Array, Array]:
    """Random boxes about the set, of all sizes, and a point of each."""
    box = region.box
    size = 1.3 * box.half[:, None]
    first = box.middle[:, None] + size * rng.uniform(-1, 1, (len(size), count))
    width = size * rng.random((len(size), count)) * 10.0 ** -rng.integers(0, 5, count)
    part = rng.random(first.shape)
    part = np.where(rng.random(first.shape) < 0.3, np.round(part), part)
    return first, first + width, first + part * width


@pytest.mark.parametrize("make", [lambda: region_of(plane()), shrunk])
def test_no_box_with_a_point_of_the_set_is_outside(
    make: Callable[[], Region],
) -> None:
    region, rng = make(), np.random.default_rng(1)
    lower, upper, points = boxes(region, rng, 40_000)
    inside, out = region.inside(points), region.outside(lower, upper)
    assert inside.sum() > 1000 and out.sum() > 1000
    assert not (inside & out).any()
    at_end, no_end = region.inside_ends(points), region.outside_ends(lower, upper)
    assert no_end.sum() > 1000
    assert not (at_end & no_end).any()


def test_inside_is_what_the_expressions_say() -> None:
    statement = plane()
    region, rng = region_of(statement), np.random.default_rng(2)
    points = boxes(region, rng, 20_000)[2]
    t, x, v = points
    kept = (x >= -0.4) & (v >= -1.1) & (v <= 1.2 - 0.3 * t)
    kept &= (x - 0.9) ** 2 + (v - 0.5) ** 2 >= 0.09
    tube = replace(statement, path=(), ends=(), state_box=double_integrator().state_box)
    kept &= Region(tube, region.tube).inside(points)
    assert (region.inside(points) == kept).all()
    ends = kept & (x <= 0.8) & (v >= 0.3) & (x**2 + v <= 1.5 - 0.1 * t)
    ends &= (t >= 1.2) & (t <= 2.1)
    assert ends.any()
    assert (region.inside_ends(points) == ends).all()


def test_paving_and_end_boxes_cover_the_trajectories() -> None:
    region, rng = region_of(plane()), np.random.default_rng(3)
    times, states = trajectories(region.statement, rng, 300)
    points = np.vstack(
        [np.repeat(times, states.shape[2]), np.moveaxis(states, 1, 0).reshape(2, -1)]
    )
    low, high = (limit[:, None] for limit in region.statement.state_box)
    statement = region.statement
    path, end = (
        ca.Function("rows", [statement.point], [ca.vertcat(*rows)])
        for rows in (statement.path, statement.ends)
    )
    kept = ((points[1:] >= low) & (points[1:] <= high)).all(axis=0)
    kept &= (np.array(path(points)) <= 0).all(axis=0)
    assert 1000 < kept.sum() < kept.size
    assert in_some(region.paving, points[:, kept]).all()
    ends = np.array(end(points))
    ended = kept & (ends <= 0).all(axis=0) & (points[0] >= 1.2)
    assert ended.sum() > 10
    assert in_some(region.end_boxes(), points[:, ended]).all()
    box = region.box
    assert (np.abs(box.scaled(points[:, kept])) <= 1 + 1e-12).all()


def in_some(covering: tuple[Array, Array], points: Array) -> NDArray[np.bool_]:
    """Return whether each point is in one of the boxes, but for rounding."""
    lower, upper = (corner[:, None, :] for corner in covering)
    found = []
    for part in np.array_split(points, max(1, points.shape[1] // 500), axis=1):
        at = part[:, :, None]
        within = (at >= lower - 1e-9) & (at <= upper + 1e-9)
        found.append(np.asarray(within.all(axis=0)).any(axis=1))
    return np.concatenate(found)


def test_narrowed_boxes_hold_all_ends() -> None:
    x = ca.SX.sym("x", 2)
    rng = np.random.default_rng(4)
    for _ in range(20):
        a, b, c = rng.normal(size=3)
        statement = by_hand.scalar(
            states=x, x0=np.zeros(2),
            state_box=(np.full(2, -np.inf), np.full(2, np.inf)),
            ends=(a * x[0] - b, c - a * x[1], -a * x[0] + b - 0.2, x[0] + x[1] - 9),
        )  # fmt: skip
        ends = EndSet(statement)
        lower = rng.uniform(-4, 4, (3, 4000))
        lower[0] = 1.0
        upper = lower + rng.random((3, 4000))
        upper[0] = 1.0
        part = rng.random((3, 4000))
        points = lower + part * (upper - lower)
        points[1] = np.where(rng.random(4000) < 0.3, b / a, points[1])
        within = ((points >= lower) & (points <= upper)).all(axis=0)
        kept = ends.inside(points) & within
        small = ends.narrowed(lower, upper)
        assert in_some(small, points[:, kept]).all()
        assert small[0].shape[1] < 4000


@pytest.mark.parametrize("ends", ["equal", "none"])
def test_equal_ends_make_boxes_that_thin(ends: str) -> None:
    statement = by_hand.scalar()
    x = statement.states
    rows = (x - 1 - 1e-4, 1 - 1e-4 - x) if ends == "equal" else ()
    region = region_of(replace(statement, ends=rows))
    lower, upper = region.end_boxes()
    width = (upper - lower)[1].max()
    assert (upper[0] == 1).all() and (lower[0] == 1).all()
    assert width < 2.1e-4 if ends == "equal" else width > 1e-3


# Of the scalar problem C = -x^2 and G = x^2 are exact, so that a slack is needed in
# full as soon as a polynomial falls in time, or is too high at the end.
PRUNINGS = {
    "exact": Pruning(
        come=by_hand.step({(0, 2): -1.0}, end_slack=None),
        go=by_hand.step({(0, 2): 1.0}),
    ),
    "come falls": Pruning(
        come=by_hand.step({(0, 2): -1.0, (1, 0): -0.9}, slack=0.9, end_slack=None),
        go=by_hand.step({(0, 2): 1.0}),
    ),
    "go falls": Pruning(
        come=by_hand.step({(0, 2): -1.0}, end_slack=None),
        go=by_hand.step({(0, 2): 1.0, (0, 0): 0.9, (1, 0): -0.9}, slack=0.9),
    ),
    "too high at the end": Pruning(
        come=by_hand.step({(0, 2): -1.0}, end_slack=None),
        go=by_hand.step({(0, 2): 1.0, (0, 0): 0.9}, end_slack=0.9),
    ),
}


@pytest.mark.parametrize("name", PRUNINGS)
@pytest.mark.parametrize("known", [1.3, 3.0, 5.0])
def test_no_trajectory_that_is_cheaper_is_pruned(name: str, known: float) -> None:
    # u = x until s, then u = -x: x^2 grows to X = e^2s, the cost is 2 X - 1.
    region = region_of(by_hand.scalar()).pruned(by_both(PRUNINGS[name]), known)
    switch = np.log((known + 1) / 2) / 2
    t = np.linspace(0, 1, 2001)
    for share in (0.999, 0.5, 0.0):
        s = share * switch
        x = np.exp(s - np.abs(t - s))
        assert region.inside(np.array([t, x])).all()
        assert not region.outside(*np.array([[t, x], [t, x]])).any()
    if name == "exact":
        s = 1.01 * switch
        x = np.exp(s - np.abs(t - s))
        assert not region.inside(np.array([t, x])).all()


def flown(u: Array) -> tuple[Array, Array, float]:
    """Return times, states and cost of x' = u from 1, controls held, x^2 + u^2."""
    dt = 1 / len(u)
    times = np.linspace(0, 1, len(u) + 1)
    x = 1 + np.concatenate([[0.0], np.cumsum(u)]) * dt
    # Of a straight line from a to b.
    squares = (x[:-1] ** 2 + x[:-1] * x[1:] + x[1:] ** 2) / 3
    fine = np.linspace(0, 1, 4 * len(u) + 1)
    return fine, np.interp(fine, times, x), float(dt * (squares + u**2).sum())


def test_computed_prunings_keep_what_is_cheaper() -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-2, 2), stage=s.x**2 + s.u**2, end=0
    )
    known = 1.1 * np.tanh(1.0)
    bound = lower_bound(problem, [1.0], answer=known, work=60.0, progress=stop_after(6))
    evidence = bound.evidence
    assert evidence is not None and evidence.prunings
    region = Region(evidence.statement, evidence.tube)
    for pruning in evidence.prunings:
        region = region.pruned(pruning, evidence.known)
    rng, cheap, cut = np.random.default_rng(5), 0, 0
    middles = (np.arange(8) + 0.5) / 8
    best = -np.sinh(1 - middles) / np.cosh(1.0)
    for number in range(120):
        wild = rng.normal(size=8) * (0.4 if number % 3 else 1.5)
        times, states, cost = flown(np.clip(best + wild, -2, 2))
        points = np.array([times, states / evidence.statement.sizes[0]])
        inside = region.inside(points).all()
        if cost < known:
            cheap += 1
            assert inside
            assert in_some(region.paving, points).all()
        cut += not inside
    assert cheap >= 10 and cut >= 10


def test_a_value_s_bounds_hold_the_exact_value() -> None:
    rng = np.random.default_rng(6)
    for degree in (0, 1, 3, 6):
        grid = np.indices((degree + 1,) * 2).reshape(2, -1).T
        grid = grid[grid.sum(axis=1) <= degree]
        order = np.lexsort((grid[:, 1], grid[:, 0], grid.sum(axis=1)))
        polynomial = Polynomial(
            middle=rng.normal(size=2), half=0.1 + rng.random(2),
            exponents=grid[order], coefficients=100 * rng.normal(size=len(grid)),
        )  # fmt: skip
        for _ in range(20):
            point = polynomial.middle + polynomial.half * rng.uniform(-1.2, 1.2, 2)
            low, high = value_interval(polynomial, point)
            assert low <= exact(polynomial, point) <= high
            assert high - low < 1e-9


def exact(polynomial: Polynomial, point: Array) -> Fraction:
    """Return the value of the floats, without any rounding."""
    powers = []
    for y, middle, half in zip(point, polynomial.middle, polynomial.half, strict=True):
        z = (Fraction(float(y)) - Fraction(float(middle))) / Fraction(float(half))
        row = [Fraction(1), z]
        for _ in range(8):
            row.append(2 * z * row[-1] - row[-2])
        powers.append(row)
    total = Fraction(0)
    for (i, j), number in zip(
        polynomial.exponents.tolist(), polynomial.coefficients, strict=True
    ):
        total += Fraction(float(number)) * powers[0][i] * powers[1][j]
    return total
