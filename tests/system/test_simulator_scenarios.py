"""Simulators of others as plants of scenarios: allowed, identified, kept, continued."""

from __future__ import annotations

import json
import pickle
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.campaign.running.finished_run import Interrupted, Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.problem.simulated import ChangedFileError
from swarmstart.cases.record.record import OccupiedFolderError, Recording
from swarmstart.simulators import SimulatorError
from swarmstart.tests.simulators import pendulum
from swarmstart.tests.simulators.conftest import Built, fmu
from swarmstart.tests.system.conftest import Command

__all__ = ["fmu"]
TANK = """\
import json, pathlib, sys

with open(pathlib.Path(__file__).with_name("marks"), "a") as file:
    file.write("run\\n")
KEEPS, LAST = "keep" in sys.argv, sys.argv[-1]
steps = 0
for line in sys.stdin:
    asked = json.loads(line)
    if "swarmstart" in asked:
        found = {"states": ["heat", "level"], "controls": ["power", "inflow"],
                 "keeps_state": KEEPS}
    elif "start_at" in asked:
        steps = 0
        found = {"x": asked["start_at"]}
    else:
        (heat, level), (power, inflow) = asked["x"], asked["u"]
        steps += 1
        level += asked["dt"] * (inflow - 0.5 * level)
        heat += asked["dt"] * (power - 0.1 * heat)
        found = {"x": [heat, level]}
        if LAST.isdigit() and steps > int(LAST):
            found = {"error": "the pump is broken"}
    print(json.dumps(found), flush=True)
"""
SCENARIO = """\
kind: problem
steps: 6
states:
  level: {start: 0.2, rate: inflow - 0.5*level}
  heat: {start: 1, rate: power - 0.1*heat}
controls:
  inflow: {bounds: [0, 1]}
  power: {bounds: [0, 1]}
stage_cost: (level - 1)**2 + (heat - 2)**2 + 0.01*power**2
prediction: {horizon_s: 2, intervals: 4, integrator: euler, substeps: 4}
feedback: receding_horizon
search: {name: none}
lanes: 0
measures: {final: level.end}
plant: {command: [PYTHON, tank.py, keep], step_s: 0.125}
"""


@dataclass(frozen=True)
class Project:
    """A folder with a scenario and its program, which leaves a mark when it is run."""

    folder: Path

    @property
    def scenario(self) -> Path:
        return self.folder / "mine.yaml"

    @property
    def runs(self) -> int:
        """Number of times that the program was run."""
        marks = self.folder / "marks"
        return len(marks.read_text().splitlines()) if marks.exists() else 0

    def resolved(self, *assignments: str, allowed: bool = True) -> Resolved:
        found = resolve(read_document(str(self.scenario)), assignments=assignments)
        return replace(found, allow_code=allowed)

    def flaws(self, *assignments: str) -> str:
        with pytest.raises(InvalidScenarioError) as caught:
            self.resolved(*assignments)
        return str(caught.value)


@pytest.fixture
def project(tmp_path: Path) -> Project:
    made = Project(tmp_path / "project")
    made.folder.mkdir()
    (made.folder / "tank.py").write_text(TANK)
    made.scenario.write_text(SCENARIO.replace("PYTHON", sys.executable))
    return made


def kept(folder: Path) -> Recording:
    """Return how a run is recorded in a folder, without figures."""
    return Recording(folder=folder, figures=False)


def same(one: Run, other: Run) -> bool:
    """Return whether two runs have the same path, to the last bit."""
    a, b = one.trajectory, other.trajectory
    return np.array_equal(a.dense_states, b.dense_states) and np.array_equal(
        a.controls, b.controls
    )


def test_nothing_runs_a_program_without_the_option(
    project: Project, command: Command, tmp_path: Path
) -> None:
    file, tank = project.scenario, f"{sys.executable} tank.py keep"
    checked = command("check", file)
    assert (checked.code, checked.out) == (0, f"{file}: valid; {tank} was not run\n")
    shown = command("run", file, "--print-config")
    assert shown.code == 0 and "- tank.py" in shown.out
    flights = ["--seeds", "1", "--solvers", "ipopt", "--out", tmp_path / "compared"]
    for refused in (
        command("run", file, "--out", tmp_path / "out"),
        command("compare", file, *flights),
    ):
        assert (refused.code, refused.out) == (2, "")
        assert refused.err.startswith(f"swarmstart: {tank}: expected --allow-code ")
    with pytest.raises(ss.CodeNotAllowedError):
        ss.run(file, seed=0)
    assert project.runs == 0


def test_a_flight_that_is_not_run_by_a_command_needs_the_permission_too(
    project: Project,
) -> None:
    resolved = project.resolved(allowed=False)
    flight = flight_of(resolved.posed(), resolved.scenario)
    rng = np.random.default_rng(0)
    with pytest.raises(ss.CodeNotAllowedError):
        next(ss.fly(flight.plant, flight.controller, flight.x0, steps=1, rng=rng))
    assert project.runs == 0


@pytest.mark.parametrize("option", ["--allow-code", "--allow-python"])
def test_the_option_and_its_old_name_run_it(
    project: Project, command: Command, tmp_path: Path, option: str
) -> None:
    out = tmp_path / "out"
    said = command("run", project.scenario, option, "--no-figures", "--out", out)
    assert said.code == 0 and project.runs == 1
    assert "tank.py keep, as --allow-code allows" in said.err
    assert (out / "tank.py").read_text() == TANK


def test_its_path_is_that_of_the_same_steps_in_python(project: Project) -> None:
    """The program's steps are those of Euler, as the plan's: no error is left."""
    finished = run(project.resolved(), seed=0)
    path = finished.trajectory
    assert path.dense_states.shape == (2, 25) and path.controls.shape == (2, 6)
    x = np.array([0.2, 1.0])
    for step in range(24):
        assert path.dense_states[:, step] == pytest.approx(x, abs=0)
        u = path.controls[:, step // 4]
        x = x + 0.125 * (u - np.array([0.5, 0.1]) * x)
    assert finished.measures["final"] == path.states[0, -1]
    first = path.decisions[0].plans[0]
    assert path.states[:, 1] == pytest.approx(first.states[:, 1], abs=1e-12)


def test_a_comparison_of_plans_needs_no_permission(
    project: Project, command: Command, tmp_path: Path
) -> None:
    """Plans do not depend on the plant, so that the program is not run for them."""
    said = command(
        "compare", project.scenario, "--of", "plan", "--seeds", "1",
        "--solvers", "ipopt", "--set", "prediction.integrator=rk4",
        "--out", tmp_path / "out",
    )  # fmt: skip
    assert said.code == 0, said.err
    assert project.runs == 0


def test_a_comparison_of_flights_runs_it_in_workers(
    project: Project, command: Command, tmp_path: Path
) -> None:
    said = command(
        "compare", project.scenario, "--seeds", "1", "--solvers", "ipopt",
        "--allow-code", "--json", "--workers", "1", "--out", tmp_path / "out",
    )  # fmt: skip
    assert said.code == 0, said.err
    assert project.runs == 2  # The other solver is IPOPT from random starts.
    rows = json.loads(said.out)["scenarios"][0]["rows"]
    assert [row["feasible"] for row in rows] == [1, 1]


def test_a_record_can_be_run_again_and_has_the_file(
    project: Project, tmp_path: Path
) -> None:
    first = run(project.resolved(), seed=0, recording=kept(tmp_path / "out"))
    copied = Project(tmp_path / "out")
    again = resolve(read_document(str(copied.folder / "scenario.yaml")))
    assert again.settings["plant"] == first.resolved.settings["plant"]
    shutil.rmtree(project.folder)
    assert same(run(replace(again, allow_code=True), seed=0), first)
    with pytest.raises(OccupiedFolderError, match="than that of the file to be run"):
        run(
            replace(again, allow_code=True),
            seed=0,
            recording=replace(kept(copied.folder), force=True),
        )


def test_another_program_is_another_run(project: Project) -> None:
    """The hash of the program is among the settings, and so in a record's key."""
    before = project.resolved().settings
    (project.folder / "tank.py").write_text(TANK + "\n# changed\n")
    after = project.resolved().settings
    assert before["plant"]["sha256"] != after["plant"]["sha256"]
    other = json.dumps(before["plant"]["sha256"])
    assert "the file has changed" in project.flaws(f"plant.sha256={other}")
    assert "found 'other.py'" in project.flaws("plant.sha256={other.py: abc}")


def test_a_program_that_changes_after_reading_is_not_run(project: Project) -> None:
    resolved = project.resolved()
    (project.folder / "tank.py").write_text(TANK + "\n# changed\n")
    with pytest.raises(ChangedFileError, match=r"tank\.py: the file has changed since"):
        run(resolved, seed=0)
    (project.folder / "tank.py").unlink()
    with pytest.raises(ChangedFileError, match="expected a file that can be read"):
        run(resolved, seed=0)
    assert project.runs == 0


def test_an_interrupted_run_goes_on_with_the_same_bits(
    project: Project, tmp_path: Path
) -> None:
    """The simulator makes the finished steps again; the plans are not made again."""
    whole = run(project.resolved(), seed=0)

    def stop(done: int, total: int, what: str) -> None:
        if (done, what) == (3, "simulating"):
            raise KeyboardInterrupt

    recording = kept(tmp_path / "out")
    with pytest.raises(Interrupted):
        run(project.resolved(), seed=0, recording=recording, progress=stop)
    rest = run(project.resolved(), seed=0, recording=recording)
    assert rest.resumed in (2, 3)
    assert same(rest, whole)


def test_a_simulator_that_does_other_steps_is_run_from_the_start(
    project: Project, tmp_path: Path
) -> None:
    """A program that depends on a file beside it can answer differently next time."""
    tank = project.folder / "tank.py"
    (project.folder / "offset").write_text("0")
    tank.write_text(
        TANK.replace(
            'found = {"x": [heat, level]}',
            'heat += float(open(__file__.replace("tank.py", "offset")).read()); '
            'found = {"x": [heat, level]}',
        )
    )

    def stop(done: int, total: int, what: str) -> None:
        if (done, what) == (3, "simulating"):
            raise KeyboardInterrupt

    recording = kept(tmp_path / "out")
    with pytest.raises(Interrupted):
        run(project.resolved(), seed=0, recording=recording, progress=stop)
    (project.folder / "offset").write_text("1e-9")
    rest = run(project.resolved(), seed=0, recording=recording)
    assert rest.resumed == 0
    assert same(rest, run(project.resolved(), seed=0))


def test_a_failure_keeps_the_finished_steps(project: Project, tmp_path: Path) -> None:
    """The tenth of its steps is within the third interval."""
    words = f"plant.command=[{sys.executable}, tank.py, keep, '10']"
    recording = kept(tmp_path / "out")
    with pytest.raises(SimulatorError, match="it said: 'the pump is broken'"):
        run(project.resolved(words), seed=0, recording=recording)
    assert (tmp_path / "out" / "partial.npz").exists() or list(
        (tmp_path / "out").glob("*partial*")
    )


def test_a_resolved_scenario_keeps_its_permission_in_another_process(
    project: Project,
) -> None:
    for allowed in (True, False):
        resolved = project.resolved(allowed=allowed)
        again = pickle.loads(pickle.dumps(resolved))
        assert again.allow_code is allowed
        assert again.settings == resolved.settings


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("plant.step_s=0.3", "whole number of steps in a control interval of 0.5 s"),
        ("plant.step_s=1e-6", "interval of 0.5 s, 1 to 10,000, found steps of 1e-06 s"),
        ("plant.states=[level]", "expected 2 names, found 1"),
        ("plant.states=[level, level]", "expected another name, found 'level' again"),
        ("plant.command=[]", "expected command to be a list of words"),
        ("plant.command=tank.py", "expected command to be a list of words"),
        ("plant.limit_s=0", "greater than 0"),
        ("plant={fmu: ../x.fmu}", "a file in the scenario's folder or below"),
        ("plant={fmu: /x.fmu}", "a file in the scenario's folder or below"),
        ("plant={fmu: tank.py}", "such as plant.fmu; found 'tank.py'"),
        ("plant={fmu: x.fmu}", "expected a file that can be read: no such file"),
        ("plant={onnx: x.onnx}", "expected a file that can be read: no such file"),
        ("plant={jsbsim: ../f16, altitude_m: 0, airspeed_m_s: 1}", "jsbsim"),
        (
            "plant={jsbsim: f16, altitude_m: 0, airspeed_m_s: 1}",
            "expected a name of states of an aircraft, found 'level'; known: speed_m_s",
        ),
        ("plant.substeps=3", "substeps"),
        ("states.heat.next=2*heat", "expected a rate with plant.command"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_runs(
    project: Project, assignment: str, expected: str
) -> None:
    assert expected in project.flaws(assignment)
    assert project.runs == 0


def test_wrong_names_of_a_program_are_said_with_the_nearest(project: Project) -> None:
    resolved = project.resolved("plant.states=[level, heta]")
    with pytest.raises(SimulatorError, match="found 'heta'; did you mean 'heat'"):
        run(resolved, seed=0)


def test_a_decided_end_time_takes_no_simulator(project: Project) -> None:
    found = project.flaws(
        "prediction.horizon_s={free: [0.4, 2]}",
        "feedback={law: receding_horizon, period_s: 0.5}",
    )
    assert "expected a number with plant.command, whose steps have one length" in found


def test_phases_take_no_simulator(project: Project) -> None:
    phases = "phases=[{horizon_s: 1, intervals: 2}, {horizon_s: 1, intervals: 2}]"
    found = project.flaws(phases, "feedback=open_loop", "steps=4")
    assert "expected no command with phases" in found


def test_committed_plans_keep_a_distance_from_another_plant(project: Project) -> None:
    """The largest error must be given, as for a model that differs."""
    found = project.flaws(
        "vehicles={members: [{name: a}, {name: b}], planning: committed, "
        "separation: {of: [level, heat], distance: 0.1}}",
        "dual_mode={at: {level: 1, heat: 2}, Q: {level: 1, heat: 1}, "
        "R: {inflow: 1, power: 1}}",
        "vehicles.members=[{name: a}, {name: b, start: {level: 3}}]",
    )
    assert "expected a number above 0 with a plant that differs" in found


FLOWN = """\
kind: problem
steps: 5
states:
  angle: {start: 0.25, rate: speed}
  speed: {start: 0, rate: torque - 9.81*sin(angle)}
controls: {torque: {bounds: [-5, 5]}}
stage_cost: angle**2 + 0.1*speed**2 + 0.01*torque**2
prediction: {horizon_s: 1, intervals: 10}
feedback: receding_horizon
search: {name: none}
lanes: 0
"""


def flown(folder: Path, plant: dict[str, Any], text: str = FLOWN) -> Run:
    """Return a run of the pendulum with a plant, whose code is allowed."""
    file = folder / "flown.yaml"
    file.write_text(f"{text}plant: {json.dumps(plant)}\n")
    return ss.run(file, seed=0, allow_code=True, figures=False)


def test_an_fmu_has_the_bits_of_its_model(fmu: Built, tmp_path: Path) -> None:
    """Both integrate by the same steps; the friction is a parameter of the FMU."""
    shutil.copy(fmu(), tmp_path / "pendulum.fmu")
    theirs = flown(tmp_path, {"fmu": "pendulum.fmu", "values": {"friction": 0.2}})
    ours = ss.Plant(pendulum.model(), dt=0.1, substeps=pendulum.SUBSTEPS)
    x = np.array([0.25, 0.0])
    for step in range(5):
        assert np.array_equal(theirs.trajectory.states[:, step], x)
        x = ours(x, theirs.trajectory.controls[:, step])[:, -1]
    for unit, is_wrong in (("rad.s-1", False), ("", False), ("deg/s", True)):
        text = FLOWN.replace("rate: torque", f"unit: '{unit}', rate: torque")
        if is_wrong:
            with pytest.raises(SimulatorError, match="expected speed in deg/s, as the"):
                flown(tmp_path, {"fmu": "pendulum.fmu"}, text)
        else:
            flown(tmp_path, {"fmu": "pendulum.fmu"}, text)
    wrong = {"fmu": "pendulum.fmu", "states": ["angle", "sped"]}
    with pytest.raises(SimulatorError, match="found 'sped'; did you mean 'speed'"):
        flown(tmp_path, wrong)
    with pytest.raises(SimulatorError, match="found 'frction'"):
        flown(tmp_path, {"fmu": "pendulum.fmu", "values": {"frction": 0.2}})


def test_a_network_makes_the_steps(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    network = pytest.importorskip("swarmstart.tests.simulators.test_network")
    network.network(tmp_path / "net.onnx")
    found = flown(tmp_path, {"onnx": "net.onnx"}).trajectory
    net = ss.OnnxPlant(tmp_path / "net.onnx", states=["a", "s"], controls=["t"], dt=0.1)
    x = np.array([0.25, 0.0])
    for step in range(5):
        assert np.array_equal(found.states[:, step], x)
        x = net.step(x, found.controls[:, step], 0.1)


@pytest.mark.parametrize("name", ["formation_v_jsbsim", "close_formation_jsbsim"])
def test_five_aircraft_begin_in_their_places(name: str) -> None:
    """Their first seconds; the claims are those of the whole flight."""
    pytest.importorskip("jsbsim")
    found = ss.run(name, seed=0, settings={"steps": 3}, figures=False)
    path = found.trajectory
    assert path.states.shape == (20, 4)
    assert path.states[0::4] == pytest.approx(222, abs=8)  # Airspeeds.
    assert np.diff(path.states[2::4], axis=1) == pytest.approx(222, abs=8)  # Norths.
    assert path.states[2::4, 0] == pytest.approx(found.flight.x0[2::4], abs=1e-3)
    assert found.status.startswith("simulated to the end; every planned step found")


@pytest.mark.parametrize("name", ["formation_v_jsbsim", "close_formation_jsbsim"])
def test_five_aircraft_keep_their_claims(name: str) -> None:
    pytest.importorskip("jsbsim")
    found = ss.run(name, seed=0, figures=False)
    assert [claim["holds"] for claim in found.claims] == [True] * 3
