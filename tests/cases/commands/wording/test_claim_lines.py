"""Claims in short: how many hold, and each that does not."""

from __future__ import annotations

from typing import Any

from swarmstart.cases.commands.actions.run import (
    SHOWN,
    claim_table,
    short_claims,
)


def claim(number: int, *, holds: bool | None, needs: str = "") -> dict[str, Any]:
    return {
        "id": str(number),
        "text": f"text {number}",
        "holds": holds,
        "measure": "cost",
        "measured": 2.0,
        "relation": "<=",
        "bound": 1.0,
        "needs": needs,
    }


def test_claims_are_counted_and_those_that_do_not_hold_are_shown() -> None:
    claims = [claim(1, holds=True), claim(2, holds=False), claim(3, holds=True)]
    head, wrong = short_claims(claims)
    assert head == "Claims: 2 hold, 1 does not hold."
    assert wrong == "  2  does not hold  cost = 2 <= 1  text 2"
    assert short_claims([]) == []
    assert short_claims(claims[:1]) == ["Claims: 1 holds."]


def test_what_claims_need_that_are_not_judged_is_said() -> None:
    some = [claim(n, holds=None, needs="a run with steps = 60") for n in range(2)]
    assert short_claims(some) == [
        "Claims: 2 not judged (needs a run with steps = 60).",
    ]
    other = claim(9, holds=None, needs="a second run")
    assert short_claims([*some, other]) == [
        "Claims: 3 not judged (2 of them: needs a run with steps = 60; --measures "
        "shows all)."
    ]


def test_needs_that_most_do_not_share_are_not_listed() -> None:
    several = [claim(n, holds=None, needs=f"run {n}") for n in range(2)]
    assert short_claims(several) == [
        "Claims: 2 not judged (--measures shows what they need)."
    ]


def test_many_claims_that_do_not_hold_are_counted() -> None:
    lines = short_claims([claim(n, holds=False) for n in range(SHOWN + 3)])
    assert lines[-1] == "  and 3 more, see --measures" and len(lines) == SHOWN + 2


def test_the_table_has_all_of_them() -> None:
    lines = claim_table([claim(1, holds=True), claim(2, holds=None, needs="more")])
    assert lines == [
        *("", "claims", "  1  holds  cost = 2 <= 1  text 1"),
        *("", "claims not judged, and what they need", "  2  more  text 2"),
    ]
    undefined = claim(1, holds=False) | {"measured": None, "bound": None}
    assert "cost = never <= never" in claim_table([undefined])[-1]
