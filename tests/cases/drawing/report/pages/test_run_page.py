"""Pages of runs: what they say, and records that are damaged or forged."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw  # Comes with matplotlib.

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.drawing.drawing import COLOURS
from swarmstart.cases.drawing.report.pages import run_page as report
from swarmstart.cases.drawing.report.pages.run_content import run_content
from swarmstart.cases.drawing.report.pages.run_page import (
    run_latex,
    run_markdown,
    run_page,
)
from swarmstart.cases.drawing.report.pages.seeds_page import (
    seeds_latex,
    seeds_markdown,
    seeds_page,
)
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES, caption_of, pictures_of
from swarmstart.cases.drawing.report.player import caption
from swarmstart.cases.drawing.report.strips import strip
from swarmstart.cases.drawing.report.text_reports import latex_text, markdown_table
from swarmstart.cases.format.registry import KINDS, words_of
from swarmstart.cases.record.files import RecordError
from swarmstart.errors import SwarmstartError
from swarmstart.tests.cases.drawing.report.flown_records import (
    Opened,
    browser,
    flown_point,
)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = flown_point(tmp_path_factory.mktemp("point"))
    names = ["a_sheet.png", "b_states.png", "c_controls.png", "d_slack.png"]
    (folder / "figures").mkdir()
    for seed, name in enumerate(names):
        (folder / "figures" / name).write_bytes(png(400, 200, seed=seed))
    return changed(folder, lambda summary: summary.update(figures=names))


@pytest.fixture(scope="module")
def opened() -> Iterator[Opened]:
    with browser() as one:
        yield one


@pytest.fixture
def copied(record: Path, tmp_path: Path) -> Path:
    return shutil.copytree(record, tmp_path / "copy")


def changed(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Change run.json of a record."""
    file = folder / "run.json"
    summary = json.loads(file.read_text(encoding="utf-8"))
    change(summary)
    file.write_text(json.dumps(summary), encoding="utf-8")
    return folder


def png(width: int = 40, height: int = 30, *, seed: int = 0) -> bytes:
    """Return a PNG file of noise, which no compression makes small."""
    noise = np.random.default_rng(seed).integers(0, 256, (height, width, 3))
    buffer = io.BytesIO()
    Image.fromarray(noise.astype(np.uint8)).save(buffer, format="PNG")
    return buffer.getvalue()


def test_a_page_says_how_it_went_and_how_to_do_it_again(
    record: Path, opened: Opened, tmp_path: Path
) -> None:
    html = run_page(record)
    page = opened.show(html, tmp_path / "page.html", width=390)
    headline = page.locator(".headline").inner_text()
    summary = json.loads((record / "run.json").read_text(encoding="utf-8"))
    assert "Simulated for 2 s in 4 steps" in headline
    assert "every planned step found a feasible plan" in headline
    assert f"{summary['measures']['flown_cost']:.6g}" in headline
    assert "of each step's 500 ms" in headline
    assert page.locator("h1").inner_text() == "A point <b>goes</b> past a mast"
    names = page.locator("#measures ~ .scroll tbody th").all_inner_texts()
    assert names == list(summary["measures"])
    assert "holds" in page.locator("#claims ~ .scroll tbody").inner_text()
    assert page.locator("#command").inner_text() == (
        "swarmstart run ./scenario.yaml --seed 0 --out again"
    )
    widths = page.eval_on_selector_all("img", "all => all.map(i => i.naturalWidth)")
    assert len(widths) == len(summary["figures"]) > 3 and min(widths) > 300
    captions = page.locator("figcaption").all_inner_texts()
    assert all(text.endswith(".") and "_" not in text for text in captions)
    assert not opened.scrolls_sideways() and opened.is_silent()
    assert len(html.encode()) < PAGE_BYTES


def test_a_collision_is_said_before_the_cost(copied: Path) -> None:
    def collide(summary: dict[str, Any]) -> None:
        summary["measures"]["obstacle_clearance_m"] = -15.0

    content = run_content(changed(copied, collide))
    assert content.headline.startswith(
        "UAVs enter an obstacle by 15 m. Simulated for 2 s"
    )
    assert content.verdict == "bad"


def test_steps_without_a_plan_are_apart_from_those_of_the_linear_law(
    copied: Path,
) -> None:
    """Plans of the linear law that break a constraint are not planned steps."""
    with np.load(copied / "trajectory.npz") as kept:
        arrays = dict(kept)
    arrays["plan_feasible"][:, 0] = [True, False, False, False]
    arrays["plan_source"] = arrays["plan_source"].astype("U16")
    arrays["plan_source"][2:, 0] = "LINEAR"
    np.savez(copied / "trajectory.npz", **arrays)
    content = run_content(copied)
    limits = " ".join(content.limits)
    assert "At 1 of 4 steps a vehicle planned, but found no feasible plan" in limits
    assert "At 2 steps under the linear law the path breaks a constraint" in limits
    seen = " ".join(caption(content.tracks))
    assert "the 1 of 4 steps at which a vehicle planned" in seen
    assert "At 2 steps under the linear law" in seen


def test_values_are_in_view_on_a_telephone_and_what_is_cut_says_so(
    copied: Path, opened: Opened, tmp_path: Path
) -> None:
    def lengthen(summary: dict[str, Any]) -> None:
        summary["measures"]["obstacle_clearance_sampled_m"] = 8.5361e-06
        summary["measures"]["errors_of_each"] = [8.5361e-06 * k for k in range(1, 13)]

    html = run_page(changed(copied, lengthen))
    page = opened.show(html, tmp_path / "page.html", width=390)
    assert page.locator("#measures ~ .scroll td.list").count() == 1
    ends = page.eval_on_selector_all(
        "#measures ~ .scroll td:nth-child(2)",
        "all => all.map(cell => cell.getBoundingClientRect().right)",
    )
    assert max(ends) < 390 - 60
    assert page.locator("#measures ~ .hint").is_visible()  # The meanings are cut.
    page = opened.show(html, tmp_path / "page.html", width=1600)
    assert page.locator("#measures ~ .hint").is_hidden()


def test_the_time_of_each_step_is_a_table_and_a_file(
    record: Path, opened: Opened, tmp_path: Path
) -> None:
    page = opened.show(run_page(record), tmp_path / "page.html")
    with np.load(record / "trajectory.npz") as kept:
        seconds = kept["step_seconds"]
    with page.expect_download() as download:
        page.locator("summary", has_text="Time of each step").click()
        page.locator("a[download='steps.csv']").click()
    lines = Path(download.value.path()).read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("step,begins [s],length [s],")
    cells = [line.split(",") for line in lines[1:]]
    assert [float(row[1]) for row in cells] == [0.0, 0.5, 1.0, 1.5]
    assert [float(row[3]) for row in cells] == pytest.approx(seconds, rel=1e-5)
    shown = page.locator("[aria-label='Time of each step'] tbody tr")
    assert shown.count() == 4 and opened.is_silent()


def test_measures_sort_and_filter(record: Path, opened: Opened, tmp_path: Path) -> None:
    page = opened.show(run_page(record), tmp_path / "page.html")
    table = page.locator("#measures ~ .scroll table")
    table.locator("thead button", has_text="value").click()
    shown = [
        float(cell.get_attribute("data-value"))
        for cell in table.locator("td.number:not(.missing)").all()
    ]
    assert shown == sorted(shown) and len(shown) > 5
    page.locator("label.filter input").first.fill("of this scenario")
    assert table.locator("tbody tr:visible th").all_inner_texts() == ["highest"]


def test_a_single_plan_has_no_measures_of_closed_loops(copied: Path) -> None:
    def of_one_plan(summary: dict[str, Any]) -> None:
        summary["measures"]["confirmed"] = 1

    of_loop = {row.name for row in run_content(copied).measures}
    rows = run_content(changed(copied, of_one_plan)).measures
    assert of_loop - {row.name for row in rows} == set(
        words_of("problem").of_closed_loops
    )
    assert set(words_of("problem").of_closed_loops) < set(words_of("problem").measures)
    (cost,) = (row for row in rows if row.name == "cost")
    assert (cost.unit, cost.meaning.count("[cost]")) == ("cost", 0)


def test_what_the_page_says_can_be_run_again(record: Path, tmp_path: Path) -> None:
    """The command of the page, on the record's own scenario: the same measures."""
    again = tmp_path / "again"
    words = ["run", str(record / "scenario.yaml"), "--seed", "0", "--out", str(again)]
    assert main([*words, "--quiet", "--no-figures"]) == 0
    first, second = (
        json.loads((folder / "run.json").read_text(encoding="utf-8"))
        for folder in (record, again)
    )
    assert first["measures"]["cost"] == second["measures"]["cost"]


def test_markdown_and_latex_have_every_measure(record: Path) -> None:
    rows, text, latex = (
        run_content(record).measures,
        run_markdown(record),
        run_latex(record),
    )
    for row in rows:
        assert f"| {row.name.replace('_', chr(92) + '_')} | {row.text}" in text
        assert f"{row.name.replace('_', chr(92) + '_')} & {row.text}" in latex
    assert "\\<b\\>goes" in text and "<b>" not in text
    assert latex.count(r"\begin{longtable}") == latex.count(r"\end{longtable}") == 2


def test_cells_are_escaped() -> None:
    table = markdown_table(["a"], [["1 | 2\n**3** <i>"]])
    assert table.splitlines()[2] == r"| 1 \| 2 \*\*3\*\* \<i\> |"
    assert latex_text(r"\input{x} 50 % $a_b^c$") == (
        r"\textbackslash{}input\{x\} 50 \% \$a\_b\textasciicircum{}c\$"
    )


# Damaged and forged records.


def test_a_folder_without_a_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"expected a finished record with run\.json"):
        run_page(tmp_path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"no archive"])
def test_a_damaged_flight_is_refused(content: bytes, copied: Path) -> None:
    (copied / "trajectory.npz").write_bytes(content)
    with pytest.raises(RecordError, match=r"trajectory\.npz: expected a file of a rec"):
        run_page(copied)


def test_objects_are_never_unpickled(copied: Path, tmp_path: Path) -> None:
    with np.load(copied / "trajectory.npz") as kept:
        arrays = dict(kept)
    trap = tmp_path / "trapped"

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (trap,)

    arrays["times"] = np.array([Trap()], dtype=object)
    np.savez(copied / "trajectory.npz", allow_pickle=True, **arrays)
    with pytest.raises(RecordError, match="allow_pickle=False"):
        run_page(copied)
    assert not trap.exists()


@pytest.mark.parametrize(("name", "array"), [
    ("times", np.zeros(0)),
    ("dense_states", np.zeros((1, 3))),
    ("dense_times", np.zeros((2, 2))),
    ("controls", np.zeros((0, 4))),
    ("step_seconds", np.array(["a", "b", "c", "d"])),
    ("dense_times", np.full(81, np.nan)),
    ("dense_times", np.linspace(2.0, 0.0, 81)),
    ("dense_states", np.zeros((4, 81), dtype=complex)),
])  # fmt: skip
def test_arrays_that_do_not_fit_are_one_message(
    name: str, array: Any, copied: Path
) -> None:
    with np.load(copied / "trajectory.npz") as kept:
        arrays = {**kept, name: array}
    assert name != "dense_times" or arrays["dense_states"].shape[1] == 81
    np.savez(copied / "trajectory.npz", **arrays)
    with pytest.raises(RecordError, match=r"copy.*: expected .*, found"):
        run_page(copied)


@pytest.mark.parametrize("change", [
    lambda s: s.update(measures=[1]),
    lambda s: s.update(claims=[{"id": 1}]),
    lambda s: s.update(seed="$(reboot)"),
    lambda s: s.update(versions=3),
    lambda s: s.pop("status"),
    lambda s: s.pop("measures"),
    lambda s: s.update(bound="proven"),
    lambda s: s.update(bound={"value": 1.0}),
])  # fmt: skip
def test_a_forged_summary_is_one_message(change: Any, copied: Path) -> None:
    with pytest.raises(RecordError, match=r"copy: expected .* found"):
        run_page(changed(copied, change))


def test_a_record_without_a_word_on_bounds_is_an_older_one(copied: Path) -> None:
    assert "bound</" not in run_page(changed(copied, lambda s: s.pop("bound", None)))


@pytest.mark.parametrize(("most", "words"), [
    (0.25, "At most 25 % of random starts would end in optima that were not seen"),
    (1.0, "No random start ended in an optimum"),
])  # fmt: skip
def test_the_share_of_unseen_optima_is_told_if_one_was_seen(
    most: float, words: str, copied: Path
) -> None:
    starts = {"lanes": {"unseen": {"most": most}}}
    html = run_page(changed(copied, lambda s: s.update(starts=starts)))
    assert words in html and "At most 100" not in html


def test_a_page_gives_reason_and_advice_below_the_headline(copied: Path) -> None:
    def touch(summary: dict[str, Any]) -> None:
        summary.update(reason="it touches abs(u)", advice="write a < b")
        summary["status"] = "simulated to the end; fine: it touches abs(u); write a < b"

    html = run_page(changed(copied, touch))
    assert "<p>Reason: it touches abs(u).</p><p>Advice: write a &lt; b.</p>" in html
    assert "<dd>simulated to the end; fine</dd>" in html
    text = run_markdown(copied)
    assert "\n\nReason: it touches abs(u).\n\nAdvice: write a \\< b.\n" in text
    assert "Advice: write a " in run_latex(copied)


def test_a_flight_that_leaves_the_finite_numbers_is_drawn_until_then(
    copied: Path,
) -> None:
    with np.load(copied / "trajectory.npz") as kept:
        arrays = dict(kept)
    arrays["dense_states"][:, 40:] = np.nan
    arrays["dense_states"][0, 39] = np.inf
    np.savez(copied / "trajectory.npz", **arrays)
    html = run_page(copied)
    assert "The flight leaves the finite numbers" in html
    payload = re.findall(r'<script type="application/json">(.*?)</script>', html)[0]
    assert "NaN" not in payload and "Infinity" not in payload
    x = json.loads(payload)["plane"]["x"][0]
    assert x[38] is not None and x[39:] == [None] * len(x[39:])


def test_a_forged_scenario_is_one_message_or_a_sentence(copied: Path) -> None:
    """Text that is no YAML is refused; one that cannot be posed has no plans."""
    file = copied / "scenario.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("kind: problem", "kind: python"), encoding="utf-8")
    assert "Plans and bounds are not drawn" in run_page(copied)
    file.write_text("a: [", encoding="utf-8")
    with pytest.raises(SwarmstartError):
        run_page(copied)


def test_words_of_a_forger_are_text(
    copied: Path, opened: Opened, tmp_path: Path
) -> None:
    bad = "</script><script>document.title='forged'</script><img src=http://x.y/z>"

    def forge(summary: dict[str, Any]) -> None:
        summary["status"] = summary["search"] = bad
        summary["measures"][bad] = 1.0
        summary["measures"]["list"] = [1.0, None, bad]
        summary["versions"][bad] = bad
        summary["claims"][0].update(text=bad, source=bad)

    page = opened.show(run_page(changed(copied, forge)), tmp_path / "page.html")
    assert page.title() == "A point <b>goes</b> past a mast"
    assert opened.is_silent()
    assert page.locator("img[src^=http]").count() == 0


def test_a_figure_opens_at_full_size_by_the_keys_and_closes(
    record: Path, opened: Opened, tmp_path: Path
) -> None:
    page = opened.show(run_page(record), tmp_path / "page.html", width=390)
    image = page.locator("#picture-1 img")
    assert image.bounding_box()["width"] < 390
    page.locator("#open-1").focus()
    page.keyboard.press("Enter")
    box = image.bounding_box()
    assert box["width"] > 390 and 0 <= box["y"] < 100
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")  # The link that closes it comes first.
    assert image.bounding_box()["width"] < 390
    assert opened.is_silent()


def test_of_a_figure_in_several_formats_the_png_file_is_shown_and_a_sheet_wide(
    record: Path,
) -> None:
    names = ["a_sheet.png", "a_sheet.svg", "a_sheet.pdf", "b_states.svg"]
    found = pictures_of(record, names, "problem", room=10**6)
    assert [bool(picture.data) for picture in found] == [True, False]
    assert "b_states.svg is no PNG file" in found[1].missing
    assert [picture.is_wide for picture in found] == [True, False]
    (narrow,) = pictures_of(record, ["b_states.png"], "problem", room=10**6, width=150)
    (wide,) = pictures_of(record, ["a_sheet.png"], "problem", room=10**6, width=150)
    assert (narrow.width, wide.width) == (150, 300)


def test_the_colours_of_thin_lines_survive_in_a_page(
    copied: Path,
) -> None:
    """UAV 3 is purple beside bands of grey that have far more pixels."""
    image = Image.new("RGB", (400, 300), "white")
    shades = ImageDraw.Draw(image)
    for row in range(0, 300, 2):
        shades.rectangle((0, row, 400, row + 2), fill=(row // 2 + 100,) * 3)
    shades.line((0, 150, 400, 150), fill=COLOURS[3 - 1])
    image.save(copied / "figures" / "b_states.png")
    (found,) = pictures_of(copied, ["b_states.png"], "problem", room=10**6)
    with Image.open(io.BytesIO(base64.b64decode(found.data))) as shown:
        own = np.array(shown.convert("RGB").getpixel((200, 150)))
    wanted = np.array([int(COLOURS[2][k : k + 2], 16) for k in (1, 3, 5)])
    assert np.abs(own - wanted).max() < 20


def test_figures_are_read_in_their_folder_only(copied: Path) -> None:
    secret = copied / "secret.png"
    secret.write_bytes(png())
    names = ["../secret.png", str(secret), "a_sheet.png", "flight.gif", "missing.png"]
    (copied / "figures" / "b_states.png").write_bytes(b"no image")
    found = pictures_of(copied, [*names, "b_states.png"], "problem", room=10**6)
    assert [bool(picture.data) for picture in found] == [False] * 2 + [True] + [
        False
    ] * 3
    assert "flight.gif is no PNG file" in found[3].missing
    assert "cannot be read" in found[5].missing


def test_a_page_stays_below_its_limit_whatever_is_drawn(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit = 250_000
    monkeypatch.setattr(report, "PAGE_BYTES", limit)
    names = [f"z_noise_{k}.png" for k in range(12)]
    for k, name in enumerate(names):
        (copied / "figures" / name).write_bytes(png(200, 150, seed=k))
    html = run_page(changed(copied, lambda s: s.update(figures=names)))
    assert len(html.encode()) < limit
    drawn = html.count("data:image/png")
    assert 2 <= drawn < len(names)
    assert html.count("It is left out to keep the page small") == len(names) - drawn


def test_a_picture_of_too_many_pixels_is_not_opened(copied: Path) -> None:
    header = b"\x89PNG\r\n\x1a\n"
    size = (60_000).to_bytes(4, "big") * 2 + bytes([8, 0, 0, 0, 0])
    chunk = b"IHDR" + size
    bomb = (
        header + (13).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    )
    (copied / "figures" / "a_sheet.png").write_bytes(bomb)
    (found,) = pictures_of(copied, ["a_sheet.png"], "problem", room=10**6)
    assert not found.data and "cannot be read" in found.missing


def test_pictures_are_images_with_their_sizes(record: Path) -> None:
    (found,) = pictures_of(record, ["b_states.png"], "problem", room=10**6, width=300)
    content = base64.b64decode(found.data)
    assert content.startswith(b"\x89PNG")
    assert int.from_bytes(content[16:20], "big") == found.width == 300


def test_every_figure_a_kind_draws_has_a_caption() -> None:
    """By the names in the code of the kinds."""
    cases = Path(__file__).parents[5] / "cases"
    own = [f for f in cases.glob("kinds/*/figures.py") if f.parent.name in KINDS]
    files = [(file.parent.name, file) for file in own]
    files += [("problem", cases / "drawing" / "problem_figures.py"),
              ("problem", cases / "kinds/problem/figures.py")]  # fmt: skip
    found = [
        (kind, stem)
        for kind, file in files
        for stem in re.findall(
            r'(?:\(|yield )"([a-z]_[a-z_]+)"', file.read_text(encoding="utf-8")
        )
    ]
    assert len(found) > 15
    assert [pair for pair in found if pair[1] not in words_of(pair[0]).captions] == []
    assert caption_of("unknown", "own.png") == "Own."


# Many seeds.


def seeds(**more: Any) -> dict[str, Any]:
    return {
        "schema": 1, "record": "seeds", "scenario": "pendulum", "kind": "problem",
        "seeds": [0, 1, 2, 3],
        "measures": {"cost": [4.0, 1, 2, 3], "flown_cost": [1.0, None, None, 3.0]},
        "command": "swarmstart run pendulum --seeds 4", **more,
    }  # fmt: skip


def test_seeds_have_lowest_median_and_highest(opened: Opened, tmp_path: Path) -> None:
    bands = {"time": [0, 1], "states": {"angle": {"low": [0, 1], "median": [1, 2],
             "high": [2, None], "unit": "rad"}}}  # fmt: skip
    html = seeds_page(seeds(bands=bands))
    page = opened.show(html, tmp_path / "page.html", width=390)
    rows = [row.inner_text() for row in page.locator("tbody tr").all()]
    assert re.match(r"cost\t1\t2\.5\t4\t", rows[0])
    assert re.match(r"flown_cost\t1\t2\t3\t", rows[1]) and "2 of 4" in rows[1]
    assert page.locator(".strip").count() == 2
    assert page.locator("svg.band").count() == 1
    assert (
        page.locator("svg.band").get_attribute("aria-label") == "angle [rad] over time"
    )
    assert "flown_cost: lowest 1, median 2, highest 3" in html
    assert not opened.scrolls_sideways() and opened.is_silent()
    assert r"| cost | 1 | 2.5 | 4 |" in seeds_markdown(seeds())
    assert "cost & 1 & 2.5 & 4 &" in seeds_latex(seeds())


def test_a_page_of_seeds_says_what_went_wrong_and_in_which_seeds() -> None:
    fine = seeds(failures=["", "", "", ""], feasible=[True] * 4)
    assert "failed" not in seeds_markdown(fine) and 'class="bad"' not in seeds_page(
        fine
    )
    wrong = seeds(failures=["", "", "cut", ""], feasible=[True, False, False, True])
    html = seeds_page(wrong)
    assert "1 of 4 failed (seed 2)" in html and "no feasible plan (seed 1)" in html
    assert '<p class="bad">4 runs' in html


def test_seeds_of_single_plans_have_no_measures_of_closed_loops() -> None:
    loop = {"cost": [1, 2, 3, 4], "linear_steps": [0] * 4, "confirmed": [None] * 4}
    plans = loop | {"confirmed": [1, 0, 1, 1]}
    assert "linear_steps" in seeds_page(seeds(kind="problem", measures=loop))
    assert "linear_steps" not in seeds_page(seeds(kind="problem", measures=plans))


def test_a_page_of_seeds_says_how_the_runs_ended() -> None:
    good = "simulated to the end; the plan is fine: stationary"
    status = [good, "simulated to the end; no answer", None, good]
    for text in (
        seeds_page(seeds(status=status)),
        seeds_markdown(seeds(status=status)),
    ):
        assert "seeds 0, 3: the plan is fine: stationary" in text
        assert "seed 1: no answer" in text
    many = seeds_markdown(seeds(seeds=[*range(15)], status=[*"abcdefghijklmno"],
                                measures={}))  # fmt: skip
    assert "seed 9: j" in many and "- and 5 more" in many


@pytest.mark.parametrize("wrong", [
    {"record": "run"}, {"schema": 2}, {"seeds": 3}, {"measures": {"cost": [1.0]}},
    {"bands": {"time": [0], "states": {"x": {"low": [0], "median": [], "high": [0]}}}},
    {"measures": 3},
])  # fmt: skip
def test_other_content_than_that_of_seeds_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(RecordError, match="expected the content of `run --seeds`"):
        seeds_page(seeds(**wrong))


def test_a_strip_is_to_scale_and_shades_what_is_asked() -> None:
    """Dots keep the ratios of the values; the side below the bound is shaded."""
    drawn = strip([1.0, 2.0, 4.0], bound=3.0, relation="<=")
    dots = re.findall(r'class="dots" d="([^"]*)"', drawn)[0]
    x = [float(found) for found in re.findall(r"M([\d.]+)", dots)]
    assert (x[2] - x[1]) / (x[1] - x[0]) == pytest.approx(2.0, rel=0.01)
    bound = float(re.findall(r'class="bound" d="M([\d.]+) ', drawn)[0])
    assert bound == pytest.approx((x[1] + x[2]) / 2, abs=0.2)
    assert f'class="asked" d="M8 0H{bound:g}V28H8z"' in drawn
    assert "3 values from 1 to 4, median 2; asked: &lt;= 3." in drawn
    assert strip([None, float("nan"), "a"]) == ""
    assert "2 not defined" in strip([5.0, None, [1]])
