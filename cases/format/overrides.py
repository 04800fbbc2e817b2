"""Changes of a scenario: a variant laid over it, a value set from the command line.

Documents are never changed; each function returns a new one, whose places point at what
replaced a value.
"""

import difflib
import re
from collections.abc import Mapping
from dataclasses import replace

from swarmstart.cases.format.document import (
    Document,
    Node,
    Path,
    Place,
    YamlError,
    frame,
    kind_of,
    shown,
)
from swarmstart.cases.format.yaml_reader import MAX_DEPTH, parse_value


def overlay(document: Document, path: Path) -> Document:
    """Merge the mapping at a path over the top level of the document.

    Mappings merge key by key; everything else, lists and null too, replaces what was
    there. Keys keep their order and new ones follow. The places of what was replaced
    point at the override.

    Args:
        document: The document; it is not changed.
        path: Path of the override in the document, such as ("variants", "literal"); the
            override is not removed from there.

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
        what = f"expected a mapping at {_dotted(path)}, found {kind_of(node)}"
        raise _error(document, what, node.place)
    if path and path[0] in node.content:
        what = f"expected other keys, found {path[0]!r}: it cannot override itself"
        raise _error(document, what, node.content[str(path[0])].key_place)
    return replace(document, root=_overlaid(document.root, node))


def split_assignment(text: str) -> tuple[str, str]:
    """Split "key.path=value" at its first "=", for `assign`.

    Returns:
        The dotted key and the text of the value.

    Raises:
        YamlError: If there is no "=" or nothing before it.
    """
    # The first "=": further ones belong to the value.
    dotted_key, equals, value = text.partition("=")
    if not equals or not dotted_key.strip():
        what = f"expected key.path=value, found {shown(text)}"
        raise YamlError(what, Place("--set", 1, 1))
    return dotted_key.strip(), value


def assign(
    document: Document, dotted_key: str, text_value: str, *, name: str = "--set"
) -> Document:
    """Set one value by its dotted path; missing mappings on the way are created.

    Args:
        document: The document; it is not changed.
        dotted_key: Keys joined by dots, such as "controller.search.size" or
            "vehicles.0.start.x_m"; a number from 0 names an item of a list, which must
            exist.
        text_value: A YAML scalar, or a list or mapping in brackets; "" is null.
        name: Name of the origin in messages, before the key.

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
        raise YamlError(f"{what}, found {shown(dotted_key)}", Place(name, 1, 1))
    text, value = parse_value(text_value, name=origin, depth=len(keys))
    if value is None:
        if text.strip():
            what = f"expected a value, found {shown(text)}: quote text that starts so"
            raise YamlError(what, place, frame=frame(text, place))
        # "--set key=" sets null.
        value = Node(None, place, place)
    sources = {**document.sources, origin: text}
    root = _assigned(document.root, keys, replace(value, key_place=place), path=())
    return replace(document, root=root, sources=sources)


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
    """Return mappings merged key by key; anything else is replaced."""
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
    # A key that is missing or null becomes a mapping.
    if node is None or node.content is None:
        node = Node({}, value.key_place, node.key_place if node else value.key_place)
    if isinstance(node.content, tuple):
        items = list(node.content)
        # Anything else, also a number with more digits, is outside of the list.
        index = int(key) if re.fullmatch(r"[0-9]{1,9}", key) else len(items)
        if index >= len(items):
            what = f"expected one of the {len(items)} items, from 0, of {_dotted(path)}"
            what = f"{what} ({node.place}), found {shown(key)}"
            raise YamlError(what, value.key_place)
        items[index] = _assigned(items[index], rest, value, path=inner)
        return replace(node, content=tuple(items))
    if not isinstance(node.content, Mapping):
        what = f"expected a mapping or a list at {_dotted(path)} ({node.place})"
        raise YamlError(f"{what}, found {kind_of(node)}", value.key_place)
    child = _assigned(node.content.get(key), rest, value, path=inner)
    return replace(node, content={**node.content, key: child})


def _error(document: Document, what: str, place: Place) -> YamlError:
    text = document.sources.get(place.name, "")
    return YamlError(what, place, frame=frame(text, place))


def _dotted(path: Path) -> str:
    return shown(".".join(map(str, path)))
