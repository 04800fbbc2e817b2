"""CMA-ES with restarts."""

import ctypes
import math
from typing import cast

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    CMAES,
    Box,
    Budget,
    Initial,
    InvalidSettingsError,
    Search,
    SearchResult,
    feasibility_first,
    minimize,
    static_penalty,
)
from swarmstart.heuristics.laws.order import ranking
from swarmstart.heuristics.running.minimize import Objective
from swarmstart.heuristics.searches.cma import CMAESState, adapt
from swarmstart.heuristics.searches.cma_constants import (
    constants_of,
    default_size,
    weights_of,
)
from swarmstart.machine_code import Pointers

DIM = 8
BOX = Box(lower=np.full(DIM, -5.0), upper=np.full(DIM, 5.0))
AXES = 10.0 ** np.linspace(0.0, 5.0, DIM)
ROTATION = np.linalg.qr(np.random.default_rng(0).normal(size=(DIM, DIM)))[0]


def sphere(x: Array) -> tuple[Array, Array]:
    return ((x - 1.0) ** 2).sum(axis=0), np.zeros(x.shape[1])


def ellipsoid(x: Array) -> tuple[Array, Array]:
    return AXES @ (x - 1.0) ** 2, np.zeros(x.shape[1])


def rotated(x: Array) -> tuple[Array, Array]:
    return AXES @ (ROTATION @ (x - 1.0)) ** 2, np.zeros(x.shape[1])


def searched(
    objective: Objective,
    evaluations: int,
    seed: int = 0,
    *,
    algorithm: CMAES | None = None,
) -> SearchResult:
    return minimize(
        objective,
        BOX,
        algorithm=algorithm or CMAES(),
        budget=Budget(evaluations=evaluations),
        rng=np.random.default_rng(seed),
    )


def evaluations_without_bounds(objective: Objective, seed: int) -> int:
    """Evaluations to 1e-8 in a box too wide to be felt, from [-4, 4], with sigma 3."""
    rng = np.random.default_rng(seed)
    return minimize(
        objective,
        Box(lower=np.full(DIM, -500.0), upper=np.full(DIM, 500.0)),
        algorithm=CMAES(sigma=0.003),
        budget=Budget(evaluations=20_000, target=1e-8),
        initial=rng.uniform(-4.0, 4.0, (DIM, default_size(DIM))),
        rng=rng,
    ).evaluations


@pytest.mark.parametrize(
    ("dim", "size"), [(1, 4), (2, 6), (10, 10), (10, 320), (80, 17)]
)
def test_constants_obey_the_identities_of_the_tutorial(dim: int, size: int) -> None:
    constants = constants_of(dim, size)
    w = weights_of(dim, size, constants)
    mu = size // 2
    ranks = np.arange(1, size + 1)
    np.testing.assert_allclose(w[:mu].sum(), 1.0)
    np.testing.assert_allclose(constants.mu_eff, 1.0 / (w[:mu] ** 2).sum())  # (8)
    assert (np.diff(w) < 0.0).all() and (w[mu + 1 :] < 0.0).all()
    raw = np.log((size + 1) / 2) - np.log(ranks)  # (49)
    np.testing.assert_allclose(w[:mu], raw[:mu] / raw[:mu].sum())
    c_1, c_mu = constants.c_1, constants.c_mu
    minus = raw[mu:].sum() ** 2 / (raw[mu:] ** 2).sum()
    allowed = min(
        1 + c_1 / c_mu,
        1 + 2 * minus / (constants.mu_eff + 2),
        (1 - c_1 - c_mu) / (dim * c_mu),
    )
    np.testing.assert_allclose(-w[w < 0.0].sum(), allowed)  # (50)-(53)
    assert 0.0 < c_1 and 0.0 < c_mu and c_1 + c_mu <= 1.0
    assert 0.0 < constants.c_sigma < 1.0 and 0.0 < constants.c_c <= 1.0
    exact = math.sqrt(2.0) * math.exp(math.lgamma((dim + 1) / 2) - math.lgamma(dim / 2))
    np.testing.assert_allclose(constants.chi, exact, rtol=0.01)


def test_default_size_is_that_of_48() -> None:
    assert [default_size(n) for n in (1, 2, 10, 80)] == [4, 6, 10, 17]


def test_constants_are_those_of_the_cmaes_package() -> None:
    cmaes = pytest.importorskip("cmaes", reason="pip install swarmstart[peers]")
    for dim, size in ((2, 6), (10, 10), (10, 160), (40, 15)):
        peer = cmaes.CMA(mean=np.zeros(dim), sigma=1.0, population_size=size)
        ours = constants_of(dim, size)
        np.testing.assert_allclose(
            [ours.mu_eff, ours.c_sigma, ours.d_sigma, ours.c_c, ours.c_1, ours.c_mu],
            [peer._mu_eff, peer._c_sigma, peer._d_sigma, peer._cc, peer._c1, peer._cmu],
            rtol=1e-12,
        )
        np.testing.assert_allclose(weights_of(dim, size, ours), peer._weights)


@pytest.mark.parametrize("h_sigma", [0.0, 1.0])
def test_covariance_is_updated_by_47(h_sigma: float) -> None:
    """With the part of C that a stalled path no longer brings: delta of (47)."""
    rng = np.random.default_rng(7)
    state = Search(CMAES(size=10), BOX, rng=rng).state
    assert isinstance(state, CMAESState)
    root = rng.normal(size=(DIM, DIM))
    C, p, y = root @ root.T, rng.normal(size=DIM), rng.normal(size=(10, DIM))
    state.covariance[:], state.path_c[:] = C, p
    k = constants_of(DIM, 10)
    w = weights_of(DIM, 10, k)
    adapt(state, k, h_sigma, float(w.sum()), w, y)
    delta = (1 - h_sigma) * k.c_c * (2 - k.c_c)
    expected = (1 + k.c_1 * delta - k.c_1 - k.c_mu * w.sum()) * C
    expected += k.c_1 * np.outer(p, p) + k.c_mu * (y.T * w) @ y
    np.testing.assert_allclose(state.covariance, expected, rtol=1e-12, atol=1e-12)


def test_sphere_converges_log_linearly() -> None:
    rates = []
    for seed in range(5):
        result = searched(sphere, 3000, seed)
        logs = np.log10(result.history_cost)
        below = np.array([int(np.argmax(logs < -k)) for k in range(1, 9)])
        slope, first = np.polyfit(np.arange(8.0), below, 1)
        # No decade is far off the line: a step is random by some generations.
        assert np.abs(first + slope * np.arange(8.0) - below).max() < 1.5 * slope
        rates.append(slope)
    # The cmaes package needs 13 to 15 generations a decade (n = 8, lambda = 10).
    assert 10.0 < np.mean(rates) < 18.0


def test_needs_as_many_evaluations_as_the_cmaes_package() -> None:
    cmaes = pytest.importorskip("cmaes", reason="pip install swarmstart[peers]")
    ours, theirs = [], []
    for seed in range(15):
        ours.append(evaluations_without_bounds(rotated, seed))
        mean = np.random.default_rng(seed).uniform(-4.0, 4.0, DIM)
        peer = cmaes.CMA(mean=mean, sigma=3.0, seed=seed)
        best, count = np.inf, 0
        while best > 1e-8:
            points = [peer.ask() for _ in range(peer.population_size)]
            values = rotated(np.array(points).T)[0]
            peer.tell(list(zip(points, values.tolist(), strict=True)))
            best, count = min(best, values.min()), count + peer.population_size
        theirs.append(count)
    # The standard deviation of one run is 5 %.
    assert 0.9 < np.median(ours) / np.median(theirs) < 1.1


def test_rotation_of_the_objective_changes_no_evaluation_count() -> None:
    counts = [
        np.median([evaluations_without_bounds(f, seed) for seed in range(15)])
        for f in (ellipsoid, rotated)
    ]
    assert 0.9 < counts[0] / counts[1] < 1.1


def test_a_constant_added_to_the_cost_changes_no_bit() -> None:
    # Costs are rounded so coarsely that the sum is exact.
    def rounded(x: Array, shift: float) -> tuple[Array, Array]:
        return np.round(1024.0 * ellipsoid(x)[0]) / 1024.0 + shift, np.zeros(x.shape[1])

    one, other = (
        searched(lambda x, c=c: rounded(x, c), 12_000)  # type: ignore[misc]
        for c in (0.0, 2.0**20)
    )
    assert _state(one).restarts[0] > 0
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.history_cost + 2.0**20, other.history_cost)


def _state(result: SearchResult) -> CMAESState:
    fields = result.snapshot.items()
    return CMAESState(**{k[6:]: v for k, v in fields if k.startswith("state.")})  # type: ignore[arg-type]


def test_each_restart_doubles_the_population_and_keeps_the_best() -> None:
    sizes: list[int] = []
    result = minimize(
        sphere,
        BOX,
        algorithm=CMAES(size=6),
        budget=Budget(evaluations=15_000),
        rng=np.random.default_rng(1),
        on_generation=lambda event: sizes.append(event.cost.size),
    )
    changes = sorted(set(sizes))
    assert changes == [6 * 2**k for k in range(len(changes))] and len(changes) >= 3
    assert sizes == sorted(sizes) and sum(sizes) == result.evaluations
    assert (np.diff(result.history_cost) <= 0.0).all()
    assert _state(result).restarts[0] == len(changes) - 1
    # The last generation that fits was run.
    assert result.evaluations + _state(result).size[0] > 15_000


def test_without_restarts_the_population_stays() -> None:
    result = searched(sphere, 15_000, algorithm=CMAES(restarts=False))
    assert _state(result).ended[0] == 1
    assert result.generations == 15_000 // 10
    assert result.cost < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_an_optimum_in_a_corner_and_one_on_an_edge_are_found(seed: int) -> None:
    slope = 10.0 ** np.linspace(0.0, 3.0, DIM)

    def corner(x: Array) -> tuple[Array, Array]:
        return slope @ (x + 5.0), np.zeros(x.shape[1])

    def edge(x: Array) -> tuple[Array, Array]:
        return slope @ (x - np.where(np.arange(DIM) < 3, 6.0, 0.0)[:, None]) ** 2 - (
            slope[:3].sum()
        ), np.zeros(x.shape[1])

    assert searched(corner, 15_000, seed).cost < 1e-5
    assert searched(edge, 15_000, seed).cost < 1e-5


def test_constraints_work_through_the_order() -> None:
    def constrained(x: Array) -> tuple[Array, Array]:
        return sphere(x)[0], np.maximum(x.sum(axis=0), 0.0)

    for order in (feasibility_first(), static_penalty(100.0)):
        result = minimize(
            constrained,
            BOX,
            algorithm=CMAES(),
            budget=Budget(evaluations=20_000),
            order=order,
            rng=np.random.default_rng(2),
        )
        assert result.violation <= 1e-8
        np.testing.assert_allclose(result.cost, DIM, rtol=1e-3)  # at x = 0


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_ranking_sorts_by_the_order_and_keeps_ties(size: int) -> None:
    rng = np.random.default_rng(size)
    cost = rng.integers(0, 5, size).astype(float)
    violation = np.maximum(rng.integers(-3, 3, size), 0).astype(float)
    cost[rng.random(size) < 0.2] = np.nan
    finite = np.isfinite(cost)
    keys = [
        (not ok, v > 0.0, v if v > 0.0 else c) if ok else (True, True, 0.0)
        for ok, c, v in zip(finite, cost, violation, strict=True)
    ]
    expected = sorted(range(size), key=keys.__getitem__)
    found = ranking(feasibility_first().running(), cost, violation)
    assert found.tolist() == expected


def test_the_first_mean_is_the_best_of_the_initial_population() -> None:
    given = np.full((DIM, 1), 0.9)
    rng = np.random.default_rng(3)
    search = Search(CMAES(sigma=0.01), BOX, rng=rng, initial=Initial(points=given))
    search.tell(*sphere(search.ask()))
    state = search.state
    assert isinstance(state, CMAESState)
    np.testing.assert_allclose(state.mean, 0.59)
    assert np.abs(search.ask() - 0.9).max() < 0.5  # sigma is 0.1 here


def test_continues_bit_for_bit_across_a_restart() -> None:
    def generations(search: Search, number: int) -> Array:
        for _ in range(number):
            search.tell(*sphere(search.ask()))
        return search.best.x

    rng = np.random.default_rng(4)
    whole = Search(CMAES(size=6), BOX, rng=rng)
    generations(whole, 100)
    while cast(CMAESState, whole.state).restarts[0] < 1:
        generations(whole, 1)
    saved = whole.snapshot()
    generations(whole, 400)
    rng = np.random.default_rng(99)
    again = Search(CMAES(size=6), BOX, rng=rng, snapshot=saved)
    generations(again, 400)
    assert cast(CMAESState, whole.state).restarts[0] > 1
    for name, array in whole.snapshot().items():
        np.testing.assert_array_equal(array, again.snapshot()[name])


KERNEL = ctypes.CFUNCTYPE(
    None,
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),
    ctypes.c_int64,
)


class Compiled:
    """The sphere behind an address, here of a callback."""

    def __init__(self) -> None:
        self.calls_from_python = 0
        self._function = KERNEL(self._evaluate)

    def __call__(self, population: Array) -> tuple[Array, Array]:
        self.calls_from_python += 1
        return sphere(population)

    def attach(self, asked: Array, cost: Array, violation: Array) -> Pointers | None:
        double = ctypes.POINTER(ctypes.c_double)
        self._in = (double * 1)(asked.ctypes.data_as(double))
        self._out = (double * 2)(*(a.ctypes.data_as(double) for a in (cost, violation)))
        address = ctypes.cast(self._function, ctypes.c_void_p).value
        return Pointers(
            address or 0, ctypes.addressof(self._in), ctypes.addressof(self._out)
        )

    def _evaluate(self, inputs, outputs, size: int) -> None:  # type: ignore[no-untyped-def]
        cost, violation = sphere(np.ctypeslib.as_array(inputs[0], (DIM, size)))
        np.ctypeslib.as_array(outputs[0], (size,))[:] = cost
        np.ctypeslib.as_array(outputs[1], (size,))[:] = violation


def test_both_loops_give_the_same_bits_while_the_population_grows() -> None:
    compiled = Compiled()
    python, loop = (searched(f, 10_003, seed=5) for f in (sphere, compiled))
    assert compiled.calls_from_python == 0
    assert _state(loop).restarts[0] >= 2
    np.testing.assert_array_equal(python.history_cost, loop.history_cost)
    for name, array in python.snapshot.items():
        np.testing.assert_array_equal(array, loop.snapshot[name])


def test_nothing_finite_is_no_failure() -> None:
    result = searched(lambda x: (np.full(x.shape[1], np.nan),) * 2, 2000)
    assert result.cost == np.inf
    assert result.nonfinite == result.evaluations > 1900


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 3}, "size must be None or an integer of at least 4, got 3"),
        ({"sigma": 0.0}, r"sigma must be a number in \(0, 1\], got 0.0"),
        ({"restarts": 1}, "restarts must be True or False, got 1"),
        ({"increase": 0}, "increase must be an integer of at least 1, got 0"),
        ({"bound_handling": "bounce"}, "bound_handling must be one of"),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        CMAES(**setting)  # type: ignore[arg-type]


def test_fixed_variables_are_no_part_of_the_distribution() -> None:
    lower = np.full(DIM, -2.0)
    lower[[1, 4]] = 3.0
    upper = np.where(lower == 3.0, 3.0, 2.0)
    search = Search(
        CMAES(size=8), Box(lower=lower, upper=upper), rng=np.random.default_rng(6)
    )
    for _ in range(5):
        search.tell(*sphere(search.ask()))
    state = search.state
    assert isinstance(state, CMAESState)
    assert state.mean.shape == (DIM - 2,)
    assert state.covariance.shape == (DIM - 2, DIM - 2)
