"""Matrices and bounds of a certificate: accepted up to their edge and not beyond."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set.checker.certificate_file import Certificate
from swarmstart.terminal_set.checker.findings import Verdict
from swarmstart.tests.terminal_set.checker.certificates_by_hand import certificate_of

flint = pytest.importorskip("flint")

from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    check_bounds,
    check_matrices,
    relative_error,
    reserve,
)

P = np.array([[2.0, 0.6], [0.6, 1.0]])
K = np.array([[0.5, -0.2], [0.1, 0.4]])
FREE = (None, None)


def stated(**changes: object) -> Certificate:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    found = certificate_of(
        ca.Function("f", [x, u], [-x + 0 * u]),
        P.tolist(),
        0.7,
        x_ref=(3.0, -2.0),
        u_ref=(1.0, 5.0),
        K=tuple(map(tuple, K.tolist())),
    )
    return dataclasses.replace(found, **changes)  # type: ignore[arg-type]


def bounded(**sides: tuple[float | None, ...]) -> dict[str, object]:
    names = ("u_lower", "u_upper", "x_lower", "x_upper")
    return {"bounds": {name: sides.get(name, FREE) for name in names}}


def holds(certificate: Certificate) -> list[bool]:
    return [found.verdict is Verdict.PROVED for found in check_bounds(certificate)]


INVERSE = np.linalg.inv(P)
STATES = np.sqrt(0.7 * np.diag(INVERSE))
INPUTS = np.sqrt(0.7 * np.diag(K @ INVERSE @ K.T))


@pytest.mark.parametrize("share", [1 + 1e-12, 1 - 1e-12])
@pytest.mark.parametrize("j", [0, 1])
def test_a_bound_holds_up_to_the_reach_of_the_ellipsoid(share: float, j: int) -> None:
    """By sqrt(alpha (P^-1)_jj) and sqrt(alpha K_i P^-1 K_i'), to the last digits."""
    expected = [share > 1]

    def only(value: float) -> tuple[float | None, ...]:
        return (value, None) if j == 0 else (None, value)

    x_ref, u_ref = (3.0, -2.0)[j], (1.0, 5.0)[j]
    for side, sign in (("lower", -1), ("upper", 1)):
        at = only(x_ref + sign * share * STATES[j])
        assert holds(stated(**bounded(**{f"x_{side}": at}))) == expected
        at = only(u_ref + sign * share * INPUTS[j])
        assert holds(stated(**bounded(**{f"u_{side}": at}))) == expected


def test_of_two_bounds_the_nearer_one_counts() -> None:
    near, far = 0.99 * STATES[0], 9.0
    for low, high in ((near, far), (far, near)):
        sides = {"x_lower": (3 - low, None), "x_upper": (3 + high, None)}
        assert holds(stated(**bounded(**sides))) == [False]
    sides = {"x_lower": (3 - far, None), "x_upper": (3 + far, None)}
    assert holds(stated(**bounded(**sides))) == [True]


@pytest.mark.parametrize("value", [3.5, 2.5])
def test_a_reference_outside_its_bounds_is_refused(value: float) -> None:
    side = "x_lower" if value > 3 else "x_upper"
    (found,) = check_bounds(stated(**bounded(**{side: (value, None)})))
    assert found.verdict is Verdict.REFUSED and "outside its bounds" in found.text


def test_between_samples_the_set_is_larger() -> None:
    """By sqrt(growth) + error of the map + drift."""
    held = {"dt": 0.5, "substeps": 1, "growth": 1.44, "integrator": 0.03, "drift": 0.02}
    reach = (1.2 + 0.05) * STATES[0]
    for share in (1 + 1e-12, 1 - 1e-12):
        sides = bounded(x_upper=(3 + share * reach, None))
        assert holds(stated(**held, **sides)) == [share > 1]
    assert float(relative_error(stated(**held))) == pytest.approx(0.05)
    # Of the inputs, which are held, it does not matter.
    sides = bounded(u_upper=(1 + 1.001 * INPUTS[0], None))
    assert holds(stated(**held, **sides)) == [True]


@pytest.mark.parametrize(
    ("changes", "condition"),
    [
        ({"growth": None}, "(at the samples)"),
        ({"growth": 1.1, "growth_proven": False}, "no more than was measured"),
        ({"growth": 1.1, "growth_proven": True}, ""),
    ],
)
def test_what_a_bound_between_samples_rests_on_is_said(
    changes: dict[str, object], condition: str
) -> None:
    held = {"dt": 0.5, "substeps": 1, **changes}
    (found,) = check_bounds(stated(**held, **bounded(x_upper=(9.0, None))))
    assert found.verdict is Verdict.PROVED and condition in found.text
    assert condition or "(" not in found.text


def judged(**changes: object) -> list[bool]:
    findings = check_matrices(stated(**changes))
    return [found.verdict is Verdict.PROVED for found in findings]


def test_matrices_are_symmetric_and_definite() -> None:
    assert judged() == [True, True]
    assert judged(P=((2.0, 1.5), (1.5, 1.0))) == [False, True]
    assert judged(P=((2.0, 0.6), (0.61, 1.0))) == [False, True]
    assert judged(P=((2.0, 0.6), (0.6 + 1e-10, 1.0))) == [True, True]
    assert judged(Q_m=((1.0, 0.0), (0.0, 0.0))) == [True, True]
    assert judged(Q_m=((1.0, 0.0), (0.0, -1e-8))) == [True, False]
    assert judged(Q_m=((1.0, 0.1), (0.2, 1.0))) == [True, False]
    assert judged(Q_m=((0.0, 0.0), (0.0, -1e-300))) == [True, False]


def test_a_reserve_that_is_rounded_is_raised_until_it_takes_nothing_away() -> None:
    """Q_m = diag(1, -1e-10) would let e'Pe rise; what is proven has diag(1, 9e-10)."""
    Q_m = ((1.0, 0.0), (0.0, -1e-10))
    assert judged(Q_m=Q_m) == [True, True]
    kept = reserve(stated(Q_m=Q_m))
    assert kept[1][1] > 0 and kept[0][0] >= 1
    assert float(kept[1][1]) < 1e-9
    assert reserve(stated())[0][0] == 0
    assert math.isclose(float(reserve(stated(Q_m=((4.0, 0), (0, 0))))[1][1]), 4e-9)
