import ctypes
import mmap
import os
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.formation_flight.pose import pose
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.heuristics import Pointers
from swarmstart.ocp import Bounds, Model, OptimalControlProblem, PathConstraint
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled import simd
from swarmstart.ocp.compiled.backend import CasadiMap
from swarmstart.ocp.compiled.emitter import (
    Roll,
    emit_rollout,
    repeated_functions,
    simplified,
)
from swarmstart.ocp.compiled.engine import machine, translate
from swarmstart.ocp.compiled.frame import Target
from swarmstart.ocp.compiled.simd import SimdBatch, compile_flat, compile_rollout, split
from swarmstart.ocp.compiled.vectors.vector_ir import Precision
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.tape import read_tape

pytestmark = pytest.mark.usefixtures("compiler")

SIZES = (1, 7, 8, 9, 20, 1000)


@pytest.fixture(scope="module")
def kernel() -> SimdBatch:
    """(x (3,), p (2,)) -> two outputs, with polynomials, library and branches."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    power = ca.fabs(x[2]) ** x[1]
    first = ca.vertcat(ca.sin(x[0]) * p[0], ca.exp(x[1]) / x[2], ca.sinh(x[0]), power)
    second = ca.if_else(x[0] > p[1], ca.log(x[1]), ca.atan2(x[1], x[2]))
    function = ca.Function("f", [x, p], [first, second])
    return compile_flat(function, (True, False))


PARAMETERS = np.array([2.0, 0.25])


def population_of(size: int) -> Array:
    return np.random.default_rng(size).normal(size=(3, size))


@pytest.mark.parametrize("size", SIZES)
def test_size_does_not_change_any_individual(kernel: SimdBatch, size: int) -> None:
    """Bit for bit: no lane depends on its neighbours, nor on one's huge angle."""
    evaluate = kernel.bind((PARAMETERS,))
    population = population_of(size)
    population[0, size // 2] = 1e22
    population[:, size // 3] = np.nan
    population[1, size // 4] = -2.0
    together = evaluate(population)
    assert together.shape == (5, size)
    for i in range(min(size, 50)):
        alone = evaluate(population[:, i : i + 1])
        np.testing.assert_array_equal(together[:, i], alone[:, 0])


def test_empty_population_has_empty_outputs(kernel: SimdBatch) -> None:
    assert kernel.bind((PARAMETERS,))(np.empty((3, 0))).shape == (5, 0)
    outputs = kernel.evaluate([np.empty((3, 0)), PARAMETERS])
    assert [o.shape for o in outputs] == [(4, 0), (1, 0)]


@pytest.mark.parametrize(
    "laid_out",
    [
        np.asfortranarray,
        lambda a: np.repeat(a, 2, axis=1)[:, ::2],
        lambda a: a[:, ::-1].copy()[:, ::-1],
        lambda a: a.T.copy().T,
    ],
)
@pytest.mark.parametrize("size", [5, 20])
def test_layout_of_the_population_does_not_matter(
    kernel: SimdBatch, laid_out: Callable[[Array], Array], size: int
) -> None:
    evaluate = kernel.bind((PARAMETERS,))
    population = population_of(size)
    expected = evaluate(population)
    np.testing.assert_array_equal(evaluate(laid_out(population)), expected)


def test_whole_numbers_and_single_precision_are_converted(kernel: SimdBatch) -> None:
    evaluate = kernel.bind((np.array([1, 2]),))
    population: NDArray[Any] = population_of(9).astype(np.float32)
    expected = evaluate(population.astype(np.float64))
    np.testing.assert_array_equal(evaluate(population), expected)


@pytest.mark.parametrize("size", [3, 8, 20])
def test_arguments_stay_and_outputs_are_new(kernel: SimdBatch, size: int) -> None:
    evaluate = kernel.bind((PARAMETERS,))
    population = population_of(size)
    before = population.copy()
    population.setflags(write=False)
    first = evaluate(population)
    kept = first.copy()
    evaluate(population + 1)
    np.testing.assert_array_equal(population, before)
    np.testing.assert_array_equal(first, kept)


def test_shared_arguments_are_copied_when_bound(kernel: SimdBatch) -> None:
    parameters = PARAMETERS.copy()
    evaluate = kernel.bind((parameters,))
    population = population_of(9)
    before = evaluate(population)
    parameters[:] = 99
    np.testing.assert_array_equal(evaluate(population), before)


def test_sparse_matrix_constant_and_unused_arguments_are_casadi_s() -> None:
    """Every output equals that of CasADi's map; a matrix counts column by column."""
    x = ca.SX.sym("x", 2, 2)
    sparse, unused = ca.SX.sym("s", ca.Sparsity.lower(2)), ca.SX.sym("unused", 3)
    empty = ca.SX.sym("empty", 0)
    scattered = ca.SX(3, 2)
    scattered[2, 1] = x[1, 0] * sparse[1, 0]
    function = ca.Function(
        "f",
        [x, sparse, unused, empty],
        [x @ sparse, scattered, ca.SX([1.5, -2]), x, ca.SX(0, 1), x[0, 1]],
    )
    rng = np.random.default_rng(1)
    population, shared = rng.normal(size=(4, 9)), rng.normal(size=4)
    kernel = compile_flat(function, (True, False, False, False))
    results = kernel.bind((shared, np.empty(3), np.empty(0)))(population)
    got = split(results, kernel.shape.outputs)
    assert [o.shape for o in got] == [(4, 9), (6, 9), (2, 9), (4, 9), (0, 9), (1, 9)]
    for i in range(9):
        answers = function(
            population[:, i].reshape((2, 2), order="F"),
            shared.reshape((2, 2), order="F"),
            [3, 0, 1],
            ca.DM(0, 1),
        )
        for output, answer in zip(got, answers, strict=True):
            dense = np.array(ca.densify(answer)).reshape(-1, order="F")
            np.testing.assert_array_equal(output[:, i], dense)


def test_argument_without_entries_may_be_what_differs() -> None:
    function = ca.Function("f", [ca.SX.sym("x", 0), ca.SX.sym("p")], [ca.SX(3)])
    evaluate = compile_flat(function, (True, False)).bind((np.ones(1),))
    np.testing.assert_array_equal(evaluate(np.empty((0, 10))), np.full((1, 10), 3))


def test_several_arguments_may_differ_per_individual() -> None:
    x, y, p = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("p")
    kernel = compile_flat(ca.Function("f", [p, x, y], [p * x / y]), (False, True, True))
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 1, 11))
    got = kernel.evaluate([np.array([3.0]), a, b])[0]
    np.testing.assert_array_equal(got, 3.0 * a / b)


def test_arguments_of_another_size_are_refused(kernel: SimdBatch) -> None:
    """They would be read beyond their end."""
    with pytest.raises(InvalidProblemError, match=r"\(2,\) entries, got \(1,\)"):
        kernel.bind((np.ones(1),))
    with pytest.raises(InvalidProblemError, match=r"\(3,\) entries, got \(2,\)"):
        kernel.bind((PARAMETERS,))(np.ones((2, 9)))
    with pytest.raises(InvalidProblemError, match=r"shapes \(\(3, 9\), \(2,\)\), got"):
        kernel.evaluate([np.ones((3, 9)), np.ones(3)])


def test_kernel_with_another_argument_per_individual_is_not_bound() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    kernel = compile_flat(ca.Function("f", [x, y], [x * y]), (True, True))
    with pytest.raises(InvalidProblemError, match=r"first .* got \(True, True\)"):
        kernel.bind((np.ones(1),))


def test_buffers_of_another_kind_are_not_attached(kernel: SimdBatch) -> None:
    bound, population = kernel.bind((PARAMETERS,)), population_of(9)
    outputs = [np.empty((4, 9)), np.empty(9)]
    with pytest.raises(InvalidProblemError, match=r"\(3,\) entries, got \(2,\)"):
        bound.attach(population[:2], outputs)
    with pytest.raises(InvalidProblemError, match=r"\(36, 9\) entries, got \(9, 36\)"):
        bound.attach(population, outputs[::-1])
    with pytest.raises(InvalidProblemError, match="contiguous doubles"):
        bound.attach(np.asfortranarray(population), outputs)
    single: list[NDArray[Any]] = [np.empty((4, 9), dtype=np.float32), np.empty(9)]
    with pytest.raises(InvalidProblemError, match="contiguous doubles"):
        bound.attach(population, single)


def call(pointers: Pointers, size: int) -> None:
    """Call as a compiled caller does, by addresses."""
    signature = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    signature(pointers.function)(pointers.inputs, pointers.outputs, size)


def test_attached_buffers_are_not_those_of_later_calls(kernel: SimdBatch) -> None:
    bound = kernel.bind((PARAMETERS,))
    one, other = population_of(9), population_of(12)
    results = [np.empty((4, 9)), np.empty(9)]
    others = [np.empty((4, 12)), np.empty(12)]
    pointers, later = bound.attach(one, results), bound.attach(other, others)
    expected = bound(one)
    bound(population_of(20))
    assert pointers != later
    call(pointers, 9)
    np.testing.assert_array_equal(np.vstack(results), expected)
    one += 1  # Read at the call, not before.
    call(pointers, 9)
    np.testing.assert_array_equal(np.vstack(results), bound(one))


@pytest.mark.parametrize("huge", [1.0, 1e22])
@pytest.mark.parametrize("size", SIZES)
def test_attached_buffers_of_any_size_are_written_to_their_end_only(
    kernel: SimdBatch, size: int, huge: float
) -> None:
    """The masked lanes of the last block, and of one with an angle for the library."""
    beyond = 2 * 4 * machine().lanes
    bound, population = kernel.bind((PARAMETERS,)), population_of(size)
    population[0] *= huge
    given = np.full(3 * size + beyond, np.nan)
    given[: 3 * size] = population.ravel()
    memory = [np.full(rows * size + 2 * beyond, -7.0) for rows in (4, 1)]
    inside = [whole[beyond:-beyond] for whole in memory]
    pointers = bound.attach(given[: 3 * size].reshape(3, size), inside)
    call(pointers, size)
    np.testing.assert_array_equal(np.concatenate(inside), bound(population).ravel())
    for whole in memory:
        np.testing.assert_array_equal(whole[:beyond], -7.0)
        np.testing.assert_array_equal(whole[-beyond:], -7.0)
    np.testing.assert_array_equal(given[3 * size :], np.nan)


@pytest.mark.skipif(os.name == "nt", reason="pages are protected as POSIX has it")
@pytest.mark.parametrize("size", [1, 7, 9])
def test_nothing_beyond_the_population_is_read(kernel: SimdBatch, size: int) -> None:
    """The population ends where a page ends; the next must not be read."""
    room = mmap.mmap(-1, 2 * mmap.PAGESIZE)
    start = ctypes.addressof(ctypes.c_char.from_buffer(room))
    protect = ctypes.CDLL(None, use_errno=True).mprotect
    last = ctypes.c_void_p(start + mmap.PAGESIZE)
    assert protect(last, mmap.PAGESIZE, 0) == 0
    offset = mmap.PAGESIZE - 3 * size * 8
    population = np.frombuffer(room, np.float64, 3 * size, offset).reshape(3, size)
    population[...] = population_of(size)
    outputs = [np.empty((4, size)), np.empty(size)]
    bound = kernel.bind((PARAMETERS,))
    call(bound.attach(population, outputs), size)
    np.testing.assert_array_equal(np.vstack(outputs), bound(population))
    assert protect(last, mmap.PAGESIZE, mmap.PROT_READ | mmap.PROT_WRITE) == 0


def test_buffers_are_prepared_for_many_calls(kernel: SimdBatch) -> None:
    prepared, population = kernel.prepare(9), population_of(9)
    assert [a.shape for a in prepared.arguments] == [(3, 9), (2,)]
    prepared.arguments[0][...], prepared.arguments[1][...] = population, PARAMETERS
    for times in (1.0, 2.0):
        prepared.arguments[0][...] = times * population
        prepared()
        expected = kernel.bind((PARAMETERS,))(times * population)
        np.testing.assert_array_equal(prepared.results, expected)
        np.testing.assert_array_equal(np.vstack(prepared.outputs), expected)
    call(prepared.pointers, prepared.size)
    np.testing.assert_array_equal(prepared.results, expected)


def compiled_rollout(
    problem: OptimalControlProblem, precision: Precision = "double"
) -> SimdBatch:
    return compile_rollout(
        Shooting(problem).stage_without_path,
        Shooting(problem).terminal,
        intervals=problem.intervals,
        signals_per_interval=problem.ns * problem.checks,
        precision=precision,
    )


def assert_rolled_is_unrolled(
    problem: OptimalControlProblem,
    shared: tuple[Array, ...],
    population: Array,
    tolerance: float = 1e-13,
) -> None:
    """Compare with CasADi's rollout over the whole horizon.

    They differ by rounding, and by the 2 ulp of sin and cos.
    """
    got = compiled_rollout(problem).bind(shared)(population)
    want = CasadiMap(Shooting(problem).rollout).bind(shared)(population)
    np.testing.assert_allclose(got, want, rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module")
def formation_problems() -> list[OptimalControlProblem]:
    """The planning problems of a shipped scenario, of the first and last UAV."""
    scenario = resolve(read_document("formation_obstacle")).scenario
    assert isinstance(scenario, FormationScenario)
    problems = [agent.problem for agent in pose(scenario).agents]
    return sorted(problems, key=lambda p: p.ns)[:: len(problems) - 1]


def test_rolled_formation_problem_is_unrolled_one(
    formation_problems: list[OptimalControlProblem],
) -> None:
    rng = np.random.default_rng(1)
    assert formation_problems[0].ns < formation_problems[-1].ns
    for problem in formation_problems:
        lower, upper = problem.control_limits
        controls = rng.uniform(lower, upper, (100, problem.intervals, lower.size))
        x0 = np.array([15.0, 0.1, 0.0, 0.0]) + rng.normal(size=4)
        near = np.tile(x0[2:], (problem.ns - 4) // 2)
        signals = np.concatenate([x0, near])[:, None] + rng.normal(
            scale=20, size=(problem.ns, problem.nodes)
        )
        shared = (x0, np.empty(0), signals.reshape(-1, order="F"))
        population = controls.reshape(100, -1).T
        assert_rolled_is_unrolled(problem, shared, population)


@pytest.fixture(scope="module")
def damped() -> Model:
    """A pendulum whose length and damping are parameters."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("p", 2)
    turning = u[0] * ca.cos(u[1]) - p[0] * ca.sin(x[0]) - p[1] * x[1]
    return Model(states=x, controls=u, ode=ca.vertcat(x[1], turning), parameters=p)


def posed(
    model: Model, *, intervals: int = 4, signals: int = 2, **options: object
) -> OptimalControlProblem:
    """Return a problem with every kind of term."""
    x, u, p, s = model.states, model.controls, model.parameters, ca.SX.sym("s", signals)
    known = ca.sum1(s) if signals else ca.SX(0)
    return OptimalControlProblem(
        model,
        horizon=0.3 * intervals,
        intervals=intervals,
        stage_cost=ca.sumsqr(x - known) + p[1] * ca.sumsqr(u),
        terminal_cost=p[0] * ca.sumsqr(x) + known**2,
        bounds=Bounds(controls=(-2.0, 2.0), states=(-1.5, 1.5)),
        constraints=[PathConstraint(expression=x[0] * u[0] - known, upper=0.1)],
        terminal=[x[0] - known],
        signals=s,
        **options,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    "options",
    [
        {"quadrature": "integral", "checks": 1},
        {"quadrature": "integral", "checks": 3, "substeps": 2},
        {"quadrature": "left", "checks": 1, "substeps": 2},
        {"quadrature": "left", "checks": 3},
        {"signals": 0},
        {"signals": 0, "checks": 3, "quadrature": "left"},
        {"signals": 1, "integrator": "euler"},
        {"intervals": 1},
        {"intervals": 1, "signals": 0, "checks": 2},
        {"intervals": 100, "substeps": 1},
    ],
)
def test_rolled_problem_is_unrolled_one(
    damped: Model, options: dict[str, object]
) -> None:
    problem = posed(damped, **options)  # type: ignore[arg-type]
    rng = np.random.default_rng(1)
    shared = (
        rng.normal(size=2),
        np.array([9.81, 0.3, 0.7, 1.3]),  # And weights of two rows.
        rng.normal(scale=0.3, size=problem.ns * problem.nodes),
    )
    population = rng.uniform(-2, 2, (2 * problem.intervals, 21))
    # Over a long horizon the pendulum spreads what rounding differed at its start.
    tolerance = 1e-11 if problem.intervals > 10 else 1e-13
    assert_rolled_is_unrolled(problem, shared, population, tolerance)


def test_one_kernel_serves_every_state_and_parameter(
    damped: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = posed(damped, signals=1)
    kernel, mapped = compiled_rollout(problem), CasadiMap(Shooting(problem).rollout)
    monkeypatch.delattr(simd, "translate")
    monkeypatch.delattr(simd, "link")
    rng = np.random.default_rng(1)
    population = rng.uniform(-2, 2, (8, 10))
    shared = [(rng.normal(size=2), rng.random(4), rng.random(5)) for _ in range(4)]
    bound = [kernel.bind(given) for given in shared]
    for evaluate, given in zip(bound, shared, strict=True):
        want = mapped.bind(given)(population)
        np.testing.assert_allclose(evaluate(population), want, rtol=1e-13)


def test_code_does_not_grow_with_the_horizon(
    damped: Model, fresh_cache: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []

    def spied(ir: str, *, quickly: bool) -> bytes:
        code = translate(ir, quickly=quickly)
        sizes.append(len(code))
        return code

    monkeypatch.setattr(simd, "translate", spied)
    for intervals in (5, 500):
        compiled_rollout(posed(damped, intervals=intervals))
    assert sizes[1] <= sizes[0] + 100


@pytest.fixture(scope="module")
def turning(unicycle: Model) -> OptimalControlProblem:
    """A unicycle whose h / 6 is a power of two, so that huge headings stay exact."""
    return OptimalControlProblem(
        unicycle,
        horizon=0.375 * 16,
        intervals=16,
        stage_cost=unicycle.states[0] ** 2 + ca.sumsqr(unicycle.states[2:]),
        terminal_cost=ca.sumsqr(unicycle.states),
        quadrature="left",
        substeps=1,
    )


def turned(rng: np.random.Generator, size: int) -> Array:
    """Accelerations, and turn rates in sixteenths."""
    controls = rng.uniform(-2, 2, (16, 2, size))
    controls[:, 1] = np.round(16 * controls[:, 1]) / 16
    return controls.reshape(32, size)


def unicycle_answers(
    problem: OptimalControlProblem, x0: list[float], population: Array
) -> tuple[Array, Array]:
    """Return what machine code and CasADi compute."""
    shared = (np.array(x0), np.empty(0), np.empty(0))
    got = compiled_rollout(problem).bind(shared)(population)
    return got, CasadiMap(Shooting(problem).rollout).bind(shared)(population)


@pytest.mark.parametrize("heading", [0.0, -0.4, 1e6, 2.0**30, 1e12, -1e12])
def test_carried_sine_of_a_turning_unicycle_is_casadi_s(
    turning: OptimalControlProblem, heading: float
) -> None:
    """A step ends with the sine that the next begins with, a huge angle's too."""
    population = turned(np.random.default_rng(1), 21)
    got, want = unicycle_answers(turning, [1.0, heading, 0.0, 2.0], population)
    np.testing.assert_allclose(got, want, rtol=1e-12)


@pytest.mark.parametrize("interval", [0, 3, 15])
def test_huge_turn_of_one_individual_is_casadi_s_and_leaves_the_others(
    turning: OptimalControlProblem, interval: int
) -> None:
    population = turned(np.random.default_rng(2), 21)
    population[2 * interval + 1, [4, 9, 17]] = 2.0**33, np.nan, np.inf
    got, want = unicycle_answers(turning, [1.0, 0.125, 0.0, 2.0], population)
    np.testing.assert_allclose(got, want, rtol=1e-12)
    assert np.isnan(got[0]).tolist() == [i in (9, 17) for i in range(21)]
    others = np.delete(np.arange(21), [4, 9, 17])
    population = population[:, others]
    alone, _ = unicycle_answers(turning, [1.0, 0.125, 0.0, 2.0], population)
    np.testing.assert_array_equal(got[:, others], alone)


def test_heading_that_is_no_number_is_casadi_s(turning: OptimalControlProblem) -> None:
    population = turned(np.random.default_rng(3), 9)
    got, want = unicycle_answers(turning, [1.0, np.nan, 0.0, 2.0], population)
    np.testing.assert_array_equal(got, want)
    assert np.isnan(got[0]).all()


def test_stage_of_a_turning_unicycle_computes_one_angle_less(
    turning: OptimalControlProblem,
) -> None:
    """At the beginning, in the middle and at the end; the last is the next's first."""
    stage = simplified(read_tape(Shooting(turning).stage_without_path))
    sines = [node for node in stage.nodes if node.operation == "sin"]
    carried = repeated_functions(stage)
    assert len(sines) == 3
    assert sorted(stage.nodes[now].operation for _, now, _ in carried) == ["cos", "sin"]
    roll = Roll(
        stage=stage,
        end=read_tape(Shooting(turning).terminal),
        intervals=turning.intervals,
        signals_per_interval=0,
        decided=(None,) * turning.model.nx,
    )
    kernel, *_ = emit_rollout(roll, target=Target(lanes=8)).split("define internal")
    _, loop = kernel.rsplit(" = phi ", 1)
    assert loop.count("@vector_sin_and_cos(") == 2


def test_rollout_in_single_precision_is_near_the_double_one(
    turning: OptimalControlProblem, damped: Model
) -> None:
    rng = np.random.default_rng(4)
    swinging = posed(damped)
    cases = [
        (
            turning,
            (np.array([1.0, 0.1, 0.0, 2.0]), np.empty(0), np.empty(0)),
            turned(rng, 100),
        ),
        (
            swinging,
            (
                rng.normal(size=2),
                np.array([9.81, 0.3, 0.7, 1.3]),  # And weights of two rows.
                rng.normal(scale=0.3, size=swinging.ns * swinging.nodes),
            ),
            rng.uniform(-2, 2, (8, 100)),
        ),
    ]
    for problem, shared, population in cases:
        want = compiled_rollout(problem).bind(shared)(population)
        got = compiled_rollout(problem, "single").bind(shared)(population)
        assert got.dtype == np.float64
        assert np.all(np.abs(got - want) <= 1e-4 * (1 + np.abs(want)))
        assert not np.array_equal(got, want)
        np.testing.assert_array_equal(got, got.astype(np.float32))
