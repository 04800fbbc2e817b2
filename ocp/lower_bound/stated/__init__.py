"""The statement of a lower bound and its evidence, which all of its proofs share."""

from swarmstart.ocp.lower_bound.stated.evidence import (
    Evidence,
)

__all__ = [
    "Evidence",
]
