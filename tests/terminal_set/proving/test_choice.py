"""Choice of weights: the largest of the sets that are proven, by the size asked for."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set import (
    Candidate,
    Change,
    Ellipsoid,
    NoProvenSetError,
    Proof,
    ProvenLevel,
    Reference,
    TerminalSet,
    continuous_change,
    continuous_terminal_set,
    held_change,
    largest_proven_set,
    log_volume,
    sampled_terminal_set,
)
from swarmstart.terminal_set.proving import level_search

SCALES = (1.0, 100.0, 1e3, 1e4)
Rank = Callable[[Callable[[Ellipsoid], float]], tuple[Candidate, ...]]


@pytest.fixture(scope="module")
def rank(formation: ca.Function, leader: Reference) -> Rank:
    """The formation held 1 s, R = diag(1, scale), ranked by some size."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    rate = [formation(x, u)]
    for part in (0.5, 0.5, 1.0):
        rate.append(formation(x + part * rate[-1], u))
    after = x + (rate[0] + 2 * rate[1] + 2 * rate[2] + rate[3]) / 6
    step = ca.Function("step", [x, u], [after])

    def design(scale: float) -> TerminalSet:
        return sampled_terminal_set(
            formation, leader, dt=1.0, Q=np.eye(4), R=np.diag([1.0, scale])
        )

    def ranked(size: Callable[[Ellipsoid], float]) -> tuple[Candidate, ...]:
        return largest_proven_set(
            design, lambda found: held_change(step, found), SCALES,
            rng=np.random.default_rng(0), size=size,
        )  # fmt: skip

    return ranked


def test_a_formation_gets_a_set_metres_wide_instead_of_centimetres(rank: Rank) -> None:
    """R = I gives 24 and 32 cm, R = diag(1, 1000) 5.2 and 5.6 m, the whole proven."""
    candidates = rank(log_volume)
    assert [one.scale for one in candidates] == [1e3, 1e4, 100.0, 1.0]
    best, narrow = candidates[0].terminal_set, candidates[-1].terminal_set
    assert best.alpha == pytest.approx(51.035, rel=1e-4)
    assert best.ellipsoid.extent()[2:] == pytest.approx([5.205, 5.616], abs=2e-3)
    assert narrow.ellipsoid.extent()[2:] == pytest.approx([0.238, 0.323], abs=1e-3)
    for one in candidates:
        assert one.level.proof.proven and one.level.alpha == one.terminal_set.alpha
        assert one.size == log_volume(one.terminal_set.ellipsoid)


def test_another_size_chooses_another_set(rank: Rank) -> None:
    """Along x the sets grow with the weight on the turn rate, the volume does not."""
    along_x = rank(lambda ellipsoid: float(ellipsoid.extent()[2]))
    assert [one.scale for one in along_x] == [1e4, 1e3, 100.0, 1.0]


@pytest.fixture(scope="module")
def upright() -> Callable[[float], tuple[Change, TerminalSet]]:
    """A pendulum, the angle from upright; c and the design with R = scale."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    pendulum = ca.Function("p", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])
    reference = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1),
        u_lower=np.array([-50.0]), u_upper=np.array([50.0]),
    )  # fmt: skip

    def pose(scale: float) -> tuple[Change, TerminalSet]:
        found = continuous_terminal_set(
            pendulum, reference, Q=np.eye(2), R=scale * np.eye(1)
        )
        return continuous_change(pendulum, found), found

    return pose


def doubtful(scale: float, found: TerminalSet) -> TerminalSet:
    """The design, or with a P under which nothing falls where the scale is negative."""
    if scale > 0:
        return found
    return TerminalSet(
        K=np.zeros_like(found.K), P=np.eye(2), alpha=1.0, x_ref=found.x_ref,
        u_ref=found.u_ref, dt=None, design="none",
    )  # fmt: skip


def test_designs_without_a_proven_level_come_last_or_are_refused(
    upright: Callable[[float], tuple[Change, TerminalSet]],
) -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    pendulum = ca.Function("p", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])

    def ranked(*scales: float) -> tuple[Candidate, ...]:
        return largest_proven_set(
            lambda scale: doubtful(scale, upright(abs(scale))[1]),
            lambda found: continuous_change(pendulum, found),
            scales,
            rng=np.random.default_rng(0),
        )

    good, none = ranked(-1.0, 1.0)
    assert (good.scale, none.scale) == (1.0, -1.0)
    assert none.size == -np.inf and none.level.alpha == 0
    with pytest.raises(NoProvenSetError, match=r"any of the scales tried: -1, -2$"):
        ranked(-1.0, -2.0)
    with pytest.raises(NoProvenSetError, match=r"tried: none$"):
        ranked()


def test_the_volume_is_that_of_the_half_axes() -> None:
    half_axes = np.array([2.0, 0.5, 3.0])
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    P: Array = turn @ np.diag(half_axes**-2.0) @ turn.T
    for alpha in (1.0, 7.0):
        expected = np.log(half_axes * np.sqrt(alpha)).sum()
        volume = log_volume(Ellipsoid(P=(P + P.T) / 2, alpha=alpha))
        assert volume == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("alpha", [0.0, 0.5])
def test_family_is_refused_only_if_no_level_is_above_zero(
    alpha: float,
    upright: Callable[[float], tuple[Change, TerminalSet]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    proof = Proof(proven=alpha > 0, alpha=alpha or 1.0, boxes=1, seconds=0.0)
    level = ProvenLevel(proof=proof, refutation=None)
    monkeypatch.setattr(level_search, "proven_level", lambda *_, **__: level)

    def ranked() -> tuple[Candidate, ...]:
        return largest_proven_set(
            lambda scale: upright(scale)[1], lambda _: upright(1.0)[0], [1.0],
            rng=np.random.default_rng(0),
        )  # fmt: skip

    if alpha == 0:
        with pytest.raises(NoProvenSetError, match=r"tried: 1$"):
            ranked()
        return
    (one,) = ranked()
    assert one.terminal_set.alpha == 0.5 and np.isfinite(one.size)
