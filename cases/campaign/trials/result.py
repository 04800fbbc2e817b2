"""The result of a trial: a solver's answer, the verdict on it, and its effort.

The file that marks a finished cell (a unit of work) contains the result as a JSON
object, under the names of the fields. Readers (judging/) take these objects, also those
of earlier versions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

NO_WORK: Mapping[str, float] = MappingProxyType(
    {
        "rollouts": 0,
        "gradients": 0,
        "hessians": 0,
        "gradient_ratio": 0.0,
        "hessian_ratio": 0.0,
    }
)


@dataclass(frozen=True, kw_only=True)
class TrialResult:
    """Entries that results of single plans and of closed-loop runs have in common.

    Attributes:
        sense: 1 if the cost is minimised, -1 if it is the negative of a value that is
            maximised.
        claimed_cost: Cost that the solver reports; None if it reports none.
        claimed_violation: Violation that the solver reports, scaled [1].
        claimed_feasible: Whether the solver calls its answer feasible.
        verified_cost: Cost of the finer simulation.
        verified_violation: Violation of the finer simulation, scaled [1].
        feasible: Whether the finer simulation confirms a feasible answer.
        status: Status of the answer, a sentence.
        evaluations: Effort as equivalents of one rollout; None if it is not counted.
        seconds: Wall time of the solver [s].
        build_seconds: Wall time of building the problem [s]; None if it is not known.
        compile_seconds: Wall time of compiling the problem [s]; None if it is not
            known.
        judge_seconds: Wall time of verifying the answer [s].
        stopped_by: "itself", "evaluations", "seconds" or "hard limit".
        history: Improvements over the effort (`Meter.history`).
        plan: Times, states and controls of the answer, with names.
    """

    of: ClassVar[str]

    sense: int
    claimed_cost: float | None = None
    claimed_violation: float | None = None
    claimed_feasible: bool = False
    verified_cost: float | None = None
    verified_violation: float | None = None
    feasible: bool = False
    status: str
    evaluations: int | None = 0
    seconds: float
    build_seconds: float | None = None
    compile_seconds: float | None = None
    judge_seconds: float = 0.0
    stopped_by: str = "itself"
    history: Mapping[str, Any] | None = None
    plan: Mapping[str, Any] | None = None

    def as_json(self) -> dict[str, Any]:
        """Return plain data by name; numbers are finite or None."""
        own = {each.name: finite(getattr(self, each.name)) for each in fields(self)}
        return {"of": self.of, **own}


@dataclass(frozen=True, kw_only=True)
class PlanResult(TrialResult):
    """The result of one planning problem.

    Attributes:
        counts: Numbers of rollouts, gradients and Hessians, and the cost of a gradient
            and of a Hessian in rollouts.
        repaired: Whether the plan was repaired: solved again with a margin.
        seconds_repair: Wall time of the repair [s].
        evaluations_repair: Evaluations of the repair.
    """

    of: ClassVar[str] = "plan"

    counts: Mapping[str, float] = field(default_factory=lambda: NO_WORK)
    repaired: bool = False
    seconds_repair: float = 0.0
    evaluations_repair: int = 0


@dataclass(frozen=True, kw_only=True)
class FlightResult(TrialResult):
    """The result of a closed-loop run.

    Attributes:
        step_seconds: Quantiles of the planning time of a step, and the period [s].
        measures: Measures by name.
        claims: Judged claims: "id", "text", "gate", "holds".
        track: "time" [s] and "states" by name at some instants.
        reason: Reason for the status of a single plan; empty for other runs.
        advice: Advice on what to change; empty if there is none.
    """

    of: ClassVar[str] = "flight"

    step_seconds: Mapping[str, float]
    measures: Mapping[str, Any]
    claims: Sequence[Mapping[str, Any]]
    track: Mapping[str, Any]
    reason: str = ""
    advice: str = ""


def finite(value: Any) -> Any:
    """Return plain data with None for numbers that are not finite."""
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return value
