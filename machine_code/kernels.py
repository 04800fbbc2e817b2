"""The decorators of every function that Numba compiles; Numba is imported when needed.

Numba takes twice as long to import as CasADi and NumPy together, and no kernel is
needed to state a problem or to check a file. So a decorated function only stands for
its kernel, which `numba_kernels` makes when it is first called or asked for anything.
If another kernel calls it, Numba finds the kernel by a protocol of its own,
`_numba_type_`.
"""

import ctypes
from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Count = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., object])


class Pointers(NamedTuple):
    """A compiled function bound to buffers.

    Attributes:
        function: Address of void f(double **in, double **out, int64 size).
        inputs: Address of its first argument.
        outputs: Address of its second argument.
    """

    function: int
    inputs: int
    outputs: int


class Deferred:
    """A kernel or an intrinsic that is made at its first use."""

    def __init__(
        self, function: Callable[..., object], make: Callable[[Any], Any]
    ) -> None:
        """Keep a function, and how the module `numba_kernels` makes a kernel of it."""
        update_wrapper(self, function)
        self._function, self._make = function, make

    @cached_property
    def made(self) -> Any:
        """The kernel; the function itself with NUMBA_DISABLE_JIT=1."""
        from swarmstart.machine_code import numba_kernels  # As the module's head says.

        return self._make(numba_kernels)

    @property
    def _numba_type_(self) -> Any:
        """The type of the kernel, for a kernel that calls it."""
        from numba.core.registry import cpu_target

        context = cpu_target.typing_context
        context.refresh()  # An intrinsic is registered when it is made.
        return context.resolve_value_type(self.made)

    def __call__(self, *arguments: object) -> Any:
        """Call the kernel."""
        return self.made(*arguments)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the kernel, such as its compiled versions."""
        if name.startswith("__"):  # Copying and pickling ask for some of these.
            raise AttributeError(name)
        return getattr(self.made, name)

    def __reduce__(self) -> str:
        """Be pickled by name, as a function is."""
        return self._function.__qualname__


def kernel(function: Function) -> Function:
    """Compile a function with Numba at its first call, and keep the machine code."""
    return cast(Function, Deferred(function, lambda maker: maker.kernel(function)))


def ieee_kernel(function: Function) -> Function:
    """Compile a function as `kernel` does; a division by 0 gives infinity or NaN."""
    return cast(Function, Deferred(function, lambda maker: maker.ieee_kernel(function)))


def free_kernel(function: Function) -> Function:
    """Compile a function as `kernel` does; it runs without Python's lock (GIL)."""
    return cast(Function, Deferred(function, lambda maker: maker.free_kernel(function)))


def prepare(function: Callable[..., object], *arguments: object) -> None:
    """Load or compile a kernel for arguments of these types, without calling it.

    Args:
        function: A kernel; for any other function nothing is done.
        arguments: Values of the types that it will be called with.
    """
    if isinstance(function, Deferred):
        from swarmstart.machine_code import numba_kernels

        numba_kernels.prepare(function.made, *arguments)


def is_kernel(function: Callable[..., object]) -> bool:
    """Return whether Numba compiles a function, through this module or directly."""
    if isinstance(function, Deferred):
        return True
    from swarmstart.machine_code import numba_kernels

    return numba_kernels.is_kernel(function)


def is_kept(
    function: Callable[..., object], *arguments: object, for_kernel: bool
) -> bool:
    """Return whether a kernel need not be compiled for arguments of these types.

    Args:
        function: A kernel; another function needs no compiling.
        arguments: Values of the types that it will be called with.
        for_kernel: True if the code is for `address_of`, False if for calls from
            Python.
    """
    if not isinstance(function, Deferred):
        return True
    from swarmstart.machine_code import numba_kernels

    return numba_kernels.is_kept(function.made, *arguments, for_kernel=for_kernel)


def address_of(function: Callable[..., object], *arguments: object) -> int:
    """Return the address of a kernel's machine code, for `call_at`.

    The code stays at this address: Numba unloads no code as long as the process runs.

    Args:
        function: A kernel that returns None.
        arguments: Values of the types that it will be called with.
    """
    from swarmstart.machine_code import numba_kernels

    return numba_kernels.address_of(getattr(function, "made", function), *arguments)


def _call_at(address: int, arguments: tuple[object, ...]) -> None:
    """Call a kernel that returns None at its address.

    Args:
        address: That of `address_of`.
        arguments: Of the types that `address_of` was given.
    """


call_at = Deferred(_call_at, lambda maker: maker.call_at)


def _call_code(
    function: int, inputs: int, outputs: int, numbers: tuple[int, ...]
) -> None:
    """Call void f(double **in, double **out, int64...) at its address.

    Args:
        function: Its address.
        inputs: Address of the table of its arguments.
        outputs: Address of the table of its outputs.
        numbers: Its numbers.
    """
    tables, integers = [ctypes.c_void_p] * 2, [ctypes.c_int64] * len(numbers)
    code = ctypes.CFUNCTYPE(None, *tables, *integers)(int(function))
    code(int(inputs), int(outputs), *map(int, numbers))


# Without compilation the loops are plain Python, which knows no intrinsics.
call_code = Deferred(
    _call_code,
    lambda maker: _call_code if maker.numba.config.DISABLE_JIT else maker.call_code,
)
