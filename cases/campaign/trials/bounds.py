"""Cells of `compare` for lower bounds: one for each scenario.

    {"settings", "variant", "seconds", "known"}  ->  value, kind, reason, sense, ...

and the effort and assumptions of the bound (`record.bound_content.bound_account`).
`known` is the best cost that the solvers have found. A known cost helps to improve the
bound, and a new bound is sought if `known` has changed.
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
from swarmstart.ocp.answer import bounded


def modules_of(job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return further modules whose code is used: of the kind and of certificates."""
    # Named as text in the record, so the imports do not lead there.
    certifying = CONTENT_OF.partition(":")[0]
    return (*modules_of_settings(job["settings"]), certifying)


def bound_cell(
    job: Mapping[str, Any], folder: Path, *, code_in: str | None = None
) -> dict[str, Any]:
    """Return a lower bound of a scenario's planning problem; called in a worker.

    Args:
        job: "settings" and "variant" of the scenario; "seconds": work for the bound, in
            units of about a second; "known": the best cost found, as the problem states
            it, or None.
        folder: Folder of the certificate.
        code_in: The folder whose files may be run; None if no file may be run.
    """
    resolved = resolved_again(job["settings"], job["variant"], code_in=code_in)
    one = first_problem(resolved.posed())
    bound = bounded(job["known"], one.problem, one.x0, one.known, work=job["seconds"])
    certificate = write_certificate(folder, bound)
    return {
        "value": bound.value,
        "kind": bound.kind.value,
        "reason": bound.reason,
        "sense": int(bound.sense),
        **bound_account(bound, certificate=certificate),
    }
