"""Many UAVs that plan one after the other: time of a step against what each sees.

    python benchmarks/formation_100.py --write docs/measured/formation_100.md

The scenario formation_100 with 25, 50 and 100 UAVs, and with longer ranges of sight.
"""

import statistics
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.reconfiguration.measures import measure
from swarmstart.cases.kinds.reconfiguration.pose import pose
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import LocalTeam, Trajectory, simulate

SPACING_M = 15
SIZES = (25, 50, 100)
RANGES_M = (35, 70, 140)


class Flown(NamedTuple):
    """One flight.

    Attributes:
        uavs: How many.
        range_m: How far each sees.
        neighbours: Mean number that a UAV avoids.
        seconds: Median of a step.
        min_distance_m: Over the whole path.
        position_error_m: At the end.
    """

    uavs: int
    range_m: float
    neighbours: float
    seconds: float
    min_distance_m: float
    position_error_m: float


def scenario_of(uavs: int, range_m: float, steps: int) -> ReconfigurationScenario:
    """Return formation_100 with another number of UAVs: a square, then a wedge."""
    side = int(np.ceil(np.sqrt(uavs)))
    middle = (side - 1) / 2
    starts = [
        (-SPACING_M * r, SPACING_M * (k - middle))
        for r in range(side)
        for k in range(side)
    ]
    slots = [
        (-SPACING_M * r, SPACING_M * (r - k))
        for r in range(side)
        for k in range(2 * r + 1)
    ]
    given = ", ".join(
        f"{{speed_m_s: 20, heading_rad: 0, x_m: {x}, y_m: {y}}}"
        for x, y in starts[:uavs]
    )
    wanted = ", ".join(f"{{x_m: {x}, y_m: {y}}}" for x, y in slots[:uavs])
    scenario = resolve(
        read_document("formation_100"),
        assignments=[
            f"uavs=[{given}]",
            f"slots=[{wanted}]",
            f"leader_uav={(side + 1) // 2}",
            f"planning.range_m={range_m}",
            f"steps={steps}",
        ],
    ).scenario
    if not isinstance(scenario, ReconfigurationScenario):
        raise TypeError(f"expected a reconfiguration, got {scenario.kind}")
    return scenario


def fly(uavs: int, range_m: float, steps: int) -> Flown:
    """Fly one, seed 0."""
    scenario = scenario_of(uavs, range_m, steps)
    flight = flight_of(pose(scenario), scenario)
    team = flight.controller
    if not isinstance(team, LocalTeam):
        raise TypeError("expected a team that plans in order")
    trajectory = simulate(
        flight.plant, team, flight.x0, steps=steps, rng=np.random.default_rng(0)
    )
    measures = measure(scenario, flight, trajectory)
    return Flown(
        uavs=uavs,
        range_m=range_m,
        neighbours=neighbours_of(team, trajectory),
        seconds=statistics.median(trajectory.step_seconds.tolist()),
        min_distance_m=float(str(measures["min_distance_m"])),
        position_error_m=float(str(measures["position_error_m"])),
    )


def neighbours_of(team: LocalTeam, trajectory: Trajectory) -> float:
    """Return the mean number of UAVs that one avoids, over UAVs and steps."""
    uavs, states = len(team.agents), trajectory.states[:, :-1].T
    counts = [
        len(team.within_range(shown, state.reshape(uavs, -1), number))
        for decision, state in zip(trajectory.decisions, states, strict=True)
        for shown in [{j: plan.states for j, plan in enumerate(decision.plans)}]
        for number in team.order
    ]
    return statistics.mean(counts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--steps", type=int, default=60)
    options = parser.parse_args(arguments)
    asked = [(uavs, RANGES_M[0]) for uavs in SIZES]
    asked += [(SIZES[-1], range_m) for range_m in RANGES_M[1:]]
    flights = [fly(uavs, range_m, options.steps) for uavs, range_m in asked]
    publish(_table(flights), options, _HEAD)
    return 0


def _table(flights: Sequence[Flown]) -> list[str]:
    lines = head(
        "UAVs", "range [m]", "neighbours of a UAV", "step [s]", "UAV [ms]",
        "UAV and neighbour [ms]", "smallest distance [m]", "error at the end [m]",
    )  # fmt: skip
    for one in flights:
        each = 1e3 * one.seconds / one.uavs
        lines.append(
            row(
                str(one.uavs),
                f"{one.range_m:g}",
                f"{one.neighbours:.1f}",
                f"{one.seconds:.3f}",
                f"{each:.2f}",
                f"{each / one.neighbours:.2f}",
                f"{one.min_distance_m:.2f}",
                f"{one.position_error_m:.3f}",
            )
        )
    return lines


_HEAD = """# 100 UAVs that plan one after another

Made by `python benchmarks/formation_100.py --write docs/measured/formation_100.md`,
seed 0, 60 steps of 0.5 s. A neighbour of a UAV is another UAV whose plan comes within
range of its own. In a step all UAVs plan, one after another on one core; its time is
the median over the steps. The smallest distance is that of the whole path, also between
the plant's steps; at least 5 m are demanded. The error at the end is the largest
distance of a UAV from its slot after the last step.

"""


if __name__ == "__main__":
    sys.exit(main())
