"""The page of a comparison in a browser: quiet, offline, sorted, easy to read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmstart.cases.drawing.report.pages.comparison_page import comparison_page
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES
from swarmstart.tests.browser import chromium
from swarmstart.tests.cases.drawing.report import contents

KINDS: dict[str, dict[str, Any]] = {
    "usual": {"regression": True},
    "twelve": {"solvers": 12, "scenarios": 1, "seeds": 30},
    "one seed": {"solvers": 3, "scenarios": 1, "seeds": 1},
    "none feasible": {"feasible": 0.0},
    "flights": {"flights": True},
    "maximised": {"sense": -1, "scenarios": 1},
    "nulls": {"nulls": True},
}
# What axe-core checks, in short: names, order of headings, ids, landmarks, language.
FAULTS = """() => {
  const faults = [];
  const all = selector => [...document.querySelectorAll(selector)];
  const ids = all("[id]").map(e => e.id);
  if (new Set(ids).size !== ids.length) faults.push("an id twice");
  if (document.documentElement.lang !== "en") faults.push("no language");
  for (const name of ["header", "main", "footer", "nav", "h1"])
    if (all(name).length !== 1) faults.push(`not one ${name}`);
  let level = 0;
  for (const head of all("h1, h2, h3, h4")) {
    if (Number(head.tagName[1]) > level + 1) faults.push(`skipped: ${head.outerHTML}`);
    level = Number(head.tagName[1]);
  }
  for (const e of all("button, summary, a"))
    if (!e.textContent.trim()) faults.push(e.outerHTML);
  for (const e of all("input")) if (!e.labels.length) faults.push(e.outerHTML);
  for (const e of all("svg")) if (e.getAttribute("role") === "img"
    ? !e.getAttribute("aria-label")
    : e.getAttribute("aria-hidden") !== "true") faults.push("svg");
  for (const e of all("a[href^='#']"))
    if (!document.querySelector(e.getAttribute("href"))) faults.push(e.outerHTML);
  for (const e of all("[aria-labelledby]"))
    if (!ids.includes(e.getAttribute("aria-labelledby"))) faults.push(e.outerHTML);
  for (const e of all("[tabindex]")) if (e.tabIndex > 0) faults.push("tab order");
  for (const e of all("[style], [onclick]")) faults.push(e.tagName);
  return faults;
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One Chromium for all."""
    with chromium() as opened:
        yield opened


@pytest.fixture
def opened(browser: Any, tmp_path: Path) -> Iterator[Any]:
    """Open a content's page; what the browser says or asks for is a failure."""
    said: list[str] = []
    pages = []

    def open_(content: dict[str, Any], **settings: Any) -> Any:
        file = tmp_path / "page.html"
        file.write_text(comparison_page(content), encoding="utf-8")
        page = browser.new_page(**settings)
        page.set_default_timeout(5000)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("dialog", lambda dialog: said.append(dialog.message))
        page.on("request", lambda request: said.append(request.url))
        page.goto(file.as_uri())
        pages.append(page)
        return page

    yield open_
    for page in pages:
        page.close()
    assert [line for line in said if not line.startswith(("file:", "data:"))] == []


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_comparison_is_accessible_and_fits_a_phone(
    opened: Any, kind: str
) -> None:
    page = opened(
        contents.content(**KINDS[kind]), viewport={"width": 390, "height": 800}
    )
    assert page.evaluate(FAULTS) == []
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    words = page.inner_text("body")
    assert "None" not in words.replace("None was", "") and "nan" not in words.split()


def test_panels_of_the_best_answer_have_units() -> None:
    text = comparison_page(contents.content(solvers=2, scenarios=1, seeds=2))
    assert "px [m]" in text and "turn rate [rad/s]" in text and "py [" not in text


def test_text_of_users_is_shown_and_not_run(opened: Any) -> None:
    page = opened(contents.hostile(), viewport={"width": 390, "height": 800})
    assert page.evaluate(FAULTS) == []
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.locator("script").count() == 2
    assert "<script>alert(1)" in page.inner_text("h2 >> nth=3")


def test_the_policy_refuses_a_script_that_is_not_the_pages_own(
    browser: Any, tmp_path: Path
) -> None:
    """The policy keeps text from being run even if escaping failed once."""
    text = comparison_page(contents.content(solvers=2, scenarios=1, seeds=2))
    file = tmp_path / "page.html"
    file.write_text(text.replace("<footer>", "<footer><script>window.ran = 1</script>"))
    page = browser.new_page()
    page.goto(file.as_uri())
    assert page.evaluate("window.ran === undefined")
    assert page.evaluate("!document.getElementById('theme').hidden")  # Ours was run.
    page.close()


def test_numbers_sort_as_numbers_and_missing_ones_last_either_way(opened: Any) -> None:
    page = opened(contents.content(solvers=5, scenarios=1, feasible=0.05, seeds=4))
    head = page.locator("#summary th", has_text="median gap")
    button = head.get_by_role("button")
    for expected, sign in (("ascending", 1), ("descending", -1)):
        button.press("Enter")
        assert head.get_attribute("aria-sort") == expected
        cells = page.locator("#summary tbody td:nth-child(5)").all_inner_texts()
        known = [float(text) for text in cells if text != "not feasible"]
        assert known == sorted(known, reverse=sign < 0) and len(known) < len(cells)
        assert cells[len(known) :] == ["not feasible"] * (len(cells) - len(known))


def test_a_filter_keeps_the_rows_with_its_words(opened: Any) -> None:
    page = opened(contents.content(solvers=6, scenarios=2))
    page.get_by_label("Show rows with").first.fill("passing_side_1 lshade")
    shown = page.locator("#summary tbody tr:visible")
    assert shown.count() == 2
    assert "2 of 12 rows" in page.locator("#summary [role=status]").inner_text()


def test_the_button_turns_to_dark_and_print_is_always_light(opened: Any) -> None:
    page = opened(contents.content(solvers=2, scenarios=1), color_scheme="light")
    ground = "getComputedStyle(document.documentElement).backgroundColor"
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
    page.get_by_role("button", name="Dark colours").click()
    assert page.evaluate(ground) == "rgb(21, 24, 29)"
    page.emulate_media(media="print")
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
    assert not page.locator("nav").is_visible()


def test_values_of_a_curve_are_read_with_the_keys(opened: Any) -> None:
    page = opened(contents.content(solvers=2, scenarios=1))
    chart = page.locator("#convergence-1 svg[role=img]")
    chart.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    row = page.locator("#convergence-1 tbody tr").nth(1)
    told = page.locator("#tip").inner_text()
    assert row.locator("th").text_content() in told and "repeated-ipopt" in told
    page.keyboard.press("Escape")
    assert not page.locator("#tip").is_visible()


def test_without_javascript_the_page_reads_completely(opened: Any) -> None:
    page = opened(contents.content(), java_script_enabled=False)
    assert page.locator("button:visible").count() == 0
    assert page.locator("figure.chart").count() > 8


def test_the_greatest_comparison_stays_below_three_megabytes() -> None:
    page = comparison_page(contents.content(solvers=12, scenarios=30, seeds=30))
    assert len(page.encode()) < PAGE_BYTES == 3_000_000


def test_a_value_that_is_maximised_is_shown_with_its_sign() -> None:
    page = comparison_page(contents.content(sense=-1, scenarios=1))
    assert "Best value known: 400, " in page
    assert "-400" not in page


def test_a_profile_of_one_scenario_is_not_drawn_and_words_say_why() -> None:
    both, one = (comparison_page(contents.content(scenarios=k)) for k in (2, 1))
    missing = "There is no performance profile: it shows on how many scenarios"
    assert 'id="profile"' in both and missing not in both
    assert 'id="profile"' not in one and missing in one
    none = contents.content() | {"profile": None}
    assert "no solver came within 1 % of the best known" in comparison_page(none)
