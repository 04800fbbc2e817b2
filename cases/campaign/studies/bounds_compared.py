"""Lower bounds of the scenarios of a comparison: cells of their own, after all runs.

A bound does not count in the seconds of any solver, and is kept and resumed like a run.
It concerns one plan, so scenarios that are compared by whole runs have none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.studies.comparing import Contest
from swarmstart.ocp import BoundKind

LATE, MOMENT_S = 2.0, 120.0
"""Time limit of a bound: a factor of its seconds, and a constant [s]."""

CarriedOut = Callable[[Sequence[Cell]], Sequence[Outcome]]


def bounds_of(
    contests: Sequence[Contest],
    outcomes: Mapping[str, Outcome],
    seconds: float | None,
    carried_out: CarriedOut,
) -> dict[str, dict[str, Any]]:
    """Return the lower bound of each scenario that has one plan.

    Args:
        contests: The scenarios, whose solvers have run.
        outcomes: Outcomes of the solvers' cells, by their keys.
        seconds: Time for each bound [s]; None means that no bound is sought.
        carried_out: Function of cells that returns their outcomes in the same order.

    Returns:
        Bounds by scenario, as `About.bound`: of costs that are minimised.
    """
    if seconds is None:
        return {}
    cells = {
        contest.name: bound_cell_of(contest, outcomes, seconds)
        for contest in contests
        if contest.of == "plan"
    }
    found = carried_out([*cells.values()])
    return {name: _about(outcome) for name, outcome in zip(cells, found, strict=True)}


def bound_cell_of(
    contest: Contest, outcomes: Mapping[str, Outcome], seconds: float
) -> Cell:
    """Return the cell of a scenario's bound."""
    resolved = contest.resolved
    return Cell(
        work="swarmstart.cases.campaign.trials.bounds:bound_cell",
        job={
            "settings": resolved.anonymous_settings(),
            "variant": resolved.variant,
            "seconds": seconds,
            "known": _best(contest, outcomes),
        },
        label=f"{contest.name}, lower bound",
        timeout_s=LATE * seconds + MOMENT_S,
        permissions=resolved.permissions(),
    )


def _best(contest: Contest, outcomes: Mapping[str, Outcome]) -> float | None:
    """Return the best confirmed cost, as the problem states it; None without one."""
    found = [outcomes[cell.key].result for e in contest.entries for cell in e.cells]
    known = [one for one in found if one is not None and one.get("feasible")]
    costs = [one for one in known if one.get("verified_cost") is not None]
    best = min(costs, key=lambda one: float(one["verified_cost"]), default=None)
    return None if best is None else float(best["sense"] * best["verified_cost"])


def _about(outcome: Outcome) -> dict[str, Any]:
    """Return a bound as in `About`; that of a failed cell is the reason only."""
    result = outcome.result
    if result is None:
        none = {"kind": BoundKind.NONE.value, "value": None}
        return {**none, "reason": outcome.failure, "cell": outcome.folder.name}
    value = result["value"]
    is_finite = value is not None and math.isfinite(value)
    return {
        **{key: one for key, one in result.items() if key != "sense"},
        "value": float(result["sense"] * value) if is_finite else None,
        "cell": outcome.folder.name,
    }
