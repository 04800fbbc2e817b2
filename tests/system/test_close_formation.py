"""The close formation meets its requirements; one seed here, more in benchmarks/."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.format.scenario import read_document, resolve

SEED = 0


@cache
def flown(
    *assignments: str,
    scenario: str = "close_formation",
    variant: str | None = None,
    ipopt: bool = False,
) -> Run:
    return run(
        resolve(
            read_document(scenario),
            variant=variant,
            search="none" if ipopt else None,
            polish="ipopt" if ipopt else None,
            assignments=assignments,
        ),
        seed=SEED,
    )


def number(measures: Mapping[str, Measure], name: str) -> float:
    value = measures[name]
    assert isinstance(value, float | int), f"{name} is {value}"
    return value


def test_exact_minimum_flies_the_fact_sheets_curve_and_its_cost_rises() -> None:
    measures = flown(ipopt=True).measures  # D4, D6
    assert number(measures, "x_settle_s") == pytest.approx(8.8, abs=0.2)
    assert number(measures, "y_settle_s") == pytest.approx(8.6, abs=0.2)
    assert number(measures, "x_max_dev_ft") == pytest.approx(51.65, abs=0.2)
    assert number(measures, "x_min_dev_ft") == pytest.approx(-19.62, abs=0.3)
    assert number(measures, "y_max_dev_ft") == pytest.approx(16.79, abs=0.2)
    assert number(measures, "cost_rises") == pytest.approx(44, abs=2)


def test_shorter_sampling_does_not_undershoot() -> None:
    fast = ("prediction.horizon_s=0.02", "steps=800")  # D5, 16 s of the 30
    measures = flown(*fast, ipopt=True).measures
    assert number(measures, "x_settle_s") == pytest.approx(6.78, abs=0.1)
    assert number(measures, "x_min_dev_ft") >= -0.05


def test_prediction_by_forward_euler_never_comes_back() -> None:
    measures = flown("prediction.integrator=euler", ipopt=True).measures  # D7
    assert number(measures, "x_rms_last_5s_ft") >= 45
    assert measures["x_settle_s"] is None


def test_longer_horizon_with_exact_kinematics_settles_earlier() -> None:
    exact = ("prediction.kinematics=exact", "plant.kinematics=exact")
    measures = flown(
        "prediction.horizon_s=1", "prediction.intervals=10", *exact, ipopt=True
    ).measures  # D9
    assert number(measures, "x_settle_s") <= 6.8
    assert number(measures, "y_max_dev_ft") <= 3.5


def test_the_texts_search_settles_and_stays() -> None:
    measures = flown().measures  # S1-S3
    assert number(measures, "x_settle_s") <= 10.5
    assert number(measures, "y_settle_s") <= 9.5
    assert number(measures, "x_max_dev_ft") == pytest.approx(51.7, abs=1.5)
    assert number(measures, "x_min_dev_ft") == pytest.approx(-19.5, abs=2.5)
    assert number(measures, "y_max_dev_ft") == pytest.approx(17, abs=0.8)
    for axis in "xyz":
        assert number(measures, f"{axis}_rms_last_5s_ft") <= 0.06


def test_the_texts_search_comes_near_the_exact_minimum() -> None:
    measures = flown("reference=ipopt").measures  # S4
    assert number(measures, "gap_relative_median") <= 1e-3
    assert number(measures, "gap_absolute_median") <= 0.15
    assert number(measures, "gap_min") >= -1e-6


def test_the_equations_as_printed_hold_the_wingman_down() -> None:
    measures = flown(variant="literal", ipopt=True).measures
    assert number(measures, "x_settle_s") == pytest.approx(8.9, abs=0.2)
    assert number(measures, "x_max_dev_ft") == pytest.approx(52.4, abs=0.3)
    assert number(measures, "z_max_ft") <= 1
    altitude = number(measures, "steady_altitude_command_ft")
    assert altitude == pytest.approx(-12.8, abs=0.2)


def test_drag_saved_in_the_vortex() -> None:
    measures = flown(scenario="close_formation_vortex", ipopt=True).measures  # D10
    ideal = number(measures, "drag_saving_ideal_percent")
    assert ideal == pytest.approx(33.518, abs=1e-3)
    assert number(measures, "drag_saving_percent") == pytest.approx(28.70, abs=0.1)


def test_same_seed_gives_the_same_bits() -> None:
    again = flown.__wrapped__()  # S11
    assert np.array_equal(
        flown().trajectory.dense_states, again.trajectory.dense_states
    )
    assert np.array_equal(flown().trajectory.controls, again.trajectory.controls)


def test_full_turn_of_the_leader_is_followed() -> None:
    table = (
        "[{time_s: 0, speed_ft_s: 200, heading_rad: 0},"
        " {time_s: 5, speed_ft_s: 200, heading_rad: 0},"
        " {time_s: 45, speed_ft_s: 200, heading_rad: 2*pi/3},"
        " {time_s: 65, speed_ft_s: 250, heading_rad: pi},"
        " {time_s: 125, speed_ft_s: 250, heading_rad: 2*pi}]"
    )
    finished = flown(
        "steps=1400", "leader.between=linear", f"leader.manoeuvre={table}",
        "commands.heading_from=leader",
    )  # fmt: skip
    assert number(finished.measures, "position_error_late_ft") <= 1
    turning = finished.trajectory.times >= 25
    x, y, _, _, z, _ = finished.trajectory.states[:, turning]
    assert np.sqrt((x - 60) ** 2 + (y - 23.6) ** 2 + z**2).max() <= 1


def test_claims_have_the_expected_verdicts() -> None:
    claims = [
        claim
        for name in ("close_formation", "close_formation_vortex")
        for claim in flown(scenario=name).claims
    ]
    verdicts = {c["id"]: c["holds"] for c in claims if c["holds"] is not None}
    kept = {"13", "15", "15b", "15c", "16", "17"}
    assert {c for c, holds in verdicts.items() if holds} == kept
    assert {c for c, holds in verdicts.items() if not holds} == {"14", "14b", "18"}
    # Claim 23 is about seconds, which a busy machine changes.
    solved = {c["id"]: c["holds"] for c in flown(ipopt=True).claims}
    assert solved["14c"] is False
    assert "23" in solved


def test_most_late_rises_of_the_cost_are_noise_of_the_search() -> None:
    """Of the exact minimum there are two after the first 10 s of the manoeuvre."""
    searched, exact = flown().measures, flown(ipopt=True).measures
    assert number(exact, "cost_rises_early") == pytest.approx(42, abs=2)
    assert number(exact, "cost_rises_late") <= 4
    assert number(searched, "cost_rises_early") == pytest.approx(44, abs=6)
    assert number(searched, "cost_rises_late") >= 50
