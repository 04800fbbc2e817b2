"""A lower bound as a record holds it, and its certificate beside it.

The certificate is everything that the proof rests on:
`python -m swarmstart.ocp.lower_bound.check bound_certificate.json` proves it again.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.record.files import write_text
from swarmstart.cases.record.record import MARK, finished_key
from swarmstart.ocp import BoundKind, LowerBound, OptimalityGap, Solution

CERTIFICATE = "bound_certificate.json"
CONTENT_OF = "swarmstart.ocp.lower_bound.certificate:certificate_content"
"""What makes a certificate: named, since it is needed only if something was proven."""


def bound_content(bound: LowerBound, beside: OptimalityGap) -> dict[str, Any]:
    """Return a bound as JSON has it.

    Args:
        bound: The bound.
        beside: The same, with the answer.
    """
    return {**_compared(beside), **bound_account(bound)}


def bound_account(bound: LowerBound) -> dict[str, Any]:
    """Return what a bound took and rests on, as JSON has it."""
    return {
        "seconds": float(bound.cpu_seconds),
        "degree": int(bound.degree),
        "slack": float(bound.slack),
        "boxes": int(bound.boxes),
        "set": bound.set_name,
        "certificate": None if bound.evidence is None else CERTIFICATE,
    }


def _compared(beside: OptimalityGap) -> dict[str, Any]:
    return {
        "kind": beside.kind.value,
        "value": beside.value,
        "gap": beside.gap,
        "words": beside.words,
        "answer": beside.cost,
        "tolerance": beside.tolerance,
        "sense": int(beside.sense),
        "reason": beside.reason,
    }


def beside_of(content: Mapping[str, Any]) -> OptimalityGap:
    """Return a recorded bound beside the answer that was recorded with it.

    Raises:
        LookupError, TypeError, ValueError: If it is no such content.
    """
    value, cost = content["value"], content["answer"]
    return OptimalityGap(
        kind=BoundKind(content["kind"]),
        value=None if value is None else _number(value),
        reason=str(content["reason"]),
        sense=-1.0 if _number(content["sense"]) < 0 else 1.0,
        cost=None if cost is None else _number(cost),
        tolerance=_number(content["tolerance"]),
    )


def _number(value: Any) -> float:
    if isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"expected a finite number, found {value!r}")
    return float(value)


def kept_bound(folder: Path, key: str) -> dict[str, Any] | None:
    """Return the bound in the finished record of a run; None if there is none.

    A bound is of the problem, so that of the same run before still holds.
    """
    if finished_key(folder) != key:
        return None
    try:
        text = (folder / MARK).read_text(encoding="utf-8")
        content = json.loads(text)["bound"]
        beside_of(content)
    except (OSError, ValueError, LookupError, TypeError, OverflowError):
        return None
    return dict(content)


def compared_anew(content: Mapping[str, Any], answer: Solution) -> dict[str, Any]:
    """Return a recorded bound beside another answer to the same problem."""
    old = beside_of(content)
    same = LowerBound(
        kind=old.kind,
        value=math.nan if old.value is None else old.value,
        reason=old.reason,
        sense=old.sense,
    )
    return {**content, **_compared(answer.beside(same))}


def write_certificate(folder: Path, bound: LowerBound) -> None:
    """Write the certificate of a bound; one of an earlier bound goes.

    Args:
        folder: Where it is written; its own record names the file.
        bound: The bound.

    Raises:
        RecordError: If it cannot be written.
    """
    file = folder / CERTIFICATE
    if bound.evidence is None:
        file.unlink(missing_ok=True)
        return
    content = resolve_name(CONTENT_OF)(bound.evidence)
    write_text(file, json.dumps(content, indent=1) + "\n")
