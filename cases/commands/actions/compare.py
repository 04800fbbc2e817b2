"""`swarmstart compare`: solvers side by side, same budget, paired seeds.

Before a comparison begins, a message says if it has too few seeds to show a difference.
"""

from __future__ import annotations

import argparse
import functools
import json
import shlex
import statistics
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.campaign.engine.cells import (
    LOCAL,
    Cell,
    Outcome,
    carried_out,
    finished,
)
from swarmstart.cases.campaign.judging.content import content_of, read_comparison
from swarmstart.cases.campaign.judging.judgement import compared_pairs, fewest_seeds
from swarmstart.cases.campaign.judging.regression import regression
from swarmstart.cases.campaign.judging.report import LISTED, listed, report_text
from swarmstart.cases.campaign.judging.results_table import (
    append_runs,
    pyarrow_module,
    require_table,
    tabled_runs,
    write_curves,
    write_parquet,
)
from swarmstart.cases.campaign.judging.runs import About, Asked
from swarmstart.cases.campaign.studies.comparing import (
    Contest,
    bounds_of,
    contest_of,
    earlier_best,
    interleaved,
    listed_best,
    with_distinct_names,
)
from swarmstart.cases.campaign.studies.comparison_plan import (
    Chosen,
    ComparePart,
    ComparisonPlan,
    chosen_of,
    is_plan,
    plan_in,
)
from swarmstart.cases.campaign.trials.solver_names import (
    NULL_HYPOTHESIS,
    Solver,
    solvers_of,
)
from swarmstart.cases.campaign.trials.solvers import budget_of, seconds_of, with_unit
from swarmstart.cases.commands.actions.shared_options import allowing
from swarmstart.cases.commands.terminal import (
    DONE,
    GATE,
    INFEASIBLE,
    Progress,
    answer,
    say,
    table_lines,
)
from swarmstart.cases.format.document import Document, counted, printable
from swarmstart.cases.format.scenario import read_document
from swarmstart.cases.record.files import (
    is_record,
    locked,
    require_ours,
    to_json,
    write_json,
)
from swarmstart.cases.record.record import (
    CELLS,
    COMPARISON,
    TABLE,
    require_comparisons,
)
from swarmstart.errors import SwarmstartError

RUNS = Path("results")
RESULTS = RUNS / "compare"
TYPICAL_S = 2.5
"""Estimated time of a cell that has never been run, without a time budget [s]."""


class SeveralPlansGivenError(SwarmstartError, ValueError):
    """More than one plan was given."""


class MissingOptionError(SwarmstartError, ValueError):
    """An option has no effect without another one."""


def compare_command(options: argparse.Namespace) -> int:
    """Compare the solvers that the options choose; return the exit code."""
    if (options.engine == "dask") != bool(options.scheduler):
        raise MissingOptionError(
            "expected --engine dask and --scheduler ADDRESS together"
        )
    if options.parquet:
        pyarrow_module()  # Raise now if it is missing, not at the end.
    plan, documents = _asked(options)
    baseline = _baseline(options)
    solvers = with_null_hypothesis(solvers_of(",".join(plan.solvers)))
    for hint in filter(None, (solver.hint for solver in solvers)):
        say(f"hint: {hint}")
    budget = budget_of(plan.budget)
    # Several scenarios can name the same file: one message is enough.
    said_once = functools.cache(say)
    contests = with_distinct_names([
        contest_of(
            chosen,
            document,
            solvers,
            plan,
            budget,
            functools.partial(allowing, options=options, told=said_once),
        )
        for chosen, document in zip(plan.scenarios, documents, strict=True)
    ])  # fmt: skip
    root = Path(options.out) if options.out else RESULTS
    # Files of others are refused now, not after hours of work.
    require_table(root / TABLE)
    require_ours(
        root / COMPARISON,
        functools.partial(is_record, name="comparison"),
        "a comparison",
    )
    require_comparisons(root)
    cells = interleaved(contests)
    few = too_few_seeds(contests, plan.seeds)
    if few and not options.quiet:
        say(few)
    if options.dry_run:
        answer(_dry_run(cells, root / CELLS, options.workers, budget))
        if plan.bound_s is not None:
            count = sum(contest.of == "plan" for contest in contests)
            answer(f"then {counted(count, 'lower bound')}, {plan.bound_s:g} s each")
        return DONE
    with Progress("compare", quiet=options.quiet, of="run") as progress:
        work = functools.partial(
            carried_out,
            root=root / CELLS,
            workers=options.workers,
            told=progress.update,
            engine=options.scheduler or LOCAL,
        )
        outcomes = work(cells)
        by_key = {cell.key: one for cell, one in zip(cells, outcomes, strict=True)}
        bounds = bounds_of(contests, by_key, plan.bound_s, work)
    content = _content(contests, by_key, bounds, plan, options)
    if baseline is not None:
        old, path = baseline
        content["regression"] = regression(
            old, content, margin=options.margin, against=path
        )
    table = _write(root, content, contests, by_key, parquet=options.parquet)
    _say_what_is_left_out(contests, plan)
    answer(
        to_json(content)
        if options.json
        else _report(content, table, times=options.times)
    )
    return _exit_code(content, options)


def _asked(options: argparse.Namespace) -> tuple[ComparisonPlan, list[Document]]:
    """Return the plan that the options and a plan among the scenarios make together."""
    names = list(dict.fromkeys(options.scenarios))
    read = {name: read_document(name) for name in names}
    plans = [name for name in names if is_plan(read[name])]
    if len(plans) > 1:
        raise SeveralPlansGivenError(
            f"expected at most one plan, found {len(plans)}: {', '.join(plans)}"
        )
    # Without a plan only the other keys are used, but the model needs a scenario.
    part = plan_in(read[plans[0]]) if plans else ComparePart(scenarios=["-"])
    scenarios = chosen_of(part, options.assignments) if plans else []
    scenarios += [_chosen(n, options, part) for n in names if n not in plans]
    default = ComparisonPlan(scenarios=(), solvers=(options.default_solvers,))
    solvers = tuple(part.solvers or default.solvers)
    plan = ComparisonPlan(
        scenarios=tuple(scenarios),
        solvers=(options.solvers,) if options.solvers else solvers,
        seeds=options.seeds or part.seeds or default.seeds,
        budget=options.budget or part.budget or default.budget,
        timeout_s=options.timeout or part.timeout_s or default.timeout_s,
        # Not `or`, which would skip False.
        repair=_first(options.repair, part.repair, default.repair),
        known=part.known,
        bound_s=_bound_s(options.bound, part.bound),
    )  # fmt: skip
    named = {one.source for one in scenarios}
    read |= {name: read_document(name) for name in named - read.keys()}
    return plan, [read[one.source] for one in scenarios]


def _chosen(name: str, options: argparse.Namespace, part: ComparePart) -> Chosen:
    """Return a scenario as the options choose it, else as the plan does."""
    return Chosen(
        source=name,
        of=options.of or part.of or "auto",
        variant=options.variant or part.variant,
        assignments=tuple(options.assignments),
    )


def _first(*given: bool | None) -> bool:
    """Return the first choice that is made."""
    return next(one for one in given if one is not None)


def _bound_s(*given: str | float | None) -> float | None:
    """Return the first time that is given [s]; None if none is."""
    first = next((one for one in given if one is not None), None)
    return None if first is None else seconds_of(str(first))


def with_null_hypothesis(solvers: Sequence[Solver]) -> list[Solver]:
    """Return the solvers with IPOPT from random starts among them, at the end if new.

    A search is worth its time only if it is better than IPOPT from random starts. Rules
    of swarms get no such solver, since they do not search.
    """
    is_there = any(solver.name.startswith(NULL_HYPOTHESIS) for solver in solvers)
    if is_there or all(solver.family == "rule" for solver in solvers):
        return list(solvers)
    return [*solvers, *solvers_of(NULL_HYPOTHESIS)]


def too_few_seeds(contests: Sequence[Contest], seeds: int) -> str:
    """Return a sentence if there are too few seeds; empty if there are enough."""
    needed = max((_needed(contest, seeds) for contest in contests), default=0)
    if seeds >= needed:
        return ""
    return (
        f"{counted(seeds, 'seed')}: with fewer than {needed} seeds no difference "
        "between solvers can be told from chance, so their costs are shown, but not "
        f"compared; --seeds {needed} compares them"
    )


def _needed(contest: Contest, seeds: int) -> int:
    """Return the number of seeds with which some pair of solvers can differ."""
    names = [entry.solver.name for entry in contest.entries]
    alone = [
        entry.solver.is_deterministic and not contest.is_seeded
        for entry in contest.entries
    ]
    pairs = compared_pairs(names, seeds) if names else []
    # Two solvers without randomness are compared without a test: any number of
    # seeds is enough for them.
    uncertain = sum(not (alone[i] and alone[j]) for i, j in pairs)
    return fewest_seeds(uncertain) if uncertain else 0


def _baseline(options: argparse.Namespace) -> tuple[Mapping[str, Any], str] | None:
    """Return the earlier comparison and its path; None if there is no --baseline."""
    if options.baseline is None:
        if options.fail_on:
            raise MissingOptionError(
                "expected --baseline with --fail-on regression: an earlier comparison"
            )
        return None
    path = Path(options.baseline)
    file = path / COMPARISON if path.is_dir() else path
    return read_comparison(file), str(options.baseline)


def _dry_run(
    cells: Sequence[Cell], root: Path, workers: int, budget: Mapping[str, float | int]
) -> str:
    """Return the number of runs, of those kept from before, and the estimated time."""
    # Equal cells are computed once.
    distinct = {cell.key: cell for cell in cells}
    kept = [finished(cell, root) for cell in distinct.values()]
    seconds = [outcome.seconds for outcome in kept if outcome is not None]
    missing = len(kept) - len(seconds)
    each = statistics.median(seconds) if seconds else budget.get("seconds", TYPICAL_S)
    left = missing * each / workers
    time = f"{left / 60:.0f} min" if left >= 120 else f"{left:.0f} s"  # noqa: PLR2004
    lines = [f"{counted(len(kept), 'run')}: {len(seconds)} kept, {missing} to be done"]
    lines.append(f"about {time} with {workers} process{'es' if workers != 1 else ''}")
    return "\n".join(lines)


def _content(
    contests: Sequence[Contest],
    outcomes: Mapping[str, Outcome],
    bounds: Mapping[str, Mapping[str, Any]],
    plan: ComparisonPlan,
    options: argparse.Namespace,
) -> dict[str, Any]:
    asked = Asked(
        seeds=tuple(range(plan.seeds)),
        budget=budget_of(plan.budget),
        budget_text=with_unit(plan.budget),
        command=shlex.join(["swarmstart", *options.words]),
    )
    about = {one.name: _about(one, outcomes, bounds, plan) for one in contests}
    content = content_of([c.entries for c in contests], outcomes, asked, about)
    content["limits"] += [
        sentence for contest in contests for sentence in contest.told_of_left_out()
    ]
    content["limits"] += _unbounded(contests, plan)
    return content


def _about(
    contest: Contest,
    outcomes: Mapping[str, Outcome],
    bounds: Mapping[str, Mapping[str, Any]],
    plan: ComparisonPlan,
) -> About:
    """Return what is known about a scenario besides the runs of its solvers."""
    known = _known(contest, plan, outcomes)
    return About(
        title=contest.resolved.scenario.title,
        kind=contest.resolved.scenario.kind,
        variant=contest.resolved.variant,
        of=contest.of,
        known_cost=None if known is None else known.cost,
        known_from="" if known is None else known.where,
        bound=bounds.get(contest.name),
        is_seeded=contest.is_seeded,
    )


def _unbounded(contests: Sequence[Contest], plan: ComparisonPlan) -> list[str]:
    """Return a sentence for scenarios that get no bound although one was asked for."""
    flown = [one.name for one in contests if one.of == "flight"]
    if plan.bound_s is None or not flown:
        return []
    return [f"A lower bound is of one plan; whole flights have none: {listed(flown)}."]


class Known(NamedTuple):
    """A cost that is known from outside of the comparison.

    Attributes:
        cost: The cost; if a value is maximised, the negative of that value.
        where: Source of the cost, in words; empty if the plan or an option states it.
    """

    cost: float
    where: str = ""


def _known(
    contest: Contest, plan: ComparisonPlan, outcomes: Mapping[str, Outcome]
) -> Known | None:
    """Return the least known cost: stated in the plan, listed, or of earlier runs."""
    results = [outcomes[c.key].result for e in contest.entries for c in e.cells]
    sense = next((one["sense"] for one in results if one is not None), 1)
    found = []
    # Both state it as the user sees it, also if the user maximises.
    stated = plan.known.get(contest.name)
    if stated is not None:
        found.append(Known(float(sense * stated)))
    if contest.of != "flight":
        found += _of_plans(contest, sense)
    return min(found, key=lambda one: one.cost, default=None)


def _of_plans(contest: Contest, sense: int) -> Iterator[Known]:
    """Yield the costs of single plans that are listed or of earlier runs."""
    best = listed_best(contest)
    if best is not None and best.cost is not None:
        yield Known(float(sense * best.cost), LISTED[best.known_by])
    earlier = earlier_best(contest, RUNS, sense)
    if earlier is not None:
        where = f"an earlier run, {printable(str(earlier.folder))}"
        yield Known(float(sense * earlier.cost), where)


def _write(
    root: Path,
    content: Mapping[str, Any],
    contests: Sequence[Contest],
    outcomes: Mapping[str, Outcome],
    *,
    parquet: bool,
) -> Path:
    """Append the runs to the table; return its path. Keep an earlier comparison."""
    entries = [entry for contest in contests for entry in contest.entries]
    runs = list(tabled_runs(entries, outcomes))
    with locked(root):
        table = append_runs(root / TABLE, runs)
        # The runs stay in the table, but only one comparison has this name.
        _put_aside(root / COMPARISON, content)
        write_json(root / COMPARISON, content)
        if parquet:
            write_parquet(table, root / "results.parquet")
            write_curves(runs, root / "curves.parquet")
    return table


def _put_aside(file: Path, content: Mapping[str, Any]) -> None:
    """Rename an earlier comparison by another command after its date."""
    try:
        earlier = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    # The same command again brings its own comparison up to date.
    if earlier.get("command") == content["command"]:
        return
    # No colons, which Windows refuses in names of files.
    stamp = "".join(c for c in str(earlier.get("date")) if c.isalnum())
    aside, number = file.with_name(f"comparison-{stamp}.json"), 2
    while aside.exists():  # Two within a second.
        aside = file.with_name(f"comparison-{stamp}-{number}.json")
        number += 1
    file.rename(aside)


def _say_what_is_left_out(contests: Sequence[Contest], plan: ComparisonPlan) -> None:
    for sentence in _unbounded(contests, plan):
        say(sentence)
    for contest in contests:
        for sentence in contest.told_of_left_out():
            say(sentence)


def _report(content: Mapping[str, Any], table: Path, *, times: bool) -> str:
    """Return the result as text; without wall times it is the same on every run."""
    lines = [report_text(content, times=times), ""]
    found = content["regression"]
    if found is not None:
        lines += [f"against {found['against']}"]
        lines += [*table_lines([_change(row) for row in found["rows"]]), ""]
    lines += [f"results  {table}"]
    lines += [f"page     swarmstart report {shlex.quote(str(table.parent))}"]
    return "\n".join(lines)


def _change(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the change of a quantity as a row of a table."""
    names = (row["scenario"], row["solver"], row["quantity"], row["verdict"])
    return (*names, row["words"])


def _exit_code(content: Mapping[str, Any], options: argparse.Namespace) -> int:
    found = content["regression"]
    if options.fail_on and found is not None and found["is_regression"]:
        worse = sum(row["verdict"] == "worse" for row in found["rows"])
        say(f"gate failed: regression in {worse} of {len(found['rows'])} comparisons")
        return GATE
    unsolved = any(
        not any(row["feasible"] for row in one["rows"]) for one in content["scenarios"]
    )
    return INFEASIBLE if unsolved else DONE
