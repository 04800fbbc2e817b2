"""Blocks of code on the Markdown pages, with what stands before them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

FENCE = re.compile(r"^ {0,3}(```+|~~~+)\s*([^\s`]*)")
EXCLUDED = re.compile(r"^<!-- not run: (.+) -->$")
SAVED = re.compile(r"Save (?:it|this|that)?\s*as `([\w./-]+)`")
FIRST_LINE = re.compile(r"# ([\w-]+\.(?:py|yaml|csv))$")
PRINTS = re.compile(r"\bprints:?$")


class Block(NamedTuple):
    """A block of code.

    Attributes:
        line: Number of its first line, from 1.
        language: The word after the fence; empty for an indented block.
        text: Its lines.
        before: The paragraph before it.
        excluded: Reason for not running it; empty if it is run.
    """

    line: int
    language: str
    text: str
    before: str
    excluded: str

    @property
    def is_output(self) -> bool:
        """True if it shows what the Python block before it prints."""
        is_text = self.language in ("", "text")
        return is_text and PRINTS.search(self.before) is not None

    @property
    def file(self) -> str:
        """Name of the file that the page asks to save it as; empty if none."""
        first = FIRST_LINE.match(self.text.partition("\n")[0])
        found = first or SAVED.search(self.before)
        return found[1] if found else ""


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page from top to bottom."""
    return list(_blocks(page.read_text(encoding="utf-8").splitlines()))


def _blocks(lines: list[str]) -> Iterator[Block]:
    before: list[str] = []
    excluded, at, is_new = "", 0, True
    while at < len(lines):
        line, start = lines[at], at
        fence, mark = FENCE.match(line), EXCLUDED.match(line)
        if fence:
            at, text = _fenced(lines, at, fence[1])
        elif line.startswith("    ") and (at == 0 or not lines[at - 1].strip()):
            at, text = _indented(lines, at)
        elif mark:
            excluded, at = mark[1], at + 1
            continue
        else:
            if line.strip():
                before = [line] if is_new else [*before, line]
            is_new = not line.strip()
            at += 1
            continue
        language = fence[2] if fence else ""
        yield Block(start + 1, language, text, " ".join(before).strip(), excluded)
        excluded, before, is_new = "", [], True


def _fenced(lines: list[str], at: int, fence: str) -> tuple[int, str]:
    """Return the line after a fenced block and its text."""
    end = at + 1
    while end < len(lines) and not lines[end].strip().startswith(fence):
        end += 1
    return end + 1, "".join(f"{line}\n" for line in lines[at + 1 : end])


def _indented(lines: list[str], at: int) -> tuple[int, str]:
    """Return the line after an indented block and its text."""
    end = at
    while end < len(lines) and (
        lines[end].startswith("    ") or not lines[end].strip()
    ):
        end += 1
    return end, "".join(f"{line[4:]}\n" for line in lines[at:end]).rstrip() + "\n"
