"""Kinds of scenario: the functions with which the commands run one."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.document import meant, printable
from swarmstart.cases.format.ramps import Ramp, ramps_of
from swarmstart.cases.format.settings import LocatedFlaw, Scenario
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import (
    Controller,
    Known,
    Links,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Plant,
    RecedingHorizon,
    Solution,
    Start,
    Steps,
    Trajectory,
    TrajectoryFamily,
    verified,
)
from swarmstart.ocp.answer import start_of
from swarmstart.ocp.instances import varied_names
from swarmstart.ocp.loop import ReferenceSignals, known_at, of_given_length
from swarmstart.ocp.rollout import from_near_start, shooting_of
from swarmstart.ocp.statement import Appended
from swarmstart.terminal_set import TerminalSet

Measure = float | int | list[float | None] | None
FLIGHT_CERTIFICATE = "flight.certificate.json"
"""Name of the certificate of committed plans in the folder of a record."""
NEVER = "never"
"""Reason of an undefined time: its event never comes, so it exceeds every bound."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedAgent:
    """An agent that plans, or that follows a given plan.

    Attributes:
        problem: Its planning problem.
        family: Family of trajectories that a search looks in; None means control
            sequences.
        reference: Absolute times (n,) [s] -> the first signals of the problem, shape
            (nr, n); None if there are no such signals. The signals after these are the
            plans of the agents in `watches`.
        parameters: Time [s] -> parameters (np,) of the plan made then; None if it has
            none.
        candidates: Time [s] -> controls (nu, N, k) that a search tries besides the last
            plan; None means none.
        append: Way in which a last plan that is shifted is continued at its end.
        shift: Whether planning starts from the last plan shifted by one interval; else
            it starts from the last plan unchanged, which is one interval late.
        first: Controls (nu, N), or a Start with states, from which the first plan
            starts; None if they are not known.
        given: Controls (nu, N) that are applied unchanged, neither searched nor
            polished; None means that the agent plans.
        watches: Numbers of the agents whose plans it uses; each of them plans before
            it.
        hears: Numbers of the agents whose committed plans and candidates are among its
            signals; see `CommittedTeam`. After these there is one more signal: a
            distance to keep in addition to the least distance.
        shows: Indices of the states that other agents use, which are its position.
        previous: Control of the interval before the first, shape (nu,); None means the
            allowed control that is nearest to zero.
        within: Largest wall time for one plan in closed loop [s]; None means no limit.
    """

    problem: OptimalControlProblem
    family: TrajectoryFamily | None = None
    reference: ReferenceSignals | None = None
    parameters: Callable[[float], Array] | None = None
    candidates: Callable[[float], Array] | None = None
    append: Appended = "zero"
    shift: bool = True
    first: Array | Start | None = None
    given: Array | None = None
    watches: tuple[int, ...] = ()
    hears: tuple[int, ...] = ()
    shows: tuple[int, ...] = ()
    previous: Array | None = None
    within: float | None = None

    def known(
        self, time: float, seen: tuple[Array, ...] = (), length: float | None = None
    ) -> Known:
        """Return parameters and signals of the plan made at a time.

        Args:
            time: Time of the plan [s].
            seen: Paths of the agents that it watches.
            length: Length of the plan [s]; None: that of the problem.
        """
        found = known_at(
            self.problem, time, self.reference, self.parameters, seen, length
        )
        return found._replace(previous=self.previous)

    def seen(self, shown: Callable[[int], Array]) -> tuple[Array, ...]:
        """Return the signals that the agent has of other agents.

        Args:
            shown: Function from the number of an agent to the states that it shows, at
                the nodes, shape (k, nodes).
        """
        plans = tuple(shown(number) for number in (*self.watches, *self.hears))
        if not self.hears:
            return plans
        return (*plans, *plans, np.zeros((1, self.problem.nodes)))

    def unseen(self) -> tuple[Array, ...]:
        """Return zeros in place of the signals of other agents, in the same shapes."""
        nothing = np.zeros((len(self.shows), self.problem.nodes))
        return self.seen(lambda _: nothing)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedSimulator:
    """An external simulator that is not loaded yet.

    Attributes:
        load: Function that returns the loaded simulator, to be called once.
        code: File or program of the user's that the simulator runs; None if it runs
            none.
        is_allowed: Whether `code` may be run.
    """

    load: Callable[[], Steps]
    code: str | None = None
    is_allowed: bool = False

    def loading(self) -> Callable[[], Steps]:
        """Return a function that loads the simulator at its first call.

        The function raises a CodeNotAllowedError if the simulator's code may not be
        run.
        """

        @cache
        def loaded() -> Steps:
            if self.code is not None and not self.is_allowed:
                raise CodeNotAllowedError(self.code)
            return self.load()

        return loaded


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedPlant:
    """A plant that is not compiled yet, with the dt of the planning problems.

    Attributes:
        model: The model.
        substeps: Steps of the integrator in a control interval.
        parameters: Times (n,) [s] -> the model's parameters (np, n) that are not
            decided; None if it has none.
        signals: Times (n,) [s] -> the model's signals (ns, n); None if it has none.
        decided: Name of a parameter that plans decide -> its value before the first
            plan.
        differs: Whether the plant differs from the model of the planning problems on
            purpose.
        simulator: The external simulator that makes the steps; None if the model does.
    """

    model: Model
    substeps: int
    parameters: Callable[[Array], Array] | None = None
    signals: Callable[[Array], Array] | None = None
    decided: Mapping[str, float] = field(default_factory=dict)
    differs: bool = False
    simulator: PosedSimulator | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LinearLaws:
    """The linear laws that a dual mode switches to; see DualMode.

    Attributes:
        sets: The terminal set of each agent.
        targets: The moving reference of each agent.
        uncertified: Whether sets that are not proven in every part are accepted.
    """

    sets: Sequence[TerminalSet]
    targets: Sequence[Callable[[float], Array]]
    uncertified: bool = False


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CommittedPlans:
    """Agreement of agents on committed plans; see CommittedTeam.

    Attributes:
        distance: Least distance of two agents.
        tracking_error: Largest distance of an agent from its committed plan.
        links: The links between the agents.
    """

    distance: float
    tracking_error: float
    links: Links


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Nearby:
    """Identical agents that use the plans of near agents only; see LocalTeam.

    Parameters and candidates of the agents are constant in time. Agents without a
    reference follow the plan of the first agent in the order.

    Attributes:
        problems: Number of other agents -> planning problem with signals for the plans
            of so many agents.
        range: Distance within which an agent uses the plans of others [m].
        position: Rows of an agent's states that are its position.
        links: Largest number of agents that an agent watches at any distance; each
            problem has signals for these, too.
    """

    problems: Mapping[int, OptimalControlProblem]
    range: float
    position: tuple[int, ...]
    links: int


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed:
    """A closed-loop run as a kind poses it, with nothing compiled.

    The subclass of a kind adds what its measures and figures need.

    Attributes:
        agents: The agents that plan, in the order of their states and controls.
        x0: Initial state, shape (nx,), agent after agent.
        plant: The simulated system.
        order: Numbers of the agents in the order in which they plan; None for one
            agent.
        nearby: Data of agents that use the plans of near agents only; None means that
            each agent uses the plans of all agents that it watches.
        open_loop: Whether the one plan is followed to its end without feedback.
        repair: Whether an open-loop plan that breaks a constraint between its checks is
            solved again with a margin.
        dual_mode: Linear laws that take over inside the terminal sets; None means none.
        committed: Data of agents that agree on committed plans, which end in the
            terminal sets of `dual_mode`; None if they do not.
        period: Time from one plan to the next [s] if the end time is decided and the
            loop is closed; else None.
        until: Time at which the closed loop and all of its plans end [s]; None if plans
            keep their length.
        controller: Controller that the kind itself supplies, without agents; None if
            agents plan.
        ended: Words on what happened in a run with `controller`; they take the place of
            a status of plans.
        documents: Further files of a run's folder: name -> text.
        files: Files that are copied into a run's folder: name -> file.
    """

    agents: tuple[PosedAgent, ...]
    x0: Array
    plant: PosedPlant
    order: tuple[int, ...] | None = None
    nearby: Nearby | None = None
    open_loop: bool = False
    repair: bool = False
    dual_mode: LinearLaws | None = None
    committed: CommittedPlans | None = None
    period: float | None = None
    until: float | None = None
    controller: Controller | None = None
    ended: str = ""
    documents: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def vehicles(self) -> int:
        """Number of vehicles, or of agents that plan."""
        return len(self.agents)

    @property
    def planned(self) -> tuple[OptimalControlProblem, ...]:
        """Problem of the plans of each agent.

        If `until` is set, the length of a plan is given to the problem anew each time.
        """
        problems = tuple(agent.problem for agent in self.agents)
        if self.until is None:
            return problems
        return tuple(of_given_length(problem) for problem in problems)

    @property
    def ramps(self) -> tuple[Ramp, ...]:
        """Signals that jump or bend where plans take them as linear or constant."""
        found = [
            ramp
            for agent in self.agents
            for ramp in ramps_of(agent.problem, agent.reference)
        ]
        return tuple(dict.fromkeys(found))

    @property
    def differs(self) -> bool:
        """True if the simulated system differs from the model of the plans."""
        return self.plant.differs or bool(self.ramps)

    def known_by(self, number: int, time: float, seen: tuple[Array, ...] = ()) -> Known:
        """Return what an agent knows when it plans.

        Args:
            number: Number of the agent.
            time: Time of the plan [s].
            seen: Paths of the agents that it watches.
        """
        agent, length = self.agents[number], None
        if self.until is not None:
            length = min(agent.problem.length, self.until - time)
        return agent.known(time, seen, length)

    @property
    def begins_anew(self) -> bool:
        """True if an interrupted run has to begin anew.

        The state of its controller is then lost.
        """
        return self.controller is not None or self.committed is not None


class SeveralPlansError(SwarmstartError):
    """A scenario has several planning problems, for several agents or steps."""


P = TypeVar("P", bound=Posed)
P_co = TypeVar("P_co", bound=Posed, covariant=True)


def _from_near(posed: P) -> P:
    """Return a run whose states far from zero are counted from near, if one plans.

    A team and an ensemble keep their problems, which several plants share.
    """
    if posed.controller or posed.order is not None or posed.nearby:
        return posed
    agent = posed.agents[0]
    if agent.problem.risk is not None:
        return posed
    problem = from_near_start(shooting_of(agent.problem), posed.x0, agent.known(0.0))
    if problem is agent.problem:
        return posed
    return replace(posed, agents=(replace(agent, problem=problem),))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Flight(Generic[P_co]):
    """A closed loop that is ready to run.

    Attributes:
        posed: Agents and plant as posed.
        plant: The simulated system.
        controller: The controller of the plant.
    """

    posed: P_co
    plant: Plant
    controller: Controller

    @property
    def x0(self) -> Array:
        """Initial state, shape (nx,)."""
        return self.posed.x0

    @property
    def agents(self) -> int:
        """Number of agents; each decision has a plan for each of them."""
        return len(self.posed.agents)

    @property
    def sense(self) -> int:
        """Sign of the cost: 1 if it is minimised, -1 if the user maximises."""
        agents = self.posed.agents
        return int(agents[0].problem.sense) if agents else 1

    @property
    def documents(self) -> Mapping[str, str]:
        """Further documents of a run's folder: name of a file -> its text."""
        return self.posed.documents

    @property
    def loop(self) -> RecedingHorizon:
        """The loop that makes the plans of the one agent.

        Raises:
            SeveralPlansError: If there is no such loop: several agents plan, or the
                controller is of another kind, such as one with a dual mode.
        """
        made = self.controller
        loop = made.loop if isinstance(made, OpenLoop) else made
        if not isinstance(loop, RecedingHorizon):
            raise SeveralPlansError(
                f"expected one agent that plans, found a {type(made).__name__}"
            )
        return loop

    def answer(self, trajectory: Trajectory) -> Solution:
        """Return the plan that an open loop followed to its end, verified.

        Raises:
            SeveralPlansError: If several agents plan.
        """
        planner = self.loop.planner
        # An open loop has one plan, made at time 0.
        given, known, _ = planner.posed(self.x0, self.loop.known(0.0))
        plan = trajectory.decisions[0].plans[0]
        x0 = start_of(planner.problem, plan, given)
        if not plan.states.size:  # A record keeps no states of plans.
            states = planner.fitness.states(plan.controls, x0, known)
            plan = replace(plan, states=states)
        return verified(planner.tracer, plan, x0, known)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PlanningProblem:
    """One planning problem, from one state.

    Attributes:
        problem: The problem.
        x0: Initial state, shape (nx,).
        known: Parameters and signals of the problem.
        family: Family of trajectories that a search looks in; None means control
            sequences.
        guess: Controls (nu, N), or a Start, from which planning starts; None if the
            scenario gives no guess.
        candidates: Controls (nu, N, k) that the search of a run tries, too; None if
            there are none.
    """

    problem: OptimalControlProblem
    x0: Array
    known: Known
    family: TrajectoryFamily | None = None
    guess: Array | Start | None = None
    candidates: Array | None = None


class CodeNotAllowedError(SwarmstartError):
    """A scenario runs code of the user's or of others, which was not allowed."""

    def __init__(self, code: str) -> None:
        """Name the file or the program, and the option."""
        super().__init__(
            f"{printable(code)}: expected --allow-code (in Python "
            "allow_code=True): this scenario runs that code"
        )


class NoAnimationError(SwarmstartError):
    """A kind of scenario has no animation."""


def no_measures(scenario: Scenario) -> dict[str, str]:
    """Return an empty mapping, for kinds whose scenarios define no measures."""
    del scenario
    return {}


class GivenInstances(NamedTuple):
    """Data of many instances of the first plan.

    Attributes:
        columns: Name of a state or parameter -> its start or its value in each of the M
            instances, shape (M,).
        starts: Number of points from which each instance is solved; None means the
            default of `solve_many`.
        place: Number of an instance -> its line in a file, in words; empty without a
            file.
    """

    columns: Mapping[str, Array]
    starts: int | None
    place: Callable[[int], str]


def unknown_instances(
    names: Iterable[str], problem: OptimalControlProblem
) -> Iterator[tuple[str, str]]:
    """Yield each name that instances of a problem cannot use, with the reason.

    Args:
        names: Names of states and parameters.
        problem: The planning problem.
    """
    states, parameters = varied_names(problem)
    known = (*states, *parameters)
    for name in names:
        if name not in known:
            hint = meant(name, known, otherwise=f"known: {', '.join(known)}")
            yield (
                name,
                "expected a state whose start is given, or a parameter that is not "
                f"decided; found {name!r}; {hint}",
            )


def no_documents(*run: object) -> dict[str, str]:
    """Return an empty mapping, for kinds whose runs lead to no further documents."""
    del run
    return {}


def no_code(scenario: Scenario) -> str | None:
    """Return None, for kinds whose scenarios run no code of others."""
    del scenario
    return None


def no_instances(scenario: Scenario) -> GivenInstances | None:
    """Return None, for kinds whose scenarios have no instances."""
    del scenario
    return None


class WholeRun(NamedTuple):
    """Cost of a whole run, and its largest excess over a constraint.

    Attributes:
        cost: Value by which runs of this kind are compared, the lower the better, also
            if the user maximises; NaN if it is not finite.
        excess: Largest excess over a constraint along the whole path, relative to the
            limit if that is a distance; 0 if all constraints hold.
    """

    cost: float
    excess: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Kind:
    """A kind of scenario.

    Attributes:
        scenario: The pydantic model of its scenarios.
        poses: Scenario -> its agents and plant, not compiled; use the method `pose`
            instead.
        measure: (scenario, flight, trajectory) -> values of the measures, by name.
        whole_run: (scenario, flight, trajectory, measures) -> values by which whole
            runs are compared.
        measures: Name -> meaning, with its unit in brackets at the end.
        undefined: Name of a measure that can be null -> reason; NEVER for the time of
            an event that may never come.
        own_measures: Scenario -> measures that it defines itself: name -> reason why
            one can be null.
        own_meanings: Scenario -> the same measures: name -> meaning.
        flaws: Scenario -> errors that concern several of its parts, with their places:
            texts, or errors of expressions.
        instances: Scenario -> the instances of its first plan; None if it has none.
        documents: (scenario, flight, trajectory) -> further files of a run's folder:
            name -> text.
        drawn_by: "module:function" that draws: (scenario, flight, trajectory, folder)
            -> files. It is a name because drawing does not change the numbers of a run.
        animated_by: Name of the module whose `animate` and `check_writer` make
            animations; empty if the kind has none.
        code: Scenario -> the file or the command of the user's that it runs; None if
            it runs none.
        posed_by_code: Whether posing runs that file or command; else only a simulation
            runs it.
    """

    scenario: type[Scenario]
    poses: Callable[..., Posed]
    measure: Callable[..., Mapping[str, Measure]]
    whole_run: Callable[..., WholeRun]
    measures: Mapping[str, str]
    undefined: Mapping[str, str]
    flaws: Callable[..., Iterator[LocatedFlaw]]
    drawn_by: str
    own_measures: Callable[..., Mapping[str, str]] = no_measures
    own_meanings: Callable[..., Mapping[str, str]] = no_measures
    instances: Callable[..., GivenInstances | None] = no_instances
    documents: Callable[..., Mapping[str, str]] = no_documents
    animated_by: str = ""
    code: Callable[..., str | None] = no_code
    posed_by_code: bool = False

    def pose(self, scenario: Scenario, *, allow_code: bool = False) -> Posed:
        """Return agents and plant, from which `kinds/flight.py` builds a closed loop.

        Args:
            scenario: The scenario, checked.
            allow_code: Whether a user's file may be run; a file cannot set this
                itself.

        Raises:
            CodeNotAllowedError: If posing runs a file and `allow_code` is false.
            SwarmstartError: If it cannot be posed.
        """
        if self.posed_by_code:
            # Before `poses`, which imports the file and so runs it.
            self.require_allowed(scenario, allow_code=allow_code)
        posed = _from_near(self.poses(scenario))
        simulator = posed.plant.simulator
        if simulator is None:
            return posed
        allowed = replace(simulator, is_allowed=allow_code)
        return replace(posed, plant=replace(posed.plant, simulator=allowed))

    def require_allowed(self, scenario: Scenario, *, allow_code: bool) -> None:
        """Raise if a scenario runs code of the user's that may not be run.

        Raises:
            CodeNotAllowedError: If so; the error names the file or the program.
        """
        code = self.code(scenario)
        if code is not None and not allow_code:
            raise CodeNotAllowedError(code)

    def figures(
        self,
        scenario: Scenario,
        flight: Flight[Posed],
        trajectory: Trajectory,
        folder: Path,
        **options: Any,
    ) -> list[Path]:
        """Write all figures that apply to a run; return the files.

        Args:
            scenario: The scenario.
            flight: The flight.
            trajectory: Its path.
            folder: Folder of the files.
            options: `formats` and `progress`, as `drawing.write_figures` takes them.
        """
        drawn: list[Path] = resolve_name(self.drawn_by)(
            scenario, flight, trajectory, folder, **options
        )
        return drawn

    def animate(
        self,
        scenario: Scenario,
        flight: Flight[Posed],
        trajectory: Trajectory,
        file: Path,
        **options: Any,
    ) -> None:
        """Write an animation of a run.

        Args:
            scenario: The scenario.
            flight: The flight.
            trajectory: Its path.
            file: A name that ends in .gif or .mp4.
            options: `progress`, a callback with (frames finished, all frames,
                "animating").

        Raises:
            NoAnimationError: If the kind has no animation.
        """
        self.check_animation(file.suffix.removeprefix("."))
        animate = resolve_name(f"{self.animated_by}:animate")
        animate(scenario, flight, trajectory, file, **options)

    def check_animation(self, writer: str) -> None:
        """Raise if an animation, "gif" or "mp4", cannot be written on this machine.

        Raises:
            NoAnimationError: If the kind has no animation.
        """
        if not self.animated_by:
            raise NoAnimationError(
                f"this kind of scenario has no animation, got --animation {writer}"
            )
        # Here and not at the top: a module of drawings imports Matplotlib.
        resolve_name(f"{self.animated_by}:check_writer")(writer)

    def measures_of(self, scenario: Scenario) -> list[str]:
        """Return the names of all measures of a scenario."""
        return [*self.own_measures(scenario), *self.measures]

    def meanings_of(self, scenario: Scenario) -> dict[str, str]:
        """Return the meaning of every measure of a scenario, by name.

        The unit stands in brackets at the end. A count has none, and a measure that the
        scenario defines itself shows its expression instead.
        """
        return {**self.own_meanings(scenario), **self.measures}

    def undefined_of(self, scenario: Scenario) -> dict[str, str]:
        """Return the reasons why measures of a scenario can be null, by name."""
        return {**self.own_measures(scenario), **self.undefined}
