"""Integrators: a step of each, equal steps, steps with size control, collocation."""

from swarmstart.ocp.integration.integrators import (
    PARTS,
    Integrator,
    held_step,
    integrate,
    verifying_integrator,
)
from swarmstart.ocp.integration.radau import (
    Radau,
    Transcription,
)
from swarmstart.ocp.integration.rodas import (
    COARSEST,
    FINEST,
)

__all__ = [
    "COARSEST",
    "FINEST",
    "PARTS",
    "Integrator",
    "Radau",
    "Transcription",
    "held_step",
    "integrate",
    "verifying_integrator",
]
