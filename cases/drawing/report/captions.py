"""Captions in words of the figures that kinds of scenario draw."""

from pathlib import PurePath

_UAVS = {
    "a_tracks": "Tracks in the plane: the whole flight above, its beginning to scale "
    "below. Triangles: the UAVs; ring: the leader.",
    "b_relative_speed": "Speed of each UAV less the leader's, over time.",
    "c_relative_heading": "Heading of each UAV less the leader's, over time.",
    "d_relative_x": "Distance of each UAV from its slot along x, over time.",
    "e_relative_y": "Distance of each UAV from its slot along y, over time.",
    "f_distances": "Smallest distance of two UAVs, and to an obstacle's edge, along "
    "the whole path and at the control instants; dashed: the limit.",
    "g_terminal_set": "How far each UAV is from the leader, as e'Pe; dashed: the level "
    "below which it is in the terminal set and the linear law may fly.",
    "h_entering": "The way of each UAV into the terminal set (grey), in pairs of "
    "states; dots: steps under the linear law.",
}
_WINGMAN = {
    "a_x": "How far the leader is ahead of the wingman, over time; dashed: the slot, "
    "shaded: settled.",
    "b_y": "How far the leader is to the right of the wingman, over time; dashed: the "
    "slot, shaded: settled.",
    "c_speed": "Speed of the wingman over time; dashed: the leader's.",
    "d_heading": "Heading of the wingman over time; dashed: the leader's.",
    "e_cost": "Cost J of each plan over time.",
    "f_drag_saving": "Drag saved in the leader's wake over time; dashed: what the slot "
    "saves.",
    "g_map": "Track of the wingman over the drag saved (colours), seen from above and "
    "from behind; both aircraft to scale, the wingman where it ended.",
}
_JOINT = {
    "a_trajectories": "Tracks in the plane: rings where they begin, arrowheads where "
    "they end; crosses: the slots around the leader at the end.",
    "b_evolution": "Cost J of the search's best point after each generation, a panel a "
    "horizon.",
    "c_cost": "Cost J of each horizon, and the largest distance from a slot at its "
    "end.",
    "d_bank": "Bank of each UAV, held over each step.",
    "e_thrust": "Thrust of each UAV, held over each step.",
    "f_distances": "Distances of all pairs of UAVs over time; dotted: the safe and the "
    "communication distance.",
}
_TRANSFER = {
    "a_trajectories": "Tracks in the plane: rings where they begin, arrowheads where "
    "they end; crosses: the goals.",
    "b_evolution": "Cost of the search's best point over generations; dashed: the cost "
    "of the plan.",
    "c_acceleration": "Acceleration of each UAV, held over each step.",
    "d_bank": "Bank of each UAV, held over each step.",
    "e_distances": "Distances of all pairs of UAVs over time; dotted: the safe "
    "distance.",
}
_PROBLEM = {
    "a_states": "States over time; dashed: their bounds.",
    "b_controls": "Controls over time; dashed: their bounds.",
    "c_slack": "How far each constraint is from its limit along the path; below 0 it "
    "is broken.",
    "d_cost": "Cost of the search's best point over evaluations, and of the plans.",
    "e_phase_plane": "One state over the other: the phase plane.",
    "f_plans": "The flown states over time, and the plans thin beneath them.",
    "g_step_time": "Wall time of each step; dashed: the length of a step.",
    "h_members": "States of the first plan for every member of the uncertain "
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
        >>> caption_of("problem", "a_states.png")
        'States over time; dashed: their bounds.'
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
