"""Ask and tell."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    CMAES,
    AskTellError,
    Box,
    ChaoticPSO,
    DifferentialEvolution,
    GeneticAlgorithm,
    InvalidEvaluationError,
    InvalidPointsError,
    InvalidSettingsError,
    InvalidSnapshotError,
    Kernels,
    RandomSearch,
    Search,
    epsilon_level,
    feasibility_first,
    static_penalty,
)
from swarmstart.heuristics.laws.algorithm import CommonFields, common_fields
from swarmstart.heuristics.laws.order import RunningOrder

BOX = Box(lower=np.full(2, -1.0), upper=np.full(2, 1.0))


def new_search(initial: ArrayLike | None = None) -> Search:
    rng = np.random.default_rng(0)
    return Search(RandomSearch(size=4), BOX, rng=rng, initial=initial)


def test_initial_points_come_first_and_the_others_are_uniform() -> None:
    initial = np.array([[1.0, -0.5], [-1.0, 0.25]])
    points = new_search(initial).ask()
    np.testing.assert_array_equal(points[:, :2], initial)
    np.testing.assert_array_equal(points[:, 2:], new_search().ask()[:, 2:])


def test_asked_points_belong_to_the_caller_and_cannot_be_changed() -> None:
    search = new_search()
    first = search.ask()
    kept = first.copy()
    with pytest.raises(ValueError, match="read-only"):
        first[0, 0] = 0.0
    search.tell(np.zeros(4), np.zeros(4))
    search.ask()
    np.testing.assert_array_equal(first, kept)


def test_state_and_best_are_copies() -> None:
    search = new_search()
    search.ask()
    search.tell([3.0, 1.0, 2.0, 4.0], np.zeros(4))
    search.state.best_cost[0] = -1.0
    search.best.x[0] = 99.0
    assert search.best.cost == 1.0
    assert search.best.x[0] <= 1.0


def test_ask_and_tell_must_alternate() -> None:
    search = new_search()
    with pytest.raises(AskTellError, match=r"tell\(\) before ask\(\)"):
        search.tell(np.zeros(4), np.zeros(4))
    search.ask()
    with pytest.raises(AskTellError, match=r"ask\(\) before tell\(\)"):
        search.ask()


@pytest.mark.parametrize(
    ("cost", "violation", "message"),
    [
        (np.zeros(3), np.zeros(4), r"cost must have shape \(4,\), got \(3,\)"),
        (np.zeros(4), 0.0, r"violation must have shape \(4,\), got \(\)"),
        (np.zeros(4), [0, 0, -1, 0], "violation must be at least 0, got -1"),
        (["a"] * 4, np.zeros(4), "cost must be an array of 4 numbers"),
    ],
)
def test_refuses_what_is_no_evaluation_and_can_be_told_again(
    cost: ArrayLike, violation: ArrayLike, message: str
) -> None:
    search = new_search()
    search.ask()
    with pytest.raises(InvalidEvaluationError, match=message):
        search.tell(cost, violation)
    search.tell(np.zeros(4), np.zeros(4))
    assert search.evaluations == 4


@pytest.mark.parametrize(
    ("initial", "message"),
    [
        (np.zeros((2, 5)), "initial has 5 points, the population only 4"),
        (np.zeros((3, 1)), r"initial must have shape \(2, k\), got \(3, 1\)"),
        (np.zeros(2), r"initial must have shape \(2, k\), got \(2,\)"),
        ([[0.0, 2.0], [0.0, 0.0]], r"columns \[1\] do not"),
        ([[np.nan], [0.0]], r"columns \[0\] do not"),
    ],
)
def test_refuses_initial_points_that_do_not_fit(
    initial: ArrayLike, message: str
) -> None:
    with pytest.raises(InvalidPointsError, match=message):
        new_search(initial)


@dataclass(frozen=True)
class Plain:
    """An algorithm of a user who has read half of what an algorithm needs."""

    names_order: bool = True

    @property
    def kernels(self) -> Kernels:
        return Kernels(propose=lambda *_: None, accept=lambda *_: None)

    def first_size(self, box: Box, evaluations: int | None) -> int:
        del box, evaluations
        return 4

    def kernel_settings(self, box: Box, order: RunningOrder) -> tuple[object, ...]:
        del box
        return SimpleNamespace(order=order) if self.names_order else (order,)  # type: ignore[return-value]

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> CommonFields:
        del box, rng
        return common_fields(population)


def test_refuses_an_algorithm_without_order_or_compiled_kernels() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidSettingsError, match="the field 'order'"):
        Search(Plain(names_order=False), BOX, rng=rng)
    with pytest.raises(InvalidSettingsError, match=r"numba\.njit"):
        Search(Plain(), BOX, rng=rng).preparations(compiled=True)


def test_refuses_arguments_out_of_range() -> None:
    search = new_search()
    with pytest.raises(InvalidSettingsError, match=r"progress .* in \[0, 1\]"):
        search.ask(progress=1.5)
    with pytest.raises(InvalidSettingsError, match="rng must be a numpy"):
        Search(RandomSearch(), BOX, rng=7)  # type: ignore[arg-type]
    with pytest.raises(InvalidSettingsError, match="initial must be None if snap"):
        Search(
            RandomSearch(size=4),
            BOX,
            rng=np.random.default_rng(0),
            initial=np.zeros((2, 1)),
            snapshot=new_search().snapshot(),
        )
    with pytest.raises(InvalidSettingsError, match="size must be at most 10000000 wi"):
        Search(RandomSearch(size=10**7 + 1), BOX, rng=np.random.default_rng(0))
    for basins, radius, what in (
        (-1, 0.1, "basins must be an integer of at least 0, got -1"),
        (10**7, 0.1, "basins must be at most 2500000 with 2 variables, got 10000000"),
        (1, 0.0, "radius must be a number above 0, got 0.0"),
        (1, np.nan, "radius must be a number above 0, got nan"),
    ):
        with pytest.raises(InvalidSettingsError, match=what):
            Search(
                RandomSearch(),
                BOX,
                rng=np.random.default_rng(0),
                basins=basins,
                radius=radius,
            )


def test_snapshot_is_a_copy() -> None:
    search = new_search()
    kept = search.snapshot()
    search.tell(search.ask().sum(axis=0), np.zeros(4))
    assert kept["state.generation"][0] == 0
    kept = search.snapshot()
    kept["state.best_cost"].fill(-1.0)
    continued = Search(
        RandomSearch(size=4),
        BOX,
        rng=np.random.default_rng(1),
        snapshot=search.snapshot(),
    )
    continued.tell(continued.ask().sum(axis=0) - 9.0, np.zeros(4))
    assert search.best.cost > -9.0 > continued.best.cost - 3.0
    assert search.generations == 1


def test_no_snapshot_while_a_generation_is_under_way() -> None:
    search = new_search()
    search.ask()
    with pytest.raises(AskTellError, match=r"snapshot\(\) before tell\(\)"):
        search.snapshot()


@pytest.mark.parametrize(
    "kind",
    [
        np.random.PCG64,
        np.random.PCG64DXSM,
        np.random.MT19937,
        np.random.Philox,
        np.random.SFC64,
    ],
)
def test_every_source_of_randomness_continues(
    kind: type[np.random.BitGenerator],
) -> None:
    search = Search(RandomSearch(size=4), BOX, rng=np.random.Generator(kind(1)))
    search.tell(search.ask().sum(axis=0), np.zeros(4))
    other = Search(
        RandomSearch(size=4),
        BOX,
        rng=np.random.Generator(kind(2)),
        snapshot=search.snapshot(),
    )
    np.testing.assert_array_equal(search.ask(), other.ask())


def kept(**other: Any) -> Search:
    """A search of these arguments, new or from a snapshot of the defaults."""
    arguments: dict[str, Any] = {
        "algorithm": DifferentialEvolution(size=8),
        "box": BOX,
        "order": feasibility_first(),
        "basins": 2,
        "rng": np.random.default_rng(3),
    }
    return Search(**(arguments | other))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"algorithm": GeneticAlgorithm(size=8)}, "algorithm is GeneticAlg.* Differ"),
        ({"algorithm": DifferentialEvolution(size=9)}, "algorithm is .*size=9.*size=8"),
        ({"algorithm": DifferentialEvolution(size=8, F=0.7)}, "algorithm is .*F=0.7"),
        ({"algorithm": ChaoticPSO(size=8)}, "algorithm is ChaoticPSO"),
        ({"box": Box(lower=[-1.0, -1.0], upper=[1.0, 2.0])}, r"box is .*2\.0"),  # type: ignore[arg-type]
        ({"box": Box(lower=-np.ones(3), upper=np.ones(3))}, "box is "),
        ({"order": static_penalty(3.0)}, r"order is .*weight=3\.0"),
        ({"order": epsilon_level()}, "order is .*rule=2.* rule=1|order is .*rule=2"),
        ({"order": feasibility_first(0.5)}, r"order is .*tolerance=0\.5"),
        ({"basins": 3}, "basins is 3, that of the snapshot 2"),
        ({"radius": 0.2}, r"radius is 0\.2, that of the snapshot 0\.1"),
        (
            {"rng": np.random.Generator(np.random.MT19937(0))},
            "must be of a search with the same arguments: .*MT19937|PCG64",
        ),
    ],
)
def test_refuses_the_snapshot_of_another_search(
    other: dict[str, Any], message: str
) -> None:
    search = kept()
    search.tell(search.ask().sum(axis=0), np.zeros(8))
    snapshot = search.snapshot()
    assert kept(snapshot=snapshot).generations == 1
    with pytest.raises(InvalidSnapshotError, match="with the same arguments") as caught:
        kept(snapshot=snapshot, **other)
    assert caught.match(message)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("state.cost", None, "state.cost"),
        ("rng", None, "rng"),
        ("basins.cost", None, "basins.cost"),
        ("state.cost", np.zeros((2, 2)), r"state.cost is float64, \(2, 2\)"),
        ("state.generation", np.zeros(1), "state.generation is float64"),
        ("rng", np.array("{"), "same arguments"),
        ("order.level", np.zeros(3), "same arguments"),
    ],
)
def test_refuses_what_is_no_snapshot(
    name: str, array: np.ndarray | None, message: str
) -> None:
    snapshot = kept().snapshot()
    if array is None:
        del snapshot[name]
    else:
        snapshot[name] = array
    with pytest.raises(InvalidSnapshotError, match=message):
        kept(snapshot=snapshot)


def test_an_abandoned_generation_is_asked_anew() -> None:
    search = new_search()
    search.abandon()  # nothing was asked: nothing happens
    first = search.ask()
    search.abandon()
    with pytest.raises(AskTellError, match="tell"):
        search.tell(np.zeros(first.shape[1]), np.zeros(first.shape[1]))
    np.testing.assert_array_equal(search.ask(), first)  # the initial population
    assert search.evaluations == 0


def begun(algorithm: Any) -> Search:
    search = Search(algorithm, BOX, rng=np.random.default_rng(0))
    points = search.ask()
    search.tell((points**2).sum(axis=0) + 1.0, np.zeros(points.shape[1]))
    return search


def test_suggested_points_are_evaluated_and_stay_if_they_are_better() -> None:
    for algorithm in (DifferentialEvolution(size=6), ChaoticPSO(size=6),
                      GeneticAlgorithm(size=6), RandomSearch(size=6)):  # fmt: skip
        search = begun(algorithm)
        suggested = np.array([[0.0, 0.5], [0.0, 0.5]])
        points = search.ask(suggested=suggested)
        np.testing.assert_array_equal(points[:, 4:], suggested)
        search.tell((points**2).sum(axis=0), np.zeros(6))
        assert search.best.cost == 0.0
        np.testing.assert_array_equal(search.best.x, [0.0, 0.0])


def test_of_more_suggestions_than_places_the_first_count() -> None:
    suggested = np.tile(np.linspace(-1, 1, 9), (2, 1))
    points = begun(RandomSearch(size=4)).ask(suggested=suggested)
    np.testing.assert_array_equal(points, suggested[:, :4])


def test_what_cannot_be_suggested_is_refused() -> None:
    with pytest.raises(InvalidSettingsError, match="in the initial population"):
        new_search().ask(suggested=np.zeros((2, 1)))
    with pytest.raises(InvalidSettingsError, match="for an algorithm that samples"):
        begun(CMAES(size=6)).ask(suggested=np.zeros((2, 1)))
    with pytest.raises(InvalidPointsError, match=r"must have shape \(2, k\), got"):
        begun(RandomSearch(size=4)).ask(suggested=np.zeros((3, 1)))
    for value in (2.0, np.nan):
        with pytest.raises(InvalidPointsError, match="must lie in the box"):
            begun(RandomSearch(size=4)).ask(suggested=np.full((2, 1), value))
