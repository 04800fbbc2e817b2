"""Figure of the slack of constraints, below 0 shaded."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from swarmstart.cases.drawing.drawing import COLOURS
from swarmstart.cases.drawing.panels import MOST_PANELS, grid, wrapped
from swarmstart.cases.drawing.series import name_lines
from swarmstart.cases.drawing.slack import Slack

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BROKEN = COLOURS[1]
_ROUNDING = 1e-2
"""Of the tolerance: an axis shows at least so much, so that rounding looks flat."""
_TITLE = 40
"""Characters of a line above a panel."""


def slack_figure(rows: Sequence[Slack]) -> "Figure":
    """Return the slack of each row: shaded below 0, marked if it counts at the end.

    Args:
        rows: Of path and terminal constraints, at least one.
    """
    shown = rows[:MOST_PANELS]
    figure, (block,) = grid([len(shown)])
    for axes, row in zip(block, shown, strict=True):
        _draw_slack(axes, row)
    title = "distance to the limit, broken below 0 (of an equality: off 0)"
    if len(rows) > len(shown):
        title = f"the first {len(shown)} of {len(rows)} rows: {title}"
    figure.suptitle(title, fontsize="medium")
    name_lines(figure)
    return figure


def _draw_slack(axes: "Axes", row: Slack) -> None:
    axes.axhline(0.0, color="0.25", ls=":", lw=1.4)
    axes.plot(row.times, row.values, color=COLOURS[0], lw=1.2)
    if row.is_terminal:
        end = row.values[-1]
        broken = abs(end) > row.tolerance if row.is_equality else end < -row.tolerance
        axes.plot(
            row.times[-1], end, "o", ms=5, clip_on=False,
            color=BROKEN if broken else COLOURS[2],
            label="broken at the end" if broken else "kept at the end",
        )  # fmt: skip
    else:
        broken = (row.values != 0.0) if row.is_equality else row.values < 0.0
        axes.fill_between(
            row.times, row.values, 0.0, where=broken, interpolate=True, color=BROKEN,
            alpha=0.35, lw=0, label="broken" if broken.any() else None,
        )  # fmt: skip
    low, high = axes.get_ylim()
    rounding = _ROUNDING * row.tolerance
    axes.set_ylim(min(low, -rounding), max(high, rounding))
    axes.set_title(wrapped(row.name, width=_TITLE), fontsize="small", loc="left")
