"""The margins of a held input: affordable ones, and all of them in the proof."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.machine_code import now
from swarmstart.terminal_set import (
    CoarseHoldError,
    TerminalSet,
    UnprovenSetError,
)
from swarmstart.terminal_set.proving import hold_margins
from swarmstart.terminal_set.proving.decrease import Change, held_change
from swarmstart.terminal_set.proving.drift import linear_decrease
from swarmstart.terminal_set.proving.flow_error import FlowError
from swarmstart.terminal_set.proving.hold_margins import (
    AFFORDABLE,
    CLOSE,
    GROWTH_RESERVE,
    HeldMotion,
    HoldBounds,
    ProvableHold,
    provable_hold,
    with_proven_growth,
)
from swarmstart.tests.terminal_set.proving.held_pendulum import sampled_pendulum

DT = 0.1


def held(
    bounds: HoldBounds,
    Q_m: float = 0.0,
    dt: float = DT,
    substeps: int = 1,
    until: float = np.inf,
) -> ProvableHold:
    f, law = sampled_pendulum(DT)
    motion = HeldMotion(f, law, dt=dt, substeps=substeps)
    rng = np.random.default_rng(0)
    change = held_change(motion.step, law, Q_m=Q_m * np.eye(2))
    return provable_hold(motion, change, bounds, rng=rng, until=until)


@pytest.fixture(scope="module")
def hold() -> ProvableHold:
    return held(HoldBounds(inputs=20.0, states=np.inf, drift=1e-3), Q_m=0.1)


def test_the_proof_pays_for_the_integrator_and_the_drift(hold: ProvableHold) -> None:
    """V(F) - V + e'Q_m e + (2 c + c^2) V, c their sum: V of the flow is no more."""
    c = hold.margins.integrator_error + 1e-3
    f, law = sampled_pendulum(DT)
    step = ca.simpleRK(f, 1, 4)
    for e in ([1.0, 0.2], [-0.3, 0.8]):
        later = np.array(step(e, -law.K @ e, DT)).ravel()
        V = float(law.value(e))
        expected = float(law.value(later)) - V + 0.1 * np.dot(e, e)
        change = float(hold.change.function(e))
        assert change == pytest.approx(expected + (2 * c + c**2) * V, rel=1e-12)
        assert change - expected > 2e-3 * V


def test_the_margin_leaves_nearly_all_of_the_decrease(hold: ProvableHold) -> None:
    assert hold.top == 20.0
    assert 0 < hold.margins.integrator_error < 2e-3
    assert hold.margins.substeps == 1 and not hold.margins.growth_is_proven


def test_bounds_of_states_leave_room_for_growth_error_and_drift() -> None:
    found = held(HoldBounds(inputs=1e3, states=15.0, drift=1e-3))
    c = found.margins.integrator_error + 1e-3
    assert found.top < 15.0 / 1.05
    assert found.top * (found.margins.growth**0.5 + c) ** 2 <= 15.0


def test_stated_growth_is_more_than_any_hold_shows_and_roomy_where_it_can_be() -> None:
    """A mass brought to rest in two holds: it goes furthest in between.

    V = e'Q e + (A e)'Q A e falls by e'Q e in each, since A^2 = 0.
    """
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.vertcat(x[1], u)])
    K, A = np.array([[1.0, 1.5]]), np.array([[0.5, 0.25], [-1.0, -0.5]])
    Q = np.diag([1.0, 0.01])
    law = TerminalSet(
        K=K, P=Q + A.T @ Q @ A, alpha=1.0, x_ref=np.zeros(2), u_ref=np.zeros(1),
        dt=None, design="own",
    )  # fmt: skip
    motion, rng = HeldMotion(f, law, dt=1.0, substeps=2), np.random.default_rng(0)
    change = held_change(motion.step, law)

    def stated(states: float) -> ProvableHold:
        bounds = HoldBounds(inputs=1.0, states=states, drift=0.0)
        return provable_hold(motion, change, bounds, rng=rng, until=np.inf)

    root = np.linalg.inv(np.linalg.cholesky(law.P)).T
    angle = np.linspace(0, 2 * np.pi, 2001)
    e = root @ np.stack([np.cos(angle), np.sin(angle)])
    most, force = 1.0, -law.K @ e
    for t in np.linspace(0, 1, 101):
        moved = np.vstack([e[0] + t * e[1] + t**2 / 2 * force[0], e[1] + t * force[0]])
        most = max(most, float(np.einsum("im,ij,jm->m", moved, law.P, moved).max()))
    assert most > 1.2
    roomy = stated(np.inf).margins.growth
    assert roomy == pytest.approx(2 * GROWTH_RESERVE * most, rel=1e-3)
    tight = stated(1.0).margins.growth
    assert tight == pytest.approx(GROWTH_RESERVE * most, rel=1e-3)
    assert tight > most and roomy > 2 * most


def test_a_growth_is_proven_or_is_said_not_to_be(hold: ProvableHold) -> None:
    proven = with_proven_growth(hold, hold.top, work=60)
    assert proven.growth_is_proven and proven.growth == hold.margins.growth
    assert not with_proven_growth(hold, hold.top, work=0).growth_is_proven


def test_a_level_is_lowered_until_its_error_is_affordable() -> None:
    """Up to 1e6 the refuted level is taken; sin's higher terms count for c there."""
    found = held(HoldBounds(inputs=1e6, states=np.inf, drift=0.0))
    assert found.refutation is not None
    assert found.top <= found.refutation.alpha < 100


@pytest.mark.parametrize("edge", [0.9, 3.0, 7.0, 19.0, 21.0])
def test_the_level_is_the_largest_whose_error_leaves_half_of_the_decrease(
    edge: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With an error that rises with the level, half of the decrease at `edge`."""
    f, law = sampled_pendulum(DT)
    motion = HeldMotion(f, law, dt=DT, substeps=1)
    decrease = linear_decrease(held_change(motion.step, law))
    most = np.sqrt(1 + AFFORDABLE * decrease) - 1  # 2 c + c^2 is half the decrease.

    def rising(residual: object, alpha: float, **_: object) -> FlowError:
        return FlowError(relative=most * (alpha / edge) ** 3, boxes=1)

    monkeypatch.setattr(hold_margins, "prove_flow_error", rising)
    bounds = HoldBounds(inputs=20.0, states=np.inf, drift=0.0)
    top = held(bounds, until=time.perf_counter() + 5).top
    assert min(edge, 20.0) / CLOSE <= top <= min(edge, 20.0)


def test_a_margin_beyond_the_decrease_is_refused() -> None:
    with pytest.raises(UnprovenSetError, match="no level could be proven"):
        held(HoldBounds(inputs=1.0, states=np.inf, drift=0.0), Q_m=100.0)


def test_without_any_decrease_no_error_is_asked_for() -> None:
    motion: Any = SimpleNamespace(residual=None, holds=[None])
    with pytest.raises(UnprovenSetError) as caught:
        hold_margins._affordable_error(motion, 2.0, 0.0, np.inf)
    assert type(caught.value) is UnprovenSetError


def test_steps_that_are_too_coarse_are_named() -> None:
    """x' = -x over a hold of 2.5 s: the map's 0.65 is not the flow's 0.08."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [-x + 0 * u])
    law = TerminalSet(
        K=np.zeros((1, 1)), P=np.eye(1), alpha=1.0, x_ref=np.zeros(1),
        u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip
    motion = HeldMotion(f, law, dt=2.5, substeps=1)
    bounds = HoldBounds(inputs=1.0, states=np.inf, drift=0.0)
    rng = np.random.default_rng(0)
    with pytest.raises(CoarseHoldError, match="1 Runge-Kutta steps a hold"):
        provable_hold(
            motion, held_change(motion.step, law), bounds, rng=rng, until=np.inf
        )
    motion = HeldMotion(f, law, dt=2.5, substeps=4)
    change = held_change(motion.step, law)
    found = provable_hold(motion, change, bounds, rng=rng, until=np.inf)
    assert found.top == 1.0


def test_no_try_at_a_margin_may_take_longer_than_all_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    granted: list[float] = []

    def unaffordable(
        residual: object, alpha: float, *, until: float, **_: object
    ) -> FlowError:
        granted.append(until)
        return FlowError(relative=np.inf, boxes=1)

    monkeypatch.setattr(hold_margins, "prove_flow_error", unaffordable)
    until = time.perf_counter() + 60
    with pytest.raises(CoarseHoldError):
        held(HoldBounds(inputs=20.0, states=np.inf, drift=0.0), until=until)
    assert len(granted) > 1 and max(granted) < until


def margins_of(
    monkeypatch: pytest.MonkeyPatch,
    growths: list[tuple[float, bool]],
    *,
    refuted: float | None = None,
    states: float = 100.0,
    relative: float = 0.02,
) -> tuple[ProvableHold, list[float]]:
    """Return a hold whose measurements are prescribed, and the measured levels."""
    levels: list[float] = []

    def measured(level: float, _: object) -> tuple[float, bool]:
        levels.append(level)
        return growths[min(len(levels), len(growths)) - 1]

    motion: Any = SimpleNamespace(measured=measured, holds=[None] * 3)
    change = Change(
        motion=ca.Function("motion", [e := ca.SX.sym("e")], [e / 2]),
        P=2 * np.eye(1), Q_m=0.1 * np.eye(1), is_held=True,
    )  # fmt: skip
    counterexample = None if refuted is None else SimpleNamespace(alpha=refuted)
    for name, value in (
        ("refuted_level", lambda *_, **__: counterexample),
        (
            "_affordable_error",
            lambda _, top, *__: (top, FlowError(relative=relative, boxes=7)),
        ),
    ):
        monkeypatch.setattr(hold_margins, name, value)
    bounds = HoldBounds(inputs=8.0, states=states, drift=0.01)
    rng = np.random.default_rng(0)
    return provable_hold(motion, change, bounds, rng=rng, until=np.inf), levels


def test_margins_are_made_of_what_is_measured_and_proven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With c = 0.02 + 0.01; a growth of 1.3 is stated as 1.43 at least, or twice it."""
    c, least = 0.03, 1.1 * 1.3
    for states, top, growth in (
        (100.0, 8.0, ((100 / 8) ** 0.5 - c) ** 2),  # 12.3: there is room for twice.
        (15.0, 8.0, ((15 / 8) ** 0.5 - c) ** 2),  # 1.79: as much as there is.
        (9.0, 9.0 / (least**0.5 + c) ** 2, least),  # None is left.
    ):
        found, levels = margins_of(monkeypatch, [(1.3, True)], states=states)
        assert levels == [8.0]
        assert found.top == pytest.approx(top, rel=1e-12)
        expected = min(2 * least, growth)
        assert found.margins.growth == pytest.approx(expected, rel=1e-8)
        assert found.margins.substeps == 3 and found.margins.boxes == 7
        assert found.margins.integrator_error == 0.02
        assert not found.margins.growth_is_proven
        np.testing.assert_allclose(found.change.Q_m, 0.1 + 2 * (2 * c + c**2))
    shrinking, _ = margins_of(monkeypatch, [(0.5, True)])
    assert shrinking.margins.growth == pytest.approx(2 * 1.05)


@pytest.mark.parametrize(
    ("growths", "refuted", "levels"),
    [
        ([(np.inf, True), (1.2, True)], None, [8, 4]),
        ([(np.nan, True), (np.inf, True), (1.2, True)], None, [8, 4, 2]),
        # One that grows is looked at again, and halved unless a state refutes it.
        ([(1.2, False), (1.2, False), (1.2, False), (1.2, True)], None, [8, 8, 4, 2]),
        ([(1.2, False)], 5.0, [8, 5]),
        ([(1.2, False), (np.inf, False), (1.2, False)], 5.0, [8, 5, 2.5]),
        ([(np.inf, True)], None, [8 / 2**k for k in range(41)]),
    ],
)
def test_level_is_halved_until_the_model_is_defined_and_falls(
    monkeypatch: pytest.MonkeyPatch,
    growths: list[tuple[float, bool]],
    refuted: float | None,
    levels: list[float],
) -> None:
    found, measured = margins_of(monkeypatch, growths, refuted=refuted, states=np.inf)
    assert measured == levels
    assert found.top == levels[-1] or not np.isfinite(growths[-1][0])
    assert (found.refutation is None) == (refuted is None)


@pytest.mark.parametrize(
    ("top", "halvings"), [(64.0, 6), (1.5, 0), (1.83 * 2, 1), (1.84 * 2, 2)]
)
def test_error_is_asked_for_until_it_is_known_to_be_affordable_or_not(
    monkeypatch: pytest.MonkeyPatch, top: float, halvings: int
) -> None:
    """It is a tenth of the level; 2 c + c^2 is half of a decrease of 0.8 at 1.832."""
    asked: list[float] = []

    def rising(
        _: object, alpha: float, *, enough: float, useless: float, until: float
    ) -> FlowError:
        asked.append(alpha)
        assert enough == pytest.approx(0.005 * 0.8 / 2)
        assert useless == pytest.approx(0.5 * 0.8 / 2)
        assert until - now() == pytest.approx(100.0, rel=0.05)
        return FlowError(relative=alpha / 10, boxes=1)

    monkeypatch.setattr(hold_margins, "prove_flow_error", rising)
    motion: Any = SimpleNamespace(residual=None, holds=[None])
    until = now() + 400.0
    level, error = hold_margins._affordable_error(motion, top, 0.8, until)
    most = 10 * (1.4**0.5 - 1)
    assert asked[: halvings + 1] == [top / 2**k for k in range(halvings + 1)]
    assert min(top, most / 1.05) <= level <= most
    assert error.relative == pytest.approx(level / 10)
    # Between a level and twice it, by their ratios, until these are 1.05.
    assert len(asked) - halvings - 1 <= np.ceil(np.log2(np.log(2) / np.log(1.05)))
    assert len(asked) == 1 or len(asked) > halvings + 1
