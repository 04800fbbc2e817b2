"""The logistic map (5.17)."""

import math

import numpy as np

from swarmstart.heuristics.searches.chaotic_pso import (
    TRAPS,
    draw_seeds,
    leave_traps,
    logistic,
)


def test_lyapunov_exponent_is_ln_2() -> None:
    # Closed form for mu = 4. The mean of 2e5 values has a standard error of 0.2 %.
    z = draw_seeds((4, 50), rng=np.random.default_rng(1))
    slopes = []
    for _ in range(1000):
        slopes.append(np.log(np.abs(4.0 * (1.0 - 2.0 * z))))
        logistic(z)
    assert math.isclose(float(np.mean(slopes)), math.log(2.0), rel_tol=0.02)


def test_numbers_follow_the_arcsine_law() -> None:
    z = draw_seeds((100, 200), rng=np.random.default_rng(2))
    for _ in range(10):
        logistic(z)
    quantiles = np.quantile(z, [0.1, 0.25, 0.5, 0.75, 0.9])
    arcsine = np.sin(np.pi / 2 * np.array([0.1, 0.25, 0.5, 0.75, 0.9])) ** 2
    np.testing.assert_allclose(quantiles, arcsine, atol=0.02)  # 4 standard errors


def test_trapped_orbits_get_new_seeds_and_the_others_stay() -> None:
    z = np.array([[*TRAPS, 0.3]])
    leave_traps(np.random.default_rng(3), z)
    assert not np.isin(z, TRAPS).any()
    assert z[0, -1] == 0.3


def test_no_random_number_is_spent_while_no_orbit_is_trapped() -> None:
    rng = np.random.default_rng(4)
    before = rng.bit_generator.state
    leave_traps(rng, np.array([[0.1, 0.2]]))
    assert rng.bit_generator.state == before
