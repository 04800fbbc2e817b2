"""Findings of measured pages are kept, and the index quotes each of them."""

from pathlib import Path

import pytest

from swarmstart.benchmarks.faults import ROOT
from swarmstart.benchmarks.tables import page_options, publish

MEASURED = ROOT / "docs" / "measured"
NEW = "# Title\n\nMade by `a benchmark`.\n\n"


def written(page: Path, above: str) -> str:
    publish(["| new |"], page_options("").parse_args(["--write", str(page)]), above)
    return page.read_text("utf-8")


def test_findings_between_title_and_origin_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    assert written(page, NEW) == f"{NEW}| new |\n"
    assert "write the finding below its title" in capsys.readouterr().err
    page.write_text("# Old\n\nX is fast.\n\nAnd more.\n\nMade by `it`.\n\n| old |\n")
    expected = (
        "# Title\n\nX is fast.\n\nAnd more.\n\nMade by `a benchmark`.\n\n| new |\n"
    )
    assert written(page, NEW) == expected
    assert "compare them with the new numbers" in capsys.readouterr().err


def test_computed_findings_replace_old_ones(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nOld.\n\nMade by `it`.\n")
    computed = "# Title\n\nComputed.\n\nMade by `it`.\n\n"
    assert written(page, computed) == f"{computed}| new |\n"


def test_the_index_quotes_the_finding_of_each_page() -> None:
    if not MEASURED.is_dir():
        pytest.skip("an installed package has no documentation")
    index = (MEASURED / "index.md").read_text("utf-8")
    for page in sorted(MEASURED.glob("*.md")):
        if page.name != "index.md":
            finding = page.read_text("utf-8").split("\n\n")[1]
            assert f"]({page.name}) | {' '.join(finding.split())} |" in index
