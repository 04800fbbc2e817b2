"""Captions in words of the figures that kinds of scenario draw."""

from pathlib import PurePath

_PLANNING = (
    "(d) Wall time of each step against the control interval, and where the control of "
    "each step comes from."
)
_UAVS = {
    "a_sheet": "(a) Tracks to scale, with marks of time; ring: the leader. (b) Error "
    "of each UAV's place on a logarithmic axis; shaded: settled. (c) Controls; dotted: "
    f"their bounds. {_PLANNING} Of a single plan (d) shows its distances.",
    "b_relative": "Speed, heading and place of each UAV less those of the leader and "
    "of its slot, over time; yellow: settled, grey: the linear law.",
    "c_distances": "Smallest distance of two UAVs, and to an obstacle's edge, along "
    "the whole path and at the control instants; dotted: the limit.",
    "d_terminal_set": "Upper left: e'Pe of each UAV; dotted: the level below which the "
    "linear law may take over. Others: the way of each UAV into the terminal set "
    "(grey), in pairs of states; dots: steps under the linear law.",
}
_WINGMAN = {
    "a_sheet": "(a) Place of the leader seen from the wingman; dashed: the slot. (b) "
    "Distance from the slot on a logarithmic axis; shaded: settled. (c) Commands; "
    f"dotted: their bounds. {_PLANNING}",
    "b_motion": "Speed and heading of the wingman (dashed: the leader's), cost J of "
    "each plan, and the drag saved in the leader's wake (dashed: in the slot).",
    "c_map": "Track of the wingman over the drag saved (blue; red: lost), seen from "
    "above and from behind; both aircraft to scale, the wingman at its last place.",
}
_JOINT = {
    "a_sheet": "(a) Tracks to scale, with marks of time; crosses: the slots around the "
    "leader at the end. (b) Distance of each UAV from its slot on a logarithmic axis. "
    f"(c) Controls; dotted: their bounds. {_PLANNING}",
    "b_evolution": "Cost J of each horizon's plan, and of the search's best point "
    "after each generation, a panel a horizon.",
    "c_distances": "Distances of all pairs of UAVs over time, of many the smallest "
    "and the largest; dotted: the safe and the communication distance.",
}
_TRANSFER = {
    "a_sheet": "(a) Tracks to scale, with marks of time; crosses: the goals. (b) Cost "
    "of the search's best point; dashed: of the plan. (c) Controls; dotted: their "
    "bounds. (d) Distances of all pairs of UAVs; dotted: the safe distance.",
}
_PROBLEM = {
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
    "f_searches": "Cost of the best point of each plan's search over evaluations.",
    "g_members": "States of the first plan for every member of the uncertain "
    "parameters.",
}
CAPTIONS = {
    "formation_flight": _UAVS,
    "close_formation": _WINGMAN,
    "reconfiguration": _JOINT,
    "transfer": _TRANSFER,
    "problem": _PROBLEM,
    "python": _PROBLEM,
}


def caption_of(kind: str, file: str) -> str:
    """Return what a figure shows; of an unknown one its name in words.

    Args:
        kind: Of the scenario.
        file: Name of the figure's file.

    Example:
        >>> caption_of("problem", "b_states.png")
        'States over time; dotted: their bounds.'
        >>> caption_of("problem", "z_own_figure.png")
        'Own figure.'
    """
    stem = PurePath(file).stem
    known = CAPTIONS.get(kind, {}).get(stem)
    if known is not None:
        return known
    letter, _, rest = stem.partition("_")
    words = (rest if len(letter) == 1 and rest else stem).replace("_", " ")
    return words[:1].upper() + words[1:] + "."
