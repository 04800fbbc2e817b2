"""Five lines in words on runs of one scenario over several seeds."""

import statistics
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.commands.wording.words import heading, method, picture
from swarmstart.cases.drawing.naming.quantities import (
    KEPT,
    duration,
    plural,
    quantity,
)
from swarmstart.cases.drawing.naming.wording import is_number


class Told(NamedTuple):
    """A measure that a sentence gives.

    Attributes:
        name: The measure.
        words: The beginning of the sentence.
        unit: Its unit; empty: none.
        undefined: The words for runs in which it is undefined; empty: none.
    """

    name: str
    words: str
    unit: str
    undefined: str = ""


OUTCOMES = (
    Told("settle_time_s", "Settled", "s", "not settled"),
    Told("x_settle_s", "Settled in x", "s", "not settled"),
    Told("position_error_m", "Largest distance from a slot at the end", "m"),
    Told("verified_cost", "Cost, integrated more finely", ""),
    Told("flown_cost", "Cost of the simulated path", ""),
    Told("closed_loop_cost", "Closed-loop cost", ""),
    Told("cost", "Cost of the first plan", ""),
)
"""Measures of the result: the first one that some run defines is used."""
CONSTRAINTS = (
    Told("min_distance_m", "closest distance of two UAVs", "m"),
    Told("min_range_ft", "closest distance of the two aircraft", "ft"),
    Told("obstacle_clearance_m", "clearance of obstacles", "m"),
)
"""Measures of what must be kept: the lowest and the median of each are told."""
EXCESS = Told("constraint_excess", "largest excess of a constraint along the path", "")
TIMES = ("step_seconds_median", "step_seconds_max", "plan_seconds")


def sentences_of_seeds(content: Mapping[str, Any], figures: Path) -> list[str]:
    """Return five lines on runs over seeds.

    Args:
        content: As seeds.json has it.
        figures: The folder of the figures.
    """
    measures = content["measures"]
    drawn = [figures / name for name in content["figures"]]
    return [
        _task(content),
        f"{_feasible(content)}. {_first_of(OUTCOMES, measures, 'No result')}.",
        f"{_kept(content)}.",
        _times(measures),
        picture(drawn),
    ]


def _task(content: Mapping[str, Any]) -> str:
    runs = len(content["seeds"])
    head = heading(content["title"], content["scenario"])
    how = method(content["search"], content["polish"], content["variant"])
    seeds = f"seeds 0 to {runs - 1}" if runs > 1 else "seed 0"
    return f"{head}: {plural(runs, 'run')}, {seeds}; {how}."


def _feasible(content: Mapping[str, Any]) -> str:
    runs = len(content["seeds"])
    return f"{sum(content['feasible'])} of {plural(runs, 'run')} found feasible plans"


def _kept(content: Mapping[str, Any]) -> str:
    """Return what had to be kept, and how well it was."""
    measures, broken = content["measures"], content["feasible"].count(False)
    excess = measures.get("constraint_excess", [])
    if excess and broken:
        ends = measures.get("terminal_excess", [])
        known = [float(value) for value in (*excess, *ends) if is_number(value)]
        most = f", by up to {quantity(max(known), 3)}" if known else ""
        return f"Constraints are broken in {plural(broken, 'run')}{most}"
    if excess and all(is_number(value) and value <= KEPT for value in excess):
        return "All constraints are kept along the simulated paths"
    told = _spread(EXCESS, excess) if any(map(is_number, excess)) else ""
    nearest = [_nearest(one, measures.get(one.name, [])) for one in CONSTRAINTS]
    said = "; ".join(filter(None, [*nearest, told]))
    return f"{said[:1].upper()}{said[1:]}" if said else "No constraints are measured"


def _nearest(told: Told, values: list[Any]) -> str:
    """Return the lowest value and the median of a distance; empty without a value."""
    known = [float(value) for value in values if is_number(value)]
    if not known:
        return ""
    low, middle = quantity(min(known), 4), quantity(statistics.median(known), 4)
    seed = values.index(min(known))
    return (
        f"{told.words}: lowest {low} {told.unit} (seed {seed}), "
        f"median {middle} {told.unit}"
    )


def _first_of(
    those: tuple[Told, ...], measures: Mapping[str, list[Any]], otherwise: str
) -> str:
    """Return the first measure that is defined in some run, in words."""
    for told in those:
        values = measures.get(told.name)
        if values is not None and (told.undefined or any(map(is_number, values))):
            return _spread(told, values)
    return otherwise


def _spread(told: Told, values: list[Any]) -> str:
    """Return median and range of a measure, and in how many runs it is defined."""
    known = [float(value) for value in values if is_number(value)]
    missing = len(values) - len(known)
    if not known:
        return f"{told.undefined.capitalize()} in any run"
    unit = f" {told.unit}" if told.unit else ""
    middle, low, high = statistics.median(known), min(known), max(known)
    said = f"{told.words}: median {quantity(middle)}{unit}"
    if low < high:
        said += f", from {quantity(low)} to {quantity(high)}{unit}"
    if told.undefined and missing:
        said += f"; {told.undefined} in {plural(missing, 'run')}"
    return said


def _times(measures: Mapping[str, list[Any]]) -> str:
    """Return the solver's time."""
    found = {
        name: [float(value) for value in measures.get(name, []) if is_number(value)]
        for name in TIMES
    }
    middle, most, plan = found.values()
    if plan:
        middle, most = plan, plan
    if not middle or not most:
        return "No times were measured."
    typical = duration(statistics.median(middle))
    return f"Time per step: median {typical}, worst of all runs {duration(max(most))}."
