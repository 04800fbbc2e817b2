"""The kind of scenario "close_formation"."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.close_formation.measures import measure, whole_run
from swarmstart.cases.kinds.close_formation.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.close_formation.pose import flaws, pose
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario

KIND = Kind(
    scenario=CloseFormationScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.close_formation.figures:draw",
)
