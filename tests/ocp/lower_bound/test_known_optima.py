"""No bound is better than an optimum that is known otherwise."""

import itertools
from collections.abc import Callable
from functools import cache

import pytest

from swarmstart.ocp import solve
from swarmstart.ocp.common.presentation import ProgressCallback
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.tests.ocp.lower_bound.known_optima import known_optima
from swarmstart.tests.ocp.lower_bound.known_optimum import KnownOptimum

SHORT = (
    "regulator",
    "catch",
    "double integrator to a soft end, in hours",
    "to rest in the least time",
    "Bryson and Denham, 0.111",
    "drawn 0",
)
ROUNDING = 1e-9
"""Of an optimum: it is known to that, and its floats are."""
SOLVED = 1e-5
"""Of an optimum: what a solver's tolerance of 1e-6 for constraints may gain."""
PARTS = 4
"""All known optima in so many tests."""


@cache
def by_name() -> dict[str, KnownOptimum]:
    """Return the known optima by their names."""
    return {known.name: known for known in known_optima()}


def part_of_all(number: int) -> list[KnownOptimum]:
    """Return every fourth of them."""
    return list(by_name().values())[number::PARTS]


def solved(known: KnownOptimum, lanes: int) -> float:
    """Return the cost of the answer that `solve` finds."""
    answer = solve(
        known.problem, known.x0, known=known.known, search=None, lanes=lanes,
        backend="casadi", seed=0,
    )  # fmt: skip
    assert answer.status.is_confirmed, f"{known.name}: {answer.reason}"
    return float(answer.cost)


def bounded(
    known: KnownOptimum, *, work: float, answer: float | None = None
) -> LowerBound:
    """Return the bound of a known problem."""
    return lower_bound(
        known.problem, known.x0, known=known.known, answer=answer, work=work
    )


def stop_after(bounds: int) -> ProgressCallback:
    """Return what ends a search, as Ctrl-C does, once it has told so many bounds.

    So a slow machine looks at the same bounds as a quick one.
    """
    left = itertools.count(bounds - 1, -1)

    def tell(done: int, of: int, what: str, /) -> None:
        del done, of, what
        if next(left) <= 0:
            raise KeyboardInterrupt

    return tell


def crossing(known: KnownOptimum, bound: LowerBound) -> str:
    """Return what is wrong with a bound; empty if nothing is."""
    if bound.sense != known.problem.sense:
        return f"{known.name}: sense {bound.sense}"
    if not bound.kind.is_bound:
        return "" if bound.reason else f"{known.name}: {bound.kind} without a reason"
    if not known.excess(bound.value) <= ROUNDING:
        return f"{known.name}: {bound.kind} {bound.value!r} above {known.optimum!r}"
    return ""


def a_little_worse(known: KnownOptimum) -> float:
    """Return the cost of an answer that is 5 % off."""
    return known.optimum + known.problem.sense * 0.05 * known.size


def better_than_the_best(known: KnownOptimum) -> float:
    """Return a cost that no answer has."""
    return known.optimum - known.problem.sense * 0.05 * known.size


def test_there_are_enough_and_all_kinds_of_them() -> None:
    known = known_optima()
    assert len(known) == len(by_name()) >= 30
    assert max(k.problem.model.nx for k in known) == 3
    assert sum(k.problem.maximize for k in known) >= 5
    assert {type(k.problem.horizon).__name__ for k in known} == {"float", "Free"}
    assert any(k.optimum < 0 for k in known) and any(k.optimum == 0 for k in known)


@pytest.mark.parametrize("name", SHORT)
def test_a_known_optimum_is_what_solve_comes_near_and_never_below(name: str) -> None:
    known = by_name()[name]
    excess = known.excess(solved(known, lanes=0))
    assert -SOLVED <= excess <= known.within


@pytest.mark.parametrize("part", range(PARTS))
def test_no_known_optimum_is_missed_or_bettered_from_many_starts(part: int) -> None:
    for known in part_of_all(part):
        excess = known.excess(solved(known, lanes=32))
        assert -SOLVED <= excess <= known.within, known.name


@pytest.mark.parametrize("name", SHORT)
def test_a_bound_does_not_cross_a_known_optimum(name: str) -> None:
    known = by_name()[name]
    # With the optimum as the answer a bound that is too high would be cut to that.
    bound = lower_bound(
        known.problem, known.x0, known=known.known, answer=a_little_worse(known),
        work=60.0, progress=stop_after(2),
    )  # fmt: skip
    assert not crossing(known, bound)


@pytest.mark.parametrize("part", range(PARTS))
def test_no_bound_crosses_any_known_optimum(part: int) -> None:
    found = [
        crossing(known, bounded(known, work=1.0, answer=answer))
        for known in part_of_all(part)
        for answer in (None, known.optimum, a_little_worse(known))
    ]
    assert not [said for said in found if said]


@pytest.mark.parametrize("answer", [None, better_than_the_best])
def test_no_answer_and_a_wrong_one_make_no_bound_cross(
    answer: Callable[[KnownOptimum], float] | None,
) -> None:
    known = by_name()["regulator"]
    cost = None if answer is None else answer(known)
    assert not crossing(known, bounded(known, work=0.5, answer=cost))


def test_a_crossing_is_seen_in_both_senses() -> None:
    for name in ("regulator", "catch"):
        known = by_name()[name]
        sense = known.problem.sense
        value = known.optimum + sense * 1e-6
        over = LowerBound(kind=BoundKind.PROVEN, value=value, reason="-", sense=sense)
        assert "above" in crossing(known, over)
        value = known.optimum - sense * 1e-6
        under = LowerBound(kind=BoundKind.PROVEN, value=value, reason="-", sense=sense)
        assert not crossing(known, under)
