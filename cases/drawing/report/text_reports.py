"""Tables as Markdown and as LaTeX, with any text in their cells; comparisons, claims.

A comparison is Markdown for a pull request, in GitHub's tables, or LaTeX for an
article, in ASCII. The claims of a replication are Markdown or LaTeX. Tables in LaTeX
are in the style of booktabs.
"""

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.report import rows
from swarmstart.cases.drawing.report.rows import Cell
from swarmstart.cases.drawing.wording import number, percent, shortened
from swarmstart.cases.format.document import counted

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

# Of a comparison, for any encoding of the article; _LATEX leaves letters as they are.
_ASCII_LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&",
    "#": r"\#", "%": r"\%", "_": r"\_", "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "`": r"\textasciigrave{}",
    "'": r"\textquotesingle{}", "…": r"\ldots{}", "é": r"\'{e}",
}  # fmt: skip
_NOT_ASCII = re.compile(r"[^\x20-\x7e]")
_ASCII_END = 0x7F

# More than _MARKDOWN: images and links (!, parentheses), lists (+), mentions (@),
# entities (&).
_GITHUB_SPECIAL = re.compile(r"([\\`*_{}\[\]()#+!|<>~@$&])")

REPLICATION_HEADS = ("claim", "what the chapter says", "where", "measured", "verdict")


def markdown_text(text: str) -> str:
    r"""Return a text that Markdown shows as it is, in one line.

    Example:
        >>> print(markdown_text("a|b *c*"))
        a\|b \*c\*
    """
    return _MARKDOWN.sub(r"\\\1", _one_line(text))


def markdown_table(heads: Sequence[str], cells: Rows) -> str:
    """Return a table in Markdown; its cells are escaped."""
    lines = [heads, *cells]
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


def latex_table(heads: Sequence[str], cells: Rows, *, columns: str, title: str) -> str:
    """Return a table in LaTeX for the packages booktabs and longtable.

    Args:
        heads: Headings.
        cells: Rows of cells; their texts are escaped.
        columns: Specification of the columns in LaTeX, such as "lrp{8cm}".
        title: The caption.
    """
    caption = rf"\caption{{{latex_text(title)}}} \\"
    return _longtable(
        columns, caption, [map(latex_text, row) for row in (heads, *cells)]
    )


def _longtable(columns: str, caption: str, table: Sequence[Iterable[str]]) -> str:
    """Return a table in LaTeX from its caption and its rows, the headings first."""
    head, *body = (" & ".join(row) + r" \\" for row in table)
    begin = [rf"\begin{{longtable}}{{{columns}}}", caption, r"\toprule", head]
    end = [r"\bottomrule", r"\end{longtable}"]
    return "\n".join([*begin, r"\midrule", r"\endhead", *body, *end])


def _one_line(text: object) -> str:
    return " ".join(cleaned(str(text)).split())


def comparison_latex(content: Mapping[str, Any]) -> str:
    """Return a LaTeX table of all scenarios, and one for each scenario.

    The preamble needs the packages booktabs, textcomp and, for the length of the
    tables, longtable. Letters beyond ASCII without a decomposition are shown as "?".

    Args:
        content: Content of `comparison.json`: a record "comparison" of schema 2.
    """
    near = percent(content["near"][0]) if content["near"] else ""
    seeds, budget = counted(len(content["seeds"]), "seed"), content["budget_text"]
    head = [
        "% Made by swarmstart. In the preamble:",
        r"% \usepackage[T1]{fontenc} \usepackage{booktabs,longtable,textcomp}",
    ]
    whole = _ascii_table(
        rows.SUMMARY,
        rows.summary(content),
        caption=f"Summary. Success: feasible along the whole path and within {near} "
        f"of the best cost known, with Wilson's 95 % interval; {seeds}, budget "
        f"{budget}.",
        label="tab:summary",
    )
    single = [
        _ascii_table(
            # Without the sentence on the test: these columns break no lines.
            rows.DETAILS[:-1],
            [row[:-1] for row in rows.details(scenario)],
            caption=f"{shortened(scenario['name'], 120)}. {rows.best_words(scenario)} "
            f"{seeds}, budget {budget}.",
            label=f"tab:scenario-{place}",
        )
        for place, scenario in enumerate(content["scenarios"], 1)
    ]
    return "\n".join([*head, whole, *single])


def ascii_latex(text: object) -> str:
    r"""Return text that LaTeX sets as it is, on one line, in ASCII.

    Example:
        >>> ascii_latex("50 %_a")
        '50 \\%\\_a'
    """
    flat = _one_line(text)
    return "".join(_ASCII_LATEX.get(letter) or _ascii(letter) for letter in flat)


def _ascii(letter: str) -> str:
    """Return a letter in ASCII: without its accent, or a question mark."""
    if not _NOT_ASCII.match(letter):
        return letter
    parts = unicodedata.normalize("NFKD", letter)
    base = "".join(part for part in parts if ord(part) < _ASCII_END and part.isalnum())
    return base or "?"


def _ascii_table(
    headings: Sequence[str],
    cells: Sequence[Sequence[Cell]],
    *,
    caption: str,
    label: str,
) -> str:
    first = cells[0] if cells else [Cell("")] * len(headings)
    columns = "".join("r" if cell.kind == "number" else "l" for cell in first)
    said = rf"\caption{{{ascii_latex(caption)}}}\label{{{label}}}\\"
    table = [headings, *([cell.words for cell in row] for row in cells)]
    return _longtable(columns, said, [map(ascii_latex, row) for row in table]) + "\n"


def comparison_markdown(content: Mapping[str, Any]) -> str:
    """Return the Markdown of a comparison: headline, tables, how to reproduce.

    Args:
        content: Content of `comparison.json`: a record "comparison" of schema 2.
    """
    near = [percent(share) for share in content["near"]]
    parts = ["# Solvers compared", github_text(shortened(content["headline"], 600))]
    if content["is_noisy"]:
        parts.append("**The machine was busy with other work: compare no seconds.**")
    parts += _github_regression(content)
    parts += [
        "## Summary",
        _github_table(rows.SUMMARY, rows.summary(content)),
        f"Success: feasible along the whole path and within {near[0]} of the best cost "
        "known, with Wilson's 95 % interval.",
    ]
    for scenario in content["scenarios"]:
        parts += [
            f"## {github_text(shortened(scenario['name'], 120))}",
            github_text(rows.best_words(scenario)),
            _github_table(rows.DETAILS, rows.details(scenario)),
        ]
        headings, measured = rows.measures(scenario)
        if headings:
            parts.append(_github_table(headings, measured))
        parts += [
            f"- {github_text(shortened(solver))}: {github_text(words)}"
            for solver, words in rows.troubles(scenario)
        ]
    machines = "; ".join(rows.machine_words(found) for found in content["machines"])
    parts += [
        "## How to reproduce",
        _github_code(content["command"]),
        github_text(
            f"Budget {content['budget_text']}, "
            f"{counted(len(content['seeds']), 'seed')}, begun "
            f"{content['date']}, {number(content['total_seconds'], digits=4)} s in "
            f"all; {machines or 'machine not known'}."
        ),
        "## Known limits",
        *(f"- {github_text(shortened(words, 600))}" for words in content["limits"]),
    ]
    return "\n\n".join(parts) + "\n"


def github_text(text: object) -> str:
    r"""Return text that GitHub shows as it is, on one line.

    Example:
        >>> github_text("a|b_c")
        'a\\|b\\_c'
    """
    told = _GITHUB_SPECIAL.sub(r"\\\1", _one_line(text))
    # At a line's beginning a hyphen or "1." would begin a list, "=" a heading.
    return re.sub(r"^(\d*)([-.=])", r"\1\\\2", told)


def _github_regression(content: Mapping[str, Any]) -> list[str]:
    if content["regression"] is None:
        return []
    is_worse = content["regression"]["is_regression"]
    told = "Something has become worse" if is_worse else "Nothing has become worse"
    against = github_text(shortened(content["regression"]["against"], 200))
    return [
        "## Before and now",
        f"**{told}**, compared with {against}.",
        _github_table(rows.REGRESSION, rows.regression(content)),
    ]


def _github_table(headings: Sequence[str], cells: Sequence[Sequence[Cell]]) -> str:
    first = cells[0] if cells else [Cell("")] * len(headings)
    sides = ["--:" if cell.kind == "number" else "---" for cell in first]
    lines = [[github_text(words) for words in headings], sides]
    lines += [[github_text(cell.words) for cell in row] for row in cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _github_code(text: str) -> str:
    """Return a block of code whose fence is longer than any within it."""
    plain = cleaned(str(text))
    longest = max((len(found) for found in re.findall("`+", plain)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}\n{plain}\n{fence}"


def replication_markdown(content: Mapping[str, Any]) -> str:
    """Return the claims with what was measured and the verdicts as Markdown.

    Args:
        content: Content of replication.json.
    """
    parts = [
        "# The chapter replicated",
        markdown_text(f"{content['counted']}; {content['seeds_in_words']}."),
        markdown_table(REPLICATION_HEADS, _claim_rows(content)),
    ]
    return "\n\n".join(parts) + "\n"


def replication_latex(content: Mapping[str, Any]) -> str:
    """Return the claims as LaTeX, for the packages booktabs, longtable and textcomp."""
    parts = [
        r"% Needs \usepackage[T1]{fontenc}, \usepackage{booktabs,longtable,textcomp}.",
        latex_text(f"{content['counted']}; {content['seeds_in_words']}."),
        latex_table(
            REPLICATION_HEADS,
            _claim_rows(content),
            columns="rp{5cm}p{2cm}p{5cm}l",
            title="The chapter replicated",
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _claim_rows(content: Mapping[str, Any]) -> list[tuple[str, ...]]:
    return [
        (
            str(claim["id"]),
            claim["text"],
            claim["source"],
            "; ".join(f"{p['measured']}: {p['verdict']}" for p in claim["parts"]),
            claim["verdict"],
        )
        for claim in content["claims"]
    ]
