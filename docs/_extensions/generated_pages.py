"""Reference pages made from the command line's parser and from the JSON Schema.

A page of docs/reference has a line such as `<!-- generated: command line -->` or
`<!-- generated: keys of problem -->`; when it is read, Markdown takes the line's place.
"""

import re
from typing import Any

from command_line import commands_page
from scenario_keys import keys_page
from sphinx.application import Sphinx

MARK = re.compile(r"^<!-- generated: (command line|keys of (\w+)) -->$", re.MULTILINE)


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect this module with Sphinx."""
    app.connect("source-read", _fill)
    app.connect("env-get-outdated", _changed)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    def made(mark: re.Match[str]) -> str:
        return keys_page(mark[2]) if mark[2] else commands_page()

    if page.startswith("reference/"):
        source[0] = MARK.sub(made, source[0])


def _changed(app: Sphinx, env: Any, *_: Any) -> list[str]:
    """Return the pages to read again: their source is the package."""
    return [page for page in env.all_docs if page.startswith("reference/")]
