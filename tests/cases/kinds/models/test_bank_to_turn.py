"""The aircraft that turns by banking, against closed forms and another integrator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.cases.kinds.planar import (
    GRAVITY_M_S2,
    Thrust,
    ThrustEquation,
    Turn,
    bank_to_turn,
)
from swarmstart.ocp import InvalidProblemError, Model, right_hand_side
from swarmstart.ocp.integration.integrators import held_step

G = 9.8
SIXTY = math.pi / 3
PRINTED = Thrust(drag=2000.0, weight=10_000.0, equation="printed")
NEWTON = Thrust(drag=2000.0, weight=10_000.0, equation="newton")

speeds = st.floats(2.0, 30.0)
headings = st.floats(-10.0, 10.0)
banks = st.floats(-SIXTY, SIXTY).filter(lambda phi: abs(phi) > 1e-3)


def rate(model: Model, x: Any, u: Any) -> Array:
    return np.ravel(right_hand_side(model)(x, u, []).full())


def flown(model: Model, x: Any, u: Any, seconds: float) -> Array:
    """Return the state after some seconds with held controls, by DOP853."""
    f = right_hand_side(model)
    found = solve_ivp(
        lambda _, y: np.ravel(f(y, u, []).full()), (0.0, seconds), x, method="DOP853",
        rtol=1e-11, atol=1e-11,
    )  # fmt: skip
    return np.asarray(found.y[:, -1])


def on_the_circle(x: Any, radius: float, seconds: float) -> Array:
    """Return the state after some seconds on a circle; left turns: radius > 0."""
    v, psi, east, north = x
    after = psi + v / radius * seconds
    return np.array(
        [
            v,
            after,
            east + radius * (math.sin(after) - math.sin(psi)),
            north - radius * (math.cos(after) - math.cos(psi)),
        ]
    )


@pytest.mark.parametrize(("turn", "of"), [("sin", math.sin), ("tan", math.tan)])
@settings(max_examples=15, deadline=None)
@given(v=speeds, psi=headings, phi=banks)
def test_a_turn_at_constant_speed_is_a_circle(
    turn: Turn, of: Any, v: float, psi: float, phi: float
) -> None:
    start = [v, psi, 3.0, -7.0]
    found = flown(bank_to_turn(turn=turn), start, [0.0, phi], 1.5)
    radius = v**2 / (G * of(phi))
    # The arc is at most 45 m: 1e-8 is above the tolerance of the integrator.
    assert found == pytest.approx(on_the_circle(start, radius, 1.5), abs=1e-8)


@settings(max_examples=15, deadline=None)
@given(v=speeds, a=st.floats(0.05, 0.4), phi=banks)
def test_the_heading_of_an_accelerated_turn_grows_with_the_logarithm_of_the_speed(
    v: float, a: float, phi: float
) -> None:
    after = flown(bank_to_turn(turn="sin"), [v, 0.0, 0.0, 0.0], [a, phi], 2.0)
    assert after[0] == pytest.approx(v + 2 * a)
    turned = G * math.sin(phi) / a * math.log1p(2 * a / v)
    assert after[1] == pytest.approx(turned, rel=1e-8)


def test_without_bank_it_flies_straight() -> None:
    after = flown(bank_to_turn(turn="tan"), [5.0, 0.6, 1.0, 2.0], [-0.5, 0.0], 4.0)
    way = 5.0 * 4 - 0.5 * 4**2 / 2
    expected = [3.0, 0.6, 1 + way * math.cos(0.6), 2 + way * math.sin(0.6)]
    assert after == pytest.approx(expected, rel=1e-10)


def test_a_bank_to_the_other_side_flies_the_mirror_image() -> None:
    for model in (bank_to_turn(turn="sin"), bank_to_turn(turn="tan")):
        left = flown(model, [4.0, 0.3, 1.0, 2.0], [0.2, 0.7], 1.0)
        right = flown(model, [4.0, -0.3, 1.0, -2.0], [0.2, -0.7], 1.0)
        assert right == pytest.approx(left * [1, -1, 1, -1], rel=1e-9)


def test_the_coordinated_turn_is_tighter_by_the_cosine_of_the_bank() -> None:
    x = [7.0, 0.1, 0.0, 0.0]
    for phi in (0.01, 0.5, SIXTY):
        printed = rate(bank_to_turn(turn="sin"), x, [0.0, phi])[1]
        coordinated = rate(bank_to_turn(turn="tan"), x, [0.0, phi])[1]
        assert printed / coordinated == pytest.approx(math.cos(phi))


@pytest.mark.parametrize(
    ("thrust", "slowest", "fastest"), [(PRINTED, -0.2, 0.4), (NEWTON, -1.96, 3.92)]
)
def test_thrust_accelerates_between_the_published_limits(
    thrust: Thrust, slowest: float, fastest: float
) -> None:
    model = bank_to_turn(turn="sin", thrust=thrust)
    x = [2.0, 0.0, 0.0, 0.0]
    found = [rate(model, x, [force, 0.0])[0] for force in (0.0, 2000.0, 6000.0)]
    assert found == pytest.approx([slowest, 0.0, fastest], abs=1e-14)
    assert thrust.acceleration(6000.0) == pytest.approx(fastest)


@pytest.mark.parametrize("equation", ["printed", "newton"])
def test_thrust_does_only_what_its_acceleration_does(equation: ThrustEquation) -> None:
    thrust = Thrust(drag=1500.0, weight=8000.0, equation=equation)
    x, phi = [3.0, 0.4, 5.0, 6.0], 0.8
    pushed = rate(bank_to_turn(turn="tan", thrust=thrust), x, [4000.0, phi])
    told = rate(bank_to_turn(turn="tan"), x, [thrust.acceleration(4000.0), phi])
    assert pushed == pytest.approx(told, rel=1e-15)


def test_at_2_m_s_and_60_degrees_it_reverses_within_a_second() -> None:
    turning = rate(bank_to_turn(turn="sin"), [2.0, 0.0, 0.0, 0.0], [0.0, SIXTY])[1]
    assert turning == pytest.approx(4.24, abs=0.005)
    assert turning > math.pi
    assert 2.0 / turning == pytest.approx(0.47, abs=0.005)  # the radius


@given(v=speeds, phi=st.floats(-SIXTY, SIXTY))
def test_no_bank_allowed_turns_faster_than_the_largest_at_the_lowest_speed(
    v: float, phi: float
) -> None:
    turning = rate(bank_to_turn(turn="sin"), [v, 0.0, 0.0, 0.0], [0.0, phi])[1]
    assert abs(turning) <= G * math.sin(SIXTY) / 2.0 + 1e-12


@pytest.mark.parametrize(("steps", "off"), [(1, 0.12), (4, 3.3e-4), (10, 8.2e-6)])
def test_error_of_runge_kutta_after_a_second_of_full_thrust_and_bank(
    steps: int, off: float
) -> None:
    start, controls = [2.0, 0.0, 0.0, 0.0], [6000.0, SIXTY]
    model = bank_to_turn(turn="sin", thrust=PRINTED)
    found = np.ravel(held_step(model, 1.0, substeps=steps)(start, controls, []).full())
    errors = np.abs(found - flown(model, start, controls, 1.0))
    assert errors[2:].max() == pytest.approx(off, rel=0.02)  # two digits


def test_names_and_sizes() -> None:
    model, pushed = bank_to_turn(turn="sin"), bank_to_turn(turn="sin", thrust=PRINTED)
    assert (model.nx, model.nu, model.np) == (4, 2, 0)
    assert model.state_names == ("speed_m_s", "heading_rad", "x_m", "y_m")
    assert model.control_names == ("acceleration_m_s2", "bank_rad")
    assert pushed.control_names == ("thrust_n", "bank_rad")
    assert GRAVITY_M_S2 == G


def test_a_turn_that_is_none_is_refused() -> None:
    with pytest.raises(
        InvalidProblemError, match=r"^turn must be sin or tan, got 'cos'$"
    ):
        bank_to_turn(turn="cos")  # type: ignore[arg-type]
