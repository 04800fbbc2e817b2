"""The page of one scenario run with many seeds: spread of the measures, bands.

Content, as `run --seeds` records it:

    {"schema": 1, "record": "seeds", "scenario", "seeds": [...], "command",
     "measures": {name: [a value a seed]}, and where known "title", "kind", "variant",
     "vehicles": [name of each UAV], "status": [...], "versions",
     "own_measures": {name: expression}, "failures": [...], "feasible": [...],
     "bands": {"time": [...], "states": {name: {"low", "median", "high", "unit"}}}}
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report.pages.broken_limits import broken_seeds
from swarmstart.cases.drawing.report.pages.run_content import MOST_ROWS
from swarmstart.cases.drawing.report.panels_over_time import SIZE, band_panel
from swarmstart.cases.drawing.report.strips import strip
from swarmstart.cases.drawing.report.text_reports import (
    latex_table,
    latex_text,
    markdown_table,
    markdown_text,
)
from swarmstart.cases.drawing.seed_figures import band_label, shown_time
from swarmstart.cases.drawing.wording import (
    is_number,
    shortened,
    shown,
    unit_of_measure,
)
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.record.files import RecordError

if TYPE_CHECKING:
    from markupsafe import Markup

HEADS = ("measure", "lowest", "median", "highest", "unit", "not defined", "meaning")
MOST_BANDS = 24
MOST_ENDS = 10
"""Ways in which runs ended that a page tells; further ones are counted."""
_SIMULATED = "simulated to the end; "
_RUN = 3
"""Seeds, one after another, from which on the first and the last are told."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SpreadRow:
    """A measure of many runs.

    Attributes:
        name: Name as in run.json.
        values: Value for each seed.
        known: Values that are numbers.
        unit: Unit of the measure; may be empty.
        meaning: Definition of the measure in a sentence.
    """

    name: str
    values: Sequence[Any]
    known: Sequence[float]
    unit: str
    meaning: str

    @property
    def ends(self) -> tuple[float | None, float | None, float | None]:
        """Return lowest, median and highest value; each is None if none is a number."""
        if not self.known:
            return None, None, None
        return min(self.known), statistics.median(self.known), max(self.known)

    @property
    def undefined(self) -> str:
        """Return how many values are missing; empty if all are numbers."""
        missing = len(self.values) - len(self.known)
        return f"{missing} of {len(self.values)}" if missing else ""


def seeds_page(content: Mapping[str, Any]) -> str:
    """Return the page of a scenario run with many seeds.

    Args:
        content: Content of seeds.json, as `run --seeds` records it.

    Raises:
        RecordError: If the content has another form.
    """
    title, rows, bands = _read(content)
    return rendered(
        "seeds_page.html.j2",
        {
            "title": title,
            "headline": _headline(content, rows),
            "is_broken": bool(broken_seeds(content)),
            "rows": [
                (row, [shown(v) for v in row.ends], strip(row.values)) for row in rows
            ],
            "ends": _ends(content),
            "bands": bands,
            "rest": shown_time(content["bands"])[1] if bands else "",
            "size": SIZE,
            "seeds": [str(seed) for seed in content["seeds"]],
            "command": str(content.get("command") or ""),
            "facts": _facts(content),
            "failures": [str(text) for text in content.get("failures") or [] if text],
        },
    )


def seeds_markdown(content: Mapping[str, Any]) -> str:
    """Return the spread of the measures as Markdown; raises as `seeds_page`."""
    title, rows, _ = _read(content)
    return (
        "\n\n".join(
            [
                f"# {markdown_text(title)}",
                markdown_text(_headline(content, rows)),
                markdown_table(HEADS, [_cells(row) for row in rows]),
                *[f"- {markdown_text(line)}" for line in _ends(content)],
                f"    {content.get('command', '')}",
            ]
        )
        + "\n"
    )


def seeds_latex(content: Mapping[str, Any]) -> str:
    """Return the spread of the measures as LaTeX; raises as `seeds_page`."""
    title, rows, _ = _read(content)
    table = latex_table(
        HEADS, [_cells(row) for row in rows], columns="lrrrllp{5cm}", title=title
    )
    return f"{latex_text(_headline(content, rows))}\n\n{table}\n"


def _read(
    content: Mapping[str, Any],
) -> "tuple[str, list[SpreadRow], list[Any]]":
    """Return title, rows and bands; raises RecordError for what does not fit."""
    try:
        if content["record"] != "seeds" or content["schema"] != 1:
            raise ValueError(f"record {content['record']!r}")
        seeds = list(content["seeds"])
        rows = _rows(content, len(seeds))
        bands = _bands(content)
        broken_seeds(content)  # For its errors: the page takes its words later.
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise RecordError(
            "expected the content of `run --seeds` (schema 1), found: "
            f"{type(error).__name__}: {str(error)[:200]}"
        ) from error
    return str(content.get("title") or content.get("scenario") or "Runs"), rows, bands


def _rows(content: Mapping[str, Any], count: int) -> list[SpreadRow]:
    kind = str(content.get("kind") or "")
    known = dict(words_of(kind).measures)
    meanings = {**known, **dict(content.get("own_measures") or {})}
    are_plans = any(v is not None for v in content["measures"].get("confirmed", ()))
    left_out = words_of(kind).of_closed_loops if are_plans else ()
    rows = []
    for name, values in list(content["measures"].items())[:MOST_ROWS]:
        if not isinstance(values, list) or len(values) != count:
            raise ValueError(f"{name}: {count} values expected, one a seed")
        if name in left_out or any(isinstance(value, list) for value in values):
            continue  # A list a seed has no lowest and highest.
        meaning = str(meanings.get(name, ""))
        rows.append(
            SpreadRow(
                name=str(name),
                values=values,
                known=[float(v) for v in values if is_number(v)],
                unit=unit_of_measure(str(name), meaning) if name in known else "",
                meaning=meaning,
            )
        )
    return rows


def _bands(content: Mapping[str, Any]) -> "list[tuple[str, Markup]]":
    """Return name and drawing of the band of each state."""
    given = content.get("bands")
    if not given:
        return []
    times, drawn = given["time"], []
    shown, _ = shown_time(given)
    for number, (name, band) in enumerate(given["states"].items()):
        if any(len(band[side]) != len(times) for side in ("low", "median", "high")):
            raise ValueError(f"{name}: {len(times)} values expected in each band")
        if not times or number >= MOST_BANDS:
            continue
        label = band_label(str(name), content)
        drawn.append((label, band_panel(label, shown, band)))
    return drawn


def _headline(content: Mapping[str, Any], rows: Sequence[SpreadRow]) -> str:
    """Return how many runs, and the spread of the measure that matters most."""
    count = len(content["seeds"])
    of = "seed" if count == 1 else "seeds"
    said = [f"{counted(count, 'run')} with the {of} {_seeds(content)}"]
    said += broken_seeds(content)
    # A verified cost says more than a simulated one, and that more than a planned one.
    first = ("verified_cost", "closed_loop_cost", "flown_cost", "cost", "cost_max",
             "position_error_m")  # fmt: skip
    by_name = {row.name: row for row in rows}
    for name in ("settle_time_s", "x_settle_s"):
        if name in by_name:
            row = by_name[name]
            said.append(f"settled in {len(row.known)} of {count}")
            break
    chosen = next(
        (by_name[n] for n in first if n in by_name and by_name[n].known), None
    )
    if chosen is not None:
        low, median, high = (shown(value) for value in chosen.ends)
        said.append(f"{chosen.name}: lowest {low}, median {median}, highest {high}")
    return "; ".join(said) + "."


def _ends(content: Mapping[str, Any]) -> list[str]:
    """Return how the runs ended, with reason and advice, each with its seeds."""
    found: dict[str, list[str]] = {}
    for seed, status in zip(
        content["seeds"], content.get("status") or (), strict=False
    ):
        if status is not None:
            text = shortened(str(status).removeprefix(_SIMULATED), 600)
            found.setdefault(text, []).append(str(seed))
    lines = [
        f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(seeds)}: {text}"
        for text, seeds in [*found.items()][:MOST_ENDS]
    ]
    more = len(found) - MOST_ENDS
    return [*lines, f"and {more} more"] if more > 0 else lines


def _seeds(content: Mapping[str, Any]) -> str:
    seeds = list(content["seeds"])
    if len(seeds) >= _RUN and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def _facts(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    versions = content.get("versions") or {}
    facts = [
        ("scenario", content.get("scenario")),
        ("kind", content.get("kind")),
        ("variant", content.get("variant")),
        ("seeds", _seeds(content)),
        ("versions", ", ".join(f"{k} {v}" for k, v in dict(versions).items())),
    ]
    return [(name, str(words)) for name, words in facts if words]


def _cells(row: SpreadRow) -> tuple[str, ...]:
    return (row.name, *map(shown, row.ends), row.unit, row.undefined, row.meaning)
