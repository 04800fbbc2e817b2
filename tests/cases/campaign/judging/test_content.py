"""A comparison's content is complete, repeatable and true, also with little data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.benchmarks.false_claims import made_up
from swarmstart.cases.campaign.judging import content as content_module
from swarmstart.cases.campaign.judging.content import fault_of, load_of, read_comparison
from swarmstart.cases.campaign.judging.report import report_text
from swarmstart.cases.campaign.judging.runs import About
from swarmstart.cases.record.files import write_json

INF, NAN = np.inf, np.nan
TWELVE = (
    *("de", "ga", "pso", "cpso", "lshade", "cma", "de+ipopt", "ga+ipopt"),
    *("pso+ipopt", "lshade+ipopt", "repeated-ipopt", "ipopt"),
)


def with_history(cost: float) -> Mapping[str, Any]:
    """Return a history that halves its distance from the cost at every mark."""
    if not np.isfinite(cost):
        return {"plan": None, "history": None}
    distances = [8.0, 4.0, 2.0, 1.0, 0.0]
    return {
        "history": {
            "evaluations": [1, 10, 100, 1000, 4000],
            "seconds": [0.01, 0.1, 0.2, 0.5, 1.0],
            "cost": [cost + d for d in distances],
            "violation": [1.0, 1e-5, 0.0, 0.0, 1e-4],
        },
        "plan": {"time": [0.0, 1.0], "cost": cost},
        "claimed_violation": 1e-4,
    }


def flight(cost: float) -> Mapping[str, Any]:
    return {
        "of": "flight",
        "claimed_cost": None,
        "claimed_feasible": False,
        "history": None,
        "measures": {
            "closed_loop_cost": cost,
            "settle_time_s": None if cost > 10 else 4.0,
            "misses": [1, 2],
        },
        "step_seconds": {"p50": 0.01 * cost, "p99": 0.2, "max": 0.3, "dt": 1.0},
    }


def draws(count: int, seeds: int) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    own = {name: 10 + rng.exponential(size=seeds) for name in TWELVE[:count]}
    return own | ({"ipopt": [10.5]} if count == len(TWELVE) else {})


CASES: dict[str, dict[str, Any]] = {
    "two solvers": made_up({"s": draws(2, 8), "t": draws(2, 8)}, more=with_history),
    "no feasible answer": made_up({"s": {"de": [INF] * 8, "ga": [INF] * 8}}),
    "one scenario of two unsolved": made_up(
        {"s": {"de": [INF] * 8, "ga": [INF] * 8}, "t": draws(2, 8)}, more=with_history
    ),
    "all failed": made_up({"s": {"de": [NAN] * 8, "ga": [NAN] * 8, "ipopt": [NAN]}}),
    "one seed": made_up({"s": draws(2, 1)}, more=with_history),
    "one solver": made_up({"s": draws(1, 8)}, more=with_history),
    "one solver, one seed, deterministic": made_up({"s": {"ipopt": [3.0]}}),
    "twelve solvers": made_up({"s": draws(12, 21)}, more=with_history),
    "costs of 0": made_up({"s": {"de": [0.0] * 8, "ga": [0.0] * 7 + [1.0]}}),
    "below 0": made_up({"s": {"de": [-5.0] * 8, "ga": [-5.0] * 7 + [1.0]}}),
    "huge": made_up({"s": {"de": [1e300] * 8, "ga": [1e308] * 8}}),
    "flights": made_up({"s": draws(2, 8)}, more=flight),
    "few failed": made_up({"s": {"de": [NAN, *[3.0] * 7], "ga": [4.0] * 8}}),
}


@pytest.mark.parametrize("name", CASES)
def test_content_is_complete_and_finite(name: str, tmp_path: Path) -> None:
    content = CASES[name]
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    write_json(tmp_path / "comparison.json", content)
    assert read_comparison(tmp_path) == content
    for scenario in content["scenarios"]:
        for row in scenario["rows"]:
            runs = 1 if row["deterministic"] else len(content["seeds"])
            lists = ("costs", "gaps", "claimed", "seconds", "evaluations")
            assert {len(row[key]) for key in lists} == {runs} == {row["runs"]}
            assert row["feasible"] == sum(cost is not None for cost in row["costs"])
            assert row["near"][1] <= row["near"][0] <= row["feasible"]
            assert len(row["ert_evaluations"]) == len(row["ert_seconds"]) == 2
            assert (row["near_intervals"] is None) == row["deterministic"]
    assert content["headline"].endswith(".") and content["headline"][:2] != "; "
    assert all(said.endswith(".") for said in content["limits"])
    assert "nan" not in report_text(content, times=True).lower()
    assert "None" not in report_text(content, times=True) + content["headline"]


def test_the_same_outcomes_give_the_same_bits() -> None:
    again = made_up({"s": draws(2, 8), "t": draws(2, 8)}, more=with_history)
    assert again == CASES["two solvers"]


def test_the_best_known_is_the_least_verified_cost() -> None:
    content = CASES["two solvers"]
    scenario = content["scenarios"][0]
    costs = [c for row in scenario["rows"] for c in row["costs"]]
    assert scenario["best_cost"] == min(costs)
    best = scenario["answer"]
    assert best["plan"]["cost"] == min(costs)
    row = next(r for r in scenario["rows"] if r["solver"] == best["solver"])
    assert row["costs"][best["seed"]] == min(costs)
    assert scenario["best_by"] == best["solver"]


def test_beside_a_best_of_0_round_off_is_near() -> None:
    own = {"de": [0.0, 1e-12, 1e-3, 5.0]}
    assert made_up({"s": own})["scenarios"][0]["rows"][0]["near"] == [2, 2]


def test_round_off_of_what_was_summed_up_is_no_difference() -> None:
    """In its slot already: costs of 1e-29 and 1e-19, where a search began at 8."""
    rng = np.random.default_rng(0)
    own = {
        "de": list(1e-29 * rng.random(30)),
        "repeated-ipopt": list(1e-19 * (1 + rng.random(30))),
    }
    (scenario,) = made_up({"s": own}, more=with_history)["scenarios"]
    assert [row["near"] for row in scenario["rows"]] == [[30, 30]] * 2
    assert [row["false_successes"] for row in scenario["rows"]] == [0, 0]
    (pair,) = scenario["pairs"]
    assert pair["verdict"] == "no difference shown"


def test_where_seeds_draw_gusts_each_has_a_best_known_of_its_own() -> None:
    """Seed k costs k + 1 at least; `ga` is always 5 % costlier."""
    calm = [1.0 + k for k in range(8)]
    own = {"de": calm, "ga": [1.05 * c for c in calm[:7]] + [8.0]}
    drawn = {"s": About(is_seeded=True)}
    (scenario,) = made_up({"s": own}, about=drawn)["scenarios"]
    assert scenario["bests"] == calm
    assert [row["near"][0] for row in scenario["rows"]] == [8, 1]
    gaps = scenario["rows"][1]["gaps"]
    assert gaps == pytest.approx([0.05] * 7 + [0.0])
    (pooled,) = made_up({"s": own})["scenarios"]
    assert pooled["bests"] is None
    assert [row["near"][0] for row in pooled["rows"]] == [1, 0]


def test_marks_are_feasible_by_the_solvers_own_tolerance() -> None:
    """The second mark, at 10, has 1e-5; answers of 1e-4 were called feasible."""
    content = CASES["two solvers"]
    history = content["scenarios"][0]["rows"][0]["history"]
    low = dict(zip(history["evaluations"], history["cost"]["low"], strict=True))
    assert low[1.0] is None and low[10.0] is not None


def test_a_lower_cost_from_elsewhere_is_the_best_known() -> None:
    about = {"s": About(known_cost=5.0, bound={"value": 4.0, "kind": "proven"})}
    own = {"de": [10.0] * 8, "ga": [10.5] * 8}
    scenario = made_up({"s": own}, about=about)["scenarios"][0]
    assert (scenario["best_cost"], scenario["best_by"]) == (5.0, None)
    assert scenario["rows"][0]["gaps"] == [1.0] * 8
    assert scenario["rows"][0]["near"] == [0, 0]
    assert scenario["answer"] is None
    higher = made_up({"s": own}, about={"s": About(known_cost=11.0)})["scenarios"][0]
    assert (higher["best_cost"], higher["best_by"]) == (10.0, "de")
    assert higher["known_cost"] == 11.0


def test_limits_say_what_cannot_be_concluded() -> None:
    about = {"s": About(known_cost=5.0, bound={"value": 11.0, "kind": "proven"})}
    said = " ".join(
        made_up({"s": {"de": [10.0] * 8, "ga": [10.5] * 8}}, about=about)["limits"]
    )
    assert "No solver comes within 1 % of the cost known from elsewhere: s." in said
    assert "A cost is below the bound; one of the two is wrong: s." in said
    assert "8 seeds are few: a difference that is not shown may still be" in said
    assert "seconds are shown, and not compared" in said
    failed = " ".join(CASES["few failed"]["limits"])
    assert "Of 16 runs 1 failed; they count as they ended." in failed
    assert "No feasible answer is known: s." in CASES["no feasible answer"]["limits"]
    assert any(said.startswith("One seed: ") for said in CASES["one seed"]["limits"])


@pytest.mark.parametrize(
    ("sense", "words"),
    [
        (1, "9.9375 proven; the optimum is at most 0.63 % below the best known"),
        (-1, "-9.9375 proven; the optimum is at most 0.63 % above the best known"),
    ],
)
def test_a_bound_stands_beside_the_best_known(sense: int, words: str) -> None:
    """Costs and bounds are minimised inside, and shown in the user's sense."""
    about = {"s": About(bound={"value": 9.9375, "kind": "proven", "reason": "proof"})}
    results = {"s": {"de": [10.0] * 8, "ga": [10.5] * 8}}
    content = made_up(results, about=about, more=lambda _: {"sense": sense})
    (scenario,) = content["scenarios"]
    assert scenario["bound"]["words"] == words
    assert scenario["bound"]["gap"] == pytest.approx(0.00625, rel=1e-12)
    assert not any("no proof that none is less" in said for said in content["limits"])


def test_an_estimate_from_samples_is_no_bound() -> None:
    """It may be above the best known, has no gap, and proves nothing."""
    about = {"s": About(bound={"value": 11.0, "kind": "sampled", "reason": "..."})}
    content = made_up({"s": {"de": [10.0] * 8, "ga": [10.5] * 8}}, about=about)
    (scenario,) = content["scenarios"]
    assert scenario["bound"]["gap"] is None
    assert scenario["bound"]["words"] == "sampled estimate 11 (no bound)"
    assert any("no proof that none is less" in said for said in content["limits"])
    assert not any("below the bound" in said for said in content["limits"])
    assert "bound" not in content["headline"]
    assert "  bound: sampled estimate 11 (no bound)" in report_text(content)


def test_without_a_bound_the_reason_is_told() -> None:
    bound = {
        "value": None,
        "kind": "none",
        "reason": "5 states, at most 3 are possible",
    }
    about = {"s": About(bound=bound)}
    content = made_up({"s": {"de": [10.0] * 8, "ga": [10.5] * 8}}, about=about)
    assert "  bound: none: 5 states, at most 3 are possible" in report_text(content)
    unsolved = made_up({"s": {"de": [NAN] * 8}}, about=about)
    assert unsolved["scenarios"][0]["bound"]["gap"] is None


def test_a_failed_run_costs_its_budget_and_has_no_time() -> None:
    """To 3: seven runs of 4,000 and the budget of the one that died, over seven."""
    row = CASES["few failed"]["scenarios"][0]["rows"][0]
    assert row["failed"] == ["it died"]
    assert row["ert_evaluations"][0] == pytest.approx(8 * 4000 / 7)
    assert row["seconds"][0] is None and row["seconds_p99"] is None
    assert row["seconds_p50"] == 1.0


def test_false_successes_are_claims_that_do_not_hold() -> None:
    """One answer is not feasible, one costs 2 % more than claimed, one 0.5 %."""
    claims = {INF: 1.0, 10.2: 10.0, 10.3: 10.25, 10.0: 10.0}

    def more(cost: float) -> Mapping[str, Any]:
        return {"claimed_feasible": True, "claimed_cost": claims[cost]}

    content = made_up({"s": {"de": [INF, 10.2, 10.3, 10.0]}}, more=more)
    row = content["scenarios"][0]["rows"][0]
    assert (row["claimed_feasible"], row["false_successes"]) == (4, 2)


def test_flights_have_measures_and_no_history() -> None:
    row = CASES["flights"]["scenarios"][0]["rows"][0]
    assert CASES["flights"]["scenarios"][0]["of"] == "flight"
    assert row["history"] is None and row["ecdf"] is None
    assert row["false_successes"] == 0
    costs = sorted(row["costs"])
    found = row["measures"]["closed_loop_cost"]
    assert (found["low"], found["high"]) == (costs[0], costs[-1])
    assert row["measures"]["settle_time_s"] == {
        "low": None, "median": None, "high": None, "undefined": 8
    }  # fmt: skip
    assert row["measures"]["misses 2"]["median"] == 2
    assert row["step_seconds"]["p99"] == 0.2 and row["step_seconds"]["dt"] == 1.0


def test_plans_and_flights_stand_in_one_comparison() -> None:
    def more(cost: float) -> Mapping[str, Any]:
        return flight(cost) if cost < 5 else with_history(cost)

    content = made_up({"s": draws(2, 8), "t": {"de": [3.0] * 8, "ga": [4.0] * 8}},
                      more=more)  # fmt: skip
    assert [scenario["of"] for scenario in content["scenarios"]] == ["plan", "flight"]
    assert content["ranks"] and content["profile"]


def test_a_solver_that_cannot_serve_a_scenario_has_not_failed_there() -> None:
    """Ranks and profile are of the two scenarios on which all three ran."""
    three = {"s": draws(3, 21), "t": draws(3, 21)}
    some = made_up({"u": draws(2, 21), **three}, more=with_history)
    assert [one["name"] for one in some["solvers"]] == list(TWELVE[:3])
    full = made_up(three, more=with_history)
    shares = [
        {name: curve["share"] for name, curve in content["profile"]["curves"].items()}
        for content in (some, full)
    ]
    assert shares[0] == shares[1]
    means = [[one["mean"] for one in content["ranks"]] for content in (some, full)]
    assert means[0] == means[1]
    assert any("Not every solver ran on u" in said for said in some["limits"])
    assert made_up({"t": draws(2, 8), "s": draws(3, 8)})["ranks"] == []


def test_chance_in_the_scenario_gives_a_deterministic_solver_a_run_a_seed() -> None:
    """A flight through gusts: eight costs, a test, an interval, and no "one run"."""
    own = {"ipopt": np.arange(8.0) + 10, "de": np.arange(8.0) + 30}
    content = made_up({"s": own}, more=flight)
    row, other = content["scenarios"][0]["rows"]
    assert (row["runs"], row["deterministic"]) == (8, False)
    assert row["near_intervals"] is not None and other["against_first"]["p"] < 0.05
    assert content["solvers"][0]["deterministic"]
    assert not any("one run" in said for said in content["limits"])
    assert fault_of(content) == ""
    every = made_up({"s": {"ipopt": [10.0] * 8, "de": [10.0] * 8}})["headline"]
    assert every.startswith(
        "On s nothing is gained: ipopt finds the same cost in every run with 4000"
    )


def test_curves_rise_and_their_bands_hold_them() -> None:
    row = CASES["two solvers"]["scenarios"][0]["rows"][0]
    ecdf, history = row["ecdf"], row["history"]
    assert len(ecdf["share"]) == len(ecdf["evaluations"]) == len(history["seconds"])
    assert np.all(np.diff(ecdf["share"]) >= 0)
    assert np.all(np.array(ecdf["low"]) <= np.array(ecdf["share"]) + 1e-9)
    assert np.all(np.array(ecdf["share"]) <= np.array(ecdf["high"]) + 1e-9)
    assert history["cost"]["low"][0] is None  # The first mark breaks a constraint.
    final = [cost for cost in row["costs"] if cost is not None]
    last = [history["cost"][key][-1] for key in ("low", "median", "high")]
    expected = [min(final), np.median(final), max(final)]
    np.testing.assert_allclose(last, expected, rtol=1e-5)


def test_the_profile_is_of_evaluations_unless_only_seconds_are_limited() -> None:
    by_clock = made_up({"s": draws(2, 8)}, budget={"seconds": 2.0}, more=with_history)
    assert by_clock["profile"]["quantity"] == "seconds"
    assert CASES["two solvers"]["profile"]["quantity"] == "evaluations"
    assert CASES["no feasible answer"]["profile"] is None
    assert CASES["one solver"]["profile"] is None


def test_ranks_need_two_scenarios() -> None:
    assert CASES["two solvers"]["ranks"][0]["solver"] == "de"
    assert CASES["one scenario of two unsolved"]["ranks"] == []
    assert CASES["twelve solvers"]["ranks"] == []


@dataclass(frozen=True, kw_only=True, slots=True)
class Timed:
    """Just what a machine says of a run."""

    load: tuple[float, float] | None = None
    machine: Mapping[str, Any] | None = None
    cpu_s: float | None = None
    seconds: float = 1.0


@pytest.mark.parametrize(
    ("one", "load", "is_noisy"),
    [
        (Timed(), None, False),
        (Timed(load=(1.0, 2.0), machine={"cores": 2}), 2.0, False),
        (Timed(load=(5.1, 2.0), machine={"cores": 2}), 5.1, True),
        (Timed(cpu_s=0.7), None, True),
        (Timed(cpu_s=0.9), None, False),
        (Timed(cpu_s=0.001, seconds=0.01), None, False),
    ],
)
def test_a_busy_machine_is_noticed(
    one: Timed, load: float | None, is_noisy: bool
) -> None:
    quiet = Timed(load=(1.0, 1.0), machine={"cores": 2}, cpu_s=1.0)
    assert load_of([one] * 3) == (load, is_noisy)  # type: ignore[list-item]
    assert not load_of([one, quiet, quiet, quiet])[1]  # type: ignore[list-item]


def test_seconds_are_claimed_only_with_a_budget_in_seconds() -> None:
    clocks = {"de": np.ones(12), "ga": np.linspace(2, 3, 12)}
    own = {"s": {"de": np.arange(12.0) + 9, "ga": np.arange(12.0) + 9}}
    timed = made_up(own, seconds=clocks, budget={"seconds": 5.0})
    found = timed["scenarios"][0]["rows"][1]["against_first"]["seconds"]
    assert found["verdict"] == "slower"
    untimed = made_up(own, seconds=clocks)
    assert untimed["scenarios"][0]["rows"][1]["against_first"]["seconds"] is None
    assert not untimed["judges_seconds"]


def test_nothing_is_claimed_about_seconds_of_a_busy_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clocks = {"ipopt": np.ones(1), "ga": np.linspace(2, 3, 12)}
    own: dict[str, Any] = {"s": {"ga": np.arange(12.0) + 9, "ipopt": [9.0]}}
    budget = {"seconds": 5.0}
    monkeypatch.setattr(content_module, "load_of", lambda _: (9.0, True))
    busy = made_up(own, seconds=clocks, budget=budget)
    assert busy["is_noisy"] and not busy["judges_seconds"]
    busy_words = "The machine was busy (highest load 9.0): nothing is claimed about"
    assert any(said.startswith(busy_words) for said in busy["limits"])
    assert " s;" not in busy["headline"] and "4000 evaluations" in busy["headline"]
    monkeypatch.undo()
    quiet = made_up(own, seconds=clocks, budget=budget)
    assert "finds the same cost in 1 s" in quiet["headline"]


def test_a_comparison_of_an_earlier_version_is_read_with_the_present_names(
    tmp_path: Path,
) -> None:
    """It said multistart-ipopt, and not where costs are from."""
    costs = {"de": [2.0] * 8, "repeated-ipopt": [1.0] * 8}
    content = json.loads(json.dumps(made_up({"s": costs})))
    old = json.loads(json.dumps(content).replace("repeated-ipopt", "multistart-ipopt"))
    for one in old["scenarios"]:
        del one["known_from"]
    write_json(tmp_path / "comparison.json", old)
    assert "multistart-ipopt" in json.dumps(old)
    assert read_comparison(tmp_path) == content


def test_the_best_known_is_of_the_first_solver_that_reaches_it_or_from_elsewhere() -> (
    None
):
    same = {"ga": [3.0 + 1e-9] * 8, "de": [3.0] * 8, "pso": [4.0] * 8}
    (one,) = made_up({"s": same})["scenarios"]
    assert one["best_by"] == "ga"
    known = About(known_cost=2.0, known_from="an earlier run, results/s/1")
    content = made_up({"s": same}, about={"s": known})
    (one,) = content["scenarios"]
    assert one["best_by"] is None and one["best_cost"] == 2.0
    told = "best known: 2, from an earlier run, results/s/1"
    assert told in report_text(content)
    # An earlier run is no proof that nothing is less.
    assert any(
        "with no proof that none is less: s" in said for said in content["limits"]
    )


def test_solve_is_said_to_have_a_budget_of_its_own() -> None:
    costs = {"solve": [1.0] * 8, "de": [2.0] * 8}
    content = made_up({"s": costs}, budget_text="1evals|5s")
    assert any(s.startswith("solve does what run does") for s in content["limits"])
    head = "budget of 1 evaluations or 5s for each planning problem (solve has its own)"
    assert report_text(content).startswith(f"{head}, seeds 0 to 7\n")
    others = {"ga": [1.0] * 8, "de": [2.0] * 8}
    limits = made_up({"s": others}, budget_text="1evals")["limits"]
    assert not any("what run does" in said for said in limits)
