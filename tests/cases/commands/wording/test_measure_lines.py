"""The table of measures: value, unit and meaning; why a measure is undefined."""

import math

import pytest

from swarmstart.cases.commands.wording.measures import (
    measure_table,
    measures_of_run,
    value_text,
)
from swarmstart.cases.format.scenario import read_document, resolve


def test_values_have_unit_and_meaning_and_an_undefined_one_its_reason() -> None:
    resolved = resolve(read_document("formation_v"))
    values = {"settle_time_s": ("undefined",), "linear_steps": ("3",)}
    notes = {"settle_time_s": "undefined: never"}
    head, first, *_, last = measure_table(
        resolved, values, ("measure", "value", "unit", "meaning"), notes
    )
    assert head.split() == ["measure", "value", "unit", "meaning"]
    assert first.split()[:3] == ["settle_time_s", "undefined", "s"]
    assert last.split()[:3] == ["linear_steps", "3", "-"]
    assert max(map(len, (head, first, last))) <= 80


def test_own_and_decided_measures_are_explained() -> None:
    known = measures_of_run(resolve(read_document("pendulum")))
    assert known["final_angle"]["meaning"].endswith("angle.end")
    assert "end_time" in measures_of_run(resolve(read_document("brachistochrone")))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1000000002.4618, "1000000002.462"),
        (-6378137.25, "-6378137.25"),
        (123456.789, "123457"),
        (1.2345678e20, "1.2345678e+20"),
        (math.inf, "inf"),
        (math.nan, "nan"),
    ],
)
def test_a_far_place_has_the_digits_that_tell_it_from_others(
    value: float, text: str
) -> None:
    assert value_text(value) == text


def test_lists_are_cut_and_undefined_entries_are_dashes() -> None:
    assert value_text([1.5, None]) == "[1.5, -]"
    assert value_text([0.0] * 100) == "[0, 0, 0, 0, 0, 0, ... 100 in all]"
    assert (value_text(None), value_text(7), value_text(1 / 3)) == (
        "-",
        "7",
        "0.333333",
    )
