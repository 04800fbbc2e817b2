"""A figure of a page: chart, legend, caption, table of values, values to download."""

import csv
import io
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.svg import Axis, text_of
from swarmstart.cases.drawing.wording import shortened

_NARROW = 600  # Wider ones scroll on a small screen, or their text is too small.
_NAME = 40  # Letters of a solver's name in a legend.


@dataclass(frozen=True, kw_only=True, slots=True)
class Figure:
    """Chart with its legend, caption and values.

    Attributes:
        identity: Letters, digits and hyphens; the figure's id, and its file's name.
        title: Its subject in a few words; the accessible name, too.
        caption: Runs, budget, target and test, in a sentence or two.
        chart: Markup within the `svg` element.
        width: Of the view box.
        height: Of the view box.
        columns: Headings of the table of values.
        rows: The table of values, in words; the first cell heads the row.
        legend: Names of series with their numbers.
        values: Rows of the file to download, its headings first; empty for none.
        across: The axis along which rows lie, for the values under the pointer: their
            first cells are then values of it.
        levels: In place of `across`: where each row lies in the chart, from the top.
    """

    identity: str
    title: str
    caption: str
    chart: str
    width: int = 600
    height: int = 330
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    legend: Sequence[tuple[int, str]] = ()
    values: Sequence[Sequence[Any]] = field(default=())
    across: Axis | None = None
    levels: Sequence[float] = ()

    def __html__(self) -> str:
        """Return the markup."""
        name = text_of(self.title)  # `identity` is ours: nothing in it to escape.
        return (
            f'<figure class="chart{self._wide()}" id="{self.identity}">'
            '<div class="scroll">'
            f'<svg viewBox="0 0 {self.width} {self.height}" role="img" tabindex="0" '
            f'aria-label="{name}"{self._places()}>{self.chart}</svg></div>'
            f"{legend(self.legend)}<figcaption><b>{name}.</b> {text_of(self.caption)}"
            f"</figcaption>{self._table()}</figure>\n"
        )

    def _wide(self) -> str:
        return " wide" if self.width > _NARROW else ""

    def _places(self) -> str:
        """Return the places of the values, for the script that shows those nearby."""
        if self.across is not None:
            axis = self.across
            kind = "log" if axis.is_log else "linear"
            ends = f"{axis.low:.6g} {axis.high:.6g} {axis.start:g} {axis.end:g}"
            return f' data-across="{kind} {ends}"'
        if self.levels:
            return f' data-levels="{" ".join(f"{y:.0f}" for y in self.levels)}"'
        return ""

    def _table(self) -> str:
        if not self.rows:
            return ""
        heads = [text_of(shortened(words)) for words in self.columns]
        head = "".join(f'<th scope="col">{words}' for words in heads)
        rows = "".join(
            f'<tr><th scope="row">{text_of(shortened(first))}'
            + "".join(f"<td>{text_of(words)}" for words in rest)
            for first, *rest in self.rows
        )
        return (
            f"<details><summary>Values of this figure</summary>{self._download()}"
            f'<div class="scroll" tabindex="0" role="group" '
            f'aria-label="Values: {text_of(self.title)}">'
            f"<table><thead><tr>{head}<tbody>{rows}</table></div></details>"
        )

    def _download(self) -> str:
        if not self.values:
            return ""
        address = urllib.parse.quote(csv_of(self.values), safe=",.-;:()*+/ ")
        return (
            f'<p><a download="{self.identity}.csv" '
            f'href="data:text/csv;charset=utf-8,{text_of(address)}">'
            f"Download {self.identity}.csv</a></p>"
        )


def legend(series: Sequence[tuple[int, str]]) -> str:
    """Return a list of series' samples and names; nothing for none."""
    if not series:
        return ""
    items = "".join(
        f"<li>{svg.key(place)}{text_of(shortened(name, _NAME))}"
        for place, name in series
    )
    return f'<ul class="legend">{items}</ul>'


def csv_of(rows: Sequence[Sequence[Any]]) -> str:
    r"""Return rows as CSV; missing values are empty.

    Text that a spreadsheet would take for a formula begins with an apostrophe.

    Example:
        >>> csv_of([["solver", "cost"], ["=cmd()", None]])
        "solver,cost\n'=cmd(),\n"
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for row in rows:
        writer.writerow([_cell(value) for value in row])
    return stream.getvalue()


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    text = shortened(cleaned(str(value)))
    # A number may begin with "-"; a text that does is a formula to a spreadsheet.
    is_formula = isinstance(value, str) and text.startswith(("=", "+", "-", "@", "\t"))
    return f"'{text}" if is_formula else text
