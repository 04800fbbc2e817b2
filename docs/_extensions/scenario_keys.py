"""The keys of a kind of scenario as Markdown tables, from its JSON Schema.

Each part of a file (a mapping with keys of its own) is described once, at the first key
that holds it; other keys link there.
"""

import re
from collections import deque
from collections.abc import Iterator
from typing import Any

from swarmstart.cases.format.parts import scenario_schema
from swarmstart.docs._extensions.schema_words import default_of, kind_of, unit_of

Schema = dict[str, Any]
NAMED = re.compile(r"mapping \[with `(\w+): (\w+)`\]\((#[\w-]+)\)")
GENERIC = frozenset(
    {
        "A number, or as in pi/18.",
        "A number, or an expression in constants.",
        "An expression in the names of this file.",
    }
)
"""Descriptions of types, which stand in another column."""


def keys_page(kind: str) -> str:
    """Return the sections of a kind: the keys of a file, then those of each part."""
    page = _Page(kind)
    lines = ["## Keys of a file\n", *page.table(page.schema, "")]
    while page.waiting:
        name = page.waiting.popleft()
        lines += page.section(name)
    return "\n".join(lines)


class _Page:
    """Knowledge of one kind while its page is made.

    Attributes:
        kind: The kind of scenario.
        schema: Its JSON Schema.
        places: Key path at which each part is described, by the part's name.
        waiting: Names of parts that are still to be described.
    """

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.schema = scenario_schema(kind)
        self.places: dict[str, str] = {}
        self.waiting: deque[str] = deque()

    def section(self, name: str) -> Iterator[str]:
        """Yield the lines that describe a part."""
        part, path = self.schema["definitions"][name], self.places[name]
        mark = _mark(part)
        shared = [other for other, place in self.places.items() if place == path]
        with_mark = f" with {mark}" if mark and len(shared) > 1 else ""
        yield f"({self.anchor(name)})=\n## `{path}`{with_mark}\n"
        about = str(part.get("description", "")).split("\n\n")[0]
        about = " ".join(about.split())
        yield f"{about[:1].upper()}{about[1:].rstrip('.')}.\n" if about else ""
        yield from self.table(part, path)

    def table(self, part: Schema, path: str) -> Iterator[str]:
        """Yield the lines of the table of a part's keys."""
        yield "| key | type | default | meaning |"
        yield "|---|---|---|---|"
        needed = part.get("required", ())
        for key, schema in part["properties"].items():
            full = f"{path}.{key}" if path else key
            about = " ".join(str(schema.get("description", "")).split())
            cells = (
                f"`{full}`",
                self.words(schema, full) + unit_of(key, schema),
                "required" if key in needed else default_of(schema),
                "" if about in GENERIC else about,
            )
            yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
        yield ""

    def words(self, schema: Schema, path: str) -> str:
        """Return a type in words; note the parts that it names."""
        found = list(dict.fromkeys(self._types(schema, path)))
        named = [mark for one in found if (mark := NAMED.fullmatch(one))]
        if len(named) > 1:  # They differ in one key.
            links = ", ".join(f"[`{mark[2]}`]({mark[3]})" for mark in named)
            found = [one for one in found if not NAMED.fullmatch(one)]
            found.append(f"mapping with `{named[0][1]}:` {links}")
        return " or ".join(found)

    def _types(self, schema: Schema, path: str) -> Iterator[str]:
        choices = [
            one for key in ("anyOf", "oneOf", "allOf") for one in schema.get(key, ())
        ]
        for one in choices:
            yield from self._types(one, path)
        if "$ref" in schema:
            yield self._linked(schema["$ref"].rpartition("/")[2], path)
        if "items" in schema or "prefixItems" in schema:
            yield self._list(schema, path)
        elif "patternProperties" in schema:
            (values,) = schema["patternProperties"].values()
            yield f"names, each with: {self.words(values, path + '.*')}"
        elif not choices and "$ref" not in schema:
            yield from kind_of(schema)

    def _list(self, schema: Schema, path: str) -> str:
        items = schema.get("items")
        least, most = schema.get("minItems"), schema.get("maxItems")
        count = f" of {least}" if least is not None and least == most else ""
        if isinstance(items, dict) and items:
            return f"list{count}, each: {self.words(items, path + '[]')}"
        return f"list{count}"

    def _linked(self, name: str, path: str) -> str:
        """Return a link to a part, which is described at its first place."""
        part = self.schema["definitions"][name]
        if "properties" not in part:
            return self.words(part, path)
        if name not in self.places:
            self.places[name] = path
            self.waiting.append(name)
        mark = _mark(part)
        words = f"with {mark}" if mark else f"keys of `{self.places[name]}`"
        return f"mapping [{words}](#{self.anchor(name)})"

    def anchor(self, name: str) -> str:
        """Return the anchor of a part's section."""
        return f"keys-of-{self.kind}-{name}".lower().replace("_", "-")


def _mark(part: Schema) -> str:
    """Return what tells a part from others at the same key: a fixed or needed key."""
    for key, schema in part["properties"].items():
        if "const" in schema:
            return f"`{key}: {schema['const']}`"
    needed = part.get("required", ())
    return f"`{needed[0]}`" if len(needed) == 1 else ""
