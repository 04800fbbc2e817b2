"""A formation scenario -> planning problems, team, dual mode and plant.

UAV i: e_i = x_i - x_L - slot_i, (v, psi, x, y), slots in axes that do not turn (5.4);

    J = sum_k dt (e_k'Q e_k + u_k'R u_k) + e_N'P e_N                      (5.5)-(5.7)

plus the distances to obstacles and to the UAVs that planned before it (5.15), (5.16).
The sum over the steps is what the sampled-data P belongs to.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.formation.scenario import FormationScenario
from swarmstart.cases.kind import Flight
from swarmstart.cases.models.unicycle import unicycle
from swarmstart.cases.planar import POSITION
from swarmstart.cases.settings import Problem
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import (
    Agent,
    Bounds,
    Controller,
    DualMode,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    Separation,
    Team,
    disc,
    right_hand_side,
    stack_models,
)
from swarmstart.terminal_set import (
    Reference,
    TerminalSet,
    hold,
    linearise,
    literal_terminal_set,
    sampled_lqr,
    sampled_terminal_set,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FormationFlight(Flight):
    """A formation flight ready to be flown.

    Attributes:
        slots: (times (n,)) -> slot states of all UAVs, shape (uavs, 4, n).
        terminal_set: The terminal set, the same for every UAV.
        reference: What it is built around, with the bounds.
        dynamics: f(x, u) of one UAV.
    """

    slots: Callable[[Array], Array]
    terminal_set: TerminalSet
    reference: Reference
    dynamics: ca.Function


def build(scenario: FormationScenario) -> FormationFlight:
    """Compile everything a flight needs.

    Args:
        scenario: The scenario, checked.
    """
    model = unicycle()
    dynamics, reference = _dynamics(model), _reference(scenario)
    terminal_cost = _terminal_cost(scenario, dynamics, reference)
    terminal_set = _terminal_set(scenario, dynamics, reference)
    order = scenario.order_of_planning()
    agents = [
        _agent(scenario, model, terminal_cost, number, order)
        for number in range(len(scenario.uavs))
    ]
    team = Team(agents, order=order)
    controller: Controller = team
    if scenario.dual_mode.enabled:
        targets = [_target(scenario, number) for number in range(len(agents))]
        controller = DualMode(team, sets=[terminal_set] * len(agents), targets=targets)
    plant = Plant(
        stack_models([model] * len(agents)),
        dt=scenario.prediction.dt_s,
        substeps=scenario.plant.substeps,
    )
    return FormationFlight(
        plant=plant,
        controller=controller,
        x0=np.concatenate([uav.start.vector() for uav in scenario.uavs]),
        agents=len(agents),
        slots=lambda times: np.stack(
            [slot_states(scenario, number, times) for number in range(len(agents))]
        ),
        terminal_set=terminal_set,
        reference=reference,
        dynamics=dynamics,
    )


def problems(scenario: FormationScenario) -> Iterator[Problem]:
    """Yield what is wrong across the scenario's parts, impossible designs included."""
    found = list(scenario.problems())
    yield from found
    if found:
        return
    try:
        part = "leader"
        dynamics, reference = _dynamics(unicycle()), _reference(scenario)
        part = "weights"
        _terminal_cost(scenario, dynamics, reference)
        part = "dual_mode"
        _terminal_set(scenario, dynamics, reference)
    except SwarmstartError as error:
        yield (part,), f"expected a linear law that can be designed: {error}"


def slot_states(scenario: FormationScenario, number: int, times: Array) -> Array:
    """Return the slot of a UAV, moving with the leader, shape (4, n).

    Args:
        scenario: The scenario; its leader keeps speed and heading.
        number: The UAV's index from 0.
        times: Times since the start, shape (n,) [s].
    """
    leader, slot = scenario.leader, scenario.uavs[number].slot
    speed, heading = leader.speed_m_s, leader.heading_rad
    return np.stack(
        [
            np.full_like(times, speed),
            np.full_like(times, heading),
            leader.x_m + slot.x_m + speed * np.cos(heading) * times,
            leader.y_m + slot.y_m + speed * np.sin(heading) * times,
        ]
    )


def leader_positions(scenario: FormationScenario, times: Array) -> Array:
    """Return the virtual leader's positions, shape (2, n) [m], at times (n,) [s]."""
    leader = scenario.leader
    direction = np.array([np.cos(leader.heading_rad), np.sin(leader.heading_rad)])
    start = np.array([leader.x_m, leader.y_m])
    return start[:, None] + leader.speed_m_s * direction[:, None] * times


def _target(scenario: FormationScenario, number: int) -> Callable[[float], Array]:
    return lambda time: slot_states(scenario, number, np.array([time]))[:, 0]


def _dynamics(model: Model) -> ca.Function:
    """Return f(x, u) without parameters, as terminal_set takes it."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    return ca.Function("dynamics", [x, u], [right_hand_side(model)(x, u, ca.SX(0, 1))])


def _reference(scenario: FormationScenario) -> Reference:
    """Return the leader's motion as what a terminal set is built around."""
    lower, upper = _control_limits(scenario)
    return Reference(
        x_ref=np.array(scenario.leader.vector()),
        u_ref=np.zeros(len(lower)),
        u_lower=lower,
        u_upper=upper,
        **_speed_limits(scenario),
    )


def _terminal_cost(
    scenario: FormationScenario, dynamics: ca.Function, reference: Reference
) -> Array:
    """Return P of the terminal cost, shape (4, 4)."""
    if scenario.terminal_cost.design == "given":
        return np.array(scenario.terminal_cost.P)
    dt, weights = scenario.prediction.dt_s, scenario.weights
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    Q, R = np.diag(weights.Q) * dt, np.diag(weights.R) * dt
    return sampled_lqr(*hold(A, B, dt), Q, R).P


def _terminal_set(
    scenario: FormationScenario, dynamics: ca.Function, reference: Reference
) -> TerminalSet:
    """Return the terminal set of the dual mode."""
    dual = scenario.dual_mode
    Q, R = np.diag(dual.Q), np.diag(dual.R)
    if dual.design == "literal":
        P = np.array(dual.P)
        return literal_terminal_set(dynamics, reference, Q=Q, R=R, P=P)
    dt = scenario.prediction.dt_s
    return sampled_terminal_set(dynamics, reference, dt=dt, Q=Q, R=R)


def _control_limits(scenario: FormationScenario) -> tuple[Array, Array]:
    ranges = (scenario.vehicle.acceleration_m_s2, scenario.vehicle.turn_rate_rad_s)
    return (
        np.array([limits.lower for limits in ranges]),
        np.array([limits.upper for limits in ranges]),
    )


def _speed_limits(scenario: FormationScenario) -> dict[str, Array]:
    """Return bounds of the states as keywords; none where the speed is free."""
    limits = scenario.vehicle.speed_m_s
    if limits is None:
        return {}
    free = np.full(3, np.inf)
    return {
        "x_lower": np.array([limits.lower, *-free]),
        "x_upper": np.array([limits.upper, *free]),
    }


def _agent(
    scenario: FormationScenario,
    model: Model,
    terminal_cost: Array,
    number: int,
    order: list[int],
) -> Agent:
    """Return one UAV with its planner; it watches all that plan before it."""
    watches = tuple(order[: order.index(number)])
    problem = _problem(scenario, model, terminal_cost, others=len(watches))
    polish = scenario.ipopt.options() if scenario.polish == "ipopt" else None
    return Agent(
        controller=RecedingHorizon(
            planner=Planner(
                problem,
                search=scenario.search_settings(),
                polish=polish,
                backend=scenario.backend,
            ),
            reference=lambda times: slot_states(scenario, number, times),
        ),
        watches=watches,
        shows=POSITION,
    )


def _problem(
    scenario: FormationScenario, model: Model, terminal_cost: Array, *, others: int
) -> OptimalControlProblem:
    """Return a UAV's planning problem: signals are its slot, then others' positions."""
    signals = ca.vertcat(ca.SX.sym("slot", 4), ca.SX.sym("others", 2 * others))
    error = model.states - signals[:4]
    position = model.states[list(POSITION)]
    avoid = scenario.avoidance
    separations = [
        Separation(
            relative=position - signals[4 + 2 * j : 6 + 2 * j],
            distance=avoid.safe_distance_m,
            margin=avoid.distance_margin_m,
            smooth_margin=avoid.polish_distance_margin_m,
            along=avoid.along,
            measure=avoid.measure,
        )
        for j in range(others)
    ]
    obstacles = [
        disc(
            position,
            centre=[obstacle.x_m, obstacle.y_m],
            radius=obstacle.radius_m,
            margin=avoid.obstacle_margin_m,
            smooth_margin=avoid.polish_obstacle_margin_m,
            along=avoid.along,
            measure=avoid.measure,
        )
        for obstacle in scenario.obstacles
    ]
    Q, R = ca.diag(scenario.weights.Q), ca.diag(scenario.weights.R)
    limits, prediction = _speed_limits(scenario), scenario.prediction
    return OptimalControlProblem(
        model,
        horizon=prediction.dt_s * prediction.intervals,
        intervals=prediction.intervals,
        stage_cost=ca.bilin(Q, error, error)
        + ca.bilin(R, model.controls, model.controls),
        terminal_cost=ca.bilin(ca.DM(terminal_cost), error, error),
        bounds=Bounds(
            controls=_control_limits(scenario),
            states=(limits["x_lower"], limits["x_upper"]) if limits else None,
        ),
        constraints=[*obstacles, *separations],
        signals=signals,
        quadrature="left",
        integrator=prediction.integrator,
        substeps=prediction.substeps,
        checks=prediction.checks,
    )
