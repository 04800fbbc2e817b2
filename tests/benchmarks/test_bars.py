"""Bars are claims: their files can be judged, and a run of few steps is."""

from pathlib import Path

import pytest

from swarmstart.benchmarks import bars
from swarmstart.benchmarks.bar_measures import fly
from swarmstart.benchmarks.faults import ROOT
from swarmstart.cases.campaign.studies.replication import cells_of, claims_in, planned

FILES = sorted((ROOT / "benchmarks" / "claims").glob("*.yaml"))
SHORT = """
schema: 1
flown_by: "swarmstart.benchmarks.bar_measures:fly"
page: A page.
claims:
  - id: 1
    text: a bar
    common: {scenario: formation_v, variant: corrected, seeds: 1,
             when: {steps: 2, search.size: 5, budget.evaluations: 10}}
    parts:
      - {measure: wall_s, relation: ">", bound: 0}
      - {measure: "tail_error_by_uav_m[0]", relation: ">=", bound: 0}
      - {measure: closed_loop_cost, beside: true}
  - id: 2
    text: another
    parts:
      - {scenario: formation_v, variant: corrected, seeds: 1, when: {steps: 1},
         measure: steps_worse_than_search, bound: 1, width: WIDTH}
"""


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_bar_has_runs_and_its_page(file: Path) -> None:
    found = claims_in(file.read_bytes(), name=file.name)
    assert file.name in found.page
    assert [claim.id for claim in found.claims] == [*range(1, len(found.claims) + 1)]
    for claim in found.claims:
        for part in planned(found, claim, seeds=1):
            assert list(cells_of([part]))
            assert part.part.beside or part.claim.bound is not None


@pytest.mark.parametrize(("width", "code"), [("1.0", 0), ("0.5", 3)])
def test_missed_bar_is_the_exit_code(
    width: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, page = tmp_path / "few.yaml", tmp_path / "page.md"
    file.write_text(SHORT.replace("WIDTH", width), encoding="utf-8")
    arguments = [str(file), "--short", "--out", str(tmp_path / "runs"), "--workers=1"]
    assert bars.main([*arguments, "--write", str(page)]) == code
    lines = page.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "A page." and len(lines) == 1 + 2 + 2
    assert "`wall_s > 0`<br>" in lines[3] and "<br>`closed_loop_cost`" in lines[3]
    assert f"± {float(width):g}" in lines[4]
    assert ("does not hold" in lines[4]) is (code == 3)
    assert ("missed: another" in capsys.readouterr().err) is (code == 3)


def test_lists_are_measured_entry_by_entry(tmp_path: Path) -> None:
    found = claims_in(SHORT.replace("WIDTH", "0").encode(), name="few.yaml")
    (cell,) = cells_of(planned(found, found.claims[0], seeds=1)[:1])
    measures = fly(cell.job, tmp_path)["measures"]
    whole = measures["tail_error_by_uav_m"]
    assert [measures[f"tail_error_by_uav_m[{k}]"] for k in range(len(whole))] == whole
