"""Finer checks and margins for the answers that break limits between the checks.

The lanes see a constraint at the checks only. If some answers break a limit between the
checks, by at most e, their instances are solved again with m times as many checks and
the limit moved by e / m^2: an excess between checks falls with the square of the
distance between checks. If an excess remains, the instances are solved once more, with
the limit moved by the whole of this excess in addition. Margins are the same for all
instances, so that one problem is compiled; `solve` would compile one for each instance.
The answers are judged by the limits of the user.
"""

from collections.abc import Iterator

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.answer.repair import finer_checks, tightened, with_more_checks
from swarmstart.ocp.instances.verification import FinePaths
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.rollout.checking import ConstraintRows, Excess
from swarmstart.ocp.rollout.fitness import Known, at_nodes, flatten
from swarmstart.ocp.rollout.path import signals_between
from swarmstart.ocp.statement.problem import OptimalControlProblem

_ATTEMPT = 2
"""Attempt of a repair that has as many checks: four times those of the problem."""
Amounts = dict[tuple[int, int], float]
"""(number of a path constraint, row in it) -> how far its limits are moved, in units of
the row."""


def with_margins(
    paths: FinePaths, instances: Instances, controls: Array, before: Amounts
) -> tuple[OptimalControlProblem, Amounts]:
    """Return the core with finer checks and margins, and how far its limits are moved.

    Args:
        paths: Verification of the answers.
        instances: Instances whose answers break a constraint, with their decisions.
        controls: Their controls, shape (nu, N, n).
        before: Margins that these answers were found with; empty: with none, and with
            the core's own checks.
    """
    tracer = paths.paths.tracer
    problem, rows = tracer.problem, tracer.checker.path
    relative, scales = paths.excesses(instances, controls)
    moved, times = dict(before), finer_checks(problem, _ATTEMPT)
    part = 1.0 if before else 1 / times**2
    for i, place in enumerate(rows.places):
        # Within the tolerance it needs no margin.
        beyond = relative[i] > problem.path_tolerance
        if beyond.any():
            worst = float((relative[i] * scales[i])[beyond].max())
            moved[place] = before.get(place, 0.0) + part * worst
    chosen = [
        one
        for i, place in enumerate(rows.places)
        if place in moved
        for one in _sides(rows, i, moved[place], float(scales[i].max()))
    ]
    unknown = Known(signals=np.zeros((problem.ns, problem.nodes)))
    finer, _ = with_more_checks(problem, unknown, times)
    return tightened(finer, chosen), moved


def at_other_nodes(
    core: OptimalControlProblem, other: OptimalControlProblem, instances: Instances
) -> Instances:
    """Return instances with their signals at the nodes of another problem.

    Args:
        core: The core that the instances belong to.
        other: The core with other checks.
        instances: The instances.
    """
    if not core.ns or core.checks == other.checks:
        return instances
    signals = [
        flatten(signals_between(core, at_nodes(core, one), other.times))
        for one in instances.signals.T
    ]
    return instances._replace(signals=np.stack(signals, axis=-1))


def _sides(
    rows: ConstraintRows, i: int, amount: float, scale: float
) -> Iterator[Excess]:
    """Yield an excess of each limit of a row."""
    number, row = rows.places[i]
    for above, limits in ((False, rows.lower), (True, rows.upper)):
        if np.isfinite(limits[i, 0]):
            yield Excess(
                name=rows.names[i],
                amount=amount,
                scale=scale,
                time=0.0,
                constraint=number,
                row=row,
                above=above,
            )
