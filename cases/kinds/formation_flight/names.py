"""Measures of a formation flight: name -> meaning, its unit in brackets at the end.

Imports nothing heavy, so that `swarmstart list` is quick. A count has no brackets; [-]
marks any other number without a unit, such as a share.
"""

from swarmstart.cases.format.registry import DRAWN_PLANNING, KindWords

MEASURES = {
    "settle_time_s": "Time after which every UAV stays within 1 m of its slot in x and "
    "in y until the end; null if never [s]",
    "shape_time_s": "The same, within a tenth of the smallest distance of two slots; "
    "within 1 m with one UAV [s]",
    "tail_error_m": "Largest deviation of any UAV from its slot, in x or in y, during "
    "the last 10 s [m]",
    "tail_error_by_uav_m": "List of the same deviation for each UAV [m]",
    "lone_failure": "Number (name) of the only UAV that is more than 1 m from its slot "
    "during the last 10 s; 0 if there is none or more than one",
    "closed_loop_cost": "Sum over all steps and UAVs of the squared deviation e'e and "
    "the squared control u'u [-]",
    "plan_cost": "Cost J of the plan, if the run has one step and one UAV plans; else "
    "null [-]",
    "min_distance_m": "Smallest distance between two UAVs over the whole path flown; "
    "null with one UAV [m]",
    "min_distance_sampled_m": "Smallest distance between two UAVs at the control "
    "instants only; null with one UAV [m]",
    "obstacle_clearance_m": "Smallest distance to the edge of an obstacle over the "
    "whole path flown, negative inside; null without obstacles [m]",
    "obstacle_clearance_sampled_m": "Smallest distance to the edge of an obstacle at "
    "the control instants only; null without obstacles [m]",
    "speed_min_m_s": "Smallest speed of any UAV [m/s]",
    "speed_max_m_s": "Largest speed of any UAV [m/s]",
    "terminal_exits": "Number of steps under the linear law after which a UAV is "
    "outside its terminal set; null without such a step",
    "linear_steps": "Number of steps flown under the linear law",
    "lyapunov_ratio_max": "Largest ratio of e'Pe after a step under the linear law to "
    "e'Pe before it, while that is above 1e-12; null without such a step [-]",
    "held_spectral_radius": "Spectral radius of the loop closed by the linear law, its "
    "control held over a step; null without a terminal set [-]",
    "input_excess_ratio": "Largest |K e| over the terminal set divided by the bound of "
    "that control; null without a terminal set [-]",
    "terminal_level": "Level alpha of the terminal set e'Pe <= alpha; null without a "
    "terminal set [-]",
    "infeasible_steps": "Number of steps at which a UAV found no feasible plan",
    "evaluations": "Number of trajectories that searches and polishes evaluated",
    "steps_starting_outside": "Number of steps whose plan starts outside the bounds of "
    "the states or the path constraints",
    "step_seconds_median": "Median wall time of planning one step for all UAVs [s]",
    "step_seconds_max": "Largest wall time of planning one step for all UAVs [s]",
}

UNDEFINED = {
    "settle_time_s": "never",
    "shape_time_s": "never",
    "plan_cost": "there is more than one plan",
    "min_distance_m": "there is only one UAV",
    "min_distance_sampled_m": "there is only one UAV",
    "obstacle_clearance_m": "there is no obstacle",
    "obstacle_clearance_sampled_m": "there is no obstacle",
    "terminal_exits": "no step was under the linear law",
    "lyapunov_ratio_max": "no step was under the linear law",
    "held_spectral_radius": "there is no terminal set",
    "input_excess_ratio": "there is no terminal set",
    "terminal_level": "there is no terminal set",
}
"""Reason why a measure can be null, by name of the measure."""

CAPTIONS = {
    "a_sheet": "(a) Tracks to scale, with marks of time; ring: the leader. (b) Error "
    "of each UAV's place on a logarithmic axis; shaded: settled. (c) Controls; dotted: "
    f"their bounds. {DRAWN_PLANNING} Of a single plan (d) shows its distances.",
    "b_relative": "Speed, heading and place of each UAV less those of the leader and "
    "of its slot, over time; yellow: settled, grey: the linear law.",
    "c_distances": "Smallest distance of two UAVs, and to an obstacle's edge, along "
    "the whole path and at the control instants; dotted: the limit.",
    "d_terminal_set": "Upper left: e'Pe of each UAV; dotted: the level below which the "
    "linear law may take over. Others: the way of each UAV into the terminal set "
    "(grey), in pairs of states; dots: steps under the linear law.",
}

WORDS = KindWords(
    kind="swarmstart.cases.kinds.formation_flight.kind:KIND",
    title="UAVs that take their slots in a formation behind a leader",
    measures=MEASURES,
    templates={"formation_flight.yaml": ""},
    flown_by="UAV",
    outcome="swarmstart.cases.kinds.formation_flight.report:outcome",
    captions=CAPTIONS,
    costs=("plan_cost", "closed_loop_cost"),
    numbered_rows=True,
    surroundings="swarmstart.cases.kinds.formation_flight.report:surroundings",
    for_pages=("dual_mode.certify=false",),
)
