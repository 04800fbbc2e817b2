"""Calls of machine code at its address, from code that Numba compiles."""

import ctypes
from collections.abc import Callable
from typing import Any, cast

import numba
from llvmlite import ir
from numba.extending import intrinsic

from swarmstart.ocp.compiled.engine import PART

Call = Callable[[int, int, int, int, int], None]


def _call_part(
    typing_context: Any, function: Any, inputs: Any, outputs: Any, size: Any, last: Any
) -> tuple[Any, Callable[..., Any]]:
    """Call void part(double **in, double **out, int64 n, int64 first, int64 last)."""
    integer = numba.types.int64
    signature = numba.types.void(integer, integer, integer, integer, integer)

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        address, first, second, count, end = arguments
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(
            ir.VoidType(), [pointer, pointer, number, number, number]
        )
        called = builder.inttoptr(address, kind.as_pointer())
        given = [builder.inttoptr(a, pointer) for a in (first, second)]
        builder.call(called, [*given, count, number(0), end])
        return context.get_dummy_value()

    return signature, generate


def _in_python(function: int, inputs: int, outputs: int, size: int, last: int) -> None:
    """Call it from plain Python."""
    tables = ctypes.c_void_p(int(inputs)), ctypes.c_void_p(int(outputs))
    PART(int(function))(*tables, size, 0, int(last))


_PLAIN = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined, unused-ignore]
call_part = cast(Call, _in_python if _PLAIN else intrinsic(_call_part))
"""Evaluate the first individuals: (address of `part`, addresses of the tables of its
arguments and outputs, individuals in a row, number of individuals to evaluate)."""
