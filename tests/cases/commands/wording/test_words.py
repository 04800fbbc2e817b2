"""Sentences on a run: what was run, what came out, constraints, time, picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.wording.outcomes import time_of_excess
from swarmstart.cases.commands.wording.words import (
    extras,
    heading,
    method,
    picture,
    sentences,
)
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.ocp import SolutionStatus

PLAN = """\
kind: problem
title: Move a point
states: {x: {start: 0, rate: v, unit: m}, v: {start: 0, rate: u, bounds: [-9, 9]}}
controls: {u: {bounds: [-9, 9]}}
stage_cost: u**2
terminal: [{expression: x, equals: 1}, {expression: v}]
prediction: {horizon_s: 1, intervals: 8}
search: {name: none}
lanes: 0
"""
PUSHED = """\
kind: problem
states: {x: {start: 0, rate: u, bounds: [-1, 1]}}
controls: {u: {bounds: [-0.01, 0.01]}}
plant: {disturbance: {x: 4*sin(pi*time/0.75)}}
stage_cost: x**2
prediction: {horizon_s: 1.5, intervals: 3}
feedback: receding_horizon
search: {name: none}
lanes: 0
measures: {calm: "settling(x, 0, 0.001)", last: x.end}
"""
"""It is pushed to x = 4 * 0.75 / pi * 2 = 1.91 at 0.75 s, and back."""
BESIDE = """\
kind: problem
states: {x: {start: 1, rate: v}, v: {start: 0, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: x**2 + v**2 + u**2
prediction: {horizon_s: 2, intervals: 10}
search: {name: none}
lanes: 0
"""
"""It starts at x = 1, beyond the limits that the tests give."""
CENTIMETRES = 'path=[{expression: "v", upper: 1}]'

FAR = """\
kind: problem
states: {x: {start: 0, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: u**2
terminal: [{expression: x - 1}]
prediction: {horizon_s: 2, intervals: 4}
search: {name: none}
"""
"""A plan reaches x = 1 at its end, 2 s ahead; a run of two steps ends before."""


def finished(tmp_path: Path, text: str, *assignments: str) -> Run:
    file = tmp_path / "tiny.yaml"
    file.write_text(text)
    return run(resolve(read_document(str(file)), assignments=assignments), seed=3)


def test_one_plan_is_told_with_its_cost_and_what_that_is_worth(tmp_path: Path) -> None:
    done = finished(tmp_path, PLAN)
    what, result, why, kept, time, figures = sentences(done)
    assert what == (
        "Move a point (tiny): one plan of 1 s in 8 intervals; by solve: no search, "
        "polish IPOPT, seed 3."
    )
    cost = done.measures["cost"]
    assert isinstance(cost, float)
    worth = "a local optimum, confirmed by a finer integration"
    assert result == f"Cost {cost:.6g}: {worth}."
    assert why == "Reason: stationary, with positive second derivatives."
    assert kept.startswith("All constraints are kept")
    assert time.startswith("Solved in ") and time.endswith("s.")
    assert figures == "No figures were drawn."
    assert extras(done) == []


def test_a_plan_at_a_kink_says_why_it_is_no_optimum_and_what_would_help(
    tmp_path: Path,
) -> None:
    done = finished(tmp_path, PLAN, "stage_cost=u**2 + 50*abs(v - 1)")
    _, result, reason, advice, *_ = sentences(done)
    assert result.endswith("but not shown to be a local optimum.")
    assert reason.startswith("Reason: the path touches a kink or jump of fabs(")
    assert advice.startswith("Advice: write fabs(a) as a slack: ")
    summary = done.summary()
    assert f"Reason: {summary['reason']}." == reason
    assert f"Advice: {summary['advice']}." == advice
    assert summary["status"].endswith(f": {summary['reason']}; {summary['advice']}")


def test_a_plan_that_is_not_feasible_says_what_is_broken_and_when(
    tmp_path: Path,
) -> None:
    done = finished(tmp_path, PLAN, CENTIMETRES)  # 1 m in 1 s needs 1.5 m/s.
    _, result, reason, advice, kept, *_ = sentences(done)
    assert result == f"{SolutionStatus.INFEASIBLE.value.capitalize()}."
    assert reason.startswith("Reason: the best point found breaks constraints by ")
    assert advice.startswith("Advice: try a larger budget, ")
    ended = done.summary()["status"]
    assert ended.startswith("simulated to the end; no feasible solution was found: ")
    assert kept.startswith("A constraint is broken: ")
    assert " is broken by " in kept and kept.endswith(" s.")


@pytest.mark.parametrize(
    ("low", "upper", "result", "kept"),
    [
        (-0.1, 0.5, "No feasible solution was found.", "broken by 0.5 (0.5 of its"),
        (-40, 0.99, "Cost ", "broken by 0.01 (0.01 of its"),
    ],
    ids=["never inside", "inside later"],
)
def test_a_start_outside_is_never_called_kept(
    low: float, upper: float, result: str, kept: str, tmp_path: Path
) -> None:
    """The finer check excuses it, since no control can keep it; the words do not."""
    limit = f"path=[{{expression: x, upper: {upper}}}]"
    bounds = f"controls.u.bounds=[{low}, 40]"
    said = sentences(finished(tmp_path, BESIDE, bounds, limit))
    assert said[1].startswith(result)
    (about,) = (line for line in said if line.startswith(("A const", "All const")))
    assert about.startswith(f"A constraint is broken: 'x' is {kept}")
    assert "at 0 s" in about
    assert ("; all are kept later" in about) == (result == "Cost ")


def test_a_closed_loop_says_how_far_and_when_a_constraint_is_broken(
    tmp_path: Path,
) -> None:
    done = finished(tmp_path, PUSHED)
    what, kept, result, more, time, _ = sentences(done)
    assert more == "More: docs/messages.md#some-steps, docs/messages.md#broken-run"
    assert what.startswith("tiny (tiny): closed loop for 1.5 s in 3 steps; ")
    flown = done.measures["flown_cost"]
    assert isinstance(flown, float)
    assert result.startswith(f"Cost {flown:.6g} along the simulated path; ")
    assert result.endswith(" Settling time: calm not settled.")
    excess = 6 / np.pi - 1  # Its control moves it by less than 0.01.
    assert done.measures["constraint_excess"] == pytest.approx(excess, abs=0.01)
    assert kept.startswith("Constraints are broken: largest excess 0.9")
    assert " along the path between 0.5 and 1 s, in the unit" in kept
    assert "; a step lasts 500 ms, so every plan is ready in time." in time


def test_a_closed_loop_says_by_how_much_it_misses_the_end(tmp_path: Path) -> None:
    done = finished(tmp_path, FAR, "feedback=receding_horizon", "steps=2")
    missed = done.measures["terminal_excess"]
    assert isinstance(missed, float) and missed > 0.1
    kept = next(line for line in sentences(done) if line.startswith("All constraints"))
    assert kept.endswith(f"the end conditions are missed by up to {missed:.3g}.")


def test_a_single_search_of_a_closed_loop_is_told_in_the_singular(
    tmp_path: Path,
) -> None:
    loop = ("feedback=receding_horizon", "steps=2", "search={name: lshade}")
    done = finished(tmp_path, BESIDE, *loop, "budget.evaluations=100")
    assert done.ended.more == ", 1 of 2 plans was searched"


def test_no_time_is_sought_of_an_excess_that_is_undefined(tmp_path: Path) -> None:
    done = finished(tmp_path, PLAN)
    assert time_of_excess(replace(done, measures={"constraint_excess": None})) == ""


def test_late_steps_are_counted(tmp_path: Path) -> None:
    done = finished(tmp_path, PUSHED)
    seconds = np.array([0.6, 0.1, 0.7])
    slow = replace(done, trajectory=replace(done.trajectory, step_seconds=seconds))
    assert sentences(slow)[-2] == (
        "Time per step: median 600 ms, worst 700 ms; a step lasts 500 ms, so 2 of 3 "
        "steps took too long."
    )


@pytest.fixture(scope="module")
def flight() -> Run:
    tiny = ["steps=2", "budget.evaluations=40"]
    return run(resolve(read_document("formation_v"), assignments=tiny), seed=0)


def test_a_flight_says_whether_it_settled_and_how_near_uavs_came(flight: Run) -> None:
    what, result, kept, time, _ = sentences(flight)
    assert "(formation_v): flight of 5 UAVs for 2 s, a new plan every 1 s; " in what
    assert result.startswith("Not settled: ") and "a UAV is up to " in result
    assert kept.startswith("Closest distance of two UAVs ")
    assert " s (to be kept: 3 m); every planned step found a feasible plan" in kept
    assert "; a step lasts 1 s" in time


def test_a_flight_that_settles_says_when(flight: Run) -> None:
    settled = {"settle_time_s": 23.0, "min_distance_m": 2.5}
    done = replace(flight, measures={**flight.measures, **settled})
    _, near, result, kept, *_ = sentences(done)
    assert near.startswith("TOO CLOSE: 2.5 m between two UAVs at ")
    assert near.endswith("); the safe distance is 3 m.")
    assert "a feasible plan, but the simulated path breaks a constraint" in kept
    assert result.startswith("Settled after 23 s: every UAV then stays within 1 m")
    assert "2.5 m, at " in kept
    assert "0.5 m less than the safe distance of 3 m" in kept


@pytest.mark.parametrize(
    ("kind", "measures", "words"),
    [
        ("reconfiguration", {"position_error_m": 0.25}, "is within 0.25 m of its slot"),
        (
            "close_formation",
            {"x_settle_s": 4.0, "y_settle_s": 7.0, "position_error_late_ft": 0.1},
            "Settled 7 s after",
        ),
        (
            "close_formation",
            {"x_settle_s": 4.0, "y_settle_s": None, "position_error_late_ft": 3.0},
            "Not settled: ",
        ),
    ],
)
def test_kinds_have_words_of_their_own(
    kind: str, measures: dict[str, float | None], words: str, flight: Run
) -> None:
    scenario = flight.resolved.scenario.model_copy(update={"kind": kind})
    resolved = replace(flight.resolved, scenario=scenario)
    done = replace(flight, resolved=resolved, measures=measures)
    told = sentences(done)
    assert words in told[1]
    assert "None" not in "".join(told) and "nan" not in "".join(told)


def test_an_undefined_measure_gives_no_none(flight: Run) -> None:
    undefined = dict.fromkeys(flight.measures)
    told = sentences(replace(flight, measures=undefined))
    assert "None" not in "".join(told)


def test_the_sheet_is_the_picture_to_begin_with() -> None:
    files = [Path("f/a.png"), Path("f/a_sheet.png"), Path("f/b.png")]
    assert picture(files) == f"Picture: {files[1]} (2 more figures beside it)"
    assert picture(files[:1]) == f"Picture: {files[0]}"


def test_titles_are_shortened_and_escaped() -> None:
    assert heading("\x1b[1m", "a") == "\\x1b[1m (a)"
    assert len(heading("x" * 5000, "a")) < 120
    assert heading("", "a") == "a (a)"
    assert method("none", 0, "ipopt", "") == "by solve: no search, polish IPOPT"
    assert method("ga", 1, "none", "literal") == (
        "by solve: search ga, 1 random start in lanes, no polish, variant literal"
    )


def test_a_continued_run_and_a_bound_are_told(flight: Run) -> None:
    done = replace(flight, resumed=1, bound_content={"words": "12 proven"})
    assert extras(done) == [
        "Continued after step 1, where an earlier run stopped.",
        "Bound: 12 proven",
    ]
