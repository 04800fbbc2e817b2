"""Closed loop: controllers, plants, teams, the dual mode, and the loop of both.

A controller decides from the state and its last decision; a plant makes the step.
"""

from swarmstart.ocp.loop.controller import (
    ReferenceSignals,
    known_at,
)

__all__ = [
    "ReferenceSignals",
    "known_at",
]
