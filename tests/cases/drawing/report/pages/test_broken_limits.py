"""A collision is said first, with the seeds in which it happened."""

from __future__ import annotations

from typing import Any

import pytest

from swarmstart.cases.drawing.report.pages.broken_limits import (
    broken_seeds,
    broken_words,
)


@pytest.mark.parametrize(("measures", "scenario", "said"), [
    ({"obstacle_clearance_m": -15.0}, {}, "UAVs enter an obstacle by 15 m"),
    ({"obstacle_clearance_m": 0.1, "min_distance_m": 4.5},
     {"avoidance": {"safe_distance_m": 5}}, "UAVs come within 4.5 m of each other, "
     "but must keep 5 m"),
    ({"min_distance_m": 4.5}, {"distances": {"safe_m": 5}}, "UAVs come within"),
    ({"min_distance_m": 4.5}, {"safe_distance_m": 5}, "UAVs come within"),
    ({"constraint_excess": 0.6}, {}, "breaks constraints by up to 0.6"),
])  # fmt: skip
def test_a_broken_limit_is_a_sentence(
    measures: dict[str, Any], scenario: dict[str, Any], said: str
) -> None:
    (found,) = broken_words(measures, scenario)
    assert said in found


@pytest.mark.parametrize("measures", [
    {"obstacle_clearance_m": 0.1, "min_distance_m": 5.0}, {"min_distance_m": None},
    {"obstacle_clearance_m": -1e-9}, {"constraint_excess": 1e-6}, {},
])  # fmt: skip
def test_kept_limits_are_no_sentence(measures: dict[str, Any]) -> None:
    assert broken_words(measures, {"avoidance": {"safe_distance_m": 5}}) == []


def test_seeds_are_told_apart_by_what_went_wrong() -> None:
    content = {
        "seeds": [0, 1, 2, 3, 4, 5],
        "failures": ["", "out of memory", "", "", "", ""],
        "feasible": [True, False, False, False, False, False],
        "measures": {
            "obstacle_clearance_m": [0.1, None, -15.0, 0.1, 0.2, -1.0],
            "infeasible_steps": [0, None, 1, 2, 0, 0],
        },
    }
    assert broken_seeds(content) == [
        "1 of 6 failed (seed 1)",
        "2 of 6 entered an obstacle, by up to 15 m (seeds 2 and 5)",
        "1 of 6 had steps without a feasible plan (seed 3)",
        "1 of 6 broke a constraint or had no feasible plan (seed 4)",
    ]


def test_empty_failures_are_no_failures() -> None:
    content = {"seeds": [0, 1], "failures": ["", ""], "feasible": [True, True]}
    assert broken_seeds({**content, "measures": {"cost": [1.0, 2.0]}}) == []
