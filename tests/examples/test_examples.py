"""The gallery's scripts print what they say that they print, and their YAML agrees."""

from __future__ import annotations

import ast
import re
import runpy
import textwrap
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

import swarmstart as ss
from swarmstart.cases.commands.front.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"
if not EXAMPLES.is_dir():
    pytest.skip("there are no such files beside the tests", allow_module_level=True)
SCRIPTS = sorted(str(path.relative_to(EXAMPLES)) for path in EXAMPLES.glob("*/*.py"))
NOTEBOOKS = sorted(path.name for path in EXAMPLES.glob("*.ipynb"))
SECONDS = 120
"""Time that a cell of a notebook may take, compiling included [s]."""
LINES = 52
"""Largest number of lines of code of an example."""
NAMED = re.compile(r"`swarmstart run (\w+)[` ]")


def text_of(script: str) -> str:
    """Return the docstring of a script."""
    text = (EXAMPLES / script).read_text(encoding="utf-8")
    return ast.get_docstring(ast.parse(text)) or ""


def said(script: str) -> str:
    """Return what a script's docstring says that it prints."""
    (printed,) = re.findall(r"^Prints::\n\n((?: {4}.*\n|\n)+)", text_of(script), re.M)
    return textwrap.dedent(printed).strip()


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_prints_what_it_says_and_draws(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its answer is that of its YAML file, too."""
    monkeypatch.setattr(plt, "show", lambda: None)
    plt.close("all")
    with mpl.rc_context():
        found = runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert capsys.readouterr().out.strip() == said(name)
    figure = plt.figure(plt.get_fignums()[0])
    assert any(axes.has_data() or axes.patches for axes in figure.axes)
    stated = (EXAMPLES / name).with_suffix(".yaml")
    if stated.exists() and "solution" in found:
        assert cost_of(stated) == pytest.approx(found["solution"].cost, rel=1e-4)


def cost_of(stated: Path) -> Any:
    """Return the cost of the plan of a YAML file."""
    return ss.run(str(stated), seed=0).measures["cost"]


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_is_short_and_has_a_yaml_form_or_says_that_it_has_none(
    name: str,
) -> None:
    code = (EXAMPLES / name).read_text(encoding="utf-8").split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= LINES
    text = text_of(name)
    title, line, *_ = text.splitlines()
    assert line == "=" * len(title)
    stated = (EXAMPLES / name).with_suffix(".yaml")
    if stated.exists():
        assert (
            f".. literalinclude:: ../../../examples/{stated.relative_to(EXAMPLES)}"
            in text
        )
        assert main(["check", str(stated)]) == 0
    elif shipped := NAMED.findall(text):
        assert main(["check", *shipped]) == 0
    else:
        assert "no YAML form" in text


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
