"""The kind of scenario "problem": a problem of the user's own."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.problem.flaws import flaws
from swarmstart.cases.kinds.problem.meanings import own_meanings
from swarmstart.cases.kinds.problem.measures import flown, measure, own_measures
from swarmstart.cases.kinds.problem.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.scenario import ProblemScenario

KIND = Kind(
    scenario=ProblemScenario,
    poses=pose,
    measure=measure,
    flown=flown,
    measures=MEASURES,
    own_measures=own_measures,
    own_meanings=own_meanings,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.problem.figures:draw",
)
