"""`swarmstart run`: run one scenario, print the result in words, judge its claims.

Claims are printed as a short summary, or with --measures as a table of all of them.
"""

import argparse
import contextlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from swarmstart.cases.campaign.running.finished_run import Run, default_folder
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.trials.solvers import seconds_of
from swarmstart.cases.commands.actions.checking import warn_of_angles
from swarmstart.cases.commands.actions.seeds import figure_formats, run_seeds
from swarmstart.cases.commands.actions.shared_options import (
    Condition,
    allowing,
    condition_of,
    met_conditions,
)
from swarmstart.cases.commands.terminal import (
    DONE,
    GATE,
    INFEASIBLE,
    Progress,
    answer,
    say,
    table_lines,
)
from swarmstart.cases.commands.wording.measures import measure_lines, value_text
from swarmstart.cases.commands.wording.outcomes import told_status
from swarmstart.cases.commands.wording.words import extras, sentences
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.kind import NEVER
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.format.settings import Scenario
from swarmstart.cases.record.bound_content import CERTIFICATE
from swarmstart.cases.record.files import to_json
from swarmstart.cases.record.record import Recording
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.running import kernels_ahead
from swarmstart.ocp import DivergedError, population_of

RESULTS = Path("results")
ANIMATED = (".gif", ".mp4")
VERDICTS = {True: "holds", False: "does not hold", None: "not judged"}
SHOWN = 10
"""Claims that the summary names; further ones are counted."""
Claim = Mapping[str, Any]


class BoundOfSeedsError(SwarmstartError, ValueError):
    """A bound was asked for together with several seeds."""


def run_command(options: argparse.Namespace) -> int:
    """Run the scenario that the options name; return the exit code."""
    with contextlib.ExitStack() as ahead:

        def begin(scenario: Scenario) -> None:
            search = scenario.search_settings()
            population = None if search is None else population_of(search.algorithm)
            if population is not None and not options.print_config:
                # Another process compiles them while this one checks the terminal set.
                ahead.enter_context(kernels_ahead(population))

        return _command(options, begin)


def _command(options: argparse.Namespace, begin: Callable[[Scenario], None]) -> int:
    """Run; `begin` gets the scenario as soon as its form is known."""
    bound_s = _bound_s(options)
    resolved = resolve(
        read_document(options.scenario),
        variant=options.variant,
        search=options.search,
        polish=options.polish,
        assignments=options.assignments,
        valid=begin,
    )
    warn_of_angles(resolved.settings)
    # Before the run, so that a misspelt condition costs no time.
    conditions = [condition_of(text, resolved) for text in options.fail_on]
    if options.print_config:
        text = yaml.safe_dump(
            # Definitions of a scenario can depend on earlier ones: keep their order.
            dict(resolved.settings),
            sort_keys=False,
            allow_unicode=True,
        )
        answer(text.rstrip())
        return DONE
    # Not before: --print-config runs no code and needs no permission.
    resolved = allowing(resolved, options)
    if options.seeds is not None:
        return run_seeds(resolved, options, RESULTS, conditions)
    default = default_folder(resolved, options.seed, RESULTS)
    folder = Path(options.out) if options.out else default
    recording = Recording(
        folder=folder,
        figures=not options.no_figures,
        animation=options.animation,
        force=options.force,
        figure_formats=figure_formats(options),
    )
    try:
        with Progress(resolved.scenario.name, quiet=options.quiet) as progress:
            finished = run(
                resolved,
                seed=options.seed,
                recording=recording,
                bound_s=bound_s,
                threads=options.workers,
                progress=progress.update,
            )
    except DivergedError as error:
        say(str(error))
        return INFEASIBLE
    if options.json:
        answer(to_json(finished.summary()))
    else:
        answer(_report(finished, measures=options.measures))
    return _exit_code(finished, conditions)


def _bound_s(options: argparse.Namespace) -> float | None:
    """Return the time for a bound [s]; None if no bound is asked for."""
    if options.bound is None:
        return None
    if options.seeds is not None:
        raise BoundOfSeedsError(
            "expected --bound without --seeds: the bound is the same for all seeds"
        )
    return seconds_of(options.bound)


def _exit_code(finished: Run, conditions: Sequence[Condition]) -> int:
    if not finished.feasible:
        return INFEASIBLE
    failed = [
        f"{claim['id']}: {claim['text']}"
        for claim in finished.claims
        if claim["gate"] and claim["holds"] is False
    ]
    failed += met_conditions(conditions, finished.measures, finished.resolved)
    for failure in failed:
        say(f"gate failed: {printable(failure)}")
    return GATE if failed else DONE


def _report(finished: Run, *, measures: bool) -> str:
    """Return the text that a person reads of a run, perhaps with all measures."""
    lines = [*sentences(finished), *extras(finished)]
    if measures:
        lines += ["", *_search_lines(finished), "", *measure_lines(finished)]
        lines += claim_table(finished.claims)
    else:
        lines += short_claims(finished.claims)
    return "\n".join([*lines, *_files(finished)])


def _search_lines(finished: Run) -> list[str]:
    """Return what the search and the starts of the first plan led to."""
    sense = finished.flight.sense
    lines = [told_status(finished), *finished.search_report.lines(sense)]
    if finished.starts is not None:
        lines += finished.starts.lines(sense)
    return lines


def _files(finished: Run) -> list[str]:
    """Return lines on what was written; the last one is the record's folder."""
    if finished.folder is None:
        return []
    lines = []
    if (finished.bound_content or {}).get("certificate"):
        lines.append(f"Proof: {finished.folder / CERTIFICATE}")
    animated = [file for file in finished.figures if file.suffix in ANIMATED]
    lines += [f"Animation: {file}" for file in animated]
    return [*lines, f"Record: {finished.folder}"]


def short_claims(claims: Sequence[Claim]) -> list[str]:
    """Return how many claims hold, and each that does not; nothing without claims."""
    if not claims:
        return []
    counts = Counter(claim["holds"] for claim in claims)
    words = {True: "hold", False: "do not hold", None: "not judged"}
    if counts[False] == 1:
        words[False] = "does not hold"
    if counts[True] == 1:
        words[True] = "holds"
    said = [f"{counts[is_so]} {word}" for is_so, word in words.items() if counts[is_so]]
    lines = [f"Claims: {', '.join(said)}{_needs(claims)}."]
    wrong = [claim for claim in claims if claim["holds"] is False]
    lines += table_lines([_row(claim) for claim in wrong[:SHOWN]])
    if len(wrong) > SHOWN:
        lines.append(f"  and {len(wrong) - SHOWN} more, see --measures")
    return lines


def claim_table(claims: Iterable[Claim]) -> list[str]:
    """Return all claims: those that were judged, then those that were not."""
    lines: list[str] = []
    judged = [claim for claim in claims if claim["holds"] is not None]
    if judged:
        lines += ["", "claims", *table_lines([_row(claim) for claim in judged])]
    others = [claim for claim in claims if claim["holds"] is None]
    if others:
        lines += ["", "claims not judged, and what they need"]
        lines += table_lines([(c["id"], c["needs"], c["text"]) for c in others])
    return lines


def _needs(claims: Iterable[Claim]) -> str:
    """Return what most of the claims need that were not judged."""
    needs = Counter(claim["needs"] for claim in claims if claim["holds"] is None)
    if not needs:
        return ""
    (most, count), total = needs.most_common(1)[0], needs.total()
    # All of them need the same.
    if count == total:
        return f" (needs {most})"
    if 2 * count <= total:
        return " (--measures shows what they need)"
    return f" ({count} of them: needs {most}; --measures shows all)"


def _row(claim: Claim) -> tuple[str, ...]:
    """Return a judged claim as a row of a table."""
    bound = NEVER if claim["bound"] is None else f"{claim['bound']:.4g}"
    # None is the time of an event that never comes; the bound can be the same.
    undefined = claim["measured"] is None
    measured = NEVER if undefined else value_text(claim["measured"])
    question = f"{claim['measure']} = {measured} {claim['relation']} {bound}"
    return claim["id"], VERDICTS[claim["holds"]], question, claim["text"]
