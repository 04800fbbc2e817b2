"""Arguments of a search in short forms, and their defaults.

A name or a class stands for the default settings of an algorithm, pairs of bounds for a
box, a seed for a generator.

The default algorithm is L-SHADE. Below 400 evaluations, which are too few for its
population to shrink, it is the chaotic swarm with c1 = c2 = 1.496 and lengths taken
from the box. Both algorithms were chosen by measurements on this project's own planning
problems: docs/measured/planning.md, made by benchmarks/planning.py. CMA-ES alone, or
with half of the budget from the best point of L-SHADE, has no advantage once a local
solver has improved the result: docs/measured/search_2017.md,
docs/measured/lane_searches.md.

The default order is the adaptive epsilon level, which is feasibility first as soon as a
tenth of a generation is feasible. It was measured on constrained problems of CEC 2006:
docs/measured/orders.md, made by benchmarks/orders.py.

Neither default depends on the units of the cost or of the variables.
"""

from collections.abc import Mapping, Sequence
from pkgutil import resolve_name

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import MOST_WORK, SEED, a_count, a_number, checked, optional
from swarmstart.errors import brief
from swarmstart.heuristics.laws.algorithm import (
    Algorithm,
    InvalidSettingsError,
    is_algorithm,
)
from swarmstart.heuristics.laws.box import Box, InvalidBoxError
from swarmstart.heuristics.laws.order import InvalidOrderError, Order, epsilon_level
from swarmstart.heuristics.searches.chaotic_pso import ChaoticPSO
from swarmstart.heuristics.searches.lshade import LSHADE
from swarmstart.heuristics.searches.names import SEARCHES, installed_searches

ALGORITHMS: Mapping[str, type[Algorithm]] = {
    name: resolve_name(entry.settings) for name, entry in SEARCHES.items()
}
"""Name -> class of settings of a search of the library."""

PAIR = (2,)
"""Shape of the bounds of one variable."""

_EVALUATIONS = a_count(least=1, most=MOST_WORK)
FEWEST = 400
"""Least number of evaluations for which L-SHADE is the default."""


@checked(InvalidSettingsError, evaluations=optional(_EVALUATIONS))
def algorithm_of(
    given: Algorithm | type[Algorithm] | str | None, evaluations: int | None = None
) -> Algorithm:
    """Return the settings of an algorithm.

    Args:
        given: Settings; or a class of settings, or a name of a search, for its
            defaults; None or "default" for `default_algorithm`.
        evaluations: Budget in evaluations, on which the default depends; None if the
            budget is a time.

    Raises:
        InvalidSettingsError: If `given` is not one of these.

    Example:
        >>> algorithm_of("cma") == algorithm_of(CMAES) == CMAES()
        True
    """
    if given is None or (isinstance(given, str) and given == "default"):
        return default_algorithm(evaluations)
    if isinstance(given, str):
        given = _named(given)
    if not is_algorithm(given):
        raise _unknown(given)
    return given() if isinstance(given, type) else given


def _named(name: str) -> type[Algorithm]:
    """Return the class of settings of a search of the library or of another package."""
    if name in ALGORITHMS:
        return ALGORITHMS[name]
    others = installed_searches()
    if name not in others:
        raise _unknown(name)
    settings: type[Algorithm] = resolve_name(others[name].settings)
    return settings


def _unknown(given: object) -> InvalidSettingsError:
    names = [*ALGORITHMS, *installed_searches()]
    allowed = f"settings as LSHADE(), a class of settings, or one of {names}"
    return InvalidSettingsError("algorithm", given, allowed)


def box_of(given: Box | ArrayLike | None, bounds: Box | ArrayLike | None = None) -> Box:
    """Return the box that is given as a `Box`, or as pairs of bounds.

    Args:
        given: A box, or pairs (lower, upper), one for each variable.
        bounds: Another name for `given`; exactly one of the two must be given.

    Raises:
        InvalidBoxError: If the bounds are not pairs, or do not make a box.
        InvalidSettingsError: If both are given, or neither.

    Example:
        >>> box_of(None, [(-1.0, 1.0), (0.0, 5.0)]).upper.tolist()
        [1.0, 5.0]
    """
    if given is not None and bounds is not None:
        raise InvalidSettingsError("bounds", bounds, "None if box is given")
    chosen = bounds if given is None else given
    if isinstance(chosen, Box):
        return chosen
    if chosen is None:
        allowed = "a Box, or pairs (lower, upper), one for each variable"
        raise InvalidSettingsError("bounds", None, allowed)
    try:
        pairs = np.array(chosen)
        if pairs.dtype.kind not in "biuf":
            raise TypeError("text and complex numbers are not converted")
    except (TypeError, ValueError):
        pairs = np.empty(0)  # Refused below, with the message for wrong shapes.
    if pairs.ndim != len(PAIR) + 1 or pairs.shape[1:] != PAIR:
        problem = (
            "bounds must be pairs (lower, upper), one for each variable, "
            f"got {brief(chosen)}"
        )
        raise InvalidBoxError(problem, lower=(), upper=())
    return Box(lower=pairs[:, 0], upper=pairs[:, 1])


def generator_of(
    rng: np.random.Generator | None, seed: int | Sequence[int] | None
) -> np.random.Generator:
    """Return the generator that is given, or a new one from a seed.

    Args:
        rng: A generator.
        seed: An integer of at least 0, or several; exactly one of rng and seed must be
            given.

    Raises:
        InvalidSettingsError: If both are given or neither, or the one given is invalid.

    Example:
        >>> int(generator_of(None, 3).integers(100)) == int(
        ...     np.random.default_rng(3).integers(100)
        ... )
        True
    """
    if rng is not None and seed is not None:
        raise InvalidSettingsError("seed", seed, "None if rng is given")
    if rng is not None:
        if not isinstance(rng, np.random.Generator):
            allowed = "a numpy.random.Generator (an integer is for seed)"
            raise InvalidSettingsError("rng", rng, allowed)
        return rng
    allowed = "an integer of at least 0, or rng a numpy.random.Generator"
    # NumPy would take True for the seed 1, and None for any seed.
    if not SEED.accepts(seed):
        raise InvalidSettingsError("seed", seed, allowed)
    try:
        return np.random.default_rng(np.random.SeedSequence(seed))
    except (TypeError, ValueError, AttributeError) as error:
        raise InvalidSettingsError("seed", seed, allowed) from error


@checked(InvalidSettingsError, evaluations=optional(_EVALUATIONS))
def default_algorithm(evaluations: int | None) -> Algorithm:
    """Return the default algorithm for a budget.

    Args:
        evaluations: Budget in evaluations; None if the budget is a time.

    Example:
        >>> import swarmstart as ss
        >>> [type(ss.default_algorithm(n)).__name__ for n in (100, 20_000)]
        ['ChaoticPSO', 'LSHADE']
    """
    if evaluations is not None and evaluations < FEWEST:
        return ChaoticPSO(
            cognitive=1.496, social=1.496, velocity_max=None, search_length=None
        )
    return LSHADE()


@checked(InvalidOrderError, tolerance=a_number(least=0))
def default_order(tolerance: float = 0.0) -> Order:
    """Return the order of individuals: the adaptive epsilon level.

    Args:
        tolerance: Largest violation that counts as feasible, at least 0.

    Returns:
        `epsilon_level(tolerance)`.

    Raises:
        InvalidOrderError: If the tolerance is negative or not finite.

    Example:
        >>> import swarmstart as ss
        >>> ss.default_order(1e-6) == ss.epsilon_level(1e-6)
        True
    """
    return epsilon_level(tolerance)
