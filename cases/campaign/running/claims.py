"""Judgement of the published claims of a scenario by one run."""

import json
import math
import operator
from collections.abc import Mapping
from typing import Any

from swarmstart.cases.format.kind import NEVER, Measure
from swarmstart.cases.format.settings import Claim

RELATIONS = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
    "==": operator.eq,
}


def holds(
    measured: Measure,
    relation: str,
    bound: float | None,
    *,
    width: float = 0.0,
    reason: str = "",
) -> bool | None:
    """Return whether a measured value is in a relation to a bound.

    Args:
        measured: The value; None, or NaN, if it is not defined.
        relation: A key of RELATIONS.
        bound: The bound; None, with "==", asks whether the value is not defined.
        width: With "==", the largest difference from the bound that counts as equal.
        reason: Reason why the value can be undefined; if it is NEVER, an undefined
            value exceeds every bound.

    Returns:
        Whether the relation holds. None if that cannot be judged: the measure is a
        list, or it is not defined, `bound` is a number and `reason` is not NEVER.
    """
    if isinstance(measured, list):
        return None
    # In run.json NaN is null, and both are judged alike.
    if isinstance(measured, float) and math.isnan(measured):
        measured = None
    if bound is None:
        return measured is None
    if measured is None:
        if reason != NEVER:
            return None
        measured = math.inf
    if width:
        # A bool of Python: one of NumPy is not written to JSON.
        return bool(abs(measured - bound) <= width)
    return bool(RELATIONS[relation](measured, bound))


def judged(
    claims: list[Claim],
    settings: Mapping[str, Any],
    measures: Mapping[str, Measure],
    *,
    variant: str = "",
    undefined: Mapping[str, str] | None = None,
) -> list[dict[str, Any]]:
    """Return all claims, judged by one run.

    A claim that needs another variant, other settings, or a second run to compare with
    is not judged, and neither is a claim whose measure is not defined: then `measured`
    and `holds` are null, and `needs` gives the reason.

    Args:
        claims: The scenario's claims.
        settings: The resolved scenario.
        measures: Values of the measures, by name.
        variant: The variant that was run; empty if the scenario has no variants.
        undefined: Name of a measure -> reason why it can be undefined; None means that
            every measure is defined.
    """
    reasons = undefined or {}
    return [_judged(claim, settings, measures, variant, reasons) for claim in claims]


def why_not(claim: Claim, settings: Mapping[str, Any], variant: str = "") -> str:
    """Return why one run with these settings cannot judge a claim; empty if it can."""
    missing = [
        f"{key} = {wanted}"
        for key, wanted in claim.when.items()
        if value_at(settings, key) != wanted
    ]
    if claim.variant not in ("", variant):
        missing.insert(0, f"variant = {claim.variant}")
    if missing:
        return f"a run with {', '.join(missing)}"
    if claim.against is not None:
        other = ", ".join(f"{key} = {value}" for key, value in claim.against.items())
        return f"a second run to compare with: {other}"
    return ""


def value_at(settings: Any, dotted_key: str) -> object:
    """Return the value at a dotted key; None if it is missing."""
    for part in dotted_key.split("."):
        settings = settings.get(part) if isinstance(settings, Mapping) else None
    value: object = settings
    return value


def _judged(
    claim: Claim,
    settings: Mapping[str, Any],
    measures: Mapping[str, Measure],
    variant: str,
    undefined: Mapping[str, str],
) -> dict[str, Any]:
    reason = why_not(claim, settings, variant)
    measured, verdict = None, None
    if not reason:
        why = undefined.get(claim.measure, "")
        measured = measures[claim.measure]
        verdict = holds(
            measured, claim.relation, claim.bound, width=claim.width, reason=why
        )
        if verdict is None:
            reason = f"a run in which {claim.measure} is a number"
            reason += f"; here {why}" if why else ""
    return {
        **{name: getattr(claim, name) for name in ("id", "text", "source", "measure")},
        "measured": measured,
        **{name: getattr(claim, name) for name in ("relation", "bound", "width")},
        "holds": verdict,
        "gate": claim.gate,
        "note": claim.note,
        "needs": reason,
    }


def assignments_of(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return dotted settings as texts for `--set`.

    The name of a search comes first, since it replaces all settings of the search.
    """
    # `search={name: ...}` replaces all settings of the search, so it comes first.
    ordered = sorted(settings.items(), key=lambda item: item[0] != "search.name")
    return tuple(
        f"search={{name: {value}}}"
        if key == "search.name"
        else f"{key}={json.dumps(value)}"
        for key, value in ordered
    )


def claim_assignments(claim: Claim, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the settings with which a run can judge a claim."""
    wanted = {k: v for k, v in claim.when.items() if value_at(settings, k) != v}
    if "search.name" in wanted:  # The defaults of the search, then the other settings.
        wanted = {
            k: v for k, v in claim.when.items() if k.startswith("search.")
        } | wanted
    return assignments_of(wanted)
