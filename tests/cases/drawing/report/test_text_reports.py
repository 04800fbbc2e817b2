"""Markdown whose tables hold, and LaTeX that compiles, whatever users write."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.cases.drawing.report.text_reports import (
    ascii_latex,
    comparison_latex,
    comparison_markdown,
    github_text,
)
from swarmstart.tests.cases.drawing.report import contents

CONTENTS = [
    contents.content(regression=True),
    contents.content(flights=True),
    contents.content(nulls=True),
    contents.content(solvers=3, scenarios=1, seeds=1, feasible=0.0, sense=-1),
    contents.hostile(),
]


@pytest.mark.parametrize("content", CONTENTS)
def test_every_line_of_a_markdown_table_has_as_many_cells(content: Any) -> None:
    text = comparison_markdown(content)
    text.encode()
    for block in re.findall(r"(?:^\|.*\n)+", text, flags=re.M):
        bars = {
            len(re.findall(r"(?<!\\)(?:\\\\)*\|", line))
            for line in block.split("\n")
            if line
        }
        assert len(bars) == 1
    assert not re.search(r"(?<!\\)<script", text.split("```")[0])


@pytest.mark.parametrize("content", CONTENTS)
def test_environments_of_latex_balance_and_rows_have_as_many_cells(
    content: Any,
) -> None:
    text = comparison_latex(content)
    assert text.isascii()
    begun = re.findall(r"\\begin\{longtable\}\{([lr]+)\}", text)
    assert len(begun) == text.count(r"\end{longtable}") == len(content["scenarios"]) + 1
    for table in text.split(r"\begin{longtable}")[1:]:
        columns = len(re.match(r"\{([lr]+)\}", table).group(1))  # type: ignore[union-attr]
        body = table.split(r"\endhead")[1].split(r"\bottomrule")[0].strip()
        for row in body.split("\n"):
            assert row.endswith(r" \\")
            assert len(re.findall(r"(?<!\\)&", row)) == columns - 1


@given(st.text(max_size=60))
@settings(max_examples=100, deadline=None)
def test_escaped_latex_has_no_bare_special_character(text: str) -> None:
    told = ascii_latex(text)
    assert told.isascii() and "\n" not in told
    bare = re.sub(r"\\(?:text[a-z]+|ldots)\{\}|\\'\{e\}|\\[{}$&#%_]", "", told)
    assert not set(bare) & set("\\{}$&#%_~^<>|\"'`")


@given(st.text(max_size=60))
@settings(max_examples=100, deadline=None)
def test_escaped_markdown_has_no_bare_special_character(text: str) -> None:
    told = github_text(text)
    assert "\n" not in told
    bare = re.sub(r"\\[!-/:-@[-`{-~]", "", told)
    assert not set(bare) & set("\\`*_[]<>|~")
