"""The content of a certificate is the evidence, as data."""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.lower_bound.certificate import certificate_content
from swarmstart.ocp.lower_bound.stated.answer import Evidence
from swarmstart.terminal_set import check
from swarmstart.terminal_set.checker.file_content import digest
from swarmstart.terminal_set.checker.lower_bound.certificate_file import expected_claims
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
)
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand


@pytest.mark.parametrize("make", by_hand.ALL)
def test_the_content_survives_json_to_the_last_bit(
    make: Callable[[], Evidence],
) -> None:
    content: Any = certificate_content(make())
    again = json.loads(json.dumps(content, allow_nan=False))
    assert again == content
    assert digest(again) == content["sha256"]
    coefficients = again["final"]["polynomial"]["coefficients"]
    assert coefficients == make().final.polynomial.coefficients.tolist()


def test_the_tape_evaluates_as_the_problem() -> None:
    evidence = by_hand.least_time()
    content: Any = certificate_content(evidence)
    statement, problem = evidence.statement, content["problem"]
    t, x, u = 0.3, np.array([0.5, -0.7]), np.array([0.2])
    simple: dict[str, Callable[..., float]] = {
        "mul": lambda a, b: a * b,
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "neg": lambda a: -a,
    }
    values: list[float] = []
    for operation, *operands in problem["tape"]:
        if operation == "const":
            values.append(operands[0])
        elif operation in ("t", "x", "u"):
            entries = {"t": np.array([t]), "x": x, "u": u}[operation]
            values.append(float(entries[operands[0]]))
        else:
            values.append(simple[operation](*(values[k] for k in operands)))
    parts = ca.vertcat(statement.rate, statement.stage, statement.end, *statement.ends)
    function = ca.Function("f", [statement.point, statement.controls], [parts])
    numbers = [*problem["rate"], problem["stage"], problem["end"], *problem["ends"]]
    exact = np.array(function(np.array([t, *x]), u)).ravel()
    np.testing.assert_allclose([values[k] for k in numbers], exact, rtol=1e-14)


def test_what_is_infinite_is_null() -> None:
    content: Any = certificate_content(by_hand.quadratic())
    assert content["known"] is None
    assert content["problem"]["state_box"] == {"lower": [None], "upper": [None]}


def test_the_words_are_those_that_the_checker_takes() -> None:
    for evidence, prunings in ((by_hand.quadratic(), 0), (by_hand.pruned(), 1)):
        content: Any = certificate_content(evidence)
        said = [entry["statement"] for entry in content["statements"]]
        assert said == expected_claims(prunings)


def test_a_number_that_must_be_finite_is_refused() -> None:
    evidence = by_hand.quadratic()
    evidence.tube.levels[0, 0] = math.nan
    with pytest.raises(ValueError, match="JSON compliant"):
        certificate_content(evidence)


def test_a_problem_that_jumps_has_no_certificate() -> None:
    simple = by_hand.quadratic()
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("u")
    statement = by_hand.scalar(
        time=t, states=x, controls=u, rate=u * (x > 0), stage=u, end=x
    )
    evidence = Evidence(
        statement=statement,
        tube=simple.tube,
        prunings=(),
        final=simple.final,
        known=np.inf,
        bound=0.0,
    )
    with pytest.raises(UnknownIntervalOperationError):
        certificate_content(evidence)


def test_the_checker_imports_nothing_that_finds_bounds() -> None:
    file = Path(check.__file__)
    allowed = ("swarmstart.terminal_set.checker",)
    outside = {"casadi", "scipy", "numba", "llvmlite"}
    files = sorted((file.parent / "checker").rglob("*.py"))
    assert len(files) > 15
    for path in [file, *files]:
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            for name in names:
                assert name.split(".")[0] not in outside, (path, name)
                if name.startswith("swarmstart"):
                    assert name.startswith(allowed), (path, name)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in {"eval", "exec", "compile", "__import__"}
