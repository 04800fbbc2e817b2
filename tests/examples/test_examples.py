"""The examples run, and print what they say that they print."""

from __future__ import annotations

import ast
import re
import runpy
import textwrap
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
if not EXAMPLES.is_dir():
    pytest.skip("there are no such files beside the tests", allow_module_level=True)
SCRIPTS = sorted(path.name for path in EXAMPLES.glob("*.py"))
NOTEBOOKS = sorted(path.name for path in EXAMPLES.glob("*.ipynb"))
SECONDS = 120
"""Time that a cell of a notebook may take, compiling included [s]."""


def said(script: Path) -> str:
    """Return what a script's docstring says that it prints."""
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    (printed,) = re.findall(r"^Prints:\n(.*)\Z", text, re.MULTILINE | re.DOTALL)
    return textwrap.dedent(printed).strip()


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_prints_what_its_docstring_says(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert capsys.readouterr().out.strip() == said(EXAMPLES / name)


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_is_short_and_says_what_it_shows(name: str) -> None:
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    assert "\nShows: " in text
    assert len(text.splitlines()) <= 85


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_runs_to_its_end(name: str) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=SECONDS, kernel_name="python3")
    client.execute()  # Raises with the cell's traceback if a cell fails.


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_is_kept_without_outputs(name: str) -> None:
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
