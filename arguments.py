"""Checks of what a caller gives, made at the door of a public function or class.

    @checked(refusal, steps=a_count(least=1), dt=a_number(above=0), x0=reals())

A decorated function looks at its arguments by their names before its body runs, and a
decorated class before it is constructed. A refused value raises `refusal(name, value,
allowed)`, the error of the room, so nothing fails later with an error of Python. A
check says what type and range a value must have by itself; conditions on several values
together are checked in the body. A check takes less than a microsecond, of an array
somewhat more.
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
    """Return a check for integers of Python or NumPy in [least, most]; no bools."""

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
    """Return a check for real numbers in a range; no bools.

    Args:
        least: Smallest allowed number.
        above: Every allowed number is larger than this one.
        most: Largest allowed number.
        below: Every allowed number is smaller than this one.
        finite: Whether infinities and NaN are refused.
        nan: Whether NaN is accepted, because a later check has its own error for it.
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
    """Return a check for real numbers: an array, a list or one number.

    Args:
        finite: Whether NaN and infinities are refused.
        axes: Number of axes of the array; None for any.
        array: Whether the value must be a NumPy array.
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
    """Return a check for text of at most `longest` characters."""
    return Check(
        lambda value: isinstance(value, str) and len(value) <= longest,
        f"text of at most {longest} characters",
    )


def choice(allowed: Collection[str]) -> Check:
    """Return a check for one of the texts `allowed`."""
    return Check(
        lambda value: isinstance(value, str) and value in allowed,
        f"one of {', '.join(allowed)}",
    )


def of_kind(types: Any, words: str) -> Check:
    """Return a check for instances of a class, a union, or one of several classes."""
    return Check(lambda value: isinstance(value, types), words)


def optional(check: Check) -> Check:
    """Return a check that accepts None and what another check accepts."""
    accepts = check.accepts
    return Check(
        lambda value: value is None or accepts(value), f"None or {check.allowed}"
    )


def either(first: Check, second: Check) -> Check:
    """Return a check that accepts what one of two checks accepts."""
    one, other = first.accepts, second.accepts
    return Check(
        lambda value: one(value) or other(value), f"{first.allowed} or {second.allowed}"
    )


def several(check: Check, words: str) -> Check:
    """Return a check for a sequence or vector of what `check` accepts; no text."""
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
    """Return a check for a mapping whose keys and values pass checks; None: any."""

    def accepts(given: Any) -> bool:
        if not isinstance(given, Mapping):
            return False
        return (keys is None or all(map(keys.accepts, given))) and (
            values is None or all(map(values.accepts, given.values()))
        )

    return Check(accepts, words)


UNITS = mapping(text(), text(), words="a mapping from names to units")


def function(words: str = "a function") -> Check:
    """Return a check for callable objects other than classes."""
    return Check(lambda value: callable(value) and not isinstance(value, type), words)


def having(*names: str, words: str) -> Check:
    """Return a check for objects other than classes with the attributes `names`."""
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
