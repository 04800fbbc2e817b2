"""The kernels that Numba makes of functions, and the cache of their code.

Numba is imported untyped; only this module has to deal with that. With
NUMBA_DISABLE_JIT=1 the same functions run as plain Python. Fast-math is off, so
compiled and plain code give the same bits.

Numba's own cache keeps code beside the source, under the hash of the file that holds
the function. It does not notice a change in another file that the function calls. Here
code is kept in `code_cache`, under a key of everything that it is made from: the
function's fingerprint, the types it is compiled for, the processor, and the versions
and options of Numba, LLVM, NumPy and Python.
"""

import hashlib
import logging
import pickle
import platform
import sys
from collections.abc import Callable
from contextvars import ContextVar
from functools import cache
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils
from numba.core import types as numba_types
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.core.types import unliteral
from numba.extending import intrinsic

from swarmstart.machine_code.clocks import announce, compiling
from swarmstart.machine_code.code_cache import cache_refusal, load_code, store_code
from swarmstart.machine_code.fingerprints import (
    CALLED_FROM_PYTHON,
    UnknownValueError,
    fingerprint,
)

Function = TypeVar("Function", bound=Callable[..., object])

_ANNOUNCED = {
    "heuristics": ("the search", "about 10 s"),
    "terminal_set": ("interval arithmetic", "some seconds"),
}
_OTHER = "kernels", "some seconds"
log = logging.getLogger(__name__)

_OPTIONS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "ENABLE_AVX")
"""The settings of Numba that change the code it makes."""


def kernel(function: Function) -> Function:
    """Return a function that Numba compiles, as `kernels.kernel` says."""
    return _compiled(function)


def ieee_kernel(function: Function) -> Function:
    """Return a function that Numba compiles, as `kernels.ieee_kernel` says."""
    return _compiled(function, error_model="numpy")


def free_kernel(function: Function) -> Function:
    """Return a function that Numba compiles, as `kernels.free_kernel` says."""
    return _compiled(function, nogil=True)


def prepare(function: Callable[..., object], *arguments: object) -> None:
    """Load or compile a kernel, as `kernels.prepare` says."""
    known = function, _key_of(arguments)
    if isinstance(function, _Kernel) and known not in _PREPARED:
        kinds = _types_of(arguments)
        kept = function.overloads.get(kinds)
        if kept is None or _is_inner(kept):
            function.compile(kinds)
        _PREPARED.add(known)


def is_kernel(function: Callable[..., object]) -> bool:
    """Return whether Numba compiles a function, as `kernels.is_kernel` says."""
    return isinstance(function, CPUDispatcher)


def is_kept(
    function: Callable[..., object], *arguments: object, for_kernel: bool
) -> bool:
    """Return whether a kernel need not be compiled, as `kernels.is_kept` says."""
    known = for_kernel and (function, _key_of(arguments)) in _ADDRESSES
    if known or not isinstance(function, _Kernel):
        return True
    kinds = _types_of(arguments)
    if kinds in function.overloads:
        return for_kernel or not _is_inner(function.overloads[kinds])
    token = _for_kernel.set(for_kernel)
    try:
        return function.cache.holds(kinds, function.targetctx)
    finally:
        _for_kernel.reset(token)


def address_of(function: Callable[..., object], *arguments: object) -> int:
    """Return the address of a kernel's machine code, as `kernels.address_of` says."""
    known = function, _key_of(arguments)
    if known not in _ADDRESSES:
        kinds, dispatcher = _types_of(arguments), cast(Any, function)
        if kinds not in dispatcher.overloads:  # Without an entry for Python.
            dispatcher.get_call_template(kinds, {})
        compiled = dispatcher.overloads[kinds]
        name = compiled.fndesc.llvm_func_name
        _ADDRESSES[known] = int(compiled.library.get_pointer_to_function(name))
    return _ADDRESSES[known]


def _types_of(arguments: tuple[object, ...]) -> tuple[Any, ...]:
    return tuple(numba.typeof(argument) for argument in arguments)


_ADDRESSES: dict[object, int] = {}
"""(kernel, key of its arguments) -> address. Every search asks for it, and to find and
hash Numba's types takes 0.1 ms each."""
_PREPARED: set[object] = set()
"""Kernels with keys of arguments that `prepare` has prepared."""


def _key_of(value: object) -> object:
    """Return a key that determines Numba's type of a value."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.ndim, value.flags.num
    if isinstance(value, tuple):
        return type(value), tuple(map(_key_of, value))
    return type(value)


def _compiled(function: Function, **options: Any) -> Function:
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined, unused-ignore]
        return function
    options = {"nopython": True, "no_cfunc_wrapper": True, **options}
    return cast(Function, _Kernel(py_func=function, targetoptions=options))


_for_kernel: ContextVar[bool] = ContextVar("_for_kernel", default=False)
"""True while the code that is being compiled will be called by machine code only."""


class _Kernel(CPUDispatcher):
    """A function compiled by Numba, for Python or for other kernels.

    Code that only other kernels call needs no entry that unpacks Python objects. For
    kernels whose arguments are records of many arrays, that entry is a third of the
    compiling. It is made when Python calls the kernel with those types after all.
    """

    def __init__(self, **options: Any) -> None:
        """Take what Numba's dispatcher takes."""
        super().__init__(**options)
        self.cache = self._cache = _KernelCache(self)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile for a kernel that calls this one; return Numba's call template.

        For a constant, code for any number of its type is compiled; otherwise each
        constant would need code of its own.
        """
        plain = tuple(unliteral(kind) for kind in args)
        named = {name: unliteral(kind) for name, kind in kws.items()}
        token = _for_kernel.set(True)
        try:
            return super().get_call_template(plain, named)
        finally:
            _for_kernel.reset(token)

    def compile(self, sig: Any) -> Any:
        """Compile or load code for a signature; return the entry that Python calls."""
        arguments, _ = normalize_signature(sig)
        with compiling(), global_compiler_lock:
            kept = self.overloads.get(tuple(arguments))
            if not _for_kernel.get() and kept is not None and _is_inner(kept):
                # Else Numba would return this code, which Python cannot enter.
                del self.overloads[tuple(arguments)]
            self.targetoptions[CALLED_FROM_PYTHON] = _for_kernel.get()
            return super().compile(sig)

    def add_overload(self, cres: Any) -> None:
        """Keep compiled code; Python finds it only if the code has an entry for it."""
        if _is_inner(cres):
            self.overloads[tuple(cres.signature.args)] = cres
        else:
            super().add_overload(cres)


def _is_inner(result: Any) -> bool:
    """Return whether machine code has no entry for Python."""
    name = result.fndesc.llvm_cpython_wrapper_name
    return not result.library.get_pointer_to_function(name)


class _KernelCache(_Cache):
    """Cache in which a kernel looks for its machine code before it is compiled."""

    cache_path = None

    def __init__(self, dispatcher: Any) -> None:
        """Keep the dispatcher; the key is made when it is first needed."""
        self._dispatcher = dispatcher

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return the code compiled for a signature; None if it is not kept."""
        target_context.refresh()
        key = self._key(signature, target_context.codegen())
        code = None if key is None else load_code(key)
        if code is None:
            what = _ANNOUNCED.get(_room_of(self._dispatcher), _OTHER)
            announce(*what, is_kept=cache_refusal() is None)
            return None
        return CompileResult._rebuild(target_context, *pickle.loads(code))

    def holds(self, signature: Any, target_context: Any) -> bool:
        """Return whether the code compiled for a signature is kept."""
        key = self._key(signature, target_context.codegen())
        return key is not None and load_code(key) is not None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store the code compiled for a signature, if another process could use it."""
        key = self._key(signature, result.library.codegen)
        # Numba's own cache refuses these too; globals may be addresses of this process.
        lifted = any(not one.can_cache for one in result.lifted)
        if key is not None and not lifted and not result.library.has_dynamic_globals:
            store_code(key, dumps(result._reduce()))

    def enable(self) -> None:
        """Do nothing: the cache is always on."""

    def disable(self) -> None:
        """Do nothing: the cache is always on."""

    def flush(self) -> None:
        """Do nothing: stored code is never out of date."""

    def _key(self, signature: Any, codegen: Any) -> str | None:
        """Return the hash of all that determines the code; None if that is unknown."""
        try:
            own = fingerprint(self._dispatcher)
            arguments = tuple(_described(argument) for argument in signature)
        except UnknownValueError as error:
            name = self._dispatcher.py_func.__qualname__
            log.debug("machine code of %s is not kept: it reads %s", name, error)
            return None
        inner = _for_kernel.get()
        parts = own, arguments, inner, codegen.magic_tuple(), _toolchain(), _settings()
        return hashlib.sha256(repr(parts).encode()).hexdigest()


def _room_of(dispatcher: Any) -> str:
    """Return the folder of this package that holds a kernel; may be empty."""
    return str(dispatcher.py_func.__module__).partition(".")[2].partition(".")[0]


def _described(kind: Any) -> str:
    """Return a text that distinguishes a type of Numba from all others.

    Numba's own name of a named tuple has neither its module nor its fields.

    Raises:
        UnknownValueError: If the type is that of a function, whose name is an address.
    """
    if isinstance(kind, numba_types.Callable):
        raise UnknownValueError(f"an argument of type {kind}")
    if not isinstance(kind, numba_types.BaseTuple):
        return str(kind)
    made: Any = getattr(kind, "instance_class", tuple)
    fields = getattr(kind, "fields", ())
    inner = ", ".join(_described(one) for one in getattr(kind, "types", ()))
    return f"{made.__module__}.{made.__qualname__}{fields}({inner})"


@cache
def _toolchain() -> tuple[str, ...]:
    """Return the versions of all software that makes the code."""
    python = sys.version, sys.implementation.cache_tag, platform.machine()
    return *python, numba.__version__, llvmlite.__version__, np.__version__


def _settings() -> tuple[object, ...]:
    return tuple(repr(getattr(numba.config, name, None)) for name in _OPTIONS)


def _call_at(
    typing_context: Any, address: Any, arguments: Any
) -> tuple[Any, Callable[..., Any]]:
    """Call a kernel that returns None at its address, as Numba calls it."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds = tuple(signature.args[1])
        convention = context.call_conv
        called = convention.get_function_type(numba_types.none, kinds)
        entry = builder.inttoptr(values[0], called.as_pointer())
        given = cgutils.unpack_tuple(builder, values[1], len(kinds))
        status, _ = convention.call_function(
            builder, entry, numba_types.none, kinds, given
        )
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return numba_types.void(numba_types.int64, arguments), generate


call_at = cast(Callable[[int, tuple[object, ...]], None], intrinsic(_call_at))
"""The intrinsic of `kernels.call_at`."""


def _call_code(
    typing_context: Any, function: Any, inputs: Any, outputs: Any, numbers: Any
) -> tuple[Any, Callable[..., Any]]:
    """Call void f(double **in, double **out, int64...) at an address."""
    integer = numba_types.int64

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        address, *tables, given = arguments
        pointer = ir.IntType(8).as_pointer()
        counts = cgutils.unpack_tuple(builder, given, len(numbers))
        kinds = [pointer, pointer, *[ir.IntType(64)] * len(counts)]
        kind = ir.FunctionType(ir.VoidType(), kinds)
        called = builder.inttoptr(address, kind.as_pointer())
        found = [builder.inttoptr(table, pointer) for table in tables]
        builder.call(called, [*found, *counts])
        return context.get_dummy_value()

    return numba_types.void(integer, integer, integer, numbers), generate


call_code = intrinsic(_call_code)
"""The intrinsic of `kernels.call_code`."""
