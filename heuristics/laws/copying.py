"""Copies of arrays in kernels, coordinate by coordinate.

They do the same as `target[:] = source`. For that, Numba also compiles an error message
about shapes that differ, which takes 1 to 2 s at the first use and never runs.
"""

from swarmstart.arrays import Array
from swarmstart.machine_code import kernel


@kernel
def copy_values(source: Array, target: Array) -> None:
    """Copy the first numbers of a vector into another, as many as that has."""
    for k in range(target.size):
        target[k] = source[k]


@kernel
def copy_points(source: Array, target: Array) -> None:
    """Copy the first columns of a matrix into another, as many as that has."""
    for d in range(target.shape[0]):
        for i in range(target.shape[1]):
            target[d, i] = source[d, i]


@kernel
def copy_column(source: Array, i: int, target: Array, j: int) -> None:
    """Copy column i of a matrix into column j of another, or of the same one."""
    for d in range(target.shape[0]):
        target[d, j] = source[d, i]


@kernel
def fill_column(value: Array, target: Array, j: int) -> None:
    """Copy a vector into column j of a matrix."""
    for d in range(target.shape[0]):
        target[d, j] = value[d]


@kernel
def take_column(source: Array, i: int, target: Array) -> None:
    """Copy column i of a matrix into a vector."""
    for d in range(target.size):
        target[d] = source[d, i]
