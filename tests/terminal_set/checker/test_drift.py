"""References that are no equilibrium: refused beyond what a negligible core bears."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import casadi as ca
import pytest

from swarmstart.terminal_set.checker.findings import Verdict
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (
    certificate_of,
    chen,
    formation,
    replaced,
    scalar,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import as_read

pytest.importorskip("flint")

from flint import arb

from swarmstart.terminal_set.checker.motion import _norm, check_drift

Check = Callable[..., tuple[int, str]]


def core(level: float, drift: float) -> dict[str, float]:
    return {"level": level, "drift": drift}


@pytest.mark.parametrize("offset", [1e-9, -1e-9])
def test_a_rounded_reference_is_taken_with_a_core_that_holds_the_equilibrium(
    check: Check, offset: float
) -> None:
    """x' = -x + 1e-9 rests at 1e-9; a drift of 1e-3 and a core of 1e-6 bear as much."""
    code, said = check(scalar(offset, core=core(1e-12, 1.001e-3)))
    assert code == 0
    assert "the reference moves x[0] by 1e-09 a second at most" in said


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("offset", "level", "drift"),
    [
        (1e-9, 0.0, 0.0),  # stated to be exact
        (1e-9, 1e-12, 0.999e-3),  # D > a sqrt(core)
        (1e-9, 0.99e-12, 1e-3),
        (1e-6, 1.1e-6, 1e-3),  # a core that is more than a millionth of the set
        (math.inf, 1e-12, 1e-3),
    ],
)
def test_motion_beyond_what_the_core_bears_is_refused(
    check: Check, sign: int, offset: float, level: float, drift: float
) -> None:
    content = scalar(0.0, core=core(level, drift))
    tape = content["dynamics"]["tape"]
    # Infinity is no number of a file, but 1/0 is one of a tape.
    tape[3] = ["const", sign * offset] if math.isfinite(offset) else ["inv", 1]
    code, said = check(signed(content))
    assert code == 3
    assert "the reference is no equilibrium, beyond what its core bears" in said


def test_a_drift_that_uses_up_the_decrease_is_not_proven(check: Check) -> None:
    """x' = -x + 2e-3 rests at 2e-3, outside a core of radius 1e-3."""
    assert check(scalar(0.99e-3, core=core(1e-6, 0.991)))[0] == 0
    code, said = check(scalar(2e-3, core=core(1e-6, 2.001)))
    assert code == 3
    assert "V does not decrease at e = " in said


@pytest.mark.parametrize(("x_ref", "offset"), [(1e13, 5.0), (1e6, 9e-7)])
def test_a_motion_that_is_small_beside_the_reference_is_one_all_the_same(
    check: Check, x_ref: float, offset: float
) -> None:
    """Within 1e-12 of x_ref one is at rest, but the set is smaller than that."""
    alpha = 1.0 if offset > 1 else 1e-14
    for drift in (0.0, 0.5):
        stated = core(1e-6 * alpha, drift)
        code, _ = check(scalar(offset, x_ref=x_ref, alpha=alpha, core=stated))
        assert code == 3


@pytest.mark.parametrize("heading", [0.0, math.pi])
@pytest.mark.parametrize("side", ["x_lower", "x_upper"])
def test_a_state_with_a_bound_may_not_move_along(
    check: Check, heading: float, side: str
) -> None:
    """A leader at 15 m/s reaches 60 m after 4 s, whatever its follower does."""
    forwards = math.cos(heading) * 15.0
    reference = {
        "x": [15.0, heading, 30.0, 0.0],
        "u": [0.0, 0.0],
        "velocity": [0.0, 0.0, forwards, 0.0],
    }
    content = formation(reference=reference)
    # Of the heading pi the sine is 1.2e-16: a core for that alone.
    content["core"] = core(1e-6 * content["alpha"], 1e-6)
    bound = 0.0 if side == "x_lower" else 60.0
    assert check(signed(content))[0] in (0, 3)
    code, said = check(signed(replaced(content, ("bounds", side, 2), bound)))
    assert code == 3
    assert f"to move x[2] by {forwards:g} a second, but it has bounds" in said


@pytest.mark.parametrize("sign", [1, -1])
def test_over_a_hold_the_motion_of_the_reference_counts(
    check: Check, sign: int
) -> None:
    """x' = -x + r moves r (1 - exp(-dt)) in a hold; 0.393 r in half a second."""
    r = 1e-9

    def judged(moved: float) -> tuple[int, str]:
        stated = core(1e-12, moved * r / 1e-6)
        return check(scalar(sign * r, dt=0.5, core=stated))

    assert judged(1.2)[0] == 0
    code, said = judged(0.39)
    assert code == 3
    assert "no equilibrium" in said


def test_over_a_hold_without_an_enclosure_nothing_is_borne(check: Check) -> None:
    """h sup |f| does not settle for x' = -x + r held 3 s in one step."""
    content = scalar(1e-9, dt=3.0, core=core(1e-12, 0.1))
    assert check(content)[0] == 3
    assert "no equilibrium" in check(content)[1]


def test_a_state_that_rests_at_first_is_moved_by_one_that_does_not() -> None:
    """x0' = r, x1' = 8 x0: after half a second they are at r / 2 and at r."""
    x, u, r = ca.SX.sym("x", 2), ca.SX.sym("u"), 2.0**-30
    dynamics = ca.Function("chain", [x, u], [ca.vertcat(r + 0 * u, 8 * x[0])])
    certificate = certificate_of(dynamics, [[1.0, 0.0], [0.0, 1.0]], 1.0, dt=0.5)
    stated = dataclasses.replace(
        certificate,
        core=1e-6,
        bounds=certificate.bounds | {"x_upper": (1.0, 1.0)},
    )
    moved = math.hypot(0.5, 1.0) * r
    for share, verdict in ((0.99, Verdict.REFUSED), (4.0, Verdict.PROVED)):
        borne = dataclasses.replace(stated, drift=share * moved / 1e-3)
        assert check_drift(borne).verdict is verdict


@pytest.mark.parametrize("alpha", [0.25, 1.0, 4.0])
def test_core_is_at_most_a_millionth_of_the_level(alpha: float) -> None:
    x, u = ca.SX.sym("x", 1), ca.SX.sym("u")
    dynamics = ca.Function("rounded", [x, u], [1e-12 - x + 0 * u])
    stated = certificate_of(dynamics, [[1.0]], alpha)
    assert stated.alpha == alpha
    for share, verdict in ((0.99e-6, Verdict.PROVED), (1.01e-6, Verdict.REFUSED)):
        held = dataclasses.replace(stated, core=share * alpha, drift=1.0)
        assert check_drift(held).verdict is verdict


@pytest.mark.parametrize("dt", [None, 0.5])
def test_a_state_that_may_move_along_needs_nothing_of_the_core(
    dt: float | None,
) -> None:
    """x0' = -x0 + r moves by less than 2 r, x1' = 3 is felt by nothing else."""
    x, u, r = ca.SX.sym("x", 2), ca.SX.sym("u"), 1e-9
    dynamics = ca.Function("along", [x, u], [ca.vertcat(r - x[0] + 0 * u, 3)])
    P = [[1.0, 0.5], [0.5, 1.0]]
    certificate = certificate_of(dynamics, P, 1.0, dt=dt, velocity=[0.0, 3.0])
    stated = dataclasses.replace(certificate, core=1e-12, drift=2e-3)
    assert check_drift(stated).verdict is Verdict.PROVED
    for velocity in ((0.0, 0.0), (0.0, 3.01), (0.0, -3.0), (1e-9, 3.0)):
        moved = dataclasses.replace(stated, velocity=velocity)
        assert check_drift(moved).verdict is Verdict.REFUSED, velocity
    # Of the velocity itself, 3, a billionth may be missing.
    for share, verdict in ((0.9e-9, Verdict.PROVED), (1.1e-9, Verdict.REFUSED)):
        moved = dataclasses.replace(stated, velocity=(0.0, 3.0 * (1 + share)))
        assert check_drift(moved).verdict is verdict
    bounds = stated.bounds | {"x_upper": (None, 1.0)}
    held_back = dataclasses.replace(stated, bounds=bounds)
    assert check_drift(held_back).verdict is Verdict.REFUSED


def test_the_drift_is_part_of_what_bounds_of_states_leave_room_for(
    check: Check,
) -> None:
    """The set reaches sqrt(growth) + c + drift, here 1.1 + 0.001 + 0.05."""
    growth = {"growth": 1.21, "grounds": "measured"}
    for room, expected in ((1.1512, 0), (1.15, 3)):
        content = scalar(0.0, dt=0.5, core=core(0.0, 0.05))
        content["margins"]["between_samples"] = growth
        content["bounds"]["x_upper"] = [room]
        assert check(signed(content))[0] == expected


def test_the_drift_is_part_of_the_decrease(check: Check) -> None:
    """x' = -x: V' = -2 V. Held, 0.60677^2 + (1 + 0.001 + drift)^2 - 1 is to be below 1.

    0.60677 is the Runge-Kutta map of half a second; the drift can be 0.2764.
    """
    for drift, expected in ((0.99, 0), (1.01, 3)):
        assert check(scalar(core=core(0.0, drift)))[0] == expected
    for drift, expected in ((0.276, 0), (0.277, 3)):
        assert check(scalar(dt=0.5, core=core(0.0, drift)))[0] == expected


@pytest.mark.parametrize("beside", [3.0, -3.0])
def test_a_motion_is_as_large_as_its_worst_signs_make_it(beside: float) -> None:
    certificate = dataclasses.replace(as_read(chen()), P=((4.0, beside), (beside, 9.0)))
    most = math.sqrt(4 * 0.5**2 + 2 * 3 * 0.5 * 0.25 + 9 * 0.25**2)
    found = float(_norm(certificate, [arb(0.5), arb(0.25)]))
    assert found == pytest.approx(most, rel=1e-6) and found >= most


def test_chen_is_an_exact_equilibrium(check: Check) -> None:
    assert "re-proved: the reference rests" in check(chen())[1]


def test_products_that_cancel_exactly_do_not_move_the_reference(check: Check) -> None:
    """0.1 * 0.3 - 0.3 * 0.1: their digits, twice those of a float, are all kept."""
    content = scalar()
    content["dynamics"]["tape"] += [
        ["const", 0.1], ["const", 0.3], ["mul", 5, 6], ["mul", 6, 5],
        ["sub", 7, 8], ["add", 4, 9],
    ]  # fmt: skip
    content["dynamics"]["xdot"] = [10]
    code, said = check(signed(content))
    assert code == 0 and "re-proved: the reference rests" in said
