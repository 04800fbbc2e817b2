"""Shape of comparison.json: all keys that a table, page or gate reads."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

NUMBER, COUNT, TEXT, FLAG = "a number", "a count", "a text", "true or false"
_SHOWN = 40
_ALL = "*"
_CURVE = [(NUMBER,)]
_BAND = {"share": _CURVE, "low": _CURVE, "high": _CURVE}
_ROW = {
    "solver": TEXT, "deterministic": FLAG, "settings": TEXT, "runs": COUNT,
    "failed": [TEXT], "cut": COUNT, "feasible": COUNT, "claimed_feasible": COUNT,
    "false_successes": COUNT, "near": [COUNT], "near_intervals": ([[NUMBER]],),
    "costs": _CURVE, "gaps": _CURVE, "claimed": _CURVE, "seconds": _CURVE,
    "build_seconds": _CURVE, "compile_seconds": _CURVE, "evaluations": _CURVE,
    "seconds_p50": (NUMBER,), "seconds_p99": (NUMBER,), "evaluations_median": (NUMBER,),
    "ert_evaluations": _CURVE, "ert_seconds": _CURVE,
    "against_first": {
        "words": TEXT, "p": (NUMBER,), "effect": (NUMBER,), "shift": (NUMBER,),
        "verdict": TEXT,
    },
    "history": ({
        "evaluations": _CURVE, "seconds": _CURVE,
        "cost": {"low": _CURVE, "median": _CURVE, "high": _CURVE},
    },),
    "ecdf": ({"evaluations": _CURVE, **_BAND},),
    "measures": {_ALL: {
        "low": (NUMBER,), "median": (NUMBER,), "high": (NUMBER,), "undefined": COUNT,
    }},
    "step_seconds": ({_ALL: (NUMBER,)},),
}  # fmt: skip
_PAIR = {"a": TEXT, "b": TEXT, "p": (NUMBER,), "effect": NUMBER, "verdict": TEXT}
_SCENARIO = {
    "name": TEXT, "title": TEXT, "kind": TEXT, "variant": TEXT, "of": TEXT,
    "sense": NUMBER, "best_cost": (NUMBER,), "best_by": (TEXT,),
    "bests": (_CURVE,),
    "known_cost": (NUMBER,), "rows": [_ROW],
    "bound": ({"value": (NUMBER,), "kind": TEXT, "gap": (NUMBER,), "words": TEXT},),
    "pairs": [_PAIR], "answer": ({"solver": TEXT, "seed": COUNT, "plan": {}},),
}  # fmt: skip
_CHANGE = {
    "scenario": TEXT, "solver": TEXT, "quantity": TEXT, "before": (NUMBER,),
    "now": (NUMBER,), "verdict": TEXT, "words": TEXT,
}  # fmt: skip
_COMPARISON = {
    "headline": TEXT, "command": TEXT, "budget_text": TEXT, "date": TEXT,
    "budget": {"evaluations": (NUMBER,), "seconds": (NUMBER,)},
    "versions": {_ALL: TEXT}, "seeds": [COUNT], "near": [NUMBER], "is_noisy": FLAG,
    "load_max": (NUMBER,),
    "machines": [{}], "total_seconds": NUMBER,
    "solvers": [{"name": TEXT, "title": TEXT, "deterministic": FLAG}],
    "scenarios": [_SCENARIO], "limits": [TEXT],
    "profile": ({"quantity": TEXT, "ratios": _CURVE, "curves": {_ALL: _BAND}},),
    "ranks": [{"solver": TEXT, "mean": NUMBER, "low": NUMBER, "high": NUMBER}],
    "regression": ({"margin": NUMBER, "rows": [_CHANGE], "is_regression": FLAG},),
}  # fmt: skip
"""Form of a comparison.

A text names a type, a tuple allows null, a list contains such values; a mapping has at
least these keys, or, with "*", any keys with such values.
"""


def fault_of(content: Mapping[str, Any]) -> str:
    """Return an error of a comparison with its place; empty if there is none.

    Args:
        content: As read from JSON.
    """
    return _fault(content, _COMPARISON, "") or _miscounted(content)


def short(value: object) -> str:
    """Return a value as JSON, cut if it is long."""
    text = json.dumps(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _fault(value: Any, expected: Any, place: str) -> str:
    """Return a difference from the expected form with its place; empty without one."""
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
        if _ALL in expected:
            expected = dict.fromkeys(value, expected[_ALL])
        named = {key: f"{place}.{key}".lstrip(".") for key in expected}
        missing = [where for key, where in named.items() if key not in value]
        if missing:
            return f"no {missing[0]}"
        parts = [(value[key], expected[key], named[key]) for key in expected]
    return next(filter(None, (_fault(*part) for part in parts)), "")


def _wrong(value: Any, expected: str, place: str) -> str:
    return f"{place} = {short(value)} instead of {expected}"


def _is(value: object, kind: str) -> bool:
    if kind in (TEXT, FLAG):
        return isinstance(value, str if kind == TEXT else bool)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if kind == COUNT:
        return isinstance(value, int) and 0 <= value < 1 << 63
    return abs(value) <= sys.float_info.max


def _miscounted(content: Mapping[str, Any]) -> str:
    """Return an error of a list's length; empty if there is none."""
    if len(content["near"]) != 2:  # noqa: PLR2004
        return f"{len(content['near'])} distances in near instead of 2"
    seeds = len(content["seeds"])
    for scenario in content["scenarios"]:
        for row in scenario["rows"]:
            runs = 1 if row["deterministic"] and row["runs"] == 1 else seeds
            counts = [len(row[key]) for key in ("costs", "seconds", "evaluations")]
            if {row["runs"], *counts} != {runs} or len(row["near"]) != 2:  # noqa: PLR2004
                return (
                    f"{row['runs']} runs and {counts[0]} costs of "
                    f"{short(row['solver'])} on {short(scenario['name'])} instead of "
                    f"{runs}"
                )
    return ""
