"""Kinds of scenario: the parts of one that the commands need to run it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.format.document import printable
from swarmstart.cases.format.settings import LocatedFlaw, Scenario
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import (
    Controller,
    Known,
    Model,
    OpenLoop,
    OptimalControlProblem,
    Plant,
    RecedingHorizon,
    Solution,
    Start,
    Trajectory,
    TrajectoryFamily,
    verified,
)
from swarmstart.ocp.controller import ReferenceSignals
from swarmstart.ocp.guess import Appended
from swarmstart.ocp.plan import start_of
from swarmstart.terminal_set import TerminalSet

Array = NDArray[np.float64]
Measure = float | int | list[float | None] | None
NEVER = "never"
"""Why a time is not defined: what it waits for does not come, so it is above any."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedAgent:
    """An agent that plans, or flies a plan that it is given.

    Attributes:
        problem: Its planning problem.
        family: What a search looks for; None means control sequences.
        reference: The problem's first signals: absolute times (n,) [s] -> (nr, n); the
            plans of those that it watches follow. None: it has none.
        parameters: Time [s] -> parameters (np,) of the plan made then; None: none.
        candidates: Time [s] -> controls (nu, N, k) that a search looks at besides the
            last plan; None: none.
        append: What the last plan, shifted, ends with.
        shift: Whether planning starts at the last plan shifted by one interval; else at
            the last plan as it is, one interval late.
        first: Controls (nu, N), or a Start with states, that the first plan begins
            from; None: none are known.
        given: Controls (nu, N) that are flown as they are, neither searched nor
            polished; None: the agent plans.
        watches: Numbers of the agents whose plans it sees; each plans before it.
        shows: Rows of its own states that others see: its position.
        previous: Control of the interval before the flight, shape (nu,); None: the
            nearest to zero that is allowed.
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
    shows: tuple[int, ...] = ()
    previous: Array | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedPlant:
    """A plant that is not compiled yet; its dt is that of the planning problems.

    Attributes:
        model: The model.
        substeps: Steps of the integrator in a control interval.
        parameters: Times (n,) [s] -> the model's parameters (np, n) that are not
            decided; None: none.
        signals: Times (n,) [s] -> the model's signals (ns, n); None: none.
        decided: Name of a parameter that plans decide -> its value until one does.
        differs: Whether it is another system than the planning problems', on purpose.
    """

    model: Model
    substeps: int
    parameters: Callable[[Array], Array] | None = None
    signals: Callable[[Array], Array] | None = None
    decided: Mapping[str, float] = field(default_factory=dict)
    differs: bool = False


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
class Nearby:
    """Alike agents that see only those within a range; see LocalTeam.

    Parameters and candidates of the agents do not change in time, and agents without a
    reference follow the plan of the first in the order.

    Attributes:
        problems: Number of others -> the planning problem with signals for that many.
        range: Distance within which an agent sees others' plans [m].
        position: Rows of an agent's states that are its position.
        links: How many agents to watch always the problems have signals for.
    """

    problems: Mapping[int, OptimalControlProblem]
    range: float
    position: tuple[int, ...]
    links: int


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed:
    """A flight as a kind poses it, with nothing compiled.

    A kind's own subclass adds what its measures and figures need.

    Attributes:
        agents: Those that plan, in the order of their states and controls.
        x0: Where the flight starts, shape (nx,), agent after agent.
        plant: What is flown.
        order: Numbers of the agents in the order in which they plan; None: there is
            one agent.
        nearby: Given where agents see only those within a range; None: each sees the
            plans of all that it watches.
        open_loop: Whether the one plan is flown to its end without looking again.
        repair: Of an open loop: whether a plan that breaks a constraint between its
            checks is made again with a margin.
        dual_mode: What takes over inside the terminal sets; None: nothing does.
        period: Time from one plan to the next [s] where the end time is decided and
            the loop is not open; else None.
        documents: What else belongs into a run's folder: name of a file -> its text.
    """

    agents: tuple[PosedAgent, ...]
    x0: Array
    plant: PosedPlant
    order: tuple[int, ...] | None = None
    nearby: Nearby | None = None
    open_loop: bool = False
    repair: bool = False
    dual_mode: LinearLaws | None = None
    period: float | None = None
    documents: Mapping[str, str] = field(default_factory=dict)


class SeveralPlansError(SwarmstartError):
    """A scenario has several planning problems: of several agents, or of its steps."""


P_co = TypeVar("P_co", bound=Posed, covariant=True)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Flight(Generic[P_co]):
    """A closed loop ready to be flown.

    Attributes:
        posed: What was posed.
        plant: What is flown.
        controller: What flies it.
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
        """Number of agents, with as many plans in a decision."""
        return len(self.posed.agents)

    @property
    def documents(self) -> Mapping[str, str]:
        """Further documents of a run's folder: name of a file -> its text."""
        return self.posed.documents

    @property
    def loop(self) -> RecedingHorizon:
        """The loop that makes the plans, if one agent does.

        Raises:
            SeveralPlansError: If several do.
        """
        made = self.controller
        loop = made.loop if isinstance(made, OpenLoop) else made
        if not isinstance(loop, RecedingHorizon):
            raise SeveralPlansError(
                f"expected one agent that plans, found a {type(made).__name__}"
            )
        return loop

    def answer(self, trajectory: Trajectory) -> Solution:
        """Return the plan that an open loop flew to its end, verified.

        Raises:
            SeveralPlansError: If several agents plan.
        """
        planner = self.loop.planner
        given, known, _ = planner.posed(self.x0, self.loop.known(0.0))
        plan = trajectory.decisions[0].plans[0]
        x0 = start_of(planner.problem, plan, given)
        if not plan.states.size:  # A record keeps none.
            states = planner.fitness.states(plan.controls, x0, known)
            plan = replace(plan, states=states)
        return verified(planner.tracer, plan, x0, known)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PlanningProblem:
    """One planning problem, from one state.

    Attributes:
        problem: The problem.
        x0: The state, shape (nx,).
        known: Its parameters and signals.
        family: What a search looks for; None means control sequences.
    """

    problem: OptimalControlProblem
    x0: Array
    known: Known
    family: TrajectoryFamily | None = None


class CodeNotAllowedError(SwarmstartError):
    """A scenario runs a file of the user's, and that is not allowed."""

    def __init__(self, file: Path) -> None:
        """Name the file and the option."""
        super().__init__(
            f"{printable(str(file))}: expected --allow-python (in Python "
            "allow_python=True): this scenario runs the code of that file"
        )


class NoAnimationError(SwarmstartError):
    """There is no animation of this kind of flight."""


def no_measures(scenario: Scenario) -> dict[str, str]:
    """Return no measures of its own, for a kind whose scenarios define none."""
    del scenario
    return {}


class Flown(NamedTuple):
    """Cost of a whole flight, and by how much it broke its constraints.

    Attributes:
        cost: What flights of this kind are compared by, the less the better, also where
            the user maximises; NaN if it is not finite.
        excess: Largest excess over a constraint along the whole path, relative to its
            limit where that is a distance; 0 if all hold.
    """

    cost: float
    excess: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Kind:
    """A kind of scenario.

    Attributes:
        scenario: The pydantic model of its scenarios.
        poses: Scenario -> its agents and plant, nothing compiled; call `pose`.
        measure: (scenario, flight, trajectory) -> measures by name.
        flown: (scenario, flight, trajectory, measures) -> what whole flights are
            compared by.
        measures: Name -> meaning, with its unit in brackets at the end.
        undefined: Name of a measure that may be null -> why; NEVER for a time.
        own_measures: Scenario -> measures that it defines itself: name -> why one may
            be null.
        own_meanings: Scenario -> the same measures: name -> meaning.
        flaws: Scenario -> what is wrong across its parts, with the place: text, or
            the error of an expression.
        drawn_by: "module:function" of what draws: (scenario, flight, trajectory,
            folder) -> files written. A name, since it is no part of what determines a
            run's numbers.
        animated_by: Name of the module whose `animate` and `check_writer` make
            animations; empty: the kind has none.
        code: Scenario -> the file of the user's that posing it runs; None: it runs
            none.
    """

    scenario: type[Scenario]
    poses: Callable[..., Posed]
    measure: Callable[..., Mapping[str, Measure]]
    flown: Callable[..., Flown]
    measures: Mapping[str, str]
    undefined: Mapping[str, str]
    flaws: Callable[..., Iterator[LocatedFlaw]]
    drawn_by: str
    own_measures: Callable[..., Mapping[str, str]] = no_measures
    own_meanings: Callable[..., Mapping[str, str]] = no_measures
    animated_by: str = ""
    code: Callable[..., Path] | None = None

    def pose(self, scenario: Scenario, *, allow_python: bool = False) -> Posed:
        """Return agents and plant: `kinds/flight.py` makes a flight of them.

        Args:
            scenario: The scenario, checked.
            allow_python: Whether a file of the user's may be run; no file can say so.

        Raises:
            CodeNotAllowedError: If one is to be run and may not.
            SwarmstartError: If it cannot be posed.
        """
        if self.code is not None and not allow_python:
            raise CodeNotAllowedError(self.code(scenario))
        return self.poses(scenario)

    def figures(
        self,
        scenario: Scenario,
        flight: Flight[Posed],
        trajectory: Trajectory,
        folder: Path,
    ) -> list[Path]:
        """Write all figures that apply to a run; return the files."""
        drawn: list[Path] = resolve_name(self.drawn_by)(
            scenario, flight, trajectory, folder
        )
        return drawn

    def animate(
        self,
        scenario: Scenario,
        flight: Flight[Posed],
        trajectory: Trajectory,
        file: Path,
    ) -> None:
        """Write an animation of a run.

        Raises:
            NoAnimationError: If the kind has none.
        """
        self.check_animation(file.suffix.removeprefix("."))
        resolve_name(f"{self.animated_by}:animate")(scenario, flight, trajectory, file)

    def check_animation(self, writer: str) -> None:
        """Refuse an animation that cannot be written here, "gif" or "mp4".

        Raises:
            NoAnimationError: If the kind has none.
        """
        if not self.animated_by:
            raise NoAnimationError(
                f"this kind of scenario has no animation, got --animation {writer}"
            )
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
        """Return why measures of a scenario may be null, by name."""
        return {**self.own_measures(scenario), **self.undefined}
