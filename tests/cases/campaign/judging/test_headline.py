"""The headline states what the numbers show, and no more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from swarmstart.benchmarks.false_claims import made_up

INF, NAN = np.inf, np.nan
THIRTY = np.arange(30)


def found(count: int) -> Any:
    """Return thirty costs of which so many are the optimum, 10, and the others 15."""
    return np.where(THIRTY < count, 10.0, 15.0)


BASINS = {"repeated-ipopt": found(2), "lshade+ipopt": found(27), "ipopt": [15.0]}
EASY = {"repeated-ipopt": found(30), "lshade+ipopt": found(30), "ipopt": [10.0]}
STARTS = {**EASY, "ipopt": [15.0]}
NEVER = {"repeated-ipopt": [INF] * 30, "lshade+ipopt": [INF] * 30, "ipopt": [INF]}
GAIN = "lshade+ipopt comes within 1 % of the best known in more seeds than"


def test_a_gain_on_most_and_nothing_gained_on_one() -> None:
    scenarios = {"a": BASINS, "b": BASINS, "c": BASINS, "van_der_pol": EASY}
    assert made_up(scenarios)["headline"] == (
        f"On 3 of 4 scenarios {GAIN} repeated-ipopt (30 seeds, Holm-adjusted "
        "p <= 0.05); on van_der_pol nothing is gained: ipopt once finds the same cost "
        "with 4000 evaluations."
    )


def test_seconds_are_told_only_if_something_may_be_said_of_them() -> None:
    clocks = {name: np.full(30, 0.05) for name in BASINS}
    content = made_up({"s": EASY}, seconds=clocks, budget={"seconds": 2.0})
    assert content["headline"].startswith(
        "On s nothing is gained: ipopt once finds the same cost in 0.05 s; "
    )


def test_one_scenario_is_told_with_its_counts() -> None:
    assert made_up({"catalyst": BASINS})["headline"] == (
        f"On catalyst {GAIN} repeated-ipopt (27 of 30 against 2 of 30, "
        "Holm-adjusted p <= 0.05)."
    )


def test_of_those_that_gain_alike_the_one_that_succeeds_more_often_is_named() -> None:
    own = {**BASINS, "cpso+ipopt": found(13)}
    for order in (own, dict(reversed(own.items()))):
        said = made_up({"catalyst": order})["headline"]
        assert "lshade+ipopt comes within" in said and "27 of 30 against" in said


def test_the_order_of_the_solvers_changes_nothing() -> None:
    turned = dict(reversed(BASINS.items()))
    second = {name: BASINS[name] for name in sorted(BASINS, reverse=True)}
    third = {name: BASINS[name] for name in sorted(BASINS, key=lambda n: n[0] != "l")}
    assert next(iter(third)) == "lshade+ipopt"
    said = {made_up({"s": own})["headline"] for own in (BASINS, turned, second, third)}
    assert len(said) == 1


def test_plain_ipopt_comes_first_where_it_is_as_good_on_more() -> None:
    said = made_up({"a": EASY, "b": EASY, "c": BASINS})["headline"]
    assert said == (
        "On a and b nothing is gained: ipopt once finds the same cost; on c "
        f"{GAIN} repeated-ipopt (27 of 30 against 2 of 30, Holm-adjusted p <= 0.05)."
    )


def test_the_null_hypothesis_comes_first_where_it_always_succeeds() -> None:
    assert made_up({"s": STARTS})["headline"] == (
        "On s nothing is gained: repeated-ipopt comes within 1 % of the best known "
        "in every run; no solver is shown to come within 1 % of the best known in more "
        "seeds than repeated-ipopt, which does so in more than ipopt on s (30 seeds, "
        "Holm-adjusted p <= 0.05)."
    )


def test_a_first_solver_that_stands_in_for_it_is_held_to_nothing() -> None:
    said = made_up({"s": {"de": found(30), "ga": found(30)}})["headline"]
    assert "nothing is gained" not in said


def test_nearly_as_good_is_not_as_good() -> None:
    near = made_up({"s": {**EASY, "ipopt": [10.05]}})["headline"]
    assert "ipopt once comes within 1 % of the best known with 4000" in near
    once_missed = {"repeated-ipopt": found(29), "lshade+ipopt": found(30)}
    assert "nothing is gained" not in made_up({"s": once_missed})["headline"]


def test_a_loss_is_told() -> None:
    own = {"repeated-ipopt": found(27), "lshade+ipopt": found(2)}
    assert made_up({"s": own})["headline"] == (
        "No solver is shown to come within 1 % of the best known in more seeds than "
        "repeated-ipopt, which does so in more than lshade+ipopt on s (30 seeds, "
        "Holm-adjusted p <= 0.05)."
    )
    mixed = {"a": own, "b": BASINS | {"ipopt": [15.0]}, "c": BASINS}
    mixed["a"] = {**own, "ipopt": [15.0]}
    assert f"{GAIN} repeated-ipopt, and in fewer on 1 (30" in made_up(mixed)["headline"]


def test_cheaper_without_more_successes_is_said_so() -> None:
    own = {"repeated-ipopt": 24.0 + THIRTY / 10, "lshade+ipopt": 20.0 + THIRTY / 10}
    said = made_up({"s": own}, near=(1e-6, 1e-9))["headline"]
    assert said.startswith(
        "On s lshade+ipopt finds cheaper answers than repeated-ipopt, though not "
        "shown to come within 0.0001 % of the best known in more seeds"
    )
    turned = made_up(
        {"s": {name: cost - 99 for name, cost in own.items()}},
        near=(1e-6, 1e-9),
        more=lambda _: {"sense": -1},
    )
    assert "lshade+ipopt finds better answers than" in turned["headline"]


def test_a_difference_on_one_of_many_scenarios_may_be_chance() -> None:
    """Shown on its own, at p = 0.02; one such in ten scenarios is to be expected."""
    rng = np.random.default_rng(3)
    equal = {}
    for k in range(9):
        costs = 10 + rng.exponential(size=30)
        equal[f"s{k}"] = {"de": costs, "ga": costs[::-1]}
    gain = np.random.default_rng(2).normal(-0.35, 0.85, size=30)
    differs = {"de": np.full(30, 20.0), "ga": 20.0 + gain}
    scenarios = {"first": differs, **equal}
    content = made_up(scenarios)
    row = content["scenarios"][0]["rows"][1]["against_first"]
    assert row["verdict"] == "cheaper" and 0.005 < row["p"] <= 0.05
    assert content["headline"].startswith("No solver is shown")
    assert made_up({"first": differs})["headline"].startswith("On first ga finds")


@pytest.mark.parametrize(
    ("scenarios", "said"),
    [
        ({"s": NEVER}, "No solver has a feasible answer on s."),
        ({"s": NEVER, "t": NEVER, "u": NEVER},
         "No solver has a feasible answer on any of 3 scenarios."),
        ({"s": {"de": [NAN] * 3}}, "No solver has a feasible answer on s."),
        ({"s": {"de": [3.0] * 3, "ga": [4.0] * 3}},
         "Solvers are not compared: 3 seeds, 7 are needed."),
        ({"s": {"de": [3.0] * 6, "ipopt": [3.0]}},
         "Solvers are not compared: 6 seeds, 7 are needed; on s nothing is gained: "
         "ipopt once finds the same cost with 4000 evaluations."),
        ({"s": {"ipopt": [3.0]}},
         "ipopt has a feasible answer on s in 1 of 1 run, 1 of them within 1 % of the "
         "best known; one solver, so nothing is compared."),
        ({"s": {"de": [3.0] * 2}, "t": {"de": [3.0, INF]}},
         "de has a feasible answer in every run on 1 of 2 scenarios; one solver, so "
         "nothing is compared."),
        ({}, "Nothing was compared."),
    ],
)  # fmt: skip
def test_little_is_told_as_little(scenarios: Any, said: str) -> None:
    content = made_up(scenarios)
    assert content["headline"] == said


def test_few_seeds_are_said_only_if_nothing_was_compared() -> None:
    """Eight seeds are enough for three solvers, and too few for six."""
    eight = {name: np.arange(8.0) + 9 for name in ("de", "ga", "pso")}
    many = {name: np.arange(8.0) + 9 for name in ("cpso", "lshade", "cma")}
    said = made_up({"flight": eight, "plan": eight | many})["headline"]
    assert said.startswith("No solver is shown")
    assert made_up({"plan": eight | many})["headline"] == (
        "Solvers are not compared: 8 seeds, 9 are needed."
    )


def test_unsolved_scenarios_are_told() -> None:
    said = made_up({"a": BASINS, "b": NEVER})["headline"]
    assert said.endswith("; on b no solver has a feasible answer.")
