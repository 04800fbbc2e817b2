"""Figures of a transfer: they are there, and show what was flown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from swarmstart.cases.kinds.transfer.figures import draw, evolution_figure
from swarmstart.cases.kinds.transfer.pose import TransferFlight
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import simulate
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.transfer.conftest import Make


def test_all_figures_are_written_and_none_is_blank(
    scenario: TransferScenario, flight: TransferFlight, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=20, rng=rng)
    files = draw(scenario, flight, flown, tmp_path)
    names = ("a_trajectories", "b_evolution", "c_acceleration", "d_bank", "e_distances")
    assert [file.stem for file in files] == list(names)
    for file in files:
        with Image.open(file) as image:
            colours = image.convert("RGB").getcolors(1 << 24)
        assert colours is not None and len(colours) > 50, file.name


def test_a_transfer_without_a_search_shows_the_plan_alone(make: Make) -> None:
    flight = build(make("swap_5", "search={name: none}", "steps=1"))
    rng = np.random.default_rng(0)
    flown = simulate(flight.plant, flight.controller, flight.x0, steps=1, rng=rng)
    (axes,) = evolution_figure(flown).axes
    (line,) = axes.lines
    assert str(line.get_label()).startswith("plan, ")
