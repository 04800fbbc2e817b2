"""A swarm scenario -> its controller, and point masses as the plant."""

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Posed, PosedPlant
from swarmstart.cases.kinds.swarm.scenario import SwarmScenario
from swarmstart.ocp import SwarmController, swarm_model


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedSwarm(Posed):
    """A swarm in closed loop: one `controller` for all vehicles, and no `agents`."""

    controller: SwarmController

    @property
    def vehicles(self) -> int:
        """Number of vehicles."""
        return self.controller.swarm.size


SwarmRun = Flight[PosedSwarm]


def pose(scenario: SwarmScenario) -> PosedSwarm:
    """Return the controller and the plant of a checked scenario."""
    controller = scenario.controller()
    plant, n = scenario.plant, controller.swarm.size

    def disturbance(times: Array) -> Array:
        """Return the disturbances from each of some times on, shape (3 n, times)."""
        grid = controller.dt / plant.substeps
        columns = [
            np.random.default_rng([plant.seed, int(number)]).uniform(-1.0, 1.0, 3 * n)
            for number in np.rint(times / grid)
        ]
        return plant.disturbance_m_s2 * np.stack(columns, axis=1)

    return PosedSwarm(
        agents=(),
        x0=controller.x0,
        plant=PosedPlant(
            model=swarm_model(n), substeps=plant.substeps, parameters=disturbance
        ),
        controller=controller,
        ended="each vehicle followed its committed plans",
    )
