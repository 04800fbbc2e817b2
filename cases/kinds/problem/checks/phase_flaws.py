"""Errors of phases: of each phase as a scenario of its own, and of all together."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from swarmstart.cases.format.expressions import parse
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks import attempts
from swarmstart.cases.kinds.problem.checks.attempts import (
    Attempt,
    Place,
    names_of_nothing,
    tried,
    unknown,
)
from swarmstart.cases.kinds.problem.checks.number_flaws import (
    feature_flaws,
    operation_flaws,
)
from swarmstart.cases.kinds.problem.measuring.measures import measure_flaws
from swarmstart.cases.kinds.problem.stated.members import members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import COSTS
from swarmstart.cases.kinds.problem.stated.phases import (
    MERGED,
    joined,
    phase_names,
    phase_scenarios,
    whole_scenario,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import TIME, known_parameters
from swarmstart.cases.kinds.problem.stated.values import OverTime, Table
from swarmstart.errors import SwarmstartError

Stage = Callable[[ProblemScenario], Iterable[LocatedFlaw]]
# The library numbers phases from 1; in these two messages it says which is wrong.
_OF_PHASE = re.compile(r"phase (\d+) (?:has|must come)")


def phases_flaws(
    scenario: ProblemScenario, stages: Sequence[Stage]
) -> Iterator[LocatedFlaw]:
    """Yield errors; those of a later stage only if earlier stages have none."""
    every: tuple[Stage, ...] = (
        _of_parts,
        *(partial(_in_phases, stage=stage) for stage in stages),
        partial(_in_phases, stage=partial(feature_flaws, what="a phase")),
        _of_linkages,
        _in_time,
        measure_flaws,
        _of_all,
    )
    for look in every:
        found = list(look(scenario))
        yield from found
        if found:
            return


def _in_phases(scenario: ProblemScenario, *, stage: Stage) -> Iterator[LocatedFlaw]:
    """Yield the errors of a stage in all phases, at their places in the file, once."""
    seen: set[tuple[Place, str]] = set()
    for number, one in enumerate(phase_scenarios(scenario)):
        for place, what in stage(one):
            where = place_in_file(scenario, number, place)
            # What the file states is wrong in every phase: one error.
            if (where, str(what)) not in seen:
                seen.add((where, str(what)))
                yield where, what


def place_in_file(scenario: ProblemScenario, number: int, place: Place) -> Place:
    """Return the place in the file at which a part of a phase's scenario is stated.

    Args:
        scenario: The scenario of the file, with phases.
        number: Number of the phase, from 0.
        place: Place of the part in the phase's own scenario.
    """
    phase, at = scenario.phases[number], ("phases", number)
    is_last = number == len(scenario.phases) - 1
    match place:
        case ("prediction", "horizon_s" | "intervals" as key, *rest):
            return (*at, key, *rest)
        case ("path" | "terminal" as key, int(index), *rest):
            shared = len(scenario.path if key == "path" else scenario.terminal)
            # Terminal constraints of the file belong to the last phase alone.
            shared = shared if key == "path" or is_last else 0
            return place if index < shared else (*at, key, index - shared, *rest)
        case ("constants" | "definitions" as key, name, *rest):
            return (*at, key, name, *rest) if name in getattr(phase, key) else place
        case (str(key), str(name), *rest) if key in MERGED:
            own = getattr(phase, key).get(name)
            given: set[str] = getattr(own, "model_fields_set", set())
            # Its own only if the phase gives this very key; others come from the file.
            is_own = name in getattr(phase, key) and (
                not rest or rest[0] in given or isinstance(own, str)
            )
            return (*at, key, name, *rest) if is_own else place
        case ("stage_cost" | "step_cost" | "terminal_cost" as key,):
            return (*at, key) if getattr(phase, key) is not None else place
    return place


def _of_parts(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    for look in (_of_file, _of_costs, _of_names, _of_overlays, _linked_names):
        yield from look(scenario)


def _of_file(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of parts of the file that do not fit phases."""
    has: dict[Place, object] = {
        ("signals",): scenario.signals,
        ("vehicles",): scenario.vehicles,
        ("uncertain",): scenario.uncertain,
        ("dual_mode",): scenario.dual_mode,
        ("instances",): scenario.instances,
        ("plant", "disturbance"): scenario.modelled.disturbance,
        ("prediction", "horizon_s"): scenario.prediction.horizon_s,
        ("prediction", "blocks"): scenario.prediction.blocks,
    }
    if scenario.simulator is not None:
        has["plant", scenario.simulator.key] = True
    for place, found in has.items():
        if found:
            yield place, f"expected no {place[-1]} with phases"
    if scenario.feedback.law != "open_loop":
        what = "expected feedback: open_loop with phases, found receding_horizon"
        yield ("feedback",), what
    total = sum(one.intervals for one in scenario.phases)
    if scenario.prediction.intervals != total:
        yield (
            ("prediction", "intervals"),
            f"expected the intervals of all phases, {total}, or no number; found "
            f"{scenario.prediction.intervals}",
        )
    elif scenario.steps > total:
        yield ("steps",), f"expected at most {total} steps, found {scenario.steps}"


def _of_costs(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield an error if there is no cost, or two terminal costs."""
    keys = {*scenario.model_fields_set}
    for one in scenario.phases:
        keys |= {key for key in one.model_fields_set if getattr(one, key) is not None}
    if not {*COSTS} & keys:
        yield (), f"expected a cost, one of {', '.join(COSTS)}; found none"
    last = len(scenario.phases) - 1
    if scenario.phases[last].terminal_cost is None or scenario.terminal_cost == "0":
        return
    place: Place = ("phases", last, "terminal_cost")
    yield place, "expected no terminal cost in the last phase, since the file has one"


def _of_names(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of unknown names in guesses, and of repeated names of phases."""
    whole = whole_scenario(scenario)
    yield from names_of_nothing(whole)
    for index, one in enumerate(scenario.candidates):
        for name in whole.controls:
            if name not in one:
                yield ("candidates", index), f"expected the key {name!r}"
    names = phase_names(scenario)
    for number, name in enumerate(names):
        if name in names[:number]:
            yield ("phases", number, "name"), f"expected a new name, found {name!r}"


def _of_overlays(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of missing and of unknown parts in each phase."""
    for number, one in enumerate(phase_scenarios(scenario)):
        for part in MERGED:
            place: Place = ("phases", number, part)
            if part in ("states", "controls") and not getattr(one, part):
                yield place, f"expected at least one of the {part} in a phase"
            known = getattr(scenario, part)
            for name, own in getattr(scenario.phases[number], part).items():
                if own is None and name not in known:
                    yield (*place, name), unknown(name, known, "name of the file")


def _linked_names(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of linkages to no state of a next phase."""
    every = phase_scenarios(scenario)
    for number, phase in enumerate(scenario.phases):
        place: Place = ("phases", number, "linkage")
        if number == len(every) - 1:
            if phase.linkage:
                yield place, "expected no linkage in the last phase"
            return
        after = every[number + 1].states
        for name in phase.linkage:
            if name not in after:
                yield (*place, name), unknown(name, after, "state of the next phase")


def _of_linkages(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    def every() -> Iterator[Attempt]:
        pairs = zip(scenario.phases, phase_scenarios(scenario), strict=True)
        for number, (phase, one) in enumerate(pairs):
            (member,) = members_of(one, shared_of(one))
            for name, text in phase.linkage.items():
                place: Place = ("phases", number, "linkage", name)
                yield place, partial(member.scopes["linkage"].symbol, text)

    yield from tried(every())


def _in_time(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of guesses, candidates and parameters over time.

    The plant's parameters must be constant, since its times are not known before.
    """
    whole = whole_scenario(scenario)
    yield from tried(attempts.in_time(whole))
    over: dict[Place, OverTime] = {
        **{("parameters", n): one for n, one in known_parameters(scenario).items()},
        **{
            ("plant", "parameters", n): p
            for n, p in scenario.modelled.parameters.items()
        },
    }
    for place, given in over.items():
        if _varies(given):
            yield place, "expected a number with phases, found values over time"


def _varies(given: OverTime) -> bool:
    return isinstance(given, Table) or TIME in parse(given).names


def _of_all(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of all phases together, also if building takes minutes."""
    try:
        together, _ = joined(scenario)
    except SwarmstartError as error:
        found = _OF_PHASE.search(str(error))
        at: Place = ("phases", int(found[1]) - 1) if found else ("phases",)
        yield at, error
        return
    yield from operation_flaws(together.problem)
