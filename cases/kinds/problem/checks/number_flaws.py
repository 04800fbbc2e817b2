"""Errors of numbers: starts, bounds, decided numbers, and the number of operations.

Errors are starts and bounds that are invalid or do not fit each other, and a decided
end time, parameter or start that does not fit other parts. Too many operations are an
error, too: an interval is one expression, which would take minutes to build.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial

import casadi as ca

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Place
from swarmstart.cases.kinds.problem.stated.members import Member, members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import horizon_of
from swarmstart.cases.kinds.problem.stated.parts import Control, Noise
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    constants_of,
    decided_parameters,
    fixed_limits,
    is_decided,
    limits,
    moving_limits,
    number,
)
from swarmstart.cases.kinds.problem.stated.values import Decided, Tied
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import INTEGRATORS, Free, OptimalControlProblem, held_step
from swarmstart.ocp.integration import PARTS
from swarmstart.ocp.statement import FEATURES

Limits = tuple[float, float]

MOST_OPERATIONS = 40_000
"""Largest number of operations in an interval, which take up to 15 s to prepare."""


def number_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield each error of starts and bounds that are invalid or do not fit, once."""
    seen: set[Place] = set()
    yield from decided_flaws(scenario)
    for member in members_of(scenario, shared_of(scenario)):
        for place, what in _of_member(scenario, member):
            # Vehicles share bounds: one error, not one for each of them.
            if place not in seen:
                seen.add(place)
                yield place, what


def _of_member(scenario: ProblemScenario, member: Member) -> Iterator[LocatedFlaw]:
    starts = dict(zip(scenario.states, member.start, strict=True))
    for name, state in scenario.states.items():
        pair, scope = state.bounds, member.scopes["bounds"]
        for place, found in _ordered(
            ("states", name, "bounds"), partial(fixed_limits, pair, scope)
        ):
            if not isinstance(found, tuple):
                yield place, found
            elif (first := member.tied.get(name, name)) in member.decided:
                yield from bounded_start_flaws(
                    scenario, name, found, member.decided[first]
                )
            elif not found[0] <= starts[name] <= found[1]:
                yield (
                    ("states", name, "start"),
                    f"expected a start within the bounds {interval_text(found)}, "
                    f"found {starts[name]:g}",
                )
    for name, control in scenario.controls.items():
        yield from _of_control(scenario, name, control, member)


def _ordered(
    place: Place, read: Callable[[], Limits]
) -> Iterator[tuple[Place, Limits | str | SwarmstartError]]:
    """Yield a place with its bounds, or with their error."""
    try:
        lower, upper = read()
    except SwarmstartError as error:
        yield place, error
        return
    if lower > upper:
        yield place, f"expected lower <= upper, found {interval_text((lower, upper))}"
    else:
        yield place, (lower, upper)


def _of_control(
    scenario: ProblemScenario, name: str, control: Control, member: Member
) -> Iterator[LocatedFlaw]:
    """Yield errors of a control's bounds, also if a search has nothing to draw."""
    place: Place = ("controls", name, "bounds")
    scope = member.scopes["bounds"]
    # Exactly one is yielded: the bounds, or their error.
    ((_, bounds),) = _ordered(place, partial(fixed_limits, control.bounds, scope))
    if not isinstance(bounds, tuple):
        yield place, bounds
        return
    lower, upper = bounds
    if control.search_bounds is not None:
        inner: Place = ("controls", name, "search_bounds")
        own = partial(limits, control.search_bounds, member.constants)
        ((_, within),) = _ordered(inner, own)
        if not isinstance(within, tuple):
            yield inner, within
            return
        lower, upper = max(within[0], lower), min(within[1], upper)
        if lower > upper:
            yield (
                inner,
                f"expected bounds for the search within {interval_text(bounds)}, found "
                f"{interval_text(within)}",
            )
    yield from _not_whole(name, control, bounds, (lower, upper))
    is_bounded = math.isfinite(lower) and math.isfinite(upper)
    if scenario.search.name != "none" and not is_bounded:
        moves = any(
            isinstance(limit, ca.SX) for limit in moving_limits(control.bounds, scope)
        )
        yield (
            place if control.bounds is not None else place[:-1],
            "expected search_bounds, two numbers, beside bounds that move: the search "
            "draws between them"
            if moves
            else "expected bounds of the control, [lower, upper]: the search draws "
            "between them; without a search (search: {name: none}) it may be unbounded",
        )


def _not_whole(
    name: str, control: Control, bounds: Limits, within: Limits
) -> Iterator[LocatedFlaw]:
    """Yield errors of bounds that are not whole for a control of whole numbers."""
    for key, found in (("bounds", bounds), ("search_bounds", within)):
        is_whole = all(b == round(b) for b in found if math.isfinite(b))
        if control.integer and not is_whole:
            yield (
                ("controls", name, key),
                "expected whole numbers as bounds of a control that takes whole "
                f"numbers, found {interval_text(found)}",
            )
            return


def combination_flaws(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> Iterator[LocatedFlaw]:
    """Yield errors of parts that do not go with planning one by one or a dual mode."""
    model, vehicles = problem.model, scenario.vehicles
    planning = "joint" if vehicles is None else vehicles.planning
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
    if planning != "joint":
        yield from feature_flaws(scenario, f"planning: {planning}, unlike joint,")
        found = [what for what, is_there in decides.items() if is_there]
        if found:
            yield (
                ("vehicles", "planning"),
                f"expected planning: joint with {', '.join(found)}; found {planning}",
            )
    if scenario.dual_mode is not None:
        yield from feature_flaws(scenario, "dual_mode")
        found = [what for what, is_there in (decides | varies).items() if is_there]
        if found:
            yield (
                ("dual_mode",),
                f"expected a problem without {', '.join(found)}: the linear law and "
                "its set are for a system that does not change in time",
            )


def feature_flaws(scenario: ProblemScenario, what: str) -> Iterator[LocatedFlaw]:
    """Yield errors of control features, such as `delay_s`, that `what` cannot have.

    A feature whose number is 0, such as a delay of 0 s, is no error.

    Args:
        scenario: The scenario.
        what: Key of the scenario that allows no such features.
    """
    try:
        members = members_of(scenario, shared_of(scenario))
    except SwarmstartError:
        return  # A later stage names the error with its place.
    for name, control in scenario.controls.items():
        for key in FEATURES:
            text = getattr(control, key)
            found = {number(text, m.constants) for m in members} if text else {0.0}
            if found != {0.0}:
                yield (
                    ("controls", name, key),
                    f"{what} takes no {key}: expected null or 0, found {text}",
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
        # A tied start of the file is tied to the starts of this vehicle.
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
    if scenario.feedback.ends_at_s is not None:
        yield from _of_fixed_end(scenario, bool(rates))
    elif is_decided(horizon):
        yield from _of_free_end(scenario, bool(rates))
    elif scenario.feedback.period_s is not None:
        yield (
            ("feedback", "period_s"),
            "expected no period_s unless the end time is decided or feedback.ends_at_s "
            "is given",
        )


def _of_fixed_end(scenario: ProblemScenario, has_rates: bool) -> Iterator[LocatedFlaw]:
    """Yield errors of parts that do not fit plans that become shorter."""
    place, what = ("feedback", "ends_at_s"), "a receding horizon that ends"
    if is_decided(scenario.prediction.horizon_s):
        yield place, "expected no ends_at_s if the end time is decided"
    if not has_rates:
        yield place, "expected no ends_at_s in discrete time, whose steps are all equal"
    vehicles = scenario.vehicles
    if vehicles is not None and vehicles.planning != "joint":
        yield place, "expected no ends_at_s unless one plan is made for all vehicles"
    if scenario.dual_mode is not None:
        yield place, "expected no ends_at_s with a dual mode, which goes on for ever"
    yield from _substep_flaws(scenario, "the run ends at a fixed time")
    yield from feature_flaws(scenario, what)


def _substep_flaws(scenario: ProblemScenario, cause: str) -> Iterator[LocatedFlaw]:
    """Yield an error if the last step is too coarse for all intervals of a plan."""
    least, found = scenario.prediction.intervals, scenario.modelled.substeps
    if found < least:
        yield (
            ("plant", "substeps"),
            f"expected at least prediction.intervals = {least} if {cause}, since the "
            f"last step has all of them; found {found}",
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
    if not is_open:
        yield from _substep_flaws(scenario, "the end time is decided")
    if is_open and period is not None:
        yield (
            ("feedback", "period_s"),
            "expected no period_s with feedback: open_loop",
        )
    for name, given in scenario.modelled.disturbance.items():
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
    """Yield an error if a decided number lacks a bound that the search needs.

    A search draws the number between its bounds; without a search they may be missing.

    Args:
        scenario: The scenario.
        place: Place of the error in the scenario.
        one: The bounds of the decided number.
    """
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
    """Yield an error if no value of a decided start is within the state's bounds.

    If a search draws the start, an error is also yielded if a bound of it is missing.
    """
    lower, upper = max(bounds[0], free.lower), min(bounds[1], free.upper)
    place: Place = ("states", name, "start")
    if lower > upper:
        yield (
            place,
            f"expected a start that can be within the bounds {interval_text(bounds)}, "
            f"found {interval_text((free.lower, free.upper))}",
        )
    else:
        # A search draws where both the free range and the bounds allow it.
        yield from search_flaws(scenario, place, Free(lower, upper))


def interval_text(pair: tuple[float, float]) -> str:
    """Return bounds as text, such as [0, 1]."""
    return f"[{pair[0]:g}, {pair[1]:g}]"


def operation_flaws(problem: OptimalControlProblem) -> Iterator[LocatedFlaw]:
    """Yield an error if an interval of a problem has too many operations."""
    model = problem.model
    symbols = [*problem.symbols().values(), model.time]
    rates = ca.Function("rates", symbols, [model.ode, problem.stage_cost])
    evaluations = INTEGRATORS[problem.integrator].evaluations
    steps = problem.substeps * problem.checks
    radau, points = problem.collocation, 0
    if radau is not None:
        # Collocation evaluates the rates once at each of its points.
        points = radau.points * (radau.elements or problem.substeps) * problem.checks
    found = rates.n_instructions() * max(evaluations * steps, points)
    if problem.integrator == "stiff" and found <= MOST_OPERATIONS:
        # Also those of linear equations.
        dt = float(problem.expected_times[-1]) / problem.intervals
        first = held_step(model, dt, method="stiff")
        found = int(first.n_instructions() / PARTS * (steps + PARTS - 1))
    if found > MOST_OPERATIONS:
        yield (
            ("prediction",),
            f"expected at most {MOST_OPERATIONS} operations in an interval, those of "
            f"the rates in all substeps of all checks; found {found}: take more "
            "intervals, or fewer checks, substeps or elements",
        )
