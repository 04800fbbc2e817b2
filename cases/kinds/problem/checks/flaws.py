"""Errors between parts of a problem scenario, each with its place.

Names are checked first, then constants, definitions and all expressions, then numbers
and the algebraic equations, and at last the problem itself by the library.
"""

from collections.abc import Collection, Iterator, Mapping

import casadi as ca

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks import attempts
from swarmstart.cases.kinds.problem.checks.attempts import (
    Place,
    names_given_twice,
    names_of_nothing,
    tried,
    unknown,
)
from swarmstart.cases.kinds.problem.checks.committed_flaws import (
    committed_numbers,
    committed_parts,
)
from swarmstart.cases.kinds.problem.checks.instance_flaws import (
    instance_names,
    instance_numbers,
    instance_ranges,
)
from swarmstart.cases.kinds.problem.checks.number_flaws import (
    combination_flaws,
    end_time_flaws,
    number_flaws,
    operation_flaws,
    start_flaws,
    tied_flaws,
)
from swarmstart.cases.kinds.problem.checks.phase_flaws import Stage, phases_flaws
from swarmstart.cases.kinds.problem.checks.simulator_flaws import simulator_flaws
from swarmstart.cases.kinds.problem.checks.uncertain import (
    uncertain_names,
    uncertain_numbers,
    uncertain_ranges,
    with_members,
)
from swarmstart.cases.kinds.problem.measuring.measures import measure_flaws
from swarmstart.cases.kinds.problem.stated.members import Member, members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import (
    COSTS,
    model_of,
    planning_problem,
)
from swarmstart.cases.kinds.problem.stated.parts import Equation
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, Vehicle
from swarmstart.cases.kinds.problem.stated.symbols import number
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import OptimalControlProblem
from swarmstart.ocp.statement import FEATURES


def flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors; those of a later stage only if earlier stages have none."""
    every = phases_flaws(scenario, _STAGES) if scenario.phases else _in_stages(scenario)
    yield from every


def _in_stages(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    for stage in (*_STAGES, measure_flaws, _of_whole):
        found = list(stage(scenario))
        yield from found
        if found:
            return


def _whole(scenario: ProblemScenario) -> OptimalControlProblem:
    """Return the problem of all vehicles that are planned together."""
    members = members_of(scenario, shared_of(scenario))
    # Vehicles that plan one by one have alike problems: the first stands for all.
    one_by_one = scenario.vehicles and scenario.vehicles.planning != "joint"
    return planning_problem(scenario, members[:1] if one_by_one else members)


def _feature_at_fault(scenario: ProblemScenario) -> Place:
    """Return the feature of a control without which the problem is valid, if any."""
    for name, control in scenario.controls.items():
        for key in FEATURES:
            if getattr(control, key) is None:
                continue
            less = {**scenario.controls, name: control.model_copy(update={key: None})}
            try:
                _whole(scenario.model_copy(update={"controls": less}))
            except SwarmstartError:
                continue
            return ("controls", name, key)
    return ()


def _of_whole(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of the whole problem, also if it would take minutes to build.

    An interval is one expression.
    """
    try:
        problem = _whole(scenario)
    except SwarmstartError as error:
        yield _feature_at_fault(scenario), error
        return
    yield from combination_flaws(scenario, problem)
    yield from instance_names(scenario, problem)
    try:
        problem = with_members(scenario, problem)
    except SwarmstartError as error:
        yield ("uncertain",), error
        return
    yield from operation_flaws(problem)


def _of_parts(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of repeated and unknown names, and of parts that do not fit."""
    yield from scenario.flaws()
    yield from names_given_twice(scenario)
    yield from names_of_nothing(scenario)
    yield from _missing_keys(scenario)
    yield from _of_vehicles(scenario)
    yield from _of_feedback(scenario)
    yield from end_time_flaws(scenario)
    yield from tied_flaws(scenario)
    yield from _of_blocks(scenario)
    yield from uncertain_names(scenario)


def _vehicles(scenario: ProblemScenario) -> list[Vehicle]:
    return scenario.vehicles.members if scenario.vehicles else []


def _missing_keys(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of missing keys that other parts of the scenario require."""
    if not {*COSTS} & scenario.model_fields_set:
        yield (), f"expected a cost, one of {', '.join(COSTS)}; found none"
    vehicles = _vehicles(scenario)
    for name, state in scenario.states.items():
        elsewhere = vehicles and all(name in vehicle.start for vehicle in vehicles)
        if state.start is None and not elsewhere:
            yield ("states", name), "expected the key 'start'"
        if state.rate is None and state.next is None:
            yield (
                ("states", name),
                "expected the key 'rate', or 'next' of a state that changes at the "
                "end of each interval",
            )
    complete: list[tuple[Place, Mapping[str, object], Collection[str]]] = [
        (("candidates", index), one, scenario.controls)
        for index, one in enumerate(scenario.candidates)
    ]
    if scenario.dual_mode is not None:
        complete += [
            (("dual_mode", "at"), scenario.dual_mode.at, scenario.states),
            (("dual_mode", "R"), scenario.dual_mode.R, scenario.controls),
        ]
    for place, given, names in complete:
        yield from ((place, f"expected the key {n!r}") for n in names if n not in given)


def _of_vehicles(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    names = [vehicle.name for vehicle in _vehicles(scenario)]
    for index, name in enumerate(names):
        if name in names[:index]:
            place = ("vehicles", "members", index, "name")
            yield place, f"expected a new name, found {name!r}"
    if scenario.vehicles is None:
        return
    yield from committed_parts(scenario, scenario.vehicles)
    if scenario.vehicles.separation is None:
        return
    for index, text in enumerate(scenario.vehicles.separation.of):
        one_by_one = scenario.vehicles.planning != "joint"
        # Other vehicles see only states of a plan: a coordinate must be one of them.
        if one_by_one and text.strip() not in scenario.states:
            where = ("vehicles", "separation", "of", index)
            yield where, unknown(text, scenario.states, "state")


def _of_feedback(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of parts that do not fit the open or the closed loop."""
    if scenario.feedback.law != "open_loop":
        yield from start_flaws(scenario)
        return
    intervals = scenario.prediction.intervals
    if scenario.steps > intervals:
        yield (
            ("steps",),
            f"expected at most prediction.intervals = {intervals} with feedback: "
            f"open_loop, found {scenario.steps}",
        )
    needs = "expected feedback: receding_horizon with it, found open_loop"
    if scenario.dual_mode is not None:
        yield ("dual_mode",), needs
    if scenario.vehicles is not None and scenario.vehicles.planning != "joint":
        yield ("vehicles", "planning"), needs


def _of_blocks(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield an error if the blocks do not have all intervals."""
    grid = scenario.prediction
    if grid.blocks and sum(grid.blocks) != grid.intervals:
        yield (
            ("prediction", "blocks"),
            f"expected lengths that sum to prediction.intervals = {grid.intervals}, "
            f"found the sum {sum(grid.blocks)}",
        )


def algebraic_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of algebraic equations and of the use of their variables.

    The equations must determine the variables. Costs and constraints at the start or
    the end of the horizon must not use a variable that depends on a control, since
    there is no control then.
    """
    if not scenario.algebraic:
        return
    member = members_of(scenario, shared_of(scenario))[0]
    # A scale that is not positive would fail in the model, without its place.
    wrong = list(_of_scales(scenario, member))
    yield from wrong
    if wrong:
        return
    try:
        model = model_of(scenario, [member])
    except SwarmstartError as error:
        yield ("algebraic",), error
        return
    for place, scope, text in _at_ends(scenario):
        value = model.sx(scope, member.scopes[scope].symbol(text))
        if ca.depends_on(value, model.controls):
            yield (
                place,
                f"expected no algebraic variable that depends on controls in {scope}, "
                f"found {text}",
            )


def _of_scales(scenario: ProblemScenario, member: Member) -> Iterator[LocatedFlaw]:
    for name, given in scenario.algebraic.items():
        if isinstance(given, Equation):
            scale = number(given.scale, member.constants)
            if not scale > 0:
                place = ("algebraic", name, "scale")
                yield place, f"expected a scale above 0, found {scale:g}"


def _at_ends(scenario: ProblemScenario) -> Iterator[tuple[Place, str, str]]:
    """Yield (place, scope, text) of expressions at times without controls."""
    for key in ("initial_cost", "terminal_cost"):
        yield (key,), key, getattr(scenario, key)
    for index, one in enumerate(scenario.terminal):
        yield ("terminal", index, "expression"), "terminal", one.expression


_STAGES: tuple[Stage, ...] = (
    _of_parts,
    lambda s: tried(attempts.constants(s)),
    lambda s: tried(attempts.starts(s)),
    lambda s: tried(attempts.definitions(s)),
    lambda s: tried(
        [*attempts.expressions(s), *uncertain_numbers(s), *instance_numbers(s)]
    ),
    lambda s: [
        *number_flaws(s),
        *uncertain_ranges(s),
        *instance_ranges(s),
        *committed_numbers(s),
        *simulator_flaws(s),
    ],
    algebraic_flaws,
)
