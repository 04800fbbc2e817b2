"""Figures of matplotlib within a page: colours, texts and ids are the page's."""

from __future__ import annotations

import re
from typing import Any

import pytest

from swarmstart.cases.drawing.report import svg


def drawn(name: str = "series", *, salt: str = "a", **more: Any) -> str:
    """Return a chart with one line of a name."""
    with svg.page_style():
        figure, axes = svg.new_chart()
        style = {**svg.series_style(2), **more}
        axes.plot([1, 10], [0.25, 1], label=svg.label_of_series(name),
                  gid=svg.titled(name), **style)  # fmt: skip
        axes.set_title("share")
        svg.make_logarithmic(axes.xaxis)
        svg.name_series(figure)
        return svg.as_svg(figure, salt=salt)


def test_colours_are_those_of_the_page_and_no_style_is_an_attribute() -> None:
    """The page's policy refuses styles; a colour of its own would not turn dark."""
    text = drawn()
    assert 'stroke="var(--s2)"' in text and 'fill="var(--ink)"' in text
    assert not re.search(r"style=|<style|#[0-9a-f]{6}|font-family", text)
    assert drawn(color="#123456").count("#123456") > 0  # No colour is lost.


def test_a_line_keeps_its_places_to_a_decimal() -> None:
    """x from 1 to 10 and y from 0.25 to 1, margins of matplotlib's 5 % on each side."""
    text = drawn(marker=None)
    x0, y0, x1, y1 = map(
        float, re.findall(r'd="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)"', text)[-1]
    )
    left, right, below, above = svg.MARGINS
    width, height = svg.WIDTH - left - right, svg.HEIGHT - below - above
    assert x0 == pytest.approx(left + width * 0.05 / 1.1, abs=0.06)
    assert x1 == pytest.approx(left + width * 1.05 / 1.1, abs=0.06)
    assert y1 == pytest.approx(above + height * 0.05 / 1.1, abs=0.06)
    assert y0 == pytest.approx(above + height * 1.05 / 1.1, abs=0.06)


def test_the_same_chart_is_the_same_text_and_two_of_a_page_share_no_id() -> None:
    first, again, other = drawn(), drawn(), drawn(salt="b")
    assert first == again
    ids = [re.findall(r' id="([^"]*)"', text) for text in (first, other)]
    assert ids[0] and not {*ids[0]} & {*ids[1]}
    assert {*re.findall(r'href="#([^"]*)"', first)} == {*ids[0]}


@pytest.mark.parametrize("name", [
    "a $b$ c", "_hidden", "\u4e2d\u6587", "</title><script>1</script>", '"&<#588ef6',
    "x\x1b[31m",
])  # fmt: skip
def test_text_of_a_user_stays_text(name: str) -> None:
    """Neither formula nor markup, and no warning of a glyph that a font lacks."""
    text = drawn(name)
    told = svg.text_of(name).replace("&quot;", '"').replace("&#x27;", "'")
    assert re.search(rf"<text [^>]*> ?{re.escape(told)}</text>", text)
    assert f"<title>{svg.text_of(name)}</title>" in text


@pytest.mark.parametrize(("ends", "texts"), [
    ((0.02, 0.7), ["0.05", "0.1", "0.2", "0.5"]),
    ((1e-6, 1e3), ["0.0001", "0.01", "1", "100"]),
    ((3.01, 3.02), ["3.01", "3.02"]),
])  # fmt: skip
def test_a_logarithmic_axis_has_a_few_plain_numbers(
    ends: tuple[float, float], texts: list[str]
) -> None:
    with svg.page_style():
        _, axes = svg.new_chart()
        axes.plot(ends, [0, 1])
        svg.make_logarithmic(axes.xaxis)
        low, high = axes.get_xlim()
        places = [at for at in axes.get_xticks() if low <= at <= high]
        found = [axes.xaxis.get_major_formatter()(at, 0) for at in places]
    assert {*texts} <= {*found} and len(found) <= 10
