"""Rates over cells: no point of a cell is faster, and small cells are exact."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes.faces import template_of
from swarmstart.ocp.lower_bound.tubes.motion import Cells, motion_of, rates_over
from swarmstart.ocp.lower_bound.tubes.tube import _directions
from swarmstart.tests.ocp.lower_bound.statements import (
    pushed,
    rates,
    reactor,
    stated,
    unicycle,
    van_der_pol,
)


def wild() -> Statement:
    """Kinks, a cut, time, and controls of which one is not affine."""
    return stated(
        lambda t, x, u: [
            ca.fabs(x[0] - u[0]) * ca.fmin(x[1], ca.sin(3 * t)) + u[1] * x[1],
            ca.sin(0.5 * ca.atan2(x[1], x[0])) + u[1] ** 2,
        ],
        [0.3, -0.2],
        [(-0.5, 1), (-1, 0.5)],
        1.0,
    )


def cells_of(
    statement: Statement, rng: np.random.Generator, count: int, size: float
) -> Cells:
    """Random cells of faces that move, near 0."""
    n = statement.n
    template = template_of(_directions(n, 16), (np.full(n, -9.0), np.full(n, 9.0)))
    face = rng.integers(len(template.directions), size=count)
    start = rng.uniform(-0.5, 0.5, count)
    low = rng.uniform(-0.5, 0.5, (count, n - 1))
    return Cells(
        times=(0.4, 0.4 + size),
        directions=template.directions[face],
        frames=template.frames[face],
        levels=np.array([start, start + size * rng.normal(size=count)]),
        lower=low,
        upper=low + size * rng.random((count, n - 1)),
        misfit=template.misfit,
    )


def speeds(
    statement: Statement, cells: Cells, rng: np.random.Generator, number: int
) -> Array:
    """d'f at random points of each cell, shape (N, number)."""
    f, (low, high) = rates(statement), statement.control_box
    found = []
    for _ in range(number):
        # Corners more often than what is between them.
        part, along, share = (
            np.where(rng.random(shape) < 0.5, np.round(raw), raw)
            for shape, raw in (
                (size, rng.random(size))
                for size in (
                    len(cells.directions),
                    cells.lower.shape,
                    (statement.m, len(cells.directions)),
                )
            )
        )
        z = np.column_stack(
            [
                cells.levels[0] + part * (cells.levels[1] - cells.levels[0]),
                cells.lower + along * (cells.upper - cells.lower),
            ]
        )
        x = np.einsum("kij,kj->ik", cells.frames, z)
        t = cells.times[0] + part * (cells.times[1] - cells.times[0])
        u = low[:, None] + (high - low)[:, None] * share
        speed = np.asarray(f.map(t.size)(t[None, :], x, u))
        found.append((cells.directions.T * speed).sum(axis=0))
    return np.array(found).T


@pytest.mark.parametrize("size", [1e-6, 0.05, 0.4])
@pytest.mark.parametrize("problem", [van_der_pol, reactor, unicycle, pushed, wild])
def test_no_point_of_a_cell_is_faster_than_its_bound(
    problem: Callable[[], Statement], size: float
) -> None:
    statement, rng = problem(), np.random.default_rng(7)
    cells = cells_of(statement, rng, 300, size)
    bounds = rates_over(motion_of(statement), cells)
    found = speeds(statement, cells, rng, 60)
    assert (found <= bounds[:, None] + 1e-12).all()


@pytest.mark.parametrize("problem", [van_der_pol, reactor])
def test_the_excess_falls_with_the_square_of_the_size(
    problem: Callable[[], Statement],
) -> None:
    statement = problem()
    motion, excess = motion_of(statement), []
    for size in (0.04, 0.01):
        rng = np.random.default_rng(8)
        cells = cells_of(statement, rng, 200, size)
        found = speeds(statement, cells, rng, 400).max(axis=1)
        excess.append(np.median(rates_over(motion, cells) - found))
    # Sampling leaves a part that falls with the size itself.
    assert excess[1] < excess[0] / 6


def test_states_that_do_not_matter_in_a_direction_may_be_unbounded() -> None:
    statement = stated(lambda _, x, u: [u[0], 1 / x[1]], [1, 0], [(-1, 1)], 1.0)
    template = template_of(_directions(2, 16), (np.full(2, -9.0), np.full(2, 9.0)))
    cells = Cells(
        times=(0.0, 0.1),
        directions=template.directions[[0, 2]],
        frames=template.frames[[0, 2]],
        levels=np.zeros((2, 2)),
        lower=np.full((2, 1), -1.0),
        upper=np.full((2, 1), 1.0),
        misfit=0.0,
    )
    bounds = rates_over(motion_of(statement), cells)
    assert bounds[0] == pytest.approx(1.0)
    assert bounds[1] == np.inf
