from __future__ import annotations

import math
from typing import Any

import pydantic
import pytest

from swarmstart.cases.campaign.running.claims import (
    RELATIONS,
    assignments_of,
    claim_assignments,
    holds,
    judged,
    value_at,
    why_not,
)
from swarmstart.cases.format.kind import NEVER
from swarmstart.cases.format.settings import Claim

SETTINGS = {"search": {"name": "cpso", "size": 20}, "dual_mode": {"enabled": True}}


def claim(**changes: Any) -> Claim:
    whole = {
        **{"id": "1", "text": "It is small.", "source": "5.2", "measure": "size"},
        **{"relation": "<=", "bound": 2},
    }
    return Claim.model_validate(whole | changes)


@pytest.mark.parametrize(
    ("relation", "below", "equal", "above"),
    [
        ("<=", True, True, False),
        ("<", True, False, False),
        (">=", False, True, True),
        (">", False, False, True),
        ("==", False, True, False),
    ],
)
def test_a_relation_is_what_it_says(
    relation: str, below: bool, equal: bool, above: bool
) -> None:
    found = [holds(value, relation, 2.0) for value in (1, 2, 3.5)]
    assert found == [below, equal, above]


def test_width_is_allowed_on_both_sides_of_a_number() -> None:
    found = [holds(value, "==", 2.0, width=0.5) for value in (1.4, 1.5, 2.5, 2.6)]
    assert found == [False, True, True, False]
    assert holds(None, "==", 2.0, width=0.5) is None
    assert holds(None, "==", 2.0, width=0.5, reason=NEVER) is False
    near = claim(relation="==", width=0.5)
    (told,) = judged([near], SETTINGS, {"size": 2.5})
    assert told["holds"] is True and told["width"] == 0.5
    for refused in ({"relation": "<="}, {"relation": "==", "bound": None}):
        with pytest.raises(pydantic.ValidationError, match="expected width with"):
            claim(width=0.5, **refused)


def test_every_relation_can_be_claimed() -> None:
    for relation in RELATIONS:
        assert claim(relation=relation).relation == relation


def test_null_claims_that_a_measure_is_undefined() -> None:
    assert holds(None, "==", None) is True
    assert holds(3.0, "==", None) is False
    assert holds(None, "==", None, reason=NEVER) is True
    assert holds([1.0], "<=", 2.0) is None


def test_what_never_comes_is_later_than_any_bound() -> None:
    found = [holds(None, relation, 50, reason=NEVER) for relation in RELATIONS]
    assert found == [False, True, False, True, False]


@pytest.mark.parametrize("relation", RELATIONS)
def test_what_is_not_defined_judges_nothing(relation: str) -> None:
    assert holds(None, relation, 50) is holds(math.nan, relation, 50) is None
    asked = claim(relation=relation)
    (verdict,) = judged(
        [asked], SETTINGS, {"size": None}, undefined={"size": "there is none"}
    )
    assert (verdict["measured"], verdict["holds"]) == (None, None)
    assert verdict["needs"] == "a run in which size is a number; here there is none"


def test_null_is_compared_with_equal_only() -> None:
    with pytest.raises(pydantic.ValidationError, match="expected relation == with the"):
        claim(relation="<", bound=None)


def test_a_claim_about_a_variant_is_judged_in_it_alone() -> None:
    asked = claim(variant="literal")
    (other,) = judged([asked], SETTINGS, {"size": 1.5}, variant="corrected")
    (own,) = judged([asked], SETTINGS, {"size": 1.5}, variant="literal")
    assert (other["holds"], other["needs"]) == (None, "a run with variant = literal")
    assert (own["holds"], own["needs"]) == (True, "")


def test_a_claim_is_judged_by_what_was_measured() -> None:
    (fine,) = judged([claim()], SETTINGS, {"size": 1.5})
    (broken,) = judged([claim(gate=True)], SETTINGS, {"size": 2.5})
    assert fine["holds"] is True and fine["measured"] == 1.5
    assert broken["holds"] is False and broken["gate"] is True
    assert {"id", "text", "source", "relation", "bound"} <= fine.keys()


def test_a_claim_about_other_settings_is_not_judged_and_says_why() -> None:
    asked = claim(when={"search.name": "ga", "search.size": 20}, note="A note.")
    (verdict,) = judged([asked], SETTINGS, {"size": 1.5})
    assert (verdict["holds"], verdict["measured"]) == (None, None)
    assert verdict["needs"] == "a run with search.name = ga"
    assert why_not(claim(when={"dual_mode.enabled": True}), SETTINGS) == ""
    assert "search.reseed = none" in why_not(
        claim(when={"search.reseed": "none"}), SETTINGS
    )


def test_a_claim_against_another_run_is_not_judged_by_one() -> None:
    (verdict,) = judged([claim(against={"search.name": "ga"})], SETTINGS, {"size": 1})
    assert verdict["holds"] is None
    assert "a second run to compare with" in verdict["needs"]


def test_a_value_is_found_by_its_dotted_key() -> None:
    assert value_at(SETTINGS, "search.size") == 20
    assert value_at(SETTINGS, "search.size.more") is None
    assert value_at(SETTINGS, "nothing.here") is None


def test_a_search_by_name_is_set_before_its_other_settings() -> None:
    """`search={name: ...}` replaces what was set before it; others keep their order."""
    settings = {"b.x": 1.5, "search.size": 20, "search.name": "cpso", "a": "y"}
    assert assignments_of(settings) == (
        "search={name: cpso}", "b.x=1.5", "search.size=20", 'a="y"',
    )  # fmt: skip


def test_run_that_judges_a_claim_is_given_what_differs_and_a_whole_search() -> None:
    """The settings have a search of size 20."""
    name = value_at(SETTINGS, "search.name")
    for when, expected in (
        ({}, ()),
        ({"search.size": 20, "search.name": name}, ()),
        ({"search.size": 30}, ("search.size=30",)),
        ({"search.name": "ga", "a.b": 1}, ("search={name: ga}", "a.b=1")),
        # Another search has another default size, so that 20 is stated again.
        ({"search.size": 20, "search.name": "ga"}, ("search={name: ga}",
                                                    "search.size=20")),
    ):  # fmt: skip
        assert claim_assignments(claim(when=when), SETTINGS) == expected


def test_variant_is_the_first_of_what_a_run_would_need() -> None:
    asked = claim(variant="literal", when={"search.size": 30, "search.name": "ga"})
    assert why_not(asked, SETTINGS, "corrected") == (
        "a run with variant = literal, search.size = 30, search.name = ga"
    )
