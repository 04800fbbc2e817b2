"""The command `replicate` as a user types it; the table of docs/chapter/index.md."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from swarmstart.cases.commands.actions.replicate import markdown
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.drawing.report.pictures import PAGE_BYTES
from swarmstart.tests.browser import chromium

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

ROOT = Path(__file__).parents[2]
PAGE, NOTED = (ROOT / "docs" / "chapter" / name for name in ("index.md", "claims.json"))
CLAIMS, FIGURES = 25, 8
PICTURES = 8 * 3
"""A sheet and 2 more figures a run; the formation flights have no dual mode."""
SOME = (8, 9, 18, 19, 24)
"""Claims of each kind of scenario and a computed one, in the time of `make test`."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `replicate --quick` leaves."""
    root = tmp_path_factory.mktemp("replication")
    assert main(["replicate", "--quick", "--quiet", "--out", str(root)]) == 0
    return root


@pytest.fixture(scope="module")
def record(folder: Path) -> Any:
    return json.loads((folder / "replication.json").read_text(encoding="utf-8"))


def test_every_claim_is_judged_or_says_why_not(record: Any) -> None:
    assert [claim["id"] for claim in record["claims"]] == list(range(1, CLAIMS + 1))
    for claim in record["claims"]:
        assert claim["as_expected"] and claim["source"] and claim["because"]
        if claim["verdict"] == "not judged":
            assert any("needed" in part["test"] for part in claim["parts"])
        else:
            assert claim["verdict"] == claim["expected"]
        assert not any(part["failures"] for part in claim["parts"])


def test_a_second_call_reads_what_the_first_has_left(
    folder: Path, command: Command
) -> None:
    cells = {file: file.stat().st_mtime_ns for file in folder.glob("cells/*/cell.json")}
    said = command("replicate", "--quick", "--quiet", "--out", folder)
    assert said.code == 0
    assert f"{len(cells)} runs, one seed each" in said.out
    assert cells == {file: file.stat().st_mtime_ns for file in cells}
    assert len(list(folder.glob("cells/*"))) == len(cells)


def test_a_dry_run_tells_what_is_kept_and_what_is_missing(
    folder: Path, command: Command
) -> None:
    said = command("replicate", "--quick", "--dry-run", "--out", folder)
    number = len(list(folder.glob("cells/*")))
    assert said.out == f"{number} runs, {number} kept from before, 0 to do\n"
    more = command("replicate", "--dry-run", "--out", folder)
    assert re.search(rf", {number} kept from before, \d+ to do\nabout \d+ s", more.out)


def test_one_claim_alone_takes_its_runs_only(folder: Path, command: Command) -> None:
    said = command(
        "replicate", "--only", "8", "--only", "24", "--json", "--quiet", "--out", folder
    )
    content = json.loads(said.out)
    assert [claim["id"] for claim in content["claims"]] == [8, 24]
    assert content["runs"] == 2
    assert (folder / "replication-8-24.html").exists()  # Not in place of the whole.


def test_runs_that_fail_are_no_replication(folder: Path, command: Command) -> None:
    """A kept failure: nothing is judged, and message and exit code report it."""
    (mark,) = (
        file
        for file in folder.glob("cells/*/cell.json")
        if "de_absorption" in file.read_text()
    )
    kept = mark.read_text()
    mark.write_text(json.dumps({**json.loads(kept), "failure": "no luck"}))
    said = command("replicate", "--only", "24", "--quiet", "--out", folder)
    mark.write_text(kept)
    assert said.code == 3
    assert "not judged" in said.out and "a run failed: no luck" in said.out


def test_a_claim_that_is_none_is_refused(command: Command) -> None:
    said = command("replicate", "--only", "99")
    assert said.code == 2
    assert "expected --only to be a claim from 1 to 25, found 99" in said.err


def test_the_page_holds_every_claim_and_every_figure(folder: Path) -> None:
    page = (folder / "replication.html").read_text(encoding="utf-8")
    for number in range(1, CLAIMS + 1):
        assert f'id="claim-{number}"' in page
    assert len(re.findall(r"<h4 [^>]*>Fig\. ", page)) == FIGURES
    assert page.count('src="data:image/png;base64,') == PICTURES
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page)
    assert "url(" not in page and "@import" not in page
    assert len(page.encode()) < PAGE_BYTES and "left out" not in page


def test_the_page_opens_without_an_error_and_without_a_network(folder: Path) -> None:
    said: list[str] = []
    asked: list[str] = []
    with chromium() as opened:
        page = opened.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto((folder / "replication.html").as_uri())
        assert page.locator("section.claim").count() == CLAIMS
        widths = page.eval_on_selector_all("img", "all => all.map(i => i.naturalWidth)")
    assert all(width > 100 for width in widths) and len(widths) == PICTURES
    assert said == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []


@pytest.fixture(scope="module")
def noted() -> Any:
    """The results of the whole replication, every seed."""
    return json.loads(NOTED.read_text(encoding="utf-8"))


def test_the_page_has_the_table_of_all_seeds(noted: Any) -> None:
    table = [line for line in PAGE.read_text("utf-8").splitlines() if "|" in line]
    expected = markdown(noted).splitlines()
    begin = table.index(expected[0])
    assert table[begin : begin + len(expected)] == expected
    assert not noted["quick"] and "not judged" not in "".join(expected)


def test_what_is_noted_is_found_again(noted: Any, record: Any) -> None:
    """The first seed of every part of every claim, within the part's tolerance."""
    require_found_again(noted["claims"], record["claims"])


def test_some_of_what_is_noted_is_found_again(noted: Any, tmp_path: Path) -> None:
    only = [word for number in SOME for word in ("--only", str(number))]
    words = ["replicate", "--quick", *only, "--quiet", "--out", str(tmp_path)]
    assert main(words) == 0
    (file,) = tmp_path.glob("replication*.json")
    found = json.loads(file.read_text(encoding="utf-8"))["claims"]
    assert [claim["id"] for claim in found] == list(SOME)
    assert all(claim["as_expected"] for claim in found)
    then = [claim for claim in noted["claims"] if claim["id"] in SOME]
    require_found_again(then, found)
    page = file.with_suffix(".html").read_text(encoding="utf-8")
    assert len(page.encode()) < PAGE_BYTES
    assert all(claim["text"] in page for claim in found)


def require_found_again(noted: Any, found: Any) -> None:
    for then, now in zip(noted, found, strict=True):
        assert (then["text"], then["source"]) == (now["text"], now["source"])
        for old, new in zip(then["parts"], now["parts"], strict=True):
            for key in ("command", "against", "asked", "reading", "basis", "text"):
                assert old[key] == new[key], then["id"]
            if old["tolerance"] is None:
                continue
            before, again = old["values"][0], new["values"][0]
            if before is not None:  # It never settles, say: then not now either.
                before = pytest.approx(before, rel=old["tolerance"], abs=1e-12)
            assert again == before, (then["id"], old["text"])


@pytest.mark.parametrize("name", ["replication-24.json", "replication-24.html"])
def test_a_file_of_another_program_is_refused_before_any_work(
    name: str, command: Command, tmp_path: Path
) -> None:
    (tmp_path / name).write_text("mine")
    said = command("replicate", "--only", "24", "--quiet", "--out", tmp_path)
    assert (said.code, said.out) == (2, "")
    assert "found another file; choose another --out" in said.err
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"
