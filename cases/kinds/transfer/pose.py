"""A transfer scenario -> one optimal-control problem, its search, and a plant.

minimise    the integral of R_1 a_i^2 + R_2 phi_i^2, summed over the UAVs
subject to  (5.30) with the acceleration as a control, bounds on a, phi and v,
the safe distance of every two UAVs at every check,
each UAV in its goal at the end, with any speed and heading
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.format.kind import Flight, Posed, PosedAgent, PosedPlant
from swarmstart.cases.format.settings import LocatedFlaw, bounds_of
from swarmstart.cases.kinds.assignment import shortest_assignment
from swarmstart.cases.kinds.models.bank_to_turn import bank_to_turn
from swarmstart.cases.kinds.planar import METRE, POSITION, speed_bounds
from swarmstart.cases.kinds.transfer.paths import flat_paths
from swarmstart.cases.kinds.transfer.scenario import TransferScenario, goal_flaws
from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    Separation,
    TerminalConstraint,
    stack_models,
)

Array = NDArray[np.float64]
NX, NU = 4, 2  # Of one UAV.
TOLERANCE_M = 1e-4
"""Summed violation that counts as none: what IPOPT leaves, rolled out."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedTransfer(Posed):
    """A transfer with the goal of each UAV, shape (uavs, 2) [m]."""

    goals: Array


TransferFlight = Flight[PosedTransfer]


def pose(scenario: TransferScenario) -> PosedTransfer:
    """Return the one planning problem, with the paths searched, and the plant.

    Args:
        scenario: The scenario, checked.
    """
    goals = assigned_goals(scenario)
    uav = bank_to_turn(turn=scenario.vehicle.turn)
    model = stack_models([uav] * len(scenario.uavs))
    problem = transfer_problem(scenario, model, goals)
    family = flat_paths(
        problem,
        goals,
        turn=scenario.vehicle.turn,
        lateral=scenario.paths.lateral,
        along=scenario.paths.along,
    )
    return PosedTransfer(
        agents=(PosedAgent(problem=problem, family=family),),
        x0=np.concatenate([uav.start.vector() for uav in scenario.uavs]),
        plant=PosedPlant(model=model, substeps=scenario.plant.substeps),
        open_loop=True,
        repair=scenario.repair,
        goals=goals,
    )


def flaws(scenario: TransferScenario) -> Iterator[LocatedFlaw]:
    """Yield what is wrong across the scenario's parts, with the place."""
    yield from scenario.flaws()
    for number, (x, y) in enumerate(assigned_goals(scenario)):
        yield from goal_flaws(scenario, number, (float(x), float(y)))


def assigned_goals(scenario: TransferScenario) -> Array:
    """Return the goal of each UAV, shape (uavs, 2) [m]."""
    goals = np.array([[uav.goal.x_m, uav.goal.y_m] for uav in scenario.uavs])
    if scenario.assignment == "given":
        return goals
    starts = np.array([[uav.start.x_m, uav.start.y_m] for uav in scenario.uavs])
    return goals[shortest_assignment(starts, goals)]


def transfer_problem(
    scenario: TransferScenario, model: Model, goals: Array
) -> OptimalControlProblem:
    """Return the problem of all UAVs at once.

    Args:
        scenario: The scenario.
        model: All UAVs, states and controls UAV after UAV.
        goals: Of each UAV, shape (uavs, 2) [m].
    """
    vehicle, uavs = scenario.vehicle, len(goals)
    positions = [state[list(POSITION)] for state in ca.vertsplit(model.states, NX)]
    R = ca.diag(ca.DM(np.tile(scenario.weights, uavs)))
    lower, upper = bounds_of((vehicle.acceleration_m_s2, vehicle.bank_rad))
    return OptimalControlProblem(
        model,
        stage_cost=ca.bilin(R, model.controls, model.controls),
        bounds=Bounds(
            controls=(np.tile(lower, uavs), np.tile(upper, uavs)),
            states=speed_bounds(vehicle.speed_m_s, uavs=uavs),
            state_scale=METRE,
        ),
        constraints=[
            Separation(
                relative=a - b,
                distance=scenario.safe_distance_m,
                margin=scenario.margin_m,
                smooth_margin=scenario.margin_m,
                along=scenario.along,
                scale=METRE,
                name=f"distance of UAV {i} and UAV {j}",
            )
            for (i, a), (j, b) in itertools.combinations(enumerate(positions, 1), 2)
        ],
        terminal=[
            TerminalConstraint(
                expression=position - ca.DM(goal),
                scale=METRE,
                name=f"goal of UAV {number}",
            )
            for number, (position, goal) in enumerate(
                zip(positions, goals, strict=True), start=1
            )
        ],
        **scenario.prediction.grid(),
        tolerance=TOLERANCE_M,
        path_tolerance=scenario.path_tolerance_m,
    )
