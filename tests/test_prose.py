"""The rules of English: they hold everywhere, and each finds what it is for."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmstart.tests import prose

PAGES = ("README.md", "CONTRIBUTING.md", "docs", "examples")


def test_every_docstring_message_and_page_keeps_the_rules_of_english() -> None:
    broken = [
        f"{place.file}:{place.line}: {rule.name}: {words}"
        for place, rule, words in prose.found((*prose.ROOMS, *PAGES))
        if place.file not in ("tests/prose.py", "tests/test_prose.py")
    ]
    assert not broken, "\n".join(broken)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('"""What a hold must be."""', "clause"),
        ('"""Which algorithm is taken."""', "clause"),
        ('"""Refuse.\n\nRaises:\n    ValueError: If dt is none.\n"""', "none"),
        ('"""Refuse.\n\nRaises:\n    ValueError: Where dt is 0.\n"""', "raises"),
        ("# written by nobody else", "nobody"),
        ('x = "taken where it is not given"', "where"),
        ('x = "passes on the dear side"', "dear"),
        ('x = "the pendulum is flown"', "fly"),
        ('x = "64 unless told otherwise"', "told"),
    ],
)
def test_a_forbidden_turn_is_found_by_its_rule(
    text: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    (tmp_path / "pendulum.py").write_text(text + "\n", encoding="utf-8")
    assert {rule.name for _, rule, _ in prose.found(("pendulum.py",))} == {name}


@pytest.mark.parametrize(
    "text",
    [
        '"""Return the level."""\nx = None  # there is none\n',
        'x = "the point at which it crosses zero"\n',
    ],
)
def test_plain_sentences_break_no_rule(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    (tmp_path / "pendulum.py").write_text(text, encoding="utf-8")
    assert not list(prose.found(("pendulum.py",)))


def test_uavs_may_fly_and_code_on_pages_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prose, "ROOT", tmp_path)
    (tmp_path / "formation.md").write_text("UAVs fly.\n", encoding="utf-8")
    (tmp_path / "page.md").write_text("```python\nflown\n```\n    fly\n", "utf-8")
    assert not list(prose.found(("formation.md", "page.md")))
