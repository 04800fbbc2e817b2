"""Machine code of small functions."""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.compiled.simd import compile_flat
from swarmstart.ocp.compiled.vectors.vector_ir import Precision

Evaluate = Callable[..., tuple[Array, ...]]


@pytest.fixture(scope="session")
def compiled(compiler: None) -> Callable[..., Evaluate]:
    """(inputs, outputs) -> machine code of arrays (rows, n), all per individual."""

    def compile_(
        inputs: Sequence[ca.SX],
        outputs: Sequence[ca.SX],
        precision: Precision = "double",
    ) -> Evaluate:
        function = ca.Function("f", list(inputs), list(outputs))
        kernel = compile_flat(function, (True,) * len(inputs), precision=precision)
        return lambda *arguments: kernel.evaluate(arguments)

    return compile_


@pytest.fixture(scope="session")
def by_casadi() -> Callable[..., Array]:
    """(function, arguments (rows, n)) -> its first output by CasADi, (rows, n)."""

    def evaluate(function: ca.Function, *arguments: Array) -> Array:
        mapped = function.map(arguments[0].shape[1])
        answer = mapped.call([ca.DM(np.atleast_2d(a)) for a in arguments])[0]
        return np.array(ca.densify(answer))

    return evaluate


@pytest.fixture(scope="session")
def ulps_apart() -> Callable[[Array, Array], Array]:
    """(a, b) -> doubles between them; NaN is 0 from NaN and far from all else."""

    def place(values: Array) -> NDArray[np.object_]:
        bits = np.ascontiguousarray(values, dtype=np.float64).view(np.int64)
        ordered = np.where(bits < 0, np.iinfo(np.int64).min - bits, bits)
        return ordered.astype(object)

    def count(a: Array, b: Array) -> Array:
        apart: Array = np.abs(place(a) - place(b)).astype(np.float64)
        either, both = np.isnan(a) | np.isnan(b), np.isnan(a) & np.isnan(b)
        apart[either] = np.inf
        apart[both] = 0.0
        return apart

    return count
