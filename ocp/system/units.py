"""Units of a model: their check against the equations; pint reads the texts.

A unit is a text at a state, a control or an output; time is in seconds. Plain numbers
and parameters without a unit may have any unit, so that a product with one of them is
not checked. Everything else is compared: the terms of a sum, the argument of a function
such as the sine, and each rate with its state.
"""

from __future__ import annotations

import functools
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import casadi as ca

from swarmstart.ocp.common.messages import Paragraph
from swarmstart.tape import Node, Tape, UnknownOperationError, read_tape

_POWER = re.compile(r"(?<=[^\W\d_])(-?\d)")
"""The power in m2, as the standard of FMUs writes it."""
_SAME = 1e-9
_TIMES = {60.0, 3600.0, 86400.0, 31557600.0}
"""A minute, an hour, a day, a year [s]: a model may count its time in any of them."""
_EQUAL = ("add", "sub", "fmin", "fmax", "hypot", "fmod", "remainder", "copysign")
_KEPT = ("neg", "fabs", "floor", "ceil", "twice")
_NUMBERS = (
    "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "erf", "sinh", "cosh",
    "tanh", "asinh", "acosh", "atanh", "log1p", "expm1",
)  # fmt: skip
"""Functions of a number without unit, and angles in radians are such."""
_COMPARED = ("lt", "le", "eq", "ne", "and", "or", "not", "sign", "atan2")
"""Functions of values in one unit that return a number."""
_POWERS = {"sq": Fraction(2), "sqrt": Fraction(1, 2), "inv": Fraction(-1)}


class UnitWarning(UserWarning):
    """Units of a model contradict each other in an equation."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit as a factor and powers of the base units.

    Attributes:
        factor: Size of the unit in base units, above 0.
        powers: Name of a base unit -> its power, none of them 0; radians are left out.
        text: Text that the unit was read from; empty for a computed unit.
    """

    factor: float
    powers: frozenset[tuple[str, Fraction]] = frozenset()
    text: str = field(default="", compare=False)

    def __str__(self) -> str:
        """Return the text of the unit, or else its factor and base units."""
        if self.text:
            return self.text
        words = [
            name if power == 1 else f"{name}^{power}"
            for name, power in sorted(self.powers)
        ]
        number = [] if self.is_size(1.0) and words else [f"{self.factor:.6g}"]
        return " ".join([*number, *words])

    def is_size(self, factor: float) -> bool:
        """Return whether the unit's factor is a given number."""
        return abs(self.factor / factor - 1) < _SAME

    def is_like(self, other: Unit) -> bool:
        """Return whether another unit is the same one, however they are written."""
        return self.powers == other.powers and self.is_size(other.factor)

    def times(self, other: Unit, power: int = 1) -> Unit:
        """Return the product with a power of another unit."""
        powers = dict(self.powers)
        for name, one in other.powers:
            powers[name] = powers.get(name, Fraction(0)) + power * one
        return Unit(self.factor * other.factor**power, _nonzero(powers))

    def to(self, power: Fraction) -> Unit:
        """Return a power of the unit."""
        powers = {name: one * power for name, one in self.powers}
        return Unit(self.factor ** float(power), _nonzero(powers))


_ONE = Unit(1.0)


class UnlikeUnitsError(ValueError):
    """Unlike units are added or compared, or a function has a wrong unit."""


def read_unit(text: str) -> Unit | None:
    """Return a unit from its text, such as "m/s^2", "N m", "deg C" or "kg.m2/s2".

    Args:
        text: The text.

    Returns:
        The unit; for a temperature, the unit of its differences. None if the text is
        empty or not a unit that pint knows: such a text is only a label.
    """
    plain = text.strip().replace("·", "*").replace("deg C", "delta_degC")
    # pint would read two strokes as one whole division.
    if plain in ("", "-") or "//" in plain:
        return None
    return _read(_POWER.sub(r"^\1", plain.replace(".", "*")), text.strip())


@functools.cache
def _read(plain: str, text: str) -> Unit | None:
    registry = _registry()
    try:
        factor, base = registry.get_base_units(
            registry.parse_units(plain, as_delta=True)
        )
        powers = {
            str(name): Fraction(power).limit_denominator(60)
            for name, power in base._units.items()
            if name != "radian"
        }
    except Exception:  # noqa: BLE001 - pint raises many kinds for what is no unit
        return None
    return Unit(float(factor), _nonzero(powers), text)


@functools.cache
def _registry() -> Any:
    """Return pint's units; loading them takes a second."""
    import pint

    return pint.UnitRegistry()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Equations:
    """Equations, and the names and units of the quantities in them.

    Attributes:
        symbols: Symbol of each quantity, a column.
        names: Name of each symbol in order. If there is one symbol more than names, the
            last symbol is the time [s].
        units: Unit by name, as text.
        kinds: Kind of equation, such as "rate" -> the names of the quantities whose
            units are compared, and the expressions.
    """

    symbols: ca.SX
    names: Sequence[str]
    units: Mapping[str, str]
    kinds: Mapping[str, tuple[Sequence[str], ca.SX]]


def warn_of_units(conflicts: Sequence[str]) -> None:
    """Warn of units that contradict each other, at the line of the user's call."""
    for words in conflicts:
        warnings.warn(
            f"{words} (more: {Paragraph.UNITS})",
            UnitWarning,
            stacklevel=4,  # The user's call, such as that of solve.
        )


def conflicts_of(equations: Equations) -> tuple[str, ...]:
    """Return a sentence for each equation whose units contradict each other.

    Args:
        equations: The equations.

    Returns:
        Sentences such as "the rate of x is in m/s^2, expected m/s: x is in m". A rate
        per minute, hour, day or year instead of per second is no conflict.
    """
    known = [read_unit(equations.units.get(name, "")) for name in equations.names]
    known += [read_unit("s")] * (equations.symbols.numel() - len(known))
    rows = [rows for _, rows in equations.kinds.values()]
    try:
        tape = read_tape(ca.Function("equations", [equations.symbols], rows))
    except (RuntimeError, UnknownOperationError):  # No formula.
        return ()
    found, units = _units_of(tape, known)
    for (kind, (names, _)), numbers in zip(
        equations.kinds.items(), tape.outputs, strict=True
    ):
        for name, number in zip(names, numbers, strict=False):
            stated = read_unit(equations.units.get(name, ""))
            found += _compared(kind, name, stated, units[number])
    return tuple(dict.fromkeys(found))


def _compared(
    kind: str, name: str, stated: Unit | None, found: Unit | None
) -> list[str]:
    """Return a sentence if the unit of an equation is not what a name's unit asks."""
    if stated is None or found is None:
        return []
    expected, is_right = stated, found.is_like(stated)
    if kind == "rate":
        expected, is_right = _rate_of(stated, found)
    if is_right:
        return []
    return [
        f"the {kind} of {name} is in {found}, expected "
        f"{_named(expected, stated, kind)}: {name} is in {stated}"
    ]


def _named(expected: Unit, stated: Unit, kind: str) -> str:
    """Return how an expected unit is written."""
    if kind != "rate":
        return str(expected)
    return f"({stated})/s" if re.search(r"[\s/*.]", str(stated)) else f"{stated}/s"


def _rate_of(stated: Unit, rate: Unit) -> tuple[Unit, bool]:
    """Return the rate's unit, and whether a rate has it in some unit of time."""
    per_second = stated.times(Unit(1.0, frozenset({("second", Fraction(1))})), -1)
    if rate.powers != per_second.powers:
        return per_second, False
    ratio = per_second.factor / rate.factor
    return per_second, any(abs(ratio / one - 1) < _SAME for one in (1.0, *_TIMES))


def _units_of(
    tape: Tape, known: Sequence[Unit | None]
) -> tuple[list[str], list[Unit | None]]:
    """Return what is wrong within the equations, and the unit of each value."""
    units: list[Unit | None] = []
    found = []
    for node in tape.nodes:
        unit = None
        if node.operation == "input":
            unit = known[node.arguments[1]]
        elif node.operation != "constant":
            given = [units[number] for number in node.arguments]
            try:
                unit = _result(node, given, tape)
            except UnlikeUnitsError as error:
                found.append(str(error))
        units.append(unit)
    return found, units


def _result(node: Node, given: list[Unit | None], tape: Tape) -> Unit | None:
    """Return the unit of an operation's result; None if nothing is known of it."""
    operation, first = node.operation, given[0]
    if operation in _EQUAL:
        return _alike(given)
    if operation in _NUMBERS:
        return _of_number(operation, first)
    if operation in _COMPARED:
        _alike(given)
        return _ONE
    if operation == "if_else_zero":
        return given[1]
    if first is None or operation in _KEPT:
        return first
    return _of_powers(node, first, given[-1], tape)


def _of_powers(node: Node, first: Unit, last: Unit | None, tape: Tape) -> Unit | None:
    """Return the unit of a product, a quotient or a power."""
    operation = node.operation
    if operation in _POWERS:
        return first.to(_POWERS[operation])
    if operation in ("pow", "constpow"):
        power = tape.nodes[node.arguments[1]]
        if power.operation == "constant":
            return first.to(Fraction(power.value).limit_denominator(60))
        return None
    if operation in ("mul", "div") and last is not None:
        return first.times(last, 1 if operation == "mul" else -1)
    return None


def _alike(given: Sequence[Unit | None]) -> Unit | None:
    """Return the unit of a sum.

    Raises:
        UnlikeUnitsError: If two of its terms are in different ones.
    """
    units = [one for one in given if one is not None]
    for one in units[1:]:
        if not one.is_like(units[0]):
            raise UnlikeUnitsError(f"{units[0]} and {one} are added or compared")
    return units[0] if units else None


def _of_number(operation: str, unit: Unit | None) -> Unit:
    """Return the unit of a function of a number.

    Raises:
        UnlikeUnitsError: If its argument has a unit.
    """
    if unit is not None and not unit.is_like(_ONE):
        raise UnlikeUnitsError(
            f"{operation} is taken of a value in {unit}, expected a number or radians"
        )
    return _ONE


def _nonzero(powers: Mapping[str, Fraction]) -> frozenset[tuple[str, Fraction]]:
    return frozenset((name, power) for name, power in powers.items() if power)
