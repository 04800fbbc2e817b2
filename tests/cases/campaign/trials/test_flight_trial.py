"""Whole flights as trials: judged by the path flown."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.cases.campaign.engine.cells import Cell
from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.trials.flight_trial import (
    FLOWN_TOLERANCE,
    flight_cell,
    flown_trial,
    fly_cell,
)
from swarmstart.cases.format.scenario import Resolved, read_document, resolve


def resolved(name: str, *assignments: str) -> Resolved:
    return resolve(read_document(name), assignments=assignments)


def flown(name: str, *assignments: str, seed: int = 0) -> Run:
    return run(resolved(name, *assignments), seed=seed)


def trial(cell: Cell) -> dict[str, Any]:
    return fly_cell(cell.job, Path())


def weighted(rows: Sequence[Any], weights: Sequence[float]) -> Any:
    return sum(w * row**2 for w, row in zip(weights, rows, strict=True))


def test_the_cost_of_close_formation_is_the_integral_of_its_tracking_errors() -> None:
    """(5.21) over the path flown, by the trapezoidal rule on the plant's steps."""
    finished = flown("close_formation", "steps=30")
    scenario, path = finished.resolved.scenario, finished.trajectory
    x, y, psi, V, z, _ = path.dense_states
    leader = finished.flight.plant.parameters(path.dense_times)
    slot = scenario.slot  # type: ignore[attr-defined]
    off = (x - slot.x_ft, y - slot.y_ft, z - slot.z_ft, V - leader[0], psi - leader[1])
    rate = weighted(off, scenario.weights) / finished.flight.plant.dt  # type: ignore[attr-defined]
    expected = np.trapezoid(rate, path.dense_times)
    assert flown_trial(finished).verified_cost == pytest.approx(expected, rel=1e-3)


def test_a_maximised_cost_is_turned_and_a_closed_loop_one_is_the_measure() -> None:
    best = flown_trial(flown("goddard_rocket", "search={name: none}"))
    assert best.sense == -1
    assert best.verified_cost == -best.measures["flown_cost"]
    tank = flown_trial(flown("stirred_tank", "steps=3")).as_json()
    assert tank["verified_cost"] == tank["measures"]["flown_cost"]
    assert tank["step_seconds"]["dt"] > 0
    assert len(tank["track"]["time"]) == len(tank["track"]["states"]["C_a"]) <= 201


def test_two_uavs_nearer_than_the_safe_distance_are_no_feasible_flight() -> None:
    """Planned at a tenth of the distance that counts afterwards."""
    near = flown("formation_v", "steps=12", "budget.evaluations=400")
    safe = near.measures["min_distance_m"]
    kind, scenario = near.resolved.kind, near.resolved.scenario
    avoidance = scenario.avoidance  # type: ignore[attr-defined]
    wider = avoidance.model_copy(update={"safe_distance_m": 1.1 * safe})  # type: ignore[operator]
    asked = scenario.model_copy(update={"avoidance": wider})
    _, excess = kind.whole_run(asked, near.flight, near.trajectory, near.measures)
    assert excess == pytest.approx(1 - 1 / 1.1)
    assert excess > FLOWN_TOLERANCE
    assert (
        kind.whole_run(scenario, near.flight, near.trajectory, near.measures).excess
        == 0
    )
    assert flown_trial(near).feasible
    judged = flown_trial(replace(near, resolved=replace(near.resolved, scenario=asked)))
    assert judged.claimed_feasible and not judged.feasible


def test_gusts_differ_from_seed_to_seed_and_solvers_meet_the_same() -> None:
    gusty = "plant={gusts: {sigma_ft_s: 3, length_ft: 600, seed: 7}}"
    calm = resolved("close_formation", "steps=4", gusty, "budget.evaluations=60")
    first, again, other = (trial(flight_cell(calm, seed)) for seed in (0, 0, 1))
    assert first["track"] == again["track"] != other["track"]
    still = flown("close_formation", "steps=4", gusty, "budget.evaluations=60")
    assert flown_trial(still).as_json()["track"] == first["track"]


def test_flights_that_differ_in_name_and_claims_only_are_one_cell() -> None:
    one, two = resolved("formation_v"), resolved("formation_v", "name=other")
    assert flight_cell(one, 0).key == flight_cell(two, 0).key
    assert flight_cell(one, 0, named=True).key != flight_cell(two, 0, named=True).key
    assert flight_cell(one, 0).key != flight_cell(one, 1).key
