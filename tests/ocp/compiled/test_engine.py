import gc
import math
from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import llvmlite
import llvmlite.binding as llvm
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.compiled import engine
from swarmstart.ocp.compiled.emitter import emit_flat
from swarmstart.ocp.compiled.engine import (
    Machine,
    NoCompilerError,
    link,
    machine,
    translate,
)
from swarmstart.ocp.compiled.frame import Target, target_of
from swarmstart.ocp.compiled.simd import Shape, SimdBatch, compile_flat
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS, Precision
from swarmstart.tape import OPERATIONS, read_tape

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


def test_code_that_would_take_minutes_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engine, "MOST_CHARACTERS", 3)
    with pytest.raises(NoCompilerError, match="at most 3 characters"):
        translate("; ir")


def test_very_long_code_is_translated_without_optimisation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    x = ca.SX.sym("x", 3)
    f = ca.Function("f", [x], [ca.exp(x[0]) * x[1] ** 2.5 + ca.sin(x[2])])
    tape, target = read_tape(f), target_of([read_tape(f)], "double")
    ir = emit_flat(tape, per_individual=(True,), target=target)
    monkeypatch.setattr(engine, "MOST_OPTIMISED", len(ir))
    optimised, quick = translate(ir), translate(ir, quickly=True)
    monkeypatch.setattr(engine, "MOST_OPTIMISED", len(ir) - 1)
    assert translate(ir) == quick != optimised


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


UNARY = "sin cos exp log tanh atan sqrt floor fabs".split()
NAMES = [*UNARY, "atan2", "fmin", "div", "mul", "pow"]


def everything() -> ca.Function:
    """Return a function of two arguments that uses every polynomial."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    values = [getattr(ca, name)(x) for name in UNARY]
    pairs = ca.vertcat(ca.atan2(x, y), ca.fmin(x, y), x / y, x * y, x**y)
    return ca.Function("f", [x, y], [ca.vertcat(*values, pairs)])


def evaluated(
    monkeypatch: pytest.MonkeyPatch,
    function: ca.Function,
    values: Array,
    on: Machine,
    target: Target,
) -> Array:
    """Return the first output of code made for a machine, run here."""
    shape = Shape((True, True), (1, 1), (function.numel_out(0),))
    ir = emit_flat(read_tape(function), per_individual=(True, True), target=target)
    with monkeypatch.context() as patch:
        patch.setattr(engine, "machine", lambda: on)
        return SimdBatch(link(translate(ir)), shape).evaluate(list(values))[0]


@pytest.fixture
def lesser() -> Machine:
    """This machine without its long registers."""
    here = machine()
    if not here.triple.startswith("x86_64"):
        pytest.skip("compares processors of the x86 family")
    features = "+avx2,+fma,-avx512f"
    return replace(
        here, cpu="haswell", features=features, register_bits=256, has_scale=False
    )


@pytest.fixture(scope="module")
def many_values() -> Array:
    """Arguments of two-argument functions: (2, 1, n), special ones among them."""
    rng = np.random.default_rng(1)
    values = rng.normal(size=(2, 1, 3000))
    values[:, :, :1000] *= np.exp2(rng.integers(-60, 60, (2, 1, 1000)))
    values[0, :, 1000:2000] = rng.uniform(-746, -700, 1000)
    # Of log base * exponent, from where powers are denormal to if they are 0.
    values[1, :, 2000:] = rng.uniform(-750, 720, 1000) / np.log(math.e + 1)
    values[0, :, 2000:] = math.e + 1
    values[:, :, :5] = [1e22, -1e-310, np.inf, np.nan, 0.0]
    return values


@pytest.mark.parametrize("precision", ["double", "single"])
def test_code_for_a_lesser_processor_gives_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
    lesser: Machine,
    many_values: Array,
    precision: Precision,
) -> None:
    """So a run is repeated bit for bit on another machine."""
    target = Target(lanes=16, precision=precision, register_bits=256)
    function = everything()
    answers = [
        evaluated(monkeypatch, function, many_values, on, target)
        for on in (machine(), lesser)
    ]
    np.testing.assert_array_equal(answers[0], answers[1])


@pytest.mark.parametrize("precision", ["double", "single"])
def test_scaling_at_once_changes_denormal_results_only(
    monkeypatch: pytest.MonkeyPatch,
    lesser: Machine,
    many_values: Array,
    precision: Precision,
) -> None:
    """In two steps they are rounded twice: one denormal apart at most."""
    here, function = machine(), everything()
    if not here.has_scale:
        pytest.skip("needs AVX-512")
    targets = {
        machine_: Target(
            lanes=16,
            precision=precision,
            register_bits=machine_.register_bits,
            has_scale=machine_.has_scale,
        )
        for machine_ in (here, lesser)
    }
    at_once, in_two = (
        evaluated(monkeypatch, function, many_values, on, target)
        for on, target in targets.items()
    )
    form = FORMATS[precision]
    smallest_denormal = form.smallest * 2.0**-form.significand
    apart = (at_once != in_two) & ~(np.isnan(at_once) & np.isnan(in_two))
    assert np.all(np.abs(at_once[apart]) <= form.smallest)
    difference = np.abs(at_once[apart] - in_two[apart])
    np.testing.assert_array_equal(difference, smallest_denormal)
    names = {NAMES[row] for row in np.nonzero(apart)[0]}
    assert names <= {"exp", "pow", "tanh"}


@pytest.mark.parametrize("precision", ["double", "single"])
def test_code_for_arm_is_made_of_every_operation(
    monkeypatch: pytest.MonkeyPatch, precision: Precision
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
    target = Target(lanes=8, precision=precision, register_bits=128)
    ir = emit_flat(tape, per_individual=(True, True), target=target)
    assert translate(ir).startswith(b"\x7fELF")
