"""Errors of numbers: starts and bounds that are invalid, or do not fit each other."""

import math
from collections.abc import Callable, Iterator
from functools import partial

import casadi as ca

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Place
from swarmstart.cases.kinds.problem.checks.decided_flaws import (
    bounded_start_flaws,
    decided_flaws,
    interval_text,
)
from swarmstart.cases.kinds.problem.stated.members import Member, members_of, shared_of
from swarmstart.cases.kinds.problem.stated.parts import Control
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    fixed_limits,
    limits,
    moving_limits,
)
from swarmstart.errors import SwarmstartError

Limits = tuple[float, float]


def number_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of starts and bounds that are invalid or do not fit; once each."""
    seen: set[Place] = set()
    yield from decided_flaws(scenario)
    for member in members_of(scenario, shared_of(scenario)):
        for place, what in _of_member(scenario, member):
            if place not in seen:
                seen.add(place)
                yield place, what


def _of_member(scenario: ProblemScenario, member: Member) -> Iterator[LocatedFlaw]:
    starts = dict(zip(scenario.states, member.start, strict=True))
    for name, state in scenario.states.items():
        pair, scope = state.bounds, member.scopes["bounds"]
        for place, found in _ordered(
            ("states", name, "bounds"), partial(fixed_limits, pair, scope)
        ):
            if not isinstance(found, tuple):
                yield place, found
            elif (first := member.tied.get(name, name)) in member.decided:
                yield from bounded_start_flaws(
                    scenario, name, found, member.decided[first]
                )
            elif not found[0] <= starts[name] <= found[1]:
                yield (
                    ("states", name, "start"),
                    f"expected a start within the bounds {interval_text(found)}, "
                    f"found {starts[name]:g}",
                )
    for name, control in scenario.controls.items():
        yield from _of_control(scenario, name, control, member)


def _ordered(
    place: Place, read: Callable[[], Limits]
) -> Iterator[tuple[Place, Limits | str | SwarmstartError]]:
    """Yield a place with its bounds, or with their error."""
    try:
        lower, upper = read()
    except SwarmstartError as error:
        yield place, error
        return
    if lower > upper:
        yield place, f"expected lower <= upper, found {interval_text((lower, upper))}"
    else:
        yield place, (lower, upper)


def _of_control(
    scenario: ProblemScenario, name: str, control: Control, member: Member
) -> Iterator[LocatedFlaw]:
    """Yield errors of a control's bounds, also if a search has nothing to draw."""
    place: Place = ("controls", name, "bounds")
    scope = member.scopes["bounds"]
    ((_, bounds),) = _ordered(place, partial(fixed_limits, control.bounds, scope))
    if not isinstance(bounds, tuple):
        yield place, bounds
        return
    lower, upper = bounds
    if control.search_bounds is not None:
        inner: Place = ("controls", name, "search_bounds")
        own = partial(limits, control.search_bounds, member.constants)
        ((_, within),) = _ordered(inner, own)
        if not isinstance(within, tuple):
            yield inner, within
            return
        lower, upper = max(within[0], lower), min(within[1], upper)
        if lower > upper:
            yield (
                inner,
                f"expected bounds for the search within {interval_text(bounds)}, found "
                f"{interval_text(within)}",
            )
    yield from _not_whole(name, control, bounds, (lower, upper))
    is_bounded = math.isfinite(lower) and math.isfinite(upper)
    if scenario.search.name != "none" and not is_bounded:
        moves = any(
            isinstance(limit, ca.SX) for limit in moving_limits(control.bounds, scope)
        )
        yield (
            place if control.bounds is not None else place[:-1],
            "expected search_bounds, two numbers, beside bounds that move: the search "
            "draws between them"
            if moves
            else "expected bounds of the control, [lower, upper]: the search draws "
            "between them; without a search (search: {name: none}) it may be unbounded",
        )


def _not_whole(
    name: str, control: Control, bounds: Limits, within: Limits
) -> Iterator[LocatedFlaw]:
    """Yield errors of bounds that are not whole for a control of whole numbers."""
    for key, found in (("bounds", bounds), ("search_bounds", within)):
        is_whole = all(b == round(b) for b in found if math.isfinite(b))
        if control.integer and not is_whole:
            yield (
                ("controls", name, key),
                "expected whole numbers as bounds of a control that takes whole "
                f"numbers, found {interval_text(found)}",
            )
            return
