"""The table of the claims: what a row shows of parts that say different things."""

from __future__ import annotations

from typing import Any

import pytest

from swarmstart.cases.commands.actions.replicate import deciding, markdown


def part(name: str, verdict: str, **more: Any) -> dict[str, Any]:
    whole = {
        **{"scenario": "", "variant": "", "reading": "", "basis": "text"},
        **{"asked": f"{name} < 1", "measured": name, "verdict": verdict},
    }
    return whole | more


def claim(verdict: str, *parts: dict[str, Any]) -> dict[str, Any]:
    return {"id": 1, "text": "It holds.", "verdict": verdict, "parts": list(parts)}


@pytest.mark.parametrize(
    ("verdict", "parts", "shown"),
    [
        ("holds", [("a", "holds"), ("b", "holds")], ["a"]),
        ("in part", [("a", "holds"), ("b", "does not hold")], ["b", "a"]),
        ("in part", [("a", "in part")], ["a"]),
        ("in part", [("a", "in part"), ("b", "does not hold")], ["b", "a"]),
        ("in part", [("a", "in part"), ("b", "in part")], ["a"]),
        (
            "in part",
            [("a", "no difference shown"), ("b", "does not hold"), ("c", "holds")],
            ["b", "c"],
        ),
        ("does not hold", [("a", "not shown"), ("b", "does not hold")], ["b"]),
        ("holds", [("a", "shown beside"), ("b", "holds")], ["b"]),
        ("not judged", [("a", "does not hold"), ("b", "not judged")], ["b"]),
    ],
)
def test_a_row_shows_what_is_farthest_from_holding_and_what_holds(
    verdict: str, parts: list[tuple[str, str]], shown: list[str]
) -> None:
    found = deciding(claim(verdict, *[part(*one) for one in parts]))
    assert [one["measured"] for one in found] == shown


def row(one: dict[str, Any]) -> list[str]:
    (*_, last) = markdown({"claims": [one]}).splitlines()
    return last.strip("| ").split(" | ")


def test_no_number_stands_beside_what_is_not_judged() -> None:
    assert row(claim("not judged", part("0.9593", "not judged")))[3] == "-"
    assert row(claim("holds", part("0.9593", "holds")))[3] == "0.9593"


def test_a_row_says_how_the_text_is_read_and_whose_bound_it_is() -> None:
    read = part("a", "does not hold", reading="as printed", basis="ours")
    assert row(claim("does not hold", read))[2] == "`a < 1` (as printed; bound ours)"
    other = part("b", "holds", scenario="formation_v", variant="literal")
    cells = row(claim("in part", read | {"basis": "text"}, other))
    assert cells[2] == "`a < 1` (as printed)<br>`b < 1` (formation_v literal)"
    assert cells[3] == "a: does not hold<br>b: holds"
