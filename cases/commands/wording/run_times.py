"""Rough run times of the shipped scenarios, for the list.

Measured once, one scenario after the other, with seed 0 and figures, after machine
code had been compiled: the CPU time on a machine that others used as well. They only
distinguish seconds from minutes.
"""

RUN_TIMES_S: dict[str, float] = {
    "batch_reactor": 3,
    "bifunctional_catalyst": 4,
    "brachistochrone": 3,
    "bryson_denham": 3,
    "catalyst_mixing": 3,
    "close_formation": 3,
    "close_formation_fast": 6,
    "close_formation_vortex": 3,
    "double_integrator": 3,
    "double_pendulum": 15,
    "formation_100": 27,
    "formation_obstacle": 5,
    "formation_obstacle_uav3": 4,
    "formation_v": 5,
    "four_discs": 4,
    "goddard_rocket": 4,
    "hypersensitive": 3,
    "lotka_volterra_fishing": 3,
    "lotka_volterra_whole": 3,
    "lynx_and_hares": 3,
    "passing_side": 4,
    "pendulum": 4,
    "pendulum_on_cart": 3,
    "race_car": 5,
    "reconfiguration": 3,
    "reconfiguration_reverse": 3,
    "shuttle_reentry": 10,
    "stirred_tank": 4,
    "supersonic_climb": 22,
    "swap_5": 4,
    "swap_8": 8,
    "two_drones": 5,
    "two_reaction_reactor": 3,
    "two_stage_launch": 4,
    "van_der_pol": 3,
}
"""Name of a scenario -> time of `swarmstart run` [s]."""

_STEPS_S = (1, 2, 5, 10, 20, 30)
_MINUTE_S = 60.0


def rough(seconds: float | None) -> str:
    """Return a run time as a round number; "?" if it was not measured.

    Example:
        >>> rough(0.7), rough(3.1), rough(26.0), rough(70.0), rough(None)
        ('1 s', '5 s', '30 s', '1 min', '?')
    """
    if seconds is None:
        return "?"
    for step in _STEPS_S:
        if seconds <= step:
            return f"{step} s"
    return f"{max(1, round(seconds / _MINUTE_S))} min"
