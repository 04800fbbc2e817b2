"""The motion in balls: against the same formulas in floats, written by hand."""

from __future__ import annotations

import dataclasses
import itertools

import casadi as ca
import numpy as np
import pytest

flint = pytest.importorskip("flint")

from flint import arb  # noqa: E402

from swarmstart.arrays import Array  # noqa: E402
from swarmstart.terminal_set.checker.findings import (  # noqa: E402
    Deadline,
    TimeIsUpError,
)
from swarmstart.terminal_set.checker.jets import RAY_AND_TIME, Algebra  # noqa: E402
from swarmstart.terminal_set.checker.motion import (  # noqa: E402
    Program,
    RelativeMotion,
    _fastest,
    _over_hold,
    live_instructions,
    rate,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (  # noqa: E402
    certificate_of,
    chen,
    formation,
    replaced,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import (  # noqa: E402
    Field,
    as_read,
    chen_field,
    relative_motion,
    unicycle_field,
)

SYSTEMS = {"chen": (chen, chen_field), "formation": (formation, unicycle_field)}


def moving_chen(**changes: object) -> dict[str, object]:
    """The example about another reference, if nothing is zero."""
    return chen(reference={"x": [0.5, -0.25], "u": [0.125]}, **changes)


def held_chen(substeps: int) -> dict[str, object]:
    margin = {"relative_error": 1e-3, "grounds": "measured", "samples": 1}
    held = {"integrator": margin, "between_samples": None}
    return moving_chen(dt=0.5, substeps=substeps, margins=held, statements=[])


def mids(balls: list[arb]) -> list[float]:
    assert all(float(ball.rad()) < 1e-12 for ball in balls)
    return [float(ball.mid()) for ball in balls]


def test_only_what_reaches_the_rate_is_run() -> None:
    content = chen()
    tape = [*content["dynamics"]["tape"], ["log", 0], ["add", 15, 3]]
    dead = as_read(signed(replaced(content, ("dynamics", "tape"), tape)))
    assert live_instructions(dead) == frozenset(range(15))
    shorter = as_read(signed(replaced(content, ("dynamics", "xdot"), [1, 5])))
    assert live_instructions(shorter) == {0, 1, 4, 5}
    program = Program.of(shorter)
    assert [number for number, _ in program.steps] == [0, 1, 4, 5]
    assert program.outputs == (1, 5)


def test_rate_is_that_of_the_tape() -> None:
    program = Program.of(as_read(moving_chen()))
    values = Algebra(monomials=0)
    x, u = np.array([0.3, -1.7]), np.array([0.9])
    jets = [[values.constant(entry) for entry in v] for v in (x, u)]
    found = mids([jet.value for jet in rate(program, *jets)])
    np.testing.assert_allclose(found, chen_field(x, u), rtol=1e-14)


@pytest.mark.parametrize("side", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_no_point_around_the_reference_moves_faster_than_the_bound(
    side: tuple[int, int],
) -> None:
    """Corner by corner, mirrored so that each of them is the fastest once."""
    reference = np.array([0.5, -0.25]) * side
    content = chen(reference={"x": reference.tolist(), "u": [0.125]})
    certificate = as_read(signed(content))
    around = np.array([0.3, 0.2])
    program, both = Program.of(certificate), frozenset({0, 1})
    found = _fastest(certificate, program, both, [arb(float(r)) for r in around])
    corners = [
        np.abs(chen_field(reference + np.array(s) * around, np.array([0.125])))
        for s in itertools.product((-1, 1), repeat=2)
    ]
    bounds = np.array([float(bound) for bound in found])
    assert (bounds >= np.max(corners, axis=0)).all()
    np.testing.assert_allclose(bounds, np.max(corners, axis=0), rtol=1e-8)
    assert _fastest(certificate, program, frozenset({1}), [arb(0)] * 2)[0] == 0


@pytest.mark.parametrize(
    ("content", "field", "time"),
    [
        (moving_chen(), chen_field, None),
        (held_chen(1), chen_field, 0.5),
        (held_chen(3), chen_field, 0.5),
        (held_chen(3), chen_field, 0.125),
        (formation(), unicycle_field, 1.0),
    ],
)
def test_motion_is_that_of_the_field_or_of_runge_kutta(
    content: dict[str, object], field: Field, time: float | None
) -> None:
    certificate = as_read(content)
    motion = RelativeMotion(certificate)
    assert motion.held is (certificate.dt is not None)
    rng = np.random.default_rng(0)
    for _ in range(3):
        e = 0.3 * rng.normal(size=certificate.nx)
        found = motion.at(
            [arb(entry) for entry in e], None if time is None else arb(time)
        )
        expected = relative_motion(field, certificate, e, time)
        np.testing.assert_allclose(mids(found), expected, rtol=1e-11, atol=1e-12)
    rest = motion.at([arb(0)] * certificate.nx, None if time is None else arb(time))
    np.testing.assert_allclose(mids(rest), 0, atol=1e-14)


@pytest.mark.parametrize("substeps", [1, 2, 8])
def test_motion_of_the_reference_over_a_hold_stays_within_its_bounds(
    substeps: int,
) -> None:
    """x' = x + r moves by r (e^t - 1); every step is of 0.6 s."""
    x, u, hold = ca.SX.sym("x", 1), ca.SX.sym("u"), 0.6 * substeps
    dynamics = ca.Function("away", [x, u], [1e-3 + x + 0 * u])
    certificate = certificate_of(dynamics, [[1.0]], 1.0, dt=hold)
    certificate = dataclasses.replace(certificate, substeps=substeps)
    program = Program.of(certificate)
    (bound,) = _over_hold(certificate, program, frozenset({0}))
    most = 1e-3 * np.expm1(hold)
    assert most <= float(bound.lower())
    # Of each step, at most 1.5 times what is needed, 0.6 / (1 - 0.6) of the start.
    assert float(bound.upper()) <= 1e-3 * (1 + 1.5 * 0.6 / (1 - 0.6)) ** substeps


def test_time_that_is_a_variable_has_the_slope_of_the_motion() -> None:
    """In s along a ray and in t: by differences of the floats."""
    certificate = as_read(held_chen(3))
    motion, time, ray = RelativeMotion(certificate), 0.375, np.array([0.5, -1.0])
    t = RAY_AND_TIME.variable(arb(time), {3: arb(1)})
    e = [RAY_AND_TIME.variable(arb(0.25) * r, {1: arb(r)}) for r in ray]
    reference = motion.reference_stages(RAY_AND_TIME, t)
    found = motion.relative(e, t, reference)
    assert len(reference) == 3 * 4

    def at(s: float, time: float) -> Array:
        return relative_motion(chen_field, certificate, s * ray, time)

    h = 1e-4
    slopes = {
        0: at(0.25, time),
        1: (at(0.25 + h, time) - at(0.25 - h, time)) / (2 * h),
        2: (at(0.25 + h, time) - 2 * at(0.25, time) + at(0.25 - h, time)) / (2 * h**2),
        3: (at(0.25, time + h) - at(0.25, time - h)) / (2 * h),
        4: (
            at(0.25 + h, time + h) - at(0.25 - h, time + h)
            - at(0.25 + h, time - h) + at(0.25 - h, time - h)
        ) / (4 * h**2),
    }  # fmt: skip
    for k, expected in slopes.items():
        np.testing.assert_allclose(
            mids([jet.slope(k) for jet in found]), expected, rtol=1e-6, atol=1e-6
        )


def test_clock_is_looked_at_in_every_evaluation() -> None:
    certificate = as_read(chen())
    late = RelativeMotion(certificate, Deadline.after(-1.0))
    with pytest.raises(TimeIsUpError):
        late.at([arb(0), arb(0)], None)
    RelativeMotion(certificate, Deadline.after(60.0)).at([arb(0), arb(0)], None)
