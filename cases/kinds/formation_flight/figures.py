"""Figures of a formation flight, after the chapter's Figs. 5.9-5.12.

(a) tracks in the plane, the leader "o" and the UAVs triangles; (b)-(e) relative speed,
heading, x and y against time. Beside them what the chapter does not show: distances
and obstacle clearance between the samples, and the terminal set.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing.drawing import (
    COLOURS,
    Figures,
    arrowhead,
    colour,
    into_folder,
    new_figure,
)
from swarmstart.cases.kinds.formation_flight.measures import (
    clearances,
    errors,
    linear_mask,
    lyapunov,
)
from swarmstart.cases.kinds.formation_flight.pose import (
    FormationFlight,
    leader_positions,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.models.unicycle import unicycle
from swarmstart.cases.kinds.planar import by_uav, pair_distances
from swarmstart.ocp import Mode, Plant, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MARKS = 6
BEGINNING_S = 20.0
# Pairs of states that the terminal set's matrix couples, behind a leader along x.
PLANES = ((2, 3), (0, 2), (1, 3))
SETS_SHOWN = 2.5
# A clearance far above the limit says nothing: the panel ends here, in metres.
FAR_M = 40.0

RELATIVE = (
    ("speed", "v - v$_L$ [m/s]"),
    ("heading", r"$\psi$ - $\psi_L$ [rad]"),
    ("x", "x - slot [m]"),
    ("y", "y - slot [m]"),
)


@into_folder
def draw(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return all figures of a flight by name, in the order of the chapter's panels."""
    figures = [
        ("a_tracks", tracks_figure(scenario, flight, trajectory)),
        *[
            (f"{letter}_relative_{name}", relative_figure(flight, trajectory, row))
            for row, (letter, (name, _)) in enumerate(
                zip("bcde", RELATIVE, strict=True)
            )
        ],
        ("f_distances", distances_figure(scenario, flight, trajectory)),
    ]
    if flight.posed.designed_set is not None:
        figures += [
            ("g_terminal_set", terminal_set_figure(flight, trajectory)),
            ("h_entering", entering_figure(flight, trajectory)),
        ]
    return figures


def tracks_figure(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> "Figure":
    """Return (a): tracks in the plane; the whole flight, and its beginning to scale.

    Of a flight of one planned step: the plans over their whole horizon.
    """
    first = trajectory.decisions[0]
    if len(trajectory.decisions) == 1 and first.mode is Mode.PLANNED:
        return _plans_figure(scenario, flight, trajectory)
    figure = new_figure((9.0, 8.0))
    whole, beginning = figure.subplots(2, 1, height_ratios=(2, 3))
    until = min(BEGINNING_S, float(trajectory.times[-1]))
    times, dense = (
        trajectory.dense_times,
        by_uav(trajectory.dense_states, flight.agents),
    )
    early = times <= until + 1e-9
    _tracks(whole, scenario, times, dense)
    _tracks(beginning, scenario, times[early], dense[:, :, early])
    beginning.set_aspect("equal", adjustable="datalim")
    whole.set_title(scenario.title)
    beginning.set_title(f"the first {until:g} s, to scale")
    _uav_legend(beginning, flight)
    return figure


def planned_paths(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> tuple[Array, Array]:
    """Return where the plans of the first step lead, if flown to their end.

    Returns:
        Times, shape (n,) [s], and the states of each UAV, shape (uavs, 4, n).
    """
    plant = Plant(unicycle(), dt=flight.plant.dt, substeps=flight.plant.substeps)
    paths = []
    for start, plan in zip(
        by_uav(flight.x0[:, None], flight.agents),
        trajectory.decisions[0].plans,
        strict=True,
    ):
        path = [start]
        for control in plan.controls.T:
            path.append(plant(path[-1][:, -1], control))
        paths.append(np.hstack(path))
    horizon = flight.plant.dt * scenario.prediction.intervals
    return np.linspace(0.0, horizon, paths[0].shape[1]), np.stack(paths)


def _plans_figure(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> "Figure":
    times, paths = planned_paths(scenario, flight, trajectory)
    figure = new_figure((9.0, 6.0))
    axes = figure.add_subplot()
    _tracks(axes, scenario, times, paths)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"{scenario.title}: planned for {times[-1]:g} s")
    _uav_legend(axes, flight)
    return figure


def _tracks(
    axes: "Axes", scenario: FormationScenario, times: Array, dense: Array
) -> None:
    """Draw tracks (uavs, 4, n), the formation marked at five instants or so."""
    leader = leader_positions(scenario, times)
    axes.plot(*leader, color="0.6", linestyle=":", linewidth=1)
    for number, states in enumerate(dense):
        axes.plot(states[2], states[3], color=colour(number), linewidth=1)
    for instant in np.linspace(0.0, times[-1], MARKS):
        _formation(axes, scenario, dense, times, float(instant))
    _obstacles(axes, scenario)
    axes.set(xlabel="x [m]", ylabel="y [m]")


def _formation(
    axes: "Axes",
    scenario: FormationScenario,
    dense: Array,
    times: Array,
    instant: float,
) -> None:
    """Mark leader and UAVs at an instant, the triangles pointing where they fly."""
    k = int(np.argmin(np.abs(times - instant)))
    leader = leader_positions(scenario, times[k : k + 1])[:, 0]
    axes.plot(*leader, marker="o", color="black", markersize=7, fillstyle="none")
    for number, states in enumerate(dense[:, :, k]):
        axes.plot(
            states[2],
            states[3],
            marker=arrowhead(float(states[1])),
            color=colour(number),
            markersize=11,
            linestyle="none",
        )


def _obstacles(axes: "Axes", scenario: FormationScenario) -> None:
    from matplotlib.patches import Circle

    for obstacle in scenario.obstacles:
        axes.add_patch(
            Circle(
                (obstacle.x_m, obstacle.y_m),
                obstacle.radius_m,
                facecolor="0.85",
                edgecolor="0.4",
            )
        )


def _uav_legend(axes: "Axes", flight: FormationFlight) -> None:
    from matplotlib.lines import Line2D

    agents = flight.agents
    handles: list[Any] = [
        Line2D([], [], marker="o", color="black", fillstyle="none", linestyle="none")
    ]
    handles += [Line2D([], [], marker="^", color=colour(i)) for i in range(agents)]
    labels = ["leader", *flight.posed.names]
    axes.legend(handles, labels, fontsize="small", ncols=2 if agents > 5 else 1)  # noqa: PLR2004


def relative_figure(
    flight: FormationFlight, trajectory: Trajectory, row: int
) -> "Figure":
    """Return (b)-(e): one relative state of every UAV against time."""
    figure = new_figure()
    axes = figure.add_subplot()
    deviations = errors(flight.posed, trajectory.dense_times, trajectory.dense_states)
    for number, deviation in enumerate(deviations):
        axes.plot(
            trajectory.dense_times,
            deviation[row],
            color=colour(number),
            linewidth=1.2,
            label=flight.posed.names[number],
        )
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    _shade_linear(axes, trajectory)
    axes.set(xlabel="time [s]", ylabel=RELATIVE[row][1])
    axes.legend(fontsize="small")
    return figure


def _shade_linear(axes: "Axes", trajectory: Trajectory) -> None:
    """Shade the steps flown under the linear law."""
    linear, times = linear_mask(trajectory), trajectory.times
    labelled = False
    for k in np.flatnonzero(linear):
        label = None if labelled else "linear law"
        axes.axvspan(times[k], times[k + 1], color="0.93", linewidth=0, label=label)
        labelled = True


def distances_figure(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> "Figure":
    """Return (f): smallest distance and clearance between the samples, and at them."""
    series: list[tuple[str, float, list[tuple[Array, Array]]]] = []
    grids = [
        (trajectory.dense_times, trajectory.dense_states),
        (trajectory.times, trajectory.states),
    ]
    if flight.agents > 1:
        limit = scenario.avoidance.safe_distance_m
        distances = [
            (t, pair_distances(x, flight.agents).min(axis=0)) for t, x in grids
        ]
        series.append(("smallest distance of two UAVs [m]", limit, distances))
    if scenario.obstacles:
        rooms = [(t, clearances(scenario, flight, x).min(axis=0)) for t, x in grids]
        series.append(("smallest clearance of the obstacles [m]", 0.0, rooms))
    figure = new_figure((7.0, 0.8 + 2.8 * max(len(series), 1)))
    panels = figure.subplots(max(len(series), 1), 1, squeeze=False)[:, 0]
    for axes, (label, limit, values) in zip(panels, series, strict=False):
        (dense_times, dense), (times, sampled) = values
        axes.plot(dense_times, dense, color=COLOURS[0], linewidth=1.2, label="flown")
        axes.plot(
            times, sampled, ".", color=COLOURS[1], label="at the control instants"
        )
        axes.axhline(limit, color="0.3", linestyle="--", linewidth=1, label="limit")
        axes.fill_between(
            dense_times, limit, dense, where=dense < limit, color=COLOURS[1], alpha=0.4
        )
        axes.set(ylabel=label)
        axes.set_ylim(top=min(axes.get_ylim()[1], limit + FAR_M))
        axes.legend(fontsize="small")
    panels[-1].set_xlabel("time [s]")
    return figure


def terminal_set_figure(flight: FormationFlight, trajectory: Trajectory) -> "Figure":
    """Return (g): e'Pe of every UAV against the level of the terminal set."""
    figure = new_figure()
    axes = figure.add_subplot()
    values = np.maximum(lyapunov(flight.posed, trajectory), 1e-14)
    for number, value in enumerate(values):
        axes.semilogy(
            trajectory.times,
            value,
            color=colour(number),
            linewidth=1.2,
            label=flight.posed.names[number],
        )
    level = flight.posed.terminal_set.alpha
    axes.axhline(
        level, color="0.3", linestyle="--", linewidth=1, label=f"alpha = {level:.3g}"
    )
    _shade_linear(axes, trajectory)
    axes.set(
        xlabel="time [s]",
        ylabel="e'Pe",
        title=f"Terminal set, {flight.posed.terminal_set.design} design",
    )
    axes.legend(fontsize="small")
    return figure


def entering_figure(flight: FormationFlight, trajectory: Trajectory) -> "Figure":
    """Return (h): the terminal set's projections, and the UAVs on their way into it."""
    figure = new_figure((11.0, 4.2))
    terminal_set = flight.posed.terminal_set
    deviations = errors(flight.posed, trajectory.dense_times, trajectory.dense_states)
    at_instants = errors(flight.posed, trajectory.times, trajectory.states)
    linear = linear_mask(trajectory)
    extent = terminal_set.ellipsoid.extent()
    panels = figure.subplots(1, len(PLANES))
    for axes, (i, j) in zip(panels, PLANES, strict=True):
        outline = terminal_set.ellipsoid.shadow(i, j)
        axes.fill(*outline, color="0.9")
        axes.plot(*outline, color="0.3", linestyle="--", linewidth=1)
        for number, (dense, instants) in enumerate(
            zip(deviations, at_instants, strict=True)
        ):
            axes.plot(
                dense[i],
                dense[j],
                color=colour(number),
                linewidth=0.9,
                label=flight.posed.names[number],
            )
            flown = instants[:, :-1][:, linear]
            axes.plot(flown[i], flown[j], "o", color=colour(number), markersize=3)
        axes.set(xlabel=RELATIVE[i][1], ylabel=RELATIVE[j][1])
        axes.set_xlim(-SETS_SHOWN * extent[i], SETS_SHOWN * extent[i])
        axes.set_ylim(-SETS_SHOWN * extent[j], SETS_SHOWN * extent[j])
    panels[0].legend(fontsize="small")
    certificate = terminal_set.certificate
    grounds = "of its bounds"
    if certificate is not None and certificate.dt is not None:
        grounds = f"certified for inputs held {certificate.dt:g} s"
    figure.suptitle(
        f"Terminal set, {terminal_set.design} design, alpha = {terminal_set.alpha:.4g} "
        f"{grounds}; dots: steps under the linear law",
        fontsize="medium",
    )
    return figure
