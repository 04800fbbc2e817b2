"""Flaws of a problem scenario across its parts, each with its place.

Names first, then constants, definitions and all expressions; last the problem itself,
as the library takes it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

import casadi as ca

from swarmstart.cases.format.document import meant
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem import attempts
from swarmstart.cases.kinds.problem.algebraic_flaws import algebraic_flaws
from swarmstart.cases.kinds.problem.attempts import Place, tried
from swarmstart.cases.kinds.problem.decided_flaws import (
    combination_flaws,
    end_time_flaws,
    start_flaws,
    tied_flaws,
)
from swarmstart.cases.kinds.problem.measures import measure_flaws
from swarmstart.cases.kinds.problem.members import members_of, shared_of
from swarmstart.cases.kinds.problem.model import COSTS, planning_problem
from swarmstart.cases.kinds.problem.number_flaws import number_flaws
from swarmstart.cases.kinds.problem.parts import Vehicle
from swarmstart.cases.kinds.problem.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.symbols import (
    RESERVED,
)
from swarmstart.cases.kinds.problem.uncertain import (
    uncertain_names,
    uncertain_numbers,
    uncertain_ranges,
    with_members,
)
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import OptimalControlProblem, held_step
from swarmstart.ocp.integrators import PARTS

MOST_OPERATIONS = 40_000
"""In an interval: they take up to 15 s to prepare, and twice as many a minute."""
_NAMED = (
    "constants",
    "tables",
    "parameters",
    "signals",
    "definitions",
    "algebraic",
    "states",
    "controls",
)


def flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield what is wrong; a later stage only if the earlier ones are right."""
    stages: list[Callable[[ProblemScenario], Iterable[LocatedFlaw]]] = [
        _of_parts,
        lambda s: tried(attempts.constants(s)),
        lambda s: tried(attempts.starts(s)),
        lambda s: tried(attempts.definitions(s)),
        lambda s: tried([*attempts.expressions(s), *uncertain_numbers(s)]),
        lambda s: [*number_flaws(s), *uncertain_ranges(s)],
        algebraic_flaws,
        measure_flaws,
        _of_whole,
    ]
    for stage in stages:
        found = list(stage(scenario))
        yield from found
        if found:
            return


def _whole(scenario: ProblemScenario) -> OptimalControlProblem:
    """Return the problem of all that are planned together."""
    members = members_of(scenario, shared_of(scenario))
    one_by_one = scenario.vehicles and scenario.vehicles.planning == "priority"
    return planning_problem(scenario, members[:1] if one_by_one else members)


def _of_whole(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield that there is no such problem, or that it would take minutes to build.

    An interval is one expression.
    """
    try:
        problem = _whole(scenario)
    except SwarmstartError as error:
        yield (), error
        return
    yield from combination_flaws(scenario, problem)
    try:
        problem = with_members(scenario, problem)
    except SwarmstartError as error:
        yield ("uncertain",), error
        return
    grid, model = scenario.prediction, problem.model
    symbols = [*problem.symbols().values(), model.time]
    rates = ca.Function("rates", symbols, [model.ode, problem.stage_cost])
    evaluations = {"rk4": 4, "euler": 1, "stiff": 6}[grid.integrator]
    steps = grid.substeps * grid.checks
    found = rates.n_instructions() * evaluations * steps
    if grid.integrator == "stiff" and found <= MOST_OPERATIONS:  # And linear equations.
        dt = float(problem.expected_times[-1]) / grid.intervals
        first = held_step(model, dt, method="stiff")
        parts = len(PARTS)
        found = int(first.n_instructions() / parts * (steps + parts - 1))
    if found > MOST_OPERATIONS:
        yield (
            ("prediction",),
            f"expected at most {MOST_OPERATIONS} operations in an interval, those of "
            f"the rates in all substeps of all checks; found {found}: take more "
            "intervals, or fewer checks or substeps",
        )


def _of_parts(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield names given twice or to nothing, and parts that do not go together."""
    yield from scenario.flaws()
    yield from _names_given_twice(scenario)
    for place, given, known, what in _mappings(scenario):
        for name in given:
            if name not in known:
                yield (*place, name), _unknown(name, known, what)
    yield from _missing_keys(scenario)
    yield from _of_vehicles(scenario)
    yield from _of_feedback(scenario)
    yield from end_time_flaws(scenario)
    yield from tied_flaws(scenario)
    yield from _of_blocks(scenario)
    yield from uncertain_names(scenario)


def _names_given_twice(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    seen: dict[str, str] = {}
    for part in _NAMED:
        for name in getattr(scenario, part):
            if name in RESERVED or name in seen:
                found = seen.get(name, "it has a meaning of its own")
                yield (part, name), f"expected a new name, found {name!r}: {found}"
            seen[name] = f"it is among the {part}"


def _mappings(
    scenario: ProblemScenario,
) -> Iterator[tuple[Place, Mapping[str, object], Collection[str], str]]:
    """Yield (place, mapping, what its keys may be, what they are called)."""
    states, controls, plant = scenario.states, scenario.controls, scenario.plant
    yield ("guess", "controls"), scenario.guess.controls, controls, "control"
    yield ("guess", "states"), scenario.guess.states, states, "state"
    yield ("plant", "parameters"), plant.parameters, scenario.parameters, "parameter"
    yield ("plant", "disturbance"), plant.disturbance, states, "state"
    for index, one in enumerate(scenario.candidates):
        yield ("candidates", index), one, controls, "control"
    if scenario.dual_mode is not None:
        yield ("dual_mode", "at"), scenario.dual_mode.at, states, "state"
        yield ("dual_mode", "Q"), scenario.dual_mode.Q, states, "state"
        yield ("dual_mode", "R"), scenario.dual_mode.R, controls, "control"
    for index, vehicle in enumerate(_vehicles(scenario)):
        place = ("vehicles", "members", index, "start")
        yield place, vehicle.start, states, "state"


def _vehicles(scenario: ProblemScenario) -> list[Vehicle]:
    return scenario.vehicles.members if scenario.vehicles else []


def _missing_keys(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield keys that other parts of the scenario make necessary."""
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
    if scenario.vehicles is None or scenario.vehicles.separation is None:
        return
    for index, text in enumerate(scenario.vehicles.separation.of):
        one_by_one = scenario.vehicles.planning == "priority"
        if one_by_one and text.strip() not in scenario.states:
            where = ("vehicles", "separation", "of", index)
            yield where, _unknown(text, scenario.states, "state")


def _of_feedback(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield what does not go with one plan that is flown to its end, or with many."""
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
    if scenario.vehicles is not None and scenario.vehicles.planning == "priority":
        yield ("vehicles", "planning"), needs


def _of_blocks(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield that blocks of intervals are not all intervals."""
    grid = scenario.prediction
    if grid.blocks and sum(grid.blocks) != grid.intervals:
        yield (
            ("prediction", "blocks"),
            f"expected lengths that sum to prediction.intervals = {grid.intervals}, "
            f"found the sum {sum(grid.blocks)}",
        )


def _unknown(name: str, known: Collection[str], what: str) -> str:
    hint = meant(name, known, otherwise=f"known: {', '.join(known) or 'none'}")
    return f"expected a {what}, found {name!r}; {hint}"
