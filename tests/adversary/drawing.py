"""Systems that several classes draw."""

from collections.abc import Callable, Iterator

import numpy as np

from swarmstart.arrays import Array
from swarmstart.tests.adversary.case import Case
from swarmstart.tests.adversary.exact.convex import UnsolvedError

MOST_GROWTH = 3.0
"""The largest exponent by which a drawn system may grow over its horizon."""


def chain(nx: int) -> Array:
    """Return A of a chain of integrators, the control at its last state."""
    return np.eye(nx, k=1)


def last(nx: int) -> Array:
    """Return B of a chain of integrators, shape (nx, 1)."""
    return np.eye(nx)[:, -1:]


def symmetric_limits(limit: Array) -> tuple[Array, Array]:
    """Return (-limit, limit)."""
    limit = np.asarray(limit, dtype=np.float64)
    return -limit, limit


def away_from_zero(values: Array, *, least: float = 0.2) -> Array:
    """Return values, those nearer to zero than `least` moved there.

    A target is the scale of its constraint: nearly zero, it asks for more digits than
    a grid has.
    """
    return np.copysign(np.maximum(np.abs(values), least), values)


def random_system(
    rng: np.random.Generator, *, nx: int, nu: int, horizon: float
) -> tuple[Array, Array]:
    """Return A and B of a system that grows by exp(MOST_GROWTH) at most."""
    A = rng.normal(size=(nx, nx)) / np.sqrt(nx)
    growth = float(np.linalg.eigvals(A).real.max()) * horizon
    if growth > MOST_GROWTH:
        A -= np.eye(nx) * (growth - MOST_GROWTH) / horizon
    return A, rng.normal(size=(nx, nu))


def drawn_cases(count: int, draw: Callable[[int], Case]) -> Iterator[Case]:
    """Yield cases; what has no solution by chance is drawn again.

    Args:
        count: How many.
        draw: Draws the case of a number, another one on every call.

    Raises:
        UnsolvedError: If a case has no solution in many draws.
    """
    for number in range(count):
        for _ in range(50):
            try:
                case = draw(number)
            except UnsolvedError:
                continue
            yield case
            break
        else:
            raise UnsolvedError(f"case {number} had no solution in 50 draws")
