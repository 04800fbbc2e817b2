"""Machine code called at its address, by compiled code and by plain Python."""

from collections.abc import Callable

import casadi as ca
import numba
import numpy as np
import pytest

from swarmstart.machine_code import call_code, kernels
from swarmstart.ocp.compiled.simd import compile_flat

pytestmark = pytest.mark.usefixtures("compiler")


@numba.njit
def _called(address: int, inputs: int, outputs: int, size: int, last: int) -> None:
    call_code(address, inputs, outputs, (size, 0, last))


def _in_python(address: int, inputs: int, outputs: int, size: int, last: int) -> None:
    kernels._call_code(address, inputs, outputs, (size, 0, last))


@pytest.mark.parametrize("call", [_called, _in_python])
def test_only_the_first_individuals_are_evaluated(
    call: Callable[[int, int, int, int, int], None],
) -> None:
    """Up to the end of the block that the last one is in."""
    x = ca.SX.sym("x")
    batch = compile_flat(ca.Function("f", [x], [2 * x]), (True,))
    prepared = batch.prepare(100)
    prepared.arguments[0][...] = np.arange(100.0)
    prepared.outputs[0][...] = -1.0
    _, inputs, outputs = prepared.pointers
    call(batch.part_address, inputs, outputs, 100, 10)
    found = prepared.outputs[0][0]
    np.testing.assert_array_equal(found[:10], 2 * np.arange(10))
    assert (found[64:] == -1.0).all()
