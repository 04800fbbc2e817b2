"""Gears: a car crosses hills at full throttle, in one of three gears per interval.

    x' = v,   v' = pull(gear, v) - drag v - slope(x)
    pull = r exp(-((r v - 1) / width)^2),   r = ratio(gear)

The engine pulls best at one speed of its own, so that each gear has a best speed. Each
shift costs. With N intervals there are 3^N sequences of gears; for N <= 10 all can be
computed.
"""

import numpy as np

from swarmstart.cases.hard.draws import Mapped, first_possible, rounded

INTERVAL_S = 1.0
"""Length of a control interval [s]."""
SHIFT = 0.3
"""Cost of a shift by one gear; of two gears it is four times that."""


def gears(*, intervals: int, seed: int) -> Mapped:
    """Return the document of a car with three gears.

    Args:
        intervals: Number of intervals N, each of one second.
        seed: Seed of the draw of the hills.
    """
    (height, length, phase), draw = first_possible(_attempt, seed)
    return {
        "kind": "problem",
        "title": f"Drive over hills with a gear for each of {intervals} s ({draw})",
        "constants": {
            "hill": height,
            "length": length,
            "phase": phase,
            "drag": 0.06,
            "width": 0.7,
            "shift": SHIFT,
        },
        # Gears 1, 2, 3 have the ratios 1, 0.6 and 0.36.
        "definitions": {
            "ratio": "0.6**(gear - 1)",
            "pull": "ratio*exp(-((ratio*v - 1)/width)**2)",
            "slope": "hill*sin(2*pi*x/length + phase)",
        },
        "states": {
            "x": {"start": 0, "rate": "v", "unit": "m"},
            "v": {"start": 1, "rate": "pull - drag*v - slope", "unit": "m/s"},
        },
        "controls": {
            "gear": {"bounds": [1, 3], "integer": True, "previous": 1},
        },
        "maximize": True,
        "step_cost": "-shift*(gear - previous(gear))**2",
        "terminal_cost": "x + v**2/2",
        "prediction": {
            "horizon_s": rounded(intervals * INTERVAL_S),
            "intervals": intervals,
            "substeps": 20,
        },
    }


def _attempt(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return height of the slope, length of a hill, and phase."""
    height, length, phase = rounded(
        [rng.uniform(0.8, 1.0), rng.uniform(6, 10), rng.uniform(0, 2 * np.pi)]
    )
    return height, length, phase
