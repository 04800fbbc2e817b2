"""A set is certified where all states rest, or move as is stated; never elsewhere."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import swarmstart as ss
from swarmstart.terminal_set.check import main
from swarmstart.tests.terminal_set.checker.certificates_by_hand import signed

DT = 0.1


@dataclass(frozen=True, kw_only=True)
class Case:
    """x' = ode(x, u), its bounds, and a point that is to be held."""

    ode: Callable[[ca.SX, ca.SX], list[ca.SX]]
    controls: tuple[Any, Any]
    at: list[float]
    velocity: list[float] | None = None
    inputs: int = 1

    def problem(self) -> ss.OptimalControlProblem:
        x, u = ca.SX.sym("x", len(self.at)), ca.SX.sym("u", self.inputs)
        model = ss.Model(states=x, controls=u, ode=ca.vertcat(*self.ode(x, u)))
        return ss.OptimalControlProblem(
            model, horizon=20 * DT, intervals=20,
            bounds=ss.Bounds(controls=self.controls),
        )  # fmt: skip

    def designed(self, velocity: list[float] | None = None) -> ss.TerminalSet:
        return ss.terminal_set_of(
            self.problem(),
            at=self.at,
            velocity=velocity or self.velocity,
            weights=ss.Weights(Q=np.eye(len(self.at)), R=np.eye(self.inputs)),
            rng=np.random.default_rng(0),
        )


def rolling(x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [x[1], u - 0.1 * x[1] ** 3]


def unicycle(x: ca.SX, u: ca.SX) -> list[ca.SX]:
    return [u[0], u[1], x[0] * ca.cos(x[1]), x[0] * ca.sin(x[1])]


COURSE = [0.0, 0.0, 15 * np.cos(0.5), 15 * np.sin(0.5)]

HELD: dict[str, tuple[Case, list[float]]] = {
    "tank": (Case(ode=lambda x, u: [u - 2], controls=(-1, 10), at=[5.0]), [2.0]),
    "wind": (Case(ode=lambda x, u: [u + 0.5], controls=(-1, 1), at=[3.0]), [-0.5]),
    "hover": (
        Case(ode=lambda x, u: [x[1], u - 9.81], controls=(0, 20), at=[3.0, 0.0]),
        [9.81],
    ),
    "heater": (
        Case(ode=lambda x, u: [u - 0.1 * (x - 20)], controls=(0, 9), at=[50.0]),
        [3.0],
    ),
    "two tanks": (
        Case(ode=lambda x, u: [u - x[0], x[0] - x[1]], controls=(0, 9), at=[1.0, 1.0]),
        [1.0],
    ),
    "valve": (Case(ode=lambda x, u: [ca.exp(u) - 1], controls=(-1, 2), at=[4.0]), [0]),
    "cube": (Case(ode=lambda x, u: [u**3 - 8], controls=(0, 5), at=[0.0]), [2.0]),
    "two inputs": (
        Case(
            ode=lambda x, u: [u[0] + u[1] - 1],
            controls=([0, 0], [2, 2]), at=[0.0], inputs=2,
        ),
        [0.5, 0.5],
    ),
    "rolling": (
        Case(ode=rolling, controls=(-9, 9), at=[7.0, 3.0], velocity=[3.0, 0.0]),
        [2.7],
    ),
    "leader": (
        Case(
            ode=unicycle, controls=([-5, -1], [5, 1]), at=[15.0, 0.5, 0.0, 0.0],
            velocity=COURSE, inputs=2,
        ),
        [0.0, 0.0],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HELD)
def test_from_the_edge_of_a_set_the_loop_comes_to_its_reference(name: str) -> None:
    """Integrated by SciPy, held inputs, from 8 states with V = alpha."""
    case, held = HELD[name]
    found = case.designed()
    np.testing.assert_allclose(found.u_ref, held, atol=1e-9)
    dynamics = found.certificate.dynamics if found.certificate else None
    assert dynamics is not None
    velocity = np.array(case.velocity or np.zeros(len(case.at)))
    assert np.array(dynamics(case.at, found.u_ref)).ravel() == pytest.approx(
        velocity, abs=1e-9
    )
    root = np.linalg.inv(np.linalg.cholesky(found.P).T)
    for direction in np.random.default_rng(1).normal(size=(8, len(case.at))):
        unit = direction / np.linalg.norm(direction)
        x = np.array(case.at) + np.sqrt(found.alpha) * root @ unit
        values = []
        for k in range(300):
            e = x - np.array(case.at) - velocity * k * DT
            values.append(float(found.value(e)) / found.alpha)
            u = found.u_ref + found.feedback(e)
            x = solve_ivp(
                lambda t, y, u=u: np.array(dynamics(y, u)).ravel(), (0, DT), x,
                rtol=1e-9, atol=1e-12,
            ).y[:, -1]  # fmt: skip
        assert np.all(np.diff(values) < 1e-9)
        assert values[-1] < 1e-6


@pytest.mark.parametrize(
    ("case", "error"),
    [
        # It would rest with u = 0, on its bounds: no room for any feedback.
        (
            Case(
                ode=lambda x, u: [u[0], u[1]],
                controls=([0, 0], [2, 2]), at=[1.0, 2.0], inputs=2,
            ),
            ss.SaturatedReferenceError,
        ),
        (
            Case(ode=lambda x, u: [ca.exp(u)], controls=(-1, 1), at=[0.0]),
            ss.NotAnEquilibriumError,
        ),
        (
            Case(ode=lambda x, u: [x[1], u - 9.81], controls=(0, 20), at=[3.0, 1.0]),
            ss.NotAnEquilibriumError,
        ),
        (
            Case(ode=lambda x, u: [u - x[0], x[0] - x[1]], controls=(0, 9), at=[1, 2]),
            ss.NotAnEquilibriumError,
        ),
        (Case(ode=rolling, controls=(-9, 9), at=[7.0, 3.0]), ss.NotAnEquilibriumError),
        (
            Case(
                ode=rolling, controls=(-9, 9), at=[7.0, 3.0], velocity=[3.0 + 1e-8, 0]
            ),
            ss.MovingReferenceError,
        ),
        (
            Case(
                ode=unicycle, controls=([-5, -1], [5, 1]), at=[15.0, 0.5, 0, 0],
                inputs=2,
            ),
            ss.NotAnEquilibriumError,
        ),
        # Of the two velocities of a leader one is not enough.
        (
            Case(
                ode=unicycle, controls=([-5, -1], [5, 1]), at=[15.0, 0.5, 0, 0],
                velocity=[0, 0, COURSE[2], 0], inputs=2,
            ),
            ss.NotAnEquilibriumError,
        ),
    ],
    ids=["robot", "one way", "falling", "two levels", "rolling", "faster", "leader",
         "sideways"],
)  # fmt: skip
def test_where_a_state_moves_without_saying_so_nothing_is_certified(
    case: Case, error: type[Exception]
) -> None:
    with pytest.raises(error):
        case.designed()


@cache
def _text(name: str) -> str:
    certificate = HELD[name][0].designed().certificate
    assert certificate is not None
    return ss.certificate_text(certificate)


def certified(name: str) -> dict[str, Any]:
    """The content of the file of a set that holds its reference."""
    content: dict[str, Any] = json.loads(_text(name))
    return content


def checked(
    content: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    pytest.importorskip("flint")
    file = tmp_path / "forged.json"
    file.write_text(json.dumps(signed(content)), encoding="utf-8")
    code = main(["--seconds", "60", str(file)])
    return code, capsys.readouterr().out


@pytest.mark.parametrize("name", HELD)
def test_a_file_whose_reference_moves_unstated_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A linear law holds about any point: only that it does not rest is false."""
    content = certified(name)
    code, said = checked(content, tmp_path, capsys)
    assert code == 0 and "verdict: proven again" in said
    assert ("as the file states" in said) is (HELD[name][0].velocity is not None)
    forged = json.loads(json.dumps(content))
    forged["reference"]["u"][0] += 0.25
    forged["refuted"] = None
    code, said = checked(forged, tmp_path, capsys)
    assert code == 3 and "refused: the reference is no equilibrium" in said
    for j in range(len(content["P"])):
        forged = json.loads(json.dumps(content))
        forged["reference"]["velocity"][j] += 0.5
        code, said = checked(forged, tmp_path, capsys)
        assert code == 3 and f"the reference is said to move x[{j}] by" in said


@pytest.mark.parametrize("name", ["rolling", "leader"])
def test_a_file_of_before_that_does_not_state_its_velocity_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = certified(name)
    kept = {key: content["reference"][key] for key in ("x", "u")}
    still = {"velocity": [0.0] * len(content["P"])}
    for forged in (
        content | {"version": 1, "reference": kept},
        content | {"reference": kept | still},
    ):
        code, said = checked(forged, tmp_path, capsys)
        assert code == 3
        assert "without a velocity in the file it moves x[" in said


@pytest.mark.parametrize("velocity", [[3.0], [3.0, "0"], [3.0, None], 3.0])
def test_a_velocity_that_is_no_vector_makes_a_file_unusable(
    velocity: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = certified("rolling")
    content["reference"]["velocity"] = velocity
    assert checked(content, tmp_path, capsys)[0] == 2
