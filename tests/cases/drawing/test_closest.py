"""A place where vehicles come close has a zoom exactly if the picture hides it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarmstart.cases.drawing.closest import approaches, draw_scene
from swarmstart.cases.drawing.tracks import Scene
from swarmstart.tests.cases.drawing.reading import covered

TIMES = np.linspace(0.0, 10.0, 11)
ALONG = 10.0 * TIMES  # 0 to 100 m.


def past_a_disc(clearance: float, *, shift: float = 5.0) -> Scene:
    """Return a vehicle that passes a disc between two instants of the path."""
    places = np.stack([ALONG, np.full(TIMES.size, 8.0 + clearance)])[None]
    return Scene(
        times=TIMES, positions=places, headings=np.zeros((1, TIMES.size)),
        names=["one"], discs=[(50.0 + shift, 0.0, 8.0)],
    )  # fmt: skip


def drawn(scene: Scene) -> Figure:
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    draw_scene(figure, scene)
    return figure


@pytest.mark.parametrize(("clearance", "panels"), [(0.097, 2), (1.99, 2), (2.01, 1)])
def test_an_approach_below_two_percent_of_the_picture_has_a_zoom(
    clearance: float, panels: int
) -> None:
    # The picture is 100 m wide: 2 % are 2 m.
    assert len(drawn(past_a_disc(clearance)).axes) == panels


def test_the_zoom_shows_both_ends_of_the_distance_and_says_it() -> None:
    figure = drawn(past_a_disc(0.25))
    assert covered(figure) == []
    whole, zoom = figure.axes
    low, high = zoom.get_ylim()
    assert low < 8.0 and high > 8.25
    assert high - low < 0.05 * np.ptp(whole.get_xlim())
    assert zoom.get_title() == "1: about 0.25 m at 5.5 s\none, obstacle"
    assert [text.get_text() for text in zoom.texts] == []


def test_an_approach_is_found_between_the_instants() -> None:
    (found,) = approaches(past_a_disc(0.25))
    assert found.distance == pytest.approx(0.25) and found.time == pytest.approx(5.5)
    assert found.ends == pytest.approx(np.array([[55.0, 8.25], [55.0, 8.0]]))


def test_vehicles_are_close_only_at_the_same_time() -> None:
    # The second crosses the track of the first 5 s after that one was there.
    first = np.stack([ALONG, np.zeros(TIMES.size)])
    second = np.stack([np.full(TIMES.size, 20.0), ALONG - 70.0])
    scene = Scene(
        times=TIMES, positions=np.stack([first, second]),
        headings=np.zeros((2, TIMES.size)), names=["one", "two"],
    )  # fmt: skip
    (found,) = approaches(scene)
    # Along (10 t - 20, 70 - 10 t): least at t = 4.5, where both are 25 m.
    assert found.distance == pytest.approx(25.0 * np.sqrt(2.0))
    assert found.time == pytest.approx(4.5) and list(found.names) == ["one", "two"]
    assert len(drawn(scene).axes) == 1
    assert len(drawn(replace(scene, positions=np.stack([first, first + 1]))).axes) == 2


def test_positions_that_are_not_finite_have_no_approach() -> None:
    scene = past_a_disc(0.25)
    gone = replace(scene, positions=np.full_like(scene.positions, np.nan))
    assert list(approaches(gone)) == []


def test_an_instant_that_is_not_finite_hides_no_approach() -> None:
    scene = past_a_disc(0.25)
    scene.positions[0, :, 1] = np.nan
    (found,) = approaches(scene)
    assert found.distance == pytest.approx(0.25)
