"""Swing-up with a weak motor: a pendulum gains its height in many swings.

In units of the pendulum, angle'' = torque - sin(angle), with a torque that is a small
part of gravity. Number and order of the swings are free, and so is the angle at which
the pendulum ends: it is upright at every odd multiple of pi.
"""

import numpy as np

from swarmstart.cases.hard.draws import Mapped, first_possible, reached, uniform

SWINGS_S = 1.7
"""Horizon for a torque of 1, in sqrt(length / gravity); it grows as 1 / torque^0.8."""
GRID_S = 0.3
"""Longest control interval, in the same units."""


def swing_up(*, percent: int, seed: int) -> Mapped:
    """Return the document of a swing-up.

    Args:
        percent: Largest torque, in percent of that which holds the pendulum level.
        seed: Seed of the draw of the pendulum's start.
    """
    (angle, speed), draw = first_possible(_attempt, seed)
    torque = percent / 100
    horizon = float(np.ceil(SWINGS_S * np.pi / torque**0.8))
    return {
        "kind": "problem",
        "title": f"Swing up with {percent} % of the torque of gravity ({draw})",
        "states": {
            "angle": {"start": angle, "rate": "speed", "unit": "rad"},
            "speed": {"start": speed, "rate": "torque - sin(angle)"},
        },
        "controls": {"torque": {"bounds": [-torque, torque]}},
        "stage_cost": "torque**2",
        # Upright, on either side and after any number of turns.
        "terminal": [
            {"expression": "cos(angle/2)"},
            *reached({"speed": 0}),
        ],
        "prediction": {
            "horizon_s": horizon,
            "intervals": int(np.ceil(horizon / GRID_S)),
            "substeps": 16,
        },
    }


def _attempt(rng: np.random.Generator) -> tuple[float, float]:
    """Return angle and speed at the start, near rest."""
    angle, speed = uniform(rng, -0.3, 0.3, 2).tolist()
    return angle, speed
