"""Words on runs that come too near to an obstacle or to each other.

A page begins with these words, so that a low cost hides no collision.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.wording import is_number, listed, shown

ROUNDING = 1e-6
"""Missing part of a distance [m] up to which it counts as kept."""
EXCESS = 1e-2
"""Excess over a constraint of a problem up to which a simulated path is feasible."""


def broken_words(measures: Mapping[str, Any], scenario: Mapping[str, Any]) -> list[str]:
    """Return sentences on limits that a run breaks; empty if it keeps them.

    Args:
        measures: Measures as in run.json.
        scenario: Scenario as recorded.

    Example:
        >>> broken_words({"obstacle_clearance_m": -15.0}, {})
        ['UAVs enter an obstacle by 15 m']
    """
    said = []
    clearance, near, excess = (
        float(measures[name]) if is_number(measures.get(name)) else None
        for name in ("obstacle_clearance_m", "min_distance_m", "constraint_excess")
    )
    if clearance is not None and clearance < -ROUNDING:
        said.append(f"UAVs enter an obstacle by {shown(-clearance, digits=3)} m")
    kept = kept_distance(scenario)
    if kept is not None and near is not None and near < kept - ROUNDING:
        said.append(
            f"UAVs come within {shown(near)} m of each other, but must keep "
            f"{shown(kept)} m"
        )
    if excess is not None and excess > EXCESS:
        said.append(f"the simulated path breaks constraints by up to {shown(excess)}")
    return [f"{words[0].upper()}{words[1:]}" for words in said]


def kept_distance(scenario: Mapping[str, Any]) -> float | None:
    """Return the distance that every two UAVs must keep [m]; None without a limit.

    Example:
        >>> kept_distance({"avoidance": {"safe_distance_m": 10}})
        10.0
    """
    # Each kind of scenario has its own place for it.
    for part, name in (
        (scenario.get("avoidance"), "safe_distance_m"),
        (scenario.get("distances"), "safe_m"),
        (scenario, "safe_distance_m"),
    ):
        value = part.get(name) if isinstance(part, Mapping) else None
        if is_number(value):
            return float(value)  # type: ignore[arg-type]
    return None


def broken_seeds(content: Mapping[str, Any]) -> list[str]:
    """Return sentences on the numbers of runs that failed or broke a limit, with seeds.

    Each run counts once: as failed, or else as inside an obstacle, or else as without a
    feasible plan at some steps, or else as not feasible.

    Args:
        content: Content of seeds.json.

    Raises:
        TypeError: If parts of the content are no lists.
    """
    seeds, measures = list(content["seeds"]), content["measures"]
    failures = list(content.get("failures") or ())
    clearance = list(measures.get("obstacle_clearance_m") or ())
    missing = list(measures.get("infeasible_steps") or ())
    feasible = list(content.get("feasible") or ())
    worst = min((value for value in clearance if is_number(value)), default=0.0)
    found = {
        "failed": [bool(failure) for failure in failures],
        f"entered an obstacle, by up to {shown(-worst, digits=3)} m": [
            is_number(value) and value < -ROUNDING for value in clearance
        ],
        "had steps without a feasible plan": [
            is_number(value) and value > 0 for value in missing
        ],
        "broke a constraint or had no feasible plan": [
            held is False for held in feasible
        ],
    }
    said, told = [], set[int]()
    for words, marks in found.items():
        # A damaged record may have more values than seeds.
        places = [k for k, marked in enumerate(marks[: len(seeds)]) if marked]
        places = [place for place in places if place not in told]
        told.update(places)
        if places:
            those = _seeds([str(seeds[place]) for place in places])
            said.append(f"{len(places)} of {len(seeds)} {words} ({those})")
    return said


def _seeds(numbers: Sequence[str]) -> str:
    return f"{'seed' if len(numbers) == 1 else 'seeds'} {listed(numbers)}"
