"""Rough run times of the shipped scenarios, for the list.

Measured once on two cores of a current machine, one scenario after the other, with
seed 0, figures included and machine code compiled before. They only tell seconds from
minutes.
"""

RUN_TIMES_S: dict[str, float] = {}
"""Name of a scenario -> wall time of `swarmstart run` [s]."""

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
