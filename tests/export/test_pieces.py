"""Polynomials are as near to a path as they say, smooth, and their peaks are found."""

import numpy as np
import pytest

from swarmstart.export.paths import ExportError, VehiclePath
from swarmstart.export.pieces import fitted
from swarmstart.tests.export.flights import loop, loop_at


@pytest.mark.parametrize(("degree", "error"), [(7, 5e-3), (7, 1e-5), (3, 1e-3)])
def test_the_error_is_kept_between_samples_too(degree: int, error: float) -> None:
    found = fitted(loop(), degree, error, 4096)
    times = np.linspace(0.0, 20.0, 7777)
    off = np.linalg.norm(found.at(times) - loop_at(times), axis=1).max()
    assert found.error <= error
    assert off <= 1.5 * found.error + 1e-6


def test_a_polynomial_is_found_again() -> None:
    times = np.linspace(0.0, 2.0, 50)
    path = VehiclePath("cube", times, np.stack([times**3, 1 - times, 0 * times], 1))
    found = fitted(path, 7, 1e-6, 31)
    assert len(found.coefficients) == 1 and found.knots.tolist() == [0.0, 2.0]
    expected = np.zeros((8, 3))
    expected[3, 0], expected[:2, 1] = 1.0, (1.0, -1.0)
    np.testing.assert_allclose(found.coefficients[0], expected, atol=1e-5)


def test_pieces_meet_with_their_derivatives() -> None:
    found = fitted(loop(), 7, 1e-5, 31)
    ends = found.knots[1:-1]
    for derivative in range(4):
        before = found.at(ends - 1e-9, derivative)
        after = found.at(ends + 1e-9, derivative)
        np.testing.assert_allclose(before, after, atol=1e-4)


def test_windows_are_short_where_the_path_turns() -> None:
    times = np.linspace(0.0, 40.0, 1601)
    turn = 12 * np.tanh(times / 3)  # It rests from 15 s on.
    places = np.stack([np.sin(turn), np.cos(turn), 0 * times], axis=1)
    found = fitted(VehiclePath("turn", times, places), 7, 0.02, 31)
    assert found.lengths.min() < 0.3 * found.lengths.max()
    assert (found.knots < 10.0).sum() > len(found.coefficients) / 2


def test_the_ends_are_those_of_the_path() -> None:
    path = loop()
    found = fitted(path, 7, 5e-3, 31)
    ends = found.at(np.array([0.0, path.duration]))
    np.testing.assert_allclose(ends, path.positions[[0, -1]], atol=1e-6)


@pytest.mark.parametrize("derivative", [1, 2])
def test_the_largest_speed_and_acceleration_are_found(derivative: int) -> None:
    found = fitted(loop(), 7, 1e-5, 31)
    size, time = found.largest(derivative)
    times = np.linspace(0.0, 20.0, 100_001)
    sizes = np.linalg.norm(found.at(times, derivative), axis=1)
    assert sizes.max() <= size * (1 + 1e-9)
    assert size == pytest.approx(sizes.max(), rel=1e-5)
    there = np.linalg.norm(found.at(np.array([time]), derivative))
    assert there == pytest.approx(size, rel=1e-9)


def test_a_path_that_needs_more_pieces_is_refused_with_what_it_would_be() -> None:
    with pytest.raises(
        ExportError, match=r"vehicle loop: expected an error of at most 1e-06"
    ):
        fitted(loop(seconds=200.0, samples=4001), 7, 1e-6, 31)
