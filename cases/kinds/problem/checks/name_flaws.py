"""Errors of names: given twice, already taken, or unknown."""

from collections.abc import Collection, Iterator, Mapping

from swarmstart.cases.format.document import meant
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Place
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import RESERVED

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


def names_given_twice(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of names that already have a meaning."""
    seen: dict[str, str] = {}
    for part in _NAMED:
        for name in getattr(scenario, part):
            if name in RESERVED or name in seen:
                found = seen.get(name, "it has a meaning of its own")
                yield (part, name), f"expected a new name, found {name!r}: {found}"
            seen[name] = f"it is among the {part}"


def names_of_nothing(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of keys that are not names of states, controls and the like."""
    for place, given, known, what in _mappings(scenario):
        for name in given:
            if name not in known:
                yield (*place, name), unknown(name, known, what)


def _mappings(
    scenario: ProblemScenario,
) -> Iterator[tuple[Place, Mapping[str, object], Collection[str], str]]:
    """Yield (place, mapping, allowed keys, role of the keys)."""
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
    for index, vehicle in enumerate(
        scenario.vehicles.members if scenario.vehicles else []
    ):
        place = ("vehicles", "members", index, "start")
        yield place, vehicle.start, states, "state"


def unknown(name: str, known: Collection[str], what: str) -> str:
    """Return the message for an unknown name, with a similar known name."""
    hint = meant(name, known, otherwise=f"known: {', '.join(known) or 'none'}")
    return f"expected a {what}, found {name!r}; {hint}"
