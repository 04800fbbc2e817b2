"""Rows of published numbers beside what was measured, and the searches behind them."""

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    Objective,
    Order,
    SearchResult,
    StopReason,
    minimize,
)


class Row(NamedTuple):
    """A published number and what was measured.

    Attributes:
        name: Name of the number.
        measured: The measured number.
        published: The published number.
        tolerance: The allowed difference, and its source.
        holds: Whether the difference is allowed.
    """

    name: str
    measured: str
    published: str
    tolerance: str
    holds: bool


def within(value: float, published: float, tolerance: float) -> bool:
    """Return whether a number is within a relative tolerance."""
    return bool(abs(value - published) <= tolerance * published)


def cube(dim: int, half_width: float) -> Box:
    """The box [-half_width, half_width]^dim."""
    return Box(lower=np.full(dim, -half_width), upper=np.full(dim, half_width))


def no_violation(points: Array) -> Array:
    """Zeros, one for each point."""
    return np.zeros(points.shape[1])


def search_until(  # noqa: PLR0913
    objective: Objective,
    box: Box,
    algorithm: Algorithm,
    *,
    target: float,
    evaluations: int,
    seed: int | Sequence[int],
    order: Order | None = None,
) -> SearchResult:
    """Search until a feasible point has the target, or the budget is used up."""
    return minimize(
        objective,
        box,
        algorithm=algorithm,
        order=order,
        budget=Budget(evaluations=evaluations, target=target),
        rng=np.random.default_rng(seed),
    )


def expected_running_time(results: Sequence[SearchResult]) -> tuple[int, float]:
    """Number of runs that reached the target, and the ERT."""
    successes = sum(r.stopped is StopReason.TARGET for r in results)
    total = sum(r.evaluations for r in results)
    return successes, total / successes if successes else np.inf


class PeerMissingError(ImportError):
    """A package to compare with is not installed."""


def peer(name: str) -> Any:
    """Import a package to compare with.

    Raises:
        PeerMissingError: If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise PeerMissingError(
            f"{name} is not installed, its rows are skipped: pip install {name}"
        ) from error
