from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from swarmstart.cases.format.kind import NoAnimationError
from swarmstart.cases.kinds.close_formation.figures import (
    draw,
    exact_flight,
    map_figure,
    motion_figure,
    settled_s,
    sheet_figure,
)
from swarmstart.cases.kinds.close_formation.kind import KIND
from swarmstart.cases.kinds.close_formation.pose import CloseFormationFlight
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.ocp import Trajectory, simulate
from swarmstart.tests.cases.drawing.reading import (
    bounds,
    covered,
    curves,
    legend,
    named,
    panel,
)
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.close_formation.conftest import Fly, Make


@pytest.fixture(scope="module")
def trajectory(by_hand: Fly) -> Trajectory:
    offsets = np.zeros((6, 301))
    fading = np.exp(-np.arange(251) / 50)
    offsets[0, 50:], offsets[1, 50:] = 50 * fading, 15 * fading
    return by_hand(offsets, costs=np.geomspace(1e3, 1e-12, 300))


def colours(file: Path) -> int:
    with Image.open(file) as image:
        return len(image.convert("RGB").getcolors(1 << 24) or ())


def test_all_figures_are_drawn_in_order_and_not_blank(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
) -> None:
    files = draw(scenario, flight, trajectory, tmp_path / "figures")
    assert [file.name[0] for file in files] == list("abc")
    assert sorted(files) == sorted((tmp_path / "figures").iterdir())
    assert all(colours(file) > 50 for file in files)


def test_the_aircraft_on_the_map_are_to_scale(
    flight: CloseFormationFlight, trajectory: Trajectory
) -> None:
    above, behind, *_ = map_figure(flight, trajectory).axes
    leader, wingman = (patch.get_path().vertices for patch in above.patches)
    for outline in (np.asarray(leader), np.asarray(wingman)):
        assert np.ptp(outline[:, 0]) == pytest.approx(flight.posed.aircraft.span_ft)
    moved = np.asarray(wingman).mean(axis=0) - np.asarray(leader).mean(axis=0)
    x, y, *_ = trajectory.states[:, -1]
    assert moved == pytest.approx([-y, -x])
    wings = [line for line in behind.lines if line.get_label() == "leader"]
    assert np.ptp(np.asarray(wings[0].get_xdata())) == flight.posed.aircraft.span_ft


def test_the_sheet_marks_when_the_wingman_is_settled_and_the_bounds_of_commands(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> None:
    figure = sheet_figure(scenario, flight, trajectory, None)
    errors = panel(figure, "distance from the slot [ft]")
    # 50 ft fade by exp(-1/50) a step of 0.1 s: below 1 ft after 50 ln 50 steps.
    settled = 5.0 + 0.1 * np.ceil(50 * np.log(50))
    assert settled_s(scenario, trajectory) == pytest.approx(settled)
    (mark,) = named(errors, f"settled from {settled:g} s on")
    assert np.asarray(mark.get_xdata())[0] == pytest.approx(settled)
    assert errors.get_yscale() == "log" and curves(errors)[0].max() == 50.0
    span = scenario.commands.heading_rad
    wanted = np.degrees([span.lower, span.upper])
    assert bounds(panel(figure, "heading command [deg]")) == pytest.approx(wanted)


def test_the_reference_is_the_flight_of_the_exact_minimum(make: Make) -> None:
    short = make("steps=60", "reference=ipopt")
    exact, flight = exact_flight(short), build(short)
    flown = simulate(
        flight.plant, flight.controller, flight.x0, steps=60,
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert exact.states.shape == flown.states.shape
    # Both at the bounds in the first second of the manoeuvre: within 1 ft there.
    assert np.abs(exact.states[:2] - flown.states[:2]).max() < 1.0


def test_the_motion_has_one_legend_outside_its_panels(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> None:
    figure = motion_figure(scenario, flight, trajectory, None)
    assert [name[:11] for name in legend(figure)] == [
        "leader", "wingman", "in the slot",
    ]  # fmt: skip
    assert covered(figure) == []


def test_there_is_no_animation() -> None:
    with pytest.raises(NoAnimationError, match="no animation, got --animation gif"):
        KIND.check_animation("gif")
