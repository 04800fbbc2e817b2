"""Statements on V: at points against floats, on sets up to the first failing level."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

flint = pytest.importorskip("flint")

from swarmstart.arrays import Array  # noqa: E402
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    change_of,
    decrease_task,
    growth_task,
    margin_of_map,
    prove_on_set,
)
from swarmstart.terminal_set.checker.findings import (  # noqa: E402
    NEVER,
    Deadline,
    TimeIsUpError,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (  # noqa: E402
    Content,
    chen,
    scalar,
    signed,
)
from swarmstart.tests.terminal_set.checker.changes import (  # noqa: E402
    change_at,
    excess_at,
    point,
    thin,
    violates,
)
from swarmstart.tests.terminal_set.checker.systems import (  # noqa: E402
    as_read,
    change,
    chen_field,
    relative_motion,
)

Q_M = [[0.5, 0.125], [0.125, 0.25]]
CORE = {"level": 1e-9, "drift": 0.03125}


def held(growth: float | None = 1.5, **changes: object) -> Content:
    between = None if growth is None else {"growth": growth, "grounds": "proven"}
    margin = {"relative_error": 0.0625, "grounds": "measured", "samples": 1}
    return chen(
        dt=0.25, substeps=2, Q_m=Q_M, statements=[], alpha=0.5, refuted=None,
        core=CORE, margins={"integrator": margin, "between_samples": between},
        **changes,
    )  # fmt: skip


def moving() -> Content:
    return chen(Q_m=Q_M, core=CORE, refuted=None, alpha=0.5)


def points() -> list[Array]:
    return list(0.1 * np.random.default_rng(0).normal(size=(4, 2)))


def test_margin_is_that_of_the_map_and_the_drift_together() -> None:
    error = 0.0625 + 0.03125
    assert float(margin_of_map(as_read(held()))) == 2 * error + error**2


@pytest.mark.parametrize("content", [moving(), held()])
def test_change_at_a_point_is_that_of_the_definition(content: Content) -> None:
    certificate = as_read(content)
    P = np.array(certificate.P)
    for e in points():
        V = float(e @ P @ e)
        level = thin(change_of(certificate).level(point(e)))
        assert level == pytest.approx(V, rel=1e-13)
        error = 0.0625 + 0.03125
        more = 2 * 0.03125 * V if certificate.dt is None else (2 * error + error**2) * V
        expected = change(chen_field, certificate, e) + more
        found = change_at(certificate, e)
        assert found == pytest.approx(expected, rel=1e-12)


def test_excess_is_what_v_grows_beyond_its_bound_at_a_time() -> None:
    certificate = as_read(held())
    P = np.array(certificate.P)
    for e in points():
        for time in (0.0, 0.125, 0.25):
            moved = relative_motion(chen_field, certificate, e, time)
            found = excess_at(certificate, e, time)
            expected = moved @ P @ moved - 1.5 * e @ P @ e
            assert found == pytest.approx(expected, rel=1e-12)


def test_counterexamples_are_inside_the_set_and_not_its_centre() -> None:
    """x' = +e: V rises everywhere, in the set (|e| <= 1) and beyond."""
    content = scalar()
    content["dynamics"]["tape"][2] = ["sub", 0, 1]
    rising = as_read(signed(content))
    for e in (1.0 - 1e-12, -0.5):
        assert violates(rising, (e,))
    for e in (0.0, 1.0000001, -1.1):
        assert not violates(rising, (e,))
    still = dataclasses.replace(rising, tape=(("const", (), 0.0),), xdot=(0,))
    # Equal, but for what rounding leaves open.
    assert abs(change_at(still, (0.5,))) < 1e-150
    assert not violates(as_read(scalar()), (0.5,))


@pytest.mark.parametrize("content", [moving(), held()])
def test_decrease_is_stated_with_its_margins(content: Content) -> None:
    certificate = as_read(content)
    change, P = decrease_task(certificate).change, np.array(certificate.P)
    M, error = np.array(change.M, dtype=float), 0.0625 + 0.03125
    weight = 2 * 0.03125 if certificate.dt is None else 2 * error + error**2 - 1
    np.testing.assert_allclose(M, np.array(Q_M) + weight * P, rtol=1e-6)
    np.testing.assert_array_equal(np.array(change.P, dtype=float), P)
    assert change.time == certificate.dt


def test_growth_is_stated_for_its_times_without_a_reserve() -> None:
    task = growth_task(as_read(held()))
    P = np.array(as_read(held()).P)
    np.testing.assert_array_equal(np.array(task.change.M, dtype=float), -1.5 * P)
    assert task.times is not None
    assert (task.times[0], task.times[-1], len(task.T)) == (0.0, 0.25, 64)
    assert (np.diff(task.times) > 0.0).all()


@pytest.mark.parametrize(("share", "proven"), [(0.97, True), (1.03, False)])
def test_cubic_system_is_proven_up_to_its_pole_and_not_beyond(
    share: float, proven: bool
) -> None:
    """x' = -x + x^3: V falls up to |e| = 1."""
    content = scalar(alpha=share)
    content["dynamics"] = {
        "nx": 1, "nu": 1,
        "tape": [["x", 0], ["sq", 0], ["mul", 0, 1], ["sub", 2, 0]], "xdot": [3],
    }  # fmt: skip
    found = prove_on_set(decrease_task(as_read(signed(content))), NEVER)
    assert found.proven is proven
    assert (found.counterexample is None) is proven
    with pytest.raises(TimeIsUpError):
        decrease_task(as_read(signed(content)), Deadline.after(-1.0))


@pytest.mark.parametrize(("share", "proven"), [(1.001, True), (0.999, False)])
def test_growth_is_proven_down_to_what_it_is(share: float, proven: bool) -> None:
    """x' = +e held 0.25 s: at the end V is the square of Runge-Kutta's polynomial."""
    content = scalar(dt=0.25)
    content["dynamics"]["tape"][2] = ["sub", 0, 1]
    h = 0.25
    exact = (1 + h + h**2 / 2 + h**3 / 6 + h**4 / 24) ** 2
    between = {"growth": share * exact, "grounds": "proven"}
    content["margins"]["between_samples"] = between
    certificate = as_read(signed(content))
    found = prove_on_set(growth_task(certificate), NEVER)
    assert found.proven is proven
    if not proven:
        assert found.counterexample is not None
        assert excess_at(certificate, found.counterexample, 0.25) > 0.0
