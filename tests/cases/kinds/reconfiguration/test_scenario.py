"""Errors of a reconfiguration are reported at their places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import read_document, resolve, shipped
from swarmstart.cases.kinds.reconfiguration.pose import flaws
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import slots_at, uavs_at

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Make

PRIORITY = "planning={name: priority, range_m: 60}"
FOLLOWING = (PRIORITY, "leader=straight", "vehicle.speed_m_s=[0.2, 20]")
APART = "expected at least 5 m (distances.safe_m) from slot"
NEAR_START = "expected a start at least 5 m (distances.safe_m) from that of UAV"
FAR_START = "expected a start at most 50 m (distances.communication_m) from that of UAV"


def complaints(
    *assignments: str, name: str = "reconfiguration"
) -> list[tuple[str, str]]:
    """Return the errors: the option or the text at the place, and the message."""
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(read_document(name), assignments=assignments)
    lines = shipped()[name].read_text(encoding="utf-8").splitlines()
    found = []
    for flaw in caught.value.flaws:
        where = flaw.place.name
        if where.endswith(".yaml"):
            where = lines[flaw.place.line - 1][flaw.place.column - 1 :].rstrip()
        found.append((where, flaw.what))
    return found


def start(y: float) -> str:
    """Return a start as the file has it."""
    return f"{{speed_m_s: 2, heading_rad: 0, x_m: 0, y_m: {y:g}}}"


FLAWS = {
    "a start too near another": (
        ["uavs.1.y_m=16"],
        start(10),
        f"{NEAR_START} 1, found 4 m",
    ),
    "a start too far from another": (
        ["uavs.0.y_m=31"],
        start(-20),
        f"{FAR_START} 1, found 51 m",
    ),
    "a start nearer another than the margin allows": (
        ["distances.margin_m=3", "uavs.1.y_m=12.5"],
        start(10),
        "expected a start at least 8 m (distances.safe_m) from that of UAV 1, "
        "found 7.5 m",
    ),
    "slots of linked UAVs out of reach of each other": (
        [PRIORITY, "leader=straight", "vehicle.speed_m_s=[0.2, 20]", "slots.0.y_m=80"],
        "- {x_m: -20, y_m: 20}",
        "expected slots of the linked UAVs 1 and 2 at most 50 m "
        "(distances.communication_m) apart, found 70.7107 m",
    ),
    "two slots in one place": (
        ["slots.1={x_m: -20, y_m: 20}"],
        "--set slots.1",
        "expected a place of its own, found that of slot 1",
    ),
    "two slots too near each other": (
        ["slots.1={x_m: -17, y_m: 16.25}"],
        "--set slots.1",
        f"{APART} 1, found 4.80234 m",
    ),
    "two slots too far from each other": (
        ["slots.0.y_m=31"],
        "{x_m: -20, y_m: -20}",
        "expected at most 50 m (distances.communication_m) from slot 1, found 51 m",
    ),
    "more slots than UAVs": (
        [slots_at([(0, 10), (0, 0), (0, -10)]), uavs_at([(2, 0, 0, 0), (2, 0, 0, 9)]),
         "leader_uav=2"],
        "--set slots",
        "expected a slot for each of the 2 UAVs, found 3: more slots than UAVs",
    ),
    "fewer slots than UAVs": (
        [slots_at([(0, 20), (0, 10), (0, 0), (0, -10)])],
        "--set slots",
        "expected a slot for each of the 5 UAVs, found 4: fewer slots than UAVs",
    ),
    "no speed at the start": (
        ["uavs.3.speed_m_s=0"],
        "--set uavs.3.speed_m_s",
        "expected a speed above 0, since the heading rate divides by it; found 0",
    ),
    "a speed out of its limits at the start": (
        ["uavs.3.speed_m_s=21"],
        "--set uavs.3.speed_m_s",
        "expected a speed within vehicle.speed_m_s [0.2, 20], found 21",
    ),
    "a speed limit of zero": (
        ["vehicle.speed_m_s=[0, 20]"],
        "--set vehicle.speed_m_s",
        "expected a lower limit above 0, since the heading rate divides by the speed; "
        "found 0",
    ),
    "a leader that there is not": (
        ["leader_uav=6"],
        "--set leader_uav",
        "expected a UAV from 1 to 5, found 6",
    ),
    "a leader numbered from 0": (
        ["leader_uav=0"],
        "--set leader_uav",
        "expected leader_uav to be at least 1; found 0",
    ),
    "another leader than the one at the origin": (
        ["leader_uav=2"],
        "{x_m: -10, y_m: 10}",
        "expected the leader's own slot at (0, 0), found (-10, 10)",
    ),
    "no slot for the leader": (
        ["slots.2.x_m=0.1", "assignment=shortest"],
        "- {x_m: -20, y_m: 20}",
        "expected the leader's own slot at (0, 0), found none there",
    ),
    "thrust that cannot hold the straight leader's speed": (
        ["vehicle.thrust_n=[2500, 6000]", "leader=straight"],
        "--set vehicle.thrust_n",
        "expected a range that includes 2000, with which the leader flies straight; "
        "found [2500, 6000]",
    ),
    "a bank whose tangent is infinite": (
        ["vehicle.turn=tan", "vehicle.bank_rad=[-pi/2, 1]"],
        "--set vehicle.bank_rad",
        "expected limits between -pi/2 and pi/2, found [-1.5708, 1]",
    ),
    "a bank beyond the steepest turn": (
        ["vehicle.bank_rad=[-1, 2]"],
        "--set vehicle.bank_rad",
        "expected limits between -pi/2 and pi/2, found [-1, 2]",
    ),
    "a straight leader that cannot fly level": (
        ["vehicle.bank_rad=[0.1, 0.5]", "leader=straight"],
        "--set vehicle.bank_rad",
        "expected a range that includes 0, with which the leader flies straight; found "
        "[0.1, 0.5]",
    ),
    "weights of nothing": (
        ["weights=[0, 0, 0, 0]"],
        "--set weights",
        "expected a weight above 0, found zeros only",
    ),
    "margins that leave no room between the distances": (
        ["distances.margin_m=22.5"],
        "50}   # Dsafe, Dcom",
        "expected more than safe_m = 5, and the margin twice; found 50",
    ),
    "priority without a range": (
        [*FOLLOWING, "planning={name: priority}"],
        "--set planning",
        "expected the key range_m with priority",
    ),
    "a range in which two meet unseen": (
        [*FOLLOWING, "planning.range_m=44.9"],
        "--set planning.range_m",
        "expected at least 45 m: distances.safe_m, and what two UAVs can close in a "
        "control step; found 44.9",
    ),
    "priority with a free leader": (
        [*FOLLOWING, "leader=free"],
        "--set leader",
        "expected straight with planning priority: a leader that plans alone has no "
        "cost of its own; found free",
    ),
    "priority without speed limits": (
        [*FOLLOWING, "vehicle.speed_m_s=null"],
        "thrust_n: [0, 6000]                         # T",  # the first of the vehicle
        "expected the key speed_m_s with planning priority, since the range that must "
        "be seen follows from it",
    ),
    "priority with a reference": (
        [*FOLLOWING, "reference=ipopt"],
        "--set reference",
        "expected none with planning priority, found ipopt",
    ),
    "links of none": (
        [*FOLLOWING, "planning.links=0"],
        "--set planning.links",
        "expected planning.links to be at least 1; found 0",
    ),
    "weights of too few states": (
        ["weights=[1, 1, 1]"],
        "--set weights",
        "expected weights to be a list of at least 4 entries; found [1, 1, 1]",
    ),
}  # fmt: skip


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flaw_is_said_once_at_its_place(flaw: str) -> None:
    assignments, where, what = FLAWS[flaw]
    assert complaints(*assignments) == [(where, what)]


def test_every_pair_is_looked_at_and_everything_said() -> None:
    crowded = ["uavs.1.y_m=18", "uavs.2.y_m=16"]
    assert complaints(*crowded) == [
        (start(10), f"{NEAR_START} 1, found 2 m"),
        (start(0), f"{NEAR_START} 1, found 4 m"),
        (start(0), f"{NEAR_START} 2, found 2 m"),
    ]


def test_starts_and_slots_at_the_very_limits_are_allowed(make: Make) -> None:
    rows = [(2, 0, 0, 25), (2, 0, 0, 20), (2, 0, 0, 0), (2, 0, 0, -20), (2, 0, 0, -25)]
    slots = [(0, y) for _, _, _, y in rows]
    scenario = make(uavs_at(rows), slots_at(slots), "assignment=shortest")
    assert not list(flaws(scenario))


def test_in_priority_only_links_keep_the_communication_distance(make: Make) -> None:
    """Five in a column, each linked to the one before it on its side of the leader."""
    column = [(0, y) for y in (60, 30, 0, -30, -60)]
    apart = [(10.0, 0, *place) for place in column]
    posed = (*FOLLOWING, slots_at(column), uavs_at(apart))
    assert not list(flaws(make(*posed, variant="corrected")))
    apart[4] = (10.0, 0, 0, -81)  # linked to the fourth, 51 m from it
    assert complaints(*posed[:-1], uavs_at(apart)) == [
        ("--set uavs", f"{FAR_START} 4, found 51 m")
    ]


def test_margins_and_links_are_none_and_one_unless_told(make: Make) -> None:
    scenario = make()
    assert scenario.distances.margin_m == 0.0 and scenario.distances.along == "points"
    assert (scenario.planning.name, scenario.planning.links) == ("joint", 1)


@pytest.mark.parametrize("heading", [0.0, np.pi])
def test_a_start_is_in_the_order_of_the_model(make: Make, heading: float) -> None:
    name = "reconfiguration_reverse" if heading else "reconfiguration"
    assert make(name=name).uavs[1].vector() == [2.0, heading, 0.0, 10.0]


def test_the_two_variants_differ_where_the_text_is_read(make: Make) -> None:
    literal, corrected = make(), make(variant="corrected")
    assert literal.vehicle.thrust_equation == "printed"
    assert corrected.vehicle.thrust_equation == "newton"
    assert literal.vehicle.speed_m_s is None and corrected.vehicle.speed_m_s is not None
    assert literal.order and corrected.order
    assert (literal.order.name, literal.order.weight) == ("static_penalty", 2e9)
    assert corrected.order.name == "feasibility_first"
