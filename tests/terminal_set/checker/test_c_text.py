"""A C file with another constant, or another law, than its certificate is refused."""

import os
import re
from functools import lru_cache
from pathlib import Path

import pytest

from swarmstart.export import export_c
from swarmstart.export.controller.source import _SET
from swarmstart.terminal_set.check import main
from swarmstart.terminal_set.checker.c_text import _LAW, _words
from swarmstart.terminal_set.checker.command import (
    PROVED,
    REFUSED,
    UNREADABLE,
    UNUSABLE,
)
from swarmstart.tests.export.controller.controllers import dual_mode


@lru_cache(maxsize=1)
def files() -> dict[str, str]:
    """Return the export of a double integrator with a proven set."""
    controller, x0 = dual_mode()
    return dict(export_c(controller, x0, name="law", starts=0).files)


def judged(folder: Path, source: str) -> int:
    """Return the exit code for a C file beside the certificate."""
    (folder / "law.certificate.json").write_text(files()["law.certificate.json"])
    (folder / "law.c").write_text(source)
    arguments = [folder / "law.certificate.json", "--against", folder / "law.c"]
    return main([str(one) for one in arguments])


def test_what_is_exported_is_proven_again(tmp_path: Path) -> None:
    """With its constants compared first."""
    assert judged(tmp_path, files()["law.c"]) == PROVED


TABLES = "gain set_matrix set_level x_reference u_reference u_lower u_upper".split()


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("change", ["bit", "sign", "fewer"])
def test_every_constant_is_compared_bit_by_bit(
    tmp_path: Path, table: str, change: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last bit, the sign, and the number of entries."""
    source = files()["law.c"]
    declared = re.search(rf"{table}\[(\d+)\] = {{(.*?)}}", source, flags=re.DOTALL)
    assert declared
    count, (*rest, last) = int(declared[1]), declared[2].strip().split(",")
    value = float.fromhex(last.strip("() \n"))
    if change == "bit":
        last = float.hex(value + (abs(value) or 1.0) * 2.0**-52)
    elif change == "sign":
        last = float.hex(-value if value else 1e-300)
    else:
        count += 1
        last += ", 0x0.0p+0"
    body = ", ".join([*rest, last])
    changed = source.replace(declared[0], f"{table}[{count}] = {{{body}}}")
    assert changed != source
    assert judged(tmp_path, changed) == REFUSED
    assert table in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("u -= gain", "u += gain"),
        ("(here[j] - x_reference[j])", "here[j]"),
        ("return value <= set_level[0];", "return value <= 2 * set_level[0];"),
        ("row += set_matrix[i * NX + j]", "row += set_matrix[j * NX + j]"),
        ("clipped(u, u_lower[i], u_upper[i])", "u"),
        ("value > most ? most", "value > most ? least"),
    ],
)
def test_the_law_is_compared_word_by_word(tmp_path: Path, old: str, new: str) -> None:
    """A sign, a reference left out, a larger set, another index, no bounds."""
    source = files()["law.c"]
    assert source.count(old) >= 1
    assert judged(tmp_path, source.replace(old, new)) == REFUSED


@pytest.mark.parametrize(
    ("pattern", "new", "code"),
    [
        (r"#define HOLD .*", "#define HOLD 0x1.0p+0", REFUSED),
        (r"#define ALL_STEPS .*", "#define ALL_STEPS 2", REFUSED),
        (r"#define N (\d+)", "#define N 0", REFUSED),
        (r"#define NX .*", "#define NX 3", REFUSED),
        (r"#define NU .*", "#define NU 2", REFUSED),
        (r"#define HOLD .*", "#define HOLD 0.2", UNUSABLE),
        (r"#define NU .*", "#define NU 1\n#define gain other", UNUSABLE),
        (r"#define NU .*", "#define NU 1\n#define NU 1", UNUSABLE),
        (r"#define NU .*", "#define NU 1\n#if 0", UNUSABLE),
        (r"#define NU .*", "#define NU 1\n#pragma once", UNUSABLE),
        (r"#define NU .*", '#define NU 1\n#include "/etc/other.h"', UNUSABLE),
        (r"#define N (\d+)", "#define N (m->plan[0] = 1, 10)", UNUSABLE),
        (r"#define SIGNALS.*", "#define SIGNALS(k) (m->plan[0] = 1, m->p)", UNUSABLE),
        (r"#define HOLD .*", "#define HOLD 0x1.8p+9999", UNUSABLE),
        (r"#define NU .*", "#define NU \\\n1", UNUSABLE),
        (r"static const real gain", "static real gain", UNUSABLE),
        (r"static const real gain\[2\]", "static const real gain[3]", UNUSABLE),
        (r"static void shift", "static real gain[2];\nstatic void shift", UNUSABLE),
        (r"static void shift", "// x\nstatic void shift", UNUSABLE),
        (r"static void shift", "/* x \nstatic void shift", REFUSED),
        (r"static void shift", 'static char *x = "y";\nstatic void shift', UNUSABLE),
        (r"static void shift", "static char x = 'y';\nstatic void shift", UNUSABLE),
        (r"static void shift", "static int ä;\nstatic void shift", UNUSABLE),
    ],
)
def test_what_a_compiler_could_read_otherwise_is_refused(
    tmp_path: Path, pattern: str, new: str, code: int
) -> None:
    """Sizes and the hold; and words defined anew, conditions, quotes, comments."""
    changed = re.sub(pattern, lambda _: new, files()["law.c"], count=1)
    assert changed != files()["law.c"]
    assert judged(tmp_path, changed) == code


def test_a_right_table_in_a_comment_does_not_count(tmp_path: Path) -> None:
    """The table that the compiler sees does."""
    source = files()["law.c"]
    declared = re.search(r"static const real gain.*?;", source, flags=re.DOTALL)
    assert declared
    wrong = declared[0].replace("p-1", "p-2")
    changed = source.replace(declared[0], f"/* {declared[0]} */\n{wrong}")
    assert judged(tmp_path, changed) == REFUSED


def test_files_that_cannot_be_read_have_their_own_code(tmp_path: Path) -> None:
    """A missing certificate has it, too."""
    assert judged(tmp_path, files()["law.c"]) == PROVED
    certificate = str(tmp_path / "law.certificate.json")
    assert main([certificate, "--against", str(tmp_path / "no.c")]) == UNREADABLE
    assert main([certificate, "--against", certificate]) == UNUSABLE


def test_a_pipe_is_no_c_file(tmp_path: Path) -> None:
    """It is refused at once; reading it would wait for ever."""
    assert judged(tmp_path, files()["law.c"]) == PROVED
    os.mkfifo(tmp_path / "pipe.c")
    certificate = str(tmp_path / "law.certificate.json")
    assert main([certificate, "--against", str(tmp_path / "pipe.c")]) == UNUSABLE


def test_the_law_of_the_checker_is_that_of_the_generator() -> None:
    """Each has its own copy, so that one judges the other."""
    known = [one for one in _LAW if "clipped(real" not in one]
    assert _words("".join(known)) == _words(re.sub(r"/\*.*?\*/", "", _SET))
