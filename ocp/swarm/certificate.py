"""Certificate of a swarm's flight: all that a proof of it needs, as text.

It has the samples and bulges of every plan that was proposed, when it was proposed,
committed to or withdrawn, and when each other vehicle accepted it. The command `python
-m swarmstart.terminal_set.check FILE` proves from it that no two vehicles came too
near, and that the rule was kept, without code of `ocp/swarm`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import Count
from swarmstart.ocp.swarm.plans import Plans
from swarmstart.ocp.swarm.swarm import Swarm
from swarmstart.terminal_set.certificates import digest

FORMAT = "swarmstart swarm flight certificate"
VERSION = 1
STATEMENTS = (
    "each plan begins as the one that it replaces, until they part",
    "no two vehicles come nearer than the distance, at any time from the start on",
    "no vehicle comes nearer to an obstacle than its clearance",
    "each plan was accepted by all others before it was committed to, or they had "
    "committed to their last plan, and was clear then of what they had committed to "
    "and proposed",
)
OPEN, START = -2, -1
"""Ticks of what has not happened, and of what was so at the start."""


class Log(NamedTuple):
    """All plans of a flight, and what became of them.

    Attributes:
        plans: The plans; the first n are those of the start.
        vehicle: Number of each plan's vehicle, shape (rows,).
        parting: Step at which each plan parts from the plan before, shape (rows,).
        proposed: Tick of each plan's proposal; START for a plan of the start; shape
            (rows,).
        ended: Tick of each plan's commitment or withdrawal; START for a plan of the
            start, OPEN if neither has happened; shape (rows,).
        committed: Whether each plan was committed to, shape (rows,).
        accepted: Tick at which each vehicle accepted each plan; OPEN if it has not;
            shape (rows, n).
        ticks: Number of ticks in a step.
        steps: Number of steps of the flight.
        step_s: Step of the grid of times [s].
    """

    plans: Plans
    vehicle: Count
    parting: Count
    proposed: Count
    ended: Count
    committed: Count
    accepted: Count
    ticks: int
    steps: int
    step_s: float


def certificate_text(
    log: Log, distance: float, obstacles: Sequence[dict[str, object]] = ()
) -> str:
    """Return the certificate of a flight as JSON.

    Args:
        log: The flight's plans.
        distance: Least distance of two plans [m].
        obstacles: The obstacles, as from `obstacle_paths`.
    """
    content: dict[str, object] = {
        "format": FORMAT,
        "version": VERSION,
        "vehicles": log.accepted.shape[1],
        "steps": log.steps,
        "ticks": log.ticks,
        "distance": distance,
        "plans": [_plan(log, row) for row in range(len(log.vehicle))],
        "obstacles": list(obstacles),
        "statements": [
            {"statement": words, "grounds": "proven"} for words in STATEMENTS
        ],
    }
    content["sha256"] = digest(content)
    return json.dumps(content, allow_nan=False) + "\n"


def _plan(log: Log, row: int) -> dict[str, object]:
    """Return a plan as data."""
    ended = int(log.ended[row])
    return {
        "vehicle": int(log.vehicle[row]),
        "parting": int(log.parting[row]),
        "proposed": int(log.proposed[row]),
        "ended": None if ended == OPEN else ended,
        "committed": bool(log.committed[row]),
        "accepted": [
            None if tick == OPEN else tick for tick in log.accepted[row].tolist()
        ],
        **_path(
            int(log.plans.first[row]), log.plans.samples[row], log.plans.bulges[row]
        ),
    }


def _path(first: int, samples: Array, bulges: Array) -> dict[str, object]:
    """Return samples and bulges up to the rest."""
    moving = np.flatnonzero((samples != samples[-1]).any(axis=1))
    end = int(moving[-1]) + 1 if moving.size else 0
    return {
        "first": first,
        "samples": samples[: end + 1].tolist(),
        "bulges": [*bulges[:end].tolist(), float(bulges[-1])],
    }


def obstacle_paths(swarm: Swarm, step_s: float) -> list[dict[str, object]]:
    """Return the obstacles, each with the distance to keep from its centre."""
    found = []
    for one in swarm.obstacles:
        times = np.arange(np.ceil(one.times[-1] / step_s) + 2) * step_s
        bulges = np.append(one.bulge(times), 0.0) * swarm.scale.max()
        found.append(
            {
                "clearance": swarm.clearance(one),
                **_path(0, one.position(times) * swarm.scale, bulges),
            }
        )
    return found
