"""The decorators of every function that Numba compiles, and the cache of its code.

Numba is imported untyped; this is the one place where that meets the type checker.
With NUMBA_DISABLE_JIT=1 the same functions run as plain Python. No fast-math: both give
the same bits.

Numba's own cache keeps code beside the source, under the hash of the one file that the
function stands in; so a change to what it calls in another file goes unnoticed. Here
code is kept in `code_cache`, under a key of all that it is made from: the function's
fingerprint, the types it is compiled for, the processor, and the versions and options
of Numba, LLVM, NumPy and Python.
"""

import hashlib
import logging
import pickle
import platform
import sys
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
from numba.core import types as numba_types
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numpy.typing import NDArray

from swarmstart.code_cache import load, store
from swarmstart.fingerprint import UnknownValueError, fingerprint

Array = NDArray[np.float64]
Count = NDArray[np.int64]

Function = TypeVar("Function", bound=Callable[..., object])

_RESULT: Any = CompileResult  # Untyped in some versions of Numba.
_SERIALISE: Any = dumps
log = logging.getLogger(__name__)

_OPTIONS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "ENABLE_AVX")
"""The settings of Numba that change the code it makes."""


def kernel(function: Function) -> Function:
    """Compile a function with Numba at its first call, and keep the machine code."""
    return _compiled(function)


def ieee_kernel(function: Function) -> Function:
    """Compile likewise; a division by zero gives infinity or NaN, and no error."""
    return _compiled(function, error_model="numpy")


def _compiled(function: Function, **options: Any) -> Function:
    dispatcher: Any = numba.njit(**options)(function)
    if dispatcher is not function:  # As it is with NUMBA_DISABLE_JIT=1.
        dispatcher._cache = _KernelCache(dispatcher)
    return cast(Function, dispatcher)


class _KernelCache(_Cache):
    """Where a kernel looks for its machine code before it is compiled."""

    cache_path = None

    def __init__(self, dispatcher: Any) -> None:
        """Remember whose code is kept; the key is made when it is first needed."""
        self._dispatcher = dispatcher

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return the code compiled for a signature; None if it is not kept."""
        target_context.refresh()
        key = self._key(signature, target_context.codegen())
        code = None if key is None else load(key)
        if code is None:
            return None
        return _RESULT._rebuild(target_context, *pickle.loads(code))

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the code compiled for a signature, if another process could use it."""
        key = self._key(signature, result.library.codegen)
        lifted = any(not one.can_cache for one in result.lifted)
        if key is not None and not lifted and not result.library.has_dynamic_globals:
            store(key, _SERIALISE(result._reduce()))

    def enable(self) -> None:
        """Do nothing: it is always on."""

    def disable(self) -> None:
        """Do nothing: it is always on."""

    def flush(self) -> None:
        """Do nothing: what is kept is never out of date."""

    def _key(self, signature: Any, codegen: Any) -> str | None:
        """Return the hash of all that determines the code; None if that is unknown."""
        try:
            own = fingerprint(self._dispatcher)
            arguments = tuple(_described(argument) for argument in signature)
        except UnknownValueError as error:
            name = self._dispatcher.py_func.__qualname__
            log.debug("machine code of %s is not kept: it reads %s", name, error)
            return None
        parts = own, arguments, codegen.magic_tuple(), _toolchain(), _settings()
        return hashlib.sha256(repr(parts).encode()).hexdigest()


def _described(kind: Any) -> str:
    """Return a text that tells a type of Numba from all others.

    The name that Numba gives a named tuple has neither its module nor its fields.

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
    """Return the versions of all that makes the code."""
    python = sys.version, sys.implementation.cache_tag, platform.machine()
    return *python, numba.__version__, llvmlite.__version__, np.__version__


def _settings() -> tuple[object, ...]:
    return tuple(repr(getattr(numba.config, name, None)) for name in _OPTIONS)
