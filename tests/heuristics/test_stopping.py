"""When a search has come to its end."""

import pytest

from swarmstart.heuristics.stopping import progress_of


@pytest.mark.parametrize(("size", "budget"), [(10, 100), (7, 100), (3, 1000)])
def test_progress_is_the_number_of_the_generation_over_that_of_the_last(
    size: int, budget: int
) -> None:
    last = budget // size - 1
    found = [progress_of(k * size, size, budget) for k in range(last + 1)]
    assert found == [k / last for k in range(last + 1)]


def test_progress_is_0_in_an_only_generation() -> None:
    assert progress_of(0, 60, 100) == 0.0


@pytest.mark.parametrize("evaluations", [81, 85, 90])
def test_progress_is_1_in_the_last_generation_after_others_of_another_size(
    evaluations: int,
) -> None:
    assert progress_of(evaluations, 10, 100) == 1.0
    assert progress_of(evaluations - 11, 10, 100) < 1.0
