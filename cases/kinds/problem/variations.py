"""Parts of a scenario that vary its problem: uncertain parameters, and phases."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, Tag, field_serializer, model_validator

from swarmstart.cases.format.settings import Part
from swarmstart.cases.kinds.problem.parts import (
    AlgebraicPart,
    Constraint,
    Control,
    PathPart,
    State,
)
from swarmstart.cases.kinds.problem.values import (
    Expression,
    Horizon,
    Names,
    Quantity,
    chosen,
)
from swarmstart.ocp.risk import Measure

MOST_MEMBERS = 1000
"""Sets of values of uncertain parameters."""
Pair = Annotated[list[Quantity], Field(min_length=2, max_length=2)]


class Normal(Part):
    """Normal numbers: [mean, deviation]."""

    normal: Pair

    @property
    def pair(self) -> tuple[str, list[str]]:
        """Its name and its two numbers."""
        return "normal", self.normal


class Uniform(Part):
    """Numbers that are as likely everywhere in [lower, upper]."""

    uniform: Pair

    @property
    def pair(self) -> tuple[str, list[str]]:
        """Its name and its two numbers."""
        return "uniform", self.uniform


Law = Annotated[
    Annotated[Normal, Tag("of normal")] | Annotated[Uniform, Tag("of uniform")],
    chosen("normal", "uniform"),
]
"""What a number is drawn by."""


class Uncertain(Part):
    """Several values of parameters, for which one control sequence is planned.

    What is simulated has the value that the parameter itself is given.

    Attributes:
        values: By parameter: one value for each member.
        drawn: By parameter: what a value is drawn by, in place of `values`.
        samples: Number of members that are drawn.
        seed: Of the drawn numbers.
        weights: Of the members; by default equal.
        risk: Which cost counts: the mean of the members' costs, the worst, or the mean
            of the worst part of them.
        level: Of "cvar": that part is 1 - level.
        robust_horizon: Number of intervals after which each member has controls of its
            own; by default none has.
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
    """One of several phases, one after another: what is other than in the file.

    Attributes:
        name: In names of measures; its number, from 1, unless given.
        horizon_s: Its length [s], or decided.
        intervals: Number of its control intervals.
        constants: In place of, or besides, the file's.
        definitions: Likewise.
        states: Likewise, key by key; null: there is no such state in this phase.
        controls: Likewise.
        algebraic: Likewise.
        stage_cost: In place of the file's.
        step_cost: In place of the file's.
        terminal_cost: At the end of this phase.
        path: Besides the file's, which hold in all phases.
        terminal: At the end of this phase.
        linkage: By state of the next phase: what the end of this one makes of it; other
            states go on.
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
        """Return what is laid over the file: no default hides what the file says."""
        return {
            name: None
            if part is None
            else part.model_dump(mode="json", exclude_unset=True)
            for name, part in parts.items()
        }
