"""The scenario of a problem: a model of the user's own, its costs and constraints.

Only kind, states, controls, prediction and a cost are required. Expressions are in the
file's own names; numbers may be expressions in its constants.
"""

import math
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

from swarmstart.cases.format.expressions import evaluate, parse
from swarmstart.cases.format.settings import (
    LARGEST,
    AnySearch,
    BudgetPart,
    Checks,
    Number,
    Part,
    Positive,
    Scenario,
)
from swarmstart.cases.kinds.problem.tables import TablePart
from swarmstart.cases.record.first_plan import recorded_plan
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.control_shape import ControlShape
from swarmstart.ocp.guess import Appended
from swarmstart.ocp.integrators import Integrator
from swarmstart.ocp.problem import Quadrature
from swarmstart.ocp.tables import Table as LookupTable

EVALUATIONS = 20_000
"""Of a search, unless the budget says something else."""
MOST_NODES = 10_000
"""Checks of a horizon."""
MOST_STEPS = 10_000
"""Of a simulation whose number of steps is not given."""
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
        found = key if has else otherwise if is_part else "text"
        return f"of {found}"  # No tag is a key: errors are placed by keys.

    return Discriminator(tag)


OverTime = Annotated[
    Annotated[Table, Tag("of table")] | Annotated[Expression, Tag("of text")],
    _chosen("table", "table"),
]
"""A table, or an expression in constants and time."""
Limits = Annotated[list[Quantity | None], Field(min_length=2, max_length=2)]
"""[lower, upper]; null: no limit."""


class Decided(Part):
    """A number that is decided, within bounds.

    Attributes:
        free: [lower, upper]; null: no limit, for a polish without a search.
        guess: Where a polish without a search starts; by default between the bounds.
    """

    free: Limits
    guess: Quantity | None = None


def _decided_or(otherwise: str) -> Discriminator:
    """Return the choice of a decided number, or else of another form."""

    def tag(value: Any) -> str:
        if isinstance(value, Decided) or (isinstance(value, dict) and "free" in value):
            return "is decided"
        if otherwise == "over time" and isinstance(value, dict | Table):
            return "table"
        return otherwise

    return Discriminator(tag)


Start = Annotated[
    Annotated[Decided, Tag("is decided")] | Annotated[Quantity, Tag("number")],
    _decided_or("number"),
]
"""Of a state: a number, or decided."""
Parameter = Annotated[
    Annotated[Decided, Tag("is decided")]
    | Annotated[Table, Tag("table")]
    | Annotated[Expression, Tag("over time")],
    _decided_or("over time"),
]
"""As OverTime, or decided."""
Horizon = Annotated[
    Annotated[Decided, Tag("is decided")] | Annotated[Positive, Tag("number")],
    _decided_or("number"),
]
"""A length [s], or decided."""


class State(Part):
    """A state: where it starts, and how it changes.

    Attributes:
        rate: Its derivative in time; 0 unless given.
        next: Its value that the end of a control interval makes; as it is unless given.
        periodic: Whether it ends where it starts.
        scale: Its size, in place of the natural one.
    """

    start: Start | None = None
    rate: Expression | None = None
    next: Expression | None = None
    periodic: bool = False
    bounds: Limits | None = None
    scale: Quantity | None = None
    unit: str = ""


class Control(Part):
    """A control and its bounds.

    Attributes:
        search_bounds: Narrower bounds for the search alone.
        previous: Its value in the interval before the first; the nearest to zero within
            the bounds unless given.
        scale: Its size, in place of the natural one.
    """

    bounds: Limits | None = None
    search_bounds: Limits | None = None
    previous: Quantity | None = None
    scale: Quantity | None = None
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
    Annotated[Distance, Tag("of distance")]
    | Annotated[PathLimit, Tag("of expression")],
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


class Prediction(Part):
    """The horizon and its grid.

    Attributes:
        horizon_s: Its length; left out in discrete time, where an interval lasts 1.
        control_shape: Whether controls are held, or linear between knots; of
            "continuous" ones the first knot is the control before.
    """

    horizon_s: Horizon | None = None
    intervals: int = Field(ge=1, le=10_000)
    checks: Checks = 1
    substeps: int = Field(default=4, ge=1, le=1000)
    integrator: Integrator = "rk4"
    quadrature: Quadrature = "integral"
    control_shape: ControlShape = "constant"
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
    """Use of plans: one to its end, or a new one in every interval.

    Attributes:
        period_s: Of a receding horizon whose end time is decided: time from one plan to
            the next.
    """

    law: Literal["open_loop", "receding_horizon"] = "open_loop"
    period_s: Positive | None = None
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
    Annotated[Noise, Tag("of deviation")]
    | Annotated[Table, Tag("of table")]
    | Annotated[Expression, Tag("of text")],
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
    start: Mapping[Names, Start] = Field(default_factory=dict)
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
    parameters: Mapping[Names, Parameter] = Field(default_factory=dict)
    signals: Mapping[Names, OverTime] = Field(default_factory=dict)
    definitions: Mapping[Names, Expression] = Field(default_factory=dict)
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
        guess = given.get("guess")
        given = {"steps": _steps(given), **given}
        if isinstance(guess, dict) and "record" in guess:
            given["guess"] = _guess_of(
                guess, given.get("controls"), given.get("vehicles")
            )
        return given


def _steps(given: dict[str, Any]) -> int:
    """Return the steps of a scenario that says nothing else; 1 if that is invalid.

    They are the intervals; where an end time that is decided is followed to its end,
    the periods in the longest.
    """
    prediction, feedback = given.get("prediction"), given.get("feedback")
    prediction = prediction if isinstance(prediction, dict) else {}
    intervals, horizon = prediction.get("intervals"), prediction.get("horizon_s")
    period = feedback.get("period_s") if isinstance(feedback, dict) else None
    if period is not None and isinstance(horizon, dict):
        try:
            longest = evaluate(str(horizon["free"][1]))
            return min(max(math.ceil(longest / evaluate(str(period))), 1), MOST_STEPS)
        except (SwarmstartError, ArithmeticError, LookupError, TypeError):
            return 1
    if isinstance(intervals, bool) or not isinstance(intervals, int):
        return 1
    return intervals


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
