"""Values along the simulated path by the names of the file, for its own measures.

There is one row for each control interval, with the plant's steps and both ends.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import interpret, parse, previous_of
from swarmstart.cases.format.kind import Flight
from swarmstart.cases.kinds.problem.measuring.flown_path import (
    algebraic_rows,
    controls_before,
    decided_rows,
    rows_of,
)
from swarmstart.cases.kinds.problem.stated.members import members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import model_of
from swarmstart.cases.kinds.problem.stated.phases import interval_ends, phase_scenarios
from swarmstart.cases.kinds.problem.stated.posed import ProblemPosed
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import ARRAYS, TIME, constants_of
from swarmstart.cases.kinds.problem.stated.tables import (
    Tables,
    inputs_of,
    operations_of,
)
from swarmstart.ocp import Trajectory

Value = Any
"""A number, or values along the path, shape (T, m + 1)."""


def path_of(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> dict[str, Value]:
    """Return name -> number or values along the simulated path, shape (T, m + 1).

    Names of states, controls, algebraic variables, definitions and a vehicle's
    constants end with its suffix; the file's constants can also be used without it.
    """
    posed, (times, states, controls) = flight.posed, rows_of(flight, trajectory)
    flat = times.reshape(-1)
    shared = {n: f(flat).reshape(times.shape) for n, f in posed.known.items()}
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
        own |= {previous_of(name): values for name, values in last.items()}
        for name, text in scenario.definitions.items():
            own[name] = _along(text, own, scenario.tabled)
        together |= {
            f"{name}{member.suffix}": value
            for name, value in own.items()
            if name not in shared
        }
    return together


def path_of_phases(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> dict[str, Value]:
    """Return the same for phases: each row has the values of its phase.

    Names that a phase does not have are NaN there, except states and controls, which
    are constant.
    """
    posed, (times, states, controls) = flight.posed, rows_of(flight, trajectory)
    flat, shape = times.reshape(-1), times.shape
    shared = {n: f(flat).reshape(shape) for n, f in posed.known.items()}
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
    with np.errstate(all="ignore"):
        return interpret(
            parse(text, functions=inputs_of(tables)),
            operations={**ARRAYS, **operations_of(tables)},
            names=names,
        )
