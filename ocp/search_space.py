"""What a population searches: control sequences, or members of a family.

A search knows a box and an objective; a space says which box, and what a point of it
means for the problem: where a polish starts.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.heuristics import Box
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.fitness import Fitness, Known, Objective, flatten, unflatten

Array = NDArray[np.float64]


class Start(NamedTuple):
    """Where a polish starts.

    Attributes:
        controls: Shape (nu, N).
        states: At the nodes, shape (nx, nodes); None: where the controls lead.
    """

    controls: Array
    states: Array | None = None


class SearchSpace(Protocol):
    """What a population searches."""

    @property
    def box(self) -> Box:
        """The box of its points."""

    def objective(self, x0: ArrayLike, known: Known) -> Objective:
        """Return population -> cost and violation, from an initial state."""

    def decoded(self, x: Array, x0: ArrayLike, known: Known) -> Start:
        """Return what a point, shape (dim,), means."""

    def encoded(self, controls: Array) -> Array:
        """Return the point of controls, shape (nu, N).

        Raises:
            InvalidProblemError: If controls have no point here.
        """


class ControlSpace:
    """All control sequences within the bounds; ca.vec of (nu, N).

    Attributes:
        box: The box of all control sequences.
    """

    def __init__(self, fitness: Fitness) -> None:
        """Take the problem's evaluator.

        Raises:
            InvalidProblemError: If a control is unbounded.
        """
        self._fitness = fitness
        self.box = _control_box(fitness)

    def objective(self, x0: ArrayLike, known: Known) -> Objective:
        """Return population -> cost and violation; see SearchSpace."""
        return self._fitness.objective(x0, known)

    def decoded(self, x: Array, x0: ArrayLike, known: Known) -> Start:
        """Return the controls; see SearchSpace."""
        del x0, known
        return Start(unflatten(x, self._fitness.problem.model.nu))

    def encoded(self, controls: Array) -> Array:
        """Return ca.vec of the controls; see SearchSpace."""
        return flatten(controls)


def _control_box(fitness: Fitness) -> Box:
    problem = fitness.problem
    if not problem.model.nu:
        raise InvalidProblemError(
            "a population search needs at least one control, got a model without any: "
            "solve it with search=None"
        )
    lower, upper = problem.control_limits
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        raise InvalidProblemError(
            "a population search needs finite bounds on every control, "
            f"got lower {lower} and upper {upper}"
        )
    return Box(
        lower=np.tile(lower, problem.intervals),
        upper=np.tile(upper, problem.intervals),
        per_step=problem.model.nu,
    )
