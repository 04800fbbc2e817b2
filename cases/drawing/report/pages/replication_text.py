"""The claims of a replication as text: Markdown and LaTeX."""

from collections.abc import Mapping
from typing import Any

from swarmstart.cases.drawing.report.text_tables import (
    latex_table,
    latex_text,
    markdown_table,
    markdown_text,
)

HEADS = ("claim", "what the chapter says", "where", "measured", "verdict")


def replication_markdown(content: Mapping[str, Any]) -> str:
    """Return the claims with what was measured and the verdicts as Markdown.

    Args:
        content: As replication.json holds it.
    """
    parts = [
        "# The chapter replicated",
        markdown_text(f"{content['counted']}; {content['seeds_in_words']}."),
        markdown_table(HEADS, _rows(content)),
    ]
    return "\n\n".join(parts) + "\n"


def replication_latex(content: Mapping[str, Any]) -> str:
    """Return the same as LaTeX, for the packages booktabs, longtable and textcomp."""
    parts = [
        r"% Needs \usepackage[T1]{fontenc}, \usepackage{booktabs,longtable,textcomp}.",
        latex_text(f"{content['counted']}; {content['seeds_in_words']}."),
        latex_table(
            HEADS,
            _rows(content),
            columns="rp{5cm}p{2cm}p{5cm}l",
            title="The chapter replicated",
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _rows(content: Mapping[str, Any]) -> list[tuple[str, ...]]:
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
