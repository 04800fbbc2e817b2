"""The model of a problem and its planning problem, of one vehicle or of several.

    x' = rate(t, x, u, p, s),  x+ = next(t, x, u, p, s) at the end of an interval,
    J = integral of stage_cost + step_cost of each interval + initial and terminal cost

with the time t, states x, controls u, parameters p and signals s. Several vehicles
share parameters and signals. If they are planned jointly they are stacked. If they are
planned one after another, each has a problem of its own, with the positions of those
before it as its last signals. Constraints are those of each vehicle, and the separation
of each pair.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.kinds.problem.stated.members import Member, column_of
from swarmstart.cases.kinds.problem.stated.parts import (
    Constraint,
    Control,
    Distance,
    PathLimit,
    State,
    equation_of,
)
from swarmstart.cases.kinds.problem.stated.scenario import (
    ProblemScenario,
    Vehicles,
)
from swarmstart.cases.kinds.problem.stated.symbols import (
    TIMING_S,
    decided_parameters,
    fixed_limits,
    free,
    limits,
    moving_limits,
    number,
)
from swarmstart.cases.kinds.problem.stated.values import Decided, Table
from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    Connection,
    Free,
    HeldSignals,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Separation,
    TerminalConstraint,
)
from swarmstart.ocp.statement import FEATURES, Feature
from swarmstart.ocp.system import MovingLimit

COSTS = ("stage_cost", "step_cost", "initial_cost", "terminal_cost")


def model_of(
    scenario: ProblemScenario,
    members: Sequence[Member],
    *,
    disturbed: bool = False,
    timed: bool = False,
) -> Model:
    """Return one model with the states and controls of all members.

    Args:
        scenario: The scenario.
        members: The members.
        disturbed: Whether disturbances are parameters after those of the file, member
            after member, for a plant.
        timed: Whether the time is an input even if no rate depends on it.
    """
    shared = members[0].shared
    pushed = scenario.modelled.disturbance if disturbed else ()
    pushes = {
        (member.suffix, name): ca.SX.sym(f"disturbance_{name}{member.suffix}")
        for member in members
        for name in scenario.states
        if name in pushed
    }
    ode = column_of(
        member.scopes["rate"].symbol(state.rate or "0")
        + pushes.get((member.suffix, name), 0)
        for member in members
        for name, state in scenario.states.items()
    )
    next_state = _next_state(scenario, members)
    equations = _equations(scenario, members)
    changes = ca.vertcat(ode, next_state)
    if equations is not None:
        changes = ca.vertcat(changes, equations.residual, equations.start)
    signals = column_of(shared.signals.values())
    return Model(
        states=column_of(s for member in members for s in member.states.values()),
        controls=column_of(u for member in members for u in member.controls.values()),
        ode=ode,
        next_state=next_state,
        parameters=column_of([*shared.parameters.values(), *pushes.values()]),
        # Signals of costs and constraints alone are those of the problem.
        signals=signals if _uses(changes, signals) else ca.SX(0, 1),
        time=shared.time if timed or _uses(changes, shared.time) else ca.SX(0, 1),
        state_names=tuple(n for m in members for n in m.titled(m.states)),
        control_names=tuple(n for m in members for n in m.titled(m.controls)),
        algebraic=equations,
        units=_units(scenario, members),
    )


def _units(scenario: ProblemScenario, members: Sequence[Member]) -> dict[str, str]:
    """Return the units of the members' states and controls, as far as stated."""
    units = {name: state.unit for name, state in scenario.states.items()}
    units |= {name: control.unit for name, control in scenario.controls.items()}
    return {
        title: units[name]
        for member in members
        for symbols in (member.states, member.controls)
        for name, title in zip(symbols, member.titled(symbols), strict=True)
        if units[name]
    }


def _next_state(scenario: ProblemScenario, members: Sequence[Member]) -> ca.SX:
    """Return the states after an interval's end; empty if none of them jumps."""
    if all(state.next is None for state in scenario.states.values()):
        return ca.SX(0, 1)
    return column_of(
        member.states[name]
        if state.next is None
        else member.scopes["next"].symbol(state.next)
        for member in members
        for name, state in scenario.states.items()
    )


def _equations(
    scenario: ProblemScenario, members: Sequence[Member]
) -> AlgebraicEquations | None:
    """Return the algebraic equations of all members together; None without any."""
    given = [
        (member, equation_of(one))
        for member in members
        for one in scenario.algebraic.values()
    ]
    if not given:
        return None
    return AlgebraicEquations(
        symbols=column_of(z for member in members for z in member.algebraic.values()),
        residual=column_of(m.scopes["algebraic"].symbol(e.equation) for m, e in given),
        start=column_of(m.scopes["algebraic_start"].symbol(e.start) for m, e in given),
        scale=np.array([number(e.scale, m.constants) for m, e in given]),
        iterations=scenario.prediction.newton_iterations,
    )


def planning_problem(
    scenario: ProblemScenario, members: Sequence[Member], *, seen: Sequence[Member] = ()
) -> OptimalControlProblem:
    """Return the planning problem of some members.

    Args:
        scenario: The scenario.
        members: Members that are planned together.
        seen: Other members, whose positions are the last signals. If plans are
            committed, the last signals are the positions of these members in committed
            plans, their positions in candidate plans, and a length to be added to the
            least distance.
    """
    first, grid = members[0], scenario.prediction
    vehicles = scenario.vehicles
    separation = None if vehicles is None else vehicles.separation
    dimensions = 0 if separation is None else len(separation.of)
    is_committed = vehicles is not None and vehicles.is_committed and bool(seen)
    kinds = ("committed", "candidate") if is_committed else ("position",)
    others = [
        (m, ca.SX.sym(f"{kind}{m.suffix}", dimensions)) for kind in kinds for m in seen
    ]
    reserve = ca.SX.sym("reserve", int(is_committed))
    costs = {place: _cost(scenario, members, place) for place in COSTS}
    constraints = [
        *(path_constraint(c, member) for member in members for c in scenario.path),
        *separations(vehicles, members, others, reserve),
    ]
    terminal = [
        terminal_constraint(c, member) for member in members for c in scenario.terminal
    ]
    bounds = _bounds(scenario, members)
    # Time and previous controls are inputs only if something depends on them.
    used = column_of(
        [
            *costs.values(),
            *(c.expression for c in (*constraints, *terminal)),
            *_moving(bounds),
        ]
    )
    previous = column_of(u for m in members for u in m.previous.values())
    return OptimalControlProblem(
        model_of(scenario, members, timed=_uses(used, first.shared.time)),
        horizon=horizon_of(scenario, first.constants),
        intervals=grid.intervals,
        stage_cost=costs["stage_cost"],
        step_cost=costs["step_cost"],
        initial_cost=costs["initial_cost"],
        terminal_cost=costs["terminal_cost"],
        maximize=scenario.maximize,
        bounds=bounds,
        constraints=constraints,
        terminal=terminal,
        start={names: one for m in members for names, one in m.starts().items()},
        periodic=_periodic(scenario, members),
        decided=decided_parameters(scenario, first.constants),
        previous=previous if _uses(used, previous) else ca.SX(0, 1),
        signals=column_of(
            [*first.shared.signals.values(), *(symbol for _, symbol in others), reserve]
        ),
        control_shape=grid.control_shape,
        scales=_scales(scenario, members),
        quadrature=grid.quadrature,
        integrator=grid.integrator,
        substeps=grid.substeps,
        transcription=grid.collocation,
        integrator_tolerance=grid.integrator_tolerance,
        checks=grid.checks,
        blocks=grid.blocks,
        tolerance=grid.tolerance,
        path_tolerance=grid.path_tolerance,
        features=_features(scenario, members),
    )


def _features(scenario: ProblemScenario, members: Sequence[Member]) -> list[Feature]:
    """Return the features of the controls of all members."""
    found: list[Feature] = []
    for key, feature in FEATURES.items():
        given = {
            f"{name}{member.suffix}": number(getattr(control, key), member.constants)
            for member in members
            for name, control in scenario.controls.items()
            if getattr(control, key) is not None
        }
        if given:
            found.append(feature(given))
    held = _held(scenario, members[0].constants)
    return [*found, HeldSignals(held)] if held else found


def _held(scenario: ProblemScenario, constants: Mapping[str, float]) -> list[str]:
    """Return the signals that plans hold: tables that jump where intervals begin.

    Plans that end at a fixed time have intervals of other lengths, and those of a team
    that commits to its plans have no jumps at all.
    """
    feedback, vehicles = scenario.feedback, scenario.vehicles
    committed = vehicles is not None and vehicles.is_committed
    if feedback.ends_at_s is not None or feedback.period_s is not None or committed:
        return []
    horizon = horizon_of(scenario, constants)
    if isinstance(horizon, Free):
        return []
    dt, found = horizon / scenario.prediction.intervals, []
    for name, given in scenario.signals.items():
        if isinstance(given, Table) and given.between == "hold":
            jumps = np.array(given.times[1:])[np.diff(given.values) != 0]
            off = np.abs(jumps - dt * np.rint(jumps / dt))
            if jumps.size and (off <= TIMING_S).all():
                found.append(name)
    return found


def _periodic(scenario: ProblemScenario, members: Sequence[Member]) -> list[str]:
    """Return the names of the periodic states of all members."""
    names = [name for name, state in scenario.states.items() if state.periodic]
    return [f"{name}{member.suffix}" for member in members for name in names]


def _moving(bounds: Bounds) -> Iterator[ca.SX]:
    """Yield the bounds that are expressions."""
    for pair in (bounds.controls, bounds.states):
        for side in pair or ():
            if isinstance(side, list):
                yield from side


def horizon_of(
    scenario: ProblemScenario, constants: Mapping[str, float]
) -> float | Free:
    """Return the length of the horizon [s], or the bounds of a decided one.

    In discrete time it can be left out; it is then the number of intervals, each of
    which lasts 1.
    """
    given = scenario.prediction.horizon_s
    if given is None:
        return float(scenario.prediction.intervals)
    return free(given, constants) if isinstance(given, Decided) else given


def interval_of(scenario: ProblemScenario, constants: Mapping[str, float]) -> float:
    """Return the length of a control interval of the plant [s].

    If the end time is decided and no `period_s` is given, it follows from the guess.
    """
    horizon = horizon_of(scenario, constants)
    if scenario.feedback.period_s is not None:
        return scenario.feedback.period_s
    length = horizon.first if isinstance(horizon, Free) else horizon
    return length / scenario.prediction.intervals


def previous_controls(
    scenario: ProblemScenario, members: Sequence[Member]
) -> Array | None:
    """Return the controls before the first interval; None if none is given.

    Controls that are not given are those nearest to zero within their bounds.
    """
    if all(control.previous is None for control in scenario.controls.values()):
        return None
    values = [
        np.clip(0.0, *fixed_limits(control.bounds, member.scopes["bounds"]))
        if control.previous is None
        else number(control.previous, member.constants)
        for member in members
        for control in scenario.controls.values()
    ]
    return np.array(values)


def _uses(expression: ca.SX, symbols: ca.SX) -> bool:
    """Return whether an expression depends on any of some symbols."""
    return bool(symbols.numel()) and bool(ca.depends_on(expression, symbols))


def positions_of(scenario: ProblemScenario) -> tuple[int, ...]:
    """Return the indices of the states that are the coordinates of the separation.

    Each coordinate must be the name of a state. Empty if there is no separation.
    """
    if scenario.vehicles is None or scenario.vehicles.separation is None:
        return ()
    names = list(scenario.states)
    return tuple(names.index(name.strip()) for name in scenario.vehicles.separation.of)


def _cost(scenario: ProblemScenario, members: Sequence[Member], place: str) -> ca.SX:
    """Return the sum of all members' costs."""
    text = getattr(scenario, place)
    first, *others = (member.scopes[place].symbol(text) for member in members)
    return sum(others, first)


def _bounds(scenario: ProblemScenario, members: Sequence[Member]) -> Bounds:
    states, controls = scenario.states.values(), scenario.controls.values()
    scopes = [member.scopes["bounds"] for member in members]
    of_controls = [moving_limits(c.bounds, one) for one in scopes for c in controls]
    of_states = [moving_limits(s.bounds, one) for one in scopes for s in states]
    of_search = [
        fixed_limits(c.bounds, m.scopes["bounds"])
        if c.search_bounds is None
        else limits(c.search_bounds, m.constants)
        for m in members
        for c in controls
    ]
    is_narrower = any(c.search_bounds is not None for c in controls)
    return Bounds(
        controls=_pair(of_controls),
        search=_arrays(of_search) if is_narrower else None,
        states=_pair(of_states),
        integer=[
            name
            for member in members
            for name, control in zip(
                member.titled(scenario.controls), controls, strict=True
            )
            if control.integer
        ],
    )


def _pair(
    ranges: Sequence[tuple[float | ca.SX, float | ca.SX]],
) -> tuple[MovingLimit, MovingLimit]:
    """Return lower and upper limits: arrays, or lists if any limit changes."""
    lower, upper = ([*side] for side in zip(*ranges, strict=True))
    if any(isinstance(one, ca.SX) for one in (*lower, *upper)):
        return lower, upper
    return np.array(lower), np.array(upper)


def _scales(scenario: ProblemScenario, members: Sequence[Member]) -> dict[str, float]:
    """Return the given sizes of states and controls, by name."""
    given: dict[str, State | Control] = {**scenario.states, **scenario.controls}
    return {
        f"{name}{member.suffix}": number(part.scale, member.constants)
        for member in members
        for name, part in given.items()
        if part.scale is not None
    }


def _arrays(ranges: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    lower, upper = np.array(ranges).T
    return lower, upper


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
        # One of both is given, as `_one_limit` of the part checks.
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
    part: Vehicles | None,
    members: Sequence[Member],
    others: Sequence[tuple[Member, ca.SX]],
    reserve: ca.SX,
) -> list[Separation]:
    """Return the separations of all pairs of members, and of members from others.

    Args:
        part: The vehicles.
        members: Members that are planned together.
        others: Other members, each with the symbol of its position.
        reserve: Symbol of a length that is added to the distance; an empty column adds
            nothing.
    """
    if part is None or part.separation is None:
        return []
    given, constants = part.separation, members[0].constants
    places = [
        column_of(m.scopes["path"].symbol(text) for text in given.of) for m in members
    ]
    pairs = [
        (a - b, f"distance{members[i].suffix}{members[j].suffix}")
        for (i, a), (j, b) in itertools.combinations(enumerate(places), 2)
    ]
    pairs += [
        (place - position, f"distance{other.suffix}{member.suffix}")
        for member, place in zip(members, places, strict=True)
        for other, position in others
    ]
    margin, distance = (
        number(given.margin, constants),
        number(given.distance, constants),
    )
    if reserve.numel():
        distance = committed_distance(part, constants)
        # |r| >= d + reserve, with a distance that is a number.
        share = distance / (distance + reserve)
        pairs = [(relative * share, name) for relative, name in pairs]
    return [
        Separation(
            relative=relative,
            distance=distance,
            margin=margin,
            smooth_margin=margin,
            along=given.along,
            scale=_optional(given.scale, members[0]),
            name=name,
        )
        for relative, name in pairs
    ]


def committed_distance(part: Vehicles, constants: Mapping[str, float]) -> float:
    """Return the distance that committed plans keep: the least, plus twice the error.

    The error is the largest distance of a vehicle from its committed plan.
    """
    text = "0" if part.separation is None else part.separation.distance
    error = number(part.tracking_error, constants)
    return number(text, constants) + 2.0 * error


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
