"""Tables of a problem: as functions in its expressions, from the file or from CSV."""

import json
from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import (
    Resolved,
    read_document,
    resolve,
    resolved_again,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.record.record import Recording
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)

PLANE = """\
kind: problem
tables:
  thrust: {x: [0, 0.5, 1, 1.5, 2], y: [2, 2.2, 2.5, 2.1, 1.5], method: bspline}
  drag: {x: [0, 1, 2], y: [0, 1], z: [[0.1, 0.2], [0.5, 0.4], [1.5, 1.2]]}
definitions: {mach: speed/2}
states:
  speed: {start: 0.2, rate: "throttle*thrust(mach) - drag(mach, height)"}
  height: {start: 0.1, rate: climb*speed}
controls:
  throttle: {bounds: [0, 1]}
  climb: {bounds: [-0.5, 0.5]}
stage_cost: throttle**2 + climb**2
terminal_cost: -10*height
prediction: {horizon_s: 2, intervals: 6}
measures: {most: max(thrust(mach)), last: "drag(speed.end/2, height.end)"}
budget: {evaluations: 300}
"""


def test_tables_are_functions_in_expressions_and_measures() -> None:
    path, found = simulated(PLANE)
    tables = scenario_of(PLANE).tabled
    speed, height = path.dense_states
    assert found["most"] == pytest.approx(tables["thrust"].at(speed / 2).max())
    last = tables["drag"].at(speed[-1] / 2, height[-1])
    assert found["last"] == pytest.approx(float(last))
    u = path.decisions[0].plans[0].controls[0, 0]
    rise = np.diff(speed[:2])[0] / np.diff(path.dense_times[:2])[0]
    force = u * tables["thrust"].at(0.1) - tables["drag"].at(0.1, 0.1)
    assert rise == pytest.approx(float(force), rel=0.05)


def test_a_table_may_stand_where_expressions_of_the_problem_do() -> None:
    more = """
path: [{expression: "thrust(mach) - 0.1*height", lower: 1, scale: 1}]
terminal: [{expression: thrust(mach), upper: 9, scale: 1}]
candidates: [{throttle: thrust(0.5)/4, climb: 0.1}]
"""
    _, found = simulated(PLANE + more)
    assert found["violation"] == 0


REFUSED = {
    "values": (
        "y: [2, 2.2, 2.5, 2.1, 1.5]",
        "y: [2, 2.2]",
        ("stated.yaml:3:11:", "values must have shape (5,)", "got (2,)"),
    ),
    "order": ("[0, 0.5, 1,", "[0, 0.5, 0.5,", ("3:11:", "must increase")),
    "few": ("x: [0, 1, 2], y", "x: [0], y", ("4:9:", "at least 2 breakpoints, got 1")),
    "ragged": ("[0.5, 0.4]", "[0.5]", ("4:9:", "values must be numbers")),
    "method": ("method: bspline", "method: cubic", ("3:72:", "'linear' or 'bspline'")),
    "key": ("method: b", "metod: b", ("3:64:", "did you mean 'method'")),
    "missing": ("x: [0, 0.5, 1, 1.5, 2], ", "", ("3:11:", "missing x")),
    "text": ("2.1, 1.5]", "2.1, much]", ("3:58:", "unknown name 'much'")),
    "too few arguments": (
        "drag(mach, height)",
        "drag(mach)",
        ("7:54:", "expected drag with 2 plain argument(s), found 1"),
    ),
    "too many": ("thrust(mach) -", "thrust(mach, 1) -", ("7:39:", "found 2")),
    "unknown": (
        "*thrust(mach)",
        "*trust(mach)",
        ("7:39:", "unknown function 'trust': did you mean 'thrust'"),
    ),
    "no argument": ("thrust(mach) -", "thrust -", ("7:39:", "without its argument")),
    "in a start": ("start: 0.2", "start: thrust(1)", ("7:18:", "unknown function")),
    "in a measure": (
        "max(thrust(mach))",
        '"max(thrust(mach, 1))"',
        ("expected thrust with 1 plain argument(s), found 2",),
    ),
    "a path": ("max(thrust(mach))", "thrust(mach)", ("expected one number",)),
    "name of a state": ("  thrust: {", "  speed: {", ("it is among the tables",)),
    "name of a function": ("  thrust: {", "  sin: {", ("a meaning of its own",)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_with_a_table_is_said_at_its_place(name: str) -> None:
    part, other, expected = REFUSED[name]
    assert part in PLANE
    with pytest.raises(InvalidScenarioError) as caught:
        stated(PLANE.replace(part, other, 1))
    for words in expected:
        assert words in str(caught.value)


INLINE = "{x: [0, 1, 2], y: [0, 1], z: [[0.1, 0.2], [0.5, 0.4], [1.5, 1.2]]}"
DRAG = "mach \\ km,0,1\n0,0.1,0.2\n1,0.5,0.4\n\n2,1.5,1.2\n"
THRUST = "mach,kN\n0,2\n0.5,2.2\n1,2.5\n1.5,2.1\n2,1.5\n"


def filed(folder: Path, *assignments: str) -> Resolved:
    """Return the plane with its tables in files, resolved in a folder."""
    (folder / "data").mkdir(exist_ok=True)
    for name, text in (("drag", DRAG), ("thrust", THRUST)):
        if not (folder / "data" / f"{name}.csv").exists():
            (folder / "data" / f"{name}.csv").write_text(text, encoding="utf-8")
    text = PLANE.replace(INLINE, "{file: data/drag.csv}")
    text = text.replace(
        "x: [0, 0.5, 1, 1.5, 2], y: [2, 2.2, 2.5, 2.1, 1.5]", "file: data/thrust.csv"
    )
    assert text.count("file: ") == 2
    file = folder / "stated.yaml"
    file.write_text(text, encoding="utf-8")
    return resolve(read_document(str(file)), assignments=assignments)


def test_a_file_means_what_its_numbers_do(tmp_path: Path) -> None:
    """Also behind a byte order mark, with CRLF, and without a line of names."""
    inline = stated(PLANE).settings
    assert filed(tmp_path).settings == inline
    table = tmp_path / "data" / "thrust.csv"
    table.write_bytes(b"\xef\xbb\xbf" + THRUST.replace("\n", "\r\n").encode())
    assert filed(tmp_path).settings == inline
    table.write_text(THRUST.partition("\n")[2], encoding="utf-8")
    assert filed(tmp_path).settings == inline


def test_settings_make_the_same_problem_without_the_file(tmp_path: Path) -> None:
    settings = filed(tmp_path).settings
    (tmp_path / "data" / "drag.csv").unlink()
    again = resolved_again(settings, "")
    assert isinstance(again.scenario, ProblemScenario)
    assert again.scenario.tabled["drag"].values[1, 0] == 0.5


def test_another_number_in_a_file_is_another_run(tmp_path: Path) -> None:
    def key(name: str) -> str:
        recording = Recording(folder=tmp_path / name, figures=False)
        run(filed(tmp_path, "steps=1"), seed=0, recording=recording)
        found = json.loads((tmp_path / name / "run.json").read_text(encoding="utf-8"))
        return str(found["key"])

    first = key("one")
    assert key("same") == first
    file = tmp_path / "data" / "drag.csv"
    file.write_text(DRAG.replace("1.2", "1.3"), encoding="utf-8")
    assert key("other") != first
    assert "1.3" in (tmp_path / "other" / "scenario.yaml").read_text(encoding="utf-8")


WRONG_FILES = {
    "empty": ("", "at least two columns, found 0"),
    "one column": ("1\n2\n", "at least two columns, found 1"),
    "ragged": ("a,b\n1,2\n3\n", "drag.csv:3: expected 2 columns"),
    "word": ("0,1\n1,x\n", "drag.csv:2: expected a number in column 2, found 'x'"),
    "half a head": ("mach,1\n1,2\n2,3\n", "drag.csv:1: expected a number in column 1"),
    "not finite": ("0,1\n1,nan\n", "expected a number in column 2, found 'nan'"),
    "underscore": ("0,1\n1,1_0\n", "expected a number in column 2, found '1_0'"),
    "no number in the head": ("a,b,c\n0,1,2\n1,2,3\n", "drag.csv:1: expected a number"),
    "falling": ("0,1\n-1,2\n", "breakpoints must increase"),
    "binary": ("\udcff,\x00", "expected CSV in UTF-8"),
    "one input": (THRUST, "expected drag with 1 plain argument(s), found 2"),
}


@pytest.mark.parametrize("name", WRONG_FILES)
def test_a_file_without_a_table_is_refused(tmp_path: Path, name: str) -> None:
    text, expected = WRONG_FILES[name]
    (tmp_path / "data").mkdir()
    content = text.encode(errors="surrogateescape")
    (tmp_path / "data" / "drag.csv").write_bytes(content)
    with pytest.raises(InvalidScenarioError) as caught:
        filed(tmp_path)
    assert expected in str(caught.value)
    assert "stated.yaml:" in str(caught.value)


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("nothing.csv", "expected a readable file, found: No such file"),
        ("../drag.csv", "in the scenario's folder or below"),
        ("/etc/passwd", "in the scenario's folder or below"),
        ("drag.txt", "expected file to be a CSV file"),
        ("3", "expected file to be a CSV file"),
        ("data/drag.csv, x: [0, 1]", "expected file, or x and y; found file and x"),
    ],
)
def test_another_file_is_refused(file: str, expected: str) -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        stated(PLANE.replace(INLINE, f"{{file: {file}}}"))
    assert expected in str(caught.value)
    assert "stated.yaml:4:9:" in str(caught.value)


def test_the_file_of_a_shipped_scenario_is_beside_it_and_not_where_one_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "supersonic_climb.csv").write_text("x,y\n0,1\n1,2\n")
    monkeypatch.chdir(tmp_path)
    scenario = resolve(read_document("supersonic_climb")).scenario
    assert isinstance(scenario, ProblemScenario)
    thrust = scenario.tabled["thrust_at"]
    assert thrust.at(0.6, 10_000) == pytest.approx(23_800, rel=1e-12)
