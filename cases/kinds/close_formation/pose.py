"""A close formation scenario -> planning problem and plant.

    J = sum over the horizon of e'Q e at the ends of its steps                (5.21)

e = (x - x_C, y - y_C, z - z_C, V - V_L, psi - psi_L). The leader's speed, heading and
height are parameters of the model, with their values at the time of planning.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Posed, PosedAgent, PosedPlant
from swarmstart.cases.format.settings import LocatedFlaw, bounds_of
from swarmstart.cases.kinds.close_formation.gusts import dryden
from swarmstart.cases.kinds.close_formation.leader import leader_of
from swarmstart.cases.kinds.close_formation.scenario import (
    CloseFormationScenario,
    PlantPart,
    Prediction,
)
from swarmstart.cases.kinds.models.close_formation import (
    Wingman,
    close_formation,
)
from swarmstart.cases.kinds.models.horseshoe_vortex import Aircraft
from swarmstart.ocp import Bounds, Model, OptimalControlProblem

MOST_SUBSTEPS = 10_000


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedCloseFormation(Posed):
    """A close formation.

    Attributes:
        aircraft: Both aircraft.
        leader: Times (n,) -> speed, heading and height of the leader, shape (3, n).
    """

    aircraft: Aircraft
    leader: Callable[[Array], Array]


CloseFormationFlight = Flight[PosedCloseFormation]


def pose(scenario: CloseFormationScenario) -> PosedCloseFormation:
    """Return the wingman's planning problem, and the plant.

    Args:
        scenario: The scenario, checked.
    """
    aircraft = Aircraft(**scenario.aircraft.model_dump())
    wingman = Wingman(aircraft=aircraft, **scenario.autopilot.model_dump())
    leader, believed = leader_of(scenario.leader), scenario.prediction

    def now(time: float) -> Array:
        return leader(np.array([time]))[:, 0]

    def candidates(time: float) -> Array:
        """Return the leader's state as a command, held over the horizon (Step 1)."""
        own = commanded(scenario, now(time))
        return np.repeat(own[:, None], believed.intervals, axis=1)[:, :, None]

    return PosedCloseFormation(
        agents=(
            PosedAgent(
                problem=planning_problem(scenario, _model(scenario, wingman, believed)),
                parameters=now,
                candidates=candidates if scenario.leader_as_candidate else None,
                append="last",
            ),
        ),
        x0=np.array(scenario.start.vector()),
        plant=_plant(scenario, wingman, leader),
        aircraft=aircraft,
        leader=leader,
    )


def flaws(scenario: CloseFormationScenario) -> Iterator[LocatedFlaw]:
    """Yield errors between parts of the scenario, with their places."""
    yield from scenario.flaws()
    substeps = scenario.prediction.dt / scenario.plant.substep_s
    if substeps > MOST_SUBSTEPS:
        yield (
            ("plant", "substep_s"),
            f"expected at least a control interval / {MOST_SUBSTEPS} = "
            f"{scenario.prediction.dt / MOST_SUBSTEPS:g}, "
            f"found {scenario.plant.substep_s:g}",
        )


def planning_problem(
    scenario: CloseFormationScenario, model: Model
) -> OptimalControlProblem:
    """Return the planning problem (5.21), (5.22) on a model."""
    slot, prediction, commands = scenario.slot, scenario.prediction, scenario.commands
    x, y, psi, V, z, _ = ca.vertsplit(model.states)
    V_L, psi_L, _ = ca.vertsplit(model.parameters)
    errors = ca.vertcat(
        x - slot.x_ft, y - slot.y_ft, z - slot.z_ft, V - V_L, psi - psi_L
    )
    ranges = (commands.speed_ft_s, commands.heading_rad, commands.height_ft)
    return OptimalControlProblem(
        model,
        stage_cost=ca.bilin(ca.diag(scenario.weights), errors, errors) / prediction.dt,
        bounds=Bounds(controls=bounds_of(ranges)),
        quadrature="right",
        **prediction.grid(),
    )


def commanded(scenario: CloseFormationScenario, leader: Array) -> Array:
    """Return the commands that hold the state of the leader (V_L, psi_L, h_L), (3,)."""
    relative = scenario.commands.heading_from == "leader"
    return np.array([leader[0], 0.0 if relative else leader[1], leader[2]])


def _model(
    scenario: CloseFormationScenario,
    wingman: Wingman,
    equations: Prediction | PlantPart,
    *,
    gusts: bool = False,
) -> Model:
    """Return the model of the prediction or of the plant."""
    return close_formation(
        wingman,
        variant=equations.model,
        kinematics=equations.kinematics,
        aerodynamics=equations.aerodynamics,
        heading_from=scenario.commands.heading_from,
        gusts=gusts,
    )


def _plant(
    scenario: CloseFormationScenario,
    wingman: Wingman,
    leader: Callable[[Array], Array],
) -> PosedPlant:
    simulated, dt = scenario.plant, scenario.prediction.dt
    model = _model(scenario, wingman, simulated, gusts=True)
    substeps = max(1, round(dt / simulated.substep_s))
    gusts, step = simulated.gusts, dt / substeps
    blown = dryden(
        scenario.steps * substeps,
        sigma=gusts.sigma_ft_s,
        length=gusts.length_ft,
        speed=scenario.leader.manoeuvre[0].speed_ft_s,
        dt=step,
        rng=np.random.default_rng(gusts.seed),
    )

    def parameters(times: Array) -> Array:
        index = np.minimum(np.rint(times / step).astype(int), blown.shape[1] - 1)
        return np.vstack([leader(times), blown[:, index]])

    return PosedPlant(model=model, substeps=substeps, parameters=parameters)
