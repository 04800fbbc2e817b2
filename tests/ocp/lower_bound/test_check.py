"""The checker of lower bounds: what holds is proven again, what was changed is not."""

from __future__ import annotations

import copy
import json
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.ocp.lower_bound.check import main
from swarmstart.ocp.lower_bound.stated.answer import Evidence
from swarmstart.terminal_set.checker.file_content import digest
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand

Content = dict[str, Any]
Check = Callable[..., tuple[int, str]]


@pytest.fixture
def check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Check:
    """Write a certificate, check it, return the exit code and all that was said."""

    def run(content: Content | str, seconds: float = 20.0) -> tuple[int, str]:
        file = tmp_path / "certificate.json"
        text = content if isinstance(content, str) else json.dumps(content)
        file.write_text(text)
        code = main([str(file), "--seconds", str(seconds)])
        said = capsys.readouterr()
        return code, said.out + said.err

    return run


def content_of(evidence: Evidence) -> Content:
    content: Content = certificate_content(evidence)
    return content


def changed(
    evidence: Evidence, *path: str | int, to: object = None, by: float = 0.0
) -> Content:
    """A certificate with one entry replaced or raised, and a new digest."""
    content = copy.deepcopy(content_of(evidence))
    *way, last = path
    entry: Any = content
    for key in way:
        entry = entry[key]
    entry[last] = entry[last] + by if by else to
    content["sha256"] = digest(content)
    return content


@pytest.mark.parametrize("evidence", by_hand.ALL)
def test_what_follows_by_hand_is_proven_again(
    check: Check, evidence: Callable[[], Evidence]
) -> None:
    code, said = check(content_of(evidence()))
    assert code == 0, said
    assert "refused" not in said
    assert said.splitlines()[-1].startswith("verdict: proven again: no admissible")


def test_the_bound_is_close_to_the_optimum_where_v_is_the_cost_to_go(
    check: Check,
) -> None:
    _, said = check(content_of(by_hand.quadratic()))
    assert float(said.split()[-1]) == pytest.approx(1.0, abs=3 * by_hand.TINY)


def test_a_maximised_cost_is_said_in_its_own_sense(check: Check) -> None:
    _, said = check(changed(by_hand.quadratic(), "problem", "sense", to=-1.0))
    assert "no admissible answer is worth more than -0.99999" in said


FINAL = ("final", "polynomial", "coefficients")
FALSE: dict[str, Callable[[], Content]] = {
    "bound above V by one part in a million": lambda: changed(
        by_hand.quadratic(), "bound", by=1e-6
    ),
    "bound above the known cost": lambda: changed(by_hand.pruned(), "known", to=0.19),
    "larger V": lambda: changed(by_hand.quadratic(), *FINAL, 0, by=1e-4),
    "steeper V": lambda: changed(by_hand.quadratic(), *FINAL, 1, by=1e-2),
    "V_t of the other sign": lambda: changed(
        by_hand.riccati(), "final", "polynomial", "half", 0, to=-2.0
    ),
    "V that grows in time": lambda: changed(by_hand.riccati(), *FINAL, -1, by=2.4),
    "smaller slack": lambda: changed(by_hand.slackened(), "final", "slack", to=0.99e-3),
    "smaller end slack": lambda: changed(
        by_hand.least_time(), "final", "end_slack", to=6e-4
    ),
    "level below the initial state": lambda: changed(
        by_hand.quadratic(), "tube", "levels", 0, 0, to=0.99
    ),
    "face too slow": lambda: changed(
        by_hand.quadratic(), "tube", "levels", 1, 0, by=-2e-3
    ),
    "face of one of two states too slow": lambda: changed(
        by_hand.least_time(), "tube", "levels", 1, 3, by=-5e-3
    ),
    "tube that ends early": lambda: changed(
        by_hand.quadratic(), "tube", "times", 1, to=0.9
    ),
    "tube that begins late": lambda: changed(
        by_hand.quadratic(), "tube", "times", 0, to=0.1
    ),
    "later end": lambda: changed(
        by_hand.quadratic(), "problem", "horizon", to=[1.0, 1.1]
    ),
    "wider controls": lambda: changed(
        by_hand.quadratic(), "problem", "control_box", "upper", 0, to=2.1
    ),
    "no bounds of the states": lambda: changed(
        by_hand.constrained(), "problem", "state_box", "lower", to=[None]
    ),
    "no path constraint": lambda: changed(
        by_hand.constrained(), "problem", "path", to=[]
    ),
    "no prunings": lambda: (
        changed(by_hand.pruned(), "prunings", to=[])
        | {"statements": content_of(by_hand.quadratic())["statements"]}
    ),
    "known cost that leaves too much": lambda: changed(
        by_hand.pruned(), "known", to=1.8
    ),
    "C that is no lower bound": lambda: changed(
        by_hand.pruned(),
        "prunings",
        0,
        "come",
        "polynomial",
        "coefficients",
        1,
        by=-1.0,
    ),
    "G that is no lower bound": lambda: changed(
        by_hand.pruned(), "prunings", 0, "go", "polynomial", "coefficients", 0, by=0.1
    ),
}


@pytest.mark.parametrize("attack", FALSE.values(), ids=FALSE)
def test_what_is_false_is_not_proven_with_a_new_digest(
    check: Check, attack: Callable[[], Content]
) -> None:
    content = attack()
    content["sha256"] = digest(content)
    code, said = check(content, 5.0)
    assert code in (2, 3), said
    assert "digest" not in said


def test_a_counterexample_is_shown(check: Check) -> None:
    content = changed(by_hand.slackened(), "final", "slack", to=0.99e-3)
    code, said = check(content)
    assert code == 3
    assert "of the final step: (t, x) = (" in said


def test_a_path_constraint_of_the_other_sign_is_refused(check: Check) -> None:
    content = content_of(by_hand.constrained())
    tape = content["problem"]["tape"]
    number = content["problem"]["path"][0]
    content["problem"]["tape"] = [*tape, ["neg", number]]
    content["problem"]["path"] = [len(tape)]
    content["sha256"] = digest(content)
    assert check(content)[0] == 3


def test_a_dropped_slab_is_refused(check: Check) -> None:
    content = content_of(by_hand.quadratic())
    tube = content["tube"]
    first, last = (np.array(row) for row in tube["levels"])
    tube["times"] = [0.0, 0.5, 1.0]
    tube["levels"] = [first.tolist(), ((first + last) / 2).tolist(), last.tolist()]
    content["sha256"] = digest(content)
    assert check(content)[0] == 0
    for i in range(3):
        content["tube"] = {**tube}
        for key in ("times", "levels"):
            content["tube"][key] = [row for j, row in enumerate(tube[key]) if j != i]
        content["sha256"] = digest(content)
        assert check(content)[0] == (0 if i == 1 else 3)


def test_every_number_changed_is_refused_by_the_digest(check: Check) -> None:
    for path in [("bound",), ("known",), (*FINAL, 0), ("tube", "levels", 0, 1)]:
        content = changed(by_hand.pruned(), *path, by=1e-15)
        content["sha256"] = content_of(by_hand.pruned())["sha256"]
        code, said = check(content)
        assert (code, "digest" in said) == (3, True), path


UNUSABLE: dict[str, tuple[tuple[str | int, ...], object]] = {
    "negative slack": (("final", "slack"), -1e-9),
    "negative end slack": (("final", "end_slack"), -1e-9),
    "no end slack": (("final", "end_slack"), None),
    "no known cost": (("known",), None),
    "huge coefficient": ((*FINAL, 0), 1e31),
    "huge integer": (("bound",), 10**400),
    "truth for a number": (("bound",), True),
    "text for a number": (("bound",), "1.0"),
    "width of 0": (("final", "polynomial", "half", 0), 0.0),
    "huge exponent": (("final", "polynomial", "exponents", 0, 0), 10**9),
    "negative exponent": (("final", "polynomial", "exponents", 0, 0), -1),
    "product given twice": (("final", "polynomial", "exponents", 0), [0, 2]),
    "unknown operation": (("problem", "tape", 1), ["eval", 0]),
    "cyclic operand": (("problem", "tape", 1), ["sq", 1]),
    "later operand": (("problem", "tape", 1), ["sq", 2]),
    "unknown state": (("problem", "tape", 0), ["x", 1]),
    "unknown control": (("problem", "tape", 0), ["u", 1]),
    "second time": (("problem", "tape", 0), ["t", 1]),
    "constant that is a text": (("problem", "tape", 0), ["const", "__import__"]),
    "no instruction": (("problem", "tape", 0), []),
    "times in disorder": (("tube", "times"), [1.0, 0.0]),
    "one time": (("tube", "times"), [0.0]),
    "face that is no axis": (("tube", "directions", 0), [2.0]),
    "face without direction": (("tube", "directions"), [[1.0], [-1.0], [0.0]]),
    "bounds the wrong way round": (("problem", "control_box", "lower", 0), 3.0),
    "horizon the wrong way round": (("problem", "horizon"), [1.0, 0.5]),
    "sense of 2": (("problem", "sense"), 2),
    "other version": (("version",), 2),
    "words of its own": (("statements", 0, "statement"), "the bound is tight"),
    "grounds of its own": (("statements", 0, "grounds"), "proven, by me"),
    "too many states": (("problem", "n"), 100),
    "deep nesting": (("final", "polynomial"), {"a": [[[[[[[[1]]]]]]]]}),
}


@pytest.mark.parametrize(("path", "value"), UNUSABLE.values(), ids=UNUSABLE)
def test_what_cannot_be_judged_is_unusable(
    check: Check, path: tuple[str | int, ...], value: object
) -> None:
    code, said = check(changed(by_hand.pruned(), *path, to=value))
    assert code == 2, said
    assert "cannot be used" in said


@pytest.mark.parametrize("name", ["end", "path", "ends"])
def test_an_end_or_a_constraint_of_a_control_is_unusable(
    check: Check, name: str
) -> None:
    number = content_of(by_hand.quadratic())["problem"]["stage"]
    value = number if name == "end" else [number]
    code, said = check(changed(by_hand.quadratic(), "problem", name, to=value))
    assert code == 2
    assert "a value without controls" in said


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_are_unusable(check: Check, number: str) -> None:
    text = json.dumps(content_of(by_hand.pruned()) | {"bound": 123456.0})
    assert check(text.replace("123456.0", number))[0] == 2


def test_a_key_given_twice_is_unusable(check: Check) -> None:
    text = json.dumps(content_of(by_hand.pruned()))
    assert check(text.replace('"version": 1', '"version": 1, "version": 1'))[0] == 2


def test_every_missing_key_is_unusable(check: Check) -> None:
    content = content_of(by_hand.pruned())
    ways: list[tuple[str | int, ...]] = [(), ("problem",), ("tube",), ("final",)]
    ways += [("final", "polynomial"), ("problem", "state_box"), ("prunings", 0)]
    for way in ways:
        entry: Any = content
        for key in way:
            entry = entry[key]
        for name in entry:
            broken: Any = copy.deepcopy(content)
            inner = broken
            for key in way:
                inner = inner[key]
            del inner[name]
            if name != "sha256":
                broken["sha256"] = digest(broken)
            assert check(broken)[0] == 2, (way, name)


def test_nesting_beyond_the_stack_is_unusable(check: Check) -> None:
    depth = 100_000
    assert check('{"format": ' + "[" * depth + "]" * depth + "}")[0] == 2


def test_a_certificate_with_the_format_of_another_is_unusable(check: Check) -> None:
    content = content_of(by_hand.quadratic())
    content["format"] = "swarmstart terminal set certificate"
    content["sha256"] = digest(content)
    code, said = check(content)
    assert code == 2
    assert 'the file: expected the key "K"' in said
    content["format"] = "swarmstart report"
    code, said = check(content)
    assert code == 2
    assert 'none of "swarmstart terminal set certificate", "swarmstart lower' in said


def test_an_unreadable_file_has_a_code_of_its_own(tmp_path: Path) -> None:
    assert main([str(tmp_path / "missing.json")]) == 5


@pytest.mark.skipif(sys.platform == "win32", reason="no named pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert main([str(pipe)]) == 2


def test_too_little_time_leaves_it_undecided(check: Check) -> None:
    code, said = check(content_of(by_hand.steered()), 1e-9)
    assert code == 4
    assert "verdict: undecided within 1e-09 s" in said


def test_where_floats_end_it_is_undecided(check: Check) -> None:
    # Equality without slack: no arithmetic with rounding can tell.
    content = changed(by_hand.quadratic(), "final", "slack", to=0.0)
    content["bound"] = 0.99
    content["sha256"] = digest(content)
    code, _ = check(content, 1.0)
    assert code == 4


def test_values_that_overflow_are_never_proven(check: Check) -> None:
    content = content_of(by_hand.quadratic())
    tape = content["problem"]["tape"]
    for _ in range(12):
        tape.append(["sq", len(tape) - 1])
    content["problem"]["stage"] = len(tape) - 1
    content["sha256"] = digest(content)
    assert check(content, 1.0)[0] in (3, 4)


def test_the_words_are_those_of_the_writer(check: Check) -> None:
    for evidence in (by_hand.quadratic(), by_hand.pruned()):
        assert check(content_of(evidence))[0] == 0


def test_a_second_file_is_refused_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["a", "\x1b[31m"])
    assert stopped.value.code == 2
    assert "\x1b" not in capsys.readouterr().err


def test_seconds_must_be_above_zero() -> None:
    for text in ("0", "-1", "nan", str(math.inf)):
        with pytest.raises(SystemExit):
            main(["a", f"--seconds={text}"])
