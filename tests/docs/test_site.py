"""The site: built without a warning, no broken link, every public name, no network."""

from __future__ import annotations

import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import swarmstart
from swarmstart import heuristics, terminal_set
from swarmstart.cases.format.registry import KINDS
from swarmstart.tests.docs.conftest import Site

HEAVIEST = 1_500_000
"""Most bytes that a page has with all that it loads, animations apart."""
LOADED = {"src", "srcset", "poster", "data"}
"""Attributes whose address a browser loads by itself."""


class Page(HTMLParser):
    """The links, the anchors and the addresses that are loaded of one page.

    Attributes:
        links: Addresses that a reader may follow.
        anchors: Names of places in the page.
        loaded: Addresses of images, scripts, styles and fonts.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: Counter[str] = Counter()
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.anchors[value] += 1
            elif name == "href" and value:
                (self.links if tag == "a" else self.loaded).append(value)
            elif name in LOADED and value:
                self.loaded.append(value)


@pytest.fixture(scope="module")
def html(site: Site) -> dict[Path, Page]:
    """Return the pages of the site by their path."""
    return {
        path.resolve(): Page(path.read_text(encoding="utf-8"))
        for path in sorted(site.folder.rglob("*.html"))
    }


def test_the_site_is_built_without_a_warning(site: Site) -> None:
    assert site.said == ""


def test_no_page_is_heavy(html: dict[Path, Page]) -> None:
    heavy = {}
    for path, page in html.items():
        files = {
            (path.parent / unquote(urlsplit(one).path)).resolve()
            for one in page.loaded
            if urlsplit(one).path
        }
        sizes = [
            file.stat().st_size
            for file in {path, *files}
            if file.is_file() and file.suffix != ".gif"
        ]
        if sum(sizes) > HEAVIEST:
            heavy[path.name] = sum(sizes)
    assert not heavy


def test_no_link_is_broken(html: dict[Path, Page]) -> None:
    broken = []
    for path, page in html.items():
        for link in page.links:
            place = urlsplit(link)
            if place.scheme in ("http", "https", "mailto"):
                continue
            target = (path.parent / unquote(place.path)) if place.path else path
            target = target.resolve()
            known = html[target].anchors if target in html else ()
            is_there = target.is_file() and (
                not place.fragment or unquote(place.fragment) in known
            )
            if not is_there:
                broken.append(f"{path.name}: {link}")
    assert not broken


def test_no_anchor_stands_twice_on_a_page(html: dict[Path, Page]) -> None:
    twice = {
        path.name: names
        for path, page in html.items()
        if (names := [name for name, count in page.anchors.items() if count > 1])
    }
    assert not twice


def test_nothing_is_loaded_from_elsewhere(site: Site, html: dict[Path, Page]) -> None:
    for path, page in html.items():
        for address in page.loaded:
            place = urlsplit(address)
            assert not place.netloc and place.scheme in ("", "data"), (path, address)
    for style in site.folder.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", text), style


ROOMS = {"heuristics": heuristics, "terminal_set": terminal_set}


def names() -> list[str]:
    """Return the full names of what users import; one of the root stands for both."""
    found = [f"swarmstart.{name}" for name in swarmstart.__all__]
    for room, module in ROOMS.items():
        for name in module.__all__:
            ours = (
                getattr(swarmstart, name, None) if name in swarmstart.__all__ else None
            )
            if ours is not getattr(module, name):
                found.append(f"swarmstart.{room}.{name}")
    return found


def test_every_public_name_is_described_once(html: dict[Path, Page]) -> None:
    places: Counter[str] = Counter()
    for page in html.values():
        places.update(page.anchors.keys())
    assert {name: places[name] for name in names() if places[name] != 1} == {}


def test_every_kind_has_a_page_with_its_keys(site: Site) -> None:
    for kind in KINDS:
        text = (site.folder / "reference" / "yaml" / f"{kind}.html").read_text("utf-8")
        assert text.count("<table") > 3, kind
        assert "generated:" not in text
