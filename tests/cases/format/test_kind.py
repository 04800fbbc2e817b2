"""Parts that every kind of scenario has."""

from __future__ import annotations

import re
from pkgutil import resolve_name

import pytest

from swarmstart.cases.format.registry import KINDS


@pytest.mark.parametrize("name", KINDS)
def test_a_measure_that_may_be_null_has_a_reason(name: str) -> None:
    kind = resolve_name(KINDS[name].kind)
    assert kind.undefined.keys() <= kind.measures.keys()
    null = {measure for measure, text in kind.measures.items() if "null" in text}
    assert null <= kind.undefined.keys()
    assert all(kind.undefined.values())


@pytest.mark.parametrize("name", KINDS)
def test_every_measure_has_a_meaning_with_its_unit(name: str) -> None:
    kind = resolve_name(KINDS[name].kind)
    for measure, meaning in kind.measures.items():
        assert meaning[0].isupper() or meaning[0].isdigit(), measure
        is_count = meaning.startswith(("Number ", "1 if "))
        assert is_count or re.search(r" \[[^\[\]]{1,20}\]$", meaning), measure
    assert dict(resolve_name(KINDS[name].measures)) == kind.measures
