"""What every kind offers."""

from __future__ import annotations

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
