"""Flight and memory of the swarms, against a transcription of (2.11) in NumPy."""

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import Box, ChaoticPSO, ParticleSwarm, Search
from swarmstart.heuristics.searches.chaotic_pso import ChaoticPSOState
from swarmstart.heuristics.searches.pso import ParticleSwarmState

DIM, SIZE = 3, 7


def cost_of(points: Array) -> Array:
    total: Array = ((points - 0.3) ** 2).sum(axis=0)
    return total


def flown(search: Search, inertia: float, velocity_max: float) -> tuple[Array, Array]:
    """Return positions and velocities after (2.11), before bounds are applied."""
    state = search.state
    assert isinstance(state, ChaoticPSOState | ParticleSwarmState)
    rng = np.random.default_rng()
    rng.bit_generator.state = search.rng.bit_generator.state
    r1, r2 = rng.random((SIZE, DIM, 2)).T
    x, g = state.position, state.best[:, None]
    c1, c2 = 0.5, 1.5
    v = inertia * state.velocity + c1 * r1 * (state.personal - x) + c2 * r2 * (g - x)
    v = np.clip(v, -velocity_max, velocity_max)
    return x + v, v


def advance(search: Search, generations: int) -> None:
    for _ in range(generations):
        search.tell(cost_of(search.ask()), np.zeros(SIZE))


def test_chaotic_swarm_flies_by_2_11_with_the_inertia_of_5_19() -> None:
    box = Box(lower=np.full(DIM, -2.0), upper=np.full(DIM, 2.0))
    algorithm = ChaoticPSO(
        size=SIZE,
        cognitive=0.5,
        social=1.5,
        velocity_max=0.8,
        reseed="none",
        bound_handling="clip",
    )
    search = Search(algorithm, box, rng=np.random.default_rng(5))
    advance(search, 3)
    position, velocity = flown(search, 1.2 - 0.3 * (1.2 - 0.1), velocity_max=0.8)
    asked = search.ask(progress=0.3)
    np.testing.assert_array_equal(asked, np.clip(position, -2.0, 2.0))
    state = search.state
    assert isinstance(state, ChaoticPSOState)
    np.testing.assert_array_equal(state.velocity, velocity)  # kept at the bounds
    assert (position != asked).any()  # the bounds were met


@pytest.mark.parametrize("rule", ["absorb", "clip"])
def test_swarm_stops_at_the_bounds(rule: str) -> None:
    box = Box(lower=np.full(DIM, -0.75), upper=np.full(DIM, 0.25))  # optimum outside
    algorithm = ParticleSwarm(
        size=SIZE,
        cognitive=0.5,
        social=1.5,
        velocity_max=0.25,
        bound_handling="absorb" if rule == "absorb" else "clip",
    )
    search = Search(algorithm, box, rng=np.random.default_rng(6))
    advance(search, 2)
    position, velocity = flown(search, 0.7298, velocity_max=0.25)
    asked = search.ask()
    outside = np.abs(position + 0.25) > 0.5
    assert outside.any()
    np.testing.assert_array_equal(asked, np.clip(position, -0.75, 0.25))
    state = search.state
    assert isinstance(state, ParticleSwarmState)
    kept = velocity if rule == "clip" else np.where(outside, 0.0, velocity)
    np.testing.assert_array_equal(state.velocity, kept)


def test_swarm_is_reflected_at_the_bounds_by_default() -> None:
    box = Box(lower=np.full(DIM, -0.75), upper=np.full(DIM, 0.25))  # optimum outside
    algorithms: tuple[ParticleSwarm | ChaoticPSO, ...] = (
        ParticleSwarm(size=SIZE, cognitive=0.5, social=1.5, velocity_max=3.0),
        ChaoticPSO(
            size=SIZE, cognitive=0.5, social=1.5, velocity_max=3.0, reseed="none"
        ),
    )
    furthest = 0.0
    for algorithm, inertia in zip(algorithms, (0.7298, 1.2), strict=True):
        assert algorithm.bound_handling == "reflect"
        search = Search(algorithm, box, rng=np.random.default_rng(6))
        advance(search, 2)
        position, velocity = flown(search, inertia, velocity_max=3.0)
        asked = search.ask()
        # Reflected as if the box were repeated, every second time mirrored.
        cell = np.floor(position + 0.75)
        mirrored = cell % 2 == 1
        inside = position - cell
        inside = np.where(mirrored, -0.5 - inside, inside)
        assert mirrored.any()
        furthest = max(furthest, float(np.abs(cell).max()))
        np.testing.assert_allclose(asked, inside, rtol=0.0, atol=1e-14)
        state = search.state
        assert isinstance(state, ChaoticPSOState | ParticleSwarmState)
        kept = np.where(mirrored, -velocity, velocity)
        np.testing.assert_array_equal(state.velocity, kept)
    assert furthest > 1  # Some were reflected more than once.


def test_particles_remember_their_best_points() -> None:
    box = Box(lower=np.full(DIM, -2.0), upper=np.full(DIM, 2.0))
    search = Search(ParticleSwarm(size=SIZE), box, rng=np.random.default_rng(7))
    points, costs = [], []
    for _ in range(10):
        points.append(search.ask())
        costs.append(cost_of(points[-1]))
        search.tell(costs[-1], np.zeros(SIZE))
    first = np.argmin(costs, axis=0)
    state = search.state
    assert isinstance(state, ParticleSwarmState)
    np.testing.assert_array_equal(state.personal_cost, np.min(costs, axis=0))
    for i in range(SIZE):
        np.testing.assert_array_equal(state.personal[:, i], points[first[i]][:, i])
    assert search.best.cost == np.min(costs)
