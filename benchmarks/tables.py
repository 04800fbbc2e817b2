"""Pages of tables in Markdown, how they are asked for and written, and bars on them."""

import argparse
import operator
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

RELATIONS = {"<=": operator.le, ">=": operator.ge, ">": operator.gt}


def row(*cells: str) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(cells)} |"


def head(*cells: str) -> list[str]:
    """Return the head of a table: names of the columns, and the rule below."""
    return [row(*cells), row(*["---"] * len(cells))]


class Bar(NamedTuple):
    """A bound on a number that was measured; None: it was not, here."""

    text: str
    relation: str
    bound: float
    measured: float | None

    @property
    def is_missed(self) -> bool:
        """Return whether it was measured, and is out of bounds."""
        return self.measured is not None and not RELATIONS[self.relation](
            self.measured, self.bound
        )


def bar_table(bars: Iterable[Bar]) -> list[str]:
    """Return bars and what was measured, as a section of a page."""
    lines = ["## Bars", "", *head("bar", "asked", "measured", "reached")]
    for bar in bars:
        asked = f"{bar.relation} {bar.bound:g}"
        if bar.measured is None:
            lines.append(row(bar.text, asked, "-", "skipped"))
        else:
            said = "**no**" if bar.is_missed else "yes"
            lines.append(row(bar.text, asked, f"{bar.measured:.3g}", said))
    return [*lines, ""]


def page_options(
    documentation: str | None, *, plots: bool = False
) -> argparse.ArgumentParser:
    """Return the parser of a benchmark that can write its page.

    Args:
        documentation: Of the module; its first line is the description.
        plots: Whether it can write a picture, too.
    """
    parser = argparse.ArgumentParser(description=(documentation or "").split("\n")[0])
    parser.add_argument("--write", type=Path, help="a Markdown file to write")
    if plots:
        parser.add_argument("--plot", type=Path, help="a picture to write")
    return parser


def command_of(script: str, arguments: Sequence[str] | None) -> str:
    """Return the command that makes a page, in words of a shell.

    Args:
        script: The benchmark.
        arguments: Its arguments; None: those of this process.
    """
    given = sys.argv[1:] if arguments is None else arguments
    return shlex.join(["python", script, *given])


def illustrated(
    lines: Sequence[str],
    options: argparse.Namespace,
    caption: str,
    draw: Callable[[Path], None],
) -> list[str]:
    """Return a page's tables with its picture, which is drawn if that is asked for.

    Args:
        lines: The tables.
        options: As the parser returns them.
        caption: Text for those who do not see the picture.
        draw: Writes the picture into a file.
    """
    if not options.plot:
        return [*lines]
    draw(options.plot)
    return [*lines, "", f"![{caption}]({options.plot.name})"]


MADE = "Made by `"
"""Beginning of the paragraph below the findings of a page."""


def with_findings(text: str, page: Path) -> str:
    """Return a page's new text with the findings of the page that it replaces.

    Findings are the paragraphs between the title and "Made by". They are written by
    hand, except on pages whose benchmark computes them; those are not changed here.

    Args:
        text: The new page.
        page: The file; it need not exist.
    """
    title, _, rest = text.partition("\n\n")
    if not rest.startswith(MADE):
        return text
    old = page.read_text(encoding="utf-8") if page.is_file() else ""
    found = re.match(rf"# [^\n]*\n\n(.*?)(?={MADE})", old, re.DOTALL)
    if not found or not found[1]:
        print(f"{page}: write the finding below its title", file=sys.stderr)
        return text
    print(f"{page}: its findings were kept; compare them with the new numbers",
          file=sys.stderr)  # fmt: skip
    return f"{title}\n\n{found[1]}{rest}"


def publish(lines: Sequence[str], options: argparse.Namespace, above: str = "") -> None:
    """Print a page's tables, and write the page if that is asked for.

    Args:
        lines: The tables.
        options: As the parser returns them.
        above: Text above the tables, not printed.
    """
    text = "\n".join(lines) + "\n"
    print(text)
    if options.write:
        page = with_findings(above + text, options.write)
        options.write.write_text(page, encoding="utf-8")
