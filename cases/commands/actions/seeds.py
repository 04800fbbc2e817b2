"""`swarmstart run --seeds`: one scenario run with many seeds, measures with spread.

A few lines give the result in words. For each claim that fails in some runs, a line
names the seeds in which it fails, the values, and a command that shows one of these
runs.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import shlex
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.campaign.engine.cells import Cell, Outcome, carried_out
from swarmstart.cases.campaign.running.seeds import seeds_content, spread_of
from swarmstart.cases.campaign.trials.flight_trial import flight_cell
from swarmstart.cases.commands.actions.shared_options import Condition, met_conditions
from swarmstart.cases.commands.terminal import (
    DONE,
    GATE,
    INFEASIBLE,
    Progress,
    answer,
    say,
    table_lines,
)
from swarmstart.cases.commands.wording.measures import (
    measure_table,
    measures_of_run,
)
from swarmstart.cases.commands.wording.words import heading, method, picture
from swarmstart.cases.drawing.drawing import write_figures
from swarmstart.cases.drawing.seed_figures import seed_figures
from swarmstart.cases.drawing.wording import KEPT, duration, is_number, quantity
from swarmstart.cases.format.document import counted, printable
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.record.files import (
    is_record,
    locked,
    require_ours,
    to_json,
    write_json,
)
from swarmstart.cases.record.record import (
    CELLS,
    FIGURES,
    PNG,
    SEEDS,
    finished_key,
    require_own_seeds,
    withdraw,
)

HEAD = ("measure", "lowest", "median", "highest", "unit", "meaning")
SHOWN = 5
"""Seeds that a line names; further ones are counted."""
OF_SEEDS = ("--seeds", "--workers", "--out")
"""Options, each with a value, that the command for one run does not have."""
NO_UNITS = ("", "cost")
"""Entries for the unit in a table of measures that are not written after a number."""
SILENT = ("--no-figures", "--json", "-q", "--quiet")
"""Options without which a run shows more."""


class Told(NamedTuple):
    """A measure, and the words of a sentence that gives its value.

    Attributes:
        name: The measure.
        words: The beginning of the sentence.
        unit: Unit of the measure; may be empty.
        undefined: Words on runs in which the measure is undefined; may be empty.
    """

    name: str
    words: str
    unit: str
    undefined: str = ""


OUTCOMES = (
    Told("settle_time_s", "Settled", "s", "not settled"),
    Told("x_settle_s", "Settled in x", "s", "not settled"),
    Told("position_error_m", "Largest distance from a slot at the end", "m"),
    Told("verified_cost", "Cost, integrated more finely", ""),
    Told("flown_cost", "Cost of the simulated path", ""),
    Told("closed_loop_cost", "Closed-loop cost", ""),
    Told("cost", "Cost of the first plan", ""),
    Told("mean_arrival_time_s", "Mean time of arrival", "s"),
)
"""Measures of the result: the first one that some run defines is used."""
CONSTRAINTS = (
    Told("min_distance_m", "closest distance of two vehicles", "m"),
    Told("min_range_ft", "closest distance of the two aircraft", "ft"),
    Told("obstacle_clearance_m", "clearance of obstacles", "m"),
)
"""Measures of constraints: lines give the lowest and the median value of each."""
EXCESS = Told("constraint_excess", "largest excess of a constraint along the path", "")
OF_VEHICLE = "vehicle_step_ms"
"""Measure of the time of each vehicle in a step, in a swarm [ms]."""
TIMES = ("step_seconds_median", "step_seconds_max", "plan_seconds")


def run_seeds(
    resolved: Resolved,
    options: argparse.Namespace,
    root: Path,
    conditions: Sequence[Condition],
) -> int:
    """Run a scenario with seeds 0 to N - 1; return the exit code.

    The exit code reports a failure if a condition of --fail-on is true in any run.
    """
    # Named, so that the claims of the scenario are judged.
    cells = [flight_cell(resolved, seed, named=True) for seed in range(options.seeds)]
    folder = Path(options.out) if options.out else root / _name(resolved, cells)
    # A file of another program is refused now, not after the runs.
    require_ours(
        folder / SEEDS, functools.partial(is_record, name="seeds"), "runs over seeds"
    )
    command, keys = shlex.join(["swarmstart", *options.words]), [c.key for c in cells]
    with locked(folder):
        if not options.force:
            require_own_seeds(folder, keys)
        name = resolved.scenario.name
        with Progress(name, quiet=options.quiet, of="run") as progress:
            outcomes = carried_out(
                cells,
                folder / CELLS,
                workers=options.workers,
                told=lambda done, total, what: progress.update(
                    done, total, what.removeprefix(f"{name}, ")
                ),
            )
        content = seeds_content(resolved, outcomes, command=command, key=keys[0])
        if finished_key(folder, SEEDS) != keys[0]:
            withdraw(folder, SEEDS)
        figures = [] if options.no_figures else [*seed_figures(content)]
        drawn = write_figures(
            figures, folder / FIGURES, formats=figure_formats(options)
        )
        content["figures"] = [file.name for file in drawn]
        write_json(folder / SEEDS, content)
    if options.json:
        answer(to_json(content))
    else:
        failing = failing_lines(resolved, outcomes, options.words)
        answer(_report(content, folder, resolved, failing, measures=options.measures))
    return _exit_code(content, outcomes, resolved, conditions)


def figure_formats(options: argparse.Namespace) -> tuple[str, ...]:
    """Return the formats of the figures of `run`, each once."""
    return tuple(dict.fromkeys(options.formats)) or PNG


def _name(resolved: Resolved, cells: Sequence[Cell]) -> Path:
    """Return <scenario>/seeds-<key>, with a hash of all that determines the runs."""
    keys = hashlib.sha256("".join(cell.key for cell in cells).encode()).hexdigest()
    return Path(resolved.scenario.name) / f"seeds-{keys[:16]}"


def _report(
    content: Mapping[str, Any],
    folder: Path,
    resolved: Resolved,
    failing: Sequence[str],
    *,
    measures: bool,
) -> str:
    """Return the text that a person reads of content as seeds.json has it."""
    lines = sentences_of_seeds(content, folder / FIGURES)
    failed = [(n, text) for n, text in enumerate(content["failures"]) if text]
    lines += [f"Seed {number} failed: {printable(text)}" for number, text in failed]
    claims = [row for row in map(_claim_row, content["claims"]) if row]
    if measures:
        spreads = {name: spread_of(v) for name, v in content["measures"].items()}
        values = {name: cells for name, (*cells, _) in spreads.items()}
        notes = {name: note for name, (*_, note) in spreads.items() if note}
        lines += ["", *measure_table(resolved, values, HEAD, notes), ""]
    if claims:
        lines += ["Claims:", *table_lines(claims), *failing]
    return "\n".join([*lines, f"Record: {folder}"])


def _claim_row(claim: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a claim and in how many runs it holds; empty if no run can judge it."""
    known = [held for held in claim["holds"] if held is not None]
    if not known:
        return ()
    return claim["id"], f"holds in {sum(known)} of {len(known)}", claim["text"]


def _exit_code(
    content: Mapping[str, Any],
    outcomes: Sequence[Outcome],
    resolved: Resolved,
    conditions: Sequence[Condition],
) -> int:
    if not any(content["feasible"]):
        return INFEASIBLE
    failed = [
        f"{claim['id']} in {counted(claim['holds'].count(False), 'run')} "
        f"({', '.join(f'seed {seed}' for seed in failing_seeds(outcomes, number))}): "
        f"{claim['text']}"
        for number, claim in enumerate(content["claims"])
        if claim["gate"] and False in claim["holds"]
    ]
    for seed, outcome in enumerate(outcomes):
        if outcome.result is not None:
            met = met_conditions(conditions, outcome.result["measures"], resolved)
            failed += [f"seed {seed}: {text}" for text in met]
    for failure in failed:
        say(f"gate failed: {printable(failure)}")
    return GATE if failed else DONE


def sentences_of_seeds(content: Mapping[str, Any], figures: Path) -> list[str]:
    """Return lines of text on runs over seeds, from the content of seeds.json.

    Reasons and advice of single plans have lines of their own.
    """
    measures = content["measures"]
    drawn = [figures / name for name in content["figures"]]
    return [
        _task(content),
        f"{_feasible(content)}. {_first_of(OUTCOMES, measures, 'No result')}.",
        *_told_of_plans(content),
        f"{_kept(content)}.",
        _times(measures),
        picture(drawn),
    ]


def _task(content: Mapping[str, Any]) -> str:
    runs = len(content["seeds"])
    head = heading(content["title"], content["scenario"])
    how = content.get("way") or method(
        *(content[key] for key in ("search", "lanes", "polish", "variant"))
    )
    seeds = f"seeds 0 to {runs - 1}" if runs > 1 else "seed 0"
    return f"{head}: {counted(runs, 'run')}, {seeds}; {how}."


def _feasible(content: Mapping[str, Any]) -> str:
    runs = len(content["seeds"])
    found = "were feasible" if content.get("way") else "found feasible plans"
    return f"{sum(content['feasible'])} of {counted(runs, 'run')} {found}"


def _told_of_plans(content: Mapping[str, Any]) -> list[str]:
    """Return each reason and advice of single plans, with its seeds, most first."""
    lines = []
    for role in ("reason", "advice"):
        told = content.get(role) or []
        counts = Counter(text for text in told if text)
        for text, count in counts.most_common(SHOWN):
            seeds = [str(n) for n, one in enumerate(told) if one == text]
            which = f"seed{'s' * (count > 1)} {', '.join(seeds)}"
            if count > SHOWN or count == len(told):
                which = counted(count, "run")
            lines.append(f"{role.capitalize()} ({which}): {printable(text)}.")
    return lines


def _kept(content: Mapping[str, Any]) -> str:
    """Return what had to be kept, and how well it was."""
    measures, broken = content["measures"], content["feasible"].count(False)
    excess = measures.get("constraint_excess", [])
    if excess and broken:
        ends = measures.get("terminal_excess", [])
        known = [float(value) for value in (*excess, *ends) if is_number(value)]
        most = f", by up to {quantity(max(known), 3)}" if known else ""
        return f"Constraints are broken in {counted(broken, 'run')}{most}"
    if excess and all(is_number(value) and value <= KEPT for value in excess):
        return "All constraints are kept along the simulated paths"
    told = _spread(EXCESS, excess) if any(map(is_number, excess)) else ""
    nearest = [_nearest(one, measures.get(one.name, [])) for one in CONSTRAINTS]
    said = "; ".join(filter(None, [*nearest, told]))
    return f"{said[:1].upper()}{said[1:]}" if said else "No constraints are measured"


def _nearest(told: Told, values: list[Any]) -> str:
    """Return the lowest value and the median of a distance; empty without a value."""
    known = [float(value) for value in values if is_number(value)]
    if not known:
        return ""
    low, middle = quantity(min(known), 4), quantity(statistics.median(known), 4)
    # Seeds count from 0, so that the place of a run is its seed.
    seed = values.index(min(known))
    return (
        f"{told.words}: lowest {low} {told.unit} (seed {seed}), "
        f"median {middle} {told.unit}"
    )


def _first_of(
    those: tuple[Told, ...], measures: Mapping[str, list[Any]], otherwise: str
) -> str:
    """Return the first measure that is defined in some run, in words."""
    for told in those:
        values = measures.get(told.name)
        if values is not None and (told.undefined or any(map(is_number, values))):
            return _spread(told, values)
    return otherwise


def _spread(told: Told, values: list[Any]) -> str:
    """Return median and range of a measure, and in how many runs it is defined."""
    known = [float(value) for value in values if is_number(value)]
    missing = len(values) - len(known)
    if not known:
        return f"{told.undefined.capitalize()} in any run"
    unit = f" {told.unit}" if told.unit else ""
    middle, low, high = statistics.median(known), min(known), max(known)
    said = f"{told.words}: median {quantity(middle)}{unit}"
    if low < high:
        said += f", from {quantity(low)} to {quantity(high)}{unit}"
    if told.undefined and missing:
        said += f"; {told.undefined} in {counted(missing, 'run')}"
    return said


def _times(measures: Mapping[str, list[Any]]) -> str:
    """Return the solver's time."""
    found = {
        name: [float(value) for value in measures.get(name, []) if is_number(value)]
        for name in TIMES
    }
    middle, most, plan = found.values()
    if not plan and any(is_number(one) for one in measures.get("confirmed", [])):
        plan = most  # All steps but the first follow the plan.
    if plan:
        # One plan, solved once: its time is the median and the largest one.
        middle, most = plan, plan
    each = [float(v) for v in measures.get(OF_VEHICLE, []) if is_number(v)]
    if each:
        usual, longest = duration(statistics.median(each) / 1e3), max(each) / 1e3
        return (
            f"Time of a vehicle's step: median {usual}, worst of all runs "
            f"{duration(longest)}."
        )
    if not middle or not most:
        return "No times were measured."
    typical = duration(statistics.median(middle))
    if plan:
        return f"Time of a plan: median {typical}, worst {duration(max(most))}."
    return f"Time per step: median {typical}, worst of all runs {duration(max(most))}."


def failing_lines(
    resolved: Resolved, outcomes: Sequence[Outcome], words: Sequence[str]
) -> list[str]:
    """Return a line for each claim that fails in some run.

    Args:
        resolved: The scenario.
        outcomes: Outcomes of its runs, seed by seed from 0 on.
        words: Command line of the runs, word by word, without the program's name.
    """
    units = measures_of_run(resolved)
    lines = []
    for number, claim in enumerate(resolved.scenario.claims):
        seeds = failing_seeds(outcomes, number)
        if seeds:
            values = {seed: _measures(outcomes[seed])[claim.measure] for seed in seeds}
            unit = units[claim.measure]["unit"]
            command = shlex.join(["swarmstart", *words_of_one(words, seeds[0])])
            lines.append(
                f"Claim {printable(claim.id)} fails in {_listed(values, unit)}; "
                f"see it: {printable(command)}"
            )
    return lines


def failing_seeds(outcomes: Sequence[Outcome], number: int) -> list[int]:
    """Return the seeds in which a claim does not hold, by its number from 0 on."""
    return [
        seed
        for seed, outcome in enumerate(outcomes)
        if outcome.result is not None
        and outcome.result["claims"][number]["holds"] is False
    ]


def words_of_one(words: Sequence[str], seed: int) -> list[str]:
    """Return the command line of the run with one seed.

    Example:
        >>> words_of_one(["run", "a.yaml", "--seeds", "9", "--search=ga"], 3)
        ['run', 'a.yaml', '--search=ga', '--seed', '3']
    """
    kept, rest = [], iter(words)
    for word in rest:
        if word in OF_SEEDS:
            # Its value is the next word.
            next(rest, None)
        elif word not in SILENT and word.partition("=")[0] not in OF_SEEDS:
            kept.append(word)
    return [*kept, "--seed", str(seed)]


def _measures(outcome: Outcome) -> Mapping[str, Any]:
    # Asked for failing seeds only, and these have a result.
    found: Mapping[str, Any] = (outcome.result or {})["measures"]
    return found


def _listed(values: Mapping[int, Any], unit: str) -> str:
    """Return seeds, each with its value and unit in brackets."""
    said = [
        f"seed {seed} ({_with_unit(value, unit)})"
        for seed, value in [*values.items()][:SHOWN]
    ]
    left = len(values) - len(said)
    return ", ".join(said) + (f" and {left} more" if left else "")


def _with_unit(value: Any, unit: str) -> str:
    if not is_number(value):
        return "undefined"
    shown = quantity(float(value), 4)
    return f"{shown} {unit}" if unit not in NO_UNITS else shown
