"""Plan of a comparison: from the command line, a file in YAML, or both.

    schema: 1
    compare:
      scenarios: [van_der_pol, {scenario: formation_v, of: flight}, own/problem.yaml]
      solvers: ["lshade[size=60]+ipopt", repeated-ipopt, ipopt]
      seeds: 30
      budget: 20000evals|1s
      known: {van_der_pol: 2.86726}

An option of the command line replaces the value in the plan, and this replaces the
default.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from swarmstart.cases.format.document import Document
from swarmstart.cases.format.flaws import checked
from swarmstart.cases.format.parts import Number, Part
from swarmstart.cases.format.scenario import hard_problems
from swarmstart.cases.record.files import to_json

Of = Literal["auto", "plan", "flight"]
"""One planning problem, a whole run, or the one that fits the scenario."""
SECTION = "compare"
MOST_SEEDS = 100_000


class ScenarioChoice(Part):
    """A scenario of a plan, with changes of its settings."""

    scenario: str
    of: Of | None = None
    variant: str | None = None
    set: Mapping[str, Any] = Field(default_factory=dict)


class ComparePart(Part):
    """The keys of a plan."""

    scenarios: list[str | ScenarioChoice] = Field(min_length=1)
    solvers: list[str] | None = Field(default=None, min_length=1)
    seeds: int | None = Field(default=None, ge=1, le=MOST_SEEDS)
    budget: str | None = None
    of: Of | None = None
    variant: str | None = None
    set: Mapping[str, Any] = Field(default_factory=dict)
    timeout_s: int | None = Field(default=None, ge=1)
    repair: bool | None = None
    known: Mapping[str, Number] = Field(default_factory=dict)
    bound: str | Number | None = None


class PlanFile(Part):
    """A plan: the whole file."""

    schema_version: Literal[1] = Field(alias="schema")
    compare: ComparePart


@dataclass(frozen=True, kw_only=True, slots=True)
class Chosen:
    """A scenario of a comparison.

    Attributes:
        source: The name of a shipped scenario, or a path.
        of: Whether one planning problem or the whole run is compared.
        variant: The variant; None means the default one.
        assignments: Changes of the scenario's settings, as for --set.
    """

    source: str
    of: Of = "auto"
    variant: str | None = None
    assignments: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class ComparisonPlan:
    """All options of a comparison.

    Attributes:
        scenarios: The scenarios.
        solvers: Names of solvers; the others are compared with the first.
        seeds: Number of seeds, from 0 on.
        budget: Budget of one planning problem, as text.
        timeout_s: Time limit of a cell [s].
        repair: Whether answers that break a constraint between the checks are solved
            again.
        known: Best known costs by scenario, as the scenarios state their costs.
        bound_s: Work for a lower bound of each scenario that makes one plan, in units
            of about a second; None means that no bound is sought.
    """

    scenarios: tuple[Chosen, ...]
    solvers: tuple[str, ...]
    seeds: int = 10
    budget: str = "4000evals"
    timeout_s: int = 300
    repair: bool = True
    known: Mapping[str, float] = field(default_factory=dict)
    bound_s: float | None = None


def is_plan(document: Document) -> bool:
    """Return whether a file is a plan and not a scenario."""
    data = document.data
    return isinstance(data, dict) and SECTION in data and "kind" not in data


def plan_in(document: Document) -> ComparePart:
    """Return the content of a plan.

    Paths of scenarios in the file are relative to its folder; in the content they begin
    with this folder.

    Raises:
        InvalidScenarioError: If the file is not a valid plan.
    """
    found = checked(document, PlanFile).compare
    folder = Path(document.name).parent
    scenarios = [
        one if isinstance(one, ScenarioChoice) else ScenarioChoice(scenario=one)
        for one in found.scenarios
    ]
    placed = [
        one.model_copy(update={"scenario": _placed(one.scenario, folder)})
        for one in scenarios
    ]
    return found.model_copy(update={"scenarios": placed})


def _placed(source: str, folder: Path) -> str:
    """Return a path with the plan's folder before it, or a scenario's name as it is."""
    # Of names only those of hard problems have one of these marks.
    looks_like_path = any(mark in source for mark in "./\\")
    is_path = looks_like_path and source not in hard_problems()
    return str(folder / source) if is_path else source


def chosen_of(part: ComparePart, assignments: Sequence[str]) -> list[Chosen]:
    """Return the scenarios of a plan.

    Args:
        part: The plan.
        assignments: Assignments of --set, which are applied last.
    """
    return [
        Chosen(
            source=one.scenario,
            of=one.of or part.of or "auto",
            variant=one.variant or part.variant,
            assignments=(
                *_assignments({**part.set, **one.set}),
                *assignments,
            ),
        )
        for one in part.scenarios
        if isinstance(one, ScenarioChoice)
    ]


def _assignments(settings: Mapping[str, Any]) -> list[str]:
    return [f"{key}={to_json(value)}" for key, value in settings.items()]
