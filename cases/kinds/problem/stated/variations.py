"""Parts of a scenario that vary its problem: uncertain parameters, and phases."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, Tag, field_serializer, model_validator

from swarmstart.cases.format.settings import Part
from swarmstart.cases.kinds.problem.stated.parts import (
    AlgebraicPart,
    Constraint,
    Control,
    PathPart,
    State,
)
from swarmstart.cases.kinds.problem.stated.values import (
    Expression,
    Horizon,
    Names,
    Quantity,
    chosen,
)
from swarmstart.ocp.statement import Measure

MOST_MEMBERS = 1000
"""Largest number of members, the sets of values of uncertain parameters."""
Pair = Annotated[list[Quantity], Field(min_length=2, max_length=2)]


class Normal(Part):
    """Normally distributed numbers: [mean, deviation].

    Attributes:
        normal: Mean and standard deviation of a normal distribution.
    """

    normal: Pair

    @property
    def pair(self) -> tuple[str, list[str]]:
        """Its name and its two numbers."""
        return "normal", self.normal


class Uniform(Part):
    """Uniformly distributed numbers in [lower, upper].

    Attributes:
        uniform: Lower and upper end of a uniform distribution.
    """

    uniform: Pair

    @property
    def pair(self) -> tuple[str, list[str]]:
        """Its name and its two numbers."""
        return "uniform", self.uniform


Law = Annotated[
    Annotated[Normal, Tag("of normal")] | Annotated[Uniform, Tag("of uniform")],
    chosen("normal", "uniform"),
]
"""Distribution of a drawn number."""


class Uncertain(Part):
    """Several values of parameters, for which one control sequence is planned.

    The simulated system has the value that the parameter itself is given.

    Attributes:
        values: Values by parameter: one for each member.
        drawn: Distributions by parameter, from which the values are drawn, in place of
            `values`.
        samples: Number of members that are drawn; null if `values` are given.
        seed: Seed of the drawn numbers.
        weights: Weights of the members; null means equal ones.
        risk: Cost that counts: the mean of the members' costs, the worst one, or (cvar)
            the mean of the worst part of them.
        level: Level of cvar: the worst part is 1 - level of the members.
        robust_horizon: Number of intervals after which each member has controls of its
            own; null means that all members share all controls.
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
