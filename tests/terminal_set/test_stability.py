from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.terminal_set import NotStabilisableError
from swarmstart.terminal_set.stability import (
    CONTINUOUS,
    SAMPLED,
    growth,
    require_stabilisable,
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


def test_the_unit_of_an_input_does_not_matter(matrices: Matrices) -> None:
    A, B = matrices
    require_stabilisable(A, B * [1e-12, 1e12], CONTINUOUS)
