"""The decorators of every function that Numba compiles.

Numba is imported untyped; this is the one place where that meets the type checker.
The machine code is cached next to the module. With NUMBA_DISABLE_JIT=1 the same
functions run as plain Python. No fast-math: both give the same bits.

Numba's cache looks at the file of the cached function only. After a change to a kernel
that kernels of other modules call, delete `heuristics/__pycache__`.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Count = NDArray[np.int64]

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Compile a function with Numba at its first call, and cache the machine code."""
    return cast(Function, numba.njit(cache=True)(function))


def ieee_kernel(function: Function) -> Function:
    """Compile likewise; a division by zero gives infinity or NaN, and no error."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))
