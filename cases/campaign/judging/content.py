"""A whole comparison as plain data: made from outcomes, and read from comparison.json.

All pages are made from this content. The table `_COMPARISON` has the keys that a text,
page or gate reads; a user's file is checked against it before use.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.campaign.judging.curves import (
    performance_profile,
    profile_bands,
    ratios_of,
    relative_times,
    rounded,
)
from swarmstart.cases.campaign.judging.headline import headline
from swarmstart.cases.campaign.judging.report import limits_of
from swarmstart.cases.campaign.judging.runs import About, Asked, Entry, runs_of
from swarmstart.cases.campaign.judging.scenario_content import (
    Judged,
    judged_scenario,
    scenario_content,
)
from swarmstart.cases.campaign.judging.statistics import (
    mean_ranks,
    median,
    resampled,
    scenario_ranks,
)
from swarmstart.cases.campaign.trials.solver_names import renamed
from swarmstart.cases.record.files import RecordError, said

SCHEMA = 2
LOAD = 1.25
"""A machine is busy if its load exceeds this factor times its cores.

Each run uses one core, and the command uses a little.
"""
ON_CPU = 0.8
"""A machine is busy if runs had the CPU for less than this part of their wall time."""
SHORTEST_S = 0.05
"""Shortest run for which the part in `ON_CPU` is meaningful [s]."""
NOTHING: Mapping[str, About] = MappingProxyType({})

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
    "known_cost": (NUMBER,), "known_from": TEXT, "rows": [_ROW],
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

MOST_BYTES = 200 * 1024 * 1024


def content_of(
    entries: Sequence[Sequence[Entry]],
    outcomes: Mapping[str, Outcome],
    asked: Asked,
    about: Mapping[str, About] = NOTHING,
) -> dict[str, Any]:
    """Return a comparison as plain data; its keys are those of comparison.json.

    Args:
        entries: The solvers of each scenario; the others are compared with the first.
            Solvers that cannot solve a scenario are missing.
        outcomes: Outcomes by the cells' keys.
        asked: Settings of the comparison: seeds, budget, command and the distance that
            counts as near.
        about: Data about scenarios besides their runs, by the scenario's name.

    Returns:
        Plain data: numbers are finite or None, and the same outcomes give the same
        bits. The entry "regression" has the value None: `regression` makes it from two
        comparisons.
    """
    rng = np.random.default_rng(asked.bootstrap_seed)
    used = [outcomes[c.key] for each in entries for e in each for c in e.cells]
    load, noisy = load_of(used)
    known = [about.get(each[0].scenario, About()) for each in entries]
    # With equal evaluations seconds are shown, but not compared: see `judgement`.
    judges = not noisy and asked.budget.get("seconds") is not None
    found = [
        judged_scenario(
            [runs_of(entry, outcomes, asked) for entry in each],
            asked,
            known_cost=one.known_cost,
            judges_seconds=judges,
            is_seeded=one.is_seeded,
        )
        for each, one in zip(entries, known, strict=True)
    ]
    scenarios = [
        scenario_content(each[0].scenario, judged, asked, one, rng=rng)
        for each, judged, one in zip(entries, found, known, strict=True)
    ]
    solvers = {e.solver.name: e for each in entries for e in each}
    names = list(solvers)
    # Solvers are ranked only on scenarios on which all ran; a missing one did not fail.
    shared = [one for one in found if [runs.name for runs in one.runs] == names]
    content = {
        "schema": SCHEMA,
        "record": "comparison",
        "headline": "",
        "command": asked.command,
        "budget": {q: asked.budget.get(q) for q in ("evaluations", "seconds")},
        "budget_text": asked.budget_text,
        "seeds": list(asked.seeds),
        "near": list(asked.near),
        "bootstrap": {"seed": asked.bootstrap_seed, "resamples": asked.resamples},
        **_circumstances(used),
        "load_max": load,
        "is_noisy": noisy,
        "judges_seconds": judges,
        "solvers": [_solver(entry) for entry in solvers.values()],
        "scenarios": scenarios,
        "profile": _profile(shared, names, asked, rng),
        "ranks": _ranks(shared, names, asked, rng),
        "limits": [],
        "regression": None,
    }
    content["headline"] = headline(content)
    content["limits"] = limits_of(content)
    return content


def _solver(entry: Entry) -> dict[str, Any]:
    solver = entry.solver
    return {
        "name": solver.name,
        "title": getattr(solver, "title", ""),
        "deterministic": solver.is_deterministic,
    }


def _circumstances(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return dates and machines of the cells, as far as known."""
    machines: list[dict[str, Any]] = []
    versions: dict[str, Any] = {}
    for one in outcomes:
        machine = dict(getattr(one, "machine", None) or {})
        if machine and machine not in machines:
            machines.append(machine)
        versions.update(getattr(one, "versions", None) or {})
    dates = [str(getattr(one, "date", "") or "") for one in outcomes]
    return {
        "date": min(filter(None, dates), default=""),
        "machines": machines,
        "versions": versions,
        "total_seconds": float(sum(one.seconds for one in outcomes)),
    }


def load_of(outcomes: Sequence[Outcome]) -> tuple[float | None, bool]:
    """Return the highest load, and whether the machine was too busy to measure times.

    It was too busy if the load during the median run was above 1.25 times the number of
    cores, or if that run had the CPU for less than 0.8 of its time. The median is used
    so that one busy moment does not spoil a comparison.

    Args:
        outcomes: Outcomes, with `load`, `machine` and `cpu_s` if known.

    Returns:
        The highest load, None if no run has one; whether the machine was too busy.
    """
    loads, relative, shares = [], [], []
    for one in outcomes:
        given = getattr(one, "load", None)
        pair = given if isinstance(given, list | tuple) else [given]
        own = [load for load in pair if isinstance(load, int | float)]
        cores = (getattr(one, "machine", None) or {}).get("cores")
        if own:
            loads.append(max(own))
            if cores:
                relative.append(max(own) / cores)
        cpu = getattr(one, "cpu_s", None)
        if isinstance(cpu, int | float) and cpu > 0 and one.seconds > SHORTEST_S:
            shares.append(cpu / one.seconds)
    is_loaded = (median(relative) or 0.0) > LOAD
    is_waiting = bool(shares) and (median(shares) or 0.0) < ON_CPU
    return max(loads, default=None), is_loaded or is_waiting


def _profile(
    found: Sequence[Judged],
    names: Sequence[str],
    asked: Asked,
    rng: np.random.Generator,
) -> dict[str, Any] | None:
    """Return the performance profile; None if no solver comes near the best at all."""
    quantity, times = profile_times(found, asked)
    if len(names) < 2 or not np.isfinite(times).any():  # noqa: PLR2004
        return None
    relative = relative_times(times)
    ratios = ratios_of(relative)
    shares = performance_profile(relative, ratios)
    low, high = shares, shares
    if asked.resamples:
        groups = [
            resampled(len(asked.seeds), resamples=asked.resamples, rng=rng)
            for _ in found
        ]
        low, high = profile_bands(relative, ratios, groups)
    return {
        "quantity": quantity,
        "ratios": rounded(ratios),
        "curves": {
            name: {
                "share": rounded(shares[k]),
                "low": rounded(low[k]),
                "high": rounded(high[k]),
            }
            for k, name in enumerate(names)
        },
    }


def profile_times(
    found: Sequence[Judged], asked: Asked
) -> tuple[str, np.ndarray[Any, np.dtype[np.float64]]]:
    """Return the unit of effort, and the effort of solvers to come near the best.

    Args:
        found: Results on the scenarios, each with the same solvers in the same order.
        asked: Settings of the comparison; its budget decides between evaluations and
            seconds.

    Returns:
        "evaluations" or "seconds", and the effort in this unit, shape (solvers,
        instances); infinite if a solver never came near the best.
    """
    # Evaluations if they are limited, since they do not depend on the machine.
    by_clock = asked.budget.get("evaluations") is None and (
        asked.budget.get("seconds") is not None
    )
    seeds, columns = len(asked.seeds), []
    for one in found:
        rows = []
        for runs in one.runs:
            courses = runs.seconds if by_clock else runs.evaluations
            rows.append(runs.for_seeds(one.times_to(runs, courses, 0), seeds))
        columns.append(np.array(rows))
    times = np.concatenate(columns, axis=1) if columns else np.empty((0, 0))
    return "seconds" if by_clock else "evaluations", times


def _ranks(
    found: Sequence[Judged],
    names: Sequence[str],
    asked: Asked,
    rng: np.random.Generator,
) -> list[dict[str, Any]]:
    """Return mean ranks; empty for one scenario or one solver."""
    told = [one for one in found if math.isfinite(one.best)]
    if len(told) < 2 or len(names) < 2:  # noqa: PLR2004
        return []
    ranks = [scenario_ranks(one.costs) for one in told]
    mean, low, high = mean_ranks(ranks, resamples=asked.resamples, rng=rng)
    return [
        {"solver": name, "mean": float(m), "low": float(lo), "high": float(hi)}
        for name, m, lo, hi in zip(names, mean, low, high, strict=True)
    ]


def read_comparison(path: Path) -> dict[str, Any]:
    """Return a comparison written by `compare`.

    Args:
        path: comparison.json, or the folder that holds it.

    Returns:
        Its content, as from `content_of`.

    Raises:
        RecordError: If the file cannot be read, or has another form.
    """
    file = path / "comparison.json" if path.is_dir() else path
    try:
        # Before reading: a wrong file can be too large for the memory.
        if file.stat().st_size > MOST_BYTES:
            raise _foreign(file, f"more than {MOST_BYTES >> 20} MiB")
        # Python would also read NaN and Infinity, which are not JSON.
        text = renamed(file.read_text(encoding="utf-8"))
        content = json.loads(text, parse_constant=_refuse)
    except OSError as error:
        raise RecordError(f"{file}: expected a comparison: {said(error)}") from error
    except (ValueError, RecursionError) as error:  # JSON, UTF-8, a NUL, huge numbers
        raise _foreign(file, "a file that is not JSON") from error
    if not isinstance(content, dict) or content.get("record") != "comparison":
        raise _foreign(file, "other JSON")
    if content.get("schema") != SCHEMA:
        raise _foreign(file, f"schema {_short(content.get('schema'))}")
    fault = fault_of(_completed(content))
    if fault:
        raise _foreign(file, fault)
    return content


def _completed(content: dict[str, Any]) -> dict[str, Any]:
    """Return a comparison of an earlier version with the keys that are new."""
    scenarios = content.get("scenarios")
    for one in scenarios if isinstance(scenarios, list) else ():
        if isinstance(one, dict):
            one.setdefault("known_from", "")
    return content


def _foreign(file: Path, found: str) -> RecordError:
    return RecordError(
        f"{file}: expected a comparison of schema {SCHEMA}, as `swarmstart compare` "
        f"writes it; found {found}"
    )


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is not a number of JSON")


def fault_of(content: Mapping[str, Any]) -> str:
    """Return an error of a comparison with its place; empty if there is no error.

    Args:
        content: Content of a comparison, as read from JSON.
    """
    return _fault(content, _COMPARISON, "") or _miscounted(content)


def _short(value: object) -> str:
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
    return f"{place} = {_short(value)} instead of {expected}"


def _is(value: object, kind: str) -> bool:
    if kind in (TEXT, FLAG):
        return isinstance(value, str if kind == TEXT else bool)
    # In Python a bool is an int.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if kind == COUNT:
        return isinstance(value, int) and 0 <= value < 1 << 63
    # An integer of JSON can be larger than any float.
    return abs(value) <= sys.float_info.max


def _miscounted(content: Mapping[str, Any]) -> str:
    """Return an error of a list's length; empty without one."""
    if len(content["near"]) != 2:  # noqa: PLR2004
        return f"{len(content['near'])} distances in near instead of 2"
    seeds = len(content["seeds"])
    for scenario in content["scenarios"]:
        for row in scenario["rows"]:
            # One run without chance counts for every seed.
            runs = 1 if row["deterministic"] and row["runs"] == 1 else seeds
            counts = [len(row[key]) for key in ("costs", "seconds", "evaluations")]
            if {row["runs"], *counts} != {runs} or len(row["near"]) != 2:  # noqa: PLR2004
                return (
                    f"{row['runs']} runs and {counts[0]} costs of "
                    f"{_short(row['solver'])} on {_short(scenario['name'])} instead of "
                    f"{runs}"
                )
    return ""
