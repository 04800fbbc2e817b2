"""Populations spread over threads."""

import os
import threading
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.benchmarks.problems import bicycle
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.compiled.batch import compile_batch
from swarmstart.ocp.compiled.threads import LEAST, in_parts, parts_of
from swarmstart.ocp.rollout.fitness import Fitness


@pytest.fixture
def angles() -> ca.Function:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    return ca.Function("angles", [x, p], [ca.tan(x[0]) + p * ca.erf(x[1])])


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("size", [0, 1, LEAST, 2 * LEAST - 1, 2 * LEAST, 5 * LEAST + 3])
def test_parts_are_all_individuals_each_once(size: int, threads: int) -> None:
    parts = parts_of(size, threads)
    numbers = [i for first, last in parts for i in range(first, last)]
    assert numbers == list(range(size))
    assert len(parts) <= threads


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("size", [1, 7, 1000, 1001, 4097])
@pytest.mark.parametrize("threads", [2, 3, 8])
def test_any_number_of_threads_gives_the_same_bits(
    angles: ca.Function, size: int, threads: int
) -> None:
    """Angles beyond 2^30, which the C library serves, among them."""
    rng = np.random.default_rng(0)
    population, p = rng.normal(size=(2, size)), np.array([0.3])
    population[0, ::13] = 1e12
    want = compile_batch(angles, backend="llvm")(population, p)
    several = compile_batch(angles, backend="llvm", threads=threads)
    for _ in range(2):  # Small ones go through buffers from the second call on.
        np.testing.assert_array_equal(several(population, p), want)
    prepared = several.prepare(population, p)
    prepared()
    np.testing.assert_array_equal(prepared.results, want)


@pytest.mark.usefixtures("compiler")
def test_rollouts_on_two_threads_have_the_same_bits() -> None:
    instance = bicycle()
    population = instance.population(3000, np.random.default_rng(0))
    values = [
        Fitness(instance.problem, threads=threads).objective(
            instance.x0, instance.known
        )(population)
        for threads in (1, 2)
    ]
    np.testing.assert_array_equal(values[0], values[1])


@pytest.mark.usefixtures("compiler")
def test_parts_run_in_several_threads_without_python_s_lock() -> None:
    """Each waits for the other, which one thread alone would never end."""
    met = threading.Barrier(2, timeout=30)
    seen = set()

    def part(first: int, last: int) -> None:
        del first, last
        met.wait()
        seen.add(threading.get_ident())

    in_parts(part, 2 * LEAST, 2)
    assert len(seen) == 2


def test_failure_in_a_part_is_raised_after_all_have_ended() -> None:
    ended = []

    def part(first: int, last: int) -> None:
        if first:
            raise ValueError("no part")
        ended.append(last)

    with pytest.raises(ValueError, match="no part"):
        in_parts(part, 2 * LEAST, 2)
    assert ended


@pytest.mark.usefixtures("compiler")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_process_that_was_forked_has_threads_of_its_own(
    angles: ca.Function, tmp_path: Path
) -> None:
    population = np.random.default_rng(0).normal(size=(2, 4 * LEAST))
    several = compile_batch(angles, backend="llvm", threads=2)
    want = several(population, np.array([0.3]))
    child = os.fork()
    if not child:  # pragma: no cover - another process
        np.save(tmp_path / "found.npy", several(population, np.array([0.3])))
        os._exit(0)
    os.waitpid(child, 0)
    np.testing.assert_array_equal(np.load(tmp_path / "found.npy"), want)


@pytest.mark.parametrize("threads", [0, -1, 1.5])
def test_threads_must_be_a_positive_whole_number(
    angles: ca.Function, threads: int
) -> None:
    with pytest.raises(InvalidProblemError, match="threads must be an integer of at"):
        compile_batch(angles, threads=threads)
