from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp.compiled.emitter import emit_flat
from swarmstart.ocp.compiled.engine import link, machine, translate
from swarmstart.ocp.compiled.frame import Target, side_by_side
from swarmstart.ocp.compiled.simd import Shape, SimdBatch
from swarmstart.ocp.compiled.vectors.vector_ir import Precision
from swarmstart.tape import Tape, read_tape


def chain(x: ca.SX, steps: int = 50) -> ca.SX:
    """Steps each of which waits for the one before."""
    for _ in range(steps):
        x = 0.75 * x * (1 - x) + 0.1
    return x


def wide(x: ca.SX, values: int = 60) -> ca.SX:
    """Values that do not wait for each other."""
    return ca.vertcat(*((x + i) * (x - i) for i in range(values)))


def tape_of(make: Callable[[ca.SX], ca.SX]) -> Tape:
    x = ca.SX.sym("x")
    return read_tape(ca.Function("f", [x], [make(x)]))


def test_chain_is_interleaved_and_independent_values_are_not() -> None:
    assert side_by_side([tape_of(chain)], registers=1) in (2, 4)
    assert side_by_side([tape_of(wide)], registers=1) == 1


@pytest.mark.parametrize("registers", [2, 4])
def test_more_registers_a_vector_need_less_interleaving(registers: int) -> None:
    tapes = [tape_of(chain)]
    once = side_by_side(tapes, registers=1)
    assert side_by_side(tapes, registers=registers) <= once
    assert side_by_side(tapes, registers=16) == 1


def test_tapes_one_after_the_other_wait_for_each_other() -> None:
    """A second chain adds as much waiting as work; wide values only work."""
    alone = side_by_side([tape_of(chain)], registers=1)
    assert side_by_side([tape_of(chain)] * 2, registers=1) == alone
    assert side_by_side([tape_of(chain), tape_of(wide)], registers=1) <= alone


def test_nothing_to_do_is_not_interleaved() -> None:
    assert side_by_side([], registers=1) == 1
    assert side_by_side([tape_of(lambda x: x)], registers=1) == 1


def everything(x: ca.SX) -> ca.SX:
    names = "sin cos exp log tanh atan sinh sqrt floor".split()
    values = [getattr(ca, name)(x) for name in names]
    return ca.vertcat(*values, ca.fabs(x) ** x, ca.atan2(x, 2), chain(x))


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("size", [1, 9, 100])
def test_any_number_of_lanes_gives_the_same_bits(
    precision: Precision, size: int
) -> None:
    tape, here = tape_of(everything), machine()
    rng = np.random.default_rng(size)
    values = rng.normal(size=(1, size))
    values[0, rng.random(size) < 0.1] = 1e22
    values[0, -1:] = np.nan
    answers = []
    # A vector in single precision holds twice the numbers.
    for lanes in (8, 16, 32) if precision == "double" else (16, 32, 64):
        target = Target(
            lanes=lanes,
            precision=precision,
            register_bits=here.register_bits,
            has_scale=here.has_scale
            and lanes * (8 if precision == "double" else 4) >= 64,
        )
        code = link(translate(emit_flat(tape, per_individual=(True,), target=target)))
        kernel = SimdBatch(code, Shape((True,), (1,), (12,)))
        answers.append(kernel.evaluate([values])[0])
    np.testing.assert_array_equal(answers[1], answers[0])
    np.testing.assert_array_equal(answers[2], answers[0])
