"""Machine code in this process, made from LLVM IR."""

import ctypes
import ctypes.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from swarmstart.ocp.compiled.vectors.operations import C_FUNCTIONS

try:
    import llvmlite
    import llvmlite.binding as llvm
except ImportError:  # pragma: no cover - numba brings it, but a platform may lack it
    llvm = None


_NEON_BITS, _AVX512_BITS = 128, 512
_OLDEST = (0, 45)
"""The first llvmlite whose LLVM reads untyped pointers."""
MOST_OPTIMISED = 3_000_000
"""Characters of the longest module that LLVM optimises, some 20 000 operations. It
takes 10 s; twice as many take four times as long."""
MOST_CHARACTERS = 24_000_000
"""Characters of the longest module that is translated, which takes 10 s."""


class NoCompilerError(Exception):
    """Machine code cannot be made here; the message says why."""


@dataclass(frozen=True, slots=True)
class Machine:
    """The processor that code is made for.

    Attributes:
        triple: The target triple.
        cpu: The processor's name.
        features: Features of the processor, as LLVM writes them.
        register_bits: Length of a vector register.
        lanes: Least number of doubles that a kernel evaluates side by side.
        has_scale: See `vector_ir.Module`.
        llvm: LLVM's version.
    """

    triple: str
    cpu: str
    features: str
    register_bits: int
    lanes: int
    has_scale: bool
    llvm: str


@cache
def machine() -> Machine:
    """Return the processor that this process runs on.

    Raises:
        NoCompilerError: If llvmlite is missing or too old, the C library of mathematics
            is incomplete, or the processor has no fused multiply-add.
    """
    if llvm is None:
        raise NoCompilerError("llvmlite is not installed")
    if tuple(map(int, llvmlite.__version__.split(".")[:2])) < _OLDEST:
        raise NoCompilerError(
            f"llvmlite must be at least {'.'.join(map(str, _OLDEST))}, "
            f"got {llvmlite.__version__}"
        )
    _initialise()
    triple = str(llvm.get_process_triple())
    features = llvm.get_host_cpu_features()
    if triple.startswith(("aarch64", "arm64")):
        register_bits = _NEON_BITS
    elif not features.get("fma"):
        raise NoCompilerError("the processor has no fused multiply-add")
    elif features.get("avx512f") and features.get("avx512vl"):
        register_bits = _AVX512_BITS
    else:
        register_bits = 256
    return Machine(
        triple=triple,
        cpu=str(llvm.get_host_cpu_name()),
        features=str(features.flatten()),
        register_bits=register_bits,
        lanes=4 if register_bits == _NEON_BITS else 8,
        has_scale=register_bits == _AVX512_BITS,
        llvm=".".join(map(str, llvm.llvm_version_info)),
    )


def _initialise() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    # LLVM ends the process if code calls a missing function, so check first.
    try:
        library = ctypes.CDLL(ctypes.util.find_library("m"))
        functions = {name: getattr(library, name) for name in C_FUNCTIONS}
    except (OSError, TypeError, AttributeError) as error:
        raise NoCompilerError(f"the C library is incomplete: {error}") from error
    for name, function in functions.items():
        llvm.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)


@dataclass(frozen=True, slots=True, eq=False)
class Compiled:
    """A compiled kernel; keep the object as long as the code may be called.

    Attributes:
        address: Address of void kernel(double **in, double **out, int64 n).
        part_address: Address of `part`.
        part: void part(double **in, double **out, int64 n, int64 first, int64 last), a
            function of ctypes; this function and `call` release Python's lock.
        call: The kernel as a function of ctypes.
        keeps_alive: Owner of the code.
    """

    address: int
    part_address: int
    call: Callable[..., None]
    part: Callable[..., None]
    keeps_alive: Any


_TABLES, _NUMBER = (ctypes.c_void_p, ctypes.c_void_p), ctypes.c_int64
SIGNATURE = ctypes.CFUNCTYPE(None, *_TABLES, _NUMBER)
PART = ctypes.CFUNCTYPE(None, *_TABLES, _NUMBER, _NUMBER, _NUMBER)


def translate(ir: str, *, quickly: bool = False) -> bytes:
    """Return the object code of an IR module.

    Args:
        ir: A module with the function `kernel`.
        quickly: Whether LLVM optimises nothing, as for very long modules. LLVM then
            needs a tenth of the time; the code has the same results, but takes up to
            twice as long.

    Raises:
        NoCompilerError: If machine code cannot be made here, or the module is too long.
    """
    target = machine()
    require_short(ir)
    level = 0 if quickly or len(ir) > MOST_OPTIMISED else 2
    try:
        module = llvm.parse_assembly(ir)
        module.triple = target.triple
        module.verify()
        code: bytes = _target_machine(target, level).emit_object(module)
    except RuntimeError as error:
        raise NoCompilerError(f"LLVM refuses the code: {error}") from error
    return code


def require_short(ir: str) -> None:
    """Validate that a module is short enough for LLVM.

    Args:
        ir: The module.

    Raises:
        NoCompilerError: If it is too long.
    """
    if len(ir) > MOST_CHARACTERS:
        raise NoCompilerError(
            f"expected at most {MOST_CHARACTERS} characters of code, found {len(ir)}; "
            "compile one of the steps that repeat and call it in a loop"
        )


def link(code: bytes) -> Compiled:
    """Return the kernel of object code, ready to be called.

    Args:
        code: Object code that `translate` made for this machine.
    """
    target = machine()
    # MCJIT begins with a module; the object code is added to it.
    empty = llvm.parse_assembly("")
    empty.triple = target.triple
    engine = llvm.create_mcjit_compiler(empty, _target_machine(target))
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    address = engine.get_function_address("kernel")
    part = engine.get_function_address("part")
    return Compiled(address, part, SIGNATURE(address), PART(part), engine)


def _target_machine(target: Machine, optimised: int = 2) -> Any:
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=optimised, reloc="pic", jit=True
    )
