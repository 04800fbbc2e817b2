"""A newer comparison against an older one: better, same, worse, or unknown."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from swarmstart.benchmarks.false_claims import DRAWS, made_up
from swarmstart.cases.campaign.judging.regression import (
    InvalidMarginError,
    regression,
)

INF, NAN = np.inf, np.nan
MACHINE = {"processor": "one", "cores": 2, "system": "Linux", "python": "3.11"}
THIRTY = np.arange(30)
STEADY = 10.0 + 0.001 * THIRTY


def content(costs: Any, solver: str = "de", **more: Any) -> dict[str, Any]:
    made = made_up({"s": {solver: costs}}, resamples=0, **more)
    return {**made, "machines": [MACHINE]}


def verdicts(before: Any, now: Any, margin: float = 0.1) -> list[str]:
    return [row["verdict"] for row in regression(before, now, margin)["rows"]]


def row(before: Any, now: Any, number: int) -> dict[str, Any]:
    found: dict[str, Any] = regression(before, now)["rows"][number]
    return found


def test_the_same_costs_are_the_same_and_need_no_seeds() -> None:
    for costs in (STEADY, STEADY[:1], [INF] * 3, [3.0, INF, NAN]):
        before = content(costs)
        said = regression(before, content(costs), against="old.json")
        assert verdicts(before, content(costs))[:2] == ["same", "same"]
        assert not said["is_regression"] and said["against"] == "old.json"
    assert row(content(STEADY), content(STEADY), 1)["words"] == (
        "the same costs again in all 30 seeds"
    )


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [(0.8, "better"), (0.95, "same"), (1.05, "same"), (1.2, "worse")],
)
def test_costs_are_judged_against_the_margin(factor: float, verdict: str) -> None:
    before, now = content(STEADY), content(factor * STEADY)
    found = row(before, now, 1)
    assert found["verdict"] == verdict
    assert found["now"] == pytest.approx(factor * found["before"])
    # 5 percent are within the margin, and yet none is within 1 percent of the best.
    assert verdicts(before, now)[0] == ("better" if factor < 1 else "worse")
    scaled = row(content(1e-9 * STEADY), content(1e-9 * factor * STEADY), 1)
    assert scaled["verdict"] == verdict


def test_a_maximised_cost_is_judged_by_its_size() -> None:
    """Below 0: 20 percent of the gain lost is worse, however it is written."""
    assert verdicts(content(-STEADY), content(-0.8 * STEADY))[1] == "worse"
    assert verdicts(content(-STEADY), content(-1.2 * STEADY))[1] == "better"


def test_a_spread_of_the_size_of_the_margin_is_unknown() -> None:
    rng = np.random.default_rng(0)
    before = content(10 * np.exp(0.3 * rng.normal(size=30)))
    now = content(10 * np.exp(0.3 * rng.normal(size=30)))
    assert verdicts(before, now)[1] == "unknown"
    # At five times the margin the same data do tell.
    assert verdicts(before, now, margin=0.5)[1] == "same"


def test_answers_that_are_lost_are_worse() -> None:
    lost = np.where(THIRTY < 20, INF, STEADY)
    assert verdicts(content(STEADY), content(lost))[:2] == ["worse", "worse"]
    assert verdicts(content(lost), content(STEADY))[:2] == ["better", "better"]
    found = row(content(STEADY), content(lost), 1)
    assert found["now"] is None and "beyond measure" in found["words"]
    assert verdicts(content([INF] * 30), content([INF] * 29 + [NAN]))[1] == "same"


def test_success_is_held_to_the_best_of_both() -> None:
    """The newer one always finds 10; the older one's best, 12, is not near that."""
    before, now = content(np.full(30, 12.0)), content(np.full(30, 10.0))
    found = row(before, now, 0)
    assert (found["before"], found["now"], found["verdict"]) == (0.0, 1.0, "better")


def test_round_off_beside_a_best_of_0_is_success() -> None:
    """Of costs up to 5, 1e-12 is the optimum, before and now."""
    before = content([0.0, 1e-12] * 14 + [5.0, 5.0])
    now = content([1e-12, 0.0] * 14 + [5.0, 5.0])
    found = row(before, now, 0)
    assert found["before"] == found["now"] == 28 / 30 and found["verdict"] == "same"


def test_seconds_are_judged_on_one_quiet_machine_only() -> None:
    def at(pace: float, **more: Any) -> dict[str, Any]:
        clock = {"de": pace * (1 + 0.001 * THIRTY)}
        return {**content(STEADY, seconds=clock), **more}

    assert verdicts(at(1.0), at(1.05))[2] == "same"
    assert verdicts(at(1.0), at(1.3))[2] == "worse"
    assert verdicts(at(1.0), at(0.7))[2] == "better"
    other = [{**MACHINE, "processor": "two"}]
    for more, why in (
        ({"machines": other}, "another machine"),
        ({"machines": []}, "a machine is not known"),
        ({"is_noisy": True}, "a machine was busy"),
    ):
        found = row(at(1.0), at(1.3, **more), 2)
        assert found["verdict"] == "unknown"
        assert found["words"] == f"not compared: {why}"
    newer_python = [{**MACHINE, "python": "3.13"}]
    assert verdicts(at(1.0), at(1.3, machines=newer_python))[2] == "worse"


def test_a_deterministic_solver_is_judged_by_its_one_run() -> None:
    before = content([10.0], solver="ipopt")
    assert verdicts(before, content([10.5], solver="ipopt"))[1] == "same"
    assert verdicts(before, content([12.0], solver="ipopt")) == [
        "worse", "worse", "unknown"
    ]  # fmt: skip
    assert verdicts(before, content([INF], solver="ipopt"))[1] == "worse"
    assert row(before, content([12.0], solver="ipopt"), 1)["words"] == (
        "+20 %, one run each"
    )


def test_what_cannot_be_compared_is_unknown_and_says_why() -> None:
    before = content(STEADY)
    cases = {
        "another budget": {**content(STEADY), "budget": {"evaluations": 5}},
        "another distance counts as near": {**content(STEADY), "near": [0.1, 0.01]},
        "not in the newer comparison": content(STEADY, solver="ga"),
    }
    for why, now in cases.items():
        for found in regression(before, now)["rows"]:
            assert found["verdict"] == "unknown"
            assert found["words"] == f"not compared: {why}"
    changed = content(STEADY)
    changed["scenarios"][0]["rows"][0]["settings"] = "other"
    assert row(before, changed, 1)["words"].endswith("settings of scenario or solver")
    assert row(before, {**before, "scenarios": []}, 0)["verdict"] == "unknown"
    few = row(content(STEADY[:5]), content(1.5 * STEADY[:5]), 1)
    assert few["words"] == "not compared: 5 seeds, 6 are needed"
    about_zero = row(content([0.0] * 29 + [1.0]), content([0.0] * 28 + [1.0] * 2), 1)
    assert about_zero["words"] == "not compared: the cost is about 0"


def test_pairs_are_of_one_seed_and_else_of_independent_runs() -> None:
    """Costs that depend on the seed much more than on the solver tell by pairs only."""
    own = 10.0 * np.exp(0.3 * np.random.default_rng(0).normal(size=30))
    before = content(own)
    assert verdicts(before, content(1.02 * own))[1] == "same"
    turned = content(1.02 * own[::-1], seeds=tuple(range(29, -1, -1)))
    assert verdicts(before, turned)[1] == "same"
    elsewhere = content(1.02 * own[::-1], seeds=tuple(range(100, 130)))
    assert verdicts(before, elsewhere)[1] == "unknown"
    more_seeds = content(np.concatenate([own, 3 * own]))
    assert verdicts(before, more_seeds)[1] == "same"


@pytest.mark.parametrize("margin", [0.0, 1.0, -0.1, NAN])
def test_a_margin_is_a_part(margin: float) -> None:
    with pytest.raises(InvalidMarginError, match="expected a margin above 0 %"):
        regression(content(STEADY), content(STEADY), margin)


def test_every_verdict_of_equal_solvers_is_no_worse() -> None:
    """A short form of `benchmarks/false_claims.py`."""
    rng = np.random.default_rng(1)
    worse = rows = 0
    for draw in DRAWS:
        for _ in range(12):
            old, new = draw(rng, (2, 30))
            found = verdicts(content(old), content(new))
            worse, rows = worse + found.count("worse"), rows + len(found)
    assert worse <= 0.05 * rows
