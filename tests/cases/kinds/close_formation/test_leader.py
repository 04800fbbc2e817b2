from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from swarmstart.cases.kinds.close_formation.pose import (
    first_manoeuvre_s,
    last_change_s,
    leader_of,
)
from swarmstart.cases.kinds.close_formation.scenario import Leader

ROWS = [(0, 200, 0.0), (5, 250, 0.4), (9, 240, 2 * math.pi)]


def table(between: str, rows: Sequence[tuple[float, ...]] = ROWS) -> Leader:
    keys = ("time_s", "speed_ft_s", "heading_rad")
    written: list[dict[str, Any]] = [dict(zip(keys, r, strict=True)) for r in rows]
    return Leader.model_validate({"between": between, "manoeuvre": written})


def test_a_held_row_is_valid_until_the_next() -> None:
    leader = leader_of(table("hold"))
    found = leader(np.array([0.0, 4.99, 5.0, 8.99, 9.0, 1e3]))
    assert found.shape == (3, 6)
    assert found[0] == pytest.approx([200, 200, 250, 250, 240, 240])
    assert found[1] == pytest.approx([0, 0, 0.4, 0.4, 2 * math.pi, 2 * math.pi])


def test_a_sampling_instant_that_rounds_below_a_row_has_the_row() -> None:
    below = math.nextafter(5.0, 0.0)
    assert leader_of(table("hold"))(np.array([below]))[0, 0] == 250


def test_linear_rows_are_joined_and_headings_not_wrapped() -> None:
    found = leader_of(table("linear"))(np.array([2.5, 7.0, 20.0]))
    assert found[0] == pytest.approx([225, 245, 240])
    assert found[1] == pytest.approx([0.2, 0.2 + math.pi, 2 * math.pi])


def test_the_manoeuvre_begins_and_ends_where_something_changes() -> None:
    rows = [(0, 200, 0.0), (3, 200, 0.0), (5, 250, 0.0), (8, 250, 0.0)]
    held, joined = table("hold", rows), table("linear", rows)
    assert (first_manoeuvre_s(held), last_change_s(held)) == (5.0, 5.0)
    assert (first_manoeuvre_s(joined), last_change_s(joined)) == (3.0, 5.0)


def test_a_leader_that_does_nothing_has_nothing_to_settle_from() -> None:
    still = table("hold", ROWS[:1])
    assert first_manoeuvre_s(still) == last_change_s(still) == 0.0
