"""The kind of scenario "formation_flight"."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.formation_flight.measures import measure, whole_run
from swarmstart.cases.kinds.formation_flight.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.formation_flight.pose import flaws, pose
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario

KIND = Kind(
    scenario=FormationScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.formation_flight.figures:draw",
    animated_by="swarmstart.cases.kinds.formation_flight.figures",
)
