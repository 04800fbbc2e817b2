from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib import animation as writers
from matplotlib.patches import Circle
from PIL import Image

from swarmstart.cases.drawing import animation
from swarmstart.cases.drawing.animation import MissingWriterError
from swarmstart.cases.kinds.formation_flight.figures import (
    CONTROLS,
    animate,
    check_writer,
    distances_figure,
    draw,
    relative_figure,
    sheet_figure,
    terminal_set_figure,
)
from swarmstart.cases.kinds.formation_flight.measures import measure
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.formation_flight.shown_path import shown_of
from swarmstart.cases.record.files import RecordError
from swarmstart.ocp import Trajectory
from swarmstart.tests.cases.drawing.reading import (
    bounds,
    curves,
    held,
    legend,
    level,
    named,
    panel,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarmstart.tests.cases.kinds.formation_flight.conftest import Fly

UAVS, SUBSTEPS, STEPS = 5, 4, 6


@pytest.fixture(scope="module")
def trajectory(by_hand: Fly) -> Trajectory:
    """All are up to 9 m off at first, ever less; the last two steps linear."""
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
    assert [file.name[0] for file in files] == list("abcd")
    assert sorted(files) == sorted((tmp_path / "figures").iterdir())
    assert all(colours(file) > 50 for file in files)


@pytest.fixture(scope="module")
def sheet(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> Figure:
    """The sheet of the flight by hand."""
    return sheet_figure(scenario, flight, trajectory)


ERROR = "largest of |dx|, |dy| to the slot [m]"


def test_tracks_are_to_scale_with_the_obstacle_at_its_place(
    scenario: FormationScenario, sheet: Figure
) -> None:
    (disc,) = scenario.obstacles
    axes, *_ = sheet.axes  # Zooms beside it have the same names.
    assert axes.get_aspect() == 1.0
    (patch,) = (p for p in axes.patches if isinstance(p, Circle))
    assert patch.center == (disc.x_m, disc.y_m)
    assert patch.radius == disc.radius_m


def test_tracks_have_a_dot_and_a_label_each_second(
    flight: FormationFlight, trajectory: Trajectory, sheet: Figure
) -> None:
    axes, *_ = sheet.axes  # Zooms beside it have the same names.
    texts = [text.get_text() for text in axes.texts]
    assert [text for text in texts if text.endswith(" s")] == [
        f"{k} s" for k in range(1, 7)
    ]
    first = next(line for line in axes.lines if str(line.get_marker()) == ".")
    wanted = trajectory.states.reshape(UAVS, 4, -1)[0, 2:, 1:]
    assert np.asarray(first.get_data()) == pytest.approx(wanted)


def test_errors_are_on_a_logarithmic_axis_with_the_band_of_settled_ones(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    sheet: Figure,
) -> None:
    axes = panel(sheet, ERROR)
    assert axes.get_yscale() == "log"
    settled = measure(scenario, flight, trajectory)["settle_time_s"]
    (mark,) = named(axes, f"settled from {settled:g} s on")
    assert np.asarray(mark.get_xdata()).tolist() == [settled, settled]
    (band,) = (p for p in axes.patches if p.get_label() == "settled: at most 1 m")
    assert band.get_extents().transformed(axes.transData.inverted()).y1 == 1.0
    assert curves(axes)[0][0] == pytest.approx(9.0)


def test_a_flight_that_never_settles_says_so(
    scenario: FormationScenario, flight: FormationFlight, by_hand: Fly
) -> None:
    off = np.zeros((UAVS, 4, STEPS * SUBSTEPS + 1))
    off[2, 3] = 2.0
    axes = panel(sheet_figure(scenario, flight, by_hand(off)), ERROR)
    assert axes.get_title(loc="right") == "never settled"


def test_controls_are_between_their_bounds(
    scenario: FormationScenario, sheet: Figure, trajectory: Trajectory
) -> None:
    limits = (scenario.vehicle.acceleration_m_s2, scenario.vehicle.turn_rate_rad_s)
    units = ("m/s\N{SUPERSCRIPT TWO}", "rad/s")
    for row, (name, unit, own) in enumerate(zip(CONTROLS, units, limits, strict=True)):
        axes = panel(sheet, f"{name} [{unit}]")
        assert bounds(axes) == [own.lower, own.upper]
        values, edges = held(axes)[1]
        assert values.tolist() == trajectory.controls[2 + row].tolist()
        assert edges.tolist() == trajectory.times.tolist()


def test_the_strip_tells_search_and_terminal_law(sheet: Figure) -> None:
    names = legend(sheet)
    assert "S  search" in names and "T  terminal law" in names
    assert "P  polish" not in names


def test_a_relative_state_is_the_deviation_from_the_slot(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> None:
    shown = shown_of(scenario, flight, trajectory)
    axes = panel(relative_figure(scenario, flight, shown), "x - slot [m]")
    drawn = curves(axes)
    assert len(drawn) == UAVS
    assert drawn[0][0] == pytest.approx(-9.0) and drawn[4][0] == pytest.approx(9.0)
    assert len(axes.patches) == 1  # the band
    assert shaded(axes) == [tuple(trajectory.times[[4, 6]])]


def test_steps_under_the_linear_law_are_shaded_and_no_others(
    scenario: FormationScenario, flight: FormationFlight, by_hand: Fly
) -> None:
    offsets = np.zeros((UAVS, 4, STEPS * SUBSTEPS + 1))
    for linear, spans in (({0, 2, 3}, [[0, 1], [2, 4]]), (set(), [])):
        flown = by_hand(offsets, linear=linear)
        figure = relative_figure(scenario, flight, shown_of(scenario, flight, flown))
        found = shaded(figure.axes[0])
        assert found == [tuple(flown.times[ends]) for ends in spans]
        assert ("linear law" in legend(figure)) == bool(spans)


def shaded(axes: Axes) -> list[tuple[float, float]]:
    """Return begin and end of what is shaded for the linear law."""
    areas = [area for area in axes.collections if area.get_label() == "linear law"]
    boxes = [path.get_extents() for area in areas for path in area.get_paths()]
    return [(box.x0, box.x1) for box in boxes]


def test_distances_and_clearances_have_a_panel_each(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> None:
    shown = shown_of(scenario, flight, trajectory)
    figure = distances_figure(scenario, flight, shown)
    assert figure is not None
    distances, clearances = figure.axes
    assert "distance" in distances.get_ylabel()
    assert "clearance" in clearances.get_ylabel()
    (limit,) = named(clearances, "limit, 0 m")
    assert level(limit) == 0.0
    free = scenario.model_copy(update={"obstacles": []})
    alone = distances_figure(free, flight, shown)
    assert alone is not None and len(alone.axes) == 1


def test_the_level_of_the_terminal_set_is_marked(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> None:
    shown = shown_of(scenario, flight, trajectory)
    axes = panel(terminal_set_figure(scenario, flight, shown), "e'Pe")
    alpha = flight.posed.terminal_set.alpha
    assert alpha in [level(line) for line in axes.lines]


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Animations of 0.4 s."""
    monkeypatch.setattr(animation, "SHORTEST_S", 0.4)
    monkeypatch.setattr(animation, "LONGEST_S", 0.4)


def test_an_animation_has_frames_and_leaves_no_other_file(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
    brief: None,
) -> None:
    file = tmp_path / "figures" / "flight.gif"
    animate(scenario, flight, trajectory, file)
    with Image.open(file) as image:
        assert image.n_frames == 6  # type: ignore[attr-defined]
    assert list(file.parent.iterdir()) == [file]


def test_an_animation_that_fails_leaves_no_file(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
    brief: None,
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
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> None:
    shown = shown_of(scenario, flight, trajectory)
    _, *panels = terminal_set_figure(scenario, flight, shown).axes
    assert len(panels) == 3
    extent = flight.posed.terminal_set.ellipsoid.extent()
    (outline,) = named(panels[0], "terminal set")
    assert np.max(np.asarray(outline.get_xdata())) == pytest.approx(extent[2], rel=1e-3)
    assert np.max(np.asarray(outline.get_ydata())) == pytest.approx(extent[3], rel=1e-3)
    dots = [line for line in panels[0].lines if line.get_marker() == "o"]
    assert len(dots) == UAVS and np.size(dots[0].get_xdata()) == 2  # the linear steps
