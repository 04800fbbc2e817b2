"""Ask and tell: a search one generation at a time.

A generation is `points = search.ask()`, then `search.tell(*objective(points))`; what
was found is `search.best`.
"""

import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.algorithm import Algorithm, InvalidSettingsError, State
from swarmstart.heuristics.box import Box, InvalidPointsError
from swarmstart.heuristics.compiled_loop import (
    CompiledObjective,
    Work,
    loop_of,
    new_work,
)
from swarmstart.heuristics.interrupts import put_off
from swarmstart.heuristics.kernel import Array
from swarmstart.heuristics.order import Order, feasibility_first
from swarmstart.heuristics.sampling import sample_uniform


class AskTellError(SwarmstartError, RuntimeError):
    """`ask` and `tell` were not called in turn."""


class InvalidEvaluationError(SwarmstartError, ValueError):
    """What an objective returned is no cost and violation of each individual.

    Attributes:
        name: "cost", "violation", or "objective" if it is no pair at all.
    """

    def __init__(self, message: str, *, name: str) -> None:
        """Keep the name beside the message."""
        super().__init__(message)
        self.name = name


class Individual(NamedTuple):
    """A point with its cost and violation.

    Attributes:
        x: The point, shape (dim,).
        cost: Its cost.
        violation: Its violation, at least 0; 0 = feasible.
    """

    x: Array
    cost: float
    violation: float


class Search:
    """A search, driven one generation at a time by `ask` and `tell`.

    Attributes:
        algorithm: Settings of the algorithm.
        box: The box that all points lie in.
        order: How individuals are ordered.
        rng: Source of randomness; the search advances it.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        box: Box,
        *,
        rng: np.random.Generator,
        order: Order | None = None,
        initial: ArrayLike | None = None,
        state: State | None = None,
    ) -> None:
        """Draw the initial population, or continue from a state.

        Args:
            algorithm: Settings of the algorithm.
            box: The box to search.
            rng: Source of randomness, kept and advanced.
            order: How individuals are ordered; None means `feasibility_first()`.
            initial: Points that become the first columns of the initial population,
                shape (dim, k), k at most algorithm.size, in the box; copied. The others
                are drawn uniformly in the box. None means all are.
            state: State of a search with the same arguments, to continue from; copied.
                With `rng` in the state it had then, it continues bit for bit. Excludes
                `initial`.

        Raises:
            InvalidPointsError: If initial points do not fit.
            InvalidSettingsError: If the settings do not fit the box, rng is no
                Generator, or both `initial` and `state` are given.
        """
        if not isinstance(rng, np.random.Generator):
            raise InvalidSettingsError("rng", rng, "a numpy.random.Generator")
        if initial is not None and state is not None:
            allowed = "None where state is given"
            raise InvalidSettingsError("initial", initial, allowed)
        self.algorithm = algorithm
        self.box = box
        self.order = feasibility_first() if order is None else order
        self.rng = rng
        self._settings = algorithm.kernel_settings(box, self.order)
        if state is None:
            population = _initial_population(algorithm, box, initial, rng=rng)
            with put_off():
                self._state = algorithm.start(box, population, rng=rng)
        else:
            self._state = copy.deepcopy(state)
        self._asked = np.empty((box.dim, algorithm.size))
        self._waiting = False

    @property
    def best(self) -> Individual:
        """The best individual so far; its cost is infinite if none was finite."""
        state = self._state
        return Individual(
            x=state.best.copy(),
            cost=float(state.best_cost[0]),
            violation=float(state.best_violation[0]),
        )

    @property
    def generations(self) -> int:
        """Number of generations told."""
        return int(self._state.generation[0])

    @property
    def evaluations(self) -> int:
        """Number of individuals told."""
        return self.generations * self.algorithm.size

    @property
    def nonfinite(self) -> int:
        """Number of individuals told whose cost or violation was not finite."""
        return int(self._state.nonfinite[0])

    @property
    def state(self) -> State:
        """A copy of the state, a NamedTuple of plain arrays, to save and continue."""
        return copy.deepcopy(self._state)

    def ask(self, *, progress: float | None = None) -> Array:
        """The next generation to evaluate.

        Args:
            progress: Fraction of the budget used, in [0, 1]; falling inertia depends on
                it. None leaves it as it was; it starts at 0.

        Returns:
            The points as columns, shape (dim, size): a new array, read-only.

        Raises:
            AskTellError: If the generation asked before was not told yet.
            InvalidSettingsError: If progress is not in [0, 1].
        """
        if self._waiting:
            raise AskTellError("ask() before tell(): a generation is not evaluated yet")
        if progress is not None:
            if not 0.0 <= progress <= 1.0:
                raise InvalidSettingsError("progress", progress, "in [0, 1]")
            self._state.progress[0] = progress
        propose = self.algorithm.kernels.propose
        with put_off():
            propose(self.rng, self._settings, self._state, self._asked)
        self._waiting = True
        points = self._asked.copy()
        points.setflags(write=False)
        return points

    def tell(self, cost: ArrayLike, violation: ArrayLike) -> None:
        """Give the costs and violations of the generation asked last.

        Args:
            cost: Costs, shape (size,); NaN and infinity rank last. Copied.
            violation: Violations, shape (size,), at least 0. Copied.

        Raises:
            AskTellError: If no generation was asked.
            InvalidEvaluationError: If a shape is wrong or a violation is negative.
        """
        if not self._waiting:
            raise AskTellError("tell() before ask(): there is nothing to evaluate")
        cost = _evaluations("cost", cost, self.algorithm.size)
        violation = _evaluations("violation", violation, self.algorithm.size)
        if np.any(violation < 0.0):
            raise InvalidEvaluationError(
                f"violation must be at least 0, got {np.nanmin(violation)}",
                name="violation",
            )
        accept = self.algorithm.kernels.accept
        with put_off():
            accept(self._settings, self._state, self._asked, cost, violation)
        self._waiting = False

    def loop(
        self, objective: CompiledObjective, *, generations: int, last: int
    ) -> Work | None:
        """Ask, evaluate and tell several generations in compiled code.

        Args:
            objective: A compiled objective.
            generations: How many.
            last: Number of the last generation that the budget allows; progress is the
                generation's number divided by it.

        Returns:
            The best after each generation, and the last generation; None, and nothing
            is done, where the objective cannot be called from compiled code.

        Raises:
            AskTellError: If the generation asked before was not told yet.
        """
        if self._waiting:
            raise AskTellError(
                "loop() before tell(): a generation is not evaluated yet"
            )
        work = new_work(self.box.dim, self.algorithm.size, generations)
        pointers = objective.attach(work.asked, work.cost, work.violation)
        if pointers is None:
            return None
        loop = loop_of(self.algorithm.kernels)
        with put_off():
            loop(self.rng, self._settings, self._state, work, pointers, last)
        return work


def _initial_population(
    algorithm: Algorithm,
    box: Box,
    initial: ArrayLike | None,
    *,
    rng: np.random.Generator,
) -> Array:
    """Initial points first, the others uniform in the box, shape (dim, size)."""
    population = sample_uniform(box, algorithm.size, rng=rng)
    if initial is None:
        return population
    points = np.asarray(initial, dtype=np.float64)
    if points.ndim != 2 or points.shape[0] != box.dim:  # noqa: PLR2004
        raise InvalidPointsError(
            f"initial must have shape ({box.dim}, k), got {points.shape}",
            shape=points.shape,
        )
    given = points.shape[1]
    if given > algorithm.size:
        raise InvalidPointsError(
            f"initial has {given} points, the population only {algorithm.size}",
            shape=points.shape,
        )
    outside = np.flatnonzero(~box.contains(points))
    if outside.size:
        raise InvalidPointsError(
            f"initial must lie in the box, columns {outside.tolist()} do not",
            shape=points.shape,
        )
    population[:, :given] = points
    return population


def _evaluations(name: str, values: ArrayLike, size: int) -> Array:
    """Copy the costs or violations of a generation; refuse what is none."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        message = f"{name} must be an array of {size} numbers: {error}"
        raise InvalidEvaluationError(message, name=name) from error
    if array.shape != (size,):
        message = f"{name} must have shape ({size},), got {array.shape}"
        raise InvalidEvaluationError(message, name=name)
    return array
