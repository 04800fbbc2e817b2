"""The player: what a record gives it, and what a reader sees and does in a browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.cases.drawing.report.outlook import outlook_of
from swarmstart.cases.drawing.report.pages.run_content import RunContent, run_content
from swarmstart.cases.drawing.report.pages.run_page import page_of
from swarmstart.cases.drawing.report.panels_over_time import (
    reduced,
    series_panels,
    solver_panel,
)
from swarmstart.cases.drawing.report.player import caption, player
from swarmstart.cases.drawing.report.tracks import Tracks, tracks_of
from swarmstart.cases.drawing.vehicles import discs_of_problem
from swarmstart.cases.record.results import Record, load
from swarmstart.tests.cases.drawing.report.flown_records import (
    Opened,
    browser,
    circling,
    flown_point,
)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return load(flown_point(tmp_path_factory.mktemp("point")))


@pytest.fixture(scope="module")
def content(record: Record) -> RunContent:
    return run_content(record.folder)


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    with browser() as one:
        yield one


def shown(opened: Opened, content: RunContent, tracks: Tracks, folder: Path) -> Any:
    """Open the page of a run with other tracks."""
    html = page_of(replace(content, tracks=tracks, figures=()))
    return opened.show(html, folder / "page.html")


def place(page: Any, selector: str = ".vehicle") -> tuple[float, float]:
    """Return where a vehicle is drawn."""
    text = page.locator(selector).first.get_attribute("transform")
    found = re.match(r"translate\(([-\d.]+) ([-\d.]+)\)", text)
    assert found is not None
    return float(found[1]), float(found[2])


def clock_of(page: Any) -> float:
    return float(page.locator(".clock").inner_text())


def scrub(page: Any, frame: int) -> None:
    page.locator(".scrub input").evaluate(
        "(node, to) => { node.value = to; node.dispatchEvent(new Event('input')); }",
        frame,
    )


# What the record gives.


def test_tracks_are_the_recorded_positions(record: Record) -> None:
    """Frames at the plant's steps: positions are the states there, x first."""
    tracks = tracks_of(record)
    flight, plane = record.trajectory, tracks.plane
    assert flight is not None and plane is not None
    expected = [
        np.interp(tracks.times, flight.dense_times, flight.dense_states[row])
        for row in (0, 1)
    ]
    np.testing.assert_allclose(plane.positions[0], expected)
    assert (plane.unit, tracks.vehicles) == ("m", ("",))
    assert [series.name for series in tracks.series] == ["ax", "ay", "vx", "vy"]
    assert (tracks.series[0].lower, tracks.series[0].upper) == (-1.0, 1.0)


def test_plans_start_at_the_vehicle_and_lead_where_it_flies_next(
    record: Record,
) -> None:
    """No disturbance: the first interval of each plan is carried out."""
    flight = record.trajectory
    assert flight is not None
    paths = outlook_of(record, flight).paths
    assert [time for time, _ in paths] == pytest.approx(list(flight.times[:-1]))
    for step, (_, (path,)) in enumerate(paths):
        assert path is not None
        nodes = (path.shape[1] - 1) // 4
        np.testing.assert_allclose(path[:, 0], flight.states[:, step], atol=1e-12)
        np.testing.assert_allclose(
            path[:, nodes], flight.states[:, step + 1], atol=1e-9
        )


def test_distances_from_a_fixed_place_are_discs() -> None:
    """x - c in either sign is a disc at c; a moving place and a scaled one are not."""
    path = [
        {"distance": ["x - a", "0.5 + y"], "at_least": "2*a", "name": "mast"},
        {"distance": ["3 - x", "y"], "at_most": 1},
        {"distance": ["x - 8*time", "y"], "at_least": 1},
        {"distance": ["2*x", "y"], "at_least": 1},
        {"distance": ["x*x", "y"], "at_least": 1},
        {"distance": ["x", "y"], "at_least": "unknown"},
        "no mapping",
    ]
    scenario = {"path": path, "constants": {"b": "a/2", "a": "3"}}
    found = discs_of_problem(scenario, ("x", "y"))
    assert [(d.x, d.y, d.radius, d.is_limit) for d in found] == [
        (3.0, -0.5, 6.0, False),
        (3.0, 0.0, 1.0, True),
    ]


def test_the_longest_time_of_the_solver_is_not_lost_where_steps_are_many() -> None:
    steps = 5000
    seconds = np.full(steps, 0.01)
    seconds[3210] = 0.7
    tracks = replace(
        circling(1),
        step_times=np.linspace(0.0, 10.0, steps + 1),
        step_seconds=seconds,
        without_plan=np.arange(steps) == 7,
    )
    panel = solver_panel(tracks)
    assert panel is not None and len(panel.values) <= 300
    assert max(v for v in panel.values if v is not None) == 0.7
    assert panel.drawing.count("l6 6m-6 0l6-6") == 1  # The cross.
    assert "5000 steps took longer" in panel.alt
    assert "the 1 of 5000 steps at which" in " ".join(caption(tracks))


def test_a_plan_flown_to_its_end_has_no_panel_of_the_solver() -> None:
    tracks = replace(circling(1), is_one_plan=True)
    assert solver_panel(tracks) is None
    assert "One plan, made before the start in 0.1 s" in " ".join(caption(tracks))


def test_bounds_nearby_are_drawn_and_those_far_away_are_named() -> None:
    (series,) = circling(1).series  # Its values are from -1 to 1.
    near = replace(circling(1), series=(replace(series, lower=-2.0, upper=2.0),))
    far = replace(circling(1), series=(replace(series, lower=-2.0, upper=900.0),))
    (first,), (second,) = series_panels(near), series_panels(far)
    dashed = 'class="level"'
    assert (first.drawing.count(dashed), first.far) == (2, "")
    assert (second.drawing.count(dashed), second.far) == (1, "turn rate 900")


def test_fewer_points_keep_the_first_and_the_last() -> None:
    times = np.linspace(0.0, 1.0, 1000)
    few, rows = reduced(times, np.sin(times)[None], 50)
    assert (few[0], few[-1], rows.shape) == (0.0, 1.0, (1, 50))
    held, _ = reduced(np.append(times, 1.1), np.sin(times)[None], 50)
    assert (held[-1], held.size) == (1.1, 51)


def test_names_of_a_user_are_text_in_the_page(content: RunContent) -> None:
    tracks = replace(circling(1), title='</script><b onclick="x">', vehicles=("<i>",))
    html = page_of(replace(content, tracks=tracks, title="<u>", figures=()))
    assert "<b onclick" not in html and "<i>" not in html and "<u>" not in html


def test_a_hundred_vehicles_are_less_than_a_megabyte() -> None:
    assert len(player(circling(100, frames=300))) < 1_000_000


# What a reader sees and does.


def test_nothing_moves_until_it_is_played(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    page = shown(opened, content, circling(3), tmp_path)
    before = place(page)
    page.clock.run_for(2000)
    assert (clock_of(page), place(page)) == (0.0, before)
    page.locator(".play").click()
    page.clock.run_for(1000)
    assert 0.9 < clock_of(page) < 1.1
    assert place(page) != before
    page.locator(".play").click()
    paused = clock_of(page)
    page.clock.run_for(1000)
    assert clock_of(page) == paused
    assert opened.is_silent()


def test_the_clock_runs_at_the_speed_chosen(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    page = shown(opened, content, circling(1), tmp_path)
    page.locator(".play").click()
    page.locator(".speed").select_option("0.1")
    page.clock.run_for(2000)
    slow = clock_of(page)
    assert slow == pytest.approx(0.2, abs=0.11)
    page.locator(".speed").select_option("5.0")
    page.clock.run_for(1000)
    assert clock_of(page) - slow == pytest.approx(5.0, rel=0.05)
    page.clock.run_for(1500)
    assert clock_of(page) == 10.0  # It stops at the end,
    assert page.locator(".play").inner_text() == "Play"  # and can be played again.


def test_places_are_to_scale(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    """The scale bar against the circle: half a turn moves a vehicle by 20 m along x."""
    page = shown(opened, content, circling(1, frames=51), tmp_path)
    bar = page.locator(".scale-bar path").get_attribute("d")
    pixels = float(re.search(r"h([\d.]+)m", bar)[1])  # type: ignore[index]
    metres = float(page.locator(".scale-bar text").text_content().split()[0])
    begin = place(page)
    scrub(page, 25)
    end = place(page)
    assert clock_of(page) == 5.0
    moved = (begin[0] - end[0]) * metres / pixels
    assert moved == pytest.approx(20.0, rel=1e-3)
    assert end[1] == pytest.approx(begin[1], abs=0.1)
    scrub(page, 12)
    assert place(page)[1] < begin[1]  # y is up.
    words = page.locator(".scrub input").get_attribute("aria-valuetext")
    assert words == "2.4 s of 10.0 s"


def test_a_camera_that_follows_keeps_the_vehicles_in_the_middle(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    page = shown(opened, content, circling(1), tmp_path)
    page.locator(".follow").check()
    middle = page.locator(".plane").evaluate(
        "n => [n.clientWidth / 2, n.clientHeight / 2]"
    )
    for frame in (0, 20, 40):
        scrub(page, frame)
        assert place(page) == pytest.approx(middle, abs=1.5)
    page.locator(".follow").uncheck()
    assert place(page) != pytest.approx(middle, abs=1.5)


def test_it_is_played_with_the_keyboard_alone(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    page = shown(opened, content, circling(2, frames=51), tmp_path)
    page.locator(".plane").focus()
    page.keyboard.press("ArrowRight")
    assert clock_of(page) == 0.2
    page.keyboard.press("End")
    assert clock_of(page) == 10.0
    page.keyboard.press(" ")
    page.clock.run_for(500)
    assert 0.3 < clock_of(page) < 0.7
    page.keyboard.press(" ")
    page.keyboard.press("f")
    assert page.locator(".follow").is_checked()
    page.locator(".scrub input").focus()
    page.keyboard.press("Home")
    assert clock_of(page) == 0.0


def test_a_click_in_a_panel_goes_to_that_time(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    page = shown(opened, content, circling(1), tmp_path)
    panel = page.locator(".panel").first
    box = panel.bounding_box()
    panel.click(position={"x": box["width"] * (48 + 123) / 300, "y": 40})
    assert clock_of(page) == pytest.approx(5.0, abs=0.1)
    shift = page.locator(".cursor").first.get_attribute("transform")
    assert float(re.findall(r"[\d.]+", shift)[0]) == pytest.approx(123, abs=2)


def test_what_is_not_finite_is_not_drawn(
    opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    tracks = circling(2)
    assert tracks.plane is not None
    positions = tracks.plane.positions.copy()
    positions[0, :, 20:] = np.nan
    positions[1, 0, 10] = np.inf
    plane = replace(tracks.plane, positions=positions)
    values = np.full((2, 10), np.nan)
    (series,) = tracks.series
    diverged = replace(tracks, plane=plane, series=(replace(series, values=values),))
    page = shown(opened, content, diverged, tmp_path)
    scrub(page, 40)
    seen = [node.get_attribute("visibility") for node in page.locator(".vehicle").all()]
    assert seen == ["hidden", "visible"]
    drawn = page.locator(".player").inner_html()
    assert "NaN" not in drawn and "Infinity" not in drawn
    assert opened.is_silent()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("tracks", [
    circling(1, frames=2, steps=1), circling(7), circling(100, frames=30),
    replace(circling(1), plane=None, vehicles=("",)),
    replace(circling(2), without_plan=np.ones(10, dtype=bool)),
], ids=["one step", "seven", "hundred", "no positions", "no plan"])  # fmt: skip
def test_pages_fit_a_telephone_and_are_silent(
    tracks: Tracks, scheme: str, opened: Opened, content: RunContent, tmp_path: Path
) -> None:
    opened.page.emulate_media(color_scheme=scheme)
    html = page_of(replace(content, tracks=tracks, figures=()))
    page = opened.show(html, tmp_path / "page.html", width=390)
    assert not opened.scrolls_sideways()
    page.locator(".play").click()
    page.clock.run_for(300)
    assert clock_of(page) > 0.02
    assert opened.is_silent()
    opened.page.emulate_media(color_scheme="light")
