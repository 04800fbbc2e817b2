"""References that move: what a set can bear of it, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set import (
    Change,
    MovingReferenceError,
    NotAnEquilibriumError,
    ProofOptions,
    ProvenLevel,
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
    certify,
    proven_level,
)
from swarmstart.terminal_set.proving.drift import (
    _EXACT,
    _EXACT_AT,
    MOST_CORE,
    Drift,
    ReferenceMotion,
    _exactly,
    bearable_drift,
    exact_rates,
    linear_decrease,
)


def decaying(offset: float, *, rate: float = 1.0) -> ca.Function:
    """x' = -rate x + offset + u."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return ca.Function("decaying", [x, u], [-rate * x + offset + u])


def at(x_ref: list[float], room: float = 1.0, **bounds: Array) -> Reference:
    return Reference(
        x_ref=np.array(x_ref),
        u_ref=np.zeros(1),
        u_lower=-np.ones(1),
        u_upper=np.ones(1),
        **(bounds or {"x_upper": np.array(x_ref) + room}),
    )


def unit(x_ref: float = 0.0) -> TerminalSet:
    """P = 1 and no feedback."""
    return TerminalSet(
        K=np.zeros((1, 1)), P=np.eye(1), alpha=1.0, x_ref=np.array([x_ref]),
        u_ref=np.zeros(1), dt=None, design="given",
    )  # fmt: skip


def certified(
    offset: float, *, dt: float | None = None, room: float = 1.0
) -> TerminalSet:
    options = ProofOptions(growth=False)
    rng = np.random.default_rng(0)
    return certify(
        decaying(offset), at([0.0], room), unit(), dt=dt, options=options, rng=rng
    )


@pytest.mark.parametrize("dt", [None, 0.5])
@pytest.mark.parametrize("offset", [1e-9, -1e-9])
def test_a_rounded_reference_has_a_core_that_holds_the_equilibrium(
    offset: float, dt: float | None
) -> None:
    """x' = -x + r rests at r: that is within the core, and the core within the set."""
    found = certified(offset, dt=dt)
    certificate = found.certificate
    assert certificate is not None
    assert offset**2 < certificate.core <= MOST_CORE * found.alpha
    # |e+| <= |map| + (c + drift) |e| at the core's edge: it is not left.
    moved = abs(offset) * (1 if dt is None else 1 - np.exp(-dt))
    assert moved < certificate.drift * certificate.core**0.5
    assert certificate.drift <= 1e-3  # 5e-4 of the decrease, 2 V a second


@pytest.mark.parametrize("dt", [None, 0.5])
def test_what_is_proven_has_the_drift_in_reserve(
    dt: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Too little to see in the level: the margin that is asked for is looked at."""
    asked = []

    def recorded(change: Change, *rest: Any, **options: Any) -> ProvenLevel:
        asked.append(change.Q_m)
        return proven_level(change, *rest, **options)

    monkeypatch.setattr(
        "swarmstart.terminal_set.proving.certification.proven_level", recorded
    )
    certificate = certified(1e-9, dt=dt).certificate
    assert certificate is not None and certificate.drift > 1e-5
    expected = 2 * certificate.drift
    if certificate.held is not None:
        c = certificate.held.integrator_error + certificate.drift
        expected = 2 * c + c**2
    assert asked[-1][0, 0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("dt", [None, 0.5])
@pytest.mark.parametrize("offset", [1e-5, -1e-5])
def test_a_drift_that_its_core_could_not_bear_is_refused(
    offset: float, dt: float | None
) -> None:
    with pytest.raises(NotAnEquilibriumError, match=r"xdot\[0\] = -?1e-05 there"):
        certified(offset, dt=dt)


def test_what_a_set_can_bear_is_a_matter_of_its_size() -> None:
    """The same drift, and a room of 1 and of 1e6: nothing is absolute."""
    assert certified(1e-5, room=1e6).alpha == pytest.approx(1e12, rel=1e-6)
    with pytest.raises(NotAnEquilibriumError, match="of a set V <= 1e-06"):
        certified(1e-9, room=1e-3)


@pytest.mark.parametrize(("x_ref", "offset"), [(1e13, 5.0), (1e6, 9e-7)])
def test_a_drift_is_not_small_because_the_reference_is_large(
    x_ref: float, offset: float
) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    dynamics = ca.Function("f", [x, u], [-(x - x_ref) + offset + u])
    reference = at([x_ref], 1.0 if offset > 1 else 1e-7)
    with pytest.raises(NotAnEquilibriumError, match=rf"xdot\[0\] = {offset:.6g} there"):
        certify(
            dynamics,
            reference,
            unit(x_ref),
            dt=None,
            rng=np.random.default_rng(0),
        )


@pytest.mark.parametrize("heading", [0.0, np.pi])
@pytest.mark.parametrize("side", ["x_lower", "x_upper"])
def test_a_state_with_a_bound_may_not_move_along(
    formation: ca.Function, leader: Reference, heading: float, side: str
) -> None:
    """A leader at 15 m/s: 0 <= x <= 60 was certified, stated or not."""
    free = np.full(4, np.inf)
    x_ref = np.array([15.0, heading, 30.0, 0.0])
    weights = Weights(Q=np.eye(4), R=np.diag([1.0, 100.0]))
    course = 15 * np.array([0, 0, np.cos(heading), np.sin(heading)])
    unbounded = replace(leader, x_ref=x_ref, velocity=course)
    limit = {"x_lower": -free, "x_upper": free}[side].copy()
    limit[2] = 0.0 if side == "x_lower" else 60.0
    speed = "15" if heading == 0 else "-15"
    with pytest.raises(MovingReferenceError, match=rf"{speed} of x\[2\], with bounds"):
        replace(unbounded, **{side: limit})
    with pytest.raises(NotAnEquilibriumError, match=rf"xdot\[2\] = {speed}"):
        certified_terminal_set(
            formation,
            replace(unbounded, velocity=None, **{side: limit}),
            weights,
            dt=1.0,
            rng=np.random.default_rng(0),
        )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("substeps", [1, 4])
def test_a_hold_moves_the_reference_no_further_than_its_bound(
    sign: int, substeps: int
) -> None:
    """x' = x + r moves r (exp(dt) - 1), more than r dt."""
    r = 1e-6
    motion = ReferenceMotion(decaying(sign * r, rate=-1.0), at([0.0]))
    assert motion.bound == pytest.approx([r], rel=1e-12)
    for dt in (0.01, 0.3):
        moved = motion.over_hold(dt, substeps)[0]
        assert r * np.expm1(dt) < moved < 1.7 * r * np.expm1(dt)


def test_a_state_that_rests_at_first_is_moved_by_one_that_does_not() -> None:
    """x0' = r, x1' = 8 x0: after dt they are at r dt and at 4 r dt^2."""
    x, u, r, dt = ca.SX.sym("x", 2), ca.SX.sym("u"), 1e-6, 0.5
    dynamics = ca.Function("chain", [x, u], [ca.vertcat(r + 0 * u, 8 * x[0])])
    reference = at([0.0, 0.0], x_upper=np.ones(2))
    moved = ReferenceMotion(dynamics, reference).over_hold(dt, 1)
    assert r * dt <= moved[0] < 1.6 * r * dt
    assert 4 * r * dt**2 < moved[1] < 40 * r * dt**2


def test_without_an_enclosure_of_the_hold_there_is_no_bound() -> None:
    motion = ReferenceMotion(decaying(1e-6, rate=10.0), at([0.0]))
    assert motion.over_hold(1.0, 1)[0] == np.inf
    assert np.isfinite(motion.over_hold(1.0, 40)[0])


def test_states_that_are_stated_to_move_are_left_out(
    formation: ca.Function, leader: Reference
) -> None:
    motion = ReferenceMotion(formation, leader)
    assert motion.entries == () and not motion.bound.any()
    assert not motion.over_hold(1.0, 2).any()
    unstated = ReferenceMotion(formation, replace(leader, velocity=None))
    assert unstated.entries == (2,) and unstated.rates == (15.0,)


def test_a_state_moves_only_as_it_says_and_only_if_nothing_feels_it() -> None:
    """x' = (1e-3, -y + v) with inputs (v, w): x may move by 1e-3, y may not."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    f = ca.Function("f", [x, u], [ca.vertcat(1e-3 + 0 * u[1], -x[1] + u[0])])
    rest = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(2), u_lower=-np.ones(2), u_upper=np.ones(2)
    )
    assert ReferenceMotion(f, rest).entries == (0,)
    along = replace(rest, velocity=np.array([1e-3 * (1 + 0.9e-9), 0]))
    motion = ReferenceMotion(f, along)
    assert motion.entries == () and not motion.bound.any()
    for wrong, said in (
        ([1e-3 * (1 + 1.1e-9), 0], r"of x\[0\], whose rate is 0.001"),
        ([-1e-3, 0], r"velocity -0.001 of x\[0\], whose rate"),
        ([1e-3, 1e-9], r"of x\[1\], on which the dynamics depend"),
    ):
        with pytest.raises(MovingReferenceError, match=said):
            ReferenceMotion(f, replace(rest, velocity=np.array(wrong)))
    driven = ca.Function("f", [x, u], [ca.vertcat(1e-3 + x[0], -x[1] + u[0])])
    with pytest.raises(MovingReferenceError, match=r"x\[0\], on which the dynamics"):
        ReferenceMotion(driven, along)


def test_linear_decrease_is_that_at_the_centre() -> None:
    """e' = -(1, 3) e + e^2: V falls by 2 of itself there, by less away from it."""
    e = ca.SX.sym("e", 2)
    motion = ca.Function("motion", [e], [ca.vertcat(-e[0], -3 * e[1]) + e**2])
    for P in (np.eye(2), np.diag([4.0, 9.0])):
        change = Change(motion=motion, P=P, Q_m=np.zeros((2, 2)), is_held=False)
        assert linear_decrease(change) == pytest.approx(2.0, rel=1e-12)
    rising = ca.Function("motion", [e], [e - e**2])
    change = Change(motion=rising, P=np.eye(2), Q_m=np.zeros((2, 2)), is_held=False)
    assert linear_decrease(change) == 0


def linear_change(rates: Array, P: Array) -> Change:
    """e' = -rates e, entry by entry; V falls by 2 rates_i of its own part."""
    e = ca.SX.sym("e", rates.size)
    motion = ca.Function("motion", [e], [-ca.DM(rates) * e])
    return Change(motion=motion, P=P, Q_m=np.zeros(P.shape), is_held=False)


def resting() -> ReferenceMotion:
    """Of (x, y)' = (1e-9, -2e-9) - (x, y): both should rest."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.DM([1e-9, -2e-9]) - x + 0 * u])
    reference = at([0.0, 0.0], x_upper=np.ones(2))
    return ReferenceMotion(f, reference)


@pytest.mark.parametrize("rate", [0.05, 2.0])
def test_drift_is_measured_by_p_and_allowed_for_within_shares_of_the_decrease(
    rate: float,
) -> None:
    motion = resting()
    assert motion.entries == (0, 1) and motion.rates == (1e-9, -2e-9)
    P = np.diag([4.0, 9.0])
    change = linear_change(np.array([rate, 3 * rate]), P)
    for alpha in (1.0, 1e4, 1e16):
        found = bearable_drift(motion, motion.bound, change, alpha)
        size = (1 + 1e-9) * (1e-9 * 2 + 2e-9 * 3)
        assert found.size == pytest.approx(size, rel=1e-12)
        decay = 2 * rate  # Of the slower entry.
        # A millionth of the radius, twice for rounding; at most 5e-4 of the decrease.
        wanted = 2 * size / (1e-6 * np.sqrt(alpha))
        expected = np.clip(wanted, 1e-9 * decay, 5e-4 * decay)
        assert found.relative == pytest.approx(float(expected), rel=1e-9)
        assert (found.entries, found.rates) == ((0, 1), (1e-9, -2e-9))
    still = bearable_drift(motion, np.zeros(2), change, 1.0)
    assert (still.size, still.relative, still.core_of(1.0)) == (0, 0, 0)


@pytest.mark.parametrize("rate", [0.05, 2.0])
def test_drift_beyond_all_levels_is_refused_unless_nothing_can_be_proven(
    rate: float,
) -> None:
    motion, large = resting(), np.array([1.0, 1.0])
    with pytest.raises(NotAnEquilibriumError):
        bearable_drift(motion, large, linear_change(np.full(2, rate), np.eye(2)), 1.0)
    rising = linear_change(np.array([1.0, -rate]), np.eye(2))
    assert bearable_drift(motion, large, rising, 1.0).relative == 0


def test_core_is_where_the_drift_is_the_stated_share() -> None:
    """Twice for rounding; from a millionth of the level down to 1e-24 of it."""
    drift = Drift(entries=(0,), rates=(1.0,), size=1e-6, relative=0.5)
    radius = 2 * 1e-6 / 0.5
    edge = radius**2 / 1e-6
    assert drift.core_of(edge * (1 + 1e-9)) == pytest.approx(radius**2, rel=1e-12)
    with pytest.raises(NotAnEquilibriumError) as told:
        drift.core_of(edge * (1 - 1e-9))
    assert told.value.core == pytest.approx(radius**2, rel=1e-12)
    large = 1e6 * radius**2 / 1e-24
    assert drift.core_of(large) == 1e-24 * large
    with pytest.raises(NotAnEquilibriumError):
        replace(drift, relative=0.0).core_of(1e9)
    assert replace(drift, size=0.0).core_of(1.0) == 0


@pytest.mark.parametrize("substeps", [1, 4])
def test_constant_rate_moves_its_time_over_a_hold(substeps: int) -> None:
    """A box as wide as the rate times the step is wide enough."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [ca.DM(-3e-3) + 0 * u])
    motion = ReferenceMotion(f, at([2.0]))
    found = motion.over_hold(0.5, substeps)
    exact = 3e-3 * 0.5
    assert exact * (1 + 1e-9) < found[0] <= exact * (1 + 1e-9) ** (2 * substeps + 1)


def test_rates_near_a_reference_are_those_of_a_box_that_is_rounded_outwards() -> None:
    """Of 1e10 (x - 1), within 100 units in the last place: and four more."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [1e10 * (x - 1) + u])
    unit = float(np.spacing(1.0))
    found = ReferenceMotion(f, at([1.0]))._fastest(np.array([100 * unit]))[0]
    assert 1e10 * 103.9 * unit <= found < 1e10 * 105 * unit


def test_reference_that_rests_exactly_is_not_moved_by_the_rounding_of_intervals() -> (
    None
):
    """0.1 + 0.1 - 0.2 is 0 and its interval wider; the state beside it rests as well.

    A box around a reference that does not move is not widened.
    """
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [(x + 0.1) - (x + 0.2) + 0.1 + u])
    motion = ReferenceMotion(f, at([15.0], 1e3))
    assert motion._fastest(np.zeros(1))[0] > 0
    assert motion.entries == () and motion.bound[0] == 0
    assert motion.over_hold(1.0, 2)[0] == 0


def test_rates_are_exact_where_fractions_show_it_and_else_unknown() -> None:
    """0.1 + 0.2 is no 0.3 in floats, and 3 * (1/3) is no 1: neither rests."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rates = ca.vertcat(
        x[0] * ca.sin(x[1]), u - 9.81, (x[0] + 0.1) - (x[0] + 0.2) + 0.1,
        ca.exp(u) - 1, ca.cos(x[1]) * u - u, x[0] / x[1],
    )  # fmt: skip
    f = ca.Function("f", [x, u], [rates])
    reference = Reference(
        x_ref=np.array([15.0, 0.0]), u_ref=np.array([9.81]),
        u_lower=np.array([-99.0]), u_upper=np.array([99.0]),
    )  # fmt: skip
    found = exact_rates(f, reference)
    assert found[0] == found[1] == found[4] == 0
    assert found[2] == Fraction(0.1) + Fraction(0.1) - Fraction(0.2) == 0
    assert found[3] is None and found[5] is None
    assert exact_rates(f, replace(reference, u_ref=np.array([0.1 + 0.2])))[1] == (
        Fraction(0.1 + 0.2) - Fraction(9.81)
    )
    for first in (x[0] + 0.1, x[0], 1 / x[0]):
        chain = first
        for _ in range(60):  # 2^60 times the digits, if they were kept.
            chain = chain * chain
        long = ca.Function("f", [x, u], [chain + u])
        assert exact_rates(long, reference) == [None]
    beyond = ca.Function("f", [x, u], [u * np.inf])
    assert exact_rates(beyond, reference) == [None]


@pytest.mark.parametrize("value", [Fraction(0), Fraction(1), Fraction(-3, 7)])
def test_operations_on_fractions_are_those_on_numbers(value: Fraction) -> None:
    """Known exactly only where the result is a fraction, and then it is that one."""
    other = Fraction(5, 4)
    by_hand = {
        "add": value + other, "sub": value - other, "mul": value * other,
        "div": value / other, "neg": -value, "fabs": abs(value),
        "fmin": min(value, other), "fmax": max(value, other), "sq": value**2,
        "twice": value + value, "inv": 1 / value if value else None,
    }  # fmt: skip
    assert by_hand.keys() == _EXACT.keys()
    binary = ("add", "sub", "mul", "div", "fmin", "fmax")
    for name, expected in by_hand.items():
        arguments = [value, other] if name in binary else [value]
        assert _exactly(name, list(arguments)) == expected
        assert _exactly(name, [*arguments[1:], None]) is None
    for name in _EXACT_AT:
        found = _exactly(name, [value])
        numbers = {"sin": 0, "tan": 0, "atan": 0, "tanh": 0, "sqrt": 0, "exp": 0,
                   "cos": 0, "log": 1}  # fmt: skip
        assert (found is not None) == (value == numbers[name])
        if found is not None:
            assert float(found) == getattr(np, {"atan": "arctan"}.get(name, name))(
                float(value)
            )
