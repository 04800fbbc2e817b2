"""Reader of a user's YAML file: data, with the place of every value.

    text -> events of libyaml -> tree of Nodes -> Document (plain data and places)

The tree is built straight from the event stream, one bounded step at a time, so that no
file can crash the reader, run code or grow in memory. Plain scalars follow the core
schema, and nothing else: null, true/false, decimal integers and floats; all others are
strings (`no`, `1:30`, `1_000`, `0x10`). Not part of this format, and refused: anchors,
aliases, tags, merge keys, keys that are not strings, keys given twice, a second
document, .inf and .nan.

Source: YAML 1.2.2 (2021), section 10.3.2, core schema, without octal and hexadecimal.
"""

import math
import os
import re
import stat
from collections.abc import Mapping

import yaml

from swarmstart.cases.format.document import (
    LINE_BREAK,
    Document,
    Node,
    Place,
    UnreadableFileError,
    YamlError,
    frame,
    kind_of,
    printable,
    shown,
)

MAX_BYTES = 1_000_000
MAX_DEPTH = 32
_TOO_DEEP = f"expected at most {MAX_DEPTH} collections inside each other, found more"
MAX_EVENTS = 50_000
MAX_DIGITS = 30
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml if it is built in
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
_SYNTAX = (  # message of libyaml or PyYAML -> what was expected
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
    # libyaml's scanner reads ahead, and so meets a limit of its own first.
    (r"maximum nesting depth", _TOO_DEEP),
    (r"escape", r"expected a YAML escape after '\': write '...' to keep backslashes"),
)


def read_yaml(path: str | os.PathLike[str]) -> Document:
    """Read a YAML file whose top level is a mapping.

    Args:
        path: Path of a regular file, UTF-8, at most `MAX_BYTES` long (checked before
            reading).

    Returns:
        Its data, with places that name the file as `path` does.

    Raises:
        UnreadableFileError: If it is missing, forbidden, a directory or a device.
        YamlError: If it is too large, or this format does not allow it.
    """
    return parse_yaml(read_bytes(path), name=os.fspath(path))


def read_bytes(path: str | os.PathLike[str], *, most: int = MAX_BYTES) -> bytes:
    """Return the content of a file.

    Args:
        path: Path of a regular file.
        most: Largest size of the file [bytes], checked before reading.

    Raises:
        UnreadableFileError: If it is missing, forbidden, a directory or a device.
        YamlError: If it is too large.
    """
    name = os.fspath(path)
    try:
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            raise UnreadableFileError(name, "found a directory")
        if not stat.S_ISREG(status.st_mode):
            raise UnreadableFileError(name, "found a pipe or a device")
        if status.st_size > most:
            raise _too_large(f"{status.st_size} bytes", name, most)
        with open(path, "rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        reason = f"found: {error.strerror or error}"
        raise UnreadableFileError(name, reason) from error
    except ValueError as error:  # a path with a NUL or a surrogate
        raise UnreadableFileError(name, f"found: {error}") from error
    if len(content) > most:  # The file has grown since its size was read.
        raise _too_large("more", name, most)
    return content


def parse_yaml(text: str | bytes, *, name: str) -> Document:
    """Return the document in a YAML text whose top level is a mapping.

    Args:
        text: The text; bytes must be UTF-8. A byte order mark and CRLF are accepted.
        name: Name of the text in messages, usually a file name.

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
        what = f"{expected} at the top level, found {kind_of(root)}"
        raise YamlError(what, root.place, frame=frame(decoded, root.place))
    return Document(root=root, name=name, sources={name: decoded})


def parse_value(text: str, *, name: str, depth: int) -> tuple[str, Node | None]:
    """Return the value of a text of one line, as after `--set key=`.

    Args:
        text: A scalar, or a list or mapping in brackets.
        name: Name of the text in messages.
        depth: Depth in the document at which the value will stand.

    Returns:
        The text as it was read, and its node; the node is None if there is no value.

    Raises:
        YamlError: If it is not what this format allows.
    """
    decoded = _decoded(text, name)
    return decoded, _Reader(decoded, name=name, depth=depth, inline=True).root()


class _Reader:
    """One pass over the events of a text, with a limit on everything that can grow."""

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
        """Return the document in the stream; None if it has none."""
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
            raise self._error(_TOO_DEEP, place)
        if self._inline and not getattr(event, "flow_style", False):
            what = "expected a scalar, a list in [] or a mapping in {}"
            raise self._error(f"{what}, found {shown(self._text)}", place)
        if isinstance(event, yaml.MappingStartEvent):
            return Node(self._mapping(depth + 1), place, key_place)
        return Node(self._sequence(depth + 1), place, key_place)

    def _mapping(self, depth: int) -> dict[str, Node]:
        children: dict[str, Node] = {}
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            place = self._place(event)
            self._refuse_decimal_comma(event, place, [*children.values()][-1:])
            key = self._key(event, place)
            if key in children:
                first = children[key].key_place
                what = f"expected each key once, found {shown(key)} again"
                raise self._error(f"{what} (first at {first})", place, first)
            children[key] = self._node(self._next(), depth, place)
        return children

    def _refuse_decimal_comma(
        self, event: yaml.Event, place: Place, before: list[Node]
    ) -> None:
        """Refuse "1,5" in braces, which YAML reads as the value 1 and the key 5."""
        if not (event.start_mark and isinstance(event, yaml.ScalarEvent) and before):
            return
        index, whole = event.start_mark.index, before[0].content
        # With a blank behind the comma it is no number of a user.
        if self._text[index - 1] != "," or not re.fullmatch(r"\d+", event.value):
            return
        if isinstance(whole, int) and not isinstance(whole, bool):
            number = f"{whole},{event.value}"
            what = f"expected a number with a point, found {shown(number)}: write"
            raise self._error(f"{what} {whole}.{event.value}", place)

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
            what = f"expected a string as key, found {shown(event.value)}"
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
            raise self._error(f"{what}, found {shown(text)}", place)
        if _NOT_FINITE.fullmatch(text):
            raise self._error(f"expected a finite number, found {shown(text)}", place)
        if not _FLOAT.fullmatch(text):
            return text
        if not math.isfinite(value := float(text)):
            raise self._error(f"expected a finite number, found {shown(text)}", place)
        return value

    def _refuse_indirection(self, event: yaml.Event, place: Place) -> None:
        if isinstance(event, yaml.AliasEvent):
            found = f"the alias {shown(f'*{event.anchor}')}"
        elif tag := getattr(event, "tag", None):
            found = f"the tag {shown(tag)}"
        elif anchor := getattr(event, "anchor", None):
            found = f"the anchor {shown(f'&{anchor}')}"
        else:
            return
        what = f"expected plain data, found {found}: write the value out, or quote it"
        raise self._error(what, place)

    def _syntax_error(self, error: Exception) -> YamlError:
        """Return the parser's message as one line with a place."""
        place = Place(self._name, 1, 1)
        if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
            what = printable(" ".join(str(error).split()))
            return self._error(f"expected YAML, found an error: {what}", place)
        lines = LINE_BREAK.split(self._text.rstrip("\r\n "))
        mark = error.problem_mark
        if mark.line >= len(lines):
            place = Place(self._name, len(lines), len(lines[-1]) + 1)
        else:
            place = Place(self._name, mark.line + 1, mark.column + 1)
        char = lines[place.line - 1][place.column - 1 : place.column]
        what = _explained(str(error.problem), char)
        if error.context and (begin := error.context_mark):
            context = printable(error.context)
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
    """Return what the parser expected, in the words of this module if it has some."""
    found = shown(char) if char else "the end of the line"
    if char == "\t" and "token" in problem:
        problem = "tab"
    for pattern, explanation in _SYNTAX:
        if match := re.search(pattern, problem):
            expected = match.group(match.lastindex or 0)
            return explanation.replace("{char}", found).replace("{match}", expected)
    return f"expected YAML, found an error: {printable(problem)}"


def _decoded(text: str | bytes, name: str) -> str:
    """Return the decoded text without byte order mark; refuse other bytes."""
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
    lines = LINE_BREAK.split(text.removeprefix("\ufeff"))
    return Place(name, len(lines), len(lines[-1]) + 1)


def _too_large(found: str, name: str, most: int = MAX_BYTES) -> YamlError:
    what = f"expected at most {most} bytes, found {found}"
    return YamlError(what, Place(name, 1, 1))
