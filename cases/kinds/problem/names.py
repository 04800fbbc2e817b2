"""The measures of any problem, by name; imports nothing, for the list."""

END_TIME_MEASURE = "end_time"
"""Length of the first plan's horizon [s], where it is decided; other numbers that are
decided have measures called decided_NAME."""

MEMBERS_MEASURE = "member_costs"
"""Costs of the first plan for each member of uncertain parameters, a list."""

MEASURES = {
    "cost": "cost of the first plan, of all vehicles together",
    "violation": "summed violation of the first plan",
    "verified_cost": "the plan's, integrated ten times finer; null in closed loop",
    "confirmed": "1 if the finer integration confirms the plan; null in closed loop",
    "converged": "1 if IPOPT has converged at the first step, else 0",
    "search_cost": "cost of the search's own first answer; null without a search",
    "flown_cost": "cost of the simulated path; null if it is not finite",
    "constraint_excess": "largest excess of a path constraint or bound on that path",
    "terminal_excess": "largest excess of a terminal constraint at its end",
    "infeasible_steps": "steps at which planning found no feasible plan",
    "linear_steps": "steps under the linear law of a dual mode",
    "evaluations": "members evaluated by the search, and the objective by IPOPT",
    "steps_starting_outside": "steps from a state that breaks a constraint already",
    "step_seconds_median": "median wall time of planning a step [s]",
    "step_seconds_max": "longest wall time of planning a step [s]",
}

UNDEFINED = {
    "verified_cost": "plans are made anew at every step",
    "confirmed": "plans are made anew at every step",
    "search_cost": "there is no search",
    "flown_cost": "the costs are not finite on the path",
}
"""Why a measure is null, where it is."""
