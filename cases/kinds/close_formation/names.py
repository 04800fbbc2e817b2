"""Measures of a close formation: name -> meaning, its unit in brackets at the end.

Imports nothing heavy, so that `swarmstart list` is quick. A count has no brackets; [-]
marks any other number without a unit, such as a share.
"""

from swarmstart.cases.format.registry import DRAWN_PLANNING, KindWords

MEASURES = {
    "x_settle_s": "Time from the leader's last change until x stays within 1 ft of the "
    "slot; null if never [s]",
    "y_settle_s": "Time from the leader's last change until y stays within 1 ft of the "
    "slot; null if never [s]",
    "x_max_dev_ft": "Largest deviation of x from the slot, with its sign [ft]",
    "x_min_dev_ft": "Smallest deviation of x from the slot, with its sign [ft]",
    "y_max_dev_ft": "Largest deviation of y from the slot, without its sign [ft]",
    "y_min_dev_ft": "Smallest deviation of y from the slot, with its sign [ft]",
    "z_max_ft": "Largest deviation of z from the slot, without its sign [ft]",
    "x_rms_last_5s_ft": "Root mean square deviation of x from the slot over the last "
    "5 s [ft]",
    "y_rms_last_5s_ft": "Root mean square deviation of y from the slot over the last "
    "5 s [ft]",
    "z_rms_last_5s_ft": "Root mean square deviation of z from the slot over the last "
    "5 s [ft]",
    "position_error_late_ft": "Largest distance from the slot during the last 5 s [ft]",
    "speed_max_ft_s": "Largest speed of the wingman [ft/s]",
    "heading_max_deg": "Largest heading of the wingman, counted from the leader's "
    "first heading [deg]",
    "turn_rate_max_deg_s": "Largest turn rate of the wingman, as the mean between two "
    "samples [deg/s]",
    "steady_altitude_command_ft": "Mean altitude command during the last 5 s [ft]",
    "cost_max": "Largest cost J of a plan [-]",
    "cost_rises": "Number of steps whose cost J is more than 1e-6 above that of the "
    "step before, both from the manoeuvre on",
    "cost_rises_early": "Number of these rises within the first 10 s of the manoeuvre",
    "cost_rises_late": "Number of these rises after the first 10 s of the manoeuvre",
    "candidate_losses": "Number of plans that cost more than the last plan shifted by "
    "one step, see (5.29)",
    "drag_saving_percent": "Mean drag saved in the leader's vortex, over all control "
    "instants [%]",
    "drag_saving_min_percent": "Smallest drag saved at a control instant [%]",
    "drag_saving_ideal_percent": "Drag saved in the slot of (5.20), y = pi b / 4 [%]",
    "drag_saving_best_percent": "Largest drag saving possible at the leader's height "
    "[%]",
    "drag_saving_shortfall_percent": "Part of the largest possible drag saving that "
    "the slot of (5.20) loses [%]",
    "drag_saving_low_s": "Total time with less than 30 percent of drag saved [s]",
    "min_range_ft": "Smallest distance between the two aircraft over the whole path "
    "flown [ft]",
    "gap_relative_median": "Median of (J - J*) / J* in the first 10 s of the "
    "manoeuvre, J* from the reference; null without a reference [-]",
    "gap_absolute_median": "Median of J - J* after the first 10 s of the manoeuvre; "
    "null without a reference [-]",
    "gap_absolute_p90": "90th percentile of J - J* after the first 10 s of the "
    "manoeuvre; null without a reference [-]",
    "gap_min": "Smallest (J - J*) / max(1, J*) of all steps; null without a reference "
    "[-]",
    "evaluations": "Number of trajectories that searches and polishes evaluated",
    "steps_starting_outside": "Number of steps whose plan starts outside the bounds of "
    "the states or the path constraints",
    "step_seconds_median": "Median wall time of planning one step [s]",
    "step_seconds_max": "Largest wall time of planning one step [s]",
}

UNDEFINED = {
    "x_settle_s": "never",
    "y_settle_s": "never",
    "gap_relative_median": "there is no reference, or no step in that time",
    "gap_absolute_median": "there is no reference, or no step in that time",
    "gap_absolute_p90": "there is no reference, or no step in that time",
    "gap_min": "there is no reference",
}
"""Reason why a measure can be null, by name of the measure."""

CAPTIONS = {
    "a_sheet": "(a) Place of the leader seen from the wingman; dashed: the slot. (b) "
    "Distance from the slot on a logarithmic axis; shaded: settled. (c) Commands; "
    f"dotted: their bounds. {DRAWN_PLANNING}",
    "b_motion": "Speed and heading of the wingman (dashed: the leader's), cost J of "
    "each plan, and the drag saved in the leader's wake (dashed: in the slot).",
    "c_map": "Track of the wingman over the drag saved (blue; red: lost), seen from "
    "above and from behind; both aircraft to scale, the wingman at its last place.",
}

WORDS = KindWords(
    kind="swarmstart.cases.kinds.close_formation.kind:KIND",
    title="a wingman in the vortex of its leader",
    measures=MEASURES,
    example="close_formation",
    flown_by="a wingman behind its leader",
    outcome="swarmstart.cases.kinds.close_formation.report:outcome",
    captions=CAPTIONS,
    costs=("cost_max",),
    vehicles=("wingman",),
    relative=True,
    surroundings="swarmstart.cases.kinds.close_formation.report:surroundings",
)
