"""Cells of comparisons: plans or runs, their solvers and their order."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.studies import comparing
from swarmstart.cases.campaign.studies.comparing import (
    Contest,
    contest_of,
    earlier_best,
    interleaved,
    listed_best,
    with_distinct_names,
)
from swarmstart.cases.campaign.studies.comparison_plan import Chosen, ComparisonPlan, Of
from swarmstart.cases.campaign.trials.solver_names import solvers_of
from swarmstart.cases.campaign.trials.solvers import solve_cell
from swarmstart.cases.format.kind import SeveralPlansError
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.hard.best_known import BestKnown, best_known
from swarmstart.cases.record.record import MARK, SCENARIO, Recording

TRAM = """\
kind: problem
states:
  s: {start: 0, rate: v}
  v: {start: 0, rate: f - 0.02*v, bounds: [0, 20]}
controls: {f: {bounds: [-1.5, 1.5]}}
stage_cost: max(f*v, 0) + 0.5*f**2
path: [{expression: "max(f*v, 0)", upper: 12}]
terminal: [{expression: s, equals: 300}, {expression: v, equals: 0}]
prediction: {horizon_s: 40, intervals: 12}
budget: {evaluations: 600}
lanes: 8
"""
"""A tram between two stops: power has a kink, and breaks its limit between checks."""
SOLVERS = "de,repeated-ipopt,ipopt,scipy-de"
GUSTY = "plant={gusts: {sigma_ft_s: 3, length_ft: 600, seed: 7}}"


def contest(name: str, *assignments: str, of: Of = "auto", seeds: int = 3) -> Contest:
    plan = ComparisonPlan(scenarios=(), solvers=(), seeds=seeds)
    chosen = Chosen(source=name, of=of, assignments=assignments)
    budget = {"evaluations": 600}
    document, solvers = read_document(name), solvers_of(SOLVERS)
    return contest_of(chosen, document, solvers, plan, budget, lambda given: given)


def names(found: Contest) -> Sequence[str]:
    return [entry.solver.name for entry in found.entries]


def test_what_plans_once_is_compared_by_its_plan_and_what_flies_by_flights() -> None:
    pendulum, flight = contest("pendulum"), contest("formation_v", "steps=2")
    assert (pendulum.of, flight.of) == ("plan", "flight")
    assert names(pendulum) == SOLVERS.split(",")
    # The search of another package cannot plan in closed loop.
    assert names(flight) == ["de", "repeated-ipopt", "ipopt"]
    assert flight.left_out == ("scipy-de",)
    assert contest("stirred_tank").of == "flight"
    assert contest("stirred_tank", of="plan").of == "plan"
    with pytest.raises(SeveralPlansError):
        contest("formation_v", of="plan")


def test_random_starts_fly_without_lanes_and_ipopt_without_a_search() -> None:
    found = contest("stirred_tank")
    de, many, cold = (entry.cells[0].job["settings"] for entry in found.entries)
    assert many["search"]["name"] == "multistart" and not many["search"]["lanes"]
    assert (cold["search"]["name"], cold["polish"]) == ("none", "ipopt")
    assert (de["search"]["name"], de["polish"]) == ("de", "none")
    assert {one["lanes"] for one in (de, many, cold)} == {0}


def test_a_solver_without_chance_runs_once_unless_gusts_are_drawn() -> None:
    calm = contest("stirred_tank")
    gusty = contest("close_formation", "steps=2", GUSTY)
    assert [len(entry.cells) for entry in calm.entries] == [3, 3, 1]
    assert [len(entry.cells) for entry in gusty.entries] == [3, 3, 3]
    assert gusty.is_seeded and not calm.is_seeded
    assert not contest("close_formation", GUSTY, of="plan").is_seeded


def test_solvers_of_a_scenario_take_turns_seed_by_seed() -> None:
    one, two = contest("pendulum"), contest("van_der_pol", seeds=2)
    labels = [cell.label for cell in interleaved([one, two])]
    assert labels[:5] == [
        *("pendulum, de, seed 0", "pendulum, repeated-ipopt, seed 0"),
        *("pendulum, ipopt, seed 0", "pendulum, scipy-de, seed 0"),
        "pendulum, de, seed 1",
    ]
    assert len(labels) == len(set(labels)) == 3 * 3 + 1 + 3 * 2 + 1
    assert all(label.startswith("van_der_pol") for label in labels[10:])


def test_two_scenarios_of_one_name_are_told_apart() -> None:
    first, second = with_distinct_names([contest("pendulum"), contest("pendulum")])
    assert (first.name, second.name) == ("pendulum", "pendulum (2)")
    assert {entry.scenario for entry in second.entries} == {"pendulum (2)"}


@pytest.fixture
def tram(tmp_path: Path) -> str:
    file = tmp_path / "tram.yaml"
    file.write_text(TRAM)
    return str(file)


NARROW = ("prediction.intervals=10", "prediction.checks=1", "lanes=8")
"""Few checks, between which the first answer breaks the wall and is repaired."""


@pytest.mark.parametrize(
    ("name", "changes", "confirmed"),
    [
        ("tram", (), 1),
        ("van_der_pol", (), 1),
        ("bryson_denham", NARROW, 1),
        ("bryson_denham", (*NARROW, "feedback.repair=false"), 0),
    ],
)
def test_solve_is_what_run_does_bit_for_bit(
    name: str, changes: tuple[str, ...], confirmed: int, tram: str, tmp_path: Path
) -> None:
    name = tram if name == "tram" else name
    plan = ComparisonPlan(scenarios=(), solvers=(), seeds=1)
    (entry,) = contest_of(
        Chosen(source=name, assignments=changes),
        read_document(name),
        solvers_of("solve"),
        plan,
        {"evaluations": 50},  # Which does not limit it.
        lambda given: given,
    ).entries
    found = solve_cell(dict(entry.cells[0].job), tmp_path)
    resolved = resolve(read_document(name), assignments=changes)
    measures = run(resolved, seed=0).measures
    assert found["verified_cost"] == measures["verified_cost"]
    assert found["feasible"] == measures["confirmed"] == confirmed


def test_solve_keeps_the_scenarios_own_settings_but_for_those_it_names() -> None:
    def settings(solver: str, name: str, of: Of) -> dict[str, Any]:
        plan = ComparisonPlan(scenarios=(), solvers=(), seeds=1)
        chosen, given = Chosen(source=name, of=of), read_document(name)
        budget = {"evaluations": 50, "seconds": 3}
        made = contest_of(
            chosen, given, solvers_of(solver), plan, budget, lambda given: given
        )
        return dict(made.entries[0].cells[0].job["settings"])

    own = resolve(read_document("stirred_tank")).settings
    planned = settings("solve", "stirred_tank", "plan")
    assert all(planned[key] == own[key] for key in ("search", "budget", "polish"))
    flown = settings("solve", "stirred_tank", "flight")
    assert flown["budget"] == {**own["budget"], "seconds": 3}
    assert flown["search"] == own["search"] and flown["lanes"] == own["lanes"]
    other = settings("solve[search=de,lanes=3]", "van_der_pol", "plan")
    assert (other["search"]["name"], other["lanes"]) == ("de", 3)


@pytest.fixture(scope="module")
def recorded_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run's record."""
    whole = tmp_path_factory.mktemp("once")
    (whole / "tram.yaml").write_text(TRAM)
    document = read_document(str(whole / "tram.yaml"))
    run(
        resolve(document, search="none", polish="ipopt"), seed=0,
        recording=Recording(folder=whole / "one", figures=False),
    )  # fmt: skip
    return whole / "one"


@pytest.fixture
def recorded(recorded_once: Path, tmp_path: Path) -> Path:
    """Return the folder of a copy of it."""
    folder = tmp_path / "results" / "tram" / "one"
    shutil.copytree(recorded_once, folder)
    return folder


def test_a_comparison_knows_earlier_runs_of_the_same_problem(
    tram: str, recorded: Path
) -> None:
    runs = recorded.parents[1]
    mark = json.loads((recorded / MARK).read_text())
    found = earlier_best(contest(tram), runs)
    assert found is not None and found.folder == recorded
    assert found.cost == mark["measures"]["verified_cost"]
    # Another method does not matter, another problem does.
    assert earlier_best(contest(tram, "lanes=3", "basins=1"), runs) == found
    assert earlier_best(contest(tram, "prediction.intervals=13"), runs) is None
    assert earlier_best(contest(tram), runs.parent) is None
    other = recorded.with_name("other")
    shutil.copytree(recorded, other)
    mark["measures"]["verified_cost"] = 1.0
    (other / MARK).write_text(json.dumps(mark))
    assert earlier_best(contest(tram), runs) == (1.0, other)
    # The larger value of a problem that is maximised.
    assert earlier_best(contest(tram), runs, -1) == found


def test_a_comparison_knows_the_listed_value_of_a_hard_problem_as_shipped(
    tmp_path: Path,
) -> None:
    found = listed_best(contest("hard/gears_6"))
    assert found is not None and found.known_by == "exact"
    assert found.cost == best_known()["hard/gears_6"].cost
    # Another method does not matter, another problem does.
    assert listed_best(contest("hard/gears_6", "lanes=3", "basins=1")) == found
    assert listed_best(contest("hard/gears_6", "prediction.intervals=13")) is None
    assert listed_best(contest("pendulum")) is None
    copy = tmp_path / "gears_6.yaml"  # Its own problem, though it has the name.
    copy.write_text(TRAM)
    assert listed_best(contest(str(copy))) is None


def test_a_hard_problem_of_which_no_value_is_known_has_none_in_a_comparison(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    unknown = {"hard/gears_6": BestKnown(known_by="unknown")}
    monkeypatch.setattr(comparing, "best_known", lambda: unknown)
    assert listed_best(contest("hard/gears_6")) is None


@pytest.mark.parametrize(
    ("file", "forged"),
    [
        (MARK, {"measures": {"verified_cost": 1.0, "confirmed": 0}}),
        (MARK, {"measures": {"verified_cost": "1", "confirmed": 1}}),
        (MARK, {"measures": {"verified_cost": None, "confirmed": 1}}),
        (MARK, {"measures": {"verified_cost": float("nan"), "confirmed": 1}}),
        (MARK, {"measures": {"verified_cost": 10**400, "confirmed": 1}}),
        (MARK, {"measures": []}),
        (MARK, []),
        (SCENARIO, {"kind": "problem"}),
    ],
)
def test_records_that_tell_of_no_confirmed_answer_are_passed_over(
    file: str, forged: object, tram: str, recorded: Path
) -> None:
    (recorded / file).write_text(json.dumps(forged))
    assert earlier_best(contest(tram), recorded.parents[1]) is None
