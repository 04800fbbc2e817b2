"""Runs of one solver on one scenario, read from its cells, and what was asked of them.

A run that failed, was cut or has no feasible answer stays in every count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.campaign.judging.entry import Entry
from swarmstart.cases.campaign.judging.running_time import FEASIBLE, Courses, courses_of

Array = NDArray[np.float64]
NEAR = (0.01, 0.0001)
ROUND_OFF = 1e-9
"""Of the largest cost: where the best is about 0, this is near it."""
FIRST_ROUND_OFF = 1e-12
"""Of the first cost of a history: so much is lost where what is summed up cancels."""


@dataclass(frozen=True, kw_only=True, slots=True)
class About:
    """What is known of a scenario beside the runs.

    Attributes:
        title: In words.
        kind: Of the scenario.
        variant: Of it.
        of: "plan" or "flight"; empty: as the results say.
        known_cost: A feasible cost known from elsewhere, to be minimised like all; None
            if there is none.
        bound: {"value", "kind", "reason"} and what it took: a value below which no cost
            is, if its kind is one of a bound; None if none was sought.
        is_seeded: Whether each seed is a problem of its own, as its gusts differ: then
            the best known is that of each seed.
    """

    title: str = ""
    kind: str = ""
    variant: str = ""
    of: str = ""
    known_cost: float | None = None
    bound: Mapping[str, Any] | None = None
    is_seeded: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Asked:
    """What was asked of a comparison.

    Attributes:
        seeds: The seeds.
        budget: {"evaluations", "seconds"} of a run; a missing one is no limit.
        budget_text: As the user wrote it.
        command: By which the comparison can be repeated.
        near: Relative distances from the best known that count as a success.
        resamples: Of every bootstrap; 0: no bands.
        bootstrap_seed: Of its random numbers.
    """

    seeds: tuple[int, ...]
    budget: Mapping[str, float | int] = field(
        default_factory=lambda: MappingProxyType({})
    )
    budget_text: str = ""
    command: str = ""
    near: tuple[float, float] = NEAR
    resamples: int = 500
    bootstrap_seed: int = 0

    @property
    def near_words(self) -> str:
        """The first distance in words."""
        return f"{100 * self.near[0]:g} %"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Runs:
    """Runs of one solver on one scenario.

    Attributes:
        entry: The solver and the scenario.
        outcomes: Of its cells, in their order.
        results: Of them; empty where a run has failed.
        costs: Verified; infinite where not feasible, shape (runs,).
        evaluations: Courses by evaluations.
        seconds: Courses by seconds.
    """

    entry: Entry
    outcomes: tuple[Outcome, ...]
    results: tuple[Mapping[str, Any], ...]
    costs: Array
    evaluations: Courses
    seconds: Courses

    @property
    def is_deterministic(self) -> bool:
        """Whether there is one run without chance in it, which counts for each seed.

        A flight through gusts has a run a seed, whatever solves it.
        """
        return self.entry.solver.is_deterministic and len(self.entry.cells) == 1

    @property
    def name(self) -> str:
        """The solver's."""
        return self.entry.solver.name

    @property
    def seeds(self) -> list[int]:
        """The seed of each run."""
        return [cell.job.get("seed", k) for k, cell in enumerate(self.entry.cells)]

    @property
    def has_answer(self) -> NDArray[np.bool_]:
        """Whether each run came to an end of its own, feasible or not."""
        return np.array([bool(result) for result in self.results])

    @property
    def clock(self) -> Array:
        """Seconds of each run; infinite where it failed."""
        return np.where(self.has_answer, self.seconds.ends, np.inf)

    def for_seeds(self, values: Array, seeds: int) -> Array:
        """Return values a seed."""
        return np.repeat(values, seeds) if len(values) == 1 else values


def runs_of(entry: Entry, outcomes: Mapping[str, Outcome], asked: Asked) -> Runs:
    """Return the runs of a solver on a scenario."""
    found = tuple(outcomes[cell.key] for cell in entry.cells)
    results = tuple(one.result or {} for one in found)
    costs = np.array([_cost(result) for result in results])
    histories = [result.get("history") for result in results]
    counts = np.array([number(r.get("evaluations")) for r in results])
    clocks = np.array([number(r.get("seconds")) for r in results])
    lost = np.array([not result for result in results])
    spent = np.array([one.seconds or math.nan for one in found])
    # A run that failed has spent its budget; if it has none, as much as any other.
    counts = np.where(lost, _budget(asked, "evaluations", counts), counts)
    clocks = np.where(lost, np.fmax(spent, _budget(asked, "seconds", clocks)), clocks)
    evaluations, seconds = (
        courses_of(
            histories, quantity, ends=ends, final=costs, tolerance=_tolerance(results)
        )
        for quantity, ends in (("evaluations", counts), ("seconds", clocks))
    )
    return Runs(
        entry=entry,
        outcomes=found,
        results=results,
        costs=costs,
        evaluations=evaluations,
        seconds=seconds,
    )


def _tolerance(results: Sequence[Mapping[str, Any]]) -> float:
    """Return the largest violation that the solver itself has called feasible."""
    called = [r.get("claimed_violation") for r in results if r.get("claimed_feasible")]
    known = [number(violation) for violation in called]
    return max([FEASIBLE, *(one for one in known if math.isfinite(one))])


def number(value: object) -> float:
    """Return a number; NaN where there is none."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else math.nan  # type: ignore[arg-type]


def _budget(asked: Asked, quantity: str, known: Array) -> float:
    limit = asked.budget.get(quantity)
    if limit is not None:
        return float(limit)
    return float(np.fmax.reduce(known, initial=-math.inf)) if _any(known) else math.nan


def _any(values: Array) -> bool:
    return bool(np.isfinite(values).any())


def _cost(result: Mapping[str, Any]) -> float:
    """Return the verified cost; infinity where the answer is not feasible."""
    cost = number(result.get("verified_cost"))
    return cost if result.get("feasible") and math.isfinite(cost) else math.inf


def is_false_success(result: Mapping[str, Any], near: float = NEAR[0]) -> bool | None:
    """Return whether an answer called feasible is not, or costs other than claimed.

    Args:
        result: Of a run.
        near: Relative difference of costs that is none. One of round-off is none
            either: of the claimed cost, and of the first cost of its history.

    Returns:
        None if nothing is known of a claim.
    """
    claims = result.get("claimed_feasible")
    if claims is None:
        return None
    claimed, verified = number(result.get("claimed_cost")), _cost(result)
    if not claims:
        return False
    if math.isinf(verified):
        return True
    history = (result.get("history") or {}).get("cost", ())
    first = next((abs(cost) for cost in history if cost is not None), 0.0)
    slack = ROUND_OFF * abs(claimed) + FIRST_ROUND_OFF * first
    return abs(claimed - verified) > near * abs(verified) + slack


def plain(values: ArrayLike) -> list[float | None]:
    """Return numbers as plain data; None where one is not finite."""
    return [v if math.isfinite(v) else None for v in np.ravel(values).tolist()]
