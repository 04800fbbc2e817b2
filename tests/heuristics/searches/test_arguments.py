"""Short forms of settings, a box and a generator."""

from typing import Any

import numpy as np
import pytest

from swarmstart import heuristics
from swarmstart.heuristics import (
    ALGORITHMS,
    LSHADE,
    Algorithm,
    Box,
    InvalidBoxError,
    InvalidSettingsError,
    algorithm_of,
    box_of,
    default_algorithm,
    generator_of,
)


def test_names_and_classes_stand_for_the_defaults() -> None:
    for name, kind in ALGORITHMS.items():
        assert algorithm_of(name) == algorithm_of(kind) == kind()
    settings = LSHADE(size=30)
    assert algorithm_of(settings) is settings


def test_every_algorithm_of_the_library_has_a_name(
    algorithms: tuple[Algorithm, ...],
) -> None:
    library = {type(a) for a in algorithms if type(a).__name__ in heuristics.__all__}
    assert library <= set(ALGORITHMS.values())
    assert set(ALGORITHMS) == set(heuristics.SEARCHES)


@pytest.mark.parametrize("evaluations", [100, 20_000, None])
def test_no_algorithm_is_the_default_of_the_budget(evaluations: int | None) -> None:
    expected = default_algorithm(evaluations)
    assert algorithm_of(None, evaluations) == expected
    assert algorithm_of("default", evaluations) == expected


@pytest.mark.parametrize("given", ["LSHADE", "", 3, Box, [], np.zeros(2)])
def test_refuses_what_is_no_algorithm(given: Any) -> None:
    with pytest.raises(InvalidSettingsError, match="algorithm must be settings as"):
        algorithm_of(given)


@pytest.mark.parametrize(
    "pairs", [[(-1, 1), (0, 5)], np.array([[-1.0, 1.0], [0.0, 5.0]])]
)
def test_pairs_are_the_bounds_of_one_variable_each(pairs: Any) -> None:
    for box in (box_of(pairs), box_of(None, pairs)):
        assert (box.lower.tolist(), box.upper.tolist()) == ([-1.0, 0.0], [1.0, 5.0])
    assert box_of(box) is box_of(None, box) is box


@pytest.mark.parametrize("given", [[], [1.0, 2.0], [(1, 2, 3)], ["ab"], [(0, 1), 2]])
def test_refuses_what_is_no_list_of_pairs(given: Any) -> None:
    with pytest.raises(InvalidBoxError, match="bounds must be pairs"):
        box_of(given)


def test_refuses_no_box_and_two() -> None:
    with pytest.raises(InvalidSettingsError, match="bounds must be a Box, or pairs"):
        box_of(None)
    with pytest.raises(InvalidSettingsError, match="bounds must be None if box is"):
        box_of([(0, 1)], [(0, 1)])


def test_a_seed_is_a_new_generator_and_a_generator_is_kept() -> None:
    rng = np.random.default_rng(5)
    assert generator_of(rng, None) is rng
    for seed in (5, np.int64(5)):
        state = generator_of(None, seed).bit_generator.state  # type: ignore[arg-type]
        assert state == np.random.default_rng(5).bit_generator.state


@pytest.mark.parametrize(
    ("rng", "seed", "message"),
    [
        (None, None, "seed must be an integer of at least 0, or rng a .*, got None"),
        (np.random.default_rng(0), 0, "seed must be None if rng is given, got 0"),
        (7, None, r"rng must be a numpy.random.Generator \(an integer is for seed\)"),
        (None, -1, "seed must be an integer of at least 0"),
        (None, 1.5, "seed must be an integer of at least 0"),
        (None, True, "seed must be an integer of at least 0"),
    ],
)
def test_refuses_no_source_of_randomness_and_two(
    rng: Any, seed: Any, message: str
) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        generator_of(rng, seed)
