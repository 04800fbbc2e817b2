"""The chapter's formation model and the example of Chen and Allgoewer (1998)."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.terminal_set import Reference, linearise
from swarmstart.terminal_set.check import main
from swarmstart.terminal_set.proving import certification

TURN_RATE = np.pi / 18  # 10 deg/s


@pytest.fixture(autouse=True)
def proven_anew(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Prove every set, unless a test has a cache of its own."""
    if "fresh_cache" not in request.fixturenames:
        monkeypatch.setattr(certification, "load_set", lambda *_, **__: None)


@pytest.fixture(scope="session")
def formation() -> ca.Function:
    """Unicycle v' = u, psi' = w, x' = v cos psi, y' = v sin psi."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    xdot = ca.vertcat(u, x[0] * ca.cos(x[1]), x[0] * ca.sin(x[1]))
    return ca.Function("formation", [x, u], [xdot])


@pytest.fixture(scope="session")
def leader() -> Reference:
    """A leader with 15 m/s along x; bounds of the chapter, section 5.2.4."""
    return leader_at(0.0)


@pytest.fixture(scope="session")
def turned_leader() -> Reference:
    """The same leader on the heading of the second experiment."""
    return leader_at(np.pi / 4)


def leader_at(heading: float) -> Reference:
    return Reference(
        x_ref=np.array([15.0, heading, 0.0, 0.0]),
        u_ref=np.zeros(2),
        u_lower=np.array([-5.0, -TURN_RATE]),
        u_upper=np.array([5.0, TURN_RATE]),
        velocity=np.array([0.0, 0.0, 15 * np.cos(heading), 15 * np.sin(heading)]),
    )


@pytest.fixture(scope="session")
def matrices(
    formation: ca.Function, leader: Reference
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A and B of the formation model."""
    return linearise(formation, leader.x_ref, leader.u_ref)


@pytest.fixture(scope="session")
def printed_p() -> NDArray[np.float64]:
    """P as printed in section 5.2.4."""
    P = np.diag([0.0596, 0.0596, 0.0129, 0.0129])
    P[[0, 1, 2, 3], [2, 3, 0, 1]] = -0.0063
    return P


@pytest.fixture(scope="session")
def chen() -> tuple[ca.Function, Reference]:
    """The example of Chen and Allgoewer, mu = 0.5, |u| <= 2."""
    x, u, mu = ca.SX.sym("x", 2), ca.SX.sym("u"), 0.5
    xdot = ca.vertcat(
        x[1] + u * (mu + (1 - mu) * x[0]), x[0] + u * (mu - 4 * (1 - mu) * x[1])
    )
    reference = Reference(
        x_ref=np.zeros(2),
        u_ref=np.zeros(1),
        u_lower=np.array([-2.0]),
        u_upper=np.array([2.0]),
    )
    return ca.Function("chen", [x, u], [xdot]), reference


@pytest.fixture
def check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    """Write a certificate, check it, return the exit code and all that was said."""

    def run(content: object, *options: str) -> tuple[int, str]:
        file = tmp_path / "certificate.json"
        text = content if isinstance(content, str) else json.dumps(content)
        file.write_text(text)
        code = main([str(file), *options])
        said = capsys.readouterr()
        return code, said.out + said.err

    return run
