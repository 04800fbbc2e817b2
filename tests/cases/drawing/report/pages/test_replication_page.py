"""The page of a replication: figures at their claims, spread, a flight, no network."""

from __future__ import annotations

import itertools
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image  # Comes with matplotlib.

from swarmstart.cases.drawing.report.pages.replication_page import (
    quality,
    replication_page,
)
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES
from swarmstart.cases.record.files import RecordError
from swarmstart.tests.cases.drawing.report.flown_records import (
    Opened,
    browser,
    flown_point,
)

CELL = "0123456789abcdef"


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown_point(tmp_path_factory.mktemp("point"))


@pytest.fixture
def folder(record: Path, tmp_path: Path) -> Path:
    """A replication's folder with one run that is kept."""
    cell = shutil.copytree(record, tmp_path / "cells" / CELL)
    (cell / "figures").mkdir()
    Image.new("RGB", (300, 200), "white").save(cell / "figures" / "b_states.png")
    return tmp_path


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    with browser() as one:
        yield one


def part(scenario: str, *, search: str = "", **more: Any) -> dict[str, Any]:
    command = f"swarmstart run {scenario}"
    command += f" --set 'search={{name: {search}}}'" if search else ""
    return {
        "scenario": scenario, "variant": "", "claim": "1", "reading": "as printed",
        "text": "It settles.", "asked": "settle_time_s <= 50",
        "measure": "settle_time_s", "relation": "<=", "bound": 50.0, "basis": "ours",
        "values": [8.0, 9.0, None, 12.0], "pairs": [], "measured": "8 / 9 / 12",
        "runs": 4, "verdict": "holds", "test": "", "tolerance": None,
        "command": command, "against": "", "failures": [], **more,
    }  # fmt: skip


def claim(number: int, *parts: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {
        "id": number, "text": f"Claim {number} of a chapter, as it says.",
        "source": "Section 5.2", "verdict": "in part", "expected": "in part",
        "as_expected": True, "because": "So it is.", "parts": list(parts), **more,
    }  # fmt: skip


def figure(number: str, scenario: str, **more: Any) -> dict[str, Any]:
    return {
        "number": number, "title": "A flight", "scenario": scenario, "search": None,
        "kind": "problem", "command": f"swarmstart run {scenario}", "cell": CELL,
        "files": ["b_states.png"], "failure": "", **more,
    }  # fmt: skip


def content(claims: list[dict[str, Any]], figures: list[Any]) -> dict[str, Any]:
    return {
        "schema": 1, "command": "swarmstart replicate", "quick": False,
        "seeds_in_words": "4 seeds each", "runs": 4, "counted": "1 in part",
        "claims": claims, "versions": {"swarmstart": "0"}, "figures": figures,
    }  # fmt: skip


def test_a_figure_stands_once_at_the_first_claim_of_its_runs(folder: Path) -> None:
    """By scenario and search; a claim judged by later runs links to it."""
    claims = [
        claim(1, part("a")),
        claim(2, part("a", search="ga")),
        claim(3, part("a", against='swarmstart run a --set \'search={"name": "ga"}\'')),
        claim(4, part("b")),
    ]
    figures = [
        figure("5.9", "a", search="ga"),
        figure("5.10", "a"),
        figure("5.30", "c"),
    ]
    html = replication_page(content(claims, figures), folder)
    sections = dict(
        re.findall(r'id="claim-(\d)" (.*?)(?=<section class="claim"|$)', html, re.S)
    )
    heads = {
        number: re.findall(r"Fig\. ([\d.]+): ", text)
        for number, text in sections.items()
    }
    assert heads["1"] == ["5.10"] and heads["2"] == ["5.9"] and heads["3"] == []
    links = re.findall(r'href="#(figure-\d)">Fig. ([\d.]+)', sections["3"])
    assert links == [("figure-1", "5.9"), ("figure-2", "5.10")]
    assert "Further figures" in html and html.count("<h4 ") == len(figures)
    assert html.count("States over time; dotted: their bounds.</figcaption>") == 3


def test_the_page_opens_on_a_telephone_in_light_and_dark(
    folder: Path, opened: Opened, tmp_path: Path
) -> None:
    claims = [
        claim(1, part("a"), part("a", verdict="does not hold", bound=None)),
        claim(2, part("", values=[0.68], command="module:compute"), as_expected=False),
    ]
    html = replication_page(content(claims, [figure("5.10", "a")]), folder)
    for scheme in ("light", "dark"):
        opened.page.emulate_media(color_scheme=scheme)
        page = opened.show(html, tmp_path / "page.html", width=390)
        assert not opened.scrolls_sideways()
        assert opened.is_silent()
        assert faint(page) == []
    opened.page.emulate_media(color_scheme="light")
    assert page.locator("section.claim").count() == 2
    assert page.locator(".strip").count() == 3
    for landmark in ("header", "nav", "main", "footer"):
        assert page.locator(landmark).count() == 1
    levels = [
        int(h.evaluate("n => n.tagName[1]")) for h in page.locator("h1,h2,h3,h4").all()
    ]
    assert levels[0] == 1 and all(b - a <= 1 for a, b in itertools.pairwise(levels))
    page.locator(".play").click()
    page.clock.run_for(500)
    assert float(page.locator(".clock").inner_text()) > 0.05
    page.locator("label.filter input").first.fill("expected:")
    assert page.locator("#overview ~ .scroll tbody tr:visible").count() == 1


def faint(page: Any) -> list[str]:
    """Return texts whose contrast with their ground is below 4.5 (WCAG 2.2, 1.4.3)."""
    found: list[str] = page.evaluate(
        """() => {
          const parts = text => text.match(/[\\d.]+/g).map(Number);
          const light = ([r, g, b]) => {
            const [x, y, z] = [r, g, b].map(v => v / 255).map(
              v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
            return 0.2126 * x + 0.7152 * y + 0.0722 * z;
          };
          const ground = node => {
            for (; node; node = node.parentElement) {
              const colour = parts(getComputedStyle(node).backgroundColor);
              if (colour.length < 4 || colour[3] > 0) return colour;
            }
            return [255, 255, 255];
          };
          const bad = [];
          for (const node of document.querySelectorAll("body > :not(script) *")) {
            const own = [...node.childNodes].some(
              n => n.nodeType === 3 && n.textContent.trim());
            if (!own || !node.checkVisibility()) continue;
            const style = getComputedStyle(node);
            const ink = node instanceof SVGElement ? style.fill : style.color;
            if (!ink.startsWith("rgb")) continue;
            const [a, b] = [light(parts(ink)), light(ground(node))];
            const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
            if (ratio < 4.5) bad.push(`${node.tagName} ${node.textContent} ${ratio}`);
          }
          return bad;
        }"""
    )
    return found


def test_a_forged_record_is_neither_read_elsewhere_nor_run(
    folder: Path, opened: Opened, tmp_path: Path
) -> None:
    bad = "</script><script>document.title=1</script><img src=http://x.y/z>"
    claims = [
        claim(1, part("a", text=bad, measured=bad, test=bad), text=bad, because=bad)
    ]
    shutil.copytree(folder / "cells" / CELL, folder / "outside")
    cells = ["../outside", "../..", "", "0123/../x", None, "f" * 16]
    figures = [figure(bad, "a", cell=cell, title=bad, command=bad) for cell in cells]
    html = replication_page(content(claims, figures), folder)
    assert "data:image/png" not in html and "One of the flights" not in html
    page = opened.show(html, tmp_path / "page.html")
    assert page.title() == "The chapter replicated"
    assert opened.is_silent()


@pytest.mark.parametrize("wrong", [
    {"claims": [{"id": 1}]}, {"claims": 3}, {"figures": [1]}, {"versions": None},
    {"claims": [claim(1, part("a", values=5))]},
    {"claims": [claim(1, part("a", width="wide"))]},
])  # fmt: skip
def test_other_content_is_one_message(wrong: dict[str, Any], folder: Path) -> None:
    with pytest.raises(RecordError, match=r"expected the content of replication\.json"):
        replication_page({**content([claim(1, part("a"))], []), **wrong}, folder)


def test_content_without_figures_or_runs_is_a_page(tmp_path: Path) -> None:
    """Content of an older version, which had no figures, is still read."""
    whole = content([claim(1, part("a"))], [])
    del whole["figures"]
    html = replication_page(whole, tmp_path)
    assert "One of the flights" not in html and "claim-1" in html
    missing = content([claim(1, part("a"))], [figure("5.9", "a")])
    html = replication_page(missing, tmp_path)
    assert "Its file cannot be read as an image." in html
    assert len(html.encode()) < PAGE_BYTES


def test_verdicts_have_three_qualities() -> None:
    verdicts = [
        "holds",
        "does not hold",
        "in part",
        "not shown",
        "an assumption, met here",
    ]
    assert [quality(v) for v in verdicts] == ["good", "bad", "mid", "mid", "good"]
