"""Formation flight behind a virtual leader (the chapter's section 5.2)."""

from swarmstart.cases.formation.build import build
from swarmstart.cases.formation.measures import MEASURES, measure
from swarmstart.cases.formation.scenario import FormationScenario
from swarmstart.cases.kind import Kind

KIND = Kind(
    scenario=FormationScenario,
    build=build,
    measure=measure,
    measures=MEASURES,
    problems=FormationScenario.problems,
    figures=lambda *a: [],
    animate=lambda *a: None,
)
