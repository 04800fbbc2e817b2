"""Pages on what many instances are for, made again in a short form."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.benchmarks.uses import design_study, feedback_map, training_set
from swarmstart.tests.benchmarks.test_measured_pages import rows


def test_a_small_map_is_mirrored_and_as_cheap_as_single_solves(tmp_path: Path) -> None:
    """The next neighbours of a grid of 15 x 15 are far apart: not all are optima."""
    page, picture = tmp_path / "page.md", tmp_path / "map.png"
    few = ["--points", "15", "--solves", "5"]
    feedback_map.main([*few, "--write", str(page), "--plot", str(picture)])
    values = {cells[0]: float(cells[1]) for _, cells in rows(page.read_text("utf-8"))}
    assert values["initial states"] == values["confirmed"] == 225
    assert values["mirrored"] >= 0.9 and values["as cheap as `solve`"] >= 0.8
    assert values["jump of the first control, at borders"] > 1
    assert picture.stat().st_size > 10_000


def test_borders_are_where_controls_differ_and_steps_where_the_cost_does() -> None:
    controls = np.zeros((4, 3, 2))
    controls[:, 2, 0] = 2.0
    cost = np.zeros((3, 2))
    cost[2, 0] = 5.0
    known = np.ones((3, 2), dtype=bool)
    one = feedback_map.Map(np.zeros((2, 3, 2)), cost, controls, known)
    apart, control, jump = feedback_map.borders(one)
    assert np.argwhere(apart).tolist() == [[1, 0]]
    assert control[apart].tolist() == [2.0] and jump[apart].tolist() == [5.0]


@pytest.mark.parametrize(("higher", "share"), [(0.0, 1.0), (0.1, 0.0)])
def test_a_cost_above_its_mirror_image_counts(higher: float, share: float) -> None:
    cost = np.ones((2, 2))
    cost[0] += higher
    assert feedback_map.mirrored(cost) == (1.0 + share) / 2


def test_a_small_study_is_confirmed_and_as_cheap_as_single_solves(
    tmp_path: Path,
) -> None:
    page, picture = tmp_path / "page.md", tmp_path / "study.png"
    few = ["--points", "12", "--solves", "3"]
    design_study.main([*few, "--write", str(page), "--plot", str(picture)])
    cells = {row[0]: row[1] for _, row in rows(page.read_text("utf-8"))}
    assert cells["lengths"] == cells["confirmed"] == "12"
    assert float(cells["as cheap as `solve`"]) == 1
    assert cells["best length [m]"] == "0.25"
    assert picture.stat().st_size > 5_000


def test_a_kink_is_where_the_slope_of_the_cost_changes() -> None:
    lengths = np.linspace(0.0, 1.0, 21)
    smooth = lengths + 0.01 * lengths**2
    assert design_study.kinks(smooth, lengths).tolist() == []
    bent = smooth + np.maximum(lengths - 0.5, 0.0)
    assert design_study.kinks(bent, lengths).tolist() == [10]


def test_the_slope_of_a_network_is_that_of_differences() -> None:
    rng = np.random.default_rng(0)
    network = training_set.Network.random(rng)
    inputs, goal = rng.normal(size=(4, 7)), rng.uniform(-1, 1, 7)
    _, slope = network.loss(inputs, goal)
    h = 1e-6 * rng.normal(size=slope.size)
    ends = [
        training_set.Network(network.weights + sign * h).loss(inputs, goal)[0]
        for sign in (1, -1)
    ]
    assert (ends[0] - ends[1]) / 2 == pytest.approx(slope @ h, rel=1e-6)


def test_few_plans_have_their_costs_and_a_network_costs_little_more(
    tmp_path: Path,
) -> None:
    page = tmp_path / "page.md"
    few = ["--points", "10", "--pairs", "2000", "--paths", "20", "--iterations", "60"]
    training_set.main([*few, "--write", str(page)])
    values = {cells[0]: float(cells[1]) for _, cells in rows(page.read_text("utf-8"))}
    assert values["optimal paths"] == values["of these confirmed"] == 100
    assert values["largest difference of a plan's cost, relative"] < 1e-4
    assert values["RMS error of the torque, other pairs"] < 3
    assert values["median excess"] < 1
