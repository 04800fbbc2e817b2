"""The page of a run, and of the same run with many seeds; the tables as text, too.

run_page(folder), run_markdown(folder), run_latex(folder)
seeds_page(content), seeds_markdown(content), seeds_latex(content)
"""

from pathlib import Path

from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report.pages.run_content import (
    CLAIM_HEADS,
    MEASURE_HEADS,
    RunContent,
    run_content,
)
from swarmstart.cases.drawing.report.pages.seeds_page import (
    seeds_latex,
    seeds_markdown,
    seeds_page,
)
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES, pictures_of
from swarmstart.cases.drawing.report.player import player
from swarmstart.cases.drawing.report.step_table import step_table
from swarmstart.cases.drawing.report.text_tables import (
    latex_table,
    latex_text,
    markdown_table,
    markdown_text,
)

__all__ = [
    "run_latex",
    "run_markdown",
    "run_page",
    "seeds_latex",
    "seeds_markdown",
    "seeds_page",
]

VERDICTS = {"holds": "good", "does not hold": "bad", "not judged": "mid"}


def run_page(folder: Path) -> str:
    """Return the page of a run: one file that asks for nothing, below 2 MB.

    Args:
        folder: The record of `swarmstart run`.

    Raises:
        RecordError: If there is none, or it is damaged.
        SwarmstartError: If its scenario cannot be read.
    """
    return page_of(run_content(folder))


def page_of(content: RunContent) -> str:
    """Return the page of what a run's record says."""
    parts = {
        "content": content,
        "flight": player(content.tracks),
        "steps": step_table(content.tracks),
        "verdicts": VERDICTS,
        "pictures": [],
    }
    room = PAGE_BYTES - len(rendered("run_page.html.j2", parts).encode()) - 20_000
    pictures = pictures_of(
        content.record.folder, content.figures, content.kind, room=room
    )
    return rendered("run_page.html.j2", {**parts, "pictures": pictures})


def run_markdown(folder: Path) -> str:
    """Return headline, measures and claims of a run as Markdown."""
    content = run_content(folder)
    parts = [
        f"# {markdown_text(content.title)}",
        markdown_text(content.headline),
        "## Measures",
        markdown_table(MEASURE_HEADS, measure_cells(content)),
    ]
    if content.claims:
        parts += ["## Claims", markdown_table(CLAIM_HEADS, claim_cells(content))]
    limits = "\n".join(f"- {markdown_text(line)}" for line in content.limits)
    parts += ["## Limits", limits, "## Again", f"    {content.command}"]
    return "\n\n".join(parts) + "\n"


def run_latex(folder: Path) -> str:
    """Return headline, measures and claims of a run as LaTeX.

    They need the packages booktabs, longtable and textcomp.
    """
    content = run_content(folder)
    parts = [
        r"% Needs \usepackage[T1]{fontenc}, \usepackage{booktabs,longtable,textcomp}.",
        latex_text(content.headline),
        latex_table(
            MEASURE_HEADS, measure_cells(content), columns="lrlp{6cm}",
            title=f"{content.title}: measures",
        ),
    ]  # fmt: skip
    if content.claims:
        parts.append(
            latex_table(
                CLAIM_HEADS, claim_cells(content),
                columns="llrp{3cm}p{5cm}p{2cm}", title=f"{content.title}: claims",
            )
        )  # fmt: skip
    return "\n\n".join(parts) + "\n"


def measure_cells(content: RunContent) -> list[tuple[str, ...]]:
    """Return the rows of the table of measures."""
    return [(row.name, row.text, row.unit, row.meaning) for row in content.measures]


def claim_cells(content: RunContent) -> list[tuple[str, ...]]:
    """Return the rows of the table of claims."""
    return [
        (row.id, row.verdict, row.measured, row.asked, row.text, row.source)
        for row in content.claims
    ]
