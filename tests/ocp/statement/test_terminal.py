"""Terminal set of a problem: from its dynamics, bounds and control interval."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    terminal_set_of,
)
from swarmstart.terminal_set import (
    MovingReferenceError,
    NotAnEquilibriumError,
    ProofOptions,
    Reference,
    TerminalSet,
    Weights,
    certified_terminal_set,
)

WEIGHTS = Weights(Q=np.eye(2), R=np.eye(1))
X, U, P = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")


def upright(**bounds: object) -> OptimalControlProblem:
    """A pendulum about its upper rest, with holds of 0.1 s, integrated in two steps."""
    return OptimalControlProblem(
        Model(
            states=X, controls=U, parameters=P,
            ode=ca.vertcat(X[1], P * ca.sin(X[0]) + U),
        ),
        horizon=2.0,
        intervals=20,
        substeps=2,
        stage_cost=U**2,
        bounds=Bounds(**({"controls": (-20, 20)} | bounds)),  # type: ignore[arg-type]
    )  # fmt: skip


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def found(problem: OptimalControlProblem, **given: object) -> TerminalSet:
    stated = {"at": [0, 0], "weights": WEIGHTS, "parameters": [9.81]} | given
    return terminal_set_of(problem, rng=rng(), **stated)  # type: ignore[arg-type]


@pytest.mark.parametrize("states", [None, ([-0.3, -np.inf], [0.2, np.inf])])
def test_it_is_the_set_certified_from_the_same_numbers(states: object) -> None:
    problem = upright(states=states)
    f = ca.Function("f", [X, U], [ca.vertcat(X[1], 9.81 * ca.sin(X[0]) + U)])
    lower, upper = problem.state_limits
    reference = Reference(
        x_ref=np.zeros(2), u_ref=np.zeros(1), u_lower=np.array([-20.0]),
        u_upper=np.array([20.0]), x_lower=lower, x_upper=upper,
    )  # fmt: skip
    expected = certified_terminal_set(
        f, reference, WEIGHTS, dt=0.1, options=ProofOptions(substeps=2), rng=rng()
    )
    terminal_set = found(problem)
    assert terminal_set.dt == 0.1
    np.testing.assert_allclose(terminal_set.K, expected.K, rtol=1e-12)
    np.testing.assert_allclose(terminal_set.P, expected.P, rtol=1e-12)
    assert terminal_set.alpha == pytest.approx(expected.alpha, rel=1e-9)
    assert terminal_set.certificate is not None
    assert terminal_set.certificate.unproven() == []


def test_inputs_stay_within_the_bounds_of_the_problem() -> None:
    narrow, wide = (found(upright(controls=(-b, b))) for b in (2.0, 20.0))
    assert narrow.alpha < wide.alpha
    reach = np.sqrt(narrow.alpha * narrow.K @ np.linalg.inv(narrow.P) @ narrow.K.T)
    assert reach.item() == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("lean", [0.3, -0.4])
def test_the_input_that_holds_a_reference_is_found(lean: float) -> None:
    """A leaning pendulum is held by p sin(angle), for any p."""
    for p in (9.81, 3.0):
        terminal_set = found(upright(), at=[lean, 0], parameters=[p])
        np.testing.assert_allclose(terminal_set.u_ref, -p * np.sin(lean), rtol=1e-9)


def test_a_reference_that_no_input_holds_is_refused() -> None:
    with pytest.raises(NotAnEquilibriumError):
        found(upright(), at=[0, 1.0])
    with pytest.raises(NotAnEquilibriumError):
        found(upright(controls=(-2, 2)), at=[0.5, 0])  # It would take 4.7.


def test_a_reference_moves_in_a_state_that_nothing_feels_if_it_says_so() -> None:
    """A cart that rolls at 3 m/s: its place may move with that velocity."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 0.1 * x[1] ** 3)),
        horizon=1.0,
        intervals=10,
        stage_cost=u**2,
        bounds=Bounds(controls=(-9, 9)),
    )
    asked: dict[str, Any] = {"at": [7.0, 3.0], "weights": WEIGHTS, "rng": rng()}
    rolling = terminal_set_of(problem, velocity=[3.0, 0.0], **asked)
    np.testing.assert_allclose(rolling.u_ref, 0.1 * 27, rtol=1e-9)
    with pytest.raises(NotAnEquilibriumError, match=r"xdot\[0\] = 3,"):
        terminal_set_of(problem, **asked)
    with pytest.raises(MovingReferenceError, match=r"whose rate is 3$"):
        terminal_set_of(problem, velocity=[2.0, 0.0], **asked)
    held = replace(problem, bounds=Bounds(controls=(-9, 9), states=(-99, 99)))
    with pytest.raises(MovingReferenceError, match=r"x\[0\], with bounds"):
        terminal_set_of(held, velocity=[3.0, 0.0], **asked)
    with pytest.raises(InvalidProblemError, match="velocity must be 2 finite numbers"):
        terminal_set_of(problem, velocity=[3.0], **asked)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"at": [0]}, r"at must be 2 finite numbers, got \[0\]"),
        ({"at": [0, np.nan]}, "at must be 2 finite numbers"),
        ({"parameters": []}, r"parameters must be 1 finite numbers, got \[\]"),
    ],
)
def test_numbers_of_another_size_are_refused(
    given: dict[str, object], said: str
) -> None:
    with pytest.raises(InvalidProblemError, match=said):
        found(upright(), **given)
