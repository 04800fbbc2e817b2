"""`swarmstart replicate`: every claim of the chapter, measured and judged."""

from __future__ import annotations

import argparse
import shlex
import statistics
import time as clock
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.engine.cells import Cell, Outcome, carried_out, finished
from swarmstart.cases.campaign.judging.statistics import spread
from swarmstart.cases.campaign.studies.replication import (
    Chapter,
    ChapterClaim,
    JudgedClaim,
    JudgedPart,
    PartOfClaim,
    PlannedPart,
    cells_of,
    chapter,
    figure_cells,
    judged,
    planned,
)
from swarmstart.cases.campaign.studies.verdicts import Verdict
from swarmstart.cases.commands.terminal import DONE, GATE, Progress, answer
from swarmstart.cases.drawing.report.pages.replication_page import replication_page
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.record.files import (
    locked,
    require_ours,
    to_json,
    write_json,
    write_text,
)
from swarmstart.cases.record.record import versions
from swarmstart.errors import SwarmstartError

RESULTS = Path("results") / "replication"
COMMAND = "swarmstart replicate"
TYPICAL_S = 2.5
"""Estimated time of a cell that has never been run [s]."""
WORST_FIRST = (
    Verdict.NOT_JUDGED,
    Verdict.FAILS,
    Verdict.IN_PART,
    Verdict.NO_DIFFERENCE,
    Verdict.NOT_SHOWN,
    Verdict.HOLDS,
)


class UnknownClaimError(SwarmstartError, LookupError):
    """A number after --only belongs to no claim."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """The work that a call of the command does.

    Attributes:
        chapter: The chapter.
        claims: The claims to judge.
        parts: The parts of each claim, in the same order.
        figures: Runs (cells) of the figures; empty if single claims are chosen.
    """

    chapter: Chapter
    claims: list[ChapterClaim]
    parts: list[list[PlannedPart]]
    figures: list[Cell]

    def cells(self) -> list[Cell]:
        """Return every run (cell) once; those with figures are longest, so first."""
        every = [cell for parts in self.parts for cell in cells_of(parts)]
        return list({cell.key: cell for cell in (*self.figures, *every)}.values())


def replicate_command(options: argparse.Namespace) -> int:
    """Judge the claims that the options choose; return the exit code."""
    began = clock.perf_counter()
    seeds = 1 if options.quick else options.seeds
    plan = _planned(options.only, seeds)
    root = Path(options.out) if options.out else RESULTS
    cells, folder = plan.cells(), root / "cells"
    if options.dry_run:
        foreseen = _foreseen(cells, folder, options.workers)
        answer(to_json(foreseen) if options.json else _dry(foreseen))
        return DONE
    stem = "-".join(["replication", *map(str, sorted(set(options.only)))])
    _require_own(root, stem)
    with Progress("replicate", quiet=options.quiet, of="run") as progress:
        outcomes = carried_out(
            cells, folder, workers=options.workers, told=progress.update
        )
    # Parts of several claims share cells, so outcomes are found by their keys.
    by_key = dict(zip((cell.key for cell in cells), outcomes, strict=True))
    claims = [
        judged(claim, parts, by_key)
        for claim, parts in zip(plan.claims, plan.parts, strict=True)
    ]
    content = _content(plan, claims, len(cells), options)
    content["figures"] = _figures(plan, by_key)
    page = replication_page(content, root)
    with locked(root):
        # Again, under the lock: the files can have appeared in the meantime.
        _require_own(root, stem)
        write_json(
            root / f"{stem}.json",
            {**content, "wall_s": clock.perf_counter() - began},
        )
        write_text(root / f"{stem}.html", page)
    if options.json:
        answer(to_json(content))
    else:
        answer(markdown(content) if options.markdown else _report(content, root / stem))
    return DONE if all(claim.is_expected for claim in claims) else GATE


def _require_own(root: Path, stem: str) -> None:
    """Raise if a record or a page is there that this command has not written."""
    record, page = root / f"{stem}.json", root / f"{stem}.html"
    command = f'"command": "{COMMAND}'
    require_ours(record, lambda text: command in text, "the record of a replication")
    # A page has no mark of its own: it is ours if the record is beside it.
    require_ours(page, lambda _: record.exists(), "the page of a replication")


def _planned(only: Sequence[int], seeds: int | None) -> Plan:
    """Return the work to do; raise UnknownClaimError for an unknown number."""
    whole = chapter()
    known = {claim.id: claim for claim in whole.claims}
    unknown = [number for number in only if number not in known]
    if unknown:
        raise UnknownClaimError(
            f"expected --only to be a claim from {min(known)} to {max(known)}, "
            f"found {unknown[0]}"
        )
    claims = [known[number] for number in sorted(set(only))] or whole.claims
    return Plan(
        chapter=whole,
        claims=claims,
        parts=[planned(whole, claim, seeds=seeds) for claim in claims],
        figures=[] if only else figure_cells(whole),
    )


def _foreseen(cells: Sequence[Cell], folder: Path, workers: int) -> dict[str, Any]:
    """Return the number of cells, of those kept from before, and the estimated time."""
    kept = [outcome for cell in cells if (outcome := finished(cell, folder))]
    missing = len(cells) - len(kept)
    known = [outcome.seconds for outcome in kept if outcome.seconds > 0]
    each = statistics.mean(known) if known else TYPICAL_S
    return {
        "schema": 1,
        "runs": len(cells),
        "kept": len(kept),
        "missing": missing,
        "seconds": missing * each / workers,
        "workers": workers,
    }


def _dry(foreseen: Mapping[str, Any]) -> str:
    """Return the estimate of a dry run as text."""
    runs = counted(foreseen["runs"], "run")
    text = "{}, {kept} kept from before, {missing} to do".format(runs, **foreseen)
    if not foreseen["missing"]:
        return text
    time = "about {seconds:.0f} s with {workers} worker processes".format(**foreseen)
    return f"{text}\n{time}"


def _content(
    plan: Plan,
    claims: Sequence[JudgedClaim],
    runs: int,
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Return the content of replication.json and of the page."""
    counts = Counter(str(claim.verdict) for claim in claims)
    if options.quick:
        seeds = "one seed each"
    elif options.seeds:
        seeds = f"{counted(options.seeds, 'seed')} of each run that is random"
    else:
        seeds = "1 to 10 seeds each"
    only = "".join(f" --only {number}" for number in options.only)
    return {
        "schema": 1,
        "command": COMMAND
        + (" --quick" if options.quick else "")
        + (f" --seeds {options.seeds}" if options.seeds else "")
        + only,
        "quick": options.quick,
        "seeds_in_words": seeds,
        "runs": runs,
        "counted": ", ".join(f"{n} {verdict}" for verdict, n in counts.most_common()),
        "claims": [recorded(claim) for claim in claims],
        "versions": versions(),
    }


def recorded(judged_claim: JudgedClaim) -> dict[str, Any]:
    """Return a judged claim as plain data, as in the record."""
    claim = judged_claim.claim
    return {
        "id": claim.id,
        "text": claim.text,
        "source": claim.source,
        "verdict": str(judged_claim.verdict),
        "expected": str(claim.expected),
        "as_expected": judged_claim.is_expected,
        "because": claim.because,
        "parts": [_part(part) for part in judged_claim.parts],
    }


def _part(judged_part: JudgedPart) -> dict[str, Any]:
    part, claim = judged_part.planned.part, judged_part.planned.claim
    over = ", ratio" if claim.against is not None else ""
    over += ", median" if part.over == "median" else ""
    bound = "never" if claim.bound is None else f"{claim.bound:.{_digits(part)}g}"
    bound += f" ± {claim.width:g}" if claim.width else ""
    if part.measure and claim.share < 1:
        bound += f" in {claim.share:.0%} of the runs"
    asked = f"{claim.measure}{over} {claim.relation} {bound}"
    commands = judged_part.planned.commands
    return {
        "scenario": part.scenario,
        "variant": judged_part.planned.variant,
        "claim": part.claim,
        "reading": part.reading,
        "text": claim.text,
        "asked": claim.measure if part.beside and claim.bound is None else asked,
        "measure": claim.measure,
        "relation": claim.relation,
        "bound": claim.bound,
        "width": claim.width,
        "basis": part.basis,
        "values": list(judged_part.values),
        "pairs": [list(pair) for pair in judged_part.pairs],
        "measured": _measured(judged_part),
        "runs": len(judged_part.values),
        "verdict": str(judged_part.verdict),
        "test": judged_part.test,
        "tolerance": part.tolerance,
        "command": commands[0],
        "against": commands[1] if len(commands) > 1 else "",
        "failures": list(judged_part.failures),
    }


def _measured(judged_part: JudgedPart) -> str:
    """Return the measured values; of ratios also the medians of both sides."""
    said = spread(judged_part.values, digits=_digits(judged_part.planned.part))
    if not judged_part.pairs:
        return said
    sides = zip(*judged_part.pairs, strict=True)
    first, second = (_median(values) for values in sides)
    return f"{said} ({first} to {second})"


def _digits(part: PartOfClaim) -> int:
    """Return the number of digits to show: more if the part has its own bound."""
    return 6 if part.scenario and part.measure else 4


def _median(values: Sequence[Measure]) -> str:
    known = [float(value) for value in values if isinstance(value, int | float)]
    return spread([statistics.median(known)] if known else [None], digits=5)


def _figures(plan: Plan, outcomes: Mapping[str, Outcome]) -> list[dict[str, Any]]:
    """Return the chapter's figures whose runs are finished, with their files."""
    drawn = []
    for figure, cell in zip(
        plan.chapter.figures, figure_cells(plan.chapter), strict=True
    ):
        outcome = outcomes.get(cell.key)
        if outcome is None:
            continue
        variant = plan.chapter.variants.get(figure.scenario)
        words = ["swarmstart", "run", figure.scenario]
        words += ["--variant", variant] if variant else []
        words += ["--search", figure.search] if figure.search else []
        drawn.append(
            {
                "number": figure.number,
                "title": figure.title,
                "scenario": figure.scenario,
                "kind": cell.job["settings"]["kind"],
                "search": figure.search,
                "command": shlex.join(words),
                "cell": outcome.folder.name,
                "files": outcome.result["figures"] if outcome.result else [],
                "failure": outcome.failure,
            }
        )
    return drawn


def deciding(claim: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the parts that decide a claim's verdict, for its row in a table.

    The first is the part that is farthest from holding; of several equally far ones it
    is the earliest. If the claim holds in part, a part that is nearer to holding
    follows, if there is one: the earliest part that holds, or else the earliest part
    that holds in part.
    """
    judged = [p for p in claim["parts"] if p["verdict"] != str(Verdict.BESIDE)]
    # min returns the first of equals, as promised.
    told = [min(judged, key=lambda part: WORST_FIRST.index(part["verdict"]))]
    if claim["verdict"] == str(Verdict.IN_PART):
        better = [
            part
            for verdict in (Verdict.HOLDS, Verdict.IN_PART)
            for part in judged
            if part["verdict"] == str(verdict) != told[0]["verdict"]
        ]
        told += better[:1]
    return told


def markdown(content: Mapping[str, Any]) -> str:
    """Return a Markdown table: a row for each claim, with the parts that decide."""
    lines = [
        "| claim | what the chapter says | asked | measured | verdict |",
        "| --- | --- | --- | --- | --- |",
    ]
    for claim in content["claims"]:
        parts = deciding(claim)
        # The scenario is named only if the claim is judged on more than one.
        several = len({_run_of(part) for part in claim["parts"]}) > 1
        cells = (
            str(claim["id"]),
            claim["text"],
            "<br>".join(_asked(part, where=several) for part in parts),
            "<br>".join(_found(part, alone=len(parts) == 1) for part in parts),
            claim["verdict"],
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _run_of(part: Mapping[str, Any]) -> str:
    """Return the scenario and the variant of a part; empty for a computation."""
    return " ".join(filter(None, (part["scenario"], part["variant"])))


def _asked(part: Mapping[str, Any], *, where: bool) -> str:
    """Return the condition of a part, with its reading and the origin of its bound.

    With `where` the scenario is named, too.
    """
    notes = [_run_of(part)] if where and part["scenario"] else []
    notes += [part["reading"]] if part["reading"] else []
    notes += ["bound ours"] if part["basis"] == "ours" else []
    return f"`{part['asked']}`" + (f" ({'; '.join(notes)})" if notes else "")


def _found(part: Mapping[str, Any], *, alone: bool) -> str:
    """Return the measured value of a part; "-" if the part is not judged."""
    if part["verdict"] == str(Verdict.NOT_JUDGED):
        return "-"
    said: str = part["measured"]
    return said if alone else f"{said}: {part['verdict']}"


def _report(content: Mapping[str, Any], path: Path) -> str:
    """Return the result as text."""
    plural = "" if content["runs"] == 1 else "s"
    lines = [f"{content['runs']} run{plural}, {content['seeds_in_words']}", ""]
    width = max(len(claim["verdict"]) for claim in content["claims"])
    for claim in content["claims"]:
        head = f"{claim['id']:>2}  {claim['verdict'].ljust(width)}  {claim['text']}"
        lines.append(f"{head} [{claim['source']}]")
        if not claim["as_expected"]:
            lines.append(f"      expected: {claim['expected']}. {claim['because']}")
        for part in claim["parts"]:
            where = _run_of(part)
            test = f" ({part['test']})" if part["test"] else ""
            lines.append(
                f"      {(where or 'computed').ljust(32)}  "
                f"{_asked(part, where=False).replace('`', '')}: "
                f"{_found(part, alone=False)}{test}"
            )
            lines += [f"        a run failed: {text}" for text in part["failures"]]
    lines += ["", f"{content['counted']}"]
    lines += [f"page    {path}.html", f"record  {path}.json"]
    return "\n".join(lines)
