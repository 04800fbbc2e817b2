"""Measures of any problem: name -> meaning, its unit in brackets at the end.

Imports nothing heavy, so that `swarmstart list` is quick. A count has no brackets;
[cost] is the unit of the scenario's cost, and [-] marks any other number without a
unit, such as a scaled violation.
"""

from swarmstart.cases.format.registry import KindWords

END_TIME_MEASURE = "end_time"
"""Measure of the length of the first plan's horizon, if the plan decides it [s]."""

MEMBERS_MEASURE = "member_costs"
"""Measure of the costs of the first plan, one for each member; a list."""

MEASURES = {
    "cost": "Cost of the first plan, of all vehicles together [cost]",
    "violation": "Sum of the constraint violations of the first plan [-]",
    "verified_cost": "Cost of the plan, integrated ten times finer; null in closed "
    "loop [cost]",
    "confirmed": "1 if the finer integration confirms the plan, else 0; null in closed "
    "loop",
    "converged": "1 if the polish converged at the first step, else 0",
    "search_cost": "Cost of the first answer of the search, before the polish; null "
    "without a search [cost]",
    "flown_cost": "Cost of the simulated path; null if it is not finite [cost]",
    "constraint_excess": "Largest excess over a path constraint or a bound on the "
    "simulated path [-]",
    "terminal_excess": "Largest excess over a terminal constraint at the end of the "
    "simulated path [-]",
    "infeasible_steps": "Number of steps at which no feasible plan was found",
    "stopped_steps": "Number of steps at which planning was stopped, since its time "
    "was over",
    "linear_steps": "Number of steps under the linear law of a dual mode",
    "evaluations": "Number of trajectories that searches evaluated, plus the "
    "evaluations of the objective by the polish",
    "steps_starting_outside": "Number of steps whose initial state breaks a constraint "
    "already",
    "step_seconds_median": "Median wall time of planning one step [s]",
    "step_seconds_max": "Largest wall time of planning one step [s]",
}

OF_CLOSED_LOOPS = (
    "infeasible_steps",
    "stopped_steps",
    "linear_steps",
    "steps_starting_outside",
    "step_seconds_median",
)
"""Measures that say nothing of a single plan."""

UNDEFINED = {
    "verified_cost": "the run is in closed loop",
    "confirmed": "the run is in closed loop",
    "search_cost": "there is no search",
    "flown_cost": "the cost is not finite on the simulated path",
}
"""Reason why a measure can be null, by name of the measure."""

CAPTIONS = {
    "a_sheet": "States and controls over time (dotted: their bounds); of a closed-loop "
    "run the cost of each plan, the wall time of each step and the source of its plan; "
    "of a single plan the convergence of the search and the local optima found, or the "
    "path in the plane.",
    "b_states": "States over time; dotted: their bounds.",
    "c_controls": "Controls over time; dotted: their bounds.",
    "d_slack": "How far each constraint is from its limit along the path; below 0 it "
    "is broken.",
    "e_phase_plane": "One state over the other: the phase plane.",
    "e_tracks": "Tracks to scale, with marks of time; thin: the plans.",
    "h_outputs": "Outputs of the model over time.",
    "i_signals": "Signals over time, as they are in the simulated system.",
    "f_searches": "Cost of the best point of each plan's search over evaluations; "
    "dashed: while it breaks limits.",
    "g_members": "States of the first plan for every member of the uncertain "
    "parameters.",
}

WORDS = KindWords(
    kind="swarmstart.cases.kinds.problem.kind:KIND",
    title="any system, written in YAML: one plan or a closed loop",
    measures=MEASURES,
    of_closed_loops=OF_CLOSED_LOOPS,
    templates={"problem.yaml": ""},
    captions=CAPTIONS,
    costs=("verified_cost", "flown_cost", "cost"),
)
