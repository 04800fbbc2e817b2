"""A whole comparison as plain data, for comparison.json and all pages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.campaign.judging.curves import rounded
from swarmstart.cases.campaign.judging.entry import Entry
from swarmstart.cases.campaign.judging.headline import headline
from swarmstart.cases.campaign.judging.limits import limits_of
from swarmstart.cases.campaign.judging.profiles import (
    performance_profile,
    profile_bands,
    ratios_of,
    relative_times,
)
from swarmstart.cases.campaign.judging.ranks import mean_ranks, scenario_ranks
from swarmstart.cases.campaign.judging.runs import About, Asked, runs_of
from swarmstart.cases.campaign.judging.scenario_content import (
    Judged,
    judged_scenario,
    scenario_content,
)
from swarmstart.cases.campaign.judging.statistics import median, resampled

SCHEMA = 2
LOAD = 1.25
"""A machine is busy if its load exceeds this factor times its cores.

Each run uses one core, and the command uses a little.
"""
ON_CPU = 0.8
"""A machine is busy if runs had the CPU for less than this part of their wall time."""
SHORTEST_S = 0.05
"""Shortest run for which that part is meaningful [s]."""
NOTHING: Mapping[str, About] = MappingProxyType({})


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
        asked: Seeds, budget, command and the distance that counts as near.
        about: Further knowledge about scenarios, by name.

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
        "date": max(dates, default=""),
        "machines": machines,
        "versions": versions,
        "total_seconds": float(sum(one.seconds for one in outcomes)),
    }


def load_of(outcomes: Sequence[Outcome]) -> tuple[float | None, bool]:
    """Return the highest load, and whether the machine was too busy to time anything.

    It was too busy if the median run saw a load above 1.25 times the cores, or had the
    CPU for less than 0.8 of its time. With the median one busy moment does not spoil a
    comparison.

    Args:
        outcomes: Outcomes, with `load`, `machine` and `cpu_s` if known.

    Returns:
        None if no run knows its load.
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
    """Return the effort of solvers to come near the best, shape (solvers, instances).

    Args:
        found: The scenarios, each with the same solvers in the same order.
        asked: The request, whose budget decides between evaluations and seconds.

    Returns:
        The quantity, and the times: infinite if never reached.
    """
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
