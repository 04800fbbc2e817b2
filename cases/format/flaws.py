"""Errors of a scenario, each with its place, in own words in place of pydantic's.

    document -> pydantic -> its errors by their place -> Flaw (file:line:column, frame)

Errors of pydantic that belong together become one: the errors of all forms that a value
can have, and an unknown key with the missing key for which it may be a misspelling. All
other errors are reported at once. An error within an expression has a column of its
own.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from swarmstart.cases.format.document import (
    Document,
    Place,
    frame,
    meant,
)
from swarmstart.cases.format.expressions import ExpressionError
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.errors import SwarmstartError

if TYPE_CHECKING:
    import pydantic
    import pydantic_core


M = TypeVar("M", bound="pydantic.BaseModel")
_SHOWN = 40  # characters of a value in a message
RENAMED = {
    "prediction.dt_s": "prediction.horizon_s (dt_s times intervals)",
    "integrator": "prediction.integrator",
    "search.bounds": "search.bound_handling",
}
"""Keys of earlier versions -> their replacements."""
_OF_EXPRESSION = {"at_least": "lower", "at_most": "upper"}
"""Limits of a distance -> those of an expression."""
_COSTS = ("stage_cost", "terminal_cost")
_HORIZON, _GRID = ("prediction.horizon_s",), ("prediction.intervals",)
OTHER_WORDS = {
    **dict.fromkeys(("constraints", "constraint"), ("path", "terminal")),
    **dict.fromkeys(("path_constraints", "inequalities", "g"), ("path",)),
    **dict.fromkeys(
        ("terminal_constraints", "end", "final", "goal", "target"), ("terminal",)
    ),
    **dict.fromkeys(
        ("ode", "dynamics", "f", "rhs", "xdot", "derivative"), ("states.rate",)
    ),
    **dict.fromkeys(("objective", "cost", "j", "minimize", "minimise"), _COSTS),
    **dict.fromkeys(("lagrange", "running_cost", "integral"), _COSTS[:1]),
    **dict.fromkeys(("mayer", "final_cost", "end_cost"), _COSTS[1:]),
    **dict.fromkeys(("horizon", "t", "tf", "t_f", "duration", "end_time"), _HORIZON),
    **dict.fromkeys(("n", "nodes", "num_intervals"), _GRID),
    **dict.fromkeys(("dt", "ts", "time_step"), (*_HORIZON, *_GRID)),
    **dict.fromkeys(("x0", "x_0", "initial", "initial_state"), ("states.start",)),
    **dict.fromkeys(("u", "input", "inputs"), ("controls",)),
    **dict.fromkeys(("lb", "lower", "min"), ("lower", "bounds")),
    **dict.fromkeys(("ub", "upper", "max"), ("upper", "bounds")),
    **dict.fromkeys(("limits", "range"), ("bounds",)),
    **dict.fromkeys(("solver", "optimizer", "algorithm"), ("search", "polish")),
}
"""Words of other tools, in small letters -> full names of keys that mean the same."""
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
_EXPECTED = {  # pydantic's type of an error -> what was expected, with its context
    "int_type": "an integer",
    "int_from_float": "an integer",
    "float_type": "a number, or an expression such as pi/18",
    "expression_type": "a number, or an expression such as 2*x",
    "measure_type": "an expression such as max(x)",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "text: put it in quotes",
    "string_pattern_mismatch": "text that matches {pattern}",
    "list_type": "a list",
    "mapping_type": "a mapping",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "literal_error": "{expected}",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "a list of at least {min_length} entries",
    "too_long": "a list of at most {max_length} entries",
}


@dataclass(frozen=True, slots=True)
class Flaw:
    """An error in a scenario.

    Attributes:
        place: Place of the error.
        what: Description of what was expected and what was found.
        frame: The line with a caret; empty if there is no line.
    """

    place: Place
    what: str
    frame: str = ""

    def __str__(self) -> str:
        """Put the place before the message."""
        return f"{self.place}: {self.what}"


class InvalidScenarioError(SwarmstartError, ValueError):
    """A scenario can be read but not run.

    Attributes:
        flaws: All errors, in the order of the file.
    """

    def __init__(self, flaws: Sequence[Flaw]) -> None:
        """Keep the flaws, sorted by their places."""
        self.flaws = tuple(sorted(flaws, key=lambda flaw: flaw.place))
        super().__init__(self.flaws)

    def __str__(self) -> str:
        """Return all errors, a line each."""
        return "\n".join(map(str, self.flaws))


def checked(document: Document, model: type[M]) -> M:
    """Return a document validated by a pydantic model.

    Raises:
        InvalidScenarioError: If it does not fit, with all errors.
    """
    import pydantic

    try:
        return model.model_validate(document.data, context={"folder": document.beside})
    except pydantic.ValidationError as error:
        by_path = _by_path(document, error)
        # An old name of a key is reported once, and not also the missing new key.
        old = RENAMED.keys() & map(_dotted, by_path)
        new = {RENAMED[key].partition(" ")[0] for key in old}
        misspelt = _misspelt(document, by_path, model)
        flaws = [
            _described(document, path, together, model)
            for path, together in by_path.items()
            if _dotted(path) not in new and path not in misspelt
        ]
        raise InvalidScenarioError(flaws) from error


def located_flaw(
    document: Document, path: tuple[str | int, ...], what: str | SwarmstartError
) -> Flaw:
    """Return an error that a check of several parts has found, with its place.

    For an error in an expression, the place includes the column in the expression.
    """
    if isinstance(what, str):
        return flaw_at(document, path, what)
    return _refused(document, path, what)


def flaw_at(
    document: Document,
    path: Sequence[str | int],
    what: str,
    *,
    of_key: bool = False,
) -> Flaw:
    """Return an error at a path, or at the longest part of the path that exists."""
    places = document.key_places if of_key else document.places
    at = tuple(path)
    while at not in places and at:
        at, places = at[:-1], document.places
    place = places[at]
    # The text of an option is its value alone: it has no key to point at.
    if of_key and place.name.startswith("--"):
        return Flaw(place, what)
    return Flaw(place, what, frame(document.sources.get(place.name, ""), place))


def shown_value(value: object) -> str:
    """Return a value as YAML has it, shortened."""
    if isinstance(value, str):
        text = repr(value)
    else:
        text = json.dumps(value, ensure_ascii=False, default=repr)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def _by_path(
    document: Document, error: pydantic.ValidationError
) -> dict[tuple[str | int, ...], list[pydantic_core.ErrorDetails]]:
    """Return pydantic's errors by their place in the data.

    If a value can have one of several forms, pydantic reports an error for each form.
    These belong together, and the form that fits best is the one with the deepest
    error.
    """
    grouped: dict[tuple[str | int, ...], list[pydantic_core.ErrorDetails]] = {}
    for details in error.errors(include_url=False):
        grouped.setdefault(_path_in(document.data, details), []).append(details)
    # All paths on the way to an error.
    inner = {path[:depth] for path in grouped for depth in range(len(path))}
    return {path: group for path, group in grouped.items() if path not in inner}


def _misspelt(
    document: Document,
    by_path: Mapping[tuple[str | int, ...], Sequence[pydantic_core.ErrorDetails]],
    model: type[Any],
) -> set[tuple[str | int, ...]]:
    """Return the missing keys that the message about an unknown key beside suggests."""
    missing = {p for p, group in by_path.items() if group[0]["type"] == "missing"}
    suggested = set()
    for path, group in by_path.items():
        if missing and group[0]["type"] == "extra_forbidden":
            known = _known_keys(model, document.data, path[:-1])
            near = difflib.get_close_matches(str(path[-1]), known, n=1)
            near = _ours(path, known, ()) or near
            suggested |= {(*path[:-1], key.strip("'")) for key in near}
    return missing & suggested


def _ours(
    path: Sequence[str | int], known: Sequence[str], top: Sequence[str]
) -> list[str]:
    """Return the keys, in quotes, for a key that has another name in other tools.

    Args:
        path: The path of the key.
        known: Keys that are known beside it.
        top: Keys of the whole document, for keys that belong elsewhere.
    """
    found = []
    for ours in OTHER_WORDS.get(str(path[-1]).lower(), ()):
        part, _, key = ours.rpartition(".")
        if key in known:
            found.append(f"{key!r}")
        elif part in top:
            found.append(f"{key!r} of {part!r}")
        elif not part and key in top:
            found.append(f"{key!r} at the top of the file")
    return found


def _described(
    document: Document,
    path: tuple[str | int, ...],
    group: Sequence[pydantic_core.ErrorDetails],
    model: type[Any],
) -> Flaw:
    """Return pydantic's errors at one place in the words of this project."""
    # An error of this project says more than those of the other forms.
    details = next((d for d in group if d["type"] == "value_error"), group[0])
    kind, context = details["type"], details.get("ctx", {})
    if kind == "extra_forbidden":
        what = _unknown_key(document, path, model)
        return flaw_at(document, path, what, of_key=True)
    if kind == "missing":
        return flaw_at(document, path[:-1], f"expected the key {path[-1]!r}")
    if kind == "value_error":
        return _refused(document, path, context["error"])
    if kind.startswith("union_tag"):
        return _of_no_form(document, path, details)
    dotted = _dotted(path) or "the scenario"
    expected = " or ".join(dict.fromkeys(map(_expected, group)))
    found = shown_value(details["input"])
    what = f"expected {dotted} to be {expected}; found {found}"
    if kind == "too_long":
        what += _with_point(document, path)
    return flaw_at(document, path, what)


def _with_point(document: Document, path: tuple[str | int, ...]) -> str:
    """Return how to write the first decimal comma of a list; empty without one."""
    place = document.places[path]
    lines = document.sources.get(place.name, "").splitlines()
    text = lines[place.line - 1][place.column - 1 :] if lines else ""
    comma = _DECIMAL_COMMA.search(text.partition("]")[0])
    if comma is None:
        return ""
    number = comma.group()
    return f"; if {number} is one number, write {number.replace(',', '.')}"


def _at(data: Any, path: Sequence[str | int]) -> Any:
    """Return the part of plain data at a path."""
    for part in path:
        data = data[part]
    return data


def _unknown_key(
    document: Document, path: tuple[str | int, ...], model: type[Any]
) -> str:
    """Return the message for a key that is not known, with the one to write."""
    key = str(path[-1])
    if new := RENAMED.get(_dotted(path)):
        return f"expected {new}, found {key}"
    known = _known_keys(model, document.data, path[:-1])
    hint = meant(key, known, otherwise=f"known: {', '.join(known)}")
    if ours := _ours(path, known, _known_keys(model, document.data, ())):
        hint = f"did you mean {' or '.join(ours)}?"
    if key in known:  # Another form of this part takes it.
        hint = "it goes with other keys than those that are given"
        if "expression" in _at(document.data, path[:-1]) and key in _OF_EXPRESSION:
            hint = f"of an expression write {_OF_EXPRESSION[key]}"
    return f"expected a known key, found {shown_value(path[-1])}; {hint}"


def _of_no_form(
    document: Document,
    path: tuple[str | int, ...],
    details: pydantic_core.ErrorDetails,
) -> Flaw:
    """Return the error of a value that has none of the forms it can have."""
    context = details.get("ctx", {})
    # As `chosen` of the values of a problem names the forms.
    keys = re.findall(r"'of (\w+)'", context.get("expected_tags", ""))
    if keys:
        what = " or ".join(map(repr, keys))
        found = shown_value(details["input"])
        what = f"expected {_dotted(path)} to be a mapping with the key {what}"
        return flaw_at(document, path, f"{what}; found {found}")
    key = str(context.get("discriminator", "")).strip("'")
    known = re.findall(r"'([^']+)'", context.get("expected_tags", ""))
    if key in ("", "name"):
        key, known = "name", [*SEARCHES]
    found = shown_value(context["tag"]) if "tag" in context else "none"
    what = f"expected {key} to be one of {', '.join(known)}; found {found}"
    return flaw_at(document, (*path, key), what)


def _expected(details: pydantic_core.ErrorDetails) -> str:
    """Return what one of pydantic's errors expected."""
    words = _EXPECTED.get(details["type"])
    if words is None:  # A type of error that the models here do not cause.
        return details["msg"].removeprefix("Input should be ")
    return words.format(**details.get("ctx", {}))


def _refused(document: Document, path: tuple[str | int, ...], error: Exception) -> Flaw:
    """Return the error of one of this project's checks, at the place of the value."""
    from swarmstart.heuristics import InvalidSettingsError

    cause = error.__cause__
    if isinstance(cause, InvalidSettingsError):
        path = (*path, cause.name)
        found = shown_value(cause.value)
        allowed = cause.allowed.replace("None", "null")
        what = f"expected {_dotted(path)} to be {allowed}; found {found}"
        return flaw_at(document, path, what)
    flaw = flaw_at(document, path, str(error))
    if not isinstance(error, ExpressionError):
        return flaw
    source = document.sources.get(flaw.place.name, "")
    place = _within(flaw.place, source, error)
    return replace(flaw, place=place, frame=frame(source, place))


def _within(place: Place, source: str, error: ExpressionError) -> Place:
    """Return the place of the wrong part of an expression in a text.

    It is the place of the whole value if that has escapes or several lines.
    """
    lines = source.splitlines()
    written = lines[place.line - 1][place.column - 1 :] if lines else ""
    quotes = len(written) - len(written.lstrip("\"'"))
    if not written[quotes:].startswith(error.expression):
        return place
    return replace(place, column=place.column + quotes + error.column - 1)


def _path_in(data: Any, details: pydantic_core.ErrorDetails) -> tuple[str | int, ...]:
    """Return pydantic's location without tags of unions, which are not in the data.

    The last part of a missing key is not in the data either, and is kept; the ends of
    a range are entries of a list.
    """
    path: list[str | int] = []
    for name in details["loc"]:
        end = isinstance(data, list) and name in ("lower", "upper")
        part = ("lower", "upper").index(str(name)) if end else name
        if isinstance(data, dict) and part in data:
            data = data[part]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            continue
        path.append(part)
    if details["type"] == "missing":
        path.append(details["loc"][-1])
    return tuple(path)


def _known_keys(
    model: type[Any],
    data: Any,
    path: Sequence[str | int],
) -> list[str]:
    """Return the keys that a mapping at a path can have according to the schema."""
    schema = model.model_json_schema(by_alias=True)
    node = _resolved(schema, schema, data)
    for part in path:
        data = data[part]
        below = node.get("items") if isinstance(part, int) else None
        below = below or node.get("properties", {}).get(part)
        below = below or next(iter(node.get("patternProperties", {}).values()), {})
        node = _resolved(schema, below, data)
    return list(node.get("properties", {}))


def _resolved(schema: Any, node: Any, data: Any) -> Any:
    """Return the schema of a node behind references and choices by name."""
    if "discriminator" in node and isinstance(data, dict):
        node = {"$ref": node["discriminator"]["mapping"].get(data.get("name"), "")}
    choices = [*node.get("anyOf", ()), *node.get("oneOf", ()), node]
    choices += [inner for choice in choices for inner in choice.get("oneOf", ())]
    parts = [
        schema["$defs"].get(choice["$ref"].rpartition("/")[2], {})
        for choice in choices
        if choice.get("$ref")
    ]
    given = set(data) if isinstance(data, dict) else set()
    return max(
        parts, key=lambda one: len(given & {*one.get("properties", ())}), default=node
    )


def _dotted(path: Sequence[str | int]) -> str:
    return ".".join(map(str, path))
