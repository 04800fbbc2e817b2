"""The player: a recorded run as an animation that needs no network.

    player(tracks) -> markup; PLAYER_STYLE and PLAYER_SCRIPT once in the page

It shows vehicles, trails, plans and surroundings in the plane, to scale, with a clock;
beside them the solver's time for each step; below states and controls over time, each
with a cursor that moves with the clock. A flight without positions has the panels
alone. Nothing starts by itself.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.panels_over_time import (
    ACROSS,
    PanelDrawn,
    series_panels,
    solver_panel,
)
from swarmstart.cases.drawing.report.tracks import Plane, Tracks
from swarmstart.cases.drawing.wording import number
from swarmstart.cases.format.document import counted

if TYPE_CHECKING:
    from markupsafe import Markup


WIDTH = 10_000
"""Width of the plane in the units of its paths: whole numbers are fine enough."""
SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Speeds to choose from, relative to the run's own time."""
MOST_IN_LEGEND = 12
"""Largest number of vehicles in a legend that does not hide the plane."""
MOST_PLAN_NUMBERS = 60_000
"""Largest number of numbers in a page's plans; above, every second plan is left out."""
_COLOURS = 12
"""Colours of vehicles in the page's style; then they begin again."""
_BESIDE = 3
"""Panels beside the plane."""
_TIMES = "\N{MULTIPLICATION SIGN}"
_LASTS = (3.0, 30.0)
"""Seconds that a flight may take at its own pace to be played at that."""
_PLAYED = 8.0
"""Seconds that other flights take, as nearly as the speeds allow."""
_MARKS = 8
"""Marks of time below the slider, about."""
_MOST_MARKED = 10
"""Number of vehicles whose tracks have dots at the marks of time."""
_FOLLOWED = 3.0
"""Times the extent of the vehicles from which on of the whole way they are followed."""


def player(tracks: Tracks) -> "Markup":
    """Return a flight as an animation; the page needs its style and its script once.

    Args:
        tracks: The run that is played.
    """
    from markupsafe import Markup

    world = None if tracks.plane is None else _World(tracks.plane)
    panels = series_panels(tracks)
    solver = solver_panel(tracks)
    end = float(tracks.times[-1])
    shown = [solver, *panels] if solver else panels
    beside = _BESIDE if world is not None else 0
    payload: dict[str, Any] = {
        "end": end,
        "frames": int(tracks.times.size),
        # Decimals of the clock: one to three, for about three digits of the end.
        "digits": max(1, min(3, 2 - math.floor(math.log10(end or 1.0)))),
        "panels": [
            {"times": p.times, "values": p.values, "held": p.held} for p in shown
        ],
        "edges": ACROSS,
    }
    if world is not None:
        payload["plane"] = world.payload(tracks)
    return Markup(
        rendered(
            "player.html.j2",
            {
                "id": "flight",
                "title": tracks.title,
                "payload": payload,
                "world": None if world is None else world.drawn(tracks),
                "side": shown[:beside],
                "panels": shown[beside:],
                "speeds": [(one, f"{one:g}{_TIMES}") for one in _speeds(end)],
                "speed": _speed(end),
                "end": f"{end:.{payload['digits']}f}",
                "legend": _legend(tracks),
                "caption": [*caption(tracks), *_bounds_caption(panels)],
            },
        )
    )  # fmt: skip


def caption(tracks: Tracks) -> list[str]:
    """Return sentences that explain the picture."""
    said = [] if tracks.plane is None else [_plane_caption(tracks.plane)]
    if tracks.is_one_plan and tracks.step_seconds.size:
        seconds = number(float(np.nansum(tracks.step_seconds)), digits=4)
        said.append(
            f"One plan, made before the start in {seconds} s, is followed to its end."
        )
    missing = int(tracks.without_plan.sum())
    if missing and not tracks.is_one_plan:
        said.append(
            f"Crosses in the panel of the solver's time: the {missing} of "
            f"{counted(tracks.without_plan.size, 'step')} at which a vehicle planned, "
            "but found no feasible plan."
        )
    broken = int(tracks.linear_breaks.sum())
    if broken:
        said.append(
            f"At {counted(broken, 'step')} under the linear law the path breaks a "
            "constraint."
        )
    return [sentence.strip() for sentence in (*said, *tracks.notes)]


def _plane_caption(plane: Plane) -> str:
    """Return a sentence on what is seen in the plane."""
    around = plane.surroundings
    parts = {
        "thin lines: the whole tracks; thick: until now": True,
        "dashed: the plans made last": bool(plane.plans),
        f"crosses: the {around.called}s": around.targets is not None,
        "ring: the leader": around.leader is not None,
        "grey discs: places to keep out of": any(not d.is_limit for d in around.discs),
        "dotted circles: places to stay within": any(d.is_limit for d in around.discs),
    }
    text = "; ".join(words for words, is_seen in parts.items() if is_seen)
    return f"{text[:1].upper()}{text[1:]}. {plane.words}"


def _bounds_caption(panels: Sequence[PanelDrawn]) -> list[str]:
    """Return sentences on the bounds that are drawn, and on those that are not."""
    said = []
    if any(panel.has_bounds for panel in panels):
        said.append("Dashed levels: bounds.")
    far = [panel.far for panel in panels if panel.far]
    if far:
        said.append(f"Bounds too far away to be drawn: {'; '.join(far)}.")
    return said


def _speeds(end: float) -> Sequence[float]:
    return (*SPEEDS, 100.0) if end > 60 * SPEEDS[-1] else SPEEDS


def _speed(end: float) -> float:
    """Return the speed to begin with: the flight's own, or one that suits the eye."""
    if _LASTS[0] <= end <= _LASTS[1]:
        return 1.0
    return min(_speeds(end), key=lambda speed: abs(np.log(end / speed / _PLAYED)))


def _legend(tracks: Tracks) -> list[tuple[int, str]]:
    """Return number of the colour, and name, of each vehicle; none of many, or one."""
    count = len(tracks.vehicles)
    if not 1 < count <= MOST_IN_LEGEND:
        return []
    return [(place % _COLOURS, name) for place, name in enumerate(tracks.vehicles)]


def short_name(name: str) -> str:
    """Return the text beside a vehicle: its number, or its name."""
    last = name.rpartition(" ")[2]
    return last if last.isdigit() else name[:12]


class _World:
    """The plane's metres (or feet) as whole numbers, y down as in SVG."""

    def __init__(self, plane: Plane) -> None:
        """Find the extent of the drawing."""
        around, self.plane = plane.surroundings, plane
        places = [plane.positions.swapaxes(0, 1).reshape(2, -1)]
        if around.targets is not None:
            places.append(around.targets.swapaxes(0, 1).reshape(2, -1))
        if around.leader is not None:
            places.append(around.leader)
        for disc in around.discs:
            reach = np.array([[-disc.radius, disc.radius]])
            places.append(np.array([[disc.x], [disc.y]]) + reach)
        every = np.hstack(places)
        every = every[:, np.isfinite(every).all(axis=0)]
        if not every.size:
            every = np.zeros((2, 1))
        low, high = every.min(axis=1), every.max(axis=1)
        size = float((high - low).max()) or 1.0
        # A straight track is a line: it gets ground on both sides, a fifth as high.
        middle, half = (low + high) / 2, np.maximum(high - low, size / 5) / 2
        self.low, self.high = middle - half, middle + half
        self.per_unit = WIDTH / float((self.high - self.low)[0])
        self.height = round(float((self.high - self.low)[1]) * self.per_unit)

    def x(self, values: Array) -> Array:
        """Return the places of x coordinates, counted from the left edge."""
        return np.asarray((values - self.low[0]) * self.per_unit)

    def y(self, values: Array) -> Array:
        """Return the places of y coordinates, counted from the upper edge down."""
        return np.asarray((self.high[1] - values) * self.per_unit)

    def payload(self, tracks: Tracks) -> dict[str, Any]:
        """Return what the script draws at each instant."""
        plane, around = self.plane, self.plane.surroundings
        x, y = plane.positions[:, 0], plane.positions[:, 1]
        spread = _spread(plane.positions)
        extent = float((self.high - self.low).max())
        window = max(spread * 1.5, extent / 12)
        return {
            "width": WIDTH,
            "height": self.height,
            "unit": plane.unit,
            "per_unit": self.per_unit,
            "origin": [float(self.low[0]), float(self.high[1])],
            "x": [_whole(row) for row in self.x(x)],
            "y": [_whole(row) for row in self.y(y)],
            # y points down in SVG, so that angles change their sign.
            "turn": [_whole(row) for row in np.degrees(-plane.headings)],
            "window": window * self.per_unit,
            "follow": len(x) > 1 and extent > _FOLLOWED * window,
            "leader": None
            if around.leader is None
            else {
                "x": _whole(self.x(around.leader[0])),
                "y": _whole(self.y(around.leader[1])),
            },
            "targets": []
            if around.targets is None
            else [
                {
                    "x": _fixed(_whole(self.x(one[0]))),
                    "y": _fixed(_whole(self.y(one[1]))),
                }
                for one in around.targets
            ],
            "plans": self._plans(),
            "marks": _marks(tracks),
        }

    def _plans(self) -> list[Any]:
        """Return time and paths of plans; of many plans every second."""
        plans = list(self.plane.plans)
        while sum(p.size for _, e in plans for p in e if p is not None) > (
            MOST_PLAN_NUMBERS
        ):
            plans = plans[::2]
        return [
            [
                round(time, 6),
                [None if one is None else self._flat(one) for one in each],
            ]
            for time, each in plans
        ]

    def _flat(self, places: Array) -> list[int]:
        both = np.stack([self.x(places[0]), self.y(places[1])], axis=1)
        kept = both[np.isfinite(both).all(axis=1)]
        far = 20 * WIDTH  # A plan that diverges.
        return [int(v) for v in np.clip(kept, -far, far).round().ravel()]

    def drawn(self, tracks: Tracks) -> dict[str, Any]:
        """Return what the template draws once."""
        plane = self.plane
        every = 1 if len(plane.positions) <= MOST_IN_LEGEND else 3
        marks = np.array(_marks(tracks))
        discs = [
            {
                "x": round(float(self.x(np.array(disc.x)))),
                "y": round(float(self.y(np.array(disc.y)))),
                "r": round(disc.radius * self.per_unit),
                "name": disc.name or ("limit" if disc.is_limit else "keep out"),
                "limit": disc.is_limit,
            }
            for disc in plane.surroundings.discs
        ]
        vehicles = []
        for place, (x, y) in enumerate(plane.positions):
            thin = slice(None, None, every)
            vehicles.append(
                {
                    "colour": place % _COLOURS,
                    "name": tracks.vehicles[place] or "vehicle",
                    "short": short_name(tracks.vehicles[place]),
                    "track": svg.path(self.x(x[thin]).round(), self.y(y[thin]).round()),
                    "dots": svg.dots(
                        self.x(np.interp(marks, tracks.times, x)).round(),
                        self.y(np.interp(marks, tracks.times, y)).round(),
                    )
                    if place < _MOST_MARKED
                    else "",
                }
            )
        return {
            "width": WIDTH,
            "height": self.height,
            "discs": discs,
            "vehicles": vehicles,
            "targets": 0
            if plane.surroundings.targets is None
            else len(plane.surroundings.targets),
            "leader": plane.surroundings.leader is not None,
            "small": len(plane.positions) > 2 * MOST_IN_LEGEND,
            "alt": f"{tracks.title}: {len(plane.positions)} "
            f"{'vehicles move' if len(plane.positions) > 1 else 'vehicle moves'} in "
            f"the plane for {float(tracks.times[-1]):.4g} s.",
        }


def _spread(positions: Array) -> float:
    """Return the largest extent of all vehicles at an instant."""
    finite = np.isfinite(positions).all(axis=(0, 1))
    if not finite.any():
        return 0.0
    return float(np.ptp(positions[:, :, finite], axis=0).max())


def _marks(tracks: Tracks) -> list[float]:
    """Return instants that are marked on the tracks."""
    from matplotlib.ticker import MaxNLocator

    end = float(tracks.times[-1])
    ticks = MaxNLocator(_MARKS, steps=[1, 2, 5, 10]).tick_values(0.0, end)
    return [float(tick) for tick in ticks if 0 < tick <= end]


def _whole(values: Array) -> list[int | None]:
    return [round(float(v)) if np.isfinite(v) else None for v in values]


def _fixed(values: list[int | None]) -> list[int | None]:
    """Return the one value of what stands still, else all."""
    return values[:1] if len(set(values)) == 1 else values
