import math
import pickle

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from swarmstart.cases.kinds.models.horseshoe_vortex import (
    Aircraft,
    InvalidAircraftError,
    derivatives,
    drag_saving,
    increments,
    sidewash,
    upwash,
)

AIRCRAFT = Aircraft()
YBAR = math.pi * 30 / 4
ROUNDED = 1e-5
"""Relative tolerance: expected values are rounded to six digits, 5e-6 at worst."""


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("mass_slug", 777.0249),
        ("dynamic_pressure_lb_ft2", 157.224),
        ("acceleration_ft_s2", 60.70244),
        ("lift_coefficient", 0.530028),
        ("aspect_ratio", 3.0),
        ("induced_drag", 0.0298076),
        ("vortex_separation_ft", 23.561945),
        ("circulation_ft", 3.374264),
        ("squared_core_ft2", 9.0),
        ("side_force_slope", 0.9188875),
    ],
)
def test_derived_quantities_of_the_default_aircraft(name: str, expected: float) -> None:
    assert getattr(AIRCRAFT, name) == pytest.approx(expected, rel=3e-6)


def test_lift_carries_the_weight() -> None:
    lift = AIRCRAFT.acceleration_ft_s2 * AIRCRAFT.lift_coefficient
    assert lift == pytest.approx(AIRCRAFT.gravity_ft_s2, rel=1e-14)


@pytest.mark.parametrize(
    ("y", "expected"),
    [
        (10.0, -0.033212), (15.0, -0.009235), (17.27, 0.001683), (20.0, 0.015927),
        (28.0, 0.023999), (34.0, 0.014157), (40.39, 0.009225), (50.0, 0.005641),
    ],
)  # fmt: skip
def test_upwash_beside_the_leader(y: float, expected: float) -> None:
    assert upwash(AIRCRAFT, y, 0.0) == pytest.approx(expected, abs=5.1e-7)


@pytest.mark.parametrize(
    ("z", "expected"),
    [(1.0, 0.030332), (3.0, 0.023913), (5.0, 0.017212), (10.0, 0.006293)],
)
def test_upwash_above_the_slot(z: float, expected: float) -> None:
    assert upwash(AIRCRAFT, YBAR, z) == pytest.approx(expected, abs=5.1e-7)


@pytest.mark.parametrize("y", [3.0, YBAR, 40.0])
@pytest.mark.parametrize("z", [0.0, -6.0])
def test_upwash_is_the_mean_of_two_vortices_over_the_span(y: float, z: float) -> None:
    bp, M, G = YBAR, AIRCRAFT.squared_core_ft2, AIRCRAFT.circulation_ft

    def point_upwash(eta: float) -> float:
        near, far = eta - bp / 2, eta + bp / 2
        return (
            G
            / (2 * math.pi)
            * (near / (near**2 + z**2 + M) - far / (far**2 + z**2 + M))
        )

    integral, _ = quad(point_upwash, y - bp / 2, y + bp / 2, epsabs=1e-13)
    assert upwash(AIRCRAFT, y, z) == pytest.approx(integral / bp, rel=1e-9)


@pytest.mark.parametrize("y", [3.0, YBAR, 40.0])
@pytest.mark.parametrize("z", [0.0, -6.0])
def test_sidewash_is_the_mean_of_two_vortices_over_the_fin(y: float, z: float) -> None:
    bp, M, G = YBAR, AIRCRAFT.squared_core_ft2, AIRCRAFT.circulation_ft
    near, far = (y - bp / 2) ** 2 + M, (y + bp / 2) ** 2 + M

    def point_sidewash(height: float) -> float:
        rate = height / (near + height**2) - height / (far + height**2)
        return G / (2 * math.pi) * rate

    h = AIRCRAFT.fin_height_ft
    integral, _ = quad(point_sidewash, z, z + h, epsabs=1e-13)
    assert sidewash(AIRCRAFT, y, z) == pytest.approx(integral / h, rel=1e-9)


@pytest.mark.parametrize("y", [0.0, 0.7, 12.0, YBAR])
@pytest.mark.parametrize("z", [0.0, 2.5, -4.0])
def test_lift_and_drag_are_even_in_y_and_side_force_is_odd(y: float, z: float) -> None:
    right, left = increments(AIRCRAFT, y, z), increments(AIRCRAFT, -y, z)
    mirrored = (right.C_L, right.C_D, -right.C_Y)
    assert left == pytest.approx(mirrored, rel=1e-12, abs=1e-17)


def test_upwash_is_even_in_height() -> None:
    assert upwash(AIRCRAFT, 20.0, 4.0) == upwash(AIRCRAFT, 20.0, -4.0)


def test_increments_in_the_slot() -> None:
    assert upwash(AIRCRAFT, YBAR, 0.0) == pytest.approx(0.0314974, rel=ROUNDED)
    assert sidewash(AIRCRAFT, YBAR, 0.0) == pytest.approx(0.0104111, rel=ROUNDED)
    assert increments(AIRCRAFT, YBAR, 0.0) == pytest.approx(
        (0.166936, -0.0166945, 0.00956662), rel=ROUNDED
    )


def test_derivatives_in_the_slot() -> None:
    found = derivatives(AIRCRAFT, YBAR, 0.0)
    assert found.C_Ly == pytest.approx(0.00753708, rel=ROUNDED)
    assert found.C_Dy == pytest.approx(-0.000753748, rel=ROUNDED)
    assert found.C_Yy == pytest.approx(-0.00140197, rel=ROUNDED)
    assert found.C_Yz == pytest.approx(0.00195674, rel=ROUNDED)
    assert found.C_Ly / AIRCRAFT.lift_slope_per_rad == pytest.approx(
        0.00142209, rel=ROUNDED
    )


def test_lift_and_drag_do_not_change_with_height_at_the_height_of_the_leader() -> None:
    found = derivatives(AIRCRAFT, YBAR, 0.0)
    assert abs(found.C_Lz) < 1e-12
    assert abs(found.C_Dz) < 1e-12


def test_accelerations_of_a_foot_off_the_slot() -> None:
    found, qSm = derivatives(AIRCRAFT, YBAR, 0.0), AIRCRAFT.acceleration_ft_s2
    assert qSm * found.C_Ly == pytest.approx(0.45752, abs=5e-6)
    assert qSm * found.C_Ly * 0.3075 * 3.85 == pytest.approx(0.5416, abs=5e-5)
    assert qSm * found.C_Dy == pytest.approx(-0.04575, abs=5e-6)
    assert qSm * found.C_Yy == pytest.approx(-0.08510, abs=5e-6)
    assert qSm * found.C_Yz == pytest.approx(0.11878, abs=5e-6)


@pytest.mark.parametrize("y", [2.0, YBAR, 60.0, -17.0])
@pytest.mark.parametrize("z", [0.0, 3.0, -9.0])
def test_derivatives_agree_with_automatic_differentiation(y: float, z: float) -> None:
    position = ca.SX.sym("position", 2)
    of = ca.vertcat(*increments(AIRCRAFT, position[0], position[1]))
    jacobian = ca.Function("J", [position], [ca.jacobian(of, position)])
    expected = np.ravel(jacobian([y, z]).full())
    # 1e-16 of increments of order 0.1 [-], cancelled over feet
    assert derivatives(AIRCRAFT, y, z) == pytest.approx(expected, rel=1e-11, abs=1e-15)


def test_curvature_of_the_upwash_in_the_slot() -> None:
    position = ca.SX.sym("position", 2)
    hessian, _ = ca.hessian(upwash(AIRCRAFT, position[0], position[1]), position)
    found = ca.Function("H", [position], [hessian])([YBAR, 0.0]).full()
    assert np.diag(found) == pytest.approx([-0.0026005, -0.0024619], abs=1e-7)


@pytest.mark.parametrize(
    ("core", "saved", "optimum", "expected"),
    [
        (0.0025, 0.8367, 23.705, (0.047056, 0.007652, -0.0007652, -0.001523, 0.002032)),
        (0.005, 0.6977, 23.847, (0.039237, 0.007613, -0.0007613, -0.001481, 0.002006)),
        (0.01, 0.5601, 24.128, (0.031497, 0.007537, -0.0007537, -0.001402, 0.001957)),
        (0.02, 0.4252, 24.681, (0.023913, 0.007389, -0.0007389, -0.001261, 0.001864)),
        (0.04, 0.2957, 25.752, (0.016627, 0.007107, -0.0007107, -0.001034, 0.001701)),
    ],
)
def test_a_larger_core_weakens_the_wake_and_moves_the_optimum_outward(
    core: float, saved: float, optimum: float, expected: tuple[float, ...]
) -> None:
    aircraft = Aircraft(core_fraction=core, parasitic_drag=0.0)
    C = derivatives(aircraft, YBAR, 0.0)
    found = (upwash(aircraft, YBAR, 0.0), C.C_Ly, C.C_Dy, C.C_Yy, C.C_Yz)
    best = minimize_scalar(
        lambda y: -upwash(aircraft, y, 0.0), bounds=(18.0, 32.0), method="bounded",
        options={"xatol": 1e-6},
    )  # fmt: skip
    assert drag_saving(aircraft, YBAR, 0.0) == pytest.approx(saved, abs=5.1e-5)
    assert best.x == pytest.approx(optimum, abs=5.1e-4)
    assert found == pytest.approx(expected, abs=5.1e-7)
    assert found[2] == pytest.approx(expected[2], abs=5.1e-8)


def test_share_of_the_total_drag_saved() -> None:
    assert drag_saving(AIRCRAFT, YBAR, 0.0) == pytest.approx(0.33518, abs=5.1e-6)
    assert drag_saving(AIRCRAFT, 23.6, 0.0) == pytest.approx(0.33574, abs=5.1e-6)
    assert drag_saving(AIRCRAFT, 24.128, 0.0) == pytest.approx(0.33939, abs=5.1e-6)
    assert upwash(AIRCRAFT, 24.128, 0.0) == pytest.approx(0.031893, abs=5.1e-7)


def test_share_of_the_induced_drag_saved_is_that_without_parasitic_drag() -> None:
    increment = increments(AIRCRAFT, YBAR, 0.0)
    alone = drag_saving(Aircraft(parasitic_drag=0.0), YBAR, 0.0)
    assert alone == pytest.approx(-increment.C_D / AIRCRAFT.induced_drag, rel=1e-14)
    assert alone == pytest.approx(0.5601, abs=5.1e-5)


def test_only_the_drag_acceleration_depends_on_the_dynamic_pressure() -> None:
    slow = Aircraft(speed_ft_s=225.0, air_density_slug_ft3=2.377e-3)  # sea level
    pressure = slow.dynamic_pressure_lb_ft2 / AIRCRAFT.dynamic_pressure_lb_ft2
    assert pressure == pytest.approx(0.383, abs=5e-4)
    here, there = (
        np.array(derivatives(a, YBAR, 0.0)) * a.acceleration_ft_s2
        for a in (AIRCRAFT, slow)
    )
    lift, drag, side = slice(0, 2), slice(2, 4), slice(4, 6)
    assert there[lift] == pytest.approx(here[lift], rel=1e-12)
    assert there[side] == pytest.approx(here[side], rel=1e-12)
    assert there[drag] == pytest.approx(here[drag] / pressure, rel=1e-12)
    assert 1 / pressure == pytest.approx(2.61, abs=5e-3)


@pytest.mark.parametrize(("density", "expected"), [(2.377e-3, 1.75), (4.62e-4, 9.0)])
def test_no_such_aircraft_flies_level_at_the_speed_of_the_text(
    density: float, expected: float
) -> None:
    text = Aircraft(speed_ft_s=200.0, air_density_slug_ft3=density)
    assert text.lift_coefficient == pytest.approx(expected, abs=0.03)


@pytest.mark.parametrize(
    "name",
    [
        "span_ft", "wing_area_ft2", "weight_lb", "air_density_slug_ft3", "speed_ft_s",
        "lift_slope_per_rad", "core_fraction", "fin_efficiency", "fin_area_ft2",
        "fin_height_ft", "gravity_ft_s2",
    ],
)  # fmt: skip
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_a_number_that_is_not_positive_is_refused(name: str, value: float) -> None:
    with pytest.raises(
        InvalidAircraftError, match=f"^{name} must be positive and finite, got {value}$"
    ):
        Aircraft(**{name: value})


@pytest.mark.parametrize("value", [-0.01, math.inf, math.nan])
def test_a_negative_parasitic_drag_is_refused(value: float) -> None:
    with pytest.raises(
        InvalidAircraftError, match=f"^parasitic_drag must be zero or .*, got {value}$"
    ):
        Aircraft(parasitic_drag=value)


def test_the_error_carries_its_parts_through_a_pickle() -> None:
    error = pickle.loads(
        pickle.dumps(InvalidAircraftError("span_ft", -1.0, "positive"))
    )
    assert (error.name, error.value, error.allowed) == ("span_ft", -1.0, "positive")
    assert str(error) == "span_ft must be positive, got -1.0"
