"""Animation of a formation flight: the formation seen from above, and its leader."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from swarmstart.cases.drawing.animation import animate_scene, check_writer
from swarmstart.cases.kinds.formation_flight.figures import scene_of
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.formation_flight.shown_path import shown_of
from swarmstart.cases.kinds.planar import POSITION
from swarmstart.ocp import Trajectory
from swarmstart.ocp.common import ProgressCallback, tell_nothing

__all__ = ["animate", "check_writer"]


def animate(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    file: Path,
    *,
    progress: ProgressCallback = tell_nothing,
) -> None:
    """Write an animation of a flight, or of the plan of a flight of one step.

    Args:
        scenario: The scenario.
        flight: The flight.
        trajectory: Its path.
        file: A name that ends in .gif or .mp4.
        progress: Told (frames finished, all frames, "animating").

    Raises:
        MissingWriterError: If the program that writes that kind is not installed.
        RecordError: If the file cannot be written.
    """
    shown = shown_of(scenario, flight, trajectory)
    scene = scene_of(scenario, flight, shown)
    slots = flight.posed.slots(shown.dense_times)[:, list(POSITION)]
    steps = np.searchsorted(shown.times, shown.dense_times + 1e-9, side="right") - 1
    steps = np.clip(steps, 0, shown.linear.size - 1)
    law = "plan" if shown.is_plan else "planning"
    notes = ["terminal law" if shown.linear[step] else law for step in steps]
    animate_scene(
        replace(scene, slots=slots),
        file,
        title=scenario.title,
        notes=notes,
        progress=progress,
    )
