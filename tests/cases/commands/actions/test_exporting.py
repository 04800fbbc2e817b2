"""`swarmstart export trajectory` writes files of a run, and replaces none."""

import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.commands.actions.exporting import ERRORS, FORMATS
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.front.options import EXPORTS

ORIGIN = ["--origin", "47.38,8.55,408"]


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of three vehicles that go to places of a line."""
    folder = tmp_path_factory.mktemp("export")
    file = folder / "three.yaml"
    file.write_text(
        "schema: 1\nkind: swarm\ntitle: Three\nsteps: 60\nsafe_distance_m: 0.4\n"
        "starts: {formation: line, count: 3, spacing_m: 1}\n"
        "goals: {formation: points, points_m: [[0, 2, 1], [1, 2, 1], [2, 2, 1]]}\n",
        encoding="utf-8",
    )
    ss.run(str(file), seed=0, out=str(folder / "run"))
    return folder / "run"


def exported(record: Path, out: Path, *words: str) -> int:
    return main(["export", "trajectory", str(record), "--out", str(out), *words])


def test_the_formats_of_the_help_are_those_that_are_written() -> None:
    assert [*EXPORTS] == [*FORMATS]
    assert {*ERRORS} <= {*FORMATS}


@pytest.mark.parametrize("name", [*FORMATS])
def test_each_format_has_a_file_for_each_vehicle_or_one_for_all(
    record: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "mcap":
        pytest.importorskip("mcap_ros2")
    origin = ORIGIN if name in ("qgc", "wpl") else []
    assert exported(record, tmp_path, "--format", name, *origin) == 0
    files = sorted(tmp_path.iterdir())
    assert len(files) == (1 if name in ("mcap", "skybrush") else 3)
    assert all(file.stat().st_size > 100 for file in files)
    told = capsys.readouterr().out.splitlines()
    assert told == [f"file  {file}" for file in files]


def test_the_table_is_the_simulated_path(record: Path, tmp_path: Path) -> None:
    assert exported(record, tmp_path, "--format", "csv", "--vehicle", "1") == 0
    (file,) = tmp_path.iterdir()
    found = np.loadtxt(file, delimiter=",", skiprows=1)
    arrays = ss.load(record).arrays
    row = [*arrays["state_names"]].index("x_m_1")
    np.testing.assert_array_equal(found[:, 0], arrays["dense_times"])
    np.testing.assert_array_equal(found[:, 1:].T, arrays["dense_states"][row : row + 3])


def test_a_mission_begins_on_the_earth_where_the_vehicle_does(
    record: Path, tmp_path: Path
) -> None:
    assert exported(record, tmp_path, "--format", "qgc", *ORIGIN) == 0
    plan = json.loads((tmp_path / "0.plan").read_text("utf-8"))
    *_, latitude, longitude, _ = plan["mission"]["items"][0]["params"]
    assert abs(latitude - 47.38) < 1e-4 and abs(longitude - 8.55) < 1e-4


def test_the_default_folder_is_in_the_record(record: Path) -> None:
    words = ["export", "trajectory", str(record), "--format", "skybrush"]
    assert main(words) == 0
    assert zipfile.is_zipfile(record / "export" / "show.skyc")
    ss.load(record)


def test_a_file_that_exists_is_not_replaced(
    record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "1.csv").write_text("mine", encoding="utf-8")
    assert exported(record, tmp_path, "--format", "csv") == 5
    assert "1.csv: expected a new file, found one" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["1.csv"]
    assert (tmp_path / "1.csv").read_text("utf-8") == "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--format", "qgc"], "--origin: expected LATITUDE,LONGITUDE,ALTITUDE"),
        (["--format", "wpl", "--origin", "47,8"], "found 47,8"),
        (
            ["--format", "wpl", "--origin", "91,8,0"],
            "latitude from -89 to 89, found 91",
        ),
        (["--format", "wpl", "--origin", "nan,8,0"], "expected a latitude"),
        (["--format", "csv", "--vehicle", "9"], "expected one of 0, 1, 2, found '9'"),
        (["--format", "csv", "--positions", "x"], "two or three names"),
        (
            ["--format", "csv", "--positions", "a,b"],
            "expected states a, b of a vehicle",
        ),
        (["--format", "crazyswarm", "--max-speed", "0.1"], "speed of at most 0.1 m/s"),
        (["--format", "crazyswarm", "--error", "1e-12"], "an error of at most 1e-12 m"),
        (
            ["--format", "skybrush", "--error", "nan"],
            "expected a finite number above 0",
        ),
        (["--format", "csv", "--height", "inf"], "expected a finite number"),
        (
            ["--format", "skybrush", "--max-speed", "9"],
            "--max-speed: expected --format",
        ),
        (["--max-acceleration", "9"], "expected --format crazyswarm with it"),
        (["--origin", "47,8,0"], "--origin: expected --format qgc or wpl with it"),
        (["--format", "skybrush", "--heading", "0"], "--heading: expected --format"),
        (
            ["--format", "mcap", "--error", "1"],
            "--error: expected --format crazyswarm or skybrush or qgc or wpl with it",
        ),
        (["--format", "gpx"], "expected one of crazyswarm"),
    ],
)
def test_what_does_not_fit_is_said_in_one_line(
    record: Path, tmp_path: Path, words: list[str], said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    try:
        code = exported(record, tmp_path, *words)
    except SystemExit as ended:  # Of argparse
        code = int(str(ended.code))
    assert code in (2, 5)
    assert said in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_missing_extra_is_named(
    record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, "mcap_ros2", None)
    assert exported(record, tmp_path, "--format", "mcap") == 2
    said = capsys.readouterr().err
    assert "a bag of ROS 2 needs mcap_ros2" in said and "[ros]" in said
    assert not any(tmp_path.iterdir())


def test_a_folder_without_a_record_is_said_to_be_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exported(tmp_path / "none", tmp_path / "out", "--format", "csv") == 5
    assert "expected a finished record" in capsys.readouterr().err
