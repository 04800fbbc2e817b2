"""Closed forms: what is stated of matrices and bounds, just inside and just outside."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("flint")

from swarmstart.terminal_set.checker.ellipsoid_statements import (
    check_bounds,
    check_matrices,
    relative_error,
    reserve,
)
from swarmstart.terminal_set.checker.findings import Finding, Verdict
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (
    Content,
    chen,
    formation,
    replaced,
    scalar,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import as_read

P = np.array([[16.5926, 11.5926], [11.5926, 16.5926]])
NONE = [None, None]


def verdicts(findings: list[Finding]) -> list[bool]:
    assert {f.verdict for f in findings} <= {Verdict.PROVED, Verdict.REFUSED}
    return [finding.verdict is Verdict.PROVED for finding in findings]


@pytest.mark.parametrize(
    ("matrix", "holds"),
    [
        ([[2.0, 1.0], [1.0, 2.0]], True),
        ([[2.0, 1.0 + 1e-8], [1.0, 2.0]], False),
        ([[2.0, 1.0], [1.0 + 1e-8, 2.0]], False),
        ([[2.0, 1.0 + 1e-10], [1.0, 2.0]], True),
        ([[1.0, 1.001], [1.001, 1.0]], False),
        ([[1.0, 0.999], [0.999, 1.0]], True),
        ([[-1.0, 0.0], [0.0, -1.0]], False),
    ],
)
def test_p_is_symmetric_to_rounding_and_definite(
    matrix: list[list[float]], holds: bool
) -> None:
    assert verdicts(check_matrices(as_read(chen(P=matrix)))) == [holds, True]


@pytest.mark.parametrize(
    ("matrix", "holds"),
    [
        ([[0.0, 0.0], [0.0, 0.0]], True),
        ([[1.0, 1.0], [1.0, 1.0]], True),  # Semidefinite: rounding is given back.
        ([[1.0, 1.0 + 1e-8], [1.0 + 1e-8, 1.0]], False),
        ([[1.0, 0.5], [0.25, 1.0]], False),
        ([[1.0, 0.0], [0.0, -1e-8]], False),
        ([[0.0, 0.0], [0.0, 1.0]], True),
    ],
)
def test_q_m_takes_nothing_away(matrix: list[list[float]], holds: bool) -> None:
    assert verdicts(check_matrices(as_read(chen(Q_m=matrix)))) == [True, holds]


def test_reserve_is_q_m_and_a_part_in_1e9_of_its_largest_entry() -> None:
    found = reserve(as_read(chen(Q_m=[[1.0, -8.0], [-8.0, 2.0]])))
    entries = np.array(found, dtype=float)
    np.testing.assert_allclose(entries, [[1 + 8e-9, -8], [-8, 2 + 8e-9]], rtol=1e-15)
    nothing = reserve(as_read(chen()))
    assert not any(entry for row in nothing for entry in row)


def bounded(content: Content, **bounds: list[float | None]) -> list[bool]:
    """Judge a certificate with these bounds and no others."""
    free = {name: [None] * len(v) for name, v in content["bounds"].items()}
    changed = signed(content | {"bounds": free | bounds})
    return verdicts(check_bounds(as_read(changed)))


@pytest.mark.parametrize(("share", "holds"), [(1 + 1e-8, True), (1 - 1e-8, False)])
def test_inputs_reach_the_root_of_alpha_k_p_inverse_k(
    share: float, holds: bool
) -> None:
    content = chen(reference={"x": [0.0, 0.0], "u": [0.25]})
    K = np.array(content["K"])[0]
    reach = share * math.sqrt(content["alpha"] * K @ np.linalg.inv(P) @ K)
    assert bounded(content, u_upper=[0.25 + reach]) == [holds]
    assert bounded(content, u_lower=[0.25 - reach]) == [holds]
    # The nearer of two bounds counts.
    low, high = 0.25 - reach, 0.25 + reach
    assert bounded(content, u_lower=[low], u_upper=[9.0]) == [holds]
    assert bounded(content, u_lower=[-9.0], u_upper=[high]) == [holds]


@pytest.mark.parametrize(("share", "holds"), [(1 + 1e-8, True), (1 - 1e-8, False)])
@pytest.mark.parametrize("j", [0, 1])
def test_states_reach_the_root_of_alpha_p_inverse(
    j: int, share: float, holds: bool
) -> None:
    skew = np.array([[4.0, 1.0], [1.0, 1.0]])
    content = chen(P=skew.tolist(), reference={"x": [1.0, 3.0], "u": [0.0]})
    reach = share * math.sqrt(content["alpha"] * np.linalg.inv(skew)[j, j])
    for side, sign in (("x_upper", 1), ("x_lower", -1)):
        bound: list[float | None] = [None, None]
        bound[j] = [1.0, 3.0][j] + sign * reach
        assert bounded(content, **{side: bound}) == [holds]


@pytest.mark.parametrize(("share", "holds"), [(1 + 1e-8, True), (1 - 1e-8, False)])
@pytest.mark.parametrize("growth", [None, 2.25])
def test_held_states_need_room_for_growth_and_the_relative_error(
    growth: float | None, share: float, holds: bool
) -> None:
    """The root of V grows to 1.5, and by 0.001 of the map and 0.05 of the drift."""
    content = scalar(dt=0.5, core={"level": 0.0, "drift": 0.05})
    if growth is not None:
        between = {"growth": growth, "grounds": "measured"}
        content = replaced(content, ("margins", "between_samples"), between)
    reach = share * (1.0 if growth is None else 1.5 + 0.001 + 0.05)
    assert bounded(content, x_upper=[reach]) == [holds]
    # The input is held: it does not grow between samples.
    moving = content | {"K": [[-0.5]]}
    assert bounded(moving, u_upper=[0.5 * share]) == [holds]
    error = float(relative_error(as_read(signed(content))))
    assert error == pytest.approx(0.001 + 0.05, rel=1e-15)


def test_growth_says_on_what_it_rests() -> None:
    between = {"growth": 1.21, "grounds": "measured"}
    content = replaced(formation(), ("margins", "between_samples"), between)
    proven = replaced(content, ("margins", "between_samples", "grounds"), "proven")
    texts = {
        name: next(f.text for f in check_bounds(as_read(signed(c))) if "x[" in f.text)
        for name, c in (("measured", content), ("proven", proven), ("no", formation()))
    }
    assert texts["measured"].startswith("x[0] (if V grows no more than was measured)")
    assert texts["proven"].startswith("x[0] stays")
    assert texts["no"].startswith("x[0] (at the samples) stays")
    moving = check_bounds(as_read(chen()))
    assert [f.text.split(" stays")[0] for f in moving] == ["u[0]", "x[1]"]


@pytest.mark.parametrize(
    ("lower", "upper", "inside"),
    [(1.0, None, True), (1.1, None, False), (None, 1.0, True), (None, 0.9, False),
     (0.0, 0.9, False), (1.1, 2.0, False)],
)  # fmt: skip
def test_reference_outside_its_bounds_is_refused(
    lower: float | None, upper: float | None, inside: bool
) -> None:
    content = chen(
        reference={"x": [1.0, 0.0], "u": [0.0]}, alpha=1e-9,
        bounds={"u_lower": [None], "u_upper": [None], "x_lower": [lower, None],
                "x_upper": [upper, None]},
    )  # fmt: skip
    (found,) = check_bounds(as_read(content))
    assert found.verdict is Verdict.REFUSED  # On the bound there is no room.
    assert ("is outside its bounds" in found.text) is not inside
