"""The measures of a reconfiguration, by name; imports nothing, for the list."""

MEASURES = {
    "position_error_m": "largest distance of a UAV from its slot, both relative to the "
    "leader, at the end",
    "position_error_per_horizon_m": "the same after each control step, a list",
    "cost_per_horizon": "J of each plan, a list; summed over the UAVs where each plans "
    "alone",
    "cost_rises": "steps whose J is above that of the step before",
    "candidate_losses": "plans worse than the last plan, shifted, its end held (5.29); "
    "null where each UAV plans alone",
    "gap_per_horizon": "J less the best J found from the same state, a list; null "
    "without reference",
    "gap_max": "largest of these",
    "min_distance_m": "smallest distance of two UAVs over the whole path flown",
    "max_distance_m": "largest distance of two UAVs over the whole path flown",
    "max_link_distance_m": "largest distance of two UAVs that keep the communication "
    "distance, over the whole path flown",
    "penalty_max": "largest summed violation of a plan; 0: all limits kept",
    "heading_error_rad": "largest difference of a UAV's heading from the leader's, at "
    "the end; whole turns count",
    "speed_min_m_s": "smallest speed of a UAV",
    "speed_max_m_s": "largest speed of a UAV",
    "bank_max_rad": "largest bank",
    "infeasible_steps": "steps at which some plan was not feasible",
    "evaluations": "trajectories evaluated by searches and polishes",
    "steps_starting_outside": "steps at which a plan starts outside the bounds of "
    "the states or the path constraints",
    "step_seconds_median": "median wall time of a decision of all UAVs [s]",
    "step_seconds_max": "largest wall time of a decision of all UAVs [s]",
}

UNDEFINED = {
    "candidate_losses": "each UAV plans alone",
    "gap_per_horizon": "there is no reference",
    "gap_max": "there is no reference",
}
"""Why a measure is null, where it is."""
