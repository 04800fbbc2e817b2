"""A run killed a few times; `benchmarks/kills.py` does so a hundred times."""

from __future__ import annotations

import os

import pytest

from swarmstart.benchmarks.kills import Command, besieged, finished_steps, flown

SMALL = Command(
    name="run",
    arguments=(
        *("run", "formation_v", "--variant", "literal", "--quiet", "--no-figures"),
        *("--set", "steps=12", "--set", "budget.evaluations=400"),
    ),
    finished=finished_steps,
    numbers=flown,
)


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="looks into /proc")
def test_no_signal_and_no_kill_loses_what_is_finished() -> None:
    happened, rounds, wrong = besieged([SMALL], signals=2, kills=1, seed=2)
    assert not wrong
    assert sum(happened.values()) == 3
    assert sum(n for what, n in happened.items() if "SIGKILL" in what) == 1
    assert rounds >= 1
