"""Attempts to refute: what is integrated, if it is looked, and from where on."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

flint = pytest.importorskip("flint")

from swarmstart.arrays import Array  # noqa: E402
from swarmstart.terminal_set.checker import falsification  # noqa: E402
from swarmstart.terminal_set.checker.certificate_file import (  # noqa: E402
    Certificate,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    change_of,
)
from swarmstart.terminal_set.checker.falsification import (  # noqa: E402
    REFINEMENT,
    SAMPLES,
    TIMES,
    check_growth_by_samples,
    check_integrator,
    check_refuted,
    find_counterexample,
)
from swarmstart.terminal_set.checker.findings import NEVER, Verdict  # noqa: E402
from swarmstart.terminal_set.checker.models import Model  # noqa: E402
from swarmstart.tests.terminal_set.checker.certificates_by_hand import (  # noqa: E402
    Content,
    chen,
    formation,
    replaced,
    scalar,
    signed,
)
from swarmstart.tests.terminal_set.checker.systems import (  # noqa: E402
    as_read,
    runge_kutta,
    unicycle_field,
)


@pytest.mark.parametrize("steps", [1, 5])
def test_motion_is_integrated_with_the_input_held(steps: int) -> None:
    certificate = as_read(formation())
    change, rng = change_of(certificate), np.random.default_rng(0)
    x_ref, u_ref = np.array(certificate.x_ref), np.array(certificate.u_ref)
    states = 0.3 * rng.normal(size=(4, 3))
    found = falsification._after(change, states, 0.75, steps)
    for e, moved in zip(states.T, found.T, strict=True):
        u = u_ref - np.array(certificate.K) @ e
        ours = runge_kutta(unicycle_field, x_ref + e, u, 0.75, steps)
        own = runge_kutta(unicycle_field, x_ref, u_ref, 0.75, steps)
        np.testing.assert_allclose(moved, ours - own, rtol=1e-11, atol=1e-12)


def refuted(e: float, **changes: object) -> Content:
    """x' = -e + e^3, whose V = e^2 falls up to |e| = 1."""
    content = scalar(alpha=0.5)
    content["dynamics"] = {
        "nx": 1, "nu": 1,
        "tape": [["x", 0], ["sq", 0], ["mul", 0, 1], ["sub", 2, 0]], "xdot": [3],
    }  # fmt: skip
    content["refuted"] = {"alpha": e**2, "e": [e], "change": 0.0} | changes
    return signed(content)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (refuted(1.0), None),
        (refuted(-1.5), None),
        (refuted(1 - 1e-10), None),  # c = -2 e-10, to rounding none.
        (refuted(1 - 1e-8), "decreases"),
        (refuted(0.9), "decreases"),
        (refuted(0.75, alpha=0.5), "is not beyond the set's level 0.5"),
        (refuted(0.6), "is not beyond the set's level 0.5"),
        (refuted(2.0, alpha=4 * (1 + 0.9e-9)), None),
        (refuted(2.0, alpha=4 * (1 - 0.9e-9)), None),
        (refuted(2.0, alpha=4 * (1 + 1.1e-9)), "has V(e) = 4"),
        (refuted(2.0, alpha=4 * (1 - 1.1e-9)), "has V(e) = 4"),
    ],
)
def test_refuted_point_is_on_its_level_and_does_not_decrease(
    content: Content, words: str | None
) -> None:
    found = check_refuted(as_read(content), NEVER)
    assert found.verdict is (Verdict.PROVED if words is None else Verdict.REFUSED)
    assert (words or "does not decrease") in found.text


def test_rounding_of_a_refuted_point_is_a_part_of_its_level() -> None:
    """c = -2 V (1 - e^2): at V = 100 more is rounding than at V = 1."""
    for size in (1e-3, 1e3):
        content = scalar(alpha=0.5 * size**2)
        cubic = [["x", 0], ["const", size], ["div", 0, 1], ["sq", 2], ["mul", 0, 3],
                 ["sub", 4, 0]]  # fmt: skip
        content["dynamics"] = {"nx": 1, "nu": 1, "tape": cubic, "xdot": [5]}
        for short, verdict in ((1e-10, Verdict.PROVED), (1e-8, Verdict.REFUSED)):
            e = size * (1 - short)
            content["refuted"] = {"alpha": e**2, "e": [e], "change": 0.0}
            found = check_refuted(as_read(signed(content)), NEVER)
            assert found.verdict is verdict


def test_nothing_is_refuted_if_nothing_is_stated() -> None:
    assert check_refuted(as_read(scalar()), NEVER).verdict is Verdict.SKIPPED


def test_axes_near_the_centre_and_the_boundary_are_tried_and_spheres(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    certificate = as_read(chen(P=[[4.0, 1.0], [1.0, 1.0]], alpha=0.25, refuted=None))
    seen = falsification._candidates(certificate).T
    P = np.array(certificate.P)
    T = np.linalg.inv(np.linalg.cholesky(P)).T
    axes = [
        side * share * 0.5 * T[:, j]
        for share in (1e-4, 0.999) for side in (1, -1) for j in (0, 1)
    ]  # fmt: skip
    np.testing.assert_allclose(seen[: len(axes)], axes, rtol=1e-12, atol=1e-18)
    rest = seen[len(axes) :]
    assert rest.shape == (2 * SAMPLES, 2)
    V = np.einsum("ki,ij,kj->k", rest, P, rest)
    boundary, centre = V[:SAMPLES] / 0.25, V[SAMPLES:] / 0.25
    assert (boundary < 1).all() and (boundary > 1 - 1e-11).all()
    np.testing.assert_allclose(centre, 1e-8, rtol=1e-10)
    angles = np.sort(np.arctan2(*np.linalg.solve(T, rest[:SAMPLES].T)))
    assert np.diff(angles).max() < 0.3  # All directions.
    bad = seen[5]

    def fails(change: object, e: list[Model], alpha: float) -> Array:
        near = [
            np.isclose(x.middle, b, rtol=1e-12) for x, b in zip(e, bad, strict=True)
        ]
        return np.asarray(np.all(near, axis=0))

    monkeypatch.setattr(falsification, "fails", fails)
    found = find_counterexample(certificate, NEVER)
    assert found is not None and found.verdict is Verdict.REFUSED
    assert ", ".join(f"{entry:.6g}" for entry in bad) in found.text
    monkeypatch.setattr(falsification, "fails", lambda *_: np.zeros(408, dtype=bool))
    assert find_counterexample(certificate, NEVER) is None


def test_samples_of_the_inside_are_uniform_in_volume_but_off_the_centre(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    certificate = as_read(chen(alpha=0.25, refuted=None))
    inside = falsification._inside(certificate).T
    assert inside.shape == (SAMPLES, 2)
    P = np.array(certificate.P)
    shares = np.sqrt(np.einsum("ki,ij,kj->k", inside, P, inside) / 0.25)
    assert 0.01 <= shares.min() and shares.max() <= 1
    # In two dimensions half of the area is within 0.707; 3.5 % is one deviation.
    assert np.mean(shares < np.sqrt(0.5)) == pytest.approx(0.5, abs=0.1)

    class Nothing(random.Random):
        def random(self) -> float:
            return 0.0

        def gauss(self, mu: float = 0.0, sigma: float = 1.0) -> float:
            return mu + sigma

    monkeypatch.setattr(random, "Random", Nothing)
    near = falsification._inside(certificate).T
    shares = np.sqrt(np.einsum("ki,ij,kj->k", near, P, near) / 0.25)
    np.testing.assert_allclose(shares, 0.01, rtol=1e-12)


def held(error: float = 1e-3, growth: float | None = None) -> Certificate:
    """x' = -x held 0.5 s in one step: the map is 0.60677 e, the flow 0.60653 e."""
    content = scalar(dt=0.5)
    content["margins"]["integrator"]["relative_error"] = error
    if growth is not None:
        between = {"growth": growth, "grounds": "measured"}
        content["margins"]["between_samples"] = between
    return as_read(signed(content))


MAP = 1 - 0.5 + 0.5**2 / 2 - 0.5**3 / 6 + 0.5**4 / 24
FLOW = math.exp(-0.5)


@pytest.mark.parametrize(
    ("error", "verdict"),
    [
        (1.0001 * (MAP - FLOW), Verdict.SAMPLED),
        (0.9999 * (MAP - FLOW), Verdict.REFUSED),
    ],
)
def test_flow_is_as_far_from_the_map_as_the_exponential(
    error: float, verdict: Verdict
) -> None:
    found = check_integrator(held(error), NEVER)
    assert found.verdict is verdict
    assert "the flow" in found.text
    if verdict is Verdict.SAMPLED:
        assert f"{MAP - FLOW:.3g} at {SAMPLES} points" in found.text


def test_error_of_floats_is_allowed_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """The map and the flow may differ by 1e-10 of |e| if they are the same."""
    certificate = held(0.0)
    for apart, verdict in ((0.9e-10, Verdict.SAMPLED), (1.1e-10, Verdict.REFUSED)):

        def moved(
            _: object, e: Array, time: float, steps: int, apart: float = apart
        ) -> Array:
            assert (time, steps) in ((0.5, 1), (0.5, REFINEMENT))
            return e * (0.5 + apart * (steps > 1))

        monkeypatch.setattr(falsification, "_after", moved)
        assert check_integrator(certificate, NEVER).verdict is verdict


@pytest.mark.parametrize(
    ("flow", "words"), [(1.0, "does not decrease"), (-1.0, "does not decrease"),
                        (math.nan, "not defined near e"), (0.99, "is within")]
)  # fmt: skip
def test_flow_that_does_not_decrease_is_refused(
    monkeypatch: pytest.MonkeyPatch, flow: float, words: str
) -> None:
    monkeypatch.setattr(falsification, "_after", lambda _, e, *__: e * flow)
    found = check_integrator(held(), NEVER)
    assert words in found.text
    assert (found.verdict is Verdict.SAMPLED) is (flow == 0.99)


def test_motion_that_is_not_defined_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(falsification, "_after", lambda _, e, *__: e * math.nan)
    for found in (
        check_integrator(held(), NEVER),
        check_growth_by_samples(held(growth=2.0), NEVER),
    ):
        assert found.verdict is Verdict.REFUSED
        assert "the dynamics are not defined near e = " in found.text


def test_steps_are_those_of_the_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    content = replaced(scalar(dt=0.5), ("substeps",), 3)
    between = {"growth": 4.0, "grounds": "measured"}
    content = signed(replaced(content, ("margins", "between_samples"), between))
    asked: list[tuple[float, int]] = []

    def moved(_: object, e: Array, time: float, steps: int) -> Array:
        asked.append((time, steps))
        return 0.5 * e

    monkeypatch.setattr(falsification, "_after", moved)
    check_integrator(as_read(content), NEVER)
    assert asked == [(0.5, 3 * REFINEMENT), (0.5, 3)]
    asked.clear()
    check_growth_by_samples(as_read(content), NEVER)
    assert asked == [(0.5 * i / TIMES, 3) for i in range(1, TIMES + 1)]


def test_integrator_without_a_stated_error_is_left_out() -> None:
    content = replaced(scalar(dt=0.5), ("margins", "integrator"), None)
    assert check_integrator(as_read(signed(content)), NEVER).verdict is Verdict.SKIPPED


@pytest.mark.parametrize(
    ("grown", "growth", "verdict"),
    [
        (1.2, 1.45, Verdict.SAMPLED),  # 1.2^2 = 1.44.
        (-1.2, 1.45, Verdict.SAMPLED),
        (1.2, 1.43, Verdict.REFUSED),
        (2.0, 4.0, Verdict.REFUSED),  # As much is not below.
        (0.5, 1.01, Verdict.SAMPLED),
        (0.5, 1.0, Verdict.REFUSED),  # At the samples themselves V is V.
        (0.5, 0.5, Verdict.REFUSED),
        (math.nan, 4.0, Verdict.REFUSED),
    ],
)
def test_growth_between_samples_is_that_of_the_squares(
    monkeypatch: pytest.MonkeyPatch, grown: float, growth: float, verdict: Verdict
) -> None:
    def moved(_: object, e: Array, time: float, steps: int) -> Array:
        # It grows at one of the instants only.
        return e * (grown if time == 0.5 * 3 / TIMES else 0.1)

    monkeypatch.setattr(falsification, "_after", moved)
    found = check_growth_by_samples(held(growth=growth), NEVER)
    assert found.verdict is verdict
    if grown in (1.2, -1.2):
        assert "1.44" in found.text
    if growth == 1.43:
        assert "t = 0.188 s" in found.text  # Of 0.5 s, three eighths.


def test_norm_is_that_of_p() -> None:
    certificate = as_read(chen(refuted=None))
    e = (0.5, -0.25)
    exact = math.sqrt(float(np.array(e) @ np.array(certificate.P) @ e))
    found = falsification._norm(certificate, np.array([[*e], [1e200, 1.0]]).T)
    assert found[0] == pytest.approx(exact, rel=1e-14)
    assert math.isnan(found[1])
