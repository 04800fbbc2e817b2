"""What claims need that no flight measures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.heuristics.markov_chain import GridDE, absorption, build_chain

TRAP = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 0.0])
"""Costs of six points that fall away from the optimum, which is the last."""
IMMIGRANT = 0.1


def de_absorption(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the exact probability that DE/rand/1 ever meets the optimum of a trap.

    From four uniform individuals, F = 0.5, clip; without and with random immigrants.
    """
    del job, folder
    plain = absorption(build_chain(GridDE(costs=TRAP, size=4, F=0.5)))
    aided = absorption(
        build_chain(GridDE(costs=TRAP, size=4, F=0.5, immigrant=IMMIGRANT))
    )
    return {
        "measures": {
            "absorption_probability": plain.uniform,
            "absorption_probability_with_immigrants": aided.uniform,
        }
    }
