from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import read_document, resolve

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.close_formation.conftest import Make

ROW = "{{time_s: {}, speed_ft_s: 200, heading_rad: 0}}"


def rows(*times: float) -> str:
    return f"leader.manoeuvre=[{', '.join(ROW.format(time) for time in times)}]"


def complaints(*assignments: str, variant: str | None = None) -> list[str]:
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(
            read_document("close_formation"), variant=variant, assignments=assignments
        )
    return [flaw.what for flaw in caught.value.flaws]


def test_the_start_is_in_the_order_of_the_model(make: Make) -> None:
    start = make("start.heading_rad=0.1", "start.z_ft=2", "start.climb_ft_s=-1").start
    assert start.vector() == [60, 23.6, 0.1, 200, 2, -1]


def test_the_three_sampling_times_fly_equally_long(make: Make) -> None:
    for name in ("close_formation", "close_formation_fast", "close_formation_vortex"):
        scenario = make(name=name)
        assert scenario.steps * scenario.prediction.dt == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        (
            "autopilot.speed_lag_s=-1",
            "expected autopilot.speed_lag_s to be greater than 0; found -1",
        ),
        (
            "aircraft.span_ft=0",
            "expected aircraft.span_ft to be greater than 0; found 0",
        ),
        (
            "prediction.horizon_s=60",
            "expected control intervals of at most 5 s, when the leader's manoeuvre is "
            "over; found 60 s",
        ),
        (
            "commands.speed_ft_s=[260, 350]",
            "expected bounds that include the leader's speeds, 200 to 250; "
            "found [260, 350]",
        ),
        (
            "commands.speed_ft_s=[150, 220]",
            "expected bounds that include the leader's speeds, 200 to 250; "
            "found [150, 220]",
        ),
        (rows(0, 5, 4), "expected a time after 5 s, that of the row before; found 4"),
        (rows(0, 5, 5), "expected a time after 5 s, that of the row before; found 5"),
        (rows(1, 5), "expected a manoeuvre that begins at 0 s, found 1"),
        (
            "plant.substep_s=0.2",
            "expected at most prediction.horizon_s / intervals = 0.1, found 0.2",
        ),
    ],
)
def test_bad_input_is_said_once(assignment: str, said: str) -> None:
    assert complaints(assignment) == [said]


@pytest.mark.parametrize("part", ["prediction", "plant"])
def test_the_printed_equations_have_no_vortex(part: str) -> None:
    (said,) = complaints(
        f"{part}={{horizon_s: 0.1, model: literal, aerodynamics: vortex}}"
        if part == "prediction"
        else "plant={model: literal, aerodynamics: vortex}"
    )
    assert "vortex" in said


def test_a_leader_that_never_manoeuvres_bounds_no_sampling_time(make: Make) -> None:
    assert make(rows(0), "prediction.horizon_s=6").prediction.dt == 6
