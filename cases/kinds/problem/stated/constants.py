"""Constants of a file, used in its lengths of time, tables over time and tolerances."""

from collections.abc import Mapping
from typing import Any

from swarmstart.cases.format.expressions import evaluate
from swarmstart.errors import SwarmstartError

_PARTS = ("prediction", "feedback", "phases", "parameters", "signals", "guess", "plant")
_KEYS = ("times", "values", "tolerance", "path_tolerance", "integrator_tolerance")


def with_constants(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario as read, with numbers in place of expressions in constants.

    Replaced are the expressions of lengths in seconds (keys that end in `_s`), of
    tables over time and of tolerances. A text that cannot be evaluated stays as it is,
    and is refused later, with its place. Other numbers stay expressions until the
    problem is built.

    Args:
        given: The scenario, of which nothing is checked yet.
    """
    constants = _values(given.get("constants"), {})
    parts = {key: given[key] for key in _PARTS if key in given}
    return {**given, **{k: _replaced(k, part, constants) for k, part in parts.items()}}


def _values(stated: object, before: Mapping[str, float]) -> dict[str, float]:
    """Return constants as numbers, as far as they are some; each may use those before.

    Args:
        stated: A mapping from names to numbers or expressions, if it is valid.
        before: Constants that they replace or are added to.
    """
    found = dict(before)
    for name, value in stated.items() if isinstance(stated, Mapping) else ():
        number = _number(value, found)
        if isinstance(name, str) and isinstance(number, int | float):
            found[name] = float(number)
    return found


def _replaced(key: str, value: Any, constants: Mapping[str, float]) -> Any:
    """Return a part with the numbers that its expressions are."""
    if isinstance(value, Mapping):
        # A phase has constants of its own.
        known = _values(value.get("constants"), constants)
        return {name: _replaced(name, part, known) for name, part in value.items()}
    if isinstance(value, list):
        return [_replaced(key, part, constants) for part in value]
    if isinstance(key, str) and (key.endswith("_s") or key in _KEYS):
        return _number(value, constants)
    return value


def _number(value: Any, constants: Mapping[str, float]) -> Any:
    """Return the number that an expression is; all else as it is."""
    if not isinstance(value, str):
        return value
    try:
        return evaluate(value, constants)
    except SwarmstartError:
        return value
