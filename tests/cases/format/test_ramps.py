"""Signals that jump between two checks are named, with the time of the ramp."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.cases.format.ramps import Ramp, ramps_of


def problem(checks: int = 1) -> ss.OptimalControlProblem:
    """Four intervals of a second, with two signals."""
    x, u, low, price = (ca.SX.sym(name) for name in ("x", "u", "low", "price"))
    signals = ca.vertcat(low, price)
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u, signals=signals), horizon=4.0,
        intervals=4, checks=checks, stage_cost=u**2,
    )  # fmt: skip


def smooth_and_jumping(times: Array) -> Array:
    return np.stack([np.sin(times / 2), np.where(times < 2.0, 1.0, 3.0)])


def test_a_jump_is_a_ramp_from_the_check_before_it_and_shorter_with_more_checks() -> (
    None
):
    assert ramps_of(problem(), smooth_and_jumping) == [Ramp("price", 1.0, 2.0)]
    assert ramps_of(problem(4), smooth_and_jumping) == [Ramp("price", 1.75, 2.0)]


def test_a_signal_that_plans_hold_has_a_ramp_only_if_it_jumps_within_an_interval() -> (
    None
):
    held = ss.HeldSignals(["price"])
    for checks in (1, 4):
        stated = replace(problem(checks), features=[held])
        assert ramps_of(stated, smooth_and_jumping) == []
    late = ramps_of(stated, lambda t: np.stack([0 * t, np.where(t < 2.5, 1.0, 3.0)]))
    assert late == [Ramp("price", 2.5, 2.75, is_held=True)]
    assert str(late[0]).endswith("between 2.5 s and 2.75 s, where plans keep its value")


@pytest.mark.parametrize("reference", [
    None, lambda times: np.stack([times, 3 - times]),
    lambda times: np.ones((2, times.size)),
    lambda times: np.stack([np.interp(times, [0, 1, 3], [0, 5, 0]), 0 * times]),
])  # fmt: skip
def test_what_is_linear_between_checks_or_smooth_is_none(reference: object) -> None:
    assert ramps_of(problem(), reference) == []  # type: ignore[arg-type]


def test_with_a_free_end_time_nothing_is_known() -> None:
    free = ss.OptimalControlProblem(
        problem().model, horizon=ss.Free(1.0, 4.0), intervals=4
    )
    assert ramps_of(free, smooth_and_jumping) == []
