"""Rules at the bounds, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.heuristics.laws.box import (
    CODES,
    NAMES,
    NONE,
    reflected,
    repair,
    turned,
)

HOLDING = [code for name, code in CODES.items() if name != "none"]
anything = st.floats(width=64)  # NaN and infinity too
# Sixteenths of the width: every number below is exact.
sixteenths = st.integers(-100, 100).map(lambda n: n / 16)
scales = st.sampled_from([2.0**-20, 1.0, 4.0, 2.0**30])


def put(rule: int, value: float, origin: float, box: tuple[float, float]) -> float:
    return repair(rule, value, origin, *box, 0.5)


@settings(deadline=None)
@given(sixteenths, st.integers(-3, 3), scales)
def test_reflection_is_a_triangular_wave(t: float, low: int, width: float) -> None:
    lower, upper = low * width, (low + 1) * width
    expected = lower + width * (1.0 - abs(t % 2.0 - 1.0))
    value = lower + width * t
    assert reflected(value, lower, upper) == expected
    assert put(CODES["reflect"], value, lower, (lower, upper)) == expected


@settings(deadline=None)
@given(sixteenths, scales)
def test_velocity_turns_round_with_each_reflection(t: float, width: float) -> None:
    reflections = max(math.ceil(t) - 1, 0) if t > 0 else math.ceil(-t)
    velocity = turned(CODES["reflect"], 3.0, width * t, 0.0, width)
    assert velocity == 3.0 * (-1) ** reflections
    if t % 1.0:  # Between the turns it is the slope of the wave.
        h = width / 64
        ahead, behind = (reflected(width * t + s, 0.0, width) for s in (h, -h))
        assert (ahead - behind) / (2 * h) == velocity / 3.0


@settings(deadline=None)
@given(st.integers(0, 16), sixteenths)
def test_midpoint_is_half_the_way_to_the_bound(origin: int, t: float) -> None:
    lower, upper, start = -1.0, 1.0, -1.0 + origin / 8
    value = lower + 2.0 * t
    put_back = put(CODES["midpoint"], value, start, (lower, upper))
    if lower <= value <= upper:
        assert put_back == value
    else:
        bound = lower if value < lower else upper
        assert put_back == (start + bound) / 2


@pytest.mark.parametrize("name", ["clip", "absorb"])
def test_clip_and_absorb_stop_at_the_bound(name: str) -> None:
    for value, expected in ((-9.0, -1.0), (9.0, 2.0), (np.inf, 2.0), (-np.inf, -1.0)):
        assert put(CODES[name], value, 0.0, (-1.0, 2.0)) == expected


@pytest.mark.parametrize("fraction", [0.0, 0.25, 1.0 - 2.0**-53])
def test_redrawn_values_are_where_the_number_drawn_says(fraction: float) -> None:
    drawn = repair(CODES["redraw"], 7.0, 0.0, 2.0, 4.0, fraction)
    assert drawn == 2.0 + 2.0 * fraction
    for name, code in CODES.items():
        assert repair(code, 3.0, 2.0, 2.0, 4.0, fraction) == 3.0  # inside
        if name != "redraw":
            outside = {repair(code, 7.0, 2.0, 2.0, 4.0, f) for f in (fraction, 0.5)}
            assert len(outside) == 1


@settings(deadline=None)
@given(
    st.sampled_from(HOLDING),
    anything,
    st.sampled_from([(-1.0, 2.0), (0.0, 5e-324), (1e308, 1.7e308), (-8e307, 9e307)]),
    st.floats(0.0, 1.0),
)
def test_whatever_comes_in_a_value_in_the_box_comes_out(
    rule: int, value: float, box: tuple[float, float], where: float
) -> None:
    lower, upper = box
    origin = min(lower + (upper - lower) * where, upper)
    inside = put(rule, value, origin, box)
    assert lower <= inside <= upper
    if lower <= value <= upper:
        assert inside == value


@settings(deadline=None)
@given(st.sampled_from(sorted(CODES.values())), anything, st.floats(-1e9, 1e9))
def test_a_fixed_variable_stays_and_stands_still(
    rule: int, value: float, bound: float
) -> None:
    assert put(rule, value, bound, (bound, bound)) == bound
    assert turned(rule, -3.0, value, bound, bound) == 0.0
    assert reflected(value, bound, bound) == bound


@settings(deadline=None)
@given(st.sampled_from(sorted(CODES.values())), st.floats(-1.0, 2.0))
def test_inside_nothing_changes(rule: int, value: float) -> None:
    assert put(rule, value, 0.0, (-1.0, 2.0)) == value
    assert turned(rule, -3.0, value, -1.0, 2.0) == -3.0


@settings(deadline=None)
@given(st.floats(allow_nan=False))
def test_none_lets_everything_through(value: float) -> None:
    assert put(NONE, value, 0.0, (-1.0, 2.0)) == value
    assert math.isnan(put(NONE, np.nan, 0.0, (-1.0, 2.0)))


@pytest.mark.parametrize("value", [-1.5, 2.5, 100.0, np.inf, -np.inf])
@pytest.mark.parametrize("name", NAMES)
def test_velocity_outside_is_kept_turned_or_lost(name: str, value: float) -> None:
    velocity = turned(CODES[name], 3.0, value, -1.0, 2.0)
    if name in ("clip", "none"):
        assert velocity == 3.0
    elif name == "reflect" and math.isfinite(value):
        assert abs(velocity) == 3.0
    else:
        assert velocity == 0.0


@pytest.mark.parametrize("name", ["absorb", "reflect", "midpoint", "redraw"])
def test_velocity_that_is_not_a_number_is_lost(name: str) -> None:
    assert turned(CODES[name], np.nan, np.nan, -1.0, 2.0) == 0.0
