"""Animation of a swarm from above: vehicles, committed plans, links, obstacles.

Each disc is as large as the distance that a vehicle keeps. A dashed line is the rest of
a committed plan; a thin line between two vehicles shows that one of them has just
accepted the plan of the other. The clock turns red when a disc meets another one, at
the same height.
"""

from pathlib import Path

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.animation import (
    ALARM,
    FRAME,
    Filmed,
    check_writer,
    frame_times,
    write_film,
)
from swarmstart.cases.drawing.drawing import colour, escaped
from swarmstart.cases.kinds.swarm.kind import flight_of, positions_of
from swarmstart.cases.kinds.swarm.pose import SwarmRun
from swarmstart.cases.kinds.swarm.scenario import SwarmScenario
from swarmstart.ocp import SwarmFlight, Trajectory
from swarmstart.ocp.common import ProgressCallback, tell_nothing
from swarmstart.ocp.swarm.swarm import pairwise_distances

# `check_writer` is looked up here by its name; see `animated_by` of Kind.
__all__ = ["animate", "check_writer"]

LINK_S = 0.3
"""Time for which an acceptance is shown [s]."""
MOST_LINKS = 200
"""Number of acceptances that are shown at once."""
ROOM = 0.08
"""Room around all paths, in parts of their extent."""


def animate(
    scenario: SwarmScenario,
    flight: SwarmRun,
    trajectory: Trajectory,
    file: Path,
    *,
    progress: ProgressCallback = tell_nothing,
) -> None:
    """Write an animation of a run.

    Args:
        scenario: The scenario.
        flight: The closed loop.
        trajectory: Path of the run.
        file: A name that ends in .gif or .mp4.
        progress: Callback with (frames finished, all frames, "animating").
    """
    times = frame_times(trajectory.dense_times)
    places = np.stack(
        [
            [np.interp(times, trajectory.dense_times, row) for row in one]
            for one in positions_of(trajectory)
        ]
    )
    del flight
    film = SwarmFilm(flight_of(trajectory), times, places, title=scenario.title)
    write_film(film, file, [""] * film.frames, progress)


class SwarmFilm(Filmed):
    """A swarm from above, frame by frame."""

    def __init__(
        self, flight: SwarmFlight, times: Array, places: Array, *, title: str
    ) -> None:
        """Draw what stays, and prepare what moves.

        Args:
            flight: The committed plans.
            times: Times of the frames, shape (F,) [s].
            places: Positions at these times, shape (n, 3, F) [m].
            title: Title above the picture.
        """
        from matplotlib.collections import LineCollection
        from matplotlib.patches import Circle

        swarm = flight.swarm
        super().__init__(times.size, [colour(number) for number in range(swarm.size)])
        self._flight, self._times, self._places = flight, times, places
        axes = self.axes
        self._balls = [
            Circle((0, 0), one.radius, fc="0.85", ec="0.4", hatch="//")
            for one in swarm.obstacles
        ]
        axes.plot(*swarm.goals[:, :2].T, "x", color="0.45", ms=6, zorder=1)
        self._links = LineCollection([], colors="0.6", lw=0.6)
        self._plans = LineCollection([], colors=self.colours, lw=1.0, ls="--")
        radius = swarm.distance / 2 / swarm.scale[0]
        self._discs = [
            Circle((0, 0), radius, fc=own, ec="white", lw=0.6, zorder=3)
            for own in self.colours
        ]
        for patch in (*self._balls, *self._discs):
            axes.add_patch(patch)
        for lines in (self._links, self._plans):
            axes.add_collection(lines)
        low = places[:, :2].min(axis=(0, 2)) - radius
        high = places[:, :2].max(axis=(0, 2)) + radius
        room = ROOM * (high - low).max()
        axes.set(xlim=(low[0] - room, high[0] + room), xlabel="x [m]", ylabel="y [m]")
        axes.set_ylim(low[1] - room, high[1] + room)
        left, bottom, width, height = FRAME
        # Of the figure: the axes may be narrow.
        above = bottom + height + 0.02
        self.figure.text(left + width, above, escaped(title), fontsize=10, ha="right")
        axes.set_aspect("equal", adjustable="box")
        self._clock = self.figure.text(
            left, above, "", fontsize=12, family="monospace", fontweight="bold"
        )

    def show(self, frame: int, note: str = "") -> None:
        """Show the vehicles, plans, links and obstacles at the time of a frame."""
        del note
        now, places = float(self._times[frame]), self._places[:, :2, frame]
        swarm = self._flight.swarm
        for disc, place in zip(self._discs, places, strict=True):
            disc.set_center((float(place[0]), float(place[1])))
        for ball, one in zip(self._balls, swarm.obstacles, strict=True):
            x, y, _ = one.position([now])[0]
            ball.set_center((float(x), float(y)))
        self._plans.set_segments(self._ahead(now, places))
        self._links.set_segments(self._accepted(now, places))
        scaled = self._places[:, :, frame] * swarm.scale
        apart = pairwise_distances(scaled)
        np.fill_diagonal(apart, np.inf)
        is_near = bool((apart < swarm.distance).any())
        self._clock.set_text(f"t = {now:.1f} s" + ("  collision" if is_near else ""))
        self._clock.set_color(ALARM if is_near else "black")

    def _ahead(self, now: float, places: Array) -> list[Array]:
        """Return the rest of each committed plan, from above."""
        log, found = self._flight.log, []
        step = now / log.step_s
        for vehicle, place in enumerate(places):
            row = self._committed(vehicle, now)
            samples = log.plans.samples[row, :, :2] / self._flight.swarm.scale[:2]
            begin = max(0, int(np.floor(step)) + 1 - int(log.plans.first[row]))
            found.append(np.vstack([place, samples[begin:]]))
        return found

    def _committed(self, vehicle: int, now: float) -> int:
        """Return the row of the plan that a vehicle is committed to."""
        log = self._flight.log
        tick = now / log.step_s * log.ticks
        rows = np.flatnonzero(
            (log.vehicle == vehicle) & log.committed & (log.ended <= tick)
        )
        return int(rows[log.ended[rows].argmax()])

    def _accepted(self, now: float, places: Array) -> list[Array]:
        """Return lines between vehicles of which one has just accepted a plan."""
        log = self._flight.log
        tick = now / log.step_s * log.ticks
        age = tick - log.accepted
        recent = (
            (log.accepted >= 0) & (age >= 0) & (age < LINK_S / log.step_s * log.ticks)
        )
        pairs = np.argwhere(recent)[-MOST_LINKS:]
        return [places[[int(log.vehicle[row]), j]] for row, j in pairs]
