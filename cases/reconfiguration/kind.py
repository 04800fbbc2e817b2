"""Reconfiguration as the commands run it."""

from swarmstart.cases.kind import Kind
from swarmstart.cases.reconfiguration.build import build, pose, problems
from swarmstart.cases.reconfiguration.figures import draw
from swarmstart.cases.reconfiguration.measures import measure
from swarmstart.cases.reconfiguration.names import MEASURES, UNDEFINED
from swarmstart.cases.reconfiguration.scenario import ReconfigurationScenario

KIND = Kind(
    scenario=ReconfigurationScenario,
    build=build,
    pose=pose,
    measure=measure,
    measures=MEASURES,
    undefined=UNDEFINED,
    problems=problems,
    figures=draw,
)
