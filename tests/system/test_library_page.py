"""docs/library.md: its code runs from top to bottom."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "library.md"


def test_the_code_of_the_library_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if not PAGE.exists():
        pytest.skip("the documentation is not beside an installed package")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    said = capsys.readouterr().out.splitlines()
    assert len(blocks) == 9
    assert float(said[0]) == pytest.approx(36.713, abs=1e-3)
    assert said[1] == "[20.36 24.56]"
    assert said[2].startswith("('angle', 'speed')")
    assert said[-3].startswith("problem 1, ipopt: 1 of 1 feasible")
    assert float(said[-1]) < 1e-6
