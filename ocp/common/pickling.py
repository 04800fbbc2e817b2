"""Pickles of objects that hold CasADi expressions or compiled functions.

CasADi pickles an expression only within a context of its own, and compiled code cannot
be pickled at all. So an object is pickled as what it was made of, and made again when
it is loaded. It is then validated as any new object, and its caches are empty.

    Rebuilt     a dataclass: its class and its fields
    Expressed   a dataclass with expressions: as one string of bytes, in which all its
                expressions stand side by side, so that they keep their common symbols
    Called      any other class: the arguments that it was called with
"""

import copy
import pickle
from collections.abc import Callable
from dataclasses import fields
from io import BytesIO
from types import MappingProxyType
from typing import Any, Self

import casadi as ca

Arguments = tuple[tuple[Any, ...], dict[str, Any]]


class Rebuilt:
    """Base of dataclasses that are copied and pickled by their fields."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Return how to make the object again."""
        return made, (type(self), (), self._given())

    def _given(self) -> dict[str, Any]:
        """Return the fields that the constructor takes."""
        given = {one.name: getattr(self, one.name) for one in fields(self) if one.init}  # type: ignore[arg-type]
        # Python cannot pickle the view of a mapping.
        return {
            name: dict(value) if isinstance(value, MappingProxyType) else value
            for name, value in given.items()
        }


class Expressed(Rebuilt):
    """Base of dataclasses that are copied and pickled with their expressions.

    Expressions that have a symbol in common still have it in common in a loaded pickle
    and in a copy.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Return how to load the object from bytes."""
        return loaded, dumped(self)

    def __copy__(self) -> Self:
        """Return the object made again, with the same symbols."""
        again: Self = made(type(self), (), self._given())
        return again

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return the object made again from copies, with the same symbols."""
        again: Self = made(type(self), (), copy.deepcopy(self._given(), memo))
        return again


class Called:
    """Base of classes that are pickled by the arguments that they were called with.

    A copy shares all functions with the original.
    """

    _called_with: Arguments

    def __new__(cls, *args: Any, **named: Any) -> Self:
        """Keep the arguments; lists and mappings of them are copied."""
        self = super().__new__(cls)
        self._called_with = (
            tuple(map(_unshared, args)),
            {name: _unshared(value) for name, value in named.items()},
        )
        return self

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Return how to make the object again."""
        return made, (type(self), *self._called_with)

    def __copy__(self) -> Self:
        """Return a copy that shares all attributes."""
        again = object.__new__(type(self))
        again.__dict__.update(vars(self))
        return again

    def _call_with(self, **named: Any) -> None:
        """Replace arguments of which a copy was changed."""
        args, before = self._called_with
        self._called_with = args, before | named


def _unshared(value: Any) -> Any:
    """Return a copy of a list or a mapping, else the value itself."""
    return copy.copy(value) if isinstance(value, list | dict) else value


def made(kind: Callable[..., Any], args: tuple[Any, ...], named: dict[str, Any]) -> Any:
    """Return a new object of a class."""
    return kind(*args, **named)


def dumped(thing: object) -> tuple[bytes, str]:
    """Return an object as a pickle, and its expressions in CasADi's own format."""
    buffer = BytesIO()
    pickler = _Pickler(buffer)
    pickler.dump(thing)
    return buffer.getvalue(), pickler.packed()


def loaded(pickled: bytes, packed: str) -> Any:
    """Return the object that was dumped."""
    return _Unpickler(pickled, packed).load()


class _Pickler(pickle.Pickler):
    """Pickler that leaves expressions out and collects them."""

    def __init__(self, file: BytesIO) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._numbers = dict[int, int]()
        self._found = list[ca.SX | ca.MX]()

    def persistent_id(self, thing: Any) -> int | None:
        """Return the number of an expression; None for other objects."""
        if not isinstance(thing, ca.SX | ca.MX):
            return None
        number = self._numbers.setdefault(id(thing), len(self._found))
        if number == len(self._found):
            # The list also keeps it alive, so that no other gets its id.
            self._found.append(thing)
        return number

    def reducer_override(self, thing: Any) -> Any:
        """Return how to pickle an `Expressed` object within a larger pickle.

        Its expressions are stored together with those of the other objects, so that
        they keep their common symbols. NotImplemented for an object of another class.
        """
        # Not by its own bytes: its symbols would differ from those around it.
        return Rebuilt.__reduce__(thing) if isinstance(thing, Expressed) else (
            NotImplemented
        )  # fmt: skip

    def packed(self) -> str:
        """Return all expressions that were found."""
        # One stream for all: a symbol that occurs again stays the same one.
        stream = ca.StringSerializer()
        for expression in self._found:
            stream.pack(expression)
        found: str = stream.encode()
        return found


class _Unpickler(pickle.Unpickler):
    """Unpickler that puts expressions in."""

    def __init__(self, pickled: bytes, packed: str) -> None:
        super().__init__(BytesIO(pickled))
        self._stream = ca.StringDeserializer(packed)
        self._found = list[ca.SX | ca.MX]()

    def persistent_load(self, number: int) -> ca.SX | ca.MX:
        """Return an expression by its number."""
        while len(self._found) <= number:
            self._found.append(self._stream.unpack())
        return self._found[number]
