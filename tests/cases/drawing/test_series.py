"""Lines of a few series, bands of many."""

import numpy as np
from matplotlib.figure import Figure

from swarmstart.cases.drawing.drawing import MOST_NAMED, draw_series, name_lines
from swarmstart.tests.cases.drawing.reading import curves, held, legend, named

TIMES = np.linspace(0.0, 3.0, 4)


def drawn(values: np.ndarray, times: np.ndarray = TIMES, **options: object) -> Figure:
    figure = Figure(layout="constrained")
    draw_series(figure.subplots(), times, values, **options)  # type: ignore[arg-type]
    return figure


def test_up_to_twelve_series_are_lines_with_names() -> None:
    values = np.arange(4 * MOST_NAMED, dtype=float).reshape(MOST_NAMED, 4)
    names = [f"UAV {k}" for k in range(1, MOST_NAMED + 1)]
    figure = drawn(values, names=names)
    name_lines(figure)
    assert np.array_equal(curves(figure.axes[0]), values)
    assert legend(figure) == names


def test_a_hundred_series_are_a_median_quartiles_and_extremes() -> None:
    values = np.tile(np.arange(101.0)[:, None], (1, 4))
    (axes,) = drawn(values).axes
    (median,) = curves(axes)
    assert median.tolist() == [50.0] * 4
    spans = {
        str(band.get_label()): band.get_paths()[0].get_extents()
        for band in axes.collections
    }
    ends = {name: (box.y0, box.y1) for name, box in spans.items()}
    assert ends == {"smallest to largest": (0, 100), "middle half": (25, 75)}


def test_bands_of_held_values_keep_their_steps_and_skip_what_is_not_finite() -> None:
    values = np.tile(np.array([1.0, 5.0, 2.0]), (20, 1))
    values[0, 1] = np.inf
    (axes,) = drawn(values).axes
    (median,) = named(axes, "median of 20")
    assert np.asarray(median.get_data()).tolist() == [
        [0, 1, 1, 2, 2, 3], [1, 1, 5, 5, 2, 2],
    ]  # fmt: skip


def test_lines_that_leap_to_and_fro_are_thinner() -> None:
    times = np.arange(1001.0)
    wild = (-1.0) ** times[None]
    calm = np.sin(times / 300)[None] + 1e-9 * wild  # Rounding is no leap.
    widths = [drawn(v, times).axes[0].lines[0].get_linewidth() for v in (calm, wild)]
    assert widths[1] == widths[0] / 2


def test_held_values_are_steps() -> None:
    (axes,) = drawn(np.array([[4.0, 5.0, 6.0]])).axes
    ((values, edges),) = held(axes)
    assert values.tolist() == [4, 5, 6] and edges.tolist() == TIMES.tolist()
