"""Self-contained HTML pages: one file each, no network."""

import base64
import importlib.resources
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def rendered(template: str, content: Mapping[str, Any]) -> str:
    """Return a page; everything that is put into it is escaped.

    Args:
        template: A file of `cases/drawing/drawing/templates`.
        content: What the template names.
    """
    import jinja2

    file = importlib.resources.files(__package__) / "templates" / template
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text = environment.from_string(file.read_text(encoding="utf-8"))
    return text.render(dict(content))


def embedded(file: Path) -> str:
    """Return a file's content as text for a data: address."""
    return base64.b64encode(file.read_bytes()).decode("ascii")
