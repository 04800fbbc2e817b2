"""The measures of a transfer, by name; imports nothing, for the list."""

MEASURES = {
    "cost": "cost of the plan: the integral of the weighted squares of the controls",
    "violation": "summed violation of the plan",
    "verified_cost": "cost integrated ten times finer",
    "confirmed": "1 where the finer integration confirms the plan, else 0",
    "converged": "1 where IPOPT has converged, else 0",
    "search_cost": "cost of the search's own answer; null without a search",
    "search_violation": "violation of that answer; null without a search",
    "goal_error_m": "largest distance of a UAV from its goal at the end, as flown",
    "min_distance_m": "smallest distance of two UAVs over the whole path flown",
    "min_distance_checked_m": "the same at the plan's checks",
    "speed_min_m_s": "smallest speed of a UAV",
    "speed_max_m_s": "largest speed of a UAV",
    "evaluations": "members evaluated by the search, and the objective by IPOPT",
    "plan_seconds": "wall time of search and polish [s]",
}

UNDEFINED = {
    "search_cost": "there is no search",
    "search_violation": "there is no search",
    "goal_error_m": "the flight ends before the horizon",
    "min_distance_m": "there is one UAV",
    "min_distance_checked_m": "there is one UAV",
}
"""Why a measure is null, where it is."""
