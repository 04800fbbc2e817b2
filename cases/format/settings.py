"""The keys of a scenario that all kinds share: search, polish, claims.

The models of searches are made from the settings dataclasses of the registry, key by
key, so that a search of another package has its keys in scenarios, too.
"""

import contextlib
import dataclasses
import types
from collections.abc import Iterator, Mapping
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
    Field,
    create_model,
    model_validator,
)

from swarmstart.cases.format.foreign_solvers import refused
from swarmstart.cases.format.parts import (
    BudgetPart,
    NonNegative,
    Number,
    OrderPart,
    Part,
    Positive,
    attributes_of,
)
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import (
    Box,
    Sampling,
    default_algorithm,
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
from swarmstart.silence import silenced

if TYPE_CHECKING:
    IntegratorName = str
else:  # Read here, so that integrators registered before are known.
    IntegratorName = Literal[tuple(INTEGRATORS)]


LocatedFlaw = tuple[tuple[str | int, ...], str | SwarmstartError]
"""Path of an error in the scenario, and the error.

The error of an expression has a column of its own.
"""
MOST_LANES = 100_000
"""Largest number of random starts that are solved at once."""
MOST_INDIVIDUALS = 200_000
"""Largest number of individuals in the population of a search."""


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
        """Return the options in the form that the polish takes."""
        return IpoptOptions(
            max_iterations=self.max_iterations,
            tolerance=self.tolerance,
            options=self.options,
        )


class PolishPart(Part):
    """An NLP solver of CasADi other than IPOPT, used as the polish.

    Attributes:
        solver: Name of the solver in CasADi, such as sqpmethod.
        options: Options of the solver by its own names.
    """

    solver: str = Field(pattern=r"^[a-z][a-z0-9_]{0,40}$")
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)

    def told(self) -> NlpOptions:
        """Return the solver and its options in the form that the polish takes."""
        return NlpOptions(plugin=self.solver, options=self.options)

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield an error if CasADi has no such solver, or it refuses an option."""
        if self.solver in _NOT_A_POLISH:
            yield ("solver",), _NOT_A_POLISH[self.solver]
            return
        beyond = [(("options", name), what) for name, what in refused(self.options)]
        yield from beyond
        # Not tried with CasADi: making the solver would already obey such an option.
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
        when: Plans that are searched if there is a polish: all of them (always); the
            first plan, and those for which the polish of the last plan is not enough
            (needed); or as with needed, but without the first plan if polishes from
            simple starts and local solves from random starts agree on it (undecided).
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
            evaluations: Budget of evaluations, on which the search `default` depends;
                None means no limit.
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
    # Expressions are allowed for every number of a scenario.
    if hint is float:
        return Number
    if get_origin(hint) in (Union, types.UnionType):
        members = dict.fromkeys(map(_yaml_type, get_args(hint)))
        return Union[tuple(members)]  # noqa: UP007 - the members are known at run time
    if hint in (bool, int, str, type(None)) or get_origin(hint) is Literal:
        return hint
    return list[Number]  # Sequences and arrays of numbers.


def search_part(name: str) -> type[SearchPart]:
    """Return the pydantic model of a search, with the keys of its settings class."""
    entry = SEARCHES[name]
    keys: dict[str, Any] = {
        "name": (Literal[name], ...),
        "warm_start": (WarmStart, entry.warm_start),
        "sampling": (Sampling | None, entry.sampling),
        "when": (When, "undecided" if name == "default" else "needed"),
    }
    # `default` and `none` have no settings. A package whose search cannot be imported
    # must not stop the other searches: `algorithm` tells of it if it is named.
    with contextlib.suppress(UnusableSearchError):
        settings = _settings_of(name)
        hints, texts = get_type_hints(settings), attributes_of(settings)
        for setting in dataclasses.fields(settings):
            # A docstring speaks of Python, the schema of YAML.
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
    """A search alone, which is checked like the search of a scenario.

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
        against: Settings of a second run with the same seed; the measure of the run is
            divided by that of the second run, so that one run alone cannot judge the
            claim; null means no second run.
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
        claims: Claims that a run judges.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")
    kind: str
    title: str
    source: str = ""
    steps: int = Field(ge=1, le=1_000_000)
    claims: list[Claim] = Field(default_factory=list)

    @property
    def search_name(self) -> str:
        """Name of the search of each plan, as in SEARCHES."""
        return "none"

    @property
    def polish_name(self) -> str:
        """Name of the polish: none, ipopt, or the name of another NLP solver."""
        return "none"

    @property
    def evaluator(self) -> Backend:
        """Evaluator of populations."""
        return "auto"

    def random_starts(self) -> int:
        """Return the number of random starts that are solved in lanes."""
        return 0

    def search_settings(self) -> SearchSettings | None:
        """Return the search for a planner; None if there is no search."""
        return None

    def polish_options(self) -> IpoptOptions | NlpOptions | None:
        """Return the options of the polish for a planner; None if it is `none`."""
        return None

    def way(self) -> str:
        """Return in words how plans are made; empty if `solve` makes them."""
        return ""

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from ()


class PlanningScenario(Scenario):
    """The keys of kinds whose plans are optimal-control problems.

    Attributes:
        search: Search algorithm and its settings.
        budget: Budget of the search for each planning problem.
        order: Order in which the search ranks feasible and infeasible individuals; null
            means the adaptive epsilon level.
        polish: Local solver that improves the answer of the search: IPOPT, none, or
            another NLP solver of CasADi with its options.
        ipopt: Options of IPOPT, used if `polish` is ipopt.
        basins: Number of further starting points for the polish: the best distinct
            basins that the search found, besides its best point.
        lanes: Number of random starts that are solved at once, besides the search, if
            there is no earlier plan; needs a polish, and null means the default of the
            kind.
        backend: Evaluator of populations: llvm is machine code, casadi its virtual
            machine, and auto follows SWARMSTART_BACKEND or else takes machine code if
            possible.
    """

    search: AnySearch
    budget: BudgetPart
    order: OrderPart | None = None
    polish: Literal["none", "ipopt"] | PolishPart = "none"
    ipopt: IpoptPart = IpoptPart()
    basins: int = Field(default=0, ge=0, le=10_000)
    lanes: int | None = Field(default=None, ge=0, le=MOST_LANES)
    backend: Backend = "auto"

    @property
    def search_name(self) -> str:
        """Name of the search of each plan, as in SEARCHES."""
        part: SearchPart = self.search
        return part.name

    @property
    def evaluator(self) -> Backend:
        """Evaluator of populations."""
        return self.backend

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
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
        # The real problem is not posed yet; more dimensions only enlarge a generation.
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


def planning(scenario: Scenario) -> PlanningScenario:
    """Return a scenario whose plans are optimal-control problems.

    Raises:
        TypeError: If the plans of the scenario are no optimal-control problems.
    """
    if not isinstance(scenario, PlanningScenario):
        raise TypeError(
            f"expected a scenario with search and polish, found kind {scenario.kind}"
        )
    return scenario
