"""Measures of a problem: those of any problem, and own ones that the scenario defines.

Own measures are expressions on the simulated path. The path has one row for each
control interval, with the values at both ends and at the plant's steps between them, so
that a held control jumps from one row to the next.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import (
    FLOAT_OPERATIONS,
    FUNCTIONS,
    REDUCTIONS,
    ExpressionError,
    Operation,
    interpret,
    parse,
)
from swarmstart.cases.format.kind import NEVER, Flight, Measure, Posed, WholeRun
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.measuring.decided_measures import (
    decided_measures,
    decided_values,
    is_decided,
    with_durations,
)
from swarmstart.cases.kinds.problem.measuring.flown_path import (
    Value,
    flown_values,
    integrated,
    path_of,
    path_of_phases,
)
from swarmstart.cases.kinds.problem.stated.members import ProblemPosed
from swarmstart.cases.kinds.problem.stated.model import planning_problem
from swarmstart.cases.kinds.problem.stated.names import (
    MEASURES,
    MEMBERS_MEASURE,
)
from swarmstart.cases.kinds.problem.stated.phases import phase_scenarios, whole_scenario
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, UserScenario
from swarmstart.cases.kinds.problem.stated.symbols import ARRAYS, TIME
from swarmstart.cases.kinds.problem.stated.values import (
    NO_TABLES,
    Tables,
    inputs_of,
    operations_of,
)
from swarmstart.cases.record.trajectory_arrays import effort
from swarmstart.ocp import (
    Mode,
    OptimalControlProblem,
    PolishStatus,
    Trajectory,
)

P = TypeVar("P", bound=Posed)


def measure(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures by name, with None for undefined ones."""
    if scenario.phases:
        found = measured(
            flight,
            trajectory,
            problem=flight.posed.agents[0].problem,
            own=own_values(
                scenario.measures,
                path_of_phases(scenario, flight, trajectory),
                scenario.tabled,
            ),
        )
        return with_durations(scenario, flight.posed.agents[0].problem, found)
    return measured(
        flight,
        trajectory,
        problem=planning_problem(scenario, flight.posed.members),
        own=own_values(
            scenario.measures,
            path_of(scenario, flight, trajectory),
            scenario.tabled,
        ),
    )


def whole_run(
    scenario: UserScenario,
    flight: Flight[Posed],
    trajectory: Trajectory,
    measures: Mapping[str, Measure],
) -> WholeRun:
    """Return the cost of the simulated path and its largest excess over a constraint.

    Terminal constraints count if the one plan was simulated to its end.
    """
    del scenario, trajectory
    names = ["constraint_excess", *["terminal_excess"] * flight.posed.open_loop]
    sense = flight.posed.agents[0].problem.sense
    return WholeRun(
        # Lower is better, also if the user maximises.
        cost=sense * _number(measures["flown_cost"]),
        excess=max(_number(measures[name]) for name in names),
    )


def _number(measured: Measure) -> float:
    """Return a measure as a number; NaN if it is not defined."""
    return float(measured) if isinstance(measured, int | float) else math.nan


def measured(
    flight: Flight[P],
    trajectory: Trajectory,
    *,
    problem: OptimalControlProblem,
    own: Mapping[str, Measure],
) -> dict[str, Measure]:
    """Return own measures and those of any problem, with None for undefined ones.

    Args:
        flight: The flight.
        trajectory: Its path.
        problem: The planning problem of all vehicles together, with one value for each
            uncertain parameter.
        own: Own measures, as from `own_values`.
    """
    plans, sense = trajectory.decisions[0].plans, problem.sense
    # Only a plan that is followed to its end can be verified as a whole.
    is_open = flight.posed.open_loop
    solution = flight.answer(trajectory) if is_open else None
    searched = sum(plan.search.cost for plan in plans)
    flown_cost, path_excess, terminal_excess = flown_values(problem, flight, trajectory)
    measures: dict[str, Measure] = {
        "cost": _finite(sense * sum(plan.cost for plan in plans)),
        "violation": sum(plan.violation for plan in plans),
        "verified_cost": _finite(solution.verified_cost) if solution else None,
        "confirmed": int(solution.status.is_confirmed) if solution else None,
        "converged": int(all(p.polish_status is PolishStatus.CONVERGED for p in plans)),
        "search_cost": _finite(sense * searched),
        "flown_cost": _finite(flown_cost),
        "constraint_excess": _finite(path_excess),
        "terminal_excess": _finite(terminal_excess),
        "infeasible_steps": trajectory.infeasible_steps,
        "stopped_steps": trajectory.stopped_steps,
        "linear_steps": sum(d.mode is Mode.LINEAR for d in trajectory.decisions),
        **effort(trajectory),
    }
    planned_for = flight.posed.agents[0].problem
    more: dict[str, Measure] = {}
    if is_decided(problem):
        more |= decided_values(planned_for, plans[0].x0)
    if planned_for.risk is not None:
        answer = solution or flight.answer(trajectory)
        more[MEMBERS_MEASURE] = [_finite(float(one)) for one in answer.member_costs]
    return {**own, **more, **{name: measures[name] for name in MEASURES}}


def own_values(
    own: Mapping[str, str], path: Mapping[str, Value], tables: Tables = NO_TABLES
) -> dict[str, Measure]:
    """Return own measures by name, with None for one without a finite value.

    Args:
        own: Name -> expression.
        path: The values that they can use, by name.
        tables: The tables that they can use, by name.
    """
    return {name: _own(text, path, tables) for name, text in own.items()}


def own_measures(scenario: UserScenario) -> dict[str, str]:
    """Return the scenario's own measures: name -> reason why the measure can be null.

    In place of a reason, a settling time has the constant NEVER: if it is null, the
    path never settles, so that it exceeds every bound. This does not hold for values
    computed from a settling time, such as `9 - settling(...)`.
    """
    decided = (
        decided_measures(scenario) if isinstance(scenario, ProblemScenario) else {}
    )
    trees = {
        name: parse(text, of_paths=True, functions=None).tree
        for name, text in scenario.measures.items()
    }
    return decided | {
        name: NEVER
        if isinstance(tree, Operation) and tree.name == "settling"
        else "its value is not a finite number"
        for name, tree in trees.items()
    }


def measure_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of the scenario's own measures."""
    owners: dict[str, Mapping[str, str]] = {"": {}}
    if scenario.vehicles is not None:
        owners = {f"_{one.name}": one.constants for one in scenario.vehicles.members}
    parts = (
        [scenario]
        if not scenario.phases
        else [whole_scenario(scenario), *phase_scenarios(scenario)]
    )
    paths = {
        name
        for one in parts
        for names in (one.states, one.controls, one.algebraic, one.definitions)
        for name in names
    }
    known: dict[str, Any] = {
        **dict.fromkeys(scenario.constants, 0.0),
        # Parameters, too: they can change from plan to plan.
        **dict.fromkeys((*scenario.parameters, *scenario.signals, TIME), PATH),
        **{f"{n}{end}": 0.0 for end, own in owners.items() for n in own},
        **{f"{n}{end}": 0.0 for end in owners for n in scenario.constants},
        **{f"{name}{end}": PATH for name in paths for end in owners},
    }
    for name in scenario.measures.keys() & decided_measures(scenario).keys():
        yield (
            ("measures", name),
            f"expected a new name, found {name!r}, a measure of what is decided",
        )
    yield from wrong_measures(scenario.measures, known, scenario.tabled)


def wrong_measures(
    own: Mapping[str, str], known: Mapping[str, Any], tables: Tables = NO_TABLES
) -> Iterator[LocatedFlaw]:
    """Yield errors of own measures.

    Args:
        own: Name -> expression.
        known: Name -> PATH for values along the path, else a number.
        tables: The tables that they can use, by name.
    """
    # Shapes are enough to find errors, and there is no path before a run.
    shapes = {**_SHAPES, **dict.fromkeys(tables, _of_shape)}
    for name, text in own.items():
        place = ("measures", name)
        if name in MEASURES:
            yield (
                place,
                f"expected a new name, found {name!r}, a measure of any problem",
            )
        try:
            found = interpret(
                parse(text, of_paths=True, functions=inputs_of(tables)),
                operations=shapes,
                names=known,
            )
        except ExpressionError as error:
            yield place, error
            continue
        if found is PATH:
            yield (
                place,
                "expected one number, such as x.end, max(x) or integral(x); found a "
                f"path: {text}",
            )


def _own(text: str, path: Mapping[str, Value], tables: Tables) -> float | None:
    """Return the value of an own measure; None if it is not a finite number."""
    expression = parse(text, of_paths=True, functions=inputs_of(tables))
    operations = {**ARRAYS, **operations_of(tables), **_reductions(path[TIME])}
    try:
        # Values that are not finite make the measure null, below.
        with np.errstate(all="ignore"):
            found = interpret(expression, operations=operations, names=path)
    except ExpressionError:
        return None
    return _finite(float(found))


def _reductions(times: Array) -> dict[str, Callable[..., float]]:
    """Return the operations that compute a number from a path."""

    def full(x: Value) -> Array:
        return np.broadcast_to(np.asarray(x, dtype=np.float64), times.shape)

    def integral(x: Value) -> float:
        return integrated(full(x), times)

    def settling(x: Value, target: Value, band: Value) -> float:
        # NaN counts as outside.
        outside = np.flatnonzero(~(np.abs(full(x) - target).ravel() <= band))
        if not outside.size:
            return float(times[0, 0])
        after = outside[-1] + 1
        return float(times.ravel()[after]) if after < times.size else math.nan

    def overshoot(x: Value, target: Value) -> float:
        # Beyond the target, seen from the start.
        beyond = np.sign(target - full(x)[0, 0]) * (full(x) - target)
        return float(np.maximum(0.0, beyond.max()))  # NaN stays NaN.

    return {
        "start": lambda x: float(full(x)[0, 0]),
        "end": lambda x: float(full(x)[-1, -1]),
        "integral": integral,
        "mean": lambda x: integral(x) / float(times[-1, -1] - times[0, 0]),
        "min": lambda *x: float(full(x[0]).min()) if len(x) == 1 else np.minimum(*x),
        "max": lambda *x: float(full(x[0]).max()) if len(x) == 1 else np.maximum(*x),
        "settling": settling,
        "overshoot": overshoot,
    }


PATH = object()
"""Placeholder of values along a path, if only shapes are checked."""


def _of_shape(*arguments: object) -> object:
    return PATH if any(argument is PATH for argument in arguments) else 0.0


_SHAPES: Mapping[str, Callable[..., Any]] = {
    **dict.fromkeys((*FLOAT_OPERATIONS, *FUNCTIONS), _of_shape),
    **dict.fromkeys((*REDUCTIONS, "start", "end"), lambda *_: 0.0),
    **dict.fromkeys(("min", "max"), lambda *x: 0.0 if len(x) == 1 else _of_shape(*x)),
}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
