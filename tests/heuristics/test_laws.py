"""Laws that every algorithm obeys."""

import dataclasses
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart import heuristics
from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    GenerationEvent,
    InvalidSettingsError,
    Order,
    Search,
    SearchResult,
    StopReason,
    minimize,
    run,
)
from swarmstart.heuristics.laws.box import NAMES

Objective = Callable[[Array], tuple[Array, Array]]
BOX = Box(lower=np.full(4, -3.0), upper=np.full(4, 3.0))
BUDGET = 300


def rippled(points: Array) -> tuple[Array, Array]:
    """Many local minima, the best ones infeasible; NaN in a corner."""
    cost = (points**2 + np.cos(7.0 * points)).sum(axis=0)
    cost[points[0] > 2.0] = np.nan
    return cost, np.maximum(0.5 - points[0], 0.0)


def with_gaps(points: Array) -> tuple[Array, Array]:
    """The same, NaN for one of each population: a search may soon leave the corner."""
    cost, violation = rippled(points)
    cost[0] = np.nan
    return cost, violation


def rounded(points: Array) -> tuple[Array, Array]:
    """The same in eighths: sums with what has few digits are exact."""
    cost, violation = rippled(points)
    return np.round(8.0 * cost) / 8.0, np.round(8.0 * violation) / 8.0


def shifted(constant: float) -> Objective:
    def objective(points: Array) -> tuple[Array, Array]:
        cost, violation = rounded(points)
        return cost + constant, violation

    return objective


def generations(search: Search, count: int, objective: Objective) -> list[Array]:
    """Every point asked, generation after generation."""
    asked = []
    for k in range(count):
        asked.append(search.ask(progress=min(k / (count - 1), 1.0)))
        search.tell(*objective(asked[-1]))
    return asked


def assert_same(one: Mapping[str, object], other: Mapping[str, object]) -> None:
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def with_rule(algorithm: Algorithm, rule: str) -> Algorithm | None:
    """The algorithm with another rule; None if it has none."""
    if not hasattr(algorithm, "bound_handling"):
        return None
    changed: Algorithm = dataclasses.replace(  # type: ignore[type-var]
        algorithm, bound_handling=rule
    )
    return changed


def test_the_old_name_of_the_rule_at_the_bounds_is_refused_with_the_new(
    algorithm: Algorithm,
) -> None:
    if with_rule(algorithm, "clip") is not None:
        said = "bounds must be given as bound_handling, its new name, got 'clip'"
        with pytest.raises(InvalidSettingsError, match=said):
            type(algorithm)(bounds="clip")  # type: ignore[call-arg]


def test_every_algorithm_of_the_library_is_tested_here(
    algorithms: tuple[Algorithm, ...],
) -> None:
    kinds = {
        kind
        for kind in map(heuristics.__getattr__, heuristics.__all__)
        if dataclasses.is_dataclass(kind) and hasattr(kind, "kernel_settings")
    }
    assert kinds and kinds <= {type(algorithm) for algorithm in algorithms}


@settings(max_examples=12, deadline=None)
@given(
    rule=st.sampled_from([name for name in NAMES if name != "none"]),
    dim=st.integers(1, 6),
    scale=st.sampled_from([1e-6, 0.3, 1.0, 1e5]),
    seed=st.integers(0, 2**32),
)
def test_every_point_lies_in_the_box_and_the_best_is_the_best_of_all(
    algorithm: Algorithm, order: Order, rule: str, dim: int, scale: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    lower = rng.normal(size=dim) * scale
    box = Box(lower=lower, upper=lower + rng.uniform(0.1, 4.0, dim) * scale)
    chosen = with_rule(algorithm, rule) or algorithm
    search = Search(chosen, box, order=order, rng=rng)

    def merit(cost: float, violation: float) -> tuple[float, float]:
        """Smaller is better, in the end; a key that sorts."""
        if not np.isfinite(cost):
            return np.inf, np.inf
        if order.rule == heuristics.static_penalty(0.0).rule:
            return 0.0, cost + order.weight * violation
        feasible = violation <= order.tolerance
        return (0.0, cost) if feasible else (violation, 0.0)

    least = (np.inf, np.inf)
    for k in range(12):
        points = search.ask(progress=k / 11)
        assert box.contains(points).all()
        cost, violation = rippled(points)
        search.tell(cost, violation)
        least = min([least, *map(merit, cost, violation)])
        best = search.best
        assert merit(best.cost, best.violation) == least
        if np.isfinite(best.cost):
            cost, violation = rippled(best.x[:, None])
            assert (cost[0], violation[0]) == (best.cost, best.violation)


@settings(max_examples=12, deadline=None)
@given(
    rule=st.sampled_from(NAMES),
    fixed=st.lists(st.booleans(), min_size=1, max_size=6),
    seed=st.integers(0, 2**32),
)
def test_a_variable_with_equal_bounds_is_fixed(
    algorithm: Algorithm, order: Order, rule: str, fixed: list[bool], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    lower = rng.normal(size=len(fixed))
    width = np.where(fixed, 0.0, rng.uniform(0.1, 4.0, len(fixed)))
    box = Box(lower=lower, upper=lower + width)
    chosen = with_rule(algorithm, rule) or algorithm
    search = Search(chosen, box, order=order, rng=rng, basins=3)
    asked = generations(search, 12, rippled)
    for points in asked:
        assert (points[fixed] == lower[fixed, None]).all()
        assert rule == "none" or box.contains(points).all()
    assert np.ptp(asked[0], axis=1).astype(bool).tolist() == (width > 0.0).tolist()
    assert (search.best.x[fixed] == lower[fixed]).all()
    if all(fixed):
        assert len(search.basins) <= 1


def test_fixed_variables_do_not_slow_a_search(algorithm: Algorithm) -> None:
    """min |x - 0.3|^2 in 2-D: alone, and among ten fixed variables."""

    def median_cost(free: NDArray[np.bool_]) -> float:
        def bowl(points: Array) -> Array:
            return np.asarray(((points[free] - 0.3) ** 2).sum(axis=0))

        width = np.where(free, 3.0, 0.0)
        costs = [
            minimize(
                bowl,
                Box(lower=-width, upper=width),
                algorithm=algorithm,
                budget=600,
                seed=seed,
            ).cost
            for seed in range(25)
        ]
        return float(np.median(costs))

    alone = median_cost(np.ones(2, dtype=np.bool_))
    among = median_cost(np.arange(12) % 6 == 0)
    assert among <= 100.0 * alone


def test_points_may_leave_the_box_where_nothing_holds_them(
    algorithm: Algorithm,
) -> None:
    free = with_rule(algorithm, "none")
    if free is None:
        return
    search = Search(free, BOX, rng=np.random.default_rng(0))

    def downhill(points: Array) -> tuple[Array, Array]:
        return -points.sum(axis=0), np.zeros(points.shape[1])

    asked = np.concatenate(generations(search, 40, downhill), axis=1)
    assert not BOX.contains(asked).all()
    assert not BOX.contains(search.best.x)


def test_same_seed_same_bits_and_other_seed_other_bits(algorithm: Algorithm) -> None:
    runs = [
        np.concatenate(
            generations(
                Search(algorithm, BOX, rng=np.random.default_rng(seed)), 30, rippled
            ),
            axis=1,
        )
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    inside = np.abs(runs[0]) < 3.0  # several points may share a bound
    assert not np.isin(runs[0][inside], runs[2]).any()


@pytest.mark.parametrize(
    ("stagnation", "reason"), [(2, StopReason.STAGNATION), (None, StopReason.TARGET)]
)
def test_a_constant_added_to_the_cost_changes_neither_the_points_nor_the_end(
    algorithm: Algorithm, order: Order, stagnation: int | None, reason: StopReason
) -> None:
    def searched(constant: float, target: float | None) -> tuple[SearchResult, Array]:
        asked = []

        def objective(points: Array) -> tuple[Array, Array]:
            asked.append(points)
            return shifted(constant)(points)

        result = minimize(
            objective,
            BOX,
            algorithm=algorithm,
            budget=Budget(evaluations=2000, stagnation=stagnation, target=target),
            order=order,
            rng=np.random.default_rng(3),
        )
        return result, np.concatenate(asked, axis=1)

    whole, _ = searched(0.0, None)
    # A cost that a feasible point had on the way.
    feasible = whole.history_cost[whole.history_violation <= order.tolerance]
    reached = float(feasible[feasible.size // 2]) if feasible.size else np.nan
    target = None if stagnation else reached
    if target is not None and np.isnan(target):
        return  # With a penalty the best may be infeasible all the time.
    plain, asked = searched(0.0, target)
    other, asked_too = searched(1e3, None if target is None else target + 1e3)
    assert plain.stopped is other.stopped is reason
    np.testing.assert_array_equal(asked, asked_too)
    np.testing.assert_array_equal(plain.history_cost + 1e3, other.history_cost)
    np.testing.assert_array_equal(plain.x, other.x)


def without_units(algorithm: Algorithm) -> Algorithm:
    """The algorithm; the chapter's swarm with its two lengths taken from the box."""
    if not isinstance(algorithm, heuristics.ChaoticPSO):
        return algorithm
    return dataclasses.replace(algorithm, velocity_max=None, search_length=None)


powers = st.integers(-27, 27).map(lambda k: 2.0**k)


@settings(max_examples=12, deadline=None)
@given(
    cost_unit=powers,
    units=st.lists(powers, min_size=4, max_size=4),
    seed=st.integers(0, 2**32),
    adaptive=st.booleans(),
)
def test_units_of_cost_and_variables_change_nothing(
    algorithm: Algorithm,
    cost_unit: float,
    units: list[float],
    seed: int,
    adaptive: bool,
) -> None:
    """Powers of two: scaled numbers have the same bits."""
    order = heuristics.epsilon_level() if adaptive else heuristics.default_order()

    def searched(cost_unit: float, unit: Array) -> tuple[Array, Search]:
        box = Box(lower=BOX.lower * unit, upper=BOX.upper * unit)
        search = Search(
            without_units(algorithm),
            box,
            order=order,
            rng=np.random.default_rng(seed),
            basins=4,
        )

        def objective(points: Array) -> tuple[Array, Array]:
            cost, violation = rippled(points / unit[:, None])
            return cost_unit * cost, violation

        asked = np.concatenate(generations(search, 60, objective), axis=1)
        return asked / unit[:, None], search

    plain, search = searched(1.0, np.ones(4))
    scaled, scaled_search = searched(cost_unit, np.array(units))
    np.testing.assert_array_equal(scaled, plain)
    assert scaled_search.best.cost == cost_unit * search.best.cost
    for one, other in zip(scaled_search.basins, search.basins, strict=True):
        np.testing.assert_array_equal(one.x / units, other.x)


@settings(max_examples=10, deadline=None)
@given(cost_unit=powers, unit=powers, evaluations=st.sampled_from([300, 3000]))
def test_the_defaults_do_not_depend_on_units(
    cost_unit: float, unit: float, evaluations: int
) -> None:
    def found(cost_unit: float, unit: float) -> SearchResult:
        def objective(points: Array) -> tuple[Array, Array]:
            cost, violation = rippled(points / unit)
            return cost_unit * cost, violation

        box = Box(lower=unit * BOX.lower, upper=unit * BOX.upper)
        return minimize(objective, box, budget=evaluations, seed=9)

    plain, scaled = found(1.0, 1.0), found(cost_unit, unit)
    np.testing.assert_array_equal(scaled.x / unit, plain.x)
    np.testing.assert_array_equal(scaled.history_cost, cost_unit * plain.history_cost)


def test_one_batch_of_64_is_four_of_16(algorithm: Algorithm) -> None:
    if hasattr(algorithm, "size"):
        algorithm = dataclasses.replace(algorithm, size=64)  # type: ignore[type-var]

    def bowl(points: Array) -> tuple[Array, Array]:
        return ((points - 0.3) ** 2).sum(axis=0), np.maximum(points[0], 0.0)

    def in_batches(points: Array) -> tuple[Array, Array]:
        starts = range(0, points.shape[1], 16)
        parts = [bowl(points[:, k : k + 16].copy()) for k in starts]
        cost, violation = zip(*parts, strict=True)
        return np.concatenate(cost), np.concatenate(violation)

    whole, parts = (
        minimize(
            objective,
            BOX,
            algorithm=algorithm,
            budget=Budget(evaluations=64 * 8),
            rng=np.random.default_rng(4),
        )
        for objective in (bowl, in_batches)
    )
    np.testing.assert_array_equal(whole.history_cost, parts.history_cost)
    assert_same(whole.snapshot, parts.snapshot)


@pytest.mark.parametrize("before", [1, 2, 11])
def test_search_continues_bit_for_bit_from_a_file(
    algorithm: Algorithm, order: Order, before: int, tmp_path: Path
) -> None:
    budget = Budget(evaluations=BUDGET)

    def new_search(seed: int, **snapshot: object) -> Search:
        rng = np.random.default_rng(seed)
        return Search(
            algorithm,
            BOX,
            order=order,
            rng=rng,
            evaluations=BUDGET,
            basins=3,
            radius=0.2,
            **snapshot,  # type: ignore[arg-type]
        )

    def stop(event: GenerationEvent) -> None:
        if event.generation == before - 1:
            raise StopIteration

    whole = run(new_search(5), with_gaps, budget=budget)
    part = run(new_search(5), with_gaps, budget=budget, on_generation=stop)
    np.savez(tmp_path / "search.npz", **part.snapshot)  # type: ignore[arg-type]
    with np.load(tmp_path / "search.npz", allow_pickle=False) as saved:
        search = new_search(99, snapshot=saved)
    assert search.evaluations == part.evaluations < whole.evaluations
    assert_same(search.snapshot(), part.snapshot)
    rest = run(search, with_gaps, budget=budget)
    for name in ("history_cost", "history_violation"):
        joined = np.append(getattr(part, name), getattr(rest, name))
        np.testing.assert_array_equal(joined, getattr(whole, name))
    np.testing.assert_array_equal(rest.x, whole.x)
    assert (rest.evaluations, rest.generations) == (
        whole.evaluations,
        whole.generations,
    )
    assert rest.nonfinite == whole.nonfinite > 0
    assert len(rest.basins) == len(whole.basins) > 0
    assert_same(rest.snapshot, whole.snapshot)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.sampled_from([0.1, 0.5, 0.95]))
def test_what_is_not_finite_is_counted_and_never_best(
    algorithm: Algorithm, order: Order, seed: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    search = Search(algorithm, BOX, order=order, rng=np.random.default_rng(6), basins=4)
    counted, seen = 0, []
    for k in range(8):
        size = search.ask(progress=k / 7).shape[1]
        cost = np.asarray(rng.normal(size=size))
        violation = np.zeros(size)
        bad = np.asarray(rng.random(size) < share)
        cost[bad] = rng.choice([np.nan, np.inf, -np.inf, 1.0], bad.sum())
        violation[bad & (cost == 1.0)] = rng.choice([np.nan, np.inf])
        search.tell(cost, violation)
        counted += int(bad.sum())
        seen += cost[~bad].tolist()
    assert search.nonfinite == counted
    assert search.best.cost == min(seen, default=np.inf)
    assert all(np.isfinite(member.cost) for member in search.basins)


def test_nothing_finite_is_no_failure(algorithm: Algorithm, order: Order) -> None:
    box = Box(lower=np.zeros(2), upper=np.ones(2))
    search = Search(algorithm, box, order=order, rng=np.random.default_rng(5))

    def nowhere(points: Array) -> tuple[Array, Array]:
        assert box.contains(points).all()
        return np.full(points.shape[1], np.nan), np.zeros(points.shape[1])

    generations(search, 5, nowhere)
    assert search.best.cost == np.inf
    assert search.nonfinite == search.evaluations
    points = search.ask()
    size = points.shape[1]
    last = np.arange(size) == size - 1
    search.tell(np.where(last, 1e300, np.inf), np.zeros(size))
    assert search.best.cost == 1e300
    np.testing.assert_array_equal(search.best.x, points[:, -1])


def test_sizes_are_those_of_the_generations(algorithm: Algorithm) -> None:
    search = Search(algorithm, BOX, rng=np.random.default_rng(7), evaluations=BUDGET)
    assert search.size == algorithm.first_size(BOX, BUDGET)
    told = 0
    for k in range(10):
        size = search.size
        points = search.ask(progress=k / 9)
        assert points.shape == (4, size)
        search.tell(*rippled(points))
        told += size
        assert (search.generations, search.evaluations) == (k + 1, told)


PRINT_RUNS = """
import sys
import numpy as np
from swarmstart import heuristics as h
names = {name: getattr(h, name) for name in h.__all__}
names |= {a.__name__: a for a in h.ALGORITHMS.values()}
box = h.Box(lower=np.full(3, -3.0), upper=np.full(3, 3.0))
for text in sys.argv[1:]:
    algorithm = eval(text, names)
    initial = np.full((3, 9), 0.1) if isinstance(algorithm, h.ChaoticPSO) else None
    for order in (h.feasibility_first(), h.static_penalty(3.0), h.epsilon_level()):
        rng = np.random.default_rng(7)
        search = h.Search(
            algorithm, box, order=order, rng=rng, initial=initial, basins=3
        )
        for k in range(8):
            points = search.ask(progress=k / 7)
            print(points.tobytes().hex())
            search.tell((points**2).sum(axis=0), np.maximum(0.5 - points[0], 0.0))
        for name, array in search.snapshot().items():
            print(name, array.tobytes().hex())
"""


def test_plain_python_gives_the_same_bits_as_compiled_code(
    algorithms: tuple[Algorithm, ...],
) -> None:
    known = heuristics.ALGORITHMS.values()
    names = [repr(a) for a in algorithms if type(a) in known]
    names += [
        repr(changed)
        for a in algorithms
        for rule in NAMES
        if (changed := with_rule(a, rule)) is not None
    ]
    outputs = [
        subprocess.run(
            [sys.executable, "-c", PRINT_RUNS, *names],
            env=os.environ
            | {"NUMBA_DISABLE_JIT": disable, "PYTHONPATH": os.pathsep.join(sys.path)},
            check=False,
            capture_output=True,
            text=True,
        )
        for disable in ("0", "1")
    ]
    assert [o.returncode for o in outputs] == [0, 0], outputs[0].stderr
    compiled, plain = (o.stdout for o in outputs)
    assert compiled == plain
    assert len(plain.splitlines()) > len(names) * 3 * 8
