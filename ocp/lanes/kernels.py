"""Functions whose arguments and outputs have names, and matrices written out."""

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca

from swarmstart.ocp.compiled.scan import PER_INTERVAL, Role, compile_scan
from swarmstart.ocp.compiled.simd import SimdBatch, compile_flat

_SMALLEST_PIVOT = 1e-10

Named = Mapping[str, ca.SX]
"""Arguments or outputs of a kernel by their names."""


class Kernel(NamedTuple):
    """Machine code whose arguments and outputs have names.

    Attributes:
        code: The machine code.
        reads: Names of its arguments.
        writes: Names of its outputs.
    """

    code: SimdBatch
    reads: tuple[str, ...]
    writes: tuple[str, ...]


class Written(NamedTuple):
    """A kernel before it is compiled.

    Attributes:
        function: Function of the kernel; with intervals, that of one interval.
        roles: Role of each argument, as in compiled/scan.py.
        turns: Number of intervals; 0: it has none.
        backward: Whether the last interval comes first.
        reads: Names of its arguments.
        writes: Names of its outputs.
    """

    function: ca.Function
    roles: tuple[Role, ...]
    turns: int
    backward: bool
    reads: tuple[str, ...]
    writes: tuple[str, ...]

    def compiled(self) -> Kernel:
        """Return the kernel as machine code.

        Raises:
            UnknownOperationError: If the kernel has an operation that is not compiled.
            NoCompilerError: If machine code cannot be made here.
        """
        if self.turns:
            code = compile_scan(
                self.function, self.roles, turns=self.turns, backward=self.backward
            )
        else:
            own = tuple(role == "individual" for role in self.roles)
            code = compile_flat(self.function, own)
        return Kernel(code, self.reads, self.writes)


def rows_of(kernel: Written) -> dict[str, int]:
    """Return the number of entries of each name that a kernel reads or writes."""
    function, turns = kernel.function, max(kernel.turns, 1)
    carried = kernel.roles.count("carried")
    found = {
        name: function.numel_in(i) * (turns if role in PER_INTERVAL else 1)
        for i, (name, role) in enumerate(zip(kernel.reads, kernel.roles, strict=True))
    }
    return found | {
        name: function.numel_out(i) * (1 if i < carried else turns)
        for i, name in enumerate(kernel.writes)
    }


def written_flat(lane: Named, shared: Named, writes: Named) -> Written:
    """Return a kernel without intervals, with individual and shared arguments."""
    roles: list[Role] = ["individual"] * len(lane)
    roles += ["shared"] * len(shared)
    named = {**lane, **shared}
    function = simplified_function(named, writes)
    return Written(function, tuple(roles), 0, False, tuple(named), tuple(writes))


def simplified_function(reads: Named, writes: Named) -> ca.Function:
    """Return a function of named symbols, common parts computed once."""
    outputs = ca.cse([ca.densify(one) for one in writes.values()])
    return ca.Function("step", list(reads.values()), outputs)


def symbols(**sizes: int) -> dict[str, ca.SX]:
    """Return symbols of given names and sizes."""
    return {name: ca.SX.sym(name, size) for name, size in sizes.items()}


def all_of(first: ca.SX, *others: ca.SX) -> ca.SX:
    """Return whether all conditions hold."""
    for one in others:
        first = ca.logic_and(first, one)
    return first


def any_of(first: ca.SX, *others: ca.SX) -> ca.SX:
    """Return whether any condition holds."""
    for one in others:
        first = ca.logic_or(first, one)
    return first


def triangle(n: int) -> list[tuple[int, int]]:
    """Return the indices of the lower triangle of a matrix, row by row."""
    return [(i, j) for i in range(n) for j in range(i + 1)]


def symmetric(entries: ca.SX, n: int) -> ca.SX:
    """Return the symmetric matrix of the entries of its lower triangle."""
    matrix = ca.SX(n, n)
    for number, (i, j) in enumerate(triangle(n)):
        matrix[i, j] = matrix[j, i] = entries[number]
    return matrix


def lower(matrix: ca.SX) -> ca.SX:
    """Return the entries of the lower triangle of a matrix that is symmetric."""
    entries = [(matrix[i, j] + matrix[j, i]) / 2 for i, j in triangle(matrix.shape[0])]
    return ca.vertcat(ca.SX(0, 1), *entries)


def cholesky_solved(A: ca.SX, B: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return A^-1 B by Cholesky's method, written out, and the least pivot.

    A pivot that is not positive is replaced by its absolute value.
    """
    n, L, inverse, least = A.shape[0], ca.SX(*A.shape), [], ca.SX(1)
    for j in range(n):
        pivot = A[j, j] - ca.sumsqr(L[j, :j])
        least = ca.fmin(least, pivot)
        inverse.append(1 / ca.sqrt(ca.fmax(ca.fabs(pivot), _SMALLEST_PIVOT)))
        for i in range(j + 1, n):
            L[i, j] = (A[i, j] - ca.dot(L[i, :j], L[j, :j])) * inverse[j]
    Y = ca.SX(*B.shape)
    for i in range(n):
        Y[i, :] = (B[i, :] - L[i, :i] @ Y[:i, :] if i else B[i, :]) * inverse[i]
    for i in reversed(range(n)):
        rest = L[i + 1 :, i].T @ Y[i + 1 :, :] if i + 1 < n else 0
        Y[i, :] = (Y[i, :] - rest) * inverse[i]
    return Y, least
