"""Pages of the site in a browser: quiet, offline, readable by night and on a phone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from swarmstart.tests.browser import chromium
from swarmstart.tests.docs.conftest import Site

PAGES = (
    "index",
    "gallery/index",
    "gallery/plans/least_time_gap",
    "tutorial/swing_up",
    "problem",
    "reference/solving",
    "reference/command_line",
    "reference/yaml/problem",
    "glossary",
    "chapter/formation",
    "measured/published_results",
)
LEAST_CONTRAST = 4.5
"""Of text (WCAG 2.2, success criterion 1.4.3, level AA)."""
# Every text of the page's content against the first background that is not clear.
CONTRASTS = """() => {
  const canvas = document.createElement("canvas")
    .getContext("2d", {willReadFrequently: true});
  const rgba = colour => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const luminance = ([r, g, b]) => {
    const [R, G, B] = [r, g, b].map(v => v / 255).map(
      v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * R + 0.7152 * G + 0.0722 * B;
  };
  const behind = element => {
    for (let e = element; e; e = e.parentElement) {
      const colour = rgba(getComputedStyle(e).backgroundColor);
      if (colour[3] === 255) return colour;
    }
    return [255, 255, 255, 255];
  };
  const found = {};
  const root = document.querySelector("[role=main]");
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || !element.checkVisibility() ||
        element.closest(".headerlink, script, style, .visually-hidden")) continue;
    const style = getComputedStyle(element);
    const [a, b] = [luminance(rgba(style.color)), luminance(behind(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const name = `${element.tagName}.${element.className} ${style.color}`;
    found[name] = Math.min(ratio, found[name] ?? 99);
  }
  return found;
}"""
# What reaches beyond the window and is in no box that scrolls.
TOO_WIDE = """() => [...document.querySelectorAll("[role=main] *")].filter(e => {
  if (e.getBoundingClientRect().right <= innerWidth + 1) return false;
  for (let p = e; p; p = p.parentElement)
    if (["auto", "scroll", "hidden"].includes(getComputedStyle(p).overflowX))
      return false;
  return e.checkVisibility();
}).map(e => e.outerHTML.slice(0, 80))"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Yield one Chromium for all tests."""
    with chromium() as opened:
        yield opened


@pytest.mark.parametrize("name", PAGES)
def test_a_page_fits_a_phone_is_legible_and_is_silent(
    browser: Any, site: Site, name: str
) -> None:
    said: list[str] = []
    page = browser.new_page(
        viewport={"width": 390, "height": 800}, color_scheme="light"
    )
    page.set_default_timeout(10_000)
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: said.append(request.url))
    page.goto((site.folder / f"{name}.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.evaluate(TOO_WIDE) == []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        contrasts = page.evaluate(CONTRASTS)
        assert contrasts
        faint = {what: c for what, c in contrasts.items() if c < LEAST_CONTRAST}
        assert not faint, scheme
    page.close()
    own = site.folder.as_uri()
    assert [line for line in said if not line.startswith((own, "data:"))] == []


@pytest.mark.parametrize(
    "name", [name for name in PAGES if not name.startswith("reference/")]
)
def test_axe_finds_no_error_of_accessibility(
    browser: Any, site: Site, name: str
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.set_default_timeout(10_000)
    page.goto((site.folder / f"{name}.html").as_uri())
    found = axe.Axe().run(page).response["violations"]
    page.close()
    assert [(one["id"], one["nodes"][0]["html"]) for one in found] == []


def test_the_search_finds_a_name_without_a_network(browser: Any, site: Site) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.set_default_timeout(10_000)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((site.folder / "search.html").as_uri() + "?q=LSHADE")
    link = page.locator("#search-results a", has_text="LSHADE").first
    assert "reference/search.html" in link.get_attribute("href")
    own = site.folder.as_uri()
    assert [url for url in asked if not url.startswith((own, "data:"))] == []
    page.close()
