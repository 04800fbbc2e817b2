"""The wrong values of the walk over all public calls, and what comes of one call."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from swarmstart.errors import SwarmstartError

WRONG: Mapping[str, object] = {
    "None": None,
    "text": "abc",
    "a number as text": "0.3",
    "bytes": b"x",
    "complex": 1 + 2j,
    "complex array": np.array([1 + 2j, 0.5j]),
    "NaN": float("nan"),
    "inf": float("inf"),
    "-inf": -float("inf"),
    "NaN array": np.array([np.nan, 1.0]),
    "-1": -1,
    "0": 0,
    "10**30": 10**30,
    "1e300": 1e300,
    "True": True,
    "list": [],
    "mapping": {},
    "tuple": (1, 2, 3),
    "object": object(),
    "function": lambda *_, **__: None,
    "class": int,
    "set": {1, 2},
    "ragged list": [[1], [1, 2]],
    "strings": np.array(["a", "b"]),
    "objects": np.array([object(), None]),
    "empty array": np.zeros(0),
    "three axes": np.zeros((3, 7, 2)),
    "huge text": "x" * 100_000,
}
LONGEST_MESSAGE = 1000
"""Characters of a message that a person still reads."""


@dataclasses.dataclass(frozen=True, slots=True)
class Call:
    """A public function, class or method with valid arguments.

    Attributes:
        thing: What is called.
        valid: Valid arguments by name.
        target: The public function or class that `thing` stands for, for the names of
            its parameters.
        places: Names of arguments that are passed by their place, in order.
    """

    thing: Callable[..., object]
    valid: Mapping[str, Any]
    target: Callable[..., object] | None = None
    places: tuple[str, ...] = ()

    def with_value(self, name: str, value: object) -> object:
        """Call with one argument replaced; steps are run to their end."""
        given = {**self.valid, name: value}
        first = [given.pop(place) for place in self.places]
        found = self.thing(*first, **given)
        return [*found] if isinstance(found, Iterator) else found


Calls = dict[str, Call]


def record(made: Any) -> Call:
    """Return the call that makes a frozen record from the values of its fields."""
    if isinstance(made, tuple):  # A NamedTuple
        return Call(type(made), made._asdict())  # type: ignore[attr-defined]
    fields = dataclasses.fields(made)
    return Call(type(made), {f.name: getattr(made, f.name) for f in fields if f.init})


def with_defaults(thing: Callable[..., object], **valid: Any) -> Call:
    """Return a call with the defaults of all parameters that are not given."""
    parameters = inspect.signature(thing).parameters
    known = {
        name: one.default
        for name, one in parameters.items()
        if one.default is not one.empty
        and "factory" not in type(one.default).__name__.lower()
    }
    return Call(thing, {**known, **valid})


def outcome(call: Call, name: str, value: object) -> str:
    """Return what comes of a wrong value: "refused", "accepted", or a fault in words.

    Args:
        call: The call.
        name: The argument that gets the value.
        value: The value.
    """
    try:
        call.with_value(name, value)
    except SwarmstartError as error:
        said = len(str(error))
        return "refused" if 0 < said < LONGEST_MESSAGE else f"a message of {said}"
    except Exception as error:  # noqa: BLE001 - any error is a finding of the walk
        return f"bare {type(error).__name__}: {error!s:.100}"
    return "accepted"
