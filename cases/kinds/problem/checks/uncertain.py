"""Uncertain parameters of a problem: one control sequence for several values.

The simulated system has the values of the scenario's `parameters`, replaced by those of
`plant.parameters`. Plans are made for all members of `uncertain` together.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Attempt, Place, quantity
from swarmstart.cases.kinds.problem.stated.scenario import (
    MOST_MEMBERS,
    ProblemScenario,
    Uncertain,
)
from swarmstart.cases.kinds.problem.stated.symbols import (
    constants_of,
    known_parameters,
    number,
)
from swarmstart.cases.kinds.problem.stated.values import Normal, OverTime, Uniform
from swarmstart.ocp import OptimalControlProblem, ensemble


def with_members(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> OptimalControlProblem:
    """Return the problem of planning for all members together.

    A member is a set of values of the uncertain parameters. Without uncertain
    parameters, the result is `problem` itself.

    Raises:
        InvalidProblemError: If the problem has a part that members cannot have.
    """
    part = scenario.uncertain
    if part is None:
        return problem
    constants = constants_of(scenario)
    weights = part.weights
    return ensemble(
        problem,
        member_values(part, constants),
        weights=None if weights is None else [number(w, constants) for w in weights],
        risk=part.risk,
        level=number(part.level, constants),
        robust_horizon=part.robust_horizon,
    )


def member_values(
    part: Uncertain, constants: Mapping[str, float]
) -> dict[str, list[float]]:
    """Return the values of each uncertain parameter, one for each member."""
    if part.values:
        return {
            name: [number(text, constants) for text in texts]
            for name, texts in part.values.items()
        }
    rng = np.random.default_rng(part.seed)
    drawn: dict[str, list[float]] = {name: [] for name in part.drawn}
    # Member after member: more samples leave the first ones as they are.
    for _ in range(part.samples or 0):
        for name, law in part.drawn.items():
            kind, pair = law.pair
            first, second = (number(text, constants) for text in pair)
            draw = rng.normal if kind == "normal" else rng.uniform
            drawn[name].append(float(draw(first, second)))
    return drawn


def planned_parameters(scenario: ProblemScenario) -> dict[str, OverTime]:
    """Return the parameters that plans know: neither decided nor uncertain."""
    part = scenario.uncertain
    uncertain = {*part.values, *part.drawn} if part else set()
    given = known_parameters(scenario).items()
    return {name: one for name, one in given if name not in uncertain}


def uncertain_names(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of unknown parameters, and of lists of different lengths."""
    part = scenario.uncertain
    if part is None:
        return
    known = known_parameters(scenario)
    for key, names in (("values", part.values), ("drawn", part.drawn)):
        for name in names:
            if name not in known:
                decided = " that is not decided" if name in scenario.parameters else ""
                listed = ", ".join(known) or "none"
                yield (
                    ("uncertain", key, name),
                    f"expected a parameter{decided}, found {name!r}; known: {listed}",
                )
    yield from _of_lengths(part)
    vehicles = scenario.vehicles
    if vehicles is not None and vehicles.planning != "joint":
        place: Place = ("vehicles", "planning")
        yield (
            place,
            f"expected planning: joint with uncertain; found {vehicles.planning}",
        )
    if scenario.instances is not None:
        yield ("instances",), "expected no instances with uncertain"
    if scenario.dual_mode is not None:
        what = "expected no dual mode with uncertain: its linear law is for one system"
        yield ("dual_mode",), what


def _of_lengths(part: Uncertain) -> Iterator[LocatedFlaw]:
    members = part.samples or len(next(iter(part.values.values()), []))
    lists: list[tuple[Place, Sequence[str] | None]] = [
        (("uncertain", "values", name), one) for name, one in part.values.items()
    ]
    for place, given in (*lists, (("uncertain", "weights"), part.weights)):
        # Also too many members, whose lists all have the right length.
        if given is not None and not len(given) == members <= MOST_MEMBERS:
            most = f", at most {MOST_MEMBERS}" if members > MOST_MEMBERS else ""
            yield (
                place,
                f"expected one number for each of {members} members{most}; "
                f"found {len(given)}",
            )
    if not members:
        yield ("uncertain", "values"), "expected at least one value, found none"


def _branches(scenario: ProblemScenario, part: Uncertain) -> Iterator[LocatedFlaw]:
    """Yield errors of a robust horizon that is too long or needs a closed loop."""
    shared, intervals = part.robust_horizon, scenario.prediction.intervals
    place: Place = ("uncertain", "robust_horizon")
    if shared is None:
        return
    if shared > intervals:
        yield place, f"expected at most {intervals}, the intervals; found {shared}"
    elif scenario.feedback.law == "open_loop" and shared < intervals:
        yield (
            place,
            "expected feedback: receding_horizon with a robust horizon, after which "
            "no control is that of all members; found open_loop",
        )


def uncertain_numbers(scenario: ProblemScenario) -> Iterator[Attempt]:
    """Yield an attempt for each number in the part `uncertain` of a scenario.

    The attempt is the number's place and a call that evaluates its expression.
    """
    part = scenario.uncertain
    if part is None:
        return
    fixed = constants_of(scenario)
    texts: dict[Place, Sequence[str]] = {
        ("values", name): one for name, one in part.values.items()
    }
    for name, law in part.drawn.items():
        kind, pair = law.pair
        texts["drawn", name, kind] = pair
    texts[("weights",)] = part.weights or []
    for inner, given in texts.items():
        for index, text in enumerate(given):
            yield quantity(("uncertain", *inner, index), text, fixed)
    yield quantity(("uncertain", "level"), part.level, fixed)


def uncertain_ranges(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of numbers that are out of range."""
    part = scenario.uncertain
    if part is None:
        return
    fixed = constants_of(scenario)
    level = number(part.level, fixed)
    if not 0 <= level < 1:
        found = f"expected a level of at least 0 and below 1, found {level:g}"
        yield ("uncertain", "level"), found
    yield from _branches(scenario, part)
    for index, text in enumerate(part.weights or []):
        if not number(text, fixed) > 0:
            place: Place = ("uncertain", "weights", index)
            yield place, f"expected a weight above 0, found {text}"
    for name, law in part.drawn.items():
        yield from law_flaws(("uncertain", "drawn", name), law, fixed)


def law_flaws(
    place: Place, law: Normal | Uniform, constants: Mapping[str, float]
) -> Iterator[LocatedFlaw]:
    """Yield errors of a distribution's numbers.

    Args:
        place: Place of the distribution.
        law: The distribution.
        constants: The constants of the file.
    """
    kind, pair = law.pair
    first, second = (number(text, constants) for text in pair)
    if kind == "normal" and not second > 0:
        found = f"expected a deviation above 0, found {second:g}"
        yield (*place, kind, 1), found
    elif kind == "uniform" and not first < second:
        found = f"expected lower < upper, found [{first:g}, {second:g}]"
        yield (*place, kind), found
