"""The code of three pages of docs/ runs from top to bottom."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def run(
    name: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> tuple[int, list[str]]:
    """Return the number of blocks of code of a page, and their output."""
    page = DOCS / name
    if not page.exists():
        pytest.skip("the documentation is not beside an installed package")
    monkeypatch.chdir(folder)
    blocks = re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(page), "exec"), names)
    return len(blocks), capsys.readouterr().out.splitlines()


def test_the_code_of_the_library_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks, said = run("library.md", tmp_path, monkeypatch, capsys)
    assert blocks == 9
    assert float(said[0]) == pytest.approx(36.713, abs=1e-3)
    assert said[1] == "[20.36 24.56]"
    assert said[2].startswith("('angle', 'speed')")
    assert said[-3].startswith("problem 1, ipopt: 1 of 1 feasible")
    assert float(said[-1]) < 1e-6


def test_the_code_of_the_page_of_what_a_problem_may_need_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks, said = run("any_problem.md", tmp_path, monkeypatch, capsys)
    assert blocks == 15
    assert [float(word) for word in said[0].split()] == pytest.approx([2.0] * 2)
    assert said[1] == "[-0.1867 -0.2393]"
    assert [float(word) for word in said[2].split()] == pytest.approx(
        [3.0, 1.5], abs=0.05
    )
    assert said[3].startswith("{'duration of phase 1': ")
    assert said[4].startswith("2.9") and "'phase'" in said[4]
    assert said[5:8] == ["1.311", "0.734 1.36", "0.2"]
    assert said[8].startswith("('x_0', 'x_1', 'x_2') [")
    assert said[9] == "('u_0', 'u_1', 'u_2') True"
    assert said[10] == "5"
    assert said[11] == "[[ 1.5  0.9  0.3 -0.3 -0.9 -1.5]] 1.5"
    assert re.match("whole numbers cost .*, relaxed .*% apart", said[12])
    assert said[13] == "('z',) (1, 11)"


def test_the_code_of_the_page_of_stiff_models_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks, said = run("stiff_models.md", tmp_path, monkeypatch, capsys)
    assert blocks == 2
    assert said[1] == "0.0125267 a local optimum, confirmed on the finer grid"
