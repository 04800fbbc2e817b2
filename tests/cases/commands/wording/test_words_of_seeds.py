"""Sentences on runs over seeds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from swarmstart.cases.commands.actions.seeds import sentences_of_seeds

FOLDER = Path("f")


def content(**measures: list[Any]) -> dict[str, Any]:
    runs = max(map(len, measures.values()))
    return {
        **{"title": "T", "scenario": "s", "variant": "", "lanes": 0, "search": "ga"},
        **{"polish": "none", "seeds": [*range(runs)], "feasible": [True] * runs},
        **{"measures": measures, "figures": ["a.png", "b.png"]},
    }


def test_medians_ranges_and_undefined_runs_are_told() -> None:
    told = sentences_of_seeds(
        content(
            settle_time_s=[20.0, None, 24.0],
            min_distance_m=[3.0, 2.0, 4.0],
            step_seconds_median=[0.01, 0.02, 0.03],
            step_seconds_max=[0.1, 0.2, 0.3],
        ),
        FOLDER,
    )
    assert told == [
        "T (s): 3 runs, seeds 0 to 2; by solve: search ga, no polish.",
        "3 of 3 runs found feasible plans. Settled: median 22 s, from 20 to 24 s; not "
        "settled in 1 run.",
        "Closest distance of two vehicles: lowest 2 m (seed 1), median 3 m.",
        "Time per step: median 20 ms, worst of all runs 300 ms.",
        f"Picture: {FOLDER / 'a.png'} (1 more figure beside it)",
    ]


def test_the_worst_seed_is_told_of_each_distance_that_must_be_kept() -> None:
    told = sentences_of_seeds(
        content(min_distance_m=[9.0, 8.0, 7.0], obstacle_clearance_m=[0.5, -15, 0.1]),
        FOLDER,
    )
    assert told[2] == (
        "Closest distance of two vehicles: lowest 7 m (seed 2), median 8 m; clearance "
        "of obstacles: lowest -15 m (seed 1), median 0.1 m."
    )


def test_kept_constraints_and_runs_that_never_settle_are_told_in_words() -> None:
    told = sentences_of_seeds(
        content(settle_time_s=[None], constraint_excess=[1e-9], plan_seconds=[2.0]),
        FOLDER,
    )
    assert told[0].endswith(": 1 run, seed 0; by solve: search ga, no polish.")
    assert told[1].endswith(" Not settled in any run.")
    assert told[2] == "All constraints are kept along the simulated paths."
    assert told[3] == "Time of a plan: median 2 s, worst 2 s."


def test_time_of_a_single_plan_is_not_that_of_the_median_step() -> None:
    """All steps but the first follow the plan, and take no time."""
    times = {"step_seconds_median": [1e-6, 1e-6], "step_seconds_max": [1.0, 3.0]}
    told = sentences_of_seeds(content(confirmed=[1, 0], **times), FOLDER)
    assert "Time of a plan: median 2 s, worst 3 s." in told
    told = sentences_of_seeds(content(confirmed=[None, None], **times), FOLDER)
    assert any(line.startswith("Time per step: ") for line in told)


def test_runs_without_a_feasible_plan_break_constraints() -> None:
    found = content(constraint_excess=[0.0, 0.0], terminal_excess=[3.0, 0.0])
    told = sentences_of_seeds(found | {"feasible": [False, True]}, FOLDER)
    assert told[2] == "Constraints are broken in 1 run, by up to 3."


def test_failed_runs_give_no_none() -> None:
    told = sentences_of_seeds(content(cost=[None, None]), FOLDER)
    assert "None" not in "".join(told)
    assert told[1:4] == [
        "2 of 2 runs found feasible plans. No result.",
        "No constraints are measured.",
        "No times were measured.",
    ]


def test_each_reason_and_advice_is_told_with_its_seeds() -> None:
    found = content(cost=[1.0] * 8) | {
        "reason": ["flat", None, "steep", "steep", *["far"] * 4],
        "advice": [*["more checks"] * 8],
    }
    assert sentences_of_seeds(found, FOLDER)[2:6] == [
        "Reason (seeds 4, 5, 6, 7): far.",
        "Reason (seeds 2, 3): steep.",
        "Reason (seed 0): flat.",
        "Advice (8 runs): more checks.",
    ]
    many = content(cost=[1.0] * 9) | {"reason": [*["far"] * 8, "near"]}
    assert "Reason (8 runs): far." in sentences_of_seeds(many, FOLDER)
