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
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from swarmstart.cases.format.document import (
    Document,
    UnreadableFileError,
    YamlError,
    meant,
    printable,
    shown,
)
from swarmstart.cases.format.flaws import (
    RENAMED,
    InvalidScenarioError,
    checked,
    flaw_at,
    located_flaw,
    shown_value,
)
from swarmstart.cases.format.overrides import assign, overlay, split_assignment
from swarmstart.cases.format.registry import KINDS, POLISHES, words_of
from swarmstart.cases.format.yaml_reader import parse_yaml, read_yaml
from swarmstart.errors import SwarmstartError

if TYPE_CHECKING:
    from swarmstart.cases.format.kind import Kind, Posed
    from swarmstart.cases.format.settings import Scenario


DEFAULT_VARIANT = "corrected"
LONGEST_NAME = 64


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
        folder: Folder of the files that the scenario names.
        allow_code: Whether the user's code may be run, if the scenario runs any; only
            the current command or call can set this, never a file.
    """

    scenario: Scenario
    kind: Kind
    variant: str
    settings: Mapping[str, Any]
    folder: Path = Path()
    allow_code: bool = False

    def __reduce__(self) -> tuple[Callable[..., Resolved], tuple[Any, ...]]:
        """Return the call that resolves the scenario again.

        An object of classes that are made anew for each search cannot be pickled.
        """
        folder = str(self.folder.resolve())
        again = partial(resolved_again, code_in=folder, allow_code=self.allow_code)
        return again, (self.settings, self.variant)

    @property
    def code(self) -> str | None:
        """The user's file or command that the scenario runs; None if it runs none."""
        return self.kind.code(self.scenario)

    def posed(self) -> Posed:
        """Return agents and plant, as the kind of the scenario poses them.

        Raises:
            CodeNotAllowedError: If posing runs a file and `allow_code` is false.
            SwarmstartError: If it cannot be posed.
        """
        return self.kind.pose(self.scenario, allow_code=self.allow_code)

    def require_allowed(self) -> None:
        """Raise if the scenario runs code of the user's that may not be run.

        Raises:
            CodeNotAllowedError: If so; the error names the file or the program.
        """
        self.kind.require_allowed(self.scenario, allow_code=self.allow_code)

    def permissions(self) -> dict[str, str]:
        """Return {"code_in": folder} if the scenario's own code may be run, else {}.

        With it a worker may run that code as well.
        """
        if self.code is None or not self.allow_code:
            return {}
        return {"code_in": str(self.folder.resolve())}

    def anonymous_settings(self) -> dict[str, Any]:
        """Return the settings without title, name, source, claims and instances.

        These keys do not affect the result.
        """
        told = {"claims": [], "title": "", "source": "", "name": "cell"}
        settings = {**self.settings, **told}
        settings.pop("instances", None)
        return settings

    def planning_settings(self) -> dict[str, Any]:
        """Return `anonymous_settings`, without a plant that runs a user's code.

        Planning does not run that code.
        """
        settings = self.anonymous_settings()
        if self.code is not None and not self.kind.posed_by_code:
            settings.pop("plant")
        return settings


def shipped() -> dict[str, Path]:
    """Return the scenarios that come with the package, name -> file."""
    folder = importlib.resources.files("swarmstart.cases") / "scenarios"
    return {Path(f.name).stem: Path(str(f)) for f in sorted_files(folder)}


def hard_problems() -> dict[str, Path]:
    """Return the hard problems that come with the package, `hard/NAME` -> file."""
    folder = importlib.resources.files("swarmstart.cases") / "hard" / "problems"
    return {f"hard/{Path(f.name).stem}": Path(str(f)) for f in sorted_files(folder)}


def by_name() -> dict[str, Path]:
    """Return all files that come with the package, by the names that commands take."""
    return {**shipped(), **hard_problems()}


def sorted_files(folder: Any) -> list[Any]:
    """Return the YAML files of a folder by name."""
    return sorted(
        (f for f in folder.iterdir() if f.name.endswith(".yaml")), key=lambda f: f.name
    )


def read_document(name_or_path: str) -> Document:
    """Read a scenario file.

    Args:
        name_or_path: The name of a shipped scenario, such as `pendulum` or
            `hard/walls_4`, or a path: anything with a dot, a slash, or an existing
            file.

    Raises:
        UnknownScenarioError: If it looks like a name, but no scenario has it.
        UnreadableFileError: If the file cannot be read.
        YamlError: If its content is not in the scenario format.
    """
    known = by_name()
    if name_or_path in known:
        file = known[name_or_path]
        document = parse_yaml(file.read_bytes(), name=f"{name_or_path}.yaml")
        return replace(document, folder=str(file.parent))
    looks_like_path = any(mark in name_or_path for mark in "./\\")
    is_hard = re.fullmatch(r"hard/\w*", name_or_path) is not None
    if (looks_like_path and not is_hard) or _exists(name_or_path):
        return _read_file(name_or_path)
    near = difflib.get_close_matches(name_or_path, known, n=1)
    hint = f"did you mean {near[0]}?" if near else _near_file(name_or_path)
    found = f"expected a scenario or a path, found {shown(name_or_path)}; "
    chosen, option = (hard_problems(), " --hard") if is_hard else (shipped(), "")
    listed = f"{len(chosen)} scenarios: swarmstart list scenarios{option}"
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
        # A name that is too long, or has a NUL.
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
        valid: Function that is called once with the scenario, if its form is right,
            before slow checks, such as whether its terminal set can be certified.

    Raises:
        YamlError: If an assignment does not fit.
        InvalidScenarioError: If the scenario is invalid, with all errors.
    """
    document, name = _with_variant(document, variant)
    document = _with_name(_without(document, "variants"))
    # Before --set: claims are about runs as long as the file says.
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
    flaws = [located_flaw(document, path, what) for path, what in located]
    if flaws:
        raise InvalidScenarioError(flaws)
    return Resolved(
        scenario=scenario,
        kind=kind,
        variant=name,
        settings=scenario.model_dump(mode="json", by_alias=True),
        folder=document.beside,
    )


def resolved_again(
    settings: Mapping[str, Any],
    variant: str,
    *,
    code_in: str | None = None,
    allow_code: bool = True,
) -> Resolved:
    """Return a scenario from the settings of an earlier `resolve`.

    Args:
        settings: Attribute `settings` of the earlier result: plain data, complete and
            checked.
        variant: Attribute `variant` of the earlier result.
        code_in: Folder of the files that the scenario names; None: the working folder,
            and no code may be run.
        allow_code: Whether the scenario's own code may be run, if `code_in` is given.

    Raises:
        InvalidScenarioError: If the settings are not those of a resolved scenario.
    """
    # A name in that folder: files that the scenario names are looked for beside it.
    text, name = json.dumps(settings), str(Path(code_in or "") / "settings")
    resolved = resolve(parse_yaml(text.encode(), name=name))
    is_allowed = allow_code and code_in is not None
    return replace(resolved, variant=variant, allow_code=is_allowed)


def search_of(
    name: str, options: Mapping[str, str], *, told: str = "--search"
) -> dict[str, Any]:
    """Return the complete `search:` section of a scenario from some of its settings.

    Args:
        name: The search.
        options: Its settings -> their values as YAML text.
        told: Name of the origin of the settings, for messages.

    Raises:
        YamlError: If a value cannot be read.
        InvalidScenarioError: If a value is not allowed. The message is the same as for
            a scenario file.
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
        what = (
            f"expected a mapping of names to overrides, found {shown_value(variants)}"
        )
        raise InvalidScenarioError([flaw_at(document, ("variants",), what)])
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
    # In quotes: a file may be called 1.yaml or true.yaml.
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
        what = (
            f"expected a known key, found {shown_value(near[0])}; did you mean 'kind'?"
        )
        raise InvalidScenarioError([flaw_at(document, near, what, of_key=True)])
    if not isinstance(kind, str) or kind not in KINDS:
        found = "nothing" if kind is None else shown_value(kind)
        what = f"expected kind to be one of {', '.join(KINDS)}; found {found}"
        raise InvalidScenarioError([flaw_at(document, ("kind",), what)])
    found_kind: Kind = resolve_name(words_of(kind).kind)
    return found_kind


def _claim_flaws(
    scenario: Scenario, kind: Kind
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield an error for each claim whose measure or key does not exist."""
    for number, claim in enumerate(scenario.claims):
        known = kind.measures_of(scenario)
        if claim.measure not in known:
            what = f"expected a measure, found {shown_value(claim.measure)}"
            hint = meant(claim.measure, known, otherwise="see swarmstart list")
            yield ("claims", number, "measure"), f"{what}; {hint}"
        for key in claim.when:
            # pydantic does not check what is in `when`.
            if key in RENAMED or _is_missing(scenario, key):
                path = ("claims", number, "when", key)
                new = RENAMED.get(key, "a key of the scenario")
                yield path, f"expected {new}, found {shown_value(key)}"


def _is_missing(scenario: Scenario, dotted_key: str) -> bool:
    """Return whether a scenario lacks a key; keys of other searches are not checked."""
    settings = scenario.model_dump(mode="json", by_alias=True)
    # A claim may be about another search, which has other keys.
    if dotted_key.startswith("search."):
        return False
    for part in dotted_key.split("."):
        if not isinstance(settings, dict) or part not in settings:
            return True
        settings = settings[part]
    return False
