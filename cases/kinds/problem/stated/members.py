"""The vehicles of a problem, with their symbols and the scopes of expressions.

Without `vehicles` there is one vehicle, without a name. All share parameters and
signals. A posed problem carries its vehicles for its measures and figures.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import parse, previous_of
from swarmstart.cases.format.kind import Posed
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, Vehicle
from swarmstart.cases.kinds.problem.stated.symbols import (
    TIME,
    Scope,
    Signal,
    constants_of,
    free,
    known_parameters,
    number,
    over_time,
)
from swarmstart.cases.kinds.problem.stated.values import Decided, Tied, inputs_of
from swarmstart.ocp import Free


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shared:
    """Symbols that all vehicles share.

    Attributes:
        parameters: Name -> symbol.
        signals: Name -> symbol.
        time: Symbol of the time.
    """

    parameters: Mapping[str, ca.SX]
    signals: Mapping[str, ca.SX]
    time: ca.SX


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Member:
    """A vehicle with its symbols; without `vehicles` there is one, without a name.

    Attributes:
        suffix: Suffix of the names of its states and controls in the results.
        constants: Name -> number.
        start: Its states at the start, shape (nx,); guesses for decided ones.
        decided: Name of a state whose start is decided -> its bounds.
        tied: Name of a state -> name of the decided state whose start it has.
        states: Name -> symbol.
        controls: Name -> symbol.
        algebraic: Name of an algebraic variable -> symbol.
        previous: Name of a control -> symbol of its value in the interval before.
        shared: Symbols of all vehicles.
        scopes: Place of an expression -> the names that it can use.
    """

    suffix: str
    constants: Mapping[str, float]
    start: Array
    decided: Mapping[str, Free]
    tied: Mapping[str, str]
    states: Mapping[str, ca.SX]
    controls: Mapping[str, ca.SX]
    algebraic: Mapping[str, ca.SX]
    previous: Mapping[str, ca.SX]
    shared: Shared
    scopes: Mapping[str, Scope]

    def starts(self) -> dict[tuple[str, ...], Free]:
        """Return the decided starts by the names of the states."""
        return {
            self.titled(
                dict.fromkeys([name, *(n for n in self.tied if self.tied[n] == name)])
            ): value
            for name, value in self.decided.items()
        }

    def titled(self, names: Mapping[str, object]) -> tuple[str, ...]:
        """Return names with the suffix of the vehicle appended."""
        return tuple(f"{name}{self.suffix}" for name in names)


def shared_of(scenario: ProblemScenario) -> Shared:
    """Return new symbols for parameters and signals."""
    return Shared(
        parameters=_symbols(scenario.parameters),
        signals=_symbols(scenario.signals),
        time=ca.SX.sym(TIME),
    )


def members_of(scenario: ProblemScenario, shared: Shared) -> tuple[Member, ...]:
    """Return the vehicles with symbols of their own.

    Raises:
        ExpressionError: If an expression has no value.
    """
    if scenario.vehicles is None:
        return (_member(scenario, shared, None),)
    return tuple(_member(scenario, shared, one) for one in scenario.vehicles.members)


def candidate_scopes(
    scenario: ProblemScenario,
    members: Sequence[Member],
    constants: Mapping[str, float],
    time: float,
) -> list[Scope]:
    """Return the names that candidates can use, with their values at a time [s].

    Args:
        scenario: The scenario.
        members: Members that are planned together.
        constants: Constants of the file, as numbers.
        time: Time of planning [s].
    """
    values = {
        name: float(over_time(given, constants)(np.array([time]))[0])
        for name, given in known_parameters(scenario).items()
    }
    # Known ones are in `values`, so that only decided ones are refused.
    others = dict.fromkeys(scenario.parameters, "decided parameter")
    return [
        Scope(
            {**m.constants, **values, TIME: time}, others, "candidates", scenario.tabled
        )
        for m in members
    ]


def held_candidates(
    scenario: ProblemScenario,
    members: Sequence[Member],
    intervals: int,
    constants: Mapping[str, float],
) -> Callable[[float], Array] | None:
    """Return a function of the time [s] that returns additional controls for a search.

    The controls have the shape (nu, N, k), with k candidates, each constant over the N
    intervals. Without candidates in the scenario there is no function, but None.
    """
    if not scenario.candidates:
        return None

    def candidates(time: float) -> Array:
        scopes = candidate_scopes(scenario, members, constants, time)
        columns = [
            [scope.number(one[name]) for scope in scopes for name in scenario.controls]
            for one in scenario.candidates
        ]
        # (nu, 1, candidates): the middle axis is repeated for the intervals.
        return np.repeat(np.array(columns).T[:, None, :], intervals, axis=1)

    return candidates


def column_of(entries: Any) -> ca.SX:
    """Return symbols as one column, without rows if there are no symbols."""
    return ca.vertcat(ca.SX(0, 1), *entries)


def _member(
    scenario: ProblemScenario, shared: Shared, vehicle: Vehicle | None
) -> Member:
    suffix = "" if vehicle is None else f"_{vehicle.name}"
    constants = constants_of(scenario, vehicle.constants if vehicle else None)
    own = vehicle.start if vehicle else {}
    given = {n: own.get(n, s.start or "0") for n, s in scenario.states.items()}
    decided = {
        n: free(one, constants) for n, one in given.items() if isinstance(one, Decided)
    }
    tied = {n: one.same_as for n, one in given.items() if isinstance(one, Tied)}
    start = [
        decided[first].first
        if (first := tied.get(name, name)) in decided
        # Tied to a start that is not decided: `tied_flaws` reports it.
        else number("0" if isinstance(one, Decided | Tied) else one, constants)
        for name, one in given.items()
    ]
    states = _symbols(scenario.states, suffix)
    controls = _symbols(scenario.controls, suffix)
    algebraic = _symbols(scenario.algebraic, suffix)
    previous = {
        name: ca.SX.sym(f"previous_{name}{suffix}") for name in scenario.controls
    }
    return Member(
        suffix=suffix,
        constants=constants,
        start=np.array(start),
        decided=decided,
        tied=tied,
        states=states,
        controls=controls,
        algebraic=algebraic,
        previous=previous,
        shared=shared,
        scopes=_scopes(
            scenario,
            {
                "constant": constants,
                "state": states,
                "control": controls,
                "algebraic variable": algebraic,
                "previous control": {previous_of(n): v for n, v in previous.items()},
                "parameter": shared.parameters,
                "signal": shared.signals,
                "time": {TIME: shared.time},
            },
        ),
    )


def _symbols(names: Mapping[str, object], suffix: str = "") -> dict[str, ca.SX]:
    return {name: ca.SX.sym(f"{name}{suffix}") for name in names}


def _scopes(
    scenario: ProblemScenario, roles: Mapping[str, Mapping[str, Any]]
) -> dict[str, Scope]:
    """Return the names for each place: none of controls at ends, few previous ones.

    A definition is allowed in places in which everything that it uses is allowed.

    Args:
        scenario: The scenario.
        roles: Role of names -> names with their values.
    """
    kinds = {name: role for role, names in roles.items() for name in names}
    ends = ("control", "previous control")
    barred: dict[str, tuple[str, ...]] = {
        "rate": ("previous control",),
        "algebraic": ("previous control",),
        "algebraic_start": ("algebraic variable", "previous control"),
        "next": ("previous control",),
        "linkage": ("previous control",),
        "stage_cost": ("previous control",),
        "step_cost": (),
        "path": (),
        "bounds": ("state", "algebraic variable", *ends),
        "initial_cost": ends,
        "terminal_cost": ends,
        "terminal": ends,
    }
    everything = {name: v for names in roles.values() for name, v in names.items()}
    uses: dict[str, frozenset[str]] = {n: frozenset({k}) for n, k in kinds.items()}
    tables = scenario.tabled
    for name, text in scenario.definitions.items():
        # In order: a definition can use those before it, and is inlined in those after.
        scope = Scope(everything, {}, "a definition", tables)
        everything = {**everything, name: scope.symbol(text)}
        names = parse(text, functions=inputs_of(tables)).names
        of_parts = [uses.get(part, frozenset()) for part in names]
        uses[name] = frozenset().union(*of_parts)
    return {
        place: Scope(
            {n: v for n, v in everything.items() if not uses[n] & {*without}},
            # Of every name, for a message that says why it is not allowed here.
            {n: _said(n, uses[n] & {*without}, kinds) for n in everything},
            place,
            tables,
        )
        for place, without in barred.items()
    }


def _said(name: str, roles: frozenset[str], kinds: Mapping[str, str]) -> str:
    """Return the role of a name, in words, for places in which it is not allowed."""
    role = next(iter(sorted(roles)), "")
    return role if name in kinds else f"definition with a {role}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProblemPosed(Posed):
    """A posed problem, with data for measures and figures.

    Attributes:
        known: Name of a parameter of the plant, or of a signal -> its values over time.
        members: The vehicles, the one system, or the phases.
    """

    known: Mapping[str, Signal]
    members: tuple[Member, ...]
