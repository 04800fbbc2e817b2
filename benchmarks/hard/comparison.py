"""Methods on hard problems with equal CPU time: the page docs/hard.md.

    python benchmarks/hard/comparison.py --write docs/hard.md --plot docs/hard.png
        [--problems hard/walls_2 ...] [--methods solve ipopt ...] [--seeds 30]
        [--seconds 2] [--workers 1] [--out results/hard] [--kept] [--fresh 102]

Each run is kept in a folder under --out, and is not repeated as long as the code that
it uses is the same. So a measurement can be stopped and continued, and more seeds are
added to those that are there. `--kept` makes the page of the problems whose runs are
all there. `--fresh 102` also runs some methods on other draws, those of seed 102.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.cpu_trials import CHARGE, entries_of
from swarmstart.benchmarks.hard.peers import PEERS
from swarmstart.benchmarks.tables import (
    command_of,
    head,
    illustrated,
    page_options,
    publish,
    row,
)
from swarmstart.cases.campaign.engine.cells import Outcome, carried_out, finished
from swarmstart.cases.campaign.judging.running_time import (
    expected_running_time,
    reached,
)
from swarmstart.cases.campaign.judging.runs import Asked, Entry, Runs, runs_of
from swarmstart.cases.campaign.judging.statistics import (
    LEVEL,
    sign_ps,
    wilson_interval,
    with_ties,
)
from swarmstart.cases.campaign.studies.judged_file import BETTER
from swarmstart.cases.campaign.trials.trial import LATE, MOMENT_S
from swarmstart.cases.drawing.drawing import colour, line_style
from swarmstart.cases.hard import SHIPPED, draw
from swarmstart.cases.hard.best_known import best_known

NEAR = 1e-3
"""Relative distance from the best known cost that is a success, and between optima."""
DEFAULT, ONCE, MANY = "solve", "ipopt", "repeated-ipopt"
METHODS = {
    ONCE: "IPOPT once, from zero controls",
    MANY: "IPOPT from random starts until the budget is spent",
    "multistart+ipopt": "many local solves at once from random starts, then IPOPT",
    "lshade+ipopt": "L-SHADE, then IPOPT",
    "de+ipopt": "differential evolution, then IPOPT",
    "cpso+ipopt": "chaotic particle swarm, then IPOPT",
    "cma+ipopt": "covariance matrix adaptation, then IPOPT",
    "memetic+ipopt": "L-SHADE with many local solves at once, then IPOPT",
    DEFAULT: "the default call, as `swarmstart run` makes it",
    **{name: peer.title for name, peer in PEERS.items()},
}
"""Methods and what they are."""
PROBLEMS = (
    "walls_2", "currents_4", "swing_up_20", "arms_2", "crossing_4", "discs_8",
    "reorientation_2", "gears_6",
)  # fmt: skip
"""One size of each family, for a measurement of an hour."""
CHECKED = (ONCE, MANY, "memetic+ipopt", DEFAULT)
"""Methods that are also run on fresh draws."""
ENOUGH = 10
"""Number of seeds from which the page does not say that there are few."""
NOTES = (
    "- **Budget.** CPU time of the process, one thread, so that other work on the "
    "machine takes nothing from a method. Building and compiling do not count, for "
    "any method. With a search and IPOPT, the search has 90 % of it.",
    "- **Judge.** No method judges itself: its answer is simulated again ten times "
    "finer, as by `swarmstart judge`. An answer that breaks a limit between the "
    "checks is repaired by the library, whichever method found it; the time of the "
    "repair is added to that of the run and may exceed the budget.",
    "- **Success.** A confirmed cost within 0.1 % of the best known. It takes the time "
    "until the method first had a value so good, plus that of the repair; a whole run "
    "takes longer. "
    "These are failures: a value that is found later than 1.1 times the budget plus "
    "0.25 s, a run that takes more than {most} s with its repair, and a problem for "
    "which the method has no answer. IPOPT once has no random numbers: it is run once, "
    "and counts for each seed in sums.",
    "- **Expected time** to the first success with restarts: the time of all "
    "successes and {most} s for each failure, divided by the number of successes.",
    "- **Optima.** Number of confirmed costs that differ by more than 0.1 %, over the "
    "seeds.",
    "- **Limits.** Settings of peers were not tuned. The order in which the default "
    "call tries its starts was chosen after runs on these problems; the last section "
    "has problems that were not looked at before. The best known costs come from "
    "the default call in longer runs, or are exact ([how each is known]"
    "(hard_problems.md#best-known-values)). Other budgets can change the order. The p "
    "values above are those of sign tests over pairs of problem and seed, as if these "
    "were independent.",
)
"""Notes on the measurement; `most` is the charge of a failure [s]."""
TEXT = "# Hard problems: a comparison\n\n"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Score:
    """Runs of a method on a problem.

    Attributes:
        problem: Name of the problem.
        method: Name of the method.
        runs: Number of its runs: one of a deterministic method.
        times: CPU time of each seed to a success, infinite without one, shape (seeds,)
            [s].
        costs: Confirmed minimised costs, infinite without one, shape (seeds,).
        ends: CPU time of each whole run, with the repair, shape (seeds,) [s].
        limit: CPU time that a failure is charged [s].
        refusal: Why no run had an answer; empty if one had.
    """

    problem: str
    method: str
    runs: int
    times: Array
    costs: Array
    ends: Array
    limit: float
    refusal: str = ""

    @property
    def successes(self) -> int:
        """Number of successful runs."""
        return int(np.isfinite(self.times[: self.runs]).sum())

    @property
    def expected_s(self) -> float | None:
        """Expected CPU time to a success with restarts; None without a success [s]."""
        charged = np.full(len(self.times), self.limit)
        return expected_running_time(self.times, charged)

    @property
    def optima(self) -> int:
        """Number of distinct costs of confirmed answers."""
        costs = with_ties(self.costs, NEAR)
        return len(np.unique(costs[np.isfinite(costs)]))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Result:
    """Results of all methods on a problem.

    Attributes:
        problem: Name of the problem.
        sense: -1 if the file maximises; costs here are minimised all the same.
        known: Best known cost of the file; infinite if it is unknown.
        best: The least confirmed cost, here or known; infinite if there is none.
        scores: Results of the methods.
    """

    problem: str
    sense: int
    known: float
    best: float
    scores: tuple[Score, ...]

    @property
    def is_better(self) -> bool:
        """True if a run is better than the best known cost."""
        if not np.isfinite(self.known):
            return bool(np.isfinite(self.best))
        return self.known - self.best > BETTER * abs(self.known)


def result_of(
    entries: Sequence[Entry],
    outcomes: Mapping[str, Outcome],
    *,
    names: Sequence[str],
    seeds: int,
    seconds: float,
) -> Result:
    """Return the results of the methods on a problem.

    Args:
        entries: Methods with their cells.
        outcomes: Outcomes by the cells' keys.
        names: Names of the methods.
        seeds: Number of seeds.
        seconds: Budget of a run [s].
    """
    asked = Asked(seeds=tuple(range(seeds)), budget={"seconds": seconds})
    every = [runs_of(entry, outcomes, asked) for entry in entries]
    problem, costs = entries[0].scenario, [one.costs.min() for one in every]
    sense = next((int(r["sense"]) for one in every for r in one.results if r), 1)
    entry = best_known().get(problem)
    cost = None if entry is None else entry.cost
    known = np.inf if cost is None else sense * cost
    best = min(known, *costs)
    target = best + NEAR * abs(best) if np.isfinite(best) else -np.inf
    return Result(
        problem=problem,
        sense=sense,
        known=known,
        best=best,
        scores=tuple(
            _score(name, one, target, seeds=seeds, seconds=seconds)
            for name, one in zip(names, every, strict=True)
        ),
    )


def _score(
    name: str, runs: Runs, target: float, *, seeds: int, seconds: float
) -> Score:
    """Return the results of a method, whose successes reach the target in time."""
    times, limit = reached(runs.seconds, [target])[:, 0], CHARGE * seconds
    repairs = np.array(
        [one["seconds_repair"] if one.get("repaired") else 0.0 for one in runs.results]
    )
    # As in `compare`, whose hard limit would have ended the run.
    in_time = (times - repairs <= LATE * seconds + MOMENT_S) & (times <= limit)
    failures = [one.failure for one in runs.outcomes]
    return Score(
        problem=runs.entry.scenario,
        method=name,
        runs=len(times),
        times=runs.for_seeds(np.where(in_time, times, np.inf), seeds),
        costs=runs.for_seeds(runs.costs, seeds),
        ends=runs.for_seeds(runs.seconds.ends, seeds),
        limit=limit,
        refusal=failures[0] if all(failures) else "",
    )


def success_of(results: Sequence[Result], method: str) -> NDArray[np.bool_]:
    """Return whether a method succeeds, for each pair of problem and seed."""
    scores = [s for one in results for s in one.scores if s.method == method]
    return np.asarray(np.isfinite(np.concatenate([one.times for one in scores])))


def finding(results: Sequence[Result], seconds: float) -> str:
    """Return the finding, in words: the best method, and what is shown of others.

    Others are compared with it by the sign test over pairs of problem and seed, without
    adjustment.
    """
    hits = {s.method: success_of(results, s.method) for s in results[0].scores}
    counts = {method: int(one.sum()) for method, one in hits.items()}
    spent = {method: _charged(results, method) for method in hits}
    ranked = sorted(hits, key=lambda method: (-counts[method], spent[method]))
    best, total = ranked[0], len(hits[ranked[0]])
    peer = next((method for method in ranked if method in PEERS), None)
    named = [*dict.fromkeys(m for m in (MANY, DEFAULT, ONCE, peer) if m in counts)]
    others = [method for method in named if method and method != best]
    words, alike = [], []
    for method in others:
        words.append(f"{_called(method)} in {counts[method]}")
        gained = int((hits[best] & ~hits[method]).sum())
        lost = int((hits[method] & ~hits[best]).sum())
        p = float(sign_ps([gained], [lost])[0])
        if p > LEVEL:
            alike.append(f"{_called(method)} (p = {p:.2g})")
    said = (
        f"In {seconds:g} s of CPU time on one thread, {_called(best)} comes within "
        f"0.1 % of the best known cost in {counts[best]} of {total} runs on "
        f"{len(results)} hard problems"
    )
    said += f"; {_joined(words)}." if words else "."
    if alike:
        said += f" Not shown to differ from `{best}`: {_joined(alike)}."
    return said


def _charged(results: Sequence[Result], method: str) -> float:
    """Return the time of all successes of a method, and that of its failures [s]."""
    scores = [s for one in results for s in one.scores if s.method == method]
    return float(sum(np.minimum(s.times, s.limit).sum() for s in scores))


def _called(method: str) -> str:
    """Return a method in words, with its name."""
    words = {
        DEFAULT: "the default call",
        ONCE: "IPOPT once",
        MANY: "IPOPT from random starts",
    }
    plain = words.get(method) or METHODS.get(method, "")
    return f"{plain} (`{method}`)" if plain else f"`{method}`"


def _joined(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if words[1:] else words)


def method_table(results: Sequence[Result]) -> list[str]:
    """Return the table of the methods over all problems."""
    lines = head("method", "what it is", "successes", "95 % interval",
                 "on problems that it answers", "least expected time")  # fmt: skip
    scores = [score for one in results for score in one.scores]
    fastest = [_fastest(one) for one in results]
    for method in dict.fromkeys(score.method for score in scores):
        own = [score for score in scores if score.method == method]
        hits = success_of(results, method)
        count, taken = int(hits.sum()), [one for one in own if not one.refusal]
        low, high = wilson_interval(count, len(hits))
        lines.append(
            row(
                f"`{method}`",
                METHODS.get(method, ""),
                f"{count} of {len(hits)}",
                f"{low:.2f} to {high:.2f}" if any(s.runs > 1 for s in own) else "-",
                f"{count} of {sum(len(one.times) for one in taken)}",
                f"{fastest.count(method)} of {len(results)}",
            )
        )
    return lines


def _fastest(one: Result) -> str | None:
    """Return the method with the least expected time; None if none succeeds."""
    known = {s.method: s.expected_s for s in one.scores if s.expected_s is not None}
    return min(known, key=lambda method: known[method], default=None)


def problem_table(one: Result) -> list[str]:
    """Return the table of the methods on a problem."""
    lines = head("method", "successes", "95 % interval", "expected time [s]",
                 "whole run [s]", "optima", "best cost")  # fmt: skip
    for score in one.scores:
        low, high = wilson_interval(score.successes, score.runs)
        least = float(score.costs.min())
        lines.append(
            row(
                f"`{score.method}`",
                f"{score.successes} of {score.runs}",
                f"{low:.2f} to {high:.2f}" if score.runs > 1 else "-",
                "-" if score.expected_s is None else f"{score.expected_s:.3g}",
                "no answer" if score.refusal else f"{np.median(score.ends):.3g}",
                str(score.optima),
                f"{one.sense * least:.7g}" if np.isfinite(least) else "-",
            )
        )
    said = [f"- `{s.method}`: {s.refusal}." for s in one.scores if s.refusal]
    return [*lines, "", *said] if said else lines


def fresh_draws(folder: Path, names: Sequence[str], seed: int) -> list[str]:
    """Write draws with another seed; return their paths.

    Args:
        folder: Where the files are written.
        names: Names of shipped hard problems, whose families and sizes are drawn.
        seed: The seed.
    """
    shipped = [SHIPPED[name.removeprefix("hard/")] for name in names]
    return [
        str(written_draw(folder, family, sizes, seed)) for family, sizes, _ in shipped
    ]


def written_draw(
    folder: Path, family: str, sizes: Mapping[str, int], seed: int
) -> Path:
    """Write a draw of a family, and return its path, whose name has size and seed.

    Args:
        folder: Where the file is written.
        family: Name of the family.
        sizes: Its sizes, of which the first is part of the name.
        seed: The seed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{family}_{next(iter(sizes.values()))}_seed_{seed}.yaml"
    path.write_text(draw(family, seed=seed, **sizes), encoding="utf-8")
    return path


def fresh_section(results: Sequence[Result], *, seconds: float, seed: int) -> list[str]:
    """Return the lines on draws with another seed.

    Args:
        results: Results of the draws, whose best cost is the least found here.
        seconds: Budget of a run [s].
        seed: Seed of the draws.
    """
    methods = [score.method for score in results[0].scores]
    lines = [
        "## Other draws",
        "",
        f"Problems of the same families and sizes, drawn with seed {seed} for this "
        "test only. The least cost that these methods found stands for the best known. "
        f"{finding(results, seconds)}",
        "",
        *head("draw", "best cost", *(f"`{one}`" for one in methods)),
    ]
    for one in results:
        counts = [f"{s.successes} of {s.runs}" for s in one.scores]
        best = f"{one.sense * one.best:.7g}" if np.isfinite(one.best) else "none"
        lines.append(row(Path(one.problem).stem, best, *counts))
    return ["", *lines]


def page(
    results: Sequence[Result], *, seconds: float, seeds: int, command: str
) -> list[str]:
    """Return the lines of the page below its title.

    Args:
        results: Results of the problems.
        seconds: Budget of a run [s].
        seeds: Number of seeds.
        command: Command that makes the page.
    """
    most = CHARGE * seconds
    few = (
        ": too few to tell apart methods that are alike. The same command with more "
        "seeds continues the measurement"
    )
    lines = [
        finding(results, seconds),
        "",
        f"Made by `{command}` on {len(results)} of the [hard problems]"
        f"(hard_problems.md) with {seeds} seeds, on one of {os.cpu_count()} cores"
        f"{few if seeds < ENOUGH else ''}.",
        "",
        *(line.format(most=f"{most:g}") for line in NOTES),
        "",
        "## All problems",
        "",
        *method_table(results),
        "",
        "## Best known values",
        "",
        _best_known(results),
        "",
        "## Each problem",
        "",
    ]
    for one in results:
        known = f"{one.sense * one.known:.9g}" if np.isfinite(one.known) else "unknown"
        lines += [f"### {one.problem}", "", f"Best known cost: {known}.", ""]
        lines += [*problem_table(one), ""]
    return lines[:-1]


def _best_known(results: Sequence[Result]) -> str:
    better = [one for one in results if one.is_better]
    if not better:
        return (
            f"No run of any method is better than the file of best known values by "
            f"more than {BETTER:g} of the value."
        )
    said = [f"`{one.problem}` ({one.sense * one.best:.12g})" for one in better]
    return f"Better than the file of best known values: {_joined(said)}."


def plot(results: Sequence[Result], path: Path) -> None:
    """Draw the profile of the methods into a file."""
    profile(results).savefig(path, dpi=120)


def profile(results: Sequence[Result]) -> Figure:
    """Return a figure of the share of problems and seeds that each method solves."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    scores = [score for one in results for score in one.scores]
    methods = dict.fromkeys(score.method for score in scores)
    for number, method in enumerate(methods):
        own = np.concatenate([s.times for s in scores if s.method == method])
        times = np.sort(own[np.isfinite(own)])
        shares = np.arange(1, len(times) + 1) / len(own)
        axes.step(
            [*times[:1], *times, scores[0].limit],
            [*np.zeros(len(times[:1])), *shares, len(times) / len(own)],
            where="post",
            color=colour(number),
            linestyle=line_style(number),
            label=method,
        )
    axes.set(xscale="log", ylim=(0, 1), xlabel="CPU time [s]")
    axes.set_ylabel("share of problems and seeds within 0.1 %")
    figure.legend(loc="outside right upper", fontsize="small")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is missing, print the page, and write it where asked."""
    parser = page_options(__doc__, plots=True)
    parser.add_argument("--problems", nargs="*", help="names such as hard/walls_2")
    parser.add_argument("--methods", nargs="*", default=[*METHODS])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=5.0, help="CPU time of a run")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("results/hard"))
    parser.add_argument("--kept", action="store_true", help="run nothing")
    parser.add_argument("--fresh", type=int, help="seed of other draws")
    options = parser.parse_args(arguments)
    problems = options.problems or [f"hard/{name}" for name in PROBLEMS]
    results = _results(problems, options.methods, options)
    if not results:
        print("expected the runs of a problem, found none", file=sys.stderr)
        return 1
    given = sys.argv[1:] if arguments is None else arguments
    given = [one for one in given if one != "--kept"]  # The page needs the runs.
    command = command_of("benchmarks/hard/comparison.py", given)
    lines = page(results, seconds=options.seconds, seeds=options.seeds, command=command)
    caption = "Share of problems and seeds that each method solves, over CPU time"
    lines = illustrated(lines, options, caption, lambda path: plot(results, path))
    if options.fresh is not None:
        paths = fresh_draws(options.out / "fresh", problems, options.fresh)
        found = _results(paths, CHECKED, options)
        if found:  # With --kept runs may be missing.
            lines += fresh_section(found, seconds=options.seconds, seed=options.fresh)
    publish(lines, options, TEXT)
    return 0


def _results(
    problems: Sequence[str], methods: Sequence[str], options: argparse.Namespace
) -> list[Result]:
    """Return the results of the problems, without those whose runs are not kept."""
    results = []
    for problem in problems:
        entries = entries_of(
            problem,
            methods,
            seeds=options.seeds,
            budget={"seconds": options.seconds},
        )
        outcomes = _outcomes(entries, options)
        if outcomes is not None:
            results.append(
                result_of(
                    entries, outcomes, names=methods,
                    seeds=options.seeds, seconds=options.seconds,
                )
            )  # fmt: skip
    return results


def _outcomes(
    entries: Sequence[Entry], options: argparse.Namespace
) -> dict[str, Outcome] | None:
    """Return the outcomes of all cells by key; None if only kept ones are asked for."""
    if options.kept:
        cells = [cell for entry in entries for cell in entry.cells]
        kept = {cell.key: finished(cell, options.out) for cell in cells}
        known = {key: one for key, one in kept.items() if one is not None}
        return known if len(known) == len(kept) else None
    return outcomes_of(entries, options.out, workers=options.workers)


def outcomes_of(
    entries: Sequence[Entry], out: Path, *, workers: int
) -> dict[str, Outcome]:
    """Run the cells that are not kept yet, and return the outcomes of all by key."""
    cells = [cell for entry in entries for cell in entry.cells]
    done = carried_out(cells, out, workers=workers, told=_told)
    return dict(zip([cell.key for cell in cells], done, strict=True))


def _told(done: int, total: int, label: str) -> None:
    print(f"{done} of {total}: {label}", file=sys.stderr)


if __name__ == "__main__":
    raise SystemExit(main())
