"""Tracks are to scale, with marks of time at the right places."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarmstart.cases.drawing.tracks import Scene, draw_tracks, mark_times
from swarmstart.tests.cases.drawing.reading import named

TIMES = np.linspace(0.0, 40.0, 401)


def scene(vehicles: int, **more: object) -> Scene:
    """Return vehicles side by side that move along x with 2 m/s."""
    positions = np.stack(
        [np.stack([2.0 * TIMES, np.full_like(TIMES, 5.0 * k)]) for k in range(vehicles)]
    )
    return Scene(
        times=TIMES, positions=positions, headings=np.zeros((vehicles, TIMES.size)),
        names=[f"UAV {k + 3}" for k in range(vehicles)], **more,  # type: ignore[arg-type]
    )  # fmt: skip


def test_marks_are_at_round_times_with_their_labels() -> None:
    axes = Figure().subplots()
    draw_tracks(axes, scene(2))
    assert axes.get_aspect() == 1.0
    assert [text.get_text() for text in axes.texts] == [
        f"{5 * k} s" for k in range(1, 9)
    ]
    dots = [x for x in axes.lines if str(x.get_marker()) == "." and len(x.get_xdata())]  # type: ignore[arg-type]
    assert np.asarray(dots[1].get_data()) == pytest.approx(
        np.array([10.0 * np.arange(1, 9), np.full(8, 5.0)])
    )


def test_each_vehicle_has_its_own_name_and_the_colour_of_its_number() -> None:
    axes = Figure().subplots()
    draw_tracks(axes, scene(2, numbers=(2, 3)))
    both = Figure().subplots()
    draw_tracks(both, scene(4))
    own, other = named(axes, "UAV 3")[0], named(both, "UAV 5")[0]
    assert own.get_color() == other.get_color()


def test_of_many_vehicles_there_is_one_name_and_no_marks() -> None:
    axes = Figure().subplots()
    draw_tracks(axes, scene(100))
    labels = [str(line.get_label()) for line in axes.lines]
    assert [name for name in labels if not name.startswith("_")] == ["100 vehicles"]
    assert len(axes.texts) == 0


@pytest.mark.parametrize("end", [0.07, 1.0, 8.0, 60.0, 900.0])
def test_there_are_a_few_marks_whatever_the_time(end: float) -> None:
    marks = mark_times(np.linspace(0.0, end, 1001))
    assert 3 <= marks.size <= 8 and marks[-1] <= end * (1 + 1e-9)


def test_of_a_part_of_a_flight_all_rows_are_cut() -> None:
    part = scene(2, leader=np.zeros((2, TIMES.size))).until(10.0)
    assert part.leader is not None
    sizes = {part.times.size, part.positions.shape[2], part.headings.shape[1]}
    assert sizes == {101} and part.leader.shape == (2, 101)
