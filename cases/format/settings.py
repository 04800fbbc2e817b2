"""The parts of a scenario that every kind of scenario shares, as pydantic models.

All are strict and frozen, and refuse unknown keys. A number may be written as an
expression, `pi/18`.
"""

import dataclasses
import types
from collections.abc import Iterator, Mapping, Sequence
from pkgutil import resolve_name
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    WithJsonSchema,
    create_model,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from swarmstart.cases.format.expressions import evaluate
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import (
    Box,
    Budget,
    Order,
    Sampling,
    default_algorithm,
    epsilon_level,
    feasibility_first,
    static_penalty,
)
from swarmstart.ocp import (
    Backend,
    IpoptOptions,
    Multistart,
    SearchAlgorithm,
    SearchSettings,
    WarmStart,
    When,
    population_of,
)

Array = NDArray[np.float64]
LocatedFlaw = tuple[tuple[str | int, ...], str | SwarmstartError]
"""Where in the scenario something is wrong, and what; an expression's error has a
column of its own."""


LARGEST = 1e30
"""Largest magnitude of a number: its powers are still finite."""
MOST_LANES = 100_000
"""Random starts that are solved at once."""
MOST_INDIVIDUALS = 200_000
"""Of a search's population."""


def _number(value: object) -> object:
    """Compute an expression; leave everything else to pydantic."""
    return evaluate(value) if isinstance(value, str) else value


Number = Annotated[
    float,
    BeforeValidator(_number),
    Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST),
    WithJsonSchema(
        {"type": ["number", "string"], "description": "A number, or as in pi/18."}
    ),
]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]


class Part(BaseModel):
    """A mapping of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Range(Part):
    """An interval, written as a list of two: [lower, upper]."""

    lower: Number
    upper: Number

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, value: object) -> object:
        if not isinstance(value, list) or len(value) != len(cls.model_fields):
            raise ValueError(
                f"expected a list of two numbers, [lower, upper]; found {value}"
            )
        return {"lower": value[0], "upper": value[1]}

    @model_serializer
    def _as_list(self) -> list[float]:
        return [self.lower, self.upper]

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe it as it is written: a list of two."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        entry = schema.get("properties", {}).get("lower", {"type": "number"})
        entry.pop("title", None)
        schema.clear()
        schema.update(
            type="array",
            items=entry,
            minItems=2,
            maxItems=2,
            description="An interval: [lower, upper].",
        )
        return schema

    @model_validator(mode="after")
    def _ordered(self) -> "Range":
        if not self.lower < self.upper:
            raise ValueError(
                f"expected lower < upper, found [{self.lower:g}, {self.upper:g}]"
            )
        return self


def bounds_of(ranges: Sequence[Range]) -> tuple[Array, Array]:
    """Return the lower and the upper limits of n ranges, each (n,)."""
    return np.array([r.lower for r in ranges]), np.array([r.upper for r in ranges])


class GridPart(Part):
    """The horizon of a plan and its grid; a kind may add `checks` and `integrator`."""

    horizon_s: Positive
    intervals: int = Field(default=1, ge=1, le=1000)
    substeps: int = Field(default=1, ge=1, le=100)

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.horizon_s / self.intervals

    def grid(self) -> dict[str, Any]:
        """Return the grid as a planning problem takes it."""
        keys = {"intervals", "substeps", "checks", "integrator"}
        return {"horizon": self.horizon_s, **self.model_dump(include=keys)}


Checks = Annotated[int, Field(ge=1, le=100)]


class BudgetPart(Part):
    """Budget of the search for one planning problem; whichever limit comes first."""

    evaluations: int | None = Field(default=None, ge=1, lt=2**62)
    seconds: Positive | None = None
    target: Number | None = None
    stagnation: int | None = Field(default=None, ge=1, lt=2**62)

    @model_validator(mode="after")
    def _some(self) -> "BudgetPart":
        if self.evaluations is None and self.seconds is None:
            raise ValueError("expected evaluations, seconds or both; found neither")
        return self

    def budget(self) -> Budget:
        """Return the budget as the search takes it."""
        return Budget(**self.model_dump())


class OrderPart(Part):
    """The order of individuals."""

    name: Literal["static_penalty", "feasibility_first", "epsilon_level"]
    weight: Positive = 1e4

    def order(self) -> Order:
        """Return the order as the search takes it."""
        if self.name == "static_penalty":
            return static_penalty(self.weight)
        if self.name == "epsilon_level":
            return epsilon_level()
        return feasibility_first()


class IpoptPart(Part):
    """Options of IPOPT if `polish: ipopt`."""

    max_iterations: int = Field(default=300, ge=1)
    tolerance: Positive = 1e-8
    options: dict[str, bool | int | float | str] = Field(
        default_factory=dict,
        description="Other options of IPOPT by their own names, e.g. mu_strategy.",
    )

    def told(self) -> IpoptOptions:
        """Return the options as the polish takes them."""
        return IpoptOptions(
            max_iterations=self.max_iterations,
            tolerance=self.tolerance,
            options=self.options,
        )


class SearchPart(Part):
    """A search with its settings; see `search_part`."""

    name: str
    warm_start: WarmStart
    sampling: Sampling | None
    when: When

    @model_validator(mode="after")
    def _makes_settings(self) -> "SearchPart":
        try:
            self.algorithm()
        except SwarmstartError as error:
            raise ValueError(str(error)) from error
        return self

    def algorithm(self, evaluations: int | None = None) -> SearchAlgorithm | None:
        """Return the algorithm's settings; None where the search is `none`.

        Args:
            evaluations: The budget, which decides what `default` is; None: none.
        """
        if self.name == "none":
            return None
        if self.name == "default":
            return default_algorithm(evaluations)
        settings: SearchAlgorithm = resolve_name(SEARCHES[self.name].settings)(
            **self.model_dump(exclude={"name", "warm_start", "sampling", "when"})
        )
        return settings


def _yaml_type(hint: Any) -> Any:
    """Return the type that a key of a scenario has for a setting's type hint."""
    if hint is float:
        return Number
    if get_origin(hint) in (Union, types.UnionType):
        members = {_yaml_type(member) for member in get_args(hint)}
        return Union[tuple(members)]  # noqa: UP007 - the members are known at run time
    if hint in (bool, int, str, type(None)) or get_origin(hint) is Literal:
        return hint
    return list[Number]  # Sequences and arrays of numbers.


def search_part(name: str) -> type[SearchPart]:
    """Return the model of a search: its settings dataclass, key by key."""
    entry = SEARCHES[name]
    keys: dict[str, Any] = {
        "name": (Literal[name], ...),
        "warm_start": (WarmStart, entry.warm_start),
        "sampling": (Sampling | None, entry.sampling),
        "when": (When, "needed"),
    }
    if entry.settings:
        settings = resolve_name(entry.settings)
        hints = get_type_hints(settings)
        for setting in dataclasses.fields(settings):
            keys[setting.name] = (_yaml_type(hints[setting.name]), setting.default)
    return create_model(
        f"Search_{name}", __base__=SearchPart, __doc__=entry.title, **keys
    )


if TYPE_CHECKING:
    AnySearch = SearchPart
else:
    AnySearch = Annotated[
        Union[tuple(search_part(name) for name in SEARCHES)],  # noqa: UP007 - as above
        Field(discriminator="name"),
    ]


class Searching(Part):
    """A search alone, checked as a scenario's is."""

    search: AnySearch


class Claim(Part):
    """A published claim, and how a run judges it.

    Attributes:
        id: Its number in the list of the chapter's claims; a letter for its parts.
        text: What is claimed.
        source: Where.
        measure: The name of a measure of the run.
        relation: How the measure must relate to the bound.
        bound: A number; null, with "==", if "not defined" (never settled) is what is
            claimed.
        width: With "==", by how much the measure may differ from the bound.
        when: Settings, dotted key to value, under which a run can judge it; the
            scenario's own `steps` unless others are given.
        variant: The variant that it is judged with; empty: any.
        against: Settings of a second run, same seed: then the measure is divided by
            that of the second run, and one run alone cannot judge.
        share: Part of the seeds in which it must hold.
        gate: Whether the command fails (exit code 3) when it does not hold.
        note: What the reader ought to know.
    """

    id: str
    text: str
    source: str
    measure: str
    relation: Literal["<=", ">=", "<", ">", "=="]
    bound: Number | None
    width: NonNegative = 0.0
    when: Mapping[str, Any] = Field(default_factory=dict)
    variant: str = ""
    against: Mapping[str, Any] | None = None
    share: Annotated[Number, Field(gt=0, le=1)] = 1.0
    gate: bool = False
    note: str = ""

    @model_validator(mode="after")
    def _null_is_compared_with_equal(self) -> "Claim":
        if self.bound is None and self.relation != "==":
            raise ValueError(
                f"expected relation == with the bound null, found {self.relation}"
            )
        if self.width and (self.bound is None or self.relation != "=="):
            raise ValueError("expected width with relation == and a number as bound")
        return self


class Scenario(Part):
    """The keys that every kind of scenario has."""

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: str
    title: str
    source: str = ""
    steps: int = Field(ge=1, le=1_000_000)
    search: AnySearch
    budget: BudgetPart
    order: OrderPart | None = None
    polish: Literal["none", "ipopt"] = "none"
    ipopt: IpoptPart = IpoptPart()
    basins: int = Field(default=0, ge=0, le=10_000)
    lanes: int | None = Field(default=None, ge=0, le=MOST_LANES)
    backend: Backend = "auto"
    claims: list[Claim] = Field(default_factory=list)

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield what one part of the scenario makes wrong in another."""
        if self.search.name == "none" and self.polish == "none":
            yield ("search",), "expected a search, a polish or both; found neither"
        if isinstance(self.search.algorithm(), Multistart) and self.search.sampling:
            what = f"expected no sampling with multistart, found {self.search.sampling}"
            yield ("search", "sampling"), what
        if self.lanes and self.polish == "none":
            yield ("lanes",), "expected lanes with polish: ipopt, found none"
        evaluations, size = self.budget.evaluations, self._smallest_generation()
        if size > MOST_INDIVIDUALS:
            yield (
                ("search", "size"),
                f"expected at most {MOST_INDIVIDUALS} individuals; found {size}",
            )
        elif evaluations is not None and evaluations < size:
            yield (
                ("budget", "evaluations"),
                f"expected at least {size}, one generation of the search; "
                f"found {evaluations}",
            )

    def _smallest_generation(self) -> int:
        """Return the size of the search's first generation, in one dimension."""
        part: SearchPart = self.search
        evaluations = self.budget.evaluations
        algorithm = part.algorithm(evaluations)
        if algorithm is None:
            return 1
        population = population_of(algorithm, evaluations)
        if population is None:
            return 1
        line = Box(lower=np.zeros(1), upper=np.ones(1))
        return population.first_size(line, evaluations)

    def random_starts(self) -> int:
        """Return the number of random starts that are solved in lanes."""
        return self.lanes or 0

    def polish_options(self) -> IpoptOptions | None:
        """Return the polish as a planner takes it; None where it is `none`."""
        return self.ipopt.told() if self.polish == "ipopt" else None

    def search_settings(self) -> SearchSettings | None:
        """Return the search as a planner takes it; None where it is `none`."""
        part: SearchPart = self.search
        algorithm = part.algorithm(self.budget.evaluations)
        if algorithm is None:
            return None
        return SearchSettings(
            algorithm=algorithm,
            budget=self.budget.budget(),
            order=None if self.order is None else self.order.order(),
            warm_start=part.warm_start,
            sampling=part.sampling,
            basins=self.basins,
            when=part.when,
        )
