"""Docstrings of the package as reStructuredText: they are plain text with backticks.

Symbols that reStructuredText would take for marks (`*`, `|`, `_`) are escaped, and
blocks that are indented, such as equations, are shown as they are written. Attributes
get their types; long types of NumPy get the names that the source has for them.
"""

import re
from typing import Any, get_type_hints

from numpy.typing import ArrayLike
from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation

CODE = re.compile(r"(`+[^`]*`+)")
MARKS = re.compile(r"[*|\\]|(?<=\w)_(?!\w)")
SECTION = re.compile(r"[A-Z][A-Za-z ]*:$")
ATTRIBUTE = re.compile(r"    (\w+): ")
ARRAYS = re.compile(r"~?(?:numpy\.)?ndarray\[tuple\[[^]]*\], (?:~?[\w.]*\[[^]]*\])\]")
ARRAY_LIKES = tuple(
    stringify_annotation(ArrayLike, mode)
    for mode in ("smart", "fully-qualified-except-typing")
)
MODULES = re.compile(r"~?\b(?:\w+\.)+(?=\w)")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect this module with Sphinx."""
    app.connect("autodoc-process-docstring", _read, priority=400)  # before napoleon
    app.connect("autodoc-skip-member", _skip)
    app.connect("object-description-transform", _shorten, priority=400)
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


def short(annotation: str) -> str:
    """Return a type with short names for arrays and for what becomes an array."""
    for long in ARRAY_LIKES:
        annotation = annotation.replace(long, "~numpy.typing.ArrayLike")
    return ARRAYS.sub("~numpy.ndarray", annotation)


def _typed(thing: Any, lines: list[str]) -> None:
    """Add the types of a class to the lines of its attributes."""
    try:
        hints = get_type_hints(thing)
    except (NameError, TypeError):  # Of names that only type checkers import.
        return
    section = ""
    for number, line in enumerate(lines):
        if line and not line.startswith(" "):
            section = line
        found = ATTRIBUTE.match(line)
        if section == "Attributes:" and found and found[1] in hints:
            words = short(stringify_annotation(hints[found[1]], "smart"))
            named = f"    {found[1]} ({MODULES.sub('', words)}): "
            lines[number] = named + line[found.end() :]


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
    if what == "class":
        _typed(thing, lines)


def _shorten(app: Sphinx, domain: str, kind: str, content: Any) -> None:
    """Shorten the types that autodoc is about to write."""
    document = getattr(app.env, "current_document", None)
    types = getattr(document, "autodoc_annotations", {})
    for found in types.values():
        for name, annotation in found.items():
            found[name] = short(annotation)


def _skip(
    app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any
) -> bool | None:
    """Leave out the fields of named tuples, which Attributes describe already."""
    return True if type(thing).__name__ == "_tuplegetter" else None
