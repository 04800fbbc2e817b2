"""Self-contained HTML pages: one file each, no network.

A page's policy (`Content-Security-Policy`) lets the browser ask for nothing and run no
script but the page's own: `hashed` puts the SHA-256 of each style sheet and script into
it while the page is made. Thus a user's text that gets into a page unescaped is shown,
and not run.
"""

import base64
import functools
import hashlib
import importlib.resources
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup

_FOLDER = "report/templates"
# Controls, lone surrogates and non-characters have no place in a page; marks that turn
# the reading order round would do so beyond the text that they are in.
_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069"
    "\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]"
)


def rendered(template: str, content: Mapping[str, Any]) -> str:
    """Return a page made from a template; texts in it are cleaned and escaped.

    Args:
        template: Name of a file in `cases/drawing/report/templates`.
        content: Values for the names in the template. Text of the type
            `markupsafe.Markup` is inserted as it is.
    """
    return _environment().get_template(template).render(dict(content))


def cleaned(text: str) -> str:
    """Return a text with its unprintable characters shown as U+FFFD.

    Example:
        >>> cleaned("a" + chr(0) + "b") == "a" + chr(0xFFFD) + "b"
        True
    """
    return _UNPRINTABLE.sub("\ufffd", text)


def hashed(text: str) -> "Markup":
    """Return the hash by which a page's policy allows this style sheet or script.

    Source: Content Security Policy Level 3, section 2.3.1 (hash-source).
    """
    from markupsafe import Markup

    digest = base64.b64encode(hashlib.sha256(str(text).encode()).digest())
    return Markup("'sha256-{}'").format(digest.decode("ascii"))


def _source(name: str) -> str | None:
    # As a resource: an installed package need not be a folder.
    file = importlib.resources.files(__package__).joinpath(_FOLDER, name)
    return file.read_text(encoding="utf-8") if file.is_file() else None


def _printable(value: Any) -> Any:
    """Clean text on its way into a page; markup has been cleaned before."""
    if isinstance(value, str) and not hasattr(value, "__html__"):
        return cleaned(value)
    return value


@functools.cache
def _environment() -> "jinja2.Environment":
    # Not at the head: Markdown, LaTeX and CSV need `cleaned` alone.
    import jinja2

    from swarmstart.cases.drawing import palette

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_source),
        autoescape=True,
        finalize=_printable,
        undefined=jinja2.StrictUndefined,  # A misspelt name leaves no silent gap.
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["hashed"] = hashed
    environment.globals["palette_css"] = palette.style_sheet()
    return environment
