"""`swarmstart run`: run one scenario, print the result in words, judge its claims."""

import argparse
import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

import yaml

from swarmstart.cases.campaign.running.run import Run, default_folder, run
from swarmstart.cases.commands.actions.seeds import run_seeds
from swarmstart.cases.commands.options.allowing import allowing
from swarmstart.cases.commands.options.angles import warn_of_angles
from swarmstart.cases.commands.options.conditions import (
    Condition,
    condition_of,
    met_conditions,
)
from swarmstart.cases.commands.options.figure_formats import figure_formats
from swarmstart.cases.commands.terminal.output import (
    DONE,
    GATE,
    INFEASIBLE,
    answer,
    say,
)
from swarmstart.cases.commands.terminal.progress import Progress
from swarmstart.cases.commands.wording.claim_lines import claim_table, short_claims
from swarmstart.cases.commands.wording.measure_lines import measure_lines
from swarmstart.cases.commands.wording.outcomes import told_status
from swarmstart.cases.commands.wording.words import extras, sentences
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.duration import seconds_of
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


class BoundOfSeedsError(SwarmstartError, ValueError):
    """A bound was asked for together with several seeds."""


def run_command(options: argparse.Namespace) -> int:
    """Run the scenario that the options name; return the exit code."""
    with contextlib.ExitStack() as ahead:

        def begin(scenario: Scenario) -> None:
            algorithm = scenario.search.algorithm(scenario.budget.evaluations)
            population = None if algorithm is None else population_of(algorithm)
            if population is not None and not options.print_config:
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
    conditions = [condition_of(text, resolved) for text in options.fail_on]
    if options.print_config:
        text = yaml.safe_dump(
            dict(resolved.settings), sort_keys=False, allow_unicode=True
        )
        answer(text.rstrip())
        return DONE
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
    """Return the time for a bound [s]; None: no bound is asked for."""
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
    """Return the text that a person reads of a run.

    Args:
        finished: The run.
        measures: Whether all measures and all claims are told.
    """
    lines = [*sentences(finished), *extras(finished)]
    if measures:
        lines += ["", *_search_lines(finished), "", *measure_lines(finished)]
        lines += claim_table(finished.claims)
    else:
        lines += short_claims(finished.claims)
    return "\n".join([*lines, *_files(finished)])


def _search_lines(finished: Run) -> list[str]:
    """Return what the search and the starts of the first plan led to."""
    sense = finished.flight.posed.agents[0].problem.sense
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
