from __future__ import annotations

import pickle
import subprocess
import sys

import numpy as np
import pytest

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set import (
    AsymmetricMatrixError,
    IndefiniteMatrixError,
    InvalidShapeError,
    NotFiniteError,
    NotPositiveError,
    NotStabilisableError,
    SaturatedReferenceError,
    UnreliableSolutionError,
)
from swarmstart.terminal_set.linear.arrays import (
    bound_array,
    finite_array,
    positive_definite,
    positive_semidefinite,
)


def test_an_array_is_copied_and_locked() -> None:
    mine = np.ones(3)
    theirs = finite_array("a", mine, (3,))
    mine[0] = 7.0
    assert theirs[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        theirs[0] = 2.0


@pytest.mark.parametrize("value", [[np.nan], [np.inf], ["1"], [1j], [[1], [1, 2]]])
def test_what_holds_no_finite_numbers_is_refused(value: list[float]) -> None:
    with pytest.raises(NotFiniteError, match="u_ref must hold finite real numbers"):
        finite_array("u_ref", value, (None,))


def test_a_bound_may_be_infinite_but_not_nan() -> None:
    assert bound_array("upper", [np.inf], (1,))[0] == np.inf
    with pytest.raises(NotFiniteError, match="upper"):
        bound_array("upper", [np.nan], (1,))


def test_a_wrong_shape_is_told_with_both_shapes() -> None:
    message = r"K must have shape \(2, any\), got \(2,\)"
    with pytest.raises(InvalidShapeError, match=message) as caught:
        finite_array("K", [1.0, 2.0], (2, None))
    assert caught.value.shape == (2,)
    with pytest.raises(InvalidShapeError, match=r"must have shape \(any,\)"):
        finite_array("K", [], (None,))


def test_an_asymmetric_matrix_is_told_by_how_much() -> None:
    with pytest.raises(AsymmetricMatrixError, match=r"Q must be symmetric.*0\.816"):
        positive_semidefinite("Q", [[1.0, 1.0], [0.0, 1.0]])


def test_definite_and_semidefinite_differ_by_a_zero_eigenvalue() -> None:
    singular = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])  # one eigenvalue not zero
    np.testing.assert_array_equal(positive_semidefinite("Q", singular), singular)
    with pytest.raises(IndefiniteMatrixError, match="R must be positive definite"):
        positive_definite("R", singular)
    message = r"Q must be positive semidefinite.*eigenvalue is -2"
    with pytest.raises(IndefiniteMatrixError, match=message):
        positive_semidefinite("Q", np.diag([1.0, -2.0]))


@pytest.mark.parametrize(
    "error",
    [
        NotPositiveError("dt", -1.0),
        InvalidShapeError("K", (2,), (2, None)),
        SaturatedReferenceError("u_ref", 1, 2.0, -1.0, 1.0),
        UnreliableSolutionError("sampled Riccati", "the condition of P", 1e12, 1e10),
        NotStabilisableError(np.zeros(1, complex), np.eye(1, dtype=complex)),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_comes_back_whole_from_a_worker(error: SwarmstartError) -> None:
    returned = pickle.loads(pickle.dumps(error))
    assert type(returned) is type(error)
    assert str(returned) == str(error)


def test_the_package_is_imported_without_python_control() -> None:
    # Its import takes a second, which only a design should cost.
    program = "import sys, swarmstart.terminal_set; sys.exit('control' in sys.modules)"
    environment = {"PYTHONPATH": ":".join(path for path in sys.path if path)}
    completed = subprocess.run(
        [sys.executable, "-c", program], env=environment, check=False
    )
    assert completed.returncode == 0
