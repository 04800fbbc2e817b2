"""An animation of a formation flight, through matplotlib's own writers."""

from pathlib import Path

import numpy as np

from swarmstart.cases.drawing.drawing import colour, new_figure
from swarmstart.cases.kinds.formation_flight.pose import (
    FormationFlight,
    leader_positions,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import by_uav
from swarmstart.cases.record.files import replacing
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Trajectory

FRAMES_PER_S = 10
WRITERS = {".gif": ("pillow", "Pillow"), ".mp4": ("ffmpeg", "the program ffmpeg")}


class MissingWriterError(SwarmstartError):
    """The program that writes this kind of animation is not installed."""


def check_writer(ending: str) -> None:
    """Refuse a kind of animation that cannot be written here.

    Args:
        ending: "gif" or "mp4".

    Raises:
        MissingWriterError: If the program that writes it is not installed.
    """
    from matplotlib import animation

    name, needed = WRITERS[f".{ending}"]
    if not animation.writers.is_available(name):
        raise MissingWriterError(
            f"an animation as {ending} needs {needed}, which is not installed; "
            "try --animation gif"
        )


def animate(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    file: Path,
) -> None:
    """Write an animation of a flight, ten times as fast as it was flown.

    Args:
        scenario: The scenario.
        flight: What was flown.
        trajectory: The flight.
        file: A name that ends in .gif or .mp4.

    Raises:
        MissingWriterError: If what writes that kind is not installed.
        RecordError: If the file cannot be written.
    """
    from matplotlib import animation

    check_writer(file.suffix.removeprefix("."))
    name, _ = WRITERS[file.suffix]
    figure = new_figure((9.0, 5.0))
    axes = figure.add_subplot()
    dense, times = (
        by_uav(trajectory.dense_states, flight.agents),
        trajectory.dense_times,
    )
    leader = leader_positions(scenario, times)
    trails = [axes.plot([], [], color=colour(i))[0] for i in range(flight.agents)]
    heads = [
        axes.plot([], [], marker="o", color=colour(i))[0] for i in range(flight.agents)
    ]
    (virtual,) = axes.plot([], [], marker="o", color="black", fillstyle="none")
    from matplotlib.patches import Circle

    for obstacle in scenario.obstacles:
        centre = (obstacle.x_m, obstacle.y_m)
        axes.add_patch(Circle(centre, obstacle.radius_m, facecolor="0.85"))
    everywhere = np.concatenate([dense[:, 2:].reshape(-1, 2, times.size), leader[None]])
    low, high = everywhere.min(axis=(0, 2)), everywhere.max(axis=(0, 2))
    axes.set(xlabel="x [m]", ylabel="y [m]", title=scenario.title)
    axes.set_xlim(low[0] - 10, high[0] + 10)
    axes.set_ylim(low[1] - 10, high[1] + 10)
    axes.set_aspect("equal")

    frames = np.arange(0, times.size, max(1, round(1.0 / (times[1] - times[0]))))
    writer = animation.writers[name](fps=FRAMES_PER_S)
    with (
        replacing(file, suffix=file.suffix) as temporary,
        writer.saving(figure, str(temporary), dpi=90),
    ):
        for k in frames:
            for number, states in enumerate(dense):
                trails[number].set_data(states[2, : k + 1], states[3, : k + 1])
                heads[number].set_data(states[2, k : k + 1], states[3, k : k + 1])
            virtual.set_data(leader[0, k : k + 1], leader[1, k : k + 1])
            writer.grab_frame()
