"""The measurement on draws that are held back: what counts, and what it is called."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import yaml

from swarmstart.benchmarks.hard.comparison import DEFAULT, MANY
from swarmstart.benchmarks.hard.held_back import (
    FIRST_SEED,
    LONGEST_S,
    Held,
    drawn,
    finding,
    page,
)
from swarmstart.cases.hard.families import SHIPPED


def held(default: list[float], many: list[float], seconds: float = 1.0) -> Held:
    return Held(
        family="walls",
        name="walls_2_seed_101",
        costs={
            DEFAULT: np.array(default),
            MANY: np.array(many),
            "roadmap": np.array([math.inf]),
        },
        seconds={
            DEFAULT: np.full(len(default), seconds),
            MANY: np.full(len(many), seconds),
        },
        budget=seconds,
    )


def test_draws_are_of_seeds_that_no_shipped_problem_is_drawn_from(
    tmp_path: Path,
) -> None:
    found = drawn(tmp_path, 2, ["walls", "swing_up"])
    assert len(found) == 2 * 2 + 3 * 2
    assert all(seed < FIRST_SEED for _, _, seed in SHIPPED.values())
    titles = [yaml.safe_load(path.read_text())["title"] for path in found.values()]
    assert all(f"of seed {FIRST_SEED}" in t or "of seed 102" in t for t in titles)


def test_best_cost_is_that_of_any_method_and_a_run_near_it_is_a_hit() -> None:
    one = held([1.0005, 1.1, math.inf], [1.0, math.inf, 1.002])
    assert one.best == 1.0
    assert one.hits(DEFAULT).tolist() == [True, False, False]
    assert one.hits(MANY).tolist() == [True, False, False]
    assert one.finders == [DEFAULT, MANY]


def test_no_run_is_a_hit_if_no_answer_is_confirmed() -> None:
    one = held([math.inf] * 2, [math.inf] * 2)
    assert not one.hits(DEFAULT).any()
    assert one.finders == []
    assert "| none |" in "\n".join(page([one, held([1.0], [1.0])], "it", 2))


def test_sizes_that_take_the_default_call_too_long_are_named_and_not_counted() -> None:
    short, long = held([1.0] * 4, [2.0] * 4), held([2.0], [1.0], LONGEST_S + 1.0)
    said = finding([short, long])
    assert "On 1 random problems from 1 families" in said
    assert "4 of 4 runs (100%" in said
    assert "in 0 of 4 runs (0%" in said
    assert "Not counted above" in page([short, long], "it", 1)[-1]


def test_share_of_hits_is_of_runs_and_not_of_draws() -> None:
    said = finding([held([1.0, 1.0, 2.0], [1.0]), held([1.0], [1.0])])
    assert "3 of 4 runs (75%" in said
