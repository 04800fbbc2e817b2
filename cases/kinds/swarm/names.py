"""Measures of a swarm's flight: name -> meaning, its unit in brackets at the end.

Imports nothing heavy, so that `swarmstart list` is quick. A count has no brackets; [-]
marks any other number without a unit, such as a share.
"""

from swarmstart.cases.format.registry import KindWords

MEASURES = {
    "collisions": "Number of pairs of vehicles that come nearer than the distance on "
    "the simulated path",
    "obstacle_hits": "Number of vehicles that come nearer to an obstacle than half the "
    "distance",
    "min_distance_m": "Smallest distance between two vehicles on the simulated path, "
    "scaled; null with one vehicle [m]",
    "arrived_share": "Share of the vehicles that arrive and stay at their goals [-]",
    "arrival_time_s": "Time from which on all vehicles are at their goals; null if one "
    "does not arrive [s]",
    "mean_arrival_time_s": "Mean time of arrival of the vehicles that arrive; null if "
    "none does [s]",
    "path_ratio": "Median length of a path, by the straight way to the goal, of the "
    "vehicles that arrive; null if none does [-]",
    "acceleration_max_m_s2": "Largest acceleration of a vehicle along an axis [m/s^2]",
    "tracking_error_m": "Largest distance of a vehicle from its committed plan, at "
    "steps, scaled [m]",
    "plans_proposed": "Number of plans that were proposed",
    "plans_committed": "Number of plans that were committed to",
    "searches": "Number of searches for a plan",
    "vehicle_step_ms": "Mean wall time of planning, for a vehicle and step [ms]",
}

UNDEFINED = {
    "min_distance_m": "there is only one vehicle",
    "arrival_time_s": "never",
    "mean_arrival_time_s": "no vehicle arrives",
    "path_ratio": "no vehicle arrives",
}
"""Reason why a measure can be null, by name of the measure."""

CAPTIONS = {
    "a_sheet": "(a) Tracks from above; circles: starts, crosses: goals, grey: "
    "obstacles. (b) Distance of the two nearest plans over time; dashed: the least "
    "that is allowed. (c) Share of the vehicles that have arrived. (d) Plans that were "
    "proposed, and committed to, in each second.",
}

WORDS = KindWords(
    kind="swarmstart.cases.kinds.swarm.kind:KIND",
    title="Many vehicles with committed plans, which never collide",
    measures=MEASURES,
    example="swarm_20",
    outcome="swarmstart.cases.kinds.swarm.report:outcome",
    kept="swarmstart.cases.kinds.swarm.report:kept",
    captions=CAPTIONS,
    costs=("mean_arrival_time_s",),
    numbered_rows=True,
    called="vehicle",
    first_number=0,
    surroundings="swarmstart.cases.kinds.swarm.report:surroundings",
)
