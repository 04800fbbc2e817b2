"""Vehicles that cross: n discs change places across a circle, without touching.

Each pair passes on one of two sides: up to 2^(n(n-1)/2) classes of motions, most of
them possible. The vehicles are points with x' = u and a distance to keep. Without
other vehicles each would go straight, and all would meet in the middle.
"""

import numpy as np

from swarmstart.cases.hard.draws import Mapped, first_possible, least_distance, rounded

CIRCLE, APART, SHIFT = 5.0, 1.5, 0.2
"""Radius of the circle; distance to keep; largest shift of an angle, in spacings."""


def crossing(*, vehicles: int, seed: int) -> Mapped:
    """Return the problem of vehicles that cross, as the data of a YAML file.

    Args:
        vehicles: Number of vehicles.
        seed: Seed of the draw of the vehicles' places on the circle.

    Raises:
        ImpossibleDrawError: If so many vehicles do not fit on the circle.
    """
    places, draw = first_possible(lambda rng: _attempt(rng, vehicles), seed)
    members = [
        {
            "name": f"v{number}",
            "start": {"x": x, "y": y},
            "constants": {"to_x": rounded(-x), "to_y": rounded(-y)},
        }
        for number, (x, y) in enumerate(places, 1)
    ]
    return {
        "kind": "problem",
        "title": f"{vehicles} vehicles change places across a circle ({draw})",
        "constants": {"to_x": 0, "to_y": 0},
        "states": {"x": {"rate": "u"}, "y": {"rate": "v"}},
        "controls": {"u": {"bounds": [-25, 25]}, "v": {"bounds": [-25, 25]}},
        "vehicles": {
            "members": members,
            "separation": {"of": ["x", "y"], "distance": APART},
        },
        "stage_cost": "u**2 + v**2",
        "terminal": [{"expression": "x - to_x"}, {"expression": "y - to_y"}],
        "prediction": {"horizon_s": 1, "intervals": 40, "checks": 2, "substeps": 1},
    }


def _attempt(rng: np.random.Generator, count: int) -> list[tuple[float, float]] | None:
    """Return places on the circle; None if two are too near each other, or goals."""
    spacing = 2 * np.pi / count
    angles = spacing * (np.arange(count) + rng.uniform(-SHIFT, SHIFT, count))
    places = CIRCLE * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if least_distance(places) < 1.2 * APART:
        return None
    return [(x, y) for x, y in rounded(places)]
