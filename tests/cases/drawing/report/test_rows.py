"""Rows of a comparison's tables."""

import pytest

from swarmstart.cases.drawing.report.rows import against_first


@pytest.mark.parametrize(
    ("verdict", "words", "told"),
    [
        (
            "not compared",
            "not compared: 3 seeds, 7 are needed",
            "not compared: 3 seeds, 7 are needed",
        ),
        (
            "no difference shown",
            "no difference shown (cheaper in 1, costlier in 1 of 8 seeds, p = 1)",
            "no difference shown (cheaper in 1, costlier in 1 of 8 seeds, p = 1)",
        ),
        ("cheaper", "", "cheaper"),
        ("fewer", "in fewer seeds", "fewer: in fewer seeds"),
        ("", "", ""),
    ],
)
def test_a_verdict_that_the_words_begin_with_is_written_once(
    verdict: str, words: str, told: str
) -> None:
    test = {"verdict": verdict, "words": words}
    row = {"against_first": {**test, "p": None, "effect": None, "shift": None}}
    assert against_first(row) == told
