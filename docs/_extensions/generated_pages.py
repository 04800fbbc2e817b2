"""Parts of pages that are made when the site is built.

A page has a line such as `<!-- generated: command line -->`; when it is read, Markdown
takes the line's place: the options of all commands, from the parser; `keys of KIND`,
from the JSON Schema; or, in the list of contents, `other pages of FOLDER`: those that
it does not list by itself, so that every page is reachable.
"""

import re
from pathlib import Path, PurePosixPath
from typing import Any

from sphinx.application import Sphinx

from swarmstart.docs._extensions.command_line import commands_page
from swarmstart.docs._extensions.scenario_keys import keys_page

MARK = re.compile(
    r"^<!-- generated: (command line|keys of|other pages of) ?(\S*) -->$", re.MULTILINE
)
LISTED = re.compile(r"^```\{toctree\}$(.*?)^```$", re.MULTILINE | re.DOTALL)


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect this module with Sphinx."""
    app.connect("source-read", _fill)
    app.connect("env-get-outdated", _changed)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the marks of a page."""
    text = source[0]

    def made(mark: re.Match[str]) -> str:
        if mark[1] == "command line":
            return commands_page()
        if mark[1] == "keys of":
            return keys_page(mark[2])
        return "\n".join(_other_pages(app, text, PurePosixPath(mark[2])))

    source[0] = MARK.sub(made, text)


def _other_pages(app: Sphinx, text: str, folder: PurePosixPath) -> list[str]:
    """Return the pages of a folder that neither text nor the folder's index lists."""
    listed = {name for part in LISTED.findall(text) for name in part.split()}
    index = Path(app.srcdir) / folder / "index.md"
    if folder.parts and index.exists():
        inner = LISTED.findall(index.read_text(encoding="utf-8"))
        listed |= {str(folder / name) for part in inner for name in part.split()}
    pages = (
        page for page in app.env.found_docs if PurePosixPath(page).parent == folder
    )
    return sorted(page for page in pages if page not in listed and page != "index")


def _changed(app: Sphinx, env: Any, *_: Any) -> list[str]:
    """Return the pages to read again: those that are made of other files."""
    return [page for page in env.all_docs if "index" in page or "reference/" in page]
