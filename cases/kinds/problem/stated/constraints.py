"""The constraints of a problem: of each vehicle, and of each pair."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from swarmstart.cases.kinds.problem.stated.members import Member, column_of
from swarmstart.cases.kinds.problem.stated.parts import (
    Constraint,
    Distance,
    PathLimit,
    SeparationPart,
)
from swarmstart.cases.kinds.problem.stated.symbols import limits, number
from swarmstart.ocp import Connection, PathConstraint, Separation, TerminalConstraint


def path_constraint(given: Constraint | Distance, member: Member) -> Any:
    """Return a path constraint of a member."""
    name = f"{given.name}{member.suffix}" if given.name else ""
    scope, scale = member.scopes["path"], _optional(given.scale, member)
    if isinstance(given, Constraint):
        lower, upper = _limits(given, member)
        soft = given.soft if isinstance(given, PathLimit) else None
        weight, quadratic = (
            (None, None) if soft is None else (soft.weight, soft.quadratic)
        )
        return PathConstraint(
            expression=scope.symbol(given.expression),
            lower=lower,
            upper=upper,
            scale=scale,
            name=name or f"{given.expression}{member.suffix}",
            weight=_optional(weight, member),
            quadratic_weight=_optional(quadratic, member),
        )
    relative = column_of(scope.symbol(text) for text in given.distance)
    margin = number(given.margin, member.constants)
    if given.at_most is not None:
        return Connection(
            relative=relative,
            distance=number(given.at_most, member.constants),
            margin=margin,
            scale=scale,
            name=name,
        )
    return Separation(
        relative=relative,
        distance=number(given.at_least or "0", member.constants),
        margin=margin,
        smooth_margin=margin,
        along=given.along,
        measure=given.measure,
        scale=scale,
        name=name,
    )


def terminal_constraint(given: Constraint, member: Member) -> TerminalConstraint:
    """Return a terminal constraint of a member."""
    lower, upper = _limits(given, member)
    return TerminalConstraint(
        expression=member.scopes["terminal"].symbol(given.expression),
        lower=lower,
        upper=upper,
        scale=_optional(given.scale, member),
        name=f"{given.name or given.expression}{member.suffix}",
    )


def separations(
    part: SeparationPart | None,
    members: Sequence[Member],
    others: Mapping[Member, ca.SX],
) -> list[Separation]:
    """Return the distances of all pairs of members, and to seen members."""
    if part is None:
        return []
    places = [
        column_of(m.scopes["path"].symbol(text) for text in part.of) for m in members
    ]
    pairs = [
        (a - b, f"distance{members[i].suffix}{members[j].suffix}")
        for (i, a), (j, b) in itertools.combinations(enumerate(places), 2)
    ]
    pairs += [
        (place - position, f"distance{other.suffix}{member.suffix}")
        for member, place in zip(members, places, strict=True)
        for other, position in others.items()
    ]
    constants = members[0].constants
    margin = number(part.margin, constants)
    return [
        Separation(
            relative=relative,
            distance=number(part.distance, constants),
            margin=margin,
            smooth_margin=margin,
            along=part.along,
            scale=_optional(part.scale, members[0]),
            name=name,
        )
        for relative, name in pairs
    ]


def _limits(given: Constraint, member: Member) -> tuple[float, float]:
    """Return lower and upper limit; without limits the expression must be 0."""
    if given.equals is not None:
        value = number(given.equals, member.constants)
        return value, value
    if given.lower is None and given.upper is None:
        return 0.0, 0.0
    return limits((given.lower, given.upper), member.constants)


def _optional(text: str | None, member: Member) -> float | None:
    return None if text is None else number(text, member.constants)
