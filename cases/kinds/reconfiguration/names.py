"""Measures of a reconfiguration: name -> meaning, its unit in brackets at the end.

Imports nothing heavy, so that `swarmstart list` is quick. A count has no brackets; [-]
marks any other number without a unit, such as a share.
"""

from swarmstart.cases.format.registry import DRAWN_PLANNING, KindWords

MEASURES = {
    "position_error_m": "Largest distance of a UAV from its slot at the end, both "
    "relative to the leader [m]",
    "position_error_per_horizon_m": "List of the largest distance from a slot after "
    "each control step [m]",
    "cost_per_horizon": "List of the cost J of the plan of each step, summed over the "
    "UAVs if each plans on its own [-]",
    "cost_rises": "Number of steps whose cost J is above that of the step before",
    "candidate_losses": "Number of plans that cost more than the last plan shifted by "
    "one step, see (5.29); null if each UAV plans on its own",
    "gap_per_horizon": "List of the cost J of each plan minus the lowest cost found "
    "from the same state; null without a reference [-]",
    "gap_max": "Largest entry of gap_per_horizon; null without a reference [-]",
    "min_distance_m": "Smallest distance between two UAVs over the whole path flown "
    "[m]",
    "max_distance_m": "Largest distance between two UAVs over the whole path flown [m]",
    "max_link_distance_m": "Largest distance between two UAVs that must stay within "
    "the communication distance, over the whole path flown [m]",
    "penalty_max": "Largest summed violation of the limits by a plan; 0 if every plan "
    "keeps them [-]",
    "heading_error_rad": "Largest difference between a UAV's heading and the leader's "
    "at the end, with full turns counted [rad]",
    "speed_min_m_s": "Smallest speed of any UAV [m/s]",
    "speed_max_m_s": "Largest speed of any UAV [m/s]",
    "bank_max_rad": "Largest bank angle of any UAV, without its sign [rad]",
    "infeasible_steps": "Number of steps at which a plan was not feasible",
    "evaluations": "Number of trajectories that searches and polishes evaluated",
    "steps_starting_outside": "Number of steps whose plan starts outside the bounds of "
    "the states or the path constraints",
    "step_seconds_median": "Median wall time of planning one step for all UAVs [s]",
    "step_seconds_max": "Largest wall time of planning one step for all UAVs [s]",
}

UNDEFINED = {
    "candidate_losses": "each UAV plans on its own",
    "gap_per_horizon": "there is no reference",
    "gap_max": "there is no reference",
}
"""Reason why a measure can be null, by name of the measure."""

CAPTIONS = {
    "a_sheet": "(a) Tracks to scale, with marks of time; crosses: the slots around the "
    "leader at the end. (b) Distance of each UAV from its slot on a logarithmic axis. "
    f"(c) Controls; dotted: their bounds. {DRAWN_PLANNING}",
    "b_evolution": "Cost J of each horizon's plan, and of the search's best point "
    "after each generation, a panel a horizon.",
    "c_distances": "Distances of all pairs of UAVs over time, of many the smallest "
    "and the largest; dotted: the safe and the communication distance.",
}

WORDS = KindWords(
    kind="swarmstart.cases.kinds.reconfiguration.kind:KIND",
    title="UAVs that change the shape of their formation",
    measures=MEASURES,
    example="reconfiguration",
    flown_by="UAV",
    outcome="swarmstart.cases.kinds.reconfiguration.report:outcome",
    captions=CAPTIONS,
    numbered_rows=True,
    surroundings="swarmstart.cases.kinds.reconfiguration.report:surroundings",
)
