"""The parts of the scenario of a problem: states, controls, constraints, the grid."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    Tag,
    create_model,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from swarmstart.cases.format.parts import Checks, Part, Positive
from swarmstart.cases.format.settings import IntegratorName
from swarmstart.cases.kinds.problem.stated.values import (
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
from swarmstart.ocp.integration import (
    COARSEST,
    FINEST,
    Radau,
    Transcription,
)
from swarmstart.ocp.statement import FEATURES, Appended, ControlShape, Quadrature

MOST_NODES = 10_000
"""Largest number of checks in a horizon."""


class State(Part):
    """A state: its start, and the law by which it changes.

    Attributes:
        start: Value at the start: a number, or decided by the plan; null if every
            vehicle has its own.
        rate: Derivative in time, an expression [unit/s]; null means 0, but one of
            `rate` and `next` is required.
        next: Value that the state gets at the end of each control interval, an
            expression; null means that it stays as it is.
        periodic: Option that makes the state end at the value at which it starts.
        bounds: Bounds [lower, upper], numbers or expressions, kept at every check of a
            plan; null means no limit.
        scale: Typical size of the value, above 0, which scales the problem for the
            solver; null means that it is found from the problem.
        unit: Unit, as text for prints, figures and records.
    """

    start: Start | None = None
    rate: Expression | None = None
    next: Expression | None = None
    periodic: bool = False
    bounds: MovingLimits | None = None
    scale: Quantity | None = None
    unit: str = ""


_Features = create_model(
    "_Features",
    __base__=Part,
    __doc__="\n    ".join(
        ["Features of a control.\n\nAttributes:"]
        + [f"{key}: {feature.meaning}" for key, feature in FEATURES.items()]
    ),
    **{key: (Quantity | None, None) for key in FEATURES},  # type: ignore[call-overload]
)
"""Keys of a control that are features of the problem, one for each registered."""


class Control(_Features):  # type: ignore[misc, valid-type]
    """A control and its bounds.

    Attributes:
        bounds: Bounds [lower, upper], numbers or expressions; null means no limit, and
            a search needs both limits.
        search_bounds: Narrower bounds [lower, upper], numbers, for the search alone,
            which needs them if `bounds` move; null means the bounds themselves.
        previous: Value in the interval before the first; null means the value nearest
            to 0 within the bounds.
        integer: Option that allows whole numbers only; the bounds are then whole
            numbers, too.
        scale: Typical size of the value, above 0, which scales the problem for the
            solver; null means that it is found from the problem.
        unit: Unit, as text for prints, figures and records.
    """

    bounds: MovingLimits | None = None
    search_bounds: Limits | None = None
    previous: Quantity | None = None
    integer: bool = False
    scale: Quantity | None = None
    unit: str = ""


class Equation(Part):
    """An algebraic equation, which is stated for one of the algebraic variables.

    Attributes:
        equation: Expression that must be 0.
        start: Expression at which Newton's method starts for the variable, not needed
            for linear equations.
        scale: Size of the variable: its error counts relative to the larger of this
            size and the variable.
    """

    equation: Expression
    start: Expression = "0"
    scale: Quantity = "1"


AlgebraicPart = Annotated[
    Annotated[Equation, Tag("of equation")] | Annotated[Expression, Tag("of text")],
    chosen("equation", otherwise="equation"),
]
"""An algebraic variable: an equation, or its expression alone."""


def equation_of(given: Equation | str) -> Equation:
    """Return an equation; an expression alone gets the defaults of the other keys."""
    return Equation(equation=given) if isinstance(given, str) else given


class Constraint(Part):
    """A constraint: lower <= expression <= upper, or `equals`.

    Attributes:
        expression: Expression that is limited; without any limit it must be 0.
        lower: Lower limit of the expression; null means no limit.
        upper: Upper limit of the expression; null means no limit.
        equals: Value that the expression must have, in place of limits; null means that
            the limits count.
        scale: Excess that counts as a violation of 1; null means that it is found from
            the problem.
        name: Name of the constraint in figures and messages.
    """

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
    """Weights of a soft constraint, which can be broken at a cost.

    Attributes:
        weight: Cost per second, and per unit of the largest excess in each interval;
            null means 0, but one of the two weights is required.
        quadratic: Cost per second, and per squared unit of this excess; null means 0.
    """

    weight: Quantity | None = None
    quadratic: Quantity | None = None

    @model_validator(mode="after")
    def _has_weight(self) -> "Soft":
        if (self.weight, self.quadratic) == (None, None):
            raise ValueError("expected weight, quadratic or both; found neither")
        return self


class PathLimit(Constraint):
    """A constraint along the path, which can be soft.

    Attributes:
        soft: Weights of the cost of breaking the constraint; null means that the
            constraint must hold. The measure `flown_cost` does not include this cost.
    """

    soft: Soft | None = None


class Distance(Part):
    """A distance to keep from a point or from another moving object.

    Attributes:
        distance: One to three coordinates relative to the point, expressions, whose
            distance from 0 is limited.
        at_least: Smallest allowed distance; null if `at_most` is given.
        at_most: Largest allowed distance; null if `at_least` is given.
        margin: Reserve that plans keep from the limit.
        along: Places at which distances are checked: the check points, or (in the
            search) also the straight segments between them.
        measure: Measure of a violation: excess counts the missing distance, indicator
            counts 1 for each check that is too near.
        scale: Excess that counts as a violation of 1; null means that it is found from
            the problem.
        name: Name of the constraint in figures and messages.
    """

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
    chosen("distance", otherwise="expression"),
]


def _with_record(schema: dict[str, Any]) -> None:
    """Add the folder of a record, which no field of the part has."""
    schema["properties"]["record"] = {
        "type": "string",
        "default": "",
        "description": "Folder of a run, or of `solution.save(folder)`, whose first "
        "plan is the guess, in place of controls and states; not with vehicles.",
    }


class Guess(Part):
    """Start of the first plan.

    The folder of a record is replaced by its first plan when the scenario is read.

    Attributes:
        controls: Controls by name: numbers, expressions in time, or tables; 0 for those
            not given.
        states: States by name, likewise, which only a polish uses.
    """

    model_config = ConfigDict(json_schema_extra=_with_record)

    controls: Mapping[Names, OverTime] = Field(default_factory=dict)
    states: Mapping[Names, OverTime] = Field(default_factory=dict)


class Collocation(Part):
    """Radau collocation in the polish.

    Attributes:
        points: Number of collocation points in an element.
        elements: Number of elements from one check to the next; null means as many as
            `substeps`.
    """

    points: int = Field(default=3, ge=1, le=9)
    elements: Annotated[int, Field(ge=1, le=1000)] | None = None


TranscriptionPart = Annotated[
    Annotated[Collocation, Tag("of points")] | Annotated[Transcription, Tag("of text")],
    chosen("points", otherwise="points"),
]
"""A name, or collocation with its numbers."""


def _without_required(schema: dict[str, Any]) -> None:
    """Remove the required keys from a schema, since phases can give the intervals."""
    schema.pop("required", None)


class Prediction(Part):
    """The horizon and its grid.

    Attributes:
        horizon_s: Length of the horizon [s], or decided by the plan; null in discrete
            time, in which an interval lasts 1, and with phases, which have their own.
        intervals: Number of control intervals in the horizon. It is required without
            phases; with phases it is the sum of their intervals.
        blocks: Lengths of blocks of intervals that share one value of each control,
            whose sum is `intervals`; empty means that every interval has its own.
        checks: Number of checks of the constraints in a control interval.
        substeps: Number of integrator steps from one check to the next. The stiff
            integrator chooses its own number of steps; this is then the number
            expected.
        integrator: Integrator: fourth-order Runge-Kutta, Euler, or one for stiff
            models, which have very fast modes.
        transcription: Transcription in the polish: shooting, radau for collocation, or
            a mapping with the numbers of collocation.
        integrator_tolerance: Allowed error of each step of the stiff integrator,
            relative to the size of the states so far; null means that it makes
            `substeps` equal steps instead of choosing them.
        quadrature: Integration of the stage cost: its integral, or its value at the
            left or right end of an interval times the length.
        newton_iterations: Number of Newton iterations for algebraic equations that are
            not linear.
        control_shape: Shape of controls: constant in an interval, linear between knots
            with a decided first knot, or continuous, which is linear with the previous
            control as its first knot.
        tolerance: Largest summed violation of a feasible plan, relative to the scales.
        path_tolerance: Largest excess on the finely integrated path of a confirmed
            plan, relative to the scales.
    """

    model_config = ConfigDict(json_schema_extra=_without_required)

    horizon_s: Horizon | None = None
    intervals: int = Field(ge=1, le=10_000)
    blocks: list[Annotated[int, Field(ge=1)]] = Field(default_factory=list)
    checks: Checks = 1
    substeps: int = Field(default=4, ge=1, le=1000)
    integrator: IntegratorName = "rk4"
    transcription: TranscriptionPart = "shooting"
    integrator_tolerance: float | None = Field(default=1e-6, ge=FINEST, le=COARSEST)
    quadrature: Quadrature = "integral"
    newton_iterations: int = Field(default=10, ge=1, le=100)
    control_shape: ControlShape = "constant"
    tolerance: Positive = 1e-6
    path_tolerance: Positive = 1e-4

    @property
    def collocation(self) -> Transcription | Radau:
        """The transcription as an argument of a problem."""
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
        law: Law of control: open_loop follows one plan to its end, receding_horizon
            plans again in every interval.
        period_s: Time from one plan to the next [s]: required in a receding horizon
            with a decided end time; if `ends_at_s` is given, it may be null, which
            means one control interval; in all other cases it must be null.
        ends_at_s: Time at which a receding horizon ends [s]: plans end there and not
            later, so that they become shorter; null means that they all have the same
            length.
        last_plan: Starting point of planning: the last plan shifted by one interval, or
            as it is.
        append: Controls at the end of the shifted plan: zero, or the last ones again.
        within_s: Wall time for one plan in a receding horizon [s], after which the best
            plan so far is applied; results then depend on the speed of the machine, and
            lanes are not used; null means no limit.
        repair: Option to solve an open-loop plan again with a margin if it breaks a
            constraint between checks.
    """

    law: Literal["open_loop", "receding_horizon"] = "open_loop"
    period_s: Positive | None = None
    ends_at_s: Positive | None = None
    last_plan: Literal["shifted", "unshifted"] = "shifted"
    append: Appended = "zero"
    within_s: Positive | None = None
    repair: bool = True

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, value: object) -> object:
        return {"law": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _has_steps(self) -> "Feedback":
        for key in ("within_s", "ends_at_s"):
            if getattr(self, key) is not None and self.law == "open_loop":
                raise ValueError(
                    f"expected {key} with law: receding_horizon, which plans at each "
                    "step; found open_loop"
                )
        return self

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe both forms: a mapping, or the law alone."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        law = schema["properties"]["law"]["enum"]
        schema["anyOf"] = [{"type": schema.pop("type")}, {"enum": law}]
        return schema


class Noise(Part):
    """Random numbers, a new one in each of the plant's steps.

    Attributes:
        deviation: Standard deviation of the noise [unit/s].
        seed: Seed of the noise.
    """

    deviation: Quantity
    seed: int = Field(default=0, ge=0, lt=2**32)


Disturbance = Annotated[
    Annotated[Noise, Tag("of deviation")]
    | Annotated[Table, Tag("of table")]
    | Annotated[Expression, Tag("of text")],
    chosen("deviation", otherwise="table"),
]


class PlantPart(Part):
    """The simulated system: finer steps, parameters of its own, disturbances.

    Attributes:
        substeps: Number of integrator steps of the simulation in a control interval; at
            least `prediction.intervals` in a receding horizon whose end is decided or
            fixed.
        parameters: Values of parameters that differ from those of the prediction, by
            name.
        disturbance: Disturbance added to the rate of a state, by state: an expression
            in time, a table or noise [unit/s].
    """

    substeps: int = Field(default=20, ge=1, le=10_000)
    parameters: Mapping[Names, OverTime] = Field(default_factory=dict)
    disturbance: Mapping[Names, Disturbance] = Field(default_factory=dict)


class DualMode(Part):
    """A linear law within a certified terminal set around a state at rest.

    Attributes:
        at: Reference state, a number for every state.
        Q: Weights of the squared states, by state; 0 for those not given.
        R: Weights of the squared controls, one for every control.
    """

    at: Mapping[Names, Quantity]
    Q: Mapping[Names, Quantity]
    R: Mapping[Names, Quantity]
