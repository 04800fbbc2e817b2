"""The simulated path of a problem as rows, with costs and constraints along it.

There is one row for each control interval, with the plant's steps and both ends, so
that a held control jumps between rows.
"""

from typing import TypeVar

import casadi as ca
import numpy as np
from scipy.integrate import simpson

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.kinds.problem.stated.model import COSTS
from swarmstart.cases.record.trajectory_arrays import control_rows, held_controls
from swarmstart.ocp import OptimalControlProblem, Trajectory, zero_controls
from swarmstart.ocp.common import symbol_names
from swarmstart.ocp.statement import lowered
from swarmstart.ocp.system import row_excess

P = TypeVar("P", bound=Posed)


def rows_of(flight: Flight[P], trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Return times [s], states and controls along the simulated path.

    Shapes (T, m + 1), (nx, T, m + 1) and (nu, T, m + 1). If the end of an interval
    changes the state, one more column has the state after the change, and the column
    before it the state before the change.
    """
    (times,) = _by_interval(trajectory.dense_times[None], trajectory)
    states = _by_interval(trajectory.dense_states, trajectory)
    T, m = times.shape[0], times.shape[1] - 1
    controls = linear = control_rows(trajectory)
    if controls is None:
        _, held = held_controls(trajectory)
        controls = held.reshape(len(held), T, -1)
        controls = np.repeat(controls, m // controls.shape[2], axis=2)
        controls = np.concatenate([controls, controls[:, :, -1:]], axis=2)
    if not flight.plant.model.jumps:
        return np.asarray(times), states, controls
    decided = decided_rows(flight, trajectory, (T, 1))
    states = np.concatenate([states, states[:, :, -1:]], axis=2)
    for step, decision in enumerate(trajectory.decisions):
        values = {name: float(rows[step, 0]) for name, rows in decided.items()}
        plant = flight.plant.with_decided(values)
        if decision.dt is not None:
            plant = plant.with_interval(decision.dt)
        begin = float(times[step, 0])
        first = states[:, step, 0]
        if linear is None:
            path = plant.until_end(first, controls[:, step, :-1], begin)
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
    """Return the decided parameters along the simulated path, each (T, m + 1)."""
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
        times: Times as from `rows_of`, like states and controls.
        states: Shape (nx, T, m + 1).
        controls: Shape (nu, T, m + 1).
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
    """Return the time integral of values along a path, as from `rows_of`."""
    if times[0, -1] == times[0, -2]:  # The end of an interval changes the value.
        values, times = values[:, :-1], times[:, :-1]
    return float(simpson(values, x=times, axis=1).sum())


def flown_values(
    problem: OptimalControlProblem, flight: Flight[P], trajectory: Trajectory
) -> tuple[float, float, float]:
    """Return cost, and largest excess of path and terminal constraints, 0 if all hold.

    Parameters are those of the plant, whose own parameters can follow them; signals are
    those of an agent.
    """
    model, (agent, *_) = problem.model, flight.posed.agents
    times, states, controls = rows_of(flight, trajectory)
    if problem.clock:  # Its costs use the horizon's own time, of length 1.
        times = _even_times(problem, times)
    shape, at = times.shape, times.reshape(-1)
    parameters = flight.plant.parameters(at)[: model.np]
    names = symbol_names(model.parameters)
    for name, rows in decided_rows(flight, trajectory, shape).items():
        parameters[names.index(name)] = rows.reshape(-1)
    signals = np.empty((0, at.size))
    if agent.reference is not None and problem.ns:
        signals = agent.reference(at)[: problem.ns]
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
    """Return the controls of the interval before along the path, as from `rows_of`.

    For linear controls they are those at the beginning of the interval. For vehicles
    that plan one by one, those before the first interval are zero.
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
