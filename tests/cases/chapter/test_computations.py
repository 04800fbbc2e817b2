"""The printed linear law against closed forms, and the trap of the DE chain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from swarmstart.cases.chapter.computations import (
    continuous_law,
    de_absorption,
    input_levels,
)

NOWHERE = Path()
# As 5.2.4 prints P, and the gain of the continuous Riccati equation for Q = R = I at
# 15 m/s: two double integrators, of x by u and of y / 15 by omega.
P = np.array([[0.0596, -0.0063], [-0.0063, 0.0129]])
SPEED, TURN_MOST = 15.0, np.pi / 18


def test_the_level_as_printed_exceeds_the_bounds_and_with_the_inverse_it_does_not() -> (
    None
):
    """Of (psi, y): K = (k1, 1), k1^2 = 1 + 2 * 15, and u_max of the turn rate alone.

    Printed, alpha = min u^2 / K P K'; the largest K e over e'Pe <= alpha is
    sqrt(alpha K P^-1 K').
    """
    turn = np.array([np.sqrt(1 + 2 * SPEED), 1.0])
    alpha = TURN_MOST**2 / (turn @ P @ turn)
    largest = np.sqrt(alpha * turn @ np.linalg.inv(P) @ turn)
    found = input_levels({}, NOWHERE)["measures"]
    assert found["input_excess_as_printed"] == pytest.approx(largest / TURN_MOST)
    assert found["input_excess_with_inverse"] == pytest.approx(1.0, rel=1e-12)


def test_moved_continuously_the_printed_law_converges_and_leaves_its_set() -> None:
    """Leaving is a property of the linear loop: the ends of the set are small.

    e(t) = exp((A - B K) t) e(0) of other states of the edge, to t = 4 s.
    """
    A, B, K = np.zeros((4, 4)), np.eye(4)[:, :2], np.zeros((2, 4))
    A[2, 0], A[3, 1] = 1.0, SPEED
    K[0, [0, 2]] = np.sqrt(3), 1.0
    K[1, [1, 3]] = np.sqrt(1 + 2 * SPEED), 1.0
    whole = np.kron(P, np.eye(2))
    directions = np.random.default_rng(7).normal(size=(4, 500))
    edge = np.linalg.solve(np.linalg.cholesky(whole).T, directions)
    edge /= np.sqrt(np.einsum("ik,ik->k", edge, whole @ edge))
    after = [expm((A - B @ K) * t) @ edge for t in np.arange(0.01, 4.0, 0.01)]
    highest = np.max([np.einsum("ik,ik->k", e, whole @ e) for e in after], axis=0)
    found = continuous_law({}, NOWHERE)["measures"]
    assert found["share_leaving"] == pytest.approx(np.mean(highest > 1), abs=0.07)
    assert found["share_converging"] == 1.0


def test_de_may_miss_the_optimum_of_the_trap_and_with_immigrants_never() -> None:
    found = de_absorption({}, NOWHERE)["measures"]
    assert found["absorption_probability"] == pytest.approx(0.6819, abs=5e-5)
    assert found["absorption_probability_with_immigrants"] == pytest.approx(1.0)
