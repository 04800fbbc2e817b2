"""A comparison in one sentence, which claims no more than its tests show.

The null hypothesis, which searches have to beat, is IPOPT from random starts; if IPOPT
from random starts is not among the solvers, the first solver takes its place. The
sentence mentions a difference only if the tests show it on its scenario, and still show
it with p values adjusted for everything that the sentence could have claimed, on all
scenarios and for all solvers (Holm).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmstart.cases.campaign.judging.judgement import (
    CHEAPER,
    COSTLIER,
    FEWEST_SEEDS,
    NOT_COMPARED,
    SECONDS_SHARE,
)
from swarmstart.cases.campaign.judging.report import listed, near_words
from swarmstart.cases.campaign.judging.statistics import LEVEL, holm_of_those_that_can
from swarmstart.cases.campaign.trials.solver_names import NULL_HYPOTHESIS
from swarmstart.cases.format.document import counted

PLAIN = "ipopt"
NAMED = 2
"""Largest number of scenarios that are named; if there are more, they are counted."""
_OPPOSITE = {"more": "fewer", "fewer": "more", CHEAPER: COSTLIER, COSTLIER: CHEAPER}

Content = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True)
class Shown:
    """Names of scenarios, grouped by a solver's result against the null hypothesis."""

    solver: str
    more: list[str] = field(default_factory=list)
    fewer: list[str] = field(default_factory=list)
    cheaper: list[str] = field(default_factory=list)
    costlier: list[str] = field(default_factory=list)

    @property
    def merit(self) -> tuple[int, int]:
        """Scenarios gained minus scenarios lost, by successes and by costs."""
        return (
            len(self.more) - len(self.fewer),
            len(self.cheaper) - len(self.costlier),
        )


def headline(content: Content) -> str:
    """Return the result of a comparison in one sentence.

    Args:
        content: Content of a comparison from `content_of`, without headline and limits.
    """
    names = [one["name"] for one in content["solvers"]]
    scenarios = content["scenarios"]
    if not names or not scenarios:
        return "Nothing was compared."
    if not any(row["feasible"] for s in scenarios for row in s["rows"]):
        return f"No solver has a feasible answer on {_on(scenarios, scenarios)}."
    if len(names) == 1:
        return f"{_alone(content)}."
    few = _too_few(content)
    null = NULL_HYPOTHESIS if NULL_HYPOTHESIS in names else names[0]
    gain = f"Solvers are {few}" if few else _gain(content, null)
    nothing = _nothing_gained(content, null)
    parts = [part for part in (gain, nothing, _unsolved(content)) if part]
    if nothing and not few and not _is_gained(content, null):
        # Unless more scenarios show a gain, that there is none comes first.
        parts = [nothing, gain, *parts[2:]]
    text = "; ".join(parts)
    # A solver keeps its own spelling at the beginning of the sentence.
    is_name = any(text.startswith(f"{name} ") for name in names)
    return f"{text}." if is_name else f"{text[0].upper()}{text[1:]}."


def _on(some: Sequence[Content], all_of_them: Sequence[Content]) -> str:
    """Return scenarios in words."""
    if len(some) <= NAMED:
        return listed([one["name"] for one in some])
    if len(some) == len(all_of_them):
        return f"any of {len(some)} scenarios"
    return f"{len(some)} of {len(all_of_them)} scenarios"


def _alone(content: Content) -> str:
    """Return the results of a single solver, without a comparison."""
    scenarios, name = content["scenarios"], content["solvers"][0]["name"]
    if len(scenarios) == 1:
        row = scenarios[0]["rows"][0]
        low = "" if row["deterministic"] else _interval_words(row)
        return (
            f"{name} has a feasible answer on {scenarios[0]['name']} in "
            f"{row['feasible']} of {counted(row['runs'], 'run')}, {row['near'][0]} of "
            f"them within {near_words(content)} of the best known{low}; one solver, so "
            "nothing is compared"
        )
    always = [s for s in scenarios if s["rows"][0]["feasible"] == s["rows"][0]["runs"]]
    return (
        f"{name} has a feasible answer in every run on {len(always)} of "
        f"{len(scenarios)} scenarios; one solver, so nothing is compared"
    )


def _interval_words(row: Content) -> str:
    low, high = row["near_intervals"][0]
    return f" (95 % interval of the rate {low:.2f} to {high:.2f})"


def _too_few(content: Content) -> str:
    """Return the reason why nothing is compared; empty if something is."""
    pairs = [pair for s in content["scenarios"] for pair in s["pairs"]]
    is_compared = any(pair["verdict"] != NOT_COMPARED for pair in pairs)
    return "" if is_compared or not pairs else str(pairs[0]["words"])


def shown_against(content: Content, null: str) -> list[Shown]:
    """Return, for each other solver, the scenarios on which it differs from `null`.

    Differences count only if tests show them; deterministic solvers need no test.

    Args:
        content: Content of a comparison, as from `content_of`.
        null: The solver with which the others are compared.
    """
    found = {
        one["name"]: Shown(solver=one["name"])
        for one in content["solvers"]
        if one["name"] != null
    }
    tests = [
        (scenario["name"], *_oriented(pair, null), finding)
        for scenario in content["scenarios"]
        for pair in scenario["pairs"]
        if null in (pair["a"], pair["b"])
        for finding in (pair, pair["success"])
    ]
    tested = [test for test in tests if test[3]["p_alone"] is not None]
    adjusted = holm_of_those_that_can(
        [test[3]["p_alone"] for test in tested],
        [test[3]["differing"] for test in tested],
        # The sentence claims nothing about seconds.
        share=1 - SECONDS_SHARE,
    )
    # Keyed by identity, since a mapping cannot be a key.
    holds = {id(t[3]): p <= LEVEL for t, p in zip(tested, adjusted, strict=True)}
    for scenario, solver, is_turned, finding in tests:
        verdict = finding["verdict"]
        # Deterministic solvers have no test, and so no p to adjust.
        if verdict in _OPPOSITE and holds.get(id(finding), True):
            name = _OPPOSITE[verdict] if is_turned else verdict
            getattr(found[solver], name).append(scenario)
    return list(found.values())


def _oriented(pair: Content, null: str) -> tuple[str, bool]:
    """Return the other solver of a pair, and whether the null hypothesis is its a."""
    return (pair["b"], True) if pair["a"] == null else (pair["a"], False)


def _is_gained(content: Content, null: str) -> bool:
    """Return whether more scenarios show a gain than a loss."""
    best = max(shown_against(content, null), key=lambda one: one.merit)
    without = len(_plain_finds(content)) + len(_null_finds(content, null))
    return max(best.merit) > 0 and max(len(best.more), len(best.cheaper)) >= without


def _successes(content: Content, shown: Shown) -> int:
    """Return the number of runs near the best on scenarios that a solver gains."""
    return sum(
        row["near"][0]
        for scenario in content["scenarios"]
        if scenario["name"] in shown.more
        for row in scenario["rows"]
        if row["solver"] == shown.solver
    )


def _gain(content: Content, null: str) -> str:
    """Return the gain over the null hypothesis by the solver that gains most."""
    every = shown_against(content, null)
    best = max(
        every, key=lambda one: (one.merit[0], _successes(content, one), one.merit)
    )
    near = f"within {near_words(content)} of the best known"
    if best.more:
        lost = f", and in fewer on {len(best.fewer)}" if best.fewer else ""
        return (
            f"{_where(content, best.more)} {best.solver} comes {near} in more seeds "
            f"than {null}{lost} ({_counted(content, best.more, best.solver, null)})"
        )
    # A lower cost is no gain for a solver that is near the best more rarely.
    if best.cheaper and not best.fewer:
        lost = f", and costlier ones on {len(best.costlier)}" if best.costlier else ""
        word = "better" if _maximises(content, best.cheaper) else "cheaper"
        return (
            f"{_where(content, best.cheaper)} {best.solver} finds {word} answers than "
            f"{null}{lost}, though not shown to come {near} in more seeds "
            f"({_seeds(content)})"
        )
    worst = min(every, key=lambda one: one.merit)
    if worst.fewer:
        return (
            f"no solver is shown to come {near} in more seeds than {null}, which does "
            f"so in more than {worst.solver} {_where(content, worst.fewer).lower()} "
            f"({_seeds(content)})"
        )
    return (
        f"no solver is shown to come {near} in more seeds than {null}, or to find "
        f"cheaper answers, on {_on(content['scenarios'], content['scenarios'])} "
        f"({counted(len(content['seeds']), 'seed')})"
    )


def _maximises(content: Content, names: Sequence[str]) -> bool:
    return all(s["sense"] < 0 for s in content["scenarios"] if s["name"] in names)


def _where(content: Content, names: Sequence[str]) -> str:
    count = len(content["scenarios"])
    if count <= NAMED or len(names) == 1:
        return f"on {listed(list(names))}"
    return f"on {len(names)} of {count} scenarios"


def _seeds(content: Content) -> str:
    return f"{counted(len(content['seeds']), 'seed')}, Holm-adjusted p <= {LEVEL:g}"


def _counted(content: Content, names: Sequence[str], solver: str, null: str) -> str:
    """Return the counts for one scenario, else the number of seeds."""
    if len(names) > 1:
        return _seeds(content)
    rows = {
        row["solver"]: row
        for s in content["scenarios"]
        if s["name"] == names[0]
        for row in s["rows"]
    }
    counts = [f"{rows[n]['near'][0]} of {rows[n]['runs']}" for n in (solver, null)]
    return f"{counts[0]} against {counts[1]}, Holm-adjusted p <= {LEVEL:g}"


def _plain_finds(content: Content) -> list[tuple[Content, Content]]:
    """Return scenarios whose best known IPOPT finds from its one start, and its row."""
    return [
        (s, row)
        for s in content["scenarios"]
        for row in s["rows"]
        if row["solver"] == PLAIN and row["near"][0] and row["near"][0] == row["runs"]
    ]


def _null_finds(content: Content, null: str) -> list[Content]:
    """Return other scenarios whose best known the null hypothesis finds each time.

    It is empty if the first solver replaces the null hypothesis, or with few seeds.
    """
    if null != NULL_HYPOTHESIS or len(content["seeds"]) < FEWEST_SEEDS:
        return []
    plain = [s["name"] for s, _ in _plain_finds(content)]
    return [
        s
        for s in content["scenarios"]
        if s["name"] not in plain
        for row in s["rows"]
        if row["solver"] == null and row["near"][0] == row["runs"] and row["runs"]
    ]


def _nothing_gained(content: Content, null: str) -> str:
    """Return the scenarios on which IPOPT or the null hypothesis is as good as any."""
    plain, often = _plain_finds(content), _null_finds(content, null)
    scenarios, parts = content["scenarios"], []
    if plain:
        same = all(row["near"][1] for _, row in plain)
        near = f"comes within {near_words(content)} of the best known"
        does = "finds the same cost" if same else near
        spent = _spent(content, plain[0][1]) if len(plain) == 1 else ""
        where = _every(_on([s for s, _ in plain], scenarios))
        once, every = (
            ("once ", "")
            if all(row["deterministic"] for _, row in plain)
            else ("", " in every run")
        )
        parts.append(
            f"on {where} nothing is gained: {PLAIN} {once}{does}{every}{spent}"
        )
    if often:
        where = _every(_on(often, scenarios))
        parts.append(
            f"on {where} nothing is gained: {null} comes within {near_words(content)} "
            "of the best known in every run"
        )
    return "; ".join(parts)


def _every(words: str) -> str:
    return words.replace("any of", "all", 1)


def _spent(content: Content, row: Content) -> str:
    """Return the effort of a run; in seconds only if they can be compared."""
    if content["judges_seconds"] and row["seconds_p50"] is not None:
        return f" in {row['seconds_p50']:.2g} s"
    if row["evaluations_median"] is not None:
        return f" with {_evaluations(row['evaluations_median'])}"
    return ""


def _evaluations(median: float) -> str:
    return f"{median:g} evaluation{'' if median == 1 else 's'}"


def _unsolved(content: Content) -> str:
    scenarios = content["scenarios"]
    unsolved = [s for s in scenarios if not any(r["feasible"] for r in s["rows"])]
    if not unsolved:
        return ""
    return f"on {_on(unsolved, scenarios)} no solver has a feasible answer"
