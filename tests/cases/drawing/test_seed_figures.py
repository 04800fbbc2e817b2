"""Bands over seeds name UAVs as every other figure does."""

import itertools
from typing import Any

import numpy as np
import pytest

from swarmstart.cases.campaign.running.seeds import seeds_content
from swarmstart.cases.drawing.report.pages.seeds_page import seeds_page
from swarmstart.cases.drawing.seed_figures import seed_figures
from swarmstart.cases.format.scenario import read_document, resolve


def content(**more: Any) -> dict[str, Any]:
    band = {"low": [0.0, 1.0], "median": [1.0, 2.0], "high": [2.0, 3.0]}
    names = ("speed_m_s_0", "y_m_2")
    return {
        "schema": 1, "record": "seeds", "kind": "formation_flight", "seeds": [0, 1],
        "failures": ["", ""], "measures": {},
        "bands": {"time": [0.0, 1.0], "states": dict.fromkeys(names, band)}, **more,
    }  # fmt: skip


def titles(given: dict[str, Any]) -> list[str]:
    figure = dict(seed_figures(given))["bands"]
    return [axes.get_title() for axes in figure.axes if axes.get_title()]


def test_states_of_uavs_are_named_with_their_units() -> None:
    assert titles(content()) == ["UAV 1: speed [m/s]", "UAV 3: y [m]"]
    page = seeds_page(content())
    assert "UAV 1: speed [m/s]" in page and "speed_m_s_0" not in page


def test_numbers_that_a_scenario_gives_to_its_uavs_are_kept() -> None:
    given = resolve(read_document("formation_obstacle_uav3"))
    found = seeds_content(given, [], command="")["vehicles"]
    assert found == ["UAV 3", "UAV 4", "UAV 5"]
    assert titles(content(vehicles=found))[1] == "UAV 5: y [m]"


def test_states_of_other_kinds_keep_their_names() -> None:
    assert titles(content(kind="problem")) == ["speed_m_s_0", "y_m_2"]


@pytest.mark.parametrize("count", [1, 2, 4, 12])
def test_panels_at_fixed_places_hold_their_numbers(count: int) -> None:
    """No panel touches another, the title or an edge, with numbers of any size."""
    sizes = [(-1.0) ** k * 10.0 ** (3 * k - 12) for k in range(count)]
    measures = {f"m_{k}": [size, 1.7 * size] for k, size in enumerate(sizes)}
    bands = {
        f"x_{k}": {"low": [size, 0.0], "median": [size, size], "high": [size] * 2}
        for k, size in enumerate(sizes)
    }
    given = content(kind="problem", measures=measures)
    given["bands"] = {"time": [0.0, 1.0], "states": bands}
    for figure in dict(seed_figures(given)).values():
        figure.draw_without_rendering()
        boxes = [box for axes in figure.axes if (box := axes.get_tightbbox())]
        assert len(boxes) == count
        page = figure.bbox
        assert all(page.x0 <= box.x0 and box.x1 <= page.x1 for box in boxes)
        titles = [text.get_window_extent() for text in figure.texts]
        for one, other in itertools.combinations([*boxes, *titles], 2):
            assert not one.overlaps(other)


def test_a_flat_end_is_left_out_and_the_axis_says_so() -> None:
    time = [float(k) for k in range(61)]
    fading = [max(0.0, 4.0 - t) for t in time]
    given = content()
    side = dict.fromkeys(("low", "median", "high"), fading)
    given["bands"] = {"time": time, "states": {"speed_m_s_0": side}}
    figure = dict(seed_figures(given))["bands"]
    words = "the first 5 s of 60 s; then all go straight on"
    assert figure.get_supxlabel() == f"time [s], {words}"
    (axes,) = figure.axes
    assert np.asarray(axes.lines[0].get_xdata())[-1] == 5.0
    assert f"; {words}." in seeds_page(given)


def test_measures_of_a_kind_have_their_units_and_own_ones_none() -> None:
    given = content(measures={"settle_time_s": [1.0, 2.0], "my_m": [1.0, 2.0]})
    figure = dict(seed_figures(given))["spread"]
    assert [axes.get_title() for axes in figure.axes] == ["settle_time_s [s]", "my_m"]
