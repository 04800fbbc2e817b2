"""Errors of vehicles with committed plans: keys, links, room, starts and goals."""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import Place
from swarmstart.cases.kinds.problem.stated.members import members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import (
    committed_distance,
    positions_of,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, Vehicles
from swarmstart.cases.kinds.problem.stated.symbols import constants_of, number


def committed_parts(scenario: ProblemScenario, part: Vehicles) -> Iterator[LocatedFlaw]:
    """Yield errors of committed plans; of any other `planning`, of keys for them."""
    place: Place = ("vehicles", "planning")
    if not part.is_committed:
        for key in ("links", "tracking_error"):
            # Settings of a record give each key, so what differs counts.
            default = Vehicles.model_fields[key].get_default(call_default_factory=True)
            if getattr(part, key) != default:
                found = f"expected planning: committed with it; found {part.planning}"
                yield ("vehicles", key), found
        return
    needed = {
        "vehicles.separation": part.separation is not None,
        "two vehicles": len(part.members) > 1,
        "dual_mode, in whose sets plans end,": scenario.dual_mode is not None,
    }
    missing = [what for what, is_there in needed.items() if not is_there]
    for what in missing:
        yield place, f"expected {what} with planning: committed; found none"
    yield from _of_agreement(scenario, part)


def _of_agreement(scenario: ProblemScenario, part: Vehicles) -> Iterator[LocatedFlaw]:
    """Yield errors of the links of committed plans, and of a time for a plan."""
    if scenario.feedback.within_s is not None:
        yield ("feedback", "within_s"), "expected null with planning: committed"
    for where, flaw in part.links.flaws():
        yield ("vehicles", *where), flaw
    late = [one.vehicle for one in part.links.silences]
    if max(late, default=0) >= len(part.members):
        yield (
            ("vehicles", "links", "silences"),
            f"expected vehicles 0 to {len(part.members) - 1}; found {max(late)}",
        )


def committed_numbers(scenario: ProblemScenario) -> Iterator[LocatedFlaw]:
    """Yield an error if committed plans leave no distance for errors of the plant."""
    vehicles, plant = scenario.vehicles, scenario.modelled
    if vehicles is None or not vehicles.is_committed:
        return
    error, place = (
        number(vehicles.tracking_error, constants_of(scenario)),
        ("vehicles", "tracking_error"),
    )
    if not 0 <= error < math.inf:
        yield place, f"expected at least 0, found {error:g}"
    elif not error and (scenario.simulator or plant.parameters or plant.disturbance):
        yield (
            place,
            "expected a number above 0 with a plant that differs from the model, "
            "found 0",
        )
    else:
        yield from _near_flaws(scenario, vehicles)


def _near_flaws(scenario: ProblemScenario, vehicles: Vehicles) -> Iterator[LocatedFlaw]:
    """Yield errors of starts, and of goals, nearer than committed plans may be."""
    members = members_of(scenario, shared_of(scenario))
    least = committed_distance(vehicles, constants_of(scenario))
    rows, at = [*positions_of(scenario)], getattr(scenario.dual_mode, "at", {})
    names = [[*scenario.states][row] for row in rows]
    places = {
        "starts": [one.start[rows] for one in members],
        "goals": [
            np.array([number(at[name], one.constants) for name in names])
            for one in members
        ],
    }
    for what, found in places.items():
        for (i, here), (j, there) in itertools.combinations(enumerate(found), 2):
            apart = float(np.linalg.norm(here - there))
            if apart < least:
                one, other = (vehicles.members[k].name for k in (i, j))
                where = ("vehicles", "members") if what == "starts" else ("dual_mode",)
                yield (
                    where,
                    f"expected {what} at least {least:g} apart; those of {one} and "
                    f"{other} are {apart:.4g} apart",
                )
