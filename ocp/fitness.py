"""Cost and violation of a whole population of control sequences.

A decision vector is ca.vec of the controls (nu, N): interval after interval.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.compiled.casadi_map import CasadiMap
from swarmstart.ocp.compiled.interface import BatchEvaluator
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.shooting import rollout, trajectory

Array = NDArray[np.float64]
Objective = Callable[[Array], tuple[Array, Array]]


class Known(NamedTuple):
    """What is known of one planning problem besides its initial state.

    Attributes:
        parameters: Shape (np,).
        signals: Shape (ns, nodes).
    """

    parameters: ArrayLike = ()
    signals: ArrayLike = ()


NOTHING = Known()


class Fitness:
    """The evaluator of one problem, compiled once, for any initial state.

    Attributes:
        problem: The problem.
        backend: What evaluates populations.
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        """Compile the rollout of a problem.

        Args:
            problem: The problem.
        """
        self.problem = problem
        self._evaluate: BatchEvaluator = CasadiMap(rollout(problem))
        self._trajectory = trajectory(problem)

    @property
    def backend(self) -> str:
        """What evaluates populations."""
        return self._evaluate.backend

    def objective(self, x0: ArrayLike, known: Known = NOTHING) -> Objective:
        """Return population (nu * N, size) -> cost (size,) and violation (size,).

        Args:
            x0: Initial state, shape (nx,).
            known: Parameters and signals.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or x0 not finite.
        """
        shared = self._shared(x0, known)

        def evaluate(population: Array) -> tuple[Array, Array]:
            cost, violation = self._evaluate(population, shared)
            return cost[0], violation[0]

        return evaluate

    def value(
        self, controls: Array, x0: ArrayLike, known: Known = NOTHING
    ) -> tuple[float, float]:
        """Return cost and violation of one control sequence, shape (nu, N)."""
        objective = self.objective(x0, known)
        cost, violation = objective(flatten(controls)[:, None])
        return float(cost[0]), float(violation[0])

    def states(self, controls: Array, x0: ArrayLike, known: Known = NOTHING) -> Array:
        """Return the states at the nodes, shape (nx, nodes), of controls (nu, N)."""
        shared = self._shared(x0, known)
        return np.array(self._trajectory(flatten(controls), *shared))

    def _shared(self, x0: ArrayLike, known: Known) -> tuple[Array, Array, Array]:
        problem = self.problem
        signals = np.asarray(known.signals, dtype=np.float64)
        if problem.ns == 0 and signals.size == 0:
            signals = np.empty((0, problem.nodes))
        return (
            _shaped("x0", x0, (problem.model.nx,)),
            _shaped("parameters", known.parameters, (problem.model.np,)),
            flatten(_shaped("signals", signals, (problem.ns, problem.nodes))),
        )


def flatten(sequence: Array) -> Array:
    """Return ca.vec of an array (rows, columns): column after column."""
    return np.asarray(sequence, dtype=np.float64).reshape(-1, order="F")


def unflatten(vector: Array, rows: int) -> Array:
    """Return the array (rows, columns) that `flatten` made a vector of; a copy."""
    return np.array(vector, dtype=np.float64).reshape((rows, -1), order="F")


def _shaped(role: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise InvalidProblemError(f"{role} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InvalidProblemError(f"{role} must be finite, got {array}")
    return array
