"""Rollouts: cost and violation of controls, and their path in finer steps.

The compiled evaluator of populations is `Fitness`. `status.py` has the statuses that an
answer gets from its path in finer integration steps, and the advice that goes with
them.
"""

from swarmstart.ocp.rollout.checking import (
    ConstraintRows,
)
from swarmstart.ocp.rollout.fitness import (
    NOTHING,
    Arguments,
    Known,
    Objective,
    at_nodes,
    core_known,
    from_near_start,
    replayed,
    shared_arguments,
)
from swarmstart.ocp.rollout.path import (
    signals_between,
)
from swarmstart.ocp.rollout.sampled import SampledValue
from swarmstart.ocp.rollout.shooting import (
    Shooting,
    shooting_of,
)

__all__ = [
    "NOTHING",
    "Arguments",
    "ConstraintRows",
    "Known",
    "Objective",
    "SampledValue",
    "Shooting",
    "at_nodes",
    "core_known",
    "from_near_start",
    "replayed",
    "shared_arguments",
    "shooting_of",
    "signals_between",
]
