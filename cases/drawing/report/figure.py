"""A figure of a page: chart, caption, table of values, values to download."""

import csv
import io
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.report.svg import WIDTH, Chart, text_of
from swarmstart.cases.drawing.wording import shortened


@dataclass(frozen=True, kw_only=True, slots=True)
class Figure:
    """Chart with its caption and values.

    Attributes:
        identity: Id of the figure and name of its file: letters, digits and hyphens.
        title: Subject of the figure in a few words, which is also its accessible name.
        caption: One or two sentences on runs, budget, target and test.
        chart: The drawing. Its attribute `follows` says how values at the pointer are
            found in the table: "across" if the first cells of the rows are values of
            the horizontal axis, "levels" if row k is drawn at the height k, empty if no
            values are shown.
        columns: Headings of the table of values.
        rows: Rows of the table of values, in words; the first cell is the heading of
            the row.
        values: Rows of the file to download, headings first; empty if there is no file.
    """

    identity: str
    title: str
    caption: str
    chart: Chart
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    values: Sequence[Sequence[Any]] = field(default=())

    def __html__(self) -> str:
        """Return the markup."""
        name = text_of(self.title)  # `identity` is ours: nothing in it to escape.
        chart = self.chart
        # Wider ones scroll on a small screen, or their text is too small.
        wide = " wide" if chart.width > WIDTH else ""
        return (
            f'<figure class="chart{wide}" id="{self.identity}"><div class="scroll">'
            f'<svg class="drawn" viewBox="0 0 {chart.width:g} {chart.height:g}" '
            f'role="img" tabindex="0" aria-label="{name}"{chart.follows}>'
            f"{chart.drawing}</svg></div>"
            f"<figcaption><b>{name}.</b> {text_of(self.caption)}"
            f"</figcaption>{self._table()}</figure>\n"
        )

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
