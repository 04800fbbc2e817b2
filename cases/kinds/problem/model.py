"""The model of a problem and its planning problem, of one vehicle or of several.

    x' = rate(x, u, p),  J = integral of stage_cost + terminal_cost, per vehicle

Several vehicles share parameters and signals; planned jointly they are stacked, one
after another each has a problem of its own with the positions of those before it as
its last signals.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.format.expressions import parse
from swarmstart.cases.kinds.problem.scenario import (
    Constraint,
    Distance,
    ProblemScenario,
    SeparationPart,
    Vehicle,
)
from swarmstart.cases.kinds.problem.symbols import (
    TIME,
    Scope,
    constants_of,
    limits,
    number,
    over_time,
)
from swarmstart.ocp import (
    Bounds,
    Connection,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Separation,
    TerminalConstraint,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shared:
    """Symbols that all vehicles share.

    Attributes:
        parameters: Name -> symbol.
        signals: Name -> symbol.
    """

    parameters: Mapping[str, ca.SX]
    signals: Mapping[str, ca.SX]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Member:
    """A vehicle with its symbols; without `vehicles` there is one, without a name.

    Attributes:
        suffix: Follows the names of its states and controls in the results.
        constants: Name -> number.
        start: Its states at the start, shape (nx,).
        states: Name -> symbol.
        controls: Name -> symbol.
        shared: Symbols of all.
        scopes: Where an expression stands -> the names that it may use.
    """

    suffix: str
    constants: Mapping[str, float]
    start: Array
    states: Mapping[str, ca.SX]
    controls: Mapping[str, ca.SX]
    shared: Shared
    scopes: Mapping[str, Scope]

    def titled(self, names: Mapping[str, object]) -> tuple[str, ...]:
        """Return names with its suffix."""
        return tuple(f"{name}{self.suffix}" for name in names)


def shared_of(scenario: ProblemScenario) -> Shared:
    """Return new symbols for parameters and signals."""
    return Shared(
        parameters=_symbols(scenario.parameters), signals=_symbols(scenario.signals)
    )


def members_of(scenario: ProblemScenario, shared: Shared) -> tuple[Member, ...]:
    """Return the vehicles with symbols of their own.

    Raises:
        ExpressionError: If an expression has no value.
    """
    if scenario.vehicles is None:
        return (_member(scenario, shared, None),)
    return tuple(_member(scenario, shared, one) for one in scenario.vehicles.members)


def model_of(
    scenario: ProblemScenario, members: Sequence[Member], *, disturbed: bool = False
) -> Model:
    """Return the members side by side as one model.

    Args:
        scenario: The scenario.
        members: The members.
        disturbed: Whether disturbances are parameters after the file's own, those of
            one member after those of another: for a plant.
    """
    shared = members[0].shared
    parameters, rates = [*shared.parameters.values()], []
    for member in members:
        for name, state in scenario.states.items():
            rate = member.scopes["rate"].symbol(state.rate)
            if disturbed and name in scenario.plant.disturbance:
                parameters.append(ca.SX.sym(f"disturbance_{name}{member.suffix}"))
                rate += parameters[-1]
            rates.append(rate)
    return Model(
        states=_column(s for member in members for s in member.states.values()),
        controls=_column(u for member in members for u in member.controls.values()),
        ode=_column(rates),
        parameters=_column(parameters),
        state_names=tuple(n for m in members for n in m.titled(m.states)),
        control_names=tuple(n for m in members for n in m.titled(m.controls)),
    )


def planning_problem(
    scenario: ProblemScenario, members: Sequence[Member], *, seen: Sequence[Member] = ()
) -> OptimalControlProblem:
    """Return the planning problem of some members.

    Args:
        scenario: The scenario.
        members: Those that are planned together.
        seen: Others whose positions are the last signals.
    """
    first, grid = members[0], scenario.prediction
    separation = None if scenario.vehicles is None else scenario.vehicles.separation
    dimensions = 0 if separation is None else len(separation.of)
    others = [ca.SX.sym(f"position{m.suffix}", dimensions) for m in seen]
    return OptimalControlProblem(
        model_of(scenario, members),
        stage_cost=_cost(scenario, members, "stage_cost"),
        terminal_cost=_cost(scenario, members, "terminal_cost"),
        bounds=_bounds(scenario, members),
        constraints=[
            *(path_constraint(c, member) for member in members for c in scenario.path),
            *_separations(separation, members, dict(zip(seen, others, strict=True))),
        ],
        terminal=[
            terminal_constraint(c, member)
            for member in members
            for c in scenario.terminal
        ],
        signals=_column([*first.shared.signals.values(), *others]),
        quadrature=grid.quadrature,
        **grid.grid(),
        tolerance=grid.tolerance,
        path_tolerance=grid.path_tolerance,
    )


def positions_of(scenario: ProblemScenario) -> tuple[int, ...]:
    """Return the rows of the states that a separation is of; they must be states."""
    if scenario.vehicles is None or scenario.vehicles.separation is None:
        return ()
    names = list(scenario.states)
    return tuple(names.index(name.strip()) for name in scenario.vehicles.separation.of)


def candidate_scopes(
    scenario: ProblemScenario,
    members: Sequence[Member],
    constants: Mapping[str, float],
    time: float,
) -> list[Scope]:
    """Return the names that candidates may use, with their values at a time [s].

    Args:
        scenario: The scenario.
        members: Those that are planned together.
        constants: The file's, as numbers.
        time: When the plan is made.
    """
    values = {
        name: float(over_time(given, constants)(np.array([time]))[0])
        for name, given in scenario.parameters.items()
    }
    return [
        Scope({**m.constants, **values, TIME: time}, {}, "candidates") for m in members
    ]


def _symbols(names: Mapping[str, object], suffix: str = "") -> dict[str, ca.SX]:
    return {name: ca.SX.sym(f"{name}{suffix}") for name in names}


def _column(entries: Any) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *entries)


def _member(
    scenario: ProblemScenario, shared: Shared, vehicle: Vehicle | None
) -> Member:
    suffix = "" if vehicle is None else f"_{vehicle.name}"
    constants = constants_of(scenario, vehicle.constants if vehicle else None)
    given = vehicle.start if vehicle else {}
    start = [
        number(given.get(name, state.start or "0"), constants)
        for name, state in scenario.states.items()
    ]
    states = _symbols(scenario.states, suffix)
    controls = _symbols(scenario.controls, suffix)
    return Member(
        suffix=suffix,
        constants=constants,
        start=np.array(start),
        states=states,
        controls=controls,
        shared=shared,
        scopes=_scopes(scenario, shared, constants, (states, controls)),
    )


def _scopes(
    scenario: ProblemScenario,
    shared: Shared,
    constants: Mapping[str, float],
    own: tuple[Mapping[str, ca.SX], Mapping[str, ca.SX]],
) -> dict[str, Scope]:
    """Return what may stand where: rates know no signals, ends no controls.

    A definition may stand where all that it uses may.
    """
    states, controls = own
    roles: dict[str, Mapping[str, Any]] = {
        "constant": constants,
        "state": states,
        "control": controls,
        "parameter": shared.parameters,
        "signal": shared.signals,
    }
    kinds = {name: role for role, names in roles.items() for name in names}
    barred = {
        "rate": ("signal",),
        "stage_cost": (),
        "path": (),
        "terminal_cost": ("control",),
        "terminal": ("control",),
    }
    everything = {name: v for names in roles.values() for name, v in names.items()}
    uses: dict[str, frozenset[str]] = {n: frozenset({k}) for n, k in kinds.items()}
    for name, text in scenario.definitions.items():
        scope = Scope(everything, {}, "a definition")
        everything = {**everything, name: scope.symbol(text)}
        of_parts = [uses.get(part, frozenset()) for part in parse(text).names]
        uses[name] = frozenset().union(*of_parts)
    return {
        place: Scope(
            {n: v for n, v in everything.items() if not uses[n] & {*without}},
            {n: _said(n, uses[n] & {*without}, kinds) for n in everything},
            place,
        )
        for place, without in barred.items()
    }


def _said(name: str, roles: frozenset[str], kinds: Mapping[str, str]) -> str:
    """Return what a name is, in words, where it may not stand."""
    role = next(iter(sorted(roles)), "")
    return role if name in kinds else f"definition with a {role}"


def _cost(scenario: ProblemScenario, members: Sequence[Member], place: str) -> ca.SX:
    """Return the sum of all members' costs, to be minimised."""
    text = getattr(scenario, place)
    first, *others = (member.scopes[place].symbol(text) for member in members)
    total = sum(others, first)
    return -total if scenario.maximize else total


def _bounds(scenario: ProblemScenario, members: Sequence[Member]) -> Bounds:
    states, controls = scenario.states.values(), scenario.controls.values()
    of_controls = [limits(c.bounds, m.constants) for m in members for c in controls]
    of_states = [limits(s.bounds, m.constants) for m in members for s in states]
    return Bounds(controls=_pair(of_controls), states=_pair(of_states))


def _pair(ranges: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    lower, upper = np.array(ranges).T
    return lower, upper


def _scale(text: str | None, member: Member) -> float | None:
    return None if text is None else number(text, member.constants)


def path_constraint(given: Constraint | Distance, member: Member) -> Any:
    """Return a path constraint of a member."""
    name = f"{given.name}{member.suffix}" if given.name else ""
    scope, scale = member.scopes["path"], _scale(given.scale, member)
    if isinstance(given, Constraint):
        lower, upper = _limits(given, member)
        return PathConstraint(
            expression=scope.symbol(given.expression),
            lower=lower,
            upper=upper,
            scale=scale,
            name=name or f"{given.expression}{member.suffix}",
        )
    relative = _column(scope.symbol(text) for text in given.distance)
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
        scale=_scale(given.scale, member),
        name=f"{given.name or given.expression}{member.suffix}",
    )


def _limits(given: Constraint, member: Member) -> tuple[float, float]:
    """Return lower and upper limit; without any the expression is to be 0."""
    if given.equals is not None:
        value = number(given.equals, member.constants)
        return value, value
    if given.lower is None and given.upper is None:
        return 0.0, 0.0
    return limits((given.lower, given.upper), member.constants)


def _separations(
    part: SeparationPart | None,
    members: Sequence[Member],
    others: Mapping[Member, ca.SX],
) -> list[Separation]:
    """Return the distances of every two members, and of each from those it sees."""
    if part is None:
        return []
    places = [
        _column(m.scopes["path"].symbol(text) for text in part.of) for m in members
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
            scale=_scale(part.scale, members[0]),
            name=name,
        )
        for relative, name in pairs
    ]
