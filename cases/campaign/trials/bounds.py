"""Cells of `compare` for lower bounds: one a scenario, apart from every solver's.

    {"settings", "variant", "seconds", "known"}  ->  value, kind, reason, account

`known` is the best cost that the solvers have found: with it the bound is better, and
another one is sought where it has changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.engine.cell_keys import modules_of_settings
from swarmstart.cases.format.scenario import resolved_again
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.bound_content import (
    CONTENT_OF,
    bound_account,
    write_certificate,
)
from swarmstart.ocp.bounded import bounded


def modules_of(job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return further modules whose code a cell uses: its kind's, the certificate's."""
    certifying = CONTENT_OF.partition(":")[0]
    return (*modules_of_settings(job["settings"]), certifying)


def bound_cell(
    job: Mapping[str, Any], folder: Path, *, python_in: str | None = None
) -> dict[str, Any]:
    """Seek a lower bound of a scenario's planning problem; called in a worker.

    Args:
        job: "settings" and "variant" of the scenario, "seconds", and "known": the best
            cost found, as the problem states it, or None.
        folder: Where the certificate is kept.
        python_in: The folder whose files may be run; None: none may.
    """
    resolved = resolved_again(job["settings"], job["variant"], python_in=python_in)
    one = first_problem(resolved.posed())
    bound = bounded(
        job["known"], one.problem, one.x0, one.known, seconds=job["seconds"]
    )
    certificate = write_certificate(folder, bound)
    return {
        "value": bound.value,
        "kind": bound.kind.value,
        "reason": bound.reason,
        "sense": int(bound.sense),
        **bound_account(bound, certificate=certificate),
    }
