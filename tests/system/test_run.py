"""`swarmstart run`, as a user types it, on tiny flights."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from PIL import Image

from swarmstart.cases.campaign.running import run as run_module
from swarmstart.cases.campaign.running.finished_run import key_of
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.scenario import read_document, resolve, shipped
from swarmstart.cases.kinds.formation_flight.names import MEASURES
from swarmstart.terminal_set.check import main as check

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

TINY = ("--set", "steps=2", "--set", "budget.evaluations=40", "--quiet")
STATES, CONTROLS, UAVS, INTERVALS, SUBSTEPS = 20, 10, 5, 8, 20
GENERATIONS = 2


def arrays(folder: Path) -> dict[str, Any]:
    with np.load(folder / "trajectory.npz", allow_pickle=False) as file:
        return dict(file)


def assert_same_bits(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for name, values in one.items():
        if name != "step_seconds":
            assert values.tobytes() == other[name].tobytes(), name


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Any]]:
    """One run with figures, and what it printed."""
    folder = tmp_path_factory.mktemp("flown") / "deep" / "er"
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["run", "formation_v", *TINY, "--out", str(folder), "--json"])
    assert (code, err.getvalue()) == (0, "")
    yield folder, json.loads(out.getvalue())


def test_json_is_one_object_with_all_the_documented_keys(
    flown: tuple[Path, Any],
) -> None:
    folder, told = flown
    documented = {
        *("schema", "scenario", "variant", "seed", "search", "polish", "status"),
        *("measures", "claims", "evaluations", "wall_s", "out"),
    }
    assert documented <= told.keys()
    assert told["schema"] == 1 and told["scenario"] == "formation_v"
    assert (told["variant"], told["seed"]) == ("corrected", 0)
    assert (told["search"], told["polish"]) == ("cpso", "none")
    assert told["out"] == str(folder)
    assert told["measures"].keys() == MEASURES.keys()
    assert told["evaluations"] == told["measures"]["evaluations"] == 2 * UAVS * 40
    claim_keys = {"id", "text", "source", "measured", "relation", "bound", "holds"}
    assert told["claims"] and all(claim_keys <= c.keys() for c in told["claims"])
    assert told["measures"]["settle_time_s"] is None  # 2 s are too few


def test_the_folder_holds_the_documented_files_and_nothing_else(
    flown: tuple[Path, Any],
) -> None:
    folder, told = flown
    assert {file.name for file in folder.iterdir()} == {
        *("scenario.yaml", "trajectory.npz", "steps.csv", "run.json", "figures"),
        "certificate.json",
    }
    assert json.loads((folder / "run.json").read_text()) == told
    drawn = {file.name for file in (folder / "figures").iterdir()}
    assert drawn == set(told["figures"]) and len(drawn) == 4
    assert told["documents"] == ["certificate.json"]


def test_the_certificate_of_a_flight_is_proven_again(
    flown: tuple[Path, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("flint")
    folder, told = flown
    file = folder / "certificate.json"
    assert json.loads(file.read_text())["alpha"] == told["measures"]["terminal_level"]
    assert check(["--seconds", "60", str(file)]) == 0
    assert "V decreases over a hold of 1 s" in capsys.readouterr().out


def test_the_recorded_scenario_is_the_same_run(flown: tuple[Path, Any]) -> None:
    folder, _ = flown
    recorded = resolve(read_document(str(folder / "scenario.yaml")))
    sets = [text for text in TINY if "=" in text]
    original = resolve(read_document("formation_v"), assignments=sets)
    assert recorded.settings == original.settings
    assert key_of(recorded, 0) == key_of(original, 0)


def test_the_trajectory_has_the_documented_arrays(flown: tuple[Path, Any]) -> None:
    found = {name: values.shape for name, values in arrays(flown[0]).items()}
    assert found == {
        "times": (3,),
        "states": (STATES, 3),
        "controls": (CONTROLS, 2),
        "dense_times": (2 * SUBSTEPS + 1,),
        "dense_states": (STATES, 2 * SUBSTEPS + 1),
        "step_seconds": (2,),
        "linear": (2,),
        "plan_controls": (2, UAVS, 2, INTERVALS),
        "plan_start": (2, UAVS, 4),
        **{
            f"plan_{name}": (2, UAVS)
            for name in (
                *("cost", "violation", "feasible", "source", "evaluations"),
                *("polish", "start_excess", "is_new"),
            )
        },
        "search_cost": (2, UAVS),
        "search_violation": (2, UAVS),
        "search_history": (2, UAVS, GENERATIONS),
        "search_evaluations": (2, UAVS, GENERATIONS),
        "search_violations": (2, UAVS, GENERATIONS),
        "state_names": (4 * UAVS,),
        "control_names": (2 * UAVS,),
    }


def test_the_flown_controls_are_the_first_of_the_plans(flown: tuple[Path, Any]) -> None:
    record = arrays(flown[0])
    first = record["plan_controls"][:, :, :, 0].reshape(2, CONTROLS).T
    assert np.array_equal(record["controls"], first)
    assert np.array_equal(record["states"], record["dense_states"][:, ::SUBSTEPS])


def test_figures_are_png_and_not_blank(flown: tuple[Path, Any]) -> None:
    for file in (flown[0] / "figures").iterdir():
        assert file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        with Image.open(file) as image:
            colours = image.convert("RGB").getcolors(1 << 24)
        assert colours is not None and len(colours) > 50, file.name


def test_the_same_seed_gives_the_same_bits_and_another_does_not(
    flown: tuple[Path, Any], command: Command, tmp_path: Path
) -> None:
    first = arrays(flown[0])
    for seed in (0, 1):
        said = command(
            *("run", "formation_v", *TINY, "--no-figures"),
            *("--out", tmp_path / str(seed), "--seed", seed),
        )
        assert (said.code, said.err) == (0, "")
    assert_same_bits(first, arrays(tmp_path / "0"))
    assert not np.array_equal(first["controls"], arrays(tmp_path / "1")["controls"])


def test_no_figures_draws_none_and_the_report_names_the_record(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = command("run", "formation_v", *TINY, "--no-figures")
    assert (said.code, said.err) == (0, "")
    (folder,) = (tmp_path / "results" / "formation_v").iterdir()
    assert said.out.splitlines()[-1] == f"Record: {folder.relative_to(tmp_path)}"
    assert not (folder / "figures").exists()
    assert "Not settled: " in said.out
    # The claims are of flights of 60 steps.
    assert "does not hold" not in said.out and "a run with steps = 60" in said.out


def test_print_config_is_a_scenario_that_prints_itself(
    command: Command, tmp_path: Path
) -> None:
    for variant in ("literal", "corrected"):
        said = command(
            *("run", "formation_obstacle", "--variant", variant, "--print-config")
        )
        assert (said.code, said.err) == (0, "")
        file = tmp_path / f"{variant}.yaml"
        file.write_text(said.out)
        assert command("run", file, "--print-config").out == said.out
        assert command("check", file).code == 0


@pytest.mark.parametrize(
    ("condition", "code"),
    [
        ("tail_error_m > 1", 3),
        ("tail_error_m < 1", 0),
        ("settle_time_s == null", 3),
        ("settle_time_s > 10", 3),  # It never settles: later than any time.
        ("settle_time_s <= 10", 0),
        ("tail_error_by_uav_m > 24", 3),
        ("tail_error_by_uav_m > 1e3", 0),
    ],
)
def test_fail_on_leaves_with_3_where_it_holds(
    condition: str, code: int, command: Command, tmp_path: Path
) -> None:
    said = command(
        *("run", "formation_v", *TINY, "--no-figures", "--out", tmp_path / "r"),
        *("--set", "steps=1"),
        *("--fail-on", condition, "--json"),
    )
    assert said.code == code
    assert json.loads(said.out)["status"].startswith("simulated to the end")
    if code:
        assert said.err.startswith("swarmstart: gate failed: ")
        assert condition.split(maxsplit=1)[0] in said.err
    else:
        assert said.err == ""


def test_a_condition_on_what_is_not_defined_is_not_judged_and_says_so(
    command: Command, tmp_path: Path
) -> None:
    said = command(
        *("run", "formation_v", *TINY, "--no-figures", "--out", tmp_path / "r"),
        *("--set", "steps=1", "--fail-on", "lyapunov_ratio_max > 0", "--json"),
    )
    assert said.code == 0
    assert said.err == (
        "swarmstart: --fail-on not judged: lyapunov_ratio_max is not defined: "
        "no step was under the linear law\n"
    )


def test_a_claim_that_is_a_gate_and_fails_leaves_with_3(
    command: Command, tmp_path: Path
) -> None:
    said = command(
        *("run", "formation_v", *TINY, "--no-figures", "--out", tmp_path / "r"),
        *("--set", "claims.0.gate=true", "--set", "claims.0.when={steps: 2}"),
    )
    assert said.code == 3
    assert said.err.startswith("swarmstart: gate failed: 1: With chaotic PSO")


def test_no_feasible_plan_at_any_step_leaves_with_4(
    command: Command, tmp_path: Path
) -> None:
    unavoidable = "obstacles=[{x_m: 85, y_m: 65, radius_m: 79}]"
    said = command(
        *("run", "formation_v", *TINY, "--no-figures", "--out", tmp_path / "r"),
        *("--set", unavoidable, "--json"),
    )
    told = json.loads(said.out)
    assert said.code == 4
    assert told["status"] == "simulated to the end; no step found a feasible plan"
    assert told["measures"]["infeasible_steps"] == 2


@pytest.mark.parametrize("blocked", ["out", "out/in/it"])
def test_a_folder_that_cannot_be_written_leaves_with_5_before_the_flight(
    blocked: str, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("flown")

    monkeypatch.setattr(run_module, "fly", never)
    (tmp_path / "out").write_text("mine")
    said = command("run", "formation_v", *TINY, "--out", tmp_path / blocked)
    assert (said.code, said.out) == (5, "")
    assert said.err.startswith(f"swarmstart: {tmp_path / blocked}")
    assert (
        "expected a folder to write files to" in said.err and said.err.count("\n") == 1
    )
    assert (tmp_path / "out").read_text() == "mine"


METHODS = [("ga", "none"), ("de", "none"), ("pso", "none"), ("random", "none")]


@pytest.mark.parametrize(("search", "polish"), [*METHODS, ("none", "ipopt")])
def test_every_search_and_the_polish_alone_fly(
    search: str, polish: str, command: Command, tmp_path: Path
) -> None:
    said = command(
        *("run", "formation_v", "--search", search, "--polish", polish, *TINY),
        *("--set", "budget.evaluations=60", "--set", "steps=1"),
        *("--no-figures", "--out", tmp_path / "r", "--json"),
    )
    assert (said.code, said.err) == (0, "")
    told = json.loads(said.out)
    assert (told["search"], told["polish"]) == (search, polish)
    record = arrays(tmp_path / "r")
    expected = {"POLISH"} if search == "none" else {"SEARCH"}
    assert set(record["plan_source"].ravel()) == expected
    assert np.isnan(record["search_cost"]).all() == (search == "none")


def test_polishing_is_never_worse_than_the_search(
    command: Command, tmp_path: Path
) -> None:
    said = command(
        *("run", "formation_v", "--polish", "ipopt", *TINY),
        *("--no-figures", "--out", tmp_path / "r"),
    )
    record = arrays(tmp_path / "r")
    tolerance = 1e-6  # of the problem's violation
    assert said.code == 0
    better = (record["plan_cost"] <= record["search_cost"]) | (
        record["search_violation"] > tolerance
    )
    assert better.all()
    assert (record["plan_violation"] <= record["search_violation"] + tolerance).all()


def test_seven_uavs_are_a_change_of_the_yaml_alone(
    command: Command, changed: Callable[[str, str], Path], tmp_path: Path
) -> None:
    file = changed(
        "\nplanning_order:",
        """
  - start: {speed_m_s: 15, heading_rad: 0, x_m: 5, y_m: 95}
    slot: {x_m: -45, y_m: 45}
  - start: {speed_m_s: 15, heading_rad: 0, x_m: 5, y_m: 35}
    slot: {x_m: -45, y_m: -45}

planning_order:""",
    )
    said = command("run", file, *TINY, "--out", tmp_path / "r", "--json")
    assert (said.code, said.err) == (0, "")
    assert len(json.loads(said.out)["measures"]["tail_error_by_uav_m"]) == 7
    assert arrays(tmp_path / "r")["states"].shape == (28, 3)


def test_an_animation_as_gif_moves(command: Command, tmp_path: Path) -> None:
    said = command(
        *("run", "formation_v", *TINY, "--no-figures", "--animation", "gif"),
        *("--out", tmp_path / "r", "--json"),
    )
    assert (said.code, said.err) == (0, "")
    assert json.loads(said.out)["figures"] == ["flight.gif"]
    with Image.open(tmp_path / "r" / "figures" / "flight.gif") as image:
        assert image.n_frames > 1  # type: ignore[attr-defined]
    assert len(list((tmp_path / "r" / "figures").iterdir())) == 1


@pytest.mark.skipif(shutil.which("ffmpeg") is not None, reason="ffmpeg is installed")
def test_an_animation_as_mp4_without_ffmpeg_is_refused_before_the_flight(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "fly", None)
    said = command("run", "formation_v", *TINY, "--animation", "mp4", "--out", tmp_path)
    assert (said.code, said.out) == (2, "")
    assert said.err == (
        "swarmstart: an animation as mp4 needs the program ffmpeg, which is not "
        "installed; try --animation gif\n"
    )


def test_another_run_is_forced_and_leaves_nothing_that_the_run_before_wrote(
    command: Command, tmp_path: Path
) -> None:
    folder = tmp_path / "r"
    tiny = ("run", "formation_v", *TINY, "--set", "steps=1", "--out", folder)
    assert command(*tiny).code == 0
    drawn = sorted(file.name for file in (folder / "figures").iterdir())
    assert command(*tiny, "--no-figures").code == 0  # The same run keeps its figures.
    assert sorted(file.name for file in (folder / "figures").iterdir()) == drawn
    assert sorted(json.loads((folder / "run.json").read_text())["figures"]) == drawn
    (folder / "figures" / "mine.png").touch()
    (folder / "mine.json").touch()
    bounds_only = ("--set", "dual_mode.certify=false")
    refused = command(*tiny, "--no-figures", *bounds_only)
    assert (refused.code, refused.out) == (2, "")
    assert "found the record of another run" in refused.err
    assert (folder / "certificate.json").exists()
    assert command(*tiny, "--no-figures", *bounds_only, "--force").code == 0
    assert [file.name for file in (folder / "figures").iterdir()] == ["mine.png"]
    assert {file.name for file in folder.glob("*.json")} == {"run.json", "mine.json"}


def test_the_users_own_scenario_is_not_replaced(
    command: Command, tmp_path: Path
) -> None:
    mine = tmp_path / "scenario.yaml"
    text = f"# mine\n{shipped()['formation_v'].read_text(encoding='utf-8')}"
    mine.write_text(text, encoding="utf-8")
    (tmp_path / "probe").write_text("mine too")
    said = command("run", mine, *TINY, "--no-figures", "--out", tmp_path)
    assert (said.code, said.out) == (2, "")
    assert said.err == (
        f"swarmstart: {tmp_path}: expected an empty folder or the record of this run, "
        "found other files ('probe', 'scenario.yaml'); choose another --out, or write "
        "over it with --force\n"
    )
    assert mine.read_text(encoding="utf-8") == text
    assert (tmp_path / "probe").read_text() == "mine too"
    assert len(list(tmp_path.iterdir())) == 2


def test_a_plan_that_cuts_between_its_checks_is_not_silent(
    command: Command, tmp_path: Path
) -> None:
    """Five UAVs at 4.949 m where 5 m are asked for."""
    said = command(
        *("run", "swap_5", "--set", "repair=false", "--no-figures", "--quiet"),
        *("--json", "--out", tmp_path),
    )
    told = json.loads(said.out)
    assert said.code == 4
    assert told["measures"]["min_distance_m"] == pytest.approx(4.949, abs=5e-4)
    assert "not confirmed: a constraint is broken between the checks" in told["status"]
    assert "is broken by 0.0511" in told["status"]


def test_a_reader_that_has_gone_is_no_error() -> None:
    read, write = os.pipe()
    os.close(read)
    process = subprocess.run(
        [
            sys.executable,
            "-m",
            "swarmstart",
            *"run formation_v --print-config -q".split(),
        ],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
    )
    os.close(write)
    assert (process.returncode, process.stderr) == (0, "")


def test_the_recorded_yaml_is_plain_and_in_the_order_of_the_format(
    flown: tuple[Path, Any],
) -> None:
    recorded = yaml.safe_load((flown[0] / "scenario.yaml").read_text())
    assert list(recorded)[:4] == ["schema", "name", "kind", "title"]
    assert recorded["vehicle"]["acceleration_m_s2"] == [-5.0, 5.0]
