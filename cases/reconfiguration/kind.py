"""Reconfiguration as the commands run it."""

from swarmstart.cases.kind import Kind
from swarmstart.cases.reconfiguration.build import build, pose, problems
from swarmstart.cases.reconfiguration.figures import draw
from swarmstart.cases.reconfiguration.measures import measure
from swarmstart.cases.reconfiguration.names import MEASURES
from swarmstart.cases.reconfiguration.scenario import ReconfigurationScenario

KIND = Kind(
    scenario=ReconfigurationScenario,
    build=build,
    pose=pose,
    measure=measure,
    measures=MEASURES,
    problems=problems,
    figures=draw,
)
