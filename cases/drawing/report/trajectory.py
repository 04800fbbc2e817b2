"""The best answer's states and controls over time, a panel each."""

from collections.abc import Mapping, Sequence
from typing import Any

from swarmstart.cases.drawing.naming.wording import is_number, number, shortened
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.figure import Figure

_COLUMNS = 3
_WIDE, _HIGH = 300.0, 150.0
_MOST = 24  # Panels; what is beyond them is in the values to download.
_STATE, _CONTROL = 0, 1  # Colours: the first two are the furthest apart.


def trajectory(
    scenario: Mapping[str, Any], *, identity: str, points: int
) -> Figure | None:
    """Return states (lines) and controls (steps) of the best answer, if there is one.

    Args:
        scenario: Of the content of a comparison.
        identity: The figure's id.
        points: The most instants drawn and listed.
    """
    answer = scenario["answer"]
    if answer is None or not answer["plan"]["time"]:
        return None
    plan = answer["plan"]
    time = plan["time"]
    kept = svg.thinned(len(time), points)
    series = [
        (name, values, _STATE)
        for name, values in zip(plan["state_names"], plan["states"], strict=False)
    ] + [
        (name, values, _CONTROL)
        for name, values in zip(plan["control_names"], plan["controls"], strict=False)
    ]
    if not series:
        return None
    shown = series[:_MOST]
    columns = min(_COLUMNS, len(shown))
    parts = [
        _panel(name, time, values, kind, kept=kept, place=(k % columns, k // columns))
        for k, (name, values, kind) in enumerate(shown)
    ]
    rows = -(-len(shown) // columns)
    left_out = len(series) - len(shown)
    header = ["time", *(name for name, _, _ in series)]
    values = [[time[k], *(_value(part, k) for _, part, _ in series)] for k in kept]
    thinner = "" if len(kept) == len(time) else f" {len(kept)} of {len(time)} instants."
    more = f" {left_out} more are among the values to download." if left_out else ""
    return Figure(
        identity=identity,
        title=f"The best answer: {shortened(scenario['name'], 60)}",
        caption=f"Found by {shortened(answer['solver'], 60)}, seed {answer['seed']}: "
        "states (lines) and controls (dashed steps, constant over an interval) over "
        f"time, simulated on the verified path.{thinner}{more}",
        chart="".join(parts),
        width=round(columns * _WIDE),
        height=round(rows * _HIGH),
        columns=[shortened(name, 30) for name in header[: _MOST + 1]],
        rows=[[number(value, "") for value in row[: _MOST + 1]] for row in values],
        values=[header, *values],
    )


def _panel(
    name: str,
    time: Sequence[Any],
    values: Sequence[Any],
    kind: int,
    *,
    kept: Sequence[int],
    place: tuple[int, int],
) -> str:
    left, top = place[0] * _WIDE + 48, place[1] * _HIGH + 26
    right, bottom = left + _WIDE - 62, top + _HIGH - 56
    x = svg.axis_over(time, left, right, label="", margin=0)
    y = svg.axis_over(values, bottom, top, label="", margin=0.06)
    known = [
        (x.at(float(time[k])), y.at(float(value)))
        for k in kept
        if is_number(time[k]) and is_number(value := _value(values, k))
    ]
    return (
        svg.frame(x, y)
        + svg.words_at(left, top - 9, shortened(name, 34), name="l")
        + svg.line(known, kind, name, is_step=kind == _CONTROL)
    )


def _value(values: Sequence[Any], place: int) -> Any:
    """Return the value at an instant; the last control holds until the end."""
    return values[min(place, len(values) - 1)] if values else None
