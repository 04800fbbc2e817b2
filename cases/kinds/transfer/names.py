"""Measures of a transfer: name -> meaning, its unit in brackets at the end.

Imports nothing heavy, so that `swarmstart list` is quick. A count has no brackets; [-]
marks any other number without a unit, such as a share.
"""

from swarmstart.cases.format.registry import KindWords

MEASURES = {
    "cost": "Cost of the plan: the time integral of the weighted squares of the "
    "controls [-]",
    "violation": "Sum of the plan's constraint violations [-]",
    "verified_cost": "Cost of the plan, integrated ten times finer [-]",
    "confirmed": "1 if the finer integration confirms the plan, else 0",
    "converged": "1 if the polish converged, else 0",
    "search_cost": "Cost of the answer of the search, before the polish; null without "
    "a search [-]",
    "search_violation": "Sum of constraint violations of the answer of the search; "
    "null without a search [-]",
    "goal_error_m": "Largest distance of a UAV from its goal at the end of its path "
    "flown; null if the run ends before the horizon [m]",
    "min_distance_m": "Smallest distance between two UAVs over the whole path flown; "
    "null with one UAV [m]",
    "min_distance_checked_m": "Smallest distance between two UAVs at the points at "
    "which the plan is checked; null with one UAV [m]",
    "speed_min_m_s": "Smallest speed of any UAV [m/s]",
    "speed_max_m_s": "Largest speed of any UAV [m/s]",
    "evaluations": "Number of trajectories that the search evaluated, plus the "
    "evaluations of the objective by the polish",
    "plan_seconds": "Wall time of the search and the polish [s]",
}

UNDEFINED = {
    "search_cost": "there is no search",
    "search_violation": "there is no search",
    "goal_error_m": "the run ends before the horizon",
    "min_distance_m": "there is only one UAV",
    "min_distance_checked_m": "there is only one UAV",
}
"""Reason why a measure can be null, by name of the measure."""

CAPTIONS = {
    "a_sheet": "(a) Tracks to scale, with marks of time; crosses: the goals. (b) Cost "
    "of the search's best point; dashed: of the plan. (c) Controls; dotted: their "
    "bounds. (d) Distances of all pairs of UAVs; dotted: the safe distance.",
}

WORDS = KindWords(
    kind="swarmstart.cases.kinds.transfer.kind:KIND",
    title="UAVs that change places without a collision",
    measures=MEASURES,
    example="swap_5",
    flown_by="UAV",
    ending="swarmstart.cases.kinds.transfer.report:ending",
    captions=CAPTIONS,
    costs=("verified_cost", "cost"),
    numbered_rows=True,
    surroundings="swarmstart.cases.kinds.transfer.report:surroundings",
)
