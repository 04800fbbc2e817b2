"""One seed for all random numbers of a scenario: of its solver and disturbances.

A scenario draws gusts and noise with seeds of its own (any key called `seed`). Run s of
a campaign adds s to each of them. So run 0 is the scenario as it is written, and all
solvers have the same disturbances in runs of the same number.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

SEED = "seed"


def seed_keys(settings: Mapping[str, Any]) -> list[str]:
    """Return the dotted keys of all seeds of a resolved scenario."""
    parts = {name: part for name, part in settings.items() if name != "claims"}
    return [".".join(path) for path, _ in _seeds(parts, ())]


def seeded(settings: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Return a resolved scenario's settings with a number added to each of its seeds.

    Args:
        settings: Plain data; not changed.
        seed: The number of the run, from 0 on.
    """
    return {
        name: part if name == "claims" else _raised(part, seed)
        for name, part in settings.items()
    }


def _seeds(
    part: object, path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], int]]:
    named: Sequence[tuple[str, object]] = ()
    if isinstance(part, Mapping):
        named = [(str(name), inner) for name, inner in part.items()]
    elif isinstance(part, list):
        named = [(str(number), inner) for number, inner in enumerate(part)]
    for name, inner in named:
        if _is_seed(name, inner):
            yield (*path, name), inner  # type: ignore[misc]
        else:
            yield from _seeds(inner, (*path, name))


def _raised(part: object, seed: int) -> object:
    if isinstance(part, Mapping):
        return {
            name: inner + seed if _is_seed(name, inner) else _raised(inner, seed)
            for name, inner in part.items()
        }
    return [_raised(inner, seed) for inner in part] if isinstance(part, list) else part


def _is_seed(name: object, value: object) -> bool:
    return name == SEED and isinstance(value, int) and not isinstance(value, bool)
