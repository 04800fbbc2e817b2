"""c(e) of certificates at single points, as the checker computes it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.ellipsoid_statements import (
    change_of,
    growth_task,
)
from swarmstart.terminal_set.checker.falsification import fails, points
from swarmstart.terminal_set.checker.findings import Deadline
from swarmstart.terminal_set.checker.models import Model


def point(e: Sequence[float] | Array) -> list[Model]:
    """Return one state as models of no variables."""
    return points(np.array(e, dtype=float)[:, None])


def thin(model: Model) -> float:
    """Return the middle of an enclosure, which must be as thin as rounding."""
    assert model.spread[0] < 1e-9
    return float(model.middle[0])


def change_at(certificate: Certificate, e: Sequence[float] | Array) -> float:
    """Return c(e) of the decrease."""
    return thin(change_of(certificate).of(point(e)))


def excess_at(
    certificate: Certificate, e: Sequence[float] | Array, time: float
) -> float:
    """Return V(R_t(e)) - growth V(e)."""
    (duration,) = point([time])
    return thin(growth_task(certificate).change.of(point(e), duration))


def violates(certificate: Certificate, e: Sequence[float] | Array) -> bool:
    """Return whether the decrease certainly fails at a state of the set."""
    return bool(fails(change_of(certificate), point(e), certificate.alpha)[0])


@dataclass(frozen=True)
class Looks(Deadline):
    """A deadline that passes after some looks at the clock."""

    left: Iterator[int]

    @property
    def has_passed(self) -> bool:
        """Return whether so many looks were taken."""
        return next(self.left) <= 0


def after_looks(looks: int) -> Looks:
    """Return a deadline that begins to count."""
    return Looks(0.0, itertools.count(looks, -1))
