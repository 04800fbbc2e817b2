"""Other starts for instances that failed: neighbours' answers, random controls.

The neighbour of an instance is the solved one whose data are nearest, each number
divided by its range over all instances:

    d(i, k)^2 = sum over x0, parameters    ((a_i - a_k) / range(a))^2
              + sum over signals  mean over nodes of the same

a_i is the value of a number a (an initial state, a parameter) in instance i.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.instances.outcomes import Answers
from swarmstart.ocp.lanes.interior import Instances
from swarmstart.ocp.lanes.solver import random_starts
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import started
from swarmstart.ocp.statement.problem import OptimalControlProblem

CHEAPER = 1e-4
"""Least relative difference of two costs that counts."""
_CURVED = 0.2
"""The same, relative to the second-order terms of the cost between neighbours."""


class Neighbours:
    """Distances between the instances of a rewritten problem (core)."""

    def __init__(self, core: OptimalControlProblem, instances: Instances) -> None:
        """Scale the data of all instances.

        Args:
            core: The rewritten problem (core).
            instances: Data of all instances.
        """
        rows = np.vstack([*instances])
        width = np.ptp(rows, axis=1)
        scale = np.where(width > 0, width, np.inf)
        if core.ns:
            scale[-core.ns * core.nodes :] *= np.sqrt(core.nodes)
        # All are at one place if none differs; a tree needs a coordinate.
        varied = width > 0 if width.any() else np.arange(width.size) == 0
        self._rows = np.ascontiguousarray((rows / scale[:, None])[varied].T)

    def nearest(
        self, chosen: NDArray[np.int64], solved: NDArray[np.int64], count: int
    ) -> NDArray[np.int64]:
        """Return the nearest solved instances of each chosen one, the nearest first.

        Shape (n, count); -1 if there are fewer. An instance is no neighbour of itself.

        Args:
            chosen: Numbers of instances, shape (n,).
            solved: Numbers of the solved ones.
            count: Number of neighbours.
        """
        from scipy.spatial import KDTree

        # One more, since the nearest of all may be the instance itself.
        tree = KDTree(self._rows[solved])
        _, found = tree.query(self._rows[chosen], k=range(1, count + 2))
        numbers = np.append(solved, -1)[found]  # Places beyond the end are missing.
        is_own = numbers == chosen[:, None]
        order = np.argsort(is_own, axis=1, kind="stable")
        numbers = np.where(is_own, -1, numbers)
        return np.take_along_axis(numbers, order, axis=1)[:, :count]


def is_cheaper(costs: Array, before: Array) -> NDArray[np.bool_]:
    """Return a mask of the costs that are below earlier ones, which may be infinite.

    Args:
        costs: Shape (n,).
        before: Shape (n,).
    """
    least = CHEAPER * np.where(np.isfinite(before), np.abs(before), 0.0)
    return np.asarray(costs < before - least)


def promises(
    core: OptimalControlProblem,
    instances: Instances,
    answers: Answers,
    around: NDArray[np.int64],
) -> Array:
    """Return how clearly neighbours' optima promise to be cheaper at instances.

    Shape (n, count): the expected gain divided by the least gain that counts; 0 if this
    quotient is at most 1, infinite if an instance has no confirmed answer. If an
    instance i and its neighbour k are in the same valley, the costates lam give the
    difference of their costs V, with the initial states x, up to terms of third order:

        V_i - V_k = (lam_i + lam_k)' (x_i - x_k) / 2

    If V_i - V_k is larger than the right-hand side, the two optima differ, and the
    excess is half the sum of the gains of the neighbour's optimum at i and at k. A gain
    counts if it is at least `CHEAPER` times the cost, and at least `_CURVED` times the
    terms of second order, (lam_i - lam_k)' (x_i - x_k).

    Args:
        core: The rewritten problem (core).
        instances: Data of all instances.
        answers: Answers to these instances.
        around: Numbers of each instance's neighbours, -1 if there are fewer.
    """
    own = np.where(answers.confirmed, answers.cost, np.inf)[:, None]
    costs = np.where(around >= 0, answers.cost[around], np.inf)
    apart = instances.x0[:, :, None] - instances.x0[:, around]
    for one in core.free_starts:
        apart[list(one.states)] = 0.0
    here, there = answers.costates[:, :, None], answers.costates[:, around]
    told = np.sum((here + there) * apart, axis=0) / 2
    curved = np.abs(np.sum((here - there) * apart, axis=0))
    # Costates say nothing of other data that differ.
    others = np.vstack([instances.parameters, instances.signals])
    others = others[(others != others[:, :1]).any(axis=1)]
    known = np.isfinite(told) & (others[:, :, None] == others[:, around]).all(axis=0)
    expected = costs + np.where(known, told, 0.0)
    with np.errstate(invalid="ignore"):
        size = np.maximum(np.abs(expected), np.where(np.isfinite(own), own, 0.0))
        least = np.maximum(CHEAPER * size, np.where(known, _CURVED * curved, 0.0))
        gains = (own - expected) / np.maximum(least, 1e-300)
    return np.where(gains > 1, gains, 0.0)


def starts_from(
    core: OptimalControlProblem,
    instances: Instances,
    answers: Answers,
    chosen: NDArray[np.int64],
    neighbours: NDArray[np.int64],
) -> list[Start]:
    """Return answers of neighbours as starts of some instances.

    Args:
        core: The rewritten problem (core).
        instances: Data of all instances.
        answers: Answers to these instances.
        chosen: Numbers of the instances, shape (n,).
        neighbours: Numbers of the neighbours, shape (n,).
    """
    found = []
    for own, other in zip(chosen, neighbours, strict=True):
        decided = _decided(core, answers.x0[:, other])
        x0 = started(core, instances.x0[:, own], decided)
        states = answers.states[:, :, other].copy()
        states[:, 0] = x0
        found.append(Start(answers.controls[:, :, other], states, x0))
    return found


def random_start(core: OptimalControlProblem, seed: Sequence[int]) -> Start | None:
    """Return random controls and decisions, the same for all instances.

    None if the problem has nothing to draw. In the initial state only decided entries
    are set; the others are NaN.

    Args:
        core: The rewritten problem (core).
        seed: Seed of the random controls.
    """
    if not core.model.nu:
        return None
    controls, decided = random_starts(core, 1, np.random.default_rng(seed))
    x0 = started(core, np.full(core.model.nx, np.nan), decided[:, 0])
    return Start(controls[:, :, 0], x0=x0)


def at_instances(
    core: OptimalControlProblem,
    instances: Instances,
    chosen: NDArray[np.int64],
    start: Start,
) -> list[Start]:
    """Return one start for some instances, each with its own initial state.

    Args:
        core: The rewritten problem (core).
        instances: Data of all instances.
        chosen: Numbers of the instances.
        start: The start; in its initial state only decided entries are used.
    """
    drawn = np.full(core.model.nx, np.nan) if start.x0 is None else start.x0
    decided = _decided(core, drawn)
    return [
        start._replace(x0=started(core, instances.x0[:, number], decided))
        for number in chosen
    ]


def with_decisions_of(
    core: OptimalControlProblem, instances: Instances, x0: Array
) -> Instances:
    """Return instances with the decided initial states of other instances.

    Args:
        core: The rewritten problem (core).
        instances: Instances.
        x0: Initial states of as many other instances, shape (nx, n); only the decided
            entries are used.
    """
    found = instances.x0.copy()
    for one in core.free_starts:
        places = list(one.states)
        found[places] = x0[places]
    return instances._replace(x0=found)


def _decided(core: OptimalControlProblem, x0: Array) -> Array:
    """Return the decisions about the start, shape (ny,)."""
    return x0[[one.states[0] for one in core.free_starts]]
