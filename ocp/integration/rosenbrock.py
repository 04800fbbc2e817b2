"""A step of RODAS4, a Rosenbrock method for stiff equations x' = r(t, x), as SX.

With W = I - h g J, J = dr/dx and r_t = dr/dt at the step's beginning, g = 1/4, each of
six stages solves one linear system with the same matrix:

    W k_i = h g r(t + c_i h, x + sum_j a_ij k_j) + g sum_j C_ij k_j + h^2 g d_i r_t

The fifth stage ends at a solution of order 3, x_5 = x + sum_j a_5j k_j + k_5, the step
at one of order 4, x+ = x_5 + k_6, so k_6 estimates the error of the former. The method
is L-stable: fast modes are damped by steps of any length, and only the slow ones limit
the step. Nothing is iterated: a step is an explicit expression with derivatives.

W is factored symbolically: an LU factorisation by the pattern of its nonzeros, with
pivots on the diagonal in the order of least fill, without exchanging rows for their
values. A pivot that vanishes, h g J_ii = 1, belongs to a mode that grows e^4-fold in a
step, so the step is too long in any case, and the result is not finite.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.7,
with IV.10 for the method RODAS; coefficients as in their code rodas.f, method 1.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

GAMMA = 0.25
A = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950),
)
"""a_ij of the first five stages; the sixth starts at the end of the fifth."""
C = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
    (
        8.083246795921522,
        -7.981132988064893,
        -31.52159432874371,
        16.31930543123136,
        -6.058818238834054,
    ),
)
TIMES = (0.0, 0.386, 0.21, 0.63, 1.0, 1.0)
"""c_i."""
IN_TIME = (0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0)
"""d_i."""

Rate = Callable[[float, ca.SX], ca.SX]
"""r(t, x): rate at time t after the start of the step [s]."""


def rodas4(rate: Rate, x: ca.SX, t: float, h: float) -> ca.SX:
    """Return x after one step of RODAS4; see the module's head."""
    return rodas4_with_error(rate, x, t, h)[0]


def prepared(rate: Rate, size: int) -> Callable[[ca.SX, float, float], ca.SX]:
    """Return (x, t, h) -> x after a step, for many steps of one equation.

    The factorisation and the elimination of common parts are done once.

    Args:
        rate: r(t, x).
        size: Number of states.
    """
    own = [ca.SX.sym("x", size), ca.SX.sym("t"), ca.SX.sym("h")]
    after = rodas4(rate, *own)  # type: ignore[arg-type]
    known = {s.element_hash() for one in own for s in ca.vertsplit(one)}
    others = [s for s in ca.symvar(after) if s.element_hash() not in known]
    step = ca.Function("step", [*own, *others], ca.cse([after]))
    return lambda x, t, h: step(x, t, h, *others)


def rodas4_with_error(rate: Rate, x: ca.SX, t: float, h: float) -> tuple[ca.SX, ca.SX]:
    """Return x after one step of RODAS4, and the error of its solution of order 3.

    Args:
        rate: r(t, x); expressions of t must be differentiable.
        x: State, shape (n, 1).
        t: Time at the start of the step [s].
        h: Length of the step [s].
    """
    J, in_time = _slopes(rate, x, t)
    W = ca.DM.eye(x.numel()) - GAMMA * h * J
    factors = factored(W)
    k: list[ca.SX] = []
    for stage, (couplings, c, d) in enumerate(zip(C, TIMES, IN_TIME, strict=True)):
        if stage < len(A):
            at = _sum(x, A[stage], k)
        else:
            at += k[-1]
        right = GAMMA * h * rate(t + c * h, at)
        right = _sum(right, [GAMMA * coupling for coupling in couplings], k)
        if d and in_time.nnz():
            right += GAMMA * d * h * h * in_time
        k.append(factors.solve(right))
    return at + k[-1], k[-1]


def _sum(x: ca.SX, weights: Sequence[float], terms: Sequence[ca.SX]) -> ca.SX:
    """Return x + sum of weights * terms."""
    for weight, term in zip(weights, terms, strict=False):
        x = x + weight * term
    return x


def _slopes(rate: Rate, x: ca.SX, t: float) -> tuple[ca.SX, ca.SX]:
    """Return dr/dx and dr/dt at (t, x)."""
    y, time = ca.SX.sym("y", x.numel()), ca.SX.sym("t")
    r = rate(time, y)  # type: ignore[arg-type]
    slopes = [ca.jacobian(r, y), ca.jacobian(r, time)]
    J, in_time = ca.substitute(slopes, [y, time], [x, ca.SX(t)])
    return J, in_time


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """LU factors of a matrix, in the order in which its rows were eliminated.

    Attributes:
        order: Rows, in the order of elimination.
        lower: For each of them [(row, element of L in its column)].
        upper: For each of them [(column, element of U in its row)].
        inverse: For each of them 1 / pivot.
    """

    order: tuple[int, ...]
    lower: tuple[tuple[tuple[int, ca.SX], ...], ...]
    upper: tuple[tuple[tuple[int, ca.SX], ...], ...]
    inverse: tuple[ca.SX, ...]

    def solve(self, right: ca.SX) -> ca.SX:
        """Return the solution for a right-hand side, shape (n, 1)."""
        b = ca.vertsplit(ca.densify(right))
        for row, below in zip(self.order, self.lower, strict=True):
            for other, element in below:
                b[other] = b[other] - element * b[row]
        backward = zip(self.order, self.upper, self.inverse, strict=True)
        for row, right_of, inverse in reversed([*backward]):
            for other, element in right_of:
                b[row] = b[row] - element * b[other]
            b[row] = b[row] * inverse
        return ca.vertcat(ca.SX(0, 1), *b)


def factored(matrix: ca.SX) -> Factors:
    """Return the LU factors of a square matrix whose diagonal has no zero.

    Pivots are diagonal elements. The next pivot is the one with the smallest possible
    fill (Markowitz 1957), so a triangular matrix in any order needs no elimination.

    Args:
        matrix: Shape (n, n).
    """
    rows = _rows(matrix)
    order, lower, upper, inverse = [], [], [], []
    while rows:
        used = Counter(column for row in rows.values() for column in row)
        pivot = min(rows, key=lambda row: (len(rows[row]) - 1) * (used[row] - 1))
        row = rows.pop(pivot)
        order.append(pivot)
        inverse.append(1 / row.pop(pivot))
        column = []
        for number, other in rows.items():
            if pivot not in other:
                continue
            element = other.pop(pivot) * inverse[-1]
            column.append((number, element))
            for place, value in row.items():
                other[place] = other.get(place, ca.SX(0)) - element * value
        lower.append(tuple(column))
        upper.append(tuple(row.items()))
    return Factors(tuple(order), tuple(lower), tuple(upper), tuple(inverse))


Row = dict[int, ca.SX]


def _rows(matrix: ca.SX) -> dict[int, Row]:
    """Return the nonzeros of each row, by column."""
    rows: dict[int, Row] = {number: {} for number in range(matrix.shape[0])}
    places = zip(*matrix.sparsity().get_triplet(), strict=True)
    for number, (row, column) in enumerate(places):
        rows[row][column] = matrix.nz[number]
    return rows
