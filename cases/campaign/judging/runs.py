"""A solver on a scenario: its cells, one for each seed, and its runs read from them.

A run that failed, that a limit of time has ended, or that has no feasible answer counts
in all numbers. `Asked` has the settings of the comparison, `About` what is known of a
scenario from elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.running_time import FEASIBLE, Courses, courses_of
from swarmstart.cases.campaign.trials.peer_names import PEERS, installed_solvers
from swarmstart.cases.campaign.trials.solver_names import Solver
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.record.record import package_version

NEAR = (0.01, 0.0001)
ROUND_OFF = 1e-9
"""Part of the largest cost that counts as near a best cost of about 0."""
FIRST_ROUND_OFF = 1e-12
"""Part of a history's first cost that cancellation in sums can lose."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """A solver on a scenario.

    Attributes:
        scenario: The scenario's name.
        solver: The solver.
        cells: A cell for each seed; only one cell if the solver is deterministic.
    """

    scenario: str
    solver: Solver
    cells: tuple[Cell, ...]

    @property
    def settings_key(self) -> str:
        """Key of the settings on which the results depend, without the seeds."""
        if not self.cells:
            return ""
        # All cells have the same job but for the seed.
        job = {k: v for k, v in self.cells[0].job.items() if k != "seed"}
        text = json.dumps(job, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def entry_of(
    resolved: Resolved,
    solver: Solver,
    *,
    seeds: int,
    budget: Mapping[str, Any],
    timeout_s: float,
    repair: bool,
) -> Entry:
    """Return the cells of a solver on a scenario.

    Args:
        resolved: The scenario with the solver's search.
        solver: The solver.
        seeds: Number of seeds, from 0 on.
        budget: Budget of one planning problem.
        timeout_s: Time limit of a cell [s].
        repair: Whether answers that break constraints between the checks are solved
            again with a margin.
    """
    settings, permissions = resolved.planning_settings(), resolved.permissions()
    cells = [
        Cell(
            work="swarmstart.cases.campaign.trials.solvers:solve_cell",
            job={
                "settings": settings,
                "variant": resolved.variant,
                "solver": solver.name,
                "budget": dict(budget),
                "seed": seed,
                "repair": repair,
                # In the job, and so in the key: recorded versions lack most of these.
                **_package(solver),
            },
            label=f"{resolved.scenario.name}, {solver.name}, seed {seed}",
            timeout_s=timeout_s,
            permissions=permissions,
            rescue="swarmstart.cases.campaign.trials.solvers:judge_checkpoint",
        )
        for seed in range(1 if solver.is_deterministic else seeds)
    ]
    return Entry(scenario=resolved.scenario.name, solver=solver, cells=tuple(cells))


def _package(solver: Solver) -> dict[str, str]:
    """Return the version of the package of a peer, or of a user's own solver."""
    if solver.family == "own" and solver.name in installed_solvers():
        made_by = installed_solvers()[solver.name].dist
        told = "unknown" if made_by is None else f"{made_by.name} {made_by.version}"
        return {"package": told}
    if not solver.peer:
        return {}
    name = PEERS[solver.peer].pip
    return {"package": f"{name} {package_version(name)}"}


@dataclass(frozen=True, kw_only=True, slots=True)
class About:
    """Knowledge about a scenario besides its runs.

    Attributes:
        title: Title in words.
        kind: Kind of the scenario.
        variant: Variant of the scenario.
        of: "plan" or "flight", the object whose cost is compared; if it is empty, it is
            read from the results.
        known_cost: Feasible cost that is known from elsewhere, with the sign of a cost
            that is minimised; None if no such cost is known.
        known_from: Source of that cost, in words.
        bound: Result of the search for a lower bound, with the keys "value", "kind" and
            "reason", and the effort. If "kind" is "proven" or "trivial", no cost is
            below "value". None if no bound was sought.
        is_seeded: Whether each seed is a problem of its own, for example with other
            gusts; then each seed has its own best known cost.
    """

    title: str = ""
    kind: str = ""
    variant: str = ""
    of: str = ""
    known_cost: float | None = None
    known_from: str = ""
    bound: Mapping[str, Any] | None = None
    is_seeded: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Asked:
    """Settings of a comparison.

    Attributes:
        seeds: The seeds.
        budget: Budget of a run, with the keys "evaluations" and "seconds"; a missing
            key means no limit.
        budget_text: The budget as the user wrote it.
        command: Command that repeats the comparison.
        near: Relative distances from the best known that count as a success.
        resamples: Number of resamples of every bootstrap; 0 means no bands.
        bootstrap_seed: Seed of the random numbers of the bootstrap.
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
        """The first distance of `near` in words, such as "1 %"."""
        return f"{100 * self.near[0]:g} %"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Runs:
    """Runs of one solver on one scenario.

    Attributes:
        entry: The solver and the scenario.
        outcomes: Outcomes of its cells, in their order.
        results: Results of its cells; empty if a run has failed.
        costs: Verified costs; infinite if infeasible, shape (runs,).
        evaluations: Best cost of each run as a function of its evaluations.
        seconds: Best cost of each run as a function of its wall time.
    """

    entry: Entry
    outcomes: tuple[Outcome, ...]
    results: tuple[Mapping[str, Any], ...]
    costs: Array
    evaluations: Courses
    seconds: Courses

    @property
    def is_deterministic(self) -> bool:
        """True if there is one deterministic run, which counts for each seed.

        In closed loop with gusts every solver has a run for each seed.
        """
        return self.entry.solver.is_deterministic and len(self.entry.cells) == 1

    @property
    def name(self) -> str:
        """Name of the solver."""
        return self.entry.solver.name

    @property
    def seeds(self) -> list[int]:
        """Seed of each run."""
        return [cell.job.get("seed", k) for k, cell in enumerate(self.entry.cells)]

    @property
    def has_answer(self) -> NDArray[np.bool_]:
        """True for each run that ended by itself, feasible or not."""
        return np.array([bool(result) for result in self.results])

    @property
    def clock(self) -> Array:
        """Seconds of each run; infinite if it failed."""
        return np.where(self.has_answer, self.seconds.ends, np.inf)

    def for_seeds(self, values: Array, seeds: int) -> Array:
        """Return values of runs seed by seed; one deterministic run is repeated."""
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
    # A failed run counts with its budget, or without one with the largest effort.
    counts = np.where(lost, _budget(asked, "evaluations", counts), counts)
    # `fmax` ignores NaN: the larger of what is known.
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
    """Return the largest violation of an answer that the solver calls feasible."""
    called = [r.get("claimed_violation") for r in results if r.get("claimed_feasible")]
    known = [number(violation) for violation in called]
    return max([FEASIBLE, *(one for one in known if math.isfinite(one))])


def number(value: object) -> float:
    """Return a value as a float; NaN if it is not a number."""
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
    """Return the verified cost; infinity if the answer is infeasible."""
    cost = number(result.get("verified_cost"))
    return cost if result.get("feasible") and math.isfinite(cost) else math.inf


def is_false_success(result: Mapping[str, Any], near: float = NEAR[0]) -> bool | None:
    """Return whether a solver wrongly calls an answer feasible, or errs in its cost.

    Args:
        result: Result of a run.
        near: Relative difference below which costs count as equal. Costs also count as
            equal within the round-off of the claimed cost and of the first cost in the
            history.

    Returns:
        None if the solver's own values are not known.
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
    # The size of the summed terms, out of which a small cost can remain.
    first = next((abs(cost) for cost in history if cost is not None), 0.0)
    slack = ROUND_OFF * abs(claimed) + FIRST_ROUND_OFF * first
    return abs(claimed - verified) > near * abs(verified) + slack


def plain(values: ArrayLike) -> list[float | None]:
    """Return numbers as plain data; None for those that are not finite."""
    return [v if math.isfinite(v) else None for v in np.ravel(values).tolist()]
