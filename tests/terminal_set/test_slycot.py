"""With slycot installed python-control would solve, and fail, in other ways."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

DESIGNS = """
import json, sys
if sys.argv[1] == "without":
    sys.modules["slycot"] = None  # An import of it fails.
import numpy as np
from swarmstart.terminal_set import (
    continuous_lqr, continuous_lyapunov, hold, sampled_lqr, sampled_lyapunov,
)

def unicycle(v):
    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    A[2, 0], A[3, 1], B[0, 0], B[1, 1] = 1, v, 1, 1
    return A, B

A, B = unicycle(15.0)
Q, R = np.eye(4), np.eye(2)
K = continuous_lqr(A, B, Q, R).K
cases = {
    "continuous": lambda: continuous_lqr(A, B, Q, R),
    "sampled": lambda: sampled_lqr(*hold(A, B, 1.0), Q, np.diag([1, 1000.0])),
    "at rest": lambda: sampled_lqr(*hold(*unicycle(0.0), 1.0), Q, R),
    "at rest, continuous": lambda: continuous_lqr(*unicycle(0.0), Q, R),
    "no weight": lambda: continuous_lqr(A, B, 0 * Q, R),
    "indefinite": lambda: continuous_lqr(A, B, -Q, R),
    "Lyapunov": lambda: continuous_lyapunov(A - B @ K, Q),
    "Lyapunov, unstable": lambda: continuous_lyapunov(A, Q),
    "Lyapunov, sampled": lambda: sampled_lyapunov(0.5 * np.eye(4) + 0.1 * A / 15, Q),
    "Lyapunov, sampled, unstable": lambda: sampled_lyapunov(2 * np.eye(4), Q),
}
said = {}
for name, design in cases.items():
    try:
        found = design()
        arrays = [found.K, found.P] if hasattr(found, "K") else [found]
        said[name] = [array.tolist() for array in arrays]
    except Exception as error:
        said[name] = f"{type(error).__name__}: {error}"
print(json.dumps({"slycot": bool(sys.modules.get("slycot")), "said": said}))
"""


def answers(which: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", DESIGNS, which],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return dict(json.loads(done.stdout))


def test_answers_and_errors_are_the_same_with_and_without_slycot() -> None:
    pytest.importorskip("slycot")
    without, with_it = answers("without"), answers("with")
    assert not without["slycot"]
    assert with_it["said"] == without["said"]
    said = with_it["said"]
    assert "NotStabilisableError" in said["at rest"]
    assert "UnweightedModeError" in said["no weight"]
    assert "IndefiniteMatrixError" in said["indefinite"]
    assert "UnstableLoopError" in said["Lyapunov, unstable"]
    assert "UnstableLoopError" in said["Lyapunov, sampled, unstable"]
    assert len(said["continuous"]) == 2 and len(said["Lyapunov"]) == 1
