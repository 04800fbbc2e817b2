"""Sentences on the result of a swarm's flight; goals and obstacles for its pages."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.vehicles import Disc, Surroundings, standing
from swarmstart.cases.drawing.wording import is_number, number_of, quantity
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.kinds.swarm.scenario import SwarmScenario
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return a sentence on how many vehicles arrive, and when."""
    end, share = float(trajectory.times[-1]), number_of(measures.get("arrived_share"))
    last = measures.get("arrival_time_s")
    if is_number(last):
        said = f"All vehicles have arrived after {quantity(number_of(last))} s"
    else:
        said = f"{share:.1%} of the vehicles arrive within {quantity(end)} s"
    ratio = measures.get("path_ratio")
    if is_number(ratio):
        times = quantity(number_of(ratio), 3)
        said += f"; the median path has {times} times the length of the straight way"
    return f"{said}."


def kept(measures: Mapping[str, Measure]) -> tuple[str, bool]:
    """Return a sentence on the least distance of vehicles, and whether it is kept."""
    near = measures.get("min_distance_m")
    pairs = int(number_of(measures.get("collisions")))
    hits = int(number_of(measures.get("obstacle_hits")))
    parts = []
    if pairs:
        parts.append(f"{counted(pairs, 'pair')} of vehicles collide")
    if hits:
        parts.append(f"{counted(hits, 'vehicle')} hit an obstacle")
    if is_number(near):
        parts.append(f"the nearest two are {quantity(number_of(near), 3)} m apart")
    said = "; ".join(parts)
    return f"{said[:1].upper()}{said[1:]}." if said else "", not (pairs or hits)


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the goals, and obstacles that do not move; see `surroundings_of`."""
    del positions, headings
    read = SwarmScenario.model_validate(dict(scenario))
    swarm = read.controller().swarm
    return Surroundings(
        discs=[
            Disc(x=float(x), y=float(y), radius=one.radius, name=f"obstacle {number}")
            for number, one in enumerate(swarm.obstacles)
            if len(one.path) == 1
            for x, y, _ in np.atleast_2d(one.path)
        ],
        targets=standing(swarm.goals[:, :2], times),
        called="goal",
    )
