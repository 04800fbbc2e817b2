"""A user's YAML file read as data, with the place of every value.

    text -> events of libyaml -> tree of Nodes -> Document (plain data and places)

The tree is built straight from the event stream, one bounded step at a time, so that no
file can crash the reader, run code or grow in memory. Plain scalars follow the core
schema, and nothing else: null, true/false, decimal integers and floats; all others are
strings (`no`, `1:30`, `1_000`, `0x10`). Not part of this format, and refused: anchors,
aliases, tags, merge keys, keys that are not strings, keys given twice, a second
document, .inf and .nan.

Source: YAML 1.2.2 (2021), section 10.3.2, core schema, without octal and hexadecimal.
"""

import difflib
import math
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import yaml

from swarmstart.errors import SwarmstartError

Value: TypeAlias = "str | int | float | bool | list[Value] | dict[str, Value] | None"
Path: TypeAlias = tuple[str | int, ...]

MAX_BYTES = 1_000_000
MAX_DEPTH = 32
MAX_EVENTS = 50_000
MAX_DIGITS = 30
MAX_SHOWN = 40  # characters of a value in a message

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml where it is built in

_CONSTANTS: Mapping[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_NOT_TEXT = re.compile(  # what YAML refuses; 0x85, 2028, 2029: line breaks to few
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]"
)
_LINE_BREAK = re.compile(r"\r\n|\r|\n")

_SYNTAX = (  # what libyaml or PyYAML says -> what was expected
    (r"\btab\b|'\\t'", "expected spaces as indentation, found a tab"),
    (
        r"mapping values are not allowed",
        "expected no further ':' here: check the indentation above, or quote text that"
        " holds ': '",
    ),
    (r"could not find expected ':'", "expected ':' and a value after this key"),
    (r"start any token", "expected a value, found {char}: quote text that starts so"),
    (
        r"find expected key|<block end>|'-' indicator|<document start>",
        "expected the next entry: check the indentation and the quotes",
    ),
    (
        r"unexpected end of stream",
        "expected a closing quote, found the end of the text",
    ),
    (r"expected ',' or '(.)'", "expected ',' or '{match}'"),
    (r"node content", "expected a value, found {char}"),
    (r"escape", r"expected a YAML escape after '\': write '...' to keep backslashes"),
)


@dataclass(frozen=True, slots=True, order=True)
class Place:
    """Where something stands in a text: "file:line:column", both from 1."""

    name: str
    line: int
    column: int

    def __str__(self) -> str:
        """Join with colons; characters that cannot be printed are escaped."""
        return f"{_printable(self.name)}:{self.line}:{self.column}"


class YamlError(SwarmstartError):
    """The text can be read, but is not what this format allows.

    Attributes:
        what: What was expected and what was found, without the place.
        places: Where, the most important first; a key given twice has two.
        frame: The offending line with a caret below, "" when there is none.
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
    """A file is missing, forbidden, or no file to read from.

    Attributes:
        path: The path as given.
        reason: What was found instead.
    """

    def __init__(self, path: str, reason: str) -> None:
        """Keep the parts."""
        super().__init__(path, reason)
        self.path = path
        self.reason = reason

    def __str__(self) -> str:
        """Say which file and why."""
        return f"{_printable(self.path)}: expected a readable file, {self.reason}"


@dataclass(frozen=True, slots=True)
class Node:
    """One value and where it stands; collections hold Nodes and are never changed.

    Attributes:
        content: A scalar, a tuple of Nodes (list) or a dict of Nodes (mapping).
        place: Where the value begins.
        key_place: Where its key begins; its own place where it has no key.
    """

    content: "str | int | float | bool | tuple[Node, ...] | Mapping[str, Node] | None"
    place: Place
    key_place: Place


@dataclass(frozen=True, kw_only=True, slots=True)
class Document:
    """A YAML document as plain data, and where each part of it was written.

    A path is a tuple of keys and list indices; () is the document itself.

    Attributes:
        root: The tree that the other attributes are computed from; a mapping.
        name: The file's name as it appears in messages.
        sources: Text by name, for `frame`: the file's, and one for each `assign`.
        data: Nested dict, list, str, int, float, bool and None; this object's own.
        places: The place of every value, by path.
        key_places: The place of every key of a mapping, by the path of its value.
    """

    root: Node = field(repr=False)
    name: str
    sources: Mapping[str, str] = field(repr=False)
    data: dict[str, Value] = field(init=False)
    places: Mapping[Path, Place] = field(init=False, repr=False)
    key_places: Mapping[Path, Place] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Compute data and places from the tree."""
        places: dict[Path, Place] = {}
        key_places: dict[Path, Place] = {}
        data = _flattened(self.root, (), places, key_places)
        object.__setattr__(self, "data", data)
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "key_places", key_places)


def read_yaml(path: str | os.PathLike[str]) -> Document:
    """Read a YAML file whose top level is a mapping.

    Args:
        path: A regular file, UTF-8, at most `MAX_BYTES` long (checked before reading).

    Returns:
        Its data, with places that name the file as `path` does.

    Raises:
        UnreadableFileError: If it is missing, forbidden, a directory or a device.
        YamlError: If it is too large or not what this format allows.
    """
    name = os.fspath(path)
    try:
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            raise UnreadableFileError(name, "found a directory")
        if not stat.S_ISREG(status.st_mode):
            raise UnreadableFileError(name, "found a pipe or a device")
        if status.st_size > MAX_BYTES:
            raise _too_large(f"{status.st_size} bytes", name)
        with open(path, "rb") as file:
            text = file.read(MAX_BYTES + 1)
    except OSError as error:
        reason = f"found: {error.strerror or error}"
        raise UnreadableFileError(name, reason) from error
    except ValueError as error:  # a path with a NUL or a surrogate
        raise UnreadableFileError(name, f"found: {error}") from error
    return parse_yaml(text, name=name)


def parse_yaml(text: str | bytes, *, name: str) -> Document:
    """Parse a YAML text whose top level is a mapping.

    Args:
        text: UTF-8 when bytes; a byte order mark and CRLF are accepted.
        name: What messages call the text, usually a file name.

    Returns:
        Its data and places.

    Raises:
        YamlError: If it is not what this format allows.
    """
    decoded = _decoded(text, name)
    root = _Reader(decoded, name=name).root()
    expected = "expected a mapping of keys to values"
    if root is None:
        found = "nothing but comments" if decoded.strip() else "an empty file"
        raise YamlError(f"{expected}, found {found}", Place(name, 1, 1))
    if not isinstance(root.content, dict):
        what = f"{expected} at the top level, found {_kind(root)}"
        raise YamlError(what, root.place, frame=frame(decoded, root.place))
    return Document(root=root, name=name, sources={name: decoded})


def frame(text: str, place: Place) -> str:
    """Show a line of a text with a caret below the place.

    Args:
        text: The source the place refers to, `document.sources[place.name]`.
        place: Where to put the caret.

    Returns:
        Two lines; long ones are cut around the caret. "" for a place outside the text.
    """
    lines = _LINE_BREAK.split(text)
    if not 1 <= place.line <= len(lines):
        return ""
    start = max(0, place.column - 60)
    line = lines[place.line - 1][start : start + 78]
    visible = "".join(
        char if char.isprintable() else " " if char == "\t" else "?" for char in line
    )
    margin = f"{place.line:>5} | "
    caret = " " * (place.column - 1 - start) + "^"
    return f"{margin}{visible}\n{' ' * (len(margin) - 2)}| {caret}"


def overlay(document: Document, path: Path) -> Document:
    """Merge the mapping at a path over the top level of the document.

    Mappings merge key by key; everything else, lists and null too, replaces what was
    there. Keys keep their order and new ones follow. The places of what was replaced
    point at the override.

    Args:
        document: Left as it is.
        path: Where the override stands, such as ("variants", "literal"); it stays.

    Returns:
        The merged document.

    Raises:
        YamlError: If there is no mapping at the path, or if it overrides the top-level
            key it stands under.
    """
    node = document.root
    for depth, part in enumerate(path):
        node = _child(document, node, path[: depth + 1], part)
    if not isinstance(node.content, dict):
        what = f"expected a mapping at {_dotted(path)}, found {_kind(node)}"
        raise _error(document, what, node.place)
    if path and path[0] in node.content:
        what = f"expected other keys, found {path[0]!r}: it cannot override itself"
        raise _error(document, what, node.content[str(path[0])].key_place)
    return replace(document, root=_overlaid(document.root, node))


def split_assignment(text: str, *, name: str = "--set") -> tuple[str, str]:
    """Split "key.path=value" at its first "=", for `assign`.

    Args:
        text: What the user typed.
        name: What messages call it.

    Returns:
        The dotted key and the text of the value.

    Raises:
        YamlError: If there is no "=" or nothing before it.
    """
    dotted_key, equals, value = text.partition("=")
    if not equals or not dotted_key.strip():
        what = f"expected key.path=value, found {_shown(text)}"
        raise YamlError(what, Place(name, 1, 1))
    return dotted_key.strip(), value


def assign(
    document: Document, dotted_key: str, text_value: str, *, name: str = "--set"
) -> Document:
    """Set one value by its dotted path; missing mappings on the way are created.

    Args:
        document: Left as it is.
        dotted_key: Such as "controller.search.size" or "vehicles.0.start.x_m"; in a
            list, a number from 0 stands for an item that exists.
        text_value: A YAML scalar, or a list or mapping in brackets; "" is null.
        name: What messages call the origin, before the key.

    Returns:
        The changed document; places of the value read "--set controller.search.size".

    Raises:
        YamlError: If the key leads into a scalar or outside a list, or the value is not
            what this format allows.
    """
    origin = f"{name} {dotted_key}"
    place = Place(origin, 1, 1)
    keys = tuple(dotted_key.split("."))
    if "" in keys or len(keys) > MAX_DEPTH:
        what = f"expected 1 to {MAX_DEPTH} names joined by single dots as key"
        raise YamlError(f"{what}, found {_shown(dotted_key)}", Place(name, 1, 1))
    text = _decoded(text_value, origin)
    value = _Reader(text, name=origin, depth=len(keys), inline=True).root()
    if value is None:
        if text.strip():
            what = f"expected a value, found {_shown(text)}: quote text that starts so"
            raise YamlError(what, place, frame=frame(text, place))
        value = Node(None, place, place)
    sources = {**document.sources, origin: text}
    root = _assigned(document.root, keys, replace(value, key_place=place), path=())
    return replace(document, root=root, sources=sources)


class _Reader:
    """One pass over the events of a text; a limit on each thing that can grow."""

    def __init__(
        self, text: str, *, name: str, depth: int = 0, inline: bool = False
    ) -> None:
        self._text = text
        self._name = name
        self._depth = depth  # of collections around the text
        self._inline = inline  # no block collections
        self._events = yaml.parse(text, Loader=_LOADER)
        self._count = 0

    def root(self) -> Node | None:
        """Read the stream; None when it holds no document."""
        self._next()
        if isinstance(self._next(), yaml.StreamEndEvent):
            return None
        node = self._node(self._next(), self._depth)
        self._next()
        event = self._next()
        if not isinstance(event, yaml.StreamEndEvent):
            what = "expected one document, found a second one"
            raise self._error(what, self._place(event))
        return node

    def _next(self) -> yaml.Event:
        try:
            event = next(self._events)
        except (yaml.YAMLError, ArithmeticError, ValueError) as error:
            raise self._syntax_error(error) from error
        self._count += 1
        if self._count > MAX_EVENTS:
            what = f"expected at most {MAX_EVENTS} keys, values and ends, found more"
            raise self._error(what, self._place(event))
        return event

    def _node(
        self, event: yaml.Event, depth: int, key_place: Place | None = None
    ) -> Node:
        place = self._place(event)
        key_place = key_place or place
        self._refuse_indirection(event, place)
        if isinstance(event, yaml.ScalarEvent):
            return Node(self._scalar(event, place), place, key_place)
        if depth >= MAX_DEPTH:
            what = f"expected at most {MAX_DEPTH} collections inside each other"
            raise self._error(f"{what}, found more", place)
        if self._inline and not getattr(event, "flow_style", False):
            what = "expected a scalar, a list in [] or a mapping in {}"
            raise self._error(f"{what}, found {_shown(self._text)}", place)
        if isinstance(event, yaml.MappingStartEvent):
            return Node(self._mapping(depth + 1), place, key_place)
        return Node(self._sequence(depth + 1), place, key_place)

    def _mapping(self, depth: int) -> dict[str, Node]:
        children: dict[str, Node] = {}
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            place = self._place(event)
            key = self._key(event, place)
            if key in children:
                first = children[key].key_place
                what = f"expected each key once, found {_shown(key)} again"
                raise self._error(f"{what} (first at {first})", place, first)
            children[key] = self._node(self._next(), depth, place)
        return children

    def _sequence(self, depth: int) -> tuple[Node, ...]:
        children: list[Node] = []
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            children.append(self._node(event, depth))
        return tuple(children)

    def _key(self, event: yaml.Event, place: Place) -> str:
        self._refuse_indirection(event, place)
        if not isinstance(event, yaml.ScalarEvent):
            what = "expected a string as key, found a list or a mapping"
            raise self._error(what, place)
        if event.implicit[0] and event.value == "<<":
            raise self._error("expected a key, found '<<': merge is refused", place)
        key = self._scalar(event, place)
        if not isinstance(key, str):
            what = f"expected a string as key, found {_shown(event.value)}"
            raise self._error(f"{what}: put it in quotes", place)
        return key

    def _scalar(
        self, event: yaml.ScalarEvent, place: Place
    ) -> str | int | float | bool | None:
        text = event.value
        if not event.implicit[0]:  # in quotes, or a block of text
            return text
        if text in _CONSTANTS:
            return _CONSTANTS[text]
        if _INT.fullmatch(text):
            if len(text) <= MAX_DIGITS:
                return int(text)
            what = f"expected an integer of at most {MAX_DIGITS} characters"
            raise self._error(f"{what}, found {_shown(text)}", place)
        if _NOT_FINITE.fullmatch(text):
            raise self._error(f"expected a finite number, found {_shown(text)}", place)
        if not _FLOAT.fullmatch(text):
            return text
        if not math.isfinite(value := float(text)):
            raise self._error(f"expected a finite number, found {_shown(text)}", place)
        return value

    def _refuse_indirection(self, event: yaml.Event, place: Place) -> None:
        if isinstance(event, yaml.AliasEvent):
            found = f"the alias {_shown(f'*{event.anchor}')}"
        elif tag := getattr(event, "tag", None):
            found = f"the tag {_shown(tag)}"
        elif anchor := getattr(event, "anchor", None):
            found = f"the anchor {_shown(f'&{anchor}')}"
        else:
            return
        what = f"expected plain data, found {found}: write the value out, or quote it"
        raise self._error(what, place)

    def _syntax_error(self, error: Exception) -> YamlError:
        """Turn what the parser says into one line with a place."""
        place = Place(self._name, 1, 1)
        if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
            what = _printable(" ".join(str(error).split()))
            return self._error(f"expected YAML, found an error: {what}", place)
        lines = _LINE_BREAK.split(self._text.rstrip("\r\n "))
        mark = error.problem_mark
        if mark.line >= len(lines):
            place = Place(self._name, len(lines), len(lines[-1]) + 1)
        else:
            place = Place(self._name, mark.line + 1, mark.column + 1)
        char = lines[place.line - 1][place.column - 1 : place.column]
        what = _explained(str(error.problem), char)
        if error.context and (begin := error.context_mark):
            context = _printable(error.context)
            if (begin.line, begin.column) != (mark.line, mark.column):
                what += f" ({context} from {begin.line + 1}:{begin.column + 1})"
        return self._error(what, place)

    def _error(self, what: str, *places: Place) -> YamlError:
        return YamlError(what, *places, frame=frame(self._text, places[0]))

    def _place(self, event: yaml.Event) -> Place:
        mark = event.start_mark
        line, column = (mark.line, mark.column) if mark else (0, 0)
        return Place(self._name, line + 1, column + 1)


def _explained(problem: str, char: str) -> str:
    """Say what the parser expected, in this module's words where it has any."""
    found = _shown(char) if char else "the end of the line"
    if char == "\t" and "token" in problem:
        problem = "tab"
    for pattern, explanation in _SYNTAX:
        if match := re.search(pattern, problem):
            expected = match.group(match.lastindex or 0)
            return explanation.replace("{char}", found).replace("{match}", expected)
    return f"expected YAML, found an error: {_printable(problem)}"


def _decoded(text: str | bytes, name: str) -> str:
    """Decode, drop a byte order mark, and refuse what is no text."""
    if len(text) > MAX_BYTES:
        raise _too_large("more", name)
    if isinstance(text, bytes):
        if text.startswith((b"\xff\xfe", b"\xfe\xff")):
            what = "expected UTF-8 text, found a UTF-16 or UTF-32 byte order mark"
            raise YamlError(what, Place(name, 1, 1))
        try:
            decoded = text.decode("utf-8")
        except UnicodeDecodeError as error:
            place = _place_after(text[: error.start].decode("utf-8"), name)
            what = f"expected UTF-8 text, found the byte 0x{text[error.start]:02x}"
            raise YamlError(what, place) from error
    else:
        decoded = text
    decoded = decoded.removeprefix("\ufeff")
    if match := _NOT_TEXT.search(decoded):
        place = _place_after(decoded[: match.start()], name)
        what = f"expected text, found the character U+{ord(match.group()):04X}"
        raise YamlError(what, place, frame=frame(decoded, place))
    return decoded


def _place_after(text: str, name: str) -> Place:
    lines = _LINE_BREAK.split(text.removeprefix("\ufeff"))
    return Place(name, len(lines), len(lines[-1]) + 1)


def _too_large(found: str, name: str) -> YamlError:
    what = f"expected at most {MAX_BYTES} bytes, found {found}"
    return YamlError(what, Place(name, 1, 1))


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


def _child(document: Document, node: Node, path: Path, part: str | int) -> Node:
    """Return the part of a collection; path is the part's, for the message."""
    content = node.content
    if isinstance(content, Mapping) and isinstance(part, str) and part in content:
        return content[part]
    if isinstance(content, tuple) and isinstance(part, int):
        if 0 <= part < len(content):
            return content[part]
    what = f"expected a mapping at {_dotted(path)}, found nothing there"
    if isinstance(content, Mapping):
        close = difflib.get_close_matches(str(part), content, n=1)
        what += f": did you mean {close[0]!r}?" if close else ""
    raise _error(document, what, node.place)


def _overlaid(base: Node, override: Node) -> Node:
    """Merge mappings key by key; anything else is replaced."""
    if not isinstance(base.content, dict) or not isinstance(override.content, dict):
        return override
    children: dict[str, Node] = dict(base.content)
    for key, child in override.content.items():
        known = children.get(key)
        children[key] = child if known is None else _overlaid(known, child)
    return replace(base, content=children)


def _assigned(
    node: Node | None, keys: tuple[str, ...], value: Node, *, path: tuple[str, ...]
) -> Node:
    """Return the node with the value set at keys; path is where the node stands."""
    if not keys:
        return value
    key, rest, inner = keys[0], keys[1:], (*path, keys[0])
    if node is None or node.content is None:
        node = Node({}, value.key_place, node.key_place if node else value.key_place)
    if isinstance(node.content, tuple):
        items = list(node.content)
        index = int(key) if re.fullmatch(r"[0-9]{1,9}", key) else len(items)
        if index >= len(items):
            what = f"expected one of the {len(items)} items, from 0, of {_dotted(path)}"
            what = f"{what} ({node.place}), found {_shown(key)}"
            raise YamlError(what, value.key_place)
        items[index] = _assigned(items[index], rest, value, path=inner)
        return replace(node, content=tuple(items))
    if not isinstance(node.content, Mapping):
        what = f"expected a mapping or a list at {_dotted(path)} ({node.place})"
        raise YamlError(f"{what}, found {_kind(node)}", value.key_place)
    child = _assigned(node.content.get(key), rest, value, path=inner)
    return replace(node, content={**node.content, key: child})


def _error(document: Document, what: str, place: Place) -> YamlError:
    text = document.sources.get(place.name, "")
    return YamlError(what, place, frame=frame(text, place))


def _kind(node: Node) -> str:
    """Name a node that is no mapping as a user would."""
    content = node.content
    if content is None:
        return "null"
    if isinstance(content, tuple):
        return "a list"
    return _shown(content) if isinstance(content, str) else str(content).lower()


def _dotted(path: Path) -> str:
    return _shown(".".join(map(str, path)))


def _shown(text: str) -> str:
    """Quote, escape and shorten a text for a message."""
    return repr(text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}...")


def _printable(text: str) -> str:
    """Escape what would not print as one line."""
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode("ascii")
        for char in text
    )
