"""The motion in balls: against the same formulas in floats, written by hand."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

flint = pytest.importorskip("flint")

from flint import arb  # noqa: E402

from swarmstart.terminal_set.checker.file_content import (  # noqa: E402
    BINARY,
    UNARY,
)
from swarmstart.terminal_set.checker.findings import (  # noqa: E402
    Deadline,
    TimeIsUpError,
)
from swarmstart.terminal_set.checker.models import algebra_of  # noqa: E402
from swarmstart.terminal_set.checker.motion import (  # noqa: E402
    BALLS,
    RelativeMotion,
    _fastest,
    _over_hold,
    program_of,
    rate_in_balls,
)
from swarmstart.terminal_set.checker.rays import Along  # noqa: E402
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (  # noqa: E402
    certificate_of,
    chen,
    formation,
    replaced,
    signed,
)
from swarmstart.tests.terminal_set.checker.changes import (  # noqa: E402
    point,
    thin,
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
    assert [number for number, _ in program_of(dead).steps] == list(range(15))
    shorter = as_read(signed(replaced(content, ("dynamics", "xdot"), [1, 5])))
    program = program_of(shorter)
    assert [number for number, _ in program.steps] == [0, 1, 4, 5]
    assert program.outputs == (1, 5) and program.points == {0, 1}


def test_rate_is_that_of_the_tape() -> None:
    program = program_of(as_read(moving_chen()))
    x, u = np.array([0.3, -1.7]), np.array([0.9])
    balls = [[arb(entry) for entry in v] for v in (x, u)]
    found = mids(rate_in_balls(program, *balls))
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
    program, both = program_of(certificate), frozenset({0, 1})
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
        found = motion.relative(point(e), None if time is None else Fraction(time))
        expected = relative_motion(field, certificate, e, time)
        values = [thin(entry) for entry in found]
        np.testing.assert_allclose(values, expected, rtol=1e-11, atol=1e-12)
    rest = motion.relative(
        point([0.0] * certificate.nx), None if time is None else Fraction(time)
    )
    np.testing.assert_allclose([thin(entry) for entry in rest], 0, atol=1e-14)


@pytest.mark.parametrize("substeps", [1, 2, 8])
def test_motion_of_the_reference_over_a_hold_stays_within_its_bounds(
    substeps: int,
) -> None:
    """x' = x + r moves by r (e^t - 1); every step is of 0.6 s."""
    x, u, hold = ca.SX.sym("x", 1), ca.SX.sym("u"), 0.6 * substeps
    dynamics = ca.Function("away", [x, u], [1e-3 + x + 0 * u])
    certificate = certificate_of(dynamics, [[1.0]], 1.0, dt=hold)
    certificate = dataclasses.replace(certificate, substeps=substeps)
    program = program_of(certificate)
    (bound,) = _over_hold(certificate, program, frozenset({0}))
    most = 1e-3 * np.expm1(hold)
    assert most <= float(bound.lower())
    # Of each step, at most 1.5 times what is needed, 0.6 / (1 - 0.6) of the start.
    assert float(bound.upper()) <= 1e-3 * (1 + 1.5 * 0.6 / (1 - 0.6)) ** substeps


def test_time_that_is_a_variable_encloses_the_motion_of_every_instant() -> None:
    """And along rays from the centre, over the distance from it."""
    certificate = as_read(held_chen(3))
    motion, ray = RelativeMotion(certificate), np.array([0.5, -1.0])
    algebra = algebra_of(2)
    middle, radius = np.array([0.25]), np.array([0.25])
    s = algebra.variable(0, middle, radius)  # from 0 to 0.5
    t = algebra.variable(1, np.array([0.375]), np.array([0.0625]))
    direct = motion.relative([s.scaled(r) for r in ray], t)
    zero = s.number(0.0)
    along = motion.run([Along(zero, s.number(r), s) for r in ray], Along(t, zero, s))
    rng = np.random.default_rng(0)
    for _ in range(50):
        at, time = rng.uniform(1e-2, 0.5), rng.uniform(0.3125, 0.4375)
        exact = relative_motion(chen_field, certificate, at * ray, time)
        for found, size in ((direct, 1.0), ([a.slope for a in along], at)):
            low = np.array([one.lower[0] for one in found])
            high = np.array([one.upper[0] for one in found])
            assert (low - 1e-12 <= exact / size).all()
            assert (exact / size <= high + 1e-12).all()
            assert (high - low < 2.0).all()


def test_clock_is_looked_at_in_every_evaluation() -> None:
    certificate = as_read(chen())
    late = RelativeMotion(certificate, Deadline.after(-1.0))
    with pytest.raises(TimeIsUpError):
        late.relative(point([0.0, 0.0]), None)
    RelativeMotion(certificate, Deadline.after(60.0)).relative(point([0.0, 0.0]), None)


@pytest.mark.parametrize("name", sorted(UNARY | BINARY))
def test_operations_on_balls_enclose_those_on_floats(name: str) -> None:
    """Over a ball around 0.65, and around -0.65 if it is defined there."""
    scalars: dict[str, Callable[..., float]] = {
        "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b,
        "div": lambda a, b: a / b, "pow": lambda a, b: a**b, "fmin": min, "fmax": max,
        "neg": lambda a: -a, "sq": lambda a: a * a, "twice": lambda a: 2 * a,
        "inv": lambda a: 1 / a, "fabs": abs,
    }  # fmt: skip
    assert set(BALLS) == UNARY | BINARY
    function = scalars.get(name) or getattr(math, name)
    for side in (1.0, -1.0) if name not in ("log", "sqrt") else (1.0,):
        for b in (0.5, 2.0, 3.0, -2.0) if name in BINARY else (None,):
            if name == "pow" and side < 0 and b == 0.5:
                continue
            others = [] if b is None else [b]
            ball = side * arb(0.4).union(arb(0.9))
            found = BALLS[name](ball, *map(arb, others)) + arb(0, 1e-15)
            for x in side * np.linspace(0.4, 0.9, 11):
                assert found.contains(arb(function(float(x), *others)))
            assert found.rad() < 20.0
