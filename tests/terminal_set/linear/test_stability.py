from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.terminal_set import (
    NotStabilisableError,
    UnstableLoopError,
    UnweightedModeError,
)
from swarmstart.terminal_set.linear.stability import (
    CONTINUOUS,
    SAMPLED,
    TimeDomain,
    growth,
    require_stabilisable,
    require_stable,
    require_weighted,
)

Matrices = tuple[NDArray[np.float64], NDArray[np.float64]]


def test_growth_is_the_spectral_abscissa_or_the_spectral_radius() -> None:
    F = np.array([[0.3, 0.4], [-0.4, 0.3]])  # eigenvalues 0.3 +- 0.4j
    assert growth(F, CONTINUOUS) == pytest.approx(0.3)
    assert growth(F, SAMPLED) == pytest.approx(0.5)


def test_a_mode_that_decays_by_itself_needs_no_input() -> None:
    require_stabilisable(np.diag([-1.0, 2.0]), np.array([[0.0], [1.0]]), CONTINUOUS)
    require_stabilisable(np.diag([0.5, 2.0]), np.array([[0.0], [1.0]]), SAMPLED)


def test_an_oscillation_no_input_reaches_is_named_with_both_its_modes() -> None:
    A = np.zeros((3, 3))
    A[0, 1], A[1, 0] = 2.0, -2.0
    with pytest.raises(NotStabilisableError, match=r"0\+2j along .*; 0-2j along") as e:
        require_stabilisable(A, np.array([[0.0], [0.0], [1.0]]), CONTINUOUS)
    np.testing.assert_allclose(sorted(e.value.modes.imag), [-2, 2], atol=1e-12)
    assert e.value.directions.shape == (3, 2)


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_a_mode_is_named_with_its_direction_of_length_one(rate: float) -> None:
    """e' = rate e along (3, 4) / 5, which only the decay across is reached beside."""
    along, across = np.array([0.6, 0.8]), np.array([0.8, -0.6])
    A = rate * np.outer(along, along) - np.outer(across, across)
    with pytest.raises(NotStabilisableError, match=r"along \(0\.6, 0\.8\)"):
        require_stabilisable(A, across[:, None], CONTINUOUS)
    with pytest.raises(NotStabilisableError, match=r"along \(0\.6, 0\.8\)"):
        require_stabilisable(A.T, -across[:, None], CONTINUOUS)


def test_the_unit_of_an_input_does_not_matter(matrices: Matrices) -> None:
    A, B = matrices
    require_stabilisable(A, B * [1e-12, 1e12], CONTINUOUS)


@pytest.mark.parametrize(
    ("domain", "limit", "boundary"),
    [(CONTINUOUS, -1e-9, 0.0), (SAMPLED, 1 - 1e-6, 1.0)],
)
def test_loop_is_stable_below_its_limit_only(
    domain: TimeDomain, limit: float, boundary: float
) -> None:
    room = boundary - limit
    require_stable(np.array([[limit - 0.1 * room]]), domain)
    for growth_ in (limit + 0.1 * room, boundary, boundary + 1):
        with pytest.raises(UnstableLoopError):
            require_stable(np.array([[growth_]]), domain)
    require_stable(np.array([[-0.5]]), domain)


@pytest.mark.parametrize(
    ("domain", "limit", "boundary"),
    [(CONTINUOUS, -1e-9, 0.0), (SAMPLED, 1 - 1e-6, 1.0)],
)
def test_only_modes_about_the_boundary_must_be_weighted(
    domain: TimeDomain, limit: float, boundary: float
) -> None:
    """The band above it is as wide as that below; others decay or must be moved."""
    room, nothing = boundary - limit, np.zeros((1, 1))
    for off, seen in ((-1.1, True), (-0.9, False), (0.9, False), (1.1, True)):
        A = np.array([[boundary + off * room]])
        if seen:
            require_weighted(A, nothing, domain)
        else:
            with pytest.raises(UnweightedModeError):
                require_weighted(A, nothing, domain)
        require_weighted(A, np.eye(1), domain)


@pytest.mark.parametrize(("weak", "reached"), [(0.9e-8, False), (1.1e-8, True)])
def test_mode_is_reached_if_the_pencil_keeps_its_rank(
    weak: float, reached: bool
) -> None:
    """A column of length one that reaches a mode 0 by next to nothing.

    Brought to the size 3 of A, the singular values are sqrt(18) and 3 b_2 / sqrt(2).
    """
    A, B = np.diag([3.0, 0.0]), np.array([[1.0], [2 * weak]])
    if reached:
        require_stabilisable(A, B, CONTINUOUS)
    else:
        with pytest.raises(NotStabilisableError):
            require_stabilisable(A, B, CONTINUOUS)
