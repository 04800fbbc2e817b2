"""What a run says of the published claims of its scenario."""

import json
import operator
from collections.abc import Mapping
from typing import Any

from swarmstart.cases.kind import Measure
from swarmstart.cases.settings import Claim

RELATIONS = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
    "==": operator.eq,
}


def holds(measured: Measure, relation: str, bound: float | None) -> bool | None:
    """Return whether a measured value is in a relation to a bound.

    Args:
        measured: The value; null where it is not defined (never settled).
        relation: A key of RELATIONS.
        bound: The bound; null asks whether the value is not defined.

    Returns:
        None where the measure is a list, which is in no relation to a number.
    """
    if isinstance(measured, list):
        return None
    if bound is None or measured is None:
        return (measured is bound) if relation == "==" else False
    return bool(RELATIONS[relation](measured, bound))


def judged(
    claims: list[Claim], settings: Mapping[str, Any], measures: Mapping[str, Measure]
) -> list[dict[str, Any]]:
    """Return every claim with what one run says of it.

    A claim that needs other settings, or a second run to compare with, is not judged:
    `measured` and `holds` are null and `needs` says why.

    Args:
        claims: The scenario's claims.
        settings: The resolved scenario.
        measures: What was measured.
    """
    return [_judged(claim, settings, measures) for claim in claims]


def why_not(claim: Claim, settings: Mapping[str, Any]) -> str:
    """Return why one run with these settings cannot judge a claim; empty if it can."""
    missing = [
        f"{key} = {wanted}"
        for key, wanted in claim.when.items()
        if value_at(settings, key) != wanted
    ]
    if missing:
        return f"a run with {', '.join(missing)}"
    if claim.against is not None:
        other = ", ".join(f"{key} = {value}" for key, value in claim.against.items())
        return f"a second run to compare with: {other}"
    return ""


def value_at(settings: Any, dotted_key: str) -> object:
    """Return the value at a dotted key; None where there is none."""
    for part in dotted_key.split("."):
        settings = settings.get(part) if isinstance(settings, Mapping) else None
    value: object = settings
    return value


def _judged(
    claim: Claim, settings: Mapping[str, Any], measures: Mapping[str, Measure]
) -> dict[str, Any]:
    reason = why_not(claim, settings)
    measured = None if reason else measures[claim.measure]
    return {
        "id": claim.id,
        "text": claim.text,
        "source": claim.source,
        "measure": claim.measure,
        "measured": measured,
        "relation": claim.relation,
        "bound": claim.bound,
        "holds": None if reason else holds(measured, claim.relation, claim.bound),
        "gate": claim.gate,
        "note": claim.note,
        "needs": reason,
    }


def assignments_of(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return dotted settings as `--set` takes them; a search by name comes first."""
    ordered = sorted(settings.items(), key=lambda item: item[0] != "search.name")
    return tuple(
        f"search={{name: {value}}}"
        if key == "search.name"
        else f"{key}={json.dumps(value)}"
        for key, value in ordered
    )


def claim_assignments(claim: Claim, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what must be set for a run to judge a claim."""
    wanted = {k: v for k, v in claim.when.items() if value_at(settings, k) != v}
    if "search.name" in wanted:  # Its own defaults, then whatever else is asked for.
        wanted = {
            k: v for k, v in claim.when.items() if k.startswith("search.")
        } | wanted
    return assignments_of(wanted)
