"""Types, units and defaults of a JSON Schema in words."""

import json
import re
from collections.abc import Iterator
from typing import Any

Schema = dict[str, Any]
UNIT = re.compile(r"_((?:m|ft|rad|deg|kg)(?:_s2?)?|s)$")
MOST = 2**60
"""Limits beyond are those of the machine, not of the format."""
LIMITS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
}
NUMBERS = {
    "An expression in the names of this file.": "expression",
    "A number, or an expression in constants.": "number, or expression in constants",
}
"""Types that are numbers or texts, by their description."""
NAMES = {"string": "text", "boolean": "`true` or `false`", "object": "mapping"}


def kind_of(schema: Schema) -> Iterator[str]:
    """Yield the words for a type without parts; nothing for null alone."""
    if "const" in schema:
        yield f"`{_plain(schema['const'])}`"
    elif "enum" in schema:
        yield ", ".join(f"`{_plain(value)}`" for value in schema["enum"])
    elif isinstance(schema.get("type"), list):
        yield _number_or_text(schema.get("description", "")) + _limits(schema)
    elif schema.get("type") not in (None, "null"):
        word = str(schema["type"])
        yield NAMES.get(word, word) + _limits(schema)


def default_of(schema: Schema) -> str:
    """Return the default of a key; empty if there is none to tell of."""
    if schema.get("default", "") == "":
        return ""
    default = schema["default"]
    if isinstance(default, dict) and len(default) > 1:
        return "those of its keys"
    return f"`{_plain(default)}`"


def unit_of(key: str, schema: Schema) -> str:
    """Return the unit that the name of a key ends with."""
    found = UNIT.search(key)
    if found is None or "number" not in json.dumps(schema):
        return ""
    unit = found[1].replace("_s2", "/s²").replace("_s", "/s")
    return f" [{unit}]"


def _number_or_text(description: str) -> str:
    """Return the word for a number that can be text; a key's description says which."""
    is_expression = re.search(r"\bexpression\b", description, re.IGNORECASE)
    return NUMBERS.get(description, "expression" if is_expression else "number")


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _limits(schema: Schema) -> str:
    said = [
        f"{word} {schema[key]}"
        for key, word in LIMITS.items()
        if key in schema and abs(schema[key]) < MOST
    ]
    return f" ({', '.join(said)})" if said else ""
