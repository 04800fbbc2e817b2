"""Phases of a problem, one after another: a scenario for each, and one problem to pose.

A phase's scenario is the file with the phase laid over it: mappings are merged name by
name, costs replace those of the file, path constraints are added to them. The file's
initial cost is at the start of the first phase, its terminal cost and constraints are
at the end of the last one.

The one problem has the states of all phases, then states for the time, for the number
of finished intervals, and for costs and constraints at the ends of phases, which are
kept until the end of the last phase. A control that a phase does not have is constant
there.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import casadi as ca
import numpy as np
from pydantic import BaseModel

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import PosedAgent, PosedPlant
from swarmstart.cases.kinds.problem.stated.members import (
    Member,
    ProblemPosed,
    held_candidates,
    members_of,
    shared_of,
)
from swarmstart.cases.kinds.problem.stated.model import planning_problem
from swarmstart.cases.kinds.problem.stated.parts import Constraint, Guess, PlantPart
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    constants_of,
    known_parameters,
    over_time,
    rows_at,
    rows_over_time,
)
from swarmstart.ocp import Free, OptimalControlProblem, Start, phases, zero_controls
from swarmstart.ocp.statement import CLOCK, COUNTER, Phases

MERGED = ("states", "controls", "algebraic")
COSTS = ("stage_cost", "step_cost", "terminal_cost")
T = TypeVar("T")


def phase_names(scenario: ProblemScenario) -> list[str]:
    """Return the names of the phases, or their numbers from 1."""
    return [one.name or str(k) for k, one in enumerate(scenario.phases, 1)]


def phase_scenarios(scenario: ProblemScenario) -> list[ProblemScenario]:
    """Return a scenario of each phase alone: the file, with what the phase replaces.

    Path constraints of the phase are added to those of the file. The file's initial
    cost is that of the first phase only, its terminal cost and constraints are those of
    the last phase only.
    """
    last = len(scenario.phases) - 1
    return [
        _of_phase(scenario, number, is_first=not number, is_last=number == last)
        for number in range(len(scenario.phases))
    ]


def _of_phase(
    scenario: ProblemScenario, number: int, *, is_first: bool, is_last: bool
) -> ProblemScenario:
    phase = scenario.phases[number]
    where = in_phase(phase_names(scenario)[number])
    grid = {"horizon_s": phase.horizon_s, "intervals": phase.intervals}
    merged: dict[str, Any] = {
        part: _merged(getattr(scenario, part), getattr(phase, part)) for part in MERGED
    }
    if not is_first:  # Their starts come from a linkage.
        merged["states"] = {
            name: state.model_copy(update={"start": state.start or "0"})
            for name, state in merged["states"].items()
        }
    nothing_at_end = {"terminal_cost": "0", "terminal": []}
    base = scenario if is_last else scenario.model_copy(update=nothing_at_end)
    own = {key: getattr(phase, key) for key in COSTS}
    costs = {
        key: getattr(base, key) if cost is None else cost for key, cost in own.items()
    }
    return scenario.model_copy(
        update={
            **merged,
            **costs,
            "initial_cost": scenario.initial_cost if is_first else "0",
            "constants": {**scenario.constants, **phase.constants},
            "definitions": {**scenario.definitions, **phase.definitions},
            "path": _named([*scenario.path, *phase.path], where),
            "terminal": _named([*base.terminal, *phase.terminal], where),
            "prediction": scenario.prediction.model_copy(update=grid),
            "steps": phase.intervals,
            "phases": [],
            # Plant, guess, candidates and measures are of all phases together.
            "plant": PlantPart(substeps=scenario.modelled.substeps),
            "guess": Guess(),
            "candidates": [],
            "measures": {},
        }
    )


def in_phase(name: str) -> str:
    """Return the suffix of the names of a phase's constraints."""
    return f", phase {name}"


def _named(constraints: Sequence[Any], where: str) -> list[Any]:
    """Return constraints with the phase in their names."""
    return [
        one.model_copy(update={"name": f"{one.name or one.expression}{where}"})
        if isinstance(one, Constraint)
        else one
        for one in constraints
    ]


def _merged(base: Mapping[str, T], over: Mapping[str, T | None]) -> dict[str, T]:
    """Return parts by name, replaced by those of a phase."""
    found = dict(base)
    for name, part in over.items():
        if part is None:
            found.pop(name, None)
        else:
            found[name] = _laid_over(found.get(name), part)
    return found


def _laid_over(before: T | None, part: T) -> T:
    """Return a part with its keys replaced by those of another one."""
    if isinstance(part, BaseModel) and isinstance(before, BaseModel):
        # Only what the phase states: a default must not hide what the file states.
        given = {key: getattr(part, key) for key in part.model_fields_set}
        return before.model_copy(update=given)
    return part


def whole_scenario(scenario: ProblemScenario) -> ProblemScenario:
    """Return a scenario with the states, controls and so on of all phases.

    Of equal names, the earliest phase counts. The scenario is used for names and
    units; it cannot be solved, since it has no definitions.
    """
    every: dict[str, dict[str, Any]] = {part: {} for part in MERGED}
    for one in phase_scenarios(scenario):
        for part, found in every.items():
            found |= {n: p for n, p in getattr(one, part).items() if n not in found}
    return scenario.model_copy(update={**every, "definitions": {}, "phases": []})


def joined(scenario: ProblemScenario) -> tuple[Phases, list[Member]]:
    """Return all phases joined to one problem, and the symbols of each phase.

    The symbols of each phase are given as a `Member`, by their names.

    Raises:
        InvalidProblemError: If a phase has a part that phases cannot have, or a state
            of a phase has no start.
    """
    stated: list[OptimalControlProblem] = []
    linkages: list[dict[str, ca.SX]] = []
    members: list[Member] = []
    for phase, one in zip(scenario.phases, phase_scenarios(scenario), strict=True):
        (member,) = members_of(one, shared_of(one))
        members.append(member)
        stated.append(planning_problem(one, [member]))
        scope = member.scopes["linkage"]
        linkages.append({n: scope.symbol(text) for n, text in phase.linkage.items()})
    # Nothing comes after the last phase.
    return phases(stated, linkages[:-1]), members


def expected_ends(scenario: ProblemScenario, problem: OptimalControlProblem) -> Array:
    """Return the guessed beginning of each phase, and the end of the last one [s]."""
    lengths = [
        float(decided.first) if isinstance(decided, Free) else decided
        for decided in durations(scenario, problem).values()
    ]
    return np.concatenate([[0.0], np.cumsum(lengths)])


def durations(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> dict[str, float | Free]:
    """Return the length of each phase by name [s], or the bounds of a decided one."""
    return {
        name: problem.decided.get(
            f"duration of phase {number}",
            phase.horizon_s if isinstance(phase.horizon_s, float) else 0.0,
        )
        for number, (name, phase) in enumerate(
            zip(phase_names(scenario), scenario.phases, strict=True), 1
        )
    }


def interval_ends(scenario: ProblemScenario) -> list[int]:
    """Return the number of finished intervals at the end of each phase."""
    return list(itertools.accumulate(one.intervals for one in scenario.phases))


def pose_phases(scenario: ProblemScenario) -> ProblemPosed:
    """Return the agent that plans all phases, and its plant."""
    together, members = joined(scenario)
    problem, fixed = together.problem, constants_of(scenario)
    given, feedback = known_parameters(scenario), scenario.feedback
    over = {**given, **scenario.modelled.parameters}
    truly = {name: over[name] for name in scenario.parameters if name in over}
    planned, whole = rows_over_time(given, fixed), whole_scenario(scenario)
    # Candidates are of all phases.
    group = members_of(whole, shared_of(whole)) if scenario.candidates else ()
    return ProblemPosed(
        agents=(
            PosedAgent(
                problem=problem,
                parameters=None
                if planned is None
                else lambda time: planned(np.array([time]))[:, 0],
                candidates=held_candidates(whole, group, problem.intervals, fixed),
                append=feedback.append,
                shift=feedback.last_plan == "shifted",
                first=_guessed(scenario, problem),
            ),
        ),
        x0=together.start(members[0].start),
        plant=PosedPlant(
            model=problem.model,
            substeps=scenario.modelled.substeps,
            parameters=rows_over_time(truly, fixed),
            decided={
                name: one.first
                for name, one in problem.decided.items()
                if name not in truly
            },
            differs=bool(scenario.modelled.parameters),
        ),
        open_loop=True,
        repair=feedback.repair,
        known={name: over_time(one, fixed) for name, one in truly.items()},
        members=tuple(members),
    )


def _guessed(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> Array | Start | None:
    """Return the start of the plan: controls (nu, N), states (nx, nodes)."""
    guess, checks = scenario.guess, problem.checks
    if not (guess.controls or guess.states):
        return None
    whole, fixed = whole_scenario(scenario), constants_of(scenario)
    times = _node_times(scenario, problem)

    controls = zero_controls(problem)
    if guess.controls:
        controls = rows_at(guess.controls, whole.controls, times[:-1:checks], [fixed])
    if not guess.states:
        return controls
    states = np.zeros((problem.model.nx, problem.nodes))
    # Below them are the time and the interval's number, and values that phases keep.
    states[: len(whole.states)] = rows_at(guess.states, whole.states, times, [fixed])
    names = problem.model.state_names
    states[names.index(CLOCK)] = times
    states[names.index(COUNTER)] = np.arange(problem.nodes) // checks
    return Start(controls, states)


def _node_times(scenario: ProblemScenario, problem: OptimalControlProblem) -> Array:
    """Return the guessed times of the nodes of all phases [s]."""
    ends, counts = expected_ends(scenario, problem), [0, *interval_ends(scenario)]
    at = np.arange(problem.nodes) / problem.checks
    return np.asarray(np.interp(at, counts, ends))
