"""A close formation scenario -> planning problem and plant.

    J = sum over the horizon of e'Q e at the ends of its steps                (5.21)

with e = (x - x_C, y - y_C, z - z_C, V - V_L, psi - psi_L), the weights Q, the slot
(x_C, y_C, z_C), and the leader's speed V_L and heading psi_L. The number is that of the
equation in the chapter (docs/chapter). The leader's speed, heading and height are
parameters of the model, with their values at the time of planning.

Gusts of the plant are Dryden turbulence as a sequence in time, first-order noise on a
velocity:

    w_k+1 = a w_k + sigma sqrt(1 - a^2) n_k,   a = exp(-V dt / L)

with n_k standard normal and the time step dt: the variance is sigma^2 and the
correlation over a time t is exp(-V t / L), with the scale length L and the airspeed V.
Source: MIL-F-8785C, the longitudinal Dryden spectrum.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Posed, PosedAgent, PosedPlant
from swarmstart.cases.format.parts import bounds_of
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.close_formation.scenario import (
    CloseFormationScenario,
    Leader,
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
"""Largest number of the plant's steps in a control interval."""
TIMING_S = 1e-9
"""Difference below which instants are equal, since n dt is rounded [s]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedCloseFormation(Posed):
    """A close formation as planning problem and plant, with nothing compiled.

    Attributes:
        aircraft: Both aircraft.
        leader: Function from times (n,) [s] to speed, heading and height of the leader,
            shape (3, n).
    """

    aircraft: Aircraft
    leader: Callable[[Array], Array]


CloseFormationFlight = Flight[PosedCloseFormation]


def pose(scenario: CloseFormationScenario) -> PosedCloseFormation:
    """Return the wingman's planning problem, and the plant.

    The scenario must have been checked before.
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
                # Commands are absolute: an appended zero would command a stop.
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
    """Return the planning problem, the chapter's (5.21) and (5.22), on a model."""
    slot, prediction, commands = scenario.slot, scenario.prediction, scenario.commands
    x, y, psi, V, z, _ = ca.vertsplit(model.states)
    V_L, psi_L, _ = ca.vertsplit(model.parameters)
    errors = ca.vertcat(
        x - slot.x_ft, y - slot.y_ft, z - slot.z_ft, V - V_L, psi - psi_L
    )
    ranges = (commands.speed_ft_s, commands.heading_rad, commands.height_ft)
    return OptimalControlProblem(
        model,
        # The quadrature multiplies by dt; (5.21) is a plain sum.
        stage_cost=ca.bilin(ca.diag(scenario.weights), errors, errors) / prediction.dt,
        bounds=Bounds(controls=bounds_of(ranges)),
        quadrature="right",  # e at the ends of the steps, as in (5.21).
        **prediction.grid(),
    )


def commanded(scenario: CloseFormationScenario, leader: Array) -> Array:
    """Return the commands that hold the state of the leader (V_L, psi_L, h_L), (3,)."""
    # A command that counts from the leader's heading holds it at zero.
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
    # A whole number of steps, so that one ends at every control instant.
    substeps = max(1, round(dt / simulated.substep_s))
    gusts, step = simulated.gusts, dt / substeps
    blown = dryden(
        scenario.steps * substeps,
        sigma=gusts.sigma_ft_s,
        length=gusts.length_ft,
        # One speed for the whole flight, so that the gusts stay stationary.
        speed=scenario.leader.manoeuvre[0].speed_ft_s,
        dt=step,
        rng=np.random.default_rng(gusts.seed),  # The same gusts in every run.
    )

    def parameters(times: Array) -> Array:
        # Rounded, since n dt is; the end of the flight has no gust of its own.
        index = np.minimum(np.rint(times / step).astype(int), blown.shape[1] - 1)
        return np.vstack([leader(times), blown[:, index]])

    return PosedPlant(model=model, substeps=substeps, parameters=parameters)


def leader_of(leader: Leader) -> Callable[[Array], Array]:
    """Return the leader's speed, heading and height: times (n,) [s] -> shape (3, n).

    If `leader.between` is `hold`, a row of the manoeuvre is valid until the time of the
    next row. If it is `linear`, values change evenly from row to row, and stay as they
    are after the last row. Headings are not wrapped.
    """
    times = np.array([row.time_s for row in leader.manoeuvre])
    rows = np.array(
        [[r.speed_ft_s, r.heading_rad, r.height_ft] for r in leader.manoeuvre]
    ).T
    if leader.between == "hold":

        def held(at: Array) -> Array:
            index = np.searchsorted(times, np.asarray(at) + TIMING_S, side="right") - 1
            return np.asarray(rows[:, index])

        return held
    return lambda at: np.stack([np.interp(at, times, row) for row in rows])


def first_manoeuvre_s(leader: Leader) -> float:
    """Return the beginning of the leader's first change [s]; 0 if it never changes."""
    return min((begin for begin, _ in _changes(leader)), default=0.0)


def last_change_s(leader: Leader) -> float:
    """Return the end of the leader's last change [s]; 0 if it never changes."""
    return max((end for _, end in _changes(leader)), default=0.0)


def _changes(leader: Leader) -> Iterator[tuple[float, float]]:
    """Yield begin and end [s] of each change, equal if rows are held."""
    for before, row in itertools.pairwise(leader.manoeuvre):
        changed = (row.speed_ft_s, row.heading_rad, row.height_ft)
        if changed != (before.speed_ft_s, before.heading_rad, before.height_ft):
            # A held row jumps at its own time; linear change begins at the row before.
            begin = before.time_s if leader.between == "linear" else row.time_s
            yield begin, row.time_s


def dryden(
    count: int,
    *,
    sigma: float,
    length: float,
    speed: float,
    dt: float,
    rng: np.random.Generator,
) -> Array:
    """Return gusts in three directions, shape (3, count), stationary from the start.

    Args:
        count: Number of instants.
        sigma: Standard deviation of each component [ft/s].
        length: Scale length L [ft].
        speed: Airspeed V [ft/s].
        dt: Time between two instants [s].
        rng: Source of randomness.
    """
    a = np.exp(-speed * dt / length)
    noise = rng.standard_normal((3, count))
    gusts = np.empty((3, count))
    gusts[:, 0] = noise[:, 0]  # Of full variance: stationary from the start.
    spread = np.sqrt(1.0 - a * a)
    for k in range(1, count):
        gusts[:, k] = a * gusts[:, k - 1] + spread * noise[:, k]
    return np.asarray(sigma * gusts)
