"""Fingerprints: hashes of everything that compiled code is made from.

The machine code of a Numba kernel depends on its own bytecode, on that of every
function it calls, and on the value of every global name it reads, in any module. Its
fingerprint is a hash of all of these, found from the function itself:

    fingerprint(f) = hash(bytecode, constants, names, defaults and closure of f,
                          and the fingerprint of each global that f reads)

So it changes with any edit of code that the kernel uses (by hand, a pull, a branch
switch, a new wheel), and with no other edit. Comments and docstrings do not count.

The machine code of an evaluator is made by Python code, so its fingerprint is that of
the source files: `sources` hashes a module and all modules of this package it imports.
"""

import builtins
import dis
import hashlib
import importlib.util
import re
import sys
import types
from collections.abc import Callable, Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

PACKAGE = "swarmstart"
ROOT = Path(__file__).parents[1]
CALLED_FROM_PYTHON = "no_cpython_wrapper"
"""The option of a kernel that depends on its caller; fingerprints leave it out."""
_IMPORT = re.compile(
    rf"^[ \t]*(?:from[ ](?P<module>{PACKAGE}[\w.]*)[ ]import[ ]"
    rf"(?:\((?P<listed>[^)]*)\)|(?P<names>.*))|import[ ](?P<whole>{PACKAGE}[\w.]*))",
    re.MULTILINE,
)
_VERSIONED = ("llvmlite", "numba", "numpy")
"""Packages whose version stands for their content."""
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))


class UnknownValueError(Exception):
    """A function reads a global whose value has no fingerprint."""


def fingerprint(function: Callable[..., object]) -> str:
    """Return a hash of a function and of all that it calls and reads.

    Args:
        function: A Python function, or a kernel that Numba has made of one.

    Returns:
        Hexadecimal digits; the same in every process and for every folder of the files,
        for one version of Python.

    Raises:
        UnknownValueError: If the function reads a global that is not a number, a text,
            an array, a tuple of these, a class, a module or a function.
    """
    digest, seen = hashlib.sha256(), dict[int, int]()
    for part in _parts(function, seen):
        digest.update(repr(part).encode())
    return digest.hexdigest()


def sources(*modules: str) -> str:
    """Return a hash of modules' source, imports from this package included.

    Args:
        modules: Full names of the modules; imports within functions count too.
    """
    texts: dict[str, bytes] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name not in texts:
            texts[name] = source(name)
            waiting += _imported(texts[name])
    digest = hashlib.sha256()
    for name in sorted(texts):
        digest.update(repr((name, hashlib.sha256(texts[name]).digest())).encode())
    return digest.hexdigest()


def source(module: str) -> bytes:
    """Return the source text of a module.

    Args:
        module: Full name of the module.

    Raises:
        ModuleNotFoundError: If there is no such module, or it has no file.
    """
    if module.partition(".")[0] == PACKAGE:
        file = _file_of(module)
    else:
        spec = importlib.util.find_spec(module)
        file = None if spec is None or spec.origin is None else Path(spec.origin)
    if file is None:
        raise ModuleNotFoundError(module, name=module)
    return file.read_bytes()


def _file_of(module: str) -> Path | None:
    """Return the file of a module of this package; None without one.

    It is found without importlib, which would import the packages above the module.
    """
    place = ROOT.joinpath(*module.split(".")[1:])
    files = (place / "__init__.py", place.parent / f"{place.name}.py")
    return next((file for file in files if file.is_file()), None)


def _imported(text: bytes) -> Iterator[str]:
    """Yield the modules of this package that a source imports."""
    for match in _IMPORT.finditer(text.decode()):
        module = match["module"] or match["whole"]
        if _is_module(module):
            yield module
        for name in re.findall(r"\w+", match["listed"] or match["names"] or ""):
            if _is_module(f"{module}.{name}"):
                yield f"{module}.{name}"


@cache
def _is_module(name: str) -> bool:
    """Return whether a name in this package is a module."""
    return _file_of(name) is not None


def _parts(value: object, seen: dict[int, int]) -> Iterator[object]:
    """Yield the parts that identify a value, as objects with a repr of their content.

    Args:
        value: A function, or a value that one reads.
        seen: Numbers of the functions met, by identity: functions may call each other.
    """
    function = _function_of(value)
    if function is not None:
        yield "function", function.__module__, function.__qualname__, _options_of(value)
        known = id(function) in seen
        yield seen.setdefault(id(function), len(seen))
        if not known and _version_of(function.__module__) is None:
            yield from _function_parts(function, seen)
    elif isinstance(value, tuple | frozenset):
        yield type(value).__qualname__, getattr(value, "_fields", len(value))
        # The order of a set differs between processes.
        for item in value if isinstance(value, tuple) else sorted(value, key=repr):
            yield from _parts(item, seen)
    else:
        yield _description(value)


def _description(value: object) -> tuple[object, ...]:
    """Return a description that identifies a value without parts.

    Raises:
        UnknownValueError: If its type is not supported.
    """
    if isinstance(value, _PLAIN):
        return type(value).__name__, value
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        return "array", str(value.dtype), np.shape(value), value.tobytes()
    if isinstance(value, type):
        fields = getattr(value, "_fields", None)
        return "class", value.__module__, value.__qualname__, fields
    if isinstance(value, types.ModuleType):
        return "module", value.__name__, _version_of(value.__name__)
    if isinstance(value, types.BuiltinFunctionType | np.ufunc):
        return "builtin", value.__name__
    raise UnknownValueError(type(value).__qualname__)


def _function_parts(
    function: types.FunctionType, seen: dict[int, int]
) -> Iterator[object]:
    code = function.__code__
    yield from _code_parts(code, function.__doc__, seen)
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    named = sorted((function.__kwdefaults__ or {}).items())
    for value in (*(function.__defaults__ or ()), *cells, *named):
        yield from _parts(value, seen)
    known = {**vars(builtins), **function.__globals__}
    for name in sorted(_globals_read(code)):
        yield "global", name
        yield from _parts(known.get(name), seen)
        module = known.get(name)
        if isinstance(module, types.ModuleType) and not _version_of(module.__name__):
            # Read as module.name. The bytecode does not say which, so take all names.
            for attribute in sorted(_names(code) & vars(module).keys()):
                yield from _parts(vars(module)[attribute], seen)


def _code_parts(
    code: types.CodeType, doc: str | None, seen: dict[int, int]
) -> Iterator[object]:
    yield code.co_code, code.co_names, code.co_varnames, code.co_flags
    yield code.co_freevars, code.co_cellvars, code.co_exceptiontable
    for k, constant in enumerate(code.co_consts):
        if isinstance(constant, types.CodeType):
            yield from _code_parts(constant, None, seen)
        elif k or constant != doc:  # The docstring is the first constant.
            yield from _parts(constant, seen)


def _globals_read(code: types.CodeType) -> set[str]:
    """Return the names of globals that a function and its inner functions read."""
    names = {
        str(step.argval)
        for step in dis.get_instructions(code)
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= _globals_read(constant)
    return names


def _names(code: types.CodeType) -> set[str]:
    """Return the names of attributes and globals, inner functions included."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= _names(constant)
    return names


def _function_of(value: Any) -> types.FunctionType | None:
    """Return the Python function behind a function, a kernel or an intrinsic."""
    for attribute in ("py_func", "_defn"):
        value = getattr(value, attribute, value)
    return value if isinstance(value, types.FunctionType) else None


def _options_of(value: Any) -> str:
    """Return the options a kernel is compiled with, as text."""
    options = getattr(value, "targetoptions", {})
    return repr(sorted((k, v) for k, v in options.items() if k != CALLED_FROM_PYTHON))


@cache
def _version_of(module: str) -> str | None:
    """Return the version that identifies a module's content; None if it has none.

    Python's version stands for its standard library. That of any other package does
    not: it stays the same while a checkout is edited, and a search of another package
    calls kernels of this one.
    """
    top = module.split(".", maxsplit=1)[0]
    if top in sys.stdlib_module_names and top != "__main__":
        return sys.version
    return metadata.version(top) if top in _VERSIONED else None
