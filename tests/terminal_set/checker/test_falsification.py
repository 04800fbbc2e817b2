"""Attempts to refute: what is integrated, if it is looked, and from where on."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import numpy as np
import pytest

flint = pytest.importorskip("flint")

from swarmstart.terminal_set.checker import falsification  # noqa: E402
from swarmstart.terminal_set.checker.certificate_file import (  # noqa: E402
    BINARY,
    UNARY,
    Certificate,
    Vector,
)
from swarmstart.terminal_set.checker.ellipsoid_statements import (  # noqa: E402
    PointwiseChange,
)
from swarmstart.terminal_set.checker.falsification import (  # noqa: E402
    FLOAT_OPERATIONS,
    REFINEMENT,
    SAMPLES,
    TIMES,
    SampledMotion,
    check_growth_by_samples,
    check_integrator,
    check_refuted,
    find_counterexample,
)
from swarmstart.terminal_set.checker.findings import NEVER, Verdict  # noqa: E402
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
    chen_field,
    runge_kutta,
    unicycle_field,
)


@pytest.mark.parametrize(
    ("name", "arguments", "result"),
    [
        ("add", (3.0, 0.5), 3.5), ("sub", (3.0, 0.5), 2.5), ("mul", (3.0, 0.5), 1.5),
        ("div", (3.0, 0.5), 6.0), ("pow", (3.0, 2.0), 9.0), ("fmin", (3.0, 0.5), 0.5),
        ("fmax", (3.0, 0.5), 3.0), ("neg", (3.0,), -3.0), ("sq", (-3.0,), 9.0),
        ("twice", (3.0,), 6.0), ("inv", (4.0,), 0.25), ("fabs", (-3.0,), 3.0),
        ("sqrt", (9.0,), 3.0), ("sin", (0.5,), math.sin(0.5)),
        ("cos", (0.5,), math.cos(0.5)), ("tan", (0.5,), math.tan(0.5)),
        ("exp", (0.5,), math.exp(0.5)), ("log", (0.5,), math.log(0.5)),
        ("atan", (0.5,), math.atan(0.5)), ("tanh", (0.5,), math.tanh(0.5)),
    ],
)  # fmt: skip
def test_operations_on_floats(
    name: str, arguments: Sequence[float], result: float
) -> None:
    assert FLOAT_OPERATIONS[name](*arguments) == result
    assert set(FLOAT_OPERATIONS) == UNARY | BINARY


@pytest.mark.parametrize("steps", [1, 5])
def test_motion_is_integrated_with_the_input_held(steps: int) -> None:
    certificate = as_read(formation())
    motion, rng = SampledMotion(certificate, NEVER), np.random.default_rng(0)
    x_ref, u_ref = np.array(certificate.x_ref), np.array(certificate.u_ref)
    for _ in range(3):
        e = 0.3 * rng.normal(size=4)
        u = u_ref - np.array(certificate.K) @ e
        ours = runge_kutta(unicycle_field, x_ref + e, u, 0.75, steps)
        own = runge_kutta(unicycle_field, x_ref, u_ref, 0.75, steps)
        found = motion.moved(e.tolist(), 0.75, steps)
        np.testing.assert_allclose(found, ours - own, rtol=1e-11, atol=1e-12)
    x, u = np.array([0.3, -1.7]), np.array([0.9])
    rate = SampledMotion(as_read(chen()), NEVER).rate(x.tolist(), u.tolist())
    np.testing.assert_allclose(rate, chen_field(x, u), rtol=1e-14)


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


def noted(monkeypatch: pytest.MonkeyPatch, bad: Vector | None = None) -> list[Vector]:
    """Note the points that are looked at; none is a counterexample but one."""
    seen: list[Vector] = []

    def violates(_: object, e: Vector, time: float) -> bool:
        assert time == 0
        seen.append(e)
        return bad is not None and bool(np.allclose(e, bad, rtol=1e-12, atol=0))

    monkeypatch.setattr(PointwiseChange, "violates_decrease", violates)
    return seen


def test_axes_near_the_centre_and_the_boundary_are_tried_and_spheres(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    certificate = as_read(chen(P=[[4.0, 1.0], [1.0, 1.0]], alpha=0.25, refuted=None))
    seen = noted(monkeypatch)
    assert find_counterexample(certificate, NEVER) is None
    P = np.array(certificate.P)
    T = np.linalg.inv(np.linalg.cholesky(P)).T
    axes = [
        side * share * 0.5 * T[:, j]
        for share in (1e-4, 0.999) for j in (0, 1) for side in (1, -1)
    ]  # fmt: skip
    np.testing.assert_allclose(seen[: len(axes)], axes, rtol=1e-12, atol=1e-18)
    rest = np.array(seen[len(axes) :])
    assert rest.shape == (2 * SAMPLES, 2)
    V = np.einsum("ki,ij,kj->k", rest, P, rest)
    boundary, centre = V[:SAMPLES] / 0.25, V[SAMPLES:] / 0.25
    assert (boundary < 1).all() and (boundary > 1 - 1e-11).all()
    np.testing.assert_allclose(centre, 1e-8, rtol=1e-10)
    angles = np.sort(np.arctan2(*np.linalg.solve(T, rest[:SAMPLES].T)))
    assert np.diff(angles).max() < 0.3  # All directions.
    bad = seen[5]
    noted(monkeypatch, bad)
    found = find_counterexample(certificate, NEVER)
    assert found is not None and found.verdict is Verdict.REFUSED
    assert ", ".join(f"{entry:.6g}" for entry in bad) in found.text


def test_samples_of_the_inside_are_uniform_in_volume_but_off_the_centre(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    certificate = as_read(chen(alpha=0.25, refuted=None))
    inside = np.array(list(falsification._inside(certificate)))
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
    near = np.array(list(falsification._inside(certificate)))
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
            _: object, e: Vector, time: float, steps: int, apart: float = apart
        ) -> Vector:
            assert (time, steps) in ((0.5, 1), (0.5, REFINEMENT))
            return (e[0] * (0.5 + apart * (steps > 1)),)

        monkeypatch.setattr(SampledMotion, "moved", moved)
        assert check_integrator(certificate, NEVER).verdict is verdict


@pytest.mark.parametrize(
    ("flow", "words"), [(1.0, "does not decrease"), (-1.0, "does not decrease"),
                        (math.nan, "by nan of"), (0.99, "is within")]
)  # fmt: skip
def test_flow_that_does_not_decrease_is_refused(
    monkeypatch: pytest.MonkeyPatch, flow: float, words: str
) -> None:
    monkeypatch.setattr(SampledMotion, "moved", lambda _, e, *__: (e[0] * flow,))
    found = check_integrator(held(), NEVER)
    assert words in found.text
    assert (found.verdict is Verdict.SAMPLED) is (flow == 0.99)


def test_motion_that_is_not_defined_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(*_: object) -> Vector:
        raise ValueError("math domain error")

    monkeypatch.setattr(SampledMotion, "moved", moved)
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

    def moved(_: object, e: Vector, time: float, steps: int) -> Vector:
        asked.append((time, steps))
        return (0.5 * e[0],)

    monkeypatch.setattr(SampledMotion, "moved", moved)
    check_integrator(as_read(content), NEVER)
    assert asked == [(0.5, 3 * REFINEMENT), (0.5, 3)] * SAMPLES
    asked.clear()
    check_growth_by_samples(as_read(content), NEVER)
    assert asked == [(0.5 * i / TIMES, 3) for i in range(1, TIMES + 1)] * SAMPLES


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
    def moved(_: object, e: Vector, time: float, steps: int) -> Vector:
        # It grows at one of the instants only.
        return (e[0] * (grown if time == 0.5 * 3 / TIMES else 0.1),)

    monkeypatch.setattr(SampledMotion, "moved", moved)
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
    assert falsification._norm(certificate, e) == pytest.approx(exact, rel=1e-14)
    assert math.isnan(falsification._norm(certificate, (1e200, 1.0)))
