"""Rows of a comparison's tables: results of each solver on each scenario, in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmstart.cases.drawing.wording import (
    NO_SUCCESS,
    NOT_FEASIBLE,
    NOT_MEASURED,
    interval,
    is_number,
    median,
    number,
    rate,
    shortened,
    stated_cost,
)
from swarmstart.cases.format.document import counted

_SENTENCE = 300  # Letters of a failure that are shown.


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table.

    Attributes:
        words: Text of the cell.
        value: Number that the cell is sorted by, if there is one.
        is_missing: Whether the cell has no value and is sorted last.
        kind: Class of the cell: "number", "words" or "name".
    """

    words: str
    value: float | None = None
    is_missing: bool = False
    kind: str = "number"

    @property
    def attribute(self) -> str:
        """Return the value as an HTML attribute; empty if the words are the same."""
        told = "" if self.value is None else f"{self.value:.6g}"
        return "" if told == self.words else told


def summary(content: Mapping[str, Any]) -> list[list[Cell]]:
    """Return a row for each scenario and solver, with the columns of SUMMARY."""
    return [
        [
            Cell(shortened(scenario["name"]), kind="name"),
            Cell(shortened(row["solver"]), kind="name"),
            *_success(row),
            Cell(interval(_pair(row)), (_pair(row) or [None])[0]),
            _of(median(row["gaps"]), NOT_FEASIBLE, digits=4),
            _of(row["seconds_p50"], NOT_MEASURED, digits=4),
            _of(row["evaluations_median"], NOT_MEASURED),
            Cell(*_false(row)),
        ]
        for scenario in content["scenarios"]
        for row in scenario["rows"]
    ]


SUMMARY = (
    "scenario", "solver", "success", "95 % interval", "median gap", "P50 seconds",
    "evaluations", "false successes",
)  # fmt: skip

DETAILS = (
    "solver", "feasible", "within", "95 % interval", "best", "median", "worst",
    "evaluations", "P50 s", "P99 s", "build s", "compile s", "evaluations a success",
    "against the first",
)  # fmt: skip


def details(scenario: Mapping[str, Any]) -> list[list[Cell]]:
    """Return a scenario's rows: counts, costs, evaluations, seconds and test result."""
    sense = scenario["sense"]
    table = []
    for row in scenario["rows"]:
        costs = [stated_cost(cost, sense) for cost in row["costs"]]
        # The best first: of a value that is maximised the largest.
        known = sorted(
            (cost for cost in costs if cost is not None), reverse=sense == -1
        )
        ends = [known[0], median(costs), known[-1]] if known else [None] * 3
        table.append(
            [
                Cell(shortened(row["solver"]), kind="name"),
                _of_all(row["feasible"], row["runs"]),
                *_success(row),
                Cell(interval(_pair(row)), (_pair(row) or [None])[0]),
                *(_of(cost, NOT_FEASIBLE, digits=6) for cost in ends),
                _of(row["evaluations_median"], NOT_MEASURED),
                _of(row["seconds_p50"], NOT_MEASURED, digits=4),
                _of(row["seconds_p99"], NOT_MEASURED, digits=4),
                _of(median(row["build_seconds"]), NOT_MEASURED, digits=4),
                _of(median(row["compile_seconds"]), NOT_MEASURED, digits=4),
                _of((row["ert_evaluations"] or [None])[0], NO_SUCCESS, digits=4),
                Cell(against_first(row), kind="words"),
            ]
        )
    return table


def against_first(row: Mapping[str, Any]) -> str:
    """Return the result of the test against the first solver, with its numbers."""
    test = row["against_first"]
    if not test or not (test["verdict"] or test["words"]):
        return ""
    numbers = [
        f"{words} {number(test[name], digits=2)}"
        for name, words in (("p", "p"), ("effect", "A"), ("shift", "shift"))
        if is_number(test[name])
    ]
    told = "; ".join(part for part in (test["words"], ", ".join(numbers)) if part)
    verdict = "" if told.startswith(test["verdict"]) else test["verdict"]
    return ": ".join(part for part in (verdict, told) if part)


def troubles(scenario: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return pairs of a solver and a sentence on what went wrong, without repeats."""
    found = []
    for row in scenario["rows"]:
        sentences = dict.fromkeys(row["failed"])
        counts = {words: row["failed"].count(words) for words in sentences}
        for words, count in counts.items():
            told = shortened(words, _SENTENCE)
            found.append((row["solver"], f"{counted(count, 'run')} failed: {told}"))
        if row["cut"]:
            told = f"{counted(row['cut'], 'run')} stopped by the hard limit"
            found.append((row["solver"], told))
        if row["false_successes"]:
            told = counted(row["false_successes"], "claimed success")
            found.append((row["solver"], f"{told} not confirmed"))
    return found


def measures(scenario: Mapping[str, Any]) -> tuple[list[str], list[list[Cell]]]:
    """Return headings and rows of the measures of flights; empty without any."""
    names = list(
        dict.fromkeys(name for row in scenario["rows"] for name in row["measures"])
    )
    steps = any(row["step_seconds"] for row in scenario["rows"])
    if not names and not steps:
        return [], []
    timed = ["step P50 / P99 / max s", "dt s"] if steps else []
    headings = ["solver", *names, *timed]
    return headings, [
        [
            Cell(shortened(row["solver"]), kind="name"),
            *(_measure(row["measures"].get(name)) for name in names),
            *(_steps(row["step_seconds"]) if steps else []),
        ]
        for row in scenario["rows"]
    ]


def best_words(scenario: Mapping[str, Any]) -> str:
    """Return a scenario's best cost, and what else is known of it, in a sentence."""
    sense = scenario["sense"]
    word = "value" if sense == -1 else "cost"
    if not is_number(scenario["best_cost"]):
        return "No solver has found a feasible answer."
    best = number(stated_cost(scenario["best_cost"], sense), digits=6)
    told = f"Best {word} known: {best}"
    if scenario["best_by"]:
        told += f", found by {shortened(scenario['best_by'])}"
    known = scenario["known_cost"]
    if is_number(known):
        where = shortened(scenario["known_from"] or "elsewhere")
        told += f"; known from {where}: {number(stated_cost(known, sense), digits=6)}"
    if scenario["bound"] is not None:
        told += f"; bound: {shortened(scenario['bound']['words'], _SENTENCE)}"
    return told + (". The value is maximised." if sense == -1 else ".")


REGRESSION = ("scenario", "solver", "quantity", "before", "now", "verdict", "why")


def regression(content: Mapping[str, Any]) -> list[list[Cell]]:
    """Return rows of the table that compares with an earlier comparison.

    Without an earlier comparison there are none.
    """
    if content["regression"] is None:
        return []
    return [
        [
            Cell(shortened(row["scenario"]), kind="name"),
            Cell(shortened(row["solver"]), kind="name"),
            Cell(row["quantity"], kind="name"),
            _of(row["before"], NOT_MEASURED, digits=6),
            _of(row["now"], NOT_MEASURED, digits=6),
            Cell(row["verdict"], kind=_QUALITY.get(row["verdict"], "plain")),
            Cell(shortened(row["words"], _SENTENCE), kind="words"),
        ]
        for row in content["regression"]["rows"]
    ]


_QUALITY = {"better": "good", "worse": "bad", "unknown": "mid"}


def machine_words(machine: Mapping[str, Any]) -> str:
    """Return a machine in words."""
    parts = [str(machine.get(name) or "") for name in ("processor", "system", "python")]
    if machine.get("cores"):
        parts.insert(1, counted(machine["cores"], "core"))
    return ", ".join(shortened(part, 120) for part in parts if part) or NOT_MEASURED


def _pair(row: Mapping[str, Any]) -> Sequence[Any] | None:
    pairs = row["near_intervals"]
    return pairs[0] if pairs else None


def _success(row: Mapping[str, Any]) -> list[Cell]:
    share = rate(row)
    if share is None:
        return [Cell(NOT_MEASURED, is_missing=True)]
    return [Cell(f"{row['near'][0]} of {row['runs']}", share)]


def _false(row: Mapping[str, Any]) -> tuple[str, float]:
    return str(row["false_successes"]), float(row["false_successes"])


def _of(value: object, missing: str, *, digits: int = 5) -> Cell:
    if not is_number(value):
        return Cell(missing, is_missing=True)
    return Cell(number(value, digits=digits), float(value))  # type: ignore[arg-type]


def _of_all(count: int, whole: int) -> Cell:
    return Cell(f"{count} of {whole}", count / whole if whole else 0.0)


def _measure(found: Mapping[str, Any] | None) -> Cell:
    if found is None or not is_number(found["median"]):
        return Cell("undefined" if found else NOT_MEASURED, is_missing=True)
    ends = [number(found[k], "-", digits=4) for k in ("low", "median", "high")]
    told = ends[1] if len(set(ends)) == 1 else f"{ends[1]} ({ends[0]} to {ends[2]})"
    if found["undefined"]:
        told += f", {found['undefined']} undefined"
    return Cell(told, found["median"])


def _steps(found: Mapping[str, Any] | None) -> list[Cell]:
    if found is None:
        return [Cell(NOT_MEASURED, is_missing=True)] * 2
    told = " / ".join(number(found[k], "-", digits=3) for k in ("p50", "p99", "max"))
    return [Cell(told, found["p50"]), _of(found["dt"], NOT_MEASURED, digits=4)]
