"""Figure of a transfer: tracks, convergence, controls with bounds, distances."""

from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.drawing.closest import draw_scene
from swarmstart.cases.drawing.drawing import Figures, into_folder
from swarmstart.cases.drawing.panels import Labels, Panel, panels_of
from swarmstart.cases.drawing.plan_figures import draw_convergence
from swarmstart.cases.drawing.sheet import Part, panels_part, sheet
from swarmstart.cases.drawing.tracks import Scene, draw_distances
from swarmstart.cases.kinds.planar import POSITION, by_uav, pair_distances
from swarmstart.cases.kinds.transfer.pose import TransferFlight
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import Plan, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase


CONTROLS = ("acceleration", "bank")
UNITS = {"acceleration": "m/s\N{SUPERSCRIPT TWO}", "bank": "deg"}


@into_folder
def draw(
    scenario: TransferScenario,
    flight: TransferFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return the figure of a flight with its name."""
    return [("a_sheet", sheet_figure(scenario, flight, trajectory))]


def sheet_figure(
    scenario: TransferScenario, flight: TransferFlight, trajectory: Trajectory
) -> "Figure":
    """Return tracks, convergence of the search, controls, and distances."""
    uavs = len(flight.posed.goals)
    labels = _labels(uavs)
    plan = trajectory.decisions[0].plans[0]
    scene = scene_of(flight, trajectory)

    def draw_places(part: "FigureBase") -> None:
        draw_scene(part, scene)

    def draw_search(part: "FigureBase") -> None:
        draw_convergence(part, plan, labels)

    def draw_apart(part: "FigureBase") -> None:
        draw_distances(
            part.subplots(),
            trajectory.dense_times,
            pair_distances(trajectory.dense_states, uavs),
            limits={"safe": scenario.safe_distance_m},
        )

    parts = [
        Part("Tracks", draw_places),
        Part("Cost of the plan", draw_search),
        panels_part("Controls", _controls(flight, trajectory, labels), labels),
    ]
    if uavs > 1:
        parts.append(Part("Distances between UAVs", draw_apart))
    return sheet(f"{scenario.title}\n{_in_words(plan)}", parts)


def scene_of(flight: TransferFlight, trajectory: Trajectory) -> Scene:
    """Return the tracks with the goals."""
    tracks = by_uav(trajectory.dense_states, len(flight.posed.goals))
    return Scene(
        times=trajectory.dense_times,
        positions=tracks[:, list(POSITION)],
        headings=tracks[:, 1],
        names=_labels(len(tracks)).vehicles,
        targets=flight.posed.goals,
        called="goal",
    )


def _labels(uavs: int) -> Labels:
    return Labels(
        controls=CONTROLS,
        units=UNITS,
        vehicles=tuple(f"UAV {number}" for number in range(1, uavs + 1)),
    )


def _controls(
    flight: TransferFlight, trajectory: Trajectory, labels: Labels
) -> list[Panel]:
    """Return acceleration and bank, the latter in degrees."""
    scale = np.tile([1.0, np.degrees(1.0)], len(flight.posed.goals))
    lower, upper = flight.posed.agents[0].problem.control_limits
    return panels_of(
        CONTROLS,
        labels,
        trajectory.times,
        scale[:, None] * trajectory.controls,
        (scale * lower, scale * upper),
    )


def _in_words(plan: Plan) -> str:
    kept = "" if plan.feasible else ", it breaks limits"
    return f"the plan costs {plan.cost:.6g}{kept}"
