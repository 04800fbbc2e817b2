"""Taylor forms: what they leave over holds at every point, and falls as a cube."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.taylor_form import (
    Expansion,
    TaylorForm,
    least_quadratic,
)
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
)

y, p = ca.SX.sym("y", 3), ca.SX.sym("p", 2)
FUNCTIONS = {
    "cubic": [
        p[0] * y[0] ** 3 + y[0] * y[1] * y[2] - p[1] * y[1] ** 2 * y[2] + 3,
        y[2] ** 3 - 2 * y[1] * y[0] ** 2,
    ],
    "sine and exponential": [
        ca.sin(2 * y[0] + y[1]) * ca.exp(y[2]),
        ca.exp(p[0] * y[0] * y[1]) - ca.cos(y[2]) ** 2,
    ],
    "quotient": [y[0] / (6 + y[1] + y[2] ** 2), 1 / (5 + p[1] * y[0] * y[1])],
}
GIVEN = np.array([0.7, -0.4])


def boxes(
    count: int, size: float, rng: np.random.Generator, d: int = 3
) -> tuple[Array, Array]:
    """Boxes of very unequal sides in and about [-1, 1]^d, some of them flat."""
    middle = rng.uniform(-1, 1, (d, count))
    reach = size * 10.0 ** rng.uniform(-2, 0, (d, count))
    reach[rng.random((d, count)) < 0.1] = 0.0
    return middle - reach, middle + reach


def points_of(lower: Array, upper: Array, rng: np.random.Generator) -> list[Array]:
    """All corners of boxes, their middles and points at random, (d, m) each."""
    d = len(lower)
    corners = np.array(np.meshgrid(*[[0, 1]] * d)).reshape(d, -1).T
    shares = [np.repeat(c[:, None], lower.shape[1], axis=1) for c in corners]
    shares += [rng.random(lower.shape) for _ in range(40)]
    shares.append(np.full(lower.shape, 0.5))
    return [np.clip(lower + (upper - lower) * s, lower, upper) for s in shares]


def model(at: Expansion, pairs: list[tuple[int, int]], k: int, d: Array) -> Array:
    """q(m) + g'd + d'Hd / 2 of function k."""
    found: Array = at.value[k] + (at.slope[k] * d).sum(axis=0)
    for number, (i, j) in enumerate(pairs):
        found += at.bend[k, number] * d[i] * d[j] * (0.5 if i == j else 1.0)
    return found


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("size", [1.0, 0.3, 0.01, 1e-5])
def test_functions_are_within_the_rest_of_their_taylor_form(
    name: str, size: float
) -> None:
    functions = FUNCTIONS[name]
    form = TaylorForm(functions, y, p)
    rng = np.random.default_rng(1)
    lower, upper = boxes(60, size, rng)
    at = form.expanded(lower, upper, GIVEN)
    assert np.isfinite(at.rest).all()
    exact = ca.Function("q", [y, p], [ca.vertcat(*functions)])
    for point in points_of(lower, upper, rng):
        d = point - (lower + upper) / 2
        assert (np.abs(d) <= at.reach).all()
        values = np.array(exact(point, np.repeat(GIVEN[:, None], 60, axis=1)))
        for k in range(len(functions)):
            off = np.abs(values[k] - model(at, form.pairs, k, d))
            assert (off <= at.rest[k] + at.value_radius[k] + 1e-14).all()


@pytest.mark.parametrize("term", ["ijk", "iij", "iii"])
def test_the_rest_of_a_cubic_about_zero_is_its_largest_value(term: str) -> None:
    # The third derivatives are constant: nothing is lost, nothing may be missing.
    function = {"ijk": y[0] * y[1] * y[2], "iij": y[0] ** 2 * y[2], "iii": y[1] ** 3}
    reach = np.array([[0.5], [2.0], [3.0]])
    at = TaylorForm([function[term]], y, p).expanded(-reach, reach, GIVEN)
    most = {"ijk": 3.0, "iij": 0.75, "iii": 8.0}[term]
    assert at.rest[0, 0] >= most
    assert at.rest[0, 0] == pytest.approx(most)
    held = {"ijk": [0, 1, 2], "iij": [0, 2], "iii": [1]}[term]
    assert set(np.flatnonzero(at.pull[0, :, 0])) == set(held)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_rest_falls_as_the_cube_of_the_box(name: str) -> None:
    form = TaylorForm(FUNCTIONS[name], y, p)
    rng = np.random.default_rng(2)
    middle, reach = rng.uniform(-1, 1, (3, 40)), rng.uniform(0.5, 1, (3, 40))
    rests = []
    for size in (0.08, 0.02, 0.005):
        rests.append(
            form.expanded(middle - size * reach, middle + size * reach, GIVEN).rest
        )
    for large, small in pairwise(rests):
        assert (large > 4**2.8 * small).all()


def test_the_radius_of_a_value_covers_its_rounding() -> None:
    zero = (y[0] + 1e8) ** 2 - y[0] ** 2 - 2e8 * y[0] - 1e16
    rng = np.random.default_rng(3)
    at = rng.random((3, 100))
    found = TaylorForm([zero], y, p).expanded(at, at, GIVEN)
    assert np.abs(found.value).max() > 0.1
    assert (np.abs(found.value) <= found.value_radius).all()


def test_the_rest_covers_the_rounding_of_slopes_and_bends() -> None:
    # Slope and bend in y_0 are exactly 0 as numbers, but not as they are rounded.
    flat = (y[1] + 1e8) ** 2 - y[1] ** 2 - 2e8 * y[1] - 1e16
    rng = np.random.default_rng(4)
    middle, reach = rng.random((3, 100)), np.array([[4.0], [0.0], [3.0]])
    at = TaylorForm([flat * y[0], flat * y[0] ** 2, flat * y[0] * y[2]], y, p)
    found = at.expanded(middle - reach, middle + reach, GIVEN)
    slopes = np.abs(found.slope[0, 0])
    assert slopes.max() > 0.1
    assert (found.rest[0] >= 4 * slopes).all()
    bends = np.abs(found.bend[1, at.pairs.index((0, 0))])
    assert bends.max() > 0.1
    assert (found.rest[1] >= 8 * bends).all()
    assert (found.pull[1, 0] >= 8 * bends).all()
    # About 0 the slopes are exact: 16 and 12 radii of the bend are left.
    middle[[0, 2]] = 0.0
    found = at.expanded(middle - reach, middle + reach, GIVEN)
    assert found.rest[1].min() > 0.1
    assert found.rest[2] == pytest.approx(found.rest[1] * 12 / 16)


@pytest.mark.parametrize(
    "pole",
    [1 / y[0], ca.sqrt(y[0]), ca.log(y[0]), ca.tan(2 * y[0]), ca.exp(1e4 * y[0])],
)
def test_nothing_finite_is_left_over_where_a_function_is_not_smooth(
    pole: ca.SX,
) -> None:
    lower = np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    upper = np.array([[3.0, 4.0], [1.0, 1.0], [1.0, 1.0]])
    with np.errstate(all="ignore"):
        at = TaylorForm([pole], y, p).expanded(lower, upper, GIVEN)
    assert not np.isfinite(at.rest).any()


@pytest.mark.parametrize(
    "kinked", [ca.fabs(y[0]), ca.fmax(y[0], y[1]), ca.sign(y[0]) * y[1]]
)
def test_functions_whose_derivatives_jump_are_refused(kinked: ca.SX) -> None:
    with pytest.raises(UnknownIntervalOperationError):
        TaylorForm([kinked], y, p)


def drawn_quadratics(d: int, count: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(d)
    pairs = d * (d + 1) // 2
    slope = rng.normal(size=(d, count)) * rng.choice([0.0, 0.1, 1.0], count)
    bend = rng.normal(size=(pairs, count)) * rng.choice([0.0, 1.0, 10.0], count)
    return slope, bend, rng.random((d, count))


@pytest.mark.parametrize("d", [1, 2, 3, 4])
def test_quadratics_are_nowhere_below_their_least(d: int) -> None:
    slope, bend, reach = drawn_quadratics(d, 300)
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    least, spread = least_quadratic(slope, bend, reach, pairs)
    rng = np.random.default_rng(9)
    for z in points_of(-reach, reach, rng):
        value, moved = (slope * z).sum(axis=0), np.zeros_like(z)
        for number, (i, j) in enumerate(pairs):
            term = bend[number] * z[i] * z[j] * (0.5 if i == j else 1.0)
            value += term
            moved[i] += np.abs(term)
            if i != j:
                moved[j] += np.abs(term)
        assert (value >= least - 1e-13).all()
        assert (np.abs(slope * z) + moved <= spread + 1e-13).all()


@pytest.mark.parametrize("d", [1, 3])
def test_the_least_is_exact_if_axes_share_nothing(d: int) -> None:
    slope, bend, reach = drawn_quadratics(d, 100)
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    alone = np.array([i == j for i, j in pairs])
    bend = bend * alone[:, None]
    least, _ = least_quadratic(slope, bend, reach, pairs)
    z = reach[..., None] * np.linspace(-1, 1, 2001)
    each = slope[..., None] * z + bend[alone][..., None] * z**2 / 2
    assert least == pytest.approx(each.min(axis=2).sum(axis=0), abs=1e-5)
