"""The planning problems that the benchmarks evaluate and search.

five_uavs   all controls of five UAVs at once: 8 steps, 80 controls, pairwise distances
one_uav     one UAV behind its leader: 8 steps, 16 controls
reactor     Luus' two-reaction stirred tank: 13 intervals, 10 RK4 steps in each
van_der_pol the oscillator, 50 intervals, 4 RK4 steps in each
passing     one UAV whose slot lies behind a disc: past it on one side or the other
four_discs  one UAV that steers through four discs to a point
wingman     one command of a close formation
formation   the planning problems of a formation flight's first step
"""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.close_formation import pose as close_formation
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.formation_flight import pose as formation_flight
from swarmstart.cases.kinds.formation_flight.problem import dynamics_of
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import unicycle
from swarmstart.ocp import (
    Bounds,
    DualMode,
    Model,
    OptimalControlProblem,
    Plan,
    Separation,
    Team,
    disc,
    stack_models,
)
from swarmstart.ocp.rollout.fitness import Known
from swarmstart.terminal_set import hold, linearise, sampled_lqr

UAVS = 5
STEPS = 8
TURN_RATE = np.pi / 18
SLOTS = np.array([(0, 0), (-15, 15), (-30, 30), (-15, -15), (-30, -30)], dtype=float)
DISTANCE = 5.0
SPEED = 15.0


class Instance(NamedTuple):
    """A problem with all that its evaluation needs except the controls.

    Attributes:
        name: Its name in tables.
        problem: The problem.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
    """

    name: str
    problem: OptimalControlProblem
    x0: Array
    known: Known

    @property
    def dim(self) -> int:
        """Number of variables."""
        return self.problem.model.nu * self.problem.intervals

    def population(self, size: int, rng: np.random.Generator) -> Array:
        """Return controls uniform in their bounds, shape (dim, size)."""
        lower, upper = self.problem.control_limits
        shape = (self.problem.intervals, self.problem.model.nu, size)
        drawn = rng.uniform(lower[:, None], upper[:, None], shape)
        return drawn.reshape(self.dim, size)


def five_uavs(substeps: int = 1) -> Instance:
    """Return five UAVs that keep a V behind a leader, planned as one.

    Signals are the leader's x and y. Cost, summed over the steps: speed and heading
    errors, squared distances from the slots, squared controls; at the end ten times the
    squared errors. Violation: the sum over pairs of the shortfall of the least
    distance, in metres (`scale` 1), as in the rivals written by hand.
    """
    starts = [(SPEED, 0.0, 5.0, y) for y in (65, 75, 85, 45, 55)]
    return _followers("five UAVs", starts, substeps)


def one_uav() -> Instance:
    """Return the first UAV of `five_uavs` alone: no distances."""
    return _followers("one UAV", [(SPEED, 0.0, 5.0, 65.0)], 1)


def _followers(
    name: str, starts: Sequence[tuple[float, ...]], substeps: int
) -> Instance:
    """Return UAVs behind a leader, from speed, heading, x and y of each."""
    uavs = len(starts)
    model = stack_models([unicycle()] * uavs)
    leader = ca.SX.sym("leader", 2)
    errors = ca.vertcat(*(_error(model, leader, i) for i in range(uavs)))
    pairs = [(i, j) for i in range(uavs) for j in range(i)]
    problem = OptimalControlProblem(
        model,
        horizon=float(STEPS),
        intervals=STEPS,
        stage_cost=ca.sumsqr(errors) + ca.sumsqr(model.controls),
        terminal_cost=10 * ca.sumsqr(errors),
        bounds=Bounds(controls=(_limits(-1, uavs), _limits(1, uavs))),
        constraints=[
            Separation(
                relative=_position(model, i) - _position(model, j),
                distance=DISTANCE,
                scale=1.0,
            )
            for i, j in pairs
        ],
        signals=leader,
        quadrature="left",
        substeps=substeps,
    )
    name += f", {STEPS} steps" + f", {substeps} substeps" * (substeps > 1)
    return Instance(name, problem, np.ravel(starts), Known(signals=_leader()))


def _limits(sign: float, uavs: int) -> Sequence[float]:
    return [5.0 * sign, TURN_RATE * sign] * uavs


def _position(model: Model, uav: int) -> ca.SX:
    return model.states[4 * uav + 2 : 4 * uav + 4]


def _error(model: Model, leader: ca.SX, uav: int) -> ca.SX:
    speed, heading = model.states[4 * uav], model.states[4 * uav + 1]
    slot = leader + ca.SX(SLOTS[uav])
    return ca.vertcat(speed - SPEED, heading, _position(model, uav) - slot)


def _leader() -> Array:
    """Return the leader's positions at the nodes, shape (2, STEPS + 1) [m]."""
    times = np.arange(STEPS + 1.0)
    return np.stack([30.0 + SPEED * times, np.full_like(times, 60.0)])


def reactor(intervals: int = 13) -> Instance:
    """Return Luus' stirred tank with two reactions (Luus and Galli 1991)."""
    x1, x2, u = ca.SX.sym("x1"), ca.SX.sym("x2"), ca.SX.sym("u")
    r = (x2 + 0.5) * ca.exp(25 * x1 / (x1 + 2))
    model = Model(
        states=ca.vertcat(x1, x2),
        controls=u,
        ode=ca.vertcat(-(2 + u) * (x1 + 0.25) + r, 0.5 - x2 - r),
    )
    problem = OptimalControlProblem(
        model,
        horizon=0.78,
        intervals=intervals,
        stage_cost=x1**2 + x2**2 + 0.1 * u**2,
        bounds=Bounds(controls=(0.0, 5.0)),
        substeps=10,
    )
    return Instance("two-reaction reactor", problem, np.array([0.09, 0.09]), Known())


def van_der_pol() -> Instance:
    """Return the van der Pol oscillator (Balsa-Canto et al. 2002, case 6.1)."""
    x1, x2, u = ca.SX.sym("x1"), ca.SX.sym("x2"), ca.SX.sym("u")
    model = Model(
        states=ca.vertcat(x1, x2),
        controls=u,
        ode=ca.vertcat((1 - x2**2) * x1 - x2 + u, x1),
    )
    problem = OptimalControlProblem(
        model,
        horizon=5.0,
        intervals=50,
        stage_cost=x1**2 + x2**2 + u**2,
        bounds=Bounds(controls=(-0.3, 1.0)),
        substeps=4,
    )
    return Instance("van der Pol", problem, np.array([0.0, 1.0]), Known())


def bicycle() -> Instance:
    """Return a kinematic bicycle on the way to a place beside it.

    States are place, heading and speed, controls the angle of its front wheel and its
    acceleration (Rajamani 2012, Vehicle dynamics and control, section 2.2).
    """
    x, y, heading, speed = (ca.SX.sym(name) for name in ("x", "y", "heading", "speed"))
    steering, acceleration = ca.SX.sym("steering"), ca.SX.sym("acceleration")
    front, rear = 1.4, 1.6
    slip = ca.atan(rear / (front + rear) * ca.tan(steering))
    model = Model(
        states=ca.vertcat(x, y, heading, speed),
        controls=ca.vertcat(steering, acceleration),
        ode=ca.vertcat(
            speed * ca.cos(heading + slip),
            speed * ca.sin(heading + slip),
            speed / rear * ca.sin(slip),
            acceleration,
        ),
    )
    error = model.states - ca.vertcat(20.0, 4.0, 0.0, 8.0)
    problem = OptimalControlProblem(
        model,
        horizon=2.4,
        intervals=12,
        stage_cost=ca.sumsqr(error) + ca.sumsqr(model.controls),
        bounds=Bounds(controls=([-0.6, -4.0], [0.6, 4.0])),
    )
    return Instance("kinematic bicycle", problem, np.array([0, 0, 0, 8.0]), Known())


def passing() -> Instance:
    """Return one UAV and one disc on the way to its slot.

    The slot moves past the disc on the far side of its centre: from zero controls a
    gradient solver passes on the near side, at four times the cost.
    """
    model, slot = unicycle(), ca.SX.sym("slot", 4)
    error = model.states - slot
    A, B = hold(*linearise(dynamics_of(model), [SPEED, 0, 0, 0], [0, 0]), 1.0)
    P = sampled_lqr(A, B, np.eye(4), np.eye(2)).P
    problem = OptimalControlProblem(
        model,
        horizon=float(STEPS),
        intervals=STEPS,
        stage_cost=ca.sumsqr(error) + ca.sumsqr(model.controls),
        terminal_cost=ca.bilin(ca.DM(P), error, error),
        bounds=Bounds(controls=(_limits(-1, 1), _limits(1, 1))),
        constraints=[disc(model.states[2:], centre=[0.0, 1.0], radius=12.0)],
        signals=slot,
        quadrature="left",
        checks=4,
        substeps=1,
    )
    times = problem.times
    rows = [np.full_like(times, SPEED), 0 * times, SPEED * times - 50, 0 * times + 8]
    x0 = np.array([SPEED, 0.0, -60.0, 0.0])
    return Instance("passing side", problem, x0, Known(signals=np.stack(rows)))


def four_discs() -> Instance:
    """Return one UAV that steers through four discs to a point, at unit speed.

    The time is fixed at that of the best known solution, whose cost is then 0.06138.
    """
    x, y, heading, rate = (ca.SX.sym(name) for name in ("x", "y", "heading", "rate"))
    model = Model(
        states=ca.vertcat(x, y, heading),
        controls=rate,
        ode=ca.vertcat(ca.cos(heading), ca.sin(heading), rate),
    )
    discs = [(2.0, 0.3, 0.9), (4.2, -0.6, 1.0), (6.2, 0.5, 1.0), (8.2, -0.3, 0.9)]
    problem = OptimalControlProblem(
        model,
        horizon=10.757209,
        intervals=40,
        stage_cost=0.1 * rate**2,
        bounds=Bounds(controls=(-3.0, 3.0)),
        constraints=[
            disc(model.states[:2], centre=[a, b], radius=radius)
            for a, b, radius in discs
        ],
        terminal=[model.states[:2] - ca.vertcat(10.0, 0.0)],
        substeps=2,
    )
    return Instance("four discs", problem, np.zeros(3), Known())


def wingman(scenario: str) -> Instance:
    """Return the planning problem of a close formation, one second into the turn."""
    loaded = resolve(read_document(scenario)).scenario
    if not isinstance(loaded, CloseFormationScenario):
        raise TypeError(f"{scenario} is no close formation")
    posed = close_formation.pose(loaded)
    loop = flight_of(posed, loaded).loop
    return Instance(scenario, loop.planner.problem, posed.x0, loop.known(6.0))


def formation(scenario: str) -> list[Instance]:
    """Return the planning problems of a flight's first step, in planning order.

    Args:
        scenario: Name of a formation scenario.
    """
    loaded = resolve(read_document(scenario)).scenario
    if not isinstance(loaded, FormationScenario):
        raise TypeError(f"{scenario} is no formation flight")
    flight = flight_of(formation_flight.pose(loaded), loaded)
    instances = list[Instance]()
    controller = flight.controller
    team = controller.team if isinstance(controller, DualMode) else controller
    if not isinstance(team, Team):
        raise TypeError(f"{scenario} has no team")

    def plan(number: int, state: Array, seen: tuple[Array, ...]) -> Plan:
        controller = team.agents[number].controller
        known = controller.known(0.0, seen)
        problem = controller.planner.problem
        name = f"{scenario}, UAV {number + 1}"
        instances.append(Instance(name, problem, state, known))
        rng = np.random.default_rng(0)
        return controller.planner.plan(state, known=known, rng=rng)

    team.plans(flight.x0, plan)
    return instances
