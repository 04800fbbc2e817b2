from __future__ import annotations

import dataclasses
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from swarmstart.cases.format.parts import (
    BudgetPart,
    NonNegative,
    Number,
    OrderPart,
    Positive,
    Range,
)
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.cases.format.settings import search_part
from swarmstart.heuristics import default_algorithm

WITH_SETTINGS = [name for name, entry in SEARCHES.items() if entry.settings]


@pytest.mark.parametrize("name", WITH_SETTINGS)
def test_the_keys_of_a_search_are_its_settings_with_their_defaults(name: str) -> None:
    settings = resolve_name(SEARCHES[name].settings)
    part = search_part(name).model_validate({"name": name})
    fields = {field.name for field in dataclasses.fields(settings)}
    assert set(type(part).model_fields) == {
        "name",
        "warm_start",
        "sampling",
        "when",
        *fields,
    }
    assert part.algorithm() == settings()
    assert part.warm_start == SEARCHES[name].warm_start
    assert part.sampling == SEARCHES[name].sampling


@pytest.mark.parametrize("name", WITH_SETTINGS)
def test_every_setting_of_a_search_reaches_its_algorithm(name: str) -> None:
    algorithm = search_part(name).model_validate({"name": name, "size": 37}).algorithm()
    assert algorithm is not None
    assert algorithm == resolve_name(SEARCHES[name].settings)(size=37)


def test_no_search_is_no_algorithm_and_has_no_settings() -> None:
    part = search_part("none").model_validate({"name": "none"})
    assert part.algorithm() is None
    assert set(type(part).model_fields) == {"name", "warm_start", "sampling", "when"}


def test_a_setting_may_be_an_expression_or_a_list() -> None:
    part: Any = search_part("cpso").model_validate(
        {"name": "cpso", "velocity_max": ["pi/18", 5], "inertia_max": "2 ** 0.5"}
    )
    assert part.velocity_max == [np.pi / 18, 5.0]
    assert part.inertia_max == 2**0.5


def test_a_setting_out_of_range_is_refused_with_its_name() -> None:
    with pytest.raises(ValidationError, match="size must be an integer of at least 2"):
        search_part("cpso").model_validate({"name": "cpso", "size": 1})


def test_a_sampling_is_one_of_those_of_the_library() -> None:
    for sampling in (None, "uniform", "latin_hypercube", "smooth", "half_smooth"):
        part = search_part("de").model_validate({"name": "de", "sampling": sampling})
        assert part.sampling == sampling
    with pytest.raises(ValidationError, match="'latin_hypercube'"):
        search_part("de").model_validate({"name": "de", "sampling": "sobol"})


@pytest.mark.parametrize("value", [True, None, "", "pi/", float("nan"), float("inf")])
def test_what_is_no_finite_number_is_refused(value: object) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Number).validate_python(value, strict=True)


def test_signs_are_checked_after_an_expression_is_computed() -> None:
    assert TypeAdapter(NonNegative).validate_python("1 - 1") == 0.0
    with pytest.raises(ValidationError, match="greater than 0"):
        TypeAdapter(Positive).validate_python("1 - 1")


def test_a_range_is_written_and_dumped_as_a_list() -> None:
    part = Range.model_validate([-1, "pi"])
    assert (part.lower, part.upper) == (-1.0, np.pi)
    dumped: Any = part.model_dump(mode="json")
    assert Range.model_validate(dumped) == part


@pytest.mark.parametrize("value", [[1, 1], [2, 1], [1], [1, 2, 3], 3, {"lower": 1}])
def test_what_is_no_range_is_refused(value: object) -> None:
    with pytest.raises(ValidationError, match="expected"):
        Range.model_validate(value)


def test_a_budget_needs_evaluations_or_seconds() -> None:
    assert BudgetPart.model_validate({"seconds": "1/4"}).budget().seconds == 0.25
    assert BudgetPart.model_validate({"evaluations": 9}).budget().evaluations == 9
    with pytest.raises(ValidationError, match="found neither"):
        BudgetPart.model_validate({})


def test_both_orders_can_be_named() -> None:
    for name in ("static_penalty", "feasibility_first"):
        OrderPart.model_validate({"name": name}).order()


def test_the_default_search_is_that_of_the_library_for_the_budget() -> None:
    part = search_part("default").model_validate({"name": "default"})
    for evaluations in (100, 20_000, None):
        assert part.algorithm(evaluations) == default_algorithm(evaluations)
    assert part.when == "undecided"


def test_a_search_is_made_when_needed_or_always() -> None:
    part = search_part("de").model_validate({"name": "de", "when": "always"})
    assert part.when == "always" and part.algorithm() is not None
    with pytest.raises(ValidationError, match="needed"):
        search_part("de").model_validate({"name": "de", "when": "never"})


@pytest.mark.parametrize(
    ("text", "degrees"),
    [("72 km/h", "90"), ("45deg", "45"), ("-90 °", "-90"), ("1.5 m/s^2", "90")],
)
def test_a_number_with_a_unit_is_answered_with_the_way_to_write_it(
    text: str, degrees: str
) -> None:
    said = rf"a number without a unit; for degrees: radians\({degrees}\)"
    with pytest.raises(ValidationError, match=said):
        BudgetPart.model_validate({"seconds": text})
    with pytest.raises(ValidationError, match=r"column 3: expected (?!a number)"):
        BudgetPart.model_validate({"seconds": "2 pi"})
