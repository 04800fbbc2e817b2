"""Sweeps: the same answers as `solve_many`, files named line by line, records kept."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.campaign.studies import sweeping
from swarmstart.cases.campaign.studies.sweeping import sweep_key, swept
from swarmstart.cases.commands.actions.report import newest_file
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.terminal import (
    DONE,
    INFEASIBLE,
    INTERRUPTED,
    INVALID,
)
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.problem.stated.instances import MOST_INSTANCES
from swarmstart.cases.record.record import Recording

BASE = """\
kind: problem
constants: {far: 2}
parameters: {gain: 1}
states:
  x: {start: 0, rate: v}
  v: {start: 1, rate: gain*u, bounds: [-4, 4], unit: m/s}
controls: {u: {bounds: [-9, 9]}}
stage_cost: u**2
terminal: [{expression: x, equals: 1}, {expression: v, equals: 0}]
prediction: {horizon_s: 2, intervals: 8}
search: {name: none}
"""
Make = Callable[..., str]


@pytest.fixture
def made(tmp_path: Path) -> Make:
    """Return a function that writes a scenario with instances, and perhaps a file."""

    def make(instances: str, *, table: str | bytes = "", base: str = BASE) -> str:
        file = tmp_path / "mine.yaml"
        file.write_text(f"{base}instances: {instances}\n" if instances else base)
        content = table.encode() if isinstance(table, str) else table
        (tmp_path / "starts.csv").write_bytes(content)
        return str(file)

    return make


def by_hand(x: float, v: float, gain: float) -> float:
    """Return the least cost of rest at 1 after 2 s, by least norm.

    The controls are constant in eight intervals of 0.25 s.
    """
    h, k = 0.25, np.arange(8)
    rows = np.stack([gain * h * (2 - h * (k + 0.5)), np.full(8, gain * h)])
    wanted = np.array([1 - x - 2 * v, -v])
    controls = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return float(h * (controls**2).sum())


def test_every_combination_of_a_grid_has_the_cost_of_the_closed_form(
    made: Make,
) -> None:
    grid = "{x: {lower: -1, upper: far, points: 4}, gain: [1, far]}"
    found = ss.sweep(made(f"{{grid: {grid}}}"), seed=0)
    expected = [(x, gain) for x in (-1, 0, 1, 2) for gain in (1, 2)]
    data = found.data
    assert list(zip(data.x0[0], data.parameters[0], strict=True)) == expected
    assert (data.x0[1] == 1).all()  # Not named: that of the file.
    costs = [by_hand(x, 1.0, gain) for x, gain in expected]
    assert found.cost == pytest.approx(costs, rel=1e-6)


def test_a_sweep_is_solve_many(made: Make) -> None:
    x, v, u, gain = (ca.SX.sym(name) for name in ("x", "v", "u", "gain"))
    problem = ss.OptimalControlProblem(
        ss.Model(
            states=ca.vertcat(x, v),
            controls=u,
            ode=ca.vertcat(v, gain * u),
            parameters=gain,
        ),
        horizon=2.0,
        intervals=8,
        stage_cost=u**2,
        terminal=[(x, 1), (v, 0)],
        bounds=ss.Bounds(controls=(-9, 9), states=([-np.inf, -4], [np.inf, 4])),
    )
    swept_ = ss.sweep(made("{values: {v: [0, 1, 2], gain: [1, 2, 1]}}"), seed=0)
    many = ss.solve_many(
        problem, [[0, 0, 0], [0, 1, 2]], known={"gain": [1, 2, 1]}, seed=0
    )
    assert swept_.cost == pytest.approx(many.cost, rel=1e-9)
    assert swept_.controls == pytest.approx(many.controls, abs=1e-6)


def test_a_file_has_a_line_for_each_instance_in_any_spelling(made: Make) -> None:
    plain = ss.sweep(made("{file: starts.csv}", table="v,x\n1,0\n2,0.5\n"), seed=0)
    other = b"\xef\xbb\xbf v , x\r\n1.0, 0\r\n 2e0,5e-1"
    found = ss.sweep(made("{file: starts.csv}", table=other), seed=0)
    assert (found.data.x0 == [[0, 0.5], [1, 2]]).all()
    assert (found.cost == plain.cost).all()


def test_all_lines_without_an_instance_are_named(
    made: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    table = "x,v\n1,2\nfar,3\n\n4,nan\n5\n1_0,0\n6,7\n"
    assert main(["sweep", made("{file: starts.csv}", table=table)]) == INVALID
    said = capsys.readouterr().err
    for line in (
        "line 3: found 'far' as x;",
        "line 4: found an empty line;",
        "line 5: found 'nan' as v;",
        "line 6: found 1 column;",
        "line 7: found '1_0' as x",
    ):
        assert line in said
    assert "line 2" not in said and "line 8" not in said


def test_of_many_invalid_lines_the_first_are_named_and_the_others_counted(
    made: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    file = made("{file: starts.csv}", table="x\n" + "?\n" * 13)
    assert main(["check", file]) == INVALID
    said = capsys.readouterr().err
    assert "line 11: found '?' as x; and 3 more lines" in said and "line 12" not in said


@pytest.mark.parametrize(
    ("instances", "message"),
    [
        ("{}", "expected one of file, values, grid and drawn; found none"),
        ("{values: {x: [1]}, grid: {v: [1]}}", "found values and grid"),
        ("{file: a.csv, values: {x: [1]}}", "expected file or values; found both"),
        ("{file: ../starts.csv}", "in the scenario's folder or below"),
        ("{file: none.csv}", "No such file"),
        ("{file: starts.csv}", "expected the names of states and parameters"),
        ("{values: {x: [1, 2], v: [1]}}", "found 2 of x, 1 of v"),
        ("{values: {x: []}}", f"expected 1 to {MOST_INSTANCES} instances, found 0"),
        ("{grid: {x: {lower: 1, upper: 2}}}", "expected the key 'points'"),
        ("{grid: {x: {lower: 2, upper: 1, points: 3}}}", "expected lower < upper"),
        ("{grid: {x: [near]}}", "near"),
        (
            "{grid: {x: {lower: 0, upper: 1, points: 9999}, v: [1, 2, 3, 4, 5, 6, 7, "
            "8, 9, 10, 11]}}",
            "found 109989",
        ),
        ("{drawn: {x: {uniform: [0, 1]}}}", "expected samples"),
        ("{grid: {x: [1]}, samples: 4}", "expected samples"),
        ("{drawn: {x: {normal: [0, 0]}}, samples: 3}", "a deviation above 0, found 0"),
        ("{values: {gian: [1, 2]}}", "found 'gian'; did you mean 'gain'?"),
        ("{values: {u: [1, 2]}}", "found 'u'; known: x, v, gain"),
        ("{values: {x: [.inf]}}", "finite number"),
    ],
)
def test_wrong_instances_are_refused_with_their_place(
    made: Make, instances: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", made(instances)]) == INVALID
    said = capsys.readouterr().err
    assert message in said and "mine.yaml:12:" in said


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("uncertain: {values: {gain: [1, 2]}}\n", "no instances with uncertain"),
        (
            "phases: [{horizon_s: 1, intervals: 4}, {horizon_s: 1, intervals: 4}]\n",
            "expected no instances with phases",
        ),
    ],
)
def test_what_has_no_instances_is_refused(
    made: Make, more: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    base = BASE + more
    if "phases" in more:
        base = base.replace("horizon_s: 2, intervals: 8", "checks: 1")
    assert main(["check", made("{values: {x: [0]}}", base=base)]) == INVALID
    assert message in capsys.readouterr().err


def test_a_decided_start_or_parameter_cannot_differ(
    made: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    base = BASE.replace("v: {start: 1,", "v: {start: {free: [0, 2]},")
    assert main(["check", made("{values: {v: [0]}}", base=base)]) == INVALID
    assert "found 'v'; known: x, gain" in capsys.readouterr().err


def test_more_samples_leave_the_first_ones_and_names_differ(made: Make) -> None:
    def drawn(count: int, more: str = "") -> dict[str, Any]:
        laws = "{x: {normal: [0, 1]}, gain: {uniform: [1, far]}}"
        text = f"{{drawn: {laws}, samples: {count}{more}}}"
        resolved = resolve(read_document(made(text)))
        given = resolved.kind.instances(resolved.scenario)
        assert given is not None
        return dict(given.columns)

    few, many = drawn(50), drawn(4000)
    for name, values in many.items():
        assert (values[:50] == few[name]).all()
    assert many["x"].mean() == pytest.approx(0, abs=0.06)  # Four deviations.
    assert many["x"].std() == pytest.approx(1, abs=0.05)
    assert many["gain"].min() >= 1 and many["gain"].max() <= 2
    assert many["gain"].mean() == pytest.approx(1.5, abs=0.02)
    assert abs(np.corrcoef(many["x"], many["gain"])[0, 1]) < 0.07
    assert (drawn(50, ", seed: 1")["x"] != few["x"]).all()


def test_an_instance_outside_of_its_bounds_is_named_by_its_line(
    made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = made("{file: starts.csv}", table="v\n1\n-5\n2\n5\n")
    out = tmp_path / "out"
    assert main(["sweep", file, "-q", "--out", str(out)]) == DONE
    said = capsys.readouterr().out
    assert "instance 1: line 3 of starts.csv: its start must keep the bounds" in said
    assert "instance 3: line 5 of starts.csv" in said and said.count("of starts") == 4
    assert "2 INVALID" in said and said.endswith(f"\nRecord: {out}\n")
    strict = ["sweep", file, "-q", "--strict", "--out", str(tmp_path / "other")]
    assert main(strict) == INVALID
    said = capsys.readouterr().err
    assert "2 of 4 instances are invalid" in said
    assert "instance 0 is line 2 of starts.csv" in said


def test_a_sweep_leaves_a_record_that_is_read_back(
    made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = made("{file: starts.csv}", table="v\n1\n-5\n2\n"), tmp_path / "out"
    assert main(["sweep", file, "-q", "--json", "--out", str(out)]) == DONE
    said = json.loads(capsys.readouterr().out)
    assert said == json.loads((out / "sweep.json").read_text())
    assert said["statuses"] == {"CONVERGED": 2, "INVALID": 1}
    assert said["confirmed"] == 2 and said["whole"] and said["varied"] == ["v"]
    assert newest_file(tmp_path) == out / "figures" / "cost.png"
    with (out / "instances.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    assert [row["status"] for row in rows] == ["CONVERGED", "INVALID", "CONVERGED"]
    assert float(rows[2]["x0 v"]) == 2 and rows[1]["cost"] == "nan"
    assert said["costs"]["lowest"] == float(rows[0]["cost"])
    # Its scenario has the numbers of the file, and gives the same answers without it.
    again = ss.sweep(out / "scenario.yaml", seed=0)
    assert again.cost[[0, 2]].tolist() == [float(rows[k]["cost"]) for k in (0, 2)]
    kept = ss.Solutions.load(out / "solutions.npz", again.problem)
    assert (kept.controls == again.controls)[..., [0, 2]].all()


def test_signals_that_plans_take_as_ramps_are_named(
    made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    price = "signals: {price: {times: [0, 0.9], values: [1, 3], between: hold}}\n"
    base = price + BASE.replace("stage_cost: u**2", "stage_cost: price*u**2")
    file = made("{grid: {x: [0, 1]}}", base=base)
    assert main(["sweep", file, "-q", "--out", str(tmp_path / "out")]) == DONE
    words = "warning: mine: price jumps or bends between 0.75 s and 1 s"
    assert words in capsys.readouterr().err


def test_a_folder_of_another_sweep_is_refused_and_forced(
    made: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sweep", made("{grid: {x: [0, 1]}}"), "-q", "--out", str(tmp_path / "out")]
    words += ["--no-figures"]
    assert main(words) == DONE
    assert main(words) == DONE  # The same sweep again.
    other = [*words, "--set", "instances.grid.x=[0]"]
    assert main(other) == INVALID
    assert "the record of another run" in capsys.readouterr().err
    assert main([*other, "--force"]) == DONE
    assert "1 instance of mine" in capsys.readouterr().out


def test_a_run_and_its_key_ignore_instances(made: Make) -> None:
    def keys(instances: str) -> tuple[str, str]:
        resolved = resolve(read_document(made(instances)))
        return ss.run(made(instances), seed=0).summary()["key"], sweep_key(resolved, 0)

    one, other = keys("{grid: {x: [0, 1]}}"), keys("{grid: {x: [0, 2]}}")
    assert one[0] == other[0] == ss.run(made(""), seed=0).summary()["key"]
    assert one[1] != other[1]


def test_without_any_confirmed_answer_the_exit_code_tells(
    made: Make, tmp_path: Path
) -> None:
    words = ["sweep", made("{values: {x: [90, 99]}}"), "-q", "--no-figures"]
    assert main([*words, "--out", str(tmp_path / "out")]) == INFEASIBLE


def test_a_scenario_without_instances_is_told_how_to_state_them(
    made: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", made("")]) == INVALID
    assert "expected instances, which say what differs" in capsys.readouterr().err
    assert main(["sweep", "formation_v"]) == INVALID
    assert "expected instances" in capsys.readouterr().err


def test_names_of_a_python_problem_are_checked_when_it_has_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "model.py").write_text(
        "import casadi as ca, swarmstart as ss\n"
        "def build():\n"
        "    x, u, k = (ca.SX.sym(n) for n in ('x', 'u', 'k'))\n"
        "    model = ss.Model(states=x, controls=u, ode=k*u, parameters=k)\n"
        "    problem = ss.OptimalControlProblem(model, horizon=1.0, intervals=4,\n"
        "        stage_cost=u**2, terminal=[x], bounds=ss.Bounds(controls=(-9, 9)))\n"
        "    return problem, [0.0], ss.Known(parameters=[1.0])\n"
    )
    file = tmp_path / "p.yaml"
    text = "kind: python\nproblem: model.py:build\nsteps: 4\ninstances: "
    file.write_text(text + "{values: {x: [1, 2], k: [1, 2]}}\n")
    assert main(["sweep", str(file), "-q"]) == INVALID
    assert "expected --allow-code" in capsys.readouterr().err
    found = ss.sweep(file, seed=0, allow_code=True)
    assert found.cost == pytest.approx([1.0, 1.0], rel=1e-6)  # (x / k)**2
    file.write_text(text + "{values: {y: [1]}}\n")
    with pytest.raises(ss.NoInstancesError, match=r"found 'y'.*known: x, k"):
        ss.sweep(file, seed=0, allow_code=True)


@pytest.mark.parametrize(
    ("instances", "message"),
    [
        (
            "{drawn: {x: {normal: [0, -1]}}, samples: 3}",
            "a deviation above 0, found -1",
        ),
        ("{grid: {x: {lower: 2, upper: 1, points: 3}}}", "expected lower < upper"),
        ("{grid: {x: [near]}}", "unknown name 'near'"),
    ],
)
def test_wrong_numbers_beside_a_python_problem_are_refused_without_running_it(
    tmp_path: Path, instances: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "model.py").write_text("raise SystemExit")
    file = tmp_path / "p.yaml"
    text = "kind: python\nproblem: model.py:build\nsteps: 4\ninstances: "
    file.write_text(f"{text}{instances}\n")
    assert main(["check", str(file)]) == INVALID
    said = capsys.readouterr().err
    assert message in said and "p.yaml:4:" in said


def test_an_interrupt_keeps_what_was_solved(
    made: Make,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    resolved = resolve(read_document(made("{grid: {x: [0, 1]}}")))
    first = swept(resolved, seed=0).solutions

    def interrupted(*arguments: Any, **options: Any) -> ss.Solutions:
        raise ss.SolveManyInterrupted(first)

    monkeypatch.setattr(sweeping, "solve_many", interrupted)
    recording = Recording(folder=tmp_path / "a", figures=False)
    with pytest.raises(ss.SweepInterrupted, match="2 of 2 instances have been tried"):
        swept(resolved, seed=0, recording=recording)
    content = json.loads((tmp_path / "a" / "sweep.json").read_text())
    assert content["whole"] is False and content["confirmed"] == 2
    words = ["sweep", made("{grid: {x: [0, 1]}}"), "-q", "--out", str(tmp_path / "a")]
    assert main(words) == INTERRUPTED
    assert "they are kept in" in capsys.readouterr().err
