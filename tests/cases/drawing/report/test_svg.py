"""Charts within a page: places, ticks, texts; the looks are the page's."""

from __future__ import annotations

import re

import numpy as np
import pytest

from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.report import svg


def axis(low: float, high: float, *, is_log: bool = False) -> svg.Axis:
    """Return an axis of 500 units."""
    return svg.Axis(low=low, high=high, start=50.0, end=550.0, is_log=is_log)


def texts(one: svg.Axis, most: int = 8) -> list[str]:
    return [words for _, words in one.ticks(most)]


def drawn(name: str) -> str:
    """Return a chart with one line of a name."""
    x, y = axis(1.0, 10.0, is_log=True), axis(0.0, 1.0)
    places = x.at([1.0, 10.0]), y.at([0.25, 1.0])
    return (
        svg.frame(x, y, title=name, label=name)
        + svg.line(*places, svg.look(2), title=name)
        + svg.marks(*places, 2, title=name)
        + str(svg.legend({name: 2}))
    )


def test_looks_are_classes_of_the_page() -> None:
    """The page's policy refuses styles; a colour of its own would not turn dark."""
    text = drawn("series")
    assert not re.search(r"style=|<style|#[0-9a-f]{3}|rgb|font-family", text)
    sheet = palette.style_sheet()
    for name in ("s2", "d2"):
        assert name in re.findall(r'class="line ([^"]*)"', text)[0].split()
        assert f".{name}{{stroke" in sheet


def test_an_axis_holds_its_values_with_a_margin() -> None:
    """From 1 to 10 and a margin of 5 % of that: the ends are 0.05/1.1 off the ends."""
    one = svg.axis_of([10.0, None, 1.0, np.nan, np.inf], (0.0, 110.0))
    np.testing.assert_allclose(one.at([1.0, 5.5, 10.0]), [5.0, 55.0, 105.0])
    upright = svg.axis_of([1e-3, 0.0, -5.0, 1e3], (110.0, 0.0), is_log=True)
    np.testing.assert_allclose(upright.at([1e-3, 1.0, 1e3]), [105.0, 55.0, 5.0])
    assert np.isnan(upright.at([0.0, -1.0])).all()


@pytest.mark.parametrize("is_log", [False, True])
@pytest.mark.parametrize("values", [[], [3.0], [3.0, 3.0 + 1e-15], [0.0], [-2.0],
                                    [1e308, -1e308], [5e-324, 1e308]])  # fmt: skip
def test_any_values_have_an_axis_with_ticks(
    values: list[float], *, is_log: bool
) -> None:
    one = svg.axis_of(values, (0.0, 100.0), is_log=is_log)
    assert np.isfinite([one.low, one.high]).all() and one.low < one.high
    places = [place for place, _ in one.ticks(5)]
    assert 2 <= len(places) <= 8 and -1e-6 <= min(places) < max(places) <= 100 + 1e-6


@pytest.mark.parametrize(("ends", "expected"), [
    ((0.02, 0.7), ["0.05", "0.1", "0.2", "0.5"]),
    ((1e-6, 1e3), ["0.0001", "0.01", "1", "100"]),
    ((3.01, 3.02), ["3.01", "3.02"]),
])  # fmt: skip
def test_a_logarithmic_axis_has_a_few_plain_numbers(
    ends: tuple[float, float], expected: list[str]
) -> None:
    found = texts(axis(*ends, is_log=True))
    assert {*expected} <= {*found} and len(found) <= 10


def test_ticks_of_a_linear_axis_are_told_apart() -> None:
    assert texts(axis(-0.3, 0.3), 4) == ["\N{MINUS SIGN}0.2", "0", "0.2"]
    far = texts(axis(12345678.1, 12345678.4), 4)
    assert far[:2] == ["12345678.1", "12345678.2"] and len({*far}) == len(far)


def test_a_line_has_a_decimal_and_breaks_where_nothing_is_known() -> None:
    x = np.array([0.0, 1.04, 2.0, 3.0, 4.0, 5.0])
    y = np.array([7.0, 8.06, 8.06, np.nan, 1.0, 1.0])
    assert svg.path(x, y) == "M0 7L1 8.1H2M4 1H5"
    assert svg.path(*svg.corners([0, 1, 2], [5, 6])) == "M0 5H1V6H2"  # Each is held.
    assert svg.path(*svg.corners([0, 1], [5, 6])) == "M0 5H1V6"
    assert svg.outline(x, y, y + 1) == "M0 7L1 8.1H2L4 1H5V2H4L2 9.1H1L0 8z"
    assert svg.dots(x[2:5], y[2:5]) == "M2 8.1h0M4 1h0"


def test_series_look_different_for_twelve_rounds() -> None:
    assert len({svg.look(number) for number in range(144)}) == 144


@pytest.mark.parametrize("name", [
    "a $b$ c", "_hidden", "\u4e2d\u6587", "</title><script>1</script>", '"&<#588ef6',
    "x\x1b[31m",
])  # fmt: skip
def test_text_of_a_user_stays_text(name: str) -> None:
    text, told = drawn(name), svg.text_of(name)
    assert len(re.findall(rf"<text [^>]*>{re.escape(told)}</text>", text)) == 2
    assert text.count(f"<title>{told}</title>") == 2
    assert f"</svg>{told}</li>" in text
    assert "<script" not in text and "\x1b" not in text
