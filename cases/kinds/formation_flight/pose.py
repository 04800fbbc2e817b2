"""A formation scenario -> planning problems, linear laws and plant.

The UAVs plan one after another; a UAV with a given plan flies it instead.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import (
    Flight,
    LinearLaws,
    Posed,
    PosedAgent,
    PosedPlant,
)
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.formation_flight.problem import (
    dynamics_of,
    planning_problem,
    reference_of,
    slot_states,
    terminal_cost_of,
    terminal_set_of,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import POSITION, unicycle
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Model, stack_models
from swarmstart.terminal_set import Reference, TerminalSet, certificate_text


class NoTerminalSetError(SwarmstartError):
    """A formation has no terminal set, since its dual mode is off."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedFormation(Posed):
    """A formation flight as planning problems and plant, with nothing compiled.

    Attributes:
        names: Names of the UAVs.
        slots: Function from times (n,) [s] to the slot states of all UAVs, shape (uavs,
            4, n).
        designed_set: The terminal set, the same for every UAV; None without dual mode.
        reference: Reference of the set, with the bounds.
        dynamics: f(x, u) of one UAV.
    """

    names: tuple[str, ...]
    slots: Callable[[Array], Array]
    designed_set: TerminalSet | None
    reference: Reference
    dynamics: ca.Function

    @property
    def terminal_set(self) -> TerminalSet:
        """The terminal set.

        Raises:
            NoTerminalSetError: If no terminal set exists.
        """
        if self.designed_set is None:
            raise NoTerminalSetError("the dual mode is off: no set is designed")
        return self.designed_set


FormationFlight = Flight[PosedFormation]


def pose(scenario: FormationScenario) -> PosedFormation:
    """Return the planning problem of each UAV, and the plant.

    The scenario must have been checked before.
    """
    model, uavs = unicycle(), range(len(scenario.uavs))
    dynamics, reference = dynamics_of(model), reference_of(scenario)
    terminal_cost = terminal_cost_of(scenario, dynamics, reference)
    enabled = scenario.dual_mode.enabled
    designed_set = terminal_set_of(scenario, reference) if enabled else None
    # Without dual mode there is no set, and a literal set has no proof.
    certificate = None if designed_set is None else designed_set.certificate
    order = scenario.order_of_planning()
    slots = [partial(slot_states, scenario, number) for number in uavs]
    return PosedFormation(
        agents=tuple(
            _agent(scenario, model, terminal_cost, number, order) for number in uavs
        ),
        x0=np.concatenate([uav.start.vector() for uav in scenario.uavs]),
        plant=PosedPlant(
            model=stack_models([model] * len(uavs)), substeps=scenario.plant.substeps
        ),
        order=tuple(order),
        dual_mode=_linear_laws(scenario, designed_set),
        documents={}
        if certificate is None
        else {"certificate.json": certificate_text(certificate)},
        names=tuple(f"UAV {number}" for number in scenario.numbers),
        slots=lambda times: np.stack([slot(times) for slot in slots]),
        designed_set=designed_set,
        reference=reference,
        dynamics=dynamics,
    )


def flaws(scenario: FormationScenario) -> Iterator[LocatedFlaw]:
    """Yield errors between parts of the scenario, and of impossible linear laws."""
    found = list(scenario.flaws())
    yield from found
    if found:
        return
    try:
        # The place of an error, since the library does not know the scenario.
        part = "leader"
        dynamics, reference = dynamics_of(unicycle()), reference_of(scenario)
        part = "weights"
        terminal_cost_of(scenario, dynamics, reference)
        part = "dual_mode"
        if scenario.dual_mode.enabled:
            terminal_set_of(scenario, reference)
    except SwarmstartError as error:
        yield (part,), f"expected a linear law that can be designed: {error}"


def leader_positions(scenario: FormationScenario, times: Array) -> Array:
    """Return the virtual leader's positions, shape (2, n) [m], at times (n,) [s]."""
    leader = scenario.leader
    start = np.array([leader.x_m, leader.y_m])
    return start[:, None] + leader.velocity()[:, None] * times


def _linear_laws(
    scenario: FormationScenario, designed_set: TerminalSet | None
) -> LinearLaws | None:
    dual, uavs = scenario.dual_mode, range(len(scenario.uavs))
    if designed_set is None:
        return None
    return LinearLaws(
        # Alike UAVs, and the reference moves with the slot: one set for all.
        sets=[designed_set] * len(uavs),
        targets=[_target(scenario, number) for number in uavs],
        uncertified=not dual.is_certified,
    )


def _target(scenario: FormationScenario, number: int) -> Callable[[float], Array]:
    return lambda time: slot_states(scenario, number, np.array([time]))[:, 0]


def _agent(
    scenario: FormationScenario,
    model: Model,
    terminal_cost: Array,
    number: int,
    order: list[int],
) -> PosedAgent:
    """Return one UAV; it watches all that plan before it."""
    watches = tuple(order[: order.index(number)])
    given = scenario.uavs[number].plan
    return PosedAgent(
        problem=planning_problem(scenario, model, terminal_cost, others=len(watches)),
        reference=partial(slot_states, scenario, number),
        shift=scenario.last_plan == "shifted",
        given=None if given is None else np.array(given).T,
        watches=watches,
        shows=POSITION,
    )
