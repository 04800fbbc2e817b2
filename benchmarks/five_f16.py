"""Five F-16 of JSBSim in a V: the page docs/measured/five_f16.md.

    python benchmarks/five_f16.py --write docs/measured/five_f16.md [--seeds 10]

A leader goes straight, turns by TURN rad in a minute, and goes straight again. Four
followers keep slots of a V that turns with it. Each plans with first-order lags of
speed and heading, identified from step responses, while JSBSim simulates engines,
control surfaces and six degrees of freedom at 120 Hz. A law that is proportional to the
error of the slot, with the same set points, is run beside.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.benchmarks.tables import command_of, head, page_options, publish, row

TAU_V, TAU_PSI = 1.7, 5.5
"""Time constants of speed and heading, identified [s]."""
SPEED, HEIGHT = 222.0, 4572.0
SLOTS = np.array([[0, 0], [-100, 100], [-100, -100], [-200, 200], [-200, -200.0]])
"""Ahead and to the right of the leader [m]."""
OFFSET = 10.0
"""Largest error of a follower's start in each direction [m]."""
SECONDS, BEGIN, END, TURN = 240, 60, 120, 0.6
"""Length of the flight, begin and end of the turn [s], and its angle [rad]."""
SETTLED = 30
"""Time after a start or a turn from which flight counts as straight [s]."""
HORIZON = 10
"""Length of a plan, with an interval a second [s]."""
EFFORT, HASTY = 3e4, 1e3
"""Weight of the heading's set point beyond the heading, and one that is too small."""
FIRST_SEED = 1
"""The weight was chosen on seed 0."""
TEXT = "# Five F-16\n\n"
Law = Callable[[int, Array, Array, Array], Array]
"""Number of a follower, its state, its slot and the leader's heading over the horizon
-> set points of speed and heading."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Flown:
    """A flight of the five.

    Attributes:
        straight: Root mean square of the distance from the slot in straight flight [m].
        worst: Largest distance from the slot from SETTLED on, and after the turn [m].
        turning: The same in the turn and SETTLED after it [m].
        apart: Least distance of two aircraft [m].
        height: Largest change of height [m].
        simulating: CPU time of JSBSim and its autopilots [s].
        planning: CPU time of all decisions [s].
    """

    straight: float
    worst: float
    turning: float
    apart: float
    height: float
    simulating: float
    planning: float


def wanted_heading(seconds: Array) -> Array:
    """Return the leader's set point of the heading [rad]."""
    return TURN * np.clip((seconds - BEGIN) / (END - BEGIN), 0.0, 1.0)


@cache
def planner(effort: float, solver: str) -> ss.Planner:
    """Return the planner of a follower: lags of speed and heading, and its slot."""
    x, u, slot = ca.SX.sym("x", 4), ca.SX.sym("u", 2), ca.SX.sym("slot", 2)
    speed, heading = x[0], x[1]
    ode = ca.vertcat(
        (u[0] - speed) / TAU_V, u[1] / TAU_PSI,
        speed * ca.cos(heading), speed * ca.sin(heading),
    )  # fmt: skip
    # The second control is the set point of the heading beyond the heading; its bounds
    # are those of the turn rate at the largest bank angle, 1 rad.
    most = TAU_PSI * 9.81 * np.tan(1.0) / SPEED
    error = ca.sumsqr(x[2:] - slot)
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ode), horizon=float(HORIZON),
        intervals=HORIZON, signals=slot,
        stage_cost=error + (u[0] - speed) ** 2 + effort * u[1] ** 2,
        terminal_cost=10 * error,
        bounds=ss.Bounds(controls=([SPEED - 25, -most], [SPEED + 25, most])),
    )  # fmt: skip
    ipopt = solver == "ipopt"
    polish = ss.IpoptOptions() if ipopt else ss.NlpOptions(plugin=solver)
    return ss.Planner(problem, search=None, polish=polish)


class Planned:
    """Set points by plans, each of which begins at the last one."""

    def __init__(self, effort: float = EFFORT, solver: str = "ipopt") -> None:
        """Begin without plans.

        Args:
            effort: Weight of the heading's set point beyond the heading.
            solver: NLP solver of CasADi that makes each plan.
        """
        self._slot = np.zeros((2, HORIZON + 1))
        self._controller = ss.RecedingHorizon(
            planner=planner(effort, solver),
            reference=lambda times: self._slot,
            append="last",
        )
        self._decisions: dict[int, ss.Decision] = {}
        self._rng = np.random.default_rng(0)

    def __call__(self, number: int, x: Array, slot: Array, heading: Array) -> Array:
        """Return the set points of a follower."""
        # The distance of places counts, not where on the earth they are.
        start, origin = x.copy(), x[2:].copy()
        start[2:] -= origin
        self._slot = slot - origin[:, None]
        last = self._decisions.get(number)
        found = self._controller.decide(0.0, start, last, rng=self._rng)
        self._decisions[number] = found
        return np.array([found.control[0], x[1] + found.control[1]])


def proportional(number: int, x: Array, slot: Array, heading: Array) -> Array:
    """Return set points that are proportional to the error of the slot now."""
    c, s = np.cos(heading[0]), np.sin(heading[0])
    north, east = slot[:, 0] - x[2:]
    along, across = c * north + s * east, c * east - s * north
    return np.array([
        SPEED + np.clip(0.15 * along, -15, 15),
        heading[0] + np.clip(0.004 * across, -0.3, 0.3),
    ])  # fmt: skip


def expected_slots(leader: Array, now: int) -> tuple[Array, Array]:
    """Return the slots over the horizon, (5, 2, HORIZON + 1), and the heading.

    The leader is expected to follow its set points with the identified lags.
    """
    speed, heading, _, north, east = leader
    parts, dt = 10, 0.1
    headings, places = [heading], [(north, east)]
    for step in range(HORIZON * parts):
        target = wanted_heading(np.array(now + step * dt))
        heading += dt * (target - heading) / TAU_PSI
        north += dt * speed * np.cos(heading)
        east += dt * speed * np.sin(heading)
        if (step + 1) % parts == 0:
            headings.append(heading)
            places.append((north, east))
    turned = np.array(headings)
    c, s = np.cos(turned), np.sin(turned)
    ahead, right = SLOTS[:, :1], SLOTS[:, 1:]
    offsets = np.stack([c * ahead - s * right, s * ahead + c * right], axis=1)
    return np.array(places).T + offsets, turned


def flight(law: Law, seed: int) -> Flown:
    """Simulate the five once."""
    plant = ss.AircraftPlant("f16", count=5)
    rng = np.random.default_rng(seed)
    starts = SLOTS + OFFSET * rng.uniform(-1, 1, SLOTS.shape) * (
        np.arange(5)[:, None] > 0
    )
    straight = np.tile([SPEED, 0.0, HEIGHT], (5, 1))
    x = plant.start_at(np.hstack([straight, starts]).ravel())
    errors, apart, height, simulating, planning = [], [], 0.0, 0.0, 0.0
    for now in range(SECONDS):
        rows = x.reshape(5, 5)
        begun = time.process_time()
        slots, heading = expected_slots(rows[0], now)
        u = np.column_stack([np.zeros((5, 2)), np.full(5, HEIGHT)])
        # A set point that is held for a second is that of its middle.
        u[0, :2] = SPEED, wanted_heading(np.array(now + 0.5))
        for number in range(1, 5):
            own = rows[number][[0, 1, 3, 4]]
            u[number, :2] = law(number, own, slots[number], heading)
        planning += time.process_time() - begun
        errors.append(np.hypot(*(rows[:, 3:] - slots[:, :, 0]).T)[1:])
        gaps = rows[:, None, 3:] - rows[None, :, 3:]
        apart.append(np.hypot(gaps[..., 0], gaps[..., 1])[np.triu_indices(5, 1)].min())
        height = max(height, float(np.abs(rows[:, 2] - HEIGHT).max()))
        begun = time.process_time()
        x = plant.step(x, u.ravel(), 1.0)
        simulating += time.process_time() - begun
    off, at = np.array(errors), np.arange(SECONDS)
    turning = (at >= BEGIN) & (at < END + SETTLED)
    calm = (at >= SETTLED) & ~turning
    return Flown(
        straight=float(np.sqrt((off[calm] ** 2).mean())),
        worst=float(off[calm].max()), turning=float(off[turning].max()),
        apart=float(min(apart)), height=height, simulating=simulating,
        planning=planning,
    )  # fmt: skip


def page(flights: dict[str, list[Flown]], command: str, seeds: int) -> list[str]:
    """Return the lines of the page below its title."""
    ours, theirs = flights["planned"], flights["proportional"]
    worst = {name: max(one.turning for one in found) for name, found in flights.items()}
    table = head(
        "law", "straight, rms [m]", "straight, worst [m]", "turn, worst [m]",
        "least distance [m]", "height, worst [m]", "JSBSim [s]", "decisions [s]",
    )  # fmt: skip
    for name, found in flights.items():
        table.append(
            row(
                name, f"{max(one.straight for one in found):.2f}",
                f"{max(one.worst for one in found):.1f}", f"{worst[name]:.1f}",
                f"{min(one.apart for one in found):.1f}",
                f"{max(one.height for one in found):.1f}",
                f"{np.mean([one.simulating for one in found]):.1f}",
                f"{np.mean([one.planning for one in found]):.1f}",
            )
        )  # fmt: skip
    return [
        f"In {seeds} flights of {SECONDS} s with starts up to {OFFSET:g} m off in each "
        f"direction, four followers that plan keep their slots behind the leader to "
        f"{max(one.straight for one in ours):.1f} m rms in straight flight and to "
        f"{worst['planned']:.1f} m in a turn, where a law proportional to the error "
        f"is up to {worst['proportional']:.0f} m off; the least distance of two "
        f"aircraft is {min(one.apart for one in ours):.0f} m.",
        "",
        f"Made by `{command}`. The leader goes {BEGIN} s straight at {SPEED:g} m/s, "
        f"turns by {TURN:g} rad until {END} s, and goes straight until {SECONDS} s. "
        f"Straight flight counts from {SETTLED} s after the start and after the turn. "
        "Each number of a table is the worst of the flights; times are means of CPU "
        "time. Each follower knows what the leader's set points will be for the next "
        f"{HORIZON} s and plans with lags of {TAU_V:g} s (speed) and {TAU_PSI:g} s "
        "(heading); the proportional law knows the present error alone. No plan has a "
        "constraint on the distance to the others; the distances follow from the "
        "slots. The last row is one flight of the planned law in which the weight on "
        f"the heading's set point is {HASTY / EFFORT:.0%} of the usual one.",
        "",
        *table,
        "",
        "## What a first-order autopilot hides",
        "",
        "- The heading turns by a bank angle, which the autopilot builds up at "
        "0.7 rad/s: a turn begins and ends later than a first-order lag says. If "
        "plans steer hard, the aircraft oscillate more and more: with the weight on "
        "the difference of the heading's set point and the heading reduced to "
        f"{HASTY / EFFORT:.0%} the followers lose the formation (last row).",
        "- In a turn the lift has to carry the load factor too: the aircraft lose or "
        "gain height, which no lag of speed and heading has.",
        "- Speed and heading act on each other: the drag of a turn costs speed, which "
        "the throttle makes up for with a delay.",
        "- The proportional law lags by design: in a steady turn its error across the "
        "track is what holds the bank angle. Its rms in straight flight, "
        f"{max(one.straight for one in theirs):.1f} m, includes what is then left of "
        "that error.",
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate, print the page, and write it to a file if that is asked for."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args(arguments)
    flights: dict[str, list[Flown]] = {}
    seeds = range(FIRST_SEED, FIRST_SEED + options.seeds)
    flights["planned"] = [flight(Planned(), seed) for seed in seeds]
    flights["planned by SQP"] = [flight(Planned(solver="qrsqp"), k) for k in seeds]
    flights["proportional"] = [flight(proportional, seed) for seed in seeds]
    flights[f"planned, heading weight {HASTY / EFFORT:.0%}"] = [
        flight(Planned(HASTY), FIRST_SEED)
    ]
    command = command_of("benchmarks/five_f16.py", arguments)
    publish(page(flights, command, options.seeds), options, TEXT)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
