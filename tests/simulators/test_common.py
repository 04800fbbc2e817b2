"""Units are compared by their parts, and those that cannot be read are not compared."""

import pytest

from swarmstart.simulators.common import SimulatorError, require_units


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [("m/s", "m.s-1"), ("m/s^2", "m/s2"), ("m/s**2", "m.s-2"), ("N.m", "N*m"),
     ("1/s", "s-1"), ("kg.m2/s2", "kg·m2/s2"), ("rad", ""), ("", "rad"),
     ("turns of a wheel", "rad/s"), ("%", "%"), ("m/m", "1")],
)  # fmt: skip
def test_the_same_units_in_other_words_agree(ours: str, theirs: str) -> None:
    require_units("one", {"x": ours}, {"x": theirs})


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("rad", "deg"),
        ("m/s", "km/h"),
        ("degrees per hour", "rad/s"),
        ("m/s", "m/s2"),
        ("s", "1/s"),
        ("N.m", "N/m"),
    ],
)
def test_other_units_are_refused(ours: str, theirs: str) -> None:
    with pytest.raises(SimulatorError, match=r"expected x in .*; found "):
        require_units("one", {"x": ours, "y": "m"}, {"x": theirs})
