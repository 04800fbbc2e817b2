"""A pendulum in a file of Python, which leaves a mark each time it is run."""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from swarmstart.cases.format.scenario import Resolved, read_document, resolve

MODEL = """\
import pathlib

import casadi as ca
import swarmstart as ss

with open(pathlib.Path(__file__).with_name("marks"), "a") as file:
    file.write("run\\n")


def build(gravity=9.81):
    angle, speed, torque = (ca.SX.sym(n) for n in ("angle", "speed", "torque"))
    model = ss.Model(
        states=ca.vertcat(angle, speed),
        controls=torque,
        ode=ca.vertcat(speed, torque - gravity * ca.sin(angle)),
    )
    problem = ss.OptimalControlProblem(
        model,
        horizon=3,
        intervals=50,
        stage_cost=torque**2,
        terminal=[angle - ca.pi, speed],
        bounds=ss.Bounds(controls=(-8, 8)),
    )
    return problem, [0, 0]
"""
SCENARIO = """\
kind: python
problem: my_model.py:build
arguments: {gravity: 9.81}
steps: 50
measures: {final_angle: angle.end, effort: integral(torque**2)}
budget: {evaluations: 600}
"""


@dataclass(frozen=True)
class Project:
    """A folder with a scenario and its file."""

    folder: Path

    @property
    def scenario(self) -> Path:
        return self.folder / "mine.yaml"

    @property
    def model(self) -> Path:
        return self.folder / "my_model.py"

    @property
    def runs(self) -> int:
        """Number of times that the file was run."""
        marks = self.folder / "marks"
        return len(marks.read_text().splitlines()) if marks.exists() else 0

    def resolved(self, *assignments: str) -> Resolved:
        document = read_document(str(self.scenario))
        return resolve(document, assignments=assignments)


@pytest.fixture
def project(tmp_path: Path) -> Project:
    made = Project(tmp_path / "project")
    made.folder.mkdir()
    made.model.write_text(MODEL)
    made.scenario.write_text(SCENARIO)
    return made


def allowed(resolved: Resolved) -> Resolved:
    """Return a scenario whose file may be run."""
    return replace(resolved, allow_code=True)
