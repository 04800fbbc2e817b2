import warnings
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import llvmlite.binding as llvm
import numpy as np
import pytest

from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled import engine
from swarmstart.ocp.compiled.backend import (
    VARIABLE,
    BackendWarning,
    BatchEvaluator,
    CasadiMap,
    chosen_backend,
    evaluator,
)
from swarmstart.ocp.compiled.engine import machine
from swarmstart.ocp.compiled.simd import compile_flat
from swarmstart.ocp.compiled.vectors import operations

pytestmark = pytest.mark.usefixtures("compiler")
VALUES = np.linspace(-1, 1, 9)[None]


@pytest.fixture(autouse=True)
def nothing_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)


def served(backend: str | None = None, *, function: ca.Function) -> BatchEvaluator:
    return evaluator(
        lambda: compile_flat(function, (True,)), lambda: CasadiMap(function), backend
    )


@pytest.fixture
def hypotenuse() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("hypotenuse", [x], [ca.hypot(x, 1)])


@pytest.mark.parametrize(
    ("asked", "chosen"),
    [("casadi", "casadi"), ("llvm", "llvm"), ("auto", "llvm"), ("", "llvm")],
)
def test_environment_chooses(
    monkeypatch: pytest.MonkeyPatch, hypotenuse: ca.Function, asked: str, chosen: str
) -> None:
    monkeypatch.setenv(VARIABLE, asked)
    assert chosen_backend() == chosen
    assert served(function=hypotenuse).backend == chosen


def test_machine_code_is_chosen_where_nobody_asks() -> None:
    assert chosen_backend() == chosen_backend("auto") == "llvm"


@pytest.mark.parametrize("asked", ["casadi", "llvm"])
def test_caller_is_heard_before_the_environment(
    monkeypatch: pytest.MonkeyPatch, asked: str
) -> None:
    monkeypatch.setenv(VARIABLE, {"casadi": "llvm", "llvm": "casadi"}[asked])
    assert chosen_backend(asked) == asked


def test_nonsense_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidProblemError, match="auto, llvm, casadi, got 'gpu'"):
        chosen_backend("gpu")
    monkeypatch.setenv(VARIABLE, "nonsense")
    with pytest.raises(InvalidProblemError, match=f"{VARIABLE}.* got 'nonsense'"):
        chosen_backend()


def test_asking_for_casadi_warns_of_nothing(hypotenuse: ca.Function) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert served("casadi", function=hypotenuse).backend == "casadi"


def assert_casadi_serves(function: ca.Function, reason: str) -> None:
    """Check that CasADi evaluates rightly and that a warning names the reason."""
    with pytest.warns(BackendWarning, match=reason):
        batch = served(function=function)
    assert batch.backend == "casadi"
    want = [float(function(value)) for value in VALUES[0]]
    np.testing.assert_array_equal(batch.bind(())(VALUES)[0], want)


def test_operation_that_the_tape_does_not_know_is_left_to_casadi() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("inverse", [x], [ca.erfinv(x / 2)])
    assert_casadi_serves(function, "inverse has the operation erfinv")


def test_operation_that_the_emitter_does_not_know_is_left_to_casadi(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch, hypotenuse: ca.Function
) -> None:
    monkeypatch.delitem(operations.LIBRARY, "hypot")
    assert_casadi_serves(hypotenuse, "the operation hypot is not compiled")
    assert not fresh_cache.exists()


def test_matrix_function_is_left_to_casadi() -> None:
    x = ca.MX.sym("x")
    assert_casadi_serves(ca.Function("m", [x], [ca.sin(x)]), "m is no SX function")


def test_code_that_llvm_refuses_is_left_to_casadi(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch, hypotenuse: ca.Function
) -> None:
    monkeypatch.setitem(operations.LIBRARY, "hypot", "no function's name")
    assert_casadi_serves(hypotenuse, "LLVM refuses the code")


@pytest.fixture
def unknown_machine() -> Iterator[None]:
    """Find out anew what the machine is, and again after the test."""
    machine.cache_clear()
    yield
    machine.cache_clear()


@pytest.mark.usefixtures("unknown_machine")
def test_without_llvmlite_casadi_serves(
    monkeypatch: pytest.MonkeyPatch, hypotenuse: ca.Function
) -> None:
    monkeypatch.setattr(engine, "llvm", None)
    assert_casadi_serves(hypotenuse, "llvmlite is not installed")


@pytest.mark.usefixtures("unknown_machine")
def test_without_multiply_add_casadi_serves(
    monkeypatch: pytest.MonkeyPatch, hypotenuse: ca.Function
) -> None:
    triple = "x86_64-unknown-linux-gnu"
    monkeypatch.setattr(llvm, "get_process_triple", lambda: triple)
    monkeypatch.setattr(llvm, "get_host_cpu_features", dict)
    assert_casadi_serves(hypotenuse, "no fused multiply-add")
