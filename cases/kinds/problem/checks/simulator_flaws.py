"""Errors of a simulator that does not fit its scenario, found without loading it."""

from collections.abc import Iterator, Sequence

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import unknown
from swarmstart.cases.kinds.problem.stated.model import interval_of
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.simulators import (
    MOST_STEPS,
    JsbsimPart,
    SimulatorPart,
    steps_within,
)
from swarmstart.cases.kinds.problem.stated.symbols import constants_of, is_decided

AIRCRAFT_STATES = ("speed_m_s", "heading_rad", "height_m", "north_m", "east_m")
AIRCRAFT_CONTROLS = ("speed_m_s_set", "heading_rad_set", "height_m_set")


def simulator_flaws(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield errors of a simulator that does not fit the scenario."""
    part = scenario.simulator
    if part is None:
        return
    for name, state in scenario.states.items():
        if state.next is not None:
            yield (
                ("states", name, "next"),
                f"expected a rate with plant.{part.key}: measures know no changes at "
                "the end of an interval from it",
            )
    if is_decided(scenario.prediction.horizon_s):
        yield (
            ("prediction", "horizon_s"),
            f"expected a number with plant.{part.key}, whose steps have one length; "
            "found an end time that is decided",
        )
        return
    interval = interval_of(scenario, constants_of(scenario))
    if part.step_s is not None and not steps_within(part, interval):
        yield (
            ("plant", "step_s"),
            f"expected a whole number of steps in a control interval of {interval:g} "
            f"s, 1 to {MOST_STEPS:,}, found steps of {part.step_s:g} s",
        )
    yield from _of_names(scenario, part)


def _of_names(scenario: ProblemScenario, part: SimulatorPart) -> Iterator[LocatedFlaw]:
    """Yield errors of the names of a simulator's states and controls."""
    count = len(scenario.vehicles.members) if scenario.vehicles else 1
    for key, own, known in (
        ("states", scenario.states, AIRCRAFT_STATES),
        ("controls", scenario.controls, AIRCRAFT_CONTROLS),
    ):
        given = getattr(part, key, None)
        if isinstance(part, JsbsimPart):
            yield from _names(given or [*own], len(own), known, key)
        elif given is not None:
            yield from _names(given, len(own) * count, given, key)


def _names(
    given: Sequence[str], size: int, known: Sequence[str], key: str
) -> Iterator[LocatedFlaw]:
    """Yield errors of names of a simulator's variables."""
    if len(given) != size:
        yield ("plant", key), f"expected {size} names, found {len(given)}"
    for index, name in enumerate(given):
        place = ("plant", key, index)
        if name not in known:
            yield place, unknown(name, known, f"name of {key} of an aircraft")
        elif name in given[:index]:
            yield place, f"expected another name, found {name!r} again"
