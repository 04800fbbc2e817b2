"""The parts of the scenario of a problem: states, controls, constraints, vehicles."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    Tag,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from swarmstart.cases.format.settings import Checks, Part, Positive
from swarmstart.cases.kinds.problem.values import (
    Expression,
    Horizon,
    Limits,
    MovingLimits,
    Names,
    OverTime,
    Quantity,
    Start,
    Table,
    chosen,
)
from swarmstart.ocp.adaptive import COARSEST, FINEST
from swarmstart.ocp.control_shape import ControlShape
from swarmstart.ocp.guess import Appended
from swarmstart.ocp.integrators import Integrator
from swarmstart.ocp.problem import Quadrature
from swarmstart.ocp.radau import Radau, Transcription

MOST_NODES = 10_000
"""Checks of a horizon."""


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
    bounds: MovingLimits | None = None
    scale: Quantity | None = None
    unit: str = ""


class Control(Part):
    """A control and its bounds.

    Attributes:
        search_bounds: Narrower bounds for the search alone.
        previous: Its value in the interval before the first; the nearest to zero within
            the bounds unless given.
        integer: Whether it takes whole numbers only.
        scale: Its size, in place of the natural one.
    """

    bounds: MovingLimits | None = None
    search_bounds: Limits | None = None
    previous: Quantity | None = None
    integer: bool = False
    scale: Quantity | None = None
    unit: str = ""


class Equation(Part):
    """An equation, one of as many as there are algebraic variables.

    Attributes:
        equation: Expression that is 0.
        start: Where Newton's method starts for the variable; equations that are linear
            in all variables need none.
        scale: Size of the variable: its error counts in parts of the larger of it and
            the variable.
    """

    equation: Expression
    start: Expression = "0"
    scale: Quantity = "1"


AlgebraicPart = Annotated[
    Annotated[Equation, Tag("of equation")] | Annotated[Expression, Tag("of text")],
    chosen("equation", "equation"),
]
"""Of an algebraic variable: an equation, or its expression alone."""


def equation_of(given: Equation | str) -> Equation:
    """Return an equation; of an expression alone all else is by default."""
    return Equation(equation=given) if isinstance(given, str) else given


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
    chosen("distance", "expression"),
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


class Collocation(Part):
    """Radau collocation in the polish.

    Attributes:
        points: Collocation points in an element.
        elements: Elements from check to check; by default as many as `substeps`.
    """

    points: int = Field(default=3, ge=1, le=9)
    elements: Annotated[int, Field(ge=1, le=1000)] | None = None


TranscriptionPart = Annotated[
    Annotated[Collocation, Tag("of points")] | Annotated[Transcription, Tag("of text")],
    chosen("points", "points"),
]
"""A name, or collocation with its numbers."""


def _without_required(schema: dict[str, Any]) -> None:
    """Take from a schema what is required: phases say what the intervals are."""
    schema.pop("required", None)


class Prediction(Part):
    """The horizon and its grid.

    Attributes:
        horizon_s: Its length; left out in discrete time, where an interval lasts 1.
        blocks: Lengths of blocks of intervals with one control each; by default each
            interval has its own.
        transcription: Of the polish: `shooting`, `radau`, or its numbers.
        newton_iterations: For algebraic equations that are not linear.
        control_shape: Whether controls are held, or linear between knots; of
            "continuous" ones the first knot is the control before.
    """

    model_config = ConfigDict(json_schema_extra=_without_required)

    horizon_s: Horizon | None = None
    intervals: int = Field(ge=1, le=10_000)
    blocks: list[Annotated[int, Field(ge=1)]] = Field(default_factory=list)
    checks: Checks = 1
    substeps: int = Field(default=4, ge=1, le=1000)
    integrator: Integrator = "rk4"
    transcription: TranscriptionPart = "shooting"
    integrator_tolerance: float | None = Field(default=1e-6, ge=FINEST, le=COARSEST)
    quadrature: Quadrature = "integral"
    newton_iterations: int = Field(default=10, ge=1, le=100)
    control_shape: ControlShape = "constant"
    tolerance: Positive = 1e-6
    path_tolerance: Positive = 1e-4

    @property
    def collocation(self) -> Transcription | Radau:
        """The transcription, as a problem takes it."""
        if isinstance(self.transcription, Collocation):
            return Radau(**self.transcription.model_dump())
        return self.transcription

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

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe it as it may be written: as a mapping, or as its law alone."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        law = schema["properties"]["law"]["enum"]
        schema["anyOf"] = [{"type": schema.pop("type")}, {"enum": law}]
        return schema


class Noise(Part):
    """Random numbers, a new one in each of the plant's steps."""

    deviation: Quantity
    seed: int = Field(default=0, ge=0, lt=2**32)


Disturbance = Annotated[
    Annotated[Noise, Tag("of deviation")]
    | Annotated[Table, Tag("of table")]
    | Annotated[Expression, Tag("of text")],
    chosen("deviation", "table"),
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
