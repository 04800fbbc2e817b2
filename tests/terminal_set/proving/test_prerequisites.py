"""Holds and integrators with which nothing can be proven are refused at once."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set import (
    HeldTooLongError,
    Reference,
    TerminalSet,
    TooFewSubstepsError,
    continuous_lqr,
    sampled_terminal_set,
)
from swarmstart.terminal_set.proving import drift
from swarmstart.terminal_set.proving.drift import (
    require_enough_substeps,
    require_stable_hold,
)


def decay(rate: float, dt: float) -> tuple[TerminalSet, np.ndarray, np.ndarray]:
    """x' = -rate x + u, held; its law, A and B."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("decay", [x, u], [-rate * x + u])
    one = np.eye(1)
    reference = Reference(
        x_ref=np.zeros(1), u_ref=np.zeros(1), u_lower=-one[0], u_upper=one[0]
    )
    law = sampled_terminal_set(f, reference, dt=dt, Q=one, R=100 * one)
    return law, -rate * one, one


def series(z: float, substeps: int) -> float:
    """Return the Runge-Kutta method's approximation of exp(z)."""
    h = z / substeps
    return float((1 + h + h**2 / 2 + h**3 / 6 + h**4 / 24) ** substeps)


@pytest.mark.parametrize("substeps", [1, 2, 3])
def test_a_runge_kutta_map_that_diverges_is_refused_with_what_would_do(
    substeps: int,
) -> None:
    """Of x' = -x / 0.1 over 1 s: closed form, nearly without a law."""
    law, A, B = decay(10.0, 1.0)
    with pytest.raises(TooFewSubstepsError) as caught:
        require_enough_substeps(A, B, law, dt=1.0, substeps=substeps)
    factor = abs(series(-10.0, substeps))
    assert caught.value.factor == pytest.approx(factor, rel=2e-3)
    assert caught.value.error == pytest.approx(factor, rel=1e-3, abs=1e-4)
    assert caught.value.enough is not None
    require_enough_substeps(A, B, law, dt=1.0, substeps=caught.value.enough)
    message = f"substeps={substeps} is too few: .* by {caught.value.factor:.3g} in"
    with pytest.raises(TooFewSubstepsError, match=message):
        require_enough_substeps(A, B, law, dt=1.0, substeps=substeps)
    assert f"use ProofOptions(substeps={caught.value.enough})" in str(caught.value)


def test_a_map_that_shrinks_but_errs_by_the_rest_is_refused() -> None:
    """R(-2.7) = 0.81 where the flow has 0.067: 0.81 + 0.74 is above 1."""
    law, A, B = decay(2.7, 1.0)
    assert 0.5 < series(-2.7, 1) < 0.9
    with pytest.raises(TooFewSubstepsError) as caught:
        require_enough_substeps(A, B, law, dt=1.0, substeps=1)
    assert caught.value.factor < 1 < caught.value.factor + caught.value.error
    assert caught.value.enough == 2


@pytest.mark.parametrize(("most", "enough"), [(1, None), (2, 2)])
def test_no_more_substeps_are_recommended_than_are_tried(
    most: int, enough: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drift, "MOST_SUBSTEPS", most)
    law, A, B = decay(2.7, 1.0)
    with pytest.raises(TooFewSubstepsError) as caught:
        require_enough_substeps(A, B, law, dt=1.0, substeps=1)
    assert caught.value.enough == enough


def test_a_map_that_is_near_enough_passes() -> None:
    law, A, B = decay(1.0, 1.0)
    require_enough_substeps(A, B, law, dt=1.0, substeps=1)


def test_steps_beyond_all_numbers_are_refused_and_none_recommended() -> None:
    law, A, B = decay(1.0, 1.0)
    with pytest.raises(TooFewSubstepsError, match="shorten the hold") as caught:
        require_enough_substeps(1e30 * A, B, law, dt=1.0, substeps=1)
    assert caught.value.factor > 1e100 and caught.value.enough is None


def test_a_flow_that_does_not_shrink_is_not_blamed_on_the_substeps() -> None:
    law, A, B = decay(1.0, 1.0)
    require_enough_substeps(-A, B, law, dt=1.0, substeps=1)


def test_a_hold_beyond_all_numbers_in_one_entry_is_not_blamed_on_the_substeps() -> None:
    law = TerminalSet(
        K=np.array([[1e200, 0.0]]), P=np.eye(2), alpha=1.0, x_ref=np.zeros(2),
        u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip
    B = np.array([[1e200], [0.0]])
    with np.errstate(over="ignore", invalid="ignore"):
        require_enough_substeps(-np.eye(2), B, law, dt=1.0, substeps=1)


def test_a_gain_that_does_not_survive_its_hold_is_refused_with_the_longest() -> None:
    """x' = x + u, u = -k x held: Ad - Bd k = exp(dt) (1 - k) + k, -1 at the longest."""
    A, B = np.eye(1), np.eye(1)
    gain = continuous_lqr(A, B, Q=np.eye(1), R=np.eye(1))
    k = float(gain.K[0, 0])
    longest = np.log((k + 1) / (k - 1))
    require_stable_hold(A, B, gain.K, 0.999 * longest)
    with pytest.raises(HeldTooLongError, match="radius is 1"):
        require_stable_hold(A, B, gain.K, 1.001 * longest)
    with pytest.raises(HeldTooLongError) as caught:
        require_stable_hold(A, B, gain.K, 2 * longest)
    assert caught.value.longest == pytest.approx(longest, rel=1e-9)


def test_flow_that_keeps_all_lengths_needs_no_more_substeps() -> None:
    """x' = 0: neither the flow nor the map shortens a deviation."""
    rest = TerminalSet(
        K=np.zeros((1, 1)), P=np.eye(1), alpha=1.0, x_ref=np.zeros(1),
        u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip
    none = np.zeros((1, 1))
    require_enough_substeps(none, none, rest, dt=1.0, substeps=1)
