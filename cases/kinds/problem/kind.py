"""The kind of scenario "problem": a problem of the user's own."""

from swarmstart.cases.format.kind import Kind
from swarmstart.cases.kinds.problem.checks.flaws import flaws
from swarmstart.cases.kinds.problem.checks.instance_flaws import instances_of
from swarmstart.cases.kinds.problem.measuring.decided_measures import own_meanings
from swarmstart.cases.kinds.problem.measuring.measures import (
    measure,
    own_measures,
    whole_run,
)
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.stated.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario

KIND = Kind(
    scenario=ProblemScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    own_measures=own_measures,
    own_meanings=own_meanings,
    undefined=UNDEFINED,
    instances=instances_of,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.problem.figures:draw",
)
