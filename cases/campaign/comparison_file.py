"""A comparison read from a file: data of a user's, checked before anything uses it."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.content import SCHEMA
from swarmstart.cases.record.files import RecordError, said

MOST_BYTES = 200 * 1024 * 1024
NUMBER, COUNT, TEXT, FLAG = "a number", "a count", "a text", "true or false"
_SHOWN = 40

_ROW = {
    "solver": TEXT, "deterministic": FLAG, "settings": TEXT, "runs": COUNT,
    "failed": [TEXT], "cut": COUNT, "feasible": COUNT, "claimed_feasible": COUNT,
    "false_successes": COUNT, "near": [COUNT], "costs": [(NUMBER,)],
    "gaps": [(NUMBER,)], "claimed": [(NUMBER,)], "seconds": [(NUMBER,)],
    "evaluations": [(NUMBER,)], "seconds_p50": (NUMBER,), "seconds_p99": (NUMBER,),
    "evaluations_median": (NUMBER,), "against_first": {"words": TEXT, "p": (NUMBER,)},
}  # fmt: skip
_SCENARIO = {
    "name": TEXT, "title": TEXT, "kind": TEXT, "sense": NUMBER,
    "best_cost": (NUMBER,), "best_by": (TEXT,), "known_cost": (NUMBER,),
    "rows": [_ROW],
}  # fmt: skip
_COMPARISON = {
    "headline": TEXT, "command": TEXT, "budget_text": TEXT,
    "budget": {"evaluations": (NUMBER,), "seconds": (NUMBER,)},
    "seeds": [COUNT], "near": [NUMBER], "is_noisy": FLAG, "machines": [{}],
    "solvers": [{"name": TEXT, "deterministic": FLAG}],
    "scenarios": [_SCENARIO], "limits": [TEXT],
}  # fmt: skip
"""What is looked at: a text names a kind, a tuple allows null, a list is one of such, a
mapping has at least these keys."""


def read_comparison(path: Path) -> dict[str, Any]:
    """Return a comparison that `compare` has written.

    Args:
        path: comparison.json, or the folder that holds it.

    Returns:
        As of `content_of`.

    Raises:
        RecordError: If it cannot be read, or is anything else.
    """
    file = path / "comparison.json" if path.is_dir() else path
    try:
        if file.stat().st_size > MOST_BYTES:
            raise _foreign(file, f"more than {MOST_BYTES >> 20} MiB")
        content = json.loads(file.read_text(encoding="utf-8"), parse_constant=_refuse)
    except OSError as error:
        raise RecordError(f"{file}: expected a comparison: {said(error)}") from error
    except (ValueError, RecursionError) as error:  # JSON, UTF-8, a NUL, huge numbers
        raise _foreign(file, "a file that is not JSON") from error
    if not isinstance(content, dict) or content.get("record") != "comparison":
        raise _foreign(file, "other JSON")
    if content.get("schema") != SCHEMA:
        raise _foreign(file, f"schema {_short(content.get('schema'))}")
    fault = _fault(content, _COMPARISON, "") or _miscounted(content)
    if fault:
        raise _foreign(file, fault)
    return content


def _foreign(file: Path, found: str) -> RecordError:
    return RecordError(
        f"{file}: expected a comparison of schema {SCHEMA}, as `swarmstart compare` "
        f"writes it; found {found}"
    )


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _fault(value: Any, expected: Any, place: str) -> str:
    """Return what is other than expected, and where; empty if nothing is."""
    if isinstance(expected, tuple):
        return "" if value is None else _fault(value, expected[0], place)
    if isinstance(expected, str):
        return "" if _is(value, expected) else _wrong(value, expected, place)
    if isinstance(expected, list):
        if not isinstance(value, list):
            return _wrong(value, "a list", place)
        parts = [(one, expected[0], f"{place}[{k}]") for k, one in enumerate(value)]
    else:
        if not isinstance(value, dict):
            return _wrong(value, "a mapping", place)
        named = {key: f"{place}.{key}".lstrip(".") for key in expected}
        missing = [where for key, where in named.items() if key not in value]
        if missing:
            return f"no {missing[0]}"
        parts = [(value[key], expected[key], named[key]) for key in expected]
    return next(filter(None, (_fault(*part) for part in parts)), "")


def _wrong(value: Any, expected: str, place: str) -> str:
    return f"{place} = {_short(value)}, where {expected} is expected"


def _is(value: object, kind: str) -> bool:
    if kind in (TEXT, FLAG):
        return isinstance(value, str if kind == TEXT else bool)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if kind == COUNT:
        return isinstance(value, int) and 0 <= value < 1 << 63
    return abs(value) <= sys.float_info.max


def _miscounted(content: Mapping[str, Any]) -> str:
    """Return which list has another length than it must; empty if none has."""
    if len(content["near"]) != 2:  # noqa: PLR2004
        return f"{len(content['near'])} distances in near, where 2 are expected"
    seeds = len(content["seeds"])
    for scenario in content["scenarios"]:
        for row in scenario["rows"]:
            runs = 1 if row["deterministic"] else seeds
            counts = [len(row[key]) for key in ("costs", "seconds", "evaluations")]
            if {row["runs"], *counts} != {runs} or len(row["near"]) != 2:  # noqa: PLR2004
                return (
                    f"{row['runs']} runs and {counts[0]} costs of "
                    f"{_short(row['solver'])} on {_short(scenario['name'])}, where "
                    f"{runs} are expected"
                )
    return ""
