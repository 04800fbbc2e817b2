import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from swarmstart.arrays import Array
from swarmstart.cases.kinds.models.close_formation import (
    CONTROLS,
    POSITION,
    STATES,
    Wingman,
    close_formation,
)
from swarmstart.cases.kinds.models.horseshoe_vortex import (
    Aircraft,
    InvalidAircraftError,
)
from swarmstart.ocp import InvalidProblemError, Model
from swarmstart.ocp.integration.integrators import held_step
from swarmstart.ocp.system.model import right_hand_side

WINGMAN = Wingman()
X = [75.0, 20.0, 0.1, 220.0, 1.5, -0.4]
U = [300.0, 0.5, -3.0]
LEADER = [250.0, math.radians(20), 0.0]
START = [60.0, 23.6, 0.0, 200.0, 0.0, 0.0]
CRUISE = [200.0, 0.0, 0.0]
EXACT = [78.477088043, 22.534459486, 0.15008428646, 221.57403744, 1.4440110201,
         -0.68320545626]  # fmt: skip
LOWER, UPPER = np.array([150, -math.pi / 4, -20]), np.array([350, math.pi / 4, 20])
EVERY_CORRECTED: list[dict[str, Any]] = [
    {"kinematics": kinematics, "aerodynamics": aerodynamics}
    for kinematics in ("fixed", "exact")
    for aerodynamics in ("linear", "vortex")
]


def rate(model: Model, x: Any = X, u: Any = U, p: Any = LEADER) -> Array:
    return np.ravel(right_hand_side(model)(x, u, p).full())


def step(x: Any, u: Any, p: Any, **how: Any) -> Array:
    return np.ravel(held_step(close_formation(WINGMAN), 0.1, **how)(x, u, p).full())


def one_step_cost(dt: float, **how: Any) -> ca.Function:
    """J(u, d) from START, with its gradient and Hessian by u."""
    u, d = ca.SX.sym("u", 3), ca.SX.sym("d", 3)
    after = held_step(close_formation(WINGMAN), dt, **how)(START, u, d)
    e = ca.vertcat(
        after[0] - 60, after[1] - 23.6, after[4], after[3] - d[0], after[2] - d[1]
    )
    J = ca.bilin(ca.diag(ca.DM([100, 100, 100, 1, 1])), e, e)
    hessian, gradient = ca.hessian(J, u)
    return ca.Function("J", [u, d], [J, gradient, hessian])


def least_one_step_cost(d: Any) -> tuple[float, Array]:
    """The minimum over the bounds, in units of the control range."""
    J, width = one_step_cost(0.1), UPPER - LOWER

    def cost(v: Array) -> tuple[float, Array]:
        value, gradient, _ = J(LOWER + width * v, d)
        return float(value), np.ravel(gradient.full()) * width

    found = minimize(
        cost, np.full(3, 0.5), jac=True, bounds=[(0, 1)] * 3, method="L-BFGS-B",
        options={"ftol": 1e-16, "gtol": 1e-9},
    )  # fmt: skip
    return float(found.fun), LOWER + width * found.x


@pytest.mark.parametrize(
    ("choices", "expected"),
    [
        ({}, [34.9036956786, 29.4934215623, 0.5355210668, 15.8370254678, -0.4,
              -4.0260268459]),
        ({"kinematics": "exact"},
         [32.9961991448, 21.46060556, 0.5355210668, 15.8370254678, -0.4,
          -4.0260268459]),
        ({"variant": "literal"},
         [34.68893981, 30.0402928911, 0.5264065447, 16.0, -0.4, 6.7540206557]),
        ({"kinematics": "exact", "aerodynamics": "vortex"},
         [33.0132102811, 21.3968137989, 0.5363716236, 15.4664422981, -0.4,
          -7.7316622263]),
    ],
)  # fmt: skip
def test_rate_of_every_variant(choices: dict[str, Any], expected: list[float]) -> None:
    assert rate(close_formation(WINGMAN, **choices)) == pytest.approx(
        expected, rel=1e-8
    )


@pytest.mark.parametrize("choices", EVERY_CORRECTED)
def test_the_slot_at_the_speed_of_the_leader_is_an_equilibrium(
    choices: dict[str, Any],
) -> None:
    model = close_formation(WINGMAN, **choices)
    x, y, z = WINGMAN.slot_ft
    found = rate(model, x=[x, y, LEADER[1], LEADER[0], z, 0.0], u=LEADER)
    assert found == pytest.approx(np.zeros(6), abs=1e-13)


def test_the_linear_wake_is_the_tangent_of_the_vortex_in_the_slot() -> None:
    x, y, z = WINGMAN.slot_ft
    at = [x, y, LEADER[1], LEADER[0], z, 0.0]
    linear, vortex = (
        ca.Function(
            "A", [m.states, m.controls, m.parameters], [ca.jacobian(m.ode, m.states)]
        )(at, LEADER, LEADER).full()
        for m in (
            close_formation(WINGMAN, aerodynamics=which)
            for which in ("linear", "vortex")
        )
    )
    assert linear == pytest.approx(vortex, rel=1e-12, abs=1e-13)


def test_fixed_and_exact_kinematics_are_the_same_in_the_slot() -> None:
    x, y, _ = WINGMAN.slot_ft
    turning = [x, y, 0.1, 220.0, 1.5, -0.4]
    fixed, exact = (
        rate(close_formation(WINGMAN, kinematics=which), x=turning)
        for which in ("fixed", "exact")
    )
    assert fixed == pytest.approx(exact, rel=1e-14)


def test_the_vortex_pushes_to_the_leader_on_either_side() -> None:
    model = close_formation(WINGMAN, kinematics="exact", aerodynamics="vortex")
    commands = [200.0, 0.0, 0.0]
    left, right = (
        rate(model, x=[60.0, side * 23.6, 0.0, 200.0, 2.0, 0.0], u=commands, p=CRUISE)
        for side in (1, -1)
    )
    in_slot = WINGMAN.aircraft.acceleration_ft_s2 / 200.0 * 0.00956662
    assert left[2] + in_slot == pytest.approx(-(right[2] + in_slot), rel=1e-4)
    assert left[[3, 5]] == pytest.approx(right[[3, 5]], rel=1e-12)


def test_the_printed_equations_hold_the_height_only_by_a_constant_command() -> None:
    model = close_formation(WINGMAN, variant="literal")
    _, y, _ = WINGMAN.slot_ft
    at = [60.0, y, 0.0, 200.0, 0.0, 0.0]
    climb = rate(model, x=at, u=CRUISE, p=CRUISE)[5]
    assert climb == pytest.approx(10.8, abs=0.05)
    held = rate(model, x=at, u=[200.0, 0.0, -climb * 0.3075 * 3.85], p=CRUISE)[5]
    assert held == pytest.approx(0.0, abs=1e-12)
    assert -climb * 0.3075 * 3.85 == pytest.approx(-12.8, abs=0.05)


def test_the_printed_drag_term_does_nothing() -> None:
    model = close_formation(WINGMAN, variant="literal")
    assert rate(model)[3] == (300.0 - 220.0) / 5.0


def test_values_of_one_step() -> None:
    assert step(X, U, LEADER) == pytest.approx(
        [78.477073290, 22.534436316, 0.15008413951, 221.57403808, 1.4439713172,
         -0.68306952927], rel=1e-8,
    )  # fmt: skip
    assert step(X, U, LEADER, method="euler") == pytest.approx(
        [78.490369568, 22.949342156, 0.15355210668, 221.58370255, 1.46,
         -0.80260268459], rel=1e-8,
    )  # fmt: skip
    assert step(X, U, LEADER, substeps=200) == pytest.approx(EXACT, rel=1e-8)


def test_an_independent_integrator_gives_the_exact_step() -> None:
    f = right_hand_side(close_formation(WINGMAN))
    found = solve_ivp(
        lambda _, x: np.ravel(f(x, U, LEADER).full()), (0.0, 0.1), X, method="DOP853",
        rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    assert found.y[:, -1] == pytest.approx(EXACT, rel=1e-8)


def test_one_runge_kutta_step_is_within_2e_4_of_the_exact_step() -> None:
    assert np.abs(step(X, U, LEADER) - EXACT).max() < 2e-4


@pytest.mark.parametrize(
    ("u", "expected"),
    [
        (LEADER, 7497.199668),
        ([350.0, math.pi / 4, 0.0], 6080.402889),
        ([200.0, 0.0, 0.0], 11045.625936),
    ],
)
def test_cost_of_one_step_after_the_leader_turned(u: Any, expected: float) -> None:
    assert float(one_step_cost(0.1)(u, LEADER)[0]) == pytest.approx(expected, rel=1e-6)


def test_the_least_cost_of_one_step_has_the_speed_at_its_bound() -> None:
    least, u = least_one_step_cost(LEADER)
    assert least == pytest.approx(6025.352726, rel=1e-6)
    assert u[0] == 350.0
    assert u[1:] == pytest.approx([0.7081582, -0.4843452], abs=1e-6)


def test_behind_a_leader_that_flies_on_the_least_cost_of_one_step_is_zero() -> None:
    least, u = least_one_step_cost(CRUISE)
    assert least == pytest.approx(0.0, abs=1e-9)
    assert u[0] == pytest.approx(199.9913, abs=1e-3)
    assert u[1] == pytest.approx(1.214e-5, abs=1e-7)
    assert u[2] == pytest.approx(-0.0206124, abs=1e-5)


def test_sensitivities_of_one_step() -> None:
    u = ca.SX.sym("u", 3)
    after = held_step(close_formation(WINGMAN), 0.1, substeps=100)(START, u, CRUISE)
    K = ca.Function("K", [u], [ca.jacobian(after, u)])(CRUISE).full()
    x, y, V, z = 0, 1, 3, 4
    assert K[x, 0] == pytest.approx(-9.934e-4, abs=5.1e-8)
    assert K[V, 0] == pytest.approx(0.019801, abs=5.1e-7)
    assert K[x, 1] == pytest.approx(2.9459, abs=5.1e-5)
    assert K[y, 1] == pytest.approx(-8.7772, abs=5.1e-5)
    assert K[z, 2] == pytest.approx(0.0037670, abs=5.1e-8)


@pytest.mark.parametrize(
    ("dt", "expected"),
    [
        (0.1, [4.54, 38.5, 4.23e4]),
        (0.02, [0.0087, 1.29, 1504]),
        (0.01, [5.6e-4, 0.32, 370]),
    ],
)
def test_a_shorter_step_hides_height_and_speed_from_its_cost(
    dt: float, expected: list[float]
) -> None:
    _, _, hessian = one_step_cost(dt, substeps=20)(CRUISE, CRUISE)
    width = np.diag(UPPER - LOWER)
    found = np.linalg.eigvalsh(width @ hessian.full() @ width)
    assert found == pytest.approx(expected, rel=6e-3)  # two or three digits


@pytest.mark.parametrize("choices", [*EVERY_CORRECTED, {"variant": "literal"}])
def test_a_gust_adds_to_the_rate_of_the_position_only(choices: dict[str, Any]) -> None:
    calm = rate(close_formation(WINGMAN, **choices))
    model = close_formation(WINGMAN, gusts=True, **choices)
    gusty = rate(model, p=[*LEADER, 3.0, -6.0, 1.0])
    expected = np.zeros(6)
    expected[list(POSITION)] = 3.0, -6.0, 1.0
    assert gusty - calm == pytest.approx(expected, abs=1e-13)
    assert rate(model, p=[*LEADER, 0.0, 0.0, 0.0]) == pytest.approx(calm, rel=1e-15)


def test_names_and_sizes() -> None:
    calm, gusty = (close_formation(WINGMAN, gusts=gusts) for gusts in (False, True))
    assert (calm.nx, calm.nu, calm.np, gusty.np) == (6, 3, 3, 6)
    assert (calm.state_names, calm.control_names) == (STATES, CONTROLS)


def test_the_slot_follows_the_span() -> None:
    wingman = Wingman(aircraft=Aircraft(span_ft=40.0))
    assert WINGMAN.slot_ft == pytest.approx((60.0, 23.561945, 0.0), abs=1e-6)
    assert wingman.slot_ft == pytest.approx((80.0, 10 * math.pi, 0.0))


@pytest.mark.parametrize(
    "name", ["speed_lag_s", "heading_lag_s", "height_lag_a_s", "height_lag_b_s"]
)
@pytest.mark.parametrize("value", [0.0, -0.75, math.nan])
def test_a_lag_that_is_not_positive_is_refused(name: str, value: float) -> None:
    lag: dict[str, Any] = {name: value}
    with pytest.raises(
        InvalidAircraftError, match=f"^{name} must be positive and finite, got {value}$"
    ):
        Wingman(**lag)


@pytest.mark.parametrize("role", ["variant", "kinematics", "aerodynamics"])
def test_an_unknown_choice_is_refused(role: str) -> None:
    choice: dict[str, Any] = {role: "guessed"}
    with pytest.raises(
        InvalidProblemError, match=f"^{role} must be one of .*, got 'guessed'$"
    ):
        close_formation(WINGMAN, **choice)


def test_the_printed_equations_have_no_vortex() -> None:
    with pytest.raises(InvalidProblemError, match=r"linear or none, got 'vortex'$"):
        close_formation(WINGMAN, variant="literal", aerodynamics="vortex")


def test_a_higher_leader_is_seen_higher_and_its_command_follows_it() -> None:
    """z is the wingman's height above the leader: (5.20) has h_Wc - h_Lc.

    At rest in z, without a wake, the height is the difference of the commands: -7 ft if
    the leader commands 7 ft more than its wingman.
    """
    model = close_formation(WINGMAN, aerodynamics="none")
    for own, leaders in ((0.0, 7.0), (7.0, 0.0), (12.0, 5.0)):
        x = [60.0, 23.6, 0.0, 200.0, own - leaders, 0.0]
        still = rate(model, x, [200.0, 0.0, own], [200.0, 0.0, leaders])
        np.testing.assert_allclose(still, 0.0, atol=1e-12)
    lags = WINGMAN.height_lag_a_s * WINGMAN.height_lag_b_s
    level = rate(model, START, [200.0, 0.0, 0.0], [200.0, 0.0, 7.0])
    assert level[5] == pytest.approx(-7.0 / lags)
