"""The claims of a replication as text."""

from swarmstart.cases.drawing.report.text_reports import (
    replication_latex,
    replication_markdown,
)

CONTENT = {
    "counted": "1 claim holds",
    "seeds_in_words": "3 seeds",
    "claims": [
        {
            "id": 9,
            "text": "UAVs do not collide | at 50 %",
            "source": "5.2_a",
            "verdict": "in part",
            "parts": [
                {"measured": "1 / 2 / 3", "verdict": "holds"},
                {"measured": "never", "verdict": "does not hold"},
            ],
        }
    ],
}


def test_a_claim_is_a_row_whose_text_is_no_markup() -> None:
    said = replication_markdown(CONTENT)
    row = next(line for line in said.splitlines() if line.startswith("| 9 "))
    assert r"collide \| at 50 %" in row
    assert "1 / 2 / 3: holds; never: does not hold" in row
    printed = replication_latex(CONTENT)
    assert r"5.2\_a" in printed and r"50 \%" in printed
    assert printed.count(r"\begin{longtable}") == printed.count(r"\end{longtable}") == 1
