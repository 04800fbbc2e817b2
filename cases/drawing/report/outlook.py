"""Plans of a recorded run and their bounds, from the problem that its scenario poses.

A record keeps the controls of plans, and where each starts; their paths are simulated
again with the model of the planning problem. No code of a user's is run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.panels import Labels, stacked_limits
from swarmstart.cases.drawing.plan_figures import Flown, chosen
from swarmstart.cases.drawing.slack import arguments_of, made_at
from swarmstart.cases.format.kind import Posed
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.record.record import SCENARIO
from swarmstart.cases.record.results import Record
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Fitness, Known, Trajectory
from swarmstart.ocp.rollout import shooting_of

Paths = Sequence[tuple[float, Sequence[Array | None]]]

MOST_VEHICLES = 20
MOST_INTERVALS = 1000
"""Largest number of intervals of a flight whose plans are drawn."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Outlook:
    """Plans and bounds.

    Attributes:
        paths: Pairs of a time [s] at which plans were made, and for each vehicle the
            states of the planned path, shape (nx of a vehicle, n), or None if the
            vehicle did not plan then.
        states: Lower and upper bounds of the states; None if they are not known.
        controls: Lower and upper bounds of the controls; None if they are not known.
        notes: Sentences on missing plans or bounds.
    """

    paths: Paths = ()
    states: tuple[Array, Array] | None = None
    controls: tuple[Array, Array] | None = None
    notes: tuple[str, ...] = ()


def outlook_of(record: Record, flight: Trajectory) -> Outlook:
    """Return plans and bounds of a run, or a sentence in `notes` if there are none."""
    scenario: Mapping[str, Any] = record.scenario or {}
    if not record.arrays["plan_controls"].size:
        return Outlook()  # The kind has plans of its own.
    intervals = record.arrays["plan_controls"].shape[-1]
    if (scenario.get("prediction") or {}).get("intervals") != intervals or (
        intervals > MOST_INTERVALS
    ):
        note = f"Plans and bounds are drawn of at most {MOST_INTERVALS} intervals."
        return Outlook(notes=(note,))
    try:
        posed = _posed(record, scenario)
    except SwarmstartError as error:
        first = str(error).splitlines()[0]
        return Outlook(
            notes=(f"Plans and bounds are not drawn: {first[:200]}",),
        )
    problems = [agent.problem for agent in posed.agents]
    states, controls = stacked_limits(problems)
    vehicles = _vehicles(scenario, flight)
    if posed.nearby is not None or vehicles > MOST_VEHICLES:
        note = f"Plans are drawn of at most {MOST_VEHICLES} vehicles."
        return Outlook(states=states, controls=controls, notes=(note,))
    try:
        paths = _paths(posed, flight, vehicles)
    # The page is worth more than its plans. RuntimeError is CasADi's.
    except (SwarmstartError, ValueError, LookupError, RuntimeError) as error:
        note = f"Plans are not drawn: {type(error).__name__}: {str(error)[:160]}"
        return Outlook(states=states, controls=controls, notes=(note,))
    return Outlook(paths=paths, states=states, controls=controls)


def _posed(record: Record, scenario: Mapping[str, Any]) -> Posed:
    """Return what the recorded scenario poses; no terminal set is certified anew."""
    document = read_document(str(record.folder.resolve() / SCENARIO))
    quick = words_of(scenario["kind"]).for_pages
    return resolve(document, assignments=quick).posed()


def _vehicles(scenario: Mapping[str, Any], flight: Trajectory) -> int:
    members = (scenario.get("vehicles") or {}).get("members") or ()
    return len(scenario.get("uavs") or members) or 1


def _paths(posed: Posed, flight: Trajectory, vehicles: int) -> Paths:
    """Return the paths of the plans, by the instant at which they were made."""

    def known(step: int, number: int) -> Known:
        # The paths of others are in constraints alone, and do not move a vehicle.
        seen = posed.agents[number].unseen()
        return posed.known_by(number, float(flight.times[step]), seen)

    problems = posed.planned
    flown = Flown(
        problems=problems,
        trajectory=flight,
        labels=Labels(controls=()),
        known=known,
    )
    by_time: dict[float, list[Array | None]] = {}
    steps = chosen(flown.fresh)
    each = vehicles // len(problems)
    for number, (problem, own, own_known) in enumerate(flown.parts()):
        made, shooting = made_at(own), shooting_of(problem)
        # A few paths do not repay the compiling of machine code.
        fitness = Fitness(shooting, backend="casadi")
        for step in steps:
            if made[step] != step:
                continue  # At this step another vehicle planned.
            plan = own.decisions[step].plans[0]
            start, at = arguments_of(shooting.lowered, plan, own, int(step), own_known)
            states = shooting.lowered.as_stated(
                fitness.states(plan.controls, start, at)
            )
            states = states[: problem.model.nx]
            row = by_time.setdefault(float(flight.times[step]), [None] * vehicles)
            for place in range(each):
                row[number * each + place] = np.array_split(states, each)[place]
    return sorted(by_time.items(), key=lambda item: item[0])
