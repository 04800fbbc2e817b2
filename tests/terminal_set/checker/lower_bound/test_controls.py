"""Taking the controls out of a tape leaves the same functions."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.ocp.lower_bound.stated.answer import Evidence
from swarmstart.terminal_set.checker.evaluation import Program, as_model
from swarmstart.terminal_set.checker.lower_bound import controls
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Problem,
    certificate_of,
)
from swarmstart.terminal_set.checker.lower_bound.controls import Split, split
from swarmstart.terminal_set.checker.models import algebra_of
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand

T, X, U = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("u", 3)


def problem_of(rate: ca.SX, stage: ca.SX) -> Problem:
    simple = by_hand.least_time()
    statement = by_hand.scalar(
        time=T,
        states=X,
        controls=U,
        rate=rate,
        stage=stage,
        end=X[0],
        x0=np.zeros(2),
        sizes=np.ones(2),
        control_box=(np.full(3, -1.0), np.ones(3)),
        state_box=(np.full(2, -np.inf), np.full(2, np.inf)),
    )
    evidence = Evidence(
        statement=statement,
        tube=simple.tube,
        prunings=(),
        final=simple.final,
        known=np.inf,
        bound=0.0,
    )
    return certificate_of(certificate_content(evidence)).problem


def evaluated(parts: Split, t: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Rate and stage cost put together from the parts."""
    y = [t, *x, *(u[k] for k in parts.boxed)]
    algebra = algebra_of(len(y))
    variables = [algebra.constant(np.array([value])) for value in y]
    program = Program(parts.nodes, range(len(parts.nodes)))
    values = program(variables)

    def number(k: int | None) -> float:
        return 0.0 if k is None else float(as_model(values[k], variables[0]).middle[0])

    total = np.array([number(k) for k in (*parts.drift, parts.stage)])
    for place, k in enumerate(parts.free):
        column = [*parts.columns[place], parts.linear[place]]
        total += u[k] * np.array([number(entry) for entry in column])
        total[-1] += float(parts.quadratic[place]) * u[k] ** 2
    return total


CASES: dict[str, tuple[ca.SX, ca.SX, tuple[int, ...]]] = {
    "affine": (
        ca.vertcat(X[1] + U[0] * ca.sin(X[0]), (U[1] - X[0]) * X[1] / 3),
        X[0] ** 2 + (2 * U[0] - 1) ** 2 / 5 + 0.1 * U[1] ** 2 + U[2] * X[1],
        (),
    ),
    "sine of a control": (
        ca.vertcat(ca.sin(U[0]), U[1] * X[0]), U[1] ** 2 + U[2] ** 2, (0,)
    ),
    "square in the dynamics": (ca.vertcat(U[1] ** 2, U[0]), U[0] ** 2, (1,)),
    "product of controls": (ca.vertcat(U[0] * U[2], U[1]), U[1] ** 2, (0,)),
    "weight of a state": (ca.vertcat(U[0], U[1]), X[0] * U[0] ** 2 + U[1] ** 2, (0,)),
    "negative weight": (ca.vertcat(U[0], U[1]), U[1] ** 2 - U[0] ** 2, (0,)),
    "cube": (ca.vertcat(U[0], U[1]), U[2] ** 4 + U[0] ** 2, (2,)),
    "divided by a control": (ca.vertcat(X[0] / (2 + U[0]), U[1]), X[0] ** 2, (0,)),
    "cancelling square": (
        ca.vertcat((U[0] + 1) ** 2 - U[0] ** 2, U[1]), U[0] ** 2, ()
    ),
}  # fmt: skip


@pytest.mark.parametrize(("rate", "stage", "boxed"), CASES.values(), ids=CASES)
def test_the_parts_make_up_the_problem(
    rate: ca.SX, stage: ca.SX, boxed: tuple[int, ...]
) -> None:
    parts = split(problem_of(rate, stage))
    assert tuple(sorted(parts.boxed)) == boxed
    assert all(q >= 0 for q in parts.quadratic)
    function = ca.Function("f", [T, X, U], [ca.vertcat(rate, stage)])
    rng = np.random.default_rng(0)
    for _ in range(5):
        t, x, u = rng.normal(), rng.normal(size=2), rng.uniform(-1, 1, size=3)
        exact = np.array(function(t, x, u)).ravel()
        np.testing.assert_allclose(
            evaluated(parts, t, x, u), exact, rtol=1e-12, atol=1e-12
        )


def test_weights_of_squares_are_exact_fractions() -> None:
    parts = split(problem_of(ca.vertcat(U[0], U[1]), (U[0] / 3) ** 2 + 0.1 * U[1] ** 2))
    third = Fraction(1, 9)
    assert abs(parts.quadratic[0] - third) < Fraction(1, 10**15)
    assert parts.quadratic[1] == Fraction(0.1)


@pytest.mark.parametrize(
    ("operation", "values", "result"),
    [
        ("div", (3, 2), Fraction(3, 2)),
        ("div", (0, 2), Fraction(0)),
        ("div", (3, 0), None),
        ("inv", (4,), Fraction(1, 4)),
        ("inv", (0,), None),
        ("add", (3, 0), Fraction(3)),
        ("sub", (3, 0), Fraction(3)),
        ("mul", (3, 0), Fraction(0)),
        ("mul", (None, 0), Fraction(0)),
        ("mul", (None, 3), None),
    ],
)
def test_constants_are_folded_exactly_and_no_quotient_by_zero(
    operation: str, values: tuple[int | None, ...], result: Fraction | None
) -> None:
    exact = [None if v is None else Fraction(v) for v in values]
    assert controls._folded(operation, exact) == result
