import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.batch import compile_batch

pytestmark = pytest.mark.usefixtures("compiler")


@pytest.fixture
def function() -> ca.Function:
    """(x (2,), p) -> two outputs."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    return ca.Function("f", [x, p], [p * ca.sin(x), ca.sum1(ca.exp(x)) / p])


def population_of(size: int) -> Array:
    return np.random.default_rng(size).normal(size=(2, size))


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("size", [0, 1, 7, 9, 3000])
def test_any_argument_may_be_shared_or_not(
    function: ca.Function, backend: str, size: int
) -> None:
    evaluate, x = compile_batch(function, backend=backend), population_of(size)
    own = np.linspace(1, 2, size)[None]
    for p in (np.array([2.0]), own):
        for _ in range(2):
            first, second = evaluate(x, p)
            np.testing.assert_allclose(first, p * np.sin(x), rtol=1e-15, atol=1e-300)
            want = np.exp(x).sum(axis=0, keepdims=True) / p
            np.testing.assert_allclose(second, want, rtol=1e-15)


def test_one_output_is_one_array() -> None:
    x = ca.MX.sym("x", 2)
    evaluate = compile_batch(ca.Function("f", [x], [ca.sum1(x)]), backend="llvm")
    got = evaluate(np.ones((2, 5)))
    assert isinstance(got, np.ndarray)
    np.testing.assert_array_equal(got, np.full((1, 5), 2.0))


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("size", [9, 3000])
def test_results_are_not_overwritten_by_the_next_call(
    function: ca.Function, backend: str, size: int
) -> None:
    evaluate, x = compile_batch(function, backend=backend), population_of(size)
    evaluate(x, [2.0])
    first = evaluate(x, [2.0])
    kept = [output.copy() for output in first]
    evaluate(x + 1, [3.0])
    for output, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(output, copy)


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("size", [9, 3000])
def test_each_call_reads_its_own_arguments(
    function: ca.Function, backend: str, size: int
) -> None:
    """Read-only, transposed, of integers: in any memory, which may be gone later."""
    evaluate = compile_batch(function, backend=backend)
    for seed in range(4):
        x = np.random.default_rng(seed).integers(-3, 3, size=(2, size))
        given = [
            x.astype(float),
            np.asfortranarray(x.astype(float)),
            x,
            x.astype(float),
        ]
        given[3].flags.writeable = False
        for array in given:
            first, _ = evaluate(array, [2.0])
            np.testing.assert_allclose(first, 2 * np.sin(x), rtol=1e-15)


def test_casadi_s_map_is_made_once_for_each_size(function: ca.Function) -> None:
    evaluate = compile_batch(function, backend="casadi")
    for size in (5, 6, 5, 5, 6):
        evaluate(population_of(size), [2.0])
    assert sorted(size for _, size in evaluate._maps) == [5, 6]


def test_casadi_s_map_of_sparse_arguments_and_outputs_is_dense() -> None:
    x = ca.SX.sym("x", ca.Sparsity.lower(2))
    f = ca.Function("f", [x], [ca.diag(ca.diag(x)) * 2])
    given = np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0], [4.0, 8.0]])
    want = np.array([[2.0, 10.0], [0, 0], [0, 0], [8.0, 16.0]])
    for backend in ("llvm", "casadi"):
        found = compile_batch(f, backend=backend)(given)
        np.testing.assert_array_equal(found, want)


def test_prepared_function_evaluates_what_is_in_its_buffers(
    function: ca.Function,
) -> None:
    evaluate, x = compile_batch(function, backend="llvm"), population_of(9)
    prepared = evaluate.prepare(x, [2.0])
    prepared()
    for output, want in zip(prepared.outputs, evaluate(x, [2.0]), strict=True):
        np.testing.assert_array_equal(output, want)
    with pytest.raises(InvalidProblemError, match="prepare needs machine code"):
        compile_batch(function, backend="casadi").prepare(x, [2.0])


def test_single_precision_has_half_the_digits_and_double_arrays(
    function: ca.Function,
) -> None:
    x = population_of(100)
    got = compile_batch(function, backend="llvm", precision="single")(x, [2.0])
    want = compile_batch(function, backend="llvm")(x, [2.0])
    for output, reference in zip(got, want, strict=True):
        assert output.dtype == np.float64
        np.testing.assert_array_equal(output, output.astype(np.float32))
        np.testing.assert_allclose(output, reference, rtol=1e-6)
        assert not np.array_equal(output, reference)


def test_arguments_that_do_not_fit_are_refused(function: ca.Function) -> None:
    evaluate, x = compile_batch(function), population_of(4)
    with pytest.raises(InvalidProblemError, match="takes 2 arguments, got 1"):
        evaluate(x)
    with pytest.raises(InvalidProblemError, match=r"got \[4, 5\]"):
        evaluate(x, np.ones((1, 5)))
    with pytest.raises(InvalidProblemError, match="none of that shape"):
        evaluate(np.ones(2), np.ones(1))
    with pytest.raises(InvalidProblemError, match=r"argument 0 of f .* got \(3, 4\)"):
        evaluate(np.ones((3, 4)), np.ones(1))


def test_nonsense_is_refused(function: ca.Function) -> None:
    with pytest.raises(InvalidProblemError, match="double, single, got 'half'"):
        compile_batch(function, precision="half")  # type: ignore[arg-type]
    with pytest.raises(InvalidProblemError, match="nothing has no argument to vary"):
        compile_batch(ca.Function("nothing", [], [ca.SX(1)]))


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_gradient_is_one_more_output(backend: str, kind: type) -> None:
    """Of a closed form, by a matrix: its columns one below the other."""
    x, p = kind.sym("x", 2, 2), kind.sym("p")  # type: ignore[attr-defined]
    cost = p * ca.sumsqr(x) + ca.sin(x[0, 1])
    function = ca.Function("f", [x, p], [cost, 2 * cost])
    evaluate = compile_batch(function, backend=backend, gradient=True)
    population = np.random.default_rng(0).normal(size=(4, 600))
    value, twice, slope = evaluate(population, [0.3])
    np.testing.assert_allclose(twice, 2 * value)
    want = 0.6 * population
    want[2] += np.cos(population[2])
    np.testing.assert_allclose(slope, want, rtol=1e-13)


def test_gradient_of_a_column_or_of_a_kink_is_what_casadi_says() -> None:
    x = ca.SX.sym("x", 2)
    with pytest.raises(InvalidProblemError, match=r"output of f has shape \(2, 1"):
        compile_batch(ca.Function("f", [x], [x]), gradient=True)
    kink = compile_batch(ca.Function("f", [x], [ca.fabs(x[0])]), gradient=True)
    np.testing.assert_array_equal(kink(np.array([[-2.0], [1.0]]))[1], [[-1.0], [0.0]])
    constant = compile_batch(ca.Function("f", [x], [ca.SX(3)]), gradient=True)
    np.testing.assert_array_equal(constant(np.ones((2, 3)))[1], np.zeros((2, 3)))
