"""Errors of numbers decided besides controls: end time, parameters, starts."""

import math
from collections.abc import Iterator

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Place
from swarmstart.cases.kinds.problem.stated.model import horizon_of
from swarmstart.cases.kinds.problem.stated.parts import Noise
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    constants_of,
    decided_parameters,
    is_decided,
)
from swarmstart.cases.kinds.problem.stated.values import Decided, Tied
from swarmstart.ocp import Free, OptimalControlProblem


def combination_flaws(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> Iterator[LocatedFlaw]:
    """Yield errors of parts that priority planning or a dual mode cannot have."""
    model, vehicles = problem.model, scenario.vehicles
    decides = {
        "an end time that is decided": isinstance(problem.horizon, Free),
        "decided parameters": bool(problem.decided),
        "decided starts": bool(problem.start),
        "periodic states": bool(problem.periodic),
        "previous controls": bool(problem.previous.numel()),
        "linear controls": problem.has_knots,
    }
    varies = {
        "time": bool(model.time.numel()),
        "signals in rates": bool(model.ns),
        "states with next": model.jumps,
        "controls of whole numbers": bool(problem.integer),
    }
    if vehicles is not None and vehicles.planning == "priority":
        found = [what for what, is_there in decides.items() if is_there]
        if found:
            yield (
                ("vehicles", "planning"),
                f"expected planning: joint with {', '.join(found)}; found priority",
            )
    if scenario.dual_mode is not None:
        found = [what for what, is_there in (decides | varies).items() if is_there]
        if found:
            yield (
                ("dual_mode",),
                f"expected a problem without {', '.join(found)}: the linear law and "
                "its set are for a system that does not change in time",
            )


def start_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of decided starts in closed loop, where the start is measured."""
    starts: dict[Place, object] = {
        ("states", name, "start"): state.start
        for name, state in scenario.states.items()
    }
    for index, vehicle in enumerate(
        scenario.vehicles.members if scenario.vehicles else []
    ):
        place = ("vehicles", "members", index, "start")
        starts |= {(*place, name): start for name, start in vehicle.start.items()}
    for where, start in starts.items():
        if is_decided(start):
            yield (
                where,
                "expected a number with feedback: receding_horizon, whose plans start "
                "where the state is measured",
            )


def tied_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of starts that are tied to a start that is not decided."""
    own: dict[str, object] = {n: state.start for n, state in scenario.states.items()}
    starts: list[tuple[Place, str, dict[str, object]]] = [
        (("states", name, "start"), name, own) for name in own
    ]
    for index, one in enumerate(scenario.vehicles.members if scenario.vehicles else []):
        place: Place = ("vehicles", "members", index, "start")
        every = {**own, **one.start}
        starts += [((*place, name), name, every) for name in one.start]
        starts += [(place, name, every) for name in own if name not in one.start]
    for place, name, every in starts:
        start = every[name]
        if not isinstance(start, Tied):
            continue
        if not isinstance(every.get(start.same_as), Decided):
            yield (
                (*place, "same_as"),
                "expected a state whose start is decided, {free: [lower, upper]}; "
                f"found {start.same_as!r}",
            )


def end_time_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of parts that do not fit the end time."""
    place: Place = ("prediction", "horizon_s")
    horizon = scenario.prediction.horizon_s
    rates = [name for name, s in scenario.states.items() if s.rate is not None]
    if horizon is None and rates:
        yield (
            place[:1],
            "expected the key 'horizon_s', which can be left out in discrete time "
            f"only: {rates[0]} has a rate",
        )
    if is_decided(horizon):
        yield from _of_free_end(scenario, bool(rates))
    elif scenario.feedback.period_s is not None:
        yield (
            ("feedback", "period_s"),
            "expected no period_s unless the end time is decided",
        )


def _of_free_end(scenario: ProblemScenario, has_rates: bool) -> Iterator[LocatedFlaw]:
    """Yield errors of parts that do not fit a decided end time."""
    is_open, period = scenario.feedback.law == "open_loop", scenario.feedback.period_s
    if not has_rates:
        yield (
            ("prediction", "horizon_s"),
            "expected a number in discrete time, found an end time that is decided",
        )
    if scenario.signals:
        yield (
            ("signals",),
            "expected no signals if the end time is decided, since their values at the "
            "checks are not known before: write them as definitions in time",
        )
    if not is_open and period is None:
        yield (
            ("feedback",),
            "expected the key 'period_s', the time from plan to plan, if the end time "
            "is decided",
        )
    least, found = scenario.prediction.intervals, scenario.plant.substeps
    if not is_open and found < least:
        yield (
            ("plant", "substeps"),
            f"expected at least prediction.intervals = {least} if the end time is "
            f"decided, since the last step has all of them; found {found}",
        )
    if is_open and period is not None:
        yield (
            ("feedback", "period_s"),
            "expected no period_s with feedback: open_loop",
        )
    for name, given in scenario.plant.disturbance.items():
        if is_open and isinstance(given, Noise):
            yield (
                ("plant", "disturbance", name),
                "expected values over time if the end time is decided, found noise: "
                "the length of the plant's steps is not known before",
            )


def decided_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of bounds of a decided end time or parameter."""
    fixed, place = constants_of(scenario), ("prediction", "horizon_s")
    for name, one in decided_parameters(scenario, fixed).items():
        yield from search_flaws(scenario, ("parameters", name, "free"), one)
    horizon, period = horizon_of(scenario, fixed), scenario.feedback.period_s
    if not isinstance(horizon, Free):
        return
    yield from search_flaws(scenario, (*place, "free"), horizon)
    if not horizon.lower > 0:
        yield (
            (*place, "free", 0),
            f"expected a shortest time above 0, found {horizon.lower:g}",
        )
    elif period is not None and horizon.lower > period:
        yield (
            (*place, "free", 0),
            f"expected a shortest time of at most one period of {period:g} s, found "
            f"{horizon.lower:g} s",
        )


def search_flaws(
    scenario: ProblemScenario, place: Place, one: Free
) -> Iterator[LocatedFlaw]:
    """Yield errors of missing bounds, between which a search draws."""
    is_bounded = math.isfinite(one.lower) and math.isfinite(one.upper)
    if scenario.search.name != "none" and not is_bounded:
        yield (
            place,
            "expected two numbers, [lower, upper]: the search draws between them; "
            "without a search (search: {name: none}) a bound may be null",
        )


def bounded_start_flaws(
    scenario: ProblemScenario, name: str, bounds: tuple[float, float], free: Free
) -> Iterator[LocatedFlaw]:
    """Yield errors of decided starts that are always out of the state's bounds."""
    lower, upper = max(bounds[0], free.lower), min(bounds[1], free.upper)
    place: Place = ("states", name, "start")
    if lower > upper:
        yield (
            place,
            f"expected a start that can be within the bounds {interval_text(bounds)}, "
            f"found {interval_text((free.lower, free.upper))}",
        )
    else:
        yield from search_flaws(scenario, place, Free(lower, upper))


def interval_text(pair: tuple[float, float]) -> str:
    """Return bounds as a list of two."""
    return f"[{pair[0]:g}, {pair[1]:g}]"
