"""A controller in C: its text, and a controller that calls the compiled C file."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmstart.arrays import Array
from swarmstart.export.controller.numbers import Status
from swarmstart.export.controller.posed import PosedController
from swarmstart.export.paths import ExportError
from swarmstart.ocp.loop.controller import Decision, Mode
from swarmstart.ocp.rollout.fitness import Known, flatten

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-tree-vectorize")
"""Flags with which every level of optimisation gives the same bits."""
COMPILERS = ("cc", "gcc", "clang")
_SECONDS = 600.0


class NoCCompilerError(ExportError):
    """No C compiler was found on this machine."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CExport:
    """A controller as text: one C99 file, its header and what goes with them.

    Attributes:
        name: Name of the controller, a C identifier.
        files: Name of a file -> its text.
        precision: "double" or "single".
        most_operations: Largest number of operations that one control step can take.
        posed: The numbers and functions that the files are made of.
        iterations: Largest number of steps of a local solve.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=x + u), horizon=2.0, intervals=4,
        ...     stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-2, 2)),
        ... )
        >>> planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
        >>> made = ss.export_c(
        ...     ss.RecedingHorizon(planner=planner), [1.0], name="one", starts=0
        ... )
        >>> "THERE IS NO RESCUE" in made.files["one.h"], made.most_operations < 1e7
        (True, True)
    """

    name: str
    files: Mapping[str, str]
    precision: str
    most_operations: int
    posed: PosedController
    iterations: int

    def __repr__(self) -> str:
        """Return name, files and the bound of a step in one line."""
        return (
            f"CExport: {self.name}, {', '.join(self.files)}; at most "
            f"{self.most_operations:.3g} operations a step"
        )

    def controller(self, *flags: str, compiler: str = "") -> CompiledController:
        """Compile the C file, and return it as a controller of a closed loop.

        Args:
            flags: Flags of the compiler; if empty, `FLAGS`.
            compiler: Command of the compiler; if empty, the first of cc, gcc, clang.

        Raises:
            NoCCompilerError: If there is no compiler.
            ExportError: If the compiler fails.
        """
        return CompiledController(self, flags or FLAGS, compiler)


class CompiledController:
    """A controller that calls the compiled C file.

    What it remembers between steps is in a buffer of its own, which the C code fills.
    `decide` begins anew if there is no previous decision, and uses the parameters and
    signals of the export.

    Attributes:
        dt: Length of a control interval [s].
        status: Origin of the last control.
    """

    def __init__(self, made: CExport, flags: Sequence[str], compiler: str = "") -> None:
        """Compile the C file in a temporary folder, and load it.

        Args:
            made: The exported controller.
            flags: Flags of the compiler.
            compiler: Command of the compiler; if empty, the first of COMPILERS that is
                found.

        Raises:
            NoCCompilerError: If there is no compiler.
            ExportError: If the compiler fails.
        """
        self.dt, self.status = made.posed.problem.dt, Status.SHIFTED
        self._made, name = made, made.name
        self._dtype = np.dtype(made.precision)
        command = compiler_command(compiler)
        sources = {
            f"{name}.c": made.files[f"{name}.c"],
            f"{name}.h": made.files[f"{name}.h"],
            f"{name}_probe.c": _PROBE.replace("NAME", name),
        }
        with tempfile.TemporaryDirectory(prefix="swarmstart-") as folder:
            library = compiled_library(
                sources, f"{name}.so", Path(folder), command, flags
            )
            self._library = ctypes.CDLL(str(library))
        self._step = getattr(self._library, f"{name}_step")
        self._step.restype = ctypes.c_int
        size = getattr(self._library, f"{name}_size")
        size.restype = ctypes.c_ulong
        self._memory = ctypes.create_string_buffer(int(size()))
        self._facts = getattr(self._library, f"{name}_facts")
        self.reset()

    def reset(self) -> None:
        """Forget the last plan, and begin anew."""
        getattr(self._library, f"{self._made.name}_reset")(self._memory)

    def step(self, x: Array, known: Known | None = None) -> Array:
        """Return the control of a step, shape (nu,).

        Args:
            x: State, shape (nx,).
            known: Parameters and signals of the core, that is, of the problem after all
                rewrites; None: those of the export.
        """
        one = self._made.posed
        known = one.known if known is None else known
        u = np.zeros(one.problem.model.nu, dtype=self._dtype)
        given = [np.asarray(x)]
        if one.problem.model.np:
            given.append(np.asarray(known.parameters))
        if one.problem.ns:
            given.append(flatten(np.asarray(known.signals)))
        arrays = [np.ascontiguousarray(a, dtype=self._dtype) for a in given]
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*arrays, u)]
        self.status = Status(self._step(self._memory, *pointers))
        return u.astype(np.float64)

    def decide(
        self,
        time: float,
        state: Array,
        previous: Decision | None,
        *,
        rng: np.random.Generator,
    ) -> Decision:
        """Return the control of a step; see Controller."""
        del time, rng
        if previous is None:
            self.reset()
        control = self.step(state)
        linear = self.status is Status.LINEAR
        mode = Mode.LINEAR if linear else Mode.PLANNED
        return Decision(control=control, plans=(), mode=mode)

    @property
    def operations(self) -> int:
        """Number of operations of the last call of `step`."""
        return self._read()[0][0]

    @property
    def iterations(self) -> int:
        """Number of steps that the local solves of the last call of `step` tried."""
        return self._read()[0][1]

    @property
    def cost(self) -> float:
        """Cost of the last plan."""
        return self._read()[1][0]

    @property
    def violation(self) -> float:
        """Violation of the last plan."""
        return self._read()[1][1]

    def _read(self) -> tuple[list[int], list[float]]:
        counts, values = (ctypes.c_ulonglong * 2)(), (ctypes.c_double * 2)()
        self._facts(self._memory, counts, values)
        return list(counts), list(values)


_PROBE = """
#include "NAME.h"
unsigned long NAME_size(void) { return (unsigned long)sizeof(NAME_memory); }
void NAME_facts(const NAME_memory *m, unsigned long long counts[2], double values[2])
{
  counts[0] = m->operations;
  counts[1] = m->iterations;
  values[0] = (double)m->cost;
  values[1] = (double)m->violation;
}
"""


def compiler_command(asked: str = "") -> str:
    """Return the command of a C compiler.

    Raises:
        NoCCompilerError: If no compiler is found.
    """
    for command in (asked,) if asked else COMPILERS:
        found = shutil.which(command)
        if found is not None:
            return found
    wanted = asked or " or ".join(COMPILERS)
    raise NoCCompilerError(
        f"no C compiler: expected the command {wanted}, found none; install one, for "
        "example the package gcc"
    )


def compiled_library(
    sources: Mapping[str, str],
    name: str,
    folder: Path,
    command: str,
    flags: Sequence[str],
) -> Path:
    """Write sources into a folder, and compile them as a shared library.

    Args:
        sources: Name of a file -> its text.
        name: Name of the library's file.
        folder: Folder for the sources and the library.
        command: Command of the compiler.
        flags: Flags of the compiler.

    Raises:
        ExportError: If the compiler fails; with the first lines that it wrote.
    """
    for file, text in sources.items():
        (folder / file).write_text(text)
    files = [str(folder / file) for file in sources if file.endswith(".c")]
    library = folder / name
    shared = ("-fPIC", "-shared", *files, "-o", str(library), "-lm")
    try:
        done = subprocess.run(
            [command, *flags, *shared],
            capture_output=True, text=True, check=False, timeout=_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ExportError(f"the C compiler took longer than {_SECONDS:g} s") from None
    if done.returncode:
        said = "; ".join(done.stderr.strip().splitlines()[:3])
        raise ExportError(f"the C compiler failed with code {done.returncode}: {said}")
    return library
