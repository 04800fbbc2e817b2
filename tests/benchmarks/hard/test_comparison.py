"""Methods on hard problems: equal CPU time, failures charged, the finding in words."""

from __future__ import annotations

import itertools
import math
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarmstart.benchmarks.hard.comparison import (
    METHODS,
    Result,
    Score,
    finding,
    fresh_draws,
    fresh_section,
    page,
    plot,
    problem_table,
    profile,
    result_of,
)
from swarmstart.benchmarks.hard.cpu_trials import (
    OverLimitError,
    counted_by,
    cpu_limit,
    entries_of,
    solved,
    solver_named,
    with_repair,
)
from swarmstart.benchmarks.hard.peers import PEERS
from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.hard import shipped_text
from swarmstart.errors import MissingPackageError, SwarmstartError
from swarmstart.heuristics import Box, Budget, DifferentialEvolution, minimize

NAMES = ["ipopt", "basin-hopping"]


def score(method: str, times: list[float], costs: list[float]) -> Score:
    return Score(
        problem="hard/walls_2", method=method, runs=len(times), times=np.array(times),
        costs=np.array(costs), ends=np.full(len(times), 10.0), limit=30.0,
    )  # fmt: skip


def result(*scores: Score, known: float = 1.0, best: float = 1.0) -> Result:
    return Result(
        problem="hard/walls_2", sense=1, known=known, best=best, scores=scores
    )


def test_a_failure_is_charged_three_times_the_limit() -> None:
    found = score("de+ipopt", [1.0, math.inf, 3.0], [1.0, math.inf, 1.0005])
    assert found.successes == 2
    assert found.expected_s == pytest.approx((1.0 + 30.0 + 3.0) / 2)
    assert score("de+ipopt", [math.inf], [2.0]).expected_s is None


def test_optima_are_confirmed_costs_that_differ_by_more_than_a_thousandth() -> None:
    costs = [1.0, 1.0005, 1.01, 1.0101, 2.0, math.inf]
    assert score("de+ipopt", [math.inf] * 6, costs).optima == 3


def test_finding_names_the_plain_method_if_it_is_as_good() -> None:
    always, never = [1.0] * 8, [math.inf] * 8
    costs = [1.0] * 8
    one = result(
        score("solve", always, costs),
        score("repeated-ipopt", [*always[1:], math.inf], costs),
        score("ipopt", never, costs),
    )
    said = finding([one], 10.0)
    assert "the default call (`solve`) comes within 0.1 %" in said
    assert "in 8 of 8 runs on 1 hard problems" in said
    first, _, alike = said.partition("Not shown to differ from")
    assert "IPOPT once (`ipopt`) in 0" in first
    assert "repeated-ipopt" in alike
    assert "`ipopt`" not in alike


def test_of_methods_with_equal_successes_the_faster_is_named() -> None:
    times = {"de+ipopt": [2.0, 2.0], "roadmap": [1.0, 2.0], "basin-hopping": [3.0, 3.0]}
    one = result(*(score(name, each, [1.0, 1.0]) for name, each in times.items()))
    assert "(`roadmap`) comes within" in finding([one], 10.0)


def test_a_better_cost_than_the_best_known_is_reported() -> None:
    assert result(known=1.0, best=0.9).is_better
    assert result(known=math.inf, best=5.0).is_better
    assert not result(known=1.0, best=1.0 - 1e-9).is_better
    one = result(score("solve", [1.0], [0.9]), known=1.0, best=0.9)
    said = "\n".join(page([one], seconds=10.0, seeds=1, command="it"))
    assert "Better than the file of best known values: `hard/walls_2` (0.9)" in said


def test_fresh_draws_have_the_sizes_of_the_shipped_problems(tmp_path: Path) -> None:
    paths = fresh_draws(tmp_path / "fresh", ["hard/walls_2", "hard/gears_6"], 102)
    assert [Path(one).name for one in paths] == [
        "walls_2_seed_102.yaml", "gears_6_seed_102.yaml"
    ]  # fmt: skip
    for path, name in zip(paths, ("walls_2", "gears_6"), strict=True):
        shipped, other = shipped_text(name), Path(path).read_text(encoding="utf-8")
        keys = [set(yaml.safe_load(text)) for text in (shipped, other)]
        assert shipped != other and keys[0] == keys[1]


def test_methods_on_fresh_draws_are_judged_by_the_best_found_there() -> None:
    one = result(
        score("solve", [1.0, 1.0], [0.9, 0.9]),
        score("ipopt", [math.inf, math.inf], [1.0, 1.0]),
        known=math.inf, best=0.9,
    )  # fmt: skip
    lines = fresh_section([one], seconds=2.0, seed=102)
    said = "\n".join(lines)
    assert "seed 102" in said and "in 2 of 2 runs" in said
    assert lines[-1] == "| walls_2 | 0.9 | 2 of 2 | 0 of 2 |"


def test_each_line_of_the_picture_looks_different() -> None:
    one = result(*(score(name, [1.0], [1.0]) for name in METHODS))
    lines = profile([one]).axes[0].lines
    named = {str(line.get_label()): line for line in lines}
    looks = {f"{line.get_color()} {vars(line)['_dash_pattern']}" for line in lines}
    assert [*named] == [*METHODS] and len(looks) == len(METHODS)
    assert all(named[peer].get_linestyle() != "-" for peer in PEERS)


def test_budgets_of_seconds_count_by_the_clock_that_is_given() -> None:
    box = Box(lower=np.full(2, -1.0), upper=np.full(2, 1.0))
    before, counts = time.perf_counter, []
    for step in (1e-3, 1e-2):
        ticks = itertools.count(step=step)
        with counted_by(partial(next, ticks)):
            found = minimize(
                lambda x: ((x**2).sum(axis=0), np.zeros(x.shape[1])), box,
                algorithm=DifferentialEvolution(), budget=Budget(seconds=1.0), seed=0,
            )  # fmt: skip
        counts.append(found.evaluations)
    assert time.perf_counter is before
    # Ten times as many readings of the clock.
    assert counts[0] > 5 * counts[1] > 0


def test_a_run_is_stopped_by_its_cpu_time_and_not_by_waiting() -> None:
    with cpu_limit(0.05):
        time.sleep(0.2)
    with pytest.raises(OverLimitError, match=r"more than 0\.05 s of CPU time"):
        with cpu_limit(0.05):
            while True:
                pass


def test_repair_counts_in_all_times() -> None:
    history = {"seconds": [1.0, 2.0], "cost": [3.0, 2.0]}
    told = {"repaired": True, "seconds": 2.0, "seconds_repair": 5.0, "history": history}
    found = with_repair(told)
    assert found["seconds"] == 7.0
    assert found["history"]["seconds"] == [6.0, 7.0]
    assert with_repair({**told, "repaired": False})["seconds"] == 2.0


def test_missing_package_of_a_peer_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    absent = PEERS["archipelago+ipopt"]._replace(package="no_such_package")
    monkeypatch.setitem(PEERS, "archipelago+ipopt", absent)
    with pytest.raises(MissingPackageError, match="needs no_such_package"):
        solver_named("archipelago+ipopt")


def test_every_method_has_a_cell_for_each_seed() -> None:
    pytest.importorskip("pygmo")
    entries = entries_of("hard/gears_6", [*METHODS], seeds=2, budget={"seconds": 1.0})
    assert [len(one.cells) for one in entries] == [1, *[2] * (len(METHODS) - 1)]
    keys = {cell.key for one in entries for cell in one.cells}
    assert len(keys) == 2 * len(METHODS) - 1


def test_success_needs_a_confirmed_cost_near_the_best_known_in_time() -> None:
    names, best = ["de+ipopt"], -14.698883604
    (entry,) = entries_of("hard/gears_6", names, seeds=6, budget={"seconds": 1.0})
    runs = [  # Cost, whether it is confirmed, first mark, whole run, and repair.
        (0.9995 * best, True, 0.25, 1.0, 0.0),
        (0.998 * best, True, 0.25, 1.0, 0.0),
        (1.5 * best, False, 0.25, 1.0, 0.0),
        (best, True, 3.25, 3.5, 2.5),
        (best, True, 2.25, 2.5, 1.5),
        (best, True, 1.5, 2.0, 0.0),
    ]
    outcomes = {}
    for cell, run in zip(entry.cells, runs, strict=True):
        cost, confirmed, mark, seconds, repair = run
        history = {
            "seconds": [mark], "evaluations": [1], "cost": [cost], "violation": [0.0]
        }  # fmt: skip
        told = {
            "sense": -1, "feasible": confirmed, "verified_cost": cost,
            "seconds": seconds, "evaluations": 1, "history": history,
            "repaired": repair > 0.0, "seconds_repair": repair,
        }  # fmt: skip
        outcomes[cell.key] = Outcome(
            result=told, failure="", seconds=seconds, folder=Path()
        )
    found = result_of([entry], outcomes, names=names, seeds=6, seconds=1.0)
    (one,) = found.scores
    assert one.times.tolist() == [0.25, *[math.inf] * 3, 2.25, math.inf]
    # Four failures of three seconds each.
    assert one.expected_s == pytest.approx((0.25 + 2.25 + 4 * 3.0) / 2)
    assert one.optima == 2
    assert not found.is_better
    assert any("14.69888" in line for line in problem_table(found))


def test_short_form_never_beats_the_best_known_values(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ticks = itertools.count(step=1e-3)  # A clock that counts its readings.
    monkeypatch.setattr(time, "process_time", lambda: next(ticks))
    results = []
    for problem in ("hard/gears_6", "hard/swing_up_30"):
        entries = entries_of(problem, NAMES, seeds=1, budget={"seconds": 0.1})
        outcomes = {}
        for entry in entries:
            (cell,) = entry.cells
            try:
                found, failure = solved(cell.job, tmp_path), ""
            except SwarmstartError as error:
                found, failure = {}, str(error)
            outcomes[cell.key] = Outcome(
                result=found or None, failure=failure, seconds=0.0, folder=tmp_path
            )
        results.append(result_of(entries, outcomes, names=NAMES, seeds=1, seconds=1.0))
    gears, swing = results
    assert gears.known == gears.best == pytest.approx(-14.698883604)
    assert [one.successes for one in gears.scores] == [1, 0]
    assert "whole numbers" in gears.scores[1].refusal
    # From zero controls IPOPT ends in another optimum; hops leave it.
    assert swing.scores[0].costs[0] > 1.5 * swing.known
    assert swing.scores[1].costs[0] < swing.scores[0].costs[0]
    assert not any(one.is_better for one in results)
    text = page(results, seconds=1.0, seeds=1, command="it")
    assert text[0] == finding(results, 1.0)
    assert any("whole numbers" in line for line in text)
    plot(results, tmp_path / "profiles.png")
    assert (tmp_path / "profiles.png").stat().st_size > 1000
