"""The largest proven level: as near to what breaks it as is worth while."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from swarmstart.benchmarks.terminal_set_systems import SYSTEMS
from swarmstart.machine_code import now
from swarmstart.terminal_set import (
    Change,
    Ellipsoid,
    Proof,
    Reference,
    Refutation,
    continuous_change,
    continuous_terminal_set,
    prove_level,
    proven_level,
)
from swarmstart.terminal_set.proving import level_search


@pytest.fixture(scope="module")
def upright() -> tuple[Change, float]:
    """A pendulum, the angle from upright: c, and the level of its bounds."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    pendulum = ca.Function("p", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])
    reference = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1),
        u_lower=np.array([-50.0]), u_upper=np.array([50.0]),
    )  # fmt: skip
    found = continuous_terminal_set(pendulum, reference, Q=np.eye(2), R=np.eye(1))
    return continuous_change(pendulum, found), found.alpha


def test_below_a_counterexample_as_much_is_proven_as_can_be(
    upright: tuple[Change, float],
) -> None:
    change, top = upright
    level = proven_level(change, top, rng=np.random.default_rng(0))
    assert level.refutation is not None and level.refutation.alpha < top
    assert level.alpha == pytest.approx(0.99 * level.refutation.alpha, rel=1e-12)
    assert prove_level(change, level.alpha).proven


def test_the_bounds_level_is_proven_where_nothing_speaks_against_it(
    upright: tuple[Change, float],
) -> None:
    change, _ = upright
    level = proven_level(change, 1.0, rng=np.random.default_rng(0))
    assert level.refutation is None and level.alpha == 1.0


FEATURES = {
    "pole of the damping": 1.0,  # at x0 = -1
    "tank": 1.0,  # at x = -1
    "thin jump": 1.0,  # c = 0 at r = 1
    "thin bump": 1.0 - 1e-3 * np.sqrt(np.log(1.5)),  # there its edge is 0
    "nearly a centre": 1.0,
}


def change_of(name: str) -> tuple[Change, float]:
    system = SYSTEMS[name]()
    assert system.given is not None
    room = float(system.reference.e_max[0])
    return continuous_change(system.dynamics, system.given), room**2


@pytest.mark.parametrize(("name", "end"), FEATURES.items())
def test_a_level_is_tight_where_no_search_finds_a_counterexample_near(
    name: str, end: float
) -> None:
    """Shares of 0.92, 0.5 and 0.125 of what was refuted left 0.5 to 0.94 of it."""
    change, top = change_of(name)
    level = proven_level(change, top, rng=np.random.default_rng(0))
    assert 0.98 * end < level.alpha < end
    boxes = max(10 * level.proof.boxes, 50_000)
    assert not prove_level(change, 1.02 * level.alpha, max_boxes=boxes).proven


def test_a_counterexample_of_the_proof_counts_where_it_is_the_nearest() -> None:
    change, top = change_of("thin bump")
    level = proven_level(change, top, rng=np.random.default_rng(0))
    refutation = level.refutation
    assert refutation is not None and abs(refutation.alpha - 1) < 1e-3
    assert float(change.function(refutation.e)) == refutation.change >= 0
    assert refutation.alpha == pytest.approx(float(refutation.e @ refutation.e))


def test_a_state_at_which_the_model_is_not_defined_is_no_refutation() -> None:
    change, top = change_of("tank")
    assert proven_level(change, top, rng=np.random.default_rng(0)).refutation is None


@pytest.mark.parametrize("name", ["thin jump", "pole of the damping"])
def test_the_time_is_kept_in_whatever_the_search_is_doing(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After so many proofs time is up: what was proven till then is the answer."""
    change, top = change_of(name)
    found = proven_level(change, top, rng=np.random.default_rng(0))
    tried = 0

    def counted(*arguments: object, **options: object) -> Proof:
        nonlocal tried
        tried += 1
        return prove_level(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(
        "swarmstart.terminal_set.proving.level_search.prove_level", counted
    )
    monkeypatch.setattr(
        "swarmstart.terminal_set.proving.level_search.now",
        lambda: 100.0 * (tried >= 4),
    )
    stopped = proven_level(change, top, rng=np.random.default_rng(0), work=50.0)
    assert tried == 4
    assert stopped.alpha < found.alpha


@pytest.mark.parametrize(("part", "last"), [(0.9, 0.9), (1.1, 1.1 / 4)])
def test_levels_are_quartered_to_a_part_in_1e12_and_then_none_is_proven(
    part: float, last: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A level that ends a part in 1e12 or more above that is quartered once more."""
    tried: list[float] = []

    def unproven(change: Change, alpha: float, **limits: object) -> Proof:
        tried.append(alpha)
        return Proof(proven=False, alpha=alpha, boxes=1, seconds=0.0)

    refuted = part * 1e-12 / (0.92 * 0.54 * 0.25**19)
    nearest = Refutation(alpha=refuted, e=np.ones(1), change=0.0)
    monkeypatch.setattr(level_search, "prove_level", unproven)
    monkeypatch.setattr(level_search, "refuted_level", lambda *_, **__: nearest)
    change, _ = change_of("tank")
    level = proven_level(change, 1.0, rng=np.random.default_rng(0))
    assert level.alpha == 0.0
    assert tried[-1] == pytest.approx(last * 1e-12, rel=1e-9, abs=0)
    first = [1.0, 0.92 * refuted, 0.92 * 0.54 * refuted]
    assert tried[:3] == pytest.approx(first, rel=1e-9)


def test_a_model_that_is_not_defined_everywhere_gets_a_smaller_set() -> None:
    """sqrt(1 + x): the bounds' level reaches far beyond x = -1."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(x[1], ca.sqrt(x[0] + 1) - 1 + u)
    dynamics = ca.Function("root", [x, u], [xdot])
    bounds = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1),
        u_lower=-50 * np.ones(1), u_upper=50 * np.ones(1),
    )  # fmt: skip
    found = continuous_terminal_set(dynamics, bounds, Q=np.eye(2), R=np.eye(1))
    level = proven_level(
        continuous_change(dynamics, found), found.alpha, rng=np.random.default_rng(0)
    )
    assert 0 < level.alpha < found.alpha
    assert Ellipsoid(P=found.P, alpha=level.alpha).extent()[0] < 1


def test_a_try_gets_its_share_of_the_work_that_is_left(
    upright: tuple[Change, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    granted: list[float] = []

    def tried(_: Change, alpha: float, *, max_boxes: int, work: float) -> Proof:
        granted.append(work)
        return Proof(proven=False, alpha=alpha, boxes=max_boxes, seconds=0.0)

    monkeypatch.setattr(level_search, "prove_level", tried)
    search = level_search._LevelSearch(upright[0], 4.0, now() + 1000.0)
    for share in (0.25, 0.7, 1.0):
        assert not search.proves(4.0, share)
    assert granted == pytest.approx([250.0, 700.0, 1000.0], rel=1e-2)
    assert search.level.alpha == 0.0


def scripted(
    monkeypatch: pytest.MonkeyPatch, edge: float, boxes: int, *, is_broken: bool
) -> tuple[level_search._LevelSearch, list[tuple[float, int]]]:
    """Return a search up to level 4 in which all below an edge is proven.

    Above it a state at the edge is met, or nothing is.
    """
    tried: list[tuple[float, int]] = []

    def proves(_: Change, alpha: float, *, max_boxes: int, work: float) -> Proof:
        assert 0 < work <= 1000
        tried.append((alpha, max_boxes))
        state = np.sqrt(edge) * np.ones(1) if is_broken and alpha >= edge else None
        return Proof(
            proven=alpha < edge, alpha=alpha, boxes=boxes, seconds=0.0,
            counterexample=state,
        )  # fmt: skip

    e = ca.SX.sym("e")
    change = Change(
        motion=ca.Function("motion", [e], [0 * e]), P=np.eye(1), Q_m=np.zeros((1, 1)),
        is_held=False,
    )  # fmt: skip
    monkeypatch.setattr(level_search, "prove_level", proves)
    return level_search._LevelSearch(change, 4.0, now() + 1000.0), tried


@pytest.mark.parametrize("boxes", [7, 6000])
@pytest.mark.parametrize("edge", [3.9, 3.0, 1.7, 0.3])
def test_levels_between_are_tried_by_their_ratio_until_they_are_close(
    edge: float, boxes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, tried = scripted(monkeypatch, edge, boxes, is_broken=False)
    assert not search.proves(4.0, 0.25)
    search.descend()
    levels, high = [4.0, 0.92 * 4.0], 4.0
    for share in (0.54, 0.25, 0.25):
        if levels[-1] < edge:
            break
        high = levels[-1]
        levels.append(share * levels[-1])
    assert [alpha for alpha, _ in tried] == pytest.approx(levels, rel=1e-12)
    low, begun = levels[-1], len(levels)
    search.tighten()
    while high > 1.011 * low:
        levels.append((low * high) ** 0.5)
        low, high = (levels[-1], high) if levels[-1] < edge else (low, levels[-1])
    assert [alpha for alpha, _ in tried] == pytest.approx(levels, rel=1e-12)
    assert {most for _, most in tried[begun:]} == {max(10 * boxes, 50_000)}
    assert search.level.alpha == pytest.approx(low) and search.level.refutation is None


@pytest.mark.parametrize("edge", [3.9, 3.0])
def test_state_that_breaks_a_level_is_its_limit_and_no_smaller_one_s(
    edge: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """0.99 of a refuted level is tried at last, if the middle is below that."""
    search, tried = scripted(monkeypatch, edge, 7, is_broken=True)
    assert not search.proves(4.0, 0.25)
    refutation = search.level.refutation
    assert refutation is not None and refutation.alpha == pytest.approx(edge)
    search.descend()
    search.tighten()
    expected = [4.0, 0.92 * edge, 0.99 * edge]
    assert [alpha for alpha, _ in tried] == pytest.approx(expected, rel=1e-12)
    assert search.level.alpha == pytest.approx(0.99 * edge)


def test_nearest_of_all_counterexamples_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refutation(alpha: float) -> Refutation:
        return Refutation(alpha=alpha, e=np.array([alpha**0.5]), change=0.0)

    search, _ = scripted(monkeypatch, 3.0, 7, is_broken=False)
    search.refute(None)
    assert not search.proves(4.0, 0.25)
    assert (search._unproven, search._is_broken) == (4.0, False)
    for alpha, nearest in ((4.0, 4.0), (5.0, 4.0), (3.5, 3.5), (3.7, 3.5), (1.0, 1.0)):
        search.refute(refutation(alpha))
        assert (search._unproven, search._is_broken) == (nearest, True)
        found = search.level.refutation
        assert found is not None and found.alpha == nearest
    beyond, _ = scripted(monkeypatch, 3.0, 7, is_broken=False)
    beyond.refute(refutation(5.0))  # Above all that is asked for: no limit.
    assert (beyond._unproven, beyond._is_broken) == (4.0, False)
    # A state a little outside of what was tried is one of that; none is stated.
    beyond._break(np.array([4.001**0.5]))
    assert (beyond._unproven, beyond._is_broken) == (4.0, True)
    assert not beyond.proves(4.0, 0.25) and beyond.level.refutation is not None
    assert beyond.level.refutation.alpha == 5.0
