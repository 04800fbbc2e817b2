"""Parts that every kind of scenario has."""

from __future__ import annotations

import re
from pkgutil import resolve_name

import pytest

from swarmstart.cases.format.registry import KINDS, KindWords, words_of
from swarmstart.cases.format.scenario import shipped


@pytest.mark.parametrize("name", KINDS)
def test_a_measure_that_may_be_null_has_a_reason(name: str) -> None:
    kind = resolve_name(words_of(name).kind)
    assert kind.undefined.keys() <= kind.measures.keys()
    null = {measure for measure, text in kind.measures.items() if "null" in text}
    assert null <= kind.undefined.keys()
    assert all(kind.undefined.values())


@pytest.mark.parametrize("name", KINDS)
def test_every_measure_has_a_meaning_with_its_unit(name: str) -> None:
    kind = resolve_name(words_of(name).kind)
    for measure, meaning in kind.measures.items():
        assert meaning[0].isupper() or meaning[0].isdigit(), measure
        is_count = meaning.startswith(("Number ", "1 if "))
        assert is_count or re.search(r" \[[^\[\]]{1,20}\]$", meaning), measure
    assert dict(words_of(name).measures) == kind.measures


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_says_all_that_is_said_of_it(name: str) -> None:
    words = words_of(name)
    assert words.title and words.captions
    assert words.templates or words.example in shipped()
    assert {*words.costs} <= words.measures.keys()


def test_the_words_of_an_unknown_kind_are_empty() -> None:
    assert words_of("unheard") == words_of(None) == words_of(7) == KindWords()
