"""A comparison as LaTeX: tables in the style of booktabs, for an article."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.naming.wording import percent, shortened
from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.report import rows
from swarmstart.cases.drawing.report.rows import Cell

_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&",
    "#": r"\#", "%": r"\%", "_": r"\_", "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "`": r"\textasciigrave{}",
    "'": r"\textquotesingle{}", "…": r"\ldots{}", "é": r"\'{e}",
}  # fmt: skip
_OTHER = re.compile(r"[^\x20-\x7e]")
_ASCII = 0x7F


def comparison_latex(content: Mapping[str, Any]) -> str:
    """Return a table of all scenarios, and one for each.

    The preamble needs the packages booktabs, textcomp and, for the length of the
    tables, longtable. Letters beyond ASCII without a decomposition are shown as "?".

    Args:
        content: A record "comparison", schema 2: what `comparison.json` holds.
    """
    near = percent(content["near"][0]) if content["near"] else ""
    seeds, budget = len(content["seeds"]), content["budget_text"]
    head = [
        "% Made by swarmstart. In the preamble:",
        r"% \usepackage[T1]{fontenc} \usepackage{booktabs,longtable,textcomp}",
    ]
    whole = _table(
        rows.SUMMARY,
        rows.summary(content),
        caption=f"Summary. Success: feasible along the whole path and within {near} "
        f"of the best cost known, with Wilson's 95 % interval; {seeds} seeds, budget "
        f"{budget}.",
        label="tab:summary",
    )
    single = [
        _table(
            rows.DETAILS[:-1],
            [row[:-1] for row in rows.details(scenario)],
            caption=f"{shortened(scenario['name'], 120)}. {rows.best_words(scenario)} "
            f"{seeds} seeds, budget {budget}.",
            label=f"tab:scenario-{place}",
        )
        for place, scenario in enumerate(content["scenarios"], 1)
    ]
    return "\n".join([*head, whole, *single])


def escaped(text: object) -> str:
    r"""Return text that LaTeX sets as it is, on one line, in ASCII.

    Example:
        >>> escaped("50 %_a")
        '50 \\%\\_a'
    """
    flat = " ".join(cleaned(str(text)).split())
    return "".join(_SPECIAL.get(letter) or _plain(letter) for letter in flat)


def _plain(letter: str) -> str:
    """Return a letter in ASCII: without its accent, or a question mark."""
    if not _OTHER.match(letter):
        return letter
    parts = unicodedata.normalize("NFKD", letter)
    base = "".join(part for part in parts if ord(part) < _ASCII and part.isalnum())
    return base or "?"


def _table(
    headings: Sequence[str],
    cells: Sequence[Sequence[Cell]],
    *,
    caption: str,
    label: str,
) -> str:
    first = cells[0] if cells else [Cell("")] * len(headings)
    columns = "".join("r" if cell.kind == "number" else "l" for cell in first)
    body = [" & ".join(escaped(cell.words) for cell in row) + r" \\" for row in cells]
    return "\n".join(
        [
            rf"\begin{{longtable}}{{{columns}}}",
            rf"\caption{{{escaped(caption)}}}\label{{{label}}}\\",
            r"\toprule",
            " & ".join(escaped(words) for words in headings) + r" \\",
            r"\midrule",
            r"\endhead",
            *body,
            r"\bottomrule",
            r"\end{longtable}",
            "",
        ]
    )
