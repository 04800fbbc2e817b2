"""Tables as Markdown and as LaTeX, with any text in their cells."""

import re
from collections.abc import Sequence

from swarmstart.cases.drawing.page import cleaned

Rows = Sequence[Sequence[str]]

_MARKDOWN = re.compile(r"([\\`*_{}\[\]<>|#~$])")
_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#",
    "_": r"\_", "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}",
    "\N{MULTIPLICATION SIGN}": r"$\times$", "\N{MINUS SIGN}": r"$-$",
    "²": r"\textsuperscript{2}", "°": r"\textdegree{}", "±": r"$\pm$", "…": r"\dots{}",
    "≤": r"$\le$", "≥": r"$\ge$", "µ": r"\textmu{}",
}  # fmt: skip


def markdown_text(text: str) -> str:
    r"""Return a text that Markdown shows as it is, in one line.

    Example:
        >>> print(markdown_text("a|b *c*"))
        a\|b \*c\*
    """
    return _MARKDOWN.sub(r"\\\1", _one_line(text))


def markdown_table(heads: Sequence[str], rows: Rows) -> str:
    """Return a table in Markdown; its cells are escaped."""
    lines = [heads, *rows]
    said = [f"| {' | '.join(map(markdown_text, line))} |" for line in lines]
    said.insert(1, "|" + " --- |" * len(heads))
    return "\n".join(said)


def latex_text(text: str) -> str:
    r"""Return a text that LaTeX sets as it is.

    Example:
        >>> print(latex_text("50 % of x_1"))
        50 \% of x\_1
    """
    return "".join(_LATEX.get(sign, sign) for sign in _one_line(text))


def latex_table(heads: Sequence[str], rows: Rows, *, columns: str, title: str) -> str:
    """Return a table in LaTeX for the packages booktabs and longtable.

    Args:
        heads: Headings.
        rows: Cells; they are escaped.
        columns: LaTeX's own word for the columns, such as "lrp{8cm}".
        title: The caption.
    """
    head = " & ".join(map(latex_text, heads)) + r" \\"
    body = [" & ".join(map(latex_text, row)) + r" \\" for row in rows]
    return "\n".join(
        [
            rf"\begin{{longtable}}{{{columns}}}",
            rf"\caption{{{latex_text(title)}}} \\",
            r"\toprule",
            head,
            r"\midrule",
            r"\endhead",
            *body,
            r"\bottomrule",
            r"\end{longtable}",
        ]
    )


def _one_line(text: str) -> str:
    return " ".join(cleaned(text).split())
