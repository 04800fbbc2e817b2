"""Small records to draw, and a browser to open their pages in."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.drawing.report.tracks import Plane, Series, Tracks
from swarmstart.cases.drawing.vehicles import Disc, Surroundings
from swarmstart.tests.browser import chromium

POINT = """\
kind: problem
title: A point <b>goes</b> past a mast
constants: {mast: 3, wide: 2*0.25}
states:
  x: {start: 0, rate: vx, unit: m}
  y: {start: 0, rate: vy, unit: m}
  vx: {start: 1, rate: ax, unit: m/s}
  vy: {start: 0, rate: ay, unit: m/s}
controls:
  ax: {bounds: [-1, 1], unit: m/s^2}
  ay: {bounds: [-1, 1], unit: m/s^2}
stage_cost: ax**2 + ay**2 + (x - 4)**2 + (y - 1)**2
path: [{distance: [x - mast, y + 0.5], at_least: wide, name: mast}]
prediction: {horizon_s: 2, intervals: 4}
feedback: {law: receding_horizon}
steps: 4
search: {name: none}
lanes: 0
measures: {highest: max(y)}
claims:
  - {id: "1", text: It stays below 9, source: here, measure: highest, relation: "<=",
     bound: 9}
"""


def flown_point(folder: Path) -> Path:
    """Run the point; return its record, without figures."""
    file, record = folder / "point.yaml", folder / "record"
    file.write_text(POINT, encoding="utf-8")
    words = ["run", str(file), "--out", str(record), "--quiet", "--no-figures"]
    assert main(words) == 0
    return record


def circling(vehicles: int, *, frames: int = 50, steps: int = 10) -> Tracks:
    """Return vehicles that move round circles of 10 m in 10 s, in closed form."""
    times = np.linspace(0.0, 10.0, frames)
    phase = np.linspace(0.0, np.pi, vehicles)[:, None]
    angle = 2 * np.pi * times / 10.0 + phase
    centre = 3.0 * np.arange(vehicles)[:, None]
    positions = np.stack([centre + 10 * np.cos(angle), 10 * np.sin(angle)], axis=1)
    held = np.sin(np.arange(steps))[None].repeat(vehicles, axis=0)
    instants = np.linspace(0.0, 10.0, steps + 1)
    return Tracks(
        title="Circles",
        times=times,
        vehicles=tuple(f"UAV {n}" for n in range(1, vehicles + 1)),
        plane=Plane(
            unit="m",
            positions=positions,
            headings=angle + np.pi / 2,
            surroundings=Surroundings(
                discs=[Disc(x=0.0, y=0.0, radius=2.0)],
                targets=positions[:, :, :1].repeat(frames, axis=2),
                called="goal",
            ),
            plans=[(0.0, [one[:, :5] for one in positions])],
        ),
        series=(
            Series(
                name="turn rate", unit="rad/s", times=instants, values=held,
                lower=-2.0, upper=2.0,
            ),
        )
        if vehicles <= 10
        else (),
        step_times=instants,
        step_seconds=np.full(steps, 0.01),
        without_plan=np.zeros(steps, dtype=bool),
    )  # fmt: skip


@dataclass(frozen=True)
class Opened:
    """A page in the browser, with what it said and asked for."""

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def show(self, html: str, file: Path, *, width: int = 1100) -> Any:
        """Open a page; return it."""
        file.write_text(html, encoding="utf-8")
        self.said.clear()
        self.asked.clear()
        self.page.set_viewport_size({"width": width, "height": 800})
        self.page.goto(file.as_uri())
        return self.page

    def is_silent(self) -> bool:
        """Return whether the page said nothing and asked for nothing but itself."""
        beyond = [u for u in self.asked if not u.startswith(("file:", "data:"))]
        return self.said == [] and beyond == []

    def scrolls_sideways(self) -> bool:
        """Return whether the page is wider than its window."""
        return bool(
            self.page.evaluate("document.documentElement.scrollWidth > innerWidth")
        )


@contextlib.contextmanager
def browser() -> Iterator[Opened]:
    """Open a browser, whose clock is the test's; skip without one."""
    with chromium() as started:
        opened = Opened(started.new_page())
        opened.page.clock.install(time=0)
        opened.page.clock.pause_at(1)  # From now on it runs when the test says so.
        opened.page.on("console", lambda message: opened.said.append(message.text))
        opened.page.on("pageerror", lambda error: opened.said.append(str(error)))
        opened.page.on("request", lambda request: opened.asked.append(request.url))
        yield opened
