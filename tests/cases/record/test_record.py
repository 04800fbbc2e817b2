from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import key_of
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.record import record as record_module
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.partial import save_partial
from swarmstart.cases.record.record import (
    OccupiedFolderError,
    Recording,
    UnknownFormatError,
    kept_figures,
    require_comparisons,
    require_own,
    require_own_seeds,
    withdraw,
)
from swarmstart.tests.cases.record.test_partial import flight


def key(*assignments: str, seed: int = 0, name: str = "formation_v") -> str:
    return key_of(resolve(read_document(name), assignments=assignments), seed)


def test_the_key_depends_on_what_determines_the_result() -> None:
    keys = [
        key(),
        key(seed=1),
        key("steps=59"),
        key("search.size=21"),
        key("leader.x_m=31"),
        key("polish=ipopt"),
        key(name="formation_obstacle"),
    ]
    assert len(set(keys)) == len(keys)
    assert all(len(k) == 16 and set(k) <= set("0123456789abcdef") for k in keys)


def test_the_key_does_not_depend_on_what_is_only_told() -> None:
    assert key("claims=[]", "title=Mine", "source=here") == key()
    assert key("leader.x_m=60/2", "steps=60") == key()


def test_the_key_depends_on_the_code_that_makes_the_numbers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    before = key()
    for folder in ("cases", "ocp", "machine_code"):
        (tmp_path / folder).mkdir()
    (tmp_path / "cases" / "record").mkdir()
    file = tmp_path / "cases" / "record" / "record.py"
    file.touch()
    monkeypatch.setattr(record_module, "__file__", str(file))
    keys = {before}
    for name in ("ocp/a.py", "ocp/b.py", "machine_code/numba_kernels.py"):
        for content in ("x = 1", "x = 2"):
            (tmp_path / name).write_text(content)
            record_module.environment.cache_clear()
            keys.add(key())
    record_module.environment.cache_clear()
    assert len(keys) == 7
    monkeypatch.undo()
    assert key() == before


def partial(folder: Path, name: str) -> None:
    save_partial(folder, name, flight(1), np.random.default_rng(0).bit_generator.state)


def finished(folder: Path, name: str) -> None:
    content = {"key": name, "figures": ["a.png", "b.png"], "documents": ["c.json"]}
    (folder / "run.json").write_text(json.dumps(content))
    (folder / "scenario.yaml").write_text("steps: 3\n")


def test_an_empty_folder_and_the_record_of_the_same_run_are_own(tmp_path: Path) -> None:
    require_own(tmp_path, "k", "steps: 3\n")
    (tmp_path / ".run.json.7.tmp").touch()  # Left by a kill.
    require_own(tmp_path, "k", "steps: 3\n")
    partial(tmp_path, "k")
    require_own(tmp_path, "k", "steps: 3\n")
    finished(tmp_path, "k")
    (tmp_path / "notes.txt").touch()
    require_own(tmp_path, "k", "steps: 3\n")


def test_anything_else_is_refused(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "scenario.yaml").write_text("# mine\n")
    with pytest.raises(OccupiedFolderError, match=r"other files \('scenario.yaml'\)"):
        require_own(mine, "k", "# mine\n")
    other = tmp_path / "other"
    other.mkdir()
    finished(other, "another")
    with pytest.raises(OccupiedFolderError, match="the record of another run"):
        require_own(other, "k", "steps: 3\n")
    partial(other, "k")  # Of a run that was forced into the folder.
    with pytest.raises(OccupiedFolderError, match="the record of another run"):
        require_own(other, "k", "steps: 3\n")
    unknown = tmp_path / "unknown"
    unknown.mkdir()
    for content in ("{}", "[]", "no JSON", "5"):
        (unknown / "run.json").write_text(content)
        with pytest.raises(OccupiedFolderError, match="the record of another run"):
            require_own(unknown, "k", "steps: 3\n")


def test_runs_over_seeds_go_on_in_their_own_folder_only(tmp_path: Path) -> None:
    folder = tmp_path / "seeds"
    require_own_seeds(folder, ["k0", "k1"])  # There is no such folder yet.
    (folder / "cells").mkdir(parents=True)
    require_own_seeds(folder, ["k0", "k1"])  # Interrupted before its first run ended.
    (folder / "cells" / "k1").mkdir()
    require_own_seeds(folder, ["k0", "k1"])
    with pytest.raises(OccupiedFolderError, match=r"other files \('cells'\)"):
        require_own_seeds(folder, ["other"])
    (folder / "seeds.json").write_text('{"key": "k0"}')
    (folder / "notes.txt").touch()
    require_own_seeds(folder, ["k0", "k1", "k2"])  # With more seeds.
    another = r"the record of another run \('cells', 'notes.txt', 'seeds.json'\)"
    with pytest.raises(OccupiedFolderError, match=another):
        require_own_seeds(folder, ["other", "k1"])


@pytest.mark.parametrize("mark", ["run.json", "comparison.json", "replication.json"])
def test_runs_over_seeds_are_not_mixed_with_other_records(
    mark: str, tmp_path: Path
) -> None:
    (tmp_path / mark).write_text('{"key": "k0"}')
    with pytest.raises(OccupiedFolderError, match="the record of another run"):
        require_own_seeds(tmp_path, ["k0"])


def test_comparisons_share_a_folder_with_each_other_only(tmp_path: Path) -> None:
    folder = tmp_path / "compare"
    require_comparisons(folder)
    (folder / "cells" / "0123456789abcdef").mkdir(parents=True)
    require_comparisons(folder)  # Interrupted before its end.
    (folder / "cells" / "blood").mkdir()
    with pytest.raises(OccupiedFolderError, match=r"other files \('cells'\); choose"):
        require_comparisons(folder)
    (folder / "results.csv").touch()
    require_comparisons(folder)
    (tmp_path / "seeds.json").touch()
    with pytest.raises(OccupiedFolderError, match=r"another run .*another --out$"):
        require_comparisons(tmp_path)


def test_a_scenario_that_was_changed_is_refused(tmp_path: Path) -> None:
    finished(tmp_path, "k")
    (tmp_path / "scenario.yaml").write_text("steps: 3 # as always\n")
    with pytest.raises(OccupiedFolderError, match="a changed scenario"):
        require_own(tmp_path, "k", "steps: 3\n")


def test_steps_that_cannot_be_read_are_an_error(tmp_path: Path) -> None:
    partial(tmp_path, "k")
    (tmp_path / "partial.json").write_text("{")
    with pytest.raises(RecordError, match="to start again"):
        require_own(tmp_path, "k", "steps: 3\n")


def test_a_withdrawn_record_takes_along_what_it_names_and_nothing_else(
    tmp_path: Path,
) -> None:
    finished(tmp_path, "k")
    names = ("a.png", "mine.png")
    (tmp_path / "figures" / "b.png").mkdir(parents=True)  # Not what was drawn.
    for name in names:
        (tmp_path / "figures" / name).touch()
    for name in ("a.png", "c.json"):
        (tmp_path / name).touch()
    figures = tmp_path / "figures"
    assert kept_figures(tmp_path, "k") == [figures / "a.png", figures / "b.png"]
    assert kept_figures(tmp_path, "other") is None
    withdraw(tmp_path)
    left = {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*")}
    assert left == {
        *("a.png", "figures", "figures/b.png", "figures/mine.png", "scenario.yaml")
    }


@pytest.mark.parametrize("formats", [("png", "gif"), ("svg", "svg"), ()])
def test_a_format_in_which_figures_cannot_be_written_is_refused(
    formats: tuple[str, ...], tmp_path: Path
) -> None:
    with pytest.raises(UnknownFormatError, match="expected some of png, svg, pdf"):
        Recording(folder=tmp_path, figure_formats=formats)
    assert Recording(folder=tmp_path).figure_formats == ("png",)
