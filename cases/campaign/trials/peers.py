"""Searches of other packages, on the same objective, in the same box.

Each search runs as in its package, with the package's own defaults unless options
replace them, and can end by its own rules. It minimises one number,

    cost + weight * violation,

the static penalty: the weight is that of the scenario's order if that is a static
penalty, else WORTH times the natural size of the cost, which does not depend on units.
Values that are not finite count as LARGEST. Its best point is the best of all points
that it has evaluated: feasible before infeasible, then by cost. So no peer has a
disadvantage from its order of points.

SciPy and cmaes evaluate whole generations, which the compiled evaluator computes at
once. pagmo evaluates point by point, with about ten microseconds of Python each:
compare it by evaluations rather than seconds.

A budget ends a peer by an exception from the objective: the last generation is cut at
the budget's last evaluation.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Box

LARGEST = 1e30
"""Value that replaces one that is not finite."""
WORTH = 1e3
"""Penalty of a violation of 1, in natural sizes of the cost."""
_ENDLESS = 10**9
"""Number of generations that no budget reaches."""


class BudgetSpent(Exception):  # noqa: N818 - no error
    """The budget of a peer is spent."""


class PeerError(SwarmstartError):
    """A solver of another package refuses its options or its problem."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PeerTask:
    """Task of a peer.

    Attributes:
        objective: Population (dim, size) -> values to minimise (size,); raises
            BudgetSpent.
        box: Bounds of the search.
        seed: Seed of its random numbers.
        options: Its options; missing ones and None mean the package's default.
    """

    objective: Callable[[Array], Array]
    box: Box
    seed: int
    options: Mapping[str, Any]

    def given(self, *names: str) -> dict[str, Any]:
        """Return the options with these names that have a value."""
        return {n: self.options[n] for n in names if self.options.get(n) is not None}


def penalised(cost: Array, violation: Array, weight: float) -> Array:
    """Return the values that a peer minimises.

    Args:
        cost: Costs, shape (size,).
        violation: Violations, same shape.
        weight: Penalty of a violation of 1.
    """
    values = cost + weight * violation
    return np.where(np.isfinite(values), np.minimum(values, LARGEST), LARGEST)


def scipy_de(task: PeerTask) -> None:
    """Run `scipy.optimize.differential_evolution`, a generation at a time."""
    from scipy.optimize import differential_evolution

    names = inspect.signature(differential_evolution).parameters
    seeding = "rng" if "rng" in names else "seed"
    differential_evolution(
        task.objective,
        list(zip(task.box.lower, task.box.upper, strict=True)),
        maxiter=_ENDLESS,
        polish=False,
        vectorized=True,
        updating="deferred",
        **{seeding: np.random.default_rng(task.seed)},
        **task.given("popsize", "strategy", "mutation", "recombination", "tol", "init"),
    )


def pygmo_de(task: PeerTask) -> None:
    """Run `pygmo.de`."""
    _evolve(task, "de", **task.given("F", "CR", "variant", "ftol", "xtol"))


def pygmo_de1220(task: PeerTask) -> None:
    """Run `pygmo.de1220`."""
    _evolve(task, "de1220", **task.given("variant_adptv", "ftol", "xtol"))


def pygmo_pso(task: PeerTask) -> None:
    """Run `pygmo.pso`."""
    names = ("omega", "eta1", "eta2", "max_vel", "variant", "neighb_type")
    _evolve(task, "pso", **task.given(*names, "neighb_param"))


def pygmo_cmaes(task: PeerTask) -> None:
    """Run `pygmo.cmaes`, within the bounds."""
    given = task.given("sigma0", "ftol", "xtol")
    _evolve(task, "cmaes", force_bounds=True, **given)


class _Posed:
    """The problem for pagmo; a copy is the same object, since it counts evaluations."""

    def __init__(self, task: PeerTask) -> None:
        self._task = task

    def __deepcopy__(self, memo: object) -> _Posed:
        return self

    def fitness(self, x: Array) -> list[float]:
        return [float(self._task.objective(np.array(x)[:, None])[0])]

    def get_bounds(self) -> tuple[Array, Array]:
        return self._task.box.lower, self._task.box.upper


def _evolve(task: PeerTask, name: str, **options: Any) -> None:
    """Run an algorithm of pagmo."""
    import pygmo

    kind = getattr(pygmo, name)
    algorithm = pygmo.algorithm(kind(gen=_ENDLESS, seed=task.seed, **options))
    posed = pygmo.problem(_Posed(task))
    size = task.options.get("size", 20)
    population = pygmo.population(posed, size=size, seed=task.seed)
    algorithm.evolve(population)


def cmaes_ipop(task: PeerTask) -> None:
    """Run `cmaes.CMA`, from the middle of the box, restarted with twice its size.

    In the box scaled to [0, 1]; later starts are drawn from it (IPOP).
    """
    from cmaes import CMA

    box, rng = task.box, np.random.default_rng(task.seed)
    if box.dim == 1:
        raise PeerError("cmaes needs at least 2 variables, found 1")
    mean, size = np.full(box.dim, 0.5), task.options.get("size")
    while True:
        search = CMA(
            mean=mean,
            sigma=task.options.get("sigma") or 0.3,
            bounds=np.tile([0.0, 1.0], (box.dim, 1)),
            seed=int(rng.integers(2**31)),
            population_size=size,
        )
        while not search.should_stop():
            asked = [search.ask() for _ in range(search.population_size)]
            points = np.stack(asked, axis=1)
            values = task.objective(box.lower[:, None] + box.width[:, None] * points)
            search.tell(list(zip(asked, values.tolist(), strict=True)))
        mean, size = rng.random(box.dim), 2 * search.population_size


def peers_best(run: Callable[[PeerTask], None], task: PeerTask, name: str) -> bool:
    """Run a peer; return whether it ended by itself.

    Args:
        run: The peer.
        task: Its task.
        name: Its name, for messages.

    Raises:
        PeerError: If it refuses its options.
    """
    try:
        run(task)
    except BudgetSpent:
        return False
    except (ValueError, TypeError, RuntimeError, AssertionError) as error:
        if "BudgetSpent" in str(error):  # As text, through a library's own handler.
            return False
        said = " ".join(str(error).split()) or type(error).__name__
        raise PeerError(f"{name} cannot be run: {said}") from error
    return True
