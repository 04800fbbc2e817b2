"""The recipes of CONTRIBUTING for a measure and a figure work as they are written."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import swarmstart
from swarmstart.tests.processes import python

ROOT = Path(swarmstart.__file__).parent
ROOMS = (
    "machine_code", "ocp", "heuristics", "terminal_set", "export", "simulators",
    "cases",
)  # fmt: skip
RUN = ["run", "double_integrator", "--search", "none", "--polish", "ipopt"]


def written(file: Path, place: str, new: str) -> None:
    """Write something new above a place of a file, which it has once."""
    text = file.read_text(encoding="utf-8")
    assert text.count(place) == 1, f"{place!r} in {file.name}"
    file.write_text(text.replace(place, new + place), encoding="utf-8")


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package, with a measure and a figure of any problem."""
    root = tmp_path_factory.mktemp("copied")
    package = root / "swarmstart"
    package.mkdir()
    for room in ROOMS:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / room, package / room, ignore=ignored)
    for file in ROOT.glob("*.py"):
        shutil.copy(file, package / file.name)
    problem = package / "cases" / "kinds" / "problem"
    written(
        problem / "measuring" / "measures.py",
        '        "linear_steps": ',
        '        "farthest": float(abs(trajectory.states).max()),\n',
    )
    names = problem / "stated" / "names.py"
    written(
        names,
        '    "linear_steps": ',
        '    "farthest": "Largest absolute value of a state at a step [-]",\n',
    )
    figures = package / "cases" / "drawing" / "problem_figures.py"
    written(
        figures,
        "def _whole(\n",
        'def _titled(title: str) -> "Figure":\n'
        "    figure = new_figure()\n"
        "    figure.suptitle(title)\n"
        "    return figure\n\n\n",
    )
    written(
        figures,
        "    outputs = _outputs(",
        '    yield "i_title", _titled(title)\n',
    )
    written(names, '    "h_outputs": ', '    "i_title": "The title alone.",\n')
    return root


def command(copied: Path, *arguments: str) -> str:
    return python("-m", "swarmstart", *arguments, root=copied).stdout


def test_a_measure_is_listed_recorded_and_reported(copied: Path) -> None:
    assert "farthest" in command(copied, "list", "measures", "--kind", "problem")
    claim = "{id: m, text: t, source: s, measure: farthest, relation: <, bound: 1.6}"
    asked = ["--set", f"claims=[{claim}]", "--no-figures", "--measures", "--out", "run"]
    assert "farthest" in command(copied, *RUN, *asked)
    record = json.loads((copied / "run" / "run.json").read_text(encoding="utf-8"))
    # The speed halfway, of the least energy on 20 intervals.
    fastest = pytest.approx(1.5 * 400 / 399, rel=1e-4)
    assert record["measures"]["farthest"] == fastest
    assert [(c["id"], c["holds"]) for c in record["claims"]] == [("m", True)]


def test_a_figure_is_drawn_and_stands_on_the_page_with_its_caption(
    copied: Path,
) -> None:
    command(copied, *RUN, "--out", "drawn")
    assert (copied / "drawn" / "figures" / "i_title.png").is_file()
    command(copied, "report", "drawn")
    page = (copied / "drawn" / "report.html").read_text(encoding="utf-8")
    assert "The title alone." in page
