"""A comparison as text: one line for each solver, equal in all calls."""

from __future__ import annotations

from typing import Any

import numpy as np

from swarmstart.benchmarks.false_claims import made_up
from swarmstart.cases.campaign.judging.report import report_text

INF, NAN = np.inf, np.nan
SEEDS = np.arange(8.0)
CLOCK = {"de": SEEDS + 1, "ga": SEEDS + 2, "ipopt": np.array([0.25])}
OWN: dict[str, Any] = {
    "de": 10 + SEEDS,
    "ga": [INF, NAN, NAN, *(20 + SEEDS[3:])],
    "ipopt": [12.0],
}


EXPECTED = """\
budget of 4000 evaluations for each planning problem, seeds 0 to 7

s
  solver  feasible  near the best  95 %          best  median  worst  evals  false
  de      8 of 8    1 of 8         0.02 to 0.47  10    13.5    17     4000   0
  ga      5 of 8    0 of 8         0.00 to 0.32  23    25      27     4000   0      GA
  ipopt   1 of 1    0 of 1         one run       12    12      12     4000   0      X
  the last column compares each with de, seed by seed
  best known: 10, found by de
  ga: it died (2 times)"""


def test_a_line_has_what_a_solver_has_shown() -> None:
    """Of ga 2^(1 - 8), of two tests in four fifths of the chance.

    Of ipopt ranks 1.5 and 3.5 against 1.5, 3.5, 5, 6 and 7: p = 0.17, last of the two.
    """
    text = report_text(made_up({"s": OWN}, seconds=CLOCK, budget_text="4000evals"))
    said = EXPECTED.replace("GA", "costlier, p = 0.02")
    assert text == said.replace("X", "no difference shown, p = 0.21")


def test_seconds_are_shown_only_if_asked_for() -> None:
    slow = made_up({"s": OWN}, seconds=CLOCK)
    fast = made_up({"s": OWN}, seconds={k: v / 10 for k, v in CLOCK.items()})
    assert report_text(slow) == report_text(fast)
    lines = report_text(slow, times=True).splitlines()
    assert lines[3].endswith("false  P50 s  P99 s")
    assert lines[4].split()[-2:] == ["4", "8"]
    assert "0.25   0.25" in lines[6]


def test_a_maximiser_sees_what_it_maximises() -> None:
    content = made_up({"s": {"de": -10 - SEEDS}}, more=lambda _: {"sense": -1})
    assert "17    13.5    10" in report_text(content)


def test_a_scenario_without_an_answer_has_no_costs() -> None:
    text = report_text(made_up({"s": {"de": [INF] * 8, "ga": [NAN] * 8}}))
    assert "0 of 8    0 of 8         0.00 to 0.32  -     -       -" in text
    assert "ga: it died (8 times)" in text
