"""Lines in words on a finished run: what `swarmstart run` prints first.

The lines tell what was run, the result, whether constraints are kept, the time that it
took, and where the figures are. A broken constraint comes before the result.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.commands.wording.outcomes import (
    breaks_constraint,
    collisions,
    kept_constraints,
    outcome,
)
from swarmstart.cases.drawing.wording import duration, quantity
from swarmstart.cases.format.document import counted, printable
from swarmstart.cases.format.registry import SOLVE, words_of
from swarmstart.ocp.common import Paragraph

SHEET = "a_sheet"
"""Stem of the figure that shows a run on one sheet."""
LONGEST_TITLE = 100
_POLISHES = {"none": "no polish", "ipopt": "polish IPOPT"}


def sentences(finished: Run) -> list[str]:
    """Return some five lines on a finished run, and one more for each collision.

    Reason and advice for the status of a single plan have lines of their own. After
    them come the addresses of the docs that explain a result with problems.

    Collisions of a flight, and broken constraints of another closed loop, come before
    the result.
    """
    ended = finished.ended
    why = [
        f"{role}: {printable(text)}."
        for role, text in (("Reason", ended.reason), ("Advice", ended.advice))
        if text
    ]
    said = [*filter(None, (outcome(finished), *why, kept_constraints(finished)))]
    broken = collisions(finished)
    if not broken and breaks_constraint(finished):
        # The constraints first, since they are broken.
        said.reverse()
    return [
        _task(finished),
        *broken,
        *said,
        *_more(finished),
        _times(finished),
        picture(finished.figures),
    ]


def _more(finished: Run) -> list[str]:
    """Return the addresses of what explains a result that is not plainly good."""
    explained = [*finished.ended.paragraphs]
    if collisions(finished) or breaks_constraint(finished):
        explained.append(Paragraph.BROKEN_RUN)
    return [f"More: {', '.join(map(str, explained))}"] if explained else []


def heading(title: str, name: str) -> str:
    """Return the title of a scenario and its name in brackets."""
    shown = printable(title or name)
    if len(shown) > LONGEST_TITLE:
        shown = shown[:LONGEST_TITLE] + "..."
    return f"{shown} ({printable(name)})"


def method(search: str, lanes: int, polish: str, variant: str) -> str:
    """Return in words how `solve` makes plans; comparisons use the same words."""
    parts = ["no search" if search == "none" else f"search {search}"]
    if lanes:
        parts.append(f"{counted(lanes, 'random start')} in lanes")
    parts.append(_POLISHES.get(polish, f"polish {polish}"))
    if variant:
        parts.append(f"variant {printable(variant)}")
    return f"by {SOLVE}: {', '.join(parts)}"


def _task(finished: Run) -> str:
    """Return what was run, with which solver and seed."""
    resolved, settings = finished.resolved, finished.resolved.settings
    head = heading(resolved.scenario.title, resolved.scenario.name)
    scenario, search = resolved.scenario, settings.get("search", {})
    lanes = scenario.random_starts()
    is_left_out = lanes and search.get("when") == "undecided"
    how = scenario.way() or method(
        scenario.search_name + (" if starts disagree" if is_left_out else ""),
        lanes,
        scenario.polish_name,
        resolved.variant,
    )
    return f"{head}: {_what(finished)}; {how}, seed {finished.seed}."


def _what(finished: Run) -> str:
    """Return what was solved or simulated, and for how long."""
    flight, trajectory = finished.flight, finished.trajectory
    steps, end = len(trajectory.decisions), float(trajectory.times[-1])
    length = f"{quantity(end)} s"
    if words_of(finished.resolved.scenario.kind).flown_by:
        return f"flight of {_aircraft(finished)} for {length}, {_plans(finished)}"
    if flight.posed.open_loop:
        intervals = counted(flight.posed.agents[0].problem.intervals, "interval")
        return f"one plan of {length} in {intervals}"
    count = _vehicles(finished)
    who = "" if count == 1 else f"{counted(count, 'vehicle')} in "
    return f"{who}closed loop for {length} in {counted(steps, 'step')}"


def _vehicles(finished: Run) -> int:
    """Return the number of vehicles, whether one plan is made for all or several."""
    # One problem of several vehicles has one agent that plans for all of them.
    vehicles: Any = getattr(finished.resolved.scenario, "vehicles", None)
    return finished.flight.posed.vehicles if vehicles is None else len(vehicles.members)


def _aircraft(finished: Run) -> str:
    """Return which aircraft take part."""
    flown_by = words_of(finished.resolved.scenario.kind).flown_by
    # A phrase names the aircraft itself; one word is counted.
    if " " in flown_by:
        return flown_by
    uavs = getattr(finished.resolved.scenario, "uavs", ())
    return counted(len(uavs) or finished.flight.agents, flown_by)


def _plans(finished: Run) -> str:
    """Return how often plans are made in a flight."""
    steps = len(finished.trajectory.decisions)
    if finished.flight.posed.open_loop or steps == 1:
        return "one plan"
    return f"a new plan every {quantity(finished.flight.controller.dt)} s"


def _times(finished: Run) -> str:
    """Return how long the solver took, and whether that is fast enough."""
    seconds = np.asarray(finished.trajectory.step_seconds)
    if finished.flight.posed.open_loop or seconds.size == 1:
        starts = finished.starts
        by = "" if starts is None else f"; the answer comes from {starts.origin}"
        return f"Solved in {duration(float(np.nansum(seconds)))}{by}."
    lengths = np.diff(finished.trajectory.times)
    late = int((seconds > lengths).sum())
    middle, most = float(np.median(seconds)), float(seconds.max())
    whose = "" if finished.flight.posed.controller is None else " of all vehicles"
    said = (
        f"Time per step{whose}: median {duration(middle)}, worst {duration(most)}; a "
        f"step lasts {duration(float(np.median(lengths)))}"
    )
    if whose:
        return f"{said}."
    if not late:
        return f"{said}, so every plan is ready in time."
    return f"{said}, so {late} of {counted(seconds.size, 'step')} took too long."


def picture(figures: Sequence[Path]) -> str:
    """Return a line with the path of the main figure, and the number of the others."""
    if not figures:
        return "No figures were drawn."
    first = next((file for file in figures if file.stem == SHEET), figures[0])
    more = len(figures) - 1
    beside = f" ({counted(more, 'more figure')} beside it)" if more else ""
    return f"Picture: {first}{beside}"


def extras(finished: Run) -> list[str]:
    """Return lines on features that only some runs have: a continuation, a bound."""
    lines = []
    if finished.resumed:
        lines.append(
            f"Continued after step {finished.resumed}, where an earlier run stopped."
        )
    bound: Any = finished.bound_content
    if bound is not None:
        lines.append(f"Bound: {printable(bound['words'])}")
    return lines
