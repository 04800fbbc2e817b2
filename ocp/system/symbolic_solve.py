"""Symbolic solution of linear equations A z = b: smooth, and without choice of pivots.

A is permuted to lower block triangular form by its structure. Each block is solved by
modified Gram-Schmidt without square roots, with the columns a_k of the block in order
and b as the last one:

    q_j = a_j - sum_i<j r_ij q_i,   r_jk = q_j' a_k / q_j' q_j,   R z = r_b,

where each r_jk is computed from the remainder of a_k. An expression cannot choose a
pivot by its size, and a zero pivot may occur in any order; here only a singular block
divides by zero. Treating b as a column makes the method as accurate as Householder's;
CasADi's `solve` for SX forms Q'b instead, and loses the square of the condition number.

Source: Bjorck (1967), Solving linear least squares problems by Gram-Schmidt
orthogonalization, BIT 7, 1-21.
"""

import itertools

import casadi as ca


def solve_in_symbols(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return z of `matrix` z = `right`.

    Args:
        matrix: Shape (n, n), of full structural rank.
        right: Shape (n, 1).

    Returns:
        Shape (n, 1); NaN or infinite if the matrix is singular.
    """
    _, rows, columns, block_rows, _, _, _ = matrix.sparsity().btf()
    found: dict[int, ca.SX] = {}
    for first, end in itertools.pairwise(block_rows):
        own = columns[first:end]
        left = []
        for row in rows[first:end]:
            entries = (matrix[row, column] * z for column, z in found.items()
                       if matrix.sparsity().has_nz(row, column))  # fmt: skip
            left.append(right[row] - sum(entries, ca.SX(0)))
        block = ca.densify(matrix[rows[first:end], own])
        found.update(zip(own, _solved_block(block, left), strict=True))
    return ca.vertcat(*[found[k] for k in range(len(found))])


def _solved_block(block: ca.SX, right: list[ca.SX]) -> list[ca.SX]:
    """Return the solution of equations with a dense matrix."""
    if len(right) == 1:
        return [right[0] / block[0, 0]]
    left = [*ca.horzsplit(block), ca.vertcat(*right)]
    factors = []
    for j in range(len(right)):
        q = left[j]
        length = ca.sumsqr(q)
        row = {k: ca.dot(q, left[k]) / length for k in range(j + 1, len(left))}
        for k, factor in row.items():
            left[k] -= factor * q
        factors.append(row)
    solution: list[ca.SX] = []  # from the last on
    for j in reversed(range(len(right))):
        known = zip(reversed(range(j + 1, len(right))), solution, strict=True)
        solution.append(
            factors[j][len(right)]
            - sum((factors[j][k] * z for k, z in known), ca.SX(0))
        )
    return solution[::-1]
