"""A comparison as Markdown, for a pull request: GitHub's tables."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.naming.wording import number, percent, shortened
from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.report import rows
from swarmstart.cases.drawing.report.rows import Cell

_SPECIAL = re.compile(r"([\\`*_{}\[\]()#+!|<>~@$&])")


def comparison_markdown(content: Mapping[str, Any]) -> str:
    """Return the Markdown of a comparison: headline, tables, how to reproduce.

    Args:
        content: A record "comparison", schema 2: what `comparison.json` holds.
    """
    near = [percent(share) for share in content["near"]]
    parts = ["# Solvers compared", escaped(shortened(content["headline"], 600))]
    if content["is_noisy"]:
        parts.append("**The machine was busy with other work: compare no seconds.**")
    parts += _regression(content)
    parts += [
        "## Summary",
        _table(rows.SUMMARY, rows.summary(content)),
        f"Success: feasible along the whole path and within {near[0]} of the best cost "
        "known, with Wilson's 95 % interval.",
    ]
    for scenario in content["scenarios"]:
        parts += [
            f"## {escaped(shortened(scenario['name'], 120))}",
            escaped(rows.best_words(scenario)),
            _table(rows.DETAILS, rows.details(scenario)),
        ]
        headings, measured = rows.measures(scenario)
        if headings:
            parts.append(_table(headings, measured))
        parts += [
            f"- {escaped(shortened(solver))}: {escaped(words)}"
            for solver, words in rows.troubles(scenario)
        ]
    machines = "; ".join(rows.machine_words(found) for found in content["machines"])
    parts += [
        "## How to reproduce",
        _code(content["command"]),
        escaped(
            f"Budget {content['budget_text']}, {len(content['seeds'])} seeds, begun "
            f"{content['date']}, {number(content['total_seconds'], digits=4)} s in "
            f"all; {machines or 'machine not known'}."
        ),
        "## Known limits",
        *(f"- {escaped(shortened(words, 600))}" for words in content["limits"]),
    ]
    return "\n\n".join(parts) + "\n"


def escaped(text: object) -> str:
    r"""Return text that GitHub shows as it is, on one line.

    Example:
        >>> escaped("a|b_c")
        'a\\|b\\_c'
    """
    flat = " ".join(cleaned(str(text)).split())
    told = _SPECIAL.sub(r"\\\1", flat)
    # At a line's beginning a hyphen or "1." would begin a list, "=" a heading.
    return re.sub(r"^(\d*)([-.=])", r"\1\\\2", told)


def _regression(content: Mapping[str, Any]) -> list[str]:
    if content["regression"] is None:
        return []
    is_worse = content["regression"]["is_regression"]
    told = "Something has become worse" if is_worse else "Nothing has become worse"
    against = escaped(shortened(content["regression"]["against"], 200))
    return [
        "## Before and now",
        f"**{told}**, compared with {against}.",
        _table(rows.REGRESSION, rows.regression(content)),
    ]


def _table(headings: Sequence[str], cells: Sequence[Sequence[Cell]]) -> str:
    first = cells[0] if cells else [Cell("")] * len(headings)
    sides = ["--:" if cell.kind == "number" else "---" for cell in first]
    lines = [[escaped(words) for words in headings], sides]
    lines += [[escaped(cell.words) for cell in row] for row in cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _code(text: str) -> str:
    """Return a block of code whose fence is longer than any within it."""
    plain = cleaned(str(text))
    longest = max((len(found) for found in re.findall("`+", plain)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}\n{plain}\n{fence}"
