"""The simulated path of a problem: rows, values by name, cost and constraints.

The path has one row for each control interval, with the values at both ends and at the
plant's steps between them, so that a held control jumps from one row to the next. The
scenario's own measures take these values by the names in its file.
"""

from collections.abc import Mapping
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import interpret, parse, previous_of
from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.kinds.problem.stated.members import (
    ProblemPosed,
    members_of,
    shared_of,
)
from swarmstart.cases.kinds.problem.stated.model import COSTS, model_of
from swarmstart.cases.kinds.problem.stated.phases import interval_ends, phase_scenarios
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import ARRAYS, TIME, constants_of
from swarmstart.cases.kinds.problem.stated.values import (
    Tables,
    inputs_of,
    operations_of,
)
from swarmstart.cases.record.trajectory_arrays import control_rows, held_controls
from swarmstart.ocp import OptimalControlProblem, Trajectory, zero_controls
from swarmstart.ocp.common import symbol_names
from swarmstart.ocp.loop import rows_before_jumps
from swarmstart.ocp.statement import lowered
from swarmstart.ocp.system import row_excess

P = TypeVar("P", bound=Posed)

Value = Any
"""A number, or values along the path, shape (T, m + 1)."""


def rows_of(flight: Flight[P], trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Return times [s], states and controls along the simulated path.

    Their shapes are (T, m + 1), (nx, T, m + 1) and (nu, T, m + 1), with T control
    intervals of m plant steps each. If the end of an interval changes the state, one
    more column has the state after the change, and the column before it the state
    before the change.
    """
    (times,) = _by_interval(trajectory.dense_times[None], trajectory)
    states = _by_interval(trajectory.dense_states, trajectory)
    T, m = times.shape[0], times.shape[1] - 1
    controls = linear = control_rows(trajectory)
    if controls is None:
        _, held = held_controls(trajectory)
        controls = held.reshape(len(held), T, -1)
        # One value for the row, or one for each of the plant's steps.
        controls = np.repeat(controls, m // controls.shape[2], axis=2)
        controls = np.concatenate([controls, controls[:, :, -1:]], axis=2)
    if not flight.plant.model.jumps:
        return np.asarray(times), states, controls
    decided = decided_rows(flight, trajectory, (T, 1))
    states = np.concatenate([states, states[:, :, -1:]], axis=2)
    for step, decision in enumerate(trajectory.decisions):
        values = {name: float(rows[step, 0]) for name, rows in decided.items()}
        # The recorded path has the state after the change only: simulated once more.
        plant = flight.plant.with_decided(values)
        if decision.dt is not None:
            plant = plant.with_interval(decision.dt)
        begin = float(times[step, 0])
        first = states[:, step, 0]
        if linear is None:
            late = decision.acting
            held = controls[:, step, :-1] if late is None else late
            path = plant.until_end(first, held, begin)
        else:
            path = plant.along_until_end(first, controls[:, step], begin)
        states[:, step, -2] = path[:, -1]
    return (
        np.concatenate([times, times[:, -1:]], axis=1),
        states,
        np.concatenate([controls, controls[:, :, -1:]], axis=2),
    )


def decided_rows(
    flight: Flight[P], trajectory: Trajectory, shape: tuple[int, ...]
) -> dict[str, Array]:
    """Return the decided parameters along the simulated path, by name.

    Each has the given shape, with a row for each control interval. Within a row all
    values are equal.
    """
    plant = flight.posed.plant
    if not plant.decided:
        return {}
    whole = lowered(flight.posed.agents[0].problem)
    found = [whole.decided(d.plans[0].x0) for d in trajectory.decisions]
    return {
        name: np.repeat([[values[name]] for values in found], shape[1], axis=1)
        for name in plant.decided
    }


def algebraic_rows(
    flight: Flight[P],
    trajectory: Trajectory,
    times: Array,
    states: Array,
    controls: Array,
) -> Array:
    """Return the algebraic variables along the path, shape (nz, T, m + 1).

    Args:
        flight: The flight.
        trajectory: Its path.
        times: Times along the path, as from `rows_of`, shape (T, m + 1) [s].
        states: States along the path, shape (nx, T, m + 1).
        controls: Controls along the path, shape (nu, T, m + 1).
    """
    model, at = flight.plant.model, times.reshape(-1)
    solution = model.elimination.solution
    if not solution.numel():
        return np.empty((0, *times.shape))
    parameters, names = flight.plant.parameters(at), symbol_names(model.parameters)
    for name, rows in decided_rows(flight, trajectory, times.shape).items():
        parameters[names.index(name)] = rows.reshape(-1)
    symbols = [model.states, model.controls, model.parameters, model.varying]
    along = ca.Function("along", symbols, [solution]).map(at.size)
    found = along(
        states.reshape(len(states), -1),
        controls.reshape(len(controls), -1),
        parameters,
        flight.plant.varying(at),
    )
    return np.array(found).reshape(-1, *times.shape)


def integrated(values: Array, times: Array) -> float:
    """Return the time integral of values along a path, in rows as from `rows_of`."""
    from scipy.integrate import simpson  # Slow to import; `check` measures nothing.

    if times[0, -1] == times[0, -2]:  # The end of an interval changes the value.
        values, times = values[:, :-1], times[:, :-1]
    # Row by row: no parabola may reach over the jump of a held control.
    return float(simpson(values, x=times, axis=1).sum())


def flown_values(
    problem: OptimalControlProblem, flight: Flight[P], trajectory: Trajectory
) -> tuple[float, float, float]:
    """Return cost, and largest excess of path and terminal constraints, 0 if all hold.

    Parameters are the first ones of the plant, which can have more of its own; signals
    are those of the first agent.
    """
    model, (agent, *_) = problem.model, flight.posed.agents
    times, states, controls = rows_of(flight, trajectory)
    if problem.clock:  # Its costs use the horizon's own time, of length 1.
        times = _even_times(problem, times)
    shape, at = times.shape, times.reshape(-1)
    # A plant can have more: its disturbances come after those of the problem.
    parameters = flight.plant.parameters(at)[: model.np]
    names = symbol_names(model.parameters)
    for name, rows in decided_rows(flight, trajectory, shape).items():
        parameters[names.index(name)] = rows.reshape(-1)
    signals = np.empty((0, at.size))
    if agent.reference is not None and problem.ns:
        signals = rows_before_jumps(agent.reference, times)[: problem.ns]
    symbols = [*problem.symbols().values(), problem.previous, model.time]
    arguments = [
        states.reshape(len(states), -1),
        controls.reshape(len(controls), -1),
        parameters,
        signals,
        controls_before(flight, controls).reshape(len(controls), -1)[
            : problem.previous.numel()
        ],
        at[None, :][: model.time.numel()],
    ]
    paths, ends = (
        ca.vertcat(ca.SX(0, 1), *[row_excess(c.rows(c.expression)) for c in some])
        for some in (problem.path_constraints, problem.terminal_constraints)
    )
    costs = [getattr(problem, place) for place in COSTS]
    over = ca.Function("along", symbols, [*costs, paths, ends])
    found = [np.array(rows) for rows in over.map(at.size)(*arguments)]
    stage, step, initial, terminal = (rows.reshape(shape) for rows in found[:4])
    if problem.has_knots:  # Its step cost uses the control at the end of an interval.
        arguments[1] = np.repeat(controls[:, :, -1], shape[1], axis=1)
        step = np.array(over.map(at.size)(*arguments)[1]).reshape(shape)
    # The step cost is that at the beginning of each interval.
    cost = integrated(stage, times) + step[:, 0].sum()
    cost += initial[0, 0] + terminal[-1, -1]
    path = found[4].reshape(-1, *shape)
    if model.jumps:  # A held control does not apply to the state after its interval.
        free = [not ca.depends_on(row, problem.model.controls) for row in _rows(paths)]
        last = path[free][:, -1, -1]
        path = np.append(path[:, :, :-1].ravel(), last)
    return (
        float(cost),
        float(path.max(initial=0.0)),
        float(found[5][:, -1].max(initial=0.0)),
    )


def _even_times(problem: OptimalControlProblem, times: Array) -> Array:
    """Return evenly spaced times over a horizon, shape (T, m + 1)."""
    steps = times.shape[1] - 1 - int(problem.model.jumps)
    parts = np.minimum(np.arange(times.shape[1]), steps) / steps
    return np.asarray(problem.dt * (np.arange(times.shape[0])[:, None] + parts))


def controls_before(flight: Flight[P], controls: Array) -> Array:
    """Return at each time of `rows_of` the controls of the interval before.

    For linear controls these are the controls at the beginning of the interval itself.
    For vehicles that plan one by one, the controls before the first interval are zero.
    """
    (agent, *others) = flight.posed.agents
    if agent.problem.has_knots:
        return np.repeat(controls[:, :, :1], controls.shape[2], axis=2)
    at = (
        zero_controls(agent.problem)[:, 0] if agent.previous is None else agent.previous
    )
    if others:
        at = np.zeros(len(controls))
    at = at[: len(controls)]  # Members of an ensemble can have controls of their own.
    before = np.empty_like(controls)
    for step in range(controls.shape[1]):
        held = controls[:, step]
        for column in range(held.shape[1]):
            # A new value within a row begins a new interval of the plan.
            if column and (held[:, column] != held[:, column - 1]).any():
                at = held[:, column - 1]
            before[:, step, column] = at
        at = held[:, -1]
    return before


def _by_interval(dense: Array, trajectory: Trajectory) -> Array:
    """Return dense rows (n, T * m + 1) as (n, T, m + 1), ends of intervals twice."""
    count = trajectory.controls.shape[1]
    steps = (dense.shape[1] - 1) // count
    starts = np.arange(count)[:, None] * steps
    return dense[:, starts + np.arange(steps + 1)]


def _rows(column: ca.SX) -> list[ca.SX]:
    return [column[i] for i in range(column.numel())]


def path_of(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> dict[str, Value]:
    """Return name -> number or values along the simulated path, shape (T, m + 1).

    A row has the values of one of the T control intervals, at the ends of m plant steps
    (`rows_of`).

    Names of a vehicle's states, controls, algebraic variables, definitions and
    constants end with the vehicle's suffix; the file's constants can also be used
    without it.
    """
    posed, (times, states, controls) = flight.posed, rows_of(flight, trajectory)
    shared = _known_along(posed, times)
    shared |= decided_rows(flight, trajectory, times.shape)
    shared[TIME] = times
    together: dict[str, Value] = {**constants_of(scenario), **shared}
    before = controls_before(flight, controls)
    nx, nu, nz = map(len, (scenario.states, scenario.controls, scenario.algebraic))
    algebraic = algebraic_rows(flight, trajectory, times, states, controls)
    for number, member in enumerate(posed.members):
        own: dict[str, Value] = {
            **member.constants,
            **shared,
            **dict(zip(scenario.states, states[number * nx :], strict=False)),
            **dict(zip(scenario.controls, controls[number * nu :], strict=False)),
            **dict(zip(scenario.algebraic, algebraic[number * nz :], strict=False)),
        }
        last = dict(zip(scenario.controls, before[number * nu :], strict=False))
        # Before the definitions, which can use them.
        own |= {previous_of(name): values for name, values in last.items()}
        for name, text in scenario.definitions.items():
            own[name] = _along(text, own, scenario.tabled)
        together |= {
            f"{name}{member.suffix}": value
            for name, value in own.items()
            if name not in shared
        }
    return together


def _known_along(posed: ProblemPosed, times: Array) -> dict[str, Value]:
    """Return the parameters and signals along a path, each (T, m + 1), by name."""
    return {
        name: rows_before_jumps(known, times).reshape(times.shape)
        for name, known in posed.known.items()
    }


def path_of_phases(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> dict[str, Value]:
    """Return the values of `path_of` for phases: each row has those of its phase.

    Names that a phase does not have are NaN there, except states and controls, which
    are constant.
    """
    posed, (times, states, controls) = flight.posed, rows_of(flight, trajectory)
    shape = times.shape
    shared = _known_along(posed, times)
    shared |= decided_rows(flight, trajectory, shape)
    shared[TIME] = times
    model = flight.plant.model
    named = {
        **dict(zip(model.state_names, states, strict=True)),
        **dict(zip(model.control_names, controls, strict=True)),
    }
    together: dict[str, Value] = {**constants_of(scenario), **shared, **named}
    ends = interval_ends(scenario)
    in_phase = np.searchsorted(ends, np.arange(shape[0]), side="right")
    for number, one in enumerate(phase_scenarios(scenario)):
        own = {**constants_of(one), **shared, **named}
        own |= _algebraic_of(one, own, shape)
        for name, text in one.definitions.items():
            own[name] = _along(text, own, scenario.tabled)
        # States and controls of all phases are in the one model already.
        for name in (*one.definitions, *one.algebraic):
            before = together.get(name, np.full(shape, np.nan))
            values = np.broadcast_to(own[name], shape)
            together[name] = np.where((in_phase == number)[:, None], values, before)
    return together


def _algebraic_of(
    one: ProblemScenario, own: Mapping[str, Value], shape: tuple[int, ...]
) -> dict[str, Array]:
    """Return the algebraic variables of a phase along a path, each (T, m + 1)."""
    if not one.algebraic:
        return {}
    members = members_of(one, shared_of(one))
    model, (member,) = model_of(one, members, timed=True), members
    symbols = {
        **member.states,
        **member.controls,
        **member.shared.parameters,
        TIME: member.shared.time,
    }
    solution = model.elimination.solution
    along = ca.Function("along", [ca.vertcat(*symbols.values())], [solution])
    values = [np.broadcast_to(own[name], shape).reshape(-1) for name in symbols]
    found = np.array(along.map(values[0].size)(np.stack(values)))
    return dict(zip(one.algebraic, found.reshape(-1, *shape), strict=True))


def _along(text: str, names: Mapping[str, Value], tables: Tables) -> Value:
    # Undefined values are NaN, of which a measure becomes null.
    with np.errstate(all="ignore"):
        return interpret(
            parse(text, functions=inputs_of(tables)),
            operations={**ARRAYS, **operations_of(tables)},
            names=names,
        )
