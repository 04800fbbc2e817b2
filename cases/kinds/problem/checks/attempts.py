"""Errors of names, and of expressions, which are evaluated one by one to find them.

An attempt is a place in the scenario and a call that raises the error there. A name is
an error if it is given twice, already taken, or unknown.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import partial

from swarmstart.cases.format.document import meant
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.stated.members import (
    Member,
    candidate_scopes,
    members_of,
    shared_of,
)
from swarmstart.cases.kinds.problem.stated.model import (
    COSTS,
    path_constraint,
    terminal_constraint,
)
from swarmstart.cases.kinds.problem.stated.parts import Constraint, Distance, Noise
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    RESERVED,
    constants_of,
    free,
    known_parameters,
    number,
    over_time,
    positive,
)
from swarmstart.cases.kinds.problem.stated.values import Decided, OverTime
from swarmstart.errors import SwarmstartError

Place = tuple[str | int, ...]
Attempt = tuple[Place, Callable[[], object]]
Members = tuple[Member, ...]

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


def tried(attempts: Iterable[Attempt]) -> Iterator[LocatedFlaw]:
    """Make attempts, and yield the errors of those that fail.

    An attempt is a place in the scenario and a call that raises the error there. If an
    attempt fails at a place within which an earlier attempt has failed, no second error
    is yielded.
    """
    failed: set[Place] = set()
    for place, attempt in attempts:
        try:
            attempt()
        except SwarmstartError as error:
            # The whole fails with its part: one error, at the more exact place.
            if not any(one[: len(place)] == place for one in failed):
                yield place, error
            failed.add(place)


def constants(scenario: ProblemScenario) -> Iterator[Attempt]:
    """Yield an attempt for each constant, to evaluate it from those before it."""
    known: dict[str, float] = {}
    for name, text in scenario.constants.items():
        yield ("constants", name), partial(_add, name, text, known)
    members = scenario.vehicles.members if scenario.vehicles else []
    for index, vehicle in enumerate(members):
        own, place = dict(known), ("vehicles", "members", index, "constants")
        for name, text in vehicle.constants.items():
            yield (*place, name), partial(_add, name, text, own)
        yield place, partial(constants_of, scenario, vehicle.constants)


def _add(name: str, text: str, known: dict[str, float]) -> None:
    known[name] = number(text, known)


def quantity(place: Place, text: str, names: Mapping[str, float]) -> Attempt:
    """Return an attempt: a place, and a call that evaluates the number stated there."""
    return place, partial(number, text, names)


def definitions(scenario: ProblemScenario) -> Iterator[Attempt]:
    """Yield attempts to build the vehicles with the first 0, 1, 2, ... definitions.

    So the first definition that has an error is found. There are no attempts if the
    vehicles can be built with all definitions.
    """
    names, shared = list(scenario.definitions), shared_of(scenario)
    try:
        members_of(scenario, shared)
    except SwarmstartError:
        pass  # Which of them fails is found below.
    else:
        return
    # Without any definition first: an error there is not that of a definition.
    for count in range(len(names) + 1):
        some = {name: scenario.definitions[name] for name in names[:count]}
        part = scenario.model_copy(update={"definitions": some})
        place: Place = ("definitions", names[count - 1]) if count else ()
        yield place, partial(members_of, part, shared)


def starts(scenario: ProblemScenario) -> Iterator[Attempt]:
    """Yield attempts to evaluate starts, and bounds and guesses of decided numbers."""
    fixed = constants_of(scenario)
    vehicles = scenario.vehicles.members if scenario.vehicles else []
    owned = [constants_of(scenario, one.constants) for one in vehicles]
    places: list[tuple[Place, object, Mapping[str, float]]] = [
        (("prediction", "horizon_s"), scenario.prediction.horizon_s, fixed),
        *((("parameters", n), one, fixed) for n, one in scenario.parameters.items()),
    ]
    for name, state in scenario.states.items():
        pairs = zip(vehicles, owned, strict=True)
        # The start of the file counts only for vehicles without one of their own.
        users = [own for one, own in pairs if name not in one.start]
        place: Place = ("states", name, "start")
        places += [
            (place, state.start, own) for own in (users if vehicles else [fixed])
        ]
    for index, (one, own) in enumerate(zip(vehicles, owned, strict=True)):
        place = ("vehicles", "members", index, "start")
        places += [((*place, n), given, own) for n, given in one.start.items()]
    for name, control in scenario.controls.items():
        places.append((("controls", name, "previous"), control.previous, fixed))
    for place, given, names in places:
        if isinstance(given, Decided):
            yield from _of_decided(place, given, names)
        # Parameters are values over time, which `in_time` attempts.
        elif isinstance(given, str) and place[0] != "parameters":
            yield place, partial(number, given, names)


def _of_decided(
    place: Place, given: Decided, names: Mapping[str, float]
) -> Iterator[Attempt]:
    """Yield attempts to evaluate bounds and guess of a decided number, then both."""
    for index, text in enumerate(given.free):
        if text is not None:
            yield (*place, "free", index), partial(number, text, names)
    if given.guess is not None:
        yield (*place, "guess"), partial(number, given.guess, names)
    yield place, partial(free, given, names)


def expressions(scenario: ProblemScenario) -> Iterator[Attempt]:
    """Yield attempts to evaluate all other expressions."""
    members, fixed = members_of(scenario, shared_of(scenario)), constants_of(scenario)
    for place, scope, text in _symbolic(scenario):
        yield place, _in_all(members, scope, text)
    for part in ("path", "terminal"):
        for index, one in enumerate(getattr(scenario, part)):
            yield from _of_constraint((part, index), one, members)
    yield from in_time(scenario)
    for place, text in _quantities(scenario):
        yield place, partial(number, text, fixed)
    for role in ("states", "controls"):
        for name, one in getattr(scenario, role).items():
            if one.scale is not None:
                yield (role, name, "scale"), partial(positive, one.scale, fixed)


def in_time(scenario: ProblemScenario) -> Iterator[Attempt]:
    """Yield attempts to evaluate values over time."""
    members, fixed = members_of(scenario, shared_of(scenario)), constants_of(scenario)
    for place, given in _over_time(scenario):
        if isinstance(given, Noise):
            yield (*place, "deviation"), partial(number, given.deviation, fixed)
        elif place[0] == "guess":
            yield place, _for_all(members, given)
        else:
            yield place, partial(over_time, given, fixed)
    for index, one in enumerate(scenario.candidates):
        for name, text in one.items():
            yield ("candidates", index, name), _candidate(scenario, members, text)


def _symbolic(scenario: ProblemScenario) -> Iterator[tuple[Place, str, str]]:
    """Yield (place, scope, text) of rates, costs and positions."""
    for name, state in scenario.states.items():
        for change in ("rate", "next"):
            text = getattr(state, change)
            if text is not None:
                yield ("states", name, change), change, text
    yield from _bounds(scenario)
    for name, given in scenario.algebraic.items():
        place: Place = ("algebraic", name)
        if isinstance(given, str):
            yield place, "algebraic", given
        else:
            yield (*place, "equation"), "algebraic", given.equation
            yield (*place, "start"), "algebraic_start", given.start
    for cost in COSTS:
        yield (cost,), cost, getattr(scenario, cost)
    separation = scenario.vehicles.separation if scenario.vehicles else None
    for index, text in enumerate(separation.of if separation else ()):
        yield ("vehicles", "separation", "of", index), "path", text


def _bounds(scenario: ProblemScenario) -> Iterator[tuple[Place, str, str]]:
    """Yield (place, scope, text) of bounds, which can change with time."""
    for part in ("states", "controls"):
        for name, one in getattr(scenario, part).items():
            for index, text in enumerate(one.bounds or ()):
                if text is not None:
                    yield (part, name, "bounds", index), "bounds", text


def _over_time(scenario: ProblemScenario) -> Iterator[tuple[Place, OverTime | Noise]]:
    """Yield all parts that have values over time."""
    parts: dict[Place, Mapping[str, OverTime | Noise]] = {
        ("parameters",): known_parameters(scenario),
        ("signals",): scenario.signals,
        ("guess", "controls"): scenario.guess.controls,
        ("guess", "states"): scenario.guess.states,
        ("plant", "parameters"): scenario.modelled.parameters,
        ("plant", "disturbance"): scenario.modelled.disturbance,
    }
    for place, given in parts.items():
        yield from (((*place, name), one) for name, one in given.items())


def _quantities(scenario: ProblemScenario) -> Iterator[tuple[Place, str]]:
    """Yield numbers of algebraic variables, of the dual mode and the separation."""
    for name, given in scenario.algebraic.items():
        if not isinstance(given, str):
            yield ("algebraic", name, "scale"), given.scale
    if scenario.dual_mode is not None:
        for key in ("at", "Q", "R"):
            for name, text in getattr(scenario.dual_mode, key).items():
                yield ("dual_mode", key, name), text
    separation = scenario.vehicles.separation if scenario.vehicles else None
    numbers: dict[Place, str | None] = {
        ("vehicles", "separation", key): getattr(separation, key, None)
        for key in ("distance", "margin", "scale")
    }
    error = getattr(scenario.vehicles, "tracking_error", None)
    numbers["vehicles", "tracking_error"] = error
    yield from ((place, text) for place, text in numbers.items() if text is not None)


def _for_all(members: Members, given: OverTime) -> Callable[[], object]:
    return lambda: [over_time(given, member.constants) for member in members]


def _candidate(
    scenario: ProblemScenario, members: Members, text: str
) -> Callable[[], object]:
    scopes = partial(candidate_scopes, scenario, members, constants_of(scenario))
    # Time 0 stands for all: names and functions are the same at any time.
    return lambda: [scope.number(text) for scope in scopes(0.0)]


def _in_all(members: Members, place: str, text: str) -> Callable[[], object]:
    # In all, since vehicles can have constants of their own.
    return lambda: [member.scopes[place].symbol(text) for member in members]


def _of_constraint(
    path: Place, given: Constraint | Distance, members: Members
) -> Iterator[Attempt]:
    """Yield attempts to evaluate the parts of a constraint, then the whole."""
    where, fixed = str(path[0]), members[0].constants
    inner = (
        {(*path, "expression"): given.expression}
        if isinstance(given, Constraint)
        else {
            (*path, "distance", index): text
            for index, text in enumerate(given.distance)
        }
    )
    for place, text in inner.items():
        yield place, _in_all(members, where, text)
    for key in ("at_least", "at_most", "margin", "lower", "upper", "equals", "scale"):
        limit = getattr(given, key, None)
        if limit is not None:
            yield (*path, key), partial(number, limit, fixed)
    soft = getattr(given, "soft", None)
    for key in ("weight", "quadratic"):
        weight = getattr(soft, key, None)
        if weight is not None:
            yield (*path, "soft", key), partial(number, weight, fixed)
    # The whole last: its parts alone can be right, and lower be above upper.
    make = path_constraint if where == "path" else terminal_constraint
    yield path, partial(_made, make, given, members)


def _made(make: Callable[..., object], given: object, members: Members) -> None:
    for member in members:
        make(given, member)


def names_given_twice(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of names that already have a meaning."""
    seen: dict[str, str] = {}
    for part in _NAMED:
        for name in getattr(scenario, part):
            # Names of all parts share one space: an expression can use any of them.
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
    states, controls, plant = scenario.states, scenario.controls, scenario.modelled
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
    """Return the message for an unknown name, with one similar or all known names.

    Args:
        name: The unknown name.
        known: The known names.
        what: Role that the name should have, such as "state".
    """
    hint = meant(name, known, otherwise=f"known: {', '.join(known) or 'none'}")
    return f"expected a {what}, found {name!r}; {hint}"
