"""Formation flight as the commands run it."""

from swarmstart.cases.formation.animation import animate, check_writer
from swarmstart.cases.formation.build import build, pose, problems
from swarmstart.cases.formation.figures import draw
from swarmstart.cases.formation.measures import measure
from swarmstart.cases.formation.names import MEASURES, UNDEFINED
from swarmstart.cases.formation.scenario import FormationScenario
from swarmstart.cases.kind import Kind

KIND = Kind(
    scenario=FormationScenario,
    build=build,
    pose=pose,
    measure=measure,
    measures=MEASURES,
    undefined=UNDEFINED,
    problems=problems,
    figures=draw,
    animate=animate,
    check_animation=check_writer,
)
