"""Docstrings of the package as reStructuredText: they are plain text with backticks.

Symbols that reStructuredText would take for marks (`*`, `|`, `_`) are escaped, and
blocks that are indented, such as equations, are shown as they are written.
"""

import re
from typing import Any

from sphinx.application import Sphinx

CODE = re.compile(r"(`+[^`]*`+)")
MARKS = re.compile(r"[*|\\]|(?<=\w)_(?!\w)")
SECTION = re.compile(r"[A-Z][A-Za-z ]*:$")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect this module with Sphinx."""
    app.connect("autodoc-process-docstring", _read, priority=400)  # before napoleon
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def readable(lines: list[str]) -> list[str]:
    """Return the lines of a docstring as reStructuredText."""
    found: list[str] = []
    section = ""
    in_doctest = in_block = False
    for line in lines:
        text, is_indented = line.strip(), line.startswith(" ")
        if text and not is_indented:
            section, in_block = text if SECTION.match(text) else "", False
        after_blank = bool(found) and not found[-1].strip()
        in_doctest = bool(text) and (in_doctest or text.startswith(">>>"))
        if is_indented and after_blank and not (section or in_block or in_doctest):
            found += ["::", ""]
            in_block = True
        found.append(line if in_block or in_doctest else _escaped(line))
    return found


def _escaped(line: str) -> str:
    """Return a line whose marks outside of code are letters."""
    return "".join(
        part if CODE.fullmatch(part) else MARKS.sub(r"\\\g<0>", part)
        for part in CODE.split(line)
    )


def _read(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    lines[:] = readable(lines)


def _skip(
    app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any
) -> bool | None:
    """Leave out the fields of named tuples, which Attributes describe already."""
    return True if type(thing).__name__ == "_tuplegetter" else None
