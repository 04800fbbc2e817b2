"""Closed loop: controllers, teams, the dual mode, plants, and the simulation.

A controller decides from the state and its last decision; a plant makes the step.
"""

from swarmstart.ocp.loop.closed_loop import flown_again
from swarmstart.ocp.loop.controller import (
    ReferenceSignals,
    known_at,
    of_given_length,
)
from swarmstart.ocp.loop.plant import begun, rows_before_jumps, stepped
from swarmstart.ocp.loop.simulated_plant import SimulatedPlant

__all__ = [
    "ReferenceSignals",
    "SimulatedPlant",
    "begun",
    "flown_again",
    "known_at",
    "of_given_length",
    "rows_before_jumps",
    "stepped",
]
