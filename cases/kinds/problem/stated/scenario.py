"""The scenario of a problem: a model of the user's own, its costs and constraints.

Only kind, states, controls, prediction and a cost are required. Parts that repeat or
vary the problem are here: vehicles, uncertain parameters, and phases. Its other parts
are in parts.py, numbers and expressions in values.py.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_serializer, model_validator

from swarmstart.cases.format.document import counted
from swarmstart.cases.format.expressions import evaluate
from swarmstart.cases.format.parts import BudgetPart, Part
from swarmstart.cases.format.settings import (
    AnySearch,
    LocatedFlaw,
    PlanningScenario,
    PolishPart,
)
from swarmstart.cases.kinds.links import LinksPart
from swarmstart.cases.kinds.problem.stated.constants import with_constants
from swarmstart.cases.kinds.problem.stated.instances import Instances
from swarmstart.cases.kinds.problem.stated.parts import (
    AlgebraicPart,
    Constraint,
    Control,
    DualMode,
    Feedback,
    Guess,
    PathPart,
    PlantPart,
    Prediction,
    State,
)
from swarmstart.cases.kinds.problem.stated.simulators import (
    AnyPlantPart,
    SimulatorPart,
)
from swarmstart.cases.kinds.problem.stated.values import (
    Expression,
    Horizon,
    Law,
    Measured,
    Names,
    OverTime,
    Parameter,
    Quantity,
    Start,
    TablePart,
)
from swarmstart.cases.record.results import recorded_plan
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Memetic, Multistart
from swarmstart.ocp.interpolation import Table as LookupTable
from swarmstart.ocp.search import LANES
from swarmstart.ocp.statement import Measure

EVALUATIONS = 20_000
"""Default budget of evaluations of a search."""
MOST_STEPS = 10_000
"""Largest number of steps of a simulation, if it is not given."""
_ROUNDING = 1e-9
"""Rounding of a number of steps, relative to it."""

MOST_MEMBERS = 1000
"""Largest number of members, the sets of values of uncertain parameters."""


class Vehicle(Part):
    """One of several vehicles with the same model.

    Attributes:
        name: Name of the vehicle, appended to the names of its states and controls.
        start: Starts of its states, by state, in place of those of the model.
        constants: Constants of the vehicle, in place of those of the file or besides
            them.
    """

    name: Names
    start: Mapping[Names, Start] = Field(default_factory=dict)
    constants: Mapping[Names, Quantity] = Field(default_factory=dict)


class SeparationPart(Part):
    """A distance that every two vehicles keep.

    Attributes:
        of: One to three coordinates of a vehicle: any expressions if `planning` is
            joint, else names of states.
        distance: Smallest allowed distance between two vehicles.
        margin: Reserve that plans keep from the distance.
        along: Places at which distances are checked: the check points, or (in the
            search) also the straight segments between them.
        scale: Excess that counts as a violation of 1; null means that it is found from
            the problem.
    """

    of: list[Expression] = Field(min_length=1, max_length=3)
    distance: Quantity
    margin: Quantity = "0"
    along: Literal["points", "segments"] = "points"
    scale: Quantity | None = None


class Vehicles(Part):
    """Several vehicles with one model.

    Attributes:
        members: The vehicles, 1 to 100.
        planning: Method of planning: joint decides for all vehicles at once; with
            priority one vehicle plans after another, and keeps its distance from the
            plans of those before it; with committed each plans by itself, and follows
            only plans that all others have accepted. The last two need a receding
            horizon.
        separation: Distance that every two vehicles keep; null means none.
        links: Links between the vehicles, with committed plans only.
        tracking_error: Largest distance of a vehicle from its committed plan, if the
            plant differs from the model; the distance between committed plans is larger
            by twice this value.
    """

    members: list[Vehicle] = Field(min_length=1, max_length=100)
    planning: Literal["joint", "priority", "committed"] = "joint"
    separation: SeparationPart | None = None
    links: LinksPart = LinksPart()
    tracking_error: Quantity = "0"

    @property
    def is_committed(self) -> bool:
        """True if vehicles agree on committed plans."""
        return self.planning == "committed"


class Uncertain(Part):
    """Several values of parameters, for which one control sequence is planned.

    The simulated system has the values of the scenario's `parameters`, replaced by
    those of `plant.parameters`.

    Attributes:
        values: Values by parameter: one for each member.
        drawn: Distributions by parameter, from which the values are drawn, in place of
            `values`.
        samples: Number of members that are drawn; null if `values` are given.
        seed: Seed of the drawn numbers, which do not depend on --seed.
        weights: Weights of the members, one for each; null means equal ones.
        risk: Cost that counts: the mean of the members' costs, the worst one, or (cvar)
            the mean of the worst part of them.
        level: Level of cvar: the worst part is 1 - level of the members.
        robust_horizon: Number of intervals after which each member has controls of its
            own, in a receding horizon; null means that all members share all controls.
    """

    values: Mapping[Names, list[Quantity]] = Field(default_factory=dict)
    drawn: Mapping[Names, Law] = Field(default_factory=dict)
    samples: int | None = Field(default=None, ge=1, le=MOST_MEMBERS)
    seed: int = Field(default=0, ge=0, lt=2**32)
    weights: list[Quantity] | None = None
    risk: Measure = "mean"
    level: Quantity = "0.9"
    robust_horizon: int | None = Field(default=None, ge=1)

    @model_validator(mode="after")
    def _one_source(self) -> "Uncertain":
        if bool(self.values) == bool(self.drawn):
            found = "both" if self.values else "neither"
            raise ValueError(f"expected values, or drawn and samples; found {found}")
        if bool(self.drawn) != (self.samples is not None):
            raise ValueError("expected samples, their number, with drawn and only then")
        return self


class Phase(Part):
    """One of several phases, one after another: its differences from the file.

    Attributes:
        name: Name of the phase in the names of measures; null means its number, from 1.
        horizon_s: Length of the phase [s], or decided by the plan.
        intervals: Number of control intervals in the phase.
        constants: Constants in place of those of the file or besides them.
        definitions: Definitions in place of those of the file or besides them.
        states: States in place of those of the file, key by key, or besides them; null
            means that the phase has no such state.
        controls: Controls in place of those of the file, key by key, or besides them;
            null means that the phase has no such control.
        algebraic: Algebraic variables in place of those of the file or besides them;
            null means that the phase has no such variable.
        stage_cost: Cost per second in place of that of the file; null means that of the
            file [cost/s].
        step_cost: Cost at the beginning of each interval in place of that of the file;
            null means that of the file [cost].
        terminal_cost: Cost at the end of the phase; null means none [cost].
        path: Constraints at every check of the phase, besides those of the file, which
            hold in all phases.
        terminal: Constraints at the end of the phase.
        linkage: Values with which states of the next phase begin, by state: expressions
            at the end of this phase; other states continue.
    """

    name: Names | None = None
    horizon_s: Horizon
    intervals: int = Field(ge=1, le=10_000)
    constants: Mapping[Names, Quantity] = Field(default_factory=dict)
    definitions: Mapping[Names, Expression] = Field(default_factory=dict)
    states: Mapping[Names, State | None] = Field(default_factory=dict)
    controls: Mapping[Names, Control | None] = Field(default_factory=dict)
    algebraic: Mapping[Names, AlgebraicPart | None] = Field(default_factory=dict)
    stage_cost: Expression | None = None
    step_cost: Expression | None = None
    terminal_cost: Expression | None = None
    path: list[PathPart] = Field(default_factory=list)
    terminal: list[Constraint] = Field(default_factory=list)
    linkage: Mapping[Names, Expression] = Field(default_factory=dict)

    @field_serializer("states", "controls")
    def _as_given(self, parts: Mapping[str, Part | None]) -> dict[str, Any]:
        """Return only the given keys, so that no default hides a value of the file."""
        return {
            name: None
            if part is None
            else part.model_dump(mode="json", exclude_unset=True)
            for name, part in parts.items()
        }


class UserScenario(PlanningScenario):
    """The keys of scenarios whose problem is the user's own, with their defaults.

    Attributes:
        schema_version: Version of the scenario format.
        title: Title of the scenario in one line.
        feedback: Use of plans: one to its end, or a new one in every interval; a name
            or a mapping.
        measures: Measures of the scenario's own: name to an expression of the simulated
            path.
        instances: Starts and parameters of many instances of the first plan, which
            `swarmstart sweep` solves and other commands ignore; null means none.
        search: Search algorithm and its settings; by default lshade with
            `when: undecided`.
        budget: Budget of the search for each planning problem; by default 20000
            evaluations.
        polish: Local solver that improves the answer of the search: IPOPT, none, or
            another NLP solver of CasADi with its options.
        lanes: Number of random starts that are solved at once, besides the search, if
            there is no earlier plan; null means 64 with a polish and without within_s,
            else 0.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    title: str = ""
    feedback: Feedback = Feedback()
    measures: Mapping[Names, Measured] = Field(default_factory=dict)
    instances: Instances | None = None
    search: AnySearch = Field(
        default={"name": "lshade", "when": "undecided"}, validate_default=True
    )
    budget: BudgetPart = BudgetPart(evaluations=EVALUATIONS)
    polish: Literal["none", "ipopt"] | PolishPart = "ipopt"

    def random_starts(self) -> int:
        """Return the number of random starts; 64 unless the scenario gives another."""
        if self.polish == "none" or self.feedback.within_s is not None:
            return 0
        return LANES if self.lanes is None else self.lanes

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
        if self.feedback.within_s is None:
            return
        if self.lanes:
            what = "expected no lanes with feedback.within_s: they cannot be stopped"
            yield ("lanes",), f"{what}; found {self.lanes}"
        search = self.search.algorithm()
        if isinstance(search, Memetic) or (
            isinstance(search, Multistart) and search.lanes
        ):
            yield (
                ("search",),
                "expected a search that can be stopped, such as lshade, or multistart "
                f"with lanes: false, with feedback.within_s; found {self.search.name}",
            )


class ProblemScenario(UserScenario):
    """Scenario of an optimal-control problem.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        steps: Number of control intervals to simulate; by default those of the
            prediction.
        constants: Constants by name: numbers, or expressions in the constants before
            them.
        tables: Tables by name, used as functions in expressions.
        parameters: Parameters by name: values over time, or numbers that the plan
            decides. Each is constant within a plan, which takes the value at the time
            of planning if values over time are given.
        signals: Signals by name, known ahead over the horizon: numbers, expressions in
            time, or tables.
        definitions: Definitions by name: expressions that other expressions use by
            this name; each can use the definitions before it.
        algebraic: Algebraic variables by name: an expression that is 0, or a mapping.
        states: States by name, at least one; required.
        controls: Controls by name, at least one; required.
        stage_cost: Cost per second along the path, an expression [cost/s]; one of the
            four costs is required, and all that are given are added.
        step_cost: Cost at the beginning of each interval, an expression [cost].
        initial_cost: Cost at the start of the horizon, an expression [cost].
        terminal_cost: Cost at the end of the horizon, an expression [cost].
        maximize: Option to maximise the costs instead of minimising them.
        path: Constraints at every check of the path.
        terminal: Constraints at the end of the horizon.
        vehicles: Several vehicles with this model; null means one system.
        uncertain: Uncertain parameters, with one plan for all their values; null means
            none.
        phases: Phases, one after another; empty means that there is only one.
        guess: Start of the first plan: controls and states over time, or the folder of
            a record.
        candidates: Control sequences that the search tries besides its own, each an
            expression in time for every control.
        prediction: Horizon of a plan and its grid; required.
        dual_mode: Linear law in a certified terminal set, for a receding horizon only;
            null means none.
        plant: Simulated system: the model in finer steps, or an external simulator.
    """

    kind: Literal["problem"]
    constants: Mapping[Names, Quantity] = Field(default_factory=dict)
    tables: Mapping[Names, TablePart] = Field(default_factory=dict)
    parameters: Mapping[Names, Parameter] = Field(default_factory=dict)
    signals: Mapping[Names, OverTime] = Field(default_factory=dict)
    definitions: Mapping[Names, Expression] = Field(default_factory=dict)
    algebraic: Mapping[Names, AlgebraicPart] = Field(default_factory=dict)
    states: Annotated[Mapping[Names, State], Field(min_length=1, max_length=200)]
    controls: Annotated[Mapping[Names, Control], Field(min_length=1, max_length=200)]
    stage_cost: Expression = "0"
    step_cost: Expression = "0"
    initial_cost: Expression = "0"
    terminal_cost: Expression = "0"
    maximize: bool = False
    path: list[PathPart] = Field(default_factory=list)
    terminal: list[Constraint] = Field(default_factory=list)
    vehicles: Vehicles | None = None
    uncertain: Uncertain | None = None
    phases: list[Phase] = Field(default_factory=list, max_length=20)
    guess: Guess = Guess()
    candidates: list[Mapping[Names, Expression]] = Field(default_factory=list)
    prediction: Prediction
    dual_mode: DualMode | None = None
    plant: AnyPlantPart = PlantPart()

    @property
    def simulator(self) -> SimulatorPart | None:
        """The simulator that makes the steps of the plant; None if the model does."""
        return self.plant if isinstance(self.plant, SimulatorPart) else None

    @property
    def modelled(self) -> PlantPart:
        """The plant that is the model; the default one if a simulator is the plant."""
        return self.plant if isinstance(self.plant, PlantPart) else PlantPart()

    @property
    def tabled(self) -> dict[str, LookupTable]:
        """The tables, by name."""
        return {name: part.table for name, part in self.tables.items()}

    @model_validator(mode="before")
    @classmethod
    def _completed(cls, given: Any) -> Any:
        """Add steps, intervals, the numbers of constants, and the plan of a record.

        With phases the intervals of the prediction are those of all phases.
        """
        if not isinstance(given, dict):
            return given
        given = with_constants(_with_intervals(given))
        guess = given.get("guess")
        # Steps that the file gives come last and count.
        given = {"steps": _steps(given), **given}
        if isinstance(guess, dict) and "record" in guess:
            given["guess"] = _guess_of(
                guess, given.get("controls"), given.get("vehicles")
            )
        return given


def _with_intervals(given: dict[str, Any]) -> dict[str, Any]:
    """Return a scenario with the intervals of all phases, unless it gives them."""
    phases, grid = given.get("phases"), given.get("prediction", {})
    if not (isinstance(phases, list) and phases and isinstance(grid, dict)):
        return given
    counts = [one.get("intervals") for one in phases if isinstance(one, dict)]
    # Not isinstance: true and false are integers of Python.
    whole = [count for count in counts if type(count) is int]
    if "intervals" in grid or len(whole) != len(phases):
        return given
    # At least 1: an error of a phase must not appear as one of the prediction.
    return {**given, "prediction": {**grid, "intervals": max(sum(whole), 1)}}


def _steps(given: dict[str, Any]) -> int:
    """Return the default steps of a scenario; 1 if its numbers are invalid.

    They are the intervals; in closed loop with a decided end time the periods in the
    longest horizon, and with a fixed end those until then.
    """
    prediction, feedback = given.get("prediction"), given.get("feedback")
    prediction = prediction if isinstance(prediction, dict) else {}
    intervals, horizon = prediction.get("intervals"), prediction.get("horizon_s")
    feedback = feedback if isinstance(feedback, dict) else {}
    period, end = feedback.get("period_s"), feedback.get("ends_at_s")
    bounds = horizon if isinstance(horizon, dict) else {}
    if end is not None or (period is not None and bounds):
        try:
            longest = evaluate(str(bounds["free"][1] if end is None else end))
            if period is None:
                period = evaluate(str(horizon)) / evaluate(str(intervals))
            exact = longest / evaluate(str(period)) * (1 - _ROUNDING)
            return min(max(math.ceil(exact), 1), MOST_STEPS)
        # The model of the scenario reports these errors later, at their places.
        except (SwarmstartError, ArithmeticError, LookupError, TypeError):
            return 1
    if isinstance(intervals, bool) or not isinstance(intervals, int):
        return 1
    return intervals


def _guess_of(guess: dict[str, Any], controls: Any, vehicles: Any) -> dict[str, Any]:
    """Return a guess with the first plan of a record in place of its folder."""
    if (
        set(guess) != {"record"}
        or vehicles is not None
        or not isinstance(controls, dict)
    ):
        raise ValueError(
            "expected record alone in the guess of a problem without vehicles"
        )
    times, rows = recorded_plan(guess["record"])
    if len(rows) != len(controls):
        raise ValueError(
            "expected guess.record with a plan of "
            f"{counted(len(controls), 'control')}; found {len(rows)}"
        )
    return {
        "controls": {
            name: {"times": times, "values": row}
            for name, row in zip(controls, rows, strict=True)
        }
    }
