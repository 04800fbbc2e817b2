"""One scenario over many seeds: `run --seeds`, by the engine of `compare`."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.record.record import versions

MOST_INSTANTS = 201
OUTER = (0.1, 0.9)
"""Lower and upper quantile of a band."""


def seeds_content(
    resolved: Resolved, outcomes: Sequence[Outcome], *, command: str, key: str = ""
) -> dict[str, Any]:
    """Return the results of one scenario over seeds, as in seeds.json.

    Args:
        resolved: The scenario.
        outcomes: Outcomes of its runs (flight_trial.py), seed by seed from 0 on.
        command: The command line that repeats these runs.
        key: Key of the run with seed 0, by which later commands recognise a folder of
            this scenario.
    """
    settings = resolved.settings
    results = [outcome.result for outcome in outcomes]
    return {
        "schema": 1,
        "record": "seeds",
        "key": key,
        "scenario": settings["name"],
        "title": settings["title"],
        "kind": settings["kind"],
        "variant": resolved.variant,
        "vehicles": _uavs(settings.get("uavs") or []),
        "search": resolved.scenario.search_name,
        "way": resolved.scenario.way(),
        "lanes": resolved.scenario.random_starts(),
        "polish": resolved.scenario.polish_name,
        "command": command,
        "seeds": list(range(len(outcomes))),
        "failures": [outcome.failure for outcome in outcomes],
        "status": [None if one is None else one["status"] for one in results],
        # Runs that an earlier version left have neither.
        **{
            role: [None if one is None else one.get(role) or None for one in results]
            for role in ("reason", "advice")
        },
        "feasible": [one is not None and one["feasible"] for one in results],
        "measures": _measures(results),
        "claims": _claims(results),
        "step_seconds": [
            None if one is None else one["step_seconds"] for one in results
        ],
        "bands": bands([one["track"] for one in results if one is not None]),
        "versions": versions(),
    }


def _uavs(given: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the name of each UAV of the chapter's kinds; empty for other kinds."""
    return [f"UAV {uav.get('number') or place}" for place, uav in enumerate(given, 1)]


def _measures(results: Sequence[Mapping[str, Any] | None]) -> dict[str, list[Any]]:
    """Return the values of each measure, one a seed; None for a failed run."""
    names = dict.fromkeys(
        name for one in results if one is not None for name in one["measures"]
    )
    return {
        name: [None if one is None else one["measures"].get(name) for one in results]
        for name in names
    }


def _claims(results: Sequence[Mapping[str, Any] | None]) -> list[dict[str, Any]]:
    """Return each claim of the scenario with its verdicts; None means not judged."""
    found = [one["claims"] for one in results if one is not None]
    if not found:
        return []
    return [
        {
            **{name: claim[name] for name in ("id", "text", "gate")},
            "holds": [each[number]["holds"] for each in found],
        }
        # The claims are those of the scenario, and so the same in each run.
        for number, claim in enumerate(found[0])
    ]


def bands(tracks: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return medians and 10 to 90 % bands of states over time; None without paths.

    Args:
        tracks: Paths of the runs, as `flight_trial` keeps them. Paths can differ in
            length; times beyond the shortest path are left out.
    """
    if not tracks:
        return None
    end = min(track["time"][-1] for track in tracks)
    time = np.linspace(0.0, end, MOST_INSTANTS)
    return {
        "time": [float(t) for t in time],
        "states": {name: _band(tracks, name, time) for name in tracks[0]["states"]},
    }


def _band(
    tracks: Sequence[Mapping[str, Any]], name: str, time: np.ndarray[Any, Any]
) -> dict[str, list[float | None]]:
    # A state that is not defined is NaN, and so is the band there.
    rows = [
        np.interp(time, track["time"], np.array(track["states"][name], dtype=float))
        for track in tracks
    ]
    low, median, high = np.quantile(rows, [OUTER[0], 0.5, OUTER[1]], axis=0)
    return {
        side: [float(v) if np.isfinite(v) else None for v in values]
        for side, values in (("low", low), ("median", median), ("high", high))
    }


def spread_of(values: Sequence[Any]) -> tuple[str, ...]:
    """Return lowest, median and highest of a measure, and how many are undefined.

    If the measure of a run is a list, its largest entry counts.
    """
    # One number for each run, so that runs can be compared.
    single = [_largest(value) for value in values]
    known = [value for value in single if value is not None]
    missing = len(values) - len(known)
    note = f"undefined in {missing}" if missing else ""
    if not known:
        return "-", "-", "-", note
    parts = min(known), statistics.median(known), max(known)
    return (*(f"{part:.6g}" for part in parts), note)


def _largest(value: Any) -> float | None:
    if isinstance(value, list):
        known = [entry for entry in value if entry is not None]
        return max(known, default=None)
    return None if value is None else float(value)
