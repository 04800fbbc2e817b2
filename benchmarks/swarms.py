"""Swarms by rules of committed plans: the page docs/measured/swarms.md.

    python benchmarks/swarms.py --write docs/measured/swarms.md [--short]

Random transitions: starts and goals are drawn in a cube, and no draw is left out.
Delays are in ticks of 50 ms. A flight counts as a collision if two vehicles may come
nearer than the least distance between two samples, by a bound that is never too large.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.formation_100 import scenario_of
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    command_of,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.cases.kinds.planar import shortest_assignment
from swarmstart.ocp.swarm.flight import RULES

DISTANCE = 0.35
"""Least distance of Luis and Schoellig's transitions, with z halved [m]."""
SCALE = (1.0, 1.0, 0.5)
APART = 1.15
"""Distance of two starts, and of two goals, in least distances."""
SETTINGS = (("0 to 3 ticks, 5 % lost", 3, 0.05), ("0 to 6 ticks, 30 % lost", 6, 0.3))
SHORT_LEAD_S = 0.3
"""Wait of the rules that need a bound on delays [s]."""
SECONDS = 30.0
TURNING = 128
"""Number of vehicles with a turn rate."""
DELAYED = SETTINGS[0][0]
TWENTY = "20 in 1.59 m, no losses"
HUNDRED = "100 in 4.64 m, no losses"
DELAYED_HUNDRED = f"100 in 4.64 m, {DELAYED}"
IN_RANGE = f"100 in 4.64 m, range of 3 m, {DELAYED}"
CLUTTER = f"128 in 6 m, 20 balls, {DELAYED}"
UNICYCLES = f"{TURNING} unicycles in a square of 16 m, {DELAYED}, 120 s"
WEDGE = f"100 UAVs from a square into the wedge of formation_100, {DELAYED}, 60 s"
TEXT = "# Swarms of committed plans\n\n"


class Trial(NamedTuple):
    """A flight, and the CPU time that it took [s]."""

    flight: ss.SwarmFlight
    cpu_s: float

    @property
    def step_ms(self) -> float:
        """CPU time for each vehicle and step [ms]."""
        steps = self.flight.positions.shape[2] - 1
        return float(1e3 * self.cpu_s / steps / self.flight.swarm.size)

    @property
    def all_arrive(self) -> bool:
        """True if every vehicle arrives."""
        return bool(np.isfinite(self.flight.arrival_s).all())


def places(n: int, side: float, rng: np.random.Generator, balls: Sequence[Array] = (),
           axes: Sequence[float] = (1.0, 1.0, 1.0)) -> Array:  # fmt: skip
    """Return places in a cube that are apart, and away from balls (x, y, z, radius).

    With a zero in `axes` they are in a plane.
    """
    found = list[Array]()
    while len(found) < n:
        place = side * rng.random(3) * axes
        free = all(
            np.linalg.norm((place - b[:3]) * SCALE) > b[3] + DISTANCE for b in balls
        )
        if free and all(
            np.linalg.norm((place - other) * SCALE) >= APART * DISTANCE
            for other in found
        ):
            found.append(place)
    return np.array(found)


def transition(n: int, side: float, seed: int, clutter: int = 0) -> ss.Swarm:
    """Return a random transition in a cube, with balls of 0.3 m in it."""
    rng = np.random.default_rng([n, seed])
    balls = [np.append(side * rng.random(3), 0.3) for _ in range(clutter)]
    return ss.Swarm(
        starts=places(n, side, rng, balls), goals=places(n, side, rng, balls),
        distance=DISTANCE, scale=SCALE,
        obstacles=[ss.Obstacle(radius=b[3], path=[b[:3]]) for b in balls],
    )  # fmt: skip


def unicycles(n: int, side: float, seed: int) -> ss.Swarm:
    """Return a random transition in a square of vehicles that turn at 2 rad/s."""
    rng = np.random.default_rng([n, seed, 2])
    flat = [1.0, 1.0, 0.0]
    return ss.Swarm(
        starts=places(n, side, rng, axes=flat), goals=places(n, side, rng, axes=flat),
        distance=DISTANCE, turn_rate=2.0,
    )  # fmt: skip


def wedge() -> ss.Swarm:
    """Return the UAVs of formation_100 in the frame of their leader.

    Their bounds are those of its vehicles at 20 m/s: the drag as the least
    acceleration, a bank of 30 degrees, and 5 m/s to both sides in speed.
    """
    scenario = scenario_of(100, 35, 1)
    uavs, slots = (
        np.array([[one.x_m, one.y_m, 0.0] for one in each])
        for each in (scenario.uavs, scenario.slots)
    )
    goals = slots + uavs[scenario.leader_uav - 1]
    return ss.Swarm(
        starts=uavs, goals=goals[shortest_assignment(uavs, goals)], distance=5.0,
        acceleration=[1.96] * 3, speed=[5.0] * 3, drift=[20.0, 0.0, 0.0],
        turn_rate=9.81 * np.tan(np.radians(30)) / 20.0,
    )  # fmt: skip


def flown(swarm: ss.Swarm, links: ss.Links, seed: int, rule: str = "acknowledged",
          lead_s: float | None = None, seconds: float = SECONDS) -> Trial:  # fmt: skip
    """Return a flight of a swarm."""
    begin = time.process_time()
    flight = ss.simulate_swarm(
        swarm, links=links, rule=rule, lead_s=lead_s, seconds=seconds,
        longest_s=max(30.0, seconds / 2), seed=seed,
    )  # fmt: skip
    return Trial(flight, time.process_time() - begin)


def chapter_times(seeds: int) -> tuple[float, list[float]]:
    """Return the time in which formation_v settles, and those of formation_v_lossy.

    Args:
        seeds: Number of runs of the latter; none that does not arrive is left out.
    """
    settled = ss.run("formation_v", seed=0).measures["settle_time_s"]
    runs = [ss.run("formation_v_lossy", seed=seed) for seed in range(seeds)]
    times = [run.measures["arrival_time_s"] for run in runs]
    if not isinstance(settled, float):
        raise TypeError(f"formation_v does not settle: {settled}")
    return settled, [t if isinstance(t, float) else np.inf for t in times]


def gate(flights: int) -> Iterator[tuple[str, str, list[Trial]]]:
    """Yield setting, rule and flights of ten vehicles in a cube of 2.2 m."""
    for words, most_delay, loss in SETTINGS:
        links = ss.Links(most_delay=most_delay, loss=loss)
        for rule in RULES:
            lead = None if rule == "acknowledged" else SHORT_LEAD_S
            yield (
                words,
                rule,
                [
                    flown(transition(10, 2.2, seed), links, seed, rule, lead)
                    for seed in range(flights)
                ],
            )


def gate_table(rows: Sequence[tuple[str, str, list[Trial]]]) -> list[str]:
    """Return the table of the rules."""
    lines = head("delays and losses", "rule", "flights", "with a collision",
                 "all arrive", "median time [s]")  # fmt: skip
    for words, rule, trials in rows:
        times = [t.flight.arrival_s.max() for t in trials if t.all_arrive]
        lines.append(
            row(
                words, rule, str(len(trials)),
                str(sum(not t.flight.is_safe for t in trials)), str(len(times)),
                f"{np.median(times):.3g}" if times else "-",
            )
        )  # fmt: skip
    return lines


def table(rows: Mapping[str, list[Trial]]) -> list[str]:
    """Return the table of transitions."""
    lines = head("transitions", "flights", "with a collision", "all arrive",
                 "share of vehicles", "last arrival: median, most [s]", "path ratio",
                 "CPU for a vehicle and step [ms]")  # fmt: skip
    for words, trials in rows.items():
        flights = [t.flight for t in trials]
        last = [t.flight.arrival_s.max() for t in trials if t.all_arrive]
        lines.append(
            row(
                words,
                str(len(trials)),
                str(sum(not f.is_safe for f in flights)),
                str(sum(t.all_arrive for t in trials)),
                f"{np.mean([f.arrived_share for f in flights]):.2%}",
                f"{np.median(last):.3g}, {max(last):.3g}" if last else "-",
                f"{np.median(np.concatenate([f.path_ratio for f in flights])):.3f}",
                f"{np.median([t.step_ms for t in trials]):.2g}",
            )
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate all, print the page, and write it if that is asked for."""
    parser = page_options(__doc__)
    parser.add_argument("--short", action="store_true", help="a few flights of each")
    options = parser.parse_args(arguments)
    part = 20 if options.short else 1
    flown(transition(4, 3.0, 0), ss.Links(most_delay=1, loss=0.1), 0)  # Compiles.
    perfect, lossy = ss.Links(), ss.Links(most_delay=3, loss=0.05)
    rules = list(gate(200 // part))
    rows = {
        f"{n} in 1.59 m, no losses": [
            flown(transition(n, 1.59, s), perfect, s) for s in range(50 // part)
        ]
        for n in (4, 8, 12, 16, 20)
    }
    seeds = range(max(1, 20 // part))
    near = replace(lossy, radio_range=3.0)
    for words, n, side, clutter, links in (
        (HUNDRED, 100, 4.64, 0, perfect),
        (f"25 in 2.92 m, {DELAYED}", 25, 2.92, 0, lossy),
        (f"50 in 3.68 m, {DELAYED}", 50, 3.68, 0, lossy),
        (DELAYED_HUNDRED, 100, 4.64, 0, lossy),
        (IN_RANGE, 100, 4.64, 0, near),
        (CLUTTER, 128, 6.0, 20, lossy),
    ):
        rows[words] = [flown(transition(n, side, s, clutter), links, s) for s in seeds]
    rows[UNICYCLES] = [
        flown(unicycles(TURNING, 16.0, s), lossy, s, seconds=120.0) for s in seeds
    ]
    rows[WEDGE] = [flown(wedge(), lossy, s, seconds=60.0) for s in seeds]
    command = command_of("benchmarks/swarms.py", arguments)
    publish(
        page(rules, rows, chapter_times(max(1, 10 // part)), command), options, TEXT
    )
    return 0


def page(
    rules: Sequence[tuple[str, str, list[Trial]]],
    rows: Mapping[str, list[Trial]],
    chapter: tuple[float, list[float]],
    command: str,
) -> list[str]:
    """Return the lines of the page below its title."""
    safe = [t for _, rule, trials in rules if rule == "acknowledged" for t in trials]
    safe += [t for trials in rows.values() for t in trials]
    others = [t for _, rule, trials in rules if rule != "acknowledged" for t in trials]
    hits = sum(not t.flight.is_safe for t in safe)
    settled, lossy = chapter
    twenty, hundred = (
        np.mean([t.all_arrive for t in rows[one]]) for one in (TWENTY, HUNDRED)
    )
    arrived, turning, slotted = (
        np.mean([t.flight.arrived_share for t in rows[one]])
        for one in (CLUTTER, UNICYCLES, WEDGE)
    )
    ratio = np.median(np.concatenate([t.flight.path_ratio for t in rows[CLUTTER]]))
    step, uav_step = (
        np.median([t.step_ms for t in rows[one]]) for one in (DELAYED_HUNDRED, WEDGE)
    )
    return [
        "If a vehicle changes its plan only after all others have accepted the new one "
        f"(rule `acknowledged`), {hits} of {len(safe)} flights have a collision, and "
        f"{np.mean([t.flight.arrived_share for t in safe]):.1%} of the vehicles "
        "arrive; by rules without acceptances "
        f"{sum(not t.flight.is_safe for t in others)} of {len(others)} flights have "
        "one.",
        "",
        f"Made by `{command}`, on one of {os.cpu_count()} cores. The rules are those "
        "of [committed plans](../explanation/committed_plans.md). Starts are random in "
        f"a cube, {APART * DISTANCE:.2g} m or more apart if distances are measured "
        "with z halved, and so are goals. The vehicles keep a least distance of "
        f"{DISTANCE} m. They accelerate by up to 1 m/s^2 and move at up to 2 m/s along "
        f"each axis. A flight takes at most {SECONDS:g} s if its row has no other "
        "time. Vehicles exchange messages once a tick, which is 50 ms, and a step is "
        "0.1 s. A flight has a collision if a lower bound of the distance of two "
        "vehicles, which also holds between samples, is below the least distance. "
        '"12 in 1.59 m" means 12 vehicles in a cube with sides of 1.59 m. A plan lasts '
        "30 s at most, or half of a longer flight. The cube holds the starts and "
        "goals; the vehicles may leave it. The path ratio is the median of the length "
        "of a path divided by the straight line from its start to its goal.",
        "",
        *bar_table(
            Bar(words, relation, bound, float(measured))
            for words, relation, bound, measured in (
                ("flights with a collision, with acceptances", "<=", 0, hits),
                ("20 in 1.59 m: flights in which all arrive", ">=", 0.96, twenty),
                ("100 in 4.64 m: flights in which all arrive", ">=", 0.95, hundred),
                ("128 among balls: vehicles that arrive", ">=", 0.98, arrived),
                ("128 among balls: path ratio", "<=", 1.15, ratio),
                ("128 unicycles: vehicles that arrive in 120 s", ">=", 0.98, turning),
                (
                    "formation_v_lossy: longest time by that of formation_v",
                    "<=",
                    1.5,
                    max(lossy) / settled,
                ),
                ("100, losses: CPU for a vehicle and step [ms]", "<=", 1.0, step),
                ("wedge of 100: UAVs that arrive in 60 s", ">=", 0.98, slotted),
                ("wedge of 100: CPU for a UAV and step [ms]", "<=", 1.0, uav_step),
            )
        ),
        "## Rules",
        "",
        "Ten vehicles in a cube of 2.2 m, the same seeds for each rule. By `waiting` "
        f"and `hearsay` a new plan parts from the old one after {SHORT_LEAD_S} s; by "
        "`waiting` a vehicle adopts the new plan at that time, if it has heard of "
        "nothing in its way, by `hearsay` at once.",
        "",
        *gate_table(rules),
        "",
        "## Transitions",
        "",
        *table(rows),
        "",
        "## The chapter's flight",
        "",
        f"`formation_v` settles after {settled:.3g} s, with all messages in time. "
        "`formation_v_lossy`, with the same starts, slots and bounds of acceleration "
        f"and turn rate, but 30 % of the messages lost, arrives after {min(lossy):.3g} "
        f"to {max(lossy):.3g} s in {len(lossy)} runs.",
    ]


if __name__ == "__main__":
    raise SystemExit(main())
