"""The page of a replication: every claim, its runs, its spread, and its figures.

A figure is shown at the first claim that is judged by the figure's runs; other claims
link to it. One of the flights can be played.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report.pictures import (
    PAGE_BYTES,
    SMALL_WIDTH,
    Picture,
    pictures_of,
)
from swarmstart.cases.drawing.report.player import player
from swarmstart.cases.drawing.report.strips import strip
from swarmstart.cases.drawing.report.tracks import tracks_of
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.record import MARK
from swarmstart.cases.record.results import load
from swarmstart.errors import SwarmstartError

if TYPE_CHECKING:
    from markupsafe import Markup

_GOOD = ("holds", "an assumption, met here")
_BAD = ("does not hold", "an assumption, not met here")
_SEARCH = re.compile(r'search=\{"?name"?: "?(\w+)|--search (\w+)')
# The hash that names a run's folder: no other text becomes part of a path.
_KEY = re.compile(r"[0-9a-f]{8,64}")
_PLAYED = ("formation_obstacle", "formation_v")
"""Scenarios whose flight is played before others'."""
BASES = {"ours": "the bound is ours", "physics": "the bound is physics"}


@dataclass(frozen=True, kw_only=True, slots=True)
class FigureShown:
    """A figure of the chapter in the page.

    Attributes:
        number: Number of the figure in the chapter.
        title: Title of the figure.
        command: Command that makes the run of the figure.
        failure: Reason why the run failed; empty if it did not fail.
        pictures: Panels of the figure.
        key: Key made of scenario and search.
        anchor: Id of the figure in the page.
    """

    number: str
    title: str
    command: str
    failure: str
    pictures: Sequence[Picture]
    key: tuple[str, str]
    anchor: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ClaimShown:
    """A claim in the page.

    Attributes:
        claim: Claim as recorded.
        parts: Parts of the claim as recorded, each with its strip of values.
        figures: Figures that are shown at this claim.
        elsewhere: Figures of the claim's runs that are shown at another claim.
        quality: Class of the verdict's colour: "good", "mid" or "bad".
    """

    claim: Mapping[str, Any]
    parts: Sequence[tuple[Mapping[str, Any], "Markup"]]
    figures: list[FigureShown] = field(default_factory=list)
    elsewhere: list[FigureShown] = field(default_factory=list)
    quality: str = "mid"


def replication_page(content: Mapping[str, Any], folder: Path) -> str:
    """Return the page of a replication: one HTML file below 3 MB that loads nothing.

    Args:
        content: Content of replication.json.
        folder: Folder of replication.json; the folders of the runs are in `cells` below
            it.

    Raises:
        RecordError: If the content is not that of a replication.
    """
    import jinja2

    wrong = (LookupError, TypeError, ValueError, AttributeError, jinja2.UndefinedError)
    try:
        return _page(content, folder)
    except wrong as error:
        raise RecordError(
            f"{folder}: expected the content of replication.json, found: "
            f"{type(error).__name__}: {str(error)[:200]}"
        ) from error


def _page(content: Mapping[str, Any], folder: Path) -> str:
    recorded = list(content.get("figures") or [])
    flight, played = _flight(recorded, folder)
    claims = [
        ClaimShown(
            claim=claim,
            parts=[(part, _strip(part)) for part in claim["parts"]],
            quality=quality(claim["verdict"]),
        )
        for claim in content["claims"]
    ]
    parts = {
        "content": content,
        "claims": claims,
        "quality": quality,
        "bases": BASES,
        "flight": flight,
        "played": played,
        "others": [],
        "unexpected": [c for c in content["claims"] if not c["as_expected"]],
    }
    # 60 kB for the tags and captions of the figures, which are not in it yet.
    room = (
        PAGE_BYTES - len(rendered("replication_page.html.j2", parts).encode()) - 60_000
    )
    figures = _figures(recorded, folder, room)
    others = _placed(figures, claims)
    return rendered("replication_page.html.j2", {**parts, "others": others})


def quality(verdict: str) -> str:
    """Return the class of a verdict's colour."""
    if verdict in _GOOD:
        return "good"
    return "bad" if verdict in _BAD else "mid"


def _strip(part: Mapping[str, Any]) -> "Markup":
    """Return the values of a part as a strip; nothing if no value is a number."""
    return strip(
        part["values"],
        bound=part["bound"],
        relation=str(part["relation"]),
        width=float(part.get("width") or 0.0),
    )


def _figures(recorded: Sequence[Any], folder: Path, room: int) -> list[FigureShown]:
    found = []
    for number, figure in enumerate(recorded):
        place, kind = _cell(figure, folder), str(figure.get("kind") or "")
        names = [str(name) for name in figure.get("files") or []]
        pictures = (
            []
            if place is None
            else pictures_of(place, names, kind, room=room, width=SMALL_WIDTH)
        )
        room -= sum(len(picture.data) for picture in pictures)
        found.append(
            FigureShown(
                number=str(figure["number"]),
                title=str(figure["title"]),
                command=str(figure["command"]),
                failure=str(figure.get("failure") or ""),
                pictures=pictures,
                key=(str(figure["scenario"]), str(figure.get("search") or "")),
                anchor=f"figure-{number + 1}",
            )
        )
    return found


def _cell(figure: Mapping[str, Any], folder: Path) -> Path | None:
    """Return the folder of a figure's run; None if the replication has no such run."""
    key = str(figure.get("cell") or "")
    return folder / "cells" / key if _KEY.fullmatch(key) else None


def _placed(
    figures: Sequence[FigureShown], claims: Sequence[ClaimShown]
) -> list[FigureShown]:
    """Put each figure at the first claim of its runs; return those of no claim."""
    shown: set[str] = set()
    # In order: a figure stands at the first claim, others link to it.
    for claim in claims:
        keys = {key for part in claim.claim["parts"] for key in _keys(part)}
        scenarios = {scenario for scenario, _ in keys}
        exact = [figure for figure in figures if figure.key in keys]
        related = exact or [f for f in figures if f.key[0] in scenarios]
        for figure in related:
            if figure.anchor in shown:
                claim.elsewhere.append(figure)
            else:
                shown.add(figure.anchor)
                claim.figures.append(figure)
    return [figure for figure in figures if figure.anchor not in shown]


def _keys(part: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return scenario and search of each run of a part; "": the scenario's own."""
    if not part["scenario"]:
        return []
    commands = [part["command"], part.get("against") or ""]
    keys = []
    for command in filter(None, commands):
        found = _SEARCH.search(command)
        search = "" if found is None else found.group(1) or found.group(2)
        keys.append((str(part["scenario"]), search))
    return keys


def _flight(recorded: Sequence[Any], folder: Path) -> "tuple[Markup | None, str]":
    """Return one flight to play, and what runs it; None if no run is kept."""

    def rank(figure: Mapping[str, Any]) -> tuple[bool, int]:
        name = figure.get("scenario")
        place = _PLAYED.index(name) if name in _PLAYED else len(_PLAYED)
        return bool(figure.get("search")), place  # The scenario's own search first.

    for figure in sorted(recorded, key=rank):
        place = _cell(figure, folder)
        if place is None or figure.get("failure") or not (place / MARK).is_file():
            continue
        try:
            return player(tracks_of(load(place))), str(figure["command"])
        except SwarmstartError:
            continue  # A damaged run: another one can be played.
    return None, ""
