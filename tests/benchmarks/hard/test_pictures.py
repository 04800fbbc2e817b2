"""Pictures of optima show what the files of the problems state."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart.benchmarks.hard.peers import largest_excess
from swarmstart.benchmarks.hard.pictures import (
    Drawn,
    are_same,
    discs_of,
    panel_of,
    picture,
    section,
)
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.hard import SHIPPED
from swarmstart.cases.hard.best_known import best_known
from swarmstart.cases.kinds.flight import first_problem


def test_discs_of_an_arm_are_those_of_its_file() -> None:
    assert discs_of("arms_2") == {
        (-0.364, -1.209, 0.239), (0.299, -1.547, 0.273), (-1.731, 0.425, 0.309)
    }  # fmt: skip


def test_blocked_places_are_those_inside_the_discs() -> None:
    resolved = resolve(read_document("hard/discs_8"))
    problem = first_problem(resolved.posed()).problem
    points = np.random.default_rng(0).uniform(-1, [[6.1], [2.5]], (2, 500))
    inside = np.zeros(500, dtype=bool)
    for one in resolved.settings["path"]:
        x, y = (-float(part.replace(" ", "")[1:]) for part in one["distance"])
        inside |= np.hypot(points[0] - x, points[1] - y) < float(one["at_least"])
    assert 0 < inside.sum() < 500
    blocked = largest_excess(problem)(points, ()) > 0
    np.testing.assert_array_equal(blocked, inside)


def test_a_mirror_image_of_the_same_cost_is_another_optimum() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        stage_cost=u**2 / 50, terminal_cost=(x**2 - 1) ** 2,
        bounds=ss.Bounds(controls=(-2, 2)),
    )  # fmt: skip
    one = ss.solve(problem, [0.0], search=None, lanes=0, seed=0, backend="casadi")
    assert are_same(one, one)
    moved = replace(one, states=one.states * (1 + 1e-4), cost=one.cost * (1 + 1e-8))
    assert are_same(moved, one)
    assert not are_same(replace(one, states=-one.states + 1e-3), one)
    assert not are_same(replace(one, cost=one.cost + 1e-3), one)


def test_every_problem_has_a_panel_and_a_picture_is_drawn(tmp_path: Path) -> None:
    panels = {panel for panel in map(panel_of, SHIPPED) if not hasattr(panel, "args")}
    assert len(panels) == 4
    posed = first_problem(resolve(read_document("hard/currents_4")).posed())
    one = ss.solve(
        posed.problem, posed.x0, search=None, lanes=0, seed=0, backend="casadi"
    )
    picture(Drawn("currents_4", [one]), tmp_path / "currents_4.png")
    assert (tmp_path / "currents_4.png").stat().st_size > 10_000
    lines = section(Drawn("currents_4", [one]), best_known()["hard/currents_4"], "hard")
    assert lines[0] == "## currents_4"
    assert lines[4] == "![Optima of currents_4](hard/currents_4.png)"
