"""What is measured of a problem: its own measures and those of any problem.

Own measures are expressions on the simulated path: one row for each control interval,
its plant's steps with both ends, so that a held control jumps between rows.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson

from swarmstart.cases.format.expressions import (
    FLOAT_OPERATIONS,
    FUNCTIONS,
    REDUCTIONS,
    ExpressionError,
    interpret,
    parse,
)
from swarmstart.cases.format.kind import NEVER, Flight, Measure
from swarmstart.cases.format.settings import Problem
from swarmstart.cases.kinds.feasibility import found_plans, planned
from swarmstart.cases.kinds.problem.model import planning_problem
from swarmstart.cases.kinds.problem.names import MEASURES
from swarmstart.cases.kinds.problem.pose import ProblemPosed
from swarmstart.cases.kinds.problem.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.symbols import ARRAYS, TIME
from swarmstart.cases.record.plans import effort
from swarmstart.ocp import Mode, OptimalControlProblem, PolishStatus, Trajectory
from swarmstart.ocp.constraints import row_excess

Array = NDArray[np.float64]
Value = Any
"""A number, or values along the path, shape (T, m + 1)."""


def measure(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures by name, null where one is not defined."""
    path = path_of(scenario, flight.posed, trajectory)
    plans, sign = trajectory.decisions[0].plans, -1.0 if scenario.maximize else 1.0
    is_open = flight.posed.open_loop
    solution = flight.answer(trajectory) if is_open else None
    searched = sum(plan.search.cost for plan in plans)
    joint = planning_problem(scenario, flight.posed.members)
    measures: dict[str, Measure] = {
        "cost": _finite(sign * sum(plan.cost for plan in plans)),
        "violation": sum(plan.violation for plan in plans),
        "verified_cost": _finite(sign * solution.verified_cost) if solution else None,
        "confirmed": int(solution.status.is_confirmed) if solution else None,
        "converged": int(all(p.polish_status is PolishStatus.CONVERGED for p in plans)),
        "search_cost": _finite(sign * searched),
        "flown_cost": _flown_cost(scenario, flight.posed, trajectory),
        **_excesses(joint, flight, trajectory),
        "infeasible_steps": sum(
            planned(d) and not found_plans(d) for d in trajectory.decisions
        ),
        "linear_steps": sum(d.mode is Mode.LINEAR for d in trajectory.decisions),
        **effort(trajectory),
    }
    own = {name: _own(text, path) for name, text in scenario.measures.items()}
    return {**own, **{name: measures[name] for name in MEASURES}}


def own_measures(scenario: ProblemScenario) -> dict[str, str]:
    """Return the scenario's own measures: name -> why it is null, where it is."""
    return {
        name: NEVER if "settling" in text else "its value is not a finite number"
        for name, text in scenario.measures.items()
    }


def measure_problems(scenario: ProblemScenario) -> Iterator[Problem]:
    """Yield what is wrong with the scenario's own measures."""
    suffixes = [""]
    if scenario.vehicles is not None:
        suffixes = [f"_{vehicle.name}" for vehicle in scenario.vehicles.members]
    paths = (*scenario.states, *scenario.controls, *scenario.definitions)
    known: dict[str, Any] = {
        **dict.fromkeys(scenario.constants, 0.0),
        **dict.fromkeys((*scenario.parameters, *scenario.signals, TIME), _PATH),
        **{f"{name}{suffix}": _PATH for name in paths for suffix in suffixes},
    }
    for name, text in scenario.measures.items():
        place = ("measures", name)
        if name in MEASURES:
            yield (
                place,
                f"expected a new name, found {name!r}, a measure of any problem",
            )
        try:
            found = interpret(
                parse(text, of_paths=True), operations=_SHAPES, names=known
            )
        except ExpressionError as error:
            yield place, error
            continue
        if found is _PATH:
            yield (
                place,
                "expected one number, such as x.end, max(x) or integral(x); found a "
                f"path: {text}",
            )


def path_of(
    scenario: ProblemScenario, posed: ProblemPosed, trajectory: Trajectory
) -> dict[str, Value]:
    """Return name -> number or values along the simulated path, shape (T, m + 1).

    Names of states, controls and definitions end with the vehicle's suffix.
    """
    together: dict[str, Value] = {}
    for own, suffix, member in _of_members(scenario, posed, trajectory):
        together |= {
            name
            if name in member.constants or name in _shared(posed)
            else f"{name}{suffix}": v
            for name, v in own.items()
        }
    return together


def _shared(posed: ProblemPosed) -> set[str]:
    return {TIME, *posed.known}


def _of_members(
    scenario: ProblemScenario, posed: ProblemPosed, trajectory: Trajectory
) -> Iterator[tuple[dict[str, Value], str, Any]]:
    """Yield each vehicle's own names with their values, its suffix, and itself."""
    times = _by_interval(trajectory.dense_times[None], trajectory)[0]
    flat = times.reshape(-1)
    shared = {n: f(flat).reshape(times.shape) for n, f in posed.known.items()}
    states = _by_interval(trajectory.dense_states, trajectory)
    controls = np.repeat(trajectory.controls[:, :, None], times.shape[1], axis=2)
    nx, nu = len(scenario.states), len(scenario.controls)
    for number, member in enumerate(posed.members):
        own: dict[str, Value] = {
            **member.constants,
            TIME: times,
            **shared,
            **dict(zip(scenario.states, states[number * nx :], strict=False)),
            **dict(zip(scenario.controls, controls[number * nu :], strict=False)),
        }
        for name, text in scenario.definitions.items():
            own[name] = _along(text, own)
        yield own, member.suffix, member


def _by_interval(dense: Array, trajectory: Trajectory) -> Array:
    """Return dense rows (n, T * m + 1) as (n, T, m + 1), ends of intervals twice."""
    count = trajectory.controls.shape[1]
    steps = (dense.shape[1] - 1) // count
    starts = np.arange(count)[:, None] * steps
    return dense[:, starts + np.arange(steps + 1)]


def _along(text: str, names: Mapping[str, Value]) -> Value:
    with np.errstate(all="ignore"):
        return interpret(parse(text), operations=ARRAYS, names=names)


def _own(text: str, path: Mapping[str, Value]) -> float | None:
    """Return the value of an own measure; None if it is not a finite number."""
    operations = {**ARRAYS, **_reductions(path[TIME])}
    try:
        with np.errstate(all="ignore"):
            found = interpret(
                parse(text, of_paths=True), operations=operations, names=path
            )
    except ExpressionError:
        return None
    return _finite(float(found))


def _reductions(times: Array) -> dict[str, Callable[..., float]]:
    """Return the operations that make a number of a path."""

    def full(x: Value) -> Array:
        return np.broadcast_to(np.asarray(x, dtype=np.float64), times.shape)

    def integral(x: Value) -> float:
        return float(simpson(full(x), x=times, axis=1).sum())

    def settling(x: Value, target: Value, band: Value) -> float:
        outside = np.flatnonzero(np.abs(full(x) - target).ravel() > band)
        if not outside.size:
            return float(times[0, 0])
        after = outside[-1] + 1
        return float(times.ravel()[after]) if after < times.size else math.nan

    def overshoot(x: Value, target: Value) -> float:
        beyond = np.sign(target - full(x)[0, 0]) * (full(x) - target)
        return float(max(0.0, beyond.max()))

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


_PATH = object()
"""Stands for values along a path where only shapes are looked at."""


def _of_shape(*arguments: object) -> object:
    return _PATH if any(argument is _PATH for argument in arguments) else 0.0


_SHAPES: Mapping[str, Callable[..., Any]] = {
    **dict.fromkeys((*FLOAT_OPERATIONS, *FUNCTIONS), _of_shape),
    **dict.fromkeys((*REDUCTIONS, "start", "end"), lambda *_: 0.0),
    **dict.fromkeys(("min", "max"), lambda *x: 0.0 if len(x) == 1 else _of_shape(*x)),
}


def _flown_cost(
    scenario: ProblemScenario, posed: ProblemPosed, trajectory: Trajectory
) -> float | None:
    """Return what the simulated path costs; None if that is not finite."""
    total = 0.0
    for own, _, _ in _of_members(scenario, posed, trajectory):
        of_path = _reductions(own[TIME])
        total += of_path["integral"](_along(scenario.stage_cost, own))
        total += of_path["end"](_along(scenario.terminal_cost, own))
    return _finite(total)


def _excesses(
    joint: OptimalControlProblem, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> dict[str, Measure]:
    """Return the largest excess of path and of terminal constraints, 0 if all hold.

    Args:
        joint: The problem of all vehicles.
        flight: The flight.
        trajectory: Its path.
    """
    model, posed = joint.model, flight.posed
    times = _by_interval(trajectory.dense_times[None], trajectory)
    states = _by_interval(trajectory.dense_states, trajectory).reshape(model.nx, -1)
    controls = np.repeat(trajectory.controls, times.shape[2], axis=1)
    rows = [posed.known[str(name)] for name in ca.vertsplit(model.parameters)]
    signals = [posed.known[str(name)] for name in ca.vertsplit(joint.signals)]
    at = times.reshape(-1)
    given = [
        np.stack([f(at) for f in some]) if some else np.empty((0, at.size))
        for some in (rows, signals)
    ]
    arguments = [states, controls, *given]
    symbols = list(joint.symbols().values())
    found: dict[str, Measure] = {}
    for name, constraints, last in (
        ("constraint_excess", joint.path_constraints, slice(None)),
        ("terminal_excess", joint.terminal_constraints, slice(-1, None)),
    ):
        excess = [row_excess(c.rows(c.expression)) for c in constraints]
        over = ca.Function("excess", symbols, [ca.vertcat(ca.SX(0, 1), *excess)])
        values = np.array(over.map(at[last].size)(*(a[:, last] for a in arguments)))
        found[name] = _finite(float(values.max(initial=0.0)))
    return found


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
