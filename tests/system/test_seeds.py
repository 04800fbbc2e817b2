"""`run --seeds` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

SMALL = (
    *("run", "formation_v", "--seeds", "3", "--set", "steps=3"),
    *("--set", "budget.evaluations=200", "--quiet"),
)


def test_every_measure_has_lowest_median_and_highest_and_figures_show_bands(
    command: Command, tmp_path: Path
) -> None:
    never = ("--fail-on", "closed_loop_cost > 1e9")
    said = command(*SMALL, "--out", tmp_path, "--measures", *never)
    assert said.code == 0
    assert "(formation_v): 3 runs, seeds 0 to 2; " in said.out
    content = json.loads((tmp_path / "seeds.json").read_text())
    line = next(r for r in said.out.splitlines() if r.startswith("  closed_loop_cost"))
    values = content["measures"]["closed_loop_cost"]
    assert "3 of 3 runs found feasible plans. Not settled in any run." in said.out
    assert line.split()[1:4] == [f"{v:.6g}" for v in sorted(values)]
    assert len(set(values)) == 3
    assert {file.name for file in (tmp_path / "figures").iterdir()} == {
        "bands.png",
        "spread.png",
    }
    words = ["swarmstart", *SMALL]
    assert content["command"].startswith(" ".join(words[:5]))


def test_a_gate_that_fails_in_one_run_fails_all_and_one_seed_is_that_of_run(
    command: Command, tmp_path: Path
) -> None:
    every = command(*SMALL, "--out", tmp_path / "a", "--json", "--no-figures")
    costs = json.loads(every.out)["measures"]["closed_loop_cost"]
    gate = f"closed_loop_cost >= {max(costs)}"
    failed = command(*SMALL, "--out", tmp_path / "a", "--fail-on", gate)
    assert failed.code == 3
    assert failed.err.count("gate failed") == 1
    seed = costs.index(max(costs))
    assert f"seed {seed}: closed_loop_cost" in failed.err
    one = command(
        *(SMALL[0], SMALL[1], "--seed", str(seed), *SMALL[4:]),
        *("--json", "--no-figures", "--out", tmp_path / "b"),
    )
    assert json.loads(one.out)["measures"]["closed_loop_cost"] == max(costs)


def test_a_file_of_that_name_by_another_program_is_refused(
    command: Command, tmp_path: Path
) -> None:
    (tmp_path / "seeds.json").write_text("mine")
    said = command(*SMALL, "--out", tmp_path)
    assert said.code == 2
    assert "expected runs over seeds, found another file" in said.err
    assert (tmp_path / "seeds.json").read_text() == "mine"


POINT = """\
kind: problem
states: {x: {start: 1, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: x**2 + u**2
prediction: {horizon_s: 1, intervals: 4}
search: {name: none}
lanes: 0
"""


def test_a_folder_of_another_record_is_refused_without_force(
    command: Command, tmp_path: Path
) -> None:
    file, out = tmp_path / "point.yaml", tmp_path / "out"
    file.write_text(POINT)
    quiet = ("run", file, "--quiet", "--no-figures")
    seeds = (*quiet, "--seeds", "2", "--workers", "1")
    assert command(*seeds, "--out", out).code == 0
    cells = {f: f.stat().st_mtime_ns for f in out.glob("cells/*/cell.json")}
    more = command(*quiet, "--seeds", "3", "--workers", "1", "--out", out)
    assert more.code == 0 and len(cells) == 2
    assert cells == {f: f.stat().st_mtime_ns for f in cells}
    before = (out / "seeds.json").read_bytes()
    other = (*seeds, "--set", "prediction.horizon_s=2", "--out")
    said = command(*other, out)
    assert (said.code, said.out) == (2, "")
    assert "an empty folder or the record of this run, found the record of" in said.err
    assert (out / "seeds.json").read_bytes() == before
    assert len([*out.glob("cells/*")]) == 3
    assert command(*other, out, "--force").code == 0
    assert (out / "seeds.json").read_bytes() != before
    single = tmp_path / "single"
    assert command(*quiet, "--out", single).code == 0
    names = {each.name for each in single.iterdir()}
    said = command(*seeds, "--out", single)
    assert said.code == 2 and "found the record of another run ('run.json'" in said.err
    assert {each.name for each in single.iterdir()} == names


def test_one_seed_and_many_exclude_each_other(command: Command) -> None:
    said = command("run", "formation_v", "--seed", "1", "--seeds", "3")
    assert said.code == 2
    assert "not allowed with" in said.err
