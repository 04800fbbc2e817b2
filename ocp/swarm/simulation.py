"""Simulation of a swarm: vehicles that follow their plans exactly, and the links.

In controller.py the same vehicles run in a closed loop with a `Plant`, which may be
disturbed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from swarmstart.arguments import (
    RNG,
    SEED,
    Check,
    a_count,
    a_number,
    checked,
    choice,
    of_kind,
    optional,
)
from swarmstart.arrays import Array
from swarmstart.heuristics import generator_of
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.swarm.flight import RULES, SwarmFlight
from swarmstart.ocp.swarm.swarm import (
    Links,
    Swarm,
    pairwise_distances,
    require_silences,
)
from swarmstart.ocp.swarm.team import Team, lead_steps

LEAST_STEP_S = 1e-6
"""Least step of the grid [s]."""
MOST_PIECES = 10_000
"""Largest number of pieces of a plan."""
PLANNED: Mapping[str, Check] = MappingProxyType(
    {
        "swarm": of_kind(Swarm, "a Swarm"),
        "links": of_kind(Links, "Links"),
        "rule": choice(RULES),
        "step_s": a_number(least=LEAST_STEP_S),
        "longest_s": a_number(above=0, most=1e5),
        "tries": a_count(least=1),
        "lead_s": optional(a_number(least=0, most=1e5)),
    }
)
"""Checks of the arguments that say how a swarm plans."""


class Planning(NamedTuple):
    """Options of a swarm's planning; see the arguments of `simulate_swarm`."""

    links: Links
    rule: str
    step_s: float
    longest_s: float
    tries: int
    lead_s: float | None


def team_of(swarm: Swarm, planning: Planning, rng: np.random.Generator) -> Team:
    """Return the vehicles at their starts; raise the errors that `sizes_of` raises."""
    return Team(
        swarm, planning.links, planning.rule, step_s=planning.step_s,
        sizes=sizes_of(swarm, planning), rng=rng,
    )  # fmt: skip


def sizes_of(swarm: Swarm, planning: Planning) -> tuple[int, int, int]:
    """Return the pieces of a plan, the steps of its lead, and the tries of a search.

    Raises:
        InvalidProblemError: If the numbers do not fit the swarm, a silent vehicle is
            unknown, or two vehicles are not linked.
    """
    links, _, step_s, longest_s, tries, lead_s = planning
    require_silences(links, swarm.size)
    pieces = _pieces(swarm, longest_s, step_s)
    hops = max(
        most_hops("starts", swarm.starts, links.radio_range),
        most_hops("goals", swarm.goals, links.radio_range),
    )
    lead = lead_steps(swarm.size, links, hops)
    if lead_s is not None:
        lead = max(1, round(lead_s / step_s))
    if lead >= pieces:
        raise InvalidProblemError(
            f"longest_s must be above the lead of {lead * step_s:g} s, which follows "
            f"from delays and losses unless lead_s is given, got {longest_s}"
        )
    return pieces, lead, tries


@checked(
    refused,
    **PLANNED,
    seconds=a_number(above=0, most=1e5),
    rng=optional(RNG),
    seed=optional(SEED),
)
def simulate_swarm(  # noqa: PLR0913 - the swarm, its links, and how it is simulated
    swarm: Swarm,
    *,
    links: Links = Links(),  # noqa: B008 - frozen
    rule: str = "acknowledged",
    seconds: float = 60.0,
    step_s: float = 0.1,
    longest_s: float = 30.0,
    tries: int = 600,
    lead_s: float | None = None,
    rng: np.random.Generator | None = None,
    seed: int | None = None,
) -> SwarmFlight:
    """Simulate a swarm until all have arrived, or the time is over.

    Args:
        swarm: Swarm of vehicles, with starts, goals and bounds.
        links: Links between the vehicles.
        rule: Rule by which vehicles commit to plans: "acknowledged" (safe with any
            delays), "waiting" (safe if each message arrives before the new plan parts
            from the old one) or "hearsay" (not safe).
        seconds: Longest time of the flight [s].
        step_s: Step of the grid of the plans [s].
        longest_s: Longest time of a plan [s].
        tries: Number of candidate flights to the goal that a search tries.
        lead_s: Time from a proposal to its parting from the committed plan [s]; None: a
            round trip to all others over the links.
        rng: Random number generator of delays, losses and searches.
        seed: Seed of a new generator, in place of `rng`.

    Raises:
        InvalidProblemError: If an argument is invalid, a silent vehicle is unknown, or
            links of a finite range do not connect all at the starts or at the goals.

    Example:
        >>> import swarmstart as ss
        >>> swarm = ss.Swarm(
        ...     starts=[[0, 0, 1], [2, 0, 1]], goals=[[2, 0, 1], [0, 0, 1]],
        ...     distance=0.35,
        ... )
        >>> flight = ss.simulate_swarm(
        ...     swarm, links=ss.Links(most_delay=3, loss=0.3), seed=0
        ... )
        >>> flight.is_safe, flight.arrived_share
        (True, 1.0)
    """
    planning = Planning(links, rule, step_s, longest_s, tries, lead_s)
    team = team_of(swarm, planning, generator_of(rng, seed))
    for _ in range(math.ceil(seconds / step_s)):
        team.advance()
        if team.have_arrived():
            break
    return team.flight()


def most_hops(name: str, places: Array, radio_range: float) -> int:
    """Return the largest number of links on the shortest way between two vehicles.

    Args:
        name: Name of the places in a message: "starts" or "goals".
        places: Positions of the vehicles, shape (n, 3) [m].
        radio_range: Largest length of a link [m].

    Raises:
        InvalidProblemError: If no message gets from some vehicle to another.
    """
    if radio_range == math.inf:
        return 1
    from scipy.sparse.csgraph import shortest_path  # Slow to import.

    apart = pairwise_distances(places)
    hops = shortest_path(apart <= radio_range, unweighted=True)
    if np.isfinite(hops).all():
        return max(1, int(hops.max()))
    is_linked = np.isfinite(hops[0])
    gaps = apart[np.ix_(is_linked, ~is_linked)]
    near, far = np.unravel_index(gaps.argmin(), gaps.shape)
    i, j = np.flatnonzero(is_linked)[near], np.flatnonzero(~is_linked)[far]
    raise InvalidProblemError(
        f"radio_range must link all vehicles at the {name}, got {radio_range:g} m: "
        f"vehicles {i} and {j}, the nearest of two groups, are {gaps.min():.4g} m apart"
    )


def _pieces(swarm: Swarm, longest_s: float, step_s: float) -> int:
    """Return the number of pieces of a plan.

    Raises:
        InvalidProblemError: If they are too many, or too few for a vehicle, which is
            named.
    """
    # What moves is known until it stands, so that a rest is clear of it for ever.
    known_s = max((float(one.times[-1]) for one in swarm.obstacles), default=0.0)
    if not max(longest_s, known_s) / step_s <= MOST_PIECES:
        raise InvalidProblemError(
            "longest_s, and the time from which on all obstacles stand, must be at "
            f"most {MOST_PIECES} steps of step_s, got {longest_s:g} s and {known_s:g} s"
        )
    moves = swarm.speed > 0
    ways = np.abs(swarm.goals - swarm.starts)[:, moves]
    least_s = (ways / swarm.speed[moves]).max(axis=1)
    if (least_s > longest_s).any():
        i = int(least_s.argmax())
        raise InvalidProblemError(
            f"longest_s must be at least the {least_s[i]:.4g} s in which vehicle {i} "
            f"reaches its goal at full speed, got {longest_s}"
        )
    return max(round(longest_s / step_s), math.ceil(known_s / step_s))
