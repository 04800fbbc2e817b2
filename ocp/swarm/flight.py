"""Flight of a swarm: paths, arrivals, least distance, and all plans that were made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.presentation import Presenting
from swarmstart.ocp.swarm.certificate import (
    Log,
    certificate_text,
    obstacle_paths,
)
from swarmstart.ocp.swarm.swarm import Swarm

RULES = {"acknowledged": 0, "waiting": 1, "hearsay": 2}
"""Rule -> its number in kernels."""
ACKNOWLEDGED, HEARSAY = RULES["acknowledged"], RULES["hearsay"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SwarmFlight(Presenting):
    """Flight of a swarm.

    Attributes:
        swarm: The swarm.
        rule: Name of the rule.
        step_s: Step of the grid of times [s].
        positions: Positions, shape (n, 3, steps + 1) [m].
        arrival_s: Time from which on each vehicle is at its goal for ever; infinite if
            it does not arrive, shape (n,) [s].
        apart: Lower bound of the scaled distance of any two plans from each time to the
            next, shape (steps,) [m].
        searches: Number of searches for a plan.
        log: All plans, and what became of them.

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> swarm = ss.Swarm(starts=np.zeros((1, 3)), goals=np.eye(1, 3), distance=0.3)
        >>> flight = ss.simulate_swarm(swarm, seed=0)
        >>> flight.arrival_s, flight.path_ratio
        (array([2.3]), array([1.]))
    """

    swarm: Swarm
    rule: str
    step_s: float
    positions: Array
    arrival_s: Array
    apart: Array
    searches: int
    log: Log

    @property
    def commitments(self) -> int:
        """Number of commitments to plans, without those of the start."""
        return int(self.log.committed.sum()) - self.swarm.size

    def plot(self) -> Any:
        """Return a matplotlib Figure: tracks from above, least distance, arrivals.

        Raises:
            ImportError: If matplotlib is not installed.
        """
        return self._presented("plot")

    def certificate(self) -> str:
        """Return the flight's certificate, the text of a file to be checked.

        Raises:
            InvalidProblemError: If the rule is not "acknowledged": flights by the other
                rules have no proof.
        """
        if RULES[self.rule] != ACKNOWLEDGED:
            raise InvalidProblemError(
                f"a certificate needs the rule acknowledged, got {self.rule}"
            )
        obstacles = obstacle_paths(self.swarm, self.step_s)
        return certificate_text(self.log, self.swarm.plan_distance, obstacles)

    @property
    def times(self) -> Array:
        """Times of the positions, shape (steps + 1,) [s]."""
        return np.arange(len(self.apart) + 1, dtype=np.float64) * self.step_s

    @property
    def arrived_share(self) -> float:
        """Share of the vehicles that arrive."""
        return float(np.isfinite(self.arrival_s).mean())

    @property
    def min_distance_m(self) -> float:
        """Least scaled distance of two plans during the flight [m]."""
        return float(self.apart.min(initial=np.inf))

    @property
    def is_safe(self) -> bool:
        """True if no two plans come nearer than they may."""
        return self.min_distance_m >= self.swarm.plan_distance

    @property
    def path_ratio(self) -> Array:
        """Length of each path divided by the straight distance, shape (n,).

        It is 1 for a vehicle whose start is its goal, and infinite for a vehicle that
        does not arrive.
        """
        ways = np.linalg.norm(np.diff(self.positions, axis=2), axis=1).sum(axis=1)
        straight = np.linalg.norm(self.swarm.goals - self.swarm.starts, axis=1)
        ratio = np.where(straight > 0, ways / np.where(straight > 0, straight, 1.0), 1)
        return np.where(np.isfinite(self.arrival_s), ratio, np.inf)
