"""Errors of a transfer's scenario, with their places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.transfer.conftest import Make


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("steps=21", "expected at most prediction.intervals = 20, found 21"),
        ("uavs.0.goal={x_m: 25, y_m: 0}", "expected a goal away from the start"),
        (
            "uavs.0.goal={x_m: 250, y_m: 0}",
            "expected a goal within 90 m of the start, .*; found 225 m",
        ),
        (
            "uavs.1.goal={x_m: -25, y_m: 1}",
            r"expected a goal at least 5 m \(safe_distance_m\) from that of UAV 1, "
            "found 1 m",
        ),
        (
            "uavs.1.start={speed_m_s: 5, heading_rad: 0, x_m: 25, y_m: 4}",
            "expected a start at least 5 m .* from that of UAV 1, found 4 m",
        ),
        ("vehicle.speed_m_s=[0, 9]", "expected a lower limit above 0, since .* by"),
        (
            "uavs.0.start.speed_m_s=1",
            r"expected a speed within vehicle.speed_m_s \[2, 9\], found 1",
        ),
        (
            "vehicle={acceleration_m_s2: [-2, 2], bank_rad: [-2, 2], "
            "speed_m_s: [2, 9], turn: tan}",
            "expected limits between -pi/2 and pi/2, found",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_reason(
    make: Make, assignment: str, message: str
) -> None:
    with pytest.raises(InvalidScenarioError, match=message) as refused:
        make("swap_5", assignment)
    assert refused.value.flaws[0].place.name.startswith("--set ")


def test_goals_are_checked_as_they_are_assigned(make: Make) -> None:
    """A goal at its UAV's own start goes to another UAV; one out of reach to none."""
    pair = (
        "uavs=[{start: {speed_m_s: 5, heading_rad: 0, x_m: 0, y_m: 0}, "
        "goal: {x_m: %s, y_m: 0}}, {start: {speed_m_s: 5, heading_rad: pi, x_m: 50, "
        "y_m: 0}, goal: {x_m: %s, y_m: 0}}]"
    )
    make("swap_5", pair % (50, 0), "steps=1")
    shared = make("swap_5", pair % (1, 49), "assignment=shortest", "steps=1")
    assert shared.assignment == "shortest"
    with pytest.raises(InvalidScenarioError, match="expected a goal within 90 m"):
        make("swap_5", pair % (-2500, 0), "assignment=shortest", "steps=1")
    with pytest.raises(InvalidScenarioError, match="a goal away from the start"):
        make("swap_5", pair % (50, 0), "assignment=shortest", "steps=1")
