"""A model in a file is the model: evaluated, and proven by the checker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest

from swarmstart.terminal_set import (
    ProofOptions,
    Reference,
    UnknownIntervalOperationError,
    Weights,
    certificate_text,
    certified_terminal_set,
)
from swarmstart.terminal_set.check import main
from swarmstart.terminal_set.interval_arithmetic.tape import (
    OPERATIONS,
    Instruction,
    tape_of,
)

FORMS: dict[str, Callable[..., mpmath.mpf]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "inv": lambda a: 1 / a,
    "sq": lambda a: a * a,
    "twice": lambda a: 2 * a,
    "neg": lambda a: -a,
    "pow": lambda a, b: a**b,
    "sqrt": mpmath.sqrt,
    "exp": mpmath.exp,
    "log": mpmath.log,
    "atan": mpmath.atan,
    "sin": mpmath.sin,
}
WRITTEN: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "sinh": (lambda x, y: ca.sinh(x), lambda x, y: mpmath.sinh(x)),
    "cosh": (lambda x, y: ca.cosh(x), lambda x, y: mpmath.cosh(x)),
    "expm1": (lambda x, y: ca.expm1(x), lambda x, y: mpmath.expm1(x)),
    "log1p": (lambda x, y: ca.log1p(x), lambda x, y: mpmath.log1p(x)),
    "asinh": (lambda x, y: ca.asinh(x), lambda x, y: mpmath.asinh(x)),
    "acosh": (lambda x, y: ca.acosh(2 + x), lambda x, y: mpmath.acosh(2 + x)),
    "atanh": (lambda x, y: ca.atanh(x), lambda x, y: mpmath.atanh(x)),
    "asin": (lambda x, y: ca.asin(x), lambda x, y: mpmath.asin(x)),
    "acos": (lambda x, y: ca.acos(x), lambda x, y: mpmath.acos(x)),
    "hypot": (ca.hypot, mpmath.hypot),
    "atan2": (ca.atan2, mpmath.atan2),
    "pow": (lambda x, y: (1 + x) ** 1.5, lambda x, y: (1 + x) ** mpmath.mpf(1.5)),
}


def value(tape: list[Instruction], result: int, x: list[float]) -> mpmath.mpf:
    """The result of a tape, in many digits."""
    values: list[mpmath.mpf] = []
    for operation, *operands in tape:
        if operation == "const":
            values.append(mpmath.mpf(operands[0]))
        elif operation == "x":
            values.append(mpmath.mpf(x[int(operands[0])]))
        else:
            made = FORMS[str(operation)]
            values.append(made(*(values[int(number)] for number in operands)))
    return values[result]


@pytest.mark.parametrize("name", WRITTEN)
def test_what_a_file_holds_is_exactly_the_operation(name: str) -> None:
    """In forty digits: the identities are no approximations. All four quadrants."""
    make, exact = WRITTEN[name]
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    tape, (result,) = tape_of(ca.Function("f", [x, u], [make(x[0], x[1])]))
    assert {str(row[0]) for row in tape} <= {"const", "x", "u", *OPERATIONS.values()}
    with mpmath.workdps(40):
        for point in ([0.3, 0.7], [-0.4, 0.9], [0.6, -0.2], [-0.8, -0.5]):
            expected = exact(*map(mpmath.mpf, point))
            assert abs(value(tape, result, point) - expected) < mpmath.mpf(10) ** -36


def test_results_keep_their_places_zeros_by_structure_too() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    xdot = ca.vertcat(ca.sin(x[1]), ca.SX(1, 1), x[1] - 2)
    tape, results = tape_of(ca.Function("f", [x, u], [xdot]))
    found = [value(tape, result, [5.0, 0.5]) for result in results]
    assert found == [mpmath.sin(0.5), 0, -1.5]


def test_states_and_inputs_are_told_apart() -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    tape, results = tape_of(ca.Function("f", [x, u], [ca.vertcat(u[1], x[1])]))
    assert [tape[result] for result in results] == [["u", 1], ["x", 1]]


@pytest.mark.parametrize(("operation", "make"), [("erf", ca.erf), ("sign", ca.sign)])
def test_what_a_file_cannot_hold_is_refused(
    operation: str, make: Callable[[ca.SX], ca.SX]
) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    with pytest.raises(
        UnknownIntervalOperationError,
        match=f"f has the operation {operation}, which a certificate's file cannot",
    ):
        tape_of(ca.Function("f", [x, u], [make(x)]))


def test_the_checker_proves_a_set_of_a_model_with_such_operations(
    tmp_path: Path,
) -> None:
    pytest.importorskip("flint")
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    xdot = ca.sinh(x) + ca.atan2(x, 2 + x) + ca.asin(x / 3) + ca.fmax(u, -8)
    zero = np.zeros(1)
    found = certified_terminal_set(
        ca.Function("f", [x, u], [xdot]),
        Reference(x_ref=zero, u_ref=zero, u_lower=zero - 5, u_upper=zero + 5),
        Weights(Q=np.eye(1), R=np.eye(1)),
        rng=np.random.default_rng(0),
        options=ProofOptions(work=10),
    )
    file = tmp_path / "certificate.json"
    assert found.certificate is not None
    file.write_text(certificate_text(found.certificate), encoding="utf-8")
    assert main([str(file), "--seconds", "20"]) == 0
