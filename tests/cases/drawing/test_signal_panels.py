"""Signals are drawn as plans take them, and as they are in the simulated system."""

from __future__ import annotations

from inspect import unwrap

import casadi as ca
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.drawing.slack import moving_bounds_of
from swarmstart.cases.kinds.problem.figures import draw
from swarmstart.ocp import (
    Bounds,
    Free,
    HeldSignals,
    Known,
    Model,
    OptimalControlProblem,
    Solution,
    solve,
)
from swarmstart.tests.cases.kinds.problem.conftest import stated

LOW = np.array([0.0, 0.0, 1.0, 0.5, 0.5])
"""Least speed at the nodes of four intervals."""


def answer(*, held: bool, horizon: float | Free = 4.0, above: float = 0.0) -> Solution:
    """Return the cheapest way along a least speed that changes over time."""
    v, u, low = (ca.SX.sym(name) for name in ("v", "u", "low"))
    problem = OptimalControlProblem(
        Model(states=v, controls=u, ode=u), horizon=horizon, intervals=4, checks=1,
        stage_cost=u**2 + (v - above) ** 2,
        bounds=Bounds(states=(low, above + 3.0), controls=(-2, 2)),
        signals=low, features=[HeldSignals(["low"])] if held else [],
    )  # fmt: skip
    known = Known(signals=above + LOW[None])
    return solve(problem, [above], known=known, search=None, lanes=0, seed=0)


def lines(figure: Figure, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return times and values of the lines in the panel of a name."""
    (axes,) = [a for a in figure.axes if a.get_ylabel() == name]
    return [
        (np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
        for line in axes.lines
    ]


def test_a_linear_signal_and_the_bound_that_it_sets_are_lines() -> None:
    found = answer(held=False)
    ((_, row, bound),) = moving_bounds_of(found)
    assert row == 0 and not bound.is_upper
    low = np.interp(found.path.times, found.times, LOW)
    np.testing.assert_allclose(bound.values, low, atol=1e-12)
    figure = found.plot()
    ((times, values),) = lines(figure, "low")
    np.testing.assert_array_equal(times, np.arange(5.0))
    np.testing.assert_array_equal(values, LOW)
    drawn = [values for _, values in lines(figure, "v")]
    assert any(one.size == low.size and np.allclose(one, low) for one in drawn)


def test_a_held_signal_is_drawn_in_steps_as_is_its_bound() -> None:
    found = answer(held=True)
    ((_, _, bound),) = moving_bounds_of(found)
    inner = found.path.times[:-1]
    held = LOW[(inner + 1e-9).astype(int)]
    np.testing.assert_allclose(bound.values[:-1], held, atol=1e-12)
    (axes,) = [a for a in found.plot().axes if a.get_ylabel() == "low"]
    (steps,) = [one for one in axes.patches if isinstance(one, StepPatch)]
    values, edges, _ = steps.get_data()
    np.testing.assert_array_equal(values, LOW[:-1])
    np.testing.assert_array_equal(edges, np.arange(5.0))


def test_a_moving_bound_follows_a_free_end_time() -> None:
    """The signal stretches with the horizon."""
    found = answer(held=False, horizon=Free(2.0, 2.5))
    ((_, _, bound),) = moving_bounds_of(found)
    low = np.interp(found.path.times, found.times, LOW)
    np.testing.assert_allclose(bound.values, low, atol=1e-12)


def test_a_moving_bound_far_from_zero_keeps_its_digits() -> None:
    """States far from zero are counted from their start in the core."""
    found = answer(held=False, above=1e9)
    ((_, _, bound),) = moving_bounds_of(found)
    low = 1e9 + np.interp(found.path.times, found.times, LOW)
    np.testing.assert_allclose(bound.values, low, rtol=0, atol=1e-6)


JUMPING = """\
kind: problem
signals:
  low: {times: [0, 2], values: [2, 0], between: hold}
  slope: {times: [0, 4], values: [0, 4]}
states: {x: {start: 2, rate: u, bounds: [low, null]}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: (1 + u)**2 + x + 0*slope
prediction: {horizon_s: 4, intervals: 4}
search: {name: none}
"""


@pytest.mark.parametrize("at", ["2", "1.95"])
def test_a_run_shows_signals_as_they_are_simulated(at: str) -> None:
    """On the grid of plans or off it: the true value, without a ramp at a step."""
    made = run(stated(JUMPING.replace("[0, 2]", f"[0, {at}]", 1)), seed=0)
    scenario = made.resolved.scenario
    figures = dict(unwrap(draw)(scenario, made.flight, made.trajectory))
    figure = figures["i_signals"]
    ((times, values),) = lines(figure, "low")
    before, after = times < float(at) - 0.1, times > float(at) + 0.1
    assert set(values[before]) == {2.0} and set(values[after]) == {0.0}
    if at == "2":
        assert sorted(values[times == 2.0]) == [0.0, 2.0]
    ((times, values),) = lines(figure, "slope")
    np.testing.assert_allclose(values, times)
