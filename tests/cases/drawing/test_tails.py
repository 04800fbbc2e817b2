"""A figure leaves out the end of a run in which nothing happens, and says so."""

from __future__ import annotations

import numpy as np
import pytest

from swarmstart.cases.drawing.panels import Labels, panels_of, without_tails
from swarmstart.cases.drawing.sheet import panels_part
from swarmstart.cases.drawing.tails import tail_from

TIMES = np.linspace(0.0, 60.0, 601)
STILL, RAMP = np.full(TIMES.size, 15.0), 15.0 * TIMES
FADING = np.exp(-TIMES)  # Below 1 % after 4.6 s.
LABELS = Labels(states=["speed"], controls=["turn"])


def test_a_line_that_has_settled_ends_soon_after() -> None:
    tail = tail_from([(TIMES, np.stack([FADING, STILL, RAMP]))])
    assert tail == pytest.approx(1.25 * np.log(100.0), abs=0.2)


@pytest.mark.parametrize(
    "moving",
    [np.sin(TIMES), np.where(TIMES < 40.0, 0.0, 1.0), np.where(TIMES > 59, 1, FADING)],
)
def test_no_line_that_still_moves_is_cut(moving: np.ndarray) -> None:
    assert tail_from([(TIMES, FADING[None]), (TIMES, moving[None])]) is None


def test_lines_that_never_move_few_ones_and_unknown_ones_are_whole() -> None:
    assert tail_from([(TIMES, STILL[None])]) is None
    assert tail_from([(TIMES[::60], FADING[None, ::60])]) is None
    unknown = np.where(TIMES > 30.0, np.nan, FADING)
    assert tail_from([(TIMES, unknown[None])]) is None
    assert tail_from([]) is None


def test_panels_of_states_and_controls_end_together_and_say_how_long_the_run_was() -> (
    None
):
    held = np.linspace(0.0, 60.0, 121)
    states = panels_of(["speed"], LABELS, TIMES, FADING[None])
    controls = panels_of(["turn"], LABELS, held, (held[None, :-1] < 8.0).astype(float))
    (state,), (control,) = without_tails(states, controls)
    assert state.times[-1] == control.times[-1] == 10.0
    assert state.values.shape == (1, 101) and control.values.shape == (1, 20)
    assert panels_part("States", [state], LABELS).heading == (
        "States, the first 10 s of 60 s; then all go straight on"
    )
