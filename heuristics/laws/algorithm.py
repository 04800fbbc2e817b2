"""Protocols of an algorithm's parts, and what all algorithms share.

An algorithm is a frozen record of settings, a state of plain arrays, and two compiled
kernels. One generation is

    propose(rng, settings, state, asked)              fills asked, shape (dim, size)
    cost, violation = objective(asked)
    accept(settings, state, asked, cost, violation)

At generation 0 `propose` hands out the initial population, and `accept` takes its
costs. How many individuals the next generation has is part of the state, so that
populations may shrink or grow. All that changes is in the arrays of the state and in
the level of the order. From a copy of these and of the generator's state, a search
continues bit for bit.

Kernels copy arrays coordinate by coordinate, by the functions here. These do the same
as `target[:] = source`. For that line, Numba would also compile an error message about
different shapes, which takes 1 to 2 s at the first use and never runs.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol, Self

import numpy as np

from swarmstart.arguments import Check, choice
from swarmstart.arrays import Array
from swarmstart.errors import InvalidArgumentError
from swarmstart.heuristics.laws.box import NAMES, Box
from swarmstart.heuristics.laws.order import (
    RunningOrder,
    begin_level,
    is_finite,
    precedes,
    set_level,
)
from swarmstart.machine_code import Count, kernel

MOST_NUMBERS = 20_000_000
"""Largest population, in numbers: 160 MB; a search holds several arrays so large."""


class InvalidSettingsError(InvalidArgumentError):
    """A setting of an algorithm or of a search has a value that is not allowed."""


class Settings(Protocol):
    """The fields that the kernel settings of every algorithm have."""

    @property
    def lower(self) -> Array:
        """Lower bounds of the box, shape (dim,)."""

    @property
    def upper(self) -> Array:
        """Upper bounds of the box, shape (dim,)."""

    @property
    def order(self) -> RunningOrder:
        """The order of individuals."""

    @property
    def bound_handling(self) -> int:
        """The rule at the bounds, a code of `box.CODES`."""


class State(Protocol):
    """The fields that the states of all algorithms share; a NamedTuple of arrays."""

    @property
    def generation(self) -> Count:
        """Number of generations accepted so far, int64, shape (1,)."""

    @property
    def progress(self) -> Array:
        """Fraction of the budget used, in [0, 1], shape (1,); iter_k / iter_max (5.19).

        The loop sets it before each propose.
        """

    @property
    def best(self) -> Array:
        """Best point so far, shape (dim,).

        It is the first point of the initial population until an individual was finite.
        """

    @property
    def best_cost(self) -> Array:
        """Cost of `best`, shape (1,); infinity until an individual was finite."""

    @property
    def best_violation(self) -> Array:
        """Violation of `best`, shape (1,); infinity until an individual was finite."""

    @property
    def nonfinite(self) -> Count:
        """Number of individuals so far that were not finite, int64, shape (1,)."""

    @property
    def size(self) -> Count:
        """Number of individuals of the next generation, int64, shape (1,)."""

    @property
    def evaluations(self) -> Count:
        """Number of individuals accepted so far, int64, shape (1,)."""

    @property
    def improved(self) -> Count:
        """Number of the latest generation that counts as an improvement, shape (1,).

        A generation counts if it improved `best`, or if the level of the order is still
        above the tolerance after it. Here the initial population is number 1; 0: none.
        """


class CommonFields(NamedTuple):
    """The fields of `State`, with which every state begins, in this order."""

    generation: Count
    progress: Array
    best: Array
    best_cost: Array
    best_violation: Array
    nonfinite: Count
    size: Count
    evaluations: Count
    improved: Count


class Kernels(NamedTuple):
    """The two compiled functions of an algorithm.

    Attributes:
        propose: (rng, settings, state, asked) -> None; fills asked.
        accept: (settings, state, asked, cost, violation) -> None; updates the state.
    """

    propose: Callable[..., None]
    accept: Callable[..., None]


class Algorithm(Protocol):
    """The interface of an algorithm's settings, a frozen dataclass."""

    @property
    def kernels(self) -> Kernels:
        """The two compiled functions of the algorithm."""

    def first_size(self, box: Box, evaluations: int | None) -> int:
        """Number of individuals of the first generation.

        Args:
            box: The box that is searched.
            evaluations: Budget of the search in evaluations; None if it is not known.
        """

    def kernel_settings(self, box: Box, order: RunningOrder) -> tuple[object, ...]:
        """Return the settings as a NamedTuple of numbers and arrays, for the kernels.

        Raises:
            InvalidSettingsError: If a setting does not fit the box.
        """

    def start(self, box: Box, population: Array, *, rng: np.random.Generator) -> State:
        """The state before generation 0.

        Args:
            box: The box that is searched.
            population: Initial population, shape (dim, size); copied.
            rng: Source of randomness.
        """


def common_fields(population: Array) -> CommonFields:
    """The shared fields of a state before generation 0.

    Args:
        population: Initial population, shape (dim, size).

    Returns:
        New arrays.
    """
    return CommonFields(
        generation=np.zeros(1, dtype=np.int64),
        progress=np.zeros(1),
        best=population[:, 0].copy(),
        best_cost=np.full(1, np.inf),
        best_violation=np.full(1, np.inf),
        nonfinite=np.zeros(1, dtype=np.int64),
        size=np.full(1, population.shape[1], dtype=np.int64),
        evaluations=np.zeros(1, dtype=np.int64),
        improved=np.zeros(1, dtype=np.int64),
    )


@kernel
def take_generation(
    order: RunningOrder, state: State, asked: Array, cost: Array, violation: Array
) -> None:
    """Update the shared fields: the best point, the counters, the level of the order.

    The best point is the best by the final tolerance, whatever the level is now. As
    long as the level is above the tolerance, every generation counts as an improvement.

    Args:
        order: The order of individuals.
        state: State of the algorithm, changed in place.
        asked: Points that were evaluated, shape (dim, size).
        cost: Costs of these points, shape (size,).
        violation: Violations of these points, shape (size,).
    """
    # As numbers: `precedes` says why.
    rule, weight, level = order.rule, order.weight, order.tolerance
    least, least_violation, best = state.best_cost[0], state.best_violation[0], -1
    for i in range(cost.size):
        if not is_finite(cost[i], violation[i]):
            state.nonfinite[0] += 1
        if precedes(rule, weight, level, cost[i], violation[i], least, least_violation):
            least, least_violation, best = cost[i], violation[i], i
    if best >= 0:
        take_column(asked, best, state.best)
        state.best_cost[0] = least
        state.best_violation[0] = least_violation
        state.improved[0] = state.generation[0] + 1
    state.generation[0] += 1
    state.evaluations[0] += cost.size
    if state.generation[0] == 1:  # These are the costs of the initial population.
        begin_level(order, violation)
    set_level(order, state.progress[0], violation)
    if order.level[0] > order.tolerance:
        state.improved[0] = state.generation[0]


def is_algorithm(given: object) -> bool:
    """Return whether a class or an object has all methods that a search calls."""
    needed = ("kernels", "first_size", "kernel_settings", "start")
    return all(hasattr(given, name) for name in needed)


ALGORITHM = Check(
    lambda given: is_algorithm(given) and not isinstance(given, type),
    "settings of an algorithm, such as LSHADE()",
)
"""Check of the settings of an algorithm."""


def require(name: str, value: object, *, ok: bool, allowed: str) -> None:
    """Raise InvalidSettingsError unless the value of a setting is allowed.

    Raises:
        InvalidSettingsError: If `ok` is False.
    """
    if not ok:
        raise InvalidSettingsError(name, value, allowed)


class OfFixedSize:
    """Base of the settings whose generations all have `size` individuals."""

    __slots__ = ()
    size: int

    def first_size(self, box: Box, evaluations: int | None) -> int:
        """Number of individuals of every generation."""
        del box, evaluations
        return self.size


class BoundHandled:
    """Base of settings with a `bound_handling`; the former name `bounds` is refused.

    Raises:
        InvalidSettingsError: If `bounds` is given, which is a keyword of `minimize`.
    """

    __slots__ = ()

    def __new__(cls, *args: object, **settings: object) -> Self:
        """Return the object that the dataclass fills; it has the same arguments."""
        del args
        if "bounds" in settings:
            allowed = "given as bound_handling, its new name"
            raise InvalidSettingsError("bounds", settings["bounds"], allowed)
        return super().__new__(cls)


BOUND_HANDLING = choice(NAMES)
"""Check of the name of a rule at the bounds."""


def first_size_of(algorithm: Algorithm, box: Box, evaluations: int | None) -> int:
    """Return the size of the first generation, if it fits into memory.

    `evaluations` is the budget of the search; None if the budget is a time.

    Raises:
        InvalidSettingsError: If the generation would have more than MOST_NUMBERS
            coordinates.
    """
    size = algorithm.first_size(box, evaluations)
    allowed = f"at most {MOST_NUMBERS // box.dim} with {box.dim} variables"
    require("size", size, ok=size * box.dim <= MOST_NUMBERS, allowed=allowed)
    return size


@kernel
def copy_values(source: Array, target: Array) -> None:
    """Fill the vector `target` with the first entries of the vector `source`."""
    for k in range(target.size):
        target[k] = source[k]


@kernel
def copy_points(source: Array, target: Array) -> None:
    """Fill the matrix `target` with the first columns of the matrix `source`."""
    for d in range(target.shape[0]):
        for i in range(target.shape[1]):
            target[d, i] = source[d, i]


@kernel
def copy_column(source: Array, i: int, target: Array, j: int) -> None:
    """Copy column i of a matrix into column j of another, or of the same one."""
    for d in range(target.shape[0]):
        target[d, j] = source[d, i]


@kernel
def fill_column(value: Array, target: Array, j: int) -> None:
    """Copy a vector into column j of a matrix."""
    for d in range(target.shape[0]):
        target[d, j] = value[d]


@kernel
def take_column(source: Array, i: int, target: Array) -> None:
    """Copy column i of a matrix into a vector."""
    for d in range(target.size):
        target[d] = source[d, i]
