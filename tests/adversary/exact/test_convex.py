import numpy as np
import pytest
from scipy.optimize import lsq_linear

from swarmstart.tests.adversary.exact.convex import (
    Program,
    UnsolvedError,
    solve_convex,
)


def boxed(
    n: int, *, rng: np.random.Generator
) -> tuple[Program, np.ndarray, np.ndarray]:
    """Return a least-squares problem in a box, as a program and as (A, b)."""
    A, b = rng.normal(size=(n + 2, n)), rng.normal(size=n + 2) * 3
    program = Program(
        H=A.T @ A, g=-A.T @ b, constant=float(b @ b) / 2,
        G=np.vstack([np.eye(n), -np.eye(n)]),
        h=np.ones(2 * n), E=np.empty((0, n)), e=np.empty(0),
    )  # fmt: skip
    return program, A, b


@pytest.mark.parametrize("n", [1, 4, 12])
def test_box_agrees_with_bounded_least_squares(n: int) -> None:
    program, A, b = boxed(n, rng=np.random.default_rng(n))
    theirs = lsq_linear(A, b, (-1, 1), "bvls", tol=1e-14)
    ours = solve_convex(program)
    assert ours.cost == pytest.approx(theirs.cost, abs=1e-7)
    assert ours.gap < 1e-6


def test_equality_is_that_of_the_kkt_system() -> None:
    rng = np.random.default_rng(0)
    root, E = rng.normal(size=(5, 5)), rng.normal(size=(2, 5))
    H, g, e = root @ root.T, rng.normal(size=5), rng.normal(size=2)
    program = Program(H=H, g=g, G=np.empty((0, 5)), h=np.empty(0), E=E, e=e)
    kkt = np.block([[H, E.T], [E, np.zeros((2, 2))]])
    exact = np.linalg.solve(kkt, np.concatenate([-g, e]))[:5]
    np.testing.assert_allclose(solve_convex(program).point, exact, atol=1e-7)


def test_linear_program_takes_a_corner() -> None:
    program = Program(
        H=np.zeros((2, 2)), g=np.array([1.0, -2.0]), E=np.empty((0, 2)), e=np.empty(0),
        G=np.vstack([np.eye(2), -np.eye(2)]), h=np.array([1.0, 3.0, 1.0, 3.0]),
    )  # fmt: skip
    optimum = solve_convex(program)
    np.testing.assert_allclose(optimum.point, [-1.0, 3.0])
    assert optimum.cost == pytest.approx(-7.0)
    assert optimum.gap < 1e-9


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_contradiction_is_unsolved(weight: float) -> None:
    program = Program(
        H=weight * np.eye(1), g=np.ones(1), G=np.array([[1.0], [-1.0]]),
        h=np.array([0.0, -1.0]), E=np.empty((0, 1)), e=np.empty(0),
    )  # fmt: skip
    with pytest.raises(UnsolvedError):
        solve_convex(program)
