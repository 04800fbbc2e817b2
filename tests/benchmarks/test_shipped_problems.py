"""The shipped problems reach the values that their claims state; short of the page."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, least_squares, minimize, root

from swarmstart.arrays import Array
from swarmstart.benchmarks.kept_values import PROBLEMS, Kept, read
from swarmstart.benchmarks.shipped_problems import (
    WHOLE,
    Solved,
    far,
    gap,
    scenario_of,
    solved,
    stated,
    table,
    two_values,
    whole_bars,
)
from swarmstart.cases.campaign.studies.library import run
from swarmstart.cases.format.scenario import shipped

FROM_BELOW = {
    "catalyst_mixing",
    "goddard_rocket",
    "shuttle_reentry",
    "two_stage_launch",
}
"""Of which a coarser grid has the smaller value."""
ON_THEIR_GRID = ("bifunctional_catalyst", "batch_reactor", "lynx_and_hares")
"""To which their grid belongs."""
SLOW = ("shuttle_reentry", "four_discs")
"""Of which a run takes seconds; the page has more of them."""
ON_THE_PAGE_ONLY = ("supersonic_climb",)
"""Of which a run takes a quarter of a minute."""


@pytest.mark.parametrize("name", [*SLOW, *ON_THEIR_GRID])
def test_a_slow_problem_reaches_its_value(name: str) -> None:
    on, found = stated(name), solved(name, 1)
    assert found.reached == [True]
    is_repaired = read()[name].broken > 1e-4
    assert found.costs == pytest.approx([on.value], rel=1e-4 if is_repaired else 1e-6)
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
    assert gap(finer, on) < gap(own, on) / 3 < on.gap / 3
    assert (own.costs[0] > on.free) == (name not in FROM_BELOW)


@pytest.mark.parametrize("name", [*PROBLEMS, WHOLE])
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


def test_the_value_of_the_launch_is_that_of_a_tangent_linear_in_time() -> None:
    """tan(pitch) = a - b t through both stages (Lawden); b, a and T by the end."""

    def burnt(x: Array, stage: tuple[float, float, float, float], law: Array) -> Array:
        begin, length, thrust, flow = stage

        def rates(t: float, x: Array) -> Array:
            steep = law[0] - law[1] * t
            push = thrust / x[3] / np.hypot(1, steep)
            return np.array([x[1], push * steep - 9.81e-3, push, -flow])

        how = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10}
        return np.asarray(solve_ivp(rates, (begin, begin + length), x, **how).y[:, -1])

    def flown(law: Array) -> Array:
        x = burnt(np.array([0, 0, 0, 300.0]), (0, 150, 4.5, 1.53), law)
        return burnt(x - [0, 0, 0, 20], (150, law[2], 0.6, 0.136), law)

    found = root(lambda law: flown(law)[:3] - [200, 0, 7.8], [1, 0.002, 240], tol=1e-11)
    assert stated("two_stage_launch").free == pytest.approx(flown(found.x)[3], rel=1e-8)


def test_the_estimate_of_lynx_and_hares_is_that_of_least_squares() -> None:
    """SciPy's, with exact integration of the logarithms."""
    scenario = scenario_of("lynx_and_hares")
    hares, lynxes = (
        np.log(scenario.signals[name].values)  # type: ignore[union-attr]
        for name in ("hares_seen", "lynxes_seen")
    )

    def residuals(z: Array) -> Array:
        (alpha, beta, gamma, delta), x, weather = z[:4], np.log(z[4:6]), z[6:]
        path = [x]
        for w in weather:

            def rates(t: float, x: Array, w: float = w) -> list[float]:
                return [alpha + w - beta * np.exp(x[1]), delta * np.exp(x[0]) - gamma]

            x = solve_ivp(rates, (0, 1), x, "DOP853", rtol=1e-9, atol=1e-9).y[:, -1]
            path.append(x)
        seen = (np.array(path) - np.stack([hares, lynxes], 1)).ravel() / 0.25
        known = [*(path[0] - np.log(10)), (alpha - 1) / 0.5, (gamma - 1) / 0.5]
        rare = [(beta - 0.05) / 0.05, (delta - 0.05) / 0.05]
        return np.concatenate([seen, weather / 0.1, known, rare])

    first = np.array([0.5, 0.03, 0.8, 0.02, 30, 5, *np.zeros(20)])
    sizes = [*first[:6], *np.full(20, 0.1)]
    exact = least_squares(residuals, first, x_scale=sizes)
    one = run("lynx_and_hares", seed=0)
    claim = next(c for c in scenario.claims if c.id == "2")
    assert claim.bound == pytest.approx(exact.cost, rel=1e-8)
    assert one.measures["cost"] == pytest.approx(exact.cost, rel=2e-5)
    assert one.measures["verified_cost"] == pytest.approx(exact.cost, rel=1e-7)
    for name, value in zip(("alpha", "beta", "gamma", "delta"), exact.x, strict=False):
        assert one.measures[f"decided_{name}"] == pytest.approx(value, rel=1e-4)


def test_fishing_with_the_whole_fleet_keeps_its_bar() -> None:
    assert not any(bar.is_missed for bar in whole_bars(solved(WHOLE, 1)))
    one = run(WHOLE, seed=0)
    assert set(np.unique(one.trajectory.controls)) <= {0.0, 1.0}
    assert all(claim["holds"] for claim in one.claims)


def test_the_race_car_has_a_value_at_the_checks_and_one_along_the_path() -> None:
    value = read()["race_car"]
    assert value.broken > 1e-4
    for repair, wanted in ((False, value.at_checks), (True, value.along_path)):
        found = solved("race_car", 1, repair=repair)
        assert far(found, wanted)[0] < 1e-4
    assert value.along_path > value.at_checks * (1 + 5e-5)


def test_values_of_all_are_written() -> None:
    kept = read()
    assert set(kept) == set(PROBLEMS)
    for name, value in kept.items():
        if name != "supersonic_climb":
            assert value.along_path == pytest.approx(stated(name).value, rel=1e-4)


def test_the_table_of_both_values_counts_each_by_its_own() -> None:
    value = Kept(1.0, 1e-3, 2.0, 2.0, 16)
    own, unrepaired = Solved([2.0001, 2.001], []), Solved([1.0, 1.0], [])
    line = two_values({"x": value}, {"x": own}, {"x": unrepaired})[2]
    assert "| 0.0e+00 | 2 of 2 | 1.0e-03 |" in line
    assert line.endswith("| 5.0e-04 | 1 of 2 |")


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
