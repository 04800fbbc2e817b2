"""Close formation as the commands run it."""

from swarmstart.cases.close_formation.build import build, pose, problems
from swarmstart.cases.close_formation.figures import draw
from swarmstart.cases.close_formation.measures import measure
from swarmstart.cases.close_formation.names import MEASURES, UNDEFINED
from swarmstart.cases.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.kind import Kind

KIND = Kind(
    scenario=CloseFormationScenario,
    build=build,
    pose=pose,
    measure=measure,
    measures=MEASURES,
    undefined=UNDEFINED,
    problems=problems,
    figures=draw,
)
