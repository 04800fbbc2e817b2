"""Faults are drawn with a seed, tried in a copy, and counted; 200 are not run here."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from swarmstart.benchmarks import faults
from swarmstart.benchmarks.faults import (
    HARMLESS,
    ROOT,
    Drawn,
    Outcome,
    all_faults,
    copied,
    drawn,
    outcome_of,
    report,
    soundness_files,
)

TOY = "def sign(x):\n    return 1 if x > 0 else -1\n"
TOY_TEST = """
import importlib.util, pathlib
path = pathlib.Path(__file__).parent.parent / "toy.py"
spec = importlib.util.spec_from_file_location("toy", path)
toy = importlib.util.module_from_spec(spec)
spec.loader.exec_module(toy)
def test_sign():
    assert toy.sign(3) == 1 and toy.sign(-3) == -1
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """Return a folder with a module whose test does not look at the edge."""
    (tmp_path / "toy.py").write_text(TOY)
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_toy.py").write_text(TOY_TEST)
    return tmp_path


def test_same_seed_draws_the_same_faults_of_different_places() -> None:
    places = all_faults(ROOT, soundness_files(ROOT, ["ocp/*"]))
    one, same, other = (
        drawn(places, 40, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert one == same != other
    assert len({(d.file, d.fault.start) for d in one}) == 40


def test_proofs_statuses_and_verdicts_are_all_drawn_from() -> None:
    files = soundness_files(ROOT)
    assert {
        "terminal_set/proving/proof.py",
        "ocp/answer/solution.py",
        "cases/campaign/studies/verdicts.py",
    } < {*files}
    assert any(file.startswith("terminal_set/checker/") for file in files)
    for group in faults.FILES.values():  # A module that has moved leaves no gap.
        assert all(list(ROOT.glob(pattern)) for pattern in group)


def test_every_file_with_a_fault_has_tests() -> None:
    for file in {
        d.file for place in all_faults(ROOT, soundness_files(ROOT)) for d in place
    }:
        assert faults.tests_of(ROOT, file)


def test_harmless_faults_are_still_in_the_code() -> None:
    known = {
        (d.file, d.before) for p in all_faults(ROOT, soundness_files(ROOT)) for d in p
    }
    assert {(file, before) for file, before, _, _ in HARMLESS} <= known


@pytest.mark.parametrize(
    ("faulty", "outcome"),
    [
        (TOY.replace("x > 0", "x <= 0"), Outcome.CAUGHT),
        (TOY.replace("x > 0", "x >= 0"), Outcome.SURVIVED),
        ("def sign(x):\n    while True:\n        pass\n", Outcome.ENDLESS),
    ],
)
def test_fault_is_caught_if_the_tests_fail(
    toy: Path, faulty: str, outcome: Outcome
) -> None:
    limit_s = 2.0 if outcome is Outcome.ENDLESS else 60.0
    assert outcome_of(toy, "toy.py", faulty, ["tests/test_toy.py"], limit_s) is outcome
    assert (toy / "toy.py").read_text() == TOY  # The next fault meets the right text.


def test_tests_that_fail_without_a_fault_judge_nothing(toy: Path) -> None:
    (toy / "toy.py").write_text(TOY.replace(">", "<"))
    with pytest.raises(RuntimeError, match="without a fault"):
        faults.limits(toy, ["toy.py"])


def test_copy_has_links_and_new_files_and_nothing_ignored(
    toy: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    subprocess.run(["git", "init", "-q"], cwd=toy, check=True)
    (toy / ".gitignore").write_text("heavy\n")
    (toy / "heavy").write_text("")
    (toy / "here").symlink_to(".")
    copy = copied(toy, tmp_path_factory.mktemp("copy"))
    assert (copy / "toy.py").read_text() == TOY
    assert (copy / "here").is_symlink()
    assert not (copy / "heavy").exists()


def test_report_counts_what_was_caught_but_not_what_is_harmless() -> None:
    (first, *_), *_ = all_faults(ROOT, ["ocp/answer/multistart.py"])
    outcomes = [Outcome.CAUGHT] * 8 + [Outcome.ENDLESS, Outcome.SURVIVED]
    text = report([first] * 11, [*outcomes, Outcome.HARMLESS])
    # Wilson's interval of 9 in 10, from the formula: (0.9 + 1.9207 / 10 +- ...).
    assert "caught 9 of 10, 90.0% (Wilson, 95 %: 59.6% to 98.2%); 1 of them" in text
    assert "| constant | 10 | 9 | 1 |" in text


def test_listed_reason_makes_a_fault_harmless(monkeypatch: pytest.MonkeyPatch) -> None:
    (one, *_), *_ = all_faults(ROOT, ["ocp/answer/multistart.py"])
    assert not faults.reason_of(one)
    for after, applies in ((one.after, True), ("*", True), ("another", False)):
        listed = ((one.file, one.before, after, "text"),)
        monkeypatch.setattr(faults, "HARMLESS", listed)
        assert (faults.reason_of(one) == "text") is applies
    elsewhere: Drawn = one._replace(file="ocp/rollout/path.py")
    assert not faults.reason_of(elsewhere)
