"""Long graphs with exp and pow, and calls of few individuals, as machine code.

    python benchmarks/long_graphs.py [--write docs/measured/long_graphs.md]

Seconds are CPU time of the process and of gcc. Contestants are timed in turns.
"""

import ctypes
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.benchmarks.rivals import compiled_library
from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.benchmarks.timing import Timing, timings
from swarmstart.ocp import compile_batch
from swarmstart.ocp.compiled.emitter import simplified
from swarmstart.tape import Node, Tape, read_tape

STEPS, SIZE, ROUNDS = 72, 1024, 60
START = np.array([1.0, 0.05, 1.0, 0.0])
TEXT = """# Long graphs and small calls

Made by `python benchmarks/long_graphs.py --write docs/measured/long_graphs.md`: the
ascent of a rocket with a heat load, 72 steps of Runge-Kutta written as one graph, with
648 exponentials and 504 powers whose exponents are no whole numbers, for 1024
individuals. "SIMD C" is the same graph as C over vectors of individuals, whose exp and
pow are those of the C library for vectors (`gcc -O3 -march=native -ffast-math
-fopenmp-simd`). A problem that is stated with intervals is compiled as a loop, so
neither its code nor the time to compile it grows with the horizon.

"""
CALLS = """
The table has the CPU time of a call from Python of a function that takes 60 numbers
for each individual and has two outputs. Arguments of up to 4096
numbers are copied into buffers that are kept; larger ones are read in place.

"""
OPERATIONS: Mapping[str, str] = {
    "add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}",
    "neg": "-{}", "sq": "{0} * {0}", "twice": "2 * {}", "inv": "1 / {}",
    "sqrt": "sqrt({})", "fabs": "fabs({})", "exp": "exp({})", "constpow": "pow({}, {})",
}  # fmt: skip
"""Operations of the graph -> C."""


def ascent(steps: int) -> ca.Function:
    """Return (thrust, state at the start) -> (cost, state at the end)."""
    start, thrust = ca.SX.sym("start", 4), ca.SX.sym("thrust", steps)

    def rate(x: ca.SX, u: ca.SX) -> ca.SX:
        height, speed, mass, heat = (x[i] for i in range(4))
        density = ca.exp(-5 * (height - 1))
        climb = (3.5 * u - 3.1 * speed * speed * density) / mass - 1 / height**2
        heating = ca.sqrt(density) * ca.fabs(speed) ** 3.15
        heating += 0.1 * ca.exp(-heat) * mass**0.7
        return ca.vertcat(speed, climb, -2 * u, heating)

    x, dt, cost = start, 0.2 / steps, ca.SX(0)
    for k in range(steps):
        u = thrust[k]
        first = rate(x, u)
        second = rate(x + dt / 2 * first, u)
        third = rate(x + dt / 2 * second, u)
        x += dt / 6 * (first + 2 * second + 2 * third + rate(x + dt * third, u))
        cost += ca.exp(-x[0]) * u**2
    return ca.Function("ascent", [thrust, start], [cost - x[0], x])


def c_code(tape: Tape, lanes: int = 8) -> str:
    """Return C of void kernel(u, x0, out, n), n a multiple of the lanes."""

    def value(node: Node) -> str:
        if node.operation == "constant":
            return repr(node.value)
        if node.operation == "input":
            argument, entry = node.arguments
            return f"x0[{entry}]" if argument else f"u[{entry} * n + i]"
        names = [f"v{a}" for a in node.arguments]
        return OPERATIONS[node.operation].format(*names)

    outputs = [number for output in tape.outputs for number in output]
    return "\n".join(
        [
            "#include <math.h>",
            "void kernel(const double *restrict u, const double *restrict x0,",
            "            double *restrict out, long n) {",
            f"for (long s = 0; s < n; s += {lanes}) {{",
            f"#pragma omp simd simdlen({lanes})",
            f"for (long i = s; i < s + {lanes}; i++) {{",
            *(f"double v{k} = {value(n)};" for k, n in enumerate(tape.nodes)),
            *(f"out[{r} * n + i] = v{number};" for r, number in enumerate(outputs)),
            "}}}",
        ]
    )


def compiled_c(code: str, folder: Path) -> ctypes.CDLL:
    """Return the code as a library, which takes a C compiler."""
    source = folder / "graph.c"
    source.write_text(code, encoding="utf-8")
    library = compiled_library(source, "-ffast-math", "-fopenmp-simd")
    if library is None:
        raise FileNotFoundError("expected a C compiler, cc or gcc; found none")
    return library


def spent(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return a call's CPU time, that of its programs included [s], and its value."""
    begin = os.times()
    value = call()
    return float(np.subtract(os.times()[:4], begin[:4]).sum()), value


def graph_rows(folder: Path) -> list[str]:
    """Return the rows of the table of long graphs; the folder has no cache yet."""
    function, rng = ascent(STEPS), np.random.default_rng(1)
    thrust, out = rng.uniform(0, 1, (STEPS, SIZE)), np.empty((5, SIZE))
    code = c_code(simplified(read_tape(function)))
    builds = [
        spent(lambda: compile_batch(function, backend="llvm")),
        spent(lambda: compiled_c(code, folder)),
        spent(lambda: compile_batch(function, backend="casadi")),
    ]
    (_, ours), (_, library), (_, mapped) = builds
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (thrust, START, out)]
    names = ("swarmstart", "SIMD C", "CasADi's map")
    calls: list[Callable[[], object]] = [
        lambda: ours(thrust, START),
        lambda: library.kernel(*pointers, ctypes.c_long(SIZE)),
        lambda: mapped(thrust, START),
    ]
    found = cpu_timings(dict(zip(names, calls, strict=True)))
    for values in (ours(thrust, START), mapped(thrust, START)):
        np.testing.assert_allclose(np.vstack(values), out, 1e-11, 1e-11)
    reference = found["SIMD C"].median
    return [
        row(
            name,
            f"{build:.1f}",
            *(f"{1e6 * q / SIZE:.2f}" for q in by_size(found[name])),
            f"{found[name].median / reference:.2f}",
        )
        for name, (build, _) in zip(names, builds, strict=True)
    ]


def call_rows() -> list[str]:
    """Return the rows of the table of small calls."""
    x, p = ca.SX.sym("x", 60), ca.SX.sym("p", 3)
    outputs = [ca.sumsqr(x) * p[0] + p[1], x[0] * p[2]]
    evaluate = compile_batch(ca.Function("f", [x, p], outputs), backend="llvm")
    lines = []
    for size in (10, 68, 69, 100, 200):
        given = np.random.default_rng(0).normal(size=(60, size)), np.ones(3)
        call, kernel = partial(evaluate, *given), evaluate.prepare(*given)
        found = cpu_timings({"call": call, "kernel": kernel.run})
        lines.append(
            row(
                str(size),
                *(f"{1e6 * q:.1f}" for q in by_size(found["call"])),
                f"{1e6 * found['kernel'].median:.1f}",
            )
        )
    return lines


def cpu_timings(calls: Mapping[str, Callable[[], object]]) -> dict[str, Timing]:
    """Return how much CPU time each call takes, measured in turns."""
    return timings(calls, rounds=ROUNDS, clock=time.process_time)


def by_size(found: Timing) -> tuple[float, float, float]:
    """Return the quartiles, the least first [s]."""
    return found.lower, found.median, found.upper


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the page, and write it where asked."""
    options = page_options(__doc__).parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder  # So that it is compiled here.
        graphs = graph_rows(Path(folder))
    columns = ("lower quartile", "median", "upper quartile")
    lines = [
        *head(
            "contestant", "compile [s]", *(f"{c} [us/rollout]" for c in columns),
            "median / SIMD C's",
        ),
        *graphs,
        *CALLS.splitlines(),
        *head("individuals", *(f"{c} [us]" for c in columns), "the kernel alone"),
        *call_rows(),
    ]  # fmt: skip
    publish(lines, options, TEXT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
