"""Functions of the library that do what the commands `run` and `compare` do.

In the rows of `compare` a success is a feasible answer, confirmed on the finer grid,
whose cost is within NEAR of the least cost that any solver of the comparison has found.
Each solver is compared with the first, seed by seed, by a signed-rank test; p values
are adjusted for their number (Holm). An infeasible answer counts as costlier than any
feasible one.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    NAMES,
    PATH,
    Check,
    a_count,
    checked,
    mapping,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.runs import (
    About,
    Asked,
    Entry,
    runs_of,
)
from swarmstart.cases.campaign.judging.scenario_content import (
    judged_scenario,
    scenario_content,
)
from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run as run_resolved
from swarmstart.cases.campaign.studies.comparing import Contest, contest_of
from swarmstart.cases.campaign.studies.comparison_plan import (
    MOST_SEEDS,
    Chosen,
    ComparisonPlan,
)
from swarmstart.cases.campaign.trials.building import Trial, built
from swarmstart.cases.campaign.trials.own_solver import (
    GivenSolver,
    Own,
    OwnSolver,
    chosen_solvers,
    installed_solver,
)
from swarmstart.cases.campaign.trials.solver_names import Solver
from swarmstart.cases.campaign.trials.solvers import budget_of, search_share
from swarmstart.cases.campaign.trials.trial import answer_of
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.files import to_json
from swarmstart.cases.record.record import PNG, Recording
from swarmstart.errors import InvalidArgumentError, SwarmstartError
from swarmstart.heuristics import Budget, is_algorithm
from swarmstart.ocp import IpoptOptions, Known, OptimalControlProblem
from swarmstart.ocp.common import PROGRESS, ProgressGiven, shown
from swarmstart.ocp.search import LANES, SearchGiven, search_settings
from swarmstart.ocp.statement import has_decisions

Scenario = str | Path
Compared = Scenario | tuple[OptimalControlProblem, ArrayLike, *tuple[Known, ...]]
"""A scenario; or a problem, its initial state and, if needed, its `Known`."""
NEVER_S = 10**9
"""Time limit of a solver, so long that it means no limit [s]."""
NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


OF_RUNS = {
    "scenario": of_kind((str, Path), "a name or a path"),
    "out": optional(PATH),
    "variant": optional(text()),
    "polish": optional(text()),
    "figures": FLAG,
    "figure_formats": NAMES,
    "force": FLAG,
    "allow_code": FLAG,
    "threads": optional(a_count(least=1)),
    "settings": mapping(text(), words="a mapping from keys to values"),
    "progress": PROGRESS,
}
"""Checks of the arguments that `run` and `sweep` share."""


def _is_compared(given: object) -> bool:
    """Return whether a value is a scenario, or a problem with its start."""
    if isinstance(given, str | Path):
        return True
    match given:
        case (OptimalControlProblem(), x0) | (OptimalControlProblem(), x0, Known()):
            return isinstance(given, tuple) and reals().accepts(x0)
    return False


def _one_or_several(accepts: Callable[[Any], bool], words: str) -> Check:
    """Return a check of one, a sequence of at least one, or a mapping from names."""

    def is_one_or_several(given: object) -> bool:
        if accepts(given):
            return True
        values: object = given
        if isinstance(given, Mapping) and all(isinstance(name, str) for name in given):
            values = [*given.values()]
        if not isinstance(values, Sequence) or not values:
            return False
        return all(map(accepts, values))

    return Check(is_one_or_several, f"{words}; one, a list, or a mapping from names")


_COMPARED = _one_or_several(
    _is_compared, "scenarios, (problem, x0) or (problem, x0, known)"
)
_SOLVERS = _one_or_several(
    lambda given: isinstance(given, str) or is_algorithm(given) or callable(given),
    "names of solvers, functions, or searches",
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """Results of a solver on a scenario.

    Attributes:
        entry: The solver and the scenario.
        outcomes: Outcomes of the solver's runs on the scenario.
        feasible: Number of feasible answers.
        successes: Number of answers within 1 % of the best known cost.
        success_interval: 95 percent interval of the rate of successes; None for a
            deterministic solver.
        costs: Verified costs of the feasible answers, sorted.
        evaluations: Median number of evaluations; None if all cells failed.
        against_first: Comparison with the first solver, in words.
        false_successes: Number of answers that the solver calls feasible although they
            are not, or whose verified cost differs from the one that it reports.
        expected_evaluations: Expected evaluations until an answer is near the best
            known cost, if failed runs are followed by new ones; None if no run comes
            near, or if the runs did not count their evaluations.
    """

    entry: Entry
    outcomes: tuple[Outcome, ...]
    feasible: int
    successes: int
    success_interval: tuple[float, float] | None
    costs: tuple[float, ...]
    evaluations: float | None
    against_first: str
    false_successes: int = 0
    expected_evaluations: float | None = None

    @property
    def scenario(self) -> str:
        """Name of the scenario."""
        return self.entry.scenario

    @property
    def solver(self) -> str:
        """Name of the solver."""
        return self.entry.solver.name

    def __repr__(self) -> str:
        """Return problem, solver and results in one line."""
        cost = f"{statistics.median(self.costs):.6g}" if self.costs else "-"
        said = f"; {self.against_first}" if self.against_first else ""
        return (
            f"{self.scenario}, {self.solver}: {self.feasible} of "
            f"{len(self.outcomes)} feasible, {self.successes} near the best, "
            f"median cost {cost}{said}"
        )


@checked(
    InvalidArgumentError,
    seed=a_count(most=math.inf),
    search=optional(text()),
    **OF_RUNS,
)
def run(  # noqa: PLR0913 - the options of a command
    scenario: Scenario,
    *,
    seed: int,
    out: str | Path | None = None,
    variant: str | None = None,
    search: str | None = None,
    polish: str | None = None,
    figures: bool = True,
    figure_formats: Sequence[str] = PNG,
    force: bool = False,
    allow_code: bool = False,
    bound: float | None = None,
    threads: int | None = None,
    settings: Mapping[str, Any] = NO_SETTINGS,
    progress: ProgressGiven = True,
) -> Run:
    """Run a scenario, measure it and judge its claims, as `swarmstart run` does.

    Args:
        scenario: Name of a shipped scenario, or path of a scenario file.
        seed: Seed of all random numbers.
        out: Folder of the record; None means that nothing is written or drawn.
        variant: Variant of the scenario, as --variant; None means the default one.
        search: Name of the search, as --search; None means that of the scenario.
        polish: Name of the polish, as --polish; None means that of the scenario.
        figures: Whether figures are drawn into the record.
        figure_formats: Formats of each figure, of "png", "svg" and "pdf".
        force: Whether existing files with the names of the record's files are replaced,
            as --force.
        allow_code: Whether a scenario of kind python may run the file that it names,
            as --allow-code.
        bound: Work for a lower bound of the cost of the one plan, in units of about a
            second, as --bound; None means that no bound is sought.
        threads: Largest number of threads and processes, as in `solve`.
        settings: Keys and values as for --set, such as
            {"steps": 2, "budget.evaluations": 600}.
        progress: True: shown on a terminal and in a notebook if it takes more than two
            seconds. False: not shown. A function is called with (finished steps, all
            steps, current work).

    Returns:
        The finished run: measures, claims, trajectory and settings.

    Raises:
        InvalidScenarioError: If the scenario can be read but not run.
        UnknownScenarioError: If no scenario has that name.
        UnreadableFileError: If its file cannot be read.
        YamlError: If its file is not in the scenario format.
        OccupiedFolderError: If the folder holds anything but a record of this run.
        RecordError: If a file cannot be written.
        CodeNotAllowedError: If the scenario runs a file and `allow_code` is false.
        UserCodeError: If that file does not return a problem.
        InvalidProblemError: If `bound` is not a positive number.
        SeveralPlansError: If `bound` is given and the run makes more than one plan.
        UnknownFormatError: If `figure_formats` has an unknown format.

    Example:
        >>> import swarmstart as ss
        >>> finished = ss.run("double_integrator", seed=0, search="none")
        >>> finished.ended.plan.value
        'a local optimum, confirmed on the finer grid'
        >>> round(finished.measures["cost"], 3)
        12.03
        >>> finished.trajectory.states.shape
        (2, 21)
    """
    resolved = resolved_with(
        scenario, settings, variant=variant, search=search, polish=polish
    )
    resolved = replace(resolved, allow_code=allow_code)
    recording = recording_in(out, figures, figure_formats, force=force)
    with shown(progress, "run", "building") as told:
        return run_resolved(
            resolved,
            seed=seed,
            recording=recording,
            bound_s=bound,
            threads=threads,
            progress=told,
        )


@checked(
    problems=_COMPARED,
    solvers=_SOLVERS,
    seeds=a_count(least=1, most=MOST_SEEDS),
    budget=of_kind((int, str), "a number of evaluations, or text"),
    repair=FLAG,
    allow_code=FLAG,
    settings=OF_RUNS["settings"],
    progress=PROGRESS,
)
def compare(  # noqa: PLR0913 - the options of a command
    problems: Compared | Sequence[Compared] | Mapping[str, Compared],
    solvers: GivenSolver | Sequence[GivenSolver] | Mapping[str, GivenSolver],
    *,
    seeds: int = 10,
    budget: str | int = "4000evals",
    repair: bool = True,
    allow_code: bool = False,
    settings: Mapping[str, Any] = NO_SETTINGS,
    progress: ProgressGiven = True,
) -> list[Row]:
    """Solve problems by several solvers and seeds under equal budgets, side by side.

    A scenario in closed loop, or with several agents that plan, is compared by whole
    runs; solvers that cannot plan in a closed loop are left out.

    The solvers run in this process, one after another, and no result is kept. In
    contrast, `swarmstart compare` uses several processes and continues an interrupted
    comparison. The same seeds give the same answers in both.

    Args:
        problems: One problem, a list, or a mapping from names to problems. Each is a
            scenario, a pair (problem, x0) or a triple (problem, x0, known).
        solvers: Names as for `swarmstart compare --solvers`, such as
            "lshade[size=60]+ipopt", "repeated-ipopt", "solve" or "scipy-de"; one text
            can hold several with commas between. A solver of your own is a function
            (problem, x0, budget, rng) -> controls, or the settings of a search, or the
            class of such settings (docs/own_solver.md). A function with parameters
            `evaluate` or `known` is given these, too. A mapping can name the solvers.
            All other solvers are compared with the first one.
        seeds: Number n of seeds, which are 0, ..., n - 1.
        budget: Budget of one planning problem: "4000evals", "5s" or a number of
            evaluations.
        repair: Whether an answer that breaks a constraint between the checks is solved
            again with a margin.
        allow_code: As in `run`.
        settings: Settings of the scenarios, as in `run`.
        progress: True: shown on a terminal and in a notebook if it takes more than two
            seconds. False: not shown. A function is called with (finished runs, all
            runs, name of the next run).

    Returns:
        A row for each problem and solver, in this order.

    Raises:
        UnknownSolverError: If a solver is unknown, or two have one name.
        OwnSolverError: If a function does not take a solver's arguments.
        InvalidBudgetTextError: If the budget is invalid.
        CodeNotAllowedError: If a scenario runs a file and `allow_code` is false.
        UserCodeError: If that file does not return a problem.
        SeveralPlansError: If a solver of your own is to solve a scenario in closed
            loop, or with several agents that plan.
        NoFittingSolverError: If none of the named solvers fits a scenario.

    Example:
        >>> import swarmstart as ss
        >>> rows = ss.compare("double_integrator", "ipopt, solve", seeds=1, budget=400)
        >>> for row in rows:
        ...     print(row.solver, row.feasible, f"{row.costs[0]:.4f}")
        ipopt 1 12.0301
        solve 1 12.0301
    """
    chosen, own = chosen_solvers(solvers)
    _warn_of_old_names(chosen)
    share = budget_of(f"{budget}evals" if isinstance(budget, int) else budget)
    plan = ComparisonPlan(
        scenarios=(), solvers=(), seeds=seeds, timeout_s=NEVER_S, repair=repair
    )
    entries, work = [], {}  # Invalid input is refused here, before anything is solved.
    for name, problem in _named(problems).items():
        each: list[Entry] = []
        is_scenario = not isinstance(problem, tuple)
        if isinstance(problem, tuple):
            stated: PlanningProblem | None = _stated(problem)
        else:
            known = [solver for solver in chosen if solver.name not in own]
            contest = _contest(problem, known, plan, share, settings, allow_code)
            each = [replace(entry, scenario=name) for entry in contest.entries]
            stated = first_problem(contest.resolved.posed()) if own else None
        for solver in chosen:
            if stated is None or (is_scenario and solver.name not in own):
                continue
            first = _trial(stated, solver, share, own, repair=repair)
            each.append(_entry(name, solver, seeds))
            work[name, solver.name] = _solving(stated, first)
        entries.append(_in_order(each, chosen))
    every = [entry for each in entries for entry in each]
    count = sum(len(entry.cells) for entry in every)
    outcomes: dict[str, Outcome] = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        shown(progress, "compare", "building", of="run", total=count) as told,
    ):
        for entry in every:
            one = work.get((entry.scenario, entry.solver.name), _carried_out)
            for cell in entry.cells:
                told(len(outcomes), count, cell.label)
                outcomes[cell.key] = _outcome(partial(one, cell, Path(folder)))
    return [row for each in entries for row in rows_of(each, outcomes, seeds=seeds)]


def rows_of(
    entries: Sequence[Entry], outcomes: Mapping[str, Outcome], *, seeds: int
) -> list[Row]:
    """Return the results of the solvers of one scenario, in their order.

    Args:
        entries: Solvers on one scenario; all others are compared with the first.
        outcomes: Outcomes by the cells' keys.
        seeds: Number of seeds; a deterministic answer counts for each seed.
    """
    # Without resamples, since rows have no bands.
    asked = Asked(seeds=tuple(range(seeds)), resamples=0)
    found = judged_scenario([runs_of(e, outcomes, asked) for e in entries], asked)
    rng = np.random.default_rng(asked.bootstrap_seed)
    content = scenario_content("", found, asked, About(), rng=rng)
    rows = []
    for entry, runs, row in zip(entries, found.runs, content["rows"], strict=True):
        interval = row["near_intervals"]
        rows.append(
            Row(
                entry=entry,
                outcomes=runs.outcomes,
                feasible=row["feasible"],
                successes=row["near"][0],
                success_interval=None if interval is None else tuple(interval[0]),
                costs=tuple(sorted(cost for cost in row["costs"] if cost is not None)),
                evaluations=row["evaluations_median"],
                against_first=row["against_first"]["words"],
                false_successes=row["false_successes"],
                expected_evaluations=row["ert_evaluations"][0],
            )
        )
    return rows


def _contest(
    scenario: Scenario,
    solvers: Sequence[Solver],
    plan: ComparisonPlan,
    budget: Mapping[str, float | int],
    settings: Mapping[str, Any],
    allow_code: bool,
) -> Contest:
    """Return the cells of a scenario."""
    chosen = Chosen(source=str(scenario), assignments=tuple(_assignments(settings)))
    return contest_of(
        chosen,
        read_document(chosen.source),
        solvers,
        plan,
        budget,
        lambda resolved: replace(resolved, allow_code=allow_code),
    )


def _carried_out(cell: Cell, folder: Path) -> dict[str, Any]:
    """Return the result of a scenario's cell, computed in this process."""
    work: Callable[..., dict[str, Any]] = resolve_name(cell.work)
    return work(dict(cell.job), folder, **cell.permissions)


def recording_in(
    out: str | Path | None, figures: bool, formats: Sequence[str], *, force: bool
) -> Recording | None:
    """Return the folder and options of a record; None if nothing is recorded.

    Args:
        out: The folder; None means that nothing is recorded.
        figures: Whether figures are drawn.
        formats: Formats of each figure.
        force: Whether files of another record are replaced.
    """
    if out is None:
        return None
    return Recording(
        folder=Path(out), figures=figures, force=force, figure_formats=tuple(formats)
    )


def resolved_with(
    scenario: Scenario, settings: Mapping[str, Any], **given: Any
) -> Resolved:
    """Return a scenario with settings laid over it; values may be NumPy arrays.

    Args:
        scenario: Name of a shipped scenario, or path of a scenario file.
        settings: Keys and values as for --set.
        given: Other arguments of `resolve`.
    """
    document = read_document(str(scenario))
    return resolve(document, assignments=_assignments(settings), **given)


def _assignments(settings: Mapping[str, Any]) -> list[str]:
    """Return settings as texts for --set."""
    plain = {
        key: value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        for key, value in settings.items()
    }
    return [f"{key}={to_json(value)}" for key, value in plain.items()]


def _named(
    problems: Compared | Sequence[Compared] | Mapping[str, Compared],
) -> Mapping[str, Compared]:
    """Return problems by name: that of the scenario, or "problem" and a number."""
    if isinstance(problems, Mapping):
        return problems
    is_one = isinstance(problems, str | Path) or (
        isinstance(problems, tuple) and isinstance(problems[0], OptimalControlProblem)
    )
    several = cast(Sequence[Compared], [problems] if is_one else problems)
    return {
        f"problem {number}" if isinstance(one, tuple) else str(one): one
        for number, one in enumerate(several, 1)
    }


def _in_order(entries: Sequence[Entry], solvers: Sequence[Solver]) -> list[Entry]:
    """Return the entries of a scenario in the order of the solvers."""
    places = {solver.name: place for place, solver in enumerate(solvers)}
    return sorted(entries, key=lambda entry: places[entry.solver.name])


def _warn_of_old_names(solvers: Sequence[Solver]) -> None:
    for hint in filter(None, (solver.hint for solver in solvers)):
        # To the caller of `compare`, behind its check of arguments.
        warnings.warn(hint, FutureWarning, stacklevel=4)


def _stated(problem: tuple[Any, ...]) -> PlanningProblem:
    """Return the planning problem of (problem, x0) or (problem, x0, known)."""
    ocp, x0, *known = problem
    return PlanningProblem(
        problem=ocp,
        x0=np.asarray(x0, dtype=np.float64),
        known=known[0] if known else Known(),
    )


def _trial(
    posed: PlanningProblem,
    solver: Solver,
    budget: Mapping[str, float | int],
    own: Mapping[str, Own],
    *,
    repair: bool,
) -> Trial:
    """Return the solver's trial with seed 0."""
    first = Trial(solver=solver, budget=budget, seed=0, search=None, repair=repair)
    if solver.family == "own":
        function = own.get(solver.name) or installed_solver(solver.name)
        return replace(first, own=cast(OwnSolver, function))
    if solver.family == "solve":
        search = search_settings(solver.search or "default")
        return replace(
            first,
            search=search if has_decisions(posed.problem) else None,
            polish=IpoptOptions(),
            lanes=dict(solver.options).get("lanes", LANES),
        )
    if solver.search == "none" and solver.name not in own:
        return first
    share = Budget(**search_share(solver, budget))
    named = cast(SearchGiven, own.get(solver.name, solver.search))
    return replace(first, search=search_settings(named, share))


def _solving(
    posed: PlanningProblem, first: Trial
) -> Callable[[Cell, Path], dict[str, Any]]:
    """Return a function that solves a problem with a cell's seed and builds it once."""
    # Built with the first cell, so that an error there is that cell's failure.
    made = cache(partial(built, posed, first))

    def solve(cell: Cell, folder: Path) -> dict[str, Any]:
        del folder
        return answer_of(made(), replace(first, seed=cell.job["seed"])).as_json()

    return solve


def _entry(name: str, solver: Solver, seeds: int) -> Entry:
    """Return the cells of a solver on a problem, which are not kept."""
    cells = [
        Cell(
            # Never looked up: the function of `_solving` does the work.
            work="swarmstart.cases.campaign.studies.library:compare",
            job={"problem": name, "solver": solver.name, "seed": seed},
            label=f"{name}, {solver.name}, seed {seed}",
        )
        for seed in range(1 if solver.is_deterministic else seeds)
    ]
    return Entry(scenario=name, solver=solver, cells=tuple(cells))


def _outcome(work: Callable[[], dict[str, Any]]) -> Outcome:
    """Return the answer of a solver, or the reason why it failed."""
    result, failure = None, ""
    try:
        result = work()
    except SwarmstartError as error:
        failure = str(error)
    seconds = result["seconds"] if result else 0.0
    return Outcome(result=result, failure=failure, seconds=seconds, folder=Path())
