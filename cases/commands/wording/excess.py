"""The time at which a simulated path breaks a constraint most."""

from dataclasses import replace

from swarmstart.cases.campaign.running.run import Run
from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import is_number
from swarmstart.ocp import Trajectory


def time_of_excess(finished: Run) -> str:
    """Return " between T1 and T2 s": the control interval of the largest excess.

    Found by halving the path: the largest excess of its first steps jumps to that of
    all of it in the interval sought. Empty if it is not found.
    """
    whole = finished.measures.get("constraint_excess")
    if not is_number(whole):
        return ""
    few, many = 0, len(finished.trajectory.decisions)
    while many - few > 1:
        middle = (few + many) // 2
        if _excess(finished, middle) >= float(whole):  # type: ignore[arg-type]
            many = middle
        else:
            few = middle
    times = finished.trajectory.times
    begin, end = quantity(float(times[few]), 4), quantity(float(times[many]), 4)
    return f" between {begin} and {end} s"


def _excess(finished: Run, steps: int) -> float:
    """Return the largest excess of the first steps."""
    kind, scenario = finished.resolved.kind, finished.resolved.scenario
    begun = _first(finished.trajectory, steps)
    measures = kind.measure(scenario, finished.flight, begun)
    value = measures.get("constraint_excess")
    return float(value) if isinstance(value, int | float) else float("inf")


def _first(trajectory: Trajectory, steps: int) -> Trajectory:
    """Return the first steps of a trajectory."""
    fine = steps * (trajectory.dense_times.size - 1) // len(trajectory.decisions)
    return replace(
        trajectory,
        times=trajectory.times[: steps + 1],
        states=trajectory.states[:, : steps + 1],
        controls=trajectory.controls[:, :steps],
        dense_times=trajectory.dense_times[: fine + 1],
        dense_states=trajectory.dense_states[:, : fine + 1],
        decisions=trajectory.decisions[:steps],
        step_seconds=trajectory.step_seconds[:steps],
    )
