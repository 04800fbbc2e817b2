"""Every wrong scenario gives a clear message with its place, and nothing else."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.format.registry import KINDS
from swarmstart.cases.format.scenario import shipped
from swarmstart.heuristics import SEARCHES

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

Change = Callable[[str, str], Path]

PYDANTIC = re.compile(r"Input should|validation|Value error|instance of|[Tt]raceback")
SINGULAR = "P: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]]"


def messages(error: str) -> list[str]:
    """Return the messages without the lines and carets they show."""
    return [line for line in error.splitlines() if line[5:7] != " |"]


# What is wrong: (text of formation_v, what replaces it, the text at the place that is
# named, what is said).
FLAWS = {
    "a misspelt key": (
        "planning_order:",
        "planing_order:",
        "planing_order:",
        "expected a known key, found 'planing_order'; did you mean 'planning_order'?",
    ),
    "a wrong type": (
        "x_m: 30, y_m: 60",
        "x_m: [30], y_m: 60",
        "[30]",
        "expected leader.x_m to be a number, or an expression such as pi/18; "
        "found [30]",
    ),
    "text for a whole number": (
        "steps: 60",
        "steps: sixty",
        "sixty",
        "expected steps to be an integer; found 'sixty'",
    ),
    "a fraction for a whole number": (
        "steps: 60",
        "steps: 60.5",
        "60.5",
        "expected steps to be an integer; found 60.5",
    ),
    "a negative duration": (
        "steps: 60",
        "steps: -5",
        "-5",
        "expected steps to be at least 1; found -5",
    ),
    "a zero interval": (
        "horizon_s: 8 ",
        "horizon_s: 0 ",
        "0 ",
        "expected prediction.horizon_s to be greater than 0; found 0",
    ),
    "two UAVs in the same place": (
        "x_m: 5, y_m: 75",
        "x_m: 5, y_m: 65",
        "{speed_m_s: 15, heading_rad: 0, x_m: 5, y_m: 65}\n    slot: {x_m: -15",
        "expected a start at least 3 m (safe_distance_m) from that of UAV 1, found 0 m",
    ),
    "two slots in the same place": (
        "slot: {x_m: -15, y_m: 15}",
        "slot: {x_m: 0, y_m: 0}",
        "{x_m: 0, y_m: 0}\n  - start: {speed_m_s: 15, heading_rad: 0, x_m: 5, y_m: 85}",
        "expected a slot at least 3 m (safe_distance_m) from that of UAV 1, found 0 m",
    ),
    "a start inside an obstacle": (
        "planning_order:",
        "obstacles: [{x_m: 5, y_m: 46, radius_m: 5}]\nplanning_order:",
        "{speed_m_s: 15, heading_rad: 0, x_m: 5, y_m: 45}",
        "expected a start outside the obstacle of radius 5 m, found 1 m from its "
        "centre",
    ),
    "not a number": (
        "x_m: 30,",
        "x_m: .nan,",
        ".nan",
        "expected a finite number, found '.nan'",
    ),
    "an unknown search": (
        "name: cpso",
        "name: cspo",
        "cspo",
        f"expected name to be one of default, {', '.join(SEARCHES)}, memetic, "
        "multistart, none; found 'cspo'",
    ),
    "no search's name": (
        "  name: cpso\n",
        "",
        "size: 20",
        f"expected name to be one of default, {', '.join(SEARCHES)}, memetic, "
        "multistart, none; found none",
    ),
    "an unknown setting of the search": (
        "inertia_min:",
        "inertia_mim:",
        "inertia_mim:",
        "expected a known key, found 'inertia_mim'; did you mean 'inertia_min'?",
    ),
    "a setting of the search out of range": (
        "  size: 20",
        "  size: 1",
        "1\n",
        "expected search.size to be an integer of at least 2; found 1",
    ),
    "a population that does not fit into memory": (
        "  size: 20",
        "  size: 300000",
        "300000",
        "expected at most 200000 individuals; found 300000",
    ),
    "a place beyond all bounds": (
        "x_m: 5, y_m: 75",
        "x_m: 1e200, y_m: 75",
        "1e200",
        "expected uavs.1.start.x_m to be at most 1e+30; found 1e+200",
    ),
    "a misspelt kind": (
        "kind: formation_flight",
        "kindx: formation_flight",
        "kindx",
        "expected a known key, found 'kindx'; did you mean 'kind'?",
    ),
    "a budget of less than a generation": (
        "evaluations: 4000",
        "evaluations: 19",
        "19",
        "expected at least 20, one generation of the search; found 19",
    ),
    "an expression with an unknown name": (
        "[-pi/18, pi/18]",
        "[-pi/18, pie/18]",
        "pie/18",
        "expression 'pie/18', column 1: unknown name 'pie': did you mean 'pi'?",
    ),
    "an expression without a value": (
        "x_m: 30,",
        "x_m: 30 - 1/0,",
        "1/0",
        "expression '30 - 1/0', column 6: expected a finite real value, found '/' of "
        "1.0, 0.0",
    ),
    "a key given twice": (
        "polish: none",
        "polish: none\nsteps: 3",
        "steps: 3",
        "expected each key once, found 'steps' again (first at {file}:11:1)",
    ),
    "an alias": (
        "leader: {",
        "leader: *bomb {",
        "*bomb",
        "expected plain data, found the alias '*bomb': write the value out, or quote "
        "it",
    ),
    "an unknown kind": (
        "kind: formation_flight",
        "kind: formation_fight",
        "formation_fight",
        f"expected kind to be one of {', '.join(KINDS)}; found 'formation_fight'",
    ),
    "a kind that is a list": (
        "kind: formation_flight",
        "kind: [formation_flight]",
        "[formation_flight]",
        f'expected kind to be one of {", ".join(KINDS)}; found ["formation_flight"]',
    ),
    "a planning order that leaves one out": (
        "planning_order: highest_first",
        "planning_order: [1, 1, 2, 3, 4]",
        "[1, 1, 2",
        "expected the number of each of the 5 UAVs once, found [1, 1, 2, 3, 4]",
    ),
    "an invalid planning order": (
        "planning_order: highest_first",
        "planning_order: alphabetic",
        "alphabetic",
        "expected planning_order to be 'highest_first' or 'lowest_first' or a list; "
        "found 'alphabetic'",
    ),
    "reversed bounds": (
        "[-5, 5]",
        "[5, -5]",
        "[5, -5]",
        "expected lower < upper, found [5, -5]",
    ),
    "controls that exclude the leader's": (
        "[-5, 5]",
        "[1, 5]",
        "[1, 5]",
        "expected 0, the leader's own, strictly within the range; found [1, 5]",
    ),
    "half a range": (
        "[-5, 5]",
        "[-5]",
        "[-5]",
        "expected a list of two numbers, [lower, upper]; found [-5]",
    ),
    "a zero in R": (
        "R: [1, 1]",
        "R: [1, 0]",
        "0]",
        "expected weights.R.1 to be greater than 0; found 0",
    ),
    "weights too few": (
        "Q: [1, 1, 1, 1]",
        "Q: [1, 1, 1]",
        "[1, 1, 1]",
        "expected weights.Q to be a list of at least 4 entries; found [1, 1, 1]",
    ),
    "weights that leave a mode free": (
        "Q: [1, 1, 1, 1]",
        "Q: [1, 1, 0, 0]",
        "Q: [1, 1, 0, 0]",
        "expected a linear law that can be designed: Q must weigh every mode",
    ),
    "P of the wrong shape": (
        "      design: riccati ",
        "      design: given\n      P: [[1, 0], [0, 1]] # ",
        "[[1, 0], [0, 1]]",
        "expected a 4 x 4 matrix, found rows of [2, 2]",
    ),
    "P not positive definite": (
        "      design: riccati ",
        f"      design: given\n      {SINGULAR} # ",
        "[[1, 0, 0, 0]",
        "expected a positive definite matrix, found the eigenvalue 0",
    ),
    "P not given": (
        "      design: riccati ",
        "      design: given ",
        "design: given ",
        "expected the key P, a 4 x 4 matrix, with this design",
    ),
    "a missing key": (
        "    slot: {x_m: 0, y_m: 0}\n",
        "",
        "start: {speed_m_s: 15, heading_rad: 0, x_m: 5, y_m: 65}",
        "expected the key 'slot'",
    ),
    "a claim on an unknown measure": (
        "measure: settle_time_s",
        "measure: settle_time",
        "settle_time\n",
        "expected a measure, found 'settle_time'; did you mean 'settle_time_s'?",
    ),
    "a leader out of its bounds": (
        "leader: {speed_m_s: 15",
        "leader: {speed_m_s: 45",
        "45,",
        "expected a speed strictly within vehicle.speed_m_s [1, 40], found 45",
    ),
    "a UAV out of its bounds": (
        "start: {speed_m_s: 15",
        "start: {speed_m_s: 0.5",
        "0.5,",
        "expected a speed within vehicle.speed_m_s [1, 40], found 0.5",
    ),
    "no variants in variants": (
        "variants:\n",
        "variants: []\nmore:\n",
        "[]\nmore",
        "expected a mapping of names to overrides, found []",
    ),
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flaw_is_said_once_at_its_place(
    flaw: str, command: Command, changed: Change
) -> None:
    old, new, there, what = FLAWS[flaw]
    file = changed(old, new)
    said = command("run", file)
    assert (said.code, said.out) == (2, "")
    (message,) = messages(said.err)
    assert what.format(file=file) in message
    assert text_at(file, message).startswith(there)
    assert not PYDANTIC.search(said.err)


def text_at(file: Path, message: str) -> str:
    """Return the text of a file from the place that a message names."""
    found = re.match(rf"{re.escape(str(file))}:(\d+):(\d+): ", message)
    assert found, message
    line, column = map(int, found.groups())
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    return "".join(lines[line - 1 :])[column - 1 :]


def test_every_flaw_is_said_in_the_order_of_the_file(
    command: Command, changed: Change, shipped_text: str
) -> None:
    file = changed("steps: 60", "steps: -5")
    text = file.read_text(encoding="utf-8")
    text = text.replace("  size: 20", "  size: many").replace("horizon_s: 8 ", "dt: 1 ")
    file.write_text(text.replace("[-pi/18, pi/18]", "[a, b]"), encoding="utf-8")
    said = command("check", file)
    lines = [int(m.removeprefix(f"{file}:").split(":")[0]) for m in messages(said.err)]
    assert said.code == 2 and lines == sorted(lines)
    assert [text_at(file, m).split()[0] for m in messages(said.err)] == [
        "-5",
        "a,",
        "b]",
        "dt:",
        "many",
    ]


# --- files

BOMB = "a: &a [x, x, x, x]\n" + "".join(
    f"{now}: &{now} [*{last}, *{last}, *{last}, *{last}]\n"
    for last, now in zip("abcdefghijkl", "bcdefghijklm", strict=True)
)


@pytest.mark.parametrize(
    ("make", "code", "what"),
    [
        (lambda file: None, 5, "expected a readable file, found: No such file"),
        (lambda file: file.mkdir(), 5, "expected a readable file, found a directory"),
        (os.mkfifo, 5, "found a pipe or a device"),
        (lambda file: file.touch(), 2, ":1:1: expected a mapping of keys to values, "),
        (lambda file: file.write_text("# only"), 2, "found nothing but comments"),
        (
            lambda file: file.write_bytes(b"\x7fELF\x00"),
            2,
            "found the character U+007F",
        ),
        (lambda file: file.write_bytes(b"a: \xff"), 2, ":1:4: expected UTF-8 text"),
        (lambda file: file.write_text("[" * 10_000), 2, "at most 32 collections"),
        (lambda file: file.write_text("a: [b"), 2, "expected ',' or ']'"),
        (lambda file: file.write_text("- 1"), 2, "at the top level, found a list"),
        (lambda file: file.write_text(BOMB), 2, "found the anchor '&a'"),
    ],
    ids=[
        "missing",
        "directory",
        "pipe",
        "empty",
        "comments",
        "binary",
        "not UTF-8",
        "deep",
        "not closed",
        "a list",
        "alias bomb",
    ],
)
def test_a_file_that_is_no_scenario_is_refused(
    make: Callable[[Path], object],
    code: int,
    what: str,
    command: Command,
    tmp_path: Path,
) -> None:
    file = tmp_path / "wrong.yaml"
    make(file)
    said = command("run", file)
    assert (said.code, said.out) == (code, "")
    (message,) = messages(said.err)
    assert str(file) in message and what in message


def test_a_sparse_file_of_100_megabytes_is_refused_unread(
    command: Command, tmp_path: Path
) -> None:
    file = tmp_path / "large.yaml"
    with file.open("wb") as opened:
        opened.truncate(100_000_000)
    said = command("run", file)
    assert said.code == 2
    assert said.err == (
        f"{file}:1:1: expected at most 1000000 bytes, found 100000000 bytes\n"
    )


def test_an_attack_is_read_as_an_expression_and_never_run(
    command: Command, changed: Change, tmp_path: Path
) -> None:
    proof = tmp_path / "proof"
    for number, attack in enumerate(
        (
            f"__import__('os').system('touch {proof}')",
            f"open('{proof}', 'w')",
            f"exec(\\\"open('{proof}', 'w')\\\")",
            "9 ** 9 ** 9 ** 9",
            "(1).__class__.__bases__",
        )
    ):
        file = changed("x_m: 30,", f'x_m: "{attack}",')
        said = command("run", file)
        assert (said.code, said.out) == (2, ""), number
        (message,) = messages(said.err)
        assert ": expression " in message
        assert message.startswith(f"{file}:")
        assert not proof.exists()


# --- the command line


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--set", "steps"], "--set: expected key.path=value, found 'steps'"),
        (["--set", "=3"], "--set: expected key.path=value, found '=3'"),
        (
            ["--set", "step=3"],
            "--set step: expected a known key, found 'step'; did ",
        ),
        (
            ["--set", "uavs.5.slot.x_m=3"],
            "--set uavs.5.slot.x_m: expected one of the 5 items, from 0, of 'uavs'",
        ),
        (
            ["--set", "steps.first=3"],
            "--set steps.first: expected a mapping or a list at 'steps'",
        ),
        (
            ["--set", "variants.literal.steps=3"],
            "--set variants.literal.steps: expected a known key, found 'variants'",
        ),
        (
            ["--set", "weights.R=[1, pi/x]"],
            "--set weights.R, column 8: expression 'pi/x'",
        ),
        (
            ["--search", "none"],
            "--search search: expected a search, a polish or both; found neither",
        ),
        (["--variant", "literally"], "expected --variant to be one of literal, "),
        (
            ["--fail-on", "settle_time > 3"],
            "expected a measure in --fail-on, found 'settle_time'; did you mean "
            "'settle_time_s'?",
        ),
        (
            ["--fail-on", "settle_time_s"],
            "expected --fail-on 'MEASURE RELATION NUMBER', found 'settle_time_s'",
        ),
        (["--fail-on", "settle_time_s > nan"], "found 'nan' as the number"),
        (["--seed", "-1"], "argument --seed: expected a whole number from 0 to 10^18"),
        (["--search", "cspo"], "unknown 'cspo'; did you mean 'cpso'?"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_wrong_option_is_explained(
    options: list[str], what: str, command: Command
) -> None:
    said = command("run", "formation_v", *options)
    assert (said.code, said.out) == (2, "")
    assert what in said.err
    assert not PYDANTIC.search(said.err)


def test_a_scenario_nearly_named_is_suggested(command: Command) -> None:
    said = command("run", "formation_w")
    assert (said.code, said.out) == (2, "")
    assert said.err == (
        "swarmstart: expected a scenario or a path, found 'formation_w'; did you mean "
        f"formation_v? {len(shipped())} scenarios: swarmstart list scenarios\n"
    )


def test_check_says_a_flaw_of_both_variants_once_and_goes_on(
    command: Command, changed: Change
) -> None:
    file = changed("steps: 60", "steps: -5")
    said = command("check", file, "formation_v")
    assert said.code == 2
    assert len(messages(said.err)) == 1
    assert said.out == "formation_v.yaml: valid (literal, corrected)\n"


def test_check_finds_a_flaw_of_the_other_variant(
    command: Command, changed: Change
) -> None:
    file = changed("along: points", "along: lines")
    assert command("run", file, "--print-config").code == 0  # the corrected variant
    said = command("check", file)
    assert said.code == 2
    (message,) = messages(said.err)
    assert text_at(file, message).startswith("lines")


# --- as a user types it


def typed(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "swarmstart", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        stdin=subprocess.DEVNULL,
    )


def test_a_process_tells_and_leaves_with_the_code(
    changed: Change, tmp_path: Path
) -> None:
    wrong = typed("run", changed("steps: 60", "steps: -5"), "--json")
    missing = typed("run", tmp_path / "no.yaml")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert (missing.returncode, missing.stdout) == (5, "")
    for error in (wrong.stderr, missing.stderr):
        assert "Traceback" not in error and "expected" in error


def test_debug_shows_where_an_error_was_raised(changed: Change) -> None:
    said = typed("run", changed("steps: 60", "steps: -5"), "--debug")
    assert said.returncode == 2
    assert "Traceback" in said.stderr and "expected steps" in said.stderr


def test_all_shipped_scenarios_are_valid(command: Command) -> None:
    said = command("check", *shipped())
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    assert len(lines) == len(shipped())
    for line, path in zip(lines, shipped().values(), strict=True):
        varies = "\nvariants:" in path.read_text(encoding="utf-8")
        assert line.endswith(": valid (literal, corrected)" if varies else ": valid")
