"""Transfer as the commands run it."""

from swarmstart.cases.kind import Kind
from swarmstart.cases.transfer.build import build, pose, problems
from swarmstart.cases.transfer.figures import draw
from swarmstart.cases.transfer.measures import measure
from swarmstart.cases.transfer.names import MEASURES, UNDEFINED
from swarmstart.cases.transfer.scenario import TransferScenario

KIND = Kind(
    scenario=TransferScenario,
    build=build,
    pose=pose,
    measure=measure,
    measures=MEASURES,
    undefined=UNDEFINED,
    problems=problems,
    figures=draw,
)
