"""The particle swarm."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.heuristics import (
    Box,
    Budget,
    InvalidSettingsError,
    ParticleSwarm,
    Search,
    minimize,
)
from swarmstart.heuristics.searches.pso import ParticleSwarmState
from swarmstart.heuristics.searches.swarm import ring_best

COSTS = np.array([5.0, 1.0, 4.0, 3.0, 2.0])


def told_once(algorithm: ParticleSwarm, violation: float = 0.0) -> Search:
    """Five particles on a line, at rest but for the start, with the costs above."""
    box = Box(lower=np.zeros(1), upper=np.full(1, 10.0))
    initial = np.arange(5.0)[None, :]
    rng = np.random.default_rng(0)
    search = Search(algorithm, box, rng=rng, initial=initial)
    search.ask()
    search.tell(COSTS, np.where(COSTS == 1.0, violation, 0.0))
    return search


@pytest.mark.parametrize(
    ("violation", "expected"), [(0.0, [1, 1, 1, 4, 4]), (1.0, [4, 2, 3, 4, 4])]
)
def test_ring_attracts_to_the_best_of_the_neighbours_by_the_order(
    violation: float, expected: list[int]
) -> None:
    search = told_once(ParticleSwarm(size=5, neighbours=2), violation)
    state = search.state
    assert isinstance(state, ParticleSwarmState)
    found = ring_best(search.order.running(), state, 2)
    np.testing.assert_array_equal(found[0], expected)


def test_particles_fly_to_their_attractors() -> None:
    # Without inertia and memory, x <- x + 2 r (g - x), and nothing meets a bound.
    swarm = ParticleSwarm(size=5, neighbours=2, inertia=0.0, cognitive=0.0, social=0.5)
    moved = told_once(swarm).ask()[0]
    away = np.array([1, 1, 1, 4, 4]) - np.arange(5.0)
    steps = moved - np.arange(5.0)
    assert (np.sign(steps) == np.sign(away)).all()
    assert (np.abs(steps) <= 0.5 * np.abs(away)).all()


def test_a_ring_of_all_others_is_the_whole_swarm() -> None:
    whole = told_once(ParticleSwarm(size=5)).ask()
    ring = told_once(ParticleSwarm(size=5, neighbours=4)).ask()
    np.testing.assert_array_equal(whole, ring)


def test_constriction_solves_its_equation() -> None:
    for phi in (4.1, 4.5, 6.0):
        swarm = ParticleSwarm.constricted(phi)
        chi = swarm.inertia
        # chi bounds the unconstricted system of (v, p - x): spectral radius 1 / chi.
        matrix = np.array([[1.0, phi], [-1.0, 1.0 - phi]])
        radius = np.abs(np.linalg.eigvals(matrix)).max()
        np.testing.assert_allclose(chi * radius, 1.0, rtol=1e-12)
        np.testing.assert_allclose(swarm.cognitive + swarm.social, chi * phi)
    default = ParticleSwarm()
    np.testing.assert_allclose(
        [default.inertia, default.cognitive],
        [ParticleSwarm.constricted().inertia, ParticleSwarm.constricted().social],
        atol=5e-4,
    )


def test_constriction_needs_phi_above_4() -> None:
    with pytest.raises(
        InvalidSettingsError, match="phi must be a finite number above 4"
    ):
        ParticleSwarm.constricted(4.0)


@pytest.mark.parametrize("seed", range(3))
def test_solves_the_sphere(seed: int) -> None:
    def sphere(
        x: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return ((x - 1.0) ** 2).sum(axis=0), np.zeros(x.shape[1])

    result = minimize(
        sphere,
        Box(lower=np.full(10, -5.0), upper=np.full(10, 5.0)),
        algorithm=ParticleSwarm(size=40),
        budget=Budget(evaluations=20_000),
        rng=np.random.default_rng(seed),
    )
    # Peers need 8200 evaluations for 1e-8; here are more than twice that.
    assert result.cost < 1e-10
    np.testing.assert_allclose(result.x, 1.0, atol=1e-5)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 0}, "size must be an integer of at least 1, got 0"),
        ({"inertia": 1.1}, r"inertia must be a number in \[0, 1\], got 1.1"),
        ({"cognitive": np.inf}, "cognitive must be a finite"),
        ({"velocity_max": 0.0}, "velocity_max must be None or a finite number above 0"),
        (
            {"bound_handling": "stick"},
            "bound_handling must be one of clip, .*none, got 'stick'",
        ),
        ({"neighbours": 3}, "neighbours must be None or even"),
        ({"neighbours": 20}, "at least 2 and below size = 20, got 20"),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        ParticleSwarm(**setting)  # type: ignore[arg-type]
