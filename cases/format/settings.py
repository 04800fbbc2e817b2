"""The parts of a scenario that all kinds of scenario share, as pydantic models.

All are strict and frozen, and refuse unknown keys. A number can be written as an
expression, such as `pi/18`.
"""

import contextlib
import dataclasses
import re
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

from swarmstart.arrays import Array
from swarmstart.cases.format.descriptions import attributes_of, summary_of
from swarmstart.cases.format.expressions import (
    CONSTANTS,
    ExpressionError,
    evaluate,
)
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.cases.format.silence import silenced
from swarmstart.cases.format.solver_options import refused
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
    INTEGRATORS,
    Backend,
    InvalidProblemError,
    IpoptOptions,
    Multistart,
    NlpOptions,
    SearchAlgorithm,
    SearchSettings,
    WarmStart,
    When,
    population_of,
)
from swarmstart.ocp.nlp import check_solver, has_solver

if TYPE_CHECKING:
    IntegratorName = str
else:  # Read here, so that integrators registered before are known.
    IntegratorName = Literal[tuple(INTEGRATORS)]
LocatedFlaw = tuple[tuple[str | int, ...], str | SwarmstartError]
"""Path of an error in the scenario, and the error.

The error of an expression has a column of its own.
"""


LARGEST = 1e30
"""Largest magnitude of a number: its powers are still finite."""
MOST_LANES = 100_000
"""Largest number of random starts that are solved at once."""
MOST_INDIVIDUALS = 200_000
"""Largest number of individuals in the population of a search."""


_WITH_UNIT = re.compile(
    r"\s*(?P<number>[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)"
    r"\s*(?P<unit>[^\W\d_][\w/^*²³·-]*|[°%])\s*"
)


def _number(value: object) -> object:
    """Return the value of an expression; leave everything else to pydantic."""
    if not isinstance(value, str):
        return value
    try:
        return evaluate(value)
    except ExpressionError as error:
        unit = _WITH_UNIT.fullmatch(value)
        if unit is None or unit["unit"] in CONSTANTS:
            raise
        degrees = unit["number"] if unit["unit"].startswith(("deg", "°")) else "90"
        raise ExpressionError(
            f"expected a number without a unit; for degrees: radians({degrees})",
            value,
            unit.start("unit") + 1,
        ) from error


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

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe every key as the docstrings do, under "Attributes:"."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        if cls.__doc__:
            schema["description"] = summary_of(cls.__doc__)
        texts, keys = attributes_of(cls), schema.get("properties", {})
        for name, field in cls.model_fields.items():
            key = keys.get(field.alias or name)
            if key is not None and name in texts:
                key["description"] = field.description or texts[name]
        return schema


class Range(Part):
    """An interval, written as a list of two: [lower, upper].

    Attributes:
        lower: Lower limit, in the unit of the key.
        upper: Upper limit, in the unit of the key, above the lower one.
    """

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
        """Describe the form in which it is written: a list of two."""
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
    """Horizon of a plan and its grid; a kind can add `checks` and `integrator`.

    Attributes:
        horizon_s: Length of the horizon of a plan [s].
        intervals: Number of control intervals in the horizon.
        substeps: Number of integrator steps from one check of the constraints to the
            next.
    """

    horizon_s: Positive
    intervals: int = Field(default=1, ge=1, le=1000)
    substeps: int = Field(default=1, ge=1, le=100)

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.horizon_s / self.intervals

    def grid(self) -> dict[str, Any]:
        """Return the arguments of a planning problem for the grid."""
        keys = {"intervals", "substeps", "checks", "integrator"}
        return {"horizon": self.horizon_s, **self.model_dump(include=keys)}


Checks = Annotated[int, Field(ge=1, le=100)]


class BudgetPart(Part):
    """Budget of the search for one planning problem; the first limit reached counts.

    Attributes:
        evaluations: Largest number of trajectories that a search evaluates; null means
            no limit.
        seconds: Wall time after which no generation is started [s]; null means no
            limit.
        target: Cost at which a search stops once a feasible point reaches it; null
            means that it does not stop early.
        stagnation: Number of generations (for multistart: batches) without a better
            point after which a search stops; null means never.
    """

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
        """Return the budget for the search."""
        return Budget(**self.model_dump())


class OrderPart(Part):
    """Order of individuals: how the search weighs cost against violation.

    Attributes:
        name: Rule for comparing two individuals: cost plus weighted violation, feasible
            ones first, or the latter with a tolerance that shrinks.
        weight: Factor of the constraint violation in the cost, used by static_penalty
            only.
    """

    name: Literal["static_penalty", "feasibility_first", "epsilon_level"]
    weight: Positive = 1e4

    def order(self) -> Order:
        """Return the order for the search."""
        if self.name == "static_penalty":
            return static_penalty(self.weight)
        if self.name == "epsilon_level":
            return epsilon_level()
        return feasibility_first()


class IpoptPart(Part):
    """Options of IPOPT, used if `polish` is ipopt.

    Attributes:
        max_iterations: Largest number of iterations of IPOPT.
        tolerance: Convergence tolerance of the scaled problem, whose numbers are near
            1.
        options: Other options of IPOPT by their own names, such as mu_strategy.
    """

    max_iterations: int = Field(default=300, ge=1)
    tolerance: Positive = 1e-8
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)

    def told(self) -> IpoptOptions:
        """Return the options for the polish."""
        return IpoptOptions(
            max_iterations=self.max_iterations,
            tolerance=self.tolerance,
            options=self.options,
        )


class PolishPart(Part):
    """Another NLP solver of CasADi as the polish.

    Attributes:
        solver: Name of the solver in CasADi, such as sqpmethod.
        options: Options of the solver by its own names.
    """

    solver: str = Field(pattern=r"^[a-z][a-z0-9_]{0,40}$")
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)

    def told(self) -> NlpOptions:
        """Return the solver with its options."""
        return NlpOptions(plugin=self.solver, options=self.options)

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield an error if CasADi has no such solver, or it refuses an option."""
        if self.solver in _NOT_A_POLISH:
            yield ("solver",), _NOT_A_POLISH[self.solver]
            return
        beyond = [(("options", name), what) for name, what in refused(self.options)]
        yield from beyond
        if beyond:
            return
        try:
            with silenced():
                self._check()
        except SwarmstartError as error:
            yield ("solver",), str(error)

    def _check(self) -> None:
        """Raise if CasADi has no such solver, or it refuses an option."""
        if not has_solver(self.solver):
            raise InvalidProblemError(
                "expected none, ipopt or an NLP solver of CasADi that is installed, "
                f"such as sqpmethod; found {self.solver!r}"
            )
        check_solver(self.told())


_NOT_A_POLISH = {
    "ipopt": "expected polish: ipopt, with its options under ipopt; found a mapping",
    "fatrop": "expected a solver other than fatrop, which needs the stage structure of "
    "the problem: without it, as here, it takes up to 100 times as long as IPOPT",
}
"""Solvers of CasADi that are no polish by this key -> the reason."""


class UnusableSearchError(SwarmstartError):
    """A search that another package announces cannot be imported."""


def _settings_of(name: str) -> Any:
    """Return the class of a search's settings, a dataclass.

    Raises:
        UnusableSearchError: If the package that announces it has none there.
    """
    place = SEARCHES[name].settings
    try:
        settings = resolve_name(place)
    except (ImportError, AttributeError, ValueError) as error:
        raise UnusableSearchError(
            f"search {name}: expected settings at {place}, found {error}"
        ) from error
    if not dataclasses.is_dataclass(settings):
        raise UnusableSearchError(
            f"search {name}: expected a dataclass at {place}, found {settings!r}"
        )
    return settings


class SearchPart(Part):
    """A search with its settings; see `search_part`.

    Attributes:
        name: Name of the search algorithm.
        warm_start: Part of the first population that starts from the last plan: all,
            half, one individual or none.
        sampling: Method of drawing the rest of the first population; null means
            half_smooth.
        when: Plans that are searched if there is a polish: always all, or only those
            for which the polish of the last plan is not enough.
    """

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
        """Return the algorithm's settings; None if the search is `none`.

        Args:
            evaluations: The budget, on which `default` depends; None means no limit.
        """
        if self.name == "none":
            return None
        if self.name == "default":
            return default_algorithm(evaluations)
        settings: SearchAlgorithm = _settings_of(self.name)(
            **self.model_dump(exclude={"name", "warm_start", "sampling", "when"})
        )
        return settings


def _yaml_type(hint: Any) -> Any:
    """Return the type of a scenario's key for the type hint of a setting."""
    if hint is float:
        return Number
    if get_origin(hint) in (Union, types.UnionType):
        members = dict.fromkeys(map(_yaml_type, get_args(hint)))
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
    # `default` and `none` have no settings. A package whose search cannot be imported
    # must not stop the other searches: `algorithm` tells of it if it is named.
    with contextlib.suppress(UnusableSearchError):
        settings = _settings_of(name)
        hints, texts = get_type_hints(settings), attributes_of(settings)
        for setting in dataclasses.fields(settings):
            text = texts.get(setting.name, "").replace("None", "null")
            field = Field(setting.default, description=text or None)
            keys[setting.name] = (_yaml_type(hints[setting.name]), field)
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
    """A search alone, checked as the search of a scenario is.

    Attributes:
        search: Search algorithm and its settings.
    """

    search: AnySearch


class Claim(Part):
    """A published claim, and the rule by which a run judges it.

    Attributes:
        id: Number of the claim in the chapter's list, with a letter for its parts.
        text: Statement that is claimed.
        source: Place in the literature that makes the claim.
        measure: Name of the measure of the run that is compared with the bound.
        relation: Relation of the measure to the bound that the claim asserts.
        bound: Number that the measure is compared with; null, with "==" only, means
            that the measure is not defined (a time that never comes).
        width: Largest difference between measure and bound that still counts as equal,
            with "==" only.
        when: Settings, dotted key to value, of the runs that can judge the claim;
            without `steps` the run must be as long as the file says.
        variant: Variant of the scenario that can judge the claim; empty means any.
        against: Settings of a second run with the same seed, by whose measure that of
            the run is divided; null means no second run, and one run alone cannot judge
            a claim that has one.
        share: Part of the seeds, above 0 and at most 1, in which the claim must hold.
        gate: Option that makes the command end with exit code 3 if the claim does not
            hold.
        note: Remark for the reader.
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
    """The keys that every kind of scenario has.

    Attributes:
        schema_version: Version of the scenario format.
        name: Name of the folder of the results, up to 64 letters, digits, _ and -; by
            default the name of the file.
        kind: Kind of the scenario, which decides its other keys.
        title: Title of the scenario in one line.
        source: Origin of the scenario, such as a publication.
        steps: Number of control steps to simulate.
        search: Search algorithm and its settings.
        budget: Budget of the search for each planning problem.
        order: Order in which the search ranks feasible and infeasible individuals; null
            means the adaptive epsilon level.
        polish: Local solver that improves the answer of the search: IPOPT, none, or
            another NLP solver of CasADi with its options.
        ipopt: Options of IPOPT, used if `polish` is ipopt.
        basins: Number of further starting points for the polish: the best distinct
            basins that the search found, besides its best point.
        lanes: Number of random starts that are solved at once, beside the search, if
            there is no earlier plan; needs a polish, and null means the default of the
            kind.
        backend: Evaluator of populations: llvm is machine code, casadi its virtual
            machine, and auto follows SWARMSTART_BACKEND or else takes machine code if
            possible.
        claims: Claims that a run judges.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: str
    title: str
    source: str = ""
    steps: int = Field(ge=1, le=1_000_000)
    search: AnySearch
    budget: BudgetPart
    order: OrderPart | None = None
    polish: Literal["none", "ipopt"] | PolishPart = "none"
    ipopt: IpoptPart = IpoptPart()
    basins: int = Field(default=0, ge=0, le=10_000)
    lanes: int | None = Field(default=None, ge=0, le=MOST_LANES)
    backend: Backend = "auto"
    claims: list[Claim] = Field(default_factory=list)

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from self._polish_flaws()
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

    def _polish_flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors of the polish and its options."""
        for name, what in refused(self.ipopt.options):
            yield ("ipopt", "options", name), what
        if isinstance(self.polish, PolishPart):
            for place, wrong in self.polish.flaws():
                yield ("polish", *place), wrong

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

    def polish_options(self) -> IpoptOptions | NlpOptions | None:
        """Return the options of the polish for a planner; None if it is `none`."""
        if isinstance(self.polish, PolishPart):
            return self.polish.told()
        return self.ipopt.told() if self.polish == "ipopt" else None

    @property
    def polish_name(self) -> str:
        """Name of the polish: none, ipopt, or the name of another NLP solver."""
        return (
            self.polish.solver if isinstance(self.polish, PolishPart) else self.polish
        )

    def search_settings(self) -> SearchSettings | None:
        """Return the search for a planner; None if it is `none`."""
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
