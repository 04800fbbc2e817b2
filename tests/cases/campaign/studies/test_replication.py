"""The chapter's claims as data: complete, and each with its parts."""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path
from typing import Any

import pydantic
import pytest

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.studies import replication
from swarmstart.cases.campaign.studies.replication import (
    ChapterClaim,
    PartOfClaim,
    PlannedPart,
    cells_of,
    chapter,
    claims_in,
    drawn_by_key,
    figure_cells,
    judged,
    planned,
)
from swarmstart.cases.campaign.studies.verdicts import (
    Verdict,
    of_assumption,
    verdict_of_parts,
)
from swarmstart.cases.format.scenario import read_document, resolve, shipped

CLAIMS = 25
WHOLE = chapter()
NOTED = Path(__file__).parents[4] / "docs" / "chapter" / "claims.json"


def claim(number: int) -> ChapterClaim:
    return next(one for one in WHOLE.claims if one.id == number)


def outcome(value: float | None) -> Outcome:
    names = ("settle_time_s", "shape_time_s", "closed_loop_cost")
    return Outcome(
        result={"measures": dict.fromkeys(names, value)},
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
    """Except copies on a second flight of the same kind, and computed claims."""
    named = {part.claim for c in WHOLE.claims for part in c.parts}
    computed = {str(c.id) for c in WHOLE.claims if all(p.compute for p in c.parts)}
    for name in shipped():
        scenario = resolve(read_document(name)).scenario
        if not scenario.source.startswith("Chapter 5"):
            continue
        for one in scenario.claims:
            number = one.id.rstrip("abcds")
            assert one.id in named or number in computed, (name, one.id)


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
    for seeds, count in ((None, 6), (2, 2)):
        parts = planned(WHOLE, claim(5), seeds=seeds)
        assert [len(part.cells) for part in parts] == [count] * 12
        assert all(len(pair) == 2 for part in parts for pair in part.cells)
    for part in planned(WHOLE, claim(8), seeds=7):
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
        ([8.0, 9.0, 7.0], Verdict.HOLDS, False),
        ([8.0, 60.0, 7.0], Verdict.IN_PART, True),
        ([None, None, None], Verdict.FAILS, False),
    ],
)
def test_measures_make_the_verdict(
    values: list[float | None], verdict: Verdict, expected: bool
) -> None:
    """Claim 1 is expected to hold in part: here all parts have equal flights."""
    parts = planned(WHOLE, claim(1), seeds=None)
    outcomes = {
        cell.key: outcome(v)
        for part in parts
        for cell, v in zip(cells_of([part]), values, strict=True)
    }
    found = judged(claim(1), parts, outcomes)
    assert (found.verdict, found.is_expected) == (verdict, expected)
    assert [part.values for part in found.parts] == [tuple(values)] * 4


def test_a_pair_is_the_run_by_the_one_it_is_compared_with() -> None:
    """Half the cost is a ratio of 0.5: better."""
    (part, *_) = planned(WHOLE, claim(5), seeds=None)
    first, second = zip(*part.cells, strict=True)
    outcomes = {cell.key: outcome(2.0 + k) for k, cell in enumerate(first)}
    outcomes |= {cell.key: outcome(4.0 + 2 * k) for k, cell in enumerate(second)}
    found = judged(claim(5), [part], outcomes)
    assert found.parts[0].values == (0.5,) * 6
    assert found.parts[0].pairs[1] == (3.0, 6.0)
    assert found.verdict is Verdict.HOLDS


def test_a_guarantee_is_refuted_by_one_flight_and_not_shown_by_all() -> None:
    (part,) = [p for p in planned(WHOLE, claim(10), seeds=3) if p.claim.id == "10b"]
    cells = list(cells_of([part]))
    for last, verdict in ((9.0, Verdict.NOT_SHOWN), (None, Verdict.FAILS)):
        values = [8.0, 9.0, last]
        outcomes = {c.key: outcome(v) for c, v in zip(cells, values, strict=True)}
        assert judged(claim(10), [part], outcomes).verdict is verdict


def test_the_share_that_a_claim_asks_for_is_enough() -> None:
    """Claim 4: the fifth UAV alone in four runs of five, not in three."""
    (part,) = planned(WHOLE, claim(4), seeds=None)
    cells = list(cells_of([part]))
    for alone, verdict in ((4, Verdict.HOLDS), (3, Verdict.IN_PART)):
        outcomes = {
            cell.key: Outcome(
                result={"measures": {"lone_failure": 5 if k < alone else 0}},
                failure="",
                seconds=1.0,
                folder=Path(),
            )
            for k, cell in enumerate(cells)
        }
        assert judged(claim(4), [part], outcomes).verdict is verdict


def test_what_is_shown_beside_judges_nothing() -> None:
    parts = planned(WHOLE, claim(17), seeds=1)
    assert [part.part.beside for part in parts] == [False, True]
    name = parts[0].claim.measure
    fine, bad = (
        Outcome(
            result={"measures": {name: value}}, failure="", seconds=1.0, folder=Path()
        )
        for value in (0.0, 1e9)
    )
    both = {c.key: o for p, o in zip(parts, (fine, bad), strict=True)
            for c in cells_of([p])}  # fmt: skip
    found = judged(claim(17), parts, both)
    assert found.verdict is Verdict.MET and found.is_expected
    assert found.parts[1].values == (1e9,)


def test_one_sentence_has_one_bound_in_both_experiments() -> None:
    """A tenth of the smallest distance of two slots, sqrt(10^2 + 10^2) m."""
    one, other = (planned(WHOLE, claim(n), seeds=1)[0].claim.bound for n in (19, 20))
    assert one == other == pytest.approx(2**0.5)
    for name in ("reconfiguration", "reconfiguration_reverse"):
        slots = resolve(read_document(name)).settings["slots"]
        apart = min(
            math.dist((a["x_m"], a["y_m"]), (b["x_m"], b["y_m"]))
            for a, b in itertools.combinations(slots, 2)
        )
        assert one == pytest.approx(apart / 10)


def test_better_is_a_ratio_below_1() -> None:
    """Parts that are compared with another run have no factor of this project."""
    for one in WHOLE.claims:
        for part in planned(WHOLE, one, seeds=1):
            if part.claim.against is not None:
                assert (part.claim.relation, part.claim.bound) == ("<", 1), one.id


def test_a_claim_is_run_in_a_variant_that_it_is_about() -> None:
    for one in WHOLE.claims:
        for part in planned(WHOLE, one, seeds=1):
            assert part.claim.variant in ("", part.variant), (one.id, part.claim.id)
    variants = {part.variant for part in planned(WHOLE, claim(5), seeds=1)}
    assert variants == {"literal", "corrected"}


def test_one_seed_is_too_few_for_pairs_and_for_five_of_five() -> None:
    for number in (3, 5):
        parts = planned(WHOLE, claim(number), seeds=1)
        outcomes = {cell.key: outcome(10.0) for cell in cells_of(parts)}
        found = judged(claim(number), parts, outcomes)
        assert found.verdict is Verdict.NOT_JUDGED
        assert found.is_expected


def test_a_run_that_failed_is_told_and_nothing_is_judged() -> None:
    parts = planned(WHOLE, claim(1), seeds=2)[:1]
    first, second = cells_of(parts)
    lost = Outcome(result=None, failure="it died", seconds=0.0, folder=Path())
    found = judged(claim(1), parts, {first.key: outcome(8.0), second.key: lost})
    (part,) = found.parts
    assert (part.values, part.failures) == ((8.0,), ("it died",))
    assert found.verdict is Verdict.NOT_JUDGED
    assert not found.is_expected


def test_one_part_that_failed_is_as_unexpected_as_all() -> None:
    parts = planned(WHOLE, claim(1), seeds=2)
    outcomes = {cell.key: outcome(8.0) for cell in cells_of(parts)}
    (last, *_) = cells_of(parts[1:])
    lost = Outcome(result=None, failure="it died", seconds=0.0, folder=Path())
    found = judged(claim(1), parts, {**outcomes, last.key: lost})
    # Both limits are measured on the same flights.
    assert [bool(part.failures) for part in found.parts] == [True, True, False, False]
    assert not found.is_expected


def test_a_part_is_of_a_scenario_or_computed() -> None:
    for content in (
        {},
        {"scenario": "a", "claim": "1", "compute": "b", "measure": "c"},
    ):
        with pytest.raises(pydantic.ValidationError, match="scenario with claim or"):
            PartOfClaim.model_validate(content)


def test_a_part_of_a_claim_has_its_defaults_and_limits() -> None:
    stated: dict[str, Any] = {"scenario": "a", "claim": "1"}
    part = PartOfClaim.model_validate(stated)
    assert (part.width, part.share, part.seeds, part.least) == (0.0, 1.0, 3, 1)
    assert (part.tolerance, part.relation, part.over) == (0.25, "==", "every")
    assert not part.guarantee and not part.beside and part.against is None
    for key, allowed, refused in (
        ("share", 1.0, 1.01),
        ("share", 0.01, 0.0),
        ("seeds", 1, 0),
        ("least", 1, 0),
    ):
        one = PartOfClaim.model_validate(stated | {key: allowed})
        assert getattr(one, key) == allowed
        with pytest.raises(pydantic.ValidationError, match=key):
            PartOfClaim.model_validate(stated | {key: refused})
    with pytest.raises(pydantic.ValidationError, match="parts"):
        ChapterClaim.model_validate({"id": 1, "text": "a"})


@pytest.mark.parametrize(
    ("stated", "values", "verdict"),
    [
        ({}, [1.0, 1.0], Verdict.HOLDS),
        ({}, [], Verdict.NOT_JUDGED),
        ({"least": 3}, [1.0, 1.0], Verdict.NOT_JUDGED),
        ({"least": 2}, [1.0, 1.0], Verdict.HOLDS),
        ({"width": 0.5}, [1.5, 0.5], Verdict.HOLDS),
        ({"width": 0.5}, [1.51, 0.49], Verdict.FAILS),
        ({"share": 0.5}, [1.0, 7.0], Verdict.HOLDS),
        ({"share": 0.51}, [1.0, 7.0], Verdict.IN_PART),
        ({"over": "median"}, [0.0, 1.0, 9.0], Verdict.HOLDS),
        ({"guarantee": True}, [1.0, 1.0], Verdict.NOT_SHOWN),
        ({"beside": True}, [9.0], Verdict.BESIDE),
        # Compared with another run: by pairs only if there are several.
        ({"against": {"steps": 3}, "seeds": 1}, [1.0], Verdict.HOLDS),
        ({"against": {"steps": 3}, "seeds": 2}, [1.0, None], Verdict.NOT_JUDGED),
    ],
)
def test_settings_of_a_part_decide_how_its_values_are_judged(
    stated: dict[str, Any], values: list[float | None], verdict: Verdict
) -> None:
    part = PartOfClaim.model_validate(
        {"scenario": "a", "measure": "m", "bound": 1.0, **stated}
    )
    plan = PlannedPart(
        part=part, claim=replication._own_claim(part), variant="", reason="why",
        cells=(), commands=(),
    )  # fmt: skip
    assert replication._verdict(plan, values)[0] is verdict


OWN = b"""
schema: 1
flown_by: "a.b:c"
claims:
  - id: 1
    text: a bar
    common: {scenario: close_formation_vortex, seeds: 2, seeded: [plant.gusts.seed]}
    parts:
      - {measure: min_range_ft, relation: "<=", bound: 3, over: median}
      - {measure: min_range_ft, bound: 4, width: 1, share: 0.5, when: {steps: 7}}
"""


@pytest.mark.parametrize(
    ("first", "second", "verdicts"),
    [
        ((2.0, 3.5), (3.0, 9.0), (Verdict.HOLDS, Verdict.HOLDS)),
        ((2.5, 4.0), (2.9, 5.1), (Verdict.FAILS, Verdict.FAILS)),
    ],
)
def test_a_part_may_have_a_bound_of_its_own(
    first: tuple[float, ...], second: tuple[float, ...], verdicts: tuple[Verdict, ...]
) -> None:
    own = claims_in(OWN, name="own.yaml")
    parts = planned(own, own.claims[0], seeds=None)
    cells = [*cells_of(parts)]
    assert {cell.work for cell in cells} == {"a.b:c"}
    seeds = [cell.job["settings"]["plant"]["gusts"]["seed"] for cell in cells]
    assert seeds == [cell.job["seed"] for cell in cells] == [0, 1, 0, 1]
    assert [cell.job["settings"]["steps"] for cell in cells][2:] == [7, 7]
    outcomes = {
        cell.key: Outcome(
            result={"measures": {"min_range_ft": value}},
            failure="", seconds=1.0, folder=Path(),
        )
        for cell, value in zip(cells, (*first, *second), strict=True)
    }  # fmt: skip
    found = judged(own.claims[0], parts, outcomes)
    assert tuple(part.verdict for part in found.parts) == verdicts
    assert found.is_expected is (verdicts[0] is Verdict.HOLDS)


def test_a_cell_is_the_same_whoever_plans_it() -> None:
    first, again = (
        [cell.key for cell in cells_of(planned(chapter(), claim(19), seeds=3))]
        for _ in range(2)
    )
    assert first == again
    assert len(set(first)) == len(first)
    assert all(isinstance(key, str) and len(key) == 16 for key in first)
    assert isinstance(figure_cells(WHOLE)[0], Cell)


def as_noted(part: PlannedPart, told: dict[str, Any]) -> dict[str, Outcome]:
    """Return the outcomes of a part's cells as docs/chapter/claims.json notes them."""
    rows = told["pairs"] or [[value] for value in told["values"]]
    return {
        cell.key: Outcome(
            result={"measures": {part.claim.measure: value}},
            failure="",
            seconds=1.0,
            folder=Path(),
        )
        for cells, row in zip(part.cells, rows, strict=True)
        for cell, value in zip(cells, row, strict=True)
    }


def test_the_noted_verdicts_follow_from_the_noted_measures() -> None:
    """Every seed of every part; and each claim has the verdict that is expected."""
    noted = json.loads(NOTED.read_text(encoding="utf-8"))
    for one, told in zip(WHOLE.claims, noted["claims"], strict=True):
        parts = planned(WHOLE, one, seeds=None)
        found = [
            judged(one, [part], as_noted(part, row)).parts[0]
            for part, row in zip(parts, told["parts"], strict=True)
        ]
        for part, row in zip(found, told["parts"], strict=True):
            assert (part.verdict, part.test) == (row["verdict"], row["test"]), one.id
            assert part.values == pytest.approx(tuple(row["values"])), one.id
        verdict = verdict_of_parts([part.verdict for part in found])
        verdict = of_assumption(verdict) if one.assumption else verdict
        assert (one.id, verdict) == (one.id, told["verdict"])
        assert verdict is one.expected, one.id


def test_what_converges_is_judged_at_both_limits_which_are_ours() -> None:
    """1 m, and a tenth of the smallest distance of two slots, in every reading."""
    readings = (" as printed", " shifted"), (" as printed", " shifted"), ("",)
    for number, read in zip((1, 2, 3), readings, strict=True):
        parts = planned(WHOLE, claim(number), seeds=1)
        for measure, limit in (("settle_time_s", "1 m"), ("shape_time_s", "2.12 m")):
            limited = [p.part for p in parts if p.claim.measure == measure]
            assert len(limited) == len(read)
            for part, words in zip(limited, read, strict=True):
                assert part.basis == "ours" and not part.beside
                assert part.reading.endswith(f"to {limit}")
                assert words.split(" ")[-1] in part.reading


def test_the_page_shows_claims_one_to_three_at_both_limits_as_noted() -> None:
    noted = json.loads(NOTED.read_text(encoding="utf-8"))["claims"][:3]
    page = NOTED.with_name("index.md").read_text(encoding="utf-8")
    for one in noted:
        for near, far in zip(one["parts"][::2], one["parts"][1::2], strict=True):
            cells = " | ".join(
                f"{part['measured']}: {part['verdict']}" for part in (near, far)
            )
            assert re.search(
                rf"^\| {one['id']}\b.* \| {re.escape(cells)} \|$", page, re.M
            )


def test_the_reason_of_claim_23_names_the_seconds_that_were_measured() -> None:
    (noted,) = (
        one
        for one in json.loads(NOTED.read_text(encoding="utf-8"))["claims"]
        if one["id"] == 23
    )
    said = [
        float(text) for text in re.findall(r"(0\.\d+) s in section", noted["because"])
    ]
    measured = [
        part["values"][0]
        for part in noted["parts"]
        if part["measure"] == "step_seconds_median"
    ]
    assert noted["because"] == claim(23).because
    assert said == pytest.approx(measured, rel=0.5)
