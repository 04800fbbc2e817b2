"""`swarmstart run --bound` and `compare --bound`, as a user types them."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from swarmstart.cases.campaign.running.finished_run import Interrupted
from swarmstart.cases.campaign.studies.library import run
from swarmstart.ocp import InvalidProblemError
from swarmstart.ocp.lower_bound.stated.answer import LowerBound
from swarmstart.tests.ocp.bounds import (
    NONE,
    PROVEN,
    SAMPLED,
    TRIVIAL,
    Found,
    with_evidence,
)

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

# The optimum is 12; a bound of 11.75 is 2.4 % below what 20 intervals reach.
NEAR = replace(PROVEN, value=11.75)
PLAN = (
    *("double_integrator", "--search", "none", "--set", "lanes=0"),
    *("--no-figures", "--quiet"),
)
FOUR = """\
kind: problem
states: {a: {start: 1, rate: b}, b: {start: 0, rate: c}, c: {start: 0, rate: d},
  d: {start: 0, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: a**2 + u**2
prediction: {horizon_s: 1, intervals: 4, substeps: 1}
search: {name: none}
lanes: 0
"""


def kept(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "run.json").read_text("utf-8"))
    return content


def test_the_bound_is_in_the_report_in_run_json_and_its_certificate_beside_it(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = Found(with_evidence(NEAR, monkeypatch)).instead(monkeypatch)
    said = command("run", *PLAN, "--bound", "2m", "--out", tmp_path / "a")
    assert said.code == 0 and said.err == ""
    line = "Bound: 11.75 proven; the optimum is at most 2.4 % below the answer"
    assert line in said.out.splitlines()
    assert f"Proof: {tmp_path / 'a' / 'bound_certificate.json'}" in said.out
    assert [call["work"] for call in found.calls] == [120.0]
    bound = kept(tmp_path / "a")["bound"]
    cost = 12 * 400 / 399
    assert bound["answer"] == pytest.approx(cost, rel=1e-6)
    assert bound["gap"] == pytest.approx((cost - 11.75) / cost, rel=1e-5)
    numbers = ("kind", "value", "degree", "slack", "boxes", "set", "seconds")
    told = tuple(bound[name] for name in numbers)
    assert told == ("proven", 11.75, 5, 1e-4, 1234, "a tube", 2.5)
    certificate = json.loads((tmp_path / "a" / "bound_certificate.json").read_text())
    assert certificate["of"] == "what the proof rests on"


@pytest.mark.parametrize(
    ("bound", "words"),
    [
        (TRIVIAL, "0 trivial (the least stage cost); the optimum is at most 100 % "),
        (SAMPLED, "sampled estimate 1.5 (no bound)"),
        (NONE, "none: 5 states, at most 3 are possible"),
    ],
)
def test_the_kind_is_always_said(
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    bound: LowerBound,
    words: str,
) -> None:
    Found(bound).instead(monkeypatch)
    said = command("run", *PLAN, "--bound", "9", "--out", tmp_path, "--json")
    told = json.loads(said.out)["bound"]
    assert told["kind"] == bound.kind.value and told["words"].startswith(words)
    assert (told["gap"] is None) == (not bound.kind.is_bound)
    assert not (tmp_path / "bound_certificate.json").exists()


def test_a_bound_changes_no_other_number_and_is_in_no_key(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same run without --bound keeps its earlier bound."""
    Found(with_evidence(NEAR, monkeypatch)).instead(monkeypatch)
    first = command("run", *PLAN, "--out", tmp_path, "--json")
    bounded = command("run", *PLAN, "--out", tmp_path, "--json", "--bound", "1s")
    again = command("run", *PLAN, "--out", tmp_path, "--json")
    one, two, three = (json.loads(said.out) for said in (first, bounded, again))
    assert one["bound"] is None and two["bound"] == three["bound"]
    assert two["documents"] == three["documents"] == ["bound_certificate.json"]
    assert one["key"] == two["key"] == three["key"]
    timed = ("plan_seconds", "step_seconds_median", "step_seconds_max")
    for name in timed:
        one["measures"].pop(name, None), two["measures"].pop(name, None)
    assert one["measures"] == two["measures"]
    # A bound without a proof replaces the certificate as well.
    Found(NONE).instead(monkeypatch)
    command("run", *PLAN, "--out", tmp_path, "--bound", "1s")
    assert not (tmp_path / "bound_certificate.json").exists()
    assert kept(tmp_path)["bound"]["kind"] == "none"


def test_a_bound_without_a_word_in_certificates_is_kept(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Found(with_evidence(NEAR, monkeypatch, fails=True)).instead(monkeypatch)
    said = command("run", *PLAN, "--bound", "1s", "--out", tmp_path)
    assert said.code == 0 and "Proof" not in said.out
    bound = kept(tmp_path)["bound"]
    assert (bound["value"], bound["certificate"]) == (11.75, None)


def test_another_run_in_the_folder_takes_the_certificate_away(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Found(with_evidence(NEAR, monkeypatch)).instead(monkeypatch)
    command("run", *PLAN, "--out", tmp_path, "--bound", "1s")
    assert command("run", *PLAN, "--out", tmp_path, "--seed", "3").code == 2
    assert (tmp_path / "bound_certificate.json").exists()
    said = command("run", *PLAN, "--out", tmp_path, "--seed", "3", "--force")
    assert said.code == 0 and kept(tmp_path)["bound"] is None
    assert not (tmp_path / "bound_certificate.json").exists()


def test_a_forged_bound_in_the_record_is_not_kept(
    command: Command, tmp_path: Path
) -> None:
    command("run", *PLAN, "--out", tmp_path)
    mark = tmp_path / "run.json"
    whole = kept(tmp_path)
    for forged in ("proven", 3, {"kind": "sure"}, {"kind": "proven", "value": "1"}):
        mark.write_text(json.dumps({**whole, "bound": forged}), encoding="utf-8")
        assert command("run", *PLAN, "--out", tmp_path).code == 0
        assert kept(tmp_path)["bound"] is None


@pytest.mark.parametrize("is_known", [True, False])
def test_interrupted_while_bounding_the_run_is_finished_and_kept(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_known: bool
) -> None:
    raises = None if is_known else KeyboardInterrupt()
    Found(NEAR, sent=signal.SIGINT, raises=raises).instead(monkeypatch)
    said = command("run", *PLAN, "--bound", "1h", "--out", tmp_path)
    assert said.code == 130
    assert (
        f"the run is finished and kept in {tmp_path}; its bound was interr" in said.err
    )
    bound = kept(tmp_path)["bound"]
    assert (bound["value"] if bound else None) == (11.75 if is_known else None)
    assert kept(tmp_path)["measures"]["cost"] == pytest.approx(12 * 400 / 399, rel=1e-6)


def test_in_python_the_finished_run_is_in_the_interrupt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Found(NEAR, sent=signal.SIGINT).instead(monkeypatch)
    settings = {"search.name": "none", "lanes": 0}
    with pytest.raises(Interrupted) as stopped:
        run("double_integrator", seed=0, settings=settings, bound=5.0)
    finished = stopped.value.run
    assert finished is not None and finished.bound is NEAR
    assert stopped.value.folder is None


@pytest.mark.parametrize("bound", [0, -1.0, float("nan"), "60", True])
def test_in_python_other_than_seconds_is_refused(bound: Any) -> None:
    with pytest.raises(InvalidProblemError, match="bound must be a positive number"):
        run("double_integrator", seed=0, bound=bound)


@pytest.mark.parametrize(
    "text", ["", "0", "-5", "nan", "5x", "1e99", "1.2.3", "5 evals"]
)
def test_what_is_no_length_of_time_is_refused(command: Command, text: str) -> None:
    for words in (("run", *PLAN), ("compare", "double_integrator")):
        said = command(*words, f"--bound={text}")
        assert said.code == 2
        assert f"expected a length of time such as 120s, 2m or 1h, found {text!r}" in (
            said.err
        )


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (
            ("formation_v",),
            "needs one plan, and this scenario has several agents that plan",
        ),
        (
            ("stirred_tank",),
            "needs one plan, and this scenario plans at 50 steps in closed",
        ),
        (
            (*PLAN, "--seeds", "2"),
            "expected --bound without --seeds: the bound is the same",
        ),
    ],
)
def test_a_bound_is_of_one_plan(
    command: Command, tmp_path: Path, words: tuple[str, ...], why: str
) -> None:
    """It is refused before the simulation, not after it."""
    said = command("run", *words, "--bound", "5s", "--out", tmp_path / "none")
    assert said.code == 2 and why in said.err
    assert not (tmp_path / "none").exists()


def test_the_page_shows_answer_bound_and_gap(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Found(NEAR).instead(monkeypatch)
    command("run", *PLAN, "--out", tmp_path, "--bound", "1s")
    assert command("report", tmp_path).code == 0
    words = "11.75 proven; the optimum is at most 2.4 % below the answer"
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count(words) == 2  # In the headline and among the facts.
    assert "polynomials of degree 5 on a tube" in page
    Found(SAMPLED).instead(monkeypatch)
    command("run", *PLAN, "--out", tmp_path, "--bound", "1s")
    assert command("report", tmp_path).code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "; sampled estimate 1.5 (no bound);" in page


def test_a_comparison_has_bounds_in_cells_of_their_own(
    command: Command, tmp_path: Path
) -> None:
    """The problem has no bound, so that the test does not wait for a proof."""
    file = tmp_path / "four.yaml"
    file.write_text(FOUR, encoding="utf-8")
    words = (
        *("compare", file, "--solvers", "ipopt", "--seeds", "1", "--quiet"),
        *("--budget", "200evals", "--workers", "1"),
    )
    said = command(*words, "--bound", "5s", "--out", tmp_path / "a", "--json")
    assert said.code == 0
    content = json.loads(said.out)
    (bound,) = [scenario["bound"] for scenario in content["scenarios"]]
    assert (bound["kind"], bound["value"], bound["gap"]) == ("none", None, None)
    assert bound["words"].startswith("none: ")
    marks = {
        (mark := json.loads(cell.read_text("utf-8")))["work"].partition(":")[2]: mark
        for cell in tmp_path.glob("a/cells/*/cell.json")
    }
    own, solved = marks["bound_cell"], marks["solve_cell"]
    best = content["scenarios"][0]["best_cost"]
    assert own["job"]["known"] == pytest.approx(best, rel=1e-12)
    assert own["job"]["seconds"] == 5.0 and solved["failure"] == own["failure"] == ""
    # The same again does nothing anew; without --bound the runs are the same ones.
    times = {f: f.stat().st_mtime_ns for f in tmp_path.glob("a/cells/*/cell.json")}
    text = command(*words, "--bound", "5s", "--out", tmp_path / "a")
    assert "  bound: none: " in text.out
    without = command(*words, "--out", tmp_path / "a", "--json")
    assert json.loads(without.out)["scenarios"][0]["bound"] is None
    assert times == {
        f: f.stat().st_mtime_ns for f in tmp_path.glob("a/cells/*/cell.json")
    }
    dry = command(*words, "--bound", "5s", "--out", tmp_path / "a", "--dry-run")
    assert dry.out.splitlines()[-1] == "then 1 lower bound, 5 s each"
    assert command("report", tmp_path / "a").code == 0
