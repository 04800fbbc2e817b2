"""A lower bound in a record, with the file of its certificate.

The certificate contains everything that the proof needs: `python -m
swarmstart.ocp.lower_bound.check bound_certificate.json` proves the bound again.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.record.files import write_text
from swarmstart.cases.record.record import MARK, finished_key
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import BoundKind, LowerBound, OptimalityGap, Solution
from swarmstart.ocp.lower_bound.stated import Evidence

CERTIFICATE = "bound_certificate.json"
CONTENT_OF = "swarmstart.ocp.lower_bound.certificate:certificate_content"
"""Function that makes a certificate: a name, since it is imported only if needed."""


def bound_content(
    bound: LowerBound, beside: OptimalityGap, *, certificate: str | None
) -> dict[str, Any]:
    """Return a bound as data for JSON.

    Args:
        bound: The bound.
        beside: Gap between the answer and the bound.
        certificate: Name of the certificate's file; None without a certificate.
    """
    account = bound_account(bound, certificate=certificate)
    return {**_compared(beside), **account}


def bound_account(bound: LowerBound, *, certificate: str | None) -> dict[str, Any]:
    """Return effort and assumptions of a bound, as data for JSON."""
    return {
        "seconds": float(bound.cpu_seconds),
        "degree": int(bound.degree),
        "slack": float(bound.slack),
        "boxes": int(bound.boxes),
        "set": bound.set_name,
        "certificate": certificate,
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
    """Return the gap between a recorded bound and the answer recorded with it.

    Raises:
        LookupError, TypeError, ValueError: If the content is not of this form.
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
    # JSON's true would count as 1, since bool is a subclass of int.
    if isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"expected a finite number, found {value!r}")
    return float(value)


def kept_bound(folder: Path, key: str) -> dict[str, Any] | None:
    """Return the bound in the finished record of a run; None if there is no such bound.

    A bound concerns the problem, so the bound of an earlier equal run still holds.
    """
    if finished_key(folder) != key:
        return None
    try:
        text = (folder / MARK).read_text(encoding="utf-8")
        content = json.loads(text)["bound"]
        beside_of(content)
    except (OSError, ValueError, LookupError, TypeError, OverflowError):
        # A damaged record has no bound to keep, and is written anew.
        return None
    return dict(content)


def compared_anew(content: Mapping[str, Any], answer: Solution) -> dict[str, Any]:
    """Return a recorded bound with its gap to another answer to the same problem."""
    old = beside_of(content)
    same = LowerBound(
        kind=old.kind,
        # A bound without a value has NaN in the library, and null in JSON.
        value=math.nan if old.value is None else old.value,
        reason=old.reason,
        sense=old.sense,
    )
    return {**content, **_compared(answer.beside(same))}


def write_certificate(folder: Path, bound: LowerBound) -> str | None:
    """Write the certificate of a bound; that of an earlier bound is removed.

    Returns:
        The file's name; None if nothing was proven by polynomials, or the problem has
        an operation that a certificate cannot express.

    Raises:
        RecordError: If the file cannot be written.
    """
    file = folder / CERTIFICATE
    content = None if bound.evidence is None else _certificate(bound.evidence)
    if content is None:
        # It would prove the bound of another run.
        file.unlink(missing_ok=True)
        return None
    write_text(file, json.dumps(content, allow_nan=False) + "\n")
    return CERTIFICATE


def _certificate(evidence: Evidence) -> Mapping[str, object] | None:
    try:
        return resolve_name(CONTENT_OF)(evidence)  # type: ignore[no-any-return]
    except (SwarmstartError, ValueError):
        # The problem has an operation that a certificate cannot express.
        return None
