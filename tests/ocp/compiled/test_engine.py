import gc
from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import llvmlite
import llvmlite.binding as llvm
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.ocp.compiled import engine
from swarmstart.ocp.compiled.emitter import emit_flat
from swarmstart.ocp.compiled.engine import NoCompilerError, link, machine, translate
from swarmstart.ocp.compiled.simd import Shape, SimdBatch, compile_flat
from swarmstart.ocp.compiled.tape import OPERATIONS, read_tape

Array = NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("compiler")


@pytest.fixture
def unknown_machine() -> Iterator[None]:
    """Find out anew what the machine is, and again after the test."""
    machine.cache_clear()
    yield
    machine.cache_clear()


@pytest.mark.usefixtures("unknown_machine")
def test_missing_llvmlite_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "llvm", None)
    with pytest.raises(NoCompilerError, match="llvmlite is not installed"):
        machine()


@pytest.mark.usefixtures("unknown_machine")
def test_old_llvmlite_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(llvmlite, "__version__", "0.44.0rc1")
    with pytest.raises(NoCompilerError, match=r"at least 0\.45, got 0\.44\.0rc1"):
        machine()


@pytest.mark.usefixtures("unknown_machine")
def test_missing_multiply_add_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    triple = "x86_64-unknown-linux-gnu"
    monkeypatch.setattr(llvm, "get_process_triple", lambda: triple)
    monkeypatch.setattr(llvm, "get_host_cpu_features", dict)
    with pytest.raises(NoCompilerError, match="no fused multiply-add"):
        machine()


@pytest.mark.usefixtures("unknown_machine")
def test_missing_library_function_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """LLVM would end the process where the code calls it."""
    monkeypatch.setattr(engine, "C_FUNCTIONS", ("sin", "no_such_function"))
    with pytest.raises(NoCompilerError, match="no_such_function"):
        machine()


def test_code_that_llvm_cannot_read_is_refused() -> None:
    with pytest.raises(NoCompilerError, match="LLVM refuses the code"):
        translate("define nonsense")


def test_kernel_outlives_everything_but_itself() -> None:
    x = ca.SX.sym("x")
    call = compile_flat(ca.Function("f", [x], [ca.sinh(x)]), (True,)).bind(())
    gc.collect()
    np.testing.assert_array_equal(call(np.zeros((1, 9)))[0], 0.0)


def everything() -> ca.Function:
    """Return a function of two arguments that uses every polynomial."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    names = "sin cos exp log tanh atan sqrt floor fabs".split()
    values = [getattr(ca, name)(x) for name in names]
    return ca.Function(
        "f", [x, y], [ca.vertcat(*values, ca.atan2(x, y), ca.fmin(x, y), x / y, x * y)]
    )


def test_code_for_a_lesser_processor_gives_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """So a run is repeated bit for bit on another machine."""
    here = machine()
    if not here.triple.startswith("x86_64"):
        pytest.skip("compares processors of the x86 family")
    function = everything()
    ir = emit_flat(read_tape(function), per_individual=(True, True), lanes=here.lanes)
    lesser = replace(here, cpu="haswell", features="+avx2,+fma,-avx512f")
    values = np.random.default_rng(1).normal(size=(2, 1, 200))
    values[:, :, :5] = [1e22, -1e-310, np.inf, np.nan, 0.0]
    shape = Shape((True, True), (1, 1), (function.numel_out(0),))
    answers = []
    for target in (here, lesser):
        monkeypatch.setattr(engine, "machine", lambda target=target: target)
        answers.append(SimdBatch(link(translate(ir)), shape).evaluate(list(values))[0])
    np.testing.assert_array_equal(answers[0], answers[1])


def test_code_for_arm_is_made_of_every_operation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Translated only, as far as a test on another processor can go."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    arm = replace(
        machine(), triple="aarch64-unknown-linux-gnu", cpu="generic", features=""
    )
    monkeypatch.setattr(engine, "machine", lambda: arm)
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    values = [ca.SX.binary(code, x, y) for code in OPERATIONS]
    tape = read_tape(ca.Function("f", [x, y], [ca.vertcat(*values)]))
    ir = emit_flat(tape, per_individual=(True, True), lanes=4)
    assert translate(ir).startswith(b"\x7fELF")
