"""The JSON Schema of the scenario format, for editors.

Editors read draft 7 at most, and pydantic writes 2020-12: so definitions are renamed.
`variants`, overrides of any part of the format, is added.
"""

from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.format.registry import words_of

DIALECT = "http://json-schema.org/draft-07/schema#"


def scenario_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 7) of one kind of scenario.

    Args:
        kind: A key of KINDS.
    """
    model = resolve_name(words_of(kind).kind).scenario
    schema: dict[str, Any] = _draft7(model.model_json_schema(by_alias=True))
    variants = {
        "type": "object",
        "description": "Variants by name: overrides of keys, in which mappings merge "
        "and all else replaces.",
        "additionalProperties": {"type": "object"},
    }
    # A key may be given by the variant instead of the top level, so none is required.
    del schema["required"]
    return {
        "$schema": DIALECT,
        **schema,
        "title": f"swarmstart scenario, kind {kind}",
        "properties": {**schema["properties"], "variants": variants},
    }


def _draft7(node: Any) -> Any:
    """Return a schema in the words of draft 7."""
    if isinstance(node, list):
        return [_draft7(item) for item in node]
    if not isinstance(node, dict):
        return node
    renamed = {}
    for key, value in node.items():
        if key == "$ref":
            renamed[key] = value.replace("#/$defs/", "#/definitions/")
        elif key == "$defs":
            renamed["definitions"] = _draft7(value)
        elif key != "discriminator":
            renamed[key] = _draft7(value)
    return renamed
