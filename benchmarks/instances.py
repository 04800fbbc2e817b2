"""Many instances in interior-point lanes against CasADi's Opti with IPOPT, in one run.

    python benchmarks/instances.py [--write docs/measured/instances.md] [--solves 16]

Seconds are CPU time of the process, with one thread. The lanes solve all instances,
Opti some of them, evenly spread, one after another.
"""

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.benchmarks.quadrotor import Task, cylinders, tracking
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.ocp import Known, Planner
from swarmstart.ocp.lanes.answers import reached
from swarmstart.ocp.lanes.interior import Instances, InteriorLanes

SAME = 1e-3
"""Relative difference up to which an answer costs as much as the peer's."""
NO_EXPAND, EXPAND = 33.0, 12.0
TEXT = """# Many instances at once

Made by `python benchmarks/instances.py --write docs/measured/instances.md`: a quadrotor
with 13 states that goes to the origin among four cylinders, from 80 starts on an arc,
or follows a reference among three moving cylinders, from 250 random starts. The lanes
are compared with CasADi's Opti with IPOPT, without and with `expand`. Both have one
start for each instance: a straight line and hovering. "As cheap" is the share of lanes
that are feasible and cost at most 1e-3 more than the Opti's answer, among the instances
that both solved. The time of the lanes is that of all lanes, also of those that fail,
and does not contain the verification of the answers.

"""


class Compared(NamedTuple):
    """Results of one task.

    Attributes:
        name: Its name.
        lane_ms: CPU time of a lane [ms].
        peer_ms: CPU time of a solve of the peer, without and with `expand` [ms].
        feasible: Number of feasible lanes, and of all.
        as_cheap: Share of lanes that are as cheap as the peer's answer.
        iterations: Mean number of steps of a lane.
    """

    name: str
    lane_ms: float
    peer_ms: tuple[float, float]
    feasible: tuple[int, int]
    as_cheap: float
    iterations: float


def posed(planner: Planner, task: Task) -> Instances:
    """Return the instances of a task for the core of its problem."""
    columns = []
    for number in range(task.x0.shape[1]):
        signals = [values[:, number] for values in task.known.values()]
        known = Known(signals=np.array(signals)) if signals else Known()
        x0, core, _ = planner.posed(task.x0[:, number], known)
        flat = np.asarray(core.signals).ravel(order="F")
        columns.append((np.asarray(x0), np.asarray(core.parameters), flat))
    return Instances(*(np.stack(part, axis=-1) for part in zip(*columns, strict=True)))


def compared(name: str, task: Task, solves: int) -> Compared:
    """Return the results of the lanes and of the peer.

    Args:
        name: Name of the task.
        task: The task.
        solves: Number of instances that the peer solves.
    """
    planner = Planner(task.problem, search=None, polish=None)
    lanes, instances = InteriorLanes(planner.fitness.shooting), posed(planner, task)
    M = task.x0.shape[1]
    controls = np.repeat(task.guess[:, :, None], M, axis=2)
    given = instances, controls, np.zeros((0, M)), task.states
    lanes(*given)  # Compiles.
    begin = time.process_time()
    found = lanes(*given)
    lane_ms = 1e3 * (time.process_time() - begin) / M
    chosen = np.unique(np.linspace(0, M - 1, solves).astype(int)).tolist()
    spent, costs = [], np.empty(0)
    for expand in (False, True):
        peer = task.peer(expand)
        peer(chosen[0])
        begin = time.process_time()
        costs = np.array([peer(number) for number in chosen])
        spent.append(1e3 * (time.process_time() - begin) / len(chosen))
    feasible = reached(found)
    return Compared(
        name=name,
        lane_ms=lane_ms,
        peer_ms=(spent[0], spent[1]),
        feasible=(int(feasible.sum()), M),
        as_cheap=_share(feasible[chosen], found.cost[chosen], costs),
        iterations=float(found.iterations.mean()),
    )


def _share(feasible: NDArray[np.bool_], costs: Array, peer: Array) -> float:
    """Return the share of answers that are feasible and as cheap as the peer's."""
    solved = np.isfinite(peer)
    cheap = costs[solved] <= peer[solved] + SAME * np.abs(peer[solved])
    return float(np.mean(feasible[solved] & cheap))


def line(one: Compared) -> str:
    """Return the row of a task."""
    feasible, count = one.feasible
    return row(
        one.name, f"{one.lane_ms:.2f}", *(f"{ms:.0f}" for ms in one.peer_ms),
        *(f"{ms / one.lane_ms:.0f}" for ms in one.peer_ms),
        f"{feasible} of {count}", f"{one.as_cheap:.2f}", f"{one.iterations:.0f}",
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, and write it where asked."""
    parser = page_options(__doc__)
    parser.add_argument("--solves", type=int, default=16, help="solves of the peer")
    options = parser.parse_args(arguments)
    tasks = {f"arc of {angle} degrees": cylinders(angle) for angle in (90, 180)}
    tasks |= {f"reference, {speed} rad/s": tracking(speed) for speed in (1.0, 1.5, 2.0)}
    found = []
    for name, task in tasks.items():
        found.append(compared(name, task, options.solves))
        print(line(found[-1]), flush=True)
    lines = head("task", "lane [ms]", "Opti [ms]", "with expand [ms]", "times",
                 "times with expand", "feasible", "as cheap", "steps")  # fmt: skip
    lines += map(line, found)
    without, expanded = (
        min(one.peer_ms[i] / one.lane_ms for one in found) for i in range(2)
    )
    bars = [
        Bar("least ratio without expand", ">=", NO_EXPAND, without),
        Bar("least ratio with expand", ">=", EXPAND, expanded),
        Bar("least share that is as cheap", ">=", 0.95, min(o.as_cheap for o in found)),
    ]
    publish([*lines, "", *bar_table(bars)], options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
