"""The kind of scenario "reconfiguration"."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.reconfiguration.measures import measure, whole_run
from swarmstart.cases.kinds.reconfiguration.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.reconfiguration.pose import flaws, pose
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario

KIND = Kind(
    scenario=ReconfigurationScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.reconfiguration.figures:draw",
)
