"""Bounds and rows of the interior-point method, against NumPy on random numbers."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.barrier import (
    Pairs,
    Walls,
    bounded,
    inside,
    kinds_of,
    most_of,
)

NONE = np.inf
LIMITS = {
    "equal": (0.3, 0.3),
    "lower": (-0.4, NONE),
    "upper": (-NONE, 0.7),
    "range": (-0.5, 0.6),
}


def value(expression: ca.SX, **numbers: tuple[ca.SX, Array]) -> Array:
    """Return an expression with numbers in the place of its symbols, a column."""
    function = ca.Function("f", [one for one, _ in numbers.values()], [expression])
    return np.asarray(function(*(one for _, one in numbers.values()))).ravel()


class Bounded(NamedTuple):
    """Five variables, some of which have bounds, with a point inside."""

    pairs: Pairs
    of: Array
    sign: Array
    limit: Array
    v: Array
    z: Array

    def value(self, expression: ca.SX, step: Array | None = None) -> Array:
        step = np.zeros(5) if step is None else step
        return value(
            expression, v=(V, self.v), z=(Z, self.z), mu=(MU, np.array(0.03)),
            step=(STEP, step),
        )  # fmt: skip

    @property
    def distances(self) -> Array:
        return np.asarray(self.sign * (self.v[self.of.astype(int)] - self.limit))


V, Z, MU, STEP = (ca.SX.sym(n, k) for n, k in (("v", 5), ("z", 6), ("mu", 1), ("s", 5)))


@pytest.fixture(params=[0, 1, 2])
def box(request: pytest.FixtureRequest) -> Bounded:
    """Entry 1 has a lower bound, 3 an upper one, 0 and 4 both."""
    rng = np.random.default_rng(request.param)
    v = rng.normal(size=5)
    of, sign = np.array([0, 1, 4, 0, 3, 4]), np.array([1.0, 1, 1, -1, -1, -1])
    limit = v[of] - sign * rng.uniform(0.1, 2, 6)
    pairs = Pairs(of.tolist(), sign.tolist(), ca.SX(ca.DM(limit)), 5)
    return Bounded(pairs, of, sign, limit, v, rng.uniform(0.1, 2, 6))


def test_distances_are_positive_inside_only(box: Bounded) -> None:
    np.testing.assert_allclose(box.value(box.pairs.distances(V)), box.distances)
    assert (box.distances > 0).all()
    outside = box._replace(v=box.v + np.array([0, -9.0, 0, 9.0, 0]))
    assert outside.value(outside.pairs.distances(V)).min() < -1


def test_slope_is_the_derivative_of_the_logarithms(box: Bounded) -> None:
    """By central differences of -mu sum(log(d)), whose own value is NumPy's."""

    def logs(v: Array) -> float:
        return float(-np.log(box._replace(v=v).distances).sum())

    assert box.value(box.pairs.logs(V))[0] == pytest.approx(logs(box.v), rel=1e-12)
    h, eye = 1e-6, np.eye(5)
    slopes = [(logs(box.v + h * e) - logs(box.v - h * e)) / (2 * h) for e in eye]
    np.testing.assert_allclose(
        box.value(box.pairs.slope(V, MU)), 0.03 * np.array(slopes), atol=1e-7
    )


def test_curvature_is_that_of_the_logarithms_if_the_duals_are_central(
    box: Bounded,
) -> None:
    central = box._replace(z=0.03 / box.distances)
    found = central.value(box.pairs.curvature(V, Z))
    exact = ca.hessian(MU * box.pairs.logs(V), V)[0]
    np.testing.assert_allclose(
        found, central.value(ca.diag(exact)), rtol=1e-12, atol=1e-15
    )
    slack = box.value(box.pairs.curvature(V, Z))
    assert slack[2] == 0
    assert slack[1] == pytest.approx(box.z[1] / box.distances[1])


def test_step_of_duals_solves_the_linearised_complementarity(box: Bounded) -> None:
    """d z = mu, linearised: d dz + z dd = mu - d z."""
    step = np.random.default_rng(9).normal(size=5)
    dz = box.value(box.pairs.dual_step(V, Z, MU, STEP), step)
    change = box.sign * step[box.of.astype(int)]
    left = box.distances * dz + box.z * change
    np.testing.assert_allclose(left, 0.03 - box.distances * box.z, atol=1e-13)


def test_push_of_duals_is_their_part_in_the_gradient(box: Bounded) -> None:
    found = box.value(box.pairs.pushed(Z))
    wanted = np.zeros(5)
    np.add.at(wanted, box.of.astype(int), box.sign * box.z)
    np.testing.assert_allclose(found, wanted)


def test_duals_are_kept_within_ten_decades_of_the_centre(box: Bounded) -> None:
    far = box._replace(z=np.array([1e20, 1e-20, 1.0, 1.0, 1e20, 1.0]))
    found, centre = far.value(box.pairs.limited(V, Z, MU)), 0.03 / box.distances
    np.testing.assert_allclose(found[[0, 4]], 1e10 * centre[[0, 4]])
    assert found[1] == pytest.approx(1e-10 * centre[1])
    np.testing.assert_array_equal(found[[2, 3, 5]], 1.0)


def test_without_bounds_there_is_no_barrier() -> None:
    none, v = Pairs([], [], ca.SX(0, 1), 2), ca.SX.sym("v", 2)
    assert none.distances(v).shape == (0, 1)
    assert float(none.logs(v)) == 0
    np.testing.assert_array_equal(ca.DM(none.slope(v, ca.SX(1))), np.zeros((2, 1)))


def test_longest_step_leaves_a_part_of_every_number() -> None:
    rng = np.random.default_rng(0)
    d, change = ca.SX.sym("d", 4), ca.SX.sym("c", 4)
    for _ in range(20):
        numbers, changes = rng.uniform(0.1, 1, 4), rng.normal(size=4)
        given = {"d": (d, numbers), "c": (change, changes)}
        found = value(most_of(d, change, ca.SX(0.9), ca.SX(1)), **given)[0]
        ratios = [0.9 * a / -c for a, c in zip(numbers, changes, strict=True) if c < 0]
        assert found == pytest.approx(min([1.0, *ratios]), rel=1e-14)
        assert (numbers + found * changes >= 0.0999 * numbers).all()


def test_number_is_moved_inside_by_a_hundredth() -> None:
    """Of the limit, of 1, or of the width, whatever is least."""
    low, high = ca.SX(2), ca.SX(12)
    assert float(inside(ca.SX(-5), low, None)) == pytest.approx(2.02)
    assert float(inside(ca.SX(50), None, high)) == pytest.approx(11.88)
    assert float(inside(ca.SX(50), low, high)) == pytest.approx(11.9)
    assert float(inside(ca.SX(1), ca.SX(0), ca.SX(0.5))) == pytest.approx(0.495)
    assert float(inside(ca.SX(5), low, high)) == 5
    assert float(inside(ca.SX(5), None, None)) == 5


def test_bounds_of_entries_have_signs_and_limits_in_order() -> None:
    low, high = ca.SX.sym("low", 3), ca.SX.sym("high", 3)
    found = bounded(3, [(1.0, [0, 2], low), (-1.0, [2], high)])
    assert (found.of, found.sign, found.size) == ([0, 2, 2], [1.0, 1.0, -1.0], 3)
    assert ca.is_equal(found.limit, ca.vertcat(low[0], low[2], high[2]))


def test_kinds_of_rows_follow_from_their_limits() -> None:
    lower, upper = (np.array([one[side] for one in LIMITS.values()]) for side in (0, 1))
    kinds = kinds_of(lower, upper)
    assert kinds.equal == [0]
    assert kinds.slack == [1, 2, 3]
    assert (kinds.lower, kinds.upper) == ([1, 3], [2, 3])
    assert (kinds.less, kinds.more) == ([0, 1, 3], [0, 2, 3])


class Wall:
    """Rows of some kinds beside two variables, one of which has a bound."""

    def __init__(self, kinds: list[str]) -> None:
        """State them; their values are symbols."""
        m = len(kinds)
        lower, upper = (np.array([LIMITS[k][i] for k in kinds]) for i in (0, 1))
        own = Pairs([1], [1.0], ca.SX(-1), 2)
        self.rows = ca.SX.sym("c", m)
        self.walls = Walls(
            self.rows, ca.SX(ca.DM(lower)), ca.SX(ca.DM(upper)), kinds_of(lower, upper),
            own,
        )  # fmt: skip
        self.kinds, self.lower, self.upper, self.m = kinds, lower, upper, m

    def matrix(self) -> Array:
        """Return E of the residual c + E w - (limit of equal rows), by hand."""
        columns = []
        # Slacks, then what lets a row be below its limit, then above.
        for sign, without in ((-1, "equal"), (1, "upper"), (-1, "lower")):
            for row, kind in enumerate(self.kinds):
                if kind != without:
                    columns.append(sign * np.eye(self.m)[row])
        return np.array(columns).reshape(-1, self.m).T

    @property
    def fixed(self) -> Array:
        return np.where(np.array(self.kinds) == "equal", self.lower, 0.0)


SETS = [["equal"], ["lower"], ["upper"], ["range"],
        ["range", "upper", "equal", "lower", "range", "equal"]]  # fmt: skip
NAMES = ["equal", "lower", "upper", "range", "all"]


@pytest.fixture(params=SETS, ids=NAMES)
def wall(request: pytest.FixtureRequest) -> Wall:
    """Rows of one kind, or of all kinds."""
    return Wall(request.param)


def test_excess_is_linear_in_slacks_and_elastic_variables(wall: Wall) -> None:
    E, rng = wall.matrix(), np.random.default_rng(1)
    c, v = rng.normal(size=wall.m), rng.normal(size=2 + E.shape[1])
    at = ca.SX.sym("v", v.size)
    found = value(wall.walls.excess(at, wall.rows), rows=(wall.rows, c), v=(at, v))
    np.testing.assert_allclose(found, c + E @ v[2:] - wall.fixed, atol=1e-14)
    m = ca.SX.sym("m", wall.m)
    multipliers = rng.normal(size=wall.m)
    pressure = value(wall.walls.pressure(m), m=(m, multipliers))
    np.testing.assert_allclose(pressure, np.append([0, 0], E.T @ multipliers))


def test_elimination_is_the_solution_of_the_full_linear_system(wall: Wall) -> None:
    """S dw + E' m = -g, C dx + E dw = -r, for any dx; m is the multiplier after."""
    E, rng = wall.matrix(), np.random.default_rng(2)
    n = 2 + E.shape[1]
    S, g = rng.uniform(0.1, 5, n), rng.normal(size=n)
    r, moved = rng.normal(size=wall.m), rng.normal(size=wall.m)
    system = np.block([
        [np.diag(S[2:]), E.T], [E, np.zeros((wall.m, wall.m))],
    ])  # fmt: skip
    both = np.linalg.solve(system, -np.concatenate([g[2:], r + moved]))
    w, m = both[: n - 2], both[n - 2 :]
    stiff, slope = ca.SX.sym("S", n), ca.SX.sym("g", n)
    excess, after = ca.SX.sym("r", wall.m), ca.SX.sym("m", wall.m)
    given = {"S": (stiff, S), "g": (slope, g), "r": (excess, r), "m": (after, m)}
    rows = wall.walls.eliminated(stiff, slope, excess)
    weight, force = value(rows.weight, **given), value(rows.force, **given)
    np.testing.assert_allclose(weight * moved + force, m, rtol=1e-10, atol=1e-12)
    steps = value(wall.walls.steps(stiff, slope, after), **given)
    np.testing.assert_allclose(steps, w, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("far", [1e-3, 1.0, 1e4, 1e12, 1e18])
def test_begun_rows_have_no_excess_and_lie_inside(wall: Wall, far: float) -> None:
    mu, rho = 1e-2, 3.0
    rng = np.random.default_rng(3)
    for c in far * rng.normal(size=(8, wall.m)):
        w = value(
            wall.walls.begun(wall.rows, ca.SX(mu), ca.SX(rho)), rows=(wall.rows, c)
        )
        v = np.append([5.0, 5.0], w)
        at = ca.SX.sym("v", v.size)
        excess = value(wall.walls.excess(at, wall.rows), rows=(wall.rows, c), v=(at, v))
        assert np.abs(excess).max() <= 1e-15 * far + 1e-15
        distances = value(wall.walls.pairs.distances(at), v=(at, v))
        # Elastic variables of a row that is met are about mu / rho.
        assert distances.min() >= 0.4 * min(mu / rho, 1e-2)


def test_begun_elastic_pairs_are_on_the_central_path(wall: Wall) -> None:
    """mu / p + mu / n = 2 rho, if a row has both."""
    mu, rho = 1e-2, 3.0
    c = np.random.default_rng(4).normal(size=wall.m)
    w = value(wall.walls.begun(wall.rows, ca.SX(mu), ca.SX(rho)), rows=(wall.rows, c))
    kinds = wall.walls.kinds
    first = len(kinds.slack)
    p = dict(zip(kinds.less, w[first:], strict=False))
    n = dict(zip(kinds.more, w[first + len(kinds.less) :], strict=True))
    both = set(p) & set(n)
    assert len(both) == sum(kind in {"equal", "range"} for kind in wall.kinds)
    for row in both:
        assert mu / p[row] + mu / n[row] == pytest.approx(2 * rho, rel=1e-9)


def test_price_is_asked_of_elastic_variables_only(wall: Wall) -> None:
    slacks = sum(kind != "equal" for kind in wall.kinds)
    found = np.asarray(ca.DM(wall.walls.price(ca.SX(7)))).ravel()
    np.testing.assert_array_equal(found[: 2 + slacks], 0)
    np.testing.assert_array_equal(found[2 + slacks :], 7)
    assert found.size == 2 + wall.walls.inner
