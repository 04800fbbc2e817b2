"""The status of a run: certified or not, and the same as from Python."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import pytest

import swarmstart as ss
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.ocp.common import Paragraph


@pytest.mark.parametrize(
    ("variant", "enabled", "is_said"),
    [
        ("literal", "true", True),
        ("literal", "false", False),
        ("corrected", "true", False),
    ],
)
def test_sets_that_are_not_certified_are_named_in_the_status(
    variant: str, enabled: str, is_said: bool
) -> None:
    """The literal law has no certificate; it is used if the scenario asks for it."""
    assignments = ("steps=1", f"dual_mode.enabled={enabled}")
    resolved = resolve(
        read_document("formation_v"), variant=variant, assignments=assignments
    )
    finished = run(resolved, seed=0)
    assert finished.status.endswith("terminal sets are not certified") == is_said
    assert (Paragraph.NOT_CERTIFIED in finished.ended.paragraphs) == is_said


def test_progress_of_one_plan_says_solving_from_the_beginning() -> None:
    said: list[tuple[int, int, str]] = []
    settings = ("search={name: none}", "lanes=0")
    resolved = resolve(read_document("double_integrator"), assignments=settings)
    run(resolved, seed=0, progress=lambda *told: said.append(told))
    # Once before the plan is made, then after each of its steps.
    steps = resolved.scenario.steps
    assert said.count((0, 0, "solving")) == steps + 1
    assert not any(what == "simulating" for _, _, what in said)


def test_a_flat_optimum_has_the_same_status_from_a_file_as_from_python(
    tmp_path: Path,
) -> None:
    """Two pushes of which only the sum counts; perturbed starts decide for both."""
    x, a, b = ca.SX.sym("x"), ca.SX.sym("a"), ca.SX.sym("b")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=ca.vertcat(a, b), ode=a + b), horizon=1.0,
        intervals=4, stage_cost=(a + b) ** 2, terminal=[(x, 1)],
        bounds=ss.Bounds(controls=(-2, 2)),
    )  # fmt: skip
    text = """\
kind: problem
states: {x: {start: 0, rate: a + b}}
controls: {a: {bounds: [-2, 2]}, b: {bounds: [-2, 2]}}
stage_cost: (a + b)**2
terminal: [{expression: x, equals: 1}]
prediction: {horizon_s: 1, intervals: 4}
"""
    stated = tmp_path / "flat.yaml"
    stated.write_text(text, encoding="utf-8")
    solution, found = ss.solve(problem, [0.0], seed=0), ss.run(str(stated), seed=0)
    assert found.ended.plan is solution.status is ss.SolutionStatus.CONVERGED
    assert "no perturbed start led to anything better" in found.ended.reason
