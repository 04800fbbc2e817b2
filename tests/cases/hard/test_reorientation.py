"""Reorientation: against SciPy's rotations, and invariants of a free rigid body."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarmstart.cases.hard.reorientation import INERTIA
from swarmstart.ocp import PathConstraint
from swarmstart.tests.cases.hard.problems import path_values, rates, shipped_problem

NAMES = ["reorientation_1", "reorientation_2", "reorientation_4"]


def attitudes(count: int) -> tuple[np.ndarray, Rotation]:
    """Return unit quaternions, scalar first, shape (4, count), and as rotations."""
    q = np.random.default_rng(count).normal(size=(4, count))
    q /= np.linalg.norm(q, axis=0)
    return q, Rotation.from_quat(q[[1, 2, 3, 0]].T)


@pytest.mark.parametrize("name", NAMES)
def test_a_cone_limits_the_angle_of_the_turned_first_axis(name: str) -> None:
    posed = shipped_problem(name)
    q, rotations = attitudes(40)
    looks = rotations.apply([1.0, 0.0, 0.0])
    found = path_values(posed, np.vstack([q, np.zeros((3, 40))]))
    # Recover each axis from three looks, then compare all others.
    axes = np.linalg.lstsq(looks, found.T, rcond=None)[0].T
    assert np.allclose(found, axes @ looks.T, atol=1e-12)
    assert np.allclose(np.linalg.norm(axes, axis=1), 1, atol=1e-3)
    start = axes @ [1.0, 0.0, 0.0]
    limits = [
        float(np.ravel(c.upper)[0])
        for c in posed.problem.path_constraints
        if isinstance(c, PathConstraint)
    ]
    assert len(limits) == len(start)
    assert (start < limits).all()


@pytest.mark.parametrize("name", NAMES)
def test_the_end_conditions_hold_at_one_attitude_with_either_sign(name: str) -> None:
    problem = shipped_problem(name).problem
    ends = ca.vertcat(*[c.expression for c in problem.terminal_constraints[:3]])
    missed = ca.Function("missed", [problem.model.states], [ends])
    slopes = np.array([
        np.array(missed(np.r_[unit, 0, 0, 0])).ravel() for unit in np.eye(4)
    ]).T  # fmt: skip
    goal = np.linalg.svd(slopes)[2][-1]  # The quaternion with no vector part left.
    for sign in (1, -1):
        assert np.allclose(np.array(missed(np.r_[sign * goal, 0, 0, 0])), 0, atol=1e-9)
    # The size of what is missed is the sine of half the remaining angle.
    q, rotations = attitudes(20)
    target = Rotation.from_quat(goal[[1, 2, 3, 0]])
    angles = (target.inv() * rotations).magnitude()
    sizes = [np.linalg.norm(np.array(missed(np.r_[one, 0, 0, 0]))) for one in q.T]
    assert np.allclose(sizes, abs(np.sin(angles / 2)), atol=1e-9)


def test_without_torque_norm_energy_and_momentum_stay() -> None:
    posed = shipped_problem("reorientation_1")
    q, rotations = attitudes(30)
    w = np.random.default_rng(1).normal(size=(3, 30))
    found = rates(posed, np.vstack([q, w]), np.zeros((3, 30)))
    J = np.array(INERTIA)[:, None]
    assert np.allclose((q * found[:4]).sum(axis=0), 0, atol=1e-12)
    assert np.allclose((J * w * found[4:]).sum(axis=0), 0, atol=1e-12)
    # Momentum at rest: R J w, whose rate is R (J w' + w x J w).
    turning = J * found[4:] + np.cross(w, J * w, axis=0)
    assert np.allclose(turning, 0, atol=1e-12)
    # The attitude turns by w in the body: R(q + q' h) = R(q) exp(w h).
    h = 1e-6
    moved = Rotation.from_quat((q + h * found[:4])[[1, 2, 3, 0]].T)
    turned = rotations * Rotation.from_rotvec(h * w.T)
    assert ((moved.inv() * turned).magnitude() < 1e-10).all()
