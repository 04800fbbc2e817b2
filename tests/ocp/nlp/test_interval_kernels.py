"""Machine code of an NLP's intervals: CasADi's own values are the oracle."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import IpoptOptions, NlpOptions, OptimalControlProblem, Planner
from swarmstart.ocp.compiled import simd
from swarmstart.ocp.compiled.engine import NoCompilerError
from swarmstart.ocp.compiled.simd import Prepared
from swarmstart.ocp.nlp import interval_kernels, transcription
from swarmstart.ocp.nlp.interval_kernels import IntervalKernel, over_intervals
from swarmstart.ocp.nlp.transcription import NonlinearProgram, multiple_shooting
from swarmstart.tests.ocp.feature_pairs.features import drawn

N = 7
FEATURES = (
    "free end time", "tied start", "signal in rates", "moving limit", "jump",
    "soft constraint", "algebraic variable", "penalised moves", "terminal equality",
)  # fmt: skip
Posed = tuple[OptimalControlProblem, Array, object]


@pytest.fixture
def always_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile small problems too."""
    monkeypatch.setattr(transcription, "_AS_FAST", -1)


def values_at(program: NonlinearProgram, seed: int) -> list[Array]:
    """Return all functions of an NLP at a drawn point, as dense arrays."""
    rng, nlp = np.random.default_rng(seed), program.nlp
    w, q, g = (int(nlp[name].numel()) for name in ("x", "p", "g"))
    # Not near zero: the sizes among the parameters are divisors.
    at = 0.5 + rng.random(w), 0.5 + rng.random(q)
    own = ca.Function("own", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]])
    found = [*own(*at)]
    found += [*program.derivatives["grad_f"](*at), *program.derivatives["jac_g"](*at)]
    found.append(program.derivatives["hess_lag"](*at, 0.7, rng.normal(size=g)))
    return [np.array(ca.densify(one)) for one in found]


@pytest.mark.usefixtures("always_compiled")
@pytest.mark.parametrize("feature", FEATURES)
def test_all_functions_equal_those_of_casadi(feature: str) -> None:
    problem = drawn((feature,), np.random.default_rng(3)).problem()
    compiled = multiple_shooting(problem, compiled=True)
    assert all(isinstance(one, IntervalKernel) for one in compiled.kernels)
    interpreted = multiple_shooting(problem)
    assert not any(isinstance(one, IntervalKernel) for one in interpreted.kernels)
    for seed in (1, 2):
        both = (values_at(one, seed) for one in (compiled, interpreted))
        for mine, theirs in zip(*both, strict=True):
            largest = max(1.0, np.abs(theirs).max(initial=0))
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12 * largest)


def stage() -> ca.Function:
    """Return (x, p, l) -> two outputs, the second of them sparse."""
    x, p, scale = ca.SX.sym("x", 2), ca.SX.sym("p"), ca.SX.sym("l")
    slope = ca.jacobian(ca.vertcat(p * x[0] ** 3, ca.sin(x[1])), x)
    return ca.Function("stage", [x, p, scale], [scale * ca.sum1(x), slope])


def columns(seed: int) -> tuple[Array, float, Array]:
    """Return drawn arguments of all intervals."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(2, N)), float(rng.normal()), rng.normal(size=(1, N))


def test_results_belong_to_the_arguments_of_the_same_call() -> None:
    """The last results are used again, if nothing has changed at all."""
    kernel = IntervalKernel(stage(), N, {1})
    oracle = stage().map("stage", "serial", N, [1], [])
    x, p, scale = columns(1)
    other, nan = x.copy(), x.copy()
    other[1, N - 1] += 1.0
    nan[0, 0] = np.nan
    calls = [(x, p), (x, p), (other, p), (x, p), (x, 2 * p), (nan, p), (x, p), (-x, p)]
    for at, parameter in calls:
        found, expected = (f(at, parameter, scale) for f in (kernel, oracle))
        for mine, theirs in zip(found, expected, strict=True):
            assert mine.sparsity() == theirs.sparsity()
            np.testing.assert_allclose(np.array(mine), np.array(theirs), rtol=1e-15)


def test_a_call_during_another_has_memory_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two threads can do this: Python's lock is free while machine code runs."""
    kernel, begin = IntervalKernel(stage(), N, {1}), Prepared.__call__
    alone = [np.array(kernel(*columns(seed))[0]) for seed in (1, 2)]
    inner = list[Array]()

    def disturbed(prepared: Prepared) -> None:
        if not inner:
            inner.append(np.empty(0))  # The inner call is not disturbed.
            inner.append(np.array(kernel(*columns(2))[0]))
        begin(prepared)

    monkeypatch.setattr(Prepared, "__call__", disturbed)
    outer = np.array(kernel(*columns(1))[0])
    np.testing.assert_array_equal(outer, alone[0])
    np.testing.assert_array_equal(inner[1], alone[1])


def test_functions_that_are_too_long_are_left_to_casadi(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(interval_kernels, "MOST_INSTRUCTIONS", 3)
    several = over_intervals(stage(), N, [1], apart=((0,), (1,)), compiled=True)
    assert len(several) == 2  # Each evaluates what it is needed for.
    oracle = stage().map("stage", "serial", N, [1], [])(*columns(3))
    for one, theirs in zip(several, oracle, strict=True):
        assert not isinstance(one, IntervalKernel)
        np.testing.assert_array_equal(np.array(one(*columns(3))), np.array(theirs))
        assert one.n_instructions() < oracle_length()


def test_functions_that_llvm_refuses_in_the_background_are_interpreted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(ir: str, *, quickly: bool) -> bytes:
        raise NoCompilerError(f"refused {len(ir)} {quickly}")

    monkeypatch.setattr(simd, "load_code", lambda _: None)
    monkeypatch.setattr(simd, "translate", refused)
    kernel = IntervalKernel(stage(), N, {1})
    oracle = stage().map("stage", "serial", N, [1], [])
    for seed in (1, 2, 1):
        found, expected = (f(*columns(seed)) for f in (kernel, oracle))
        for mine, theirs in zip(found, expected, strict=True):
            assert mine.sparsity() == theirs.sparsity()
            np.testing.assert_array_equal(np.array(mine), np.array(theirs))


def oracle_length() -> int:
    """Return the number of instructions of the whole function, mapped."""
    return int(stage().map("stage", "serial", N, [1], []).n_instructions())


def test_a_polish_on_machine_code_ends_where_casadi_ends(
    swing_up: Callable[..., OptimalControlProblem],
) -> None:
    found = []
    for backend in ("llvm", "casadi"):
        planner = Planner(
            swing_up(50, 4), search=None, polish=IpoptOptions(), backend=backend
        )
        assert planner.polisher is not None and planner.polisher.program is not None
        kernels = planner.polisher.program.kernels
        assert any(isinstance(k, IntervalKernel) for k in kernels) == (
            backend == "llvm"
        )
        found.append(planner.plan([0, 0], rng=np.random.default_rng(0)))
    one, other = found
    assert one.cost == pytest.approx(other.cost, rel=1e-8)
    np.testing.assert_allclose(one.controls, other.controls, atol=1e-6)


def test_other_solvers_differentiate_casadis_own_functions(
    swing_up: Callable[..., OptimalControlProblem],
) -> None:
    options = NlpOptions(plugin="sqpmethod", options={"max_iter": 1})
    planner = Planner(swing_up(50, 4), search=None, polish=options, backend="llvm")
    assert planner.polisher is not None and planner.polisher.program is not None
    kernels = planner.polisher.program.kernels
    assert not any(isinstance(k, IntervalKernel) for k in kernels)
