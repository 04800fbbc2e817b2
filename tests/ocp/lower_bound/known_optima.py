"""Problems whose optimum is known: what no lower bound may exceed."""

from swarmstart.tests.ocp.lower_bound import (
    constrained_optima,
    inverse_optima,
    linear_optima,
    restated_optima,
    scalar_optima,
    time_optima,
)
from swarmstart.tests.ocp.lower_bound.known_optimum import Family, KnownOptimum

FAMILIES: tuple[Family, ...] = (
    scalar_optima.family,
    linear_optima.family,
    time_optima.family,
    constrained_optima.family,
    inverse_optima.family,
    restated_optima.family,
)


def known_optima() -> list[KnownOptimum]:
    """Return all of them, the same on every call."""
    return [known for family in FAMILIES for known in family()]
