"""Swarm of point masses: starts, goals, bounds, obstacles, and the links between them.

Distances are those of scaled positions: scale (1, 1, 0.5) keeps vehicles twice as far
apart along z, so that no drone comes into the downwash of another.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    mapping,
    of_kind,
    optional,
    reals,
    several,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused

AXES = 3
LEAST_DRIFT = 1e-3
"""Least speed of a frame that moves: below it a vehicle has no clear heading [m/s]."""


def _frozen(value: ArrayLike, shape: tuple[int | None, ...], name: str) -> Array:
    """Return a copy of finite numbers of a shape, set read-only."""
    array = np.array(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        size is None or found == size
        for found, size in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("k" if size is None else str(size) for size in shape)
        raise InvalidProblemError(
            f"{name} must have shape ({wanted}), got {array.shape}"
        )
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0].tolist()
        raise InvalidProblemError(f"{name} must be finite, got {array[*bad]} at {bad}")
    array.flags.writeable = False
    return array


def _distances(points: Array, path: Array) -> Array:
    """Return the distance of each point from a polygon, shape (n,)."""
    found = np.linalg.norm(points - path[0], axis=1)
    for start, end in itertools.pairwise(path):
        way = end - start
        share = (points - start) @ way / max(way @ way, np.finfo(float).tiny)
        near = start + np.clip(share, 0.0, 1.0)[:, None] * way
        found = np.minimum(found, np.linalg.norm(points - near, axis=1))
    return np.asarray(found)


def pairwise_distances(places: Array) -> Array:
    """Return the distances between all pairs of points, shape (n, n)."""
    return np.asarray(np.linalg.norm(places[:, None] - places, axis=2))


def _set(thing: object, **values: object) -> None:
    """Set attributes of a frozen object that is being made."""
    for name, value in values.items():
        object.__setattr__(thing, name, value)


@checked(refused, radius=a_number(above=0), path=reals(), times=reals())
@dataclass(frozen=True, init=False, slots=True, eq=False)
class Obstacle:
    """Ball at rest, or moving on a known path.

    Attributes:
        radius: Radius of the ball [m].
        path: Positions of its centre, shape (k, 3), between which it moves at constant
            speed; it rests before the first and after the last [m].
        times: Times of the positions, rising, shape (k,) [s].

    Raises:
        InvalidProblemError: If shapes do not fit, a number is not finite, or times do
            not rise.

    Example:
        >>> import swarmstart as ss
        >>> ss.Obstacle(radius=0.5, path=[[1.0, 0.0, 0.0]]).path.shape
        (1, 3)
    """

    radius: float
    path: Array
    times: Array

    def __init__(
        self, *, radius: float, path: ArrayLike, times: ArrayLike = (0.0,)
    ) -> None:
        """Copy the arrays."""
        places = _frozen(path, (None, AXES), "path")
        rising = _frozen(times, (len(places),), "times")
        if not len(places) or (np.diff(rising) <= 0).any():
            raise InvalidProblemError(f"times must rise, got {rising}")
        _set(self, radius=float(radius), path=places, times=rising)

    @checked(refused, times=reals(axes=1))
    def position(self, times: ArrayLike) -> Array:
        """Return the centre at times, shape (len(times), 3) [m]."""
        now = np.asarray(times, dtype=np.float64)
        each = [np.interp(now, self.times, axis) for axis in self.path.T]
        return np.stack(each, axis=1)

    @checked(refused, times=reals(axes=1))
    def bulge(self, times: ArrayLike) -> Array:
        """Return by how much the centre may be off the chords between times [m].

        A chord joins the centres at two successive times; between them the path may
        have a corner. Shape (len(times) - 1,).
        """
        speeds = np.linalg.norm(np.diff(self.path, axis=0), axis=1)
        speeds /= np.diff(self.times)
        fastest = float(speeds.max(initial=0.0))
        turns = np.searchsorted(self.times, times)
        return np.where(np.diff(turns) > 0, fastest * np.diff(times), 0.0)


@checked(
    refused,
    starts=reals(),
    goals=reals(),
    distance=a_number(above=0),
    scale=reals(),
    acceleration=reals(),
    speed=reals(),
    obstacles=several(of_kind(Obstacle, "an Obstacle"), "a sequence of Obstacles"),
    turn_rate=a_number(above=0, finite=False),
    headings=optional(reals()),
    tracking_error=a_number(least=0),
    drift=reals(),
)
@dataclass(frozen=True, init=False, slots=True, eq=False)
class Swarm:
    """Point masses that go from their starts to their goals, at rest at both.

    Attributes:
        starts: Positions, shape (n, 3) [m].
        goals: Positions, shape (n, 3) [m].
        distance: Least scaled distance of two vehicles [m].
        scale: Factors of the three axes in all distances, shape (3,).
        acceleration: Largest acceleration along each axis, shape (3,) [m/s^2].
        speed: Largest speed along each axis, shape (3,) [m/s]; 0: plans do not change
            the coordinate.
        obstacles: Balls from which a vehicle keeps half of `distance`, scaled.
        turn_rate: Largest turn rate of vehicles that move in the plane, in the
            direction of their heading (unicycles) [rad/s]; the bounds of the first axis
            then hold for the sizes of acceleration and velocity. Infinite for point
            masses.
        headings: Headings of such vehicles at the start, shape (n,) [rad]; zero if they
            are not given.
        drift: Velocity of the frame in which places are given, shape (3,) [m/s]: what
            is at rest there moves with it, as in a formation. Turn rates take it into
            account; nothing else depends on it.
        tracking_error: Largest scaled distance of a vehicle from its plan [m]; two
            plans keep `distance` plus twice this.

    Raises:
        InvalidProblemError: If shapes do not fit, a number is not finite, two starts or
            two goals are too near, a goal is too near an obstacle's last position, or a
            start is too near an obstacle's path; the message names the vehicles and the
            distance.

    Example:
        >>> import swarmstart as ss
        >>> swarm = ss.Swarm(
        ...     starts=[[0, 0, 1], [2, 0, 1]], goals=[[2, 0, 1], [0, 0, 1]],
        ...     distance=0.35,
        ... )
        >>> swarm.size
        2
    """

    starts: Array
    goals: Array
    distance: float
    scale: Array
    acceleration: Array
    speed: Array
    obstacles: tuple[Obstacle, ...]
    turn_rate: float
    headings: Array
    drift: Array
    tracking_error: float

    def __init__(  # noqa: PLR0913 - its fields
        self,
        *,
        starts: ArrayLike,
        goals: ArrayLike,
        distance: float,
        scale: ArrayLike = (1.0, 1.0, 1.0),
        acceleration: ArrayLike = (1.0, 1.0, 1.0),
        speed: ArrayLike = (2.0, 2.0, 2.0),
        obstacles: Sequence[Obstacle] = (),
        turn_rate: float = np.inf,
        headings: ArrayLike | None = None,
        drift: ArrayLike = (0.0, 0.0, 0.0),
        tracking_error: float = 0.0,
    ) -> None:
        """Copy the arrays, and check that all vehicles have room."""
        first = _frozen(starts, (None, AXES), "starts")
        if not len(first):
            raise InvalidProblemError("starts must name a vehicle, got none")
        last = _frozen(goals, (len(first), AXES), "goals")
        _set(self, starts=first, goals=last, distance=float(distance))
        factors = {"scale": scale, "acceleration": acceleration, "speed": speed}
        for name, given in factors.items():
            array = _frozen(given, (AXES,), name)
            is_speed = name == "speed"
            fits = array.any() and (array >= 0).all() if is_speed else (array > 0).all()
            if not fits:
                least = "at least 0, and one above it" if is_speed else "above 0"
                raise InvalidProblemError(f"{name} must be {least}, got {array}")
            _set(self, **{name: array})
        faced = np.zeros(len(first)) if headings is None else headings
        _set(
            self,
            obstacles=tuple(obstacles),
            turn_rate=float(turn_rate),
            drift=_frozen(drift, (AXES,), "drift"),
            tracking_error=float(tracking_error),
            headings=_frozen(faced, (len(first),), "headings"),
        )
        self._check_plane()
        moved = (last != first).any(axis=0) & (self.speed == 0)
        if moved.any():
            axis = "xyz"[int(moved.argmax())]
            raise InvalidProblemError(
                f"goals must have the {axis} of the starts with a speed of 0 along it, "
                f"got {last[:, moved][:, 0]} from {first[:, moved][:, 0]}"
            )
        self._check_room("starts", first)
        self._check_room("goals", last)

    def _check_plane(self) -> None:
        size = float(np.linalg.norm(self.drift))
        if self.drift[2] != 0 or 0 < size < LEAST_DRIFT:
            raise InvalidProblemError(
                f"drift must be level, and 0 or at least {LEAST_DRIFT} m/s, got "
                f"{self.drift}"
            )
        if self.turn_rate == np.inf:
            return
        heights = np.unique([self.starts[:, 2], self.goals[:, 2]])
        if len(heights) > 1 or self.scale[0] != self.scale[1]:
            raise InvalidProblemError(
                "vehicles with a turn rate must stay in a plane: one height of starts "
                f"and goals, and one scale along x and y; got heights {heights} and "
                f"scale {self.scale}"
            )

    def _check_room(self, name: str, places: Array) -> None:
        scaled, wanted = places * self.scale, self.plan_distance
        for i, place in enumerate(scaled):
            apart = np.linalg.norm(scaled[:i] - place, axis=1)
            if (apart < wanted).any():
                j = int(apart.argmin())
                raise InvalidProblemError(
                    f"{name} of vehicles {j} and {i} must be {wanted:g} m "
                    f"apart (scaled), got {apart[j]:.4g} m"
                )
        for number, obstacle in enumerate(self.obstacles):
            # Goals are kept for ever; starts, as long as no plan is agreed upon.
            path = obstacle.path if name == "starts" else obstacle.path[-1:]
            apart = _distances(scaled, path * self.scale)
            least = self.clearance(obstacle)
            if (apart < least).any():
                i = int(apart.argmin())
                raise InvalidProblemError(
                    f"{name} of vehicle {i} must be {least:g} m from the centre of "
                    f"obstacle {number} (scaled), got {apart[i]:.4g} m"
                )

    @checked(refused, obstacle=of_kind(Obstacle, "an Obstacle"))
    def clearance(self, obstacle: Obstacle) -> float:
        """Return the scaled distance that a plan keeps from an obstacle's centre.

        The scaled obstacle, an ellipsoid, is replaced by a ball around it, whose radius
        is that of the obstacle times the largest factor of `scale`.
        """
        return float(self.scale.max() * obstacle.radius + self.plan_distance / 2)

    @property
    def plan_distance(self) -> float:
        """Least scaled distance of two plans [m]."""
        return self.distance + 2.0 * self.tracking_error

    @property
    def size(self) -> int:
        """Number of vehicles."""
        return len(self.starts)


@checked(
    refused,
    period=a_count(least=1, most=100),
    most_delay=a_count(most=10_000),
    loss=a_number(least=0, below=1),
    radio_range=a_number(above=0, finite=False),
    silences=mapping(
        a_count(), several(a_number(finite=False), "two times"),
        words="a mapping of vehicles to the times at which they fall silent and speak",
    ),
)  # fmt: skip
@dataclass(frozen=True, kw_only=True, slots=True)
class Links:
    """Links of a swarm: each vehicle broadcasts to all others at every tick.

    Attributes:
        period: Number of ticks in a step of the plans.
        most_delay: A message takes 1 to 1 + most_delay ticks, drawn anew each time.
        loss: Probability that a message is lost, for each receiver.
        silences: Vehicle -> (from, to), the times between which it neither sends nor
            hears [s].
        radio_range: Largest distance between sender and receiver, not scaled [m]. If it
            is finite, vehicles pass on what they hear.

    Raises:
        InvalidProblemError: If an argument is invalid.

    Example:
        >>> import swarmstart as ss
        >>> ss.Links(most_delay=3, loss=0.05).period
        2
    """

    period: int = 2
    most_delay: int = 0
    loss: float = 0.0
    silences: Mapping[int, Sequence[float]] = field(default_factory=dict)
    radio_range: float = np.inf

    def __post_init__(self) -> None:
        """Check the silences."""
        for vehicle, times in self.silences.items():
            if len(times) != 2 or not times[0] <= times[1]:  # noqa: PLR2004
                raise InvalidProblemError(
                    f"silences of vehicle {vehicle} must be (from, to), got {times}"
                )


def require_silences(links: Links, n: int) -> None:
    """Raise if a silent vehicle is not one of the swarm.

    Raises:
        InvalidProblemError: If the number of a silent vehicle is unknown.
    """
    unknown = sorted(set(links.silences) - set(range(n)))
    if unknown:
        raise InvalidProblemError(
            f"silences must name vehicles 0 to {n - 1}, got {unknown}"
        )
