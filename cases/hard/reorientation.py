"""Reorientation: a rigid body turns to rest in an attitude, past forbidden cones.

    q' = q (0, w) / 2,   J w' = torque - w x (J w)

with the attitude as a unit quaternion q and torques that are limited. An instrument
looks along the body's first axis and must not look into cones around bright objects.
Both q and -q are the goal, so that the body turns either way; each cone is passed on
one of two sides.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.hard.draws import Mapped, first_possible, reached, rounded

INERTIA = (1.0, 1.4, 0.8)
"""Principal moments of inertia."""
HORIZON_S, LIMIT = 6.0, 1.0
"""Horizon [s]; largest torque about each axis."""
HALF_ANGLES, MARGIN = (0.3, 0.45), 0.1
"""Half angles of cones [rad]; smallest angle between them, start and goal [rad]."""
TURN = (2.1, 3.0)
"""Angle of the turn from start to goal [rad]."""


class Cone(NamedTuple):
    """A forbidden cone.

    Attributes:
        axis: Unit vector along the axis of the cone, in the frame at rest.
        half_angle: Half of the opening angle [rad].
    """

    axis: tuple[float, float, float]
    half_angle: float


def reorientation(*, cones: int, seed: int) -> Mapped:
    """Return the document of a reorientation.

    Args:
        cones: Number of forbidden cones.
        seed: Seed of the draw.

    Raises:
        ImpossibleDrawError: If so many cones do not fit.
    """
    (goal, found), draw = first_possible(lambda rng: _attempt(rng, cones), seed)
    a, b, c, d = (f"({value:.12g})" for value in goal)
    # The vector part of conj(goal) q; its scalar part is then 1 or -1.
    missed = {
        "miss1": f"{a}*q1 - {b}*q0 - {c}*q3 + {d}*q2",
        "miss2": f"{a}*q2 + {b}*q3 - {c}*q0 - {d}*q1",
        "miss3": f"{a}*q3 - {b}*q2 + {c}*q1 - {d}*q0",
    }
    look = {
        "look1": "1 - 2*(q2**2 + q3**2)",
        "look2": "2*(q1*q2 + q0*q3)",
        "look3": "2*(q1*q3 - q0*q2)",
    }
    return {
        "kind": "problem",
        "title": f"Turn a rigid body, forbidden cones: {cones} ({draw})",
        "constants": {f"J{k}": value for k, value in enumerate(INERTIA, 1)},
        "definitions": {**look, **missed},
        "states": {
            "q0": {"start": 1, "rate": "(-q1*w1 - q2*w2 - q3*w3)/2"},
            "q1": {"start": 0, "rate": "(q0*w1 + q2*w3 - q3*w2)/2"},
            "q2": {"start": 0, "rate": "(q0*w2 + q3*w1 - q1*w3)/2"},
            "q3": {"start": 0, "rate": "(q0*w3 + q1*w2 - q2*w1)/2"},
            "w1": {"start": 0, "rate": "(t1 - (J3 - J2)*w2*w3)/J1", "unit": "rad/s"},
            "w2": {"start": 0, "rate": "(t2 - (J1 - J3)*w3*w1)/J2", "unit": "rad/s"},
            "w3": {"start": 0, "rate": "(t3 - (J2 - J1)*w1*w2)/J3", "unit": "rad/s"},
        },
        "controls": {f"t{k}": {"bounds": [-LIMIT, LIMIT]} for k in (1, 2, 3)},
        "stage_cost": "t1**2 + t2**2 + t3**2",
        "path": [
            {
                "expression": " + ".join(
                    f"({part:.12g})*look{k}" for k, part in enumerate(cone.axis, 1)
                ),
                "upper": f"cos({cone.half_angle:.12g})",
            }
            for cone in found
        ],
        "terminal": [
            *({"expression": f"miss{k}"} for k in (1, 2, 3)),
            *reached({"w1": 0, "w2": 0, "w3": 0}),
        ],
        "prediction": {
            "horizon_s": HORIZON_S,
            "intervals": 40,
            "checks": 2,
            "substeps": 2,
        },
    }


def _attempt(
    rng: np.random.Generator, count: int
) -> tuple[list[float], list[Cone]] | None:
    """Return goal and cones; None if a cone is too near start or goal."""
    axis, angle = _direction(rng), rng.uniform(*TURN)
    goal = np.round([np.cos(angle / 2), *(np.sin(angle / 2) * axis)], 3)
    goal = goal / np.linalg.norm(goal)
    cones = []
    for _ in range(count):
        # Near the way of the turn about one axis, to one side or the other.
        on_way = _looks(axis, angle * rng.uniform(0.2, 0.8))
        near = np.round(_unit(on_way + 0.25 * rng.normal(size=3)), 3)
        cones.append(Cone(tuple(near.tolist()), rounded(rng.uniform(*HALF_ANGLES))))
    ends = (np.array([1.0, 0.0, 0.0]), _looks(axis, angle))
    places = [np.array(_unit(np.array(cone.axis))) for cone in cones]
    free = all(
        np.arccos(np.clip(end @ place, -1, 1)) > cone.half_angle + MARGIN
        for end in ends
        for place, cone in zip(places, cones, strict=True)
    )
    distinct = all(
        np.arccos(np.clip(places[i] @ places[j], -1, 1))
        > max(cones[i].half_angle, cones[j].half_angle)
        for i in range(count)
        for j in range(i)
    )
    return ([float(v) for v in goal], cones) if free and distinct else None


def _direction(rng: np.random.Generator) -> Array:
    """Return a random unit vector, shape (3,)."""
    return _unit(rng.normal(size=3))


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def _looks(axis: Array, angle: float) -> Array:
    """Return the first axis after a turn about an axis: Rodrigues' formula."""
    first = np.array([1.0, 0.0, 0.0])
    along = axis * (axis @ first) * (1 - np.cos(angle))
    return np.asarray(
        first * np.cos(angle) + np.cross(axis, first) * np.sin(angle) + along
    )
