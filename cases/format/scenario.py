"""Reading of a scenario: from a name or a path to a checked, frozen object.

    file -> document -> variant laid over it -> --set -> validated Scenario

All errors are reported at once, each with file:line:column.
"""

from __future__ import annotations

import difflib
import importlib.resources
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeVar

from swarmstart.cases.format.document import (
    Document,
    Place,
    UnreadableFileError,
    YamlError,
    frame,
    meant,
    printable,
    shown,
)
from swarmstart.cases.format.expressions import ExpressionError
from swarmstart.cases.format.overrides import assign, overlay, split_assignment
from swarmstart.cases.format.registry import KINDS, POLISHES, SEARCHES, words_of
from swarmstart.cases.format.yaml_reader import parse_yaml, read_yaml
from swarmstart.errors import SwarmstartError

if TYPE_CHECKING:
    import pydantic
    import pydantic_core

    from swarmstart.cases.format.kind import Kind, Posed
    from swarmstart.cases.format.settings import Scenario

M = TypeVar("M", bound="pydantic.BaseModel")

DEFAULT_VARIANT = "corrected"
LONGEST_NAME = 64
_SHOWN = 40  # characters of a value in a message
RENAMED = {
    "prediction.dt_s": "prediction.horizon_s (dt_s times intervals)",
    "integrator": "prediction.integrator",
    "search.bounds": "search.bound_handling",
}
"""Keys of earlier versions -> their replacements."""

_EXPECTED = {  # pydantic's type of an error -> what was expected, with its context
    "int_type": "an integer",
    "int_from_float": "an integer",
    "float_type": "a number, or an expression such as pi/18",
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
        what: What was expected and what was found.
        frame: The line with a caret; empty if there is no line.
    """

    place: Place
    what: str
    frame: str = ""

    def __str__(self) -> str:
        """Put the place before the message."""
        return f"{self.place}: {self.what}"


class InvalidScenarioError(SwarmstartError, ValueError):
    """A scenario that can be read but not run.

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


class UnknownScenarioError(SwarmstartError, LookupError):
    """A name that is neither a shipped scenario nor a file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Resolved:
    """A scenario as it is run.

    Attributes:
        scenario: The checked scenario.
        kind: Its kind, which builds, measures and draws it.
        variant: The variant's name; empty if the scenario has no variants.
        settings: The resolved scenario as plain data, complete with defaults.
        allow_python: Whether a user's file may be run, if the kind runs one; only the
            current command or call can set this, never a file.
    """

    scenario: Scenario
    kind: Kind
    variant: str
    settings: Mapping[str, Any]
    allow_python: bool = False

    @property
    def code(self) -> Path | None:
        """The user's file that posing it runs; None if it runs none."""
        return None if self.kind.code is None else self.kind.code(self.scenario)

    def posed(self) -> Posed:
        """Return agents and plant, posed by its kind.

        Raises:
            CodeNotAllowedError: If that runs a file and `allow_python` is false.
            SwarmstartError: If it cannot be posed.
        """
        return self.kind.pose(self.scenario, allow_python=self.allow_python)

    def permissions(self) -> dict[str, str]:
        """Return the permission to run the user's file again, if it was given."""
        if self.code is None or not self.allow_python:
            return {}
        return {"python_in": str(self.code.parent.resolve())}

    def anonymous_settings(self) -> dict[str, Any]:
        """Return the settings without title, name, source and claims.

        These do not affect the result.
        """
        told = {"claims": [], "title": "", "source": "", "name": "cell"}
        return {**self.settings, **told}


def shipped() -> dict[str, Path]:
    """Return the scenarios that come with the package, name -> file."""
    folder = importlib.resources.files("swarmstart.cases") / "scenarios"
    return {Path(f.name).stem: Path(str(f)) for f in sorted_files(folder)}


def sorted_files(folder: Any) -> list[Any]:
    """Return the YAML files of a folder by name."""
    return sorted(
        (f for f in folder.iterdir() if f.name.endswith(".yaml")), key=lambda f: f.name
    )


def read_document(name_or_path: str) -> Document:
    """Read a scenario file.

    Args:
        name_or_path: The name of a shipped scenario, or a path: anything with a dot, a
            slash, or an existing file.

    Raises:
        UnknownScenarioError: If it looks like a name, but no scenario has it.
        UnreadableFileError: If the file cannot be read.
        YamlError: If its content is not the format.
    """
    known = shipped()
    if name_or_path in known:
        file = known[name_or_path]
        document = parse_yaml(file.read_bytes(), name=f"{name_or_path}.yaml")
        return replace(document, folder=str(file.parent))
    looks_like_path = any(mark in name_or_path for mark in "./\\")
    if looks_like_path or _exists(name_or_path):
        return _read_file(name_or_path)
    near = difflib.get_close_matches(name_or_path, known, n=1)
    hint = f"did you mean {near[0]}?" if near else _near_file(name_or_path)
    found = f"expected a scenario or a path, found {shown(name_or_path)}; "
    listed = f"{len(known)} scenarios: swarmstart list scenarios"
    raise UnknownScenarioError(found + (f"{hint} {listed}" if hint else listed))


def _read_file(path: str) -> Document:
    """Read a file; the error for a missing one suggests a file of a similar name."""
    try:
        return read_yaml(path)
    except UnreadableFileError as error:
        hint = ""
        if isinstance(error.__cause__, FileNotFoundError):
            hint = _near_file(path)
        if not hint:
            raise
        raise UnreadableFileError(path, f"{error.reason}; {hint}") from error


def _near_file(path: str) -> str:
    """Return a question about the YAML file in its folder with the nearest name."""
    file = Path(path)
    try:
        beside = [one.name for one in sorted_files(file.parent)]
    except (OSError, ValueError):
        return ""
    names = {name.removesuffix(".yaml"): name for name in beside}
    near = difflib.get_close_matches(file.stem, names, n=1)
    meant_file = printable(str(file.with_name(names[near[0]]))) if near else ""
    return f"did you mean {meant_file}?" if near else ""


def _exists(path: str) -> bool:
    """Return whether a file of that name exists; false for impossible names."""
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False


def resolve(
    document: Document,
    *,
    variant: str | None = None,
    search: str | None = None,
    polish: str | None = None,
    assignments: Sequence[str] = (),
    valid: Callable[[Scenario], None] = lambda scenario: None,
) -> Resolved:
    """Return a checked scenario with its variant and the assignments applied.

    Args:
        document: The scenario as read.
        variant: The variant's name; None means "corrected" if there are variants.
        search: The search's name, with its default settings, or with those of the
            scenario if it is the scenario's own search. None means the scenario's
            search.
        polish: The polish's name; None means that of the scenario.
        assignments: "key.path=value", applied in order.
        valid: Callback with a scenario of the right form, before the slow check that
            its terminal set can be certified.

    Raises:
        YamlError: If an assignment does not fit.
        InvalidScenarioError: If the scenario is invalid, with all errors.
    """
    document, name = _with_variant(document, variant)
    document = _with_name(_without(document, "variants"))
    steps = _value(document, ("steps",))
    if search is not None and _value(document, ("search", "name")) != search:
        document = assign(document, "search", f"{{name: {search}}}", name="--search")
    if polish is not None:
        given = polish if polish in POLISHES else f"{{solver: {polish}}}"
        document = assign(document, "polish", given, name="--polish")
    for text in assignments:
        document = assign(document, *split_assignment(text))
    kind = _kind(document)
    scenario = checked(document, kind.scenario)
    if steps is None:  # By default a run is as long as its first plan.
        steps = getattr(getattr(scenario, "prediction", None), "intervals", None)
    scenario = _claiming(scenario, steps)
    valid(scenario)
    located = [*_claim_flaws(scenario, kind), *kind.flaws(scenario)]
    flaws = [_flaw_of(document, path, what) for path, what in located]
    if flaws:
        raise InvalidScenarioError(flaws)
    return Resolved(
        scenario=scenario,
        kind=kind,
        variant=name,
        settings=scenario.model_dump(mode="json", by_alias=True),
    )


def resolved_again(
    settings: Mapping[str, Any], variant: str, *, python_in: str | None = None
) -> Resolved:
    """Return the result of an earlier `resolve`, from its settings.

    Args:
        settings: As in Resolved: plain data, complete and checked.
        variant: As in Resolved.
        python_in: The folder of the file that may be run; None if no file may be run.

    Raises:
        InvalidScenarioError: If the settings are not those of a resolved scenario.
    """
    text, name = json.dumps(settings), str(Path(python_in or "") / "settings")
    resolved = resolve(parse_yaml(text.encode(), name=name))
    return replace(resolved, variant=variant, allow_python=python_in is not None)


def search_of(
    name: str, options: Mapping[str, str], *, told: str = "--search"
) -> dict[str, Any]:
    """Return the `search:` section of a scenario with some settings, complete.

    Args:
        name: The search.
        options: Its settings -> their values as YAML text.
        told: Name of the place of the settings in messages.

    Raises:
        YamlError: If a value cannot be read.
        InvalidScenarioError: If a value is not allowed, in the words for a scenario.
    """
    from swarmstart.cases.format.settings import Searching

    document = parse_yaml(f"search: {{name: {name}}}".encode(), name=told)
    for key, value in options.items():
        document = assign(document, f"search.{key}", value, name=told)
    part = checked(document, Searching)
    return dict(part.search.model_dump(mode="json"))


def _claiming(scenario: Scenario, steps: object) -> Scenario:
    """Return the scenario with claims about runs as long as its file says.

    Args:
        scenario: The scenario, with the steps that it is run with.
        steps: The steps of the file; a claim whose `when` has other steps keeps them.
    """
    if not isinstance(steps, int):
        return scenario
    claims = [
        claim.model_copy(update={"when": {"steps": steps, **claim.when}})
        for claim in scenario.claims
    ]
    return scenario.model_copy(update={"claims": claims})


def _with_variant(document: Document, variant: str | None) -> tuple[Document, str]:
    """Return the document with its variant applied, and the variant's name."""
    variants = document.data.get("variants")
    if variants is None:
        if variant is None:
            return document, ""
        place = document.places[()]
        what = f"expected a scenario with variants, to choose {variant!r} from"
        raise YamlError(what, place)
    if not isinstance(variants, dict) or not variants:
        what = f"expected a mapping of names to overrides, found {_shown(variants)}"
        raise InvalidScenarioError([_flaw(document, ("variants",), what)])
    name = variant or (DEFAULT_VARIANT if DEFAULT_VARIANT in variants else "")
    if name not in variants:
        listed = ", ".join(variants)
        found = "none" if variant is None else repr(variant)
        what = f"expected --variant to be one of {listed}; found {found}"
        raise YamlError(what, document.places[("variants",)])
    return overlay(document, ("variants", name)), name


def _with_name(document: Document) -> Document:
    """Return the document with a name: its own, or that of its file."""
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", Path(document.name).stem)[:LONGEST_NAME]
    if "name" in document.data or not stem:
        return document
    return assign(document, "name", repr(stem), name="the file's name")


def _value(document: Document, path: Sequence[str]) -> object:
    """Return the value at a path; None if there is no such path."""
    value: Any = document.data
    for part in path:
        value = value.get(part) if isinstance(value, dict) else None
    return value


def _without(document: Document, key: str) -> Document:
    """Return the document without a top-level key."""
    content = document.root.content
    if not isinstance(content, dict) or key not in content:
        return document
    kept = {name: node for name, node in content.items() if name != key}
    return replace(document, root=replace(document.root, content=kept))


def _kind(document: Document) -> Kind:
    """Return the kind that the document names."""
    kind = document.data.get("kind")
    near = difflib.get_close_matches("kind", document.data, n=1)
    if kind is None and near:
        what = f"expected a known key, found {_shown(near[0])}; did you mean 'kind'?"
        raise InvalidScenarioError([_flaw(document, near, what, of_key=True)])
    if not isinstance(kind, str) or kind not in KINDS:
        found = "nothing" if kind is None else _shown(kind)
        what = f"expected kind to be one of {', '.join(KINDS)}; found {found}"
        raise InvalidScenarioError([_flaw(document, ("kind",), what)])
    found_kind: Kind = resolve_name(words_of(kind).kind)
    return found_kind


def _claim_flaws(
    scenario: Scenario, kind: Kind
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield an error for each claim whose measure or key does not exist."""
    for number, claim in enumerate(scenario.claims):
        known = kind.measures_of(scenario)
        if claim.measure not in known:
            what = f"expected a measure, found {_shown(claim.measure)}"
            hint = meant(claim.measure, known, otherwise="see swarmstart list")
            yield ("claims", number, "measure"), f"{what}; {hint}"
        for key in claim.when:
            if key in RENAMED or _is_missing(scenario, key):
                path = ("claims", number, "when", key)
                new = RENAMED.get(key, "a key of the scenario")
                yield path, f"expected {new}, found {_shown(key)}"


def _is_missing(scenario: Scenario, dotted_key: str) -> bool:
    """Return whether a scenario lacks a key; keys of other searches are not checked."""
    settings = scenario.model_dump(mode="json", by_alias=True)
    if dotted_key.startswith("search."):
        return False
    for part in dotted_key.split("."):
        if not isinstance(settings, dict) or part not in settings:
            return True
        settings = settings[part]
    return False


def checked(document: Document, model: type[M]) -> M:
    """Return a document validated by a pydantic model.

    Args:
        document: The document.
        model: The pydantic model.

    Raises:
        InvalidScenarioError: If it does not fit, with all errors.
    """
    import pydantic

    folder = document.folder
    beside = Path(document.name).parent if folder is None else Path(folder)
    try:
        return model.model_validate(document.data, context={"folder": beside})
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
            suggested |= {(*path[:-1], key) for key in near}
    return missing & suggested


def _described(
    document: Document,
    path: tuple[str | int, ...],
    group: Sequence[pydantic_core.ErrorDetails],
    model: type[Any],
) -> Flaw:
    """Return pydantic's errors at one place in the words of this project."""
    details = next((d for d in group if d["type"] == "value_error"), group[0])
    kind, context = details["type"], details.get("ctx", {})
    if kind == "extra_forbidden":
        if new := RENAMED.get(_dotted(path)):
            what = f"expected {new}, found {path[-1]}"
            return _flaw(document, path, what, of_key=True)
        known = _known_keys(model, document.data, path[:-1])
        listed = f"known: {', '.join(known)}"
        hint = meant(str(path[-1]), known, otherwise=listed)
        what = f"expected a known key, found {_shown(path[-1])}; {hint}"
        return _flaw(document, path, what, of_key=True)
    if kind == "missing":
        return _flaw(document, path[:-1], f"expected the key {path[-1]!r}")
    if kind == "value_error":
        return _refused(document, path, context["error"])
    if kind.startswith("union_tag"):
        expected = ", ".join(SEARCHES)  # No other key is chosen by name.
        found = _shown(context["tag"]) if "tag" in context else "none"
        what = f"expected name to be one of {expected}; found {found}"
        return _flaw(document, (*path, "name"), what)
    dotted = _dotted(path) or "the scenario"
    expected = " or ".join(dict.fromkeys(map(_expected, group)))
    found = _shown(details["input"])
    return _flaw(document, path, f"expected {dotted} to be {expected}; found {found}")


def _flaw_of(
    document: Document, path: tuple[str | int, ...], what: str | SwarmstartError
) -> Flaw:
    """Return an error that concerns several parts; expressions have a column."""
    if isinstance(what, str):
        return _flaw(document, path, what)
    return _refused(document, path, what)


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
        found = _shown(cause.value)
        what = f"expected {_dotted(path)} to be {cause.allowed}; found {found}"
        return _flaw(document, path, what)
    flaw = _flaw(document, path, str(error))
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


def _flaw(
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


def _dotted(path: Sequence[str | int]) -> str:
    return ".".join(map(str, path))


def _shown(value: object) -> str:
    """Return a value as YAML has it, shortened."""
    if isinstance(value, str):
        text = repr(value)
    else:
        text = json.dumps(value, ensure_ascii=False, default=repr)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."
