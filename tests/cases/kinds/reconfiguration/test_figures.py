"""The figures 5.18 to 5.28, and those of many UAVs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from swarmstart.cases.format.kind import NoAnimationError
from swarmstart.cases.kinds.reconfiguration.figures import draw
from swarmstart.cases.kinds.reconfiguration.kind import KIND
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import SearchReport, Trajectory, simulate
from swarmstart.tests.cases.drawing.reading import (
    bounds,
    curves,
    held,
    legend,
    named,
    panel,
)
from swarmstart.tests.cases.kinds.flights import build
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import slots_at, uavs_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Fly, Make

UAVS, STEPS = 5, 3


@pytest.fixture(scope="module")
def trajectory(flight: ReconfigurationFlight) -> Trajectory:
    return simulate(
        flight.plant, flight.controller, flight.x0, steps=STEPS,
        rng=np.random.default_rng(0),
    )  # fmt: skip


def drawn(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> dict[str, Figure]:
    """Return the figures by name, not written."""
    return dict(draw.__wrapped__(scenario, flight, trajectory))  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def text(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> dict[str, Figure]:
    """The figures of the text's experiment."""
    return drawn(scenario, flight, trajectory)


def colours(file: Path) -> int:
    assert file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    with Image.open(file) as image:
        return len(image.convert("RGB").getcolors(1 << 24) or ())


def test_all_figures_are_drawn_in_order_and_not_blank(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
    tmp_path: Path,
) -> None:
    files = draw(scenario, flight, trajectory, tmp_path / "figures")
    assert [file.name[0] for file in files] == list("abc")
    assert sorted(files) == sorted((tmp_path / "figures").iterdir())
    assert all(colours(file) > 50 for file in files)


def test_tracks_begin_at_the_starts_and_slots_lie_around_the_leaders_end(
    flight: ReconfigurationFlight, trajectory: Trajectory, text: dict[str, Figure]
) -> None:
    axes = panel(text["a_sheet"], "y [m]")
    tracks = [line for line in axes.lines if str(line.get_label()).startswith("UAV")]
    assert [line.get_label() for line in tracks] == [f"UAV {i}" for i in range(1, 6)]
    begun = [(line.get_xdata()[0], line.get_ydata()[0]) for line in tracks]  # type: ignore[index]
    assert begun == [(0, 20), (0, 10), (0, 0), (0, -10), (0, -20)]
    (slots,) = named(axes, "slot at the end")
    wanted = trajectory.states[10:12, [-1]] + flight.posed.slots.T
    assert np.asarray(slots.get_data()) == pytest.approx(wanted)


def test_a_panel_of_each_horizon_has_the_history_of_its_search(
    trajectory: Trajectory, text: dict[str, Figure]
) -> None:
    costs, *panels = [axes for axes in text["b_evolution"].axes if axes.lines]
    plans = [decision.plans[0].cost for decision in trajectory.decisions]
    assert curves(costs)[0].tolist() == plans
    assert [axes.get_title() for axes in panels] == [
        f"horizon {k}" for k in range(1, STEPS + 1)
    ]
    for axes, decision in zip(panels, trajectory.decisions, strict=True):
        history = np.asarray(axes.lines[0].get_ydata())
        assert np.array_equal(history, decision.plans[0].search.history)
        assert history.size == 101  # the first population, and 100 generations
        assert (np.diff(history) <= 0).all() and history[-1] == decision.plans[0].cost


def test_histories_of_those_who_plan_alone_are_summed(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    by_hand: Fly,
) -> None:
    flown = by_hand(
        np.repeat(flight.x0[:, None], 3, axis=1),
        agents=2,
        plan=lambda step, agent: {
            "search": SearchReport(history=np.array([9.0, step + agent]))
        },
    )
    _, *panels = drawn(scenario, flight, flown)["b_evolution"].axes
    histories = [curve.get_ydata().tolist() for x in panels for curve in x.lines]  # type: ignore[union-attr]
    assert histories == [[18, 1], [18, 3]]


def test_without_a_search_the_figure_says_so(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    by_hand: Fly,
) -> None:
    flown = by_hand(np.repeat(flight.x0[:, None], 3, axis=1))
    (axes,) = drawn(scenario, flight, flown)["b_evolution"].axes
    assert axes.get_title() == "plans, made without a search"


def test_distances_from_the_slots_are_on_a_logarithmic_axis(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
    text: dict[str, Figure],
) -> None:
    axes = panel(text["a_sheet"], "distance from the slot [m]")
    errors = KIND.measure(scenario, flight, trajectory)["position_error_per_horizon_m"]
    assert isinstance(errors, list)
    assert axes.get_yscale() == "log" and len(curves(axes)) == UAVS - 1
    assert max(line[-1] for line in curves(axes)) == pytest.approx(errors[-1])
    assert axes.get_title(loc="right") == f"largest at the end {errors[-1]:.3g} m"


@pytest.mark.parametrize(
    ("name", "row", "unit"), [("bank [deg]", 1, 180 / np.pi), ("thrust [N]", 0, 1.0)]
)
def test_controls_are_held_over_their_steps_between_their_bounds(
    name: str,
    row: int,
    unit: float,
    scenario: ReconfigurationScenario,
    trajectory: Trajectory,
    text: dict[str, Figure],
) -> None:
    axes = panel(text["a_sheet"], name)
    steps = held(axes)
    assert len(steps) == UAVS
    for number, (values, edges) in enumerate(steps):
        own = trajectory.controls[2 * number + row]
        assert values == pytest.approx(unit * own)
        assert edges.tolist() == [0, 1, 2, 3]
    limits = (scenario.vehicle.thrust_n, scenario.vehicle.bank_rad)[row]
    wanted = [unit * limits.lower, unit * limits.upper]
    assert bounds(axes) == pytest.approx(wanted)


def test_every_pair_has_its_line_between_both_limits(
    flight: ReconfigurationFlight, text: dict[str, Figure]
) -> None:
    (axes,) = text["c_distances"].axes
    names = [line.get_label() for line in axes.lines]
    assert names[0] == "UAVs 1, 2" and names[9] == "UAVs 4, 5"
    assert len(names) == 10 + 2
    first = np.asarray(axes.lines[3].get_ydata())  # of UAVs 1 and 5
    assert first[0] == 40.0 and first.size == STEPS * flight.plant.substeps + 1
    limits = [np.asarray(line.get_ydata())[0] for line in axes.lines[10:]]
    assert limits == [5.0, 50.0]


@pytest.fixture(scope="module")
def many(make: Make) -> tuple[ReconfigurationScenario, ReconfigurationFlight]:
    """Fourteen in a column: too many to be named each, and 91 pairs."""
    rows = [(2, 0, 0, 4.0 * i) for i in range(14)]
    places = [(0, y) for _, _, _, y in rows]
    crowd = make(
        uavs_at(rows), slots_at(places), "leader_uav=1", "distances.safe_m=1",
        "distances.communication_m=60", "backend=casadi",
    )  # fmt: skip
    return crowd, build(crowd)


def test_of_many_uavs_only_the_nearest_and_the_farthest_pair_are_drawn(
    many: tuple[ReconfigurationScenario, ReconfigurationFlight],
    by_hand: Fly,
) -> None:
    crowd, flight = many
    states = np.repeat(flight.x0[:, None], 3, axis=1)
    states[3, 2] = 1.0  # the first comes nearer to the second
    flown = by_hand(states)
    all_linked = drawn(crowd, flight, flown)
    branches = replace(flight.posed, links=((1, 0), (2, 1)))
    tree = drawn(crowd, replace(flight, posed=branches), flown)
    assert lines(all_linked["c_distances"]) == {
        "smallest of 91 pairs": [4, 4, 3], "largest": [52, 52, 51],
        "safe, 1 m": [1, 1], "communication, 60 m": [60, 60],
    }  # fmt: skip
    assert lines(tree["c_distances"])["largest of a link"] == [4, 4, 4]
    names = legend(tree["a_sheet"])
    assert "14 vehicles" in names and not [x for x in names if x.startswith("UAV")]
    assert {"median of 14", "middle half", "smallest to largest"} <= {*names}


def lines(figure: Figure) -> dict[str, list[float]]:
    """Return the lines of a figure by their names in its legend."""
    (axes,) = figure.axes
    return {str(x.get_label()): np.asarray(x.get_ydata()).tolist() for x in axes.lines}


def test_figures_of_many_uavs_are_not_blank(
    many: tuple[ReconfigurationScenario, ReconfigurationFlight],
    by_hand: Fly,
    tmp_path: Path,
) -> None:
    crowd, flight = many
    still = by_hand(np.repeat(flight.x0[:, None], 3, axis=1))
    assert all(colours(file) > 20 for file in draw(crowd, flight, still, tmp_path))


def test_there_is_no_animation() -> None:
    with pytest.raises(NoAnimationError, match="no animation, got --animation gif"):
        KIND.check_animation("gif")
