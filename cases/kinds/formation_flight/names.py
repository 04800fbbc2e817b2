"""The measures of a formation flight, by name; imports nothing, for the list."""

MEASURES = {
    "settle_time_s": "first control instant after which max(|dx|, |dy|) <= 1 m for "
    "every UAV until the end; null if never",
    "tail_error_m": "largest max(|dx|, |dy|) over the UAVs in the last 10 s",
    "tail_error_by_uav_m": "the same for each UAV",
    "lone_failure": "number of the UAV that alone is off by more than 1 m in the last "
    "10 s; 0 if none or several are",
    "closed_loop_cost": "sum of e'e + u'u over steps and UAVs",
    "plan_cost": "J of the one plan of a flight of one step in which one UAV plans; "
    "null in any other",
    "min_distance_m": "smallest distance of two UAVs over the whole path flown",
    "min_distance_sampled_m": "the same at the control instants",
    "obstacle_clearance_m": "smallest distance to an obstacle's edge over the whole "
    "path flown, negative inside",
    "obstacle_clearance_sampled_m": "the same at the control instants",
    "speed_min_m_s": "smallest speed of a UAV",
    "speed_max_m_s": "largest speed of a UAV",
    "terminal_exits": "linear steps after which a UAV is outside its terminal set; "
    "null without a linear step",
    "linear_steps": "steps flown under the linear law",
    "lyapunov_ratio_max": "largest ratio of e'Pe after a linear step to before it, "
    "while above 1e-12; null without one",
    "held_spectral_radius": "spectral radius of the linear law, its input held",
    "input_excess_ratio": "largest |K e| over the terminal set, divided by its bound",
    "terminal_level": "alpha of the terminal set",
    "infeasible_steps": "steps at which some UAV found no feasible plan",
    "evaluations": "trajectories evaluated by searches and polishes",
    "steps_starting_outside": "steps at which a plan starts outside the bounds of "
    "the states or the path constraints",
    "step_seconds_median": "median wall time of a decision of all UAVs [s]",
    "step_seconds_max": "largest wall time of a decision of all UAVs [s]",
}

UNDEFINED = {
    "settle_time_s": "never",
    "plan_cost": "there are several plans",
    "min_distance_m": "there is one UAV",
    "min_distance_sampled_m": "there is one UAV",
    "obstacle_clearance_m": "there is no obstacle",
    "obstacle_clearance_sampled_m": "there is no obstacle",
    "terminal_exits": "never under the linear law",
    "lyapunov_ratio_max": "never under the linear law",
    "held_spectral_radius": "there is no terminal set",
    "input_excess_ratio": "there is no terminal set",
    "terminal_level": "there is no terminal set",
}
"""Why a measure is null, where it is."""
