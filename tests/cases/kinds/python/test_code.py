"""A user's file is read without being run, and its errors are one sentence."""

import os
from pathlib import Path

import pytest

from swarmstart.cases.kinds.python.scenario import (
    Code,
    UserCodeError,
    read_code,
    returned,
)


def code_of(text: str, folder: Path) -> Code:
    (folder / "own.py").write_text(text)
    return read_code("own.py:build", folder)


def test_reading_runs_nothing_and_keeps_every_byte(tmp_path: Path) -> None:
    text = "\ufeff# caf\u00e9\r\nraise SystemExit\n"
    (tmp_path / "own.py").write_bytes(text.encode())
    assert read_code("own.py:build", tmp_path).text.encode() == text.encode()


@pytest.mark.parametrize(
    "given",
    [
        "../own.py:build",
        "a/../../own.py:build",
        "/own.py:build",
        "a\\own.py:build",
        "own.py",
        "own.py:",
        "own.py:a.b",
        "own.txt:build",
        "own.py:build:more",
        "a" * 5000 + ".py:build",
        3,
        None,
    ],
)
def test_only_a_function_in_a_file_below_the_scenario_is_taken(
    given: object, tmp_path: Path
) -> None:
    (tmp_path / "own.py").write_text("")
    folder = tmp_path / "a"
    folder.mkdir()
    with pytest.raises(ValueError, match=r"such as my_model\.py:build; found") as said:
        read_code(given, folder)
    assert len(str(said.value)) < 200


def test_a_file_in_a_folder_below_is_named_without_it(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "own.py").write_text("")
    assert str(read_code("models/own.py:build", tmp_path)) == "own.py:build"


def test_a_folder_a_missing_a_large_and_a_binary_file_are_refused(
    tmp_path: Path,
) -> None:
    (tmp_path / "folder.py").mkdir()
    (tmp_path / "large.py").write_bytes(b"#" * 20_000_000)
    (tmp_path / "binary.py").write_bytes(b"\xff")
    for name, said in (
        ("folder", "found a directory"),
        ("missing", "No such file"),
        ("large", "at most 1000000 bytes"),
        ("binary", "expected text in UTF-8"),
    ):
        with pytest.raises(ValueError, match=said):
            read_code(f"{name}.py:build", tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def build(:\n", "found SyntaxError: "),
        ("x = 1\0", "found SyntaxError: "),
        ("x = " + "-" * 400_000 + "1", "found MemoryError|found RecursionError"),
        ("raise SystemExit(0)", "found SystemExit: 0"),
        ("def build():\n  import sys; sys.exit()", "found SystemExit"),
        ("def build():\n  return build()", "found RecursionError: "),
        ("class E(BaseException): ...\nraise E('x' * 9999)", "found E: xxx"),
        ("class E(Exception):\n  def __str__(self): 1/0\nraise E", "its text raises"),
        ("build = 3", "expected a function 'build', found int"),
        ("", "expected a function 'build', found no such name"),
        ("def build(mass): ...", "found TypeError: .*mass"),
        ("import sys\nsys.modules.pop(__name__)\nraise OSError", "found OSError"),
    ],
)
def test_an_error_of_the_code_is_one_sentence(
    text: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(UserCodeError, match=said) as caught:
        returned(code_of(text, tmp_path), {})
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600
    assert str(caught.value).startswith(str(tmp_path / "own.py"))


def test_an_interrupt_of_the_code_stays_one(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        returned(code_of("raise KeyboardInterrupt", tmp_path), {})


def test_the_code_has_its_arguments_and_a_module_of_its_own(tmp_path: Path) -> None:
    text = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n"
        "@dataclass\nclass Box:\n  side: float\n"
        "def build(sides):\n  sides.append(4)\n  return Box(sides[0]).side, __file__\n"
    )
    arguments = {"sides": [2.0]}
    found = returned(code_of(text, tmp_path), arguments)
    assert found == (2.0, str(tmp_path / "own.py"))
    assert arguments == {"sides": [2.0]}
    assert not list(tmp_path.glob("__pycache__"))


def test_prints_go_to_standard_error_and_the_directory_is_changed_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = os.getcwd()
    text = "import os\nprint('said')\nos.chdir('/')\ndef build(): print('built')"
    returned(code_of(text, tmp_path), {})
    assert os.getcwd() == before
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "said\nbuilt\n")
