"""Settings of searches by local solves: validation, and their population."""

import pytest

from swarmstart.heuristics import LSHADE, InvalidSettingsError
from swarmstart.ocp import Memetic, Multistart, population_of


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (Multistart, "size", 0),
        (Multistart, "size", True),
        (Multistart, "unseen", -0.1),
        (Multistart, "unseen", float("nan")),
        (Memetic, "members", 0),
        (Memetic, "share", 1.0),
        (Memetic, "share", float("nan")),
        (Memetic, "size", 2),
    ],
)
def test_values_out_of_range_are_refused(
    kind: type[Multistart | Memetic], name: str, value: object
) -> None:
    with pytest.raises(InvalidSettingsError, match=f"{name} must be"):
        kind(**{name: value})  # type: ignore[arg-type]


def test_population_is_as_large_as_its_own_part_of_the_budget_asks() -> None:
    """One individual for 80 evaluations, at least 40: as of `LSHADE`."""
    assert population_of(Multistart()) is None
    assert population_of(LSHADE(size=7)) == LSHADE(size=7)
    assert population_of(Memetic(), 20_000) == LSHADE(size=10_000 // 80)
    assert population_of(Memetic(share=0.75), 20_000) == LSHADE(size=5_000 // 80)
    assert population_of(Memetic(size=50), 20_000) == LSHADE(size=50)
    assert population_of(Memetic(), None) == LSHADE()
