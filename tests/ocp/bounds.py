"""Bounds of all kinds, in place of those that `lower_bound` would find."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass, field, replace
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from swarmstart.ocp import InvalidProblemError
from swarmstart.ocp.lower_bound import bounding
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound

PROVEN = LowerBound(
    kind=BoundKind.PROVEN, value=1.0, reason="of degree 5", degree=5, slack=1e-4,
    boxes=1234, cpu_seconds=2.5, set_name="a tube",
)  # fmt: skip
TRIVIAL = LowerBound(kind=BoundKind.TRIVIAL, value=0.0, reason="the time ran out")
SAMPLED = LowerBound(kind=BoundKind.SAMPLED, value=1.5, reason="of 20000 samples")
NONE = LowerBound(
    kind=BoundKind.NONE, value=float("nan"), reason="5 states, at most 3 are possible"
)


@dataclass
class Found:
    """Replacement of `lower_bound`: returns a given bound and records its calls."""

    bound: LowerBound = PROVEN
    raises: BaseException | None = None
    sent: int | None = None
    calls: list[dict[str, Any]] = field(default_factory=list)

    def __call__(self, problem: Any, x0: Any, **given: Any) -> LowerBound:
        self.calls.append({"problem": problem, "x0": x0, **given})
        if self.raises is not None:
            raise self.raises
        if self.sent is not None:
            try:
                signal.raise_signal(self.sent)
            except KeyboardInterrupt:  # As lower_bound does: the best is kept.
                return self.bound
        return self.bound

    def instead(self, monkeypatch: pytest.MonkeyPatch) -> Found:
        """Replace `lower_bound` in a test."""
        monkeypatch.setattr(bounding, "lower_bound", self)
        return self


def with_evidence(
    bound: LowerBound, monkeypatch: pytest.MonkeyPatch, *, fails: bool = False
) -> LowerBound:
    """Return a bound with a certificate, or one whose certificate cannot be made."""

    def content(evidence: SimpleNamespace) -> dict[str, object]:
        if fails:
            raise InvalidProblemError("no word for erf")
        head = {"format": "swarmstart lower bound certificate", "version": 1}
        return {**head, "of": evidence.statement}

    module = ModuleType("certificate")
    vars(module)["certificate_content"] = content
    name = "swarmstart.ocp.lower_bound.certificate"
    monkeypatch.setitem(sys.modules, name, module)
    evidence = SimpleNamespace(statement="what the proof rests on", tube=None)
    return replace(bound, evidence=evidence)  # type: ignore[arg-type]
