"""Measures of swarms, their certificates, and the rules beside each other."""

import itertools
import json
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.kind import FLIGHT_CERTIFICATE as CERTIFICATE
from swarmstart.cases.kinds.swarm.kind import least_gaps
from swarmstart.cases.record.record import Recording
from swarmstart.terminal_set import check

CUBE = "{{formation: cube, count: 10, side_m: 2.2, seed: {}}}"


def numbers(run: ss.Run) -> dict[str, float]:
    """Return the measures that are numbers."""
    found = run.measures.items()
    return {name: value for name, value in found if isinstance(value, int | float)}


def test_measures_are_those_of_the_simulated_path(flown: ss.Run) -> None:
    path = flown.trajectory.dense_states.reshape(6, 6, -1)[:, :3]
    times, found = flown.trajectory.dense_times, numbers(flown)
    fine = np.linspace(0, 1, 33)
    near = min(
        np.linalg.norm(
            (1 - s) * (a - b)[:, :-1] + s * (a - b)[:, 1:], axis=0
        ).min()
        for a, b in itertools.combinations(path, 2)
        for s in fine
    )  # fmt: skip
    assert found["min_distance_m"] == pytest.approx(near, abs=1e-4)
    assert found["min_distance_m"] >= 0.35
    assert (found["collisions"], found["obstacle_hits"]) == (0, 0)
    assert found["arrived_share"] == 1.0
    goals = -path[:, :, 0]
    off = np.linalg.norm(path - goals[:, :, None], axis=1)
    assert off[:, times >= found["arrival_time_s"]].max() <= 0.1
    ways = np.linalg.norm(np.diff(path, axis=2), axis=1).sum(axis=1)
    assert found["path_ratio"] == pytest.approx(np.median(ways / 3.0))
    assert 0 < found["tracking_error_m"] < 0.1
    assert found["acceleration_max_m_s2"] <= 1.0


def test_pairs_that_pass_between_two_samples_are_seen() -> None:
    path = np.zeros((2, 3, 2))
    path[0, 0], path[1, 0] = [-1.0, 1.0], [1.0, -1.0]
    path[1, 1] = 0.1
    assert least_gaps(path)[0] == pytest.approx(0.1)


def test_vehicles_in_an_obstacle_or_within_half_the_distance_are_counted(
    flown: ss.Run,
) -> None:
    hits = resolve_name("swarmstart.cases.kinds.swarm.kind:obstacle_hits")
    path = flown.trajectory.dense_states.reshape(6, 6, -1)[:, :3].copy()
    path[0, :, 7] = 0.0  # The centre of the ball of 0.2 m.
    path[1, :, 9] = [0.37, 0.0, 0.0]
    path[2, :, 9] = [0.0, 0.38, 0.0]
    assert hits(path, flown.flight, flown.trajectory) == 2


def test_an_interrupted_run_begins_anew_and_ends_the_same(
    six: Path, tmp_path: Path, flown: ss.Run
) -> None:
    resolved, folder = flown.resolved, tmp_path / "out"
    recording = Recording(folder=folder, figures=False)

    def stop(done: int, total: int, what: str) -> None:
        if done == 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(resolved, seed=0, recording=recording, progress=stop)
    again = run(resolved, seed=0, recording=recording)
    assert again.resumed == 0
    np.testing.assert_array_equal(again.trajectory.states, flown.trajectory.states)


def test_the_record_has_a_certificate_that_is_proved_again(
    six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    arguments = ["run", str(six), "--out", str(folder), "--no-figures"]
    assert main(arguments) == 0
    assert json.loads((folder / "run.json").read_text())["documents"] == [CERTIFICATE]
    assert check.main([str(folder / CERTIFICATE)]) == 0
    assert "no two of 6 vehicles" in capsys.readouterr().out
    assert main([*arguments, "--set", "rule=hearsay", "--force"]) == 0
    assert json.loads((folder / "run.json").read_text())["documents"] == []


def test_a_rule_without_acceptances_collides_with_the_same_seed(six: Path) -> None:
    six.write_text(
        six.read_text("utf-8")
        .replace("{formation: circle, count: 6, radius_m: 1.5}", CUBE.format(1))
        .replace("{formation: opposite}", CUBE.format(2))
        .replace("obstacles:", "# obstacles:")
        .replace("most_delay: 3", "most_delay: 6")
    )
    safe, unsafe = (
        ss.run(str(six), seed=1, settings=settings)
        for settings in ({}, {"rule": "hearsay", "planning.lead_s": 0.3})
    )
    assert safe.measures["collisions"] == 0
    assert numbers(unsafe)["collisions"] > 0
    one, other = (
        resolve_name("swarmstart.cases.kinds.swarm.kind:whole_run")(
            run.resolved.scenario, run.flight, run.trajectory, run.measures
        ).excess
        for run in (safe, unsafe)
    )
    assert one == 0.0 < other


def test_rules_are_compared_and_other_solvers_are_left_out(
    six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "compared"
    assert main([
        "compare", str(six), "--solvers", "acknowledged,hearsay,lshade", "--seeds", "2",
        "--out", str(folder),
    ]) == 0  # fmt: skip
    said = capsys.readouterr()
    content = json.loads((folder / "comparison.json").read_text("utf-8"))
    rows = content["scenarios"][0]["rows"]
    assert [row["solver"] for row in rows] == ["acknowledged", "hearsay"]
    assert rows[0]["feasible"] == 2
    assert "left out, since they are searches: lshade" in said.err
    assert "repeated-ipopt" in said.err  # Added to searches, with which it is compared.


@pytest.mark.parametrize(
    ("scenario", "solvers", "reason"),
    [
        ("six", "ipopt", "compared by rules of swarms; left out, since they are sea"),
        ("formation_v", "hearsay", "whole flights; left out, since they are rules of"),
        ("pendulum", "hearsay", "by its plan; left out, since they are rules of"),
    ],
)
def test_a_scenario_without_a_solver_that_fits_is_refused(
    scenario: str, solvers: str, reason: str, six: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    source, out = str(six) if scenario == "six" else scenario, str(tmp_path / "none")
    asked = ["compare", source, "--solvers", solvers, "--seeds", "1", "--out", out]
    assert main(asked) == 2
    assert reason in capsys.readouterr().err
    with pytest.raises(ss.NoFittingSolverError, match=reason):
        ss.compare(source, solvers, seeds=1)
    assert not (tmp_path / "none").exists()


def test_rules_alone_are_compared_without_budgets_and_evaluations(
    six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "compared"
    assert main([
        "compare", str(six), "--solvers", "acknowledged,hearsay", "--seeds", "2",
        "--out", str(folder),
    ]) == 0  # fmt: skip
    said = capsys.readouterr()
    assert "left out" not in said.err
    assert "budget" not in said.out
    content = json.loads((folder / "comparison.json").read_text("utf-8"))
    rows = content["scenarios"][0]["rows"]
    assert [row["evaluations_median"] for row in rows] == [None, None]


def test_runs_over_seeds_tell_distances_and_times_of_vehicles(
    six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "seeds")
    assert main(["run", str(six), "--seeds", "2", "--no-figures", "--out", out]) == 0
    said = capsys.readouterr().out
    assert "Closest distance of two vehicles: lowest" in said
    assert "Time of a vehicle's step: median" in said


def test_one_vehicle_has_no_distance_and_arrives(six: Path) -> None:
    text = six.read_text("utf-8").replace("count: 6", "count: 1")
    six.write_text(
        text.replace("formation: opposite", "formation: circle, count: 1, radius_m: 3")
    )
    alone = ss.run(str(six), seed=0)
    assert alone.measures["min_distance_m"] is None
    assert alone.measures["arrived_share"] == 1.0
    assert alone.measures["path_ratio"] == pytest.approx(1.0, abs=0.02)


def test_a_run_that_ends_too_early_has_no_time_of_arrival(six: Path) -> None:
    early = ss.run(str(six), seed=0, settings={"steps": 5})
    assert early.measures["arrived_share"] == 0.0
    for name in ("arrival_time_s", "mean_arrival_time_s", "path_ratio"):
        assert early.measures[name] is None
