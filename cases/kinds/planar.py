"""UAVs in the plane: models, states, distances, limits and assignment that kinds share.

Numbers such as (5.3) are equations of the chapter (docs/chapter).

A UAV's state is (v, psi, x, y) in the order of (5.3), speed [m/s], heading [rad] and
position [m]; those of several are stacked, UAV after UAV. Both models have

    x' = v cos psi,  y' = v sin psi

`unicycle`, which steers by its turn rate (5.1): v' = u, psi' = omega, with the controls
(u, omega), acceleration [m/s^2] and turn rate [rad/s].

`bank_to_turn`, an aircraft that turns by banking (5.30): v' = a, psi' = g sin(phi) / v,
with the controls (a, phi), acceleration [m/s^2] and bank [rad]; or (T, phi), thrust and
bank, with the drag D and

    a = g (T - D) / W          thrust_equation "newton": W is the weight [N]
    a = (T - D) / W            "printed", as in (5.30): W stands for the mass

The turn rate of a coordinated turn is g tan(phi) / v (turn "tan"); (5.30) prints sin
(turn "sin"). The heading rate divides by the speed, so that v = 0 is not allowed.

`shortest_assignment` assigns targets q_a(i) to the n starts s_i with the least sum of
squared distances. The common position of the targets does not matter: moving all of
them by c adds

    n |c|^2 - 2 c' sum_i (s_i - q_a(i)),

which is the same for every assignment a.

Source: Kuhn (1955), The Hungarian method for the assignment problem; squared distances
as in Turpin, Michael and Kumar (2014), CAPT.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from swarmstart.arrays import Array
from swarmstart.cases.format.parts import Number, Part, Range
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.ocp import (
    DenseOutput,
    InvalidProblemError,
    Model,
    largest_distance,
    smallest_distance,
)

STATES = ("speed_m_s", "heading_rad", "x_m", "y_m")
POSITION = (2, 3)
"""Rows of the states that are the position."""
METRE = 1.0
"""Scale of distances [m] and speeds [m/s] in the chapter's penalties."""
SAME_PLACE_M = 1e-9
"""Distance below which two points count as one [m]."""

GRAVITY_M_S2 = 9.8
"""Gravity as in the chapter, after (5.30)."""

Turn = Literal["sin", "tan"]
ThrustEquation = Literal["printed", "newton"]
TURNS = {"sin": ca.sin, "tan": ca.tan}


class PlanarState(Part):
    """Speed, heading and position in the plane.

    Attributes:
        speed_m_s: Speed of the vehicle along its heading [m/s].
        heading_rad: Heading, counted from the x axis towards the y axis [rad].
        x_m: Position along the x axis [m].
        y_m: Position along the y axis [m].
    """

    speed_m_s: Number
    heading_rad: Number
    x_m: Number
    y_m: Number

    def vector(self) -> list[float]:
        """Return (v, psi, x, y), the order of (5.3) and (5.30)."""
        return [self.speed_m_s, self.heading_rad, self.x_m, self.y_m]

    def velocity(self) -> Array:
        """Return (x', y') of steady motion, shape (2,) [m/s]."""
        direction = [np.cos(self.heading_rad), np.sin(self.heading_rad)]
        return self.speed_m_s * np.array(direction)


class Point(Part):
    """A position in the plane.

    Attributes:
        x_m: Position along the x axis [m].
        y_m: Position along the y axis [m].
    """

    x_m: Number
    y_m: Number


class PlantPart(Part):
    """The simulated aircraft, integrated in finer steps than the prediction.

    Attributes:
        substeps: Number of Runge-Kutta steps of the simulated aircraft in a control
            interval.
    """

    substeps: int = Field(default=20, ge=1, le=1000)


def distance(a: PlanarState | Point, b: PlanarState | Point) -> float:
    """Return the distance between two positions [m]."""
    return math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)


def bank_flaws(turn: str, bank: Range) -> Iterator[LocatedFlaw]:
    """Yield an error if the bank can exceed pi/2, beyond which turns become weaker.

    With the turn "tan" it must not reach pi/2 either.
    """
    most = max(-bank.lower, bank.upper)
    # tan is infinite at pi/2, where sin is still allowed.
    if most > math.pi / 2 or (turn == "tan" and most == math.pi / 2):
        yield (
            ("bank_rad",),
            f"expected limits between -pi/2 and pi/2, found [{bank.lower:g}, "
            f"{bank.upper:g}]",
        )


def speed_limit_flaws(limits: Range) -> Iterator[LocatedFlaw]:
    """Yield errors of a range of the speed of a UAV that banks to turn."""
    if limits.lower <= 0:
        yield (
            ("speed_m_s",),
            "expected a lower limit above 0, since the heading rate divides by the "
            f"speed; found {limits.lower:g}",
        )


def start_speed_flaws(
    place: tuple[str | int, ...], speed: float, limits: Range
) -> Iterator[LocatedFlaw]:
    """Yield errors of a speed at the start.

    Args:
        place: Place of the speed in the scenario.
        speed: The speed [m/s].
        limits: Bounds of the speed, the scenario's `vehicle.speed_m_s`.
    """
    if not limits.lower <= speed <= limits.upper:
        yield (
            place,
            f"expected a speed within vehicle.speed_m_s [{limits.lower:g}, "
            f"{limits.upper:g}], found {speed:g}",
        )


def near_place_flaws(
    uavs: Sequence[Part],
    places: tuple[str, ...],
    least: float,
    numbers: Sequence[int],
) -> Iterator[LocatedFlaw]:
    """Yield errors of positions of two UAVs that are too near to each other.

    Args:
        uavs: Parts of the scenario's key `uavs`.
        places: Keys of the positions to compare, such as start and goal.
        least: Smallest allowed distance [m].
        numbers: Numbers of the UAVs.
    """
    for (i, one), (j, other) in itertools.combinations(enumerate(uavs), 2):
        for key in places:
            apart = distance(getattr(one, key), getattr(other, key))
            if apart < least:
                yield (
                    ("uavs", j, key),
                    f"expected a {key} at least {least:g} m (safe_distance_m) from "
                    f"that of UAV {numbers[i]}, found {apart:g} m",
                )


def speed_bounds(limits: Range | None, *, uavs: int = 1) -> tuple[Array, Array] | None:
    """Return bounds of the stacked states, each (uavs * 4,), for the speeds only.

    Args:
        limits: Bounds of every speed; None means no bounds, and returns None.
        uavs: Number of UAVs.
    """
    if limits is None:
        return None
    # Heading and position have no bounds.
    free = [np.inf] * (len(STATES) - 1)
    return (
        np.tile([limits.lower, *np.negative(free)], uavs),
        np.tile([limits.upper, *free], uavs),
    )


def by_uav(stacked: Array, uavs: int) -> Array:
    """Return stacked rows (uavs * n, T) as (uavs, n, T)."""
    return stacked.reshape(uavs, -1, stacked.shape[1])


def rooms_of(tracks: Array, discs: Iterable[Any]) -> list[Array]:
    """Return, for each disc, the distance of each UAV to its edge, (uavs, T) [m].

    Args:
        tracks: States of the UAVs, shape (uavs, 4, T).
        discs: Discs with x_m, y_m and radius_m; inside, the distance is negative.
    """
    places = tracks[:, list(POSITION)]
    return [
        np.linalg.norm(places - np.array([[o.x_m], [o.y_m]]), axis=1) - o.radius_m
        for o in discs
    ]


def pair_distances(stacked: Array, uavs: int) -> Array:
    """Return the distance of each pair of UAVs, shape (pairs, T) [m].

    Args:
        stacked: States, shape (uavs * 4, T).
        uavs: Number of UAVs.
    """
    positions = by_uav(stacked, uavs)[:, list(POSITION)]
    # Each pair once.
    first, second = np.triu_indices(uavs, k=1)
    return np.asarray(np.linalg.norm(positions[first] - positions[second], axis=1))


def smallest(distances: Array) -> float | None:
    """Return the smallest of some distances; None if there is no distance."""
    return float(distances.min()) if distances.size else None


def flown_positions(path: DenseOutput, uavs: int) -> Array:
    """Return the positions of UAVs as piecewise curves, (uavs, 2, pieces, 6) [m].

    Each piece has six Bernstein coefficients for each coordinate.

    Args:
        path: Path of the stacked states, uavs * 4 rows.
        uavs: Number of UAVs.
    """
    curves = path.curves
    return curves.reshape(uavs, -1, *curves.shape[1:])[:, list(POSITION)]


def smallest_pair_distance(positions: Array) -> float | None:
    """Return the smallest distance of two UAVs [m]; None for a single UAV.

    Args:
        positions: As `flown_positions` returns them.
    """
    first, second = np.triu_indices(len(positions), k=1)
    return smallest_distance(positions, first, second) if first.size else None


def largest_pair_distance(
    positions: Array, *, pairs: Sequence[tuple[int, int]] | None = None
) -> float | None:
    """Return the largest distance of two UAVs [m]; None if there is no pair.

    Args:
        positions: As `flown_positions` returns them.
        pairs: Pairs of numbers of UAVs, from 0; None means all pairs.
    """
    first, second = np.triu_indices(len(positions), k=1)
    if pairs is not None:
        # The type and the shape are for an empty list.
        first, second = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    return largest_distance(positions, first, second) if first.size else None


def smallest_range(positions: Array, point: Point) -> float:
    """Return the smallest distance of any UAV to a fixed point [m].

    Args:
        positions: As `flown_positions` returns them.
        point: The point.
    """
    away = positions - np.array([point.x_m, point.y_m])[:, None, None]
    # The point counts as one more vehicle, which stands still at zero.
    both = np.concatenate([away, np.zeros_like(away[:1])])
    uavs = len(positions)
    return smallest_distance(both, np.arange(uavs), np.full(uavs, uavs))


def unicycle() -> Model:
    """Return the model (5.1) of the chapter, nx = 4, nu = 2."""
    u, omega = ca.SX.sym("u"), ca.SX.sym("omega")
    names = "acceleration_m_s2", "turn_rate_rad_s"
    return _planar([u, omega], names, lambda v: (u, omega))


def _planar(
    controls: Sequence[ca.SX],
    control_names: tuple[str, str],
    rates: Callable[[ca.SX], tuple[ca.SX | float, ca.SX]],
) -> Model:
    """Return a model whose speed and heading change by the rates, given the speed."""
    v, psi, x, y = (ca.SX.sym(name) for name in ("v", "psi", "x", "y"))
    return Model(
        states=ca.vertcat(v, psi, x, y),
        controls=ca.vertcat(*controls),
        ode=ca.vertcat(*rates(v), v * ca.cos(psi), v * ca.sin(psi)),
        state_names=STATES,
        control_names=control_names,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Thrust:
    """Aircraft that accelerates by thrust against drag.

    Attributes:
        drag: D, constant [N].
        weight: W [N], positive.
        equation: "newton", a = g (T - D) / W, or "printed", a = (T - D) / W, with the
            thrust T and the acceleration a.
    """

    drag: float
    weight: float
    equation: ThrustEquation

    def acceleration(self, thrust: ca.SX | float) -> ca.SX | float:
        """Return the acceleration [m/s^2] for a thrust [N]."""
        factor = GRAVITY_M_S2 if self.equation == "newton" else 1.0
        return factor * (thrust - self.drag) / self.weight


def bank_to_turn(*, turn: Turn, thrust: Thrust | None = None) -> Model:
    """Return the model, nx = 4, nu = 2.

    Args:
        turn: Whether the heading rate has the sine or the tangent of the bank.
        thrust: Conversion of the first control to an acceleration; None means that it
            is an acceleration.

    Raises:
        InvalidProblemError: If the turn is neither "sin" nor "tan".
    """
    if turn not in TURNS:
        raise InvalidProblemError(f"turn must be sin or tan, got {turn!r}")
    push, phi = ca.SX.sym("push"), ca.SX.sym("phi")
    gain = push if thrust is None else thrust.acceleration(push)
    names = "acceleration_m_s2" if thrust is None else "thrust_n", "bank_rad"
    return _planar(
        [push, phi], names, lambda v: (gain, GRAVITY_M_S2 * TURNS[turn](phi) / v)
    )


def shortest_assignment(starts: Array, targets: Array) -> NDArray[np.int64]:
    """Return for each start the number of its target, from 0, shape (n,).

    Args:
        starts: Positions of the starts, shape (n, 2) [m].
        targets: Positions of as many targets, shape (n, 2) [m].
    """
    from scipy.optimize import linear_sum_assignment  # Slow to import.

    squared = np.sum((starts[:, None] - targets[None]) ** 2, axis=2)
    _, columns = linear_sum_assignment(squared)
    return np.asarray(columns, dtype=np.int64)
