"""Series differ in colour and line style, and in grey print too."""

import io
import itertools
import warnings
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarmstart.cases.drawing.drawing import (
    COLOURS,
    PNG_DPI,
    colour,
    escaped,
    line_style,
    name_powers,
    new_figure,
    write_figures,
)
from swarmstart.tests.cases.drawing.reading import contrast

TWELVE = [(colour(number), line_style(number)) for number in range(12)]


def luminance(own: str) -> float:
    """Return the contrast to black, which grows with the luminance."""
    return contrast(own, "#000000")


def test_twelve_series_have_twelve_colours_and_twelve_line_styles() -> None:
    assert len({own for own, _ in TWELVE}) == 12
    assert len({str(style) for _, style in TWELVE}) == 12


def test_the_next_twelve_have_other_pairs_of_colour_and_style() -> None:
    pairs = {(colour(number), str(line_style(number))) for number in range(144)}
    assert len(pairs) == 144


def test_the_lightness_of_the_colours_is_spread_and_none_is_faint() -> None:
    found = sorted(luminance(own) for own in COLOURS)
    assert found[-1] / found[0] > 4
    assert all(contrast(own, "#ffffff") >= 3 for own in COLOURS)


def test_series_alike_in_grey_print_differ_in_style() -> None:
    for (first, one), (second, other) in itertools.combinations(TWELVE, 2):
        if max(luminance(first), luminance(second)) < 1.3 * min(
            luminance(first), luminance(second)
        ):
            assert one != other


@pytest.mark.parametrize("number", range(12))
def test_dashes_repeat_within_what_a_legend_shows(number: int) -> None:
    style = line_style(number)
    period = 0.0 if isinstance(style, str) else float(np.sum(style[1]))
    assert period < 30.0


def test_an_escape_sequence_in_a_title_does_not_reach_the_terminal() -> None:
    """Matplotlib's warning of a missing glyph contains the character itself."""
    figure = Figure()
    figure.suptitle(escaped("red \x1b[31m\nand costs in $"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.savefig(io.BytesIO(), format="png")
    assert escaped("a\x1b[31m\nb") == "a\\x1b[31m\nb"


def test_a_figure_is_drawn_once_and_as_matplotlib_would(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The layout is made on the way: `Figure.savefig` draws a first time for it."""
    figure = new_figure()
    figure.subplots().set(xlabel="time [s]", ylabel="a\nb")
    expected = io.BytesIO()
    figure.savefig(expected, format="png", dpi=PNG_DPI, metadata={})
    drawing = MagicMock(wraps=figure.draw)
    monkeypatch.setattr(figure, "draw", drawing)
    (file,) = write_figures([("a", figure)], tmp_path)
    assert drawing.call_count == 1
    assert file.read_bytes() == expected.getvalue()
    files = write_figures([("a", figure)], tmp_path, formats=("svg", "pdf"))
    assert [one.read_bytes()[:5] for one in files] == [b"<?xml", b"%PDF-"]


def test_powers_of_ten_are_text_and_no_formulas() -> None:
    axes = Figure().subplots()
    axes.plot([0, 1], [1e-12, 300.0])
    name_powers(axes, has_minor_ticks=False)
    words = axes.yaxis.get_major_formatter()
    assert [words(value, 0) for value in (1e-12, 1.0, 100.0, 0.3, 0.0)] == [
        "10\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT TWO}",
        "10\N{SUPERSCRIPT ZERO}", "10\N{SUPERSCRIPT TWO}", "0.3", "0",
    ]  # fmt: skip
    assert not axes.yaxis.get_minorticklocs().size
