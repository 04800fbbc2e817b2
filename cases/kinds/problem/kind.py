"""The kind of scenario "problem": a problem of the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

from swarmstart.cases.format.kind import FLIGHT_CERTIFICATE, Flight, Kind
from swarmstart.cases.kinds.problem.checks.flaws import flaws
from swarmstart.cases.kinds.problem.checks.instance_flaws import instances_of
from swarmstart.cases.kinds.problem.measuring.decided_measures import own_meanings
from swarmstart.cases.kinds.problem.measuring.measures import (
    measure,
    own_measures,
    whole_run,
)
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.stated.members import ProblemPosed
from swarmstart.cases.kinds.problem.stated.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:  # Few problems have committed plans.
    from swarmstart.ocp.swarm.committed_team import CommittedDecision


def documents(
    scenario: ProblemScenario, flight: Flight[ProblemPosed], trajectory: Trajectory
) -> Mapping[str, str]:
    """Return the certificate of the flight, if vehicles agree on committed plans."""
    del scenario
    if flight.posed.committed is None:
        return {}
    last = cast("CommittedDecision", trajectory.decisions[-1])
    return {FLIGHT_CERTIFICATE: last.vehicles.certificate()}


KIND = Kind(
    scenario=ProblemScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    own_measures=own_measures,
    own_meanings=own_meanings,
    undefined=UNDEFINED,
    instances=instances_of,
    code=lambda scenario: scenario.simulator.code if scenario.simulator else None,
    documents=documents,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.problem.figures:draw",
)
