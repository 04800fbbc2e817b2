"""Attributes for readers by keyboard and by ear, put into the pages of the theme."""

from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

CHANGES = {
    '<p class="caption" role="heading">': '<p class="caption" role="heading" '
    'aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" '
    'aria-label="Pages">',
    '<aside class="toc-drawer': '<aside aria-label="Parts of this page" '
    'class="toc-drawer',
    '<th class="head"><p></p></th>': "<td></td>",
    " id='sg-tag-list'": "",  # It would be there several times.
    "<pre>": '<pre tabindex="0">',  # It may scroll.
}
"""Text of a page -> the text that takes its place."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect this module with Sphinx."""
    app.connect("build-finished", _complete)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _complete(app: Sphinx, exception: Exception | None) -> None:
    """Change all pages that were written."""
    if exception is not None or app.builder.format != "html":
        return
    for page in Path(app.outdir).rglob("*.html"):
        text = found = page.read_text(encoding="utf-8")
        for before, after in CHANGES.items():
            text = text.replace(before, after)
        if text != found:
            page.write_text(text, encoding="utf-8")
