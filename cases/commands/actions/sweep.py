"""`swarmstart sweep`: solve all instances of a scenario, print the result in words."""

import argparse
from pathlib import Path

from swarmstart.cases.campaign.studies.sweeping import Sweep, sweep_key, swept
from swarmstart.cases.commands.actions.checking import warn_of_ramps
from swarmstart.cases.commands.actions.run import RESULTS
from swarmstart.cases.commands.actions.seeds import figure_formats
from swarmstart.cases.commands.actions.shared_options import allowing
from swarmstart.cases.commands.terminal import DONE, INFEASIBLE, Progress, answer
from swarmstart.cases.format.document import counted, printable
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.record.files import to_json
from swarmstart.cases.record.record import Recording
from swarmstart.ocp.answer import status_line
from swarmstart.ocp.instances import told_invalid


def sweep_command(options: argparse.Namespace) -> int:
    """Sweep the scenario that the options name; return the exit code."""
    resolved = resolve(
        read_document(options.scenario),
        variant=options.variant,
        polish=options.polish,
        assignments=options.assignments,
    )
    resolved = allowing(resolved, options)
    name = resolved.scenario.name
    default = RESULTS / name / sweep_key(resolved, options.seed)
    recording = Recording(
        folder=Path(options.out) if options.out else default,
        figures=not options.no_figures,
        force=options.force,
        figure_formats=figure_formats(options),
    )
    with Progress(name, quiet=options.quiet, of="instance") as progress:
        sweep = swept(
            resolved,
            seed=options.seed,
            recording=recording,
            strict=options.strict,
            threads=options.workers,
            progress=progress.update,
        )
    warn_of_ramps(name, resolved.posed())
    answer(to_json(sweep.summary()) if options.json else _report(sweep))
    return DONE if sweep.solutions.is_confirmed.any() else INFEASIBLE


def _report(sweep: Sweep) -> str:
    """Return the text that a person reads of a sweep; the folder is its last line."""
    solutions, name = sweep.solutions, sweep.resolved.scenario.name
    of = f"{counted(len(solutions), 'instance')} of {name}"
    lines = [f"{of} in {solutions.seconds:.3g} s: {', '.join(sweep.given.columns)}."]
    lines += [
        f"  {count:>7} {status_line(status)}"
        for status, count in solutions.counts.items()
    ]
    lines += sweep.cost_lines()
    if solutions.sampled:
        line = solutions.sampled_line
        lines.append(f"{line[0].upper()}{line[1:]}.")
    lines += map(printable, told_invalid(sweep.invalid))
    return "\n".join([*lines, f"Record: {sweep.folder}"])
