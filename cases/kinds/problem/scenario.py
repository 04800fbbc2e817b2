"""The scenario of a problem: a model of the user's own, its costs and constraints.

Only kind, states, controls, prediction and a cost are required. Expressions are in the
file's own names; numbers may be expressions in its constants.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    model_validator,
)

from swarmstart.cases.format.expressions import parse
from swarmstart.cases.format.settings import (
    LARGEST,
    AnySearch,
    BudgetPart,
    Checks,
    GridPart,
    Number,
    Part,
    Positive,
    Scenario,
)
from swarmstart.cases.kinds.problem.tables import TablePart
from swarmstart.cases.record.first_plan import recorded_plan
from swarmstart.ocp.guess import Appended
from swarmstart.ocp.integrators import Integrator
from swarmstart.ocp.problem import Quadrature
from swarmstart.ocp.tables import Table as LookupTable

EVALUATIONS = 20_000
"""Of a search, unless the budget says something else."""
MOST_NODES = 10_000
"""Checks of a horizon."""
Names = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$")]


def _text(value: object) -> object:
    """Return an expression in constants as text; a number is one."""
    value = _written(value)
    if isinstance(value, str):
        parse(value)
    return value


def _text_with_tables(value: object) -> object:
    """Return an expression as text; which tables there are is not known yet."""
    value = _written(value)
    if isinstance(value, str):
        parse(value, functions=None)
    return value


def _written(value: object) -> object:
    """Return a number as text, anything else as it is."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return repr(value) if abs(value) <= LARGEST else value
    return value


def _text_of_paths(value: object) -> object:
    """Return the expression of a measure as text."""
    if isinstance(value, str):
        parse(value, of_paths=True, functions=None)
    return value


def _schema(what: str) -> WithJsonSchema:
    return WithJsonSchema({"type": ["number", "string"], "description": what})


Expression = Annotated[
    str,
    BeforeValidator(_text_with_tables),
    _schema("An expression in the names of this file."),
]
Quantity = Annotated[
    str, BeforeValidator(_text), _schema("A number, or an expression in constants.")
]
Measured = Annotated[str, BeforeValidator(_text_of_paths)]


class Table(Part):
    """Values at times; held before the first and after the last.

    Attributes:
        times: Increasing [s].
        values: One at each of them.
        between: Whether values change evenly from one to the next, or are held.
    """

    times: list[Number] = Field(min_length=1, max_length=10_000)
    values: list[Number] = Field(min_length=1, max_length=10_000)
    between: Literal["linear", "hold"] = "linear"

    @model_validator(mode="after")
    def _fits(self) -> "Table":
        if len(self.times) != len(self.values):
            raise ValueError(
                f"expected as many values as times; found {len(self.values)} values "
                f"and {len(self.times)} times"
            )
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("expected times that increase")
        return self


def _chosen(key: str, otherwise: str) -> Discriminator:
    """Return the choice of a part by its key, so that errors are those of one part."""

    def tag(value: Any) -> str:
        has = key in value if isinstance(value, dict) else hasattr(value, key)
        is_part = isinstance(value, dict | Part)
        return key if has else otherwise if is_part else "text"

    return Discriminator(tag)


OverTime = Annotated[
    Annotated[Table, Tag("table")] | Annotated[Expression, Tag("text")],
    _chosen("table", "table"),
]
"""A table, or an expression in constants and time."""
Limits = Annotated[list[Quantity | None], Field(min_length=2, max_length=2)]
"""[lower, upper]; null: no limit."""


class State(Part):
    """A state: where it starts, and its rate."""

    start: Quantity | None = None
    rate: Expression
    bounds: Limits | None = None
    unit: str = ""


class Control(Part):
    """A control and its bounds."""

    bounds: Limits | None = None
    unit: str = ""


class Constraint(Part):
    """lower <= expression <= upper, or `equals`."""

    expression: Expression
    lower: Quantity | None = None
    upper: Quantity | None = None
    equals: Quantity | None = None
    scale: Quantity | None = None
    name: str = ""

    @model_validator(mode="after")
    def _one_meaning(self) -> "Constraint":
        if self.equals is not None and (self.lower, self.upper) != (None, None):
            raise ValueError("expected equals, or lower and upper; found both")
        return self


class Soft(Part):
    """Weights of a soft constraint: of its excess, and of the square of that."""

    weight: Quantity | None = None
    quadratic: Quantity | None = None

    @model_validator(mode="after")
    def _has_weight(self) -> "Soft":
        if (self.weight, self.quadratic) == (None, None):
            raise ValueError("expected weight, quadratic or both; found neither")
        return self


class PathLimit(Constraint):
    """A constraint along the path, which may be soft."""

    soft: Soft | None = None


class Distance(Part):
    """A distance to keep: of the origin from a point with these coordinates."""

    distance: list[Expression] = Field(min_length=1, max_length=3)
    at_least: Quantity | None = None
    at_most: Quantity | None = None
    margin: Quantity = "0"
    along: Literal["points", "segments"] = "points"
    measure: Literal["excess", "indicator"] = "excess"
    scale: Quantity | None = None
    name: str = ""

    @model_validator(mode="after")
    def _one_limit(self) -> "Distance":
        if (self.at_least is None) == (self.at_most is None):
            raise ValueError("expected either at_least or at_most")
        return self


PathPart = Annotated[
    Annotated[Distance, Tag("distance")] | Annotated[PathLimit, Tag("expression")],
    _chosen("distance", "expression"),
]


class Guess(Part):
    """Start of the first plan.

    A record's folder is replaced by its first plan when the scenario is read.

    Attributes:
        controls: By name: numbers, expressions in time, or tables; 0 if not given.
        states: The same; a polish begins from them, too.
    """

    controls: Mapping[Names, OverTime] = Field(default_factory=dict)
    states: Mapping[Names, OverTime] = Field(default_factory=dict)


class Prediction(GridPart):
    """The horizon and its grid."""

    intervals: int = Field(ge=1, le=10_000)
    checks: Checks = 1
    substeps: int = Field(default=4, ge=1, le=1000)
    integrator: Integrator = "rk4"
    quadrature: Quadrature = "integral"
    tolerance: Positive = 1e-6
    path_tolerance: Positive = 1e-4

    @model_validator(mode="after")
    def _few_nodes(self) -> "Prediction":
        nodes = self.intervals * self.checks
        if nodes > MOST_NODES:
            raise ValueError(
                f"expected at most {MOST_NODES} checks, intervals * checks; "
                f"found {nodes}"
            )
        return self


class Feedback(Part):
    """Use of plans: one to its end, or a new one in every interval."""

    law: Literal["open_loop", "receding_horizon"] = "open_loop"
    last_plan: Literal["shifted", "unshifted"] = "shifted"
    append: Appended = "zero"
    repair: bool = True

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: object) -> object:
        return {"law": value} if isinstance(value, str) else value


class Noise(Part):
    """Random numbers, a new one in each of the plant's steps."""

    deviation: Quantity
    seed: int = Field(default=0, ge=0, lt=2**32)


Disturbance = Annotated[
    Annotated[Noise, Tag("deviation")]
    | Annotated[Table, Tag("table")]
    | Annotated[Expression, Tag("text")],
    _chosen("deviation", "table"),
]


class PlantPart(Part):
    """The simulated system: finer steps, parameters of its own, disturbances.

    Attributes:
        substeps: Steps of the integrator in a control interval.
        parameters: By name, if other than the prediction's.
        disturbance: By state: added to its rate, an expression in time or noise.
    """

    substeps: int = Field(default=20, ge=1, le=10_000)
    parameters: Mapping[Names, OverTime] = Field(default_factory=dict)
    disturbance: Mapping[Names, Disturbance] = Field(default_factory=dict)


class DualMode(Part):
    """A linear law within a certified terminal set around a state at rest.

    Attributes:
        at: The reference, by state.
        Q: Weights of the states' squares, by state; 0 unless given.
        R: Weights of the controls' squares, by control.
    """

    at: Mapping[Names, Quantity]
    Q: Mapping[Names, Quantity]
    R: Mapping[Names, Quantity]


class Vehicle(Part):
    """One of several vehicles with the same model.

    Attributes:
        name: Appended to the names of its states and controls.
        start: By state, in place of the model's.
        constants: In place of, or besides, the file's.
    """

    name: Names
    start: Mapping[Names, Quantity] = Field(default_factory=dict)
    constants: Mapping[Names, Quantity] = Field(default_factory=dict)


class SeparationPart(Part):
    """A distance that every two vehicles keep."""

    of: list[Expression] = Field(min_length=1, max_length=3)
    distance: Quantity
    margin: Quantity = "0"
    along: Literal["points", "segments"] = "points"
    scale: Quantity | None = None


class Vehicles(Part):
    """Several vehicles with one model.

    Attributes:
        planning: "joint", all at once, or "priority", one after another: each keeps
            its distance from the plans of those before it.
    """

    members: list[Vehicle] = Field(min_length=1, max_length=100)
    planning: Literal["joint", "priority"] = "joint"
    separation: SeparationPart | None = None


class UserScenario(Scenario):
    """The keys of scenarios whose problem is the user's own, with their defaults."""

    schema_version: Literal[1] = Field(default=1, alias="schema")
    title: str = ""
    feedback: Feedback = Feedback()
    measures: Mapping[Names, Measured] = Field(default_factory=dict)
    search: AnySearch = Field(default={"name": "lshade"}, validate_default=True)
    budget: BudgetPart = BudgetPart(evaluations=EVALUATIONS)
    polish: Literal["none", "ipopt"] = "ipopt"


class ProblemScenario(UserScenario):
    """Scenario of an optimal-control problem."""

    kind: Literal["problem"]
    constants: Mapping[Names, Quantity] = Field(default_factory=dict)
    tables: Mapping[Names, TablePart] = Field(default_factory=dict)
    parameters: Mapping[Names, OverTime] = Field(default_factory=dict)
    signals: Mapping[Names, OverTime] = Field(default_factory=dict)
    definitions: Mapping[Names, Expression] = Field(default_factory=dict)
    states: Annotated[Mapping[Names, State], Field(min_length=1, max_length=200)]
    controls: Annotated[Mapping[Names, Control], Field(min_length=1, max_length=200)]
    stage_cost: Expression = "0"
    terminal_cost: Expression = "0"
    maximize: bool = False
    path: list[PathPart] = Field(default_factory=list)
    terminal: list[Constraint] = Field(default_factory=list)
    vehicles: Vehicles | None = None
    guess: Guess = Guess()
    candidates: list[Mapping[Names, Expression]] = Field(default_factory=list)
    prediction: Prediction
    dual_mode: DualMode | None = None
    plant: PlantPart = PlantPart()

    @property
    def tabled(self) -> dict[str, LookupTable]:
        """The tables, by name."""
        return {name: part.table for name, part in self.tables.items()}

    @model_validator(mode="before")
    @classmethod
    def _completed(cls, given: Any) -> Any:
        """Fill in the steps, those of the prediction, and the plan of a record."""
        if not isinstance(given, dict):
            return given
        prediction, guess = given.get("prediction"), given.get("guess")
        intervals = prediction.get("intervals") if isinstance(prediction, dict) else 1
        is_count = isinstance(intervals, int) and not isinstance(intervals, bool)
        given = {"steps": intervals if is_count else 1, **given}
        if isinstance(guess, dict) and "record" in guess:
            given["guess"] = _guess_of(
                guess, given.get("controls"), given.get("vehicles")
            )
        return given


def _guess_of(guess: dict[str, Any], controls: Any, vehicles: Any) -> dict[str, Any]:
    """Return a guess with the first plan of a record in the place of its folder."""
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
            f"expected guess.record with a plan of {len(controls)} controls; found "
            f"{len(rows)}"
        )
    return {
        "controls": {
            name: {"times": times, "values": row}
            for name, row in zip(controls, rows, strict=True)
        }
    }
