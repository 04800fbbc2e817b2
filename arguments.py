"""Checks of what a caller gives, made at the door of a public function or class.

    @checked(refusal, steps=a_count(least=1), dt=a_number(above=0), x0=reals())

A decorated function looks at its arguments by their names before its body runs, and a
decorated class before it is constructed. What is refused ends in `refusal(name, value,
allowed)`, the error of the room, so nothing fails inside with an error of Python. A
check says what type and range a value must have by itself; what depends on other values
is checked inside. Each costs less than a microsecond, an array some more.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from swarmstart.errors import InvalidArgumentError, SwarmstartError

Refusal = Callable[[str, object, str], SwarmstartError]
"""(name, value, allowed) -> the error to be raised."""
T = TypeVar("T", bound=Callable[..., Any])

MOST = 2**31 - 1
"""Largest count of what is kept in memory, such as individuals, steps or threads."""
MOST_WORK = 2**62 - 1
"""Largest count of what is only counted, such as evaluations: two add up in 64 bits."""


@dataclass(frozen=True, slots=True)
class Check:
    """A check of one value.

    Attributes:
        accepts: Function of the value that returns whether it is allowed; raises
            nothing.
        allowed: What is allowed, in words.
    """

    accepts: Callable[[Any], bool]
    allowed: str


def checked(
    refusal: Refusal = InvalidArgumentError, **checks: Check
) -> Callable[[T], T]:
    """Return a decorator that checks arguments before a function or a class is called.

    Args:
        refusal: Makes the error that is raised.
        checks: Name of an argument -> its check. A value that is left out is not
            checked.
    """

    def decorator(thing: T) -> T:
        if isinstance(thing, type):
            # The class stays itself, so that isinstance and subclasses work.
            # A NamedTuple is made by __new__.
            maker = "__new__" if issubclass(thing, tuple) else "__init__"
            setattr(thing, maker, decorator(getattr(thing, maker)))
            return thing
        accepts = {name: check.accepts for name, check in checks.items()}
        # Three times as fast as the signature: a hundred doors are made at import.
        code = inspect.unwrap(thing).__code__
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if unknown := checks.keys() - {*names}:
            raise TypeError(f"no arguments of {thing.__qualname__}: {sorted(unknown)}")

        @functools.wraps(thing)
        def door(*args: Any, **named: Any) -> Any:
            # Too many arguments are left to Python, which says so.
            for name, value in chain(zip(names, args, strict=False), named.items()):
                if name in accepts and not accepts[name](value):
                    raise refusal(name, value, checks[name].allowed)
            return thing(*args, **named)

        return door  # type: ignore[return-value]

    return decorator


def _is(value: object, types: Any) -> bool:
    """Return whether a value is of a type; a bool, an int in Python, is not."""
    return not isinstance(value, bool) and isinstance(value, types)


def a_count(*, least: int = 0, most: float = MOST) -> Check:
    """Integers of Python or NumPy in [least, most]; a bool is none."""

    def accepts(value: Any) -> bool:
        # The usual type needs no search among the others.
        if type(value) is not int and not _is(value, int | np.integer):
            return False
        return bool(least <= value <= most)

    words = f"an integer of at least {least}"
    return Check(accepts, words if most >= MOST else f"{words} and at most {most}")


def a_number(
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
    below: float = math.inf,
    finite: bool = True,
    nan: bool = False,
) -> Check:
    """Real numbers in a range; a bool is none.

    Args:
        least: Smallest number.
        above: Number that all are larger than.
        most: Largest number.
        below: Number that all are smaller than.
        finite: Whether infinities are refused, and NaN as well.
        nan: Whether NaN is accepted, for an error of its own that follows.
    """

    def accepts(value: Any) -> bool:
        # As in a_count.
        if type(value) is not float and not _is(value, Real):
            return False
        try:
            real = float(value)
        except OverflowError:
            return False
        if math.isnan(real) or (finite and math.isinf(real)):
            return nan and math.isnan(real)
        # Infinities mean no limit, and are allowed if finite is False.
        return least <= real <= most and (
            (real > above or above == -math.inf) and (real < below or below == math.inf)
        )

    words = "a finite number" if finite else "a number"
    low, high = max(least, above), min(most, below)
    if math.isfinite(low) and math.isfinite(high):
        opens, closes = "[" if least >= above else "(", "]" if most <= below else ")"
        words = f"a number in {opens}{low:g}, {high:g}{closes}"
    elif math.isfinite(low):
        words += f" of at least {low:g}" if least >= above else f" above {low:g}"
    elif math.isfinite(high):
        words += f" of at most {high:g}" if most <= below else f" below {high:g}"
    return Check(accepts, words)


def reals(
    *, finite: bool = False, axes: int | None = None, array: bool = False
) -> Check:
    """Real numbers in an array, a list or alone; text and complex numbers are none.

    Args:
        finite: Whether NaN and infinities are refused.
        axes: Number of axes; None for any.
        array: Whether it must be a NumPy array.
    """

    def accepts(value: Any) -> bool:
        if array and not isinstance(value, np.ndarray):
            return False
        try:
            numbers = np.asarray(value)
            return (
                numbers.dtype.kind in "biuf"
                and (axes is None or numbers.ndim == axes)
                and (not finite or bool(np.isfinite(numbers).all()))
            )
        except (TypeError, ValueError, OverflowError, NotImplementedError):
            return False

    words = "an array of" if array or axes else "an array or a list of"
    words += " finite numbers" if finite else " real numbers"
    return Check(
        accepts,
        words
        if axes is None
        else f"{words} with {axes} {'axis' if axes == 1 else 'axes'}",
    )


def text(*, longest: int = 1000) -> Check:
    """Text of at most so many characters."""
    return Check(
        lambda value: isinstance(value, str) and len(value) <= longest,
        f"text of at most {longest} characters",
    )


def choice(allowed: Collection[str]) -> Check:
    """One of some words."""
    return Check(
        lambda value: isinstance(value, str) and value in allowed,
        f"one of {', '.join(allowed)}",
    )


def of_kind(types: Any, words: str) -> Check:
    """Instances of a class, of a union, or of one of several classes."""
    return Check(lambda value: isinstance(value, types), words)


def optional(check: Check) -> Check:
    """None, or what another check accepts."""
    accepts = check.accepts
    return Check(
        lambda value: value is None or accepts(value), f"None or {check.allowed}"
    )


def either(first: Check, second: Check) -> Check:
    """What one of two checks accepts."""
    one, other = first.accepts, second.accepts
    return Check(
        lambda value: one(value) or other(value), f"{first.allowed} or {second.allowed}"
    )


def several(check: Check, words: str) -> Check:
    """A sequence or a vector of what another check accepts; text is none."""
    accepts = check.accepts

    def accept_all(values: Any) -> bool:
        if isinstance(values, np.ndarray):
            # One without axes cannot be iterated over; an empty one has only a type.
            known = values if values.size else np.zeros(1, values.dtype)
            return values.ndim > 0 and all(map(accepts, known))
        is_text = isinstance(values, str | bytes)
        return (
            isinstance(values, Sequence) and not is_text and all(map(accepts, values))
        )

    return Check(accept_all, words)


def mapping(
    keys: Check | None = None, values: Check | None = None, *, words: str
) -> Check:
    """A mapping whose keys and values other checks accept; None for any."""

    def accepts(given: Any) -> bool:
        if not isinstance(given, Mapping):
            return False
        return (keys is None or all(map(keys.accepts, given))) and (
            values is None or all(map(values.accepts, given.values()))
        )

    return Check(accepts, words)


UNITS = mapping(text(), text(), words="a mapping from names to units")


def function(words: str = "a function") -> Check:
    """What can be called, and is no class."""
    return Check(lambda value: callable(value) and not isinstance(value, type), words)


def having(*names: str, words: str) -> Check:
    """Objects, no classes, that have some attributes."""
    return Check(
        lambda value: (
            not isinstance(value, type) and all(hasattr(value, name) for name in names)
        ),
        words,
    )


PATH = either(text(longest=4000), of_kind(Path, "a path"))
FLAG = of_kind((bool, np.bool_), "True or False")
RNG = of_kind(np.random.Generator, "a numpy.random.Generator")


NAMES = several(text(), "a sequence of names")
INDICES = several(a_count(), "a sequence of integers of at least 0")
_PARTS = a_count(most=math.inf)
SEED = Check(
    either(_PARTS, several(_PARTS, "")).accepts,
    "an integer of at least 0, or a sequence of them",
)
