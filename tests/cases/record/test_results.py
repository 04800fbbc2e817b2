"""Saved results and records, read back as data."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.record import OccupiedFolderError, Recording
from swarmstart.cases.record.results import load
from swarmstart.cases.record.trajectory_arrays import trajectory_arrays
from swarmstart.ocp import (
    Decision,
    OptimalControlProblem,
    Plant,
    Solution,
    Trajectory,
    simulate,
)
from swarmstart.tests.ocp.bounds import PROVEN, with_evidence

NAMES = ["place", "speed"]


def test_a_saved_solution_is_read_again(solution: Solution, tmp_path: Path) -> None:
    solution = replace(solution, decided={"mass": 1.5})
    record = load(solution.save(tmp_path / "new"))
    assert record.summary["cost"] == solution.cost
    assert record.summary["decided"] == {"mass": 1.5}
    assert record.summary["status"] == solution.status.value
    assert record.arrays["state_names"].tolist() == NAMES
    np.testing.assert_array_equal(record.arrays["controls"], solution.controls)
    np.testing.assert_array_equal(record.arrays["dense_states"], solution.path.states)
    assert record.trajectory is None and record.scenario is None


def test_a_bound_is_saved_with_its_certificate(
    solution: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bound = replace(PROVEN, value=solution.verified_cost - 1.0, boxes=np.int64(7))  # type: ignore[arg-type]
    proven = replace(solution, bound=with_evidence(bound, monkeypatch))
    kept = load(proven.save(tmp_path)).summary["bound"]
    assert (kept["kind"], kept["value"]) == ("proven", bound.value)
    assert (kept["boxes"], kept["certificate"]) == (7, "bound_certificate.json")
    file = tmp_path / "bound_certificate.json"
    assert json.loads(file.read_text(encoding="utf-8"))["version"] == 1
    again = replace(solution, bound=None).save(tmp_path, force=True)
    assert load(again).summary["bound"] is None and not file.exists()


def test_a_saved_flight_is_the_same_flight_again(
    named_flight: Trajectory, tmp_path: Path
) -> None:
    again = load(named_flight.save(tmp_path)).trajectory
    assert again is not None and again.state_names == tuple(NAMES)
    before, after = trajectory_arrays(named_flight), trajectory_arrays(again)
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)


class Still:
    """A controller with zero controls and without plans."""

    dt = 0.25

    def decide(
        self,
        time: float,
        state: NDArray[np.float64],
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        return Decision(control=np.zeros(1), plans=())


def test_a_flight_of_a_controller_without_plans_is_saved(
    named_problem: OptimalControlProblem, tmp_path: Path
) -> None:
    plant, rng = (
        Plant(named_problem.model, dt=0.25, substeps=2),
        np.random.default_rng(0),
    )
    drift = simulate(plant, Still(), [0, 1], steps=2, rng=rng)
    again = load(drift.save(tmp_path)).trajectory
    assert again is not None
    np.testing.assert_allclose(again.states[0], [0, 0.25, 0.5], rtol=1e-12)


def test_a_run_is_read_with_its_scenario(tmp_path: Path) -> None:
    resolved = resolve(read_document("swap_5"), assignments=["budget.evaluations=600"])
    finished = run(
        resolved, seed=0, recording=Recording(folder=tmp_path, figures=False)
    )
    record = load(str(tmp_path))
    assert record.summary["key"] == finished.summary()["key"]
    assert record.scenario == resolved.settings
    assert record.trajectory is not None
    np.testing.assert_array_equal(
        record.trajectory.dense_states, finished.trajectory.dense_states
    )
    assert record.trajectory.state_names == finished.trajectory.state_names
    with pytest.raises(OccupiedFolderError, match="the record of a run"):
        finished.trajectory.save(tmp_path, force=True)


def test_a_folder_with_files_is_kept_unless_it_is_forced(
    solution: Solution, named_flight: Trajectory, tmp_path: Path
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(
        OccupiedFolderError, match=r"other files \('notes.txt'\); .* force=True"
    ):
        solution.save(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]
    solution.save(tmp_path, force=True)
    named_flight.save(tmp_path, force=True)
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"notes.txt", "result.json", "trajectory.npz"}
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("result.json", b"{"),
        ("result.json", b"[]"),
        ("result.json", b"\xff"),
        ("trajectory.npz", b""),
        ("trajectory.npz", b"PK\x03\x04 cut short"),
        ("trajectory.npz", b"\x80\x04K*."),  # a pickle
    ],
)
def test_a_file_that_is_no_record_is_refused_with_its_name(
    name: str, content: bytes, named_flight: Trajectory, tmp_path: Path
) -> None:
    named_flight.save(tmp_path)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=f"{name}: expected a file of a record"):
        load(tmp_path)


def test_arrays_of_python_objects_are_not_unpickled(
    named_flight: Trajectory, tmp_path: Path
) -> None:
    named_flight.save(tmp_path)
    np.savez(tmp_path / "trajectory.npz", times=np.array([{}], dtype=object))
    with pytest.raises(RecordError, match="allow_pickle=False"):
        load(tmp_path)


def test_an_array_that_claims_more_numbers_than_the_file_holds_is_refused(
    solution: Solution, tmp_path: Path
) -> None:
    folder = Path(solution.save(tmp_path / "new"))
    header = io.BytesIO()
    content = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(header, content)
    with zipfile.ZipFile(folder / "solution.npz", "w") as members:
        members.writestr("controls.npy", header.getvalue() + bytes(64))
    with pytest.raises(RecordError, match="arrays of 8,000,000,000,000 bytes in a"):
        load(folder)


def test_arrays_that_are_missing_are_refused(
    named_flight: Trajectory, tmp_path: Path
) -> None:
    named_flight.save(tmp_path)
    np.savez(tmp_path / "trajectory.npz", times=np.zeros(2))
    with pytest.raises(RecordError, match=r"trajectory.npz: expected .*dense_times"):
        load(tmp_path)


def test_a_folder_without_a_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"run.json or result.json, found neither"):
        load(tmp_path)
    with pytest.raises(RecordError, match="found no such folder"):
        load(tmp_path / "nowhere")


def test_a_saved_result_says_its_schema(solution: Solution, tmp_path: Path) -> None:
    solution.save(tmp_path)
    content = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert content["schema"] == 1 and content["versions"]["swarmstart"]
