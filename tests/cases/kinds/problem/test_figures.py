"""A problem is drawn with its own names and units, and with what its plans knew."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.drawing import problem_figures
from swarmstart.cases.drawing.plan_figures import Flown, plan_paths
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.problem import figures
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.ocp import Known, Trajectory, simulate
from swarmstart.tests.cases.kinds.problem.conftest import PENDULUM, scenario_of

ORDERED = """\
kind: problem
parameters: {{gain: 1 + time}}
signals: {{wind: 3*time}}
states: {{x: {{start: 0, rate: gain*u, unit: m}}, y: {{start: 1, rate: u - y}}}}
controls: {{u: {{bounds: [-1, 1], unit: m/s}}}}
stage_cost: (x - 2)**2 + 0*wind
prediction: {{horizon_s: 1, intervals: 4}}
steps: 2
search: {{name: none}}
feedback: receding_horizon
vehicles:
  planning: {planning}
  members: [{{name: a}}, {{name: b, start: {{x: 5}}}}]
  separation: {{of: [y, x], distance: 0.5}}
"""


def drawn(
    text: str, folder: Path, monkeypatch: pytest.MonkeyPatch, *, recorded: bool = False
) -> tuple[dict[str, Any], Trajectory, list[str]]:
    """Return what the drawing was given, the path, and the names of the files."""
    scenario = scenario_of(text)
    flight = flight_of(pose(scenario), scenario)
    rng = np.random.default_rng(0)
    path = simulate(
        flight.plant, flight.controller, flight.x0, steps=scenario.steps, rng=rng
    )
    shown = without_states(path) if recorded else path
    given: dict[str, Any] = {}

    def keep(problem: object, trajectory: Trajectory, **more: Any) -> Any:
        given.update(more, problem=problem)
        return problem_figures.figures_of(problem, trajectory, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(figures, "figures_of", keep)
    files = figures.draw(scenario, flight, shown, folder)
    assert all(file.stat().st_size > 1000 for file in files)
    return given, path, [file.stem for file in files]


def without_states(path: Trajectory) -> Trajectory:
    """Return a path as a record keeps it."""
    empty = np.empty((0, 0))
    return replace(
        path,
        decisions=tuple(
            replace(one, plans=tuple(replace(p, states=empty) for p in one.plans))
            for one in path.decisions
        ),
    )


def with_starts(path: Trajectory, starts: Sequence[Array]) -> Trajectory:
    """Return a path with the start of each plan, which a record keeps as well."""
    decisions = [
        replace(one, plans=(replace(one.plans[0], start=start),))
        for one, start in zip(path.decisions, starts, strict=True)
    ]
    return replace(path, decisions=tuple(decisions))


def test_one_problem_is_drawn_with_its_names_and_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = PENDULUM + "search: {name: none}\npath: [{expression: angle, upper: 9}]\n"
    given, _, files = drawn(text, tmp_path, monkeypatch)
    labels = given["labels"]
    assert (labels.states, labels.controls) == (("angle", "speed"), ("torque",))
    assert labels.units == {"angle": "rad", "speed": "rad/s", "torque": ""}
    assert (tuple(labels.vehicles), labels.maximize) == (("",), False)
    assert {"a_sheet", "d_slack"} <= set(files) and given["place"] is None


@pytest.mark.parametrize("recorded", [False, True])
def test_a_plan_is_drawn_with_what_it_knew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recorded: bool
) -> None:
    """Plans of a record have no states: they are integrated again."""
    text = ORDERED.format(planning="priority")
    given, path, _ = drawn(text, tmp_path, monkeypatch, recorded=recorded)
    assert [p.model.nx for p in given["problem"]] == [2, 2]
    assert [*given["labels"].vehicles] == ["a", "b"]
    assert given["place"] is None  # x has a unit and y has none.
    for step in (0, 1):
        begin = step * 0.25
        wind = 3 * (begin + np.linspace(0, 1, 5))
        first, second = (given["known"](step, number) for number in (0, 1))
        assert isinstance(first, Known) and isinstance(second, Known)
        assert np.ravel(first.parameters) == pytest.approx([1 + begin])
        np.testing.assert_allclose(np.array(first.signals), np.array([wind]))
        seen = path.decisions[step].plans[0].states
        shown = np.vstack([wind, seen[1], seen[0]])
        np.testing.assert_allclose(np.array(second.signals), shown, atol=1e-9)


@pytest.mark.parametrize("recorded", [False, True])
def test_plans_that_end_at_a_fixed_time_are_drawn_as_they_were_made(
    recorded: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each with the signals of its own horizon, and the states that it predicted."""
    text = """\
kind: problem
states: {level: {start: 0, rate: inflow + 0.1*wave}}
controls: {inflow: {bounds: [-2, 2]}}
signals: {wave: {times: [0, 1, 2, 3], values: [0, 1, -1, 0]}}
stage_cost: inflow**2
path: [{expression: level, upper: 3.2}]
terminal: [{expression: level, equals: 3}]
prediction: {horizon_s: 2, intervals: 4}
feedback: {law: receding_horizon, ends_at_s: 3, period_s: 0.5}
search: {name: none}
"""
    given, path, _ = drawn(text, tmp_path, monkeypatch, recorded=recorded)
    starts = [decision.plans[0].x0 for decision in path.decisions]
    shown = with_starts(without_states(path), starts) if recorded else path
    (problem,) = given["problem"]
    flown = Flown(
        problems=(problem,), trajectory=shown, labels=given["labels"],
        known=given["known"],
    )  # fmt: skip
    plans = plan_paths(flown)
    ends = [plan.times[-1] for plan in plans]
    assert ends == pytest.approx([2.0, 2.5, 3.0, 3.0, 3.0, 3.0])
    for plan, decision in zip(plans, path.decisions, strict=True):
        predicted = decision.plans[0].states[:1]
        np.testing.assert_allclose(plan.states, predicted, rtol=0, atol=1e-12)


def test_vehicles_planned_together_are_one_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = ORDERED.format(planning="joint")
    given, _, _ = drawn(text, tmp_path, monkeypatch)
    assert [p.model.nx for p in given["problem"]] == [4]


def test_states_that_keep_vehicles_apart_are_drawn_as_a_position(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = ORDERED.format(planning="joint").replace(
        "rate: u - y", "rate: u - 0.5*y, unit: m"
    )
    text += "path: [{distance: [y - 3, x - 2], at_least: 0.1, name: mast}]\n"
    given, _, files = drawn(text, tmp_path, monkeypatch)
    place = given["place"]
    assert place.rows == (1, 0) and place.discs == [(3.0, 2.0, 0.1)]
    assert "e_tracks" in files


def test_a_maximum_is_drawn_as_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = ORDERED.format(planning="joint") + "maximize: true\n"
    given, _, _ = drawn(text.replace("(x - 2)**2", "x"), tmp_path, monkeypatch)
    assert given["labels"].maximize
