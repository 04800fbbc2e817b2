"""Many instances of one problem: other initial states, parameters, signals.

`solve_many` reads and checks the data of all instances, solves them in lanes if it can
and by an NLP solver in processes, verifies every answer, tries failures again from
neighbours' answers, and returns arrays over all instances, `Solutions`.
"""

from swarmstart.ocp.instances.instance_data import (
    InstanceData,
    told_invalid,
    varied_names,
)
from swarmstart.ocp.instances.outcomes import (
    Answers,
)
from swarmstart.ocp.instances.solutions import (
    How,
    counted_near,
)

__all__ = [
    "Answers",
    "How",
    "InstanceData",
    "counted_near",
    "told_invalid",
    "varied_names",
]
