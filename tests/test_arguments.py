"""Checks at the door: what each accepts, and that nothing is called after a refusal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from swarmstart.arguments import (
    INDICES,
    NAMES,
    SEED,
    Check,
    a_count,
    a_number,
    checked,
    choice,
    either,
    function,
    having,
    mapping,
    optional,
    reals,
    several,
    text,
)
from swarmstart.errors import InvalidArgumentError

ACCEPTED = [
    (a_count(), (0, 3, np.int64(2)), (-1, 1.0, "1", None, True, 10**30, np.nan)),
    (a_number(least=0, below=1), (0, 0.5, np.float32(0.5)), (1.0, -0.1, True, "0.3")),
    (a_number(above=0), (1e300, 2), (0, math.inf, math.nan, 1 + 2j, 10**400)),
    (a_number(finite=False), (math.inf, -math.inf), (math.nan, None, [1.0])),
    (reals(), ([1, 2], 3.0, ca.DM([1]), [math.nan]), ("1", [1j], [[1], [1, 2]], None)),
    (reals(finite=True), ([1.0],), ([math.nan], [math.inf], 10**30)),
    (reals(array=True, axes=2), (np.eye(2),), ([[1.0]], np.ones(2))),
    (choice(("a", "b")), ("a",), ("c", ["a"], None, np.array(["a", "b"]))),
    (text(), ("", "a"), ("x" * 10**5, b"x", None)),
    (optional(a_count()), (None, 1), ("", -1)),
    (either(a_count(), text()), (1, "a"), (None, -1)),
    (function(), (math.sin,), (int, None, "sin")),
    (mapping(text(), a_count(), words=""), ({"a": 1}, {}), ({1: 1}, {"a": "b"}, [])),
    (INDICES, ((), (0, 1), range(2), np.arange(2)), ((-1,), "01", 3, [0.5], b"x")),
    (NAMES, (["a"], np.array(["a"])), ("a", [1], None)),
    (SEED, (0, 10**30, [1, 2]), (-1, True, "a", None, 0.5, {1}, {}, np.array(1.5))),
]


@pytest.mark.parametrize(("check", "good", "bad"), ACCEPTED)
def test_a_check_accepts_its_values_and_refuses_all_others(
    check: Check, good: tuple[object, ...], bad: tuple[object, ...]
) -> None:
    assert [value for value in good if not check.accepts(value)] == []
    assert [value for value in bad if check.accepts(value)] == []


@checked(size=a_count(least=1), share=a_number(above=0, most=1))
def half(size: int, *, share: float = 0.5) -> float:
    """Return a share of a size."""
    return size * share


@checked(size=a_count(least=1))
@dataclass(frozen=True, slots=True)
class Sized:
    """A size."""

    size: int = 1


@checked(size=a_count(least=1))
class Place(NamedTuple):
    """A size, as a tuple."""

    size: int = 1


def test_arguments_are_checked_by_place_and_by_name() -> None:
    assert half(4) == 2.0 and half(size=4, share=1) == 4.0
    with pytest.raises(InvalidArgumentError) as raised:
        half(-1)
    assert str(raised.value) == "size must be an integer of at least 1, got -1"
    with pytest.raises(InvalidArgumentError, match=r"share .* in \(0, 1\]"):
        half(4, share="0.3")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="unexpected keyword"):
        half(4, other=1)  # type: ignore[call-arg]


@pytest.mark.parametrize("made", [Sized, Place])
def test_a_class_is_checked_before_it_is_constructed(
    made: type[Sized] | type[Place],
) -> None:
    assert made(2).size == made(size=2).size == 2 and made().size == 1
    for wrong in ("abc", 0, None):
        with pytest.raises(InvalidArgumentError, match="size must be an integer"):
            made(wrong)  # type: ignore[arg-type]
    assert isinstance(made(), made)


def test_the_message_of_a_huge_value_is_short() -> None:
    with pytest.raises(InvalidArgumentError) as raised:
        half("x" * 10**6)  # type: ignore[arg-type]
    assert len(str(raised.value)) < 300 and str(raised.value).endswith("...")


def test_a_check_of_an_argument_that_there_is_not_is_refused() -> None:
    with pytest.raises(TypeError, match=r"no arguments of .*: \['weight'\]"):
        checked(weight=a_count())(half)


def test_an_empty_array_is_a_sequence_of_the_elements_of_its_type() -> None:
    accepts = several(a_count(), "counts").accepts
    assert accepts([]) and accepts(np.array([1, 2])) and accepts(np.zeros(0, int))
    assert not accepts(np.zeros(0)) and not accepts(np.array(1))
    assert not accepts(np.zeros(0, dtype=[("count", int)]))


def test_an_object_is_known_by_its_attributes_and_is_no_class() -> None:
    accepts = having("real", "imag", words="a number").accepts
    assert accepts(1.0)
    assert not accepts(float) and not accepts("1")


def test_nan_is_a_number_only_if_its_own_error_follows() -> None:
    nan = float("nan")
    assert not a_number(finite=False).accepts(nan)
    assert a_number(finite=False, nan=True).accepts(nan)
    assert not a_number(above=0, nan=True).accepts(-1.0)
