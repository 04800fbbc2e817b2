"""The kind of scenario "transfer"."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.transfer.measures import measure, whole_run
from swarmstart.cases.kinds.transfer.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.transfer.pose import flaws, pose
from swarmstart.cases.kinds.transfer.scenario import TransferScenario

KIND = Kind(
    scenario=TransferScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.transfer.figures:draw",
)
