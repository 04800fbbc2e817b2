"""A problem scenario -> its agents and its plant."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import (
    CommittedPlans,
    LinearLaws,
    PosedAgent,
    PosedPlant,
)
from swarmstart.cases.kinds.problem.checks.uncertain import (
    planned_parameters,
    with_members,
)
from swarmstart.cases.kinds.problem.simulated import posed_simulator
from swarmstart.cases.kinds.problem.stated.members import (
    Member,
    ProblemPosed,
    held_candidates,
    members_of,
    shared_of,
)
from swarmstart.cases.kinds.problem.stated.model import (
    interval_of,
    model_of,
    planning_problem,
    positions_of,
    previous_controls,
)
from swarmstart.cases.kinds.problem.stated.parts import DualMode, Noise, PlantPart
from swarmstart.cases.kinds.problem.stated.phases import pose_phases
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, Vehicles
from swarmstart.cases.kinds.problem.stated.simulators import steps_within
from swarmstart.cases.kinds.problem.stated.symbols import (
    Signal,
    constants_of,
    decided_parameters,
    known_parameters,
    number,
    over_time,
    rows_at,
    rows_over_time,
    stacked,
)
from swarmstart.ocp import (
    OptimalControlProblem,
    Start,
    terminal_set_of,
    zero_controls,
)
from swarmstart.terminal_set import TerminalSet, Weights, certificate_text


def pose(scenario: ProblemScenario) -> ProblemPosed:
    """Return the agents of a problem and its plant, from a checked scenario.

    Raises:
        SwarmstartError: If a guess cannot be read, or the dual mode has no certified
            terminal set.
    """
    if scenario.phases:
        return pose_phases(scenario)
    shared = shared_of(scenario)
    members, constants = members_of(scenario, shared), constants_of(scenario)
    vehicles = scenario.vehicles
    together = vehicles is None or vehicles.planning == "joint"
    groups = [members] if together else [(member,) for member in members]
    agents = tuple(
        _agent(scenario, constants, group, seen=_seen(vehicles, members, number))
        for number, group in enumerate(groups)
    )
    laws = _linear_laws(scenario, groups, agents)
    sets = laws.sets if laws is not None else ()
    in_order = tuple(range(len(agents)))
    # The plant's own values replace those that plans are made with.
    truly = {**known_parameters(scenario), **scenario.modelled.parameters}
    over = {**truly, **scenario.signals}
    known = {name: over_time(given, constants) for name, given in over.items()}
    return ProblemPosed(
        agents=agents,
        x0=np.concatenate([member.start for member in members]),
        plant=_plant(scenario, members, constants, known),
        # A dual mode switches a team, also a team of one.
        order=None if len(agents) == 1 and laws is None else in_order,
        open_loop=scenario.feedback.law == "open_loop",
        repair=scenario.feedback.repair,
        dual_mode=laws,
        committed=_committed(vehicles, constants),
        period=scenario.feedback.period_s,
        until=scenario.feedback.ends_at_s,
        documents={
            # The first is certificate.json, with or without others.
            f"certificate{number or ''}.json": certificate_text(one.certificate)
            for number, one in enumerate(sets)
            if one.certificate is not None
        },
        files={} if scenario.simulator is None else scenario.simulator.files,
        known=known,
        members=members,
    )


def _agent(
    scenario: ProblemScenario,
    constants: Mapping[str, float],
    group: Sequence[Member],
    *,
    seen: Mapping[int, Member],
) -> PosedAgent:
    """Return members that are planned together as one agent.

    Args:
        scenario: The scenario.
        constants: Constants of the file, as numbers.
        group: The members.
        seen: Number of a member -> the member, of those whose plans they see.
    """
    seen_ones = [*seen.values()]
    problem = with_members(scenario, planning_problem(scenario, group, seen=seen_ones))
    is_committed = scenario.vehicles is not None and scenario.vehicles.is_committed
    parameters = rows_over_time(planned_parameters(scenario), constants)
    feedback = scenario.feedback
    return PosedAgent(
        problem=problem,
        reference=rows_over_time(scenario.signals, constants),
        parameters=None if parameters is None else _at(parameters),
        candidates=held_candidates(scenario, group, problem.intervals, constants),
        append=feedback.append,
        shift=feedback.last_plan == "shifted",
        first=_guessed(scenario, group, problem, constants),
        # Priority planning: it sees the plans of all that plan before it.
        watches=() if is_committed else tuple(seen),
        hears=tuple(seen) if is_committed else (),
        shows=positions_of(scenario),
        previous=previous_controls(scenario, group),
        within=feedback.within_s,
    )


def _seen(
    vehicles: Vehicles | None, members: Sequence[Member], number: int
) -> dict[int, Member]:
    """Return the members whose plans a member sees, by their numbers."""
    if vehicles is None or vehicles.planning == "joint":
        return {}
    return {
        other: member
        for other, member in enumerate(members)
        if other < number or (other > number and vehicles.is_committed)
    }


def _committed(
    vehicles: Vehicles | None, constants: Mapping[str, float]
) -> CommittedPlans | None:
    """Return what vehicles keep that agree on committed plans."""
    if vehicles is None or vehicles.separation is None or not vehicles.is_committed:
        return None
    return CommittedPlans(
        distance=number(vehicles.separation.distance, constants),
        tracking_error=number(vehicles.tracking_error, constants),
        links=vehicles.links.links(),
    )


def _at(rows: Signal) -> Callable[[float], Array]:
    """Return time [s] -> one column, of times (n,) -> columns."""
    return lambda time: rows(np.array([time]))[:, 0]


def _guessed(
    scenario: ProblemScenario,
    group: Sequence[Member],
    problem: OptimalControlProblem,
    constants: Mapping[str, float],
) -> Array | Start | None:
    """Return the start of the first plan: controls (nu, N), states (nx, nodes).

    Linear controls have N + 1 knots.
    """
    guess = scenario.guess
    times = problem.expected_times
    knots = times[:: problem.checks]
    # Each interval has one value at its begin; linear controls need the end, too.
    begins = knots if problem.has_knots else knots[:-1]
    known = [{**constants, **member.constants} for member in group]
    controls = None
    if guess.controls:
        controls = rows_at(guess.controls, scenario.controls, begins, known)
    if not guess.states:
        return controls
    states = rows_at(guess.states, scenario.states, times, known)
    if problem.risk is not None:  # All members have the same guess.
        states = np.tile(states, (problem.risk.members, 1))
    return Start(zero_controls(problem) if controls is None else controls, states)


def _plant(
    scenario: ProblemScenario,
    members: Sequence[Member],
    constants: Mapping[str, float],
    known: Mapping[str, Signal],
) -> PosedPlant:
    """Return the simulated system, with parameters and disturbances of its own."""
    part, interval = scenario.modelled, interval_of(scenario, constants)
    simulator = scenario.simulator
    if simulator is not None:
        part = PlantPart(substeps=steps_within(simulator, interval))
    # In the order of the model's parameters: those of the file, then disturbances.
    rows = [known[name] for name in scenario.parameters if name in known]
    step = interval / part.substeps
    count = scenario.steps * part.substeps
    for place, _ in enumerate(members):
        for index, name in enumerate(scenario.states):
            if name in part.disturbance:
                given = part.disturbance[name]
                if isinstance(given, Noise):
                    # One seed, but other numbers for each vehicle and each state.
                    rng = np.random.default_rng([given.seed, place, index])
                    rows.append(_noise(given, constants, step, count, rng))
                else:
                    rows.append(over_time(given, constants))
    model = model_of(scenario, members, disturbed=True)
    return PosedPlant(
        model=model,
        substeps=part.substeps,
        parameters=stacked(rows),
        signals=rows_over_time(scenario.signals, constants),
        decided={
            name: one.first
            for name, one in decided_parameters(scenario, constants).items()
            if name not in known
        },
        differs=bool(part.parameters or part.disturbance or simulator),
        simulator=posed_simulator(scenario, model, interval),
    )


def _noise(
    given: Noise,
    constants: Mapping[str, float],
    step: float,
    count: int,
    rng: np.random.Generator,
) -> Signal:
    """Return the noise added to a rate over time, held for each plant's step."""
    drawn = number(given.deviation, constants) * rng.standard_normal(count)

    def noise(times: Array) -> Array:
        # Multiples of the step are rounded.
        places = np.clip(np.rint(times / step).astype(int), 0, count - 1)
        return np.asarray(drawn[places])

    return noise


def _linear_laws(
    scenario: ProblemScenario,
    groups: Sequence[Sequence[Member]],
    agents: Sequence[PosedAgent],
) -> LinearLaws | None:
    """Return the laws of a dual mode with their certified sets; None without one."""
    if scenario.dual_mode is None:
        return None
    sets = [
        _terminal_set(scenario.dual_mode, scenario, group, agent)
        for group, agent in zip(groups, agents, strict=True)
    ]
    return LinearLaws(sets=sets, targets=[partial(_target, one) for one in sets])


def _target(one: TerminalSet, time: float) -> Array:
    del time  # It must be at rest.
    return one.x_ref


def _terminal_set(
    part: DualMode,
    scenario: ProblemScenario,
    group: Sequence[Member],
    agent: PosedAgent,
) -> TerminalSet:
    """Return the certified terminal set of members that are planned together."""

    def values(given: Mapping[str, str], names: Iterable[str]) -> list[float]:
        listed = [*names]
        return [number(given.get(n, "0"), m.constants) for m in group for n in listed]

    return terminal_set_of(
        agent.problem,
        at=values(part.at, scenario.states),
        weights=Weights(
            Q=np.diag(values(part.Q, scenario.states)),
            R=np.diag(values(part.R, scenario.controls)),
        ),
        parameters=() if agent.parameters is None else agent.parameters(0.0),
        rng=np.random.default_rng(0),  # The same set in every run.
    )
