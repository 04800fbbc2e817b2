"""Forgeries of certificates: genuine files with a few seeded changes.

Numbers are scaled, negated, made huge or NaN; keys are dropped, doubled, retyped;
statements are rewritten. Other changes are those that a forger would make: a larger
level, a narrower bound, an indefinite P, smaller margins. The digest is kept or
computed anew.
"""

import copy
import hashlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np

Content = dict[str, Any]
Path = tuple[str | int, ...]
Rng = np.random.Generator

FACTORS = (
    0.0, -1.0, 0.5, 2.0, 1 + 1e-9, 1 - 1e-9, 1.02, 0.9, 10.0, 0.1, 1e3, 1e-3, 1e9,
    1e-300, 1e300,
)  # fmt: skip
VALUES: tuple[object, ...] = (
    float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, 0, -0.0, 2**63,
    10**400, 2**53 + 1, True, None, "1", "", [], {}, [[1.0]], "\x1b[2J\x1b]0;x\x07",
    "\u202e\ud800\x00", "proven", -1, 10_000, 1e-9,
)  # fmt: skip
TEXTS = (
    "safe in every weather", "e'Pe falls by more than e'Q_m e a second", "proven",
    "\x1b[31mproven\x1b[0m", "a" * 100_000, "\u0441losed form", "\x9b2J",
)  # fmt: skip


def forgery(genuine: Content, rng: Rng) -> bytes:
    """Return the bytes of a forged file.

    Args:
        genuine: The content of a certificate.
        rng: Source of randomness of the changes.
    """
    content = copy.deepcopy(genuine)
    for _ in range(int(rng.integers(1, 4))):
        # Most changes at random places are refused for their shape alone.
        changes = ANYTHING if rng.random() < 0.35 else ON_PURPOSE
        changes[int(rng.integers(len(changes)))](content, rng)
    if rng.random() < 0.85:
        content["sha256"] = _digest(content)
    text = json.dumps(content, indent=None if rng.random() < 0.5 else 1)
    data = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.15:
        data = BYTES[int(rng.integers(len(BYTES)))](data, rng)
    return data


def _digest(content: Content) -> str:
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _places(value: object, path: Path = ()) -> list[Path]:
    """Return the paths of all entries but the root."""
    if isinstance(value, dict):
        items: list[tuple[str | int, object]] = list(value.items())
    elif isinstance(value, list):
        items = list(enumerate(value))
    else:
        return []
    found = [(*path, key) for key, _ in items]
    for key, entry in items:
        found += _places(entry, (*path, key))
    return found


def _any_place(
    content: Content, rng: Rng, wanted: Callable[[object], bool] = lambda value: True
) -> tuple[Any, str | int]:
    """Return a container and a key of it whose value is wanted."""
    places = [path for path in _places(content) if wanted(_at(content, path))]
    if not places:
        return {"": 0.0}, ""  # Nothing of the kind is left: change a dummy.
    path = places[int(rng.integers(len(places)))]
    return _at(content, path[:-1]), path[-1]


def _at(content: Content, path: Path) -> Any:
    value: Any = content
    for key in path:
        value = value[key]
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _scale(content: Content, rng: Rng) -> None:
    place, key = _any_place(content, rng, _is_number)
    try:
        place[key] = place[key] * FACTORS[int(rng.integers(len(FACTORS)))]
    except OverflowError:
        place[key] = 0.0


def _replace(content: Content, rng: Rng) -> None:
    place, key = _any_place(content, rng)
    place[key] = VALUES[int(rng.integers(len(VALUES)))]


def _drop(content: Content, rng: Rng) -> None:
    place, key = _any_place(content, rng)
    del place[key]


def _add(content: Content, rng: Rng) -> None:
    place, _ = _any_place(content, rng)
    extra = VALUES[int(rng.integers(len(VALUES)))]
    if isinstance(place, list):
        place.append(extra)
    else:
        place[("beta", "\x1b[1m", "")[int(rng.integers(3))]] = extra


def _swap(content: Content, rng: Rng) -> None:
    one, first = _any_place(content, rng, lambda value: not isinstance(value, dict))
    other, second = _any_place(content, rng, lambda value: not isinstance(value, dict))
    # Copies: a list must not come to hold itself.
    held = copy.deepcopy(one[first])
    one[first], other[second] = copy.deepcopy(other[second]), held


def _nest(content: Content, rng: Rng) -> None:
    place, key = _any_place(content, rng)
    for _ in range((2, 50)[int(rng.integers(2))]):
        place[key] = [place[key]]


def _rewrite(content: Content, rng: Rng) -> None:
    place, key = _any_place(content, rng, lambda value: isinstance(value, str))
    place[key] = TEXTS[int(rng.integers(len(TEXTS)))]


def _enlarge(content: Content, rng: Rng) -> None:
    _multiply(content, ("alpha",), float(rng.choice([1.02, 1.2, 2.0, 10.0, 1e6])))
    content["refuted"] = None


def _multiply(content: Content, path: Path, factor: float) -> None:
    """Scale one number, if it is there and still is one."""
    try:
        place = _at(content, path[:-1])
        place[path[-1]] = place[path[-1]] * factor
    except (KeyError, IndexError, TypeError, OverflowError):
        return


def _narrow(content: Content, rng: Rng) -> None:
    bounds = content.get("bounds")
    if not isinstance(bounds, dict) or not bounds:
        return
    side = bounds[sorted(bounds)[int(rng.integers(len(bounds)))]]
    if isinstance(side, list) and side:
        side[int(rng.integers(len(side)))] = float(rng.choice([-1, 1])) * float(
            rng.choice([0.0, 1e-3, 0.1, 1.0])
        )


def _bend_matrix(content: Content, rng: Rng) -> None:
    name = ("P", "K", "Q_m")[int(rng.integers(3))]
    size = len(content["K"][0]) if isinstance(content.get("K"), list) else 1
    i, j = (int(k) for k in rng.integers(size, size=2))
    factor = float(rng.choice([-1.0, 0.0, 3.0, 0.5, 1.1]))
    _multiply(content, (name, i, j), factor)
    if i != j:
        _multiply(content, (name, j, i), factor)


def _bend_model(content: Content, rng: Rng) -> None:
    dynamics = content.get("dynamics")
    tape = dynamics.get("tape") if isinstance(dynamics, dict) else None
    if not isinstance(tape, list) or not tape:
        return
    step = tape[int(rng.integers(len(tape)))]
    others = {"add": "sub", "sub": "add", "mul": "div", "sin": "cos", "cos": "sin"}
    if isinstance(step, list) and step and isinstance(step[0], str):
        step[0] = others.get(step[0], "neg" if len(step) == 2 else "pow")


def _loosen_margins(content: Content, rng: Rng) -> None:
    factor = float(rng.choice([0.0, 0.1, 0.9]))
    _multiply(content, ("margins", "integrator", "relative_error"), factor)
    _multiply(content, ("margins", "between_samples", "growth"), factor)
    _multiply(content, ("core", "drift"), factor)


def _grow_core(content: Content, rng: Rng) -> None:
    alpha: Any = content.get("alpha")
    level = float(rng.choice([1e-7, 1e-5, 1.0]))
    if _is_number(alpha):
        level *= alpha
    content["core"] = {"level": level, "drift": float(rng.choice([0.0, 1e-6, 1.0]))}


def _move_reference(content: Content, rng: Rng) -> None:
    side = ("x", "u")[int(rng.integers(2))]
    size = float(rng.choice([1e-14, 1e-9, 1e-3, 1.0]))
    try:
        entries = content["reference"][side]
        entries[int(rng.integers(len(entries)))] += size
    except (KeyError, TypeError, ValueError, IndexError):
        return


def _hold_otherwise(content: Content, rng: Rng) -> None:
    _multiply(content, ("dt",), float(rng.choice([0.1, 2.0, 10.0, 1e6])))
    if isinstance(content.get("substeps"), int):
        content["substeps"] = int(rng.choice([1, 2, 100, 10_000]))


def _be_silent(content: Content, rng: Rng) -> None:
    content[("statements", "refuted")[int(rng.integers(2))]] = (
        [] if rng.random() < 0.5 else None
    )


def _cut(data: bytes, rng: Rng) -> bytes:
    return data[: int(rng.integers(len(data)))]


def _flip(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for place in rng.integers(len(changed), size=int(rng.integers(1, 20))):
        changed[place] = int(rng.integers(256))
    return bytes(changed)


def _twice(data: bytes, rng: Rng) -> bytes:
    return data.replace(b'"alpha":', b'"alpha": 1.0, "alpha":', 1)


def _deepen(data: bytes, rng: Rng) -> bytes:
    depth = int(rng.choice([500, 990, 20_000]))
    return data.replace(b"null", b"[" * depth + b"]" * depth, 1)


def _swell(data: bytes, rng: Rng) -> bytes:
    return data + b" " * int(rng.choice([10, 12_000_000]))


ANYTHING = (_scale, _scale, _replace, _replace, _drop, _add, _swap, _nest, _rewrite)
ON_PURPOSE = (
    _enlarge, _narrow, _bend_matrix, _bend_model, _loosen_margins, _grow_core,
    _move_reference, _hold_otherwise, _be_silent,
)  # fmt: skip
BYTES = (_cut, _flip, _twice, _deepen, _swell, lambda data, rng: b"\xef\xbb\xbf" + data)
