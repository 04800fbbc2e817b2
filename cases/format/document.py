"""Documents: plain data of a YAML text, with the place of every value."""

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import TypeAlias

from swarmstart.errors import SwarmstartError

Value: TypeAlias = "str | int | float | bool | list[Value] | dict[str, Value] | None"
Path: TypeAlias = tuple[str | int, ...]
MAX_SHOWN = 40  # characters of a value in a message
LINE_BREAK = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True, slots=True, order=True)
class Place:
    """A place in a text, "file:line:column"; line and column count from 1.

    If the text is an option of the command line (its name begins with "--"), a line and
    a column above 1 are written in words, such as "--set a, column 3".
    """

    name: str
    line: int
    column: int

    def __str__(self) -> str:
        """Join with colons; characters that cannot be printed are escaped."""
        name = printable(self.name)
        if name.startswith("--"):
            parts = {"line": self.line, "column": self.column}
            shown = [f", {what} {n}" for what, n in parts.items() if n > 1]
            return "".join([name, *shown])
        return f"{name}:{self.line}:{self.column}"


class YamlError(SwarmstartError):
    """A text can be read, but this format does not allow it.

    Attributes:
        what: Description of what was expected and what was found, without the place.
        places: Places of the error, the most important first; a repeated key has two.
        frame: The line of the error with a caret below; "" if there is no line.
    """

    def __init__(self, what: str, *places: Place, frame: str = "") -> None:
        """Keep the parts; the message is "file:line:column: what"."""
        super().__init__(what, *places)
        self.what = what
        self.places = places
        self.frame = frame

    def __str__(self) -> str:
        """Put the first place before the message."""
        return ": ".join([*map(str, self.places[:1]), self.what])


class UnreadableFileError(SwarmstartError):
    """A file is missing, forbidden, or cannot be read.

    Attributes:
        path: The path as given.
        reason: Description of what was found instead.
    """

    def __init__(self, path: str, reason: str) -> None:
        """Keep the parts."""
        super().__init__(path, reason)
        self.path = path
        self.reason = reason

    def __str__(self) -> str:
        """Return the file and the reason."""
        return f"{printable(self.path)}: expected a readable file, {self.reason}"


@dataclass(frozen=True, slots=True)
class Node:
    """One value and its place; collections hold Nodes and are never changed.

    Attributes:
        content: A scalar, a tuple of Nodes (list) or a dict of Nodes (mapping).
        place: Beginning of the value.
        key_place: Beginning of its key; the place of the value if it has no key.
    """

    content: "str | int | float | bool | tuple[Node, ...] | Mapping[str, Node] | None"
    place: Place
    key_place: Place


@dataclass(frozen=True, kw_only=True, slots=True)
class Document:
    """A YAML document as plain data, with the place of each part.

    A path is a tuple of keys and list indices; () is the document itself.

    Attributes:
        root: The tree that the other attributes are computed from; a mapping.
        name: The file's name as it appears in messages.
        sources: Texts by name, of which `frame` shows lines: the text of the file, and
            the text of each value set by `assign`.
        folder: Folder of the files that the document names; None means the folder of
            `name`.
        data: Content as nested dict, list, str, int, float, bool and None; not shared
            with another object.
        places: The place of every value, by path.
        key_places: The place of every key of a mapping, by the path of its value.
    """

    root: Node = field(repr=False)
    name: str
    sources: Mapping[str, str] = field(repr=False)
    folder: str | None = None
    data: dict[str, Value] = field(init=False)
    places: Mapping[Path, Place] = field(init=False, repr=False)
    key_places: Mapping[Path, Place] = field(init=False, repr=False)

    @property
    def beside(self) -> FilePath:
        """The folder of the files that the document names."""
        folder = self.folder
        return FilePath(self.name).parent if folder is None else FilePath(folder)

    def __post_init__(self) -> None:
        """Compute data and places from the tree."""
        places: dict[Path, Place] = {}
        key_places: dict[Path, Place] = {}
        data = _flattened(self.root, (), places, key_places)
        object.__setattr__(self, "data", data)
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "key_places", key_places)


def frame(text: str, place: Place) -> str:
    """Return a line of a text with a caret below the place.

    Args:
        text: The source the place refers to, `document.sources[place.name]`.
        place: Place under which the caret is put.

    Returns:
        Two lines, cut around the caret if they are long; "" for a place outside the
        text.
    """
    # Not splitlines, which knows more line breaks than YAML.
    lines = LINE_BREAK.split(text)
    if not 1 <= place.line <= len(lines):
        return ""
    # Of a long line 78 characters are shown, with the caret at the 60th.
    start = max(0, place.column - 60)
    line = lines[place.line - 1][start : start + 78]
    visible = "".join(
        # One column for each character, as the caret counts them.
        char if char.isprintable() else " " if char == "\t" else "?"
        for char in line
    )
    margin = f"{place.line:>5} | "
    caret = " " * (place.column - 1 - start) + "^"
    return f"{margin}{visible}\n{' ' * (len(margin) - 2)}| {caret}"


def _flattened(
    node: Node,
    path: Path,
    places: dict[Path, Place],
    key_places: dict[Path, Place],
) -> Value:
    """Return a node's plain data and note its places."""
    places[path] = node.place
    if isinstance(node.content, tuple):
        return [
            _flattened(child, (*path, index), places, key_places)
            for index, child in enumerate(node.content)
        ]
    if isinstance(node.content, Mapping):
        mapping: dict[str, Value] = {}
        for key, child in node.content.items():
            key_places[*path, key] = child.key_place
            mapping[key] = _flattened(child, (*path, key), places, key_places)
        return mapping
    return node.content


def shown(text: str) -> str:
    """Quote, escape and shorten a text for a message."""
    return repr(text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}...")


def counted(count: int, thing: str) -> str:
    """Return a number with its noun, in the plural if needed.

    Example:
        >>> counted(1, "seed"), counted(3, "seed")
        ('1 seed', '3 seeds')
    """
    return f"{count} {thing}{'' if count == 1 else 's'}"


def meant(name: str, known: Iterable[str], *, otherwise: str) -> str:
    """Return a question about the most similar known name, or another text.

    Args:
        name: Name that is not among `known`.
        known: Names that are allowed.
        otherwise: Text that is returned if no known name is similar.
    """
    near = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {near[0]!r}?" if near else otherwise


def printable(text: str) -> str:
    """Escape all characters that would not print as one line."""
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode("ascii")
        for char in text
    )


def kind_of(node: Node) -> str:
    """Return the content of a node in words for a message; the node is no mapping."""
    content = node.content
    if content is None:
        return "null"
    if isinstance(content, tuple):
        return "a list"
    return shown(content) if isinstance(content, str) else str(content).lower()
