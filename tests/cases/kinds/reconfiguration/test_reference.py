"""The best known costs, against earlier values and another kind of search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial import cKDTree

from swarmstart.arrays import Array
from swarmstart.cases.kinds.reconfiguration import measures as reference
from swarmstart.cases.kinds.reconfiguration.measures import best_costs, gaps
from swarmstart.ocp import RecedingHorizon, Trajectory, simulate
from swarmstart.tests.cases.kinds.flights import build
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import (
    reconfiguration,
    slots_at,
    uavs_at,
)

if TYPE_CHECKING:
    from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Fly


EXPECTED = {
    "reconfiguration": [756.338, 342.008, 111.175, 7.905],
    "reconfiguration_reverse": [755.639, 341.949, 110.228, 7.833, 0.747],
}
UAVS, LEADER, OTHERS = 5, 2, (0, 1, 3, 4)
SLOTS = np.array([[-20.0, 20], [-10, 10], [0, 0], [-10, -10], [-20, -20]])


@dataclass(frozen=True, kw_only=True)
class Best:
    """L-SHADE's flight, from state to state, and the best cost known from each."""

    joint: RecedingHorizon
    trajectory: Trajectory
    best: Array


@pytest.fixture(scope="module", params=EXPECTED)
def known(request: pytest.FixtureRequest) -> tuple[str, Best]:
    name: str = request.param
    size = "search={name: lshade, warm_start: half}"
    flight = build(reconfiguration(size, name=name))
    trajectory = simulate(
        flight.plant, flight.controller, flight.x0, steps=len(EXPECTED[name]),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    best = best_costs(flight.loop, trajectory.states[:, :-1])
    return name, Best(joint=flight.loop, trajectory=trajectory, best=best)


def test_the_best_costs_along_the_flight_are_those_expected(
    known: tuple[str, Best],
) -> None:
    name, found = known
    # Given to three digits after the point.
    assert found.best == pytest.approx(EXPECTED[name], abs=6e-4)


def test_lshade_finds_them_to_1e_6(known: tuple[str, Best]) -> None:
    _, found = known
    costs = [decision.plans[0].cost for decision in found.trajectory.decisions]
    assert np.abs(costs - found.best).max() <= 1e-6


def test_the_texts_search_finds_them_to_1_and_no_better(
    known: tuple[str, Best],
) -> None:
    name, found = known
    text = build(reconfiguration(name=name)).loop
    assert text is not None
    rng, costs, last = np.random.default_rng(0), [], None
    for state in found.trajectory.states[:, :-1].T:
        last = text.planner.plan(state, guess=last.controls if last else None, rng=rng)
        costs.append(last.cost)
    gap = costs - found.best
    assert gap.max() <= 1.0
    assert gap.min() > 1e-6


def terminal_states(x0: Array, count: int) -> Array:
    """Return where a grid of controls, count^2 of them, leads in a second, (n, 4).

    v = v0 + a t, psi = psi0 + g sin(phi) / a ln(v / v0), the way by Simpson's rule.
    """
    thrust, bank = (
        np.linspace(0, 6000, count),
        np.linspace(-np.pi / 3, np.pi / 3, count),
    )
    force, phi = (grid.ravel()[:, None] for grid in np.meshgrid(thrust, bank))
    a = (force - 2000) / 10_000
    a = np.where(a == 0, 1e-9, a)
    v0, psi0, x, y = x0
    t = np.linspace(0, 1, 41)
    shares = np.array([1, *[4, 2] * 19, 4, 1]) / 120
    v, psi = v0 + a * t, psi0 + 9.8 * np.sin(phi) / a * np.log1p(a * t / v0)
    return np.stack(
        [
            v[:, -1],
            psi[:, -1],
            x + (v * np.cos(psi)) @ shares,
            y + (v * np.sin(psi)) @ shares,
        ],
        axis=1,
    )


def test_no_point_of_a_grid_is_better_and_the_best_is_near(
    known: tuple[str, Best],
) -> None:
    """Once the leader's end is given, every follower's part of J is its own.

    49^2 controls of the leader and for each the best of 121^2 of every follower; the
    distance limits do not bind.
    """
    _, found = known
    starts = found.trajectory.states[:, 0].reshape(UAVS, 4)
    ends = terminal_states(starts[LEADER], 49)
    costs = np.zeros(len(ends))
    for i in OTHERS:
        wanted = ends + np.array([0, 0, *SLOTS[i]])
        apart, _ = cKDTree(terminal_states(starts[i], 121)).query(wanted)
        costs += apart**2
    # 2e-3: Runge-Kutta's 1e-5 m, times twice the 60 m that are left in all.
    assert found.best[0] - 2e-3 <= costs.min() <= found.best[0] + 0.1


def test_where_nothing_is_feasible_no_best_is_known() -> None:
    pair = uavs_at([(2, 0, 0, 0), (2, 0, 0, 20)]), slots_at([(0, 0), (0, 20)])
    joint = build(reconfiguration(*pair, "leader_uav=1")).loop
    too_near, fine = [2.0, 0, 0, 0, 2, 0, 0, 1], [2.0, 0, 0, 0, 2, 0, 0, 20]
    found = best_costs(joint, np.transpose([too_near, fine]))
    assert found[0] == np.inf
    assert found[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("flown", "best", "gap"),
    [((5.0, True), 3.0, 2.0), ((3.0, True), 5.0, 0.0), ((3.0, True), np.inf, 0.0),
     ((3.0, False), 5.0, -2.0)],
    ids=["worse", "better: then the best known", "alone", "better by breaking limits"],
)  # fmt: skip
def test_a_gap_counts_from_the_best_that_is_feasible(
    flown: tuple[float, bool],
    best: float,
    gap: float,
    flight: ReconfigurationFlight,
    by_hand: Fly,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cost, feasible = flown
    trajectory = by_hand(
        np.zeros((20, 3)), costs=[cost] * 2, plan=lambda *_: {"feasible": feasible}
    )
    monkeypatch.setattr(reference, "best_costs", lambda *_: np.full(2, best))
    assert gaps(flight.loop, trajectory).tolist() == [gap, gap]
