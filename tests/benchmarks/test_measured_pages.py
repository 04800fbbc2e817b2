"""Measured pages, made again by their command in a short form.

A page says how far its numbers may differ if it is made again:

    `NAME OF A COLUMN` by 10 % or 0.5     the larger; "every number" names all columns

Of a table only the columns that are named are compared.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from swarmstart.tests.docs.comparing import NUMBER

MEASURED = Path(__file__).parents[2] / "docs" / "measured"
SPREAD = re.compile(r"(?:`([^`]+)`|every number)\s+by\s+([\d.]+) %\s+or\s+([\d.]*\d)")
EVERY = ""

PAGES = {
    "warm_starts": ("free end time", "maximised", "rate limit"),
    "lanes": ("double_integrator", "van_der_pol", "two_reaction_reactor"),
    "unseen_share": ("passing",),
}
"""Problems that are measured again, by the name of the page and of its benchmark."""


class Number(NamedTuple):
    """A number of a page, with its place and the difference that the page allows."""

    place: str
    value: float
    allowed: float


def numbers(page: str, spreads: str, names: tuple[str, ...]) -> list[Number]:
    """Return the compared numbers of the rows of some problems, in their order.

    Args:
        page: The page.
        spreads: The page that states how far they may differ.
        names: First cells of the rows.
    """
    found = SPREAD.findall(spreads)
    assert found, "the page states no spread"
    spread = {
        column: (float(part) / 100, float(least)) for column, part, least in found
    }
    return [
        Number(f"{cells[0]}, {column}", value, max(part * abs(value), least))
        for name in names
        for columns, cells in rows(page)
        if cells[0] == name
        for column, cell in zip(columns[1:], cells[1:], strict=True)
        if (limits := spread.get(column, spread.get(EVERY)))
        for part, least in [limits]
        for value in map(float, NUMBER.findall(cell.replace("/", " ")))
    ]


def rows(page: str) -> Iterator[tuple[list[str], list[str]]]:
    """Yield the names of the columns and the cells of each row of each table."""
    columns: list[str] = []
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            columns = []
        elif not columns:
            columns = cells
        elif set(line) - set("|- "):
            yield columns, cells


def differences(page: str, again: str, names: tuple[str, ...]) -> list[str]:
    """Return the numbers of a page that differ by more than it says."""
    shown, measured = numbers(page, page, names), numbers(again, page, names)
    assert [one.place for one in shown] == [one.place for one in measured]
    return [
        f"{one.place}: the page shows {one.value:g}, measured was {other.value:g}"
        for one, other in zip(shown, measured, strict=True)
        if not abs(one.value - other.value) <= one.allowed
    ]


PAGE = """# Title

Each `b` by 10 % or 1 at most, `c` by 0 % or 0.5.

| a | b | c | d |
| --- | --- | --- | --- |
| x | 100/20 | 7 | 3 |
| y | 5 | 8 | 3 |
"""


@pytest.mark.parametrize(
    ("old", "new", "count"),
    [
        *[("100/20", "110/18", 0), ("100/20", "111/20", 1), ("100/20", "111/17", 2)],
        *[("| 7", "| 7.5", 0), ("| 7", "| 6.4", 1)],
        *[("7 | 3", "7 | 9", 0), ("| 5", "| 50", 0), ("20 |", "nan |", None)],
    ],
)
def test_a_number_outside_its_spread_is_found(
    old: str, new: str, count: int | None
) -> None:
    if count is None:
        with pytest.raises(AssertionError):
            differences(PAGE, PAGE.replace(old, new), ("x",))
    else:
        assert len(differences(PAGE, PAGE.replace(old, new), ("x",))) == count


@pytest.mark.parametrize("name", PAGES)
def test_a_page_says_how_far_its_numbers_may_differ(name: str) -> None:
    page = (MEASURED / f"{name}.md").read_text(encoding="utf-8")
    assert {one.place.split(",")[0] for one in numbers(page, page, PAGES[name])} == {
        *PAGES[name]
    }


@pytest.mark.parametrize("name", PAGES)
def test_a_page_made_again_shows_the_same_numbers(name: str, tmp_path: Path) -> None:
    page = (MEASURED / f"{name}.md").read_text(encoding="utf-8")
    assert f"benchmarks/{name}.py" in page
    written = tmp_path / "page.md"
    only = [word for problem in PAGES[name] for word in ("--only", problem)]
    main = importlib.import_module(f"swarmstart.benchmarks.{name}").main
    main([*only, "--write", str(written)])
    again = written.read_text(encoding="utf-8")
    assert not differences(page, again, PAGES[name])


def in_one_line(text: str) -> str:
    return " ".join(text.split())


def test_the_index_repeats_what_each_page_finds() -> None:
    index = (MEASURED / "index.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| \[[^\]]*\]\((\w+)\.md\) \| (.*) \|$", index, re.MULTILINE)
    assert {name for name, _ in lines} >= {*PAGES}
    for name, finding in lines:
        page = (MEASURED / f"{name}.md").read_text(encoding="utf-8")
        assert in_one_line(page).count(finding) == 1, name


def test_what_is_said_of_warm_starts_stands_in_the_table() -> None:
    """In the page's finding, and on the page that quotes it."""
    page = (MEASURED / "warm_starts.md").read_text(encoding="utf-8")
    polished, whole = (
        [
            [float(number) for cell in cells[1:] for number in NUMBER.findall(cell)]
            for _, cells in rows(part)
            if cells[0] in ("the same", "twice as many intervals")
        ]
        for part in page.split("\n## ")[1:]
    )
    same, twice = ((row[0], row[-1]) for row in polished)
    quoted = (MEASURED.parent / "answers.md").read_text(encoding="utf-8")
    pairs = r"(\d+) iterations (?:of IPOPT )?in place of (\d+)"
    for text in (page, quoted):
        (found,) = re.findall(pairs, in_one_line(text))
        assert tuple(map(float, found)) == same
    (found,) = re.findall(r"in (\d+) in place of (\d+)\b", in_one_line(page))
    assert tuple(map(float, found)) == twice
    (count, of) = re.findall(r"saves nothing in (\d+) of (\d+)", page)[0]
    assert int(of) - int(count) == whole[0][1]
