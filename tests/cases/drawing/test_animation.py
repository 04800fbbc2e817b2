"""The camera keeps all vehicles in the picture, and the clock tells the time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from swarmstart.cases.drawing import animation
from swarmstart.cases.drawing.animation import (
    Film,
    animate_scene,
    at_times,
    camera_of,
    frame_times,
    noted,
)
from swarmstart.cases.drawing.drawing import arrowhead
from swarmstart.cases.drawing.tracks import Scene
from swarmstart.tests.cases.drawing.reading import covered

TIMES = np.linspace(0.0, 30.0, 301)


def flight(vehicles: int = 3) -> Scene:
    """Return vehicles that gather on a curve, 15 m/s fast, and then turn back."""
    along = 15.0 * np.minimum(TIMES, 40.0 - TIMES)
    apart = np.linspace(-1, 1, vehicles)[:, None] * (60.0 * np.exp(-TIMES / 4) + 8.0)
    positions = np.stack([along + 0 * apart, 5 * np.sin(TIMES / 3) + apart], axis=1)
    turns = np.gradient(positions, TIMES, axis=2)
    return Scene(
        times=TIMES,
        positions=positions,
        headings=np.unwrap(np.arctan2(turns[:, 1], turns[:, 0])),
        names=[f"UAV {k}" for k in range(1, vehicles + 1)],
        leader=positions[0],
    )


def test_the_camera_has_all_vehicles_in_every_frame() -> None:
    scene = at_times(flight(), frame_times(TIMES))
    camera = camera_of(scene, ratio=0.5)
    for frame in range(scene.times.size):
        for limits, row in zip(camera.limits(frame), (0, 1), strict=True):
            places = scene.positions[:, row, frame]
            assert limits[0] < places.min() and places.max() < limits[1]


def test_the_picture_is_not_mostly_empty_and_its_scales_are_equal() -> None:
    scene = at_times(flight(), frame_times(TIMES))
    camera = camera_of(scene, ratio=0.5)
    assert camera.halves[1] == pytest.approx(0.5 * camera.halves[0])
    whole = np.ptp(scene.positions[:, 0])
    assert 2 * np.median(camera.halves[0]) < 0.4 * whole  # It follows them.
    late = scene.times > 20.0  # They have gathered: the camera is nearer.
    assert camera.halves[0, late].max() < 0.7 * camera.halves[0, 0]
    film = Film(scene, title="")
    assert film.axes.get_aspect() == 1.0


def test_the_camera_moves_smoothly() -> None:
    scene = at_times(flight(), frame_times(TIMES))
    camera = camera_of(scene, ratio=0.5)
    moves = np.abs(np.diff(camera.centres, n=2, axis=1))
    assert moves.max() < 0.05 * camera.halves.min()


def test_clock_headings_and_names_are_those_of_the_frame() -> None:
    scene = at_times(flight(), frame_times(TIMES))
    film = Film(scene, title="Three UAVs")
    for frame in (0, 40, film.frames - 1):
        film.show(frame, "planning")
        time = scene.times[frame]
        assert film.clock.get_text() == f"t = {time:.1f} s  planning"
        heads = [line for line in film.axes.lines if line.get_markersize() == 16]
        assert len(heads) == 3
        for head, place, heading in zip(
            heads, scene.positions[:, :, frame], scene.headings[:, frame], strict=True
        ):
            assert np.asarray(head.get_data())[:, 0] == pytest.approx(place)
            assert np.asarray(head.get_marker()) == pytest.approx(arrowhead(heading))
    assert [text.get_text() for text in film.axes.texts] == ["1", "2", "3"]
    assert film.axes.get_title(loc="right") == "Three UAVs"


def test_a_vehicle_inside_an_obstacle_is_red_and_the_clock_says_so() -> None:
    """The first vehicle passes the middle of the disc at 20 s."""
    given = flight()
    x, y = given.positions[0, :, 200]
    scene = at_times(replace(given, discs=[(x, y, 4.0)]), frame_times(TIMES))
    film = Film(scene, title="")
    early, within = 10, int(np.argmin(np.abs(scene.times - 20.0)))
    heads = [line for line in film.axes.lines if line.get_markersize() == 16]
    for frame, inside in ((early, False), (within, True), (early, False)):
        film.show(frame, "planning")
        assert ("inside an obstacle" in film.clock.get_text()) is inside
        assert (heads[0].get_color() == animation.ALARM) is inside
        assert heads[1].get_color() != animation.ALARM


def test_an_obstacle_within_two_widths_is_in_the_view_and_a_far_one_is_not() -> None:
    """A formation 30 m wide stands; one disc begins 40 m away, another 100 m."""
    places = np.array([[[0.0], [0.0]], [[30.0], [0.0]]]).repeat(TIMES.size, axis=2)
    discs = [(80.0, 0.0, 10.0), (15.0, 110.0, 10.0)]
    scene = Scene(
        times=TIMES, positions=places, headings=np.zeros((2, TIMES.size)),
        names=["UAV 1", "UAV 2"], discs=discs,
    )  # fmt: skip
    x, y = camera_of(scene, ratio=0.5).limits(150)
    assert x[0] < 0 and x[1] > 90
    assert y[1] < 100


def test_a_legend_names_the_marks_that_are_drawn() -> None:
    scene = at_times(flight(), frame_times(TIMES))
    legend = Film(scene, title="").axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["leader"]
    more = replace(scene, slots=scene.positions, discs=[(0.0, 0.0, 1.0)])
    legend = Film(more, title="").axes.get_legend()
    assert legend is not None
    assert sorted(text.get_text() for text in legend.get_texts()) == [
        "leader", "obstacle", "slot",
    ]  # fmt: skip
    bare = replace(scene, leader=None)
    assert Film(bare, title="").axes.get_legend() is None


def test_the_legend_lies_outside_the_scene() -> None:
    scene = at_times(flight(), frame_times(TIMES))
    more = replace(scene, slots=scene.positions, discs=[(0.0, 0.0, 1.0)])
    film = Film(more, title="")
    film.show(0)
    assert covered(film.figure) == []


def test_notes_are_those_of_the_last_instant_before_a_frame() -> None:
    notes = noted(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.9, 1.0, 2.5]), "abc")
    assert notes == ["a", "a", "b", "c"]


def test_a_long_flight_is_shown_faster_and_ends_with_its_last_instant() -> None:
    assert frame_times(TIMES).size == 12 * animation.FRAMES_PER_S + 1
    short = frame_times(TIMES[:11])
    assert short.size == animation.SHORTEST_S * animation.FRAMES_PER_S + 1
    assert (short[0], short[-1]) == (0.0, 1.0)


def test_a_gif_is_small_and_tells_its_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation, "LONGEST_S", 2.0)
    file, told = tmp_path / "flight.gif", []
    animate_scene(
        flight(), file, title="", progress=lambda *so_far: told.append(so_far)
    )
    with Image.open(file) as image:
        frames = image.n_frames  # type: ignore[attr-defined]
        assert image.info["duration"] == 80 and image.size == (800, 450)
    assert told == [(k, frames, "animating") for k in range(frames)]
    assert file.stat().st_size / frames < 16_000
