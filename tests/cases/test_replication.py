"""The chapter's claims as data: complete, and each with all that judges it."""

from __future__ import annotations

from pathlib import Path

import pydantic
import pytest

from swarmstart.cases.campaign import Cell, Outcome
from swarmstart.cases.replication import (
    ChapterClaim,
    PartOfClaim,
    cells_of,
    chapter,
    drawn_by_key,
    figure_cells,
    judged,
    planned,
)
from swarmstart.cases.scenario import read_document, resolve, shipped
from swarmstart.cases.verdicts import Verdict

CLAIMS = 25
WHOLE = chapter()


def claim(number: int) -> ChapterClaim:
    return next(one for one in WHOLE.claims if one.id == number)


def outcome(value: float | None) -> Outcome:
    return Outcome(
        result={
            "measures": dict.fromkeys(("settle_time_s", "closed_loop_cost"), value)
        },
        failure="",
        seconds=1.0,
        folder=Path(),
    )


def test_every_claim_of_the_chapter_is_there_once() -> None:
    assert [one.id for one in WHOLE.claims] == list(range(1, CLAIMS + 1))
    for one in WHOLE.claims:
        assert one.text.endswith(".") and one.source and one.because.strip()
        assert one.expected is not Verdict.NOT_JUDGED


def test_every_claim_of_a_scenario_of_the_chapter_is_part_of_one() -> None:
    """But for copies on a second flight of the same kind."""
    named = {(part.scenario, part.claim) for c in WHOLE.claims for part in c.parts}
    for name in shipped():
        scenario = resolve(read_document(name)).scenario
        if not scenario.source.startswith("Chapter 5"):
            continue
        numbers = {c.id.rstrip("abcd") for c in scenario.claims}
        for number in numbers:
            assert any(c == number or c.rstrip("abcd") == number for _, c in named)


def test_every_figure_of_the_chapter_is_drawn_and_flown_once() -> None:
    numbers = [figure.number for figure in WHOLE.figures]
    assert numbers[:6] == ["5.9", "5.10", "5.11", "5.12", "5.15", "5.16"]
    assert numbers[6:] == ["5.18 to 5.23", "5.24 to 5.28"]
    cells = figure_cells(WHOLE)
    assert all(cell.job["figures"] and cell.job["seed"] == 0 for cell in cells)
    drawn = drawn_by_key(WHOLE)
    used = [cell.key for c in WHOLE.claims for cell in cells_of(planned(
        WHOLE, c, seeds=1))]  # fmt: skip
    assert not set(drawn) & set(used)  # The flight that is drawn is judged too.
    assert {cell.key for cell in drawn.values()} & set(used)


def test_seeds_are_as_many_as_asked_for_where_anything_is_random() -> None:
    for seeds, counts in ((None, [6, 6, 6, 6]), (2, [2, 2, 2, 2])):
        parts = planned(WHOLE, claim(5), seeds=seeds)
        assert [len(part.cells) for part in parts] == counts
        assert all(len(pair) == 2 for part in parts for pair in part.cells)
    (part,) = planned(WHOLE, claim(8), seeds=7)
    assert len(part.cells) == 1


def test_the_commands_are_those_of_the_cells() -> None:
    part = planned(WHOLE, claim(3), seeds=1)[0]
    assert part.commands == (
        "swarmstart run formation_v --variant literal --set 'search={name: ga}' "
        "--set 'search.warm_start=\"none\"'",
    )
    settings = part.cells[0][0].job["settings"]
    assert settings["search"]["name"] == "ga"


@pytest.mark.parametrize(
    ("values", "verdict", "expected"),
    [
        ([8.0, 9.0, 7.0], Verdict.HOLDS, True),
        ([8.0, 60.0, 7.0], Verdict.IN_PART, False),
        ([None, None, None], Verdict.FAILS, False),
    ],
)
def test_measures_make_the_verdict(
    values: list[float | None], verdict: Verdict, expected: bool
) -> None:
    parts = planned(WHOLE, claim(1), seeds=None)
    cells = list(cells_of(parts))
    outcomes = {cell.key: outcome(v) for cell, v in zip(cells, values, strict=True)}
    found = judged(claim(1), parts, outcomes)
    assert (found.verdict, found.is_expected) == (verdict, expected)


def test_one_seed_is_too_few_for_pairs_and_for_five_of_five() -> None:
    for number in (3, 5):
        parts = planned(WHOLE, claim(number), seeds=1)
        outcomes = {cell.key: outcome(10.0) for cell in cells_of(parts)}
        found = judged(claim(number), parts, outcomes)
        assert found.verdict is Verdict.NOT_JUDGED
        assert found.is_expected


def test_a_run_that_failed_is_told_and_nothing_is_judged() -> None:
    parts = planned(WHOLE, claim(1), seeds=2)
    first, second = cells_of(parts)
    lost = Outcome(result=None, failure="it died", seconds=0.0, folder=Path())
    found = judged(claim(1), parts, {first.key: outcome(8.0), second.key: lost})
    (part,) = found.parts
    assert (part.values, part.failures) == ((8.0,), ("it died",))
    assert found.verdict is Verdict.NOT_JUDGED
    assert not found.is_expected


def test_a_part_is_of_a_scenario_or_computed() -> None:
    for content in (
        {},
        {"scenario": "a", "claim": "1", "compute": "b", "measure": "c"},
    ):
        with pytest.raises(pydantic.ValidationError, match="scenario and claim, or"):
            PartOfClaim.model_validate(content)


def test_a_cell_is_the_same_whoever_plans_it() -> None:
    first, again = (
        [cell.key for cell in cells_of(planned(chapter(), claim(19), seeds=3))]
        for _ in range(2)
    )
    assert first == again
    assert len(set(first)) == len(first)
    assert all(isinstance(key, str) and len(key) == 16 for key in first)
    assert isinstance(figure_cells(WHOLE)[0], Cell)
