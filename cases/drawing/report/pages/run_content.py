"""The content of a run's page: a record in words and tables.

It reads run.json, trajectory.npz, scenario.yaml and figures, and runs nothing. A record
is a user's file: a part that does not fit gives one message, a RecordError.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.drawing.report.pages.broken_limits import broken_words
from swarmstart.cases.drawing.report.tracks import Tracks, tracks_of
from swarmstart.cases.drawing.wording import (
    is_number,
    number_of,
    percent,
    shortened,
    shown,
    typeset_duration,
    unit_of_measure,
)
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.record import SCENARIO
from swarmstart.cases.record.results import Record, load
from swarmstart.ocp import BoundKind

MOST_CHARACTERS = 2000
MOST_ROWS = 500
"""Largest number of rows of a table: a forged record may have any number."""
_SETTLING = {
    "settle_time_s": "every UAV stays within 1 m of its slot",
    "x_settle_s": "x stays within 1 ft of the slot",
}
"""Measures that say when a flight has settled -> what that is."""
_COST_WORDS = {
    "mean_arrival_time_s": "mean time of arrival [s]",
    "verified_cost": "cost, integrated ten times finer",
    "flown_cost": "cost of the simulated path",
    "cost": "cost of the first plan",
    "plan_cost": "cost of the plan",
    "closed_loop_cost": "closed-loop cost",
    "cost_max": "largest cost of a plan",
}
_DECIDED = {
    "end_time": "length of the first plan's horizon, which is decided [s]",
    "duration_": "length of this phase in the first plan, which is decided [s]",
    "decided_": "decided by the first plan",
}
"""Beginning of the name of a measure of what is decided -> what it is."""
_ENDS = {"position_error_m": "largest distance from a slot at the end"}
MEASURE_HEADS = ("measure", "value", "unit", "meaning")
CLAIM_HEADS = ("claim", "verdict", "measured", "asked", "says", "source")


@dataclass(frozen=True, kw_only=True, slots=True)
class MeasureRow:
    """A measure, as a row of the table.

    Attributes:
        name: Name as in run.json.
        text: Value as it is shown.
        value: Number to sort by; None if the measure is not defined, or is a list.
        unit: Unit of the measure; may be empty.
        meaning: Definition of the measure in a sentence.
    """

    name: str
    text: str
    value: float | None
    unit: str
    meaning: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ClaimRow:
    """A claim of the scenario with its verdict by the run.

    Attributes:
        id: Number of the claim.
        verdict: "holds", "does not hold" or "not judged".
        measured: Measured value.
        asked: Measure, relation and bound of the claim.
        text: The claim, and the conditions of judging it.
        source: Origin of the claim: a page, a table, an own measurement.
    """

    id: str
    verdict: str
    measured: str
    asked: str
    text: str
    source: str


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RunContent:
    """Content of a run's page.

    Attributes:
        record: The record.
        kind: Kind of the scenario.
        title: Title of the scenario.
        headline: Result in a sentence.
        verdict: Class of the headline's colour: "good", "mid" or "bad".
        why: Sentences with the reason for the status of a single plan, and advice.
        facts: Name and words of each setting that is shown.
        measures: Rows of the table of measures.
        claims: Rows of the table of claims.
        limits: Sentences on what this run does not show.
        command: Command that repeats the run.
        versions: Versions of packages.
        figures: Names of the files of figures.
        tracks: The run, for the player.
    """

    record: Record
    kind: str
    title: str
    headline: str
    verdict: str
    why: Sequence[str]
    facts: Sequence[tuple[str, str]]
    measures: Sequence[MeasureRow]
    claims: Sequence[ClaimRow]
    limits: Sequence[str]
    command: str
    versions: Mapping[str, str]
    figures: Sequence[str]
    tracks: Tracks


def run_content(folder: Path) -> RunContent:
    """Return the content of the page for a record of `swarmstart run`.

    Raises:
        RecordError: If there is no record, or its parts do not fit together.
        SwarmstartError: If scenario.yaml in the record cannot be read.
    """
    record = load(folder)
    summary = record.summary
    if "scenario" not in summary or "measures" not in summary:
        raise RecordError(
            f"{folder}: expected the record of `swarmstart run`, found another result"
        )
    tracks = tracks_of(record)
    try:
        return _content(record, summary, tracks)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise RecordError(
            f"{folder}: expected a record that is whole, found: "
            f"{type(error).__name__}: {error}"
        ) from error


def _content(record: Record, summary: Mapping[str, Any], tracks: Tracks) -> RunContent:
    kind, measures = str(summary["kind"]), _mapping(summary["measures"])
    scenario = record.scenario or {}
    return RunContent(
        record=record,
        kind=kind,
        title=tracks.title or str(summary["scenario"]),
        headline=_headline(summary, kind, measures, tracks, scenario),
        verdict="bad"
        if broken_words(measures, scenario)
        else _quality(_ended(summary)),
        why=[
            f"{role.capitalize()}: {_words(summary[role])}."
            for role in ("reason", "advice")
            if summary.get(role)
        ],
        facts=_facts(summary, tracks, scenario),
        measures=_measure_rows(kind, measures, scenario),
        claims=[_claim_row(claim) for claim in list(summary["claims"])[:MOST_ROWS]],
        limits=_limits(summary, measures, tracks),
        command=_command(summary),
        versions={str(k): str(v) for k, v in _mapping(summary["versions"]).items()},
        figures=[str(name) for name in list(summary["figures"])[:MOST_ROWS]],
        tracks=tracks,
    )


def _mapping(given: Any) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise TypeError(f"a mapping expected, found {type(given).__name__}")
    return given


def _headline(
    summary: Mapping[str, Any],
    kind: str,
    measures: Mapping[str, Any],
    tracks: Tracks,
    scenario: Mapping[str, Any],
) -> str:
    """Return broken limits, what was simulated, the cost, and the solver's time."""
    end, steps = float(tracks.step_times[-1]), tracks.step_seconds.size
    plural = "" if steps == 1 else "s"
    parts = [f"Simulated for {shown(end)} s in {steps} step{plural}"]
    settled = _settled(measures)
    status = _ended(summary).removeprefix("simulated to the end; ")
    parts.append(settled or status.partition(";")[0])
    cost = next((n for n in words_of(kind).costs if is_number(measures.get(n))), None)
    if cost is not None:
        words = _COST_WORDS[cost]
        if scenario.get("maximize") is True:
            words = words.replace("cost", "objective")
        parts.append(f"{words} {shown(measures[cost])}")
    bound = _mapping(summary.get("bound") or {})
    if is_number(bound.get("value")):  # Of no bound only the facts tell.
        estimate = bound["kind"] == BoundKind.SAMPLED.value
        parts.append(("" if estimate else "bound ") + _words(bound["words"]))
    for name, words in _ENDS.items():
        if is_number(measures.get(name)):
            parts.append(f"{words} {shown(measures[name])} m")
    parts.append(_solver_words(tracks))
    first = [f"{words}. " for words in broken_words(measures, scenario)]
    return "".join(first) + "; ".join(parts) + "."


def _ended(summary: Mapping[str, Any]) -> str:
    """Return how a run ended, without the reason, which has a line of its own."""
    status = str(summary["status"])
    if summary.get("reason"):
        status = status.partition(f": {summary['reason']}")[0]
    return _words(status)


def _settled(measures: Mapping[str, Any]) -> str:
    for name, words in _SETTLING.items():
        if name in measures:
            time = measures[name]
            if is_number(time):
                return f"settled after {shown(time)} s ({words})"
            return f"not settled by the end (settled: {words})"
    return ""


def _solver_words(tracks: Tracks) -> str:
    """Return the solver's time against the length of a step."""
    seconds, lengths = tracks.step_seconds, np.diff(tracks.step_times)
    if tracks.is_one_plan or seconds.size == 1:
        whole = typeset_duration(float(np.nansum(seconds)))
        return f"the solver took {whole} for its plan"
    late = int((seconds > lengths).sum())
    said = (
        f"the solver took {typeset_duration(float(np.median(seconds)))} of each step's "
        f"{typeset_duration(float(np.median(lengths)))} (median; at most "
        f"{typeset_duration(float(seconds.max()))})"
    )
    return said + (f", too long in {counted(late, 'step')}" if late else "")


def _quality(status: str) -> str:
    bad = ("no step found", "not confirmed", "no feasible solution", "no answer")
    if any(words in status for words in bad):
        return "bad"
    doubtful = ("found no feasible plan", "not certified", "infeasible", "limit")
    return "mid" if any(words in status for words in doubtful) else "good"


def _facts(
    summary: Mapping[str, Any], tracks: Tracks, scenario: Mapping[str, Any]
) -> list[tuple[str, str]]:
    grid = scenario.get("prediction") or {}
    horizon = grid.get("horizon_s")
    steps = tracks.step_seconds.size
    facts = [
        ("scenario", f"{summary['scenario']} ({summary['kind']})"),
        ("variant", str(summary["variant"] or "")),
        ("source", str(scenario.get("source") or "")),
        ("solver", str(summary.get("solver") or "")),
        ("search", str(summary["search"])),
        ("random starts", str(summary.get("lanes") or "")),
        ("polish", str(summary["polish"])),
        ("seed", str(summary["seed"])),
        (
            "simulated",
            f"{steps} step{'' if steps == 1 else 's'}, "
            f"{shown(float(tracks.step_times[-1]))} s",
        ),
        (
            "horizon",
            f"{shown(horizon)} s in {grid.get('intervals')} intervals"
            if is_number(horizon)
            else "",
        ),
        ("how it ended", _ended(summary)),
        ("bound", _bound_words(_mapping(summary.get("bound") or {}))),
        ("evaluations", shown(summary.get("evaluations"))),
        (
            "wall time",
            f"{typeset_duration(number_of(summary.get('wall_s')))}, without "
            f"{typeset_duration(number_of(summary.get('compile_seconds')))} of "
            "compiling",
        ),
        ("backend", str(summary.get("backend") or "")),
    ]
    return [(name, _words(words)) for name, words in facts if words]


def _bound_words(bound: Mapping[str, Any]) -> str:
    """Return a bound, and what its proof took; empty without one."""
    if not bound:
        return ""
    told = str(bound["words"])
    if bound["set"]:
        taken = typeset_duration(number_of(bound["seconds"]))
        told += (
            f" (polynomials of degree {shown(bound['degree'])} on {bound['set']}, "
            f"{shown(bound['boxes'])} boxes, {taken})"
        )
    return told


def _measure_rows(
    kind: str, measures: Mapping[str, Any], scenario: Mapping[str, Any]
) -> list[MeasureRow]:
    known = dict(words_of(kind).measures)
    own = scenario.get("measures")
    meanings = {**known, **(own if isinstance(own, Mapping) else {})}
    rows = []
    is_one_plan = measures.get("confirmed") is not None
    left_out = words_of(kind).of_closed_loops if is_one_plan else ()
    for name, value in list(measures.items())[:MOST_ROWS]:
        if name in left_out:
            continue
        meaning = _words(meanings.get(name, ""))
        is_own = name not in known and meaning  # Its unit is in the scenario's words.
        meaning = meaning or _of_decided(str(name))
        unit = "" if is_own else unit_of_measure(str(name), meaning)
        said = meaning.removesuffix(f" [{unit}]")  # It has a column of its own.
        rows.append(
            MeasureRow(
                name=str(name),
                text=shown(value),
                value=float(value) if is_number(value) else None,
                unit=unit,
                meaning=f"of this scenario: {meaning}" if is_own else said,
            )
        )
    return rows


def _of_decided(name: str) -> str:
    """Return what a measure of what is decided is; empty for others."""
    return next((says for word, says in _DECIDED.items() if name.startswith(word)), "")


def _claim_row(claim: Mapping[str, Any]) -> ClaimRow:
    holds = claim["holds"]
    verdict = "not judged" if holds is None else "holds" if holds else "does not hold"
    bound = "not defined" if claim["bound"] is None else shown(claim["bound"], digits=8)
    if claim.get("width"):
        bound += f" ± {shown(claim['width'])}"
    text = _words(claim["text"])
    if claim.get("needs"):
        text += f" It needs {claim['needs']}."
    if claim.get("note"):
        text += f" ({claim['note']})"
    return ClaimRow(
        id=str(claim["id"]),
        verdict=verdict,
        measured=shown(claim["measured"], digits=8) if holds is not None else "-",
        asked=f"{claim['measure']} {claim['relation']} {bound}",
        text=text,
        source=str(claim["source"]),
    )


def _limits(
    summary: Mapping[str, Any], measures: Mapping[str, Any], tracks: Tracks
) -> list[str]:
    """Return what this run does not show."""
    outside = measures.get("steps_starting_outside")
    resumed = summary.get("resumed_steps")
    lanes = _mapping(summary.get("starts") or {}).get("lanes") or {}
    unseen = number_of((_mapping(lanes).get("unseen") or {}).get("most"))
    claims = summary["claims"]
    unjudged = sum(claim["holds"] is None for claim in claims)
    said = {
        "The terminal sets of the linear law are not certified: that it keeps within "
        "its bounds there is not proven.": "not certified" in _words(summary["status"]),
        **_without_plans(tracks),
        f"{shown(outside)} step{'s start' if outside != 1 else ' starts'} outside the "
        "bounds of the states or the path constraints.": is_number(outside) and outside,
        **_linear_breaks(tracks),
        "The solver's time is not known at every step.": not np.isfinite(
            tracks.step_seconds
        ).all(),
        "The finer integration does not confirm the plan.": measures.get("confirmed")
        == 0,
        f"At most {percent(unseen)} of random starts would end in optima that were not "
        "seen (95 % interval); a better one may be among them.": unseen < 1,
        "No random start ended in an optimum: how many there are is not known.": unseen
        >= 1,
        f"{shown(resumed)} step{'s are' if resumed != 1 else ' is'} from a run that "
        "was interrupted.": is_number(resumed) and resumed,
        f"{unjudged} of {counted(len(claims), 'claim')} "
        f"{'need' if unjudged > 1 else 'needs'} another run, or a second one to "
        "compare with.": unjudged,
        f"This is one run with the seed {summary['seed']}; times are of one "
        "machine.": True,
    }
    return [sentence for sentence, is_so in said.items() if is_so]


def _without_plans(tracks: Tracks) -> dict[str, bool]:
    """Return a sentence on steps without a feasible plan, and whether there are any."""
    missing, steps = int(tracks.without_plan.sum()), tracks.without_plan.size
    if tracks.is_one_plan:
        return {"The plan that was carried out is not feasible.": missing > 0}
    said = (
        f"At {missing} of {steps} steps a vehicle planned, but found no feasible plan; "
        "the last plan, shifted, was used there."
    )
    return {said: missing > 0}


def _linear_breaks(tracks: Tracks) -> dict[str, bool]:
    """Return a sentence on the linear law's breaks of constraints, and if there are."""
    broken = int(tracks.linear_breaks.sum())
    said = (
        f"At {counted(broken, 'step')} under the linear law the path breaks a "
        "constraint; nothing was planned there."
    )
    return {said: broken > 0}


def _command(summary: Mapping[str, Any]) -> str:
    """Return what runs the record's own scenario again, in its folder."""
    # int(): a forged seed must not become part of a command that readers copy.
    code = " --allow-code" if words_of(summary["kind"]).runs_code else ""
    return (
        f"swarmstart run ./{SCENARIO} --seed {int(summary['seed'])}{code} --out again"
    )


def _words(text: object) -> str:
    """Return a text, cut if no reader would read it to its end."""
    return shortened(text, MOST_CHARACTERS)
