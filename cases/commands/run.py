"""`swarmstart run`: one scenario flown, told, and judged."""

import argparse
import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml

from swarmstart.cases.campaign.run import Run, default_folder, run
from swarmstart.cases.commands.allowing import allowing
from swarmstart.cases.commands.conditions import (
    Condition,
    condition_of,
    met_conditions,
)
from swarmstart.cases.commands.output import (
    DONE,
    GATE,
    INFEASIBLE,
    answer,
    say,
    table_lines,
)
from swarmstart.cases.commands.progress import Progress
from swarmstart.cases.commands.seeds import run_seeds
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.duration import seconds_of
from swarmstart.cases.format.kind import NEVER, Measure
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.format.settings import Scenario
from swarmstart.cases.record.bound_content import CERTIFICATE
from swarmstart.cases.record.files import to_json
from swarmstart.cases.record.record import Recording
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.first_use import kernels_ahead
from swarmstart.ocp import DivergedError, population_of

RESULTS = Path("results")


class BoundOfSeedsError(SwarmstartError, ValueError):
    """A bound was asked for of runs over seeds, which have it in common."""


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
    """Run; `begin` is told of the scenario as soon as its form is known."""
    bound_s = _bound_s(options)
    resolved = resolve(
        read_document(options.scenario),
        variant=options.variant,
        search=options.search,
        polish=options.polish,
        assignments=options.assignments,
        valid=begin,
    )
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
    answer(to_json(finished.summary()) if options.json else _report(finished))
    return _exit_code(finished, conditions)


def _bound_s(options: argparse.Namespace) -> float | None:
    """Return the time for a bound [s]; None: none is sought."""
    if options.bound is None:
        return None
    if options.seeds is not None:
        raise BoundOfSeedsError(
            "expected --bound without --seeds: a bound is of the problem, the same for "
            "all seeds"
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


def _report(finished: Run) -> str:
    """Return what a person reads of a run."""
    summary = finished.summary()
    scenario = finished.resolved.scenario
    title = printable(scenario.title or scenario.name)
    variant = f", {finished.resolved.variant}" if finished.resolved.variant else ""
    method = f"{summary['search']}, polish {summary['polish']}, seed {finished.seed}"
    lines = [
        f"{title} ({summary['scenario']}{variant}; {method})",
        finished.status,
    ]
    sense = finished.flight.posed.agents[0].problem.sense
    lines += finished.search_report.lines(sense)
    if finished.starts is not None:
        lines += finished.starts.lines(sense)
    if finished.resumed:
        lines.append(f"went on after step {finished.resumed}, where it had stopped")
    if finished.bound_content is not None:
        lines.append(f"bound: {printable(finished.bound_content['words'])}")
    lines.append("")
    lines += table_lines(
        [(name, _shown(value)) for name, value in finished.measures.items()]
    )
    judged = [claim for claim in finished.claims if claim["holds"] is not None]
    if judged:
        lines += ["", "claims", *table_lines([_claim_row(claim) for claim in judged])]
    others = [claim for claim in finished.claims if claim["holds"] is None]
    if others:
        lines += ["", "claims not judged, which need"]
        lines += table_lines([(c["id"], c["text"], c["needs"]) for c in others])
    return "\n".join([*lines, *_files(finished)])


def _files(finished: Run) -> list[str]:
    """Return lines on what was written."""
    if finished.folder is None:
        return []
    lines = ["", f"record   {finished.folder}"]
    if finished.figures:
        lines.append(f"figures  {finished.folder / 'figures'}")
    if (finished.bound_content or {}).get("certificate"):
        lines.append(f"proof    {finished.folder / CERTIFICATE}")
    return lines


VERDICTS = {True: "holds", False: "does not hold", None: "not judged"}


def _claim_row(claim: dict[str, Any]) -> tuple[str, ...]:
    bound = NEVER if claim["bound"] is None else f"{claim['bound']:.4g}"
    undefined = claim["measured"] is None
    measured = f"{claim['measure']} = "
    measured += NEVER if undefined else _shown(claim["measured"])
    question = f"{measured} {claim['relation']} {bound}"
    return claim["id"], VERDICTS[claim["holds"]], question, claim["text"]


def _shown(value: Measure) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_shown(item) for item in value) + "]"
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
