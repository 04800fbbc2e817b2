"""The measures of a close formation flight, by name; imports nothing, for the list."""

MEASURES = {
    "x_settle_s": "time after the leader's last change from which on x stays within "
    "1 ft of its slot until the end; null if never",
    "y_settle_s": "the same of y",
    "x_max_dev_ft": "largest x less its slot",
    "x_min_dev_ft": "smallest x less its slot",
    "y_max_dev_ft": "largest |y less its slot|",
    "y_min_dev_ft": "smallest y less its slot",
    "z_max_ft": "largest |z|",
    "x_rms_last_5s_ft": "root mean square of x less its slot over the last 5 s",
    "y_rms_last_5s_ft": "the same of y",
    "z_rms_last_5s_ft": "the same of z",
    "position_error_late_ft": "largest distance from the slot in the last 5 s",
    "speed_max_ft_s": "largest speed of the wingman",
    "heading_max_deg": "largest heading of the wingman less the leader's first",
    "turn_rate_max_deg_s": "largest turn rate of the wingman between two samples",
    "steady_altitude_command_ft": "mean height command of the last 5 s",
    "cost_max": "largest cost J of a plan",
    "cost_rises": "steps from the manoeuvre on whose J is above the last one by 1e-6",
    "cost_rises_early": "those within the first 10 s of the manoeuvre",
    "cost_rises_late": "those after that",
    "candidate_losses": "plans worse than the last command, held (5.29)",
    "drag_saving_percent": "mean drag saved by the vortex over all samples",
    "drag_saving_min_percent": "smallest drag saved",
    "drag_saving_ideal_percent": "drag saved in the slot of (5.20), y = pi b / 4",
    "drag_saving_best_percent": "largest drag saved at the leader's height",
    "drag_saving_shortfall_percent": "what the slot of (5.20) misses of the largest "
    "saving, in percent of that",
    "drag_saving_low_s": "time with less than 30 percent of drag saved",
    "min_range_ft": "smallest distance of the two aircraft over the whole path flown",
    "gap_relative_median": "median of (J - J*) / J* in the first 10 s of the "
    "manoeuvre; null without reference",
    "gap_absolute_median": "median of J - J* after that",
    "gap_absolute_p90": "its 90th percentile",
    "gap_min": "smallest (J - J*) / max(1, J*)",
    "evaluations": "trajectories evaluated by searches and polishes",
    "steps_starting_outside": "steps at which a plan starts outside the bounds of "
    "the states or the path constraints",
    "step_seconds_median": "median wall time of a decision [s]",
    "step_seconds_max": "largest wall time of a decision [s]",
}

UNDEFINED = {
    "x_settle_s": "never",
    "y_settle_s": "never",
    "gap_relative_median": "there is no reference then",
    "gap_absolute_median": "there is no reference then",
    "gap_absolute_p90": "there is no reference then",
    "gap_min": "there is no reference then",
}
"""Why a measure is null, where it is."""
