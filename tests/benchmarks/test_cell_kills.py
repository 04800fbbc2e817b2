"""Campaigns attacked a few times; `benchmarks/cell_kills.py` does so thirty times."""

from __future__ import annotations

import os
import random

import pytest

from swarmstart.benchmarks.cell_kills import besieged
from swarmstart.cases.campaign.engine.cells import LOCAL


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="looks into /proc")
@pytest.mark.parametrize("workers", [1, 2])
def test_no_moment_loses_a_finished_cell(workers: int) -> None:
    happened, wrong = besieged(workers, LOCAL, moments=3, chance=random.Random(1))
    assert not wrong
    assert happened.total() == 3
