"""Figures of a transfer: they are there, and show what was flown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from swarmstart.cases.kinds.transfer.figures import draw, sheet_figure
from swarmstart.cases.kinds.transfer.pose import TransferFlight
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import simulate
from swarmstart.tests.cases.drawing.reading import (
    curves,
    level,
    named,
    panel,
)
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.transfer.conftest import Make


def test_all_figures_are_written_and_none_is_blank(
    scenario: TransferScenario, flight: TransferFlight, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=20, rng=rng)
    files = draw(scenario, flight, flown, tmp_path)
    assert [file.name for file in files] == ["a_sheet.png"]
    for file in files:
        with Image.open(file) as image:
            colours = image.convert("RGB").getcolors(1 << 24)
        assert colours is not None and len(colours) > 50, file.name


def test_a_transfer_without_a_search_shows_the_plan_alone(make: Make) -> None:
    scenario = make("swap_5", "search={name: none}", "steps=1")
    flight = build(scenario)
    rng = np.random.default_rng(0)
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=1, rng=rng)
    figure = sheet_figure(scenario, flight, flown)
    axes = panel(figure, "cost")
    (cost,) = (x for x in axes.lines if str(x.get_label()).startswith("plan, "))
    assert level(cost) == flown.decisions[0].plans[0].cost
    assert curves(axes) == []
    goals = named(panel(figure, "y [m]"), "goal")[0]
    assert np.asarray(goals.get_data()) == pytest.approx(flight.posed.goals.T)
    bank = scenario.vehicle.bank_rad
    wanted = np.degrees([bank.lower, bank.upper])
    axes = panel(figure, "bank [deg]")
    told = axes.get_title(loc="right")  # The bank is so small that they are far away.
    assert told == "bounds beyond the axis: " + ", ".join(f"{x:g}" for x in wanted)
