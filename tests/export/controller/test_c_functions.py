"""Functions written as C have the values that CasADi computes."""

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.export.controller.c_functions import CFile
from swarmstart.export.controller.source import preamble
from swarmstart.ocp.compiled.vectors.vector_ir import FORMATS

UNARY = (
    "sin cos tan exp log sqrt asin acos atan sinh cosh tanh asinh acosh atanh log1p "
    "expm1 erf fabs floor ceil sign"
).split()
POINTS = np.concatenate([np.linspace(-20, 20, 401), np.linspace(-1, 1, 201), [1e5]])


def compiled(function: ca.Function, folder: Path, command: str) -> ctypes.CDLL:
    """Compile a function of one number, or two, to one number."""
    file = CFile(FORMATS["double"], {})
    file.add_function(function, "inner")
    count = function.n_in()
    given = ", ".join(f"a + {i}" for i in range(count))
    body = "\n".join(
        [*(one.text for one in file.common.values()), *file.functions.values()]
    )
    text = preamble("double", body) + body
    text += f"void outer(const double a[], double r[]) {{ inner({given}, r); }}\n"
    (folder / "one.c").write_text(text)
    library = folder / "one.so"
    flags = "-std=c99 -O2 -ffp-contract=off -fPIC -shared".split()
    subprocess.run(
        [command, *flags, "one.c", "-o", library, "-lm"], cwd=folder, check=True
    )
    return ctypes.CDLL(str(library))


def called(library: ctypes.CDLL, *arguments: float) -> float:
    """Return the value of the compiled function."""
    given, found = (ctypes.c_double * 2)(*arguments), ctypes.c_double()
    outer: Any = getattr(library, "outer")  # noqa: B009 - else without a type
    outer(given, ctypes.byref(found))
    return found.value


@pytest.mark.parametrize("name", UNARY)
def test_functions_of_one_number(name: str, tmp_path: Path, c_compiler: str) -> None:
    """To 1e-14 of the larger of value and 1e-3; NaN and infinity, too."""
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [getattr(ca, name)(x)])
    library = compiled(function, tmp_path, c_compiler)
    for point in POINTS:
        expected, found = float(function(point)), called(library, point)
        near = max(abs(expected) * 1e-14, 1e-3 * 1e-14 * max(1.0, abs(point)))
        assert found == pytest.approx(expected, abs=near, rel=0, nan_ok=True), point


@pytest.mark.parametrize("name", ["atan2", "fmod", "hypot", "power", "remainder"])
def test_functions_of_two_numbers(name: str, tmp_path: Path, c_compiler: str) -> None:
    """Powers of negative and zero bases, too."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    value = x**y if name == "power" else getattr(ca, name)(x, y)
    function = ca.Function("f", [x, y], [value])
    library, rng = compiled(function, tmp_path, c_compiler), np.random.default_rng(0)
    pairs = [*rng.normal(size=(200, 2)) * 3, *np.ndindex(5, 5)]
    pairs += [(-2.0, 3.0), (-2.0, 11.0), (-2.0, 12.0), (-2.0, 0.5), (0.0, 2.5)]
    for a, b in pairs:
        if name != "power" and b == 0:
            continue
        expected, found = float(function(a, b)), called(library, a, b)
        assert found == pytest.approx(expected, rel=3e-13, abs=1e-15, nan_ok=True), (
            a,
            b,
        )


def test_angles_out_of_range_are_no_numbers(tmp_path: Path, c_compiler: str) -> None:
    """The reduction of an angle is exact up to 2^20."""
    x = ca.SX.sym("x")
    library = compiled(ca.Function("f", [x], [ca.sin(x)]), tmp_path, c_compiler)
    assert called(library, 2.0**20) == pytest.approx(np.sin(2.0**20), abs=1e-15)
    assert np.isnan(called(library, 2.0**20 + 1))
