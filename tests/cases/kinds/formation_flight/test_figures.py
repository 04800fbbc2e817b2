from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib import animation as writers
from matplotlib.patches import Circle
from PIL import Image

from swarmstart.cases.drawing.drawing import colour
from swarmstart.cases.kinds.formation_flight.animation import (
    MissingWriterError,
    animate,
    check_writer,
)
from swarmstart.cases.kinds.formation_flight.figures import (
    distances_figure,
    draw,
    entering_figure,
    relative_figure,
    terminal_set_figure,
    tracks_figure,
)
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.record.files import RecordError
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.formation_flight.conftest import Fly

UAVS, SUBSTEPS, STEPS = 5, 4, 6


@pytest.fixture(scope="module")
def trajectory(by_hand: Fly) -> Trajectory:
    """Everybody 9 m off at first, ever less; the last two steps linear."""
    fading = np.linspace(9.0, 0.0, STEPS * SUBSTEPS + 1)
    offsets = np.zeros((UAVS, 4, fading.size))
    offsets[:, 2] = fading * np.linspace(-1.0, 1.0, UAVS)[:, None]
    return by_hand(offsets, linear={4, 5})


def colours(file: Path) -> int:
    with Image.open(file) as image:
        return len(image.convert("RGB").getcolors(1 << 24) or ())


def test_all_figures_are_drawn_in_order_and_not_blank(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
) -> None:
    files = draw(scenario, flight, trajectory, tmp_path / "figures")
    assert [file.name[0] for file in files] == list("abcdefgh")
    assert sorted(files) == sorted((tmp_path / "figures").iterdir())
    assert all(colours(file) > 50 for file in files)


def test_the_obstacle_is_drawn_where_it_is(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> None:
    (disc,) = scenario.obstacles
    for axes in tracks_figure(scenario, flight, trajectory).axes:
        (patch,) = (p for p in axes.patches if isinstance(p, Circle))
        assert patch.center == (disc.x_m, disc.y_m)
        assert patch.radius == disc.radius_m


def test_a_relative_state_is_the_deviation_from_the_slot(
    flight: FormationFlight, trajectory: Trajectory
) -> None:
    (axes,) = relative_figure(flight, trajectory, 2).axes
    curves = [line for line in axes.lines if np.size(line.get_xdata()) > 2]
    assert len(curves) == UAVS
    assert np.asarray(curves[0].get_ydata())[0] == pytest.approx(-9.0)
    assert np.asarray(curves[4].get_ydata())[0] == pytest.approx(9.0)
    assert len(axes.patches) == 2  # the linear steps


def test_distances_and_clearances_have_a_panel_each(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> None:
    distances, clearances = distances_figure(scenario, flight, trajectory).axes
    assert "distance" in distances.get_ylabel()
    assert "clearance" in clearances.get_ylabel()
    free = scenario.model_copy(update={"obstacles": []})
    assert len(distances_figure(free, flight, trajectory).axes) == 1


def test_the_level_of_the_terminal_set_is_marked(
    flight: FormationFlight, trajectory: Trajectory
) -> None:
    (axes,) = terminal_set_figure(flight, trajectory).axes
    levels = [np.asarray(line.get_ydata())[0] for line in axes.lines]
    assert flight.posed.terminal_set.alpha in levels


def test_seven_uavs_have_seven_colours() -> None:
    assert len({colour(number) for number in range(7)}) == 7


def test_an_animation_has_frames_and_leaves_no_other_file(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
) -> None:
    file = tmp_path / "figures" / "flight.gif"
    animate(scenario, flight, trajectory, file)
    with Image.open(file) as image:
        assert image.n_frames == STEPS + 1  # type: ignore[attr-defined]
    assert list(file.parent.iterdir()) == [file]


def test_an_animation_that_fails_leaves_no_file(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
) -> None:
    file = tmp_path / "flight.gif"
    file.mkdir()
    with pytest.raises(RecordError, match="expected a file to write to"):
        animate(scenario, flight, trajectory, file)
    assert list(tmp_path.iterdir()) == [file]


def test_a_writer_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writers.writers, "is_available", lambda name: name == "pillow")
    check_writer("gif")
    with pytest.raises(MissingWriterError, match="needs the program ffmpeg"):
        check_writer("mp4")


def test_the_way_into_the_set_is_drawn_over_its_projections(
    flight: FormationFlight, trajectory: Trajectory
) -> None:
    panels = entering_figure(flight, trajectory).axes
    assert len(panels) == 3
    extent = flight.posed.terminal_set.ellipsoid.extent()
    (outline,) = (line for line in panels[0].lines if line.get_linestyle() == "--")
    assert np.max(np.asarray(outline.get_xdata())) == pytest.approx(extent[2], rel=1e-3)
    assert np.max(np.asarray(outline.get_ydata())) == pytest.approx(extent[3], rel=1e-3)
    dots = [line for line in panels[0].lines if line.get_marker() == "o"]
    assert len(dots) == UAVS and np.size(dots[0].get_xdata()) == 2  # the linear steps
