"""Controller of all vehicles of a swarm, for closed loops with a plant.

Vehicles follow their committed plans: each holds the acceleration of its plan in every
step, and corrects the error that a disturbance has made (tracking.py). The bounds of
the errors are added to the distances of plans, and taken off the bounds of acceleration
and speed, so that the disturbed vehicles keep the distance and the bounds, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from swarmstart.arguments import (
    a_count,
    a_number,
    checked,
    of_kind,
    reals,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.loop.controller import OF_DECISION, Decision
from swarmstart.ocp.swarm.flight import SwarmFlight
from swarmstart.ocp.swarm.simulation import PLANNED, Planning, sizes_of, team_of
from swarmstart.ocp.swarm.swarm import AXES, Links, Swarm
from swarmstart.ocp.swarm.team import Team
from swarmstart.ocp.swarm.tracking import Tracking, tracking_of
from swarmstart.ocp.system.model import Model

AXES_NAMES = ("x", "y", "z")


@checked(refused, n=a_count(least=1))
def swarm_model(n: int) -> Model:
    """Return n point masses with a disturbance, vehicle after vehicle.

    Each vehicle has the states x_m, y_m, z_m, vx_m_s, vy_m_s and vz_m_s. Its controls
    are the accelerations ax_m_s2, ay_m_s2 and az_m_s2. Its parameters are the
    disturbances wx_m_s2, wy_m_s2 and wz_m_s2, which are added to the accelerations.
    Every name ends in the number of the vehicle, from 0 on: x_m_0.

    Args:
        n: Number of vehicles.

    Example:
        >>> import swarmstart as ss
        >>> ss.swarm_model(2).nx
        12
    """
    states, controls, pushes, rates = (list[ca.SX]() for _ in range(4))
    units = {"": "m", "v": "m_s", "a": "m_s2", "w": "m_s2"}
    for number in range(n):
        place, speed, push, gust = (
            ca.vertcat(
                *[ca.SX.sym(f"{of}{axis}_{unit}_{number}") for axis in AXES_NAMES]
            )
            for of, unit in units.items()
        )
        states += [place, speed]
        controls.append(push)
        pushes.append(gust)
        rates += [speed, push + gust]
    return Model(
        states=ca.vertcat(*states), controls=ca.vertcat(*controls),
        ode=ca.vertcat(*rates), parameters=ca.vertcat(*pushes),
    )  # fmt: skip


@checked(refused, team=of_kind(Team, "a team of a SwarmController"), step=a_count())
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SwarmDecision(Decision):
    """Decision for all vehicles, with their memories.

    Attributes:
        team: The vehicles; the next decision changes them.
        step: Number of steps decided so far, this one included.
    """

    team: Team
    step: int

    @property
    def flight(self) -> SwarmFlight:
        """The flight so far."""
        return self.team.flight()


@checked(refused, **PLANNED, disturbance=a_number(least=0))
class SwarmController:
    """Controller of a swarm of point masses.

    Its plant is `swarm_model`, or any other with these states and controls. A decision
    has no plans of optimal-control problems; `decision.flight` has the committed ones.
    The loop ends when all vehicles have arrived.

    Attributes:
        swarm: The swarm that is planned for: with the tracking error, and with smaller
            bounds of acceleration and speed.
        tracking: The law that follows a plan, with the bounds of its errors.
        dt: Step of the grid of the plans [s].

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> swarm = ss.Swarm(
        ...     starts=[[0, 0, 1], [2, 0, 1]], goals=[[2, 0, 1], [0, 0, 1]],
        ...     distance=0.35,
        ... )
        >>> loop = ss.SwarmController(swarm, links=ss.Links(loss=0.3), disturbance=0.05)
        >>> gusts = lambda t: 0.05 * np.sin(np.arange(6)[:, None] + t)
        >>> plant = ss.Plant(
        ...     ss.swarm_model(2), dt=loop.dt, substeps=4, parameters=gusts
        ... )
        >>> run = ss.simulate(plant, loop, loop.x0, steps=200, seed=0)
        >>> run.decisions[-1].flight.arrived_share
        1.0
    """

    def __init__(  # noqa: PLR0913 - the swarm, its links, and how it plans
        self,
        swarm: Swarm,
        *,
        links: Links = Links(),  # noqa: B008 - frozen
        rule: str = "acknowledged",
        step_s: float = 0.1,
        longest_s: float = 30.0,
        tries: int = 600,
        lead_s: float | None = None,
        disturbance: float = 0.0,
    ) -> None:
        """Leave room in distances and bounds for the corrections.

        Args:
            swarm: The swarm, with the bounds of the real vehicles.
            links: Links between the vehicles.
            rule: As in `simulate_swarm`, as are the next four arguments.
            step_s: Step of the grid of the plans [s].
            longest_s: Longest time of a plan [s].
            tries: Number of candidate flights to the goal that a search tries.
            lead_s: Time from a proposal to its parting from the committed plan [s].
            disturbance: Largest size of the disturbance along an axis [m/s^2].

        Raises:
            InvalidProblemError: If an argument is invalid, no acceleration or speed is
                left for plans, or starts or goals are too near for the error.
        """
        self.dt = float(step_s)
        self.tracking = tracking_of(float(disturbance), self.dt)
        self.swarm = _reserved(swarm, self.tracking, disturbance)
        self._planning = Planning(links, rule, step_s, longest_s, tries, lead_s)
        sizes_of(self.swarm, self._planning)  # Raises now, not at the first step.

    @property
    def x0(self) -> Array:
        """Initial state of the plant, all at rest, shape (6 n,)."""
        starts = self.swarm.starts
        return np.hstack([starts, np.zeros_like(starts)]).ravel()

    @checked(refused, state=reals(), **OF_DECISION)
    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> SwarmDecision:
        """Return the accelerations of all vehicles for the coming step.

        Args:
            time: Time since the start [s]; not used, since the number of decisions
                gives the time.
            state: Measured state, shape (6 n,).
            previous: The decision one step ago; None at the start.
            rng: Source of all randomness, the same in all steps.

        Raises:
            InvalidProblemError: If the state has another shape or is not finite, or the
                previous decision is not the last one of its vehicles, or is not of a
                SwarmController.
        """
        del time
        if previous is None:
            team = team_of(self.swarm, self._planning, rng)
        elif not isinstance(previous, SwarmDecision):
            raise InvalidProblemError(
                f"previous must be a SwarmDecision, got a {type(previous).__name__}"
            )
        elif previous.step != previous.team.steps:
            raise InvalidProblemError(
                f"previous must be the last decision, of step {previous.team.steps}, "
                f"got that of step {previous.step}"
            )
        else:
            team = previous.team
        if np.shape(state) != self.x0.shape or not np.isfinite(state).all():
            raise InvalidProblemError(
                f"state must be {self.x0.size} finite numbers, got {np.asarray(state)}"
            )
        # Position and velocity of each vehicle, off those of its plan.
        error = (np.asarray(state) - team.states().ravel()).reshape(-1, 2, AXES)
        correction = np.einsum("k,nka->na", self.tracking.gain, error)
        pushes = team.advance() - correction
        return SwarmDecision(
            control=pushes.ravel(), plans=(), team=team, step=team.steps,
            is_last=team.have_arrived(),
        )  # fmt: skip


def _reserved(swarm: Swarm, tracking: Tracking, disturbance: float) -> Swarm:
    """Return a swarm that leaves room for the errors and corrections.

    Raises:
        InvalidProblemError: If no acceleration or speed is left.
    """
    if disturbance == 0.0:
        return swarm
    if swarm.turn_rate < np.inf:
        raise InvalidProblemError(
            f"disturbance must be 0 with a turn rate, got {disturbance:g}"
        )
    moves = swarm.speed > 0
    left = {
        "acceleration": swarm.acceleration - tracking.correction,
        "speed": np.where(moves, swarm.speed - tracking.velocity, 0.0),
    }
    for name, array in left.items():
        used = moves if name == "speed" else np.ones(AXES, dtype=bool)
        if not (array[used] > 0).all():
            raise InvalidProblemError(
                f"{name} must be above the {(getattr(swarm, name) - array).max():.4g} "
                f"that a disturbance of {disturbance:g} m/s^2 takes, got "
                f"{getattr(swarm, name)}"
            )
    error = swarm.tracking_error + tracking.distance(swarm.scale)
    return replace(
        swarm, tracking_error=error, acceleration=left["acceleration"],
        speed=left["speed"],
    )  # fmt: skip
