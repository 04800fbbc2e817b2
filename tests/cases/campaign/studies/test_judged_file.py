"""Judgement of trajectory files: exact cost, place and size, and clear refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.studies.judged_file import (
    Judgement,
    TrajectoryFileError,
    judge,
)
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.hard.best_known import BestKnown
from swarmstart.cases.hard.currents import drawn_currents

AROUND = """\
kind: problem
states: {x: {start: -2, rate: u}, y: {start: 0, rate: v}}
controls: {u: {bounds: [-9, 9]}, v: {bounds: [-9, 9]}}
stage_cost: u**2 + v**2
path: [{distance: [x, y], at_least: 1}]
terminal: [{expression: x, equals: 2}, {expression: y}]
prediction: {horizon_s: 1, intervals: 2, checks: 4}
"""


@pytest.fixture
def around(tmp_path: Path) -> str:
    file = tmp_path / "around.yaml"
    file.write_text(AROUND)
    return str(file)


def written(folder: Path, text: str) -> Path:
    file = folder / "controls.csv"
    file.write_text(text)
    return file


def test_two_straight_pieces_cost_the_square_of_their_length(
    around: str, tmp_path: Path
) -> None:
    """Over the point (0, 2) both pieces keep 2 / sqrt(2) from the disc's centre."""
    judged = judge(around, written(tmp_path, "v,u\n4,4\n-4,4\n"))
    assert judged.is_accepted and judged.reason == "" and judged.best is None
    assert judged.cost == pytest.approx(4**2 + 4**2, rel=1e-12)
    assert judged.ratio is None and not judged.is_better


def test_a_cut_disc_is_refused_with_place_and_size(around: str, tmp_path: Path) -> None:
    """Over (0, 1.1) the nearest point is half way along a piece, between the checks.

    Its distance is 2 * 1.1 / sqrt(4 + 1.1^2) = 0.9638, at the foot of the
    perpendicular: 1.1^2 / (4 + 1.1^2) of a piece before the middle.
    """
    judged = judge(around, written(tmp_path, "u,v\n4,2.2\n4,-2.2\n"))
    assert not judged.is_accepted and judged.worst is not None
    assert judged.worst.amount == pytest.approx(1 - 0.9638, abs=1e-4)
    away = 0.5 * 1.1**2 / (4 + 1.1**2)
    assert abs(judged.worst.time - 0.5) == pytest.approx(away, abs=0.02)
    assert "is broken by 0.036" in judged.reason


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected names of controls, each once; found nothing"),
        ("u,u\n1,1\n", "expected names of controls, each once; found 'u', 'u'"),
        ("u\n1\n1\n", ":1: expected the columns u, v; found u"),
        ("u,v,w\n1,1,1\n1,1,1\n", ":1: expected the columns u, v; found u, v, w"),
        ("u,v\n1,1\n", "expected 2 rows, one for each interval; found 1"),
        ("u,v\n", "expected 2 rows, one for each interval; found 0"),
        ("u,v\n1,1\n1\n", ":3: expected 2 cells, as in the first line; found 1"),
        ("u,v\n1,nan\n1,1\n", ":2: expected a finite number as v, found 'nan'"),
        ("u,v\n1,1\n1,x\n", ":3: expected a finite number as v, found 'x'"),
        ("u,v\n1,1\n1,9.1\n", "expected v from -9 to 9; found 9.1 in interval 2"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_in_one_message(
    text: str, message: str, around: str, tmp_path: Path
) -> None:
    with pytest.raises(TrajectoryFileError) as refused:
        judge(around, written(tmp_path, text))
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_another_kind_of_file_is_refused_in_true_words(
    around: str, tmp_path: Path
) -> None:
    with pytest.raises(TrajectoryFileError, match="expected a CSV file, such as"):
        judge(around, tmp_path / "u.txt")


@pytest.mark.parametrize(
    ("second", "message"),
    [("9.5", "found 9 to 9.5"), ("9", ""), ("99", "in all rows, from 3 to 24; found")],
)
def test_a_free_end_time_is_a_column_with_one_value(
    second: str, message: str, tmp_path: Path
) -> None:
    rows = ["heading,end_time", *["0.1,9"] * 59, f"0.1,{second}"]
    file = written(tmp_path, "\n".join(rows))
    if message:
        with pytest.raises(TrajectoryFileError, match=message):
            judge("hard/currents_4", file)
        return
    judged = judge("hard/currents_4", file)
    assert judged.cost == pytest.approx(9)
    assert not judged.is_accepted  # It does not end at the goal.
    goal = drawn_currents(vortices=4, seed=1)[0].goal
    assert judged.worst is not None and judged.worst.time == pytest.approx(9)
    assert judged.worst.amount < np.hypot(*goal)


def judgement(cost: float, best: BestKnown | None, sense: float = 1.0) -> Judgement:
    return Judgement(
        problem="hard/x", file="x.csv", is_accepted=True, reason="", cost=cost,
        worst=None, best=best, sense=sense,
    )  # fmt: skip


def test_better_is_by_the_sense_of_the_problem_and_beyond_round_off() -> None:
    best = BestKnown(cost=10.0, known_by="exact", methods=["by hand"])
    assert judgement(9.0, best).is_better and not judgement(9.0, best, -1.0).is_better
    assert judgement(11.0, best, -1.0).is_better and not judgement(11, best).is_better
    assert not judgement(10 - 1e-9, best).is_better
    assert judgement(12.0, best).ratio == pytest.approx(1.2)
    assert judgement(3.0, BestKnown(known_by="unknown")).is_better


def test_the_command_prints_the_verdict_and_exits_with_4_if_it_is_refused(
    around: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = written(tmp_path, "u,v\n4,4\n4,-4\n")
    assert main(["judge", around, str(good)]) == 0
    assert "accepted\n  cost        32\n" in capsys.readouterr().out
    assert main(["judge", around, str(good), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == 1 and found["accepted"] and found["cost"] == 32
    cut = written(tmp_path, "u,v\n4,0\n4,0\n")
    assert main(["judge", around, str(cut)]) == 4
    assert "refused: " in capsys.readouterr().out
    assert main(["judge", around, str(tmp_path / "none.csv")]) == 5
    assert "expected a readable file" in capsys.readouterr().err
