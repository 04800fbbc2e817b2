"""The kind of scenario "formation_flight"."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.formation_flight.measures import flown, measure
from swarmstart.cases.kinds.formation_flight.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.formation_flight.pose import flaws, pose
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario

KIND = Kind(
    scenario=FormationScenario,
    poses=pose,
    measure=measure,
    flown=flown,
    measures=MEASURES,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.formation_flight.figures:draw",
    animated_by="swarmstart.cases.kinds.formation_flight.animation",
)
