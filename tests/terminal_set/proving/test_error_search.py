"""The bounds that the integrator's error is made of: each by itself, by hand."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set import TerminalSet
from swarmstart.terminal_set.interval_arithmetic.taylor import Cells
from swarmstart.terminal_set.proving import flow_error
from swarmstart.terminal_set.proving.flow_error import (
    ErrorSearch,
    Measure,
    Piece,
    _lengths,
    logarithmic_norms,
)
from swarmstart.terminal_set.proving.proof import COVER
from swarmstart.terminal_set.proving.residual import Residual
from swarmstart.tests.terminal_set.proving.held_pendulum import pendulum


def own_law(nx: int) -> TerminalSet:
    return TerminalSet(
        K=np.zeros((1, nx)), P=np.eye(nx), alpha=1.0, x_ref=np.zeros(nx),
        u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip


class Given(ErrorSearch):
    """A search whose bounds on pieces of time are given; its tubes are noted."""

    tubes: tuple[float, ...] = ()

    def __init__(self, *given: object, speed: float, bend: float) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self.speed, self.bend = speed, bend

    def _residuals(self, speeds: object, enough: float, useless: float) -> list[float]:
        return (
            [1.0] * len(self._pieces) if self.bend == 0 else [0.0] * len(self._pieces)
        )

    def _fastest(self, piece: Piece, tube: float) -> float:
        self.tubes = (*self.tubes, tube)
        return self.speed

    def _bend(self, piece: Piece, tube: float, drift: float, error: float) -> float:
        return self.bend


def test_the_error_stays_within_the_tube_whose_slopes_bound_it() -> None:
    """Also where a sample of states shows nothing of how fast errors grow."""
    f, law = pendulum()
    residual = Residual(f, law, dt=0.1, substeps=1)
    search = Given(residual, 4.0, np.inf, speed=60.0, bend=0.0)
    error = search.error(1e-3, np.inf)
    assert np.isfinite(error)
    assert error * 2.0 < search.tubes[-1]
    assert error * 2.0 > search.tubes[0]  # The first one was too thin.


def test_coordinates_that_are_rounded_make_the_error_larger() -> None:
    f, law = pendulum()
    residual = Residual(f, law, dt=0.1, substeps=1)
    search = Given(residual, 4.0, np.inf, speed=0.0, bend=0.0)
    residual.off = 0.0
    exact = search.error(1e-3, np.inf)
    residual.off = 0.01
    assert search.error(1e-3, np.inf) >= exact * (1 + 2 * 0.01)


def test_the_error_of_the_reference_bends_those_of_all_states() -> None:
    """With residuals of 0 and slopes that bend by 3: all of it is 3 d_0 over time."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [x**2 + 1 + 0 * u])
    residual = Residual(f, own_law(1), dt=0.2, substeps=1)
    search = Given(residual, 1e-6, np.inf, speed=0.0, bend=3.0)
    step = float(ca.simpleRK(f, 1, 4)(0, 0, 0.2))
    d_0 = abs(step - np.tan(0.2))
    assert d_0 * 0.2 * 3 <= search.error(1e-3, np.inf) < 20 * d_0 * 0.2 * 3


class Timed:
    """A residual of one state of which only the steps matter."""

    nx, off = 1, 0.0

    def __init__(self, substeps: int, h: float) -> None:
        self.substeps, self.h = substeps, h


def timed(substeps: int = 2, h: float = 0.3, alpha: float = 4.0) -> ErrorSearch:
    return ErrorSearch(Timed(substeps, h), alpha, np.inf)  # type: ignore[arg-type]


def grown(
    search: ErrorSearch, residuals: Array, speeds: Array, sources: Array
) -> tuple[float, Array]:
    """Return the largest error over the pieces, and the part of each piece in it."""
    pieces, steps = search._pieces, []
    length = np.array([piece.length for piece in pieces])
    added = np.array([[late.weight(early) for early in pieces] for late in pieces])
    for last in range(len(pieces)):
        total = 0.0
        for k in range(last + 1):
            moved = added[k] @ residuals + sources[k] * length[k]
            own = np.exp(max(speeds[k], 0.0) * length[k])
            later = np.exp(speeds[k + 1 : last + 1] @ length[k + 1 : last + 1])
            total += moved * own * later
        steps.append(total)
    return max(0.0, *steps), length


@pytest.mark.parametrize("substeps", [1, 2, 3])
def test_error_is_what_all_pieces_add_and_what_becomes_of_it(substeps: int) -> None:
    """A sum over the pieces, each part grown by all later ones; the largest counts."""
    search, rng = timed(substeps), np.random.default_rng(substeps)
    count = len(search._pieces)
    assert count == -(-flow_error.PIECES // substeps) * substeps
    for scale in (1.0, 30.0):
        residuals, sources = rng.random((2, count)) * [[1e3], [1.0]]
        speeds = scale * rng.normal(size=count)
        for extra in (sources, None):
            found = search._grown(
                residuals.tolist(),
                speeds.tolist(),
                None if extra is None else extra.tolist(),
            )
            given = 0 * sources if extra is None else extra
            exact, _ = grown(search, residuals, speeds, given)
            assert found == pytest.approx(exact, rel=1e-12)
    assert np.isnan(search._grown([np.nan] * count, [0.0] * count))


def test_reserve_of_the_error_is_that_for_rounding() -> None:
    """COVER of it, and four times what the coordinates are off."""
    f, law = pendulum()
    residual = Residual(f, law, dt=0.1, substeps=1)
    search = Given(residual, 4.0, np.inf, speed=0.0, bend=0.0)
    count = len(search._pieces)
    exact = search._grown([1.0] * count, [0.0] * count)
    residual.off = 0.0
    reserve = search.error(1e-3, np.inf) / exact - 1
    assert reserve == pytest.approx(COVER, rel=1e-5)
    residual.off = 0.01
    reserve = search.error(1e-3, np.inf) / exact - 1
    assert reserve == pytest.approx(0.04, rel=1e-6)


def test_tube_holds_the_error_and_what_the_reference_drifts() -> None:
    """Of a ball so small that nearly all of it is drift, which grows by e^6."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [x**2 + 1 + 0 * u])
    residual = Residual(f, own_law(1), dt=0.2, substeps=1)
    search = Given(residual, 1e-20, np.inf, speed=30.0, bend=1e-9)
    error = search.error(1e-3, np.inf)
    own = [_lengths(*search._at_reference(piece))[0] for piece in search._pieces]
    drift = search._grown(own, [30.0] * len(own))
    assert error * 1e-10 < 1e-3 * drift
    assert 2 * drift == pytest.approx(search.tubes[-1], rel=1e-2)
    assert search.tubes[0] < drift


def test_thinnest_tube_is_a_part_of_the_radius() -> None:
    """Of a search without anything to bound."""
    search = Given(
        Residual(pendulum()[0], pendulum()[1], dt=0.1, substeps=1), 16.0, np.inf,
        speed=0.0, bend=1.0,
    )  # fmt: skip
    assert search.error(1e-3, np.inf) == 0.0
    assert {*search.tubes} == {2e-9 * search._radius}
    assert search._radius == pytest.approx(4.0, rel=1e-8)


class Asked(ErrorSearch):
    """A search that notes what bounds are asked for, and answers with given ones."""

    def __init__(self, *given: object, answers: list[float]) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self.asked: list[dict[str, Any]] = []
        self.answers = answers

    def relative_residual(self, piece: Piece) -> Measure:
        number = self._pieces.index(piece)

        def measure(cells: Cells) -> tuple[Array, Array, Array]:
            met = number + np.linspace(0, 1, cells.z.shape[1])
            return met + 1e9, met, met

        return measure

    def _largest(
        self, measure: Measure, *, at_least: float, allowed: Callable[[float], float],
        useless: float,
    ) -> float:  # fmt: skip
        self.asked.append({"least": at_least, "allowed": allowed, "useless": useless})
        return self.answers[len(self.asked) - 1]


@pytest.mark.parametrize("enough", [1e-12, 1e3])
def test_each_residual_may_be_loose_by_its_part_of_the_error(enough: float) -> None:
    count, rng = 8, np.random.default_rng(0)
    answers = rng.random(count).tolist()
    search = Asked(Timed(2, 0.3), 4.0, np.inf, answers=answers)
    speeds = rng.normal(size=count).tolist()
    found = search._residuals(speeds, enough, 7.0)
    weights = np.array([
        grown(search, one, np.array(speeds), np.zeros(count))[0]
        for one in np.eye(count)
    ])  # fmt: skip
    order = np.argsort(-weights)
    np.testing.assert_array_equal(np.array(found)[order], answers)
    met = np.arange(count) + 1.0  # The largest that is met.
    share = max(0.05 * float(met @ weights), enough / (2 * count))
    for number, asked in zip(order, search.asked, strict=True):
        assert asked["least"] == met[number]
        small = share / weights[number]
        assert asked["allowed"](0.0) == pytest.approx(small, rel=1e-9)
        assert asked["allowed"](10 * small) == pytest.approx(2 * 10 * small)
        assert asked["useless"] == pytest.approx(7 / weights[number], rel=1e-9)
    search = Asked(Timed(2, 0.3), 4.0, np.inf, answers=[0.5, np.inf])
    found = search._residuals(speeds, enough, 7.0)
    assert len(search.asked) == 2 and sorted(found)[:2] == [0.5, np.inf]


def test_speeds_and_bends_are_asked_for_as_tightly_as_they_matter() -> None:
    search = Asked(Timed(2, 0.3), 4.0, np.inf, answers=[1.0, 2.0])
    piece, hold = search._pieces[0], 0.6
    assert search._fastest(piece, 0.1) == 1.0
    assert search._bend(piece, 0.1, drift=0.0, error=1.0) == 0.0
    assert search._bend(piece, 0.1, drift=0.25, error=2.0) == 2.0
    speed, bend = search.asked
    assert speed["least"] == pytest.approx(-30 / hold)
    assert speed["allowed"](5.0) == pytest.approx(5.0 + 1 / hold)
    assert speed["useless"] == pytest.approx(30 / hold)
    # b times d_0 over the hold is a small part of the error.
    assert bend["allowed"](9.0) * 0.25 * hold == pytest.approx(0.05 * 2.0)
    assert (bend["least"], bend["useless"]) == (0.0, np.inf)


def quantity(cells: Cells) -> tuple[Array, Array, Array]:
    """z_0 + |z|, bounded by the corners of the box around a cell."""
    high = np.maximum(cells.z_middle + cells.z_reach, 0.0)
    above = high[0] + cells.radii[1]
    values = cells.z[0] + np.linalg.norm(cells.z, axis=0)
    spread = np.vstack([cells.half[0], cells.half[1:] * cells.radii[1]])
    return above, values, np.where(cells.radii[0] > 0, spread, np.nan)


@pytest.mark.parametrize("share", [1.01, 1.3])
def test_quantity_is_bounded_over_the_ball_as_tightly_as_allowed(share: float) -> None:
    """z_0 + |z| is at most 2 r, met nowhere inside; one above `useless` is infinite."""
    f, law = pendulum()
    search = ErrorSearch(Residual(f, law, dt=0.1, substeps=1), 4.0, np.inf)
    assert search.boxes == 0
    tight = search._largest(
        quantity, at_least=0.0, allowed=lambda most: share * most, useless=10.0
    )
    assert 4.0 <= tight <= share * 4.0 * (1 + 1e-8)
    assert tight < 4.5 and search.boxes > 4
    for useless, is_found in ((4.0 * share - 0.05, False), (4.0 * share + 0.05, True)):
        bound = search._largest(
            quantity, at_least=4.0, allowed=lambda most: share * most, useless=useless
        )
        assert np.isfinite(bound) == is_found
    late = ErrorSearch(Residual(f, law, dt=0.1, substeps=1), 4.0, 0.0)
    bound = late._largest(
        quantity, at_least=0.0, allowed=lambda most: share * most, useless=10.0
    )
    assert bound == np.inf


def test_lengths_and_logarithmic_norms_have_room_for_rounding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Lengths by fractions; of matrices made visible, a quarter of their sizes."""
    rng = np.random.default_rng(7)
    columns = rng.normal(size=(3, 200)) * 10.0 ** rng.uniform(-8, 8, (3, 200))
    for column, found in zip(columns.T, _lengths(columns, 0 * columns), strict=True):
        exact = sum(Fraction(float(x)) ** 2 for x in column)
        assert exact <= Fraction(float(found)) ** 2 <= exact * Fraction(1 + 1e-11)
    radius = np.array([[0.0], [3.0], [4.0]])
    assert _lengths(np.ones((3, 1)), radius)[0] == pytest.approx(3**0.5 + 5)
    monkeypatch.setattr(flow_error, "PADDING", 0.25)
    middle = np.array([[[1.0, -2.0], [4.0, 3.0]]])
    radius = np.array([[[0.5, 1.0], [0.0, 0.25]]])
    largest = np.linalg.eigvalsh([[1.0, 1.0], [1.0, 3.0]])[-1]
    beside = np.sqrt(0.75**2 + 1.5**2 + 1.0**2 + 1.0**2)
    found = logarithmic_norms(middle, radius)[0]
    assert found == pytest.approx(largest + beside, rel=1e-12)
