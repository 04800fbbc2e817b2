"""Measured answers: seconds until a hit, hits, and the log that goes on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmstart.benchmarks.answer_races import (
    has_several_optima,
    raced,
    seconds_until,
    way,
)
from swarmstart.benchmarks.answer_runs import (
    COLD,
    Amount,
    Log,
    Run,
    missing,
    shipped,
    wanted,
)
from swarmstart.benchmarks.answers import is_hit, main, page, worse

RUN = Run(
    problem="double_integrator", what="answer", number=0, lanes=None, cost=2.0,
    feasible=True, confirmed=True, process_s=1.0, wall_s=1.5,
)  # fmt: skip
LITTLE = Amount(
    seeds=1, most_seeds=1, solve_s=0, starts=2, most_starts=2, ipopt_s=0, repaired_s=0,
    longest_s=0,
)  # fmt: skip


def hits(run: Run) -> bool:
    """Return whether a run costs at most 2."""
    return run.cost <= 2.0


def test_seconds_until_a_hit_are_those_of_enough_runs() -> None:
    """Of runs that hit in one of two cases, 4.32 all miss with 5 %."""
    assert 0.5 ** (seconds_until(0.5, 1.0, 10)) == pytest.approx(0.05)
    assert seconds_until(1.0, 3.0, 10) == 3.0
    assert seconds_until(0.99, 3.0, 10) == 3.0
    # None of 10 hit with 5 %, where p is such that ten runs are wanted.
    assert seconds_until(0.0, 3.0, 10) == pytest.approx(30.0)


def test_spread_holds_the_seconds_of_the_law() -> None:
    rng = np.random.default_rng(0)
    hits = (rng.uniform(size=400) < 0.2).tolist()
    spent = rng.exponential(2.0, size=400).tolist()
    found = way(spent, hits)
    low, high = np.quantile(found.samples, [0.01, 0.99])
    assert low < seconds_until(0.2, 2.0, 400) < high
    assert low < found.seconds < high


def test_hit_is_the_best_known_or_better_in_the_problems_sense() -> None:
    assert is_hit(replace(RUN, cost=2.0001), 2.0, 1.0)
    assert not is_hit(replace(RUN, cost=2.0003), 2.0, 1.0)
    assert is_hit(replace(RUN, cost=1.9), 2.0, 1.0)
    assert not is_hit(replace(RUN, cost=1.9), 2.0, -1.0)
    assert is_hit(replace(RUN, cost=2.1), 2.0, -1.0)
    assert is_hit(replace(RUN, cost=-1.99999), -2.0, 1.0)
    assert not is_hit(replace(RUN, feasible=False), 2.0, 1.0)


def test_answer_is_worse_if_a_simpler_start_leads_to_less() -> None:
    better = replace(RUN, what="zero", cost=1.9)
    assert worse([RUN], [better], 1.0) == 1
    assert worse([RUN], [better], -1.0) == 0
    assert worse([RUN], [replace(better, feasible=False)], 1.0) == 0
    assert worse([RUN], [replace(RUN, what="zero", cost=2.0 - 1e-6)], 1.0) == 0
    assert worse([replace(RUN, tried={"the search": 1.9})], [], 1.0) == 1
    assert worse([replace(RUN, feasible=False)], [better], 1.0) == 1
    assert worse([RUN], [], 1.0) == 0


def test_what_is_asked_depends_on_how_often_ipopt_hits() -> None:
    starts = [replace(RUN, what="ipopt", cost=c) for c in (2.0, 3.0, 3.0, 3.0)]
    answers = [replace(RUN, found_s=1.5)] * 3
    seldom = raced(starts, [True, False, False, False], answers, [True] * 3)
    assert seldom.asked == "10 times less"
    # 1.5 log(0.05) / log(0.75) = 15.6 s.
    assert seldom.reached
    slow = [replace(RUN, found_s=1.6)] * 3
    late = raced(starts, [True, False, False, False], slow, [True] * 3)
    assert not late.reached
    often = raced(starts[:3], [True, False, False], slow, [True] * 3)
    assert often.asked == "not slower" and often.reached
    one = raced(starts[:1], [True], [replace(RUN, found_s=1.4, zero_s=1.0)], [True])
    assert one.asked == "at most 1.5 s" and one.reached
    dear = raced(starts[:1], [True], [replace(RUN, found_s=1.6, zero_s=1.0)], [True])
    assert not dear.reached
    assert has_several_optima(starts)
    assert not has_several_optima([*starts[1:], replace(RUN, cost=9.0, feasible=False)])


def test_log_goes_on_after_a_line_that_was_not_ended(tmp_path: Path) -> None:
    file = tmp_path / "out" / "runs.jsonl"
    log = Log(file)
    log.add(replace(RUN, cost=np.inf, tried={"the lanes": 2.0}))
    with file.open("a") as end:
        end.write('{"problem": "pend')
    again = Log(file)
    assert again.runs == log.runs
    again.add(replace(RUN, number=1))
    assert [run.number for run in Log(file).runs] == [0, 1]
    assert Log(file).of("double_integrator", "answer", 64) == []


def test_what_is_there_is_not_run_again(tmp_path: Path) -> None:
    log, name = Log(tmp_path / "runs.jsonl"), "double_integrator"
    one = shipped(name, 8)
    for run in missing(one, log, wanted(one, log, LITTLE, hits)):
        log.add(run)
    kinds = [run.what for run in log.runs]
    assert kinds == ["first", "zero", *["cold"] * COLD, "answer", *["ipopt"] * 2]
    exact = 12 / (1 - 1 / 20**2)
    assert [run.cost for run in log.runs] == pytest.approx([exact] * len(kinds))
    assert not list(missing(one, log, wanted(one, log, LITTLE, hits)))
    assert all(run.won for run in log.of(name, "answer", 8))
    rows = [line for line in page([name], log, 8) if line.startswith("| `double")]
    assert len(rows) == 2
    assert "| yes | 12.03008 | 12.03008 | 1 of 1 | 1 of 1 | 0 |" in rows[0]
    assert rows[1].endswith("| yes |") or rows[1].endswith("| **no** |")
    assert not [line for line in page([name], log, None) if line.startswith("| `")]


def test_broken_paths_are_solved_again_with_a_margin(tmp_path: Path) -> None:
    log, one = Log(tmp_path / "runs.jsonl"), shipped("double_integrator", None)
    log.add(RUN)
    assert "repaired" not in [kind.what for kind in wanted(one, log, LITTLE, hits)]
    log.add(replace(RUN, number=1, confirmed=False))
    kinds = {kind.what: kind for kind in wanted(one, log, Amount(), hits)}
    assert (kinds["repaired"].least, kinds["repaired"].most) == (3, 20)


def test_starts_that_seldom_hit_are_tried_for_longer(tmp_path: Path) -> None:
    """A solve takes 1.5 s: until 18 s, or the longest allowed."""
    log, one = Log(tmp_path / "runs.jsonl"), shipped("double_integrator", None)
    log.add(RUN)
    for number, cost in enumerate((2.0, 3.0, 3.0)):
        log.add(replace(RUN, what="ipopt", number=number, cost=cost))
    assert [k.what for k in wanted(one, log, Amount(), hits)].count("ipopt") == 1
    log.add(replace(RUN, what="ipopt", number=3, cost=3.0))
    *_, last = wanted(one, log, Amount(), hits)
    assert (last.what, last.least, last.seconds) == ("ipopt", 0, 18.0)
    *_, last = wanted(one, log, Amount(longest_s=5), hits)
    assert last.seconds == 5


def test_page_is_written_from_what_is_there(tmp_path: Path) -> None:
    written = tmp_path / "page.md"
    given = ["--only", "double_integrator", "--short", "--out", str(tmp_path)]
    assert main([*given, "--lanes", "8", "--write", str(written)]) == 0
    assert "but `lanes=8`" in written.read_text()
    assert written.read_text().count("| `double_integrator` |") == 2
