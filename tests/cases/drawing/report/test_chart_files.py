"""Charts of a page as files show what the page shows, with a title and a legend."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure

from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.drawing import write_figures
from swarmstart.cases.drawing.report import chart_files, svg
from swarmstart.cases.drawing.report.chart_files import chart_figures
from swarmstart.cases.drawing.report.pages.comparison_page import comparison_page
from swarmstart.tests.cases.drawing.reading import covered, legend
from swarmstart.tests.cases.drawing.report import contents


def figures(**more: object) -> dict[str, Figure]:
    page = comparison_page(contents.content(**more))  # type: ignore[arg-type]
    return dict(chart_figures(page))


@pytest.fixture(scope="module")
def drawn() -> dict[str, Figure]:
    return figures()


def test_each_chart_is_a_figure_with_a_title_and_none_is_empty(
    drawn: dict[str, Figure],
) -> None:
    page = comparison_page(contents.content())
    assert len(drawn) == len(re.findall(r'<svg [^>]*role="img"', page)) > 8
    for figure in drawn.values():
        (axes,) = figure.axes
        assert figure.get_suptitle() and len(axes.patches) > 2 and axes.texts
    assert "001_performance_profile" in drawn


def test_lines_have_the_colours_and_dashes_of_the_page_and_a_legend(
    drawn: dict[str, Figure],
) -> None:
    figure = drawn["001_performance_profile"]
    names = [solver["name"] for solver in contents.content()["solvers"]]
    assert legend(figure) == names
    assert covered(figure) == []
    for number, line in enumerate(figure.axes[0].lines):
        assert to_hex(line.get_color()) == palette.LIGHT[number]
        assert (line.get_linestyle() == "-") == (not palette.DASHES[number])
    edges = {to_hex(patch.get_edgecolor()) for patch in figure.axes[0].patches}
    assert {*palette.LIGHT[: len(names)]} <= edges


def test_bands_are_pale_and_lines_are_not_filled(drawn: dict[str, Figure]) -> None:
    patches = drawn["001_performance_profile"].axes[0].patches
    assert {to_rgba(patch.get_facecolor())[3] for patch in patches} == {0.0, 0.13, 1.0}


def test_a_path_of_svg_is_read_as_it_is_drawn() -> None:
    path = chart_files._path("M1 2H4V6L2 3z")
    assert path is not None
    assert np.asarray(path.vertices)[:4] == pytest.approx(
        np.array([[1, 2], [4, 2], [4, 6], [2, 3]])
    )
    disc = chart_files._path(f"M10 20{palette.MARKS[0]}")
    assert disc is not None
    away = np.hypot(*(np.asarray(disc.vertices)[1:] - [10, 20]).T)
    assert away == pytest.approx(np.full(away.size, 4.0))
    assert chart_files._path("") is None


def test_all_marks_lie_around_their_place() -> None:
    for number in range(len(palette.MARKS)):
        d = re.search(r' d="([^"]*)"', svg.marks(np.ones(1), np.ones(1), number))
        assert d is not None
        path = chart_files._path(d[1])
        assert path is not None
        assert np.abs(np.asarray(path.vertices) - 1.0).max() <= 5.1


def test_files_of_both_formats_are_written(tmp_path: Path) -> None:
    given = figures(scenarios=1, seeds=3, solvers=2)
    files = write_figures(given.items(), tmp_path, formats=("svg", "pdf"))
    assert len(files) == 2 * len(given)
    assert files[0].read_bytes().startswith(b"<?xml")
    assert files[1].read_bytes().startswith(b"%PDF")


def test_text_of_users_is_no_formula_and_breaks_nothing() -> None:
    for figure in dict(chart_figures(comparison_page(contents.hostile()))).values():
        figure.draw_without_rendering()
