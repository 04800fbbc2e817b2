"""The shipped problems reach the values that their claims state; short of the page."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq, minimize

from swarmstart.benchmarks.shipped_problems import (
    PROBLEMS,
    Solved,
    gap,
    solved,
    stated,
    table,
)
from swarmstart.cases.format.scenario import shipped

Array = NDArray[np.float64]


FROM_BELOW = {"catalyst_mixing", "race_car", "goddard_rocket", "shuttle_reentry"}
"""Of which a coarser grid has the smaller value."""
CHECKED_ONLY = {"race_car"}
"""Of which a finer grid asks for more, so that its gap need not shrink as fast."""
ON_THEIR_GRID = ("bifunctional_catalyst",)
"""To which their grid belongs."""
SLOW = ("shuttle_reentry", "four_discs")
"""Of which a run takes seconds; the page has more of them."""
ON_THE_PAGE_ONLY = ("supersonic_climb",)
"""Of which a run takes a quarter of a minute."""


@pytest.mark.parametrize("name", [*SLOW, *ON_THEIR_GRID])
def test_a_slow_problem_reaches_its_value(name: str) -> None:
    on, found = stated(name), solved(name, 1)
    assert found.reached == [True]
    assert found.costs == pytest.approx([on.value], rel=1e-6)
    assert (on.free is None) == (name in ON_THEIR_GRID)
    if on.free is not None:
        assert gap(found, on) < on.gap
        assert (found.costs[0] > on.free) == (name not in FROM_BELOW)


@pytest.mark.parametrize(
    "name",
    [
        name
        for name in PROBLEMS
        if name not in {*SLOW, *ON_THEIR_GRID, *ON_THE_PAGE_ONLY}
    ],
)
def test_a_problem_reaches_its_value_and_the_gap_shrinks(name: str) -> None:
    on = stated(name)
    assert on.free is not None
    own, finer = solved(name, 2), solved(name, 1, finer=True)
    assert all(own.reached)
    assert own.costs == pytest.approx([on.value] * 2, rel=1e-4)
    shrinks = 1 if name in CHECKED_ONLY else 3
    assert gap(finer, on) < gap(own, on) / shrinks < on.gap / shrinks
    assert (own.costs[0] > on.free) == (name not in FROM_BELOW)


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_file_is_at_most_forty_lines_long(name: str) -> None:
    assert len(shipped()[name].read_text().splitlines()) <= 40


def test_the_value_of_catalyst_mixing_is_its_closed_form() -> None:
    """The share is 1, then constant on the singular arc, then 0: linear in parts."""

    def rates(share: float) -> Array:
        return np.array([[-share, 10 * share], [share, -9 * share - 1]])

    def waste(switches: Array) -> float:
        first, second, share = switches
        x = expm(rates(1) * first) @ np.array([1.0, 0.0])
        x = expm(rates(share) * (second - first)) @ x
        return float((expm(rates(0) * (1 - second)) @ x).sum())

    best = minimize(
        waste,
        [0.14, 0.72, 0.23],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-15},
    )
    assert stated("catalyst_mixing").free == pytest.approx(1 - best.fun, rel=1e-8)


def test_the_value_of_the_brachistochrone_is_its_closed_form() -> None:
    """A cycloid: x = r (s - sin(s)), y = r (1 - cos(s)), T = s sqrt(r / g)."""
    s = brentq(lambda s: (s - np.sin(s)) - (1 - np.cos(s)), 1, 6, xtol=1e-14)
    r = 2 / (1 - np.cos(s))
    least = stated("brachistochrone").free
    assert least == pytest.approx(s * np.sqrt(r / 9.8), rel=1e-7)


def test_the_value_of_the_hypersensitive_problem_is_its_closed_form() -> None:
    """x'^2 = x^2 + x^6 + c, from 1.5 down to the least x and up to 1, in 10 s."""

    def over_both(least: float, what: str) -> float:
        def along(s: float) -> float:  # x = least cosh(s)
            x, rise = least * np.cosh(s), least * np.sinh(s)
            root = np.sqrt(1 + x**4 + x**2 * least**2 + least**4)
            return float(1 / root if what == "time" else rise**2 * root)

        ends = (np.arccosh(1.5 / least), np.arccosh(1 / least))
        return float(sum(quad(along, 0, end, limit=200)[0] for end in ends))

    least = brentq(lambda x: over_both(x, "time") - 10, 1e-6, 0.5, xtol=1e-14)
    cost = over_both(least, "cost") + 10 * (least**2 + least**6) / 2 + (1 - 1.5**4) / 4
    assert stated("hypersensitive").free == pytest.approx(cost, rel=1e-7)


def test_the_table_counts_seeds_and_tells_the_gaps() -> None:
    own, finer = (
        {name: Solved([(1 + far) * (stated(name).free or 0)] * 2, [True, False])}
        for name, far in (("pendulum", 0.01), ("pendulum", 0.002))
    )
    line = table(own, finer)[2]
    assert "| 1 of 2 |" in line
    assert "| 1.0e-02 |" in line and line.endswith("| 2.0e-03 |")


def test_a_problem_with_a_grid_of_its_own_has_a_row_without_gaps() -> None:
    found = Solved([10.0941644], [True])
    line = table({"bifunctional_catalyst": found}, {})[2]
    assert "| 1 of 1 | - |" in line and line.endswith("| - | - | - |")
    with pytest.raises(ValueError, match="expected a value without a grid"):
        gap(found, stated("bifunctional_catalyst"))
